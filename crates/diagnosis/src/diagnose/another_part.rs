//! What happens once, such as the moment at which a shaft breaks loose, is not known to a fit without the part that has it.
//! Then another part is held out.

use super::judge::{NOT_NOISE, above_floor};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit};

/// The data with another part held out and the fit to them, where a model explains the seen data and not the held-out ones,
/// and where it explains those that are held out then. What happens once may remain in the seen data.
pub(super) fn held_out(data: &Dataset, prior: &Prior, found: &Fit) -> Option<(Dataset, Fit)> {
    with_others_held_out(data, prior, found).next()
}

/// The same where nothing remains.
pub(super) fn held_out_and_explained(data: &Dataset, prior: &Prior, found: &Fit) -> Option<(Dataset, Fit)> {
    with_others_held_out(data, prior, found).find(|(_, found)| explains_seen(found))
}

/// Whether a model explains the data, or would with another part held out.
pub(super) fn is_explained(data: &Dataset, prior: &Prior, found: &Fit) -> bool {
    above_floor(data, found) < NOT_NOISE || held_out_and_explained(data, prior, found).is_some()
}

fn with_others_held_out(data: &Dataset, prior: &Prior, found: &Fit) -> impl Iterator<Item = (Dataset, Fit)> {
    let others = if explains_seen(found) { Some(data.with_others_held_out()) } else { None };
    let anew = |other: Dataset| {
        let found = fit(&found.model, &other, prior, Effort::AGAIN);
        (other, found)
    };
    others.into_iter().flatten().map(anew).filter(|(other, found)| above_floor(other, found) < NOT_NOISE)
}

/// Whether a fit leaves no more than noise where it has seen the data.
fn explains_seen(found: &Fit) -> bool {
    found.cost < NOT_NOISE.powi(2) * found.used() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::Model;
    use std::fmt::Write as _;

    /// The speed of a quick motor that follows a sine. It is `off` in the middle of the first block that is held out.
    fn recorded(off: f64) -> (Dataset, Prior) {
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap();
        let data = |disturbed: &dyn Fn(usize) -> bool| {
            let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
            let mut speed = 0.0;
            for row in 0..4000 {
                let (time_s, noise) = (row as f64 * 1e-3, (row * 37 % 101) as f64 / 101.0 - 0.5);
                let (volts, more) = (8.0 * (5.0 * time_s).sin(), if disturbed(row) { off } else { 0.0 });
                let _ = writeln!(text, "{time_s:.3},{volts:.4},{:.4}", speed + 0.5 * noise + more);
                speed += 1e-3 / 0.03 * (10.0 * volts - speed);
            }
            Dataset::new(&[Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()], &rig).unwrap()
        };
        let held_out = data(&|_| false).held_out;
        let first = held_out.iter().position(|held_out| *held_out).unwrap();
        let data = data(&|row| (first + 50..first + 100).contains(&row));
        assert_eq!(data.held_out, held_out);
        let prior = Prior::new(&rig.motor, &data);
        (data, prior)
    }

    /// What no model explains may go with another part held out, but remains in the data that are seen then.
    #[test]
    fn what_is_seen_then_has_to_be_explained_as_well() {
        for (off, is_clean) in [(0.0, true), (30.0, false)] {
            let (data, prior) = recorded(off);
            let found = fit(&Model::linear(prior.motor), &data, &prior, Effort::FULL);
            assert_eq!(above_floor(&data, &found) < NOT_NOISE, is_clean);
            assert!(held_out(&data, &prior, &found).is_some(), "{off}");
            assert_eq!(is_explained(&data, &prior, &found), is_clean);
        }
    }
}

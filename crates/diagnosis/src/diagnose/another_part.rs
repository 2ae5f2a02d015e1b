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

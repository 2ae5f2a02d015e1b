//! Which effects can be trusted beside what remains.

use super::data_sheet::{excessive_inductance_h, is_implausible};
use super::judge::{self, NOT_NOISE, above_floor};
use super::select::{NAMED_SIGMAS, Selection, Standing};
pub(crate) use crate::configuration::diagnose::trust::LEAST_OF_REST;
use crate::configuration::diagnose::trust::{LEAST_OF_ANY_COURSE, LEAST_OF_SMALL_REST, LEAST_OF_USUAL};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Interval, Place, Prior, fit};
use motorbench_model::Model;
use motorbench_model::catalogue::{USUAL, effect};
use std::ops::Range;

/// Removes effects that explain too little beside the rest ([`Rest::outweighs`]): while something large is unknown,
/// small effects cannot be trusted. A model that tells nothing of the motion names no effect. Beside a rest below the
/// threshold, an effect stays if the rest would exceed the threshold without it. A usual effect stays as well if the motor
/// would be unlike the rig file's without it: that it is there is likelier than such a motor.
pub(super) fn remove_untrusted(data: &Dataset, prior: &Prior, selection: &mut Selection) {
    while let Some(rest) = Rest::of(data, &selection.last) {
        let mut weak = (0..selection.standings.len()).filter(|index| rest.outweighs(&selection.standings[*index]));
        let without = |index: usize| {
            let mut without = selection.clone();
            remove_effect(data, prior, &mut without, index);
            let may_stay = rest.tells_motion && USUAL.contains(&selection.standings[index].id);
            let is_allowed = rest.is_missing || above_floor(data, &without.last) < NOT_NOISE;
            (is_allowed && !(may_stay && keeps_the_motor(data, prior, selection, &without))).then_some(without)
        };
        let Some(without) = weak.find_map(without) else { return };
        *selection = without;
    }
}

/// Whether the motor is like the rig file's with an effect, and unlike it without. That is seen where the fit ends.
fn keeps_the_motor(data: &Dataset, prior: &Prior, with: &Selection, without: &Selection) -> bool {
    let is_unlike = |fit: &Fit| is_implausible(prior, fit) || excessive_inductance_h(prior, fit).is_some();
    !is_unlike(&with.last) && is_unlike(&fit(&without.last.model, data, prior, Effort::FULL))
}

/// Removes an effect and refits the others.
pub(super) fn remove_effect(data: &Dataset, prior: &Prior, selection: &mut Selection, index: usize) {
    let taken = selection.standings.remove(index);
    let last = fit(&selection.last.model.without(taken.id), data, prior, Effort::CHECK);
    for standing in &mut selection.standings {
        let without = fit(&last.model.without(standing.id), data, prior, Effort::CHECK);
        standing.gain = judge::gain(data, &without.prediction, &last.prediction);
    }
    selection.last = last;
}

/// The rest: what a model leaves of each measured quantity beyond the noise.
struct Rest {
    /// Whether it exceeds the threshold, so that an effect is missing.
    is_missing: bool,
    /// Whether the model tells more of the motion than that it has a mean. One whose shaft stands still does not.
    tells_motion: bool,
    /// Squares of the weights of the quantities.
    units: Vec<f64>,
    /// Weighted sum over all quantities.
    weight: f64,
}

impl Rest {
    /// The rest of a model that leaves more than noise.
    fn of(data: &Dataset, fit: &Fit) -> Option<Self> {
        let outputs = 0..data.measured.len();
        let floors: Vec<f64> =
            outputs.clone().map(|output| judge::noise(data, &fit.residual_of(data, output), output)).collect();
        let left: Vec<f64> = outputs.clone().map(|output| judge::rmse(data, &fit.prediction, output)).collect();
        let is_missing = above_floor(data, fit) >= NOT_NOISE;
        if !is_missing && left.iter().zip(&floors).all(|(left, floor)| *left < NOT_NOISE * floor) {
            return None;
        }
        let tolerated = |output: usize| data.measured[output].least_error(data.measured[output].noise);
        let unit = |output: usize| if is_missing { tolerated(output) } else { floors[output] };
        let units: Vec<f64> = outputs.clone().map(|output| unit(output).powi(2)).collect();
        let weight = outputs.map(|output| (left[output].powi(2) - floors[output].powi(2)) / units[output]).sum();
        let tells_motion = judge::fit_percent(data, &fit.prediction, data.motion_index()) > 0.0;
        Some(Self { is_missing, tells_motion, units, weight })
    }

    /// Whether an effect explains too little beside this rest.
    fn outweighs(&self, standing: &Standing) -> bool {
        if self.is_missing && !self.tells_motion {
            return true;
        }
        let explained = standing.gain.rmse.iter().zip(&self.units);
        let own: f64 = explained.map(|((before, after), unit)| (before.powi(2) - after.powi(2)) / unit).sum();
        let least = match self.is_missing {
            true if fits_any_course(standing.id) => LEAST_OF_ANY_COURSE,
            true if USUAL.contains(&standing.id) && standing.gain.sigmas > NAMED_SIGMAS => LEAST_OF_USUAL,
            true => LEAST_OF_REST,
            false if is_of_a_sensor(standing.id) => LEAST_OF_SMALL_REST,
            false => return false,
        };
        own < least * self.weight
    }
}

/// Whether the interval of an effect's strength contains zero.
pub(super) fn may_be_nothing(standing: &Standing, model: &Model, intervals: &[Interval]) -> bool {
    let Some(index) = model.terms.iter().position(|term| term.id() == standing.id) else { return false };
    let effect = model.terms[index].effect;
    let parameters = effect.about().parameters;
    let holds_nothing = |interval: &Interval, group: &Range<usize>| match interval.place {
        Place::Term(term, constant) if term == index && group.contains(&constant) => {
            Some((interval.ci95[0]..=interval.ci95[1]).contains(&parameters[constant].nothing()))
        }
        _ => None,
    };
    let may_be_nothing = |group: Range<usize>| {
        let mut known = intervals.iter().filter_map(|interval| holds_nothing(interval, &group)).peekable();
        known.peek().is_some() && known.all(|holds_nothing| holds_nothing)
    };
    effect.about().strengths().into_iter().any(may_be_nothing)
}

/// Whether an effect can fit any course over time, and so a part of an unknown effect.
fn fits_any_course(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().fits_any_course)
}

/// Whether an effect is a fault of a sensor.
fn is_of_a_sensor(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().sensor.is_some())
}

/// Whether an effect is proportional to its strength.
pub(super) fn is_of_a_scale(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().linear_in > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::Gain;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::motor::MotorParameters;
    use std::fmt::Write as _;

    /// A friction that holds the shaft may explain a current and tells nothing of the motion.
    #[test]
    fn a_model_whose_shaft_stands_still_names_no_effect() {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..2000 {
            let volts = 8.0 * (row as f64 * 5e-3).sin();
            let _ = writeln!(text, "{:.3},{volts:.4},{:.4},{:.4}", row as f64 * 1e-3, 12.0 * volts, 0.3 * volts);
        }
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap();
        let data = Dataset::new(&[Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()], &rig).unwrap();
        let prior = Prior::new(&rig.motor, &data);
        let explains_most = || {
            let gain = Gain { sigmas: 100.0, share: 1e6, rmse: vec![(1e6, 1.0); data.measured.len()] };
            Standing { id: "coulomb_friction", gain, rival: None, same: Vec::new() }
        };
        for (torque_nm, is_outweighed) in [(0.0, false), (10.0, true)] {
            let friction = effect("coulomb_friction").unwrap();
            let model = Model::linear(MotorParameters::PIVT6).with(friction, vec![torque_nm]);
            let rest = Rest::of(&data, &fit(&model, &data, &prior, Effort::NONE)).expect("it leaves more than noise");
            assert_eq!(rest.outweighs(&explains_most()), is_outweighed, "{torque_nm} Nm");
        }
    }
}

//! Determines what a speed is where the rig file does not give it: an instantaneous value, a mean since the row before,
//! or a speed timed by edges in one of two ways. A mean is late by half its length, which is not a delay of the bridge.

use super::judge::{AS_GOOD, NOT_NOISE, above_floor};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit};
use motorbench_model::Term;

/// Without a delay, another reading has to lower the cost to this share. Rows are mostly short beside the motor's time
/// constant, and many causes fit a little better with a small delay.
const LEAST_GAIN: f64 = 0.9;

/// Takes the other reading of the speed, if it explains a delay or a rest. Returns whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    // A mean over a row is late by at most one row.
    let is_short = |late_s: f64| late_s > 0.0 && late_s < data.interval_s;
    let late = found.model.terms.iter().find(|term| is_short(term.effect.speed_late_s(&term.values))).map(Term::id);
    let has_rest = above_floor(data, found) > NOT_NOISE;
    if !(late.is_some() || has_rest) {
        return false;
    }
    let Some(other) = data.with_other_speed_reading() else { return false };
    let model = late.map_or_else(|| found.model.clone(), |id| found.model.without(id));
    let cost = fit(&model, &other, prior, Effort::TRIAL).cost;
    let explains = cost <= if late.is_some() { AS_GOOD } else { LEAST_GAIN } * found.cost;
    if explains {
        *data = other;
    }
    explains
}

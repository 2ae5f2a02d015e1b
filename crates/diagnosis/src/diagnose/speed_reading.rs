//! What a speed is where the rig file does not say it: of the moment, a mean since the row before, or timed by edges one way
//! or the other. A mean is late by half its length, which no delay need explain.

use super::judge::{AS_GOOD, NOT_NOISE, above_floor};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit};
use motorbench_model::Term;

/// Where there is none a reading has to bring the cost down to this share of it: rows are mostly short beside a motor, and many
/// causes are a little less wrong a little later.
const LEAST_GAIN: f64 = 0.9;

/// Takes the speed for the other reading, if that explains what would be a delay or a rest; whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    // A mean over a row is late by no more than one.
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

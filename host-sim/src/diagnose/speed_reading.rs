//! What a speed is where the rig file does not say it: of the moment, a mean since the row before, or timed by edges one way
//! or the other. A mean is late by half its length, which no delay need explain.

use super::judge::{AS_GOOD, NOT_NOISE, above_floor};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit};

/// What comes late by a mean over a row: a delay of no more than one.
const LATE: &str = "actuation_delay";
/// Where there is none a reading has to bring the cost down to this share of it: rows are mostly short beside a motor, and many
/// causes are a little less wrong a little later.
const LEAST_GAIN: f64 = 0.9;

/// Takes the speed for the other reading, if that explains what would be a delay or a rest; whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    let is_late = found.model.term(LATE).is_some_and(|late| late.values[0] < data.interval_s);
    let has_rest = above_floor(data, found) > NOT_NOISE;
    if !(is_late || has_rest) {
        return false;
    }
    let Some(other) = data.with_other_speed_reading() else { return false };
    let model = if is_late { found.model.without(LATE) } else { found.model.clone() };
    let cost = fit(&model, &other, prior, Effort::TRIAL).cost;
    let explains = cost <= if is_late { AS_GOOD } else { LEAST_GAIN } * found.cost;
    if explains {
        *data = other;
    }
    explains
}

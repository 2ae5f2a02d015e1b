//! Estimates the time over which a program averaged the current before each row (a PWM period, a burst of conversions),
//! where the rig file does not give it. Such a reading is late by half of that time, which is not a lag of the sensor.

use super::another_part::is_explained;
use super::judge::{AS_GOOD, NOT_NOISE, VERY_STRONG_NATS, above_floor, evidence_nats, motion_above_floor};
use crate::configuration::diagnose::current_window::{
    CLOSER, EXCESSIVE_INDUCTANCE, LATEST_S, LEAST_BESIDE, LEAST_GAIN, LOOKED_AT_S,
};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit, scales};
use maybe_rayon::prelude::*;
use motorbench_data::rig::Readings;
use motorbench_model::catalogue::effect;
use motorbench_model::{Model, Term};

/// Identifier of the lag of a current, which resembles a window.
const CURRENT_LAG: &str = "current_lag";

/// Sets the window beside which a model explains everything, if there is one and the model lacks nothing of the motion.
pub(super) fn settle_at_first(data: &mut Dataset, prior: &Prior, found: &Fit) {
    let may_explain = is_open(data) && motion_above_floor(data, found) < NOT_NOISE;
    let best = if may_explain { best_window(data, prior, &found.model) } else { None };
    let Some((window_s, best)) = best else { return };
    let other = with_window(data, window_s);
    if is_explained(&other, prior, &best) {
        *data = other;
    }
}

/// Whether a window that was set first has very strong evidence beside the effects that were found with it, and no lag
/// explains more.
pub(super) fn is_needed(data: &Dataset, prior: &Prior, found: &Fit) -> bool {
    if data.origin.current_window_s == 0.0 || !is_open(data) {
        return true;
    }
    let at_once = with_window(data, 0.0);
    let least_nats = VERY_STRONG_NATS + ((LOOKED_AT_S.len() * CLOSER.len()) as f64).ln();
    let without = fit(&found.model, &at_once, prior, Effort::AGAIN);
    let lag = effect(CURRENT_LAG).filter(|lag| !found.model.has(lag.about().id));
    let lagging = lag.map(|lag| found.model.with_start(lag, &scales(&found.model.motor, data)));
    let lagging = lagging.map(|model| fit(&model, &at_once, prior, Effort::AGAIN));
    evidence_nats(data, &without, found) > least_nats
        && lagging.is_none_or(|lagging| found.cost <= AS_GOOD * lagging.cost)
}

/// Sets the window if it explains a lag, a rest, or an excessive inductance. Returns whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    let best = if is_open(data) { likelier_s(data, prior, found) } else { None };
    data.origin.current_window_s = best.unwrap_or(data.origin.current_window_s);
    best.is_some()
}

/// Whether neither the rig file nor a ripple says over what time a current is averaged.
fn is_open(data: &Dataset) -> bool {
    data.origin.timing.readings == Readings::Instant
        && data.origin.timing.current_sampled_at.is_none()
        && data.origin.pwm_phase.is_none()
        && data.origin.timing.current_window_s.is_none()
        && data.current().is_some()
}

fn with_window(data: &Dataset, window_s: f64) -> Dataset {
    let mut other = data.clone();
    other.origin.current_window_s = window_s;
    other
}

fn likelier_s(data: &Dataset, prior: &Prior, found: &Fit) -> Option<f64> {
    let is_short = |late_s: f64| late_s > 0.0 && late_s < LATEST_S;
    let terms = found.model.terms.iter().filter(|term| is_short(term.effect.current_late_s(&term.values)));
    let late: Vec<&str> = terms.map(Term::id).collect();
    let is_late = !late.is_empty();
    let has_rest = above_floor(data, found) > NOT_NOISE;
    if !(is_late || has_rest || is_excessive(prior, found)) {
        return None;
    }
    let model = late.iter().fold(found.model.clone(), |model, id| model.without(id));
    let (window_s, best) = best_window(data, prior, &model)?;
    let explains = match (is_late, has_rest) {
        (true, _) => best.cost <= AS_GOOD * found.cost,
        (false, true) => {
            let still_has_rest = above_floor(data, &best) > NOT_NOISE;
            best.cost <= if still_has_rest { LEAST_BESIDE } else { LEAST_GAIN } * found.cost
        }
        (false, false) => best.cost <= found.cost && !is_excessive(prior, &best),
    };
    explains.then_some(window_s)
}

fn best_window(data: &Dataset, prior: &Prior, model: &Model) -> Option<(f64, Fit)> {
    let fitted =
        |window_s: f64, model: &Model| (window_s, fit(model, &with_window(data, window_s), prior, Effort::TRIAL));
    let least = |fits: Vec<(f64, Fit)>| fits.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    let mut best = least(LOOKED_AT_S.into_par_iter().map(|window_s| fitted(window_s, model)).collect())?;
    let longest_s = LOOKED_AT_S[LOOKED_AT_S.len() - 1];
    for factor in CLOSER {
        let sides = [best.0 / factor, (best.0 * factor).min(longest_s)];
        let mut fits: Vec<(f64, Fit)> = sides.into_par_iter().map(|window_s| fitted(window_s, &best.1.model)).collect();
        fits.push(best);
        best = least(fits)?;
    }
    Some(best)
}

fn is_excessive(prior: &Prior, fit: &Fit) -> bool {
    prior.nominal.inductance_h.is_some_and(|nominal_h| fit.model.motor.inductance_h > EXCESSIVE_INDUCTANCE * nominal_h)
}

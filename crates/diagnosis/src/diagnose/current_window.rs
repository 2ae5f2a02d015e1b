//! Estimates the time over which a program averaged the current before each row (a PWM period, a burst of conversions),
//! where the rig file does not give it. Such a reading is late by half of that time, which is not a lag of the sensor.

use super::judge::{AS_GOOD, NOT_NOISE, above_floor};
use crate::configuration::diagnose::current_window::{
    CLOSER, EXCESSIVE_INDUCTANCE, LATEST_S, LEAST_BESIDE, LEAST_GAIN, LOOKED_AT_S,
};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit};
use maybe_rayon::prelude::*;
use motorbench_data::rig::Readings;
use motorbench_model::{Model, Term};

/// Sets the window if it explains a lag, a rest, or an excessive inductance. Returns whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    let is_open = data.origin.timing.readings == Readings::Instant
        && data.origin.timing.current_sampled_at.is_none()
        && data.origin.pwm_phase.is_none()
        && data.origin.timing.current_window_s.is_none()
        && data.current().is_some();
    let best = if is_open { likelier_s(data, prior, found) } else { None };
    data.origin.current_window_s = best.unwrap_or(data.origin.current_window_s);
    best.is_some()
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
    let fitted = |window_s: f64, model: &Model| {
        let mut other = data.clone();
        other.origin.current_window_s = window_s;
        (window_s, fit(model, &other, prior, Effort::TRIAL))
    };
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

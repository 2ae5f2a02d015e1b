//! Estimates the time over which a program averaged the current before each row (a PWM period, a burst of conversions),
//! where the rig file does not give it. Such a reading is late by half of that time, which is not a lag of the sensor.

use super::another_part::is_explained;
use super::judge::{NOT_NOISE, VERY_STRONG_NATS, above_floor, evidence_nats, explains_as_much, motion_above_floor};
use crate::configuration::diagnose::current_window::{
    CLOSER, EXCESSIVE_INDUCTANCE, LATEST_S, LEAST_BESIDE, LEAST_GAIN, LOOKED_AT_S,
};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit, scales};
use crate::parallel;
use motorbench_data::rig::Readings;
use motorbench_model::catalogue::{ACTUATION_DELAY, About, effect};
use motorbench_model::{Model, Term};

/// What makes a current late as a window does: a lag of its sensor, and a command that acts late.
const LATE_CURRENT: [&str; 2] = ["current_lag", ACTUATION_DELAY];

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

/// Whether a window that was set first has very strong evidence beside the effects that were found with it, and no lag or delay
/// explains more.
pub(super) fn is_needed(data: &Dataset, prior: &Prior, found: &Fit) -> bool {
    if data.origin.current_window_s == 0.0 || !is_open(data) {
        return true;
    }
    let at_once = with_window(data, 0.0);
    let least_nats = VERY_STRONG_NATS + ((LOOKED_AT_S.len() * CLOSER.len()) as f64).ln();
    let without = fit(&found.model, &at_once, prior, Effort::AGAIN);
    if evidence_nats(data, &without, found) <= least_nats {
        return false;
    }
    explains_as_much_as_lateness(data, &at_once, prior, found)
}

/// Whether no lag and no delay of the data without a window, `at_once`, explains more than the window beside which a model was
/// found.
fn explains_as_much_as_lateness(data: &Dataset, at_once: &Dataset, prior: &Prior, found: &Fit) -> bool {
    let scales = scales(&found.model.motor, data);
    let late = LATE_CURRENT.iter().filter(|id| !found.model.has(id)).filter_map(|id| effect(id));
    let explained = parallel::map(late, |effect| {
        let late = fit(&found.model.with_start(effect, &scales), at_once, prior, Effort::AGAIN);
        explains_as_much(data, found, &late, effect.about())
    });
    explained.into_iter().all(|explained| explained)
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
    let late: Vec<&About> = terms.map(|term| term.effect.about()).collect();
    let is_late = !late.is_empty();
    let has_rest = above_floor(data, found) > NOT_NOISE;
    if !(is_late || has_rest || is_excessive(prior, found)) {
        return None;
    }
    let model = late.iter().fold(found.model.clone(), |model, late| model.without(late.id));
    let (window_s, best) = best_window(data, prior, &model)?;
    let other = with_window(data, window_s);
    let best = fit(&best.model, &other, prior, Effort::AGAIN);
    let explains = match (is_late, has_rest) {
        (true, _) => late.iter().all(|late| explains_as_much(data, &best, found, late)),
        (false, true) => {
            let still_has_rest = above_floor(data, &best) > NOT_NOISE;
            best.cost <= if still_has_rest { LEAST_BESIDE } else { LEAST_GAIN } * found.cost
        }
        (false, false) => best.cost <= found.cost && !is_excessive(prior, &best),
    };
    (explains && (is_late || explains_as_much_as_lateness(&other, &with_window(data, 0.0), prior, &best)))
        .then_some(window_s)
}

/// The likeliest window, and the model fitted beside it.
fn best_window(data: &Dataset, prior: &Prior, model: &Model) -> Option<(f64, Fit)> {
    let least = |fits: Vec<(f64, Fit)>| fits.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    let fitted =
        |window_s: f64, start: &Model| (window_s, fit(start, &with_window(data, window_s), prior, Effort::TRIAL));
    let mut best = least(parallel::map(LOOKED_AT_S, |window_s| fitted(window_s, model)))?;
    let longest_s = LOOKED_AT_S[LOOKED_AT_S.len() - 1];
    for factor in CLOSER {
        let sides = [best.0 / factor, (best.0 * factor).min(longest_s)];
        let beside = |window_s: f64| fitted(window_s, &later(&best.1.model, 0.5 * (best.0 - window_s)));
        let fits = parallel::map(sides, beside);
        best = least(fits.into_iter().chain([best]).collect())?;
    }
    Some(best)
}

/// A model with its delay so much longer. Beside a longer window a fit would begin with readings that are later than before.
fn later(model: &Model, by_s: f64) -> Model {
    let mut other = model.clone();
    for Term { effect, values } in &mut other.terms {
        if effect.delay_s(values) > 0.0 {
            values[0] = (values[0] + by_s).max(0.0);
        }
    }
    other
}

fn is_excessive(prior: &Prior, fit: &Fit) -> bool {
    prior.nominal.inductance_h.is_some_and(|nominal_h| fit.model.motor.inductance_h > EXCESSIVE_INDUCTANCE * nominal_h)
}

#[cfg(test)]
mod tests {
    use super::super::pwm_frequency::with_usual_bridges;
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use std::fmt::Write as _;

    /// Times that a millisecond is divided into.
    const STEPS: usize = 100;

    /// A motor with friction. `read` has the last reading and the currents since the row before.
    fn recorded(read: impl Fn(f64, &[f64]) -> f64) -> (Dataset, Prior) {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        let (mut speed, mut current, mut reading) = (0.0_f64, 0.0_f64, 0.0);
        for row in 0..4000_usize {
            let volts = [8.0, -8.0, 4.0, -4.0, 10.0, 0.0, -10.0, 2.0][row / 250 % 8];
            let noise = |prime: usize| (row * prime % 101) as f64 / 101.0 - 0.5;
            let (of_speed, of_current) = (0.5 * noise(37), 0.01 * noise(59));
            let _ =
                writeln!(text, "{:.3},{volts},{:.4},{:.5}", row as f64 * 1e-3, speed + of_speed, reading + of_current);
            let mut since = Vec::new();
            let step_s = 1e-3 / STEPS as f64;
            for _ in 0..STEPS {
                current += step_s * (volts - 5.8 * current - 0.07 * speed) / 3e-3;
                let free = speed + step_s * (0.07 * current - 6e-6 * speed) / 4e-5;
                let lost = step_s * 6e-3 / 4e-5;
                speed = if free.abs() <= lost { 0.0 } else { free - lost * free.signum() };
                since.push(current);
            }
            reading = read(reading, &since);
        }
        let rig = "[supply]\nvoltage_V = 12\n[bridge]\npwm_Hz = 31372\n[recording]\ncommand_delay_s = 0\n";
        let rig = Rig::parse("rig.toml", rig).unwrap();
        let data = Dataset::new(&[Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()], &rig).unwrap();
        let prior = Prior::new(&rig.nominal(), &data);
        (data, prior)
    }

    fn usual(data: &Dataset, prior: &Prior) -> Fit {
        let braking = with_usual_bridges(data, prior).swap_remove(0);
        fit(&braking, data, prior, Effort::FULL)
    }

    /// A low-pass looks like a window, and explains more where there is one.
    #[test]
    fn a_window_is_set_first_where_the_current_is_a_mean() {
        let mean = |_: f64, since: &[f64]| since.iter().sum::<f64>() / STEPS as f64;
        let lagging =
            |before: f64, since: &[f64]| since.iter().fold(before, |lag, now| lag + (now - lag) / (0.5 * STEPS as f64));
        for (name, (mut data, prior), is_window) in [("mean", recorded(mean), true), ("lag", recorded(lagging), false)]
        {
            let at_first = usual(&data, &prior);
            settle_at_first(&mut data, &prior, &at_first);
            let window_s = data.origin.current_window_s;
            let is_kept = window_s > 0.0 && is_needed(&data, &prior, &usual(&data, &prior));
            assert_eq!(is_kept, is_window, "{name}: {window_s} s");
            assert!(!is_window || (window_s - 1e-3).abs() < 0.15e-3, "{window_s} s");
        }
    }
}

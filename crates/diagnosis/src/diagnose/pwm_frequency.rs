//! Estimates the frequency of the PWM, where the rig file does not give it. It shows where a drop or diodes stop the
//! current within a period. Another inductance has a similar effect there.

use super::judge::{AS_GOOD, NOT_NOISE, above_floor, explains_as_much};
use crate::configuration::diagnose::pwm_frequency::{LEAST_LOG_LIKELIHOOD_GAIN, NEARER, SHOWS, USUAL_HZ};
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Prior, fit, scales};
use crate::parallel;
use motorbench_model::catalogue::{About, USUAL, effect};
use motorbench_model::{Model, Term};

/// Sets the frequency with which the nominal motor, behind a bridge with a drop, fits clearly better. Its off phase may
/// brake or coast.
pub(super) fn settle_at_first(data: &mut Dataset, prior: &Prior) {
    if data.origin.pwm_is_known {
        return;
    }
    let best = usual_bridge(data, prior);
    data.origin.pwm_hz = likelier_hz(data, prior, &best, LEAST_LOG_LIKELIHOOD_GAIN).unwrap_or(data.origin.pwm_hz);
}

/// The best of [`with_usual_bridges`], fitted.
pub(super) fn usual_bridge(data: &Dataset, prior: &Prior) -> Fit {
    let fits = parallel::map(with_usual_bridges(data, prior), |model| fit(&model, data, prior, Effort::TRIAL));
    fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("one at least")
}

/// The nominal motor with the usual effects, behind a bridge whose off phase brakes, and behind one whose off phase coasts.
pub(super) fn with_usual_bridges(data: &Dataset, prior: &Prior) -> Vec<Model> {
    let scales = scales(&prior.motor, data);
    let usual = USUAL.iter().filter_map(|id| effect(id));
    let braking = usual.fold(Model::linear(prior.motor), |model, effect| model.with_start(effect, &scales));
    let coasting = effect("coast_decay").map(|effect| braking.with_start(effect, &scales));
    [Some(braking), coasting].into_iter().flatten().collect()
}

/// Sets the frequency with which a model fits better, or equally well with a more plausible winding. Returns whether it
/// changed.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    if data.origin.pwm_is_known || !data.axis.drive.is_voltage() {
        return false;
    }
    if let Some(other) = in_place_of_a_lag(data, prior, found) {
        *data = other;
        return true;
    }
    let least_gain = if above_floor(data, found) < NOT_NOISE { f64::INFINITY } else { LEAST_LOG_LIKELIHOOD_GAIN };
    let other = likelier_hz(data, prior, found, least_gain);
    data.origin.pwm_hz = other.unwrap_or(data.origin.pwm_hz);
    other.is_some()
}

/// The data with a frequency that explains as much as a lag of the current. A current that stops within each period looks
/// late, and a mean over a period is.
fn in_place_of_a_lag(data: &Dataset, prior: &Prior, found: &Fit) -> Option<Dataset> {
    let (late, prompt) = without_lag_of_current(&found.model)?;
    let windows_s = |hz: f64| {
        let of_period_s = data.reads_instants().then_some(1.0 / hz);
        [Some(data.origin.current_window_s), of_period_s].into_iter().flatten()
    };
    let others = USUAL_HZ.into_iter().flat_map(|hz| windows_s(hz).map(move |window_s| (hz, window_s)));
    let others: Vec<Dataset> = others.map(|(hz, window_s)| with_pwm(data, hz, window_s)).collect();
    let fits = parallel::map(others, |other| {
        let found = fit(&prompt, &other, prior, Effort::AGAIN);
        (other, found)
    });
    let (other, best) = fits.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))?;
    explains_as_much(&other, &best, found, late).then_some(other)
}

/// What makes the current late in a model, if something does, and the model without it.
pub(super) fn without_lag_of_current(model: &Model) -> Option<(&'static About, Model)> {
    let is_late = |term: &&Term| term.effect.current_late_s(&term.values) > 0.0 && !term.effect.acts_on_motor();
    model.terms.iter().find(is_late).map(|late| (late.effect.about(), model.without(late.id())))
}

fn with_pwm(data: &Dataset, hz: f64, window_s: f64) -> Dataset {
    let mut other = data.clone();
    (other.origin.pwm_hz, other.origin.current_window_s) = (hz, window_s);
    other
}

/// Chooses one that lowers the cost to `least_gain` of the present one.
fn likelier_hz(data: &Dataset, prior: &Prior, found: &Fit, least_gain: f64) -> Option<f64> {
    let others = USUAL_HZ.into_iter().filter(|hz| *hz != data.origin.pwm_hz);
    let fits = parallel::map(others, |hz| {
        let other = with_pwm(data, hz, data.origin.current_window_s);
        let as_it_stands = fit(&found.model, &other, prior, Effort::NONE);
        let shows = (as_it_stands.cost / found.cost - 1.0).abs() > SHOWS;
        let mut model = found.model.clone();
        // The current ripple of a period stays the same.
        model.motor.inductance_h *= data.origin.pwm_hz / hz;
        shows.then(|| (hz, fit(&model, &other, prior, Effort::TRIAL)))
    });
    let fits: Vec<(f64, Fit)> = fits.into_iter().flatten().collect();
    let off = |fit: &Fit| (fit.model.motor.inductance_h / prior.motor.inductance_h).ln().abs();
    let least = fits.iter().map(|(_, fit)| fit.cost).fold(found.cost, f64::min);
    if least > least_gain * found.cost {
        return None;
    }
    let is_as_good = |fit: &Fit| fit.cost <= AS_GOOD * least;
    let (hz, best) = fits.iter().filter(|(_, fit)| is_as_good(fit)).min_by(|a, b| off(&a.1).total_cmp(&off(&b.1)))?;
    let better = !is_as_good(found) || off(best) + NEARER.ln() < off(found);
    better.then_some(*hz)
}

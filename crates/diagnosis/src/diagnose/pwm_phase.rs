//! Estimates where in its period the PWM is at time 0, where the rig file gives its frequency. Rows and PWM come from one
//! clock, so one phase holds for the whole recording. Between rows the phase advances. It shows where each current is
//! sampled at one instant. Where the PWM is slow beside the rows, it also shows in when a command begins to act.

use super::judge::{VERY_STRONG_NATS, evidence_nats};
use super::pwm_frequency::with_usual_bridges;
use crate::dataset::{Dataset, Output, Stretch};
use crate::identify::{Effort, Fit, Prior, fit};
use maybe_rayon::prelude::*;
use motorbench_model::Model;

/// Phases that are tried first, and the number of halvings that refine the best one. Where commands wait for a slow PWM, a
/// slightly other phase lets some of them act a whole period later.
const PHASES: usize = 12;
const PHASES_OF_SLOW: usize = 192;
/// So many of those are fitted, far from each other.
const FITTED: usize = 4;
const HALVINGS: i32 = 4;
/// A phase has to lower the squared error to this share of that of a mean over a period: beside an effect that is missing,
/// some phase always fits a little better.
const LEAST_GAIN: f64 = 0.6;
/// Between rows that lie this far apart the phase advances, but what is missing hardly changes.
const FAST_ROWS: usize = 5;
/// A phase shows in any part of a recording in which the command changes; this much suffices.
const EXCERPT_S: f64 = 3.0;

/// Sets the phase if the nominal motor fits clearly better with it than with a mean over a period, or at least what varies
/// from row to row does. Its bridge has a drop or none, and brakes or coasts in the off phase.
pub(super) fn settle_at_first(data: &mut Dataset, prior: &Prior) {
    let is_open = data.origin.pwm_is_known && data.origin.timing.current_sampled_at.is_none();
    if !is_open || !(data.reads_instants() || data.is_pwm_slow()) {
        return;
    }
    let Some(way) = likelier(&data.excerpt(EXCERPT_S), prior) else { return };
    data.origin.pwm_phase = if data.is_pwm_slow() { in_everything(data, prior, &way) } else { Some(way.phase) };
}

/// The phase of a slow PWM. It shows in a few commands alone, and the clocks of rows and PWM may drift apart, so everything
/// decides.
fn in_everything(data: &Dataset, prior: &Prior, way: &Way) -> Option<f64> {
    let whole = Way::new(data, prior, &way.model)?;
    let as_before = fit(&way.model, &data.with_pwm_phase(Some(way.phase)), prior, Effort::TRIAL).cost;
    let (phase, cost) =
        if as_before < whole.found.cost { (way.phase, as_before) } else { (whole.phase, whole.found.cost) };
    (cost < whole.mean.cost).then_some(phase)
}

/// Sets the phase of a slow PWM if a model that was found has very strong evidence for one. Returns whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    let is_known = data.origin.pwm_phase.or(data.origin.timing.current_sampled_at).is_some();
    let is_open = data.is_pwm_slow() && !is_known;
    let found_in = |phase: f64| fit(&found.model, &data.with_pwm_phase(Some(phase)), prior, Effort::TRIAL);
    let way = if is_open { Way::new(data, prior, &found.model) } else { None };
    let phase = way.map(|way| way.phase).filter(|phase| {
        let other = found_in(*phase);
        other.cost < found.cost && evidence_nats(data, found, &other) > least_nats(data)
    });
    data.origin.pwm_phase = phase.or(data.origin.pwm_phase);
    phase.is_some()
}

/// Very strong evidence for one phase of all that are tried.
fn least_nats(data: &Dataset) -> f64 {
    VERY_STRONG_NATS + (phases(data) as f64 * f64::from(1 << HALVINGS)).ln()
}

fn phases(data: &Dataset) -> usize {
    if data.is_pwm_slow() { PHASES_OF_SLOW } else { PHASES }
}

fn likelier(data: &Dataset, prior: &Prior) -> Option<Way> {
    let mut models = vec![Model::linear(prior.motor)];
    models.extend(with_usual_bridges(data, prior));
    let ways: Vec<Way> = models.into_par_iter().filter_map(|model| Way::new(data, prior, &model)).collect();
    let least = |error: fn(&Way) -> f64| ways.iter().map(error).fold(f64::INFINITY, f64::min);
    let (least_cost, least_fast) = (least(|way| way.mean.cost), least(|way| way.mean.fast));
    let best = ways.into_iter().min_by(|a, b| a.found.cost.total_cmp(&b.found.cost))?;
    let explains = best.found.cost < LEAST_GAIN * least_cost
        || best.found.fast < LEAST_GAIN * least_fast
        || best.found.cost < least_cost && best.nats > least_nats(data);
    explains.then_some(best)
}

/// Squared errors of a model.
struct Errors {
    cost: f64,
    /// Of the current, as far as it varies from row to row.
    fast: f64,
}

impl Errors {
    fn of(data: &Dataset, fit: &Fit) -> Self {
        let Some(output) = data.measured.iter().position(|measured| measured.output == Output::Current) else {
            return Self { cost: fit.cost, fast: f64::INFINITY };
        };
        let residual = fit.residual_of(data, output);
        let of_stretch = |stretch: &Stretch| {
            let around = residual[stretch.rows.clone()].windows(2 * FAST_ROWS + 1);
            let fast = around.map(|around| around[FAST_ROWS] - around.iter().sum::<f64>() / around.len() as f64);
            fast.filter(|fast| fast.is_finite()).map(|fast| fast * fast).sum::<f64>()
        };
        Self { cost: fit.cost, fast: data.stretches.iter().map(of_stretch).sum() }
    }
}

/// A model that reads the mean over a period, and one that reads in its best phase.
struct Way {
    mean: Errors,
    found: Errors,
    /// Evidence for the phase.
    nats: f64,
    phase: f64,
    model: Model,
}

impl Way {
    fn new(data: &Dataset, prior: &Prior, model: &Model) -> Option<Self> {
        let mean = fit(model, &data.with_pwm_phase(None), prior, Effort::TRIAL);
        let in_phase = |phase: f64, model: &Model, effort: Effort| -> (f64, Fit) {
            let phase = phase.rem_euclid(1.0);
            (phase, fit(model, &data.with_pwm_phase(Some(phase)), prior, effort))
        };
        let least = |ways: Vec<(f64, Fit)>| ways.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        // Commands that wait look like more inductance.
        let mut start = mean.model.clone();
        start.motor.inductance_h = start.motor.inductance_h.min(prior.motor.inductance_h);
        let phases = phases(data);
        let first = (0..phases).into_par_iter();
        let first = first.map(|phase| in_phase(phase as f64 / phases as f64, &start, Effort::NONE));
        let first: Vec<(f64, Fit)> = first.collect();
        // Neighbours lead to the same one.
        let groups = first.chunks(phases / PHASES).filter_map(|group| least(group.to_vec()));
        let mut first: Vec<(f64, Fit)> = groups.collect();
        first.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        first.truncate(if data.is_pwm_slow() { FITTED } else { 1 });
        let fitted = first.into_par_iter().map(|(phase, found)| in_phase(phase, &found.model, Effort::TRIAL));
        let mut best = least(fitted.collect())?;
        for halving in 1..=HALVINGS {
            let distance = 1.0 / phases as f64 / f64::from(1 << halving);
            let sides = [-distance, distance].map(|side| in_phase(best.0 + side, &best.1.model, Effort::NONE));
            best = least(sides.into_iter().chain([best]).collect())?;
        }
        let (phase, found) = in_phase(best.0, &best.1.model, Effort::TRIAL);
        let nats = evidence_nats(data, &mean, &found);
        Some(Self { mean: Errors::of(data, &mean), found: Errors::of(data, &found), nats, phase, model: found.model })
    }
}

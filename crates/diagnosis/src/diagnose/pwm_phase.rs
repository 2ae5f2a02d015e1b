//! Estimates where in its period the PWM is at time 0. Rows and PWM come from one clock, so one phase holds for the whole
//! recording. It shows where each current is sampled at one instant: the ripple gives frequency and phase. Where the PWM is
//! slow, the phase also shows in when a command begins to act.

use super::judge::{AS_GOOD, VERY_STRONG_NATS, evidence_nats, explains_as_much};
use super::pwm_frequency::{with_usual_bridges, without_lag_of_current};
use super::pwm_ripple::ripples;
use super::select::{LEAST_SHARE, NEAR};
use crate::configuration::diagnose::pwm_phase::{
    BESIDE, EXCERPT_S, FIRST_FILTER, FIRST_WINDOWS, FITTED, HALVINGS, PHASES, PHASES_OF_SLOW, RIPPLE_TELLS, RIPPLES,
};
use crate::dataset::{Dataset, Latch, Pulse};
use crate::identify::{Effort, Fit, Item, Prior, fit, fit_with_items};
use crate::parallel;
use motorbench_model::Model;

/// Sets the phase that the ripple in the current shows, and the frequency that it has. Where no ripple is read, commands
/// that wait for a slow PWM may show the phase. The nominal motor is taken, behind a bridge that has a drop or none, and
/// that brakes or coasts in the off phase.
pub(super) fn settle_at_first(data: &mut Dataset, prior: &Prior) {
    let is_known = data.origin.timing.current_sampled_at.or(data.origin.pwm_phase).is_some();
    if is_known {
        return;
    }
    let mut models = vec![Model::linear(prior.motor)];
    models.extend(with_usual_bridges(data, prior));
    let mean = || {
        let means = parallel::map(&models, |model| fit(model, data, prior, Effort::TRIAL));
        means.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost))
    };
    let found = if data.reads_instants() { mean() } else { None };
    if let Some(by_ripple) = found.and_then(|mean| by_ripple(data, prior, &models, &mean)) {
        *data = by_ripple;
    } else if let Some(by_commands) = by_commands(data, prior, &models) {
        *data = by_commands;
    }
}

/// The data with the frequency and the phase of a ripple, if that has very strong evidence. `mean` reads means over a period.
/// Rows in step with the PWM see a ripple that depends on the duty alone, as much of what the models may lack does. Its line
/// in the spectrum is none.
fn by_ripple(data: &Dataset, prior: &Prior, models: &[Model], mean: &Fit) -> Option<Dataset> {
    let found = ripples(data, mean);
    let others = found.iter().map(|ripple| (ripple, data.with_pwm_of(ripple.hz, ripple.pulse)));
    let ways = others.filter(|(_, other)| !other.is_in_step()).take(RIPPLES).filter_map(|(ripple, other)| {
        let near = Some(ripple.phase(&prior.motor));
        let way = likeliest(&other.excerpt(EXCERPT_S), prior, models, near)
            .filter(|way| way.found.cost <= AS_GOOD * way.mean.cost)?;
        let phase = if other.is_pwm_slow() { in_everything(&other, prior, &way, near)?.0 } else { way.phase };
        let (other, found) = by_either_timer(&other.with_pwm_phase(Some(phase)), prior, &way.found.model);
        Some((found, other, ripple.nats))
    });
    let (found, other, line_nats) = ways.min_by(|a, b| a.0.cost.total_cmp(&b.0.cost))?;
    // What the models lack besides does not hide a line in the spectrum.
    let nats = evidence_nats(data, mean, &found).max(if found.cost < mean.cost { line_nats } else { 0.0 });
    let shows = nats > least_nats(&other);
    shows.then(|| of_instants(other, prior, found))
}

/// The data in a phase that shows, as they are read there.
fn of_instants(data: Dataset, prior: &Prior, found: Fit) -> Dataset {
    let (data, found) = as_read(data, prior, found);
    data.with_instants_blurred(found.model.motor.inductance_h)
}

/// The data of rows in step with a PWM that is averaged, read at the instant that fits best, if that explains enough and has
/// very strong evidence beside the effects that were found. What such rows see of the ripple depends on the duty alone, as what
/// an effect lacks does. `mean` reads means over a period.
fn by_duty(data: &Dataset, prior: &Prior, mean: &Fit) -> Option<Dataset> {
    let is_asked_for = data.is_in_step() && data.is_one_recording() && data.origin.current_window_s <= 0.0;
    if !is_asked_for || !a_phase_may_show(data, prior, mean) {
        return None;
    }
    let ways = Pulse::ALL.into_iter().filter_map(|pulse| {
        let other = data.with_pwm_of(data.origin.pwm_hz, pulse);
        let way = Way::new(&other.excerpt(EXCERPT_S), prior, &mean.model, None)?;
        let other = other.with_pwm_phase(Some(way.phase));
        let found = fit(&way.found.model, &other, prior, Effort::TRIAL);
        Some((other, found))
    });
    let (other, better) = ways.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))?;
    let explains = better.cost <= (1.0 - LEAST_SHARE) * mean.cost;
    let shows = explains && evidence_nats(data, mean, &better) > least_nats(data);
    shows.then(|| of_instants(other, prior, better))
}

/// Whether a phase of rows in step may have very strong evidence, by first derivatives around the fit that reads means.
fn a_phase_may_show(data: &Dataset, prior: &Prior, mean: &Fit) -> bool {
    let phases = (0..PHASES).map(|step| step as f64 / PHASES as f64);
    let ways = phases.flat_map(|phase| Pulse::ALL.map(|pulse| (pulse, phase)));
    let promised = parallel::map(ways, |(pulse, phase)| {
        let other = data.with_pwm_of(data.origin.pwm_hz, pulse).with_pwm_phase(Some(phase));
        mean.promised_by(data, &fit(&mean.model, &other, prior, Effort::NONE))
    });
    let left = mean.cost - promised.into_iter().fold(0.0, f64::max);
    0.5 * mean.independent_residuals(data) * (mean.cost / left.max(f64::MIN_POSITIVE)).ln() > least_nats(data)
}

/// The data in the phase with which a model fits best, and the fit. A slow PWM takes a duty at once if that has very strong
/// evidence: most timers wait for the next period.
fn by_either_timer(data: &Dataset, prior: &Prior, model: &Model) -> (Dataset, Fit) {
    let waiting = in_step(&data.with_latch(Latch::WithPeriod), prior, model);
    if !data.is_pwm_slow() {
        return waiting;
    }
    let prompt = in_step(&data.with_latch(Latch::AtOnce), prior, model);
    let shows = evidence_nats(data, &waiting.1, &prompt.1) > VERY_STRONG_NATS;
    if shows { prompt } else { waiting }
}

/// The same with the timer that the data have.
fn in_step(data: &Dataset, prior: &Prior, model: &Model) -> (Dataset, Fit) {
    let (other, found) = polished(data, prior, fit(model, data, prior, Effort::TRIAL));
    // As an instant, a mean over a part of a period may agree best with another timer.
    over_a_window(other, prior, found)
}

/// The data of a PWM that is averaged with a low-pass in front of the conversion, if there is very strong evidence for one,
/// and with the duty taken as fits better, and the fit.
fn as_read(data: Dataset, prior: &Prior, found: Fit) -> (Dataset, Fit) {
    let mut best = (data, found);
    if best.0.is_switched() {
        return best;
    }
    if best.0.origin.current_filter_s == 0.0 {
        let filtered = best.0.clone().with_current_filtered(FIRST_FILTER / best.0.origin.pwm_hz);
        let found = fit(&best.1.model, &filtered, prior, Effort::TRIAL);
        let (filtered, found) = polished(&filtered, prior, found);
        if evidence_nats(&best.0, &best.1, &found) > least_nats(&best.0) {
            best = (filtered, found);
        }
    }
    match taken_otherwise(&best.0, prior, &best.1.model) {
        Some((other, found)) if found.cost < best.1.cost => (other, found),
        _ => best,
    }
}

/// The data of a PWM whose edges are simulated with each current a mean over a part of the period, if that is not known and
/// has very strong evidence, and the fit.
fn over_a_window(data: Dataset, prior: &Prior, found: Fit) -> (Dataset, Fit) {
    if data.origin.current_window_s > 0.0 || !data.is_switched() || !data.reads_instants() {
        return (data, found);
    }
    let averaged = parallel::map(FIRST_WINDOWS, |periods| {
        let other = data.clone().with_current_averaged(periods / data.origin.pwm_hz);
        let found = fit(&found.model, &other, prior, Effort::NONE);
        (other, found)
    });
    // Currents that are read at one instant agree less with any of them.
    let first = averaged.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    let Some((other, first)) = first.filter(|(_, first)| first.cost < found.cost) else { return (data, found) };
    let (other, averaged) = polished(&other, prior, fit(&first.model, &other, prior, Effort::TRIAL));
    let shows = evidence_nats(&data, &found, &averaged) > least_nats(&data);
    if shows { (other, averaged) } else { (data, found) }
}

/// The data of a PWM that is averaged, with the duty taken at the best other time, and the fit.
fn taken_otherwise(data: &Dataset, prior: &Prior, model: &Model) -> Option<(Dataset, Fit)> {
    if !data.may_wait() {
        return None;
    }
    let others = [Latch::WithPeriod, Latch::OnAverage, Latch::AtOnce].into_iter();
    let fitted = parallel::map(others.filter(|latch| *latch != data.origin.latch), |latch| {
        let other = data.with_latch(latch);
        let found = fit(model, &other, prior, Effort::TRIAL);
        if other.origin.pwm_phase.is_some() { polished(&other, prior, found) } else { (other, found) }
    });
    fitted.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
}

/// The same if that explains as much as a lag of the current. Where commands act at once, a model whose commands wait has too
/// small a winding, and a lag in place of the rest.
fn taken_in_place_of_a_lag(data: &Dataset, prior: &Prior, found: &Fit) -> Option<(Dataset, Fit)> {
    let (late, prompt) = without_lag_of_current(&found.model)?;
    taken_otherwise(data, prior, &prompt).filter(|(data, other)| explains_as_much(data, other, found, late))
}

/// The data with the phase and the frequency nearby with which a model fits best, and its fit. A low-pass in front of the
/// conversion, or the time of a mean, is found with them, if there is one.
fn polished(data: &Dataset, prior: &Prior, found: Fit) -> (Dataset, Fit) {
    let mut items: Vec<Item> =
        vec![|data, periods| data.with_pwm_moved(periods, 0.0), |data, turns| data.with_pwm_moved(0.0, turns)];
    if data.origin.current_filter_s > 0.0 {
        items.push(|data, periods| data.clone().with_current_filtered(periods / data.origin.pwm_hz));
    }
    if data.origin.current_window_s > 0.0 && data.reads_instants() {
        items.push(|data, periods| data.clone().with_current_averaged(periods / data.origin.pwm_hz));
    }
    fit_with_items(data, prior, found, &items)
}

/// The same, begun with a shorter and a longer low-pass as well. Where a reading comes to lie on an edge of the PWM, or a
/// command waits for another period, the cost has a kink or a jump, and no step leads across.
fn polished_from_both_sides(data: &Dataset, prior: &Prior, found: Fit) -> (Dataset, Fit) {
    let (data, found) = polished(data, prior, found);
    if data.origin.current_filter_s == 0.0 {
        return (data, found);
    }
    let sides = parallel::map([-BESIDE, BESIDE], |periods| {
        let beside = data.clone().with_current_filtered(periods / data.origin.pwm_hz);
        let near = fit(&found.model, &beside, prior, Effort::TRIAL);
        polished(&beside, prior, near)
    });
    sides.into_iter().fold((data, found), |best, side| if side.1.cost < best.1.cost { side } else { best })
}

/// The data of a slow PWM in the phase that the commands show with very strong evidence.
fn by_commands(data: &Dataset, prior: &Prior, models: &[Model]) -> Option<Dataset> {
    let ways = ways_to_read(data).into_iter().filter_map(|read| {
        let excerpt = read.excerpt(EXCERPT_S);
        let way = likeliest(&excerpt, prior, models, None)?;
        let explains =
            way.found.cost < way.mean.cost && evidence_nats(&excerpt, &way.mean, &way.found) > least_nats(&read);
        let (phase, cost) = if explains { in_everything(&read, prior, &way, None)? } else { return None };
        Some((read.with_pwm_phase(Some(phase)), way.found.model, cost))
    });
    let (read, model, _) = ways.min_by(|a, b| a.2.total_cmp(&b.2))?;
    Some(by_either_timer(&read, prior, &model).0)
}

/// The data of a slow PWM with each current read at one instant, and as a mean over a period, if neither is known. Such a
/// mean has no ripple that would show the phase.
fn ways_to_read(data: &Dataset) -> Vec<Dataset> {
    if !data.is_pwm_slow() {
        return Vec::new();
    }
    let is_open = data.reads_instants() && data.origin.current_window_s == 0.0;
    let mean = is_open.then(|| data.clone().with_current_averaged(1.0 / data.origin.pwm_hz));
    std::iter::once(data.clone()).chain(mean).collect()
}

/// The phase of a slow PWM, and the cost with it. It shows in a few commands alone, so everything decides.
fn in_everything(data: &Dataset, prior: &Prior, way: &Way, near: Option<f64>) -> Option<(f64, f64)> {
    let whole = Way::new(data, prior, &way.found.model, near)?;
    let as_before = fit(&way.found.model, &data.with_pwm_phase(Some(way.phase)), prior, Effort::TRIAL).cost;
    let best = if as_before < whole.found.cost { (way.phase, as_before) } else { (whole.phase, whole.found.cost) };
    (best.1 < whole.mean.cost).then_some(best)
}

/// Sets the phase that a ripple shows beside the effects that were found, or that of a slow PWM, if there is very strong
/// evidence for one. A known phase is moved to where that model fits best. Returns whether that changes much.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    if data.origin.pwm_phase.is_some() {
        if !data.is_one_recording() {
            return false;
        }
        let (other, better) = polished_from_both_sides(data, prior, found.clone());
        let (other, better) = in_any_phase(other, prior, better);
        let (other, better) = over_a_window(other, prior, better);
        let (other, better) = as_read(other, prior, better);
        let gains = evidence_nats(data, found, &better) > VERY_STRONG_NATS;
        if gains {
            *data = other;
        }
        return gains;
    }
    if data.origin.timing.current_sampled_at.is_some() {
        return false;
    }
    // It may have been hidden by what the nominal motor lacks. Rows see a ripple as noise, so the noise does not tell.
    if data.reads_instants() {
        let by_ripple = by_ripple(data, prior, std::slice::from_ref(&found.model), found);
        if let Some(other) = by_ripple.or_else(|| by_duty(data, prior, found)) {
            *data = other;
            return true;
        }
    }
    let explains = |better: &Fit| evidence_nats(data, found, better) > VERY_STRONG_NATS;
    let otherwise = taken_otherwise(data, prior, &found.model).filter(|(_, better)| explains(better));
    if let Some((other, _)) = otherwise.or_else(|| taken_in_place_of_a_lag(data, prior, found)) {
        *data = other;
        return true;
    }
    let in_phase = |read: Dataset| {
        let Way { found, phase, .. } = Way::beside(found.clone(), &read, prior, None)?;
        Some((read.with_pwm_phase(Some(phase)), found))
    };
    let ways = ways_to_read(data).into_iter().filter_map(in_phase);
    let best = ways.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    let shows = |better: &Fit| better.cost < found.cost && evidence_nats(data, found, better) > least_nats(data);
    let Some((other, _)) = best.filter(|(_, better)| shows(better)) else { return false };
    *data = other;
    true
}

/// The data of a PWM whose edges are simulated in whichever phase fits best, and the fit. Commands make several phases locally
/// best, and models that lacked much may have led to the wrong one.
fn in_any_phase(data: Dataset, prior: &Prior, found: Fit) -> (Dataset, Fit) {
    let way = if data.is_switched() { Way::beside(found.clone(), &data, prior, None) } else { None };
    let Some(way) = way.filter(|way| way.found.cost < found.cost) else { return (data, found) };
    polished(&data.with_pwm_phase(Some(way.phase)), prior, way.found)
}

/// Lets a timer whose edges are simulated take a duty at the other time, if that has very strong evidence beside the effects
/// that were found. What a model lacks may speak for any timer. Returns whether it does.
pub(super) fn settle_timer(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    if !data.is_switched() || !data.is_one_recording() {
        return false;
    }
    let latch = if data.origin.latch == Latch::AtOnce { Latch::WithPeriod } else { Latch::AtOnce };
    let other = data.with_latch(latch);
    let first = fit(&found.model, &other, prior, Effort::NONE);
    if first.cost > NEAR * found.cost {
        return false;
    }
    // What acts earlier agrees in another phase.
    let Some(way) = Way::beside(first, &other, prior, None) else { return false };
    let (other, better) = in_step(&other.with_pwm_phase(Some(way.phase)), prior, &way.found.model);
    let shows = evidence_nats(data, found, &better) > VERY_STRONG_NATS;
    if shows {
        *data = other;
    }
    shows
}

/// Whether a phase that a ripple showed has very strong evidence beside the effects that were found with it. Rows that are
/// nearly in step see a ripple that goes on as evenly as what a missing friction or offset leaves.
pub(super) fn is_needed(data: &Dataset, prior: &Prior, found: &Fit) -> bool {
    if data.origin.ripple_shows.is_none() {
        return true;
    }
    let mean = fit(&found.model, &data.with_pwm_phase(None), prior, Effort::AGAIN);
    evidence_nats(data, &mean, found) > least_nats(data)
}

/// Very strong evidence for one phase of all that are tried.
fn least_nats(data: &Dataset) -> f64 {
    VERY_STRONG_NATS + (phases(data) as f64 * f64::from(1 << HALVINGS)).ln()
}

fn phases(data: &Dataset) -> usize {
    if data.is_pwm_slow() { PHASES_OF_SLOW } else { PHASES }
}

fn likeliest(data: &Dataset, prior: &Prior, models: &[Model], near: Option<f64>) -> Option<Way> {
    let ways = parallel::map(models, |model| Way::new(data, prior, model, near));
    ways.into_iter().flatten().min_by(|a, b| a.found.cost.total_cmp(&b.found.cost))
}

/// A model that reads the mean over a period, and one that reads in its best phase.
struct Way {
    mean: Fit,
    found: Fit,
    phase: f64,
}

impl Way {
    /// The phase is sought everywhere, or `near` one.
    fn new(data: &Dataset, prior: &Prior, model: &Model, near: Option<f64>) -> Option<Self> {
        Self::beside(fit(model, &data.with_pwm_phase(None), prior, Effort::TRIAL), data, prior, near)
    }

    fn beside(mean: Fit, data: &Dataset, prior: &Prior, near: Option<f64>) -> Option<Self> {
        let in_phase = |phase: f64, model: &Model, effort: Effort| -> (f64, Fit) {
            let phase = phase.rem_euclid(1.0);
            (phase, fit(model, &data.with_pwm_phase(Some(phase)), prior, effort))
        };
        let least = |ways: Vec<(f64, Fit)>| ways.into_iter().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        // Commands that wait look like more inductance.
        let mut start = mean.model.clone();
        start.motor.inductance_h = start.motor.inductance_h.min(prior.motor.inductance_h);
        let phases = phases(data);
        let (around, width) = near.map_or((0.5, 0.5), |near| (near, RIPPLE_TELLS));
        let sought = (2.0 * width * phases as f64) as usize;
        let first = (0..sought).map(|step| around - width + step as f64 / phases as f64);
        let first: Vec<(f64, Fit)> = parallel::map(first, |phase| in_phase(phase, &start, Effort::NONE));
        // Neighbours lead to the same one.
        let groups = first.chunks(phases / PHASES).filter_map(|group| least(group.to_vec()));
        let mut first: Vec<(f64, Fit)> = groups.collect();
        first.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        first.truncate(if near.is_some() && !data.is_pwm_slow() { 1 } else { FITTED });
        let mut best = least(parallel::map(first, |(phase, found)| in_phase(phase, &found.model, Effort::TRIAL)))?;
        for halving in 1..=HALVINGS {
            let distance = 1.0 / phases as f64 / f64::from(1 << halving);
            let sides = [-distance, distance].map(|side| in_phase(best.0 + side, &best.1.model, Effort::NONE));
            best = least(sides.into_iter().chain([best]).collect())?;
        }
        let (phase, found) = in_phase(best.0, &best.1.model, Effort::TRIAL);
        Some(Self { mean, found, phase })
    }
}

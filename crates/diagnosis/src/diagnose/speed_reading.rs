//! Determines what a speed is where the rig file does not give it: an instantaneous value, a mean since the row before,
//! or a speed timed by edges in one of two ways. A mean is late by half its length, which is not a delay of the bridge.

use super::channels::excluded;
use super::judge::{AS_GOOD, NOT_NOISE, above_floor, explains_as_much};
use super::select::usual_model;
use crate::configuration::diagnose::speed_reading::{LEAST_GAIN, WINDOW_STEPS, WINDOWS};
use crate::dataset::{Averaged, Dataset};
use crate::identify::{Effort, Fit, Prior, fit};
use crate::parallel;
use motorbench_model::catalogue::ActsOn;
use motorbench_model::{Model, Term};

/// Takes the other reading of the speed, if it explains a delay or a rest. Returns whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    // A mean over a row is late by at most one row.
    let is_short = |late_s: f64| late_s > 0.0 && late_s < data.interval_s;
    let late = found.model.terms.iter().find(|term| is_short(term.effect.speed_late_s(&term.values)));
    let has_rest = above_floor(data, found) > NOT_NOISE;
    if !(late.is_some() || has_rest) {
        return false;
    }
    let Some(other) = data.with_other_speed_reading() else { return false };
    let model = late.map_or_else(|| found.model.clone(), |late| found.model.without(late.id()));
    let read_otherwise = fit(&model, &other, prior, Effort::AGAIN);
    let explains = match late {
        Some(late) => explains_as_much(&other, &read_otherwise, found, late.effect.about()),
        None => read_otherwise.cost <= LEAST_GAIN * found.cost,
    };
    if explains {
        *data = other;
    }
    explains
}

/// Takes a lag of the speed for a mean over as long a window, if that explains as much with a constant less. Returns
/// whether it did.
pub(super) fn settle_average(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    let late_s = |term: &Term| term.effect.speed_late_s(&term.values);
    // A delay of the command is none of the reading.
    let is_of_the_sensor = |term: &&Term| term.effect.about().acts_on == [ActsOn::AngleSensor];
    let mut of_the_sensor = found.model.terms.iter().filter(is_of_the_sensor);
    let Some(lag) = of_the_sensor.find(|term| late_s(term) >= data.interval_s) else { return false };
    let model = found.model.without(lag.id());
    let rows = 2.0 * late_s(lag) / data.interval_s;
    let [least, most] = [WINDOWS.start(), WINDOWS.end()].map(|share| (share * rows).round() as usize);
    let limit = AS_GOOD * found.cost;
    let step = (most - least).div_ceil(WINDOW_STEPS).max(1);
    let coarse = best_window(data, prior, &model, limit, (least..=most).step_by(step));
    let best = coarse.and_then(|found| {
        let around = found.span.saturating_sub(step)..=found.span + step;
        best_window(data, prior, &model, limit, around.step_by(step.div_ceil(WINDOW_STEPS / 2)))
    });
    let best = best.filter(|best| best.cost <= limit);
    let Some(other) = best.and_then(|best| data.with_speed_averaged(best.span, best.averaged)) else { return false };
    *data = other;
    true
}

/// Takes the stated window of a speed for that of readings at rows, if the usual effects explain more with it.
pub(super) fn settle_stated_window(data: &mut Dataset, prior: &Prior) {
    let cost = |data: &Dataset| usual_model(data, prior, &excluded(data)).cost;
    let readings = data.with_window_of_readings().map(|other| (cost(&other), other));
    let Some((of_readings, other)) = readings.min_by(|a, b| a.0.total_cmp(&b.0)) else { return };
    let of_time = data.with_window_centred().iter().map(cost).fold(cost(data), f64::min);
    if of_readings <= LEAST_GAIN * of_time {
        *data = other;
    }
}

/// A window over which the speed is taken as a mean, and what a model costs there.
struct WithWindow {
    span: usize,
    averaged: Averaged,
    cost: f64,
}

/// The window of several rows with which a model costs least.
fn best_window(
    data: &Dataset,
    prior: &Prior,
    model: &Model,
    limit: f64,
    spans: impl Iterator<Item = usize>,
) -> Option<WithWindow> {
    let shortest = data.stretches.iter().map(|stretch| stretch.rows.len()).min()?;
    let possible: Vec<usize> = spans.filter(|span| (2..shortest / 2).contains(span)).collect();
    let each = possible.into_iter().flat_map(|span| [(span, Averaged::Readings), (span, Averaged::Time)]);
    let tried = parallel::map(each, |(span, averaged)| {
        let data = data.with_speed_averaged(span, averaged)?;
        let as_found = fit(model, &data, prior, Effort::TRIAL.useless_above(limit)).cost;
        // What was found beside a lag may be far from what acts beside a window.
        let as_usual = usual_model(&data, prior, &excluded(&data)).cost;
        Some(WithWindow { span, averaged, cost: as_found.min(as_usual) })
    });
    tried.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))
}

//! Names missed counts from stops of the counter ([`Dataset::counter_stops`]). No model predicts when a stop happens,
//! so the evidence is in the stops themselves.

use super::judge::rmse;
use super::outcome::{Cause, Estimate, RmseGain, confidence};
use crate::configuration::diagnose::counter_stops::{
    BESIDE, LEAST_COUNTS, LEAST_SIGMAS, MOVED_COUNTS, NEXT, STILL_TURNING,
};
use crate::dataset::{CounterStop, Dataset, median};
use crate::free_run::Prediction;
use crate::identify::{Effort, Fit, Prior, Z95, fit};
use motorbench_model::Model;
use std::collections::BTreeMap;

/// Identifier of the cause.
pub const ID: &str = "missed_counts";

/// The same with a motor without any effect: its errors beside a stop compensate for most of what it lacks.
pub(super) fn settle_by_linear_motor(data: &mut Dataset, prior: &Prior) {
    if !data.origin.counter_stops.is_empty() {
        let linear = fit(&Model::linear(prior.motor), data, prior, Effort::TRIAL);
        settle(data, &linear);
    }
}

/// Updates the lost counts of known stops by the simulated speed, and finds further stops by it. Returns whether
/// anything changed. After a change of the command, or with a wave, the speed during a stop is no straight line.
pub(super) fn settle(data: &mut Dataset, found: &Fit) -> bool {
    let predicted = &found.prediction[data.motion_index()];
    let others = others(data, predicted);
    let stops = data.origin.counter_stops.iter().enumerate();
    let anew: Vec<(usize, [f64; 2])> =
        stops.filter_map(|(index, stop)| Some((index, lost_by_model(data, predicted, stop)?))).collect();
    let lost_before = |index: usize| data.origin.counter_stops[index].lost_counts;
    let is_moved = anew.iter().any(|(index, [lost, _])| (lost - lost_before(*index)).abs() > MOVED_COUNTS);
    let is_changed = is_moved || !others.is_empty();
    if is_changed {
        for (index, [lost_counts, error_counts]) in anew {
            data.set_lost_in_stop(index, lost_counts, error_counts);
        }
        data.leave_out(others);
    }
    is_changed
}

/// Further stops of the same length as known ones.
fn others(data: &Dataset, predicted: &[f64]) -> Vec<CounterStop> {
    let stands = data.stands_as_long_as_stops().into_iter();
    let as_stop = |rows| {
        let stand = CounterStop { rows, lost_counts: 0.0, error_counts: 0.0 };
        let [lost_counts, error_counts] = lost_by_model(data, predicted, &stand)?;
        let is_lost = lost_counts.abs() > LEAST_COUNTS.max(LEAST_SIGMAS * error_counts);
        (is_lost && is_abrupt(data, &stand)).then_some(CounterStop { lost_counts, error_counts, ..stand })
    };
    stands.filter_map(as_stop).collect()
}

/// Lost counts and their standard error.
fn lost_by_model(data: &Dataset, predicted: &[f64], stop: &CounterStop) -> Option<[f64; 2]> {
    let stretch = data.stretch_of(stop.rows.start)?;
    let (before, after) = (stop.rows.start.checked_sub(1)?, stop.rows.end);
    if before < stretch.rows.start || after >= stretch.rows.end {
        return None;
    }
    let wrong = |row: usize| data.motion().values[row] - predicted[row];
    let wrong_before = mean_beside((stretch.rows.start..=before).rev().map(wrong))?;
    let wrong_after = mean_beside((after..stretch.rows.end).map(wrong))?;
    let steps = (after - before) as f64;
    let by_model = predicted[before..=after].windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).sum::<f64>();
    let turned_rad = (by_model + 0.5 * (wrong_before + wrong_after) * steps) * stretch.interval_s;
    let counted_rad = data.angle_rad[after] - data.angle_rad[before] - stop.lost_counts * data.count_rad;
    let uncertain_rad = (wrong_after - wrong_before) * steps * stretch.interval_s / 12.0_f64.sqrt();
    Some([(turned_rad - counted_rad) / data.count_rad, 1.0_f64.hypot(uncertain_rad / data.count_rad)])
}

/// Mean of the nearest values that exist; `None` if there are none.
fn mean_beside(nearest_first: impl Iterator<Item = f64>) -> Option<f64> {
    let seen: Vec<f64> = nearest_first.filter(|value| value.is_finite()).take(BESIDE).collect();
    (!seen.is_empty()).then(|| seen.iter().sum::<f64>() / seen.len() as f64)
}

/// Whether the motor was neither braking to a standstill before nor starting from one after.
fn is_abrupt(data: &Dataset, stand: &CounterStop) -> bool {
    let speed = &data.motion().values;
    let before = speed[..stand.rows.start].iter().rev();
    let after = speed[stand.rows.end..].iter();
    turns_on(before) && turns_on(after)
}

/// Whether the nearest speeds are hardly below the mean of those farther away.
fn turns_on<'a>(nearest_first: impl Iterator<Item = &'a f64> + Clone) -> bool {
    let mean = |rows: usize| nearest_first.clone().take(rows).sum::<f64>() / rows as f64;
    mean(NEXT) / mean(BESIDE) > STILL_TURNING
}

/// The cause that stops of the counter are reported as.
pub fn cause(data: &Dataset, prediction: &Prediction) -> Option<Cause> {
    let stops = &data.origin.counter_stops;
    if stops.is_empty() {
        return None;
    }
    let evidence_sigmas = stops.iter().map(|stop| (stop.lost_counts / stop.error_counts).powi(2)).sum::<f64>().sqrt();
    let length_s: f64 = data.stretches.iter().map(|stretch| stretch.rows.len() as f64 * stretch.interval_s).sum();
    let poisson = |value: f64| {
        let half = Z95 * value / (stops.len() as f64).sqrt();
        Estimate { value, ci95: Some([(value - half).max(0.0), value + half]) }
    };
    let lost: f64 = stops.iter().map(|stop| stop.lost_counts.abs()).sum();
    let lengths_s = stops.iter().map(|stop| data.length_s(stop));
    let constants = [
        ("lost_share", poisson(lost * data.count_rad / path_rad(data))),
        ("stops_per_s", poisson(stops.len() as f64 / length_s)),
        ("stop_s", Estimate { value: median(lengths_s), ci95: None }),
    ];
    Some(Cause {
        effect: ID.into(),
        confidence: confidence(evidence_sigmas),
        parameters: constants.into_iter().map(|(name, estimate)| (name.to_string(), estimate)).collect(),
        gain: gain(data, prediction),
        not_separable_from: Vec::new(),
        evidence_sigmas,
        runner_up: None,
    })
}

/// Total angle of the motor in both directions, lost counts included.
fn path_rad(data: &Dataset) -> f64 {
    let of_stretch = |rows: std::ops::Range<usize>| {
        data.angle_rad[rows].windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum::<f64>()
    };
    data.stretches.iter().map(|stretch| of_stretch(stretch.rows.clone())).sum()
}

/// Error of the motion on held-out data, as read and without the stops.
fn gain(data: &Dataset, prediction: &Prediction) -> BTreeMap<&'static str, RmseGain> {
    let output = data.motion_index();
    let mut as_read = data.clone();
    for (row, read) in &data.origin.read_in_stops {
        as_read.measured[output].values[*row] = *read;
    }
    let [rmse_before, rmse_after] = [&as_read, data].map(|data| rmse(data, prediction, output));
    BTreeMap::from([(data.measured[output].output.channel(), RmseGain { rmse_before, rmse_after })])
}

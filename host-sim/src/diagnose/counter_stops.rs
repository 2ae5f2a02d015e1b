//! Counts missed because the counter stood for a while, which [`Dataset::counter_stops`] are. No term of a model says when it
//! will, so the cause is named from the stops themselves.

use super::judge::rmse;
use super::outcome::{Cause, Estimate, RmseGain, confidence};
use crate::dataset::{Dataset, median};
use crate::free_run::Prediction;
use crate::identify::Z95;
use std::collections::BTreeMap;

/// What they are.
pub const ID: &str = "missed_counts";

/// What stops of the counter are named.
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

/// How far the motor turned, both ways, with what was lost.
fn path_rad(data: &Dataset) -> f64 {
    let of_stretch = |rows: std::ops::Range<usize>| {
        data.angle_rad[rows].windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum::<f64>()
    };
    data.stretches.iter().map(|stretch| of_stretch(stretch.rows.clone())).sum()
}

/// Error of the motion on data kept back, as it was read and without the stops.
fn gain(data: &Dataset, prediction: &Prediction) -> BTreeMap<&'static str, RmseGain> {
    let output = data.motion_index();
    let mut as_read = data.clone();
    for (row, read) in &data.origin.read_in_stops {
        as_read.measured[output].values[*row] = *read;
    }
    let [rmse_before, rmse_after] = [&as_read, data].map(|data| rmse(data, prediction, output));
    BTreeMap::from([(data.measured[output].output.channel(), RmseGain { rmse_before, rmse_after })])
}

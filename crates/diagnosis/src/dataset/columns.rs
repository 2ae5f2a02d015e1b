//! Statistics and conversions of a column of numbers, some of which may be missing.

use super::Window;
pub use crate::configuration::dataset::columns::NORMAL_MEDIAN;
pub use motorbench_data::statistics::{greatest, median};
use std::ops::Range;

/// Range of the values that are not missing.
pub(super) fn width(values: &[f64]) -> f64 {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min)
}

/// Mean of the values that are not missing; 0 if there are none.
pub(super) fn mean(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|value| value.is_finite());
    finite().sum::<f64>() / finite().count().max(1) as f64
}

/// Standard deviation of what is not missing.
pub fn spread(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|value| value.is_finite());
    let count = finite().count().max(1) as f64;
    let mean = mean(values);
    (finite().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// Correlation about zero of the values that are not missing.
pub(super) fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let sum = |of: fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(a, b)| of(*a, *b)).filter(|product| product.is_finite()).sum()
    };
    sum(|a, b| a * b) / (sum(|a, _| a * a) * sum(|_, b| b * b)).sqrt().max(f64::MIN_POSITIVE)
}

/// Missing values take the last one that was there.
pub(super) fn held(values: &[f64]) -> Vec<f64> {
    let first = values.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
    values
        .iter()
        .scan(first, |last, value| {
            if value.is_finite() {
                *last = *value;
            }
            Some(*last)
        })
        .collect()
}

pub(super) fn integrated(speed: &[f64], time_s: &[f64]) -> Vec<f64> {
    let speed = held(speed);
    let mut angle_rad = vec![0.0];
    for index in 1..speed.len() {
        let mean = 0.5 * (speed[index] + speed[index - 1]);
        angle_rad.push(angle_rad[index - 1] + mean * (time_s[index] - time_s[index - 1]));
    }
    angle_rad
}

/// Mean speed over a window; missing where the window is incomplete.
pub fn difference(angle_rad: &[f64], time_s: &[f64], window: Window) -> Vec<f64> {
    let of = |index: usize| {
        let (first, last) = window.rows(index, angle_rad.len())?;
        Some((angle_rad[last] - angle_rad[first]) / (time_s[last] - time_s[first]))
    };
    (0..angle_rad.len()).map(|index| of(index).unwrap_or(f64::NAN)).collect()
}

/// Consecutive rows, joined.
pub fn runs(rows: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let rows: Vec<usize> = rows.collect();
    rows.chunk_by(|row, next| row + 1 == *next).map(|run| run[0]..run[run.len() - 1] + 1).collect()
}

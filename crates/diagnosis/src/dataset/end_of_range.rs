//! A sensor that ends before the motor does: its reading runs against a value, and stands there.
//!
//! A motor comes to its greatest speed ever slower, and noise goes on there. A reading that moved, and then is
//! the same number for rows, is at the end of a range: of a sensor, an amplifier or a converter.

use crate::configuration::dataset::end_of_range::{
    CALCULATED, LEAST_OF_GREATEST, LEAST_ROWS, LEAST_SHARE, LEAST_STEPS, ON_ITS_WAY,
};
use crate::dataset::{greatest, median, runs};
use std::ops::Range;

/// Ends of a sensor's range that were met, and the rows there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndOfRange {
    /// The greatest of them.
    pub value: f64,
    /// How many rows are not compared for it.
    pub rows: usize,
}

/// Makes the rows at the ends of the range missing ones.
pub(super) fn leave_out(values: &mut [f64]) -> Option<EndOfRange> {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let ends = [finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max)];
    let met = ends.map(|end| runs_at(values, end)).into_iter().filter(|runs| is_an_end(values, runs));
    let rows: Vec<usize> = met.flatten().flatten().collect();
    let value = greatest(&rows.iter().map(|row| values[*row]).collect::<Vec<_>>());
    rows.iter().for_each(|row| values[*row] = f64::NAN);
    (!rows.is_empty()).then_some(EndOfRange { value, rows: rows.len() })
}

/// Where a reading is this very number.
fn runs_at(values: &[f64], number: f64) -> Vec<Range<usize>> {
    runs((0..values.len()).filter(|row| values[*row] == number && number != 0.0))
}

fn is_an_end(values: &[f64], runs: &[Range<usize>]) -> bool {
    let rows: usize = runs.iter().map(Range::len).sum();
    let greatest_step = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    let before = runs.iter().filter_map(|run| {
        let last = run.start.checked_sub(1)?;
        Some((values[last] - values[last.checked_sub(ON_ITS_WAY)?]).abs() / ON_ITS_WAY as f64)
    });
    rows as f64 > LEAST_SHARE * values.len() as f64
        && rows as f64 >= LEAST_ROWS * runs.len() as f64
        && median(before) > (LEAST_STEPS * own_step(values)).max(LEAST_OF_GREATEST * greatest_step)
}

/// The least difference of two of them, but for what calculating in floating point makes.
fn own_step(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let least = CALCULATED * greatest(&sorted);
    sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > least).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A speed that goes to its end and back each second, as read by a converter of this step, with noise if any.
    fn speed(step: f64, unrest: f64) -> Vec<f64> {
        let of = |row: i32| {
            let since_s = f64::from(row % 1000) * 1e-3;
            let settled = 100.0 * (1.0 - 2.0 * (-since_s / 0.05).exp());
            let sign = if row / 1000 % 2 == 0 { 1.0 } else { -1.0 };
            let noisy = sign * settled + unrest * (f64::from(row) * 12.9).sin();
            (noisy / step).round() * step
        };
        (0..8000).map(of).collect()
    }

    #[test]
    fn readings_that_run_against_an_end_are_missing() {
        for (step, unrest) in [(0.1, 0.3), (0.1, 0.0), (1e-4, 0.3)] {
            let whole = speed(step, unrest);
            let mut cut: Vec<f64> = whole.iter().map(|value| value.clamp(-60.0, 60.0)).collect();
            let found = leave_out(&mut cut).expect("it ends at 60");
            assert_eq!(found.value, 60.0);
            let beyond = whole.iter().filter(|value| value.abs() >= 60.0).count();
            assert!(found.rows.abs_diff(beyond) < 20, "{found:?}, {beyond}");
            for (cut, whole) in cut.iter().zip(&whole) {
                assert!(cut.is_nan() == (whole.abs() >= 60.0), "{cut} for {whole}");
            }
        }
    }

    /// However coarse it is, or without any noise.
    #[test]
    fn a_speed_that_is_reached_is_no_end() {
        for (step, unrest) in [(0.1, 0.3), (0.1, 0.0), (4.0, 0.3), (4.0, 3.0), (1e-6, 0.0)] {
            let mut whole = speed(step, unrest);
            assert_eq!(leave_out(&mut whole), None, "{step} {unrest}");
        }
    }
}

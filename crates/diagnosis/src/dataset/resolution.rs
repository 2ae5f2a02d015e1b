//! The step of a converter, as its readings show it.

use crate::configuration::dataset::resolution::{FEWEST_GAPS, FEWEST_READINGS, UNEVEN};

/// The step that all readings are multiples of, apart from an offset and from how a file rounds them; `None` where nearly each
/// reading has a value of its own, or where they lie unevenly.
pub(super) fn of_readings(values: &[f64]) -> Option<f64> {
    let mut levels: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let readings = levels.len();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let mut gaps: Vec<f64> = levels.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if gaps.len() < FEWEST_GAPS || readings < FEWEST_READINGS * levels.len() {
        return None;
    }
    gaps.sort_by(f64::total_cmp);
    let middle = gaps[gaps.len() / 2];
    let steps = |gap: &f64| (gap / middle).round();
    let is_even = |gap: &f64| steps(gap) >= 1.0 && (gap / middle - steps(gap)).abs() < UNEVEN * steps(gap);
    gaps.iter().all(is_even).then(|| gaps.iter().sum::<f64>() / gaps.iter().map(steps).sum::<f64>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn current_a(row: usize) -> f64 {
        0.4 * (0.01 * row as f64).sin() + 0.3 * (0.0037 * row as f64).cos()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Behind an offset, with noise or without, written with three to six digits.
        #[test]
        fn the_step_of_a_converter_is_seen(
            step_a in 0.01_f64..0.05,
            offset_a in -0.02_f64..0.02,
            noise: bool,
            digits in 3..7,
            seed: u64,
        ) {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let digits = 10_f64.powi(digits);
            let values = (0..3000).map(|row| {
                let read = current_a(row) + if noise { random.random_range(-0.02..0.02) } else { 0.0 };
                ((((read - offset_a) / step_a).round() * step_a + offset_a) * digits).round() / digits
            });
            let found = of_readings(&values.collect::<Vec<_>>());
            prop_assert!(found.is_some_and(|found| (found / step_a - 1.0).abs() < 0.02), "{found:?}");
        }

        /// The digits of the file are their only step.
        #[test]
        fn readings_of_any_value_have_none(digits in 3..9, seed: u64) {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let digits = 10_f64.powi(digits);
            let mut read = |row: usize| current_a(row) + random.random_range(-0.01..0.01);
            let values = (0..3000).map(|row| (read(row) * digits).round() / digits);
            let found = of_readings(&values.collect::<Vec<_>>());
            prop_assert!(found.is_none_or(|found| found < 1.01 / digits), "{found:?}");
        }
    }
}

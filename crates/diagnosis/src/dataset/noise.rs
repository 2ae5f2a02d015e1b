//! How much a sensor's readings scatter, from the readings or from what a model leaves of them.

use super::columns::{NORMAL_MEDIAN, greatest};
use crate::configuration::dataset::noise::{NOT_WHITE, SAME_SCATTER};

/// Standard deviation of white noise on a smooth signal.
pub fn noise(values: &[f64]) -> f64 {
    noise_apart(values, 1)
}

/// The same of noise that is correlated over some rows, at most `most_rows`, as behind the low-pass of a sensor. Rows farther
/// apart than that all scatter alike, while what a model lacks scatters the more, the farther they are.
pub fn correlated_noise(values: &[f64], most_rows: usize) -> f64 {
    let mut known = vec![None; 3 * most_rows.max(1) + 1];
    let mut apart = |rows: usize| *known[rows].get_or_insert_with(|| noise_apart(values, rows));
    let white = apart(1);
    let level = |rows: usize| {
        let near = apart(rows);
        let mut all = [near; 4];
        for (place, farther) in [3 * rows, 2 * rows, (3 * rows).div_ceil(2)].into_iter().enumerate() {
            all[place] = apart(farther);
            if all[place].max(near) > SAME_SCATTER * all[place].min(near) {
                return None;
            }
        }
        Some(all.iter().sum::<f64>() / all.len() as f64)
    };
    (1..=most_rows).find_map(level).filter(|level| *level > NOT_WHITE * white).unwrap_or(white)
}

/// From third differences of rows that are this far apart, which are nearly free of the signal. Robust against steps (median),
/// and against a coarse rounding that leaves most differences at zero (trimmed mean square).
fn noise_apart(values: &[f64], rows: usize) -> f64 {
    let third = values.windows(3 * rows + 1).map(|w| (w[3 * rows] - 3.0 * w[2 * rows] + 3.0 * w[rows] - w[0]).abs());
    let mut third: Vec<f64> = third.filter(|difference| difference.is_finite()).collect();
    let (half, nine_tenths) = (third.len() / 2, third.len() * 9 / 10);
    if !third.is_empty() {
        third.select_nth_unstable_by(nine_tenths, f64::total_cmp);
        third[..=nine_tenths].select_nth_unstable_by(half, f64::total_cmp);
    }
    let middle = third.get(half).copied().unwrap_or(0.0);
    let kept = &third[..nine_tenths];
    let square = kept.iter().map(|value| value * value).sum::<f64>() / kept.len().max(1) as f64;
    // 0.787: root mean square of a standard normal below its ninth decile;
    // 20: sum of the squares of 1, 3, 3, 1.
    let spread = (middle / NORMAL_MEDIAN).max(square.sqrt() / 0.787) / 20_f64.sqrt();
    spread.max(1e-4 * greatest(values)).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::TAU;

    const ROWS: usize = 20_000;
    const MOST_ROWS: usize = 4;

    /// Normally distributed, with a standard deviation of 1.
    fn white(seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // Twelve uniform numbers.
        (0..ROWS).map(|_| (0..12).map(|_| random.random_range(-0.5..0.5)).sum()).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// The root mean square of what passed a low-pass with a time constant of so many rows, and of what did not.
        #[test]
        fn noise_behind_a_low_pass_has_its_own_size(seed: u64, rows in 0.3_f64..2.2) {
            let left = (-1.0 / rows).exp();
            let passed = white(seed).into_iter().scan(0.0, |last, new| {
                *last = left * *last + (1.0 - left * left).sqrt() * new;
                Some(*last)
            });
            let found = correlated_noise(&passed.collect::<Vec<_>>(), MOST_ROWS);
            prop_assert!((0.9..1.1).contains(&found), "{rows} rows: {found}");
        }

        /// A wave, a random walk, and jumps, each far greater than the noise.
        #[test]
        fn what_a_model_lacks_is_no_noise(seed: u64, period_rows in 7.0_f64..400.0, which in 0_usize..3) {
            let mut random = ChaCha8Rng::seed_from_u64(seed ^ 1);
            let mut walked = 0.0;
            let mut lacking = |row: usize| match which {
                0 => 10.0 * (TAU * row as f64 / period_rows).sin(),
                1 => {
                    walked += random.random_range(-1.0..1.0);
                    walked
                }
                _ => 10.0 * ((row as f64 / period_rows).floor() % 2.0),
            };
            let with: Vec<f64> = white(seed).into_iter().enumerate().map(|(row, noise)| noise + lacking(row)).collect();
            let (found, alone) = (correlated_noise(&with, MOST_ROWS), noise(&with));
            prop_assert!(found < 1.15 * alone, "{which}, {period_rows} rows: {found} {alone}");
            prop_assert_eq!(correlated_noise(&white(seed), MOST_ROWS), noise(&white(seed)));
        }
    }
}

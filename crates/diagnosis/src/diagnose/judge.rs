//! Judges models on held-out data.

use super::random_losses;
use crate::dataset::{Dataset, Measured};
use crate::free_run::Prediction;
use crate::identify::Fit;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Parts of this length count as independent.
pub(super) const BLOCK_S: f64 = 0.1;
/// Above this multiple of the noise floor an effect is missing.
pub const NOT_NOISE: f64 = 1.15;

/// Evidence in natural units that is called very strong (Kass and Raftery, Journal of the American Statistical Association
/// 90 (1995)).
pub(super) const VERY_STRONG_NATS: f64 = 5.0;

/// A simpler model whose cost is at most this multiple counts as equally good.
pub(super) const AS_GOOD: f64 = 1.02;

/// What one model gains over another on the held-out data.
#[derive(Clone, Debug)]
pub struct Gain {
    /// The gain over its standard error, if the better model is right. The gain is then uncertain only by the chance
    /// correlation of the prediction difference with the residuals. Residuals may be correlated within a block, and an
    /// effect may show in a few blocks alone (after Diebold and Mariano 1995).
    pub sigmas: f64,
    /// Fall of the mean square error, relative to the remaining and the tolerated error, of the quantity that gains
    /// most.
    pub share: f64,
    /// Root mean square errors before and after, in the order of [`Dataset::measured`].
    pub rmse: Vec<(f64, f64)>,
}

/// Compares two predictions on the held-out data.
pub fn gain(data: &Dataset, before: &Prediction, after: &Prediction) -> Gain {
    let block = (BLOCK_S / data.interval_s).max(1.0) as usize;
    let rmse: Vec<(f64, f64)> =
        (0..data.measured.len()).map(|output| (rmse(data, before, output), rmse(data, after, output))).collect();
    let (mut total, mut variance) = (0.0, 0.0);
    for start in (0..data.len()).step_by(block) {
        let mut chance = 0.0;
        for (output, measured) in data.measured.iter().enumerate() {
            // The noise is what the better model leaves; this weight favours neither model.
            let scale = measured.least_error(measured.noise).max(rmse[output].0.min(rmse[output].1));
            for index in (start..(start + block).min(data.len())).filter(|index| data.held_out[*index]) {
                let left = (measured.values[index] - after[output][index]) / scale;
                let change = (after[output][index] - before[output][index]) / scale;
                if left.is_finite() && change.is_finite() {
                    chance += 2.0 * left * change;
                    total += change * (2.0 * left + change);
                }
            }
        }
        variance += chance * chance;
    }
    let share = rmse.iter().zip(&data.measured).map(|((before, after), measured)| {
        (before * before - after * after) / after.hypot(measured.tolerance).powi(2).max(f64::MIN_POSITIVE)
    });
    Gain {
        sigmas: if variance > 0.0 { total / variance.sqrt() } else { 0.0 },
        share: share.fold(f64::NEG_INFINITY, f64::max),
        rmse,
    }
}

/// Evidence for `after` over `before` in natural units (Schwarz, Annals of Statistics 6 (1978)): of the costs of two fits to
/// the same data, with the number of independent residuals and a price for each further constant.
pub(super) fn evidence_nats(data: &Dataset, before: &Fit, after: &Fit) -> f64 {
    let independent = after.independent_residuals(data);
    let further = after.moved() as f64 - before.moved() as f64;
    0.5 * independent * (before.cost / after.cost).ln() - 0.5 * further * independent.ln()
}

/// Log-likelihood that one reading of each held-out quantity gains from `before` to `after`, in natural units.
pub(super) fn held_out_nats(data: &Dataset, before: &Fit, after: &Fit) -> f64 {
    let error = |fit: &Fit, output: usize| rmse(data, &fit.prediction, output).max(f64::MIN_POSITIVE);
    (0..data.measured.len()).map(|output| (error(before, output) / error(after, output)).ln()).sum()
}

/// Root mean square error of one quantity on the held-out data.
pub fn rmse(data: &Dataset, prediction: &Prediction, output: usize) -> f64 {
    let mut sum = 0.0;
    let mut count = 0.0;
    for ((value, predicted), held_out) in
        data.measured[output].values.iter().zip(&prediction[output]).zip(&data.held_out)
    {
        let difference = value - predicted;
        if *held_out && difference.is_finite() {
            sum += difference * difference;
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).sqrt()
}

/// Standard deviation of the noise in the residual of a quantity.
pub fn noise(data: &Dataset, residual: &[f64], output: usize) -> f64 {
    let of_sensor = data.measured[output].noise_in(residual);
    let of_losses = (output == data.motion_index()).then(|| random_losses::noise_rad_per_s(data, residual)).flatten();
    of_sensor.max(of_losses.unwrap_or(0.0))
}

/// Error over noise floor, for the worst channel.
pub fn above_floor(data: &Dataset, fit: &Fit) -> f64 {
    worst(data, fit, Measured::least_error)
}

/// Error over noise, for the worst channel, even below the error that is tolerated of a model.
pub fn above_noise(data: &Dataset, fit: &Fit) -> f64 {
    worst(data, fit, |_, noise| noise)
}

/// The same over its floor, for the channel of the motion.
pub fn motion_above_floor(data: &Dataset, fit: &Fit) -> f64 {
    ratio(data, fit, data.motion_index(), Measured::least_error)
}

/// Greatest ratio of the error to `floor` of a channel's noise.
fn worst(data: &Dataset, fit: &Fit, floor: impl Fn(&Measured, f64) -> f64) -> f64 {
    (0..data.measured.len()).map(|output| ratio(data, fit, output, &floor)).fold(0.0, f64::max)
}

fn ratio(data: &Dataset, fit: &Fit, output: usize, floor: impl Fn(&Measured, f64) -> f64) -> f64 {
    let noise = noise(data, &fit.residual_of(data, output), output);
    rmse(data, &fit.prediction, output) / floor(&data.measured[output], noise)
}

/// 100 (1 - |y - prediction| / |y - mean y|) on the held-out data.
pub fn fit_percent(data: &Dataset, prediction: &Prediction, output: usize) -> f64 {
    let seen =
        data.measured[output].values.iter().zip(&data.held_out).filter(|(value, kept)| **kept && value.is_finite());
    let values: Vec<f64> = seen.map(|(value, _)| *value).collect();
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let spread = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len().max(1) as f64).sqrt();
    100.0 * (1.0 - rmse(data, prediction, output) / spread.max(f64::MIN_POSITIVE))
}

/// Resamples of the block bootstrap.
const RESAMPLES: usize = 200;

/// 95 % interval of the root mean square error, by drawing blocks of the held-out data with replacement.
pub fn rmse_interval(data: &Dataset, prediction: &Prediction, output: usize) -> [f64; 2] {
    let block = (BLOCK_S / data.interval_s).max(1.0) as usize;
    let mut blocks: Vec<(f64, f64)> = Vec::new();
    for start in (0..data.len()).step_by(block) {
        let range = (start..(start + block).min(data.len())).filter(|index| data.held_out[*index]);
        let squares = range.map(|index| (data.measured[output].values[index] - prediction[output][index]).powi(2));
        let (sum, count) = squares.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        if count > 0.0 {
            blocks.push((sum, count));
        }
    }
    if blocks.is_empty() {
        return [0.0, 0.0];
    }
    // The same draws for every model, so that intervals can be compared.
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut found: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let drawn = (0..blocks.len()).map(|_| blocks[random.random_range(0..blocks.len())]);
            let (sum, count) = drawn.fold((0.0, 0.0), |(s, n), (sum, count)| (s + sum, n + count));
            f64::sqrt(sum / count)
        })
        .collect();
    found.sort_by(f64::total_cmp);
    [found[RESAMPLES * 25 / 1000], found[RESAMPLES * 975 / 1000]]
}

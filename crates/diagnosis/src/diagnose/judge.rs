//! Judges models on held-out data.

use super::random_losses;
pub use crate::configuration::diagnose::judge::NOT_NOISE;
pub(super) use crate::configuration::diagnose::judge::{AS_GOOD, BLOCK_S, VERY_STRONG_NATS};
use crate::configuration::diagnose::judge::{FAR_OFF, RESAMPLES, USUAL_ROUNDS};
use crate::dataset::{Dataset, Measured};
use crate::free_run::Prediction;
use crate::identify::Fit;
use motorbench_model::catalogue::About;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

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

/// Compares two predictions on the held-out data. A stretch that both miss by far more than the usual one, such as a start
/// from rest that neither meets, counts as a usual one: it would outweigh all others and says nothing of the difference.
pub fn gain(data: &Dataset, before: &Prediction, after: &Prediction) -> Gain {
    let blocks_of = |output| blocks(data, before, after, output);
    let by_output: Vec<Vec<Block>> = (0..data.measured.len()).map(blocks_of).collect();
    let mut chances = vec![0.0; data.len().div_ceil(block_rows(data))];
    let (mut total, mut share) = (0.0, f64::NEG_INFINITY);
    for (blocks, measured) in by_output.iter().zip(&data.measured) {
        let usual = [usual_square(blocks, |block| block.before), usual_square(blocks, |block| block.after)];
        // The noise is what the better model leaves; this weight favours neither model.
        let square = measured.least_error(measured.noise).powi(2).max(usual[0].min(usual[1]));
        let mut left = [0.0; 2];
        for block in blocks {
            let weight = (block.most(square) / block.before.min(block.after)).min(1.0);
            total += weight * (block.before - block.after) / square;
            chances[block.index] += weight * block.chance / square;
            left[0] += weight * block.before;
            left[1] += weight * block.after;
        }
        let count = blocks.iter().map(|block| block.count).sum::<f64>().max(1.0);
        let remaining = left[1] / count + measured.tolerance.powi(2);
        share = share.max((left[0] - left[1]) / count / remaining.max(f64::MIN_POSITIVE));
    }
    let variance: f64 = chances.iter().map(|chance| chance * chance).sum();
    Gain {
        sigmas: if variance > 0.0 { total / variance.sqrt() } else { 0.0 },
        share,
        rmse: (0..data.measured.len()).map(|output| (rmse(data, before, output), rmse(data, after, output))).collect(),
    }
}

/// What two models leave of one quantity in one block of the held-out data.
struct Block {
    index: usize,
    /// Sums of squares.
    before: f64,
    after: f64,
    /// What chance adds to their difference, if the model `after` is right.
    chance: f64,
    count: f64,
}

impl Block {
    /// The greatest sum of squares that counts, where this is the usual mean square.
    fn most(&self, usual_square: f64) -> f64 {
        FAR_OFF * FAR_OFF * usual_square * self.count
    }
}

fn block_rows(data: &Dataset) -> usize {
    (BLOCK_S / data.interval_s).max(1.0) as usize
}

fn blocks(data: &Dataset, before: &Prediction, after: &Prediction, output: usize) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    for index in (0..data.len()).filter(|index| data.held_out[*index]) {
        let value = data.measured[output].values[index];
        let (was, left) = (value - before[output][index], value - after[output][index]);
        if !was.is_finite() || !left.is_finite() {
            continue;
        }
        let of = index / block_rows(data);
        if blocks.last().is_none_or(|block| block.index != of) {
            blocks.push(Block { index: of, before: 0.0, after: 0.0, chance: 0.0, count: 0.0 });
        }
        let block = blocks.last_mut().expect("one was just added");
        block.before += was * was;
        block.after += left * left;
        block.chance += 2.0 * left * (was - left);
        block.count += 1.0;
    }
    blocks
}

/// Mean square of a model's error where blocks far off count as [`FAR_OFF`] (Huber, Annals of Mathematical Statistics 35
/// (1964), proposal 2).
fn usual_square(blocks: &[Block], sum_of: impl Fn(&Block) -> f64) -> f64 {
    let count = blocks.iter().map(|block| block.count).sum::<f64>().max(1.0);
    let mut square = blocks.iter().map(&sum_of).sum::<f64>() / count;
    for _ in 0..USUAL_ROUNDS {
        square = blocks.iter().map(|block| sum_of(block).min(block.most(square))).sum::<f64>() / count;
    }
    square
}

/// Evidence for `after` over `before` in natural units (Schwarz, Annals of Statistics 6 (1978)): of the costs of two fits to
/// the same data, with the number of independent residuals and a price for each further constant.
pub(super) fn evidence_nats(data: &Dataset, before: &Fit, after: &Fit) -> f64 {
    let independent = after.independent_residuals(data);
    let further = after.moved() as f64 - before.moved() as f64;
    0.5 * independent * (before.cost / after.cost).ln() - 0.5 * further * independent.ln()
}

/// Whether another reading of the data explains as much as an effect by which something is late. A lag needs a filter, and may
/// be what the laws leave out. Every command acts late, so very strong evidence is enough for a delay.
pub(super) fn explains_as_much(data: &Dataset, fit: &Fit, than: &Fit, late: &About) -> bool {
    match late.is_delay {
        true => evidence_nats(data, fit, than) < VERY_STRONG_NATS,
        false => fit.cost <= AS_GOOD * than.cost,
    }
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

/// Error over noise floor of each channel in all rows, those of the fit as well.
pub(super) fn of_all_rows_above_floor(data: &Dataset, fit: &Fit) -> Vec<f64> {
    let everything = Dataset { held_out: vec![true; data.len()], ..data.clone() };
    let of = |output: usize| ratio(&everything, fit, output, Measured::least_error);
    (0..data.measured.len()).map(of).collect()
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

/// 95 % interval of the root mean square error, by drawing blocks of the held-out data with replacement.
pub fn rmse_interval(data: &Dataset, prediction: &Prediction, output: usize) -> [f64; 2] {
    let block = block_rows(data);
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

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use std::fmt::Write as _;

    /// Speeds of 40 to 60 rad/s with noise of 0.3 rad/s, steps of the command each quarter of a second.
    fn recorded() -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
        for row in 0..4000 {
            let (volts, noise) = (4.0 + f64::from(row / 250 % 3), f64::from(row * 59 % 101) / 101.0 - 0.5);
            let _ = writeln!(text, "{:.3},{volts},{:.4}", f64::from(row) * 1e-3, 10.0 * volts + noise);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    /// The speeds of the commands, all of them off by one number and those of the last held-out block by another.
    fn predicted(data: &Dataset, off: f64, off_in_last: f64) -> Prediction {
        let last = data.held_out.iter().rposition(|held_out| *held_out).unwrap();
        let is_in_last = |row: usize| row / block_rows(data) == last / block_rows(data);
        let at = |row: usize| 10.0 * data.command[row] + if is_in_last(row) { off_in_last } else { off };
        vec![(0..data.len()).map(at).collect()]
    }

    #[test]
    fn a_block_that_both_models_miss_decides_nothing() {
        let data = recorded();
        let of = |before: [f64; 2], after: [f64; 2]| {
            let [before, after] = [before, after].map(|[off, off_in_last]| predicted(&data, off, off_in_last));
            gain(&data, &before, &after)
        };
        let without = of([1.0, 1.0], [0.0, 0.0]);
        assert!(without.sigmas > 6.0 && without.share > 0.2, "{without:?}");
        // Both miss the last block by a hundred times as much, the better model even more.
        let with = of([1.0, 40.0], [0.0, 40.1]);
        assert!(with.sigmas > 6.0 && with.share > 0.1, "{with:?}");
        // What one of them alone misses counts in full.
        let alone = of([1.0, 1.0], [0.0, 40.0]);
        assert!(alone.sigmas < 0.0 && alone.share < 0.0, "{alone:?}");
    }
}

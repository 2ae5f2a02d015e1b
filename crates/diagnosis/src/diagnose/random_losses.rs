//! Counts missed at random, each edge with some probability. The mean of what is lost is a term of the model
//! (`catalogue/missed_counts.rs`), or a wrong torque constant; the scatter is in none: it is noise, and known by that noise.
//!
//! What the model leaves of the angle goes its way at random then: from window to window it changes by independent steps,
//! whose variance is that of the counts lost, as many as the share lost of those counted. Rounding to whole counts, and rows
//! read at uneven times, leave an angle that is uneven but stays where it is; a motor that the model does not describe goes
//! on from one window into the next.
//!
//! A share that is the same at all speeds cannot be told from constants of another motor by what the motor does: by the
//! scatter alone. The data are looked at anew then, with as many counts more.

use super::counter_stops::ID;
use super::outcome::{Cause, Estimate, RmseGain, confidence};
use crate::dataset::{Dataset, Output};
use crate::identify::Z95;
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_model::unit::{Quantity, Unit};
use std::collections::BTreeMap;

/// Fewer counts in a window are rounded too evenly to be told from others.
const FEWEST_COUNTS: f64 = 2.0;
/// Fewest windows.
const FEWEST: usize = 400;
/// By how much correlations may be off what independent steps have.
const LOOSE: f64 = 0.08;
/// Lags at which independent steps have none.
const FAR: [usize; 2] = [3, 4];
/// The share lost of the slower half and of the faster half is the same to this factor.
const EVEN: f64 = 1.5;
/// Blocks for the error of the share, and with how many of its errors it is beyond doubt.
const BLOCKS: usize = 20;
const LEAST_SIGMAS: f64 = 8.0;
/// Smaller shares are named by nobody.
const LEAST_SHARE: f64 = 0.005;
/// Greater ones leave no encoder.
const MOST: f64 = 0.9;

/// A change of what the model leaves of the angle from one window to the next, in counts.
#[derive(Clone, Copy, Debug)]
struct Change {
    counts: f64,
    /// The same from the window after.
    next: f64,
    /// And from those [`FAR`] on.
    far: [f64; 2],
    /// Counts in the two windows together.
    counted: f64,
    kept_back: bool,
}

/// Mean squares and products of changes.
#[derive(Clone, Copy, Debug)]
struct Moments {
    square: f64,
    next: f64,
    far: [f64; 2],
}

impl Moments {
    fn of<'a>(changes: impl Iterator<Item = &'a Change> + Clone) -> Self {
        let count = changes.clone().count().max(1) as f64;
        let mean = |of: fn(&Change) -> f64| changes.clone().map(of).sum::<f64>() / count;
        Self {
            square: mean(|change| change.counts.powi(2)),
            next: mean(|change| change.counts * change.next),
            far: [mean(|change| change.counts * change.far[0]), mean(|change| change.counts * change.far[1])],
        }
    }

    /// Whether steps are independent, from window to window, beside an angle that is uneven: then a change and the next one
    /// have between half and two thirds in common, against each other, and far ones nothing.
    fn are_of_independent_steps(&self) -> bool {
        let share = -self.next / self.square;
        (0.5 - LOOSE..2.0 / 3.0 + LOOSE).contains(&share) && self.far.iter().all(|far| far.abs() < LOOSE * self.square)
    }

    /// Variance of what a window leaves: of its step, and of the angle at both ends.
    fn of_window(&self) -> f64 {
        (self.square + self.next).max(0.0)
    }

    /// Variance of its step alone.
    fn of_step(&self) -> f64 {
        2.0 * self.square + 3.0 * self.next
    }
}

/// Changes that a residual of the motion has, where a model with counts in it leaves one.
fn changes(data: &Dataset, residual: &[f64]) -> Vec<Change> {
    let motion = data.motion();
    let mut changes = Vec::new();
    if data.count_rad <= 0.0 || !matches!(motion.output, Output::MeanSpeed | Output::AngleDifference) {
        return changes;
    }
    for stretch in &data.stretches {
        let span = stretch.window.span.max(1);
        let to_counts = stretch.window_s() / data.count_rad;
        let left = |row: usize| to_counts * residual[row];
        let counted = |row: usize| to_counts * motion.values[row].abs();
        let change = |row: usize| left(row + span) - left(row);
        for row in stretch.rows.start..stretch.rows.end.saturating_sub((FAR[1] + 1) * span) {
            let one = Change {
                counts: change(row),
                next: change(row + span),
                far: FAR.map(|windows| change(row + windows * span)),
                counted: counted(row) + counted(row + span),
                kept_back: data.kept_back[row],
            };
            let is_whole = [one.counts, one.next, one.far[0], one.far[1]].iter().all(|value| value.is_finite());
            if is_whole && one.counted >= 2.0 * FEWEST_COUNTS {
                changes.push(one);
            }
        }
    }
    changes
}

/// The same where they are what counts lost at random make of them.
fn random_changes(data: &Dataset, residual: &[f64]) -> Option<Vec<Change>> {
    let changes = changes(data, residual);
    let all = Moments::of(changes.iter());
    let are_random = changes.len() >= FEWEST && all.are_of_independent_steps() && all.of_step() > 0.0;
    are_random.then_some(changes)
}

/// Standard deviation of the scatter in a residual of the motion on data kept back; `None` where it is not what counts lost at
/// random make of it.
pub fn noise_rad_per_s(data: &Dataset, residual: &[f64]) -> Option<f64> {
    let changes = random_changes(data, residual)?;
    let any_kept_back = changes.iter().any(|change| change.kept_back);
    let judged = Moments::of(changes.iter().filter(|change| change.kept_back || !any_kept_back));
    Some(judged.of_window().sqrt() * data.count_rad / data.stretches.first()?.window_s())
}

/// Counts of which a share is lost at random, at all speeds alike.
#[derive(Clone, Copy, Debug)]
pub struct RandomLosses {
    /// Of all counts.
    pub share: f64,
    /// Standard error of that.
    pub error: f64,
}

impl RandomLosses {
    /// What the scatter of a residual says beyond doubt.
    pub fn of(data: &Dataset, residual: &[f64]) -> Option<Self> {
        let mut changes = random_changes(data, residual)?;
        let parts: Vec<f64> = changes.chunks(changes.len().div_ceil(BLOCKS)).map(share).collect();
        let share_of_all = share(&changes);
        let spread = parts.iter().map(|part| (part - share_of_all).powi(2)).sum::<f64>() / (parts.len() - 1) as f64;
        let error = (spread / parts.len() as f64).sqrt();
        changes.sort_by(|a, b| a.counted.total_cmp(&b.counted));
        let (slower, faster) = changes.split_at(changes.len() / 2);
        let [slower, faster] = [slower, faster].map(share);
        let is_even = slower > 0.0 && faster > 0.0 && (slower / faster).max(faster / slower) < EVEN;
        let is_certain = share_of_all > LEAST_SIGMAS * error && (LEAST_SHARE..MOST).contains(&share_of_all);
        (is_even && is_certain).then_some(Self { share: share_of_all, error })
    }

    /// By how much a constant of a unit is uncertain by them: standard deviations of the logarithm.
    pub fn uncertainty(&self, unit: Unit) -> f64 {
        Quantity::Motion.power(unit).abs() * self.error / (1.0 - self.share)
    }

    /// What they are named. `rmse`: error of the motion, to which they add noise that no model takes off.
    pub fn cause(&self, data: &Dataset, rmse: f64) -> Cause {
        let half = Z95 * self.error;
        let share = Estimate { value: self.share, ci95: Some([self.share - half, self.share + half]) };
        let sigmas = self.share / self.error;
        Cause {
            effect: ID.into(),
            confidence: confidence(sigmas),
            parameters: BTreeMap::from([("lost_share".to_string(), share)]),
            gain: BTreeMap::from([(data.motion().output.channel(), RmseGain { rmse_before: rmse, rmse_after: rmse })]),
            not_separable_from: Vec::new(),
            evidence_sigmas: sigmas,
            runner_up: None,
        }
    }

    /// A model of which as many counts fewer are read.
    pub fn also_in(&self, model: &Model) -> Model {
        let effect = effect(ID).expect("an effect of the catalogue");
        // Of all, from the slowest on, all at once.
        model.with(effect, vec![self.share, 0.0, 1.0, 0.0])
    }
}

/// Variance of the steps over the counts that were counted meanwhile: of `n` edges each lost with probability `p` that is
/// `n p (1 - p)`, and `n (1 - p)` are counted.
fn share(changes: &[Change]) -> f64 {
    let counted: f64 = changes.iter().map(|change| 0.5 * change.counted).sum();
    Moments::of(changes.iter()).of_step() * changes.len() as f64 / counted
}

//! Counts missed at random: each edge is lost with some probability. The mean loss is a term of the model
//! (`catalogue/missed_counts.rs`), or a wrong torque constant. The scatter is noise, and this module recognises it.
//!
//! The residual angle is then a random walk: from window to window it changes by independent steps. Their variance is
//! that of the lost counts, proportional to the counts and the share lost. Rounding, and rows read at uneven times,
//! give an uneven angle that does not drift. A motor that the model does not describe continues from one window into
//! the next.
//!
//! A share that is equal at all speeds cannot be told from other motor constants by the motion, only by the scatter.
//! The data are then diagnosed again with the lost counts added.

use super::counter_stops::ID;
use super::outcome::{Cause, Estimate, RmseGain, confidence};
use crate::configuration::diagnose::random_losses::{
    BLOCKS, EVEN, FAR, FEWEST, FEWEST_COUNTS, LEAST_SHARE, LEAST_SIGMAS, LOOSE, MOST,
};
use crate::dataset::{Dataset, Output};
use crate::identify::Z95;
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_model::unit::{Quantity, Unit};
use std::collections::BTreeMap;

/// A change of the residual angle from one window to the next, in counts.
#[derive(Clone, Copy, Debug)]
struct Change {
    counts: f64,
    /// The change to the window after that.
    next: f64,
    /// The changes [`FAR`] windows later and beyond.
    far: [f64; 2],
    /// Counts in the two windows together.
    counted: f64,
    held_out: bool,
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

    /// Whether the steps are independent from window to window, apart from an uneven angle. Then a change and the next
    /// one have between half and two thirds in common, with opposite sign, and distant ones nothing.
    fn are_of_independent_steps(&self) -> bool {
        let share = -self.next / self.square;
        (0.5 - LOOSE..2.0 / 3.0 + LOOSE).contains(&share) && self.far.iter().all(|far| far.abs() < LOOSE * self.square)
    }

    /// Variance of the change over a window: of its step, and of the angle at both ends.
    fn of_window(&self) -> f64 {
        (self.square + self.next).max(0.0)
    }

    /// Variance of the step alone.
    fn of_step(&self) -> f64 {
        2.0 * self.square + 3.0 * self.next
    }
}

/// Changes in a residual of the motion, if the motion is counted.
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
                held_out: data.held_out[row],
            };
            let is_whole = [one.counts, one.next, one.far[0], one.far[1]].iter().all(|value| value.is_finite());
            if is_whole && one.counted >= 2.0 * FEWEST_COUNTS {
                changes.push(one);
            }
        }
    }
    changes
}

/// The same, if they are as randomly lost counts make them.
fn random_changes(data: &Dataset, residual: &[f64]) -> Option<Vec<Change>> {
    let changes = changes(data, residual);
    let all = Moments::of(changes.iter());
    let are_random = changes.len() >= FEWEST && all.are_of_independent_steps() && all.of_step() > 0.0;
    are_random.then_some(changes)
}

/// Standard deviation of the scatter in a residual of the motion on held-out data; `None` if randomly lost counts do
/// not explain it.
pub fn noise_rad_per_s(data: &Dataset, residual: &[f64]) -> Option<f64> {
    let changes = random_changes(data, residual)?;
    let any_held_out = changes.iter().any(|change| change.held_out);
    let judged = Moments::of(changes.iter().filter(|change| change.held_out || !any_held_out));
    Some(judged.of_window().sqrt() * data.count_rad / data.stretches.first()?.window_s())
}

/// A constant share of counts that is lost at random.
#[derive(Clone, Copy, Debug)]
pub struct RandomLosses {
    /// Of all counts.
    pub share: f64,
    /// Standard error of that.
    pub error: f64,
}

impl RandomLosses {
    /// The share that the scatter of a residual shows beyond doubt.
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

    /// Uncertainty of a constant of a unit from these losses: standard deviations of the logarithm.
    pub fn uncertainty(&self, unit: Unit) -> f64 {
        Quantity::Motion.power(unit).abs() * self.error / (1.0 - self.share)
    }

    /// The cause that they are reported as. `rmse`: error of the motion, which contains their noise; no model can
    /// predict it.
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

    /// A model whose sensor reads as many counts less.
    pub fn also_in(&self, model: &Model) -> Model {
        let effect = effect(ID).expect("an effect of the catalogue");
        // From the lowest speed on, all at once.
        model.with(effect, vec![self.share, 0.0, 1.0, 0.0])
    }
}

/// Variance of the steps over the counts in the same time. Of `n` edges, each lost with probability `p`, the variance
/// is `n p (1 - p)`, and `n (1 - p)` are counted.
fn share(changes: &[Change]) -> f64 {
    let counted: f64 = changes.iter().map(|change| 0.5 * change.counted).sum();
    Moments::of(changes.iter()).of_step() * changes.len() as f64 / counted
}

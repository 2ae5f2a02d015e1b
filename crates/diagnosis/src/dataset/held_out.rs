//! The part of the data that no fit sees, to judge by.
//!
//! One block in three is held out. The blocks are of equal length, so that each part has its share of what happens. Where
//! most of it happens at once, such as after the only step, they are shorter there: each part then has its share of
//! the step as well.

use super::{Dataset, spread};
use std::ops::RangeInclusive;

/// Length of a block; shorter in short recordings.
const BLOCK_S: f64 = 0.25;
const FEWEST_BLOCKS: f64 = 24.0;
const EVERY: usize = 3;
/// Which of them is held out.
const HELD_OUT: usize = 1;
/// Evenly spread, a part has a third of all changes of the motion. At half or twice these odds, they are not.
const FAIR: RangeInclusive<f64> = 0.05..=0.5;
/// A change is that over this part of a block.
const PART_OF_BLOCK: usize = 16;

impl Dataset {
    pub(super) fn hold_out(&mut self) {
        self.keep_back(HELD_OUT);
    }

    /// The same data with each of the other parts held out in turn.
    pub fn with_others_held_out(&self) -> impl Iterator<Item = Self> {
        (0..EVERY).filter(|part| *part != HELD_OUT).map(|part| {
            let mut other = self.clone();
            other.keep_back(part);
            other
        })
    }

    fn keep_back(&mut self, part: usize) {
        self.held_out = self.blocks().into_iter().map(|block| block % EVERY == part).collect();
    }

    /// The block of each row.
    fn blocks(&self) -> Vec<usize> {
        let rows_of_block = (BLOCK_S.min(self.span_s() / FEWEST_BLOCKS) / self.interval_s).max(1.0) as usize;
        let mut changes = [0.0; EVERY];
        for (block, speeds) in self.motion().values.chunks(rows_of_block).enumerate() {
            changes[block % EVERY] += spread(speeds).powi(2) * speeds.len() as f64;
        }
        let all: f64 = changes.iter().sum();
        if all == 0.0 || FAIR.contains(&(changes[HELD_OUT] / all)) {
            return (0..self.len()).map(|row| row / rows_of_block).collect();
        }
        self.blocks_of_changes(rows_of_block)
    }

    /// As many blocks, each with its share of the time and of the changes.
    fn blocks_of_changes(&self, rows_of_block: usize) -> Vec<usize> {
        let (speeds, span) = (&self.motion().values, (rows_of_block / PART_OF_BLOCK).max(1));
        let change = |row: usize| {
            let change = speeds[row] - speeds[row.saturating_sub(span)];
            if change.is_finite() { change * change } else { 0.0 }
        };
        let changes: Vec<f64> = (0..self.len()).map(change).collect();
        let all = changes.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let count = self.len() as f64 / rows_of_block as f64;
        let mut passed = 0.0;
        let block = |change: f64| {
            passed += 0.5 * (1.0 / self.len() as f64 + change / all);
            (passed * count) as usize
        };
        changes.into_iter().map(block).collect()
    }
}

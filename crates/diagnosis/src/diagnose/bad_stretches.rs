//! Short stretches in which the motion does not follow its command: a host that pauses, a hand at the shaft, rows that
//! are garbled. One of them costs every name, since its error outweighs all others. They are found where what the model
//! lacks stands out, and left out if everything else is explained without them.

use super::judge::{NOT_NOISE, above_floor};
use super::missing::lack;
use super::residuals;
use crate::dataset::{Dataset, Stretch, median};
use crate::identify::Fit;
use motorbench_model::catalogue::ActsOn;
use std::ops::Range;

/// The lack is looked at in blocks of this length.
const BLOCK_S: f64 = 0.1;
/// A block stands out by this multiple of the usual lack. Even a law that is missing acts in many blocks, so it is usual.
const STANDS_OUT: f64 = 5.0;
/// Blocks on either side that are left out as well: the filter smears the lack, and the motor has to come back.
const MARGIN_BLOCKS: usize = 2;
/// At most this share of a recording is left out, in at most so many places. More is a cause, and no accident.
const MOST_LEFT_OUT: f64 = 0.1;
const MOST_STRETCHES: usize = 3;

/// The rows of such stretches, where the model leaves more than noise.
pub(super) fn find(data: &Dataset, found: &Fit) -> Vec<Range<usize>> {
    if above_floor(data, found) < NOT_NOISE {
        return Vec::new();
    }
    let place = if data.current().is_some() { ActsOn::Voltage } else { ActsOn::Torque };
    let lack = lack(data, &found.model.motor, &residuals(data, &found.prediction), place).values;
    let blocks: Vec<(Range<usize>, f64)> = data.stretches.iter().flat_map(|stretch| blocks(stretch, &lack)).collect();
    let usual = median(blocks.iter().map(|(_, size)| *size));
    let stands_out: Vec<bool> = blocks.iter().map(|(_, size)| *size > STANDS_OUT * usual).collect();
    let near = |block: usize| {
        let last = (block + MARGIN_BLOCKS).min(blocks.len() - 1);
        stands_out[block.saturating_sub(MARGIN_BLOCKS)..=last].contains(&true)
    };
    let mut left_out: Vec<Range<usize>> = Vec::new();
    for (rows, _) in (0..blocks.len()).filter(|block| near(*block)).map(|block| &blocks[block]) {
        match left_out.last_mut().filter(|last| last.end == rows.start) {
            Some(last) => last.end = rows.end,
            None => left_out.push(rows.clone()),
        }
    }
    let rows: usize = left_out.iter().map(Range::len).sum();
    let is_an_accident = left_out.len() <= MOST_STRETCHES && rows as f64 <= MOST_LEFT_OUT * data.len() as f64;
    if is_an_accident { left_out } else { Vec::new() }
}

/// Blocks of rows with the size of the lack in each.
fn blocks(stretch: &Stretch, lack: &[f64]) -> Vec<(Range<usize>, f64)> {
    let length = (BLOCK_S / stretch.interval_s).max(1.0) as usize;
    let starts = stretch.rows.clone().step_by(length);
    starts
        .map(|start| {
            let rows = start..(start + length).min(stretch.rows.end);
            let squares: f64 = lack[rows.clone()].iter().map(|value| value * value).sum();
            let size = (squares / rows.len() as f64).sqrt();
            (rows, size)
        })
        .collect()
}

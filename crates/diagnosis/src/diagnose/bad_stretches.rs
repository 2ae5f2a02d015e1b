//! Short stretches in which the motion does not follow its command: a host that pauses, a hand at the shaft, rows that
//! are garbled. One of them costs every name, since its error outweighs all others. They are found where what the model
//! lacks stands out, and left out if everything else is explained without them.

use super::judge::{BLOCK_S, NOT_NOISE, above_floor};
use super::missing::lack;
use super::residuals;
use crate::configuration::diagnose::bad_stretches::{BELONGS, STANDS_OUT};
pub(super) use crate::configuration::diagnose::bad_stretches::{LEFT_OF_REST, MOST_LEFT_OUT, MOST_PLACES};
use crate::dataset::{Dataset, Stretch, median};
use crate::identify::{Effort, Fit, Prior, fit};
use motorbench_model::Model;
use motorbench_model::catalogue::ActsOn;
use std::ops::Range;

/// The data without the greatest of such stretches that `found` shows, if there is one and not too much is left out.
pub(super) fn without_greatest(data: &Dataset, found: &Fit) -> Option<Dataset> {
    without(data, standing_out(&Lacks::new(data, found), |_| true)?)
}

/// The same of the stretches that adjoin those that are left out: they belong to them, and are less than they. With the model
/// fitted to what is left.
pub(super) fn without_adjoining(mut rest: Dataset, prior: &Prior, model: &Model) -> (Dataset, Fit) {
    let refit = |rest: &Dataset| fit(model, rest, prior, Effort::AGAIN);
    let mut found = refit(&rest);
    for _ in 0..MOST_PLACES {
        let Some(next) = without_greatest_adjoining(&rest, &found) else { break };
        found = refit(&next);
        rest = next;
    }
    (rest, found)
}

fn without_greatest_adjoining(data: &Dataset, found: &Fit) -> Option<Dataset> {
    let adjoins = |rows: &Range<usize>| {
        let left_out = |place: &Range<usize>| place.end == rows.start || place.start == rows.end;
        data.origin.left_out.iter().any(left_out)
    };
    without(data, standing_out(&Lacks::new(data, found), adjoins)?)
}

/// Whether the effects of a model explain all but one such stretch.
pub(super) fn are_all_that_remains(data: &Dataset, prior: &Prior, found: &Fit) -> bool {
    without_greatest(data, found).is_some_and(|rest| {
        let (rest, found) = without_adjoining(rest, prior, &found.model);
        above_floor(&rest, &found) < NOT_NOISE
    })
}

fn without(data: &Dataset, rows: Range<usize>) -> Option<Dataset> {
    let mut rest = data.clone();
    rest.leave_out_rows(rows);
    let left_out: usize = rest.origin.left_out.iter().map(|rows| rows.len()).sum();
    let left: usize = rest.stretches.iter().map(|stretch| stretch.rows.len()).sum();
    (left > 0 && (left_out as f64) < MOST_LEFT_OUT * (left_out + left) as f64).then_some(rest)
}

/// What a model lacks in each block of rows.
struct Lacks {
    blocks: Vec<(Range<usize>, f64)>,
    usual: f64,
}

impl Lacks {
    fn new(data: &Dataset, found: &Fit) -> Self {
        let place = if data.current().is_some() { ActsOn::Voltage } else { ActsOn::Torque };
        let lack = lack(data, &found.model.motor, &residuals(data, &found.prediction), place).values;
        let blocks: Vec<_> = data.stretches.iter().flat_map(|stretch| blocks(stretch, &lack)).collect();
        let usual = median(blocks.iter().map(|(_, size)| *size));
        Self { blocks, usual }
    }
}

/// The rows around the greatest lack where it may be, if that stands out.
fn standing_out(Lacks { blocks, usual }: &Lacks, may: impl Fn(&Range<usize>) -> bool) -> Option<Range<usize>> {
    let possible = (0..blocks.len()).filter(|block| may(&blocks[*block].0));
    let greatest = possible.max_by(|a, b| blocks[*a].1.total_cmp(&blocks[*b].1))?;
    if blocks[greatest].1 < STANDS_OUT * usual {
        return None;
    }
    let least = (BELONGS * blocks[greatest].1).max(*usual);
    let belongs = |block: &usize| blocks[*block].1 > least;
    let first = (0..greatest).rev().take_while(belongs).last().unwrap_or(greatest);
    let last = (greatest + 1..blocks.len()).take_while(belongs).last().unwrap_or(greatest);
    Some(blocks[first].0.start..blocks[last].0.end)
}

/// Blocks of rows with the size of the lack in each.
fn blocks(stretch: &Stretch, lack: &[f64]) -> Vec<(Range<usize>, f64)> {
    let length = (BLOCK_S / stretch.interval_s).max(1.0) as usize;
    stretch
        .rows
        .clone()
        .step_by(length)
        .map(|start| {
            let rows = start..(start + length).min(stretch.rows.end);
            let squares: f64 = lack[rows.clone()].iter().map(|value| value * value).sum();
            let size = (squares / rows.len() as f64).sqrt();
            (rows, size)
        })
        .collect()
}

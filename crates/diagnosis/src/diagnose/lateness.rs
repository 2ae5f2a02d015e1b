//! How late readings are, at each moment of a recording, compared with a simulation.
//!
//! The lateness is followed through the recording by dynamic programming (Viterbi, IEEE Transactions on Information Theory
//! 13 (1967)): it grows evenly, and may jump at any time for a price. The simulation does not change, since only the
//! readings move.

use super::judge;
pub(super) use crate::configuration::diagnose::lateness::{BLOCK_S, JUMP_NATS, QUICK_S};
use crate::configuration::diagnose::lateness::{
    COARSE_GROWTH, FASTEST_GROWTH, FINE_GROWTH, LATEST_S, LONG_BLOCK_S, MOST_NATS, REFINED,
};
use crate::dataset::{Dataset, LateCourse, Measured, Stretch};
use crate::free_run::Prediction;
use crate::identify::Prior;
use crate::parallel;
use motorbench_model::Model;
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::motor::MotorParameters;
use std::ops::Range;

/// The lateness of each reading that brings a prediction closest. `errors`: what is expected of each quantity.
pub(super) fn late_s(data: &Dataset, prediction: &Prediction, errors: &[f64]) -> (Vec<f64>, LateCourse) {
    let mut late_s = vec![0.0; data.len()];
    let mut course = LateCourse::default();
    for stretch in &data.stretches {
        let path = Path::of(data, stretch, prediction, errors);
        for rows in path.pieces(stretch) {
            for row in rows.clone() {
                late_s[row] = path.late_s(row, stretch, &data.time_s);
            }
            refine(data, prediction, rows, stretch, &mut late_s);
        }
        course = LateCourse { growth: path.growth, jumps: course.jumps + path.jumps.len() };
    }
    (late_s, course)
}

/// What the readings cost with the lateness that brings a prediction closest, in natural units: in long blocks, with a
/// growth in coarse steps.
pub(super) fn nats(data: &Dataset, prediction: &Prediction, errors: &[f64]) -> f64 {
    let of = |stretch| Blocks::new(data, stretch, prediction, errors, LONG_BLOCK_S).cheapest_of_coarse().cost;
    data.stretches.iter().map(of).sum()
}

/// The one lateness of all readings that brings a prediction closest, to a block.
pub(super) fn constant_s(data: &Dataset, prediction: &Prediction, errors: &[f64]) -> f64 {
    let of = |stretch| Blocks::new(data, stretch, prediction, errors, BLOCK_S);
    let blocks: Vec<Blocks> = data.stretches.iter().map(of).collect();
    let Some(first) = blocks.first() else { return 0.0 };
    let (mut all, mut own) = (vec![0.0; states(first.block_s)], Vec::new());
    for blocks in &blocks {
        own.resize(states(blocks.block_s), 0.0);
        for block in 0..blocks.count {
            blocks.nats(block, 0.0, &mut own);
            all.iter_mut().zip(&own).for_each(|(all, own)| *all += own);
        }
    }
    least(&all) as f64 * first.block_s
}

/// Root mean square of what a model lacks in each quantity, at least its noise.
pub(super) fn errors(data: &Dataset, prediction: &Prediction) -> Vec<f64> {
    let of = |(measured, predicted): (&Measured, &Vec<f64>)| {
        let left = measured.values.iter().zip(predicted).map(|(read, predicted)| (read - predicted).powi(2));
        let seen: Vec<f64> = left.filter(|square| square.is_finite()).collect();
        let lacks = (seen.iter().sum::<f64>() / seen.len().max(1) as f64).sqrt();
        measured.least_error(measured.noise).max(lacks)
    };
    data.measured.iter().zip(prediction).map(of).collect()
}

/// The same with the inertia that gives an electromechanical time constant.
pub(super) fn with_time_constant(model: &Model, time_constant_s: f64) -> Model {
    let mut other = model.clone();
    let motor = &mut other.motor;
    motor.inertia_kg_m2 = time_constant_s * motor.torque_constant_nm_per_a.powi(2) / motor.resistance_ohm;
    other
}

/// Without a delay, and without a winding that is slower than usual: a fit to readings that are late takes the lateness
/// for either.
pub(super) fn without_lag(model: &Model, prior: &Prior) -> Model {
    let mut quicker = model.clone();
    quicker.terms.retain(|term| !term.effect.about().is_delay);
    let usual_s = TimeConstants::of(&prior.motor).electromagnetic_s;
    let motor = &mut quicker.motor;
    motor.inductance_h = motor.inductance_h.min(usual_s * motor.resistance_ohm);
    quicker
}

/// The same with the usual resistance and torque constant, and with the gain and the time constant of the model: a fit to
/// the speed alone does not return to them.
pub(super) fn at_once(model: &Model, prior: &Prior) -> Model {
    let Model { motor: found, terms } = without_lag(model, prior);
    let MotorParameters { torque_constant_nm_per_a: k, resistance_ohm, .. } = prior.motor;
    // Torque over speed: of the back-EMF and of the friction.
    let braking = |motor: &MotorParameters| {
        motor.torque_constant_nm_per_a.powi(2) / motor.resistance_ohm + motor.viscous_friction_nm_s
    };
    let gain = found.torque_constant_nm_per_a / found.resistance_ohm / braking(&found);
    let viscous_friction_nm_s = (k / resistance_ohm / gain - k * k / resistance_ohm).max(0.0);
    let inductance_h = found.inductance_h / found.resistance_ohm * resistance_ohm;
    let mut motor = MotorParameters { viscous_friction_nm_s, inductance_h, ..prior.motor };
    motor.inertia_kg_m2 = found.inertia_kg_m2 / braking(&found) * braking(&motor);
    Model { motor, terms }
}

/// Moves the lateness of rows between two jumps by less than a block, to where the readings agree best (Gauss and Newton).
fn refine(data: &Dataset, prediction: &Prediction, rows: Range<usize>, stretch: &Stretch, late_s: &mut [f64]) {
    for _ in 0..REFINED {
        let (mut normal, mut towards_s) = (0.0, 0.0);
        for (measured, predicted) in data.measured.iter().zip(prediction) {
            let weight = measured.least_error(measured.noise).powi(-2);
            for row in rows.clone() {
                let back = (late_s[row] / stretch.interval_s).max(0.0);
                let at = |back: f64| interpolated(predicted, stretch.rows.start, row as f64 - back);
                let slope = (at(back + 1.0) - at((back - 1.0).max(0.0))) / stretch.interval_s;
                let slope = slope / (back + 1.0 - (back - 1.0).max(0.0));
                let left = measured.values[row] - at(back);
                if slope.is_finite() && left.is_finite() {
                    normal += weight * slope * slope;
                    towards_s += weight * slope * left;
                }
            }
        }
        let most_s = BLOCK_S.max(stretch.interval_s);
        let moved_s = (towards_s / normal.max(f64::MIN_POSITIVE)).clamp(-most_s, most_s);
        late_s[rows.clone()].iter_mut().for_each(|late_s| *late_s = (*late_s + moved_s).max(0.0));
    }
}

/// A value between two rows; before the first row it is that of the first one.
fn interpolated(values: &[f64], first: usize, at: f64) -> f64 {
    let row = at.floor().max(first as f64) as usize;
    let part = (at - row as f64).max(0.0);
    if part > 0.0 { values[row] * (1.0 - part) + values[row + 1] * part } else { values[row] }
}

/// How late the readings of a stretch are, block by block.
struct Path {
    rows_of_block: usize,
    growth: f64,
    /// Lateness of each block at its first row.
    late_s: Vec<f64>,
    /// The blocks before which it jumped.
    jumps: Vec<usize>,
    cost: f64,
}

impl Path {
    /// The cheapest one. Its growth is searched in coarse steps and long blocks, then in fine steps.
    fn of(data: &Dataset, stretch: &Stretch, prediction: &Prediction, errors: &[f64]) -> Self {
        let blocks = |block_s: f64| Blocks::new(data, stretch, prediction, errors, block_s);
        let Self { growth, .. } = blocks(LONG_BLOCK_S).cheapest_of_coarse();
        blocks(BLOCK_S).cheapest_around(growth, FINE_GROWTH, (0.5 * COARSE_GROWTH / FINE_GROWTH).round() as i32)
    }

    /// The rows between two jumps.
    fn pieces(&self, stretch: &Stretch) -> Vec<Range<usize>> {
        let row = |block: &usize| stretch.rows.start + block * self.rows_of_block;
        let ends = self.jumps.iter().map(row).chain([stretch.rows.end]);
        let begins = [stretch.rows.start].into_iter().chain(self.jumps.iter().map(row));
        begins.zip(ends).map(|(begin, end)| begin..end).collect()
    }

    fn late_s(&self, row: usize, stretch: &Stretch, time_s: &[f64]) -> f64 {
        let block = (row - stretch.rows.start) / self.rows_of_block;
        let begun = stretch.rows.start + block * self.rows_of_block;
        (self.late_s[block] + self.growth * (time_s[row] - time_s[begun])).max(0.0)
    }
}

/// Mean readings and predictions in blocks of time.
struct Blocks {
    rows_of_block: usize,
    block_s: f64,
    count: usize,
    quantities: Vec<Quantity>,
}

/// Of each block. Readings and predictions are in multiples of the error that is expected of them.
struct Quantity {
    read: Vec<f64>,
    /// From the last block back to the first one, which is repeated for as long as a reading may be late.
    expected_back: Vec<f64>,
}

impl Blocks {
    fn new(data: &Dataset, stretch: &Stretch, prediction: &Prediction, errors: &[f64], block_s: f64) -> Self {
        let rows_of_block = (block_s / stretch.interval_s).round().max(1.0) as usize;
        let block_s = rows_of_block as f64 * stretch.interval_s;
        let rows = stretch.rows.clone();
        let in_blocks = |values: &[f64], error: f64| -> Vec<f64> {
            values[rows.clone()].chunks(rows_of_block).map(|rows| mean(rows) / error).collect()
        };
        let quantity = |((measured, predicted), error): ((&Measured, &Vec<f64>), &f64)| {
            let mut expected_back = in_blocks(predicted, *error);
            expected_back.reverse();
            let first = expected_back.last().copied().unwrap_or(f64::NAN);
            expected_back.resize(expected_back.len() + states(block_s), first);
            Quantity { read: in_blocks(&measured.values, *error), expected_back }
        };
        Self {
            rows_of_block,
            block_s,
            count: rows.len().div_ceil(rows_of_block),
            quantities: data.measured.iter().zip(prediction).zip(errors).map(quantity).collect(),
        }
    }

    fn cheapest_of_coarse(&self) -> Path {
        self.cheapest_around(0.0, COARSE_GROWTH, (FASTEST_GROWTH / COARSE_GROWTH).round() as i32)
    }

    /// The cheapest path with one of the rates of growth around this one.
    fn cheapest_around(&self, centre: f64, step: f64, steps: i32) -> Path {
        let paths = parallel::map(-steps..=steps, |count| self.cheapest(centre + f64::from(count) * step));
        paths.into_iter().min_by(|one, other| one.cost.total_cmp(&other.cost)).expect("one rate at least")
    }

    /// The cheapest path with a rate of growth. A state is a whole number of blocks by which a reading is late. What the
    /// growth adds to the last whole block comes to it.
    fn cheapest(&self, growth: f64) -> Path {
        let states = states(self.block_s);
        let grown = |block: usize| growth * block as f64;
        let moved = |block: usize| grown(block).floor() as i64 - grown(block.saturating_sub(1)).floor() as i64;
        // No state is beyond the first and the last one.
        let (mut costs, mut reached) = (vec![f64::INFINITY; states + 2], vec![0.0; states]);
        costs[1..=states].fill(0.0);
        let (mut jumped, mut jumps_from) = (vec![false; self.count * states], Vec::with_capacity(self.count));
        for (block, jumped) in jumped.chunks_mut(states).enumerate() {
            let cheapest = least(&costs[1..=states]);
            jumps_from.push(cheapest);
            let by_jump = costs[1 + cheapest] + JUMP_NATS;
            self.nats(block, grown(block) - grown(block).floor(), &mut reached);
            let stays = &costs[(1 - moved(block)) as usize..];
            for ((reached, jumped), stays) in reached.iter_mut().zip(jumped).zip(stays) {
                *jumped = *stays > by_jump;
                *reached += stays.min(by_jump);
            }
            costs[1..=states].copy_from_slice(&reached);
        }
        let costs = &costs[1..=states];
        let last = least(costs);
        let (mut state, mut jumps, mut late_s) = (last, Vec::new(), vec![0.0; self.count]);
        for (block, jumped) in jumped.chunks(states).enumerate().rev() {
            late_s[block] = (state as f64 + grown(block) - grown(block).floor()) * self.block_s;
            if block > 0 && jumped[state] {
                jumps.push(block);
            }
            state = if jumped[state] { jumps_from[block] } else { (state as i64 - moved(block)) as usize };
        }
        jumps.reverse();
        Path { rows_of_block: self.rows_of_block, growth, late_s, jumps, cost: costs[last] }
    }

    /// What a block costs whose readings are late by each number of blocks and a part of one. A few readings that nothing
    /// explains cost no more than a jump. What a model lacks continues over [`judge::BLOCK_S`], so that these blocks are
    /// not independent.
    fn nats(&self, block: usize, part: f64, nats: &mut [f64]) {
        nats.fill(0.0);
        let independent = (self.block_s / judge::BLOCK_S).min(1.0);
        for Quantity { read, expected_back } in &self.quantities {
            let (read, expected) = (read[block], &expected_back[self.count - 1 - block..]);
            if read.is_nan() {
                continue;
            }
            for ((nats, expected), before) in nats.iter_mut().zip(expected).zip(&expected[1..]) {
                let left = read - (expected * (1.0 - part) + before * part);
                let own = 0.5 * left * left * independent;
                *nats += if own.is_finite() { own * MOST_NATS / (own + MOST_NATS) } else { 0.0 };
            }
        }
    }
}

/// Number of blocks by which a reading may be late.
fn states(block_s: f64) -> usize {
    (LATEST_S / block_s).max(1.0) as usize
}

/// Where the least value is.
fn least(values: &[f64]) -> usize {
    let smaller = |(least, at): (f64, usize), (index, value): (usize, &f64)| {
        if *value < least { (*value, index) } else { (least, at) }
    };
    values.iter().enumerate().fold((f64::INFINITY, 0), smaller).1
}

/// Mean of the values that are not missing; NaN without any.
fn mean(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|value| value.is_finite());
    finite().sum::<f64>() / finite().count() as f64
}

//! A candidate fitted: constants by Levenberg and Marquardt's method on innovations, what is unknown by their likelihood, and
//! the logarithm of the evidence by Laplace's method.

use super::constants::{Constant, constants, log_odds};
use super::settings::Settings;
use super::whiten::{Channel, Quantity, Unknown, Whitener, channels};
use crate::dataset::Dataset;
use crate::free_run::{Steps, drive, read, read_angle};
use crate::identify::{Prior, scales};
use crate::model::Model;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Relative step of finite differences, and the same over events that come sooner or later.
const DIFFERENCE: f64 = 2e-3;
const DIFFERENCE_OVER_EVENTS: f64 = 4e-2;
/// A step is tried with so many dampings.
const TRIES: usize = 5;
/// A coordinate moves at most so far in a step: a logarithm, a multiple of a unit.
const FARTHEST: [f64; 2] = [0.7, 4.0];
/// Factors by which what is unknown is changed, one round each.
const FACTORS: [f64; 4] = [5.0, 2.2, 1.5, 1.2];
/// So many sensitivities in a row are corrected before they are simulated anew (Broyden 1965).
const CORRECTED: usize = 3;

/// What all candidates share.
pub struct Problem<'a> {
    /// The recordings.
    pub data: &'a Dataset,
    /// What is known of the motor.
    pub prior: &'a Prior,
    /// Thresholds and priors.
    pub set: Settings,
    /// What was measured.
    pub channels: Vec<Channel>,
}

/// How far a fit goes.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Steps at most.
    pub steps: usize,
    /// It ends when a step gains less than this logarithm of the probability.
    pub least_gain: f64,
    /// Rounds of constants and unknown in turn.
    pub rounds: usize,
}

impl Effort {
    /// To see whether a candidate is worth it.
    pub const TRIAL: Self = Self { steps: 5, least_gain: 3.0, rounds: 1 };
    /// To the end.
    pub const FULL: Self = Self { steps: 12, least_gain: 0.3, rounds: 6 };
}

/// A candidate as it was fitted.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Motor and effects.
    pub model: Model,
    /// How much is unknown.
    pub unknown: Unknown,
    /// What was moved.
    pub constants: Vec<Constant>,
    /// Logarithm of the evidence.
    pub evidence: f64,
    /// Of what the model says of each channel, less what was measured.
    pub residual: Vec<Vec<f64>>,
    /// Innovations of that.
    pub innovations: Vec<f64>,
    /// Whitened sensitivities, one column a constant.
    pub columns: Vec<Vec<f64>>,
    /// Normal matrix of data and priors.
    pub normal: DMatrix<f64>,
}

struct Point {
    model: Model,
    residual: Vec<Vec<f64>>,
    innovations: Vec<f64>,
    /// Minus the logarithm of the probability of data and constants.
    cost: f64,
}

impl<'a> Problem<'a> {
    /// Of recordings of a motor.
    pub fn new(data: &'a Dataset, prior: &'a Prior, set: Settings) -> Self {
        Self { data, prior, set, channels: channels(data) }
    }

    /// What a model says of each channel.
    pub fn predict(&self, model: &Model, steps: Steps) -> Vec<Vec<f64>> {
        let motion = drive(model, self.data, steps);
        let is_angle = self.channels.iter().any(|channel| channel.quantity == Quantity::Angle);
        let angle = is_angle.then(|| read_angle(model, self.data, motion.clone()));
        let mut predicted = read(model, self.data, motion);
        if let Some(angle) = angle {
            let place = self.channels.iter().position(|channel| channel.quantity == Quantity::Angle);
            predicted[place.expect("it was just found")] = angle;
        }
        predicted
    }

    fn residual(&self, model: &Model) -> Vec<Vec<f64>> {
        let mut predicted = self.predict(model, Steps::Fine);
        for (predicted, channel) in predicted.iter_mut().zip(&self.channels) {
            predicted.iter_mut().zip(&channel.values).for_each(|(said, value)| *said -= value);
        }
        predicted
    }

    fn whitener(&self, model: &Model, unknown: Unknown) -> Whitener {
        Whitener::new(self.data, &self.channels, &model.motor, unknown, &self.set)
    }

    /// Minus the logarithm of Student's density of innovations, and what the filter adds.
    fn loss(&self, innovations: &[f64]) -> f64 {
        let dof = self.set.degrees_of_freedom;
        0.5 * (dof + 1.0) * innovations.iter().map(|e| (e * e / dof).ln_1p()).sum::<f64>()
    }

    /// What it costs that more or less is unknown than usual.
    fn price(&self, unknown: &[f64; 4]) -> f64 {
        let Settings { left_out_spread, noise_spread, .. } = self.set;
        let spreads = [left_out_spread, left_out_spread, noise_spread, noise_spread];
        unknown.iter().zip(spreads).map(|(factor, spread)| 0.5 * (factor.ln() / spread).powi(2)).sum()
    }

    /// How much is unknown: what makes the residual of a model most probable, from a first guess on.
    fn settle(&self, model: &Model, residual: &[Vec<f64>], from: Unknown) -> Unknown {
        let cost = |list: &[f64; 4]| {
            let filter = self.whitener(model, Unknown::of(*list));
            self.loss(&filter.innovations(residual)) + filter.log_deviations + self.price(list)
        };
        let has_current = self.channels.iter().any(|channel| channel.quantity == Quantity::Current);
        let places: &[usize] = if has_current { &[0, 1, 2, 3] } else { &[0, 2] };
        let mut best = from.list();
        let mut least = cost(&best);
        for factor in FACTORS {
            for _ in 0..4 {
                let moves: Vec<(usize, f64)> =
                    places.iter().flat_map(|place| [(*place, factor), (*place, 1.0 / factor)]).collect();
                let tried = moves.into_par_iter().map(|(place, factor)| {
                    let mut other = best;
                    let bounds = if place < 2 { (1.0, self.set.most_left_out) } else { (0.3, 100.0) };
                    other[place] = (other[place] * factor).clamp(bounds.0, bounds.1);
                    (if other == best { f64::INFINITY } else { cost(&other) }, other)
                });
                let tried: Vec<(f64, [f64; 4])> = tried.collect();
                let Some((cost, other)) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
                if cost >= least {
                    break;
                }
                (best, least) = (other, cost);
            }
        }
        Unknown::of(best)
    }

    fn point(&self, model: Model, filter: &Whitener, constants: &[Constant]) -> Point {
        let residual = self.residual(&model);
        let innovations = filter.innovations(&residual);
        let prior: f64 = constants
            .iter()
            .map(|constant| 0.5 * ((constant.get(&model) - constant.prior.0) / constant.prior.1).powi(2))
            .sum();
        let loss = self.loss(&innovations);
        let cost = if loss.is_finite() { loss + prior } else { f64::INFINITY };
        Point { model, residual, innovations, cost }
    }

    /// Whitened sensitivities.
    fn columns(&self, model: &Model, filter: &Whitener, constants: &[Constant]) -> Vec<Vec<f64>> {
        let base = self.predict(model, Steps::Coarse);
        let has_events = model.terms.iter().any(|term| term.effect.has_events());
        let difference = if has_events { DIFFERENCE_OVER_EVENTS } else { DIFFERENCE };
        constants
            .par_iter()
            .map(|constant| {
                let here = constant.get(model);
                let step = if constant.value(here + difference) < constant.max { difference } else { -difference };
                let mut moved = model.clone();
                constant.set(&mut moved, here + step);
                let mut change = self.predict(&moved, Steps::Coarse);
                for (change, base) in change.iter_mut().zip(&base) {
                    change.iter_mut().zip(base).for_each(|(there, here)| *there = (*there - here) / step);
                }
                filter.innovations(&change)
            })
            .collect()
    }

    /// What an innovation counts, beside one that is as it should be.
    fn weights(&self, innovations: &[f64]) -> Vec<f64> {
        let dof = self.set.degrees_of_freedom;
        innovations.iter().map(|e| (dof + 1.0) / (dof + e * e)).collect()
    }

    fn normal(&self, columns: &[Vec<f64>], weights: &[f64], constants: &[Constant]) -> DMatrix<f64> {
        let size = columns.len();
        let mut normal = DMatrix::zeros(size, size);
        for row in 0..size {
            for column in 0..=row {
                let value = weighted(&columns[row], &columns[column], weights);
                normal[(row, column)] = value;
                normal[(column, row)] = value;
            }
            normal[(row, row)] += constants[row].prior.1.powi(-2);
        }
        normal
    }

    /// Minus the logarithm of the probability of the data by a model as it stands, with the unknown at its best.
    pub fn as_it_stands(&self, model: &Model, unknown: Unknown) -> f64 {
        let residual = self.residual(model);
        let unknown = self.settle(model, &residual, unknown);
        let filter = self.whitener(model, unknown);
        self.loss(&filter.innovations(&residual)) + filter.log_deviations
    }

    /// Fits a candidate to the end, from what was unknown and from next to nothing: a large unknown torque takes the place of
    /// friction, and a fit does not come out of that by itself.
    pub fn fit_to_the_end(&self, start: &Model, unknown: Unknown) -> Fitted {
        let (kept, little) = rayon::join(
            || self.fit(start, unknown, Effort::FULL),
            || self.fit(start, Unknown { torque: 1.0, voltage: 1.0, ..unknown }, Effort::FULL),
        );
        if little.evidence > kept.evidence { little } else { kept }
    }

    /// Fits a candidate from its constants and what was unknown of another.
    pub fn fit(&self, start: &Model, unknown: Unknown, effort: Effort) -> Fitted {
        let mut model = start.clone().with_the_known();
        let mut unknown = unknown;
        let sizes = scales(&self.prior.motor, self.data);
        let constants = constants(&model, self.prior, &sizes, &self.set);
        for constant in &constants {
            let here = constant.get(&model);
            constant.set(&mut model, here);
        }
        let mut round = 0;
        loop {
            let filter = self.whitener(&model, unknown);
            let mut point = self.point(model.clone(), &filter, &constants);
            self.descend(&mut point, &filter, &constants, effort);
            let settled = self.settle(&point.model, &point.residual, unknown);
            round += 1;
            let same = settled.list().iter().zip(unknown.list()).all(|(a, b)| (a / b).ln().abs() < 0.3);
            model = point.model.clone();
            unknown = settled;
            if round >= effort.rounds || same {
                return self.finished(point, unknown, constants);
            }
        }
    }

    fn finished(&self, point: Point, unknown: Unknown, constants: Vec<Constant>) -> Fitted {
        let filter = self.whitener(&point.model, unknown);
        let columns = self.columns(&point.model, &filter, &constants);
        let innovations = filter.innovations(&point.residual);
        let weights = self.weights(&innovations);
        let normal = self.normal(&columns, &weights, &constants);
        let prior: f64 = constants
            .iter()
            .map(|constant| {
                0.5 * ((constant.get(&point.model) - constant.prior.0) / constant.prior.1).powi(2)
                    + constant.prior.1.ln()
            })
            .sum();
        let determinant = normal.clone().cholesky().map_or(f64::INFINITY, |cholesky| {
            2.0 * cholesky.l().diagonal().iter().map(|entry| entry.ln()).sum::<f64>()
        });
        let evidence = -(self.loss(&innovations) + filter.log_deviations)
            - prior
            - self.price(&unknown.list())
            - 0.5 * determinant
            + log_odds(&point.model, &self.set);
        Fitted {
            model: point.model,
            unknown,
            constants,
            evidence,
            residual: point.residual,
            innovations,
            columns,
            normal,
        }
    }

    /// Steps until none gains any more.
    fn descend(&self, point: &mut Point, filter: &Whitener, constants: &[Constant], effort: Effort) {
        let mut damping = 1e-3;
        let mut columns = self.columns(&point.model, filter, constants);
        let mut corrected = 0;
        for _ in 0..effort.steps {
            let Some((next, moved)) = self.step(point, &columns, filter, constants, &mut damping) else {
                if corrected == 0 {
                    break;
                }
                columns = self.columns(&point.model, filter, constants);
                corrected = 0;
                continue;
            };
            let gained = point.cost - next.cost;
            correct(&mut columns, &moved, &point.innovations, &next.innovations);
            *point = next;
            corrected += 1;
            if gained < effort.least_gain {
                break;
            }
            if corrected > CORRECTED {
                columns = self.columns(&point.model, filter, constants);
                corrected = 0;
            }
        }
    }

    fn step(
        &self,
        point: &Point,
        columns: &[Vec<f64>],
        filter: &Whitener,
        constants: &[Constant],
        damping: &mut f64,
    ) -> Option<(Point, Vec<f64>)> {
        let weights = self.weights(&point.innovations);
        let normal = self.normal(columns, &weights, constants);
        let gradient = DVector::from_iterator(
            columns.len(),
            columns.iter().zip(constants).map(|(column, constant)| {
                weighted(column, &point.innovations, &weights)
                    + (constant.get(&point.model) - constant.prior.0) / constant.prior.1.powi(2)
            }),
        );
        for _ in 0..TRIES {
            let mut damped = normal.clone();
            for index in 0..damped.nrows() {
                damped[(index, index)] *= 1.0 + *damping;
            }
            let solved = damped.cholesky().map(|cholesky| cholesky.solve(&gradient));
            if let Some(step) = solved {
                let mut model = point.model.clone();
                let mut moved = Vec::with_capacity(constants.len());
                for (constant, step) in constants.iter().zip(step.iter()) {
                    let farthest = FARTHEST[usize::from(constant.unit.is_some())];
                    let here = constant.get(&point.model);
                    constant.set(&mut model, here - step.clamp(-farthest, farthest));
                    moved.push(constant.get(&model) - here);
                }
                let next = self.point(model, filter, constants);
                if next.cost < point.cost {
                    *damping = (*damping * 0.2).max(1e-9);
                    return Some((next, moved));
                }
            }
            *damping = (*damping * 8.0).max(1e-4);
        }
        None
    }
}

/// Corrects sensitivities by what a step changed.
fn correct(columns: &mut [Vec<f64>], moved: &[f64], before: &[f64], after: &[f64]) {
    let length: f64 = moved.iter().map(|moved| moved * moved).sum();
    if length == 0.0 {
        return;
    }
    let mut missed: Vec<f64> = after.iter().zip(before).map(|(after, before)| after - before).collect();
    for (column, moved) in columns.iter().zip(moved) {
        missed.iter_mut().zip(column).for_each(|(missed, column)| *missed -= moved * column);
    }
    for (column, moved) in columns.iter_mut().zip(moved) {
        let share = moved / length;
        column.iter_mut().zip(&missed).for_each(|(column, missed)| *column += share * missed);
    }
}

/// Sum of products with weights.
pub fn weighted(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let length = a.len() / 4 * 4;
    for start in (0..length).step_by(4) {
        for lane in 0..4 {
            sums[lane] += a[start + lane] * b[start + lane] * weights[start + lane];
        }
    }
    let rest: f64 = (length..a.len()).map(|index| a[index] * b[index] * weights[index]).sum();
    sums.iter().sum::<f64>() + rest
}

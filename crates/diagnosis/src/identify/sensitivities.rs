//! Sensitivities of the weighted residual to the numbers that a fit moves.

use super::unknown_scale::UnknownScale;
use super::{Fit, Unknown, dot, weighted_residual};
use crate::configuration::identify::sensitivities::{DIFFERENCE, DIFFERENCE_OVER_EVENTS};
use crate::free_run::{Motion, Prediction, Replay, Steps, nudged, read};
use crate::parallel;
use motorbench_model::catalogue::{Balance, Effect};
use motorbench_model::{Model, Term};
use nalgebra::{DMatrix, DVector};
use std::borrow::Cow;
use std::sync::OnceLock;

/// A simulation that others are compared with.
pub(super) struct Base<'a> {
    pub replay: &'a Replay<'a>,
    model: &'a Model,
    steps: Steps,
    motion: OnceLock<Motion>,
    residual: Cow<'a, [f64]>,
}

impl<'a> Base<'a> {
    /// `fine`: the weighted residual of the model in fine steps.
    pub fn new(model: &'a Model, replay: &'a Replay<'a>, steps: Steps, fine: &'a [f64]) -> Self {
        let steps = replay.or_fine(model, steps);
        let mut base = Self { replay, model, steps, motion: OnceLock::new(), residual: Cow::Borrowed(fine) };
        if steps != Steps::Fine {
            let prediction = read(model, replay.data, base.motion().clone());
            base.residual = Cow::Owned(weighted_residual(replay.data, &prediction));
        }
        base
    }

    fn motion(&self) -> &Motion {
        self.motion.get_or_init(|| self.replay.drive(self.model, self.steps))
    }

    /// Difference of the weighted residual of another model; `motion`: whether its motor moves differently.
    pub fn change(&self, other: &Model, motion: bool) -> Vec<f64> {
        let prediction = match motion {
            true => read(other, self.replay.data, self.replay.drive(other, self.steps)),
            false => read(other, self.replay.data, self.motion().clone()),
        };
        self.change_to(&prediction)
    }

    /// The same by the linear motor's response to the torque and the voltage that an effect adds, to the first order.
    pub fn change_by_linear_response(&self, model: &Model, effect: &dyn Effect, values: &[f64]) -> Vec<f64> {
        let data = self.replay.data;
        let motion = nudged(model, data, self.motion(), |at| {
            let mut terms = Balance::default();
            effect.contribute(values, &model.motor, at, &mut [], &mut terms);
            terms
        });
        self.change_to(&read(model, data, motion))
    }

    fn change_to(&self, prediction: &Prediction) -> Vec<f64> {
        let mut change = weighted_residual(self.replay.data, prediction);
        change.iter_mut().zip(&*self.residual).for_each(|(there, here)| *there -= here);
        change
    }
}

/// Finite differences around a model.
struct Differences<'a> {
    model: &'a Model,
    base: Base<'a>,
    /// Without a current the data hardly depend on some directions: there the error of a one-sided difference would decide.
    both_sides: bool,
    difference: f64,
}

impl<'a> Differences<'a> {
    fn new(model: &'a Model, replay: &'a Replay<'a>, steps: Steps, fine: &'a [f64]) -> Self {
        let data = replay.data;
        let is_at_edges = |effect: &dyn Effect| data.is_switched() && effect.is_of_switching();
        let has_events = model.terms.iter().any(|Term { effect, .. }| effect.has_events() && !is_at_edges(*effect));
        Self {
            model,
            base: Base::new(model, replay, steps, fine),
            both_sides: data.current().is_none(),
            difference: if has_events { DIFFERENCE_OVER_EVENTS } else { DIFFERENCE },
        }
    }

    /// The derivative of the residual.
    fn of(&self, unknown: &Unknown) -> Vec<f64> {
        let change = |coordinate: f64| {
            let mut moved = self.model.clone();
            unknown.set(&mut moved, coordinate);
            self.base.change(&moved, unknown.place.changes_motion(self.model))
        };
        let here = unknown.get(self.model);
        let [lowest, highest] = [unknown.min, unknown.max].map(|bound| bound / unknown.size);
        let step = if here + self.difference > highest { -self.difference } else { self.difference };
        let mut column = change(here + step);
        if self.both_sides && (unknown.logarithmic || here - step > lowest) {
            column.iter_mut().zip(change(here - step)).for_each(|(there, back)| *there = 0.5 * (*there - back));
        }
        column.iter_mut().for_each(|change| *change /= step);
        column
    }
}

/// One column an unknown.
#[derive(Clone, Debug)]
pub(super) struct Sensitivities {
    pub columns: Vec<Vec<f64>>,
    /// Approximately half the second derivatives of the sum of squares and the prior.
    pub normal: DMatrix<f64>,
}

impl Sensitivities {
    /// Computed by finite differences, on all cores. `fine`: the weighted residual of the model in fine steps.
    pub fn simulated(model: &Model, fine: &[f64], replay: &Replay, unknowns: &[Unknown], steps: Steps) -> Self {
        Self::beside(|_| None, (model, fine), replay, unknowns, steps)
    }

    /// Those of a fit to the same data, as far as they are known. Only the others are simulated.
    pub fn near(
        fit: &Fit,
        (model, fine): (&Model, &[f64]),
        replay: &Replay,
        unknowns: &[Unknown],
        steps: Steps,
    ) -> Self {
        let of_the_same = |unknown: &Unknown| {
            let (Self { columns, .. }, _) = fit.sensitivities.get()?;
            let place = unknown.place.in_another(model, &fit.model)?;
            let index = fit.unknowns.iter().position(|known| known.place == place)?;
            let per_size = unknown.size / fit.unknowns[index].size;
            Some(columns[index].iter().map(|change| per_size * change).collect())
        };
        Self::beside(of_the_same, (model, fine), replay, unknowns, steps)
    }

    /// `known`: the columns that need no simulation.
    fn beside(
        known: impl Fn(&Unknown) -> Option<Vec<f64>> + Sync,
        (model, fine): (&Model, &[f64]),
        replay: &Replay,
        unknowns: &[Unknown],
        steps: Steps,
    ) -> Self {
        let differences = OnceLock::new();
        let differences = || differences.get_or_init(|| Differences::new(model, replay, steps, fine));
        let mut columns: Vec<Vec<f64>> =
            parallel::map(unknowns, |unknown| known(unknown).unwrap_or_else(|| differences().of(unknown)));
        if let Some(scale) = UnknownScale::of(model, replay.data) {
            scale.take_out(&mut columns, unknowns, model);
        }
        let normal = normal(&columns, unknowns);
        Self { columns, normal }
    }

    /// Corrects them after a step that moved the unknowns by `moved` and the residuals by `changed`. They match this
    /// change in its direction and stay as they were across it (Broyden's rule), and along the direction `besides` that
    /// changes no residual. The prior stays in the normal matrix.
    pub fn correct(&mut self, moved: &DVector<f64>, changed: &[f64], besides: Option<&DVector<f64>>) {
        let seen = match besides {
            Some(besides) => moved - besides * (besides.dot(moved) / besides.norm_squared().max(f64::MIN_POSITIVE)),
            None => moved.clone(),
        };
        if seen.norm_squared() == 0.0 {
            return;
        }
        let mut missed = changed.to_vec();
        for (column, moved) in self.columns.iter().zip(moved) {
            missed.iter_mut().zip(column).for_each(|(missed, column)| *missed -= moved * column);
        }
        let shares = &seen / seen.norm_squared();
        let along = DVector::from_iterator(moved.len(), self.columns.iter().map(|column| dot(column, &missed)));
        let across = &along * shares.transpose();
        self.normal += &across + across.transpose() + &shares * shares.transpose() * dot(&missed, &missed);
        for (column, share) in self.columns.iter_mut().zip(shares.iter()) {
            column.iter_mut().zip(&missed).for_each(|(column, missed)| *column += share * missed);
        }
    }

    /// Half the gradient of the cost.
    pub fn gradient(&self, model: &Model, residual: &[f64], unknowns: &[Unknown]) -> DVector<f64> {
        let pull = |(column, unknown): (&Vec<f64>, &Unknown)| dot(column, residual) + unknown.pull(model);
        let pulls = self.columns.iter().zip(unknowns).map(pull);
        DVector::from_iterator(self.columns.len(), pulls)
    }

    /// Inverse of the normal matrix; zeros where it has none.
    pub fn inverse(&self) -> DMatrix<f64> {
        let size = self.normal.nrows();
        let least = 1e-9 * self.normal.trace().max(1e-12) / size as f64;
        (&self.normal + DMatrix::identity(size, size) * least)
            .try_inverse()
            .unwrap_or_else(|| DMatrix::zeros(size, size))
    }
}

fn normal(columns: &[Vec<f64>], unknowns: &[Unknown]) -> DMatrix<f64> {
    let size = columns.len();
    let mut normal = DMatrix::zeros(size, size);
    for row in 0..size {
        for column in 0..=row {
            let value = dot(&columns[row], &columns[column]);
            normal[(row, column)] = value;
            normal[(column, row)] = value;
        }
    }
    for (index, unknown) in unknowns.iter().enumerate() {
        normal[(index, index)] += unknown.stiffness();
    }
    normal
}

//! The fits of one search. All simulate the same data, and a search comes past the same start on several ways.

use super::{Effort, Fit, Prior, Search, fit_in};
use crate::dataset::Dataset;
use crate::free_run::{Replay, Steps};
use motorbench_model::{Model, Term};
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Fits models to the same data, each start once.
pub struct Fits<'a> {
    prior: &'a Prior,
    /// Simulates them.
    pub replay: Replay<'a>,
    ends: Mutex<HashMap<Start, End>>,
}

/// What a fit depends on, bit by bit.
#[derive(PartialEq, Eq, Hash)]
struct Start {
    ids: Vec<&'static str>,
    numbers: Vec<u64>,
    is_fine: bool,
    is_a_look: bool,
}

/// Where a fit ended.
#[derive(Clone)]
struct End {
    model: Model,
    /// The limit of the cost by which it was given up.
    given_up_above: Option<f64>,
}

impl<'a> Fits<'a> {
    /// Of these data.
    pub fn new(data: &'a Dataset, prior: &'a Prior) -> Self {
        Self { prior, replay: Replay::new(data), ends: Mutex::default() }
    }

    /// Fits a model from its present constants, as [`fit`](super::fit).
    pub fn fit(&self, model: &Model, effort: Effort) -> Fit {
        self.begun(model, effort, None)
    }

    /// The same from a start that differs from a fit in few constants: the sensitivities are nearly those of that fit.
    pub fn fit_near(&self, near: &Fit, model: &Model, effort: Effort) -> Fit {
        self.begun(model, effort, Some(near))
    }

    fn begun(&self, model: &Model, effort: Effort, near: Option<&Fit>) -> Fit {
        let start = Start::new(model, effort, near);
        // A fit that was given up does not tell where one with a higher limit ends.
        let answers = |end: &&End| end.given_up_above.is_none_or(|above| effort.useless_above <= above);
        let known = self.ends().get(&start).filter(answers).cloned();
        if let Some(end) = known {
            return Search::new(&end.model, &self.replay, self.prior).run(Effort { steps: 0, ..effort });
        }
        let found = fit_in(&self.replay, model, self.prior, effort, near);
        let given_up_above = found.is_given_up.then_some(effort.useless_above);
        self.ends().insert(start, End { model: found.model.clone(), given_up_above });
        found
    }

    fn ends(&self) -> MutexGuard<'_, HashMap<Start, End>> {
        self.ends.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Start {
    fn new(model: &Model, effort: Effort, near: Option<&Fit>) -> Self {
        let models = || [model].into_iter().chain(near.map(|near| &near.model));
        let motors = models().flat_map(|model| model.motor.named()).map(|(_, value)| value);
        let values = models().flat_map(|model| &model.terms).flat_map(|term| term.values.iter().copied());
        let numbers = motors.chain(values).chain([effort.steps as f64, effort.least_gain]);
        Self {
            ids: models().flat_map(|model| &model.terms).map(Term::id).collect(),
            numbers: numbers.map(f64::to_bits).collect(),
            is_fine: effort.sensitivities == Steps::Fine,
            is_a_look: effort.is_a_look,
        }
    }
}

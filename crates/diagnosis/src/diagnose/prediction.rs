//! What a model predicts of a recording that it was not fitted to. The motor is the model's. How late the commands act and
//! the readings come belongs to the recording: it is estimated beside the model.

use super::judge::{self, VERY_STRONG_NATS};
use super::late_readings;
use super::lateness;
use crate::configuration::diagnose::prediction::CLOSENESS;
use crate::dataset::Dataset;
use crate::free_run::{Prediction, free_run};
use crate::identify::{Effort, Fit, Prior, fit};
use motorbench_data::rig::Rig;
use motorbench_model::Model;
use motorbench_model::catalogue::{ACTUATION_DELAY, effect};

/// A recording, and what a model predicts of it.
pub struct Predicted {
    /// The recording as it is compared. All of it is held out.
    pub data: Dataset,
    /// The model with the delay of the recording.
    pub model: Model,
    /// Its free run.
    pub prediction: Prediction,
}

impl Predicted {
    /// With what belongs to the recording found beside the model; `delay_s`: of the commands, if it is known.
    pub fn of(data: Dataset, model: &Model, rig: &Rig, delay_s: Option<f64>) -> Self {
        let prior = Prior::new(&rig.nominal(), &data);
        let mut beside = Beside { prior, data: data.with_nothing_held_out(), model: model.clone() };
        match delay_s {
            Some(delay_s) => beside.model = with_delay(model, delay_s),
            None => beside.settle_lateness(),
        }
        let Beside { mut data, model, .. } = beside;
        data.held_out.fill(true);
        let prediction = free_run(&model, &data);
        Self { data, model, prediction }
    }
}

/// A model beside the recording that it is to predict.
struct Beside {
    prior: Prior,
    data: Dataset,
    model: Model,
}

impl Beside {
    /// The free run of a model, judged as a fit.
    fn run_of(&self, model: &Model) -> Fit {
        fit(model, &self.data, &self.prior, Effort::NONE)
    }

    /// Readings that fall behind, or one delay of all commands.
    fn settle_lateness(&mut self) {
        if !self.data.axis.drive.is_voltage() {
            return;
        }
        let before = self.run_of(&self.model);
        let prompt = with_delay(&self.model, 0.0);
        let at_once = self.run_of(&prompt);
        if let Some(retimed) = late_readings::beside(&self.data, &at_once, &before, &self.prior) {
            (self.data, self.model) = (retimed, prompt);
            return;
        }
        let late = with_delay(&self.model, self.least_delay_s(&at_once));
        if self.shows_a_delay(&prompt, &late) {
            self.model = late;
        } else if at_once.cost < before.cost {
            self.model = prompt;
        }
    }

    /// Whether a motor with other constants explains less than a delay does. A model that is too quick is not late.
    fn shows_a_delay(&self, at_once: &Model, late: &Model) -> bool {
        let [at_once, late] = [at_once, late].map(|model| fit(model, &self.data, &self.prior, Effort::AGAIN));
        judge::evidence_nats(&self.data, &at_once, &late) > VERY_STRONG_NATS
    }

    /// The delay with which the model comes closest: to a block by one run without a delay, and then in steps that are halved.
    fn least_delay_s(&self, at_once: &Fit) -> f64 {
        let expected = lateness::errors(&self.data, &at_once.prediction);
        let about_s = lateness::constant_s(&self.data, &at_once.prediction, &expected);
        let costs = |delay_s: f64| (self.run_of(&with_delay(&self.model, delay_s)).cost, delay_s);
        let (mut best, mut step_s) = (costs(about_s), lateness::BLOCK_S);
        while step_s > CLOSENESS * self.data.interval_s {
            let beside = [(best.1 - step_s).max(0.0), best.1 + step_s].map(costs);
            let better =
                beside.into_iter().filter(|other| other.0 < best.0).min_by(|one, other| one.0.total_cmp(&other.0));
            match better {
                Some(better) => best = better,
                None => step_s /= 2.0,
            }
        }
        best.1
    }
}

/// How late a model's commands act.
pub fn delay_s(model: &Model) -> f64 {
    model.term(ACTUATION_DELAY).map_or(0.0, |term| term.values[0])
}

/// The model with another delay of its commands.
fn with_delay(model: &Model, delay_s: f64) -> Model {
    let at_once = model.without(ACTUATION_DELAY);
    match effect(ACTUATION_DELAY) {
        Some(delay) if delay_s > 0.0 => at_once.with(delay, vec![delay_s]),
        _ => at_once,
    }
}

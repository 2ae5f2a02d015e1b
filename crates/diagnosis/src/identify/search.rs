//! Levenberg and Marquardt's method from one start. The sensitivities are simulated at the start, or taken from a fit near it.
//! They are simulated again after a long step. After a short one they are corrected by the change (Broyden, Mathematics of
//! Computation 19 (1965)), and so they are after a step that turned out too long. Unless the fit is only a look, it ends on
//! simulated ones.

use super::sensitivities::Sensitivities;
use super::unknown_scale::UnknownScale;
use super::unknowns::{Unknown, prior_cost, unknowns};
use super::{Effort, Fit, Prior, square, weighted_residual};
use crate::configuration::identify::search::{FAR, LEAST_KEPT, TRIES, TRIES_CORRECTED};
use crate::free_run::{Prediction, Replay, Steps};
use motorbench_model::Model;
use nalgebra::DVector;
use std::sync::OnceLock;

/// A fit in progress.
pub(super) struct Search<'a> {
    replay: &'a Replay<'a>,
    unknowns: Vec<Unknown>,
    /// What the data cannot say.
    scale: Option<UnknownScale>,
    at: Point,
    damping: f64,
    is_given_up: bool,
    /// A fit whose sensitivities hold nearly at the start as well.
    near: Option<&'a Fit>,
}

/// The present point.
struct Point {
    model: Model,
    prediction: Prediction,
    residual: Vec<f64>,
    cost: f64,
}

/// A step that was taken.
struct Taken {
    before: Point,
    /// Whether a longer one was no better.
    is_shortened: bool,
    /// What it gained of what the sensitivities promised.
    kept_share: f64,
}

/// Sensitivities, and whether they belong to this point or are corrected ones of another.
struct Known {
    sensitivities: Sensitivities,
    is_simulated: bool,
}

impl Point {
    fn new(model: Model, replay: &Replay, unknowns: &[Unknown]) -> Self {
        let (prediction, is_possible) = replay.simulated(&model, Steps::Fine);
        let residual = weighted_residual(replay.data, &prediction);
        let cost = match is_possible {
            true => square(&residual) + prior_cost(&model, unknowns),
            false => f64::INFINITY,
        };
        Self { model, prediction, residual, cost }
    }
}

impl<'a> Search<'a> {
    pub fn new(start: &Model, replay: &'a Replay<'a>, prior: &Prior) -> Self {
        let mut model = start.clone().with_prior_means();
        let unknowns = unknowns(&model, replay.data, prior);
        for unknown in &unknowns {
            let coordinate = unknown.get(&model);
            unknown.set(&mut model, coordinate);
        }
        let scale = UnknownScale::of(&model, replay.data);
        let at = Point::new(model, replay, &unknowns);
        Self { replay, at, unknowns, scale, damping: 1e-3, is_given_up: false, near: None }
    }

    /// Begins with the sensitivities of a fit that is near the start.
    pub fn near(self, fit: Option<&'a Fit>) -> Self {
        Self { near: fit, ..self }
    }

    pub fn run(mut self, effort: Effort) -> Fit {
        self.settle();
        let sensitivities = if effort.steps > 0 { self.descend(effort) } else { None };
        let Point { model, prediction, residual, cost } = self.at;
        Fit {
            model,
            prediction,
            cost,
            unknowns: self.unknowns,
            residual,
            steps: effort.sensitivities,
            is_given_up: self.is_given_up,
            sensitivities: sensitivities.map_or_else(OnceLock::new, |found| {
                let inverse = found.inverse();
                OnceLock::from((found, inverse))
            }),
        }
    }

    /// Steps until none gains any more. Returns the sensitivities if the last simulated ones still hold.
    fn descend(&mut self, effort: Effort) -> Option<Sensitivities> {
        let steps = effort.sensitivities;
        let simulated = |search: &Self| Known {
            sensitivities: {
                let Point { model, residual, .. } = &search.at;
                Sensitivities::simulated(model, residual, search.replay, &search.unknowns, steps)
            },
            is_simulated: true,
        };
        let mut known = self.near.map_or_else(
            || simulated(self),
            |near| Known {
                sensitivities: Sensitivities::near(
                    near,
                    (&self.at.model, &self.at.residual),
                    self.replay,
                    &self.unknowns,
                    steps,
                ),
                is_simulated: false,
            },
        );
        let mut gained_before = f64::INFINITY;
        let mut steps_left = effort.steps;
        loop {
            let left = self.step(&mut known);
            self.settle();
            let Some(Taken { before, is_shortened, kept_share }) = left else {
                if known.is_simulated {
                    return Some(known.sensitivities);
                }
                known = simulated(self);
                continue;
            };
            let gained = before.cost - self.at.cost;
            if gained < effort.least_gain * before.cost {
                if known.is_simulated {
                    // So near the end they no longer change.
                    return Some(known.sensitivities);
                }
                // A short step gains little anywhere.
                if effort.is_a_look && !is_shortened {
                    return None;
                }
                // Corrected sensitivities may have lost a direction.
                known = simulated(self);
                continue;
            }
            steps_left -= 1;
            let pace = gained.max(std::mem::replace(&mut gained_before, gained));
            self.is_given_up = self.at.cost - steps_left as f64 * pace > effort.useless_above;
            if steps_left == 0 || self.is_given_up {
                return None;
            }
            if gained < FAR * before.cost && kept_share > LEAST_KEPT {
                self.correct(&mut known, &before, &self.at);
            } else {
                known = simulated(self);
            }
        }
    }

    /// Moves to the most plausible scale, where the data do not contain it.
    fn settle(&mut self) {
        let Some(scale) = self.scale else { return };
        let (model, keeps_readings) = scale.most_plausible(&self.at.model, &self.unknowns);
        if !keeps_readings {
            let there = Point::new(model, self.replay, &self.unknowns);
            if there.cost < self.at.cost {
                self.at = there;
            }
            return;
        }
        let cost = square(&self.at.residual) + prior_cost(&model, &self.unknowns);
        if cost < self.at.cost {
            (self.at.model, self.at.cost) = (model, cost);
        }
    }

    /// One step; `None` if no step is better. Corrected sensitivities learn from each step that is not.
    fn step(&mut self, known: &mut Known) -> Option<Taken> {
        let before = self.damping;
        for tried in 0..if known.is_simulated { TRIES } else { TRIES_CORRECTED } {
            let Some(step) = self.damped_step(&known.sensitivities) else {
                self.damping = (self.damping * 10.0).max(1e-6);
                continue;
            };
            let there = Point::new(self.stepped(&step), self.replay, &self.unknowns);
            if there.cost < self.at.cost {
                self.damping = (self.damping * 0.2).max(1e-9);
                let before = std::mem::replace(&mut self.at, there);
                let kept_share = (before.cost - self.at.cost) / self.promised(&known.sensitivities, &before);
                return Some(Taken { before, is_shortened: tried > 0, kept_share });
            }
            if !known.is_simulated && there.cost.is_finite() {
                self.correct(known, &self.at, &there);
            }
            self.damping = (self.damping * 8.0).max(1e-4);
        }
        if !known.is_simulated {
            self.damping = before;
        }
        None
    }

    /// The step with the present damping.
    fn damped_step(&self, sensitivities: &Sensitivities) -> Option<DVector<f64>> {
        let normal = &sensitivities.normal;
        let gradient = sensitivities.gradient(&self.at.model, &self.at.residual, &self.unknowns);
        let mut damped = normal.clone();
        for index in 0..damped.nrows() {
            damped[(index, index)] += self.damping * normal[(index, index)].max(1e-9);
        }
        damped.cholesky().map(|cholesky| cholesky.solve(&gradient))
    }

    fn stepped(&self, step: &DVector<f64>) -> Model {
        let mut model = self.at.model.clone();
        for (unknown, step) in self.unknowns.iter().zip(step.iter()) {
            let limit = if unknown.logarithmic { 1.0 } else { 5.0 };
            unknown.set(&mut model, unknown.get(&self.at.model) - step.clamp(-limit, limit));
        }
        model
    }

    /// By how much the step to the present point should have lowered the cost.
    fn promised(&self, sensitivities: &Sensitivities, before: &Point) -> f64 {
        let moved = self.moved(&self.at, before);
        let gradient = sensitivities.gradient(&before.model, &before.residual, &self.unknowns);
        2.0 * gradient.dot(&moved) - moved.dot(&(&sensitivities.normal * &moved))
    }

    /// The way from one point to another.
    fn moved(&self, from: &Point, to: &Point) -> DVector<f64> {
        let moved = self.unknowns.iter().map(|unknown| unknown.get(&to.model) - unknown.get(&from.model));
        DVector::from_iterator(self.unknowns.len(), moved)
    }

    /// Corrects sensitivities by the change from one point to another.
    fn correct(&self, known: &mut Known, from: &Point, to: &Point) {
        let moved = self.moved(from, to);
        let changed: Vec<f64> = to.residual.iter().zip(&from.residual).map(|(to, from)| to - from).collect();
        let besides = self.scale.map(|scale| scale.direction(&from.model, &self.unknowns));
        known.sensitivities.correct(&moved, &changed, besides.as_ref());
        known.is_simulated = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::catalogue::effect;

    /// Otherwise it would explain everything: what it lacks counts as missing readings.
    #[test]
    fn a_model_that_cannot_be_simulated_costs_more_than_any_other() {
        let rows = (0..200).map(|row| format!("{:.3},12,{}\n", f64::from(row) * 1e-3, row.min(100)));
        let text: String = std::iter::once("t_s,u_V,omega_rad_per_s\n".to_owned()).chain(rows).collect();
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap();
        let data = Dataset::new(&[recording], &rig).unwrap();
        let prior = Prior::new(&rig.motor, &data);
        let (replay, linear) = (Replay::new(&data), Model::linear(prior.motor));
        let cost = |model: &Model| Search::new(model, &replay, &prior).run(Effort::NONE).cost;
        assert!(cost(&linear).is_finite());
        // One acts on the motor, the other one on its sensor.
        for id in ["quadratic_drag", "tacho_ripple"] {
            let effect = effect(id).unwrap();
            let mut values = effect.starts(&crate::identify::scales(&prior.motor, &data)).swap_remove(0);
            values[0] = f64::NAN;
            assert_eq!(cost(&linear.with(effect, values)), f64::INFINITY, "{id}");
        }
    }
}

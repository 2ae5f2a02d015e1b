//! Identification by output error: finds the constants with which the free-running model comes closest to the
//! measurement.
//!
//! Every measured quantity is weighted by its noise. Held-out data ([`Dataset::held_out`]) are not used, but the time
//! of a load step is read from all data. Nominal values are priors with the spread of a data sheet
//! ([`NOMINAL_SPREAD`]); they matter only where the data contain little. The method is that of Levenberg and Marquardt
//! on finite differences. Intervals come from the covariance that holds for residuals correlated within a block
//! (sandwich; White, Econometrica 50 (1982)).

use crate::configuration::identify::LOCATED_ROWS;
use crate::dataset::{Dataset, greatest};
use crate::free_run::{Prediction, Replay, Steps};
pub use fits::Fits;
use motorbench_model::catalogue::Scales;
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Model, Term};
use nalgebra::DMatrix;
pub use prior::{GIVEN_DROP_SPREAD_V, NOMINAL_SPREAD, Prior, lateness_s, uniform_deviation};
pub use promises::{EffectStart, LEAST_PROMISE, Promise, Promises};
pub use recording_items::{Item, fit_with_items};
use search::Search;
use sensitivities::Sensitivities;
pub use speed_window::with_window_settled;
use std::sync::OnceLock;
pub use uncertainty::{Derived, Interval, Uncertainty, Z95};
pub use unknown_scale::{has_unknown_torque_scale, has_unknown_voltage_scale, scales_all_torques};
pub use unknowns::Place;
use unknowns::Unknown;

mod fits;
mod prior;
mod promises;
mod recording_items;
mod search;
mod sensitivities;
mod speed_window;
mod uncertainty;
mod unknown_scale;
mod unknowns;

/// Sizes for the starting values of effects.
pub fn scales(motor: &MotorParameters, data: &Dataset) -> Scales {
    let (drive, command) = (data.axis.drive, greatest(&data.command));
    let voltage_v = if drive.is_voltage() { command } else { 0.0 };
    let speed_rad_per_s = greatest(&data.motion().values);
    let computed_a = if drive.is_voltage() { voltage_v / motor.resistance_ohm } else { command };
    Scales {
        drive,
        motor: *motor,
        voltage_v,
        speed_rad_per_s,
        supply_v: greatest(&data.supply_v),
        current_a: data.current().map_or(computed_a, |current| greatest(&current.values)),
        // From the longest recording: each has its own time.
        duration_s: greatest(&data.time_s),
        interval_s: data.interval_s,
        pwm_hz: data.origin.pwm_hz,
    }
}

/// Limits of a fit's duration.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Largest number of steps.
    pub steps: usize,
    /// It ends when a step gains less than this share of the cost.
    pub least_gain: f64,
    /// Step size of the simulations for the sensitivities.
    pub sensitivities: Steps,
    /// Whether it may end on sensitivities that were corrected after a step instead of simulated: much faster, but it
    /// sometimes stops early.
    pub is_a_look: bool,
    /// The fit is given up if the remaining steps, each with the better gain of the last two, would not reach this
    /// cost.
    pub useless_above: f64,
}

impl Effort {
    /// Its starting point, with its sensitivities.
    pub const NONE: Self = Self {
        steps: 0,
        least_gain: 0.0,
        sensitivities: Steps::Coarse,
        is_a_look: false,
        useless_above: f64::INFINITY,
    };
    /// For a first look at an effect.
    pub const TRIAL: Self = Self { steps: 12, least_gain: 5e-3, is_a_look: true, ..Self::NONE };
    /// For judging another model by its rest.
    pub const CHECK: Self = Self { steps: 8, is_a_look: false, ..Self::TRIAL };
    /// For a model that was fitted to other parts of the same data.
    pub const AGAIN: Self = Self { steps: 30, least_gain: 5e-4, ..Self::NONE };
    /// Until convergence.
    pub const FULL: Self = Self { steps: 30, least_gain: 1e-5, sensitivities: Steps::Fine, ..Self::NONE };

    /// The same for a fit that is useless above a cost.
    pub fn useless_above(self, cost: f64) -> Self {
        Self { useless_above: cost, ..self }
    }
}

/// A fitted model.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model.
    pub model: Model,
    /// Its prediction of the data.
    pub prediction: Prediction,
    /// Sum of squares of the weighted residuals that were used, and of the prior.
    pub cost: f64,
    unknowns: Vec<Unknown>,
    /// Weighted residuals, zero for held-out data.
    residual: Vec<f64>,
    /// Step size of the simulations for the sensitivities.
    steps: Steps,
    /// Whether it ended because it could not reach [`Effort::useless_above`].
    is_given_up: bool,
    /// The sensitivities and the inverse of their normal matrix, computed when needed.
    sensitivities: OnceLock<(Sensitivities, DMatrix<f64>)>,
}

/// Fits a model from its present constants.
///
/// The time of an event (the only constants with a [`spacing`](motorbench_model::catalogue::Search::spacing)) is read
/// from all the data: if it lies in a held-out stretch, the other data do not contain it.
pub fn fit(start: &Model, data: &Dataset, prior: &Prior, effort: Effort) -> Fit {
    fit_in(&Replay::new(data), start, prior, effort, None)
}

/// The same where the command has been cut into steps already. The sensitivities of a fit `near` the start need not be
/// simulated again.
fn fit_in(replay: &Replay, start: &Model, prior: &Prior, effort: Effort, near: Option<&Fit>) -> Fit {
    let scales = scales(&start.motor, replay.data);
    let located = start.terms.iter().enumerate().find_map(|(term, Term { effect, .. })| {
        let (index, spacing) = effect.spacing(&scales)?;
        Some(located(start, replay, term, index, spacing))
    });
    Search::new(located.as_ref().unwrap_or(start), replay, prior).near(near).run(effort)
}

/// The model with the constant, within half a spacing, at which the sum of all squares is least, held-out data
/// included.
fn located(model: &Model, replay: &Replay, term: usize, index: usize, spacing: f64) -> Model {
    let cost = |value: f64| {
        let mut moved = model.clone();
        moved.terms[term].values[index] = value;
        let (prediction, is_possible) = replay.simulated(&moved, Steps::Coarse);
        if !is_possible {
            return f64::INFINITY;
        }
        let squares = replay.data.measured.iter().zip(&prediction).flat_map(|(measured, predicted)| {
            measured
                .values
                .iter()
                .zip(predicted)
                .map(move |(value, predicted)| ((value - predicted) / measured.least_error(measured.noise)).powi(2))
        });
        squares.filter(|square| square.is_finite()).sum::<f64>()
    };
    let mut best = model.terms[term].values[index];
    let mut least = cost(best);
    let mut distance = 0.5 * spacing;
    while distance > LOCATED_ROWS * replay.data.interval_s {
        for value in [best - distance, best + distance].into_iter().filter(|value| *value > 0.6 * spacing) {
            let here = cost(value);
            if here < least {
                (best, least) = (value, here);
            }
        }
        distance *= 0.6;
    }
    let mut found = model.clone();
    found.terms[term].values[index] = best;
    found
}

/// Residuals over noise, with the sign such that their derivative is that of the prediction; zero for missing and
/// held-out data.
fn weighted_residual(data: &Dataset, prediction: &Prediction) -> Vec<f64> {
    let mut residual = Vec::with_capacity(data.len() * data.measured.len());
    for (measured, predicted) in data.measured.iter().zip(prediction) {
        let weight = 1.0 / measured.least_error(measured.noise);
        for ((value, predicted), held_out) in measured.values.iter().zip(predicted).zip(&data.held_out) {
            let difference = (predicted - value) * weight;
            residual.push(if *held_out || difference.is_nan() { 0.0 } else { difference });
        }
    }
    residual
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four sums, so that the additions need not wait for each other.
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a4.zip(b4) {
        for index in 0..4 {
            sums[index] += a[index] * b[index];
        }
    }
    sums.iter().sum::<f64>() + rest
}

fn square(values: &[f64]) -> f64 {
    dot(values, values)
}

impl Fit {
    /// Weighted sensitivities of the seen residuals and the inverse of their normal matrix.
    fn sensitivities(&self, data: &Dataset) -> &(Sensitivities, DMatrix<f64>) {
        self.sensitivities.get_or_init(|| {
            let (replay, fine) = (Replay::new(data), self.weighted_residual(data));
            let found = Sensitivities::simulated(&self.model, &fine, &replay, &self.unknowns, self.steps);
            let inverse = found.inverse();
            (found, inverse)
        })
    }

    /// Of the same readings, of which others may be held out.
    fn weighted_residual(&self, data: &Dataset) -> Vec<f64> {
        weighted_residual(data, &self.prediction)
    }

    /// Residuals of one measured quantity, measured minus simulated, missing ones as NaN.
    pub fn residual_of(&self, data: &Dataset, output: usize) -> Vec<f64> {
        data.measured[output].values.iter().zip(&self.prediction[output]).map(|(y, p)| y - p).collect()
    }

    /// Number of residuals that it used.
    pub fn used(&self) -> usize {
        self.residual.iter().filter(|residual| **residual != 0.0).count()
    }

    /// Cost of a residual: fewer remain where rows are left out, or where a reading comes twice.
    pub fn mean_square(&self) -> f64 {
        self.cost / self.used().max(1) as f64
    }

    /// Whether a fitted constant of a term is at the end of its range, where its law becomes another one or makes no
    /// sense.
    pub fn is_at_a_bound(&self, term: usize) -> bool {
        self.is_near_a_bound(term, |_| 0.0)
    }

    /// Whether a fitted constant of a term is within its standard error of the end of its range. There the range decides on
    /// the constant, and evidence by the curvature of the cost (Laplace's approximation) does not hold.
    pub fn reaches_a_bound(&self, data: &Dataset, term: usize) -> bool {
        let (_, inverse) = self.sensitivities(data);
        self.is_near_a_bound(term, |index| inverse[(index, index)].max(0.0).sqrt())
    }

    /// Whether a fitted constant of a term is within `distance` of a bound. That is in coordinates of the fit, by its index.
    fn is_near_a_bound(&self, term: usize, distance: impl Fn(usize) -> f64) -> bool {
        self.unknowns.iter().enumerate().any(|(index, unknown)| {
            let (value, distance) = (unknown.get(&self.model) * unknown.size, distance(index) * unknown.size);
            matches!(unknown.place, Place::Term(of, _) if of == term)
                && (value - distance <= unknown.min || value + distance >= unknown.max)
        })
    }

    /// How many constants it has moved.
    pub fn moved(&self) -> usize {
        self.unknowns.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::catalogue::effect;
    use std::fmt::Write as _;

    /// A motor with a dry friction, stepped by Euler's method, with a current and a speed that are noisy.
    fn stepped(friction_nm: f64) -> (Dataset, Prior) {
        let mut csv = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        let (mut speed, mut current) = (0.0_f64, 0.0_f64);
        for row in 0..4000_usize {
            let volts = [8.0, -8.0, 4.0, -4.0, 10.0, 0.0, -10.0, 2.0][row / 250 % 8];
            let noise = |prime: usize| (row * prime % 101) as f64 / 101.0 - 0.5;
            let _ = writeln!(
                csv,
                "{:.3},{volts},{:.4},{:.5}",
                row as f64 * 1e-3,
                speed + 0.5 * noise(37),
                current + 0.02 * noise(59)
            );
            for _ in 0..20 {
                current += 5e-5 * (volts - 5.8 * current - 0.07 * speed) / 3e-3;
                let free = speed + 5e-5 * (0.07 * current - 6e-6 * speed) / 4e-5;
                let lost = 5e-5 * friction_nm / 4e-5;
                speed = if free.abs() <= lost { 0.0 } else { free - lost * free.signum() };
            }
        }
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap();
        let data = Dataset::new(&[Recording::parse("run.csv", csv.as_bytes(), &[]).unwrap()], &rig).unwrap();
        let prior = Prior::new(&rig.motor, &data);
        (data, prior)
    }

    /// A friction cannot be less than none. Where there is none, that bound decides.
    #[test]
    fn a_constant_that_is_not_there_reaches_its_bound() {
        for (friction_nm, reaches) in [(6e-3, false), (0.0, true)] {
            let (data, prior) = stepped(friction_nm);
            let model = Model::linear(prior.motor).with(effect("coulomb_friction").unwrap(), vec![3e-3]);
            let found = fit(&model, &data, &prior, Effort::FULL);
            assert_eq!(found.reaches_a_bound(&data, 0), reaches, "{friction_nm}: {:?}", found.model);
        }
    }
}

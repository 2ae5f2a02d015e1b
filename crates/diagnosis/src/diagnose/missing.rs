//! The discrepancy of the model: the torque and the voltage over time that would make it agree with the measurement,
//! and where it acts.
//!
//! The residual of a free-running model obeys the motor's own linear equations, driven by the discrepancy. A Kalman
//! filter estimates it as a random walk, with the smoother of Rauch, Tung and Striebel (1965). The place whose
//! discrepancy makes the residual most likely is where it acts. (Kristensen, Madsen and Jorgensen, Automatica 40
//! (2004): the diffusion term points at the deficient equation.)

use crate::configuration::diagnose::missing::{MORE_THAN_TIME, WALKS, WARMING, WITHIN_S};
use crate::dataset::{Dataset, Output, Stretch, Window, difference};
use motorbench_model::catalogue::ActsOn;
use motorbench_model::motor::MotorParameters;
use nalgebra::{Matrix3, Vector3};
use std::cmp::Ordering;

/// The discrepancy over time.
#[derive(Clone, Debug)]
pub struct Lack {
    /// Where it acts.
    pub acts_on: ActsOn,
    /// Its value at each sample, in the unit of where it acts (Nm, V, A, rad/s).
    pub values: Vec<f64>,
    /// Log-likelihood of the residual with it.
    pub log_likelihood: f64,
}

/// The discrepancy at one place that makes the residual most likely. `residual`: measured minus simulated, per
/// quantity.
pub fn lack(data: &Dataset, motor: &MotorParameters, residual: &[Vec<f64>], acts_on: ActsOn) -> Lack {
    let size = typical(data, motor, residual, acts_on);
    let mut best: Option<(f64, Filter)> = None;
    for walk in WALKS {
        let mut filter = Filter::new(data, motor, acts_on, walk * size);
        let log_likelihood = filter.run(data, residual, false);
        if best.as_ref().is_none_or(|(most, _)| log_likelihood > *most) {
            best = Some((log_likelihood, filter));
        }
    }
    let (log_likelihood, mut filter) = best.expect("several walks were tried");
    filter.run(data, residual, true);
    Lack { acts_on, values: filter.smoothed(), log_likelihood }
}

/// Size of a discrepancy that would explain the residual.
fn typical(data: &Dataset, motor: &MotorParameters, residual: &[Vec<f64>], acts_on: ActsOn) -> f64 {
    let spread = |wanted: fn(Output) -> bool| {
        data.measured.iter().zip(residual).find(|(measured, _)| wanted(measured.output)).map_or(
            0.0,
            |(measured, values)| {
                let (sum, count) =
                    values.iter().filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
                (sum / f64::max(count, 1.0)).sqrt().max(measured.least_error(measured.noise))
            },
        )
    };
    let current_a = spread(|output| output == Output::Current);
    let speed = spread(|output| output != Output::Current);
    let k = motor.torque_constant_nm_per_a;
    match acts_on {
        // The error that a constant torque would leave, without a back-EMF to limit it.
        ActsOn::Torque if !data.axis.drive.is_voltage() => {
            (motor.viscous_friction_nm_s + motor.inertia_kg_m2 / WITHIN_S) * speed
        }
        ActsOn::Torque => k * current_a + k * k / motor.resistance_ohm * speed,
        ActsOn::Voltage => motor.resistance_ohm * current_a + k * speed,
        ActsOn::CurrentSensor => current_a.max(1e-6),
        ActsOn::AngleSensor => speed,
    }
}

/// States: errors of current and speed, and the discrepancy.
struct Filter {
    /// Of each stretch.
    steps: Vec<Step>,
    walk_per_s: f64,
    /// Observation row of each measured quantity: its weights of the states.
    rows: Vec<(Vector3<f64>, f64)>,
    history: Vec<Moment>,
}

/// The torque alone is left where the current is imposed: nothing brakes the speed's error through the winding.
fn without_winding(mut rates: Matrix3<f64>) -> Matrix3<f64> {
    rates.row_mut(0).fill(0.0);
    rates[(1, 0)] = 0.0;
    rates
}

/// Transition from one row of a stretch to the next.
struct Step {
    /// Where the stretch ends.
    end: usize,
    of_state: Matrix3<f64>,
    walk_variance: f64,
}

/// State and covariance before and after the update by the sample.
type Moment = (Vector3<f64>, Matrix3<f64>, Vector3<f64>, Matrix3<f64>);

impl Filter {
    fn new(data: &Dataset, motor: &MotorParameters, acts_on: ActsOn, walk_per_s: f64) -> Self {
        let (l, k, j) = (motor.inductance_h, motor.torque_constant_nm_per_a, motor.inertia_kg_m2);
        let into_current = if acts_on == ActsOn::Voltage { 1.0 / l } else { 0.0 };
        let into_speed = if acts_on == ActsOn::Torque { 1.0 / j } else { 0.0 };
        #[rustfmt::skip]
        let rates = Matrix3::new(
            -motor.resistance_ohm / l, -k / l, into_current,
            k / j, -motor.viscous_friction_nm_s / j, into_speed,
            0.0, 0.0, 0.0,
        );
        let rows = data.measured.iter().map(|measured| {
            let current = measured.output == Output::Current;
            let sensor = if current { ActsOn::CurrentSensor } else { ActsOn::AngleSensor };
            let bias = if acts_on == sensor { 1.0 } else { 0.0 };
            let row = if current { Vector3::new(1.0, 0.0, bias) } else { Vector3::new(0.0, 1.0, bias) };
            (row, measured.least_error(measured.noise).powi(2))
        });
        let rates = if data.axis.drive.is_voltage() { rates } else { without_winding(rates) };
        // The speed of a held rotor does not change.
        let mut held_rates = rates;
        held_rates.row_mut(1).fill(0.0);
        let step = |stretch: &Stretch| Step {
            end: stretch.rows.end,
            of_state: (if data.is_held(stretch) { held_rates } else { rates } * stretch.interval_s).exp(),
            walk_variance: walk_per_s * walk_per_s * stretch.interval_s,
        };
        Self { steps: data.stretches.iter().map(step).collect(), walk_per_s, rows: rows.collect(), history: Vec::new() }
    }

    /// Filters forward and returns the log-likelihood of the measurement.
    fn run(&mut self, data: &Dataset, residual: &[Vec<f64>], keep: bool) -> f64 {
        let mut state = Vector3::zeros();
        let mut unknown = Matrix3::zeros();
        unknown[(2, 2)] = self.walk_per_s * self.walk_per_s;
        let mut covariance = unknown;
        let mut log_likelihood = 0.0;
        for index in 0..data.len() {
            // The simulation restarts with each stretch, and so does its discrepancy.
            if self.begins(index) {
                (state, covariance) = (Vector3::zeros(), unknown);
            }
            let (before, before_covariance) = (state, covariance);
            for ((row, noise), values) in self.rows.iter().zip(residual) {
                let value = values[index];
                if !value.is_finite() {
                    continue;
                }
                let gain = covariance * row;
                let variance = row.dot(&gain) + noise;
                let surprise = value - row.dot(&state);
                log_likelihood -= 0.5 * (surprise * surprise / variance + variance.ln());
                state += gain * (surprise / variance);
                covariance -= gain * gain.transpose() / variance;
            }
            if keep {
                self.history.push((before, before_covariance, state, covariance));
            }
            let Step { of_state, walk_variance, .. } = self.step(index);
            state = of_state * state;
            covariance = of_state * covariance * of_state.transpose();
            covariance[(2, 2)] += walk_variance;
        }
        log_likelihood
    }

    fn begins(&self, index: usize) -> bool {
        self.steps.iter().any(|step| step.end == index)
    }

    fn step(&self, index: usize) -> &Step {
        let stretch = self.steps.partition_point(|step| step.end <= index);
        &self.steps[stretch.min(self.steps.len() - 1)]
    }

    /// The discrepancy, smoothed over the whole recording.
    fn smoothed(&self) -> Vec<f64> {
        let last = self.history.len() - 1;
        let (mut state, mut values) = (self.history[last].2, vec![0.0; self.history.len()]);
        values[last] = state[2];
        for index in (0..last).rev() {
            if self.begins(index + 1) {
                state = self.history[index].2;
                values[index] = state[2];
                continue;
            }
            let (predicted, predicted_covariance, ..) = &self.history[index + 1];
            let (_, _, filtered, covariance) = &self.history[index];
            // The speed of a held rotor would make the matrix singular.
            let mut regular = *predicted_covariance;
            for place in 0..3 {
                let variance = regular[(place, place)];
                regular[(place, place)] = if variance == 0.0 { 1.0 } else { variance * (1.0 + 1e-9) };
            }
            if let Some(inverse) = regular.try_inverse() {
                let gain = covariance * self.step(index).of_state.transpose() * inverse;
                state = filtered + gain * (state - predicted);
            } else {
                state = *filtered;
            }
            values[index] = state[2];
        }
        values
    }
}

/// Names of two quantities that it can depend on...
const TIME: &str = "time";
const WARMTH: &str = "warmth of the winding";

/// A quantity that the discrepancy can depend on.
#[derive(Clone, Debug)]
pub struct Dependence {
    /// Name of the quantity.
    pub on: &'static str,
    /// Unit of the axis.
    pub unit: &'static str,
    /// Share of the discrepancy's variance that a curve over it explains.
    pub share: f64,
    /// The curve: means of the axis and of the discrepancy in each bin.
    pub curve: Vec<(f64, f64)>,
}

/// The discrepancy against every quantity it can depend on, best first.
pub fn dependences(data: &Dataset, values: &[f64]) -> Vec<Dependence> {
    let motion = &data.motion().values;
    let angle: Vec<f64> = data.angle_rad.iter().map(|angle| angle.rem_euclid(std::f64::consts::TAU)).collect();
    let direction: Vec<f64> = motion.iter().map(|speed| speed.signum()).collect();
    let acceleration = difference(motion, &data.time_s, Window::up_to_now(5));
    let mut found = vec![
        dependence("speed", "rad/s", motion, values, 24),
        dependence("direction", "", &direction, values, 2),
        dependence("angle", "rad", &angle, values, 24),
        dependence("duty", "", &data.duty, values, 24),
        dependence(TIME, "s", &data.time_s, values, 24),
        dependence("acceleration", "rad/s2", &acceleration, values, 24),
    ];
    if let Some(current) = data.current() {
        found.push(dependence("current", "A", &current.values, values, 24));
        found.push(dependence(WARMTH, "A2", &warmth(&current.values), values, 24));
    }
    // Temperature itself changes with time, so it has to explain more than time does.
    let of_time = found.iter().find(|dependence| dependence.on == TIME).map_or(0.0, |time| time.share);
    let comes_after = |dependence: &Dependence| dependence.on == WARMTH && dependence.share < MORE_THAN_TIME * of_time;
    found.sort_by(|a, b| (comes_after(a), b.share).partial_cmp(&(comes_after(b), a.share)).unwrap_or(Ordering::Equal));
    found
}

/// What the winding's temperature follows: the low-passed square of the current.
fn warmth(current_a: &[f64]) -> Vec<f64> {
    let share = 1.0 / (WARMING * current_a.len() as f64).max(1.0);
    let mut warmth = 0.0;
    let mut next = |current_a: &f64| {
        if current_a.is_finite() {
            warmth += share * (current_a * current_a - warmth);
        }
        warmth
    };
    current_a.iter().map(&mut next).collect()
}

/// Means of `values` in bins of equal width over `axis`.
fn dependence(on: &'static str, unit: &'static str, axis: &[f64], values: &[f64], bins: usize) -> Dependence {
    let finite = || axis.iter().zip(values).filter(|(x, y)| x.is_finite() && y.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (x, _)| (l.min(*x), h.max(*x)));
    let width = ((high - low) / bins as f64).max(f64::MIN_POSITIVE);
    // Sums of the axis and of the values, and their number.
    let mut sums = vec![(0.0, 0.0, 0.0); bins];
    for (x, y) in finite() {
        let bin = (((x - low) / width) as usize).min(bins - 1);
        sums[bin].0 += x;
        sums[bin].1 += y;
        sums[bin].2 += 1.0;
    }
    sums.retain(|(.., count)| *count > 0.0);
    let count: f64 = sums.iter().map(|(.., count)| count).sum();
    let mean = sums.iter().map(|(_, sum, _)| sum).sum::<f64>() / count.max(1.0);
    let total: f64 = finite().map(|(_, y)| (y - mean).powi(2)).sum();
    let between: f64 = sums.iter().map(|(_, sum, n)| n * (sum / n - mean).powi(2)).sum();
    Dependence {
        on,
        unit,
        share: if total > 0.0 { between / total } else { 0.0 },
        curve: sums.iter().map(|(x, y, n)| (x / n, y / n)).collect(),
    }
}

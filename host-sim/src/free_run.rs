//! Free-running simulation: the model alone, driven by what drove the motor, over a whole recording.
//!
//! Within a step the linear part is solved exactly (matrix exponential); the effects' terms are constant over it, those
//! that oppose a state (resistance, viscous and dry friction) implicitly: a dry term moves its state towards zero and never
//! beyond, so the shaft sticks and the diodes block at any step (time stepping after Moreau).

use crate::catalogue::{Balance, Instant, Readings};
use crate::dataset::{Dataset, Output, difference};
use crate::model::Model;
use crate::rig;
use nalgebra::Matrix4;
use std::ops::Range;

/// Longest step of a recording at 200 Hz or more; slower ones take a tenth of their interval, at most the second.
const LONGEST_STEPS_S: [f64; 2] = [0.5e-3, 2e-3];

/// What the model says of each measured quantity, in the order of [`Dataset::measured`].
pub type Prediction = Vec<Vec<f64>>;

/// Simulates every stretch of the data.
pub fn free_run(model: &Model, data: &Dataset) -> Prediction {
    let mut prediction: Prediction = data.measured.iter().map(|_| Vec::with_capacity(data.len())).collect();
    for range in &data.stretches {
        let gap = range.start - prediction[0].len();
        for values in &mut prediction {
            values.extend(std::iter::repeat_n(f64::NAN, gap));
        }
        Run::new(model, data, range.clone()).whole(&mut prediction);
    }
    let missing = data.len() - prediction[0].len();
    for values in &mut prediction {
        values.extend(std::iter::repeat_n(f64::NAN, missing));
    }
    prediction
}

/// The linear part over one step: what becomes of current and speed, of a voltage and a torque.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinearStep {
    current_of: [f64; 4],
    speed_of: [f64; 4],
    /// Speed left, and gained of a torque, while no current can flow.
    open_speed_of: [f64; 2],
    step_s: f64,
}

impl LinearStep {
    /// For steps of `step_s`, with `inertia_kg_m2` at the motor's own shaft.
    pub fn new(motor: &crate::motor::MotorParameters, inertia_kg_m2: f64, step_s: f64) -> Self {
        let (l, k, b) = (motor.inductance_h, motor.torque_constant_nm_per_a, motor.viscous_friction_nm_s);
        #[rustfmt::skip]
        let rates = Matrix4::new(
            -motor.resistance_ohm / l, -k / l, 1.0 / l, 0.0,
            k / inertia_kg_m2, -b / inertia_kg_m2, 0.0, 1.0 / inertia_kg_m2,
            0.0, 0.0, 0.0, 0.0,
            0.0, 0.0, 0.0, 0.0,
        ) * step_s;
        let step = rates.exp();
        let row = |index: usize| [step[(index, 0)], step[(index, 1)], step[(index, 2)], step[(index, 3)]];
        let decay = (-b / inertia_kg_m2 * step_s).exp();
        let gain = if b > 0.0 { (1.0 - decay) / b } else { step_s / inertia_kg_m2 };
        Self { current_of: row(0), speed_of: row(1), open_speed_of: [decay, gain], step_s }
    }

    /// Length of the step.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Current and speed at the end of the step.
    #[inline]
    pub fn take(&self, current_a: f64, speed: f64, voltage_v: f64, open: bool, terms: &Balance) -> (f64, f64) {
        if open {
            let free = self.open_speed_of[0] * speed + self.open_speed_of[1] * terms.torque_nm;
            return (0.0, oppose_motion(free, self.open_speed_of[1], terms));
        }
        let inputs = [current_a, speed, voltage_v + terms.voltage_v, terms.torque_nm];
        let dot = |row: &[f64; 4]| row[0] * inputs[0] + row[1] * inputs[1] + row[2] * inputs[2] + row[3] * inputs[3];
        let free_a = dot(&self.current_of);
        let gain = self.current_of[2];
        let dry_a = gain * terms.dry_drop_v.max(0.0);
        let flowing_a = if free_a > dry_a { free_a - dry_a } else { (free_a + dry_a).min(0.0) };
        let current_a = flowing_a / (1.0 + gain * terms.resistance_ohm);
        let lost_v = (free_a - current_a) / gain;
        let free = dot(&self.speed_of) - self.speed_of[2] * lost_v;
        let speed = oppose_motion(free, self.speed_of[3], terms);
        let lost_nm = (free - speed) / self.speed_of[3];
        (current_a - self.current_of[3] * lost_nm, speed)
    }
}

/// What friction leaves of a speed; `gain`: speed gained of a torque over the step.
#[inline]
fn oppose_motion(free: f64, gain: f64, terms: &Balance) -> f64 {
    let forward = gain * terms.dry_forward_nm.max(0.0);
    let backward = gain * terms.dry_backward_nm.max(0.0);
    let moving = if free > forward { free - forward } else { (free + backward).min(0.0) };
    moving / (1.0 + gain * terms.viscous_nm_s)
}

struct Run<'a> {
    model: &'a Model,
    data: &'a Dataset,
    range: Range<usize>,
    delay_s: f64,
    longest_step_s: f64,
    inertia_kg_m2: f64,
    step: LinearStep,
    states: Vec<Vec<f64>>,
    current_a: f64,
    speed_rad_per_s: f64,
    angle_rad: f64,
    /// Means of current and speed since the sample before.
    means: (f64, f64),
}

impl<'a> Run<'a> {
    fn new(model: &'a Model, data: &'a Dataset, range: Range<usize>) -> Self {
        let terms = &model.terms;
        let share: f64 = terms.iter().map(|term| term.effect.motor_share(&term.values)).product();
        let first =
            |output: &[f64]| output[range.clone()].iter().take(5).copied().find(|v| v.is_finite()).unwrap_or(0.0);
        let current_a = data.current().map_or(0.0, |measured| first(&measured.values));
        let motion = data.motion();
        let speed_rad_per_s = first(&motion.values);
        let usual_step_s = (0.1 * data.interval_s).clamp(LONGEST_STEPS_S[0], LONGEST_STEPS_S[1]);
        let still = speed_rad_per_s.abs() < 5.0 * motion.noise;
        Self {
            model,
            data,
            delay_s: terms.iter().map(|term| term.effect.delay_s(&term.values)).sum::<f64>()
                + data.timing.command_delay_s.unwrap_or(0.0),
            longest_step_s: terms.iter().map(|term| term.effect.longest_step_s()).fold(usual_step_s, f64::min),
            inertia_kg_m2: model.motor.inertia_kg_m2 * share.max(0.01),
            step: LinearStep::default(),
            states: terms.iter().map(|term| vec![0.0; term.effect.states()]).collect(),
            current_a: if still { 0.0 } else { current_a },
            speed_rad_per_s: if still { 0.0 } else { speed_rad_per_s },
            angle_rad: 0.0,
            means: (0.0, 0.0),
            range,
        }
    }

    fn whole(mut self, prediction: &mut Prediction) {
        let mut angles = Vec::new();
        for index in self.range.clone() {
            let readings = self.read(index);
            angles.push(readings.angle_rad);
            for (measured, values) in self.data.measured.iter().zip(prediction.iter_mut()) {
                values.push(match measured.output {
                    Output::Current => readings.current_a,
                    Output::Speed | Output::AngleDifference(_) => readings.speed_rad_per_s,
                });
            }
            if index + 1 < self.range.end {
                self.until(index + 1);
            }
        }
        for (measured, values) in self.data.measured.iter().zip(prediction) {
            if let Output::AngleDifference(span) = measured.output {
                let start = values.len() - angles.len();
                values[start..].copy_from_slice(&difference(&angles, &self.data.time_s[self.range.clone()], span));
            }
        }
    }

    fn read(&mut self, index: usize) -> Readings {
        let (current_a, speed_rad_per_s) = match self.data.timing.readings {
            rig::Readings::Mean if index > self.range.start => self.means,
            _ => (self.current_a, self.speed_rad_per_s),
        };
        let mut readings = Readings { current_a, speed_rad_per_s, angle_rad: self.angle_rad };
        let interval_s = if index > self.range.start {
            self.data.time_s[index] - self.data.time_s[index - 1]
        } else {
            self.data.interval_s
        };
        let at = self.instant(index, 0.0, interval_s);
        for (term, state) in self.model.terms.iter().zip(&mut self.states) {
            term.effect.sense(&term.values, &at, state, &mut readings);
        }
        readings
    }

    fn instant(&self, index: usize, share: f64, step_s: f64) -> Instant {
        let data = self.data;
        let next = (index + 1).min(data.len() - 1);
        let interval_s = data.time_s[next] - data.time_s[index];
        Instant {
            time_s: data.time_s[index] + share * interval_s,
            voltage_v: data.voltage_v[index],
            duty: data.duty[index],
            supply_v: data.supply_v[index],
            current_a: self.current_a,
            speed_rad_per_s: self.speed_rad_per_s,
            angle_rad: data.angle_rad[index] + share * (data.angle_rad[next] - data.angle_rad[index]),
            step_s,
        }
    }

    /// Simulates up to the sample `next`.
    fn until(&mut self, next: usize) {
        let interval_s = self.data.time_s[next] - self.data.time_s[next - 1];
        let steps = (interval_s / self.longest_step_s - 1e-6).ceil().max(1.0);
        let step_s = interval_s / steps;
        if (step_s - self.step.step_s).abs() > 1e-9 {
            self.step = LinearStep::new(&self.model.motor, self.inertia_kg_m2, step_s);
        }
        let (mut current_sum, angle_before_rad) = (0.0, self.angle_rad);
        for part in 0..steps as usize {
            // The middle of the step stands for it.
            let mut at = self.instant(next - 1, (part as f64 + 0.5) / steps, step_s);
            if self.delay_s > 0.0 {
                let delayed_s = part as f64 * step_s - self.delay_s;
                at.voltage_v = self.mean_before(&self.data.voltage_v, next - 1, delayed_s, step_s);
                at.duty = self.mean_before(&self.data.duty, next - 1, delayed_s, step_s);
            }
            let before_a = self.current_a;
            self.advance(&mut at, self.data.open[next - 1], self.data.load_nm[next - 1]);
            current_sum += 0.5 * (before_a + self.current_a);
        }
        self.means = (current_sum / steps, (self.angle_rad - angle_before_rad) / interval_s);
    }

    fn advance(&mut self, at: &mut Instant, open: bool, load_nm: f64) {
        let mut terms = Balance { torque_nm: -load_nm, ..Balance::default() };
        for (term, state) in self.model.terms.iter().zip(&self.states) {
            if term.effect.acts_on_motor() {
                term.effect.contribute(&term.values, &self.model.motor, at, state, &mut terms);
            }
        }
        let before = self.speed_rad_per_s;
        (self.current_a, self.speed_rad_per_s) = self.step.take(self.current_a, before, at.voltage_v, open, &terms);
        self.angle_rad += 0.5 * (before + self.speed_rad_per_s) * at.step_s;
        at.current_a = self.current_a;
        at.speed_rad_per_s = self.speed_rad_per_s;
        for (term, state) in self.model.terms.iter().zip(&mut self.states) {
            if term.effect.acts_on_motor() && term.effect.states() > 0 {
                term.effect.advance(&term.values, &self.model.motor, at, state);
            }
        }
    }

    /// Mean over `length_s` of a signal that is held from sample to sample, beginning `offset_s` after sample `index`.
    fn mean_before(&self, signal: &[f64], index: usize, offset_s: f64, length_s: f64) -> f64 {
        let from_s = self.data.time_s[index] + offset_s;
        let to_s = from_s + length_s;
        let mut sample = index;
        let mut end_s = to_s;
        let mut sum = 0.0;
        loop {
            let start_s = if sample == self.range.start { f64::NEG_INFINITY } else { self.data.time_s[sample] };
            let since_s = start_s.max(from_s);
            if since_s < end_s {
                sum += signal[sample] * (end_s - since_s);
                end_s = since_s;
            }
            if since_s <= from_s || sample == self.range.start {
                return sum / length_s;
            }
            sample -= 1;
        }
    }
}

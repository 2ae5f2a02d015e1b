//! Free-running simulation: the model alone, driven by what drove the motor, over a whole recording.
//!
//! Within a step the linear part is solved exactly (matrix exponential); the effects' terms are constant over it, those
//! that oppose a state (resistance, viscous and dry friction) implicitly: a dry term moves its state towards zero and never
//! beyond, so the shaft sticks and the diodes block at any step (time stepping after Moreau).

use crate::catalogue::{ActsOn, Balance, Effect, Instant, Readings, Sampling};
use crate::dataset::{BetweenEdges, Dataset, Measured, Output, Stretch, Window, difference};
use crate::linear::motor_model::TimeConstants;
use crate::model::{Model, Term};
use crate::plant::closed_form::{Family, combine};
use crate::rig;
use between_rows::Bulge;
use pwm_period::{Ripple, Volts};
use std::ops::Range;

pub mod between_rows;
pub mod pwm_period;

/// Longest step of a recording at 200 Hz or more; slower ones take a tenth of their interval, at most the second.
const LONGEST_STEPS_S: [f64; 2] = [0.5e-3, 2e-3];

/// Recorded times are rounded: steps that differ by less are of one length.
const SAME_LENGTH_S: f64 = 1e-9;
/// A change of the voltage is a leap from this share of the supply on.
const LEAP: f64 = 0.1;
/// Whatever torque acts on it, a rotor that is held stays where it is, as one of this inertia does.
const HELD_KG_M2: f64 = 1e9;
/// Steps of Newton's method for a drop with a knee, and how close it comes, as a share of the knee.
const NEWTON_STEPS: usize = 12;
const NEWTON_CLOSENESS: f64 = 1e-3;

/// What the model says of each measured quantity, in the order of [`Dataset::measured`].
pub type Prediction = Vec<Vec<f64>>;

/// How finely time is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Steps {
    /// For what is compared with the data.
    Fine,
    /// Twice as long: for differences between two simulations, in which the error of the steps cancels.
    Coarse,
    /// At most so many seconds.
    AtMost(f64),
}

/// Longest step that the terms of a model bear.
pub fn longest_step_s(model: &Model) -> f64 {
    model.terms.iter().map(|term| term.effect.longest_step_s()).fold(f64::INFINITY, f64::min)
}

/// Simulates every stretch of the data.
pub fn free_run(model: &Model, data: &Dataset) -> Prediction {
    read(model, data, drive(model, data, Steps::Fine))
}

/// What the motor does, whatever its sensors say of it: one entry a sample of the data, NaN between stretches.
#[derive(Clone, Debug)]
pub struct Motion {
    current_a: Vec<f64>,
    speed_rad_per_s: Vec<f64>,
    angle_rad: Vec<f64>,
    /// Where on the revolution the shaft is, as measured and with what the model says was lost.
    shaft_rad: Vec<f64>,
    /// By how much the mean of the current since the sample before is above the middle between the two.
    bulge_a: Vec<f64>,
}

impl Motion {
    fn with_capacity(samples: usize) -> Self {
        let column = || Vec::with_capacity(samples);
        Self {
            current_a: column(),
            speed_rad_per_s: column(),
            angle_rad: column(),
            shaft_rad: column(),
            bulge_a: column(),
        }
    }

    /// The angle at some time before a row of a stretch, where that had begun: a cubic with the speeds of the rows around.
    fn angle_before(&self, row: usize, first: usize, rows_s: &[f64], time_s: f64) -> Option<f64> {
        let from = (first..=row).rev().find(|row| rows_s[*row] <= time_s)?;
        if from == row {
            return Some(self.angle_rad[row]);
        }
        let interval_s = rows_s[from + 1] - rows_s[from];
        let turned_rad = self.angle_rad[from + 1] - self.angle_rad[from];
        let bent_rad = [from, from + 1].map(|at| self.speed_rad_per_s[at] * interval_s - turned_rad);
        let course = Course { from_rad: self.angle_rad[from], turned_rad, bent_rad };
        Some(course.angle_rad((time_s - rows_s[from]) / interval_s))
    }

    fn fill_up_to(&mut self, samples: usize) {
        let columns = [
            &mut self.current_a,
            &mut self.speed_rad_per_s,
            &mut self.angle_rad,
            &mut self.shaft_rad,
            &mut self.bulge_a,
        ];
        for values in columns {
            values.resize(samples, f64::NAN);
        }
    }
}

/// Drives the motor of the model with what drove the real one.
pub fn drive(model: &Model, data: &Dataset, steps: Steps) -> Motion {
    let mut motion = Motion::with_capacity(data.len());
    for stretch in &data.stretches {
        motion.fill_up_to(stretch.rows.start);
        Run::new(model, data, stretch, steps).whole(&mut motion);
    }
    motion.fill_up_to(data.len());
    motion
}

/// Reads a motion with the sensors of the model.
pub fn read(model: &Model, data: &Dataset, mut motion: Motion) -> Prediction {
    if data.origin.current_window_s > 0.0 {
        motion.current_a = mean_current(model, &motion, data);
    }
    if let Some(late_s) = data.origin.timing.current_late_s {
        read_late(&mut motion.current_a, data, late_s);
    }
    if (data.origin.timing.readings, data.motion().output) == (rig::Readings::Mean, Output::Speed) {
        motion.speed_rad_per_s = mean_since_row_before(&motion, data);
    }
    let shaft_bulges = shaft_bulges(model, &motion, data);
    for term in model.in_turn(|effect| !effect.acts_on_motor()) {
        for stretch in &data.stretches {
            falsify(term, model, data, (stretch.rows.clone(), &shaft_bulges), &mut motion);
        }
    }
    data.measured
        .iter()
        .map(|measured| match measured.output {
            // Each of them is measured once at most.
            Output::Current => std::mem::take(&mut motion.current_a),
            Output::Speed => std::mem::take(&mut motion.speed_rad_per_s),
            Output::MeanSpeed | Output::AngleDifference => mean_speed(&motion, data),
            Output::TimedSpeed => timed_speed(&motion, data),
        })
        .collect()
}

/// What the shaft's speed does between rows beside the straight line: the way says its mean. Nothing is said of it where no
/// effect asks for it.
fn shaft_bulges(model: &Model, motion: &Motion, data: &Dataset) -> Vec<Bulge> {
    let mut bulges = Vec::new();
    if model.tachogenerator_lag_s() == 0.0 {
        return bulges;
    }
    bulges.resize(data.len(), Bulge::NONE);
    for index in data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1)) {
        let step_s = data.time_s[index] - data.time_s[index - 1];
        let mean = (motion.angle_rad[index] - motion.angle_rad[index - 1]) / step_s;
        let of_line = 0.5 * (motion.speed_rad_per_s[index - 1] + motion.speed_rad_per_s[index]);
        bulges[index] = Bulge::parabola(mean - of_line);
    }
    bulges
}

/// The current as a mean over the window before each row.
fn mean_current(model: &Model, motion: &Motion, data: &Dataset) -> Vec<f64> {
    let winding_s = TimeConstants::of(&model.motor).electromagnetic_s;
    let mut means = motion.current_a.clone();
    for Stretch { rows, .. } in &data.stretches {
        for (mean_a, row) in means[rows.clone()].iter_mut().zip(rows.clone()).skip(1) {
            *mean_a =
                mean_current_before(motion, &data.time_s, rows.start..row, data.origin.current_window_s, winding_s);
        }
    }
    means
}

/// Readings as they were so long before, by what is between each two.
fn read_late(readings: &mut [f64], data: &Dataset, late_s: f64) {
    for row in data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1).rev()) {
        let share = (late_s / (data.time_s[row] - data.time_s[row - 1])).min(1.0);
        readings[row] += share * (readings[row - 1] - readings[row]);
    }
}

/// Mean current over the last `window_s` of some rows and the one after them, or all of that where it is shorter.
fn mean_current_before(motion: &Motion, time_s: &[f64], rows: Range<usize>, window_s: f64, winding_s: f64) -> f64 {
    let (mut charge, mut length_s) = (0.0, 0.0);
    for first in rows.rev() {
        if length_s >= window_s {
            break;
        }
        let last = first + 1;
        let interval_s = time_s[last] - time_s[first];
        let share = ((window_s - length_s) / interval_s).min(1.0);
        let rise_a = motion.current_a[last] - motion.current_a[first];
        let even_a = motion.current_a[last] - 0.5 * share * rise_a;
        let bulge = Bulge::new(motion.bulge_a[last], interval_s, winding_s);
        charge += interval_s * (share * even_a + bulge.in_the_last(share));
        length_s += share * interval_s;
    }
    charge / length_s
}

fn mean_since_row_before(motion: &Motion, data: &Dataset) -> Vec<f64> {
    let mut means = motion.speed_rad_per_s.clone();
    for row in data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1)) {
        let turned_rad = motion.angle_rad[row] - motion.angle_rad[row - 1];
        means[row] = turned_rad / (data.time_s[row] - data.time_s[row - 1]);
    }
    means
}

fn mean_speed(motion: &Motion, data: &Dataset) -> Vec<f64> {
    let mut speed = vec![f64::NAN; data.len()];
    for Stretch { rows, window, .. } in &data.stretches {
        let differences = difference(&motion.angle_rad[rows.clone()], &data.time_s[rows.clone()], *window);
        speed[rows.clone()].copy_from_slice(&differences);
    }
    speed
}

/// Means between the edges that the recording tells.
fn timed_speed(motion: &Motion, data: &Dataset) -> Vec<f64> {
    let mut speed = vec![f64::NAN; data.len()];
    let Some(timing) = &data.origin.edge_timing else { return speed };
    for Stretch { rows, .. } in &data.stretches {
        for row in rows.clone() {
            let BetweenEdges { age_s, length_s } = timing.between[row];
            let end_s = data.time_s[row] - age_s;
            let turned_rad = || {
                let at = |time_s: f64| motion.angle_before(row, rows.start, &data.time_s, time_s);
                Some(at(end_s)? - at(end_s - length_s)?)
            };
            speed[row] = turned_rad().map_or(f64::NAN, |turned_rad| turned_rad / length_s);
        }
    }
    speed
}

/// A motion with what a small torque adds to it, to the first order: of the linear motor, which stays at rest where it was.
pub fn nudged(model: &Model, data: &Dataset, motion: &Motion, torque_nm: impl Fn(&Instant) -> f64) -> Motion {
    let mut nudged = motion.clone();
    let inertia_kg_m2 = inertia_kg_m2(model);
    let mut step = LinearStep::default();
    for Stretch { rows: range, .. } in data.stretches.iter().filter(|stretch| !data.is_held(stretch)) {
        let (mut current_a, mut speed_rad_per_s, mut angle_rad) = (0.0, 0.0, 0.0);
        for index in range.start..range.end - 1 {
            let next = index + 1;
            let step_s = data.time_s[next] - data.time_s[index];
            step.set_length(&model.motor, inertia_kg_m2, step_s);
            let at = Instant {
                time_s: data.time_s[index],
                voltage_v: data.voltage_v[index],
                duty: data.duty[index],
                mean_duty: data.duty[index],
                supply_v: data.supply_v[index],
                open: data.open[index],
                current_a: motion.current_a[index],
                speed_rad_per_s: motion.speed_rad_per_s[index],
                angle_rad: 0.5 * (motion.shaft_rad[index] + motion.shaft_rad[next]),
                turned_rad: motion.shaft_rad[next] - motion.shaft_rad[index],
                step_s,
            };
            let before = speed_rad_per_s;
            let terms = Balance { torque_nm: torque_nm(&at), ..Balance::default() };
            Reached { current_a, speed_rad_per_s, .. } = step.take(current_a, before, 0.0, at.open, &terms);
            if at.speed_rad_per_s == 0.0 && motion.speed_rad_per_s[next] == 0.0 {
                speed_rad_per_s = 0.0;
            }
            angle_rad += 0.5 * (before + speed_rad_per_s) * step_s;
            nudged.current_a[next] += current_a;
            nudged.speed_rad_per_s[next] += speed_rad_per_s;
            nudged.angle_rad[next] += angle_rad;
        }
    }
    nudged
}

/// The angle between two samples: a cubic with the speeds at either. In 10 ms a shaft that gathers speed is elsewhere than on
/// a straight line.
struct Course {
    from_rad: f64,
    turned_rad: f64,
    /// Slopes at the beginning and at the end, less that of the straight line.
    bent_rad: [f64; 2],
}

impl Course {
    /// As measured, with the speeds that the samples around say, as far as they are rows of the same stretch.
    fn new(data: &Dataset, rows: Range<usize>, index: usize) -> Self {
        let (angle, time) = (&data.angle_rad, &data.time_s);
        let turned_rad = angle[index + 1] - angle[index];
        let interval_s = time[index + 1] - time[index];
        let slope = |from: usize, to: usize| (angle[to] - angle[from]) / (time[to] - time[from]) * interval_s;
        let first = index.saturating_sub(1).max(rows.start);
        let last = (index + 2).min(rows.end - 1);
        let bent_rad = [slope(first, index + 1) - turned_rad, slope(index, last) - turned_rad];
        Self { from_rad: angle[index], turned_rad, bent_rad }
    }

    /// `share`: of the time between the two.
    fn angle_rad(&self, share: f64) -> f64 {
        let rest = 1.0 - share;
        self.from_rad + share * self.turned_rad + share * rest * (rest * self.bent_rad[0] - share * self.bent_rad[1])
    }
}

/// Of the motor's own shaft; a fit may try to leave nothing of it.
fn inertia_kg_m2(model: &Model) -> f64 {
    model.motor.inertia_kg_m2 * model.motor_share().max(0.01)
}

/// Lets one sensor's effect act on the readings of one stretch.
fn falsify(
    term: &Term,
    model: &Model,
    data: &Dataset,
    (range, shaft_bulges): (Range<usize>, &[Bulge]),
    motion: &mut Motion,
) {
    let winding_s = TimeConstants::of(&model.motor).electromagnetic_s;
    let mut state = vec![0.0; term.effect.states()];
    for index in range.clone() {
        let step_s = if index > range.start { data.time_s[index] - data.time_s[index - 1] } else { 0.0 };
        let mut readings = Readings {
            current_a: motion.current_a[index],
            speed_rad_per_s: motion.speed_rad_per_s[index],
            angle_rad: motion.angle_rad[index],
        };
        let bulge = Bulge::new(motion.bulge_a[index], step_s, winding_s);
        let speed_bulge = shaft_bulges.get(index).copied().unwrap_or(Bulge::NONE);
        let at = Sampling { angle_rad: motion.shaft_rad[index], step_s, bulge, speed_bulge };
        term.effect.sense(&term.values, &at, &mut state, &mut readings);
        motion.current_a[index] = readings.current_a;
        motion.speed_rad_per_s[index] = readings.speed_rad_per_s;
        motion.angle_rad[index] = readings.angle_rad;
    }
}

/// The linear part over one step: what becomes of current and speed, of a voltage and a torque.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinearStep {
    current_of: [f64; 4],
    speed_of: [f64; 4],
    /// Speed left, and gained of a torque, while no current can flow.
    open_speed_of: [f64; 2],
    /// Voltage and torque that make a unit of current and of speed.
    inverse_gains: [f64; 2],
    resistance_ohm: f64,
    torque_constant_nm_per_a: f64,
    /// Of the winding, over a step.
    inductance_over_step_ohm: f64,
    step_s: f64,
}

/// Where a step leads.
#[derive(Clone, Copy, Debug)]
pub struct Reached {
    /// Current at its end.
    pub current_a: f64,
    /// Speed at its end.
    pub speed_rad_per_s: f64,
    /// Mean of the current on the way.
    pub mean_a: f64,
}

impl LinearStep {
    /// For steps of `step_s`, with `inertia_kg_m2` at the motor's own shaft.
    pub fn new(motor: &crate::motor::MotorParameters, inertia_kg_m2: f64, step_s: f64) -> Self {
        let (l, k, b) = (motor.inductance_h, motor.torque_constant_nm_per_a, motor.viscous_friction_nm_s);
        // Of (current, speed).
        let rates = [[-motor.resistance_ohm / l, -k / l], [k / inertia_kg_m2, -b / inertia_kg_m2]];
        let [[own_a, across_a], [across, own]] = rates;
        let weights = Family::new(own_a + own, own_a * own - across_a * across).weights(step_s);
        let (of_state, of_rates) = (combine(weights.exponential, &rates), combine(weights.integral, &rates));
        let row = |index: usize| {
            let ([current, speed], [volts, torque]) = (of_state[index], of_rates[index]);
            [current, speed, volts / l, torque / inertia_kg_m2]
        };
        let decay = (-b / inertia_kg_m2 * step_s).exp();
        let gain = if b > 0.0 { (1.0 - decay) / b } else { step_s / inertia_kg_m2 };
        let (current_of, speed_of) = (row(0), row(1));
        let inverse_gains = [1.0 / current_of[2], 1.0 / speed_of[3]];
        Self {
            current_of,
            speed_of,
            open_speed_of: [decay, gain],
            inverse_gains,
            resistance_ohm: motor.resistance_ohm,
            torque_constant_nm_per_a: k,
            inductance_over_step_ohm: l / step_s,
            step_s,
        }
    }

    /// The same with steps of `step_s`, computed anew where that is another length.
    fn set_length(&mut self, motor: &crate::motor::MotorParameters, inertia_kg_m2: f64, step_s: f64) {
        if (step_s - self.step_s).abs() > SAME_LENGTH_S {
            *self = Self::new(motor, inertia_kg_m2, step_s);
        }
    }

    /// Length of the step.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// What drives the current through a period of the PWM.
    #[inline]
    fn volts(&self, current_a: f64, speed: f64, voltage_v: f64, terms: &Balance) -> Volts {
        Volts {
            mean_v: voltage_v + terms.voltage_v,
            emf_v: self.torque_constant_nm_per_a * speed,
            lost_v: (self.resistance_ohm + terms.resistance_ohm) * current_a,
            drops_v: terms.drops_v(),
        }
    }

    /// Current and speed at the end of the step.
    #[inline]
    pub fn take(&self, current_a: f64, speed: f64, voltage_v: f64, open: bool, terms: &Balance) -> Reached {
        if open {
            let free = self.open_speed_of[0] * speed + self.open_speed_of[1] * terms.torque_nm;
            let speed_rad_per_s = oppose_motion(speed, free, self.open_speed_of[1], terms);
            return Reached { current_a: 0.0, speed_rad_per_s, mean_a: 0.0 };
        }
        let inputs = [current_a, speed, voltage_v + terms.voltage_v, terms.torque_nm];
        let dot = |row: &[f64; 4]| row[0] * inputs[0] + row[1] * inputs[1] + row[2] * inputs[2] + row[3] * inputs[3];
        let free_a = dot(&self.current_of);
        let gain = self.current_of[2];
        let dry_a = gain * terms.ripple.mean_drop_v(terms.drops_v());
        let flowing_a = match terms.drops_with_the_mean() {
            true => {
                let left_a = eased_a(free_a, dry_a, terms.knee_a);
                turned(current_a, left_a, free_a, || {
                    [dry_a * (current_a.abs() / terms.knee_a).tanh(), (free_a - left_a).abs()]
                })
            }
            false => {
                let left_a =
                    terms.ripple.against_drops(free_a, dry_a, || self.volts(current_a, speed, voltage_v, terms));
                // One that hangs on what pulses leave has no time of its own.
                let is_whole = left_a == free_a - dry_a || left_a == free_a + dry_a;
                if is_whole { turned(current_a, left_a, free_a, || [dry_a; 2]) } else { left_a }
            }
        };
        // Quotients as products: they do not wait for what they scale.
        let left_a = flowing_a * (1.0 / (1.0 + gain * terms.resistance_ohm));
        let lost_v = (free_a - left_a) * self.inverse_gains[0];
        let free = dot(&self.speed_of) - self.speed_of[2] * lost_v;
        let speed_rad_per_s = oppose_motion(speed, free, self.speed_of[3], terms);
        let lost_nm = (free - speed_rad_per_s) * self.inverse_gains[1];
        let reached_a = left_a - self.current_of[3] * lost_nm;
        // What the resistance takes on the average is what emf and inductance leave of the voltage.
        let emf_v = self.torque_constant_nm_per_a * 0.5 * (speed + speed_rad_per_s);
        let induced_v = self.inductance_over_step_ohm * (reached_a - current_a);
        let mean_a = (inputs[2] - lost_v - emf_v - induced_v) * (1.0 / self.resistance_ohm);
        Reached { current_a: reached_a, speed_rad_per_s, mean_a }
    }
}

/// What a drop leaves of a mean current: `dry_a` of it at most, less where the current is small beside the knee. Newton's
/// method on `i + dry_a tanh(i / knee_a) = free_a`, from the side on which it does not overshoot.
fn eased_a(free_a: f64, dry_a: f64, knee_a: f64) -> f64 {
    let free = free_a.abs();
    let mut flowing = (free - dry_a).max(free / (1.0 + dry_a / knee_a));
    for _ in 0..NEWTON_STEPS {
        let share = (flowing / knee_a).tanh();
        let short = free - flowing - dry_a * share;
        if short < NEWTON_CLOSENESS * knee_a {
            break;
        }
        flowing += short / (1.0 + dry_a / knee_a * (1.0 - share * share));
    }
    flowing.copysign(free_a)
}

/// What friction leaves of a speed that was `before`; `gain`: speed gained of a torque over the step.
#[inline]
pub(crate) fn oppose_motion(before: f64, free: f64, gain: f64, terms: &Balance) -> f64 {
    let forward = gain * terms.dry_forward_nm.max(0.0);
    let backward = gain * terms.dry_backward_nm.max(0.0);
    let moving = if free > forward { free - forward } else { (free + backward).min(0.0) };
    let turned = turned(before, moving, free, || if before > 0.0 { [forward, backward] } else { [backward, forward] });
    turned * (1.0 / (1.0 + gain * terms.viscous_nm_s))
}

/// What a dry loss leaves of something that has turned round in a step: until it did, the loss acted the other way. `left`:
/// with the loss against where it goes all the time, `free` without; `dry`: what the loss takes before and after.
#[inline]
fn turned(before: f64, left: f64, free: f64, dry: impl FnOnce() -> [f64; 2]) -> f64 {
    if before * left >= 0.0 {
        return left;
    }
    let [before_dry, after_dry] = dry();
    let sense = before.signum();
    let as_before = sense * free - before_dry;
    let share_before = sense * before / (sense * before - as_before);
    left - sense * share_before * (before_dry + after_dry)
}

fn first(values: &[f64]) -> f64 {
    values.iter().take(5).copied().find(|value| value.is_finite()).unwrap_or(0.0)
}

/// Speed at the start of a stretch. Means over a window that begins there say it of its middle and not of its start: two, one
/// after the other, lead back to that, but not through a stand: what begins to move within the second stood before.
fn first_speed(motion: &Measured, stretch: &Stretch) -> f64 {
    let values = &motion.values[stretch.rows.clone()];
    if matches!(motion.output, Output::Speed | Output::TimedSpeed) {
        return first(values);
    }
    let Window { span, ahead } = stretch.window;
    let mean = |windows: usize| values.get(windows * span - ahead).copied();
    match (mean(1), mean(2)) {
        (Some(one), Some(two)) if one.is_finite() && two.is_finite() => {
            let first = 1.5 * one - 0.5 * two;
            if first * one > 0.0 { first } else { 0.0 }
        }
        _ => 0.0,
    }
}

/// A term of the model at work on the motor.
struct Acting<'a> {
    effect: &'static dyn Effect,
    values: &'a [f64],
    state: Vec<f64>,
}

/// The motor of a model on its way through one stretch of the data.
struct Run<'a> {
    model: &'a Model,
    data: &'a Dataset,
    range: Range<usize>,
    delay_s: f64,
    longest_step_s: f64,
    inertia_kg_m2: f64,
    step: LinearStep,
    acting: Vec<Acting<'a>>,
    current_a: f64,
    speed_rad_per_s: f64,
    angle_rad: f64,
    /// By how much the measured angle is behind.
    lost_rad: f64,
    /// What the model says is wrong with that angle.
    angle_sensor: Vec<&'a Term>,
    /// Mean of the current since the sample before.
    mean_a: f64,
    /// By how much the mean of the current since the sample before is above the middle between the two.
    bulge_a: f64,
    /// By how much the current where it is sampled differs from its mean over the PWM period.
    ripple_a: f64,
    /// The PWM without a duty.
    undriven: Ripple,
    /// What the step before was under.
    before: Option<(Instant, Balance)>,
    /// Whether a command may begin to act within a step.
    acts_within: bool,
    /// Whether neither current nor motion shows that the first command acted before its row.
    from_rest: bool,
}

impl<'a> Run<'a> {
    fn new(model: &'a Model, data: &'a Dataset, stretch: &Stretch, steps: Steps) -> Self {
        let terms = &model.terms;
        let range = stretch.rows.clone();
        let current_a = data.current().map_or(0.0, |measured| first(&measured.values[range.clone()]));
        let motion = data.motion();
        let speed_rad_per_s = first_speed(motion, stretch);
        let usual_step_s = (0.1 * stretch.interval_s).clamp(LONGEST_STEPS_S[0], LONGEST_STEPS_S[1]);
        let usual_step_s = match steps {
            Steps::Fine => usual_step_s,
            Steps::Coarse => 2.0 * usual_step_s,
            Steps::AtMost(step_s) => step_s.min(usual_step_s),
        };
        let still = speed_rad_per_s.abs() < 5.0 * motion.noise;
        let speed_rad_per_s = if still { 0.0 } else { speed_rad_per_s };
        let delay_s = model.delay_s() + data.origin.timing.command_delay_s.unwrap_or(0.0);
        let acting = model.in_turn(|effect| effect.acts_on_motor()).into_iter().map(|term| Acting {
            effect: term.effect,
            values: &term.values,
            state: term.effect.begins(speed_rad_per_s),
        });
        Self {
            model,
            data,
            delay_s,
            longest_step_s: longest_step_s(model).min(usual_step_s),
            inertia_kg_m2: if data.is_held(stretch) { HELD_KG_M2 } else { inertia_kg_m2(model) },
            step: LinearStep::default(),
            acting: acting.collect(),
            current_a: if still { 0.0 } else { current_a },
            speed_rad_per_s,
            angle_rad: 0.0,
            lost_rad: 0.0,
            angle_sensor: terms.iter().filter(|term| term.effect.about().acts_on == ActsOn::AngleSensor).collect(),
            mean_a: 0.0,
            bulge_a: 0.0,
            ripple_a: 0.0,
            undriven: Ripple::new(model.motor.inductance_h, model.motor.resistance_ohm, data.origin.pwm_hz),
            before: None,
            from_rest: still && data.current().is_none_or(|measured| current_a.abs() < 5.0 * measured.noise),
            acts_within: delay_s > 0.0 || data.has_moments(),
            range,
        }
    }

    fn whole(mut self, motion: &mut Motion) {
        let means = self.data.origin.timing.readings == rig::Readings::Mean;
        for index in self.range.clone() {
            let current_a = if index > self.range.start && means { self.mean_a } else { self.current_a };
            motion.current_a.push(current_a + self.ripple_a);
            motion.bulge_a.push(if means { 0.0 } else { self.bulge_a });
            motion.speed_rad_per_s.push(self.speed_rad_per_s);
            motion.angle_rad.push(self.angle_rad);
            motion.shaft_rad.push(self.shaft_rad(self.data.angle_rad[index]));
            if index + 1 < self.range.end {
                self.until(index + 1);
            }
        }
    }

    /// Where the shaft is when its sensor reads `angle_rad`, by what the model says of the sensor.
    fn shaft_rad(&self, angle_rad: f64) -> f64 {
        let counted_rad = angle_rad + self.lost_rad;
        let ahead = self.angle_sensor.iter().map(|term| term.effect.ahead_rad(&term.values, counted_rad));
        counted_rad - ahead.sum::<f64>()
    }

    /// Simulates up to the sample `next`.
    fn until(&mut self, next: usize) {
        let data = self.data;
        let index = next - 1;
        let interval_s = data.time_s[next] - data.time_s[index];
        let steps = (interval_s / self.longest_step_s - 1e-6).ceil().max(1.0);
        let step_s = interval_s / steps;
        let (mut charge, first_a) = (0.0, self.current_a);
        let course = Course::new(data, self.range.clone(), index);
        for part in 0..steps as usize {
            for (since_s, length_s) in self.pieces(index, part as f64 * step_s, step_s) {
                if length_s == 0.0 {
                    continue;
                }
                self.step.set_length(&self.model.motor, self.inertia_kg_m2, length_s);
                // The middle of the step stands for it.
                let share = (since_s + 0.5 * length_s) / interval_s;
                let half = 0.5 * length_s / interval_s;
                let (voltage_v, duty) = self.command(index, since_s - self.delay_s, length_s);
                self.change_duty(voltage_v, duty);
                let mut at = Instant {
                    time_s: data.time_s[index] + share * interval_s,
                    voltage_v,
                    duty,
                    mean_duty: duty,
                    supply_v: data.supply_v[index],
                    open: data.open[self.acting_at(index, since_s + 0.5 * length_s - self.delay_s)],
                    current_a: self.current_a,
                    speed_rad_per_s: self.speed_rad_per_s,
                    angle_rad: self.shaft_rad(course.angle_rad(share)),
                    turned_rad: course.angle_rad(share + half) - course.angle_rad(share - half),
                    step_s: length_s,
                };
                let (terms, mean_a) = self.advance(&mut at, data.load_nm[index]);
                self.before = data.origin.timing.current_sampled_at.map(|_| (at, terms));
                if let (Some(sampled_at), true) = (data.origin.timing.current_sampled_at, part + 1 == steps as usize) {
                    self.ripple_a = self.above_mean_a(&at, &terms, sampled_at);
                }
                charge += mean_a * length_s;
            }
        }
        for term in &self.angle_sensor {
            self.lost_rad += term.effect.lost_rad_per_s(&term.values, self.speed_rad_per_s) * interval_s;
        }
        self.mean_a = charge / interval_s;
        self.bulge_a = self.mean_a - 0.5 * (first_a + self.current_a);
    }

    /// One step; its terms, and the mean of the current on the way.
    fn advance(&mut self, at: &mut Instant, load_nm: f64) -> (Balance, f64) {
        let motor = &self.model.motor;
        let ripple = self.undriven.with_duty(at.duty);
        let dry_drop_v = self.data.origin.hidden_drop_v;
        let mut terms = Balance { torque_nm: -load_nm, dry_drop_v, ripple, ..Balance::default() };
        for Acting { effect, values, state } in &mut self.acting {
            effect.contribute(values, motor, at, state, &mut terms);
        }
        let before = self.speed_rad_per_s;
        let reached = self.step.take(self.current_a, before, at.voltage_v, at.open, &terms);
        (self.current_a, self.speed_rad_per_s) = (reached.current_a, reached.speed_rad_per_s);
        self.angle_rad += 0.5 * (before + self.speed_rad_per_s) * at.step_s;
        at.current_a = self.current_a;
        at.speed_rad_per_s = self.speed_rad_per_s;
        for Acting { effect, values, state } in &mut self.acting {
            if !state.is_empty() {
                effect.advance(values, motor, at, state);
            }
        }
        (terms, reached.mean_a)
    }

    /// Another duty comes with a new period, at whose begin the current is what it was: it is the mean that leaps, by what the
    /// ripple has above it there. Of one way and the other that is the whole ripple, and fades with the winding, as though
    /// that were of less inductance.
    fn change_duty(&mut self, voltage_v: f64, duty: f64) {
        let Some((at, terms)) = self.before.filter(|(at, _)| at.duty != duty && !at.open) else { return };
        let begun = self.above_mean_a(&at, &terms, 0.0);
        let at = Instant { voltage_v, duty, ..at };
        let terms = Balance { ripple: self.undriven.with_duty(duty), ..terms };
        self.current_a += begun - self.above_mean_a(&at, &terms, 0.0);
    }

    /// By how much the current, where in the period it is sampled, is above its mean.
    fn above_mean_a(&self, at: &Instant, terms: &Balance, sampled_at: f64) -> f64 {
        if at.open || at.duty == 0.0 {
            return 0.0;
        }
        let volts = self.step.volts(at.current_a, at.speed_rad_per_s, at.voltage_v, terms);
        terms.ripple.sampled_a(at.current_a, sampled_at, &volts) - at.current_a
    }

    /// When after sample `index` the parts of a step begin, and how long they are: between two the bridge opens or closes, or the
    /// voltage leaps. Its mean over the step would turn a current round too early, and a drop with it.
    fn pieces(&self, index: usize, since_s: f64, length_s: f64) -> [(f64, f64); 2] {
        let whole = [(since_s, length_s), (since_s + length_s, 0.0)];
        if !self.acts_within {
            return whole;
        }
        let data = self.data;
        let before = self.acting_at(index, since_s - self.delay_s);
        let after = self.acting_at(index, since_s + length_s - self.delay_s);
        let leap_v = LEAP * data.supply_v[before];
        let leaps = |row: usize| (data.voltage_v[row] - data.voltage_v[before]).abs() > leap_v;
        let switches = |row: &usize| data.open[*row] != data.open[before] || leaps(*row);
        let Some(switched) = (before + 1..=after).find(switches) else { return whole };
        let first_s = data.acts_from_s(switched) + self.delay_s - data.time_s[index] - since_s;
        match (SAME_LENGTH_S..length_s - SAME_LENGTH_S).contains(&first_s) {
            true => [(since_s, first_s), (since_s + first_s, length_s - first_s)],
            false => whole,
        }
    }

    /// The sample whose command acts so long after sample `index`.
    fn acting_at(&self, index: usize, offset_s: f64) -> usize {
        let data = self.data;
        if !self.acts_within {
            return index;
        }
        let at_s = data.time_s[index] + offset_s;
        let last = if data.has_moments() { (index + 1).min(self.range.end - 1) } else { index };
        (self.range.start..=last).rev().find(|row| data.acts_from_s(*row) <= at_s).unwrap_or(self.range.start)
    }

    /// Means of voltage and duty, each held until the next acts, over `length_s` from `offset_s` after sample `index`.
    fn command(&self, index: usize, offset_s: f64, length_s: f64) -> (f64, f64) {
        let data = self.data;
        let from_s = data.time_s[index] + offset_s;
        let mut end_s = from_s + length_s;
        let next = index + 1;
        let acts_early = || next < self.range.end && data.acts_from_s(next) < end_s;
        let mut sample = if data.has_moments() && acts_early() { next } else { index };
        if sample == index && (offset_s >= 0.0 || index == self.range.start && !self.from_rest) {
            return (data.voltage_v[index], data.duty[index]);
        }
        let (mut voltage, mut duty) = (0.0, 0.0);
        loop {
            let acts_before = sample == self.range.start && !self.from_rest;
            let start_s = if acts_before { f64::NEG_INFINITY } else { data.acts_from_s(sample) };
            let since_s = start_s.max(from_s);
            if since_s < end_s {
                voltage += data.voltage_v[sample] * (end_s - since_s);
                duty += data.duty[sample] * (end_s - since_s);
                end_s = since_s;
            }
            // Before a start from rest nothing acted.
            if since_s <= from_s || sample == self.range.start {
                return (voltage / length_s, duty / length_s);
            }
            sample -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::effect;
    use crate::dataset::HeldRotor;
    use crate::motor::MotorParameters;
    use crate::recording::Recording;
    use crate::rig::Rig;
    use proptest::prelude::*;
    use std::f64::consts::TAU;
    use std::fmt::Write as _;

    /// Steps of the command, recorded every `interval_s`; nothing was measured that matters.
    fn stepped(interval_s: f64) -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..(0.4 / interval_s).round() as usize {
            let time_s = row as f64 * interval_s;
            let volts = if (time_s * 50.0 + 1e-6).floor() % 2.0 == 0.0 { 12.0 } else { -3.0 };
            let (speed, current) = if row % 2 == 0 { (100, 0) } else { (101, 1) };
            let _ = writeln!(text, "{time_s:.6},{volts},{speed},{current}");
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    /// Until the current has turned round, its drop works the other way.
    #[test]
    fn a_drop_turns_round_with_the_current_within_a_step() {
        let motor = MotorParameters::PIVT6;
        let after = |steps: i32, terms: &Balance| {
            let step = LinearStep::new(&motor, motor.inertia_kg_m2, 2e-4 / f64::from(steps));
            (0..steps).fold((0.15, 0.0), |(current_a, speed), _| {
                let reached = step.take(current_a, speed, -12.0, false, terms);
                (reached.current_a, reached.speed_rad_per_s)
            })
        };
        for knee_a in [0.0, 1e-6, 1e-3] {
            let terms = Balance { dry_drop_v: 2.0, knee_a, ..Balance::default() };
            let (coarse, fine) = (after(1, &terms), after(1000, &terms));
            assert!(fine.0 < -0.05, "it reverses: {fine:?}");
            assert!((coarse.0 - fine.0).abs() < 0.01 * (0.15 - fine.0), "knee {knee_a}: {coarse:?} {fine:?}");
        }
    }

    /// Of sensors as well as of the motor: the one that was found first is not the one that acts first.
    #[test]
    fn the_order_in_which_effects_were_found_means_nothing() {
        let effects: [(&str, &[f64]); 5] = [
            ("current_lag", &[2e-3, 0.0, 0.0]),
            ("current_offset", &[-0.3]),
            ("current_clipping", &[0.8]),
            ("encoder_eccentricity", &[0.02, 0.01]),
            ("missed_counts", &[0.3, 50.0, 1.0, 0.0]),
        ];
        let with = |model: Model, (id, values): &(&str, &[f64])| model.with(effect(id).unwrap(), values.to_vec());
        let linear = || Model::linear(MotorParameters::PIVT6);
        let data = stepped(1e-3);
        let as_listed = free_run(&effects.iter().fold(linear(), with), &data);
        assert_eq!(free_run(&effects.iter().rev().fold(linear(), with), &data), as_listed);
        assert!(as_listed[0].iter().all(|current| current.abs() <= 0.8), "the range ends what the offset has moved");
    }

    /// Whatever torque its current and the magnets exert: the winding alone says what flows.
    #[test]
    fn a_rotor_that_is_held_does_not_turn() {
        let mut data = stepped(1e-3);
        data.origin.held_rotor = vec![HeldRotor { name: "run.csv".into(), rows: 0..data.len() }];
        data.measured[1].values.fill(f64::NAN);
        let motor = MotorParameters::PIVT6;
        let model = Model::linear(motor).with(effect("coulomb_friction").unwrap(), vec![0.01]);
        let model = model.with(effect("cogging").unwrap(), vec![0.02, 0.01, 12.0]);
        let prediction = free_run(&model, &data);
        assert!(prediction[1].iter().all(|speed| speed.abs() < 1e-9), "{:?}", prediction[1]);
        // Each level lasts for many time constants of the winding.
        let end_of_level = 19;
        let settled_a = data.voltage_v[end_of_level - 1] / motor.resistance_ohm;
        let share_left = (-18e-3 * motor.resistance_ohm / motor.inductance_h).exp();
        let flows_a = prediction[0][end_of_level];
        assert!((flows_a - settled_a).abs() < (1e-3 + 2.0 * share_left) * settled_a, "{flows_a} {settled_a}");
    }

    /// From a start at rest on, and where the bridge opens and closes within a step as well.
    #[test]
    fn late_commands_are_the_same_later() {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..300 {
            let volts = if row / 50 % 2 == 0 { "12" } else { "" };
            let _ = writeln!(text, "{:.3},{volts},{},{}", f64::from(row) * 1e-3, row / 2 + row % 2, row % 2);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let data = Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap();
        assert!(data.open[75] && !data.open[25]);
        let linear = Model::linear(MotorParameters::PIVT6);
        let late = |delay_s: f64| free_run(&linear.with(effect("actuation_delay").unwrap(), vec![delay_s]), &data);
        let [at_once, by_two_rows, between] = [0.0, 2e-3, 1.37e-3].map(late);
        for channel in 0..2 {
            let largest = at_once[channel].iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            for row in 2..300 {
                let (later, earlier) = (by_two_rows[channel][row], at_once[channel][row - 2]);
                assert!((later - earlier).abs() < 1e-3 * largest, "channel {channel}, row {row}: {later} {earlier}");
            }
        }
        assert_eq!(by_two_rows[0][..3], [0.0; 3], "nothing has acted yet");
        // After the bridge has opened no current flows, and before that it does.
        let [before, after] = [51, 52].map(|row| between[0][row]);
        assert!(before > 0.1 && after == 0.0, "{before} {after}");
    }

    /// As a recording that begins with a step, before a delay has passed.
    #[test]
    fn what_begins_to_move_within_the_second_window_stood_before() {
        let mut text = String::from("t_s,duty,counts\n");
        for row in 0..200 {
            let since_s = f64::max(0.0, f64::from(row) * 1e-3 - 4e-3);
            let _ = writeln!(text, "{},0.8,{}", f64::from(row) * 1e-3, (2e6 * since_s * since_s).floor());
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let rig = "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 2000\n";
        let data = Dataset::new(&[recording], &Rig::parse("rig.toml", rig).unwrap()).unwrap();
        assert_eq!(first_speed(data.motion(), &data.stretches[0]), 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Against the mean of a simulation with rows forty times as close.
        #[test]
        fn a_current_is_averaged_before_its_row(window_s in 0.2e-3_f64..3e-3, inductance_h in 0.5e-3_f64..12e-3) {
            let model = Model::linear(MotorParameters { inductance_h, ..MotorParameters::PIVT6 });
            let mut data = stepped(1e-3);
            data.origin.current_window_s = window_s;
            let means = &free_run(&model, &data)[0];
            let fine = stepped(25e-6);
            let currents = &free_run(&model, &fine)[0];
            let mut charges = vec![0.0];
            for pair in currents.windows(2) {
                charges.push(charges[charges.len() - 1] + 25e-6 * 0.5 * (pair[0] + pair[1]));
            }
            let charge = |time_s: f64| {
                let place = (time_s / 25e-6).max(0.0);
                let (row, part) = (place.floor() as usize, place.fract());
                charges[row] + part * (charges[row + 1] - charges[row])
            };
            let greatest = currents.iter().fold(0.0, |most: f64, current| most.max(current.abs()));
            for (row, found) in means.iter().enumerate().skip(4).take(386) {
                let time_s = row as f64 * 1e-3;
                let mean = (charge(time_s) - charge(time_s - window_s)) / window_s;
                prop_assert!((found - mean).abs() < 0.01 * greatest, "row {row}: {found} {mean}");
            }
        }

        /// A stretch that begins in motion begins as fast as that, and one from rest at rest.
        #[test]
        fn a_stretch_begins_as_fast_as_its_counts_say(speed in -300.0_f64..300.0, from_rest: bool) {
            let mut text = String::from("t_s,u_V,counts\n");
            let acceleration = if from_rest { 20.0 * speed } else { 0.0 };
            let start = if from_rest { 0.0 } else { speed };
            for row in 0..200 {
                let time_s = f64::from(row) * 1e-3;
                let counts = (start * time_s + 0.5 * acceleration * time_s * time_s) * 2000.0 / TAU;
                let _ = writeln!(text, "{time_s},{},{}", if row < 50 { 12 } else { 0 }, counts.floor());
            }
            prop_assume!(speed.abs() > 20.0);
            let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
            let rig = "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 2000\n";
            let data = Dataset::new(&[recording], &Rig::parse("rig.toml", rig).unwrap()).unwrap();
            let first = first_speed(data.motion(), &data.stretches[0]);
            // A count over the window, at the worst.
            prop_assert!((first - start).abs() < 2.0 * TAU / 2000.0 / 5e-3, "{first} {start}");
        }
    }
}

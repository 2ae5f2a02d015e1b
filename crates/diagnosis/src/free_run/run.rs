//! Simulates the motor of a model through one stretch of the data.

use super::{Course, Motion, Steps, inertia_kg_m2, longest_step_s};
use crate::dataset::{Dataset, Measured, Output, Stretch, Window};
use motorbench_data::rig;
use motorbench_model::catalogue::{ActsOn, Balance, Effect, Instant};
use motorbench_model::pwm_period::Ripple;
use motorbench_model::{LinearStep, SAME_LENGTH_S};
use motorbench_model::{Model, Term};
use std::ops::Range;

/// Longest step for recordings at 200 Hz or more; slower ones take a tenth of their interval, at most the second value.
const LONGEST_STEPS_S: [f64; 2] = [0.5e-3, 2e-3];
/// A voltage change is a jump from this share of the supply on.
const LEAP: f64 = 0.1;
/// A held rotor is simulated with this inertia, so that no torque moves it.
const HELD_KG_M2: f64 = 1e9;
/// From this many standard deviations of the noise on, a first reading differs from zero.
const NOT_ZERO: f64 = 5.0;

fn first(values: &[f64]) -> f64 {
    values.iter().take(5).copied().find(|value| value.is_finite()).unwrap_or(0.0)
}

/// Speed at the start of a stretch. A mean over a window that begins there gives the speed of its middle. Two
/// successive means are extrapolated back to the start, but not through a standstill: a shaft that begins to move
/// within the second one stood before.
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

/// A term of the model, with its state.
struct Acting<'a> {
    effect: &'static dyn Effect,
    values: &'a [f64],
    state: Vec<f64>,
}

/// The motor of a model in one stretch of the data.
pub(super) struct Run<'a> {
    model: &'a Model,
    data: &'a Dataset,
    range: Range<usize>,
    delay_s: f64,
    /// By how much the delay grows in each second of the recording.
    delay_growth: f64,
    longest_step_s: f64,
    inertia_kg_m2: f64,
    step: LinearStep,
    acting: Vec<Acting<'a>>,
    current_a: f64,
    speed_rad_per_s: f64,
    angle_rad: f64,
    /// By how much the measured angle lags behind.
    lost_rad: f64,
    /// Error of that angle by the model's sensor.
    angle_sensor: Vec<&'a Term>,
    /// Mean of the current since the sample before.
    mean_a: f64,
    /// Mean of the current since the sample before, less the mean of the two samples.
    bulge_a: f64,
    /// Difference of the current at its sampling time from its mean over the PWM period.
    ripple_a: f64,
    /// The PWM without a duty.
    undriven: Ripple,
    /// Conditions of the previous step.
    before: Option<(Instant, Balance)>,
    /// Whether a command may begin to act within a step.
    acts_within: bool,
    /// Whether neither current nor motion shows that the first command acted before its row.
    from_rest: bool,
}

impl<'a> Run<'a> {
    pub(super) fn new(model: &'a Model, data: &'a Dataset, stretch: &Stretch, steps: Steps) -> Self {
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
        let may_be_zero = |value: f64, measured: &Measured| value.abs() < NOT_ZERO * measured.noise;
        let still = may_be_zero(speed_rad_per_s, motion);
        let speed_rad_per_s = if still { 0.0 } else { speed_rad_per_s };
        let delay_s = model.delay_s() + data.origin.timing.command_delay_s.unwrap_or(0.0);
        let delay_growth = model.delay_growth();
        let acting = model.in_turn(|effect| effect.acts_on_motor()).into_iter().map(|term| Acting {
            effect: term.effect,
            values: &term.values,
            state: term.effect.begins(speed_rad_per_s),
        });
        Self {
            model,
            data,
            delay_s,
            delay_growth,
            longest_step_s: longest_step_s(model).min(usual_step_s),
            inertia_kg_m2: if data.is_held(stretch) { HELD_KG_M2 } else { inertia_kg_m2(model) },
            step: LinearStep::default(),
            acting: acting.collect(),
            current_a: if still { 0.0 } else { current_a },
            speed_rad_per_s,
            angle_rad: 0.0,
            lost_rad: 0.0,
            angle_sensor: terms.iter().filter(|term| term.effect.about().acts_on == [ActsOn::AngleSensor]).collect(),
            mean_a: 0.0,
            bulge_a: 0.0,
            ripple_a: 0.0,
            undriven: Ripple::new(model.motor.inductance_h, model.motor.resistance_ohm, data.origin.pwm_hz),
            before: None,
            from_rest: still && data.current().is_none_or(|measured| may_be_zero(current_a, measured)),
            acts_within: delay_s > 0.0 || delay_growth != 0.0 || data.has_moments(),
            range,
        }
    }

    pub(super) fn whole(mut self, motion: &mut Motion) {
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

    /// Angle of the shaft when its sensor reads `angle_rad`, by the model of the sensor.
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
            for piece_s in self.pieces(index, part as f64 * step_s, step_s).into_iter().flatten() {
                let (at, terms, mean_a) = self.simulate(index, &course, piece_s);
                charge += mean_a * at.step_s;
                if let Some(sampled_at) = data.origin.current_sampled_at(data.time_s[next]) {
                    self.before = Some((at, terms));
                    if part + 1 == steps as usize {
                        self.ripple_a = self.above_mean_a(&at, &terms, sampled_at);
                    }
                }
            }
        }
        for term in &self.angle_sensor {
            self.lost_rad += term.effect.lost_rad_per_s(&term.values, self.speed_rad_per_s) * interval_s;
        }
        self.mean_a = charge / interval_s;
        self.bulge_a = self.mean_a - 0.5 * (first_a + self.current_a);
    }

    /// One step, from this time after sample `index`, of this length; returns its conditions and the mean current over
    /// it.
    fn simulate(&mut self, index: usize, course: &Course, (since_s, length_s): (f64, f64)) -> (Instant, Balance, f64) {
        let data = self.data;
        let interval_s = data.time_s[index + 1] - data.time_s[index];
        self.step.set_length(&self.model.motor, self.inertia_kg_m2, length_s);
        // The middle of the step represents it.
        let share = (since_s + 0.5 * length_s) / interval_s;
        let half = 0.5 * length_s / interval_s;
        let delay_s = self.delay_at(index);
        let (voltage_v, duty) = self.command(index, since_s - delay_s, length_s);
        self.change_duty(voltage_v, duty);
        let mut at = Instant {
            time_s: data.time_s[index] + since_s,
            voltage_v,
            duty,
            mean_duty: duty,
            supply_v: data.supply_v[index],
            open: data.open[self.acting_at(index, since_s + 0.5 * length_s - delay_s)],
            current_a: self.current_a,
            speed_rad_per_s: self.speed_rad_per_s,
            angle_rad: self.shaft_rad(course.angle_rad(share)),
            turned_rad: course.angle_rad(share + half) - course.angle_rad(share - half),
            step_s: length_s,
        };
        let (terms, mean_a) = self.advance(&mut at, data.load_nm[index]);
        (at, terms, mean_a)
    }

    /// Its terms, and the mean current over the step.
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

    /// A new duty begins with a new period. The current is continuous there, so its mean jumps by the difference of the
    /// ripple. Between the two directions that is the whole ripple. It decays with the winding, as with a smaller
    /// inductance.
    fn change_duty(&mut self, voltage_v: f64, duty: f64) {
        let Some((at, terms)) = self.before.filter(|(at, _)| at.duty != duty && !at.open) else { return };
        let begun = self.above_mean_a(&at, &terms, 0.0);
        let at = Instant { voltage_v, duty, ..at };
        let terms = Balance { ripple: self.undriven.with_duty(duty), ..terms };
        self.current_a += begun - self.above_mean_a(&at, &terms, 0.0);
    }

    /// Current at its sampling time in the period, less its mean.
    fn above_mean_a(&self, at: &Instant, terms: &Balance, sampled_at: f64) -> f64 {
        if at.open || at.duty == 0.0 {
            return 0.0;
        }
        let volts = self.step.volts(at.current_a, at.speed_rad_per_s, at.voltage_v, terms);
        terms.ripple.sampled_a(at.current_a, sampled_at, &volts) - at.current_a
    }

    /// Start times and lengths of the parts of a step after sample `index`: between two parts the bridge opens or
    /// closes, or the voltage jumps. A mean voltage over the whole step would reverse the current too early, and the
    /// drop with it.
    fn pieces(&self, index: usize, since_s: f64, length_s: f64) -> [Option<(f64, f64)>; 2] {
        let whole = [Some((since_s, length_s)), None];
        if !self.acts_within {
            return whole;
        }
        let data = self.data;
        let delay_s = self.delay_at(index);
        let before = self.acting_at(index, since_s - delay_s);
        let after = self.acting_at(index, since_s + length_s - delay_s);
        let leap_v = LEAP * data.supply_v[before];
        let leaps = |row: usize| (data.voltage_v[row] - data.voltage_v[before]).abs() > leap_v;
        let switches = |row: &usize| data.open[*row] != data.open[before] || leaps(*row);
        let Some(switched) = (before + 1..=after).find(switches) else { return whole };
        let first_s = data.acts_from_s(switched) + delay_s - data.time_s[index] - since_s;
        match (SAME_LENGTH_S..length_s - SAME_LENGTH_S).contains(&first_s) {
            true => [Some((since_s, first_s)), Some((since_s + first_s, length_s - first_s))],
            false => whole,
        }
    }

    /// By how much a command acts late around a row.
    fn delay_at(&self, index: usize) -> f64 {
        self.delay_s + self.delay_growth * self.data.time_s[index]
    }

    /// The sample whose command acts at this time after sample `index`.
    fn acting_at(&self, index: usize, offset_s: f64) -> usize {
        let data = self.data;
        if !self.acts_within {
            return index;
        }
        let at_s = data.time_s[index] + offset_s;
        (self.range.start..=self.last_acting(index, at_s))
            .rev()
            .find(|row| data.acts_from_s(*row) <= at_s)
            .unwrap_or(self.range.start)
    }

    /// The last sample, from `index` on, whose command acts before `end_s`.
    fn last_acting(&self, index: usize, end_s: f64) -> usize {
        let may_act_early = self.data.has_moments() || self.delay_growth < 0.0;
        let later = (index + 1..self.range.end).take_while(|row| may_act_early && self.data.acts_from_s(*row) < end_s);
        later.last().unwrap_or(index)
    }

    /// Means of voltage and duty, each held until the next acts, over `length_s` from `offset_s` after sample `index`.
    fn command(&self, index: usize, offset_s: f64, length_s: f64) -> (f64, f64) {
        let data = self.data;
        let from_s = data.time_s[index] + offset_s;
        let mut end_s = from_s + length_s;
        let mut sample = self.last_acting(index, end_s);
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
            // Before a start from rest no command acted.
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
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use proptest::prelude::*;
    use std::f64::consts::TAU;
    use std::fmt::Write as _;

    /// A recording that begins with a step, before the delay has passed.
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
        /// A stretch that begins in motion starts at that speed, and one from rest at zero.
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
            // One count over the window in the worst case.
            prop_assert!((first - start).abs() < 2.0 * TAU / 2000.0 / 5e-3, "{first} {start}");
        }
    }
}

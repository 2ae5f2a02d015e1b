//! Simulates the motor of a model through one stretch of the data.

use super::reading::in_the_last;
use super::replay::{Change, Cut, Piece};
use super::{Motion, acts_by_angle, inertia_kg_m2};
use crate::configuration::free_run::run::HELD_KG_M2;
use crate::dataset::{Dataset, Stretch};
use motorbench_data::rig;
use motorbench_model::between_rows::Bulge;
use motorbench_model::catalogue::{ActsOn, Balance, Effect, Instant};
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::motor::MotorParameters;
use motorbench_model::pwm_period::{Ripple, Volts};
use motorbench_model::{Input, Late, LinearSteps, Model, Reached, SAME_LENGTH_S, SwitchedStep, Term, volts};
use std::collections::VecDeque;
use std::ops::Range;

/// Frequency of the PWM that is averaged; the ripple of one whose edges are simulated is not added again.
fn averaged_hz(data: &Dataset) -> f64 {
    if data.is_switched() { f64::INFINITY } else { data.origin.pwm_hz }
}

/// The current in a step that has passed.
struct Passed {
    length_s: f64,
    begin_a: f64,
    mean_a: f64,
    end_a: f64,
}

/// A low-pass in front of the conversion of the current.
struct Filter {
    time_constant_s: f64,
    winding_s: f64,
    /// By how much it is behind the mean over the PWM period.
    behind_a: f64,
    /// What it remembers, in periods of the PWM.
    memory: f64,
    /// The last step's length, and what the filter does in it.
    step: (f64, Passing),
}

/// What a low-pass does in a step.
#[derive(Clone, Copy, Default)]
struct Passing {
    /// Share of what it was behind that is left.
    left: f64,
    /// By how much a current that rises by one ampere is ahead at the end.
    of_rise: f64,
    /// The same of one whose mean is an ampere above the straight line.
    of_bulge: f64,
}

impl Filter {
    fn of(model: &Model, data: &Dataset) -> Option<Self> {
        let time_constant_s = data.origin.current_filter_s;
        let is_needed = time_constant_s > 0.0 && !data.is_switched();
        is_needed.then(|| Self {
            time_constant_s,
            winding_s: TimeConstants::of(&model.motor).electromagnetic_s,
            behind_a: 0.0,
            memory: time_constant_s * averaged_hz(data),
            step: (0.0, Passing::default()),
        })
    }

    /// Follows the current over a step.
    fn follow(&mut self, first_a: f64, reached: &Reached, step_s: f64) {
        if step_s != self.step.0 {
            self.step = (step_s, self.passing(step_s));
        }
        let Passing { left, of_rise, of_bulge } = self.step.1;
        let above_line_a = reached.mean_a - 0.5 * (first_a + reached.current_a);
        self.behind_a = left * self.behind_a + of_rise * (reached.current_a - first_a) - of_bulge * above_line_a;
    }

    fn passing(&self, step_s: f64) -> Passing {
        let steps = step_s / self.time_constant_s;
        let left = (-steps).exp();
        let of_bulge = Bulge::new(1.0, step_s, self.winding_s).in_a_low_pass(steps);
        Passing { left, of_rise: (1.0 - left) / steps, of_bulge }
    }
}

/// Of a time in periods.
fn share_of_period(periods: f64) -> f64 {
    periods - periods.floor()
}

/// A term of the model whose contribution differs from step to step, with its state.
struct Varying<'a> {
    effect: &'static dyn Effect,
    values: &'a [f64],
    state: Vec<f64>,
}

/// The motor of a model in one stretch of the data.
pub(super) struct Run<'a> {
    model: &'a Model,
    data: &'a Dataset,
    cut: &'a Cut,
    range: Range<usize>,
    stepper: Stepper,
    /// What the effects contribute whose terms are the same in each step.
    steady: Balance<'static>,
    varying: Vec<Varying<'a>>,
    current_a: f64,
    speed_rad_per_s: f64,
    acceleration_rad_per_s2: f64,
    angle_rad: f64,
    /// By how much the measured angle lags behind.
    lost_rad: f64,
    /// Error of that angle by the model's sensor.
    angle_sensor: Vec<&'a Term>,
    /// Whether an effect depends on the angle of the shaft.
    acts_by_angle: bool,
    /// Mean of the current since the sample before.
    mean_a: f64,
    /// Mean of the current since the sample before, less the mean of the two samples.
    bulge_a: f64,
    /// Difference of the current at its sampling time from its mean over the PWM period.
    ripple_a: f64,
    filter: Option<Filter>,
    /// Whether the current is averaged over a window of steps.
    has_window: bool,
    /// The last steps, as far back as that window.
    lately: VecDeque<Passed>,
    /// Whether anything depends on the ripple of the current.
    has_ripple: bool,
    /// The PWM with the last duty.
    driven: (f64, Ripple),
    before: Option<Before>,
}

/// Steps of the motor.
struct Stepper {
    linear: LinearSteps,
    /// Where every edge of the PWM is simulated.
    switched: Option<SwitchedStep>,
}

impl Stepper {
    /// From a current and a speed.
    // Inlined: its numbers stay in registers. Those that pass through memory are waited for.
    #[inline(always)]
    fn take<const AS_IT_IS: bool>(
        &mut self,
        step_s: f64,
        (current_a, speed_rad_per_s): (f64, f64),
        (input, change): (Input, Option<Change>),
        terms: &Balance,
    ) -> Reached {
        match (&mut self.switched, input) {
            (Some(step), Input::Voltage(voltage_v)) if !AS_IT_IS && !terms.drops_with_the_mean() => {
                step.set_length(step_s);
                step.take(current_a, speed_rad_per_s, voltage_v, terms)
            }
            _ => {
                let late = change.map_or(Late::default(), |Change { by, by_share, rest_s }| {
                    self.linear.late([step_s, rest_s], [by, by_share])
                });
                let step = self.linear.of_length(step_s);
                step.take(current_a, speed_rad_per_s, input, late, terms)
            }
        }
    }
}

/// What drove the current at the end of the previous step; its ripple is that of the duty until this changes.
#[derive(Clone, Copy)]
struct Before {
    duty: f64,
    open: bool,
    current_a: f64,
    volts: Volts,
    /// What the effects added to the voltage of the bridge, and to the resistance.
    added: (f64, f64),
}

impl Before {
    #[inline]
    fn new(motor: &MotorParameters, at: &Instant, terms: &Balance) -> Self {
        Self {
            duty: at.duty,
            open: at.open,
            current_a: at.current_a,
            volts: volts(motor, at.current_a, at.speed_rad_per_s, at.voltage_v, terms),
            added: (terms.voltage_v, terms.resistance_ohm),
        }
    }

    /// At another instant, with what the effects did then.
    fn with(&self, motor: &MotorParameters, at: &Instant) -> Self {
        let (voltage_v, resistance_ohm) = self.added;
        let added = Balance { voltage_v, resistance_ohm, ..Balance::default() };
        let now = Self::new(motor, at, &added);
        Self { volts: Volts { drops: self.volts.drops, ..now.volts }, ..now }
    }
}

impl<'a> Run<'a> {
    pub(super) fn new(model: &'a Model, data: &'a Dataset, stretch: &Stretch, cut: &'a Cut) -> Self {
        let (current_a, speed_rad_per_s) = cut.begins_with;
        let mut acting = model.in_turn(|effect| effect.acts_on_motor());
        let acts_on_voltage = acting.iter().any(|term| term.effect.about().acts_on.contains(&ActsOn::Voltage));
        // Of one turn they act in any order. Those of a later one may depend on one that varies.
        let is_steady = |term: &&Term| term.effect.is_steady(&term.values);
        acting.sort_by_key(|term| (term.turn(), !is_steady(term)));
        let (steady, varying) = acting.split_at(acting.iter().take_while(|term| is_steady(term)).count());
        let mut sum = Balance { dry_drop_v: data.origin.hidden_drop_v, ..Balance::default() };
        for Term { effect, values } in steady {
            effect.contribute(values, &model.motor, &Instant::default(), &mut [], &mut sum);
        }
        let varying = varying.iter().map(|Term { effect, values }| Varying {
            effect: *effect,
            values,
            state: effect.begins(speed_rad_per_s),
        });
        let inertia_kg_m2 = if data.is_held(stretch) { HELD_KG_M2 } else { inertia_kg_m2(model) };
        let of_the_angle = model.terms.iter().filter(|term| term.effect.about().acts_on == [ActsOn::AngleSensor]);
        Self {
            model,
            data,
            cut,
            range: stretch.rows.clone(),
            stepper: Stepper {
                linear: LinearSteps::new(&model.motor, inertia_kg_m2),
                switched: data.is_switched().then(|| SwitchedStep::new(&model.motor, inertia_kg_m2, data.interval_s)),
            },
            filter: Filter::of(model, data),
            has_window: data.is_switched() && data.origin.current_window_s > 0.0,
            lately: VecDeque::new(),
            acts_by_angle: acts_by_angle(model),
            has_ripple: data.current().is_some() || data.origin.hidden_drop_v != 0.0 || acts_on_voltage,
            steady: sum,
            varying: varying.collect(),
            current_a,
            speed_rad_per_s,
            acceleration_rad_per_s2: 0.0,
            angle_rad: 0.0,
            lost_rad: 0.0,
            angle_sensor: of_the_angle.collect(),
            mean_a: 0.0,
            bulge_a: 0.0,
            ripple_a: 0.0,
            driven: (0.0, Ripple::new(model.motor.inductance_h, model.motor.resistance_ohm, averaged_hz(data))),
            before: None,
        }
    }

    pub(super) fn whole(self, motion: &mut Motion) {
        // Compiled twice: mostly a reading is the motor's state and nothing else, and what the others need takes long.
        if self.is_read_as_it_is() { self.rows::<true>(motion) } else { self.rows::<false>(motion) }
    }

    /// Whether each current is that of its instant, as a mean over the period of the PWM, and each angle that of the shaft.
    fn is_read_as_it_is(&self) -> bool {
        let Self { data, stepper, filter, angle_sensor, .. } = self;
        let has_ripple = data.axis.drive.is_voltage() && data.origin.current_sampled_at(0.0).is_some();
        let is_mean = data.origin.timing.readings == rig::Readings::Mean;
        !has_ripple && !is_mean && stepper.switched.is_none() && filter.is_none() && angle_sensor.is_empty()
    }

    fn rows<const AS_IT_IS: bool>(mut self, motion: &mut Motion) {
        let means = !AS_IT_IS && self.data.origin.timing.readings == rig::Readings::Mean;
        for index in self.range.clone() {
            let current_a = match AS_IT_IS {
                true => self.current_a,
                false if index > self.range.start && means => self.mean_a,
                false => self.over_window_a(),
            };
            let behind_a = self.filter.as_ref().filter(|_| !AS_IT_IS).map_or(0.0, |filter| filter.behind_a);
            let measured_rad = self.data.angle_rad[index];
            motion.current_a[index] = current_a - behind_a + self.ripple_a;
            motion.bulge_a[index] = if means { 0.0 } else { self.bulge_a };
            motion.speed_rad_per_s[index] = self.speed_rad_per_s;
            motion.angle_rad[index] = self.angle_rad;
            motion.shaft_rad[index] = if AS_IT_IS { measured_rad } else { self.shaft_rad(measured_rad) };
            if index + 1 < self.range.end {
                self.until::<AS_IT_IS>(index + 1);
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
    #[inline]
    fn until<const AS_IT_IS: bool>(&mut self, next: usize) {
        let (data, cut) = (self.data, self.cut);
        let index = next - 1;
        let interval_s = data.time_s[next] - data.time_s[index];
        let is_voltage = data.axis.drive.is_voltage();
        // Where every edge is simulated, so is the ripple.
        let is_averaged = is_voltage && !AS_IT_IS && self.stepper.switched.is_none();
        let sampled_at = if is_averaged { data.origin.current_sampled_at(data.time_s[next]) } else { None };
        let (mut charge, first_a) = (0.0, self.current_a);
        for piece in cut.row(index - self.range.start) {
            charge += piece.length_s * self.simulate::<AS_IT_IS>(index, piece, sampled_at.is_some());
        }
        if let Some((sampled_at, before)) = sampled_at.zip(self.before.as_ref()) {
            self.ripple_a = self.above_mean_a(before, sampled_at, self.filter.as_ref());
        }
        for term in self.angle_sensor.iter().filter(|_| !AS_IT_IS) {
            self.lost_rad += term.effect.lost_rad_per_s(&term.values, self.speed_rad_per_s) * interval_s;
        }
        self.mean_a = charge / interval_s;
        self.bulge_a = self.mean_a - 0.5 * (first_a + self.current_a);
    }

    /// One step after sample `index`; returns the mean current over it. `is_kept`: its conditions are needed later.
    #[inline]
    fn simulate<const AS_IT_IS: bool>(&mut self, index: usize, piece: &Piece, is_kept: bool) -> f64 {
        let data = self.data;
        let input = data.axis.drive.input(piece.command, piece.open);
        if is_kept && self.changes_duty(piece.duty) {
            self.change_duty(&self.instant(index, piece, input));
        }
        if self.has_ripple {
            self.change_ripple(piece.duty);
        }
        let torque_nm = self.steady.torque_nm - data.load_nm[index];
        let mut terms = Balance { torque_nm, ripple: &self.driven.1, ..self.steady };
        let is_steady = self.varying.is_empty() && !is_kept;
        let mut at = if is_steady { Instant::default() } else { self.instant(index, piece, input) };
        for Varying { effect, values, state } in &mut self.varying {
            effect.contribute(values, &self.model.motor, &at, state, &mut terms);
        }
        let from = (self.current_a, self.speed_rad_per_s);
        let reached = self.stepper.take::<AS_IT_IS>(piece.length_s, from, (input, piece.change), &terms);
        (at.current_a, at.speed_rad_per_s) = (reached.current_a, reached.speed_rad_per_s);
        if is_kept {
            self.before = Some(Before::new(&self.model.motor, &at, &terms));
        }
        for Varying { effect, values, state } in &mut self.varying {
            if !state.is_empty() {
                effect.advance(values, &self.model.motor, &at, state);
            }
        }
        self.follow::<AS_IT_IS>(piece.length_s, from, &reached);
        reached.mean_a
    }

    /// The motor at the begin of a step.
    #[inline]
    fn instant(&self, index: usize, piece: &Piece, input: Input) -> Instant {
        let (voltage_v, current_a) = match input {
            Input::Voltage(voltage_v) => (voltage_v, self.current_a),
            // A bridge that has just been switched off ends the current of this instant.
            Input::Current(_) if self.data.axis.drive.is_voltage() => (piece.command, self.current_a),
            Input::Current(imposed_a) => (0.0, imposed_a),
        };
        Instant {
            time_s: piece.time_s,
            voltage_v,
            duty: piece.duty,
            mean_duty: piece.mean_duty,
            supply_v: self.data.supply_v[index],
            open: matches!(input, Input::Current(_)),
            current_a,
            speed_rad_per_s: self.speed_rad_per_s,
            middle_rad_per_s: self.speed_rad_per_s + 0.5 * piece.length_s * self.acceleration_rad_per_s2,
            angle_rad: if self.acts_by_angle { self.shaft_rad(piece.angle_rad) } else { 0.0 },
            turned_rad: piece.turned_rad,
            step_s: piece.length_s,
        }
    }

    /// Comes to the end of a step.
    #[inline(always)]
    fn follow<const AS_IT_IS: bool>(&mut self, step_s: f64, from: (f64, f64), reached: &Reached) {
        let Reached { current_a, speed_rad_per_s, mean_a } = *reached;
        if !AS_IT_IS && let Some(filter) = &mut self.filter {
            filter.follow(from.0, reached, step_s);
        }
        if !AS_IT_IS && self.has_window {
            self.lately.push_back(Passed { length_s: step_s, begin_a: from.0, mean_a, end_a: current_a });
        }
        self.acceleration_rad_per_s2 = (speed_rad_per_s - from.1) / step_s;
        self.angle_rad += 0.5 * (from.1 + speed_rad_per_s) * step_s;
        (self.current_a, self.speed_rad_per_s) = (current_a, speed_rad_per_s);
    }

    /// The current as its sensor averages it. Where no edges are simulated, that is left to the reading.
    fn over_window_a(&mut self) -> f64 {
        if !self.has_window {
            return self.current_a;
        }
        let window_s = self.data.origin.current_window_s;
        let (mut charge, mut length_s) = (0.0, 0.0);
        let mut needed = 0;
        let winding_s = TimeConstants::of(&self.model.motor).electromagnetic_s;
        for Passed { length_s: of_step_s, begin_a, mean_a, end_a } in self.lately.iter().rev() {
            let share = ((window_s - length_s) / of_step_s).min(1.0);
            let bulge = Bulge::new(mean_a - 0.5 * (begin_a + end_a), *of_step_s, winding_s);
            charge += of_step_s * in_the_last(share, [*begin_a, *end_a], &bulge);
            length_s += share * of_step_s;
            needed += 1;
            if length_s >= window_s - SAME_LENGTH_S {
                break;
            }
        }
        self.lately.drain(..self.lately.len() - needed);
        if length_s > 0.0 { charge / length_s } else { self.current_a }
    }

    /// Whether a PWM that drives, or a start from rest, comes to another duty.
    #[inline]
    fn changes_duty(&self, duty: f64) -> bool {
        match &self.before {
            Some(before) => before.duty != duty && !before.open,
            None => self.cut.begins_with == (0.0, 0.0),
        }
    }

    /// Where the duty changes, the current is continuous. So its mean jumps by the difference of the ripple. Between the two
    /// directions, and at a start from rest, that is the whole ripple. It decays with the winding, as with a smaller
    /// inductance.
    fn change_duty(&mut self, at: &Instant) {
        let takes_at = self.data.origin.takes_duty_at(at.time_s);
        let above_a = self.before.as_ref().map_or(0.0, |before| self.above_mean_a(before, takes_at, None));
        self.change_ripple(at.duty);
        let motor = &self.model.motor;
        let now = match &self.before {
            Some(before) => before.with(motor, at),
            None => Before::new(motor, at, &Balance::default()),
        };
        self.current_a += above_a - self.above_mean_a(&now, takes_at, None);
    }

    /// The PWM with a duty, which is the same for many steps.
    #[inline]
    fn change_ripple(&mut self, duty: f64) {
        if duty != self.driven.0 {
            self.driven.0 = duty;
            self.driven.1.set_duty(duty);
        }
    }

    /// Current at a share of a period, less its mean; behind a low-pass, if there is one.
    #[inline]
    fn above_mean_a(&self, driven: &Before, share: f64, filter: Option<&Filter>) -> f64 {
        if driven.open || driven.duty == 0.0 {
            return 0.0;
        }
        let since_pulse = share_of_period(share - self.data.origin.pulse.begins_at(driven.duty));
        let course = self.driven.1.course(driven.current_a, &driven.volts);
        match filter {
            None => course.above_mean_a(since_pulse),
            Some(filter) => course.filtered_above_mean_a(since_pulse, filter.memory),
        }
    }
}

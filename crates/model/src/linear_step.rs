//! One step of the linear motor, and what dry losses leave of it.

use super::axis::Input;
use super::pwm_period::{Volts, against};
use crate::catalogue::Balance;
use crate::closed_form::{Family, combine};
use crate::motor::MotorParameters;

/// Recorded times are rounded: times that differ by less are one.
pub const SAME_LENGTH_S: f64 = 1e-9;
/// The same for steps of any length, as a share of it.
const SAME_LENGTH: f64 = 1e-6;
/// So many lengths of steps are kept.
const KEPT: usize = 4;
/// So many times within a step: in straight lines between them the exponential of a winding as quick as a third of the step
/// is exact to a thousandth.
const TIMES: f64 = 64.0;
/// Where a shaft loses less than this share of its speed in a step, few terms of the exponential's series are exact.
const SLIGHT: f64 = 0.01;
/// Steps of Newton's method for a drop with a knee, and how close it comes, as a share of the knee.
const NEWTON_STEPS: usize = 12;
const NEWTON_CLOSENESS: f64 = 1e-3;

/// The linear part over one step: what becomes of current and speed, of a voltage and a torque.
#[derive(Clone, Copy, Debug)]
pub struct LinearStep {
    motor: MotorParameters,
    current_of: [f64; 4],
    speed_of: [f64; 4],
    /// Speed left, and gained of a torque, while the current is imposed.
    open_speed_of: [f64; 2],
    /// Voltage and torque that make a unit of current and of speed.
    inverse_gains: [f64; 2],
    /// Inverse of the resistance.
    conductance_siemens: f64,
    /// Of the winding, over a step.
    inductance_over_step_ohm: f64,
    /// Current that a volt makes at the begin of the step alone, and at its end, where it changes evenly from one to the other.
    falling_and_rising: [f64; 2],
    step_s: f64,
}

/// A voltage that comes to that of the step's end only within the step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Late {
    by_v: f64,
    /// The same of the pulse's share of a period.
    by_share: f64,
    /// Share of the step in which it is missing.
    missing: f64,
    /// Current and speed that a volt would have made in it.
    of_a_volt: [f64; 2],
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
    pub fn new(motor: &MotorParameters, inertia_kg_m2: f64, step_s: f64) -> Self {
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
        let (current_of, speed_of) = (row(0), row(1));
        let inverse_gains = [1.0 / current_of[2], 1.0 / speed_of[3]];
        let rising = combine(weights.second, &rates)[0][0] / (l * step_s);
        Self {
            motor: *motor,
            current_of,
            speed_of,
            open_speed_of: speed_of_torque(b, inertia_kg_m2, step_s),
            inverse_gains,
            conductance_siemens: 1.0 / motor.resistance_ohm,
            inductance_over_step_ohm: l / step_s,
            falling_and_rising: [current_of[2] - rising, rising],
            step_s,
        }
    }

    /// Current and speed at the end of the step, with the input of its end.
    // A simulation calls it in its loop. Returned through memory, its numbers would be waited for.
    #[inline(always)]
    pub fn take(&self, current_a: f64, speed: f64, input: Input, late: Late, terms: &Balance) -> Reached {
        let voltage_v = match input {
            Input::Voltage(voltage_v) => voltage_v,
            Input::Current(imposed_a) => return self.imposed([imposed_a; 2], speed, terms),
        };
        let driving_v = voltage_v + terms.voltage_v;
        let [free_a, free] = self.respond(current_a, speed, driving_v, terms.torque_nm);
        let late_v = if late.by_v == 0.0 {
            0.0
        } else {
            // The drops change with the pulse.
            late.by_v - late.by_share * against(current_a, terms.ripple.drops_of_pulse_v(terms.drops()))
        };
        let free_a = free_a - late_v * late.of_a_volt[0];
        let gain = self.current_of[2];
        let drops = terms.drops();
        let dry_a = terms.ripple.mean_drops_v(drops).map(|drop_v| gain * drop_v);
        let flowing_a = if terms.drops_with_the_mean() {
            let dry_a = dry_a[usize::from(free_a < 0.0)];
            let left_a = eased_a(free_a, dry_a, terms.knee_a);
            turned(current_a, left_a, free_a, || {
                [dry_a * (current_a.abs() / terms.knee_a).tanh(), (free_a - left_a).abs()]
            })
        } else {
            // Where the current touches zero, it follows the volts at once: those at the end of the step count.
            let ahead = || volts(&self.motor, current_a, self.driven(current_a, speed, terms), voltage_v, terms);
            let left_a = terms.ripple.against_drops(free_a, dry_a, (driving_v, drops), ahead);
            if left_a != free_a - dry_a[0] && left_a != free_a + dry_a[1] {
                return self.imposed([current_a, left_a], speed, terms);
            }
            turned(current_a, left_a, free_a, || if current_a < 0.0 { [dry_a[1], dry_a[0]] } else { dry_a })
        };
        let left_a = slowed(current_a, flowing_a, self.falling_and_rising, terms.resistance_ohm);
        let lost_v = (free_a - left_a) * self.inverse_gains[0];
        let free = free - late_v * late.of_a_volt[1] - self.speed_of[2] * lost_v;
        let speed_rad_per_s = oppose_motion(speed, free, self.speed_of[3], terms);
        let lost_nm = (free - speed_rad_per_s) * self.inverse_gains[1];
        let reached_a = left_a - self.current_of[3] * lost_nm;
        // What the resistance takes on the average is what emf and inductance leave of the voltage.
        let emf_v = self.motor.torque_constant_nm_per_a * 0.5 * (speed + speed_rad_per_s);
        let induced_v = self.inductance_over_step_ohm * (reached_a - current_a);
        let mean_a = (driving_v - late_v * late.missing - lost_v - emf_v - induced_v) * self.conductance_siemens;
        Reached { current_a: reached_a, speed_rad_per_s, mean_a }
    }

    /// The same of the linear motor alone, without dry losses.
    #[inline]
    pub fn respond(&self, current_a: f64, speed: f64, voltage_v: f64, torque_nm: f64) -> [f64; 2] {
        let inputs = [current_a, speed, voltage_v, torque_nm];
        let dot = |row: &[f64; 4]| row[0] * inputs[0] + row[1] * inputs[1] + row[2] * inputs[2] + row[3] * inputs[3];
        [dot(&self.current_of), dot(&self.speed_of)]
    }

    /// Speed at the end of the step of the linear motor through which no current flows.
    #[inline]
    pub fn speed_without_current(&self, speed: f64, torque_nm: f64) -> f64 {
        self.open_speed_of[0] * speed + self.open_speed_of[1] * torque_nm
    }

    /// The same where the current changes evenly from one to another, whatever the winding is.
    #[inline]
    fn imposed(&self, [from_a, to_a]: [f64; 2], speed: f64, terms: &Balance) -> Reached {
        let mean_a = 0.5 * (from_a + to_a);
        Reached { current_a: to_a, speed_rad_per_s: self.driven(mean_a, speed, terms), mean_a }
    }

    /// Speed at the end of the step with this mean current.
    #[inline]
    fn driven(&self, mean_a: f64, speed: f64, terms: &Balance) -> f64 {
        let torque_nm = terms.torque_nm + self.motor.torque_constant_nm_per_a * mean_a;
        let free = self.speed_without_current(speed, torque_nm);
        oppose_motion(speed, free, self.open_speed_of[1], terms)
    }
}

/// What drives the current through a period of the PWM. What effects lose in a resistance counts as back-EMF: it is not in
/// the time constant of the winding.
#[inline]
pub fn volts(motor: &MotorParameters, current_a: f64, speed: f64, voltage_v: f64, terms: &Balance) -> Volts {
    Volts {
        mean_v: voltage_v + terms.voltage_v,
        emf_v: motor.torque_constant_nm_per_a * speed + terms.resistance_ohm * current_a,
        lost_v: motor.resistance_ohm * current_a,
        drops: terms.drops(),
    }
}

/// Steps of one motor, and what it does with a volt: each is computed once.
#[derive(Clone, Debug)]
pub struct LinearSteps {
    motor: MotorParameters,
    inertia_kg_m2: f64,
    /// Of the last lengths that were asked for.
    kept: Vec<LinearStep>,
    last: usize,
    /// Current and speed of a volt after evenly spaced times.
    of_a_volt: Vec<[f64; 2]>,
    longest_s: f64,
    /// How many of these times there are in a second.
    times_per_s: f64,
}

impl LinearSteps {
    /// With `inertia_kg_m2` at the motor's own shaft.
    pub fn new(motor: &MotorParameters, inertia_kg_m2: f64) -> Self {
        Self {
            motor: *motor,
            inertia_kg_m2,
            kept: Vec::new(),
            last: 0,
            of_a_volt: Vec::new(),
            longest_s: 0.0,
            times_per_s: 0.0,
        }
    }

    /// A step of `step_s`, as [`LinearStep::new`].
    #[inline]
    pub fn of_length(&mut self, step_s: f64) -> &LinearStep {
        let is_it = |kept: &LinearStep| (kept.step_s - step_s).abs() <= SAME_LENGTH * step_s;
        match self.kept.iter().position(is_it) {
            Some(index) => &self.kept[index],
            None => self.another(step_s),
        }
    }

    /// A voltage that changes by `by_v`, and the pulse by `by_share` of a period, `rest_s` before the end of a step.
    #[inline]
    pub fn late(&mut self, [step_s, rest_s]: [f64; 2], [by_v, by_share]: [f64; 2]) -> Late {
        if step_s > self.longest_s {
            self.look_ahead(step_s);
        }
        let (whole, rest) = (self.of_a_volt(step_s), self.of_a_volt(rest_s));
        let of_a_volt = [whole[0] - rest[0], whole[1] - rest[1]];
        Late { by_v, by_share, missing: 1.0 - rest_s / step_s, of_a_volt }
    }

    #[cold]
    fn look_ahead(&mut self, longest_s: f64) {
        let after = |time: usize| match time {
            0 => [0.0; 2],
            _ => {
                let LinearStep { current_of, speed_of, .. } =
                    LinearStep::new(&self.motor, self.inertia_kg_m2, time as f64 / TIMES * longest_s);
                [current_of[2], speed_of[2]]
            }
        };
        self.of_a_volt = (0..=TIMES as usize + 1).map(after).collect();
        self.longest_s = longest_s;
        self.times_per_s = TIMES / longest_s;
    }

    /// In straight lines between the times.
    #[inline]
    fn of_a_volt(&self, after_s: f64) -> [f64; 2] {
        let at = after_s * self.times_per_s;
        let time = at as usize;
        let share = at - time as f64;
        let [from, to] = [0, 1].map(|next| self.of_a_volt[time + next]);
        [0, 1].map(|place| from[place] + share * (to[place] - from[place]))
    }

    #[cold]
    fn another(&mut self, step_s: f64) -> &LinearStep {
        let step = LinearStep::new(&self.motor, self.inertia_kg_m2, step_s);
        if self.kept.len() < KEPT {
            self.kept.push(step);
            return &self.kept[self.kept.len() - 1];
        }
        self.last = (self.last + 1) % KEPT;
        self.kept[self.last] = step;
        &self.kept[self.last]
    }
}

/// The speed left after a step, and gained of a torque over it, whatever the current does.
pub(crate) fn speed_of_torque(viscous_nm_s: f64, inertia_kg_m2: f64, step_s: f64) -> [f64; 2] {
    let b = viscous_nm_s;
    let without_loss = step_s / inertia_kg_m2;
    let lost = b * without_loss;
    if lost.abs() < SLIGHT {
        // The first terms of the series, whose rest is beyond the twelfth digit.
        let series = 1.0
            - lost * (1.0 / 2.0) * (1.0 - lost * (1.0 / 3.0) * (1.0 - lost * (1.0 / 4.0) * (1.0 - lost * (1.0 / 5.0))));
        let gained = without_loss * series;
        return [1.0 - b * gained, gained];
    }
    let decay = (-lost).exp();
    [decay, (1.0 - decay) / b]
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
pub fn oppose_motion(before: f64, free: f64, gain: f64, terms: &Balance) -> f64 {
    let forward = gain * terms.dry_forward_nm.max(0.0);
    let backward = gain * terms.dry_backward_nm.max(0.0);
    let moving = if free > forward { free - forward } else { (free + backward).min(0.0) };
    let turned = turned(before, moving, free, || if before > 0.0 { [forward, backward] } else { [backward, forward] });
    slowed(before, turned, [0.5 * gain; 2], terms.viscous_nm_s)
}

/// What a loss in proportion to a value leaves of it, where the value changes evenly from `before` over the step; `gains`: of
/// the loss at its begin and at its end. Mostly there is none, and a quotient takes long.
#[inline]
fn slowed(before: f64, without: f64, gains: [f64; 2], loss: f64) -> f64 {
    if loss == 0.0 {
        return without;
    }
    let left = (without - gains[0] * loss * before) / (1.0 + gains[1] * loss);
    // A loss alone does not turn a value round.
    if left * without >= 0.0 { left } else { without / (1.0 + (gains[0] + gains[1]) * loss) }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pwm_period::Ripple;

    /// What a current-controlled drive imposes makes its torque whatever winding is behind it.
    #[test]
    fn an_imposed_current_moves_the_shaft_without_the_winding() {
        let motor = MotorParameters { viscous_friction_nm_s: 2e-4, ..MotorParameters::PIVT6 };
        let other = MotorParameters { resistance_ohm: 100.0, inductance_h: 1.0, ..motor };
        let after = |motor: &MotorParameters| {
            let step = LinearStep::new(motor, motor.inertia_kg_m2, 0.05);
            step.take(3.0, 10.0, Input::Current(0.5), Late::default(), &Balance::default())
        };
        let reached = after(&motor);
        assert_eq!((reached.current_a, reached.mean_a), (0.5, 0.5));
        assert_eq!(reached.speed_rad_per_s, after(&other).speed_rad_per_s);
        let steady = 0.5 * motor.torque_constant_nm_per_a / motor.viscous_friction_nm_s;
        let left = (-0.05 * motor.viscous_friction_nm_s / motor.inertia_kg_m2).exp();
        assert!((reached.speed_rad_per_s - (steady + (10.0 - steady) * left)).abs() < 1e-9);
    }

    /// A resistance of an effect beside the winding, as if it were of the winding.
    #[test]
    fn a_resistance_of_an_effect_is_one_of_the_winding() {
        let motor = MotorParameters::PIVT6;
        let wider = MotorParameters { resistance_ohm: motor.resistance_ohm + 1.5, ..motor };
        let terms = Balance { resistance_ohm: 1.5, ..Balance::default() };
        let after = |motor: &MotorParameters, terms: &Balance| {
            let step = LinearStep::new(motor, motor.inertia_kg_m2, 2e-4);
            let input = Input::Voltage(12.0);
            step.take(0.3, 20.0, input, Late::default(), terms).current_a
        };
        let (exact_a, found_a) = (after(&wider, &Balance::default()), after(&motor, &terms));
        let taken_a = after(&motor, &Balance::default()) - exact_a;
        assert!((found_a - exact_a).abs() < 0.03 * taken_a, "{found_a} {exact_a} {taken_a}");
    }

    /// One step with a voltage that changes within it leads where two steps do.
    #[test]
    fn a_voltage_that_changes_within_a_step_acts_when_it_does() {
        let motor = MotorParameters::PIVT6;
        let step = |step_s: f64| LinearStep::new(&motor, motor.inertia_kg_m2, step_s);
        let terms = Balance::default();
        for rest_s in [0.1e-3, 0.37e-3, 0.99e-3] {
            let first = step(1e-3 - rest_s).take(0.2, 30.0, Input::Voltage(5.0), Late::default(), &terms);
            let input = Input::Voltage(5.8);
            let rest = step(rest_s).take(first.current_a, first.speed_rad_per_s, input, Late::default(), &terms);
            let late = LinearSteps::new(&motor, motor.inertia_kg_m2).late([1e-3, rest_s], [0.8, 0.0]);
            let one = step(1e-3).take(0.2, 30.0, input, late, &terms);
            assert!((one.current_a - rest.current_a).abs() < 1e-5, "{rest_s}: {one:?} {rest:?}");
            assert!((one.speed_rad_per_s - rest.speed_rad_per_s).abs() < 1e-4, "{rest_s}: {one:?} {rest:?}");
            let mean_a = ((1e-3 - rest_s) * first.mean_a + rest_s * rest.mean_a) / 1e-3;
            assert!((one.mean_a - mean_a).abs() < 1e-3, "{rest_s}: {one:?} {mean_a}");
        }
    }

    /// While the current touches zero in each period, it follows command, speed and friction, in long steps as in short ones.
    #[test]
    fn a_current_that_touches_zero_follows_in_long_steps() {
        let motor = MotorParameters::PIVT6;
        let friction_nm = 0.01 * motor.torque_constant_nm_per_a;
        let course = |parts: u32| {
            let step = LinearStep::new(&motor, motor.inertia_kg_m2, 1e-3 / f64::from(parts));
            let (mut current_a, mut speed) = (0.0, 60.0);
            let mut course = Vec::new();
            for row in 0..400 {
                let duty = 0.5 - 0.2 * (f64::from(row) * 0.02).sin();
                let ripple = Ripple::new(motor.inductance_h, motor.resistance_ohm, 980.0).with_duty(duty);
                let terms = Balance {
                    dry_drop_v: 1.5,
                    resistance_ohm: 0.8,
                    ripple: &ripple,
                    dry_forward_nm: friction_nm,
                    dry_backward_nm: friction_nm,
                    ..Balance::default()
                };
                for _ in 0..parts {
                    let reached = step.take(current_a, speed, Input::Voltage(12.0 * duty), Late::default(), &terms);
                    (current_a, speed) = (reached.current_a, reached.speed_rad_per_s);
                }
                course.push([current_a, speed]);
            }
            course
        };
        let (long, short) = (course(1), course(16));
        let error = |place: usize| {
            let squares = long.iter().zip(&short).map(|(long, short)| (long[place] - short[place]).powi(2));
            (squares.sum::<f64>() / long.len() as f64).sqrt()
        };
        assert!(error(0) < 1e-3 && error(1) < 0.15, "{} A, {} rad/s", error(0), error(1));
    }

    /// Until the current has turned round, its drop works the other way.
    #[test]
    fn a_drop_turns_round_with_the_current_within_a_step() {
        let motor = MotorParameters::PIVT6;
        let after = |steps: i32, terms: &Balance| {
            let step = LinearStep::new(&motor, motor.inertia_kg_m2, 2e-4 / f64::from(steps));
            (0..steps).fold((0.15, 0.0), |(current_a, speed), _| {
                let reached = step.take(current_a, speed, Input::Voltage(-12.0), Late::default(), terms);
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

    /// With hardly any loss, and with much of it.
    #[test]
    fn a_torque_gains_a_speed_by_an_exponential() {
        let (inertia_kg_m2, step_s) = (4e-5, 1e-3);
        for lost in [0.0, 1e-9, 1e-4, 0.9 * SLIGHT, 1.1 * SLIGHT, 1.0, 50.0_f64] {
            let viscous_nm_s = lost * inertia_kg_m2 / step_s;
            let [left, gained] = speed_of_torque(viscous_nm_s, inertia_kg_m2, step_s);
            let exact = if lost > 0.0 { -(-lost).exp_m1() / viscous_nm_s } else { step_s / inertia_kg_m2 };
            assert!((left - (-lost).exp()).abs() < 1e-12, "{lost}: {left}");
            assert!((gained / exact - 1.0).abs() < 1e-11, "{lost}: {gained} {exact}");
        }
    }
}

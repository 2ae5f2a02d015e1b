//! One step of the linear motor, and what dry losses leave of it.

use super::axis::Input;
use super::pwm_period::Volts;
use crate::catalogue::Balance;
use crate::closed_form::{Family, combine};
use crate::motor::MotorParameters;

/// Recorded times are rounded: steps that differ by less are of one length.
pub const SAME_LENGTH_S: f64 = 1e-9;
/// Steps of Newton's method for a drop with a knee, and how close it comes, as a share of the knee.
const NEWTON_STEPS: usize = 12;
const NEWTON_CLOSENESS: f64 = 1e-3;

/// The linear part over one step: what becomes of current and speed, of a voltage and a torque.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinearStep {
    current_of: [f64; 4],
    speed_of: [f64; 4],
    /// Speed left, and gained of a torque, while the current is imposed.
    open_speed_of: [f64; 2],
    /// Voltage and torque that make a unit of current and of speed.
    inverse_gains: [f64; 2],
    resistance_ohm: f64,
    /// Its inverse.
    conductance_siemens: f64,
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
        Self {
            current_of,
            speed_of,
            open_speed_of: speed_of_torque(b, inertia_kg_m2, step_s),
            inverse_gains,
            resistance_ohm: motor.resistance_ohm,
            conductance_siemens: 1.0 / motor.resistance_ohm,
            torque_constant_nm_per_a: k,
            inductance_over_step_ohm: l / step_s,
            step_s,
        }
    }

    /// The same with steps of `step_s`, computed anew where that is another length.
    pub fn set_length(&mut self, motor: &MotorParameters, inertia_kg_m2: f64, step_s: f64) {
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
    pub fn volts(&self, current_a: f64, speed: f64, voltage_v: f64, terms: &Balance) -> Volts {
        Volts {
            mean_v: voltage_v + terms.voltage_v,
            emf_v: self.torque_constant_nm_per_a * speed,
            lost_v: (self.resistance_ohm + terms.resistance_ohm) * current_a,
            drops: terms.drops(),
        }
    }

    /// Current and speed at the end of the step.
    // A simulation calls it in its loop. Returned through memory, its numbers would be waited for.
    #[inline(always)]
    pub fn take(&self, current_a: f64, speed: f64, input: Input, terms: &Balance) -> Reached {
        let voltage_v = match input {
            Input::Voltage(voltage_v) => voltage_v,
            Input::Current(imposed_a) => {
                let torque_nm = terms.torque_nm + self.torque_constant_nm_per_a * imposed_a;
                let free = self.open_speed_of[0] * speed + self.open_speed_of[1] * torque_nm;
                let speed_rad_per_s = oppose_motion(speed, free, self.open_speed_of[1], terms);
                return Reached { current_a: imposed_a, speed_rad_per_s, mean_a: imposed_a };
            }
        };
        let inputs = [current_a, speed, voltage_v + terms.voltage_v, terms.torque_nm];
        let dot = |row: &[f64; 4]| row[0] * inputs[0] + row[1] * inputs[1] + row[2] * inputs[2] + row[3] * inputs[3];
        let free_a = dot(&self.current_of);
        let gain = self.current_of[2];
        let dry_a = terms.ripple.mean_drops_v(terms.drops()).map(|drop_v| gain * drop_v);
        let before_and_after = || if current_a < 0.0 { [dry_a[1], dry_a[0]] } else { dry_a };
        let flowing_a = match terms.drops_with_the_mean() {
            true => {
                let dry_a = dry_a[usize::from(free_a < 0.0)];
                let left_a = eased_a(free_a, dry_a, terms.knee_a);
                turned(current_a, left_a, free_a, || {
                    [dry_a * (current_a.abs() / terms.knee_a).tanh(), (free_a - left_a).abs()]
                })
            }
            false => {
                let left_a =
                    terms.ripple.against_drops(free_a, dry_a, || self.volts(current_a, speed, voltage_v, terms));
                // One that hangs on what pulses leave has no time of its own.
                let is_whole = left_a == free_a - dry_a[0] || left_a == free_a + dry_a[1];
                if is_whole { turned(current_a, left_a, free_a, before_and_after) } else { left_a }
            }
        };
        let left_a = slowed(flowing_a, gain * terms.resistance_ohm);
        let lost_v = (free_a - left_a) * self.inverse_gains[0];
        let free = dot(&self.speed_of) - self.speed_of[2] * lost_v;
        let speed_rad_per_s = oppose_motion(speed, free, self.speed_of[3], terms);
        let lost_nm = (free - speed_rad_per_s) * self.inverse_gains[1];
        let reached_a = left_a - self.current_of[3] * lost_nm;
        // What the resistance takes on the average is what emf and inductance leave of the voltage.
        let emf_v = self.torque_constant_nm_per_a * 0.5 * (speed + speed_rad_per_s);
        let induced_v = self.inductance_over_step_ohm * (reached_a - current_a);
        let mean_a = (inputs[2] - lost_v - emf_v - induced_v) * self.conductance_siemens;
        Reached { current_a: reached_a, speed_rad_per_s, mean_a }
    }
}

/// The speed left after a step, and gained of a torque over it, whatever the current does.
pub(crate) fn speed_of_torque(viscous_nm_s: f64, inertia_kg_m2: f64, step_s: f64) -> [f64; 2] {
    let b = viscous_nm_s;
    let decay = (-b / inertia_kg_m2 * step_s).exp();
    [decay, if b > 0.0 { (1.0 - decay) / b } else { step_s / inertia_kg_m2 }]
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
    slowed(turned, gain * terms.viscous_nm_s)
}

/// What a loss proportional to a value leaves of it. Mostly there is none, and a quotient takes long.
#[inline]
fn slowed(value: f64, loss: f64) -> f64 {
    if loss == 0.0 { value } else { value / (1.0 + loss) }
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

    /// What a current-controlled drive imposes makes its torque whatever winding is behind it.
    #[test]
    fn an_imposed_current_moves_the_shaft_without_the_winding() {
        let motor = MotorParameters { viscous_friction_nm_s: 2e-4, ..MotorParameters::PIVT6 };
        let other = MotorParameters { resistance_ohm: 100.0, inductance_h: 1.0, ..motor };
        let after = |motor: &MotorParameters| {
            let step = LinearStep::new(motor, motor.inertia_kg_m2, 0.05);
            step.take(3.0, 10.0, Input::Current(0.5), &Balance::default())
        };
        let reached = after(&motor);
        assert_eq!((reached.current_a, reached.mean_a), (0.5, 0.5));
        assert_eq!(reached.speed_rad_per_s, after(&other).speed_rad_per_s);
        let steady = 0.5 * motor.torque_constant_nm_per_a / motor.viscous_friction_nm_s;
        let left = (-0.05 * motor.viscous_friction_nm_s / motor.inertia_kg_m2).exp();
        assert!((reached.speed_rad_per_s - (steady + (10.0 - steady) * left)).abs() < 1e-9);
    }

    /// Until the current has turned round, its drop works the other way.
    #[test]
    fn a_drop_turns_round_with_the_current_within_a_step() {
        let motor = MotorParameters::PIVT6;
        let after = |steps: i32, terms: &Balance| {
            let step = LinearStep::new(&motor, motor.inertia_kg_m2, 2e-4 / f64::from(steps));
            (0..steps).fold((0.15, 0.0), |(current_a, speed), _| {
                let reached = step.take(current_a, speed, Input::Voltage(-12.0), terms);
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
}

//! One step of the motor between two edges of its PWM. Within it the voltage is constant, and the speed changes little: the
//! current is an exponential. Where it comes to zero, its drop holds it there or it goes on in the other direction.

use super::linear_step::{Reached, SAME_LENGTH_S, oppose_motion, speed_of_torque};
use crate::catalogue::Balance;
use crate::motor::MotorParameters;
use crate::pwm_period::against;

/// The back-EMF of a step is that of its mean speed, which depends on the current: found in so many rounds.
const ROUNDS: usize = 2;
/// The least resistance, as a share of the winding's: an effect may take some of it away.
const LEAST_RESISTANCE: f64 = 0.05;

/// Steps of one length.
#[derive(Clone, Copy, Debug, Default)]
pub struct SwitchedStep {
    resistance_ohm: f64,
    inductance_h: f64,
    torque_constant_nm_per_a: f64,
    /// Speed left, and gained of a torque.
    speed_of: [f64; 2],
    step_s: f64,
}

impl SwitchedStep {
    /// For steps of `step_s`, with `inertia_kg_m2` at the motor's own shaft.
    pub fn new(motor: &MotorParameters, inertia_kg_m2: f64, step_s: f64) -> Self {
        Self {
            resistance_ohm: motor.resistance_ohm,
            inductance_h: motor.inductance_h,
            torque_constant_nm_per_a: motor.torque_constant_nm_per_a,
            speed_of: speed_of_torque(motor, inertia_kg_m2, step_s),
            step_s,
        }
    }

    /// The same with steps of `step_s`, computed anew where that is another length.
    pub fn set_length(&mut self, motor: &MotorParameters, inertia_kg_m2: f64, step_s: f64) {
        if (step_s - self.step_s).abs() > SAME_LENGTH_S {
            *self = Self::new(motor, inertia_kg_m2, step_s);
        }
    }

    /// Current and speed at the end of the step, at this voltage of the bridge.
    pub fn take(&self, current_a: f64, speed: f64, voltage_v: f64, terms: &Balance) -> Reached {
        let k = self.torque_constant_nm_per_a;
        let drops_v = terms.ripple.mean_drops_v(terms.drops());
        let resistance_ohm = (self.resistance_ohm + terms.resistance_ohm).max(LEAST_RESISTANCE * self.resistance_ohm);
        let winding = Winding { resistance_ohm, time_s: self.inductance_h / resistance_ohm, drops_v };
        let mut reached = Reached { current_a, speed_rad_per_s: speed, mean_a: current_a };
        for _ in 0..ROUNDS {
            let emf_v = 0.5 * k * (speed + reached.speed_rad_per_s);
            let (current_a, charge) = winding.flow(current_a, voltage_v + terms.voltage_v - emf_v, self.step_s);
            let mean_a = charge / self.step_s;
            let [decay, gain] = self.speed_of;
            let free = decay * speed + gain * (terms.torque_nm + k * mean_a);
            reached = Reached { current_a, speed_rad_per_s: oppose_motion(speed, free, gain, terms), mean_a };
        }
        reached
    }
}

/// What a voltage drives a current through.
struct Winding {
    resistance_ohm: f64,
    /// Its time constant.
    time_s: f64,
    /// Of a positive and of a negative current.
    drops_v: [f64; 2],
}

impl Winding {
    /// The current after some time at a constant voltage, and the charge until then.
    fn flow(&self, from_a: f64, driving_v: f64, length_s: f64) -> (f64, f64) {
        if from_a == 0.0 {
            return self.rise(driving_v, length_s);
        }
        let towards_a = (driving_v - against(from_a, self.drops_v)) / self.resistance_ohm;
        let decay = (-length_s / self.time_s).exp();
        let end_a = towards_a + (from_a - towards_a) * decay;
        if end_a * from_a >= 0.0 {
            return (end_a, towards_a * length_s + (from_a - towards_a) * self.time_s * (1.0 - decay));
        }
        let zero_s = self.time_s * (1.0 - from_a / towards_a).ln();
        let (end_a, charge) = self.rise(driving_v, length_s - zero_s);
        (end_a, charge + towards_a * zero_s + from_a * self.time_s)
    }

    /// The same from zero.
    fn rise(&self, driving_v: f64, length_s: f64) -> (f64, f64) {
        let [forward_v, backward_v] = self.drops_v;
        let left_v = (driving_v - forward_v).max(0.0) + (driving_v + backward_v).min(0.0);
        let towards_a = left_v / self.resistance_ohm;
        let risen = -(-length_s / self.time_s).exp_m1();
        (towards_a * risen, towards_a * (length_s - self.time_s * risen))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        /// As in a thousand short steps, whether the current reverses, is held at zero or neither.
        #[test]
        fn one_step_is_as_exact_as_many(
            current_a in -1.0_f64..1.0,
            speed in -100.0_f64..100.0,
            voltage_v in prop_oneof![Just(0.0), Just(12.0), Just(-12.0)],
            drop_v in 0.0_f64..14.0,
            friction_nm in 0.0_f64..0.01,
        ) {
            let motor = MotorParameters::PIVT6;
            let after = |steps: u32| {
                let step = SwitchedStep::new(&motor, motor.inertia_kg_m2, 1e-3 / f64::from(steps));
                let terms = Balance {
                    dry_drop_v: drop_v, dry_forward_nm: friction_nm, dry_backward_nm: friction_nm, ..Balance::default()
                };
                let start = Reached { current_a, speed_rad_per_s: speed, mean_a: 0.0 };
                (0..steps).fold(start, |at, _| {
                    let next = step.take(at.current_a, at.speed_rad_per_s, voltage_v, &terms);
                    Reached { mean_a: at.mean_a + next.mean_a / f64::from(steps), ..next }
                })
            };
            let (one, many) = (after(1), after(1000));
            prop_assert!((one.current_a - many.current_a).abs() < 5e-3, "{one:?} {many:?}");
            prop_assert!((one.mean_a - many.mean_a).abs() < 5e-3, "{one:?} {many:?}");
            // A shaft that friction stops stands for the rest of the step, whatever drives it on.
            let greatest_nm = motor.torque_constant_nm_per_a * current_a.abs().max(many.current_a.abs());
            let is_stopped = one.speed_rad_per_s == 0.0 && speed * many.speed_rad_per_s < 0.0;
            let stands = if is_stopped { 1e-3 * greatest_nm / motor.inertia_kg_m2 } else { 0.0 };
            prop_assert!((one.speed_rad_per_s - many.speed_rad_per_s).abs() < 0.2 + stands, "{one:?} {many:?}");
        }
    }
}

//! One step of the motor between two edges of its PWM. Within it the voltage is constant, and the speed changes little: the
//! current is an exponential. Where it comes to zero, its drop holds it there or it goes on in the other direction.

use super::linear_step::{Reached, SAME_LENGTH_S, speed_of_torque};
use crate::catalogue::Balance;
use crate::motor::MotorParameters;
use crate::pwm_period::against;

/// The back-EMF of a step is that of its mean speed, which depends on the current: found in so many rounds. So is the time at
/// which the shaft stops.
const ROUNDS: usize = 2;
/// The least resistance, as a share of the winding's: an effect may take some of it away.
const LEAST_RESISTANCE: f64 = 0.05;
/// A shaft that stops in a step, stands and starts the other way has three phases; it may do so again.
const MOST_PHASES: usize = 6;

/// Steps of a motor.
#[derive(Clone, Copy, Debug)]
pub struct SwitchedStep {
    resistance_ohm: f64,
    inductance_h: f64,
    torque_constant_nm_per_a: f64,
    viscous_friction_nm_s: f64,
    inertia_kg_m2: f64,
    step_s: f64,
    /// Speed left after a whole step, and gained of a torque.
    speed_of: [f64; 2],
}

/// How long the shaft moves one way or stands, and what that makes of speed and current.
#[derive(Clone, Copy)]
struct Length {
    length_s: f64,
    /// Its inverse; of no length something finite, so that no charge in no time is no current.
    per_s: f64,
    /// Speed left, and gained of a torque.
    speed_of: [f64; 2],
    /// Share of the current that is left.
    current_left: f64,
}

/// A current and a speed, and the charge that has flowed until then.
#[derive(Clone, Copy)]
struct State {
    current_a: f64,
    speed: f64,
    charge: f64,
}

impl SwitchedStep {
    /// Of a motor with `inertia_kg_m2` at its own shaft, for steps of `step_s`.
    pub fn new(motor: &MotorParameters, inertia_kg_m2: f64, step_s: f64) -> Self {
        let mut step = Self {
            resistance_ohm: motor.resistance_ohm,
            inductance_h: motor.inductance_h,
            torque_constant_nm_per_a: motor.torque_constant_nm_per_a,
            viscous_friction_nm_s: motor.viscous_friction_nm_s,
            inertia_kg_m2,
            step_s: f64::NAN,
            speed_of: [0.0; 2],
        };
        step.set_length(step_s);
        step
    }

    /// The same with steps of `step_s`.
    #[inline]
    pub fn set_length(&mut self, step_s: f64) {
        if (step_s - self.step_s).abs() <= SAME_LENGTH_S {
            return;
        }
        self.step_s = step_s;
        self.speed_of = speed_of_torque(self.viscous_friction_nm_s, self.inertia_kg_m2, step_s);
    }

    /// Current and speed at the end of the step, at this voltage of the bridge.
    pub fn take(&self, current_a: f64, speed: f64, voltage_v: f64, terms: &Balance) -> Reached {
        let drops_v = terms.ripple.mean_drops_v(terms.drops());
        let resistance_ohm = (self.resistance_ohm + terms.resistance_ohm).max(LEAST_RESISTANCE * self.resistance_ohm);
        let shaft = Shaft {
            step: self,
            winding: Winding {
                conductance_siemens: 1.0 / resistance_ohm,
                time_s: self.inductance_h / resistance_ohm,
                drops_v,
            },
            driving_v: voltage_v + terms.voltage_v,
            terms,
        };
        let (from, whole) = (State { current_a, speed, charge: 0.0 }, shaft.length_of(self.step_s, self.speed_of));
        match shaft.sense(from).and_then(|sense| shaft.keeps_moving(from, sense, &whole)) {
            Some(end) => self.reached(end),
            None => self.reached(shaft.in_phases(from, whole)),
        }
    }

    #[inline]
    fn reached(&self, state: State) -> Reached {
        Reached { current_a: state.current_a, speed_rad_per_s: state.speed, mean_a: state.charge / self.step_s }
    }
}

/// The motor at one voltage of the bridge.
struct Shaft<'a> {
    step: &'a SwitchedStep,
    winding: Winding,
    /// Without the back-EMF.
    driving_v: f64,
    terms: &'a Balance<'a>,
}

impl Shaft<'_> {
    fn length(&self, length_s: f64) -> Length {
        let SwitchedStep { viscous_friction_nm_s, inertia_kg_m2, .. } = *self.step;
        self.length_of(length_s, speed_of_torque(viscous_friction_nm_s, inertia_kg_m2, length_s))
    }

    #[inline]
    fn length_of(&self, length_s: f64, speed_of: [f64; 2]) -> Length {
        let current_left = (-length_s / self.winding.time_s).exp();
        Length { length_s, per_s: 1.0 / length_s.max(f64::MIN_POSITIVE), speed_of, current_left }
    }

    /// Through a step in which the shaft may stop or start.
    fn in_phases(&self, mut state: State, mut left: Length) -> State {
        for _ in 0..MOST_PHASES {
            let (next, passed_s) = self.phase(state, &left);
            state = next;
            if passed_s >= left.length_s {
                return state;
            }
            left = self.length(left.length_s - passed_s);
        }
        self.standing(state, &left)
    }

    /// The direction in which a shaft moves or starts.
    #[inline]
    fn sense(&self, from: State) -> Option<f64> {
        if from.speed == 0.0 { self.breaks_free(from.current_a) } else { Some(from.speed.signum()) }
    }

    /// Until the shaft stops or starts, or for the whole length: what is reached, and after what time.
    fn phase(&self, from: State, length: &Length) -> (State, f64) {
        match self.sense(from) {
            Some(sense) => self.moving(from, sense, length),
            None => self.at_rest(from, length),
        }
    }

    /// The same of a shaft that rests.
    fn at_rest(&self, from: State, length: &Length) -> (State, f64) {
        let end = self.standing(from, length);
        let Some(sense) = self.breaks_free(end.current_a) else { return (end, length.length_s) };
        let against_nm = sense * self.friction_nm(sense) - self.terms.torque_nm;
        let least_a = against_nm / self.step.torque_constant_nm_per_a;
        let stood_s = self.winding.time_to(from.current_a, self.driving_v, least_a).clamp(0.0, length.length_s);
        if stood_s >= length.length_s {
            return (end, length.length_s);
        }
        let start = self.standing(from, &self.length(stood_s));
        let (end, moved_s) = self.moving(start, sense, &self.length(length.length_s - stood_s));
        (end, stood_s + moved_s)
    }

    /// The direction in which a standing shaft starts at this current, if it does.
    fn breaks_free(&self, current_a: f64) -> Option<f64> {
        let torque_nm = self.terms.torque_nm + self.step.torque_constant_nm_per_a * current_a;
        let sense = torque_nm.signum();
        (torque_nm.abs() > self.friction_nm(sense)).then_some(sense)
    }

    /// Dry friction against motion in a direction.
    fn friction_nm(&self, sense: f64) -> f64 {
        if sense > 0.0 { self.terms.dry_forward_nm.max(0.0) } else { self.terms.dry_backward_nm.max(0.0) }
    }

    /// Of a shaft that stands.
    fn standing(&self, from: State, length: &Length) -> State {
        let (current_a, charge) = self.winding.flow(from.current_a, self.driving_v, length);
        State { current_a, speed: 0.0, charge: from.charge + charge }
    }

    /// What is reached in the direction of the motion, if the shaft does not stop.
    // Inlined, and apart from a stop: its numbers stay in registers. Those that pass through memory are waited for.
    #[inline(always)]
    fn keeps_moving(&self, from: State, sense: f64, length: &Length) -> Option<State> {
        let end = self.moved(from, sense, length);
        // The speed on the way is taken for a parabola. It lies above its chord or above its tangent: mostly neither comes to zero.
        let on_tangent = from.speed + self.acceleration(from, sense) * length.length_s;
        (sense * end.speed >= 0.0 && sense * on_tangent >= 0.0).then_some(end)
    }

    /// Of a shaft that moves in a direction.
    #[inline]
    fn acceleration(&self, from: State, sense: f64) -> f64 {
        let slowing_nm_s = self.step.viscous_friction_nm_s + self.terms.viscous_nm_s;
        let torque_nm = self.driving_nm(from.current_a, sense) - slowing_nm_s * from.speed;
        torque_nm / self.step.inertia_kg_m2
    }

    /// Of a shaft that moves one way, until it stops.
    fn moving(&self, from: State, sense: f64, length: &Length) -> (State, f64) {
        if let Some(end) = self.keeps_moving(from, sense, length) {
            return (end, length.length_s);
        }
        let (end, acceleration) = (self.moved(from, sense, length), self.acceleration(from, sense));
        let (mut reached, mut passed_s) = (end, length.length_s);
        for _ in 0..ROUNDS {
            let curvature = ((reached.speed - from.speed) / passed_s - acceleration) / passed_s;
            let stops = first_root(sense * from.speed, sense * acceleration, sense * curvature);
            match stops.filter(|stops_s| *stops_s < length.length_s) {
                Some(stops_s) => passed_s = stops_s,
                None if sense * end.speed >= 0.0 => return (end, length.length_s),
                None => break,
            }
            reached = self.moved(from, sense, &self.length(passed_s));
        }
        (State { speed: 0.0, ..reached }, passed_s)
    }

    /// Torque on a shaft that moves in a direction.
    fn driving_nm(&self, current_a: f64, sense: f64) -> f64 {
        self.terms.torque_nm + self.step.torque_constant_nm_per_a * current_a - sense * self.friction_nm(sense)
    }

    /// The same, whether it stops or not.
    #[inline(always)]
    fn moved(&self, from: State, sense: f64, length: &Length) -> State {
        let k = self.step.torque_constant_nm_per_a;
        let [decay, gain] = length.speed_of;
        let slowed = 1.0 / (1.0 + gain * self.terms.viscous_nm_s);
        let mut end = from;
        for _ in 0..ROUNDS {
            let emf_v = 0.5 * k * (from.speed + end.speed);
            let (current_a, charge) = self.winding.flow(from.current_a, self.driving_v - emf_v, length);
            let free = decay * from.speed + gain * self.driving_nm(charge * length.per_s, sense);
            end = State { current_a, speed: slowed * free, charge: from.charge + charge };
        }
        end
    }
}

/// After what time `value + slope t + curvature t^2` becomes zero, if it does.
fn first_root(value: f64, slope: f64, curvature: f64) -> Option<f64> {
    let root = (slope * slope - 4.0 * value * curvature).sqrt();
    let after = if slope > 0.0 { -0.5 * (slope + root) / curvature } else { 2.0 * value / (root - slope) };
    (after >= 0.0).then_some(after)
}

/// What a voltage drives a current through.
struct Winding {
    /// Inverse of its resistance.
    conductance_siemens: f64,
    /// Its time constant.
    time_s: f64,
    /// Of a positive and of a negative current.
    drops_v: [f64; 2],
}

impl Winding {
    /// The current after some time at a constant voltage, and the charge until then.
    #[inline]
    fn flow(&self, from_a: f64, driving_v: f64, &Length { length_s, current_left, .. }: &Length) -> (f64, f64) {
        if from_a == 0.0 {
            return self.rise(driving_v, length_s, current_left);
        }
        let towards_a = (driving_v - against(from_a, self.drops_v)) * self.conductance_siemens;
        let end_a = towards_a + (from_a - towards_a) * current_left;
        if end_a * from_a >= 0.0 {
            return (end_a, towards_a * length_s + (from_a - towards_a) * self.time_s * (1.0 - current_left));
        }
        let ratio = 1.0 - from_a / towards_a;
        let zero_s = self.time_s * ratio.ln();
        // So much is left after the rest of the time.
        let (end_a, charge) = self.rise(driving_v, length_s - zero_s, current_left * ratio);
        (end_a, charge + towards_a * zero_s + from_a * self.time_s)
    }

    /// When a current on its way comes to one that it reaches.
    fn time_to(&self, from_a: f64, driving_v: f64, reached_a: f64) -> f64 {
        let end_a = |dry_v: f64| (driving_v - dry_v) * self.conductance_siemens;
        let between = |from_a: f64, to_a: f64, end_a: f64| self.time_s * ((from_a - end_a) / (to_a - end_a)).ln();
        let [forward_v, backward_v] = self.drops_v;
        let before_a = end_a(against(from_a, self.drops_v));
        if from_a * reached_a > 0.0 || reached_a == 0.0 {
            return between(from_a, reached_a, before_a);
        }
        let to_zero_s = if from_a == 0.0 { 0.0 } else { between(from_a, 0.0, before_a) };
        let after_a = end_a(if reached_a > 0.0 { forward_v } else { -backward_v });
        to_zero_s + between(0.0, reached_a, after_a)
    }

    /// The same from zero; `left`: share of a current that would be left.
    #[inline]
    fn rise(&self, driving_v: f64, length_s: f64, left: f64) -> (f64, f64) {
        let [forward_v, backward_v] = self.drops_v;
        let left_v = (driving_v - forward_v).max(0.0) + (driving_v + backward_v).min(0.0);
        let towards_a = left_v * self.conductance_siemens;
        let risen = 1.0 - left;
        (towards_a * risen, towards_a * (length_s - self.time_s * risen))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP_S: f64 = 1e-3;

    /// Euler's method, where a drop and a friction take what is there and no more.
    fn in_short_steps(
        motor: &MotorParameters,
        [mut current_a, mut speed]: [f64; 2],
        voltage_v: f64,
        drop_v: f64,
        friction_nm: f64,
    ) -> Reached {
        const STEPS: u32 = 4000;
        let less = |free: f64, loss: f64| (free.abs() - loss).max(0.0).copysign(free);
        let length_s = STEP_S / f64::from(STEPS);
        let mut mean_a = 0.0;
        for _ in 0..STEPS {
            let driving_v = voltage_v - motor.resistance_ohm * current_a - motor.torque_constant_nm_per_a * speed;
            let before_a = current_a;
            current_a =
                less(current_a + length_s / motor.inductance_h * driving_v, length_s / motor.inductance_h * drop_v);
            mean_a += 0.5 * (before_a + current_a) / f64::from(STEPS);
            let torque_nm = motor.torque_constant_nm_per_a * current_a - motor.viscous_friction_nm_s * speed;
            let [gained, lost] = [torque_nm, friction_nm].map(|torque_nm| length_s / motor.inertia_kg_m2 * torque_nm);
            speed = less(speed + gained, lost);
        }
        Reached { current_a, speed_rad_per_s: speed, mean_a }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        /// As in many short steps, whether current or shaft reverse, are held at zero or neither.
        #[test]
        fn one_step_is_as_exact_as_many(
            current_a in -1.0_f64..1.0,
            speed in -100.0_f64..100.0,
            voltage_v in prop_oneof![Just(0.0), Just(12.0), Just(-12.0)],
            drop_v in 0.0_f64..14.0,
            friction_nm in 0.0_f64..0.01,
        ) {
            let motor = MotorParameters::PIVT6;
            let terms = Balance {
                dry_drop_v: drop_v, dry_forward_nm: friction_nm, dry_backward_nm: friction_nm, ..Balance::default()
            };
            let one = SwitchedStep::new(&motor, motor.inertia_kg_m2, STEP_S).take(current_a, speed, voltage_v, &terms);
            let many = in_short_steps(&motor, [current_a, speed], voltage_v, drop_v, friction_nm);
            prop_assert!((one.current_a - many.current_a).abs() < 5e-3, "{one:?} {many:?}");
            prop_assert!((one.mean_a - many.mean_a).abs() < 5e-3, "{one:?} {many:?}");
            prop_assert!((one.speed_rad_per_s - many.speed_rad_per_s).abs() < 0.1, "{one:?} {many:?}");
        }
    }
}

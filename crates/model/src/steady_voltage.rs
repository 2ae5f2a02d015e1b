//! The voltage that a steady speed takes, and the least with which the motor starts and keeps turning.

use crate::Model;
use crate::catalogue::{Balance, Instant};

/// Angles over which the voltage is averaged: a prime number, so that waves with few periods in a turn leave nothing.
const ANGLES: usize = 37;
/// Some effects depend on the voltage itself.
const ROUNDS: usize = 4;
/// Speeds, as shares of that without a load, among which the least voltage is looked for: it lies below a tenth.
const SLOW: [f64; 9] = [0.0, 0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1];
/// A share of it at which nothing of a breakaway is left.
const TURNING: f64 = 0.4;
/// At rest the effects see this share of the speed without a load, so that friction knows its direction.
const LEAST_SPEED: f64 = 1e-6;
/// Long after the beginning an effect that comes up with time has come up; heat is left out.
const STEP_S: f64 = 1e-3;

/// Which way the motor turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Direction {
    Forward,
    Reverse,
}

impl Direction {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::Forward, Self::Reverse];
}

impl Model {
    /// Voltage against which the motor just does not start from rest, at the supply voltage; positive both ways.
    pub fn breakaway_v(&self, direction: Direction, supply_v: f64) -> f64 {
        self.steady_v(direction, [0.0; 2], supply_v)
    }

    /// Least voltage with which it keeps turning; positive both ways.
    pub fn turning_v(&self, direction: Direction, supply_v: f64) -> f64 {
        SLOW.map(|speed| self.steady_v(direction, [speed; 2], supply_v)).into_iter().fold(f64::INFINITY, f64::min)
    }

    /// What friction and drop take once it turns, without the back-EMF and the viscous friction; positive both ways.
    pub fn dead_band_v(&self, direction: Direction, supply_v: f64) -> f64 {
        self.steady_v(direction, [TURNING, 0.0], supply_v)
    }

    /// Mean voltage over a turn. The speed that the effects see and the speed of the linear motor are shares of that
    /// without a load.
    fn steady_v(&self, direction: Direction, [seen, share]: [f64; 2], supply_v: f64) -> f64 {
        let sense = if direction == Direction::Forward { 1.0 } else { -1.0 };
        let no_load_rad_per_s = supply_v / self.motor.torque_constant_nm_per_a;
        let at_angle = |index: usize| {
            let conditions = Instant {
                time_s: 0.0,
                voltage_v: 0.0,
                duty: 0.0,
                mean_duty: 0.0,
                supply_v,
                open: false,
                current_a: 0.0,
                speed_rad_per_s: sense * seen.max(LEAST_SPEED) * no_load_rad_per_s,
                middle_rad_per_s: sense * seen.max(LEAST_SPEED) * no_load_rad_per_s,
                angle_rad: std::f64::consts::TAU * index as f64 / ANGLES as f64,
                turned_rad: sense * seen * no_load_rad_per_s * STEP_S,
                step_s: STEP_S,
            };
            (0..ROUNDS).fold(0.0, |voltage_v, _| {
                let duty = (voltage_v / supply_v).clamp(-1.0, 1.0);
                let at =
                    Instant { voltage_v: sense * voltage_v, duty: sense * duty, mean_duty: sense * duty, ..conditions };
                self.balanced_v(sense, share * no_load_rad_per_s, &at)
            })
        };
        (0..ANGLES).map(at_angle).sum::<f64>() / ANGLES as f64
    }

    /// What balances both equations at a speed in the direction `sense`, if the effects see these conditions.
    fn balanced_v(&self, sense: f64, speed: f64, at: &Instant) -> f64 {
        let motor = &self.motor;
        let mut terms = Balance::default();
        for term in self.in_turn(|effect| effect.acts_on_motor()) {
            let mut state = term.effect.begins(at.speed_rad_per_s);
            term.effect.contribute(&term.values, motor, at, &mut state, &mut terms);
        }
        let dry_nm = if sense > 0.0 { terms.dry_forward_nm } else { terms.dry_backward_nm }.max(0.0);
        let viscous_nm = (motor.viscous_friction_nm_s + terms.viscous_nm_s) * speed;
        let current_a = (dry_nm + viscous_nm - sense * terms.torque_nm) / motor.torque_constant_nm_per_a;
        let drop_v = if terms.drops_with_the_mean() {
            terms.dry_drop_v * (current_a / terms.knee_a).tanh()
        } else {
            terms.dry_drop_v * current_a.signum()
        };
        let resistance_ohm = motor.resistance_ohm + terms.resistance_ohm;
        let emf_v = motor.torque_constant_nm_per_a * speed;
        resistance_ohm * current_a + emf_v + drop_v - sense * terms.voltage_v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::effect;
    use crate::motor::MotorParameters;

    fn close(found: f64, expected: f64) {
        assert!((found - expected).abs() < 2e-3 * expected.abs().max(0.1), "{found} instead of {expected}");
    }

    #[test]
    fn friction_drop_and_breakaway_add_up_to_volts() {
        let motor = MotorParameters::PIVT6;
        let volts = |torque_nm: f64| torque_nm * motor.resistance_ohm / motor.torque_constant_nm_per_a;
        let add = |model: Model, id: &str, values: &[f64]| model.with(effect(id).unwrap(), values.to_vec());
        let dry = add(add(Model::linear(motor), "coulomb_friction", &[0.01]), "voltage_drop", &[2.0]);
        for direction in Direction::BOTH {
            close(dry.dead_band_v(direction, 12.0), volts(0.01) + 2.0);
            close(dry.breakaway_v(direction, 12.0), volts(0.01) + 2.0);
        }
        let loaded = add(dry.clone(), "load_torque", &[0.004]);
        let load_v = loaded.dead_band_v(Direction::Forward, 12.0) - dry.dead_band_v(Direction::Forward, 12.0);
        close(load_v.abs(), volts(0.004));
        close(loaded.dead_band_v(Direction::Reverse, 12.0), volts(0.01) + 2.0 - load_v);
        // Waves over the angle cancel in a turn.
        let cogging = add(dry.clone(), "cogging", &[0.003, 0.002, 12.0]);
        close(cogging.dead_band_v(Direction::Forward, 12.0), volts(0.01) + 2.0);
        let breaks = add(dry, "stribeck_friction", &[0.006, 1.0]);
        close(breaks.breakaway_v(Direction::Forward, 12.0), volts(0.016) + 2.0);
        close(breaks.dead_band_v(Direction::Forward, 12.0), volts(0.01) + 2.0);
        let turning = breaks.turning_v(Direction::Forward, 12.0);
        assert!((volts(0.01) + 2.0..volts(0.012) + 2.2).contains(&turning), "{turning}");
    }
}

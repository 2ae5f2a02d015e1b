//! How a diagnosis searches for an effect: starts for its constants, and what else may explain the same data.

use super::Effect;
use crate::Term;
use crate::axis::{Axis, Drive};
use crate::motor::MotorParameters;

/// What a recording has, for the effects that need it to be seen.
#[derive(Clone, Copy, Debug)]
pub struct Channels {
    /// What is imposed, and how it moves.
    pub axis: Axis,
    /// A current.
    pub current: bool,
    /// A speed, not an angle.
    pub speed: bool,
    /// An angle or a speed from counts.
    pub counts: bool,
    /// Moments of commands between its rows, which are sought in its readings.
    pub moments: bool,
    /// A lateness of the readings that changes, which is followed.
    pub lateness: bool,
    /// One voltage, this way and that, and nothing else that happens.
    pub one_magnitude: bool,
}

/// Sizes of a recording and of the motor as far as it is known, from which an effect takes plausible values.
#[derive(Clone, Copy, Debug)]
pub struct Scales {
    /// What is imposed.
    pub drive: Drive,
    /// The linear motor found so far.
    pub motor: MotorParameters,
    /// Greatest voltage; 0 where none is imposed.
    pub voltage_v: f64,
    /// Greatest speed.
    pub speed_rad_per_s: f64,
    /// Greatest voltage of the supply.
    pub supply_v: f64,
    /// Greatest current, measured, computed or imposed; for an imposed torque that over the torque constant.
    pub current_a: f64,
    /// Length.
    pub duration_s: f64,
    /// Time between samples.
    pub interval_s: f64,
    /// Frequency of the PWM.
    pub pwm_hz: f64,
}

impl Scales {
    /// Torque at standstill and full command.
    pub fn stall_torque_nm(&self) -> f64 {
        let current_a = match self.drive {
            Drive::Voltage => self.voltage_v / self.motor.resistance_ohm,
            Drive::Current | Drive::Torque => self.current_a,
        };
        self.motor.torque_constant_nm_per_a * current_a
    }

    /// Speed at which the supply's whole voltage is back-EMF. An imposed current knows no such end: then the greatest speed.
    pub fn no_load_rad_per_s(&self) -> f64 {
        match self.drive {
            Drive::Voltage => self.supply_v / self.motor.torque_constant_nm_per_a,
            Drive::Current | Drive::Torque => self.speed_rad_per_s,
        }
    }
}

/// How a diagnosis searches for an effect. Only [`starts`](Self::starts) has to be given.
pub trait Search {
    /// Plausible values to begin a fit from: one set for each alternative of its nonlinear constants.
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>>;

    /// A constant that needs a close start, and the distance of its [`starts`](Self::starts).
    fn spacing(&self, _scales: &Scales) -> Option<(usize, f64)> {
        None
    }

    /// Starts around one. An effect with too many starts to try them all is searched from neighbour to neighbour.
    fn neighbours(&self, _start: &[f64]) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// From so many of its starts a fit is tried: those that promise most.
    fn starts_fitted(&self, _scales: &Scales) -> usize {
        1
    }

    /// Values near those found, from which another fit may come to a better end.
    fn elsewhere(&self, _values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// The values that come closest by its other laws, where it has a choice.
    fn other_laws(&self, _values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// The same by laws that differ in a detail. They change its constants and not its name, so they are tried last.
    fn refined_laws(&self, _values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Similar laws that are not in the catalogue, with the values that come closest. The effect is named only where none of
    /// them explains more.
    fn similar_laws(&self, _values: &[f64], _scales: &Scales) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        Vec::new()
    }

    /// The values with which it comes closest to a rival that has `values`: another effect, or
    /// [`INDUCTANCE`](super::INDUCTANCE).
    fn instead_of(&self, _rival: &str, _values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        None
    }

    /// What it leaves of another term's values where it takes the place of a rival with `values`.
    fn leaves(&self, _rival: &str, _values: &[f64], _other: &Term) -> Option<Vec<f64>> {
        None
    }

    /// By how much its constants grow where it also does what a rival with `values` did beside it.
    fn takes_over(&self, _rival: &str, _values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        None
    }

    /// Whether a rival that explains the data as well is the more plausible name. `others`: the rest of the model.
    fn yields_to(&self, _values: &[f64], _rival: &str, _others: &[Term]) -> bool {
        false
    }

    /// Whether with such values it only scales a quantity, which other constants of the motor can do as well.
    fn is_a_scale(&self, _values: &[f64], _scales: &Scales) -> bool {
        false
    }

    /// Whether a recording of these channels can show it, beside that its sensor is recorded.
    fn can_show_in(&self, _channels: &Channels) -> bool {
        true
    }
}

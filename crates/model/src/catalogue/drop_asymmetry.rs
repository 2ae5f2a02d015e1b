//! Drop asymmetry: the transistors that carry the current in one direction drop more than the others, or a dead time takes
//! more of their pulses.

use super::{
    About, ActsOn, Alone, Balance, Coordinate, Instant, Law, Parameter, Scales, Search, Shown, Strength, Unit,
};
use crate::motor::MotorParameters;

/// A usual difference, to start from.
const USUAL_V: f64 = 0.3;
/// A usual torque that looks like it.
pub(super) const USUAL_TORQUE_NM: f64 = 1e-3;

/// See the module.
pub struct DropAsymmetry;

static ABOUT: About = About {
    id: "drop_asymmetry",
    title: "a voltage drop that differs between directions",
    acts_on: &[ActsOn::Voltage],
    parameters: &[Parameter::signed("difference_V", Unit::Volt)],
    linear_in: 1,
    law: "The drop is greater by difference_V / 2 while the current flows forwards and smaller by as much backwards",
    looks_like: "The missing voltage is a step over the current that is higher on one side; the motor is faster one way than the other, by the same at every duty",
    confused_with: &["bridge_asymmetry", "load_torque", "friction_asymmetry", "current_offset"],
    experiment: "Hold the rotor and measure the voltage at the motor's terminals, the same duties both ways",
    remedy: "Separate feed-forward of the drop for the two directions of the current; a MOSFET bridge",
    source: "Texas Instruments, L293D data sheet (saturation voltages of source and sink transistors)",
    requires: Some(("voltage_drop", Alone::Never)),
    shown: Shown::new(Strength::Voltage, Coordinate::Current),
    ..About::DEFAULT
};

impl Law for DropAsymmetry {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn is_steady(&self, _values: &[f64]) -> bool {
        true
    }

    /// The drop is greater one way and smaller the other by as much: that is a voltage in series.
    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        _at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.voltage_v -= 0.5 * values[0];
    }
}

impl Search for DropAsymmetry {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![USUAL_V]]
    }

    /// Without a measured current, a torque that keeps its sign looks the same.
    fn instead_of(&self, rival: &str, _values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        ["load_torque", "friction_asymmetry"].contains(&rival).then(|| vec![USUAL_V])
    }
}

//! Supply sag: batteries, thin wires and small adapters lose voltage with the current drawn from them.
//!
//! With a capacitor at the bridge the supply delivers the mean current over a period of the PWM. Without one it delivers the
//! whole current of the motor during a pulse, and none between.

use super::{About, ActsOn, Balance, Coordinate, Instant, Law, Parameter, Scales, Search, Shown, Strength, Unit};
use crate::motor::MotorParameters;

/// The duty at which both laws lose the same, to start from.
const USUAL_DUTY: f64 = 0.7;

/// See the module.
pub struct SupplySag;

static ABOUT: About = About {
    id: "supply_sag",
    title: "a supply that sags under load",
    acts_on: &[ActsOn::Voltage],
    parameters: &[Parameter::positive("resistance_ohm", Unit::Ohm), Parameter::choice("within_pulses")],
    linear_in: 1,
    law: "The supply loses resistance_ohm times the current it delivers: duty times i, or with within_pulses = 1, without a capacitor, i while a pulse of the PWM lasts",
    looks_like: "The missing voltage grows with current at high duty, not at low duty",
    confused_with: &["voltage_drop", "winding_heating"],
    experiment: "Measure the supply voltage on the divider, or hold the rotor at several duties",
    remedy: "Measure the supply and divide by it; a stiffer supply; a large capacitor at the bridge",
    source: "Horowitz and Hill, The Art of Electronics (2015)",
    shown: Shown::new(Strength::SupplyVoltage, Coordinate::SupplyCurrent),
    ..About::DEFAULT
};

impl Law for SupplySag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        let is_drawn = if values[1] > 0.0 { 1.0 } else { at.mean_duty.abs() };
        balance.resistance_ohm += values[0] * at.duty.abs() * is_drawn;
    }
}

impl Search for SupplySag {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.1 * scales.motor.resistance_ohm, 0.0]]
    }

    /// The other law with the same loss at a usual duty.
    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        let in_pulses = values[1] > 0.0;
        let factor = if in_pulses { 1.0 / USUAL_DUTY } else { USUAL_DUTY };
        vec![vec![factor * values[0], f64::from(!in_pulses)]]
    }
}

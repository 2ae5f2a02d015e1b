//! Supply sag: batteries, thin wires and small adapters lose voltage with the current drawn from them.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales};
use crate::motor::MotorParameters;

/// See the module.
pub struct SupplySag;

static ABOUT: About = About {
    id: "supply_sag",
    title: "a supply that sags under load",
    acts_on: ActsOn::Voltage,
    parameters: &[Parameter::positive("resistance_ohm")],
    linear_in: 1,
    law: "The supply loses resistance_ohm times the current it delivers, which is duty times i",
    looks_like: "The missing voltage grows with current at high duty, not at low duty",
    confused_with: &["voltage_drop", "winding_heating"],
    experiment: "Measure the supply voltage on the divider, or hold the rotor at several duties",
    remedy: "Measure the supply and divide by it; a stiffer supply; a large capacitor at the bridge",
    source: "Horowitz and Hill, The Art of Electronics (2015)",
};

impl Effect for SupplySag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.1 * scales.motor.resistance_ohm]]
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.resistance_ohm += values[0] * at.duty * at.duty;
    }
}

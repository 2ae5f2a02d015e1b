//! Voltage drop: bridge transistors and brush contacts take a nearly constant voltage while current flows.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales};
use crate::motor::MotorParameters;

/// See the module.
pub struct VoltageDrop;

static ABOUT: About = About {
    id: "voltage_drop",
    title: "a voltage drop in bridge or brushes",
    acts_on: ActsOn::Voltage,
    parameters: &[Parameter::positive("drop_V")],
    linear_in: 1,
    law: "U = drop_V sign(i); below it no current starts",
    looks_like: "The missing voltage is a step at zero current; no current at all below a command voltage",
    confused_with: &["coulomb_friction", "supply_sag"],
    experiment: "Hold the rotor and step the voltage: the line of current over voltage misses zero by the drop",
    remedy: "Feed-forward of the drop in the direction of the current; a MOSFET bridge",
    source: "ST L293D data sheet (saturation voltages); Mohan, Electric Machines and Drives (2012)",
};

impl Effect for VoltageDrop {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.05 * scales.voltage_v]]
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        _at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.dry_drop_v += values[0];
    }
}

//! Voltage drop: bridge transistors and brush contacts take a nearly constant voltage while current flows.
//!
//! In a switched bridge the drop acts at every moment. A current that swings through zero within a PWM period loses it in both
//! directions. Behind a filter, in a linear amplifier or in a program's averages, the drop follows the mean current and comes
//! up over a knee.

use super::{
    About, ActsOn, Balance, Channels, Coordinate, DryLosses, Instant, Law, Parameter, Scales, Search, Shown, Strength,
    Unit,
};
use crate::motor::MotorParameters;

/// Knees that are tried, as shares of the greatest current; 0: the drop acts at every moment.
const KNEES: [f64; 3] = [0.0, 5e-4, 1e-2];

/// See the module.
pub struct VoltageDrop;

static ABOUT: About = About {
    id: "voltage_drop",
    title: "a voltage drop in bridge or brushes",
    acts_on: &[ActsOn::Voltage],
    parameters: &[
        Parameter::positive("drop_V", Unit::Volt),
        Parameter::of_another_law("knee_A", Unit::Ampere, f64::INFINITY),
    ],
    linear_in: 1,
    law: "U = drop_V sign(i), or drop_V tanh(i / knee_A) of the mean current",
    looks_like: "The missing voltage is a step at zero current; no current at all below a command voltage",
    confused_with: &["coulomb_friction", "supply_sag"],
    experiment: "Hold the rotor and step the voltage: the line of current over voltage misses zero by the drop",
    remedy: "Feed-forward of the drop in the direction of the current; a MOSFET bridge",
    source: "ST L293D data sheet (saturation voltages); Mohan, Electric Machines and Drives (2012)",
    shown: Shown::new(Strength::Voltage, Coordinate::Current),
    ..About::DEFAULT
};

impl Law for VoltageDrop {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn dry_losses(&self, values: &[f64]) -> DryLosses {
        DryLosses { bridge_drop_v: values[0], ..DryLosses::default() }
    }

    /// A drop that follows the mean current is not that of a switched bridge.
    fn is_dry_losses_alone(&self, values: &[f64]) -> bool {
        values[1] == 0.0
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
        balance.knee_a = balance.knee_a.max(values[1]);
    }
}

impl Search for VoltageDrop {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        with_knees(0.05 * scales.voltage_v, scales)
    }

    fn other_laws(&self, values: &[f64], scales: &Scales) -> Vec<Vec<f64>> {
        let mut laws = with_knees(values[0], scales);
        // A fit moves the knee: the law with a moved knee stays in the list.
        laws.retain(|law| law[1] != values[1]);
        laws
    }

    /// At a single voltage the drop only scales it.
    fn can_show_in(&self, channels: &Channels) -> bool {
        !channels.one_magnitude
    }
}

fn with_knees(drop_v: f64, scales: &Scales) -> Vec<Vec<f64>> {
    KNEES.map(|share| vec![drop_v, share * scales.current_a]).to_vec()
}

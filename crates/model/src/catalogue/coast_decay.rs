//! Coasting off phase: with the PWM on the enable pin the current flows back through the diodes and stops. A program may also
//! disable the bridge at zero duty only, and brake between pulses.

use super::{
    About, ActsOn, Balance, Coordinate, Instant, Law, OffPhase, Parameter, Scales, Search, Shown, Strength, Unit,
};
use crate::motor::MotorParameters;

/// Forward voltage of a free-wheeling diode.
const DIODE_V: f64 = 1.0;

/// Least duty that counts as one.
const LEAST_DUTY: f64 = 1e-3;

/// See the module.
pub struct CoastDecay;

static ABOUT: About = About {
    id: "coast_decay",
    title: "an off phase of the PWM that coasts",
    acts_on: &[ActsOn::Voltage],
    // Supply and diodes are known to some tenths of a volt.
    parameters: &[
        Parameter { known: Some((1.0, 0.03)), ..Parameter::within("share", Unit::One, 0.94, 1.06) },
        Parameter::choice("at_zero_duty"),
    ],
    linear_in: 0,
    law: "In the off phase the current flows on against the supply and two diodes until it is nothing: (2 |duty| - 1) supply in the mean, or single pulses; with at_zero_duty = 1 only where the duty is 0",
    looks_like: "Hardly any motion below half duty, then steep; no braking when the duty falls; speed hardly depends on load at small duty",
    confused_with: &["voltage_drop", "coulomb_friction"],
    experiment: "Same recording with the PWM on the inputs (sign-magnitude, slow decay)",
    remedy: "Drive the inputs and leave enable high: the classic wiring makes the motor nonlinear",
    source: "ST L293D data sheet; Mohan, Electric Machines and Drives (2012)",
    is_of_switching: true,
    has_events: true,
    changes_everything: true,
    // A drop takes voltage from the pulse. With another motor that looks like more voltage in the off phase.
    held_beside: Some("voltage_drop"),
    shown: Shown::new(Strength::Voltage, Coordinate::Duty),
    tells_scale_of_voltages: true,
    ..About::DEFAULT
};

impl Law for CoastDecay {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    /// The drop of the diodes belongs to the bridge, whatever the share.
    fn off_phase(&self, values: &[f64]) -> Option<OffPhase> {
        Some(if values[1] > 0.0 { OffPhase::CoastsAtZeroDuty } else { OffPhase::Coasts })
    }

    /// The drop of the transistors acts in the pulse alone, so it has to be known here.
    fn turn(&self, _values: &[f64]) -> i8 {
        1
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        if values[1] > 0.0 && at.duty.abs() > LEAST_DUTY {
            return;
        }
        let recovered_v = at.supply_v + 2.0 * DIODE_V;
        balance.off_excess_v = values[0] * (recovered_v - balance.dry_drop_v);
    }
}

impl Search for CoastDecay {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![1.0, 0.0], vec![1.0, 1.0]]
    }

    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![values[0], 1.0 - values[1]]]
    }
}

//! Coasting off phase: with the PWM on the enable pin the current flows back through the diodes and stops. Or the program
//! takes the enable away only where it asks for nothing, and brakes between pulses.

use super::{About, ActsOn, Balance, Effect, Instant, OffPhase, Parameter, Scales};
use crate::motor::MotorParameters;

/// Free-wheeling diode.
const DIODE_V: f64 = 1.0;

/// A smaller duty is none.
const LEAST_DUTY: f64 = 1e-3;

/// See the module.
pub struct CoastDecay;

static ABOUT: About = About {
    id: "coast_decay",
    title: "an off phase of the PWM that coasts",
    acts_on: ActsOn::Voltage,
    // Supply and diodes are known, to some tenths of a volt.
    parameters: &[
        Parameter { known: Some((1.0, 0.03)), ..Parameter::within("share", 0.94, 1.06) },
        Parameter::choice("at_zero_duty"),
    ],
    linear_in: 0,
    law: "In the off phase the current flows on against the supply and two diodes until it is nothing: (2 |duty| - 1) supply in the mean, or single pulses; with at_zero_duty = 1 only where the duty is 0",
    looks_like: "Hardly any motion below half duty, then steep; no braking when the duty falls; speed hardly depends on load at small duty",
    confused_with: &["voltage_drop", "coulomb_friction"],
    experiment: "Same recording with the PWM on the inputs (sign-magnitude, slow decay)",
    remedy: "Drive the inputs and leave enable high: the classic wiring makes the motor nonlinear",
    source: "ST L293D data sheet; Mohan, Electric Machines and Drives (2012)",
};

impl Effect for CoastDecay {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![1.0, 0.0], vec![1.0, 1.0]]
    }

    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![values[0], 1.0 - values[1]]]
    }

    fn is_of_switching(&self) -> bool {
        true
    }

    /// What the diodes take is the bridge's own, whatever the share.
    fn off_phase(&self, values: &[f64]) -> Option<OffPhase> {
        Some(if values[1] > 0.0 { OffPhase::CoastsAtZeroDuty } else { OffPhase::Coasts })
    }

    fn changes_everything(&self) -> bool {
        true
    }

    /// A drop leaves less of the supply in the pulse: with a motor of another size, that is more of it in the off phase.
    fn known_beside(&self) -> Option<&'static str> {
        Some("voltage_drop")
    }

    /// What the bridge drops in the pulse counts there alone.
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
        balance.off_excess_v += values[0] * (recovered_v - balance.dry_drop_v);
    }
}

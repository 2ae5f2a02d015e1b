//! Coasting off phase: with the PWM on the enable pin the current flows back through the diodes and stops.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales};
use crate::motor::MotorParameters;

/// Free-wheeling diode.
const DIODE_V: f64 = 1.0;
/// PWM period of the firmware.
const PERIOD_S: f64 = 50e-6;

/// Mean voltage at which the mean current is that of separate pulses: they rise through the on phase and fall against
/// the supply within the off phase.
fn single_pulse_v(motor: &MotorParameters, duty: f64, supply_v: f64, emf_v: f64) -> f64 {
    let rise_v = (supply_v - emf_v).max(0.0);
    let fall_v = (supply_v + 2.0 * DIODE_V + emf_v).max(0.1 * supply_v);
    let peak_a = rise_v * duty * PERIOD_S / motor.inductance_h;
    let mean_a = 0.5 * peak_a * duty * (1.0 + rise_v / fall_v);
    emf_v + motor.resistance_ohm * mean_a
}

/// See the module.
pub struct CoastDecay;

static ABOUT: About = About {
    id: "coast_decay",
    title: "an off phase of the PWM that coasts",
    acts_on: ActsOn::Voltage,
    parameters: &[Parameter::within("share", 0.0, 1.2)],
    linear_in: 0,
    law: "In continuous conduction the mean voltage is (2 |duty| - 1) supply; below, the current is that of single pulses",
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
        vec![vec![1.0]]
    }

    fn contribute(&self, values: &[f64], motor: &MotorParameters, at: &Instant, _state: &[f64], balance: &mut Balance) {
        let duty = at.duty.abs();
        if duty == 0.0 {
            return;
        }
        let sense = at.duty.signum();
        let emf_v = sense * motor.torque_constant_nm_per_a * at.speed_rad_per_s;
        let continuous_v = (2.0 * duty - 1.0) * at.supply_v - 2.0 * (1.0 - duty) * DIODE_V;
        let mean_v = continuous_v.max(single_pulse_v(motor, duty, at.supply_v, emf_v)).min(at.supply_v.max(emf_v));
        balance.voltage_v += values[0] * (sense * mean_v - at.voltage_v);
    }
}

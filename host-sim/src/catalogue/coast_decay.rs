//! Coasting off phase: with the PWM on the enable pin the current flows back through the diodes and stops.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales};
use crate::motor::MotorParameters;

/// Free-wheeling diode.
const DIODE_V: f64 = 1.0;
/// PWM period of the firmware.
const PERIOD_S: f64 = 50e-6;

/// Mean current of separate pulses: they rise by `rise_v` through the on phase and fall by `fall_v` within the off phase.
fn single_pulses_a(motor: &MotorParameters, duty: f64, rise_v: f64, fall_v: f64) -> f64 {
    let rise_v = rise_v.max(0.0);
    let peak_a = rise_v * duty * PERIOD_S / motor.inductance_h;
    // A motor that is turned against its drive faster than the supply drives it has no pulses that end.
    0.5 * peak_a * duty * (1.0 + rise_v / fall_v.max(rise_v))
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

    fn changes_everything(&self) -> bool {
        true
    }

    /// The bridge drops its voltage in the on phase only, so that drop is part of the mean.
    fn acts_last(&self) -> bool {
        true
    }

    fn contribute(
        &self,
        values: &[f64],
        motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        // The diodes end a pulse; nothing reverses.
        balance.ripple_a = 0.0;
        let duty = at.duty.abs();
        let sense = if at.duty < 0.0 { -1.0 } else { 1.0 };
        let emf_v = sense * motor.torque_constant_nm_per_a * at.speed_rad_per_s;
        let recovered_v = at.supply_v + 2.0 * DIODE_V;
        let driving_v = at.supply_v - balance.dry_drop_v;
        let continuous_v = duty * driving_v - (1.0 - duty) * recovered_v;
        // Single pulses begin at zero, so their mean is there after one period, whatever flowed before.
        let pulses_a = single_pulses_a(motor, duty, driving_v - emf_v, recovered_v + emf_v);
        let change_a = pulses_a - sense * at.current_a;
        let pulses_v = emf_v + motor.resistance_ohm * pulses_a + motor.inductance_h * change_a / at.step_s;
        let mean_v = continuous_v.max(pulses_v).min(recovered_v);
        balance.voltage_v += values[0] * (sense * mean_v - at.voltage_v);
        balance.dry_drop_v *= (1.0 - values[0]).max(0.0);
    }
}

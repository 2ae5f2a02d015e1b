//! Coulomb friction: bearings and brushes resist with a constant torque, and hold the shaft below it.

use super::{
    About, ActsOn, Balance, Coordinate, DryLosses, Instant, Law, Parameter, Scales, Search, Shown, Simplification,
    Strength, Unit,
};
use crate::motor::MotorParameters;

/// See the module.
pub struct CoulombFriction;

static ABOUT: About = About {
    id: "coulomb_friction",
    title: "Coulomb friction",
    acts_on: &[ActsOn::Torque],
    parameters: &[Parameter::positive("torque_Nm", Unit::NewtonMetre)],
    linear_in: 1,
    law: "T = torque_Nm sign(w); at rest it balances up to torque_Nm",
    looks_like: "The missing torque is a step at zero speed; the motor does not start below a voltage; speed stops within a finite time",
    confused_with: &["friction_asymmetry", "stribeck_friction", "voltage_drop"],
    experiment: "A slow ramp through zero both ways with the current measured: friction shows in the current, a voltage drop does not",
    remedy: "Feed-forward of torque_Nm R / k volts in the direction of the reference, smooth around zero; integral action against what remains",
    source: "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994)",
    // Real contacts bend by some milliradians before they slip, and spring back when they stop.
    simplification: Simplification { own: 3.5e-3, inertia: 2.2e-3, viscous_friction: 5e-3 },
    shown: Shown::new(Strength::Torque, Coordinate::Speed),
    ..About::DEFAULT
};

impl Law for CoulombFriction {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn dry_losses(&self, values: &[f64]) -> DryLosses {
        DryLosses { friction_forward_nm: values[0], friction_reverse_nm: values[0], ..DryLosses::default() }
    }

    fn is_dry_losses_alone(&self, _values: &[f64]) -> bool {
        true
    }

    /// Effects that scale it come after it.
    fn turn(&self, _values: &[f64]) -> i8 {
        -2
    }

    fn is_steady(&self, _values: &[f64]) -> bool {
        true
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        _at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.dry_forward_nm += values[0];
        balance.dry_backward_nm += values[0];
    }
}

impl Search for CoulombFriction {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.03 * scales.stall_torque_nm()]]
    }

    /// A drop takes what this torque needs of the voltage.
    fn takes_over(&self, rival: &str, values: &[f64], Scales { motor, .. }: &Scales) -> Option<Vec<f64>> {
        let torque_nm = values[0] * motor.torque_constant_nm_per_a / motor.resistance_ohm;
        (rival == "voltage_drop").then(|| vec![torque_nm])
    }
}

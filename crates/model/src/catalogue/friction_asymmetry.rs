//! Friction asymmetry: brushes at an angle and preloaded bearings rub more in one direction.

use super::drop_asymmetry::USUAL_TORQUE_NM;
use super::{
    About, ActsOn, Alone, Balance, Coordinate, DryLosses, Instant, Law, Parameter, Scales, Search, Shown,
    Simplification, Strength, Unit,
};
use crate::motor::MotorParameters;

/// See the module.
pub struct FrictionAsymmetry;

static ABOUT: About = About {
    id: "friction_asymmetry",
    title: "friction that differs between directions",
    acts_on: &[ActsOn::Torque],
    parameters: &[Parameter::signed("difference_Nm", Unit::NewtonMetre)],
    linear_in: 1,
    law: "Coulomb friction is greater by difference_Nm / 2 forwards and smaller by as much backwards",
    looks_like: "Friction curve with unequal branches; the same voltage gives different speeds forwards and backwards",
    confused_with: &["load_torque", "current_offset"],
    experiment: "Measure the torque that just does not move the shaft, both ways, by hand or with the motor off on an incline: a load acts without motion, friction does not",
    remedy: "Separate feed-forward levels for the two directions",
    source: "Kelly, Llamas, Campa, IEEE Trans. Instrumentation and Measurement 49 (2000)",
    // It is a small difference of two frictions, each of which bends before it slips.
    simplification: Simplification::of_own(5e-3),
    requires: Some(("coulomb_friction", Alone::Never)),
    shown: Shown::new(Strength::Torque, Coordinate::Speed),
    ..About::DEFAULT
};

impl Law for FrictionAsymmetry {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn dry_losses(&self, values: &[f64]) -> DryLosses {
        DryLosses {
            friction_forward_nm: 0.5 * values[0],
            friction_reverse_nm: -0.5 * values[0],
            ..DryLosses::default()
        }
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
        // Friction does not drive: a difference of more than all friction leaves none in the other direction.
        balance.dry_forward_nm = (balance.dry_forward_nm + 0.5 * values[0]).max(0.0);
        balance.dry_backward_nm = (balance.dry_backward_nm - 0.5 * values[0]).max(0.0);
    }
}

impl Search for FrictionAsymmetry {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.02 * scales.stall_torque_nm()]]
    }

    /// While the motor turns it looks like a load; without a measured current it looks like a drop.
    fn instead_of(&self, rival: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        match rival {
            "load_torque" => Some(vec![2.0 * values[0]]),
            "drop_asymmetry" => Some(vec![USUAL_TORQUE_NM]),
            _ => None,
        }
    }
}

//! Load torque: a weight on a drum or a spring under tension. Its sign does not depend on the motion.

use super::drop_asymmetry::USUAL_TORQUE_NM;
use super::{About, ActsOn, Balance, Coordinate, Instant, Law, Parameter, Scales, Search, Shown, Strength, Unit};
use crate::Term;
use crate::motor::MotorParameters;

/// See the module.
pub struct LoadTorque;

static ABOUT: About = About {
    id: "load_torque",
    title: "a constant load torque",
    acts_on: &[ActsOn::Torque],
    parameters: &[Parameter::signed("torque_Nm", Unit::NewtonMetre)],
    linear_in: 1,
    law: "T = torque_Nm against positive motion, whatever the speed",
    looks_like: "The missing torque is a constant; the motor is faster one way than the other, and may turn by itself",
    confused_with: &["friction_asymmetry", "current_offset"],
    experiment: "Let the motor coast with the bridge off from both directions and wait: a load above the friction turns the shaft, friction never does",
    remedy: "Integral action, or a constant feed-forward of torque R / k",
    source: "Leonhard, Control of Electrical Drives (2001)",
    shown: Shown::new(Strength::Torque, Coordinate::Speed),
    ..About::DEFAULT
};

impl Law for LoadTorque {
    fn about(&self) -> &'static About {
        &ABOUT
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
        balance.torque_nm -= values[0];
    }
}

impl Search for LoadTorque {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.02 * scales.stall_torque_nm()]]
    }

    /// While the motor turns it looks like an asymmetric friction; without a measured current it looks like an asymmetric drop.
    fn instead_of(&self, rival: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        match rival {
            "friction_asymmetry" => Some(vec![0.5 * values[0]]),
            "drop_asymmetry" => Some(vec![USUAL_TORQUE_NM]),
            _ => None,
        }
    }

    /// A load below half the Coulomb friction turns nothing by itself. Unequal friction is then the usual reason.
    fn yields_to(&self, values: &[f64], rival: &str, others: &[Term]) -> bool {
        let coulomb_nm = others.iter().find(|term| term.id() == "coulomb_friction").map_or(0.0, |term| term.values[0]);
        rival == "friction_asymmetry" && values[0].abs() < 0.5 * coulomb_nm
    }
}

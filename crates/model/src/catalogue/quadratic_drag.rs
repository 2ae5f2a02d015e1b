//! Quadratic drag: a fan, a propeller or a rotor in air or oil.

use super::{
    About, ActsOn, Balance, Coordinate, Effect, Instant, Law, Parameter, Scales, Search, Shown, Simplification,
    Strength, Unit,
};
use crate::motor::MotorParameters;

/// See the module.
pub struct QuadraticDrag;

static ABOUT: About = About {
    id: "quadratic_drag",
    title: "drag that grows with the square of the speed",
    acts_on: &[ActsOn::Torque],
    parameters: &[Parameter::positive("drag_Nm_s2", Unit::NewtonMetreSecond2)],
    linear_in: 1,
    law: "T = drag_Nm_s2 w |w|",
    looks_like: "The missing torque is a parabola over speed, against the motion; top speed lower than the linear model says",
    confused_with: &["missed_counts", "winding_heating"],
    experiment: "Steady speeds at several voltages over the whole range, with current",
    remedy: "Feed-forward of drag w |w| R / k; gains scheduled with speed if the fan dominates",
    source: "Hoerner, Fluid-Dynamic Drag (1965)",
    // Friction that bends before it slips makes a weak drag uncertain.
    simplification: Simplification::of_own(0.01),
    shown: Shown::new(Strength::Torque, Coordinate::Speed),
    ..About::DEFAULT
};

/// Drag that grows with the cube of the speed: a law to compare with, not in the catalogue.
struct CubicDrag;

static ABOUT_CUBIC: About = About {
    id: "cubic_drag",
    title: "drag that grows with the cube of the speed",
    parameters: &[Parameter::positive("drag_Nm_s3", Unit::NewtonMetreSecond3)],
    law: "T = drag_Nm_s3 w^3",
    ..ABOUT
};

impl Law for QuadraticDrag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.viscous_nm_s += values[0] * at.middle_rad_per_s.abs();
    }
}

impl Search for QuadraticDrag {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.05 * scales.stall_torque_nm() / scales.speed_rad_per_s.powi(2)]]
    }

    /// Stribeck friction beside more viscous friction bends the curve like a drag. At ten times the Stribeck speed the drag is
    /// about a fifth of the excess.
    fn instead_of(&self, rival: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        (rival == "stribeck_friction").then(|| vec![0.2 * values[0] / (10.0 * values[1]).powi(2)])
    }

    /// The cubic law with the same drag at the greatest speed.
    fn similar_laws(&self, values: &[f64], scales: &Scales) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        vec![(&CubicDrag, vec![values[0] / scales.speed_rad_per_s])]
    }
}

impl Law for CubicDrag {
    fn about(&self) -> &'static About {
        &ABOUT_CUBIC
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.viscous_nm_s += values[0] * at.middle_rad_per_s.powi(2);
    }
}

impl Search for CubicDrag {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.05 * scales.stall_torque_nm() / scales.speed_rad_per_s.powi(3)]]
    }
}

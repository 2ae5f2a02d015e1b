//! Quadratic drag: a fan, a propeller or a rotor in air or oil.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales, Simplification};
use crate::motor::MotorParameters;

/// See the module.
pub struct QuadraticDrag;

static ABOUT: About = About {
    id: "quadratic_drag",
    title: "drag that grows with the square of the speed",
    acts_on: ActsOn::Torque,
    parameters: &[Parameter::positive("drag_Nm_s2")],
    linear_in: 1,
    law: "T = drag_Nm_s2 w |w|",
    looks_like: "The missing torque is a parabola over speed, against the motion; top speed lower than the linear model says",
    confused_with: &["missed_counts", "winding_heating"],
    experiment: "Steady speeds at several voltages over the whole range, with current",
    remedy: "Feed-forward of drag w |w| R / k; gains scheduled with speed if the fan dominates",
    source: "Hoerner, Fluid-Dynamic Drag (1965)",
};

/// Drag that grows with the cube of the speed: no fan's, and no effect of the catalogue.
struct CubicDrag;

static ABOUT_CUBIC: About = About {
    id: "cubic_drag",
    title: "drag that grows with the cube of the speed",
    parameters: &[Parameter::positive("drag_Nm_s3")],
    law: "T = drag_Nm_s3 w^3",
    ..ABOUT
};

impl Effect for QuadraticDrag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    /// Friction that bends before it slips leaves a part of a weak one open.
    fn simplification(&self) -> Simplification {
        Simplification { own: 0.01, inertia: 0.0, viscous_friction: 0.0 }
    }

    /// Less friction from some speed on and more viscous friction bend as a drag does: as great, at ten times that speed, as a
    /// fifth of what falls off.
    fn instead_of(&self, rival: &str, values: &[f64]) -> Option<Vec<f64>> {
        (rival == "stribeck_friction").then(|| vec![0.2 * values[0] / (10.0 * values[1]).powi(2)])
    }

    /// With as much at the greatest speed.
    fn not_its_own(&self, values: &[f64], scales: &Scales) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        vec![(&CubicDrag, vec![values[0] / scales.speed_rad_per_s])]
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.05 * scales.stall_torque_nm() / scales.speed_rad_per_s.powi(2)]]
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.viscous_nm_s += values[0] * at.speed_rad_per_s.abs();
    }
}

impl Effect for CubicDrag {
    fn about(&self) -> &'static About {
        &ABOUT_CUBIC
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.05 * scales.stall_torque_nm() / scales.speed_rad_per_s.powi(3)]]
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.viscous_nm_s += values[0] * at.speed_rad_per_s.powi(2);
    }
}

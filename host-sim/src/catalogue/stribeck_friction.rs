//! Stribeck friction: it takes more to break loose than to keep moving; the excess falls off with speed.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales};
use crate::motor::MotorParameters;

/// See the module.
pub struct StribeckFriction;

static ABOUT: About = About {
    id: "stribeck_friction",
    title: "Stribeck friction (breakaway above the Coulomb level)",
    acts_on: ActsOn::Torque,
    parameters: &[Parameter::positive("excess_torque_Nm"), Parameter::positive("stribeck_speed_rad_per_s")],
    linear_in: 1,
    law: "T = excess_torque_Nm exp(-(w / stribeck_speed)^2) sign(w), on top of Coulomb friction",
    looks_like: "The missing torque has a peak on both sides of zero speed; jerky slow motion (stick-slip); breakaway at a higher voltage than stopping",
    confused_with: &["coulomb_friction", "cogging"],
    experiment: "Very slow ramps through zero, several times, starting at other angles: cogging depends on the angle, Stribeck friction does not",
    remedy: "Compensation up to the Coulomb level only (more makes it hunt); an impulse or dither to break loose; integral action off at standstill",
    source: "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994)",
};

impl Effect for StribeckFriction {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let excess_nm = 0.03 * scales.stall_torque_nm();
        [0.01, 0.03, 0.1].map(|share| vec![excess_nm, share * scales.speed_rad_per_s]).to_vec()
    }

    /// What it adds falls off to the Coulomb level.
    fn needs(&self) -> Option<&'static str> {
        Some("coulomb_friction")
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        let ratio = at.speed_rad_per_s / values[1].max(1e-9);
        let excess_nm = values[0] * (-ratio * ratio).exp();
        balance.dry_forward_nm += excess_nm;
        balance.dry_backward_nm += excess_nm;
    }
}

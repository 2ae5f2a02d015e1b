//! Stribeck friction: it takes more to break loose than to keep moving; the excess falls off with speed.

use super::{About, ActsOn, Alone, Balance, Effect, Instant, Parameter, Scales, Simplification};
use crate::motor::MotorParameters;

/// An excess that reaches farther up would be Coulomb friction, or drag.
const MOST_OF_SPEED: f64 = 0.1;
/// The Stribeck speed of an exponential over that of the bell that is down to half at the same speed.
const EXPONENTIAL_OVER_BELL: f64 = 1.2;

/// What sticks now and then has no smooth cost: a fit stops within so much of the excess, or of the speed, of where it belongs.
const ELSEWHERE: [f64; 2] = [0.7, 1.4];

/// See the module.
pub struct StribeckFriction;

static ABOUT: About = About {
    id: "stribeck_friction",
    title: "Stribeck friction (breakaway above the Coulomb level)",
    acts_on: ActsOn::Torque,
    parameters: &[
        Parameter::positive("excess_torque_Nm"),
        Parameter::of_speed("stribeck_speed_rad_per_s", MOST_OF_SPEED),
        Parameter::choice("exponential"),
    ],
    linear_in: 1,
    law: "T = excess_torque_Nm exp(-(w / stribeck_speed)^2) sign(w), on top of Coulomb friction if there is any; with exponential = 1 it is exp(-|w| / stribeck_speed)",
    looks_like: "The missing torque has a peak on both sides of zero speed; jerky slow motion (stick-slip); breakaway at a higher voltage than stopping",
    confused_with: &["coulomb_friction", "cogging"],
    experiment: "Very slow ramps through zero, several times, starting at other angles: cogging depends on the angle, Stribeck friction does not",
    remedy: "Compensation up to the Coulomb level only (more makes it hunt); an impulse or dither to break loose; integral action off at standstill",
    source: "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994); the exponential: Tustin, Journal IEE 94 (1947)",
};

impl Effect for StribeckFriction {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let excess_nm = 0.03 * scales.stall_torque_nm();
        [0.01, 0.03, 0.1].map(|share| vec![excess_nm, share * scales.speed_rad_per_s, 0.0]).to_vec()
    }

    /// With half the excess at the same speed.
    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        let is_exponential = values[2] > 0.0;
        let speed_rad_per_s =
            values[1] * if is_exponential { 1.0 / EXPONENTIAL_OVER_BELL } else { EXPONENTIAL_OVER_BELL };
        vec![vec![values[0], speed_rad_per_s, f64::from(!is_exponential)]]
    }

    /// Both laws, with another excess or another speed.
    fn elsewhere(&self, values: &[f64], scales: &Scales) -> Vec<Vec<f64>> {
        let laws = [vec![values.to_vec()], self.other_laws(values, scales)].concat();
        let varied = |law: &Vec<f64>| {
            let at = |constant: usize, factor: f64| {
                let mut other = law.clone();
                other[constant] *= factor;
                other
            };
            [0, 1].into_iter().flat_map(|constant| ELSEWHERE.map(|factor| at(constant, factor))).collect::<Vec<_>>()
        };
        laws.iter().flat_map(varied).collect()
    }

    /// Bristles that bend before they slip smooth what here breaks loose at once.
    fn simplification(&self) -> Simplification {
        Simplification { own: 0.024, inertia: 0.0, viscous_friction: 0.0 }
    }

    /// What it adds falls off to the Coulomb level; beside a wave over the angle the excess alone is what the wave leaves.
    fn stands_on(&self) -> Option<(&'static str, Alone)> {
        Some(("coulomb_friction", Alone::Rarely))
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        let ratio = at.speed_rad_per_s.abs() / values[1].max(1e-9);
        let power = if values[2] > 0.0 { ratio } else { ratio * ratio };
        let excess_nm = values[0] * (-power).exp();
        balance.dry_forward_nm += excess_nm;
        balance.dry_backward_nm += excess_nm;
    }
}

//! Stribeck friction: the torque to break loose is greater than the torque to keep moving. The excess falls off with speed.

use super::{
    About, ActsOn, Alone, Balance, Coordinate, Instant, Law, Parameter, Scales, Search, Shown, Simplification,
    Strength, Unit,
};
use crate::Term;
use crate::motor::MotorParameters;

/// Greatest Stribeck speed, as a share of the no-load speed: an excess above would be Coulomb friction or drag.
const MOST_OF_SPEED: f64 = 0.1;
/// A usual one.
const USUAL_OF_SPEED: f64 = 0.03;
/// Stribeck speed of the exponential over that of the bell, where both fall to half at the same speed.
const EXPONENTIAL_OVER_BELL: f64 = 1.2;

/// Sticking makes the cost uneven: a fit stops within these factors of the right excess or speed.
const ELSEWHERE: [f64; 2] = [0.7, 1.4];

/// See the module.
pub struct StribeckFriction;

static ABOUT: About = About {
    id: "stribeck_friction",
    title: "Stribeck friction (breakaway above the Coulomb level)",
    acts_on: &[ActsOn::Torque],
    parameters: &[
        Parameter::positive("excess_torque_Nm", Unit::NewtonMetre),
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
    // Real contacts bend before they slip; here the shaft breaks loose at once.
    simplification: Simplification::of_own(0.024),
    // It is an excess over the Coulomb level. Without one it is often no more than the rest of a wave over the angle.
    requires: Some(("coulomb_friction", Alone::Rarely)),
    acts_at_breakaway: true,
    shown: Shown::new(Strength::Torque, Coordinate::Speed),
    ..About::DEFAULT
};

impl Law for StribeckFriction {
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
        let ratio = at.middle_rad_per_s.abs() / values[1].max(1e-9);
        let power = if values[2] > 0.0 { ratio } else { ratio * ratio };
        let excess_nm = values[0] * (-power).exp();
        balance.dry_forward_nm += excess_nm;
        balance.dry_backward_nm += excess_nm;
    }
}

impl Search for StribeckFriction {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let excess_nm = 0.03 * scales.stall_torque_nm();
        [0.01, USUAL_OF_SPEED, 0.1].map(|share| vec![excess_nm, share * scales.speed_rad_per_s, 0.0]).to_vec()
    }

    /// A shaft that breaks loose on a slow ramp looks like one that loses a load at that moment.
    fn instead_of(&self, rival: &str, values: &[f64], scales: &Scales) -> Option<Vec<f64>> {
        (rival == "load_step").then(|| vec![values[0].abs(), USUAL_OF_SPEED * scales.speed_rad_per_s, 0.0])
    }

    /// Without the load, the Coulomb level alone held the shaft until then.
    fn leaves(&self, rival: &str, values: &[f64], other: &Term) -> Option<Vec<f64>> {
        let is_level = rival == "load_step" && other.id() == "coulomb_friction";
        is_level.then(|| vec![(other.values[0] - values[0].abs()).max(0.0)])
    }

    /// The other law, with half the excess at the same speed.
    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        let is_exponential = values[2] > 0.0;
        let speed_rad_per_s =
            values[1] * if is_exponential { 1.0 / EXPONENTIAL_OVER_BELL } else { EXPONENTIAL_OVER_BELL };
        vec![vec![values[0], speed_rad_per_s, f64::from(!is_exponential)]]
    }

    /// Both laws, each with another excess or another speed.
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
}

//! Unbalance under gravity: an arm, a crank or an eccentric mass on a horizontal shaft.

use super::{About, ActsOn, Coordinate, Law, Parameter, Scales, Search, Shown, Strength, Unit, Wave};

/// See the module.
pub struct GravityUnbalance;

static ABOUT: About = About {
    id: "gravity_unbalance",
    title: "an unbalanced mass under gravity",
    acts_on: &[ActsOn::Torque],
    parameters: &[Parameter::signed("cosine_Nm", Unit::NewtonMetre), Parameter::signed("sine_Nm", Unit::NewtonMetre)],
    linear_in: 2,
    law: "T = cosine_Nm cos(a) + sine_Nm sin(a)",
    looks_like: "The missing torque folded over a revolution is one wave; the shaft comes to rest at one angle",
    confused_with: &["cogging", "encoder_eccentricity"],
    experiment: "Turn the bench so that the shaft stands upright: gravity disappears, everything else stays",
    remedy: "Feed-forward of m g r sin(a); balance the load",
    source: "Leonhard, Control of Electrical Drives (2001)",
    responds_linearly: true,
    shown: Shown::new(Strength::Torque, Coordinate::Angle),
    ..About::DEFAULT
};

impl Law for GravityUnbalance {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn wave(&self, values: &[f64]) -> Option<Wave> {
        Some(Wave { against_nm: [values[0], values[1]], periods_per_rev: 1.0 })
    }
}

impl Search for GravityUnbalance {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let torque_nm = 0.02 * scales.stall_torque_nm();
        vec![vec![torque_nm, torque_nm]]
    }
}

//! Cogging: the magnets pull the rotor's teeth to preferred angles.

use super::{About, ActsOn, Coordinate, Law, Parameter, Scales, Search, Shown, Strength, Unit, Wave};

/// Most periods a revolution that are looked for: slots times poles of a small motor.
const MOST_PERIODS: u8 = 24;

/// See the module.
pub struct Cogging;

static ABOUT: About = About {
    id: "cogging",
    title: "cogging",
    acts_on: &[ActsOn::Torque],
    parameters: &[
        Parameter::signed("cosine_Nm", Unit::NewtonMetre),
        Parameter::signed("sine_Nm", Unit::NewtonMetre),
        Parameter::tried("periods_per_rev"),
    ],
    linear_in: 2,
    law: "T = cosine_Nm cos(n a) + sine_Nm sin(n a), n = periods_per_rev, two or more",
    looks_like: "The missing torque folded over a revolution is a wave of several periods; ripple in speed at a multiple of the rotation, strongest when slow",
    confused_with: &["gravity_unbalance", "tacho_ripple", "stribeck_friction"],
    experiment: "Turn slowly with the current measured: cogging shows in the current, a fault of the speed sensor does not",
    remedy: "Table of feed-forward over the angle; a faster inner loop; avoid very slow motion",
    source: "Hanselman, Brushless Permanent Magnet Motor Design (2003)",
    responds_linearly: true,
    shown: Shown::new(Strength::Torque, Coordinate::Angle),
    ..About::DEFAULT
};

impl Law for Cogging {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn wave(&self, values: &[f64]) -> Option<Wave> {
        Some(Wave { against_nm: [values[0], values[1]], periods_per_rev: values[2] })
    }
}

impl Search for Cogging {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let torque_nm = 0.02 * scales.stall_torque_nm();
        (2..=MOST_PERIODS).map(|periods| vec![torque_nm, torque_nm, f64::from(periods)]).collect()
    }
}

//! Friction that falls as grease and brushes warm up.

use super::{
    About, ActsOn, Balance, Coordinate, Effect, Instant, Law, Parameter, Scales, Search, Shown, Strength, Unit,
    slow_drift,
};
use crate::motor::MotorParameters;

/// Least time constant: no bearing warms up faster.
const LEAST_S: f64 = 0.5;

/// Greatest excess: at 50 degrees a mineral oil of grease (ISO VG 100) has a fifth of its viscosity at 20.
const MOST_EXCESS: f64 = 4.0;

/// See the module.
pub struct FrictionWarmup;

static ABOUT: About = About {
    id: "friction_warmup",
    title: "friction that falls while the motor warms up",
    acts_on: &[ActsOn::Torque],
    parameters: &[
        Parameter::within("excess_share", Unit::One, 0.0, MOST_EXCESS),
        Parameter::slow("time_constant_s", LEAST_S, 1e4),
        Parameter::choice("dry_only"),
    ],
    linear_in: 1,
    law: "Viscous and Coulomb friction are greater by excess_share exp(-t / time_constant_s); Coulomb friction alone with dry_only = 1",
    looks_like: "The friction curve of the first seconds lies above that of the last",
    confused_with: &["winding_heating", "load_step"],
    experiment: "Record again at once, without a pause: warm friction stays low; and after an hour's rest",
    remedy: "Warm up before tuning; integral action; tune for the warm motor with margin for the cold one",
    source: "Harnoy, Bearing Design in Machinery (2002)",
    shown: Shown::new(Strength::Friction, Coordinate::Time),
    ..About::DEFAULT
};

impl Law for FrictionWarmup {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    /// It scales the Coulomb friction, and neither its asymmetry nor the Stribeck excess.
    fn turn(&self, _values: &[f64]) -> i8 {
        -1
    }

    fn contribute(
        &self,
        values: &[f64],
        motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        let excess = values[0] * (-at.time_s / values[1]).exp();
        if values[2] == 0.0 {
            balance.viscous_nm_s += excess * (motor.viscous_friction_nm_s + balance.viscous_nm_s);
        }
        balance.dry_forward_nm *= 1.0 + excess;
        balance.dry_backward_nm *= 1.0 + excess;
    }
}

impl Search for FrictionWarmup {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        [0.12, 0.35].map(|share| vec![0.4, (share * scales.duration_s).max(LEAST_S), 0.0]).to_vec()
    }

    /// Grease changes viscous and dry friction alike; brushes and seals have dry friction alone.
    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![values[0], values[1], 1.0 - values[2]]]
    }

    /// A drift is often slower or faster than this law has it.
    fn similar_laws(&self, _values: &[f64], scales: &Scales) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        vec![slow_drift::none_yet(scales)]
    }
}

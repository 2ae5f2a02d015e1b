//! Shaft compliance: a springy shaft, belt or coupling drives the load; the sensor is at the motor.

use super::backlash::MOST_SHARE;
use super::{About, ActsOn, Balance, Instant, Law, Parameter, Scales, Search, Unit};
use crate::motor::MotorParameters;
use std::ops::Range;

/// Stiffness in Nm/rad and damping in Nm s/rad of the spring.
fn spring(values: &[f64], motor: &MotorParameters) -> (f64, f64) {
    let share = values[1].clamp(1e-3, MOST_SHARE);
    let reduced_kg_m2 = share * (1.0 - share) * motor.inertia_kg_m2;
    let rate = std::f64::consts::TAU * values[0];
    (reduced_kg_m2 * rate * rate, 2.0 * values[2] * reduced_kg_m2 * rate)
}

/// See the module.
pub struct ShaftCompliance;

static ABOUT: About = About {
    id: "shaft_compliance",
    title: "a springy shaft between motor and load",
    acts_on: &[ActsOn::Torque],
    parameters: &[
        // Above, a shaft counts as stiff; more damped, it does not ring.
        Parameter::within("resonance_Hz", Unit::Hertz, 1.0, 120.0),
        Parameter::within("load_inertia_share", Unit::One, 0.0, MOST_SHARE),
        Parameter::within("damping_ratio", Unit::One, 0.0, 0.3),
    ],
    linear_in: 0,
    law: "Two masses on a spring: resonance_Hz with the motor free, load_inertia_share of the whole inertia behind the spring",
    looks_like: "After each step the speed rings at one frequency that does not depend on speed",
    confused_with: &["backlash"],
    experiment: "A chirp through the resonance: a spring rings at one frequency whatever the amplitude, a gap does not",
    remedy: "Notch filter at the resonance or a bandwidth well below it; acceleration limits on the reference",
    source: "Leonhard, Control of Electrical Drives (2001)",
    strengths: &[Range { start: 1, end: 2 }],
    ..About::DEFAULT
};

impl Law for ShaftCompliance {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    /// Twist, and speed of the load.
    fn states(&self) -> usize {
        2
    }

    fn begins(&self, speed_rad_per_s: f64) -> Vec<f64> {
        vec![0.0, speed_rad_per_s]
    }

    fn motor_share(&self, values: &[f64]) -> f64 {
        1.0 - values[1]
    }

    fn contribute(
        &self,
        values: &[f64],
        motor: &MotorParameters,
        _at: &Instant,
        state: &mut [f64],
        balance: &mut Balance,
    ) {
        let (stiffness, damping) = spring(values, motor);
        balance.torque_nm += damping * state[1] - stiffness * state[0];
        balance.viscous_nm_s += damping;
    }

    fn advance(&self, values: &[f64], motor: &MotorParameters, at: &Instant, state: &mut [f64]) {
        let (stiffness, damping) = spring(values, motor);
        let load_kg_m2 = values[1].max(1e-3) * motor.inertia_kg_m2;
        let pull_nm = stiffness * state[0] + damping * (at.speed_rad_per_s - state[1]);
        state[1] += at.step_s * pull_nm / load_kg_m2;
        state[0] += at.step_s * (at.speed_rad_per_s - state[1]);
    }
}

impl Search for ShaftCompliance {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        [8.0, 12.0, 18.0, 27.0, 40.0, 60.0].map(|resonance_hz| vec![resonance_hz, 0.4, 0.05]).to_vec()
    }

    /// The resonance may lie between two starts.
    fn elsewhere(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        [0.7, 0.85, 1.2, 1.4].map(|factor| vec![factor * values[0], values[1], values[2]]).to_vec()
    }
}

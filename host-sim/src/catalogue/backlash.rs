//! Backlash: the load hangs behind a gap in a gear or a coupling; the sensor sees the motor.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales, Simplification};
use crate::motor::MotorParameters;

/// Natural frequency of the contact: high enough to be a blow.
const CONTACT_HZ: f64 = 300.0;
/// Damping ratio of the contact: plastic and brass gears hardly rebound.
const CONTACT_DAMPING: f64 = 0.4;

/// Step that follows the contact.
const STEP_S: f64 = 0.2e-3;

/// Torque that the motor exerts on the load; the two push and do not pull.
fn contact_nm(values: &[f64], motor: &MotorParameters, state: &[f64], speed_rad_per_s: f64) -> f64 {
    let half_gap_rad = 0.5 * values[0];
    let depth_rad = state[0] - state[0].clamp(-half_gap_rad, half_gap_rad);
    if depth_rad == 0.0 {
        return 0.0;
    }
    let share = values[1].clamp(1e-3, 0.95);
    let reduced_kg_m2 = share * (1.0 - share) * motor.inertia_kg_m2;
    let rate = std::f64::consts::TAU * CONTACT_HZ;
    let slip = speed_rad_per_s - state[1];
    let torque_nm = reduced_kg_m2 * rate * (rate * depth_rad + 2.0 * CONTACT_DAMPING * slip);
    if depth_rad > 0.0 { torque_nm.max(0.0) } else { torque_nm.min(0.0) }
}

/// See the module.
pub struct Backlash;

static ABOUT: About = About {
    id: "backlash",
    title: "backlash between motor and load",
    acts_on: ActsOn::Torque,
    parameters: &[Parameter::within("gap_rad", 0.0, 1.0), Parameter::within("load_inertia_share", 0.0, 0.95)],
    linear_in: 0,
    law: "The load follows only in contact: a stiff spring with a dead zone of gap_rad",
    looks_like: "After each reversal of torque the motor runs light for a moment, then hits; the missing torque is a pair of pulses",
    confused_with: &["shaft_compliance", "stribeck_friction"],
    experiment: "Reverse slowly from rest with an encoder on each side, or feel the play by hand",
    remedy: "Slow reversals; no derivative on the motor side at the gap; a dead-zone inverse in position control",
    source: "Nordin and Gutman, Automatica 38 (2002)",
};

impl Effect for Backlash {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    /// The flanks are elastic: the blow is softer, and the gap at rest wider than it is in motion.
    fn simplification(&self) -> Simplification {
        Simplification { own: 3e-2, inertia: 0.0, viscous_friction: 0.0 }
    }

    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        [0.02, 0.05, 0.12].map(|gap_rad| vec![gap_rad, 0.4]).to_vec()
    }

    /// Twist, speed of the load, speed of the motor before the step.
    fn states(&self) -> usize {
        3
    }

    fn longest_step_s(&self) -> f64 {
        STEP_S
    }

    fn motor_share(&self, values: &[f64]) -> f64 {
        1.0 - values[1]
    }

    fn contribute(&self, values: &[f64], motor: &MotorParameters, at: &Instant, state: &[f64], balance: &mut Balance) {
        balance.torque_nm -= contact_nm(values, motor, state, at.speed_rad_per_s);
    }

    fn advance(&self, values: &[f64], motor: &MotorParameters, at: &Instant, state: &mut [f64]) {
        let load_kg_m2 = values[1].max(1e-3) * motor.inertia_kg_m2;
        // The very torque that acted on the motor during this step, or momentum would be lost.
        state[1] += at.step_s * contact_nm(values, motor, state, state[2]) / load_kg_m2;
        state[2] = at.speed_rad_per_s;
        state[0] += at.step_s * (at.speed_rad_per_s - state[1]);
    }
}

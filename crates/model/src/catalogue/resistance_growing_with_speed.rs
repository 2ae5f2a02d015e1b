//! Resistance growing with speed: a coil that a brush short-circuits has little time to turn its current round, and what it
//! has not turned round by then is lost in the spark. The faster the commutator, the more voltage that takes; brushes that
//! begin to bounce do the same.

use super::{About, ActsOn, Balance, Effect, Instant, Parameter, Scales, Simplification};
use crate::motor::MotorParameters;

/// See the module.
pub struct ResistanceGrowingWithSpeed;

static ABOUT: About = About {
    id: "resistance_growing_with_speed",
    title: "a resistance that grows with the speed",
    acts_on: ActsOn::Voltage,
    parameters: &[Parameter::positive("growth_ohm_s")],
    linear_in: 1,
    law: "R grows by growth_ohm_s |w|",
    looks_like: "The missing voltage is in proportion to current and speed: steady points alone show a resistance that depends on the speed",
    confused_with: &["supply_sag", "quadratic_drag", "winding_heating"],
    experiment: "Brake the shaft at one speed with several torques, with the current measured, and again at another speed: what the voltage changes by with the current is the resistance there",
    remedy: "Brushes and commutator cleaned or replaced; speed limited where they spark",
    source: "Fitzgerald, Kingsley, Umans, Electric Machinery (2003), reactance voltage of commutation: in proportion to current and speed",
};

impl Effect for ResistanceGrowingWithSpeed {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.1 * scales.motor.resistance_ohm / scales.speed_rad_per_s]]
    }

    /// A drop that the swing of the current within a period evens out is as much off at great speeds.
    fn simplification(&self) -> Simplification {
        Simplification { own: 0.01, inertia: 0.0, viscous_friction: 0.0 }
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.resistance_ohm += values[0] * at.speed_rad_per_s.abs();
    }
}

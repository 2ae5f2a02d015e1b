//! Resistance growing with speed: the current in a coil reverses while a brush short-circuits it. At a high speed there is
//! little time for that, and the rest is lost in a spark. Brushes that bounce have the same effect.

use super::{
    About, ActsOn, Balance, Coordinate, Instant, Law, Parameter, Scales, Search, Shown, Simplification, Strength, Unit,
};
use crate::motor::MotorParameters;

/// See the module.
pub struct ResistanceGrowingWithSpeed;

static ABOUT: About = About {
    id: "resistance_growing_with_speed",
    title: "a resistance that grows with the speed",
    acts_on: &[ActsOn::Voltage],
    parameters: &[Parameter::positive("growth_ohm_s", Unit::OhmSecond)],
    linear_in: 1,
    law: "R grows by growth_ohm_s |w|",
    looks_like: "The missing voltage is in proportion to current and speed: steady points alone show a resistance that depends on the speed",
    confused_with: &["supply_sag", "quadratic_drag", "winding_heating"],
    experiment: "Brake the shaft at one speed with several torques, with the current measured, and again at another speed: what the voltage changes by with the current is the resistance there",
    remedy: "Brushes and commutator cleaned or replaced; speed limited where they spark",
    source: "Fitzgerald, Kingsley, Umans, Electric Machinery (2003), reactance voltage of commutation: in proportion to current and speed",
    // The swing of the current within a PWM period smooths a drop, with an error of this size at high speeds.
    simplification: Simplification::of_own(0.01),
    shown: Shown::new(Strength::Resistance, Coordinate::SpeedSize),
    ..About::DEFAULT
};

impl Law for ResistanceGrowingWithSpeed {
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
        balance.resistance_ohm += values[0] * at.middle_rad_per_s.abs();
    }
}

impl Search for ResistanceGrowingWithSpeed {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.1 * scales.motor.resistance_ohm / scales.speed_rad_per_s]]
    }
}

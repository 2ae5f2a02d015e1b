//! Winding heating: copper gains 0.39 % of resistance a kelvin.

use super::{
    About, ActsOn, Balance, Coordinate, Effect, Instant, Law, Parameter, Scales, Search, Shown, Simplification,
    Strength, Unit, slow_drift,
};
use crate::motor::MotorParameters;

/// Least time constant: no winding warms up faster.
const LEAST_S: f64 = 0.5;

/// See the module.
pub struct WindingHeating;

static ABOUT: About = About {
    id: "winding_heating",
    title: "a winding that heats up",
    acts_on: &[ActsOn::Voltage],
    parameters: &[Parameter::positive("rise_per_W", Unit::PerWatt), Parameter::slow("time_constant_s", LEAST_S, 1e5)],
    linear_in: 1,
    law: "R grows by the share rise_per_W times the dissipated power, low-passed with time_constant_s",
    looks_like: "The missing voltage in proportion to the current grows during the recording and falls in pauses",
    confused_with: &["friction_warmup", "supply_sag"],
    experiment: "Measure the resistance at rest directly before and after a run under load",
    remedy: "Scale current limits and feed-forward with the estimated temperature; longer pauses",
    source: "IEC 60034-1; 0.00393 1/K for copper at 20 degrees",
    // The ripple of the current heats as well, and the mean current does not include it.
    simplification: Simplification::of_own(0.01),
    is_slow_resistance: true,
    shown: Shown::new(Strength::Resistance, Coordinate::Time),
    ..About::DEFAULT
};

impl Law for WindingHeating {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn states(&self) -> usize {
        1
    }

    fn contribute(
        &self,
        values: &[f64],
        motor: &MotorParameters,
        _at: &Instant,
        state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.resistance_ohm += motor.resistance_ohm * values[0] * state[0];
    }

    fn advance(&self, values: &[f64], motor: &MotorParameters, at: &Instant, state: &mut [f64]) {
        let power_w = motor.resistance_ohm * (1.0 + values[0] * state[0]) * at.current_a * at.current_a;
        state[0] += (power_w - state[0]) * at.step_s / values[1];
    }
}

impl Search for WindingHeating {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let power_w = 0.3 * scales.motor.resistance_ohm * scales.current_a.powi(2);
        [0.1, 0.5].map(|share| vec![0.2 / power_w.max(1e-9), (share * scales.duration_s).max(LEAST_S)]).to_vec()
    }

    /// A drift is often slower or faster than this law has it.
    fn similar_laws(&self, _values: &[f64], scales: &Scales) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        vec![slow_drift::none_yet(scales)]
    }
}

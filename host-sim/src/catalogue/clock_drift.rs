//! Clock drift: the commands and the rows are timed by two clocks, a computer's and a board's, that do not run equally fast.

use super::{About, ActsOn, Channels, Effect, Parameter, Scales, Simplification};

/// Parts per million in one.
const PPM: f64 = 1e-6;
/// Two quartz crystals differ by tens of these, a ceramic resonator by thousands.
const USUAL_PPM: f64 = 50.0;

/// In the end it has to come to this share of a row: less is where in its row a command acts.
const LEAST_ROWS: f64 = 0.5;

/// See the module.
pub struct ClockDrift;

static ABOUT: About = About {
    id: "clock_drift",
    title: "two clocks that run unequally fast",
    acts_on: ActsOn::Voltage,
    parameters: &[Parameter::within("drift_ppm", -5000.0, 5000.0)],
    linear_in: 1,
    law: "A command acts later by drift_ppm microseconds for each second of the recording",
    looks_like: "The response to each step comes a little later, or earlier, than that to the step before",
    confused_with: &["actuation_delay", "winding_heating", "friction_warmup"],
    experiment: "Record commands and readings with the same clock",
    remedy: "Nothing at the motor: stamp commands and readings with one clock",
    source: "Ljung, System Identification (1999), on data preprocessing",
};

impl Effect for ClockDrift {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![USUAL_PPM]]
    }

    /// Moments of commands that are sought follow any clock.
    fn shows_in(&self, channels: &Channels) -> bool {
        !channels.moments
    }

    /// Less than a row is in the scale of the rows' own clock.
    fn is_a_scale(&self, values: &[f64], scales: &Scales) -> bool {
        (PPM * values[0]).abs() * scales.duration_s < LEAST_ROWS * scales.interval_s
    }

    fn simplification(&self) -> Simplification {
        Simplification { own: 5e-3, inertia: 0.0, viscous_friction: 0.0 }
    }

    fn delay_growth(&self, values: &[f64]) -> f64 {
        PPM * values[0]
    }

    fn acts_on_motor(&self) -> bool {
        false
    }

    fn changes_motion(&self) -> bool {
        true
    }
}

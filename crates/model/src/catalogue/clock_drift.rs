//! Clock drift: commands and rows are timed by two clocks, a computer's and a board's, that do not run equally fast.

use super::{
    About, ActsOn, Channels, Coordinate, Law, Parameter, Scales, Search, Shown, Simplification, Strength, Unit,
};

/// One part per million.
const PPM: f64 = 1e-6;
/// Two quartz crystals differ by tens of parts per million, a ceramic resonator by thousands.
const USUAL_PPM: f64 = 50.0;
const MOST_PPM: f64 = 5000.0;
/// At the end of the recording the drift has to reach this share of a row. A shorter time only says where in its row a
/// command acts.
const LEAST_ROWS: f64 = 0.5;

/// See the module.
pub struct ClockDrift;

static ABOUT: About = About {
    id: "clock_drift",
    title: "two clocks that run unequally fast",
    acts_on: &[ActsOn::Voltage],
    parameters: &[Parameter::within("drift_ppm", Unit::PartPerMillion, -MOST_PPM, MOST_PPM)],
    linear_in: 1,
    law: "u(t - drift_ppm 1e-6 t)",
    looks_like: "The response to each step comes a little later, or earlier, than that to the step before",
    confused_with: &["actuation_delay", "winding_heating", "friction_warmup"],
    experiment: "Record commands and readings with the same clock",
    remedy: "Nothing at the motor: stamp commands and readings with one clock",
    source: "Ljung, System Identification (1999), on data preprocessing",
    // A new duty takes effect when the next period of the PWM begins.
    simplification: Simplification::of_own(5e-3),
    is_delay: true,
    shown: Shown::new(Strength::Delay, Coordinate::Time),
    ..About::DEFAULT
};

impl Law for ClockDrift {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn delay_growth(&self, values: &[f64]) -> f64 {
        PPM * values[0]
    }
}

impl Search for ClockDrift {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![USUAL_PPM]]
    }

    fn is_a_scale(&self, values: &[f64], scales: &Scales) -> bool {
        (PPM * values[0]).abs() * scales.duration_s < LEAST_ROWS * scales.interval_s
    }

    /// Where the moments of the commands are estimated, they follow any clock. So does a lateness that is followed.
    fn can_show_in(&self, channels: &Channels) -> bool {
        !channels.moments && !channels.lateness
    }
}

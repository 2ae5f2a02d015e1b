//! Current lag: a filter capacitor at the sensor or averaging in the program.

use super::{About, ActsOn, Effect, Parameter, Readings, Sampling, Scales};

/// See the module.
pub struct CurrentLag;

static ABOUT: About = About {
    id: "current_lag",
    title: "a lag of the current reading",
    acts_on: ActsOn::CurrentSensor,
    parameters: &[Parameter::within("time_constant_s", 0.0, 1.0)],
    linear_in: 0,
    law: "first-order lag with time_constant_s",
    looks_like: "The current's peaks after a step are round and late while the speed is right",
    confused_with: &["actuation_delay"],
    experiment: "Hold the rotor and step the voltage, current on an oscilloscope beside the reading",
    remedy: "A smaller capacitor; the filter's state in the observer",
    source: "Allegro ACS712 data sheet (filter pin)",
};

impl Effect for CurrentLag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        [0.002_f64, 0.008].map(|time_constant_s| vec![time_constant_s.max(0.5 * scales.interval_s)]).to_vec()
    }

    fn states(&self) -> usize {
        1
    }

    fn sense(&self, values: &[f64], at: &Sampling, state: &mut [f64], readings: &mut Readings) {
        let keep = if values[0] > 0.0 { (-at.step_s / values[0]).exp() } else { 0.0 };
        state[0] = keep * state[0] + (1.0 - keep) * readings.current_a;
        readings.current_a = state[0];
    }
}

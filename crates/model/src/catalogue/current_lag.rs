//! Current lag: a filter capacitor at the sensor or averaging in the program.

use super::{About, ActsOn, INDUCTANCE, Law, Readings, Sampling, Scales, Search, Sensor, low_pass};

/// See the module.
pub struct CurrentLag;

static ABOUT: About = About {
    id: "current_lag",
    title: "a lag of the current reading",
    acts_on: &[ActsOn::CurrentSensor],
    parameters: &low_pass::PARAMETERS,
    linear_in: 0,
    law: low_pass::LAW,
    looks_like: "The current's peaks after a step are round and late while the speed is right",
    confused_with: &["actuation_delay"],
    experiment: "Hold the rotor and step the voltage, current on an oscilloscope beside the reading",
    remedy: "A smaller capacitor; the filter's state in the observer",
    source: "Allegro ACS712 data sheet (filter pin)",
    sensor: Some(Sensor::Current),
    ..About::DEFAULT
};

impl Law for CurrentLag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn current_late_s(&self, values: &[f64]) -> f64 {
        values[0]
    }

    fn states(&self) -> usize {
        low_pass::STATES
    }

    /// A filter at the sensor acts before the sensor's other effects.
    fn turn(&self, values: &[f64]) -> i8 {
        low_pass::turn(values, -1)
    }

    fn sense(&self, values: &[f64], at: &Sampling, state: &mut [f64], readings: &mut Readings) {
        low_pass::pass(values, at.step_s, at.bulge, state, &mut readings.current_a);
    }
}

impl Search for CurrentLag {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        low_pass::starts(scales)
    }

    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        low_pass::other_laws(values)
    }

    /// More inductance delays the current by as much. Only the torque shows that the current itself was not late.
    fn instead_of(&self, rival: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        (rival == INDUCTANCE).then(|| vec![values[0], 0.0, 0.0])
    }
}

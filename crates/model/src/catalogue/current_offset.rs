//! Current offset: the zero of the sensor differs from the zero that the program subtracts.

use super::{
    About, ActsOn, Coordinate, Law, Parameter, Readings, Sampling, Scales, Search, Sensor, Shown, Strength, Unit,
};

/// See the module.
pub struct CurrentOffset;

static ABOUT: About = About {
    id: "current_offset",
    title: "an offset of the current reading",
    acts_on: &[ActsOn::CurrentSensor],
    parameters: &[Parameter::signed("offset_A", Unit::Ampere)],
    linear_in: 1,
    law: "reading = i + offset_A",
    looks_like: "A current at rest with the bridge off",
    confused_with: &["load_torque", "friction_asymmetry"],
    experiment: "Read the current with the motor unplugged",
    remedy: "Calibrate the zero at rest before every run (the console's zero command)",
    source: "Allegro ACS712 data sheet (zero current output)",
    sensor: Some(Sensor::Current),
    shown: Shown::new(Strength::Reading, Coordinate::Current),
    ..About::DEFAULT
};

impl Law for CurrentOffset {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn sense(&self, values: &[f64], _at: &Sampling, _state: &mut [f64], readings: &mut Readings) {
        readings.current_a += values[0];
    }
}

impl Search for CurrentOffset {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.02 * scales.current_a.max(0.1)]]
    }
}

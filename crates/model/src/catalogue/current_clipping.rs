//! Current clipping: the range of the sensor or the converter is smaller than that of the current.

use super::{
    About, ActsOn, Coordinate, Law, Parameter, Readings, Sampling, Scales, Search, Sensor, Shown, Strength, Unit,
};

/// See the module.
pub struct CurrentClipping;

static ABOUT: About = About {
    id: "current_clipping",
    title: "a current reading that clips",
    acts_on: &[ActsOn::CurrentSensor],
    parameters: &[Parameter::positive("limit_A", Unit::Ampere)],
    linear_in: 0,
    law: "reading = i limited to +-limit_A",
    looks_like: "The reading's peaks are flat at one value, both ways",
    confused_with: &[],
    experiment: "Read the same current with a sensor of a wider range",
    remedy: "A sensor of a wider range; current limits below the clip",
    source: "Allegro ACS712 data sheet (range)",
    sensor: Some(Sensor::Current),
    shown: Shown::new(Strength::Reading, Coordinate::Current),
    ..About::DEFAULT
};

impl Law for CurrentClipping {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    /// The range of the converter limits the output of the sensor, which includes its filter and offset.
    fn turn(&self, _values: &[f64]) -> i8 {
        1
    }

    fn sense(&self, values: &[f64], _at: &Sampling, _state: &mut [f64], readings: &mut Readings) {
        readings.current_a = readings.current_a.clamp(-values[0], values[0]);
    }
}

impl Search for CurrentClipping {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        [0.5, 0.65, 0.8, 0.95].map(|share| vec![share * scales.current_a]).to_vec()
    }
}

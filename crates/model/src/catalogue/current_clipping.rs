//! Current clipping: the sensor or the converter ends before the current does.

use super::{About, ActsOn, Effect, Parameter, Readings, Sampling, Scales};

/// See the module.
pub struct CurrentClipping;

static ABOUT: About = About {
    id: "current_clipping",
    title: "a current reading that clips",
    acts_on: ActsOn::CurrentSensor,
    parameters: &[Parameter::positive("limit_A")],
    linear_in: 0,
    law: "reading = i limited to +-limit_A",
    looks_like: "The reading's peaks are flat at one value, both ways",
    confused_with: &[],
    experiment: "Read the same current with a sensor of a wider range",
    remedy: "A sensor of a wider range; current limits below the clip",
    source: "Allegro ACS712 data sheet (range)",
};

impl Effect for CurrentClipping {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        [0.5, 0.65, 0.8, 0.95].map(|share| vec![share * scales.current_a]).to_vec()
    }

    /// The converter's range ends what a sensor with its filter and offset shows.
    fn turn(&self, _values: &[f64]) -> i8 {
        1
    }

    fn sense(&self, values: &[f64], _at: &Sampling, _state: &mut [f64], readings: &mut Readings) {
        readings.current_a = readings.current_a.clamp(-values[0], values[0]);
    }
}

//! Tachogenerator ripple: its voltage falls while its commutator changes over between segments.

use super::{
    About, ActsOn, Coordinate, Law, Parameter, Readings, Sampling, Scales, Search, Sensor, Shown, Strength, Unit,
};
use crate::Term;

/// Most ripples a revolution that are looked for.
const MOST_RIPPLES: u8 = 40;

/// See the module.
pub struct TachoRipple;

static ABOUT: About = About {
    id: "tacho_ripple",
    title: "ripple of the tachogenerator",
    acts_on: &[ActsOn::AngleSensor],
    parameters: &[
        Parameter::signed("cosine_share", Unit::One),
        Parameter::signed("sine_share", Unit::One),
        Parameter::tried("ripples_per_rev"),
    ],
    linear_in: 2,
    law: "speed reading = w (1 + cosine_share cos(n a) + sine_share sin(n a)), n = ripples_per_rev",
    looks_like: "The speed ripples many times a revolution, in proportion to the speed, while the current does not",
    confused_with: &["cogging", "encoder_eccentricity"],
    experiment: "Compare with an encoder, or look whether the ripple's share stays the same at all speeds",
    remedy: "Filter below the ripple's frequency, or a notch that moves with the speed",
    source: "Data sheets of tachogenerators (ripple share)",
    sensor: Some(Sensor::Tachogenerator),
    shown: Shown::new(Strength::ShareOfReading, Coordinate::Angle),
    ..About::DEFAULT
};

impl Law for TachoRipple {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn sense(&self, values: &[f64], at: &Sampling, _state: &mut [f64], readings: &mut Readings) {
        let (sine, cosine) = (values[2] * at.angle_rad).sin_cos();
        readings.speed_rad_per_s *= 1.0 + values[0] * cosine + values[1] * sine;
    }
}

impl Search for TachoRipple {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        (1..=MOST_RIPPLES).map(|ripples| vec![0.02, 0.02, f64::from(ripples)]).collect()
    }

    /// One ripple a revolution looks like an eccentric disc, and is more likely one.
    fn yields_to(&self, values: &[f64], rival: &str, _others: &[Term]) -> bool {
        rival == "encoder_eccentricity" && values[2] == 1.0
    }
}

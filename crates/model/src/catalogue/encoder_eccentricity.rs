//! Encoder eccentricity: the disc is off centre, so the measured angle is wrong by one wave a revolution.

use super::{
    About, ActsOn, Coordinate, Law, Parameter, Readings, Sampling, Scales, Search, Sensor, Shown, Strength, Unit,
};

/// See the module.
pub struct EncoderEccentricity;

static ABOUT: About = About {
    id: "encoder_eccentricity",
    title: "an eccentric encoder disc",
    acts_on: &[ActsOn::AngleSensor],
    parameters: &[Parameter::signed("cosine_rad", Unit::Radian), Parameter::signed("sine_rad", Unit::Radian)],
    linear_in: 2,
    law: "angle reading = a + cosine_rad cos(a) + sine_rad sin(a)",
    looks_like: "The speed wobbles once a revolution, in proportion to the speed, while the current does not",
    confused_with: &["gravity_unbalance", "tacho_ripple"],
    experiment: "The wobble in proportion to the speed: a torque's falls with the speed",
    remedy: "Table of correction over the angle; average over whole revolutions; a second reading head",
    source: "Ellis, Control System Design Guide (2012)",
    falsifies_angle: true,
    sensor: Some(Sensor::Encoder),
    shown: Shown::new(Strength::ShareOfReading, Coordinate::Angle),
    ..About::DEFAULT
};

impl Law for EncoderEccentricity {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn ahead_rad(&self, values: &[f64], angle_rad: f64) -> f64 {
        let (sine, cosine) = angle_rad.sin_cos();
        let near_rad = values[0] * cosine + values[1] * sine;
        // The shaft is behind the reading by so little that two terms of the series turn the wave back.
        let slope = values[1] * cosine - values[0] * sine;
        near_rad - near_rad * slope - 0.5 * near_rad * near_rad * near_rad
    }

    fn sense(&self, values: &[f64], at: &Sampling, _state: &mut [f64], readings: &mut Readings) {
        let (sine, cosine) = at.angle_rad.sin_cos();
        readings.angle_rad += values[0] * cosine + values[1] * sine;
        readings.speed_rad_per_s *= 1.0 - values[0] * sine + values[1] * cosine;
    }
}

impl Search for EncoderEccentricity {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![0.02, 0.02]]
    }
}

//! Speed lag: a capacitor smooths the ripple of a tachogenerator, or the recording program has a low-pass.

use super::{
    About, ActsOn, Channels, INDUCTANCE, Law, Readings, Sampling, Scales, Search, Sensor, Simplification, low_pass,
};

/// See the module.
pub struct SpeedLag;

static ABOUT: About = About {
    id: "speed_lag",
    title: "a lag of the speed reading",
    acts_on: &[ActsOn::AngleSensor],
    parameters: &low_pass::PARAMETERS,
    linear_in: 0,
    law: low_pass::LAW,
    looks_like: "After a step the speed sets out level and late while the current is right",
    confused_with: &["actuation_delay", "shaft_compliance", "current_lag"],
    experiment: "Record current and counts besides: a delay moves the current too, and an encoder has no capacitor",
    remedy: "A smaller capacitor or none in the program; else bandwidth below 0.2 / time_constant_s",
    source: "Tietze and Schenk, Electronic Circuits (2008), first-order low-pass; the bilinear transform: Oppenheim and Schafer, Discrete-Time Signal Processing (2010)",
    sensor: Some(Sensor::Tachogenerator),
    // The law knows neither a ripple between two readings nor noise that was filtered as well.
    simplification: Simplification::of_own(0.01),
    ..About::DEFAULT
};

impl Law for SpeedLag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn speed_late_s(&self, values: &[f64]) -> f64 {
        values[0]
    }

    fn tachogenerator_lag_s(&self, values: &[f64]) -> f64 {
        if values[1] > 0.0 { 0.0 } else { values[0] }
    }

    fn states(&self) -> usize {
        low_pass::STATES
    }

    /// The capacitor acts after the sensor's own effects.
    fn turn(&self, values: &[f64]) -> i8 {
        low_pass::turn(values, 1)
    }

    fn sense(&self, values: &[f64], at: &Sampling, state: &mut [f64], readings: &mut Readings) {
        low_pass::pass(values, at.step_s, at.speed_bulge, state, &mut readings.speed_rad_per_s);
    }
}

impl Search for SpeedLag {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        low_pass::starts(scales)
    }

    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        low_pass::other_laws(values)
    }

    /// Without a measured current more inductance delays the speed as well; a delay of the command does so too.
    fn instead_of(&self, rival: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        [INDUCTANCE, "actuation_delay"].contains(&rival).then(|| vec![values[0], 0.0, 0.0])
    }

    /// Where the moments of the commands are estimated, they include a short lag. So does a lateness that is followed.
    fn can_show_in(&self, channels: &Channels) -> bool {
        channels.speed && !channels.moments && !channels.lateness
    }
}

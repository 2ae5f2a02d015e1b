//! Speed lag: the capacitor behind a tachogenerator that smooths its ripple, or a low-pass in the program that records.

use super::{
    About, ActsOn, Channels, Effect, INDUCTANCE, Readings, Sampling, Scales, Sensor, Simplification, low_pass,
};

/// See the module.
pub struct SpeedLag;

static ABOUT: About = About {
    id: "speed_lag",
    title: "a lag of the speed reading",
    acts_on: ActsOn::AngleSensor,
    parameters: &low_pass::PARAMETERS,
    linear_in: 0,
    law: low_pass::LAW,
    looks_like: "After a step the speed sets out level and late while the current is right",
    confused_with: &["actuation_delay", "shaft_compliance", "current_lag"],
    experiment: "Record current and counts besides: a delay moves the current too, and an encoder has no capacitor",
    remedy: "A smaller capacitor or none in the program; else bandwidth below 0.2 / time_constant_s",
    source: "Tietze and Schenk, Electronic Circuits (2008), first-order low-pass; the bilinear transform: Oppenheim and Schafer, Discrete-Time Signal Processing (2010)",
};

impl Effect for SpeedLag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        low_pass::starts(scales)
    }

    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        low_pass::other_laws(values)
    }

    /// A winding that the current does not show, or a wait of both readings.
    fn instead_of(&self, rival: &str, values: &[f64]) -> Option<Vec<f64>> {
        [INDUCTANCE, "actuation_delay"].contains(&rival).then(|| vec![values[0], 0.0, 0.0])
    }

    fn sensor(&self) -> Option<Sensor> {
        Some(Sensor::Tachogenerator)
    }

    /// Moments that are sought are as late as a short one would make them.
    fn shows_in(&self, channels: &Channels) -> bool {
        channels.speed && !channels.moments
    }

    /// What is between two readings of a motion with ripple, or of a noise that was filtered with it, is not in the law.
    fn simplification(&self) -> Simplification {
        Simplification { own: 0.01, inertia: 0.0, viscous_friction: 0.0 }
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

    /// A capacitor is behind what the sensor itself does.
    fn turn(&self, values: &[f64]) -> i8 {
        low_pass::turn(values, 1)
    }

    fn sense(&self, values: &[f64], at: &Sampling, state: &mut [f64], readings: &mut Readings) {
        low_pass::pass(values, at.step_s, at.speed_bulge, state, &mut readings.speed_rad_per_s);
    }
}

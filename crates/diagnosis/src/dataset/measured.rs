//! The measured quantities, and how exactly each is known.

use super::{Dataset, Stretch, correlated_noise, noise, resolution, spread};
pub use crate::configuration::dataset::measured::TOLERANCE;
use crate::configuration::dataset::measured::{LONGEST_CORRELATION_S, SHARED_COUNTS};
use motorbench_data::recording::Channel;

/// A measured quantity that the simulation is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Armature current.
    Current,
    /// Speed as recorded.
    Speed,
    /// Speed as recorded, a difference of counts over a [`Stretch::window`].
    MeanSpeed,
    /// Speed as recorded, timed by [`Origin::edge_timing`](super::Origin::edge_timing).
    TimedSpeed,
    /// Speed as the difference of recorded angles over a [`Stretch::window`].
    AngleDifference,
}

impl Output {
    /// Column name of what it was made from.
    pub fn channel(self) -> &'static str {
        match self {
            Self::Current => Channel::Current.column(),
            Self::Speed | Self::MeanSpeed | Self::TimedSpeed => Channel::Speed.column(),
            Self::AngleDifference => "omega_from_angle_rad_per_s",
        }
    }

    /// Title of an axis, with its unit.
    pub fn title(self) -> &'static str {
        match self {
            Self::Current => Channel::Current.title(),
            Self::Speed | Self::MeanSpeed | Self::TimedSpeed => Channel::Speed.title(),
            Self::AngleDifference => "speed from the angle, rad/s",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Current => "A",
            Self::Speed | Self::MeanSpeed | Self::TimedSpeed | Self::AngleDifference => "rad/s",
        }
    }
}

/// A measured quantity.
#[derive(Clone, Debug)]
pub struct Measured {
    /// What it is.
    pub output: Output,
    /// Its samples, missing ones as NaN.
    pub values: Vec<f64>,
    /// Standard deviation of its noise, from its scatter from sample to sample.
    pub noise: f64,
    /// Standard deviation from rounding to whole counts, or from edges anywhere in their row; 0 if it is not counted.
    pub of_counting: f64,
    /// Scatter up to this may come from counting alone.
    pub unrest_of_counting: f64,
    /// Over so many rows at most its noise is correlated.
    pub correlated_rows: usize,
    /// Error that is tolerated of a model: [`TOLERANCE`] of its spread, or the reading's own step.
    pub tolerance: f64,
}

impl Measured {
    /// Standard deviation of the noise in its residual. Few counts increase so evenly that their scatter underestimates
    /// it.
    pub fn noise_in(&self, residual: &[f64]) -> f64 {
        self.or_of_counting(correlated_noise(residual, self.correlated_rows))
    }

    fn or_of_counting(&self, unrest: f64) -> f64 {
        if unrest < self.unrest_of_counting { self.of_counting } else { unrest.max(self.of_counting) }
    }

    pub(super) fn scale(&mut self, factor: f64) {
        self.values.iter_mut().for_each(|value| *value *= factor);
        for scale in [&mut self.noise, &mut self.of_counting, &mut self.unrest_of_counting, &mut self.tolerance] {
            *scale *= factor;
        }
    }

    /// Error of the best model that can be expected, with this noise of the sensor.
    pub fn least_error(&self, noise: f64) -> f64 {
        noise.hypot(self.tolerance)
    }
}

impl Dataset {
    /// Says of every quantity how exactly it is known, from its own scatter.
    pub(super) fn judge_noise(&mut self, current_resolution_a: Option<f64>) {
        let of_counting = self.noise_of_counting();
        let correlated_rows = (LONGEST_CORRELATION_S / self.interval_s).round() as usize;
        for measured in &mut self.measured {
            if matches!(measured.output, Output::MeanSpeed | Output::AngleDifference) {
                measured.of_counting = of_counting;
                let is_from_row_to_row = self.stretches.iter().all(|stretch| stretch.window.span <= 1);
                measured.unrest_of_counting = if is_from_row_to_row { SHARED_COUNTS * of_counting } else { 0.0 };
            }
            measured.correlated_rows = correlated_rows;
            // A signal may change as quickly as correlated noise does. A residual does not.
            measured.noise = measured.or_of_counting(noise(&measured.values));
            let seen = || resolution::of_readings(&measured.values);
            let resolution = if measured.output == Output::Current { current_resolution_a.or_else(seen) } else { None };
            measured.tolerance = (TOLERANCE * spread(&measured.values)).max(resolution.unwrap_or(0.0));
        }
    }

    /// Standard deviation that rounding to whole counts causes in a speed, from both ends of its window.
    fn noise_of_counting(&self) -> f64 {
        let of_stretch = |stretch: &Stretch| {
            (self.count_rad / 6_f64.sqrt() / stretch.window_s()).powi(2) * stretch.rows.len() as f64
        };
        (self.stretches.iter().map(of_stretch).sum::<f64>() / self.len().max(1) as f64).sqrt()
    }
}

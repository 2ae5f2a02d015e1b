//! Requirements for a loop.

use super::search::MAX_SAMPLES;
use super::weights::Weights;
use motorbench_model::motor::MotorParameters;
use serde::Serialize;

/// The largest current limit. The trip above it must still fit the core's format.
pub const LARGEST_CURRENT_A: f64 = 6.6;

/// Lowest bandwidth relative to the tick rate. A slower loop does not settle within [`MAX_SAMPLES`].
const SLOWEST: f64 = 5e-5;

/// How fast the loop has to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Speed {
    /// Smallest bandwidth from the reference to the controlled quantity (-3 dB), in hertz.
    #[serde(rename = "bandwidth_Hz")]
    BandwidthHz(f64),
    /// Longest settling time of a step of the reference within 2 %, in seconds.
    SettlingS(f64),
    /// The speed follows from these weights.
    Weights(Weights),
}

impl Speed {
    /// Approximate crossover frequency. A loop settles in about four of its times.
    pub fn rad_per_s(self, motor: &MotorParameters, period_s: f64) -> f64 {
        match self {
            Self::Weights(weights) => weights.crossover_rad_per_s(motor, period_s),
            Self::BandwidthHz(hz) => std::f64::consts::TAU * hz,
            Self::SettlingS(settling_s) => 4.0 / settling_s,
        }
    }
}

/// A specification. Bandwidth and settling refer to a plain step of the linear sampled loop. The overshoot applies to
/// that step, and to the core behind its reference profile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Specification {
    /// How fast.
    pub speed: Speed,
    /// Largest overshoot, in percent.
    pub overshoot_percent: f64,
    /// Largest current, in amperes.
    #[serde(rename = "current_limit_A")]
    pub current_limit_a: f64,
}

/// A specification that no loop can meet.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{name} = {value}: it must be {rule}")]
pub struct ImpossibleSpecification {
    /// Which figure.
    pub name: &'static str,
    /// What it was.
    pub value: f64,
    /// Allowed range.
    pub rule: &'static str,
}

impl Specification {
    /// Refuses specifications that no loop can meet.
    ///
    /// # Errors
    /// The first figure that is out of range, with the range.
    pub fn check(&self, period_s: f64) -> Result<(), ImpossibleSpecification> {
        let refuse = |name, value, rule| Err(ImpossibleSpecification { name, value, rule });
        let positive = |value: f64| value > 0.0 && value.is_finite();
        match self.speed {
            Speed::BandwidthHz(hz) if !positive(hz) => return refuse("bandwidth-Hz", hz, "a positive number"),
            Speed::SettlingS(settling_s) if !positive(settling_s) => {
                return refuse("settling-s", settling_s, "a positive number");
            }
            Speed::BandwidthHz(hz) if hz * period_s > 0.1 => {
                return refuse(
                    "bandwidth-Hz",
                    hz,
                    "at most a tenth of the tick rate, since the loop samples the motor once a tick",
                );
            }
            Speed::BandwidthHz(hz) if hz * period_s < SLOWEST => {
                return refuse(
                    "bandwidth-Hz",
                    hz,
                    "at least 1/20000 of the tick rate; slower loops cannot be evaluated",
                );
            }
            Speed::SettlingS(settling_s) if settling_s > MAX_SAMPLES as f64 * period_s => {
                return refuse("settling-s", settling_s, "at most 20000 ticks; longer responses cannot be evaluated");
            }
            Speed::SettlingS(settling_s) if settling_s < 5.0 * period_s => {
                return refuse(
                    "settling-s",
                    settling_s,
                    "at least five ticks, since the loop samples the motor once a tick",
                );
            }
            // Weights are checked when they are made.
            _ => {}
        }
        if !(0.0..=100.0).contains(&self.overshoot_percent) {
            return refuse("overshoot-percent", self.overshoot_percent, "between 0 and 100");
        }
        if !(self.current_limit_a > 0.0 && self.current_limit_a <= LARGEST_CURRENT_A) {
            return refuse(
                "current-limit-A",
                self.current_limit_a,
                "above 0 and at most 6.6 A; the core measures up to 8 A",
            );
        }
        Ok(())
    }
}

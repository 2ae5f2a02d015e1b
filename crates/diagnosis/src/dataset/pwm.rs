//! What recordings show of the period of the PWM.

use super::Dataset;
use motorbench_data::rig::Readings;

/// Every edge of a PWM is simulated up to so many of its periods in a row. A faster one is averaged.
const MOST_PERIODS: f64 = 1.5;

impl Dataset {
    /// Whether each current may be a value of one instant.
    pub fn reads_instants(&self) -> bool {
        let timing = &self.origin.timing;
        timing.readings == Readings::Instant && timing.current_window_s.is_none() && self.current().is_some()
    }

    /// Whether the ripple of the PWM in each current is known: where it is read, or that it is averaged.
    pub fn is_ripple_known(&self) -> bool {
        let origin = &self.origin;
        let is_averaged = origin.timing.readings == Readings::Mean || origin.current_window_s > 0.0;
        let is_phase_known = origin.timing.current_sampled_at.is_some() || origin.pwm_phase.is_some();
        self.current().is_none() || is_averaged || is_phase_known
    }

    /// The same with the PWM in this phase at time 0.
    pub fn with_pwm_phase(&self, pwm_phase: Option<f64>) -> Self {
        let mut other = self.clone();
        other.origin.pwm_phase = pwm_phase;
        other
    }

    /// Whether a PWM of known frequency is slow beside the rows.
    pub fn is_pwm_slow(&self) -> bool {
        let is_driven = self.axis.drive.is_voltage() && self.origin.pwm_is_known;
        is_driven && self.origin.pwm_hz * self.interval_s < MOST_PERIODS
    }

    /// Whether every edge of the PWM is simulated.
    pub fn is_switched(&self) -> bool {
        self.origin.pwm_phase.is_some() && self.is_pwm_slow()
    }
}

//! What recordings show of the period of the PWM.

use super::{Dataset, Output, Pulse};
use crate::configuration::dataset::pwm::{MOMENT_S, MOST_HZ};
use motorbench_data::rig::Readings;

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

    /// The same with the PWM ahead by so many periods in the middle of the recording, and by `turns` more from its begin to
    /// its end.
    pub fn with_pwm_moved(&self, periods: f64, turns: f64) -> Self {
        let mut other = self.clone();
        let (begin_s, end_s) = (self.time_s[0], self.time_s[self.len() - 1]);
        let off_hz = turns / (end_s - begin_s);
        other.origin.pwm_hz += off_hz;
        let at_0 = periods - off_hz * 0.5 * (begin_s + end_s);
        other.origin.pwm_phase = self.origin.pwm_phase.map(|phase| (phase + at_0).rem_euclid(1.0));
        other
    }

    /// The same where a command changes the duty `at_once` or with the next period.
    pub fn with_commands_at_once(&self, at_once: bool) -> Self {
        let mut other = self.clone();
        other.origin.commands_at_once = at_once;
        other
    }

    /// Whether all rows have one clock: that of one recording.
    pub fn is_one_recording(&self) -> bool {
        self.stretches.windows(2).all(|pair| self.time_s[pair[0].rows.end - 1] < self.time_s[pair[1].rows.start])
    }

    /// The same with a PWM of this frequency and with such pulses, which its ripple shows.
    pub fn with_pwm_of(&self, pwm_hz: f64, pulse: Pulse) -> Self {
        let mut other = self.clone();
        other.origin.ripple_shows = Some(other.origin.pwm_is_known.then_some(other.origin.pwm_hz));
        other.origin.pwm_hz = pwm_hz;
        other.origin.pulse = pulse;
        other.origin.pwm_is_known = true;
        other
    }

    /// The same with what a current changes within the uncertainty of its moment, beside this inductance, tolerated.
    pub fn with_instants_blurred(mut self, inductance_h: f64) -> Self {
        let volts = self.duty.iter().zip(&self.supply_v).map(|(duty, supply)| supply * supply * ripple(*duty));
        let root_mean_square_v = (volts.sum::<f64>() / self.len().max(1) as f64).sqrt();
        let error_a = MOMENT_S * root_mean_square_v / inductance_h;
        for measured in self.measured.iter_mut().filter(|measured| measured.output == Output::Current) {
            measured.tolerance = measured.tolerance.hypot(error_a);
        }
        self
    }

    /// Whether a PWM of known frequency is slow beside the rows.
    pub fn is_pwm_slow(&self) -> bool {
        let is_driven = self.axis.drive.is_voltage() && self.origin.pwm_is_known;
        is_driven && self.origin.pwm_hz < MOST_HZ
    }

    /// Whether every edge of the PWM is simulated.
    pub fn is_switched(&self) -> bool {
        self.origin.pwm_phase.is_some() && self.is_pwm_slow()
    }
}

/// Variance of a PWM around its mean, as a share of the squared supply.
fn ripple(duty: f64) -> f64 {
    duty.abs() * (1.0 - duty.abs()).max(0.0)
}

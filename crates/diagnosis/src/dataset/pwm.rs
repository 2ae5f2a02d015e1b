//! What recordings show of the period of the PWM.

use super::{Dataset, Latch, Output, Pulse};
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
        other.origin.move_pwm(periods - off_hz * 0.5 * (begin_s + end_s));
        other
    }

    /// The same with a low-pass in front of the conversion of the current that is slower by so much. Each reading keeps its
    /// mean delay.
    pub fn with_current_filtered(mut self, slower_s: f64) -> Self {
        let origin = &mut self.origin;
        let filter_s = (origin.current_filter_s + slower_s).max(0.0);
        origin.move_pwm(origin.pwm_hz * (filter_s - origin.current_filter_s));
        origin.current_filter_s = filter_s;
        self
    }

    /// The same with each current a mean over a time that is longer by so much. Each reading keeps its mean delay.
    pub fn with_current_averaged(mut self, longer_s: f64) -> Self {
        let origin = &mut self.origin;
        let window_s = (origin.current_window_s + longer_s).max(0.0);
        origin.move_pwm(0.5 * origin.pwm_hz * (window_s - origin.current_window_s));
        origin.current_window_s = window_s;
        self
    }

    /// The same with a timer that takes a new duty at another time.
    pub fn with_latch(&self, latch: Latch) -> Self {
        let mut other = self.clone();
        other.origin.latch = latch;
        other
    }

    /// How long a command that comes at this time waits for the next period of a PWM that is averaged.
    pub fn wait_s(&self, at_s: f64) -> f64 {
        let origin = &self.origin;
        match origin.latch {
            _ if !self.may_wait() => 0.0,
            Latch::AtOnce => 0.0,
            _ if self.waits_in_phase() => origin.period_around_s(at_s)[1] - at_s,
            Latch::WithPeriod | Latch::OnAverage => 0.5 / origin.pwm_hz,
        }
    }

    /// How long ago the last command came that may act at this time.
    pub fn waited_s(&self, at_s: f64) -> f64 {
        if self.waits_in_phase() { at_s - self.origin.period_around_s(at_s)[0] } else { self.wait_s(at_s) }
    }

    /// Whether each command waits for a period whose begin is known.
    pub fn waits_in_phase(&self) -> bool {
        self.origin.latch == Latch::WithPeriod && self.origin.pwm_phase.is_some() && self.may_wait()
    }

    /// Whether commands come at any time in a period of a PWM that is averaged. Rows in step with it always wait for one
    /// time, which nothing tells.
    pub fn may_wait(&self) -> bool {
        self.is_pwm_averaged() && self.origin.timing.current_sampled_at.is_none() && !self.is_in_step()
    }

    /// Whether every row comes at the same time in a period of a PWM that is averaged.
    pub fn is_in_step(&self) -> bool {
        let periods = self.interval_s * self.origin.pwm_hz;
        let turns = self.len() as f64 * (periods - periods.round());
        self.is_pwm_averaged() && turns.abs() <= 1.0
    }

    fn is_pwm_averaged(&self) -> bool {
        self.axis.drive.is_voltage() && self.origin.pwm_is_known && !self.is_pwm_slow()
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

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;

    /// A second of rows a millisecond apart.
    fn recorded(pwm_hz: f64, timing: &str) -> Dataset {
        let rows: String = (0..1000).map(|row| format!("{:.3},6,{},0.5\n", f64::from(row) * 1e-3, row)).collect();
        let text = format!("t_s,u_V,omega_rad_per_s,i_A\n{rows}");
        let rig = format!("[supply]\nvoltage_V = 12\n[bridge]\npwm_Hz = {pwm_hz}\n[recording]\n{timing}");
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", &rig).unwrap()).unwrap()
    }

    #[test]
    fn a_command_waits_for_the_next_period() {
        let at_3900_hz = recorded(3900.0, "");
        assert!((at_3900_hz.wait_s(0.5) - 0.5 / 3900.0).abs() < 1e-12);
        // A period began 0.3 of one before the time 0.
        let in_phase = at_3900_hz.with_pwm_phase(Some(0.3));
        let wait_s = |after: f64| in_phase.wait_s(after / 3900.0);
        for (after, waits) in [(0.0, 0.7), (0.6, 0.1), (0.8, 0.9)] {
            assert!((wait_s(after) * 3900.0 - waits).abs() < 1e-9, "{after}: {}", wait_s(after) * 3900.0);
        }
        assert_eq!(in_phase.with_latch(Latch::OnAverage).wait_s(0.0), 0.5 / 3900.0);
        assert_eq!(in_phase.with_latch(Latch::AtOnce).wait_s(0.0), 0.0);
        // In step with the rows, with its edges simulated, or in a loop of known timing.
        for other in [recorded(20_000.0, ""), recorded(490.2, ""), recorded(3900.0, "current_sampled_at = 0.9\n")] {
            assert_eq!(other.wait_s(0.5), 0.0);
        }
    }
}

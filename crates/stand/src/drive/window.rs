//! Averages of telemetry over whole revolutions, and when a state is steady.

use super::{Driver, Operator, PATIENCE_S, Reading};
use motorbench_core::HARDWARE;
use motorbench_core::message::Sample;
use motorbench_core::settings::Param;
use motorbench_data::recording::Channel;
use motorbench_data::rig::Timing;
use motorbench_data::telemetry;
use motorbench_link::board::Board;
use motorbench_link::record::Ended;
use motorbench_model::pwm_period::{Drops, Ripple, Volts};
use std::f64::consts::TAU;

/// Two windows agree if they differ by less than this share, besides their scatter.
const STEADY_SHARE: f64 = 2e-3;
const STEADY_SIGMAS: f64 = 3.0;

/// Mean values of a stretch of telemetry.
pub(super) struct Window {
    pub(super) reading: Reading,
    /// Standard error of the current.
    pub(super) current_error_a: f64,
    /// One count over the window.
    pub(super) speed_step: f64,
    /// Position at its end.
    pub(super) counts: i32,
}

/// Result of waiting for a steady state.
pub(super) enum Settled {
    Steady(Window),
    /// Still changing at the end of the waiting time: the window at half the time, and the last.
    Drifting(Window, Window),
}

impl<B: Board, P: Operator> Driver<'_, B, P> {
    /// Waits until a window agrees with the one half as long after the change.
    pub(super) fn settle(&mut self, shortest_s: f64, longest_s: f64) -> Result<Settled, Ended> {
        let mut windows = vec![self.window(shortest_s, longest_s)?];
        loop {
            let now = self.window(shortest_s, longest_s)?;
            let half = (windows.len() - 1) / 2;
            if now.agrees(&windows[half]) {
                return Ok(Settled::Steady(now));
            }
            if windows.len() as f64 * shortest_s > PATIENCE_S {
                return Ok(Settled::Drifting(windows.swap_remove(half), now));
            }
            windows.push(now);
        }
    }

    /// The next samples until a revolution is complete: variations over the angle cancel.
    pub(super) fn window(&mut self, shortest_s: f64, longest_s: f64) -> Result<Window, Ended> {
        let rate_hz = f64::from(self.settings.get(Param::TickRate));
        let rev = self.settings.get(Param::CountsPerRev) as i32;
        let mut samples = std::mem::take(&mut self.waiting);
        let mut seen = 1;
        loop {
            while seen < samples.len() {
                let (first, last) = (samples[0], samples[seen]);
                let turns = |sample: Sample| sample.counts.wrapping_sub(first.counts) / rev.max(1);
                let lasted_s = f64::from(last.tick.wrapping_sub(first.tick)) / rate_hz;
                let whole = turns(last) != turns(samples[seen - 1]);
                seen += 1;
                if lasted_s >= longest_s || lasted_s >= shortest_s && whole {
                    // The last sample of a window is the first of the next.
                    self.waiting = samples[seen - 1..].to_vec();
                    samples.truncate(seen);
                    return Ok(self.averaged(&samples));
                }
            }
            samples.extend(self.slice()?);
        }
    }

    pub(super) fn averaged(&self, samples: &[Sample]) -> Window {
        let recording = telemetry::recording("stand", samples, self.settings);
        let values = |channel| recording.get(channel).unwrap_or_default();
        // Readings of one tick are means since the previous tick. The first one belongs to the previous window.
        let mean = |values: &[f64]| values[1..].iter().sum::<f64>() / (values.len() - 1) as f64;
        let (currents, time_s) = (values(Channel::Current), values(Channel::Time));
        let (duty, u_v, i_a) = (mean(values(Channel::Duty)), mean(values(Channel::Voltage)), mean(currents));
        let (first, last) = (samples[0], samples[samples.len() - 1]);
        let lasted_s = time_s[time_s.len() - 1];
        let speed_step = TAU / f64::from(self.settings.get(Param::CountsPerRev)) / lasted_s;
        let omega = if self.settings.get(Param::SpeedSensor) == 0.0 {
            speed_step * f64::from(last.counts.wrapping_sub(first.counts))
        } else {
            mean(values(Channel::Speed))
        };
        let scatter = currents[1..].iter().map(|value| (value - i_a).powi(2)).sum::<f64>();
        let count = (currents.len() - 1) as f64;
        Window {
            reading: Reading {
                // Rounded to the microvolt as in the table, so that both print the same.
                u_V: (u_v * 1e6).round() / 1e6,
                i_A: i_a - self.sampled_above_mean_a(duty, u_v),
                omega_rad_per_s: omega,
                // A brake acts against the motion.
                load_Nm: if duty < 0.0 { 0.0 - self.load_nm } else { self.load_nm },
            },
            current_error_a: (scatter / count).sqrt() / count.sqrt(),
            speed_step,
            counts: last.counts,
        }
    }

    /// Current at its sampling time in the PWM period, less its mean. If the off phase coasts, it is unknown.
    fn sampled_above_mean_a(&self, duty: f64, voltage_v: f64) -> f64 {
        let resistance_ohm = self.motor.resistance_ohm.unwrap_or(0.0);
        match (self.motor.inductance_h, Timing::FIRMWARE.current_sampled_at) {
            (Some(inductance_h), Some(at)) if self.settings.get(Param::Wiring) == 0.0 && duty != 0.0 => {
                let volts = Volts { mean_v: voltage_v, emf_v: 0.0, lost_v: 0.0, drops: Drops::default() };
                Ripple::new(inductance_h, resistance_ohm, f64::from(HARDWARE.pwm_hz))
                    .with_duty(duty)
                    .sampled_a(0.0, at, &volts)
            }
            _ => 0.0,
        }
    }
}

impl Window {
    /// The change as text.
    pub(super) fn change_since(&self, before: &Self) -> String {
        let (now, then) = (&self.reading, &before.reading);
        format!(
            "speed went from {:.2} to {:.2} rad/s, current from {:.4} to {:.4} A",
            then.omega_rad_per_s, now.omega_rad_per_s, then.i_A, now.i_A
        )
    }

    pub(super) fn agrees(&self, before: &Self) -> bool {
        let (now, then) = (&self.reading, &before.reading);
        let current_error = self.current_error_a.hypot(before.current_error_a);
        let speed = STEADY_SHARE * now.omega_rad_per_s.abs() + self.speed_step + before.speed_step;
        let current = STEADY_SHARE * now.i_A.abs() + STEADY_SIGMAS * current_error;
        (now.omega_rad_per_s - then.omega_rad_per_s).abs() <= speed && (now.i_A - then.i_A).abs() <= current
    }
}

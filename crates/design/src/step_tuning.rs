//! Step-response tuning: a first-order model with dead time from a recorded step, and gains for a chosen time constant
//! of the loop.

use super::fixed_point::rounded;
use super::relay::speed_pi;
use serde::Serialize;

/// `K exp(-theta s) / (tau s + 1)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FirstOrder {
    /// Gain `K`, rad/s per volt.
    #[serde(rename = "gain_rad_per_s_per_V")]
    pub gain_rad_per_s_per_v: f64,
    /// Time constant `tau`.
    pub time_constant_s: f64,
    /// Dead time `theta`.
    pub dead_time_s: f64,
    /// Speed after the step.
    pub end_rad_per_s: f64,
}

/// Why a step cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// Too few samples.
    #[error("the recording has {found} samples, but needs at least {SHORTEST}, with the step among them")]
    TooShort {
        /// Samples found.
        found: usize,
    },
    /// Time, voltage and speed are not of the same length.
    #[error("time, voltage and speed have {time}, {voltage} and {speed} samples, but need the same number")]
    Lengths {
        /// Samples of the time.
        time: usize,
        /// Of the voltage.
        voltage: usize,
        /// Of the speed.
        speed: usize,
    },
    /// The voltage does not change.
    #[error("the voltage has no step: record from before the change of the voltage until the speed has settled")]
    NoStep,
    /// The speed does not follow the voltage.
    #[error(
        "the speed changes by {change_rad_per_s:.3} rad/s after a step of {change_v:.3} V: check the sign of the encoder, or take a larger step"
    )]
    NoResponse {
        /// Of the speed.
        change_rad_per_s: f64,
        /// Of the voltage.
        change_v: f64,
    },
    /// The speed still changes at the end.
    #[error("the speed still changes at the end of the recording: record for longer")]
    NotSettled,
}

/// Fewest samples.
const SHORTEST: usize = 20;
/// The last fifth (one over this) of the samples after the step gives the final speed. Its halves may differ by this
/// share.
const END_PART: usize = 5;
const END_DRIFT: f64 = 0.03;
/// Levels of the response that give time constant and dead time (Sundaresan and Krishnaswamy, 1978).
const EARLY: f64 = 0.353;
const LATE: f64 = 0.853;

/// Fits a step of the voltage: `t_s`, `u_v` with one step, and the speed.
///
/// # Errors
/// [`StepError`].
pub fn fit(t_s: &[f64], u_v: &[f64], omega_rad_per_s: &[f64]) -> Result<FirstOrder, StepError> {
    if t_s.len() != u_v.len() || t_s.len() != omega_rad_per_s.len() {
        let (time, voltage, speed) = (t_s.len(), u_v.len(), omega_rad_per_s.len());
        return Err(StepError::Lengths { time, voltage, speed });
    }
    if t_s.len() < SHORTEST {
        return Err(StepError::TooShort { found: t_s.len() });
    }
    let change_v = u_v[u_v.len() - 1] - u_v[0];
    let at = u_v.iter().position(|u| (u - u_v[0]).abs() > 0.5 * change_v.abs()).filter(|_| change_v != 0.0);
    let at = at.ok_or(StepError::NoStep)?;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let start = mean(&omega_rad_per_s[..=at]);
    let after = &omega_rad_per_s[at..];
    let end = &after[after.len() - (after.len() / END_PART).max(2)..];
    let final_rad_per_s = mean(end);
    let change_rad_per_s = final_rad_per_s - start;
    if change_rad_per_s * change_v <= 0.0 {
        return Err(StepError::NoResponse { change_rad_per_s, change_v });
    }
    let (first, second) = end.split_at(end.len() / 2);
    if (mean(second) - mean(first)).abs() > END_DRIFT * change_rad_per_s.abs() {
        return Err(StepError::NotSettled);
    }
    let crossing = |level: f64| {
        let part = |value: f64| (value - start) / change_rad_per_s;
        let next = (1..after.len()).find(|&next| part(after[next]) >= level)?;
        let (before, beyond) = (part(after[next - 1]), part(after[next]));
        let fraction = (level - before) / (beyond - before);
        let time = |index: usize| t_s[at + index] - t_s[at];
        Some(time(next - 1) + fraction * (time(next) - time(next - 1)))
    };
    let (Some(early), Some(late)) = (crossing(EARLY), crossing(LATE)) else { return Err(StepError::NotSettled) };
    let spread = ((1.0 - EARLY) / (1.0 - LATE)).ln();
    let time_constant_s = (late - early) / spread;
    Ok(FirstOrder {
        gain_rad_per_s_per_v: change_rad_per_s / change_v,
        time_constant_s,
        dead_time_s: (early + time_constant_s * (1.0 - EARLY).ln()).max(0.0),
        end_rad_per_s: final_rad_per_s,
    })
}

/// Gains of the speed PID for a closed loop of `closed_loop_s`, by the SIMC rule: `Kp = tau / (K (tc + theta))`, `Ti =
/// min(tau, 4 (tc + theta))`. With `closed_loop_s` equal to the dead time it is the tightest robust loop. Returns
/// setting names and values.
///
/// Source: Skogestad, "Simple analytic rules for model reduction and PID controller tuning", 2003.
pub fn simc(model: &FirstOrder, closed_loop_s: f64) -> Vec<(String, f64)> {
    let slow_s = closed_loop_s + model.dead_time_s;
    speed_pi(proportional(model, slow_s), model.time_constant_s.min(4.0 * slow_s))
}

/// Gains of the position PID by the same rule, for the integral of the speed: `Kc = 1 / (K (tc + theta))`, `Ti = 4 (tc +
/// theta)`, `Td = tau` of the series form, here as those of the parallel form. The derivative's filter is a tenth of
/// `Td`; the feed-forward is what a constant speed needs.
pub fn simc_position(model: &FirstOrder, closed_loop_s: f64) -> Vec<(String, f64)> {
    let slow_s = closed_loop_s + model.dead_time_s;
    let proportional = 1.0 / (model.gain_rad_per_s_per_v * slow_s);
    let (integral_s, derivative_s) = (4.0 * slow_s, model.time_constant_s);
    let (kp, kd) = (proportional * (1.0 + derivative_s / integral_s), proportional * derivative_s);
    let ki = proportional / integral_s;
    let ms = |seconds: f64| (1e3 * seconds).max(1.0);
    [
        ("position_kp", kp),
        ("position_ki", ki),
        ("position_kd", kd),
        ("position_tf", ms(0.1 * derivative_s)),
        ("position_kff", kd + 1.0 / model.gain_rad_per_s_per_v),
        ("position_tt", ms(kp / ki)),
    ]
    .map(|(name, value)| (name.to_owned(), rounded(value)))
    .into()
}

/// The same by lambda tuning: `Ti = tau` in every case.
pub fn lambda(model: &FirstOrder, closed_loop_s: f64) -> Vec<(String, f64)> {
    speed_pi(proportional(model, closed_loop_s + model.dead_time_s), model.time_constant_s)
}

fn proportional(model: &FirstOrder, slow_s: f64) -> f64 {
    model.time_constant_s / (model.gain_rad_per_s_per_v * slow_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::ControlLaw;
    use crate::robustness;
    use crate::sampled_loop::{Gains, Sampling};
    use motorbench_model::linear::motor_model::{armature, speed};
    use motorbench_model::motor::MotorParameters;

    /// A 4 V step on the PIVT-6 at 100 ms.
    fn recording() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let response = armature(&MotorParameters::PIVT6).discretise(1e-3, 0.0).step_response(400);
        let t_s: Vec<f64> = (0..500).map(|k| f64::from(k) * 1e-3).collect();
        let u_v = t_s.iter().map(|&t| if t < 0.0995 { 2.0 } else { 6.0 }).collect();
        let omega = (0..500_usize).map(|k| 27.0 + k.checked_sub(100).map_or(0.0, |k| 4.0 * response[(0, k)]));
        (t_s, u_v, omega.collect())
    }

    #[test]
    fn model_and_gains_from_a_step() {
        let (t_s, u_v, omega) = recording();
        let model = fit(&t_s, &u_v, &omega).unwrap();
        let motor = MotorParameters::PIVT6;
        assert!((model.gain_rad_per_s_per_v / speed(&motor).dc_gain() - 1.0).abs() < 0.01, "{model:?}");
        // The slow pole, and about the fast one as dead time.
        assert!((model.time_constant_s - 22.7e-3).abs() < 1.5e-3, "{model:?}");
        assert!((model.dead_time_s - 2.2e-3).abs() < 1e-3, "{model:?}");
        for (gains, closed_loop_s) in [(simc(&model, 5e-3), 5e-3), (lambda(&model, 10e-3), 10e-3)] {
            let gains = Gains { feedback: vec![gains[0].1, 0.0, gains[1].1], reference: gains[0].1 };
            let sampling = Sampling::new(1e-3, 2e-3);
            let judged = robustness::check(&motor, ControlLaw::SpeedPid, &sampling, &gains).unwrap();
            // The crossover of the loop is the inverse of its time constant plus the dead time.
            let expected_hz = 1.0 / (std::f64::consts::TAU * (closed_loop_s + model.dead_time_s));
            assert!((judged.margins.crossover_hz / expected_hz - 1.0).abs() < 0.25, "{judged:?} {expected_hz}");
        }
    }

    #[test]
    fn what_is_no_step_is_refused_with_its_reason() {
        let (t_s, u_v, omega) = recording();
        let message = |t: &[f64], u: &[f64], w: &[f64]| fit(t, u, w).unwrap_err().to_string();
        assert!(message(&t_s[..10], &u_v[..10], &omega[..10]).contains("10 samples"));
        assert!(message(&t_s, &u_v, &omega[..9]).contains("500, 500 and 9"));
        assert!(message(&t_s, &vec![2.0; 500], &omega).contains("no step"));
        let backward: Vec<f64> = omega.iter().map(|w| -w).collect();
        assert!(message(&t_s, &u_v, &backward).contains("sign of the encoder"));
        assert!(message(&t_s[..120], &u_v[..120], &omega[..120]).contains("record for longer"));
    }

    /// The loop with these gains, sampled at 1 ms, with its dead time: it follows a ramp of the reference and rests.
    #[test]
    fn a_position_follows_with_the_gains_of_a_step() {
        for (gain, time_constant_s, dead_time_s) in [(14.0, 0.05, 0.002), (1.6, 0.17, 0.004), (30.0, 0.01, 0.001)] {
            let model =
                FirstOrder { gain_rad_per_s_per_v: gain, time_constant_s, dead_time_s, end_rad_per_s: 8.0 * gain };
            let gains = simc_position(&model, 0.03);
            let of = |name: &str| gains.iter().find(|(known, _)| known == name).unwrap().1;
            let [kp, ki, kd, kff] = ["position_kp", "position_ki", "position_kd", "position_kff"].map(of);
            let (mut angle, mut speed, mut integral, mut most) = (0.0_f64, 0.0, 0.0, 0.0_f64);
            let mut late = vec![0.0; (1e3 * dead_time_s) as usize];
            for tick in 0..2000 {
                let reference = (0.002 * f64::from(tick)).min(1.0);
                let ahead = if reference < 1.0 { 2.0 } else { 0.0 };
                integral += 1e-3 * ki * (reference - angle);
                late.push(kp * (reference - angle) + integral - kd * speed + kff * ahead);
                speed += 1e-3 / time_constant_s * (gain * late.remove(0) - speed);
                angle += 1e-3 * speed;
                most = most.max(angle);
            }
            assert!(most < 1.2 && (angle - 1.0).abs() < 0.01, "{gain}: {most}, {angle}");
        }
    }
}

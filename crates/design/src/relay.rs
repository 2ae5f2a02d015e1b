//! Relay auto-tuning: gains from the limit cycle of a motor under on-off control (Astrom and Hagglund, 1984).
//!
//! ```text
//! u = bias + d  while y < reference + h going up,   u = bias - d  while y > reference - h going down
//! Ku = 4 d / (pi sqrt(a^2 - h^2)),  Tu = period of the cycle,  a = amplitude of y
//! ```
//! The reference is far from standstill, and the bias is found during the experiment. It moves until both halves of the
//! cycle are equally long. Coulomb friction is constant while the speed keeps its sign, so it only shifts the bias.

use super::law::setting_name;
use host_sim::plant::Plant;
use host_sim::trial::Trial;
use motorbench_core::message::{Mode, Request, Trip};
use motorbench_core::settings::Param;
use motorbench_core::units::VOLT;
use serde::Serialize;
use std::f64::consts::PI;

/// A relay experiment on the speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relay {
    /// Speed of the cycle's centre. Its lowest speed must stay above zero.
    pub reference_rad_per_s: f64,
    /// First guess of the mean voltage.
    pub bias_v: f64,
    /// Amplitude of the relay's voltage, positive. It must be so small that the current does not reverse. Otherwise the
    /// drop of the bridge changes its sign, the effective amplitude is smaller, and the gain is found too large.
    pub amplitude_v: f64,
    /// Half width of the hysteresis, not negative. It must exceed the noise of the speed.
    pub hysteresis_rad_per_s: f64,
    /// Longest time it may take.
    pub timeout_s: f64,
}

/// The limit cycle that was found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LimitCycle {
    /// Half the range of the speed.
    pub amplitude_rad_per_s: f64,
    /// Its period.
    pub period_s: f64,
    /// Mean voltage that holds the reference.
    #[serde(rename = "bias_V")]
    pub bias_v: f64,
    /// Gain at which a proportional controller would oscillate.
    #[serde(rename = "ultimate_gain_V_s_per_rad")]
    pub ultimate_gain_v_s_per_rad: f64,
}

/// Why there is no usable limit cycle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RelayError {
    /// The relay does not move the speed across the reference.
    #[error(
        "the speed does not cross {reference_rad_per_s} rad/s within {timeout_s} s: raise the relay's amplitude, or correct its bias"
    )]
    NoCycle {
        /// The reference.
        reference_rad_per_s: f64,
        /// The time.
        timeout_s: f64,
    },
    /// The cycle is hardly larger than the hysteresis.
    #[error(
        "the cycle's amplitude of {amplitude_rad_per_s:.3} rad/s does not exceed the hysteresis: narrow the hysteresis, or raise the relay's amplitude"
    )]
    TooSmall {
        /// The amplitude.
        amplitude_rad_per_s: f64,
    },
    /// The motor stopped during the cycle, where friction is not constant.
    #[error(
        "the motor nearly stops within the cycle, so friction causes the cycle, not the loop: raise the reference, or lower the relay's amplitude"
    )]
    Standstill,
    /// The core switched the drive off.
    #[error("the trip {0:?} came: lower the relay's amplitude or the reference")]
    Tripped(Trip),
}

/// Number of cycles, of which the last ones are evaluated, after the bias has settled.
const CYCLES: usize = 12;
const EVALUATED: usize = 4;
/// Share of the imbalance by which the bias is corrected in each cycle.
const BIAS_STEP: f64 = 0.5;

/// Smallest allowed speed relative to the reference. Near standstill friction is not constant, and the measured speed
/// reacts to a stop only as fast as edges are missing. A cycle in which the motor sticks does not characterise the
/// loop.
const SLOWEST_PART: f64 = 0.25;

/// The interval between two rising switches.
#[derive(Clone, Copy)]
struct Cycle {
    high_ticks: u32,
    low_ticks: u32,
    highest: f64,
    lowest: f64,
}

impl Cycle {
    const NEW: Self = Self { high_ticks: 0, low_ticks: 0, highest: f64::NEG_INFINITY, lowest: f64::INFINITY };
}

/// The relay as a state machine: it takes speeds and returns voltages, for a real or a simulated motor.
pub struct Switching {
    relay: Relay,
    bias_v: f64,
    high: bool,
    cycle: Cycle,
    cycles: Vec<Cycle>,
}

impl Switching {
    /// The voltage starts high.
    pub fn new(relay: &Relay) -> Self {
        Self { relay: *relay, bias_v: relay.bias_v, high: true, cycle: Cycle::NEW, cycles: Vec::new() }
    }

    /// Present voltage.
    pub fn voltage_v(&self) -> f64 {
        if self.high { self.bias_v + self.relay.amplitude_v } else { self.bias_v - self.relay.amplitude_v }
    }

    /// Takes a measured speed, `ticks` after the last one. Returns whether the voltage changed.
    pub fn observe(&mut self, speed_rad_per_s: f64, ticks: u32) -> bool {
        let cycle = &mut self.cycle;
        cycle.highest = cycle.highest.max(speed_rad_per_s);
        cycle.lowest = cycle.lowest.min(speed_rad_per_s);
        *(if self.high { &mut cycle.high_ticks } else { &mut cycle.low_ticks }) += ticks;
        let error = self.relay.reference_rad_per_s - speed_rad_per_s;
        if self.high && error < -self.relay.hysteresis_rad_per_s {
            self.high = false;
            return true;
        }
        if !self.high && error > self.relay.hysteresis_rad_per_s {
            self.high = true;
            let (up, down) = (f64::from(cycle.high_ticks), f64::from(cycle.low_ticks));
            // Longer up than down: the bias is too low.
            self.bias_v += BIAS_STEP * self.relay.amplitude_v * (up - down) / (up + down);
            self.cycles.push(std::mem::replace(&mut self.cycle, Cycle::NEW));
            return true;
        }
        false
    }

    /// The limit cycle, after enough cycles, with ticks of `tick_s`.
    pub fn found(&self, tick_s: f64) -> Option<Result<LimitCycle, RelayError>> {
        let enough = self.cycles.len() >= CYCLES;
        enough.then(|| evaluate(&self.cycles[CYCLES - EVALUATED..], &self.relay, self.bias_v, tick_s))
    }
}

/// Runs the experiment on the core in open loop.
///
/// # Errors
/// [`RelayError`].
pub fn experiment<P: Plant>(trial: &mut Trial<P>, relay: &Relay) -> Result<LimitCycle, RelayError> {
    trial.enter(Mode::OpenLoop);
    let period_s = trial.period_s();
    let mut switching = Switching::new(relay);
    for _ in 0..(relay.timeout_s / period_s) as u32 {
        let voltage_bits = (switching.voltage_v() * f64::from(VOLT)).round() as i32;
        let point = trial.tick(Some(Request::Reference(voltage_bits)));
        if trial.sample().trip != Trip::None {
            return Err(RelayError::Tripped(trial.sample().trip));
        }
        switching.observe(point.measured_rad_per_s, 1);
        if let Some(result) = switching.found(period_s) {
            return result;
        }
    }
    Err(relay.no_cycle())
}

impl Relay {
    /// The error of a loop without a limit cycle.
    pub fn no_cycle(&self) -> RelayError {
        RelayError::NoCycle { reference_rad_per_s: self.reference_rad_per_s, timeout_s: self.timeout_s }
    }
}

fn evaluate(cycles: &[Cycle], relay: &Relay, bias_v: f64, tick_s: f64) -> Result<LimitCycle, RelayError> {
    let mean = |of: fn(&Cycle) -> f64| cycles.iter().map(of).sum::<f64>() / cycles.len() as f64;
    let slowest = SLOWEST_PART * relay.reference_rad_per_s.abs();
    let sticks = |cycle: &Cycle| match relay.reference_rad_per_s >= 0.0 {
        true => cycle.lowest <= slowest,
        false => cycle.highest >= -slowest,
    };
    if cycles.iter().any(sticks) {
        return Err(RelayError::Standstill);
    }
    let amplitude_rad_per_s = mean(|cycle| 0.5 * (cycle.highest - cycle.lowest));
    let beyond = amplitude_rad_per_s.powi(2) - relay.hysteresis_rad_per_s.powi(2);
    if beyond <= 0.0 {
        return Err(RelayError::TooSmall { amplitude_rad_per_s });
    }
    Ok(LimitCycle {
        amplitude_rad_per_s,
        period_s: mean(|cycle| f64::from(cycle.high_ticks + cycle.low_ticks)) * tick_s,
        bias_v,
        ultimate_gain_v_s_per_rad: 4.0 * relay.amplitude_v / (PI * beyond.sqrt()),
    })
}

/// Gains of the speed PID from a limit cycle, by the rule of Tyreus and Luyben (1992): `Kp = Ku / 3.2`, `Ti = 2.2 Tu`.
/// It is gentler than the rule of Ziegler and Nichols, and meant for a loop without an outer loop. Returns setting
/// names and values.
pub fn tyreus_luyben(cycle: &LimitCycle) -> Vec<(String, f64)> {
    let kp = cycle.ultimate_gain_v_s_per_rad / 3.2;
    let ti_s = 2.2 * cycle.period_s;
    speed_pi(kp, ti_s)
}

/// A PI controller as settings of the speed PID.
pub(super) fn speed_pi(kp: f64, ti_s: f64) -> Vec<(String, f64)> {
    [
        (Param::SpeedKp, kp),
        (Param::SpeedKi, kp / ti_s),
        (Param::SpeedKd, 0.0),
        (Param::SpeedB, 1.0),
        (Param::SpeedTt, (1e3 * ti_s).clamp(5.0, 5000.0)),
    ]
    .into_iter()
    .map(|(param, value)| (setting_name(param), super::fixed_point::rounded(value)))
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixed_point::rig_settings;
    use crate::law::ControlLaw;
    use crate::robustness;
    use crate::sampled_loop::{Gains, Sampling};
    use crate::specification::{Specification, Speed};
    use crate::{Bench, ideal};
    use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters};
    use motorbench_model::motor::MotorParameters;

    fn trial(coulomb_friction_nm: f64, bridge: BridgeLosses) -> Trial<DcMotor> {
        let specification =
            Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.5 };
        let settings = rig_settings(&MotorParameters::PIVT6, &Bench::default(), &specification).unwrap();
        let plant = DcMotorParameters { coulomb_friction_nm, bridge, ..ideal(&MotorParameters::PIVT6) };
        Trial::new(DcMotor::new(plant), settings.all).unwrap()
    }

    const RELAY: Relay =
        Relay { reference_rad_per_s: 60.0, bias_v: 5.0, amplitude_v: 1.0, hysteresis_rad_per_s: 0.1, timeout_s: 5.0 };

    /// Friction and bridge shift the bias but hardly change the cycle, and the gains give a robust loop.
    #[test]
    fn gains_with_and_without_friction() {
        let free = experiment(&mut trial(0.0, BridgeLosses::IDEAL), &RELAY).unwrap();
        let stiff = experiment(&mut trial(0.015, BridgeLosses::L293D), &Relay { bias_v: 8.0, ..RELAY }).unwrap();
        println!("{free:?}\n{stiff:?}");
        // 60 rad/s need k w + R b w / k; friction and drop add R c / k + 2.6 V.
        assert!((free.bias_v - 4.34).abs() < 0.15, "{free:?}");
        assert!((stiff.bias_v - free.bias_v - 1.22 - 2.55).abs() < 0.2, "{stiff:?}");
        assert!((stiff.ultimate_gain_v_s_per_rad / free.ultimate_gain_v_s_per_rad - 1.0).abs() < 0.15);
        for cycle in [free, stiff] {
            let gains = tyreus_luyben(&cycle);
            let gains = Gains { feedback: vec![gains[0].1, 0.0, gains[1].1], reference: gains[0].1 };
            let judged =
                robustness::check(&MotorParameters::PIVT6, ControlLaw::SpeedPid, &Sampling::new(1e-3, 2e-3), &gains);
            assert!(judged.is_ok(), "{gains:?} {judged:?}");
        }
    }

    #[test]
    fn a_relay_that_does_not_reach_the_reference_says_so() {
        let relay = Relay { bias_v: 0.0, amplitude_v: 1.0, timeout_s: 0.5, ..RELAY };
        let error = experiment(&mut trial(0.015, BridgeLosses::L293D), &relay).unwrap_err();
        assert!(error.to_string().contains("raise the relay's amplitude"), "{error}");
    }
}

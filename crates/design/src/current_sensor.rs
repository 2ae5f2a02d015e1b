//! The cost of a missing current sensor for an LQR. For one specification it compares four loops: current measured,
//! current from the core's observer, current from a Kalman filter, and no current.
//!
//! The core can run all but the Kalman filter. The gains are not quantised, so the four loops differ only in the
//! current.

use super::law::{ControlLaw, Signal};
use super::observer::{CurrentObserver, Unknown};
use super::robustness::{self, Robustness};
use super::sampled_loop::{Gains, MotorTiming, SampledLoop};
use super::search::{Candidate, Search};
use super::specification::{Specification, Speed};
use motorbench_model::motor::MotorParameters;
use serde::Serialize;

/// Assumptions of the Kalman filter that are tried. The one with the most robust loop is used.
const FILTERS: [Unknown; 4] = [
    Unknown { voltage: 1.0, torque: 0.1, speed: 0.1 },
    Unknown { voltage: 1.0, torque: 0.1, speed: 1.0 },
    Unknown { voltage: 1.0, torque: 1.0, speed: 0.1 },
    Unknown { voltage: 0.1, torque: 1.0, speed: 1.0 },
];
/// Ticks of the plain step in which the voltage has its peak.
const PLAIN_STEP_TICKS: usize = 1000;

/// Source of the current of a law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CurrentFrom {
    /// A sensor.
    Sensor,
    /// The core's observer, from speed and voltage.
    Observer,
    /// A Kalman filter.
    Kalman,
    /// No current.
    Nothing,
}

impl CurrentFrom {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sensor => "measured",
            Self::Observer => "observer",
            Self::Kalman => "Kalman",
            Self::Nothing => "without",
        }
    }
}

/// A robust loop for the specification.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LoopWith {
    /// From reference to output, at -3 dB.
    #[serde(rename = "bandwidth_Hz")]
    pub bandwidth_hz: f64,
    /// Settling time of a plain step, within 2 %.
    pub settling_s: f64,
    /// Overshoot of the plain step.
    pub overshoot_percent: f64,
    /// Modulus margin.
    pub modulus: f64,
    /// Smallest modulus margin with parameters +-30 %; the observer's own parameters stay.
    pub worst_modulus: f64,
    /// Delay margin.
    pub delay_s: f64,
    /// Largest voltage of a plain step of 1 rad/s or 1 rad.
    #[serde(rename = "peak_V_per_unit")]
    pub peak_v_per_unit: f64,
    /// Integral of the error after a step of the load torque, in rad (speed) or rad s (position) for each Nm.
    pub error_integral_per_nm: f64,
}

/// One line of the comparison.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Source of the current.
    pub current: CurrentFrom,
    /// `None` if no loop that is fast enough is robust.
    #[serde(rename = "loop")]
    pub found: Option<LoopWith>,
}

/// The four loops of an LQR. Empty for a PID, which does not use the current.
pub fn compare(
    motor: &MotorParameters,
    timing: MotorTiming,
    law: ControlLaw,
    specification: &Specification,
) -> Vec<Comparison> {
    let current: Vec<bool> = law.feedback().iter().map(|(_, signal)| *signal == Signal::Current).collect();
    if !current.contains(&true) {
        return Vec::new();
    }
    let all = vec![true; current.len()];
    let without: Vec<bool> = current.iter().map(|is_current| !is_current).collect();
    let with = |used, observer| best(&Search { motor, law, timing, used, observer }, specification);
    let observer = CurrentObserver::of_core(motor, &timing);
    let filtered = FILTERS
        .iter()
        .filter_map(|unknown| with(&all, Some(CurrentObserver::new(motor, &timing, unknown).ok()?)))
        .max_by(|a, b| a.worst_modulus.total_cmp(&b.worst_modulus));
    vec![
        Comparison { current: CurrentFrom::Sensor, found: with(&all, None) },
        Comparison { current: CurrentFrom::Observer, found: with(&all, Some(observer)) },
        Comparison { current: CurrentFrom::Kalman, found: filtered },
        Comparison { current: CurrentFrom::Nothing, found: with(&without, None) },
    ]
}

/// The first shape of weights with a robust loop that is fast enough, as a design uses it.
fn best(search: &Search, specification: &Specification) -> Option<LoopWith> {
    let overshoot = specification.overshoot_percent;
    let candidates: Box<dyn Iterator<Item = Candidate>> = match specification.speed {
        Speed::Weights(weights) => Box::new(search.candidate(&weights, overshoot).into_iter()),
        _ => Box::new(search.shapes().into_iter().filter_map(|shape| search.gentlest(shape, specification).ok())),
    };
    let robust = |candidate: Candidate| {
        let robustness = robustness::check(search.motor, search.law, &candidate.sampling, &candidate.gains).ok()?;
        Some(loop_with(search, &candidate, &robustness))
    };
    candidates.filter(|candidate| candidate.figures.step.overshoot_percent <= overshoot).find_map(robust)
}

fn loop_with(search: &Search, candidate: &Candidate, robustness: &Robustness) -> LoopWith {
    let Candidate { figures, gains, sampling, .. } = candidate;
    let sampled = SampledLoop::new(search.motor, search.law, sampling);
    LoopWith {
        bandwidth_hz: figures.bandwidth_hz,
        settling_s: figures.step.settling_s,
        overshoot_percent: figures.step.overshoot_percent,
        modulus: robustness.margins.modulus,
        worst_modulus: robustness.worst_modulus,
        delay_s: robustness.margins.delay_s,
        peak_v_per_unit: plain_step_peaks(&sampled, gains)[0],
        error_integral_per_nm: sampled
            .error_integral(gains, &sampled.load(search.motor, sampling))
            .expect("a stable loop makes up for a load"),
    }
}

/// Largest voltage and current of a plain unit step.
pub fn plain_step_peaks(sampled: &SampledLoop, gains: &Gains) -> [f64; 2] {
    let plain = sampled.closed(gains).step_response(PLAIN_STEP_TICKS);
    let voltage = plain.row(1).iter().map(|fed_back| (fed_back + gains.reference).abs()).fold(0.0, f64::max);
    [voltage, plain.row(2).amax()]
}

/// The comparison as text; empty if there is none.
pub fn table(law: ControlLaw, comparison: &[Comparison]) -> String {
    if comparison.is_empty() {
        return String::new();
    }
    let [peak, load] = units(law);
    let mut text = String::from("  what a current sensor would bring (linear loop, exact gains; peak voltage of a\n");
    text += "  plain step, error summed after a load torque)\n";
    text += &format!("    current   bandwidth  settling  modulus  +-30 %     delay  {peak:>8}  {load:>8}\n");
    for Comparison { current, found } in comparison {
        let name = current.name();
        text += &match found {
            None => format!("    {name:8}  no robust loop is fast enough\n"),
            Some(found) => format!(
                "    {name:8}  {:6.2} Hz  {:5.1} ms  {:7.3}  {:6.3}  {:5.1} ms  {:8.3}  {:8.3}\n",
                found.bandwidth_hz,
                1e3 * found.settling_s,
                found.modulus,
                found.worst_modulus,
                1e3 * found.delay_s,
                found.peak_v_per_unit,
                found.error_integral_per_nm
            ),
        };
    }
    text
}

/// Columns of the peak voltage of a plain step and of the summed error after a load torque.
pub fn units(law: ControlLaw) -> [&'static str; 2] {
    if law.is_position() { ["V/rad", "rad s/Nm"] } else { ["V s/rad", "rad/Nm"] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loops(motor: &MotorParameters, hz: f64) -> [LoopWith; 4] {
        let specification =
            Specification { speed: Speed::BandwidthHz(hz), overshoot_percent: 10.0, current_limit_a: 1.0 };
        let comparison = compare(motor, MotorTiming::by_encoder(1e-3), ControlLaw::SpeedLqr, &specification);
        print!("{}", table(ControlLaw::SpeedLqr, &comparison));
        [0, 1, 2, 3].map(|at: usize| comparison[at].found.unwrap())
    }

    /// A current that follows the voltage within 2 ms adds little to a 10 Hz loop.
    #[test]
    fn a_slow_loop_gains_little_by_sensor_or_observer() {
        let [measured, observer, kalman, without] = loops(&MotorParameters::PIVT6, 10.0);
        for other in [measured, observer, kalman] {
            assert!((other.modulus - without.modulus).abs() < 0.1, "{other:?} {without:?}");
            // Under a load the integral must compensate what the gain on the current subtracts.
            let error = other.error_integral_per_nm / without.error_integral_per_nm;
            assert!((1.0..1.1).contains(&error), "{other:?} {without:?}");
        }
    }

    /// With 5 ms and a 20 Hz loop the current leads the speed enough to matter. The observer gives nearly all of that.
    #[test]
    fn where_the_current_is_slow_the_observer_is_worth_nearly_the_sensor() {
        let motor = MotorParameters { inductance_h: 29.2e-3, inertia_kg_m2: 4.4e-5, ..MotorParameters::PIVT6 };
        let [measured, observer, kalman, without] = loops(&motor, 20.0);
        for observer in [observer, kalman] {
            assert!(observer.modulus > measured.modulus - 0.03, "{observer:?} {measured:?}");
        }
        assert!(observer.worst_modulus > kalman.worst_modulus, "{observer:?} {kalman:?}");
        assert!(observer.modulus > without.modulus + 0.1, "{observer:?} {without:?}");
        assert!(observer.error_integral_per_nm < 0.5 * without.error_integral_per_nm, "{observer:?} {without:?}");
    }

    /// The core with an LQR whose gain on the current takes more volts under a load than the winding does.
    #[test]
    fn the_error_after_a_load_is_what_the_core_sums() {
        use crate::{Bench, design, ideal};
        use host_sim::plant::DcMotor;
        use host_sim::trial::Trial;
        const LOAD_NM: f64 = 0.02;
        let motor = MotorParameters { inductance_h: 29.2e-3, inertia_kg_m2: 4.4e-5, ..MotorParameters::PIVT6 };
        let specification =
            Specification { speed: Speed::BandwidthHz(20.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
        for current_measured in [true, false] {
            let bench = Bench { current_measured, ..Bench::default() };
            let design = design(&motor, &bench, ControlLaw::SpeedLqr, &specification).unwrap();
            let sampled = SampledLoop::new(&motor, design.law, &design.sampling);
            let said = sampled.error_integral(&design.held, &sampled.load(&motor, &design.sampling)).unwrap();
            let mut trial = Trial::new(DcMotor::new(ideal(&motor)), design.settings.all).unwrap();
            trial.enter(design.law.mode());
            trial.follow(60.0, 1.0);
            trial.surroundings.load_torque_nm = LOAD_NM;
            // After settling, the resolution of speed and duty leaves a rest that sums up as well.
            let [settling_rad, settled_rad] = [0.5, 0.5].map(|duration_s| {
                1e-3 * trial.follow(60.0, duration_s).iter().map(|point| 60.0 - point.omega_rad_per_s).sum::<f64>()
            });
            let summed = (settling_rad - settled_rad) / LOAD_NM;
            println!("current measured {current_measured}: {summed:.3} rad/Nm on the core, {said:.3} predicted");
            assert!((summed / said - 1.0).abs() < 0.05, "{summed} {said}");
        }
    }

    #[test]
    fn a_pid_has_nothing_to_compare() {
        let specification =
            Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
        let (motor, law) = (MotorParameters::PIVT6, ControlLaw::SpeedPid);
        assert!(compare(&motor, MotorTiming::by_encoder(1e-3), law, &specification).is_empty());
    }
}

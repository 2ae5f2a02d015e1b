//! Controllers for a motor. All gains are checked in the core's number formats before they are returned.
//!
//! ```text
//! model + specification -> weights -> gains -> the core's formats -> margins, +-30 %, the core itself in closed loop
//! ```
//!
//! ```
//! use motorbench_design::law::ControlLaw;
//! use motorbench_design::specification::{Specification, Speed};
//! use motorbench_design::{Bench, design};
//! use motorbench_model::motor::MotorParameters;
//!
//! let specification =
//!     Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
//! let design = design(&MotorParameters::PIVT6, &Bench::default(), ControlLaw::SpeedPid, &specification)?;
//! assert!(design.figures.bandwidth_hz > 9.9 && design.robustness.margins.modulus > 0.8);
//! for gain in &design.gains {
//!     println!("set {} {}", gain.name, gain.value);
//! }
//! # Ok::<(), motorbench_design::DesignError>(())
//! ```
//!
//! The three types to know: [`specification::Specification`], [`Design`], [`DesignError`].
//!
//! | module | what it is |
//! |---|---|
//! | [`law`] | the core's four control laws and their settings |
//! | [`specification`] | requirements for a loop |
//! | [`sampled_loop`] | motor, hold, delay and sensors as one sampled system |
//! | [`tachogenerator`] | the speed from the converter instead of the encoder |
//! | [`weights`] | Q and R, given or searched |
//! | [`search`], [`optimum`] | weights for a specification, gains for weights |
//! | [`fixed_point`] | settings, and the gains in the core's formats |
//! | [`robustness`] | margins that a loop must have |
//! | [`observer`], [`current_sensor`] | the core's current observer, a Kalman filter, and a comparison of both with a
//! sensor |
//! | [`relay`], [`step_tuning`] | gains from an experiment, without a model |
//! | [`own_loop`] | gains for the Arduino PID library and sketches of one's own |
//! | [`compensation`] | voltage against friction and the drop of the bridge |

pub mod compensation;
mod core_trial;
pub mod current_sensor;
mod error;
pub mod fixed_point;
pub mod law;
pub mod observer;
pub mod optimum;
pub mod own_loop;
pub mod own_position_loop;
pub mod relay;
pub mod robustness;
pub mod sampled_loop;
pub mod search;
pub mod specification;
pub mod step_tuning;
pub mod tachogenerator;
pub mod weights;

pub use core_trial::{TrialFigures, TrialWithEffects, ideal, trial_with_effects};
pub use error::DesignError;

use core_trial::StepTrial;
use fixed_point::SettingList;
use host_sim::trial::Point;
use law::{ControlLaw, Signal, setting_name, setting_unit};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::rig;
use motorbench_model::Model;
use motorbench_model::motor::MotorParameters;
use robustness::{Robustness, Weakness};
use sampled_loop::{Gains, MotorTiming, SampledLoop, Sampling};
use search::{Candidate, LoadFigures, LoopFigures, Reached, Search};
use serde::Serialize;
use specification::{Specification, Speed};
use tachogenerator::Tachogenerator;
use weights::{BadWeight, Weights};

/// The rig around the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bench {
    /// Motor supply, in volts.
    pub supply_v: f64,
    /// Encoder counts a revolution after x4 decoding; `None`: there is no encoder.
    pub counts_per_rev: Option<f64>,
    /// Measures the speed instead of the encoder.
    pub tachogenerator: Option<Tachogenerator>,
    /// Control rate: 1000 or 2000 Hz.
    pub tick_rate_hz: f64,
    /// Whether the current is measured. Without a sensor an LQR uses the core's observer, which needs an encoder.
    pub current_measured: bool,
    /// Delay of the voltage beyond the firmware's own, from the model. It includes the lag of a tachogenerator: for a
    /// slow loop a lag is a delay.
    pub delay_s: f64,
}

impl Default for Bench {
    /// The core's defaults.
    fn default() -> Self {
        let settings = Settings::defaults();
        Self {
            supply_v: settings.get(Param::SupplyVoltage).into(),
            counts_per_rev: Some(settings.get(Param::CountsPerRev).into()),
            tachogenerator: None,
            tick_rate_hz: settings.get(Param::TickRate).into(),
            current_measured: true,
            delay_s: 0.0,
        }
    }
}

/// A key of the rig file that a design cannot do without.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MissingKey {
    /// A design needs it.
    #[error("{0} is missing: add it, the design needs it")]
    Needed(&'static str),
    /// There is no sensor of the speed.
    #[error("encoder.counts_per_rev is missing: add it. A speed loop can use tachogenerator.gain_V_per_krpm instead")]
    Sensor,
}

impl Bench {
    /// The rig of a file, with the delay of a model of its motor.
    ///
    /// # Errors
    /// [`MissingKey`].
    pub fn of_rig(rig: &rig::Rig, model: Option<&Model>) -> Result<Self, MissingKey> {
        let tachogenerator = match tachogenerator::of_rig(rig) {
            Some(gain) => Some(gain.ok_or(MissingKey::Needed("tachogenerator.gain_V_per_krpm"))?),
            None => None,
        };
        if rig.encoder.counts_per_rev.is_none() && tachogenerator.is_none() {
            return Err(MissingKey::Sensor);
        }
        let late_s = |model: &Model| {
            // It includes the lag of a tachogenerator that measures the speed.
            model.delay_s() + if tachogenerator.is_some() { model.tachogenerator_lag_s() } else { 0.0 }
        };
        Ok(Self {
            supply_v: rig.supply.voltage_v.ok_or(MissingKey::Needed("supply.voltage_V"))?,
            counts_per_rev: rig.encoder.counts_per_rev,
            tachogenerator,
            current_measured: rig.current_sensor.present != Some(false),
            delay_s: model.map_or(0.0, late_s),
            ..Self::default()
        })
    }
}

/// A gain of a design.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DesignedGain {
    /// The setting's name on the console.
    pub name: String,
    /// The setting's unit.
    pub unit: String,
    /// Value that is set.
    pub value: f64,
    /// Value in the core's fixed-point format.
    pub held: f64,
}

/// A design with checked gains.
#[derive(Clone, Debug, Serialize)]
pub struct Design {
    /// Which law.
    pub law: ControlLaw,
    /// The specification that it meets.
    pub specification: Specification,
    /// Its gains.
    pub gains: Vec<DesignedGain>,
    /// Console lines: settings of the rig, and the gains.
    pub commands: Vec<String>,
    /// Figures of the linear loop with the gains in the core's formats.
    pub figures: LoopFigures,
    /// Robustness with the gains in the core's formats.
    pub robustness: Robustness,
    /// Figures of the core in closed loop.
    pub trial: TrialFigures,
    /// Largest voltage of a plain step, without limits and profile. The step is as large as the trial's.
    #[serde(rename = "plain_step_peak_V")]
    pub plain_step_peak_v: f64,
    /// Largest current of that step.
    #[serde(rename = "plain_step_peak_A")]
    pub plain_step_peak_a: f64,
    /// Comparison of sources of the current, for an LQR on a rig without a current sensor. Otherwise empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub current_sensor: Vec<current_sensor::Comparison>,
    /// Why the law has no gain on a current that is available: the failure of the loop with that gain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current_left_out: Option<String>,
    /// Effect of a load on a position loop. Its step does not show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load: Option<LoadFigures>,
    /// Tachogenerator that measures the speed instead of the encoder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tachogenerator: Option<Tachogenerator>,
    /// Its weights, given or searched. Weights that are given by hand give the same gains.
    pub weights: Weights,
    /// Settings, for a simulation or the board.
    #[serde(skip)]
    pub settings: SettingList,
    /// Gains in the core's formats.
    #[serde(skip)]
    pub held: Gains,
    /// Sampling of the core.
    #[serde(skip)]
    pub sampling: Sampling,
    /// The trial, tick by tick.
    #[serde(skip)]
    pub points: Vec<Point>,
}

impl Design {
    /// The controlled quantity at each tick of the trial for a linear and exact loop.
    pub fn linear_response(&self, motor: &MotorParameters) -> Vec<f64> {
        let sampled = SampledLoop::new(motor, self.law, &self.sampling);
        let closed = sampled.closed(&self.held);
        let along_speed = sampled.system().1 * self.reference_speed_gain();
        let mut x = nalgebra::DVector::zeros(sampled.states());
        let (reference, speed) = (closed.b.column(0), along_speed.column(0));
        let mut before = 0.0;
        let respond = |point: &Point| {
            let output = (&closed.c * &x)[0];
            let reference_speed = (point.reference - before) / self.sampling.period_s;
            before = point.reference;
            x = &closed.a * &x + reference * point.reference + speed * reference_speed;
            output
        };
        self.points.iter().map(respond).collect()
    }

    /// Feed-forward of a position law for each rad/s of its reference.
    fn reference_speed_gain(&self) -> f64 {
        match self.law {
            ControlLaw::SpeedPid | ControlLaw::SpeedLqr => 0.0,
            ControlLaw::PositionPid => self.settings.all.get(Param::PositionKff).into(),
            ControlLaw::PositionLqr => self.settings.all.get(Param::LqrPositionKw).into(),
        }
    }
}

/// Longest delay of a voltage, in ticks. Each tick is a state of the loop, and the search takes time with the cube of
/// the states.
const MOST_DELAY_TICKS: f64 = 20.0;

/// Designs one law for a motor.
///
/// # Errors
/// [`DesignError`]: the problem, or the requirement that the best loop misses.
pub fn design(
    motor: &MotorParameters,
    bench: &Bench,
    law: ControlLaw,
    specification: &Specification,
) -> Result<Design, DesignError> {
    motor.check()?;
    let period_s = 1.0 / bench.tick_rate_hz;
    specification.check(period_s)?;
    let most_s = MOST_DELAY_TICKS * period_s;
    if bench.delay_s > most_s {
        return Err(DesignError::Delay { delay_s: bench.delay_s, most_s });
    }
    if bench.counts_per_rev.is_none() && (law.is_position() || bench.tachogenerator.is_none()) {
        return Err(DesignError::NoEncoder { law: law.title() });
    }
    let mut design = best_design(motor, bench, law, specification)?;
    if !bench.current_measured {
        let Sampling { delay_s, speed, .. } = design.sampling;
        design.current_sensor =
            current_sensor::compare(motor, MotorTiming { period_s, delay_s, speed }, law, specification);
    }
    Ok(design)
}

/// The first shape of weights that passes all checks, or the given weights. If the gain on the current makes the loop
/// fragile, or cannot be held, the design leaves it out. Then the current is not observed either.
fn best_design(
    motor: &MotorParameters,
    bench: &Bench,
    law: ControlLaw,
    specification: &Specification,
) -> Result<Design, DesignError> {
    let period_s = 1.0 / bench.tick_rate_hz;
    let rig = fixed_point::rig_settings(motor, bench, specification)?;
    let timing = MotorTiming { period_s, delay_s: bench.delay_s, speed: fixed_point::speed_path(&rig)? };
    let rig = Rig { settings: rig, tachogenerator: bench.tachogenerator };
    let observer = observes_current(bench).then(|| observer::CurrentObserver::of_core(motor, &timing));
    let with = |current_used: bool| {
        let used: Vec<bool> =
            law.feedback().iter().map(|(_, signal)| current_used || *signal != Signal::Current).collect();
        let search = Search { motor, law, timing, used: &used, observer: observer.clone().filter(|_| current_used) };
        match specification.speed {
            Speed::Weights(weights) => with_given_weights(&search, &rig, specification, &weights),
            Speed::BandwidthHz(_) | Speed::SettlingS(_) => with_searched_weights(&search, &rig, specification),
        }
    };
    let current_known = bench.current_measured || observer.is_some();
    match with(current_known) {
        // The current can show the speed earlier than the speed sensor does. A gain that relies on it has no delay
        // margin.
        Err(error) if current_known && is_due_to_current_gain(law, &error) => match with(false) {
            Ok(design) => Ok(Design { current_left_out: Some(error.to_string()), ..design }),
            Err(_) => Err(error),
        },
        designed => designed,
    }
}

/// Whether a loop without the current may succeed where this one fails. The gain on the current may have made the loop
/// fragile, or may exceed its format, as with a slow winding.
fn is_due_to_current_gain(law: ControlLaw, error: &DesignError) -> bool {
    let on_current = law.feedback().iter().find(|(_, signal)| *signal == Signal::Current);
    on_current.is_some_and(|&(param, _)| match error {
        DesignError::NotRobust { .. } => true,
        DesignError::Setting { name, .. } => *name == setting_name(param),
        _ => false,
    })
}

/// Whether the core has to observe the current. The speed of a tachogenerator is too coarse and filtered for that.
fn observes_current(bench: &Bench) -> bool {
    !bench.current_measured && bench.tachogenerator.is_none()
}

/// The loop with the weights that the search finds.
fn with_searched_weights(search: &Search, rig: &Rig, specification: &Specification) -> Result<Design, DesignError> {
    let Search { motor, law, .. } = *search;
    let mut refusals = Refusals::default();
    for shape in search.shapes() {
        let candidate = match search.gentlest(shape, specification) {
            Ok(candidate) => candidate,
            Err(reached) => {
                refusals.too_slow(reached);
                continue;
            }
        };
        if candidate.figures.step.overshoot_percent > specification.overshoot_percent {
            refusals.overshoot(candidate.figures.step.overshoot_percent);
            continue;
        }
        match quantised_for_reversals(motor, rig, law, specification, candidate) {
            Ok(design) => return Ok(design),
            Err(error) => refusals.checked = Some(error),
        }
    }
    Err(refusals.error(law, specification))
}

/// Settings and sensor that all laws of a rig share.
struct Rig {
    settings: SettingList,
    tachogenerator: Option<Tachogenerator>,
}

/// Largest ratio of two weights. Beyond it the smaller is lost in the digits of a number.
const OUT_OF_PROPORTION: f64 = 1e12;

/// The loop with the given weights.
fn with_given_weights(
    search: &Search,
    rig: &Rig,
    specification: &Specification,
    weights: &Weights,
) -> Result<Design, DesignError> {
    let Search { motor, law, .. } = *search;
    if weights.is_position() != law.is_position() {
        return Err(BadWeight::OtherLoop { position: weights.is_position() }.into());
    }
    let options = weights.options();
    let asked_percent = specification.overshoot_percent;
    let candidate = search.candidate(weights, asked_percent).ok_or_else(|| {
        let (law, options, times) = (law.title(), options.clone(), weights.span());
        if times > OUT_OF_PROPORTION {
            return DesignError::OutOfProportion { law, options, times };
        }
        let within_s = search::MAX_SAMPLES as f64 * search.timing.period_s;
        DesignError::NoGains { law, options, within_s }
    })?;
    let found_percent = candidate.figures.step.overshoot_percent;
    let design = if found_percent > asked_percent {
        Err(DesignError::Overshoot { law: law.title(), found_percent, asked_percent })
    } else {
        quantised_for_reversals(motor, rig, law, specification, candidate)
    };
    design.map_err(|error| DesignError::GivenWeights { options, error: Box::new(error) })
}

/// How much less is asked for from trial to trial, and how often.
const LESS: f64 = 0.7;
const MOST_TRIALS: i32 = 10;

/// The fastest specification that a loop can meet, among those less and less fast than one that it cannot: each is tried.
/// `None` if there is none, or if weights were given.
pub fn fastest_possible(
    motor: &MotorParameters,
    bench: &Bench,
    law: ControlLaw,
    refused: &Specification,
) -> Option<Specification> {
    (1..=MOST_TRIALS).find_map(|trial| {
        let less = LESS.powi(trial);
        let speed = match refused.speed {
            Speed::BandwidthHz(hz) => Speed::BandwidthHz(two_digits(less * hz)),
            Speed::SettlingS(settling_s) => Speed::SettlingS(two_digits(settling_s / less)),
            Speed::Weights(_) => return None,
        };
        let specification = Specification { speed, ..*refused };
        design(motor, bench, law, &specification).is_ok().then_some(specification)
    })
}

/// A number that a person can type.
fn two_digits(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

/// Reasons why shapes were refused. The best attempt is reported.
#[derive(Default)]
struct Refusals {
    reached: Option<Reached>,
    overshoot_percent: Option<f64>,
    checked: Option<DesignError>,
}

impl Refusals {
    fn too_slow(&mut self, reached: Reached) {
        if self.reached.is_none_or(|before| before.bandwidth_hz < reached.bandwidth_hz) {
            self.reached = Some(reached);
        }
    }

    fn overshoot(&mut self, percent: f64) {
        self.overshoot_percent = Some(self.overshoot_percent.map_or(percent, |before| before.min(percent)));
    }

    fn error(self, law: ControlLaw, specification: &Specification) -> DesignError {
        let law = law.title();
        if let Some(error) = self.checked {
            return error;
        }
        if let Some(found_percent) = self.overshoot_percent {
            return DesignError::Overshoot { law, found_percent, asked_percent: specification.overshoot_percent };
        }
        let reached = self.reached.unwrap_or_default();
        let reached = match specification.speed {
            Speed::BandwidthHz(_) => format!("its bandwidth reaches {:.3} Hz", reached.bandwidth_hz),
            Speed::SettlingS(_) => format!("it settles in {:.3} s", reached.settling_s),
            Speed::Weights(weights) => format!("with {}", weights.options()),
        };
        DesignError::TooSlow { law, reached }
    }
}

/// Quantises a candidate and checks it.
fn quantised_for_reversals(
    motor: &MotorParameters,
    rig: &Rig,
    law: ControlLaw,
    specification: &Specification,
    candidate: Candidate,
) -> Result<Design, DesignError> {
    let design = quantised(motor, rig, law, specification, candidate)?;
    if let Some(tachogenerator) = rig.tachogenerator {
        tachogenerator.check_reversal(motor, design.settings.all.get(Param::Acceleration).into())?;
    }
    Ok(design)
}

/// The same, without the check for reversals with a tachogenerator.
fn quantised(
    motor: &MotorParameters,
    rig: &Rig,
    law: ControlLaw,
    specification: &Specification,
    candidate: Candidate,
) -> Result<Design, DesignError> {
    let mut settings = fixed_point::law_settings(&rig.settings, motor, law, &candidate.sampling, &candidate.gains)?;
    let (held, sampling) = fixed_point::read_back(&settings, law)?;
    // The settings contain the filters. Delay and observer come from the model.
    let Sampling { delay_s, observer, .. } = candidate.sampling.clone();
    let sampling = Sampling { delay_s, observer, ..sampling };
    let not_robust = |weakness| DesignError::NotRobust { law: law.title(), weakness };
    let robustness = robustness::check(motor, law, &sampling, &held).map_err(not_robust)?;
    let sampled = SampledLoop::new(motor, law, &sampling);
    let figures = search::figures(&sampled, &held, candidate.crossover_rad_per_s)
        .ok_or_else(|| not_robust(Weakness::Unstable { radius: robustness.spectral_radius }))?;
    check_specification(law, specification, &candidate.figures, &figures)?;
    let trials =
        StepTrial { motor, law, tachogenerator: rig.tachogenerator, delay_s, settling_s: figures.step.settling_s };
    let (trial, points) = trials.within_limits(&mut settings, specification)?;
    let [peak_v, peak_a] = current_sensor::plain_step_peaks(&sampled, &held);
    let gains = law.feedback().iter().zip(&held.feedback).map(|(&(param, _), &held)| DesignedGain {
        name: setting_name(param),
        unit: setting_unit(param),
        value: fixed_point::rounded(settings.all.get(param).into()),
        held,
    });
    Ok(Design {
        law,
        specification: *specification,
        gains: gains.collect(),
        commands: settings.commands(),
        figures,
        robustness,
        plain_step_peak_v: peak_v * trial.step,
        plain_step_peak_a: peak_a * trial.step,
        current_sensor: Vec::new(),
        current_left_out: None,
        load: law.is_position().then(|| {
            let load = sampled.load(motor, &sampling);
            search::load_figures(&sampled, &held, &load, candidate.crossover_rad_per_s)
        }),
        tachogenerator: rig.tachogenerator,
        trial,
        weights: candidate.weights,
        settings,
        held,
        sampling,
        points,
    })
}

/// Share of a figure of the specification that quantising may cost.
const QUANTISING: f64 = 0.05;

/// Checks that the loop with the gains in the core's formats meets the specification. With given weights it must match
/// the loop with the exact gains.
fn check_specification(
    law: ControlLaw,
    specification: &Specification,
    exact: &LoopFigures,
    figures: &LoopFigures,
) -> Result<(), DesignError> {
    let overshoot = figures.step.overshoot_percent;
    let slow = match specification.speed {
        Speed::BandwidthHz(hz) => figures.bandwidth_hz < (1.0 - QUANTISING) * hz,
        Speed::SettlingS(settling_s) => figures.step.settling_s > (1.0 + QUANTISING) * settling_s,
        Speed::Weights(_) => (figures.bandwidth_hz / exact.bandwidth_hz - 1.0).abs() > QUANTISING,
    };
    if slow || overshoot > specification.overshoot_percent + 100.0 * QUANTISING {
        return Err(DesignError::Quantised {
            law: law.title(),
            bandwidth_hz: figures.bandwidth_hz,
            settling_s: figures.step.settling_s,
            overshoot_percent: overshoot,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;

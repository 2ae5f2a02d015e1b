//! Controllers for a motor: gains that the core can hold, checked before they are offered.
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
//! | [`specification`] | what a loop is asked to do |
//! | [`sampled_loop`] | motor, hold, delay and sensors as one sampled system |
//! | [`tachogenerator`] | the speed from the converter instead of the encoder |
//! | [`weights`] | Q and R, given or found |
//! | [`search`], [`optimum`] | weights for a specification, gains for weights |
//! | [`fixed_point`] | settings, and the gains the core's formats make of them |
//! | [`robustness`] | what a loop must withstand |
//! | [`observer`], [`current_sensor`] | the current of the core's observer, and of a Kalman filter; what these, or a sensor, are worth |
//! | [`relay`], [`step_tuning`] | gains from an experiment, without a model |
//! | [`compensation`] | voltage against friction and the bridge's drop |

pub mod compensation;
pub mod current_sensor;
pub mod fixed_point;
pub mod law;
pub mod observer;
pub mod optimum;
pub mod relay;
pub mod robustness;
pub mod sampled_loop;
pub mod search;
pub mod specification;
pub mod step_tuning;
pub mod tachogenerator;
pub mod weights;

use fixed_point::SettingList;
use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters, Plant};
use host_sim::trial::{Point, Trial};
use law::{ControlLaw, Signal, setting_name, setting_unit};
use motorbench_core::message::Trip;
use motorbench_core::settings::{BuildError, Param, Settings};
use motorbench_data::telemetry::speed_bit_rad_per_s;
use motorbench_model::Model;
use motorbench_model::linear::motor_model;
use motorbench_model::motor::{MotorParameters, NonPhysical};
use robustness::{Robustness, Weakness};
use sampled_loop::{Gains, SampledLoop, Sampling, Seen};
use search::{Candidate, LoadFigures, LoopFigures, Reached, Search};
use serde::Serialize;
use specification::{ImpossibleSpecification, Specification, Speed};
use tachogenerator::Tachogenerator;
use weights::{BadWeight, Weights};

/// The surroundings of the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bench {
    /// Motor supply, in volts.
    pub supply_v: f64,
    /// Encoder counts a turn, after x4 decoding; `None`: there is no encoder.
    pub counts_per_rev: Option<f64>,
    /// The speed is measured by this, and not by the encoder.
    pub tachogenerator: Option<Tachogenerator>,
    /// Control rate: 1000 or 2000 Hz.
    pub tick_rate_hz: f64,
    /// Whether the current is measured; without it an LQR has that of the core's observer, by an encoder.
    pub current_measured: bool,
    /// By how much the voltage comes later than the firmware's own, as a model says it, and the speed by a tachogenerator's lag: to a
    /// loop that is slow beside it a lag is a delay.
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

/// Why a design failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DesignError {
    /// The model is no motor.
    #[error("the motor's {0}")]
    Model(#[from] NonPhysical),
    /// No loop can do this.
    #[error("the specification's {0}")]
    Specification(#[from] ImpossibleSpecification),
    /// The edges come faster than the chip can count.
    #[error(
        "the encoder gives {edges_per_s:.0} edges/s at no load, the chip counts {limit_per_s:.0}: lower the supply or use a coarser encoder"
    )]
    TooFast {
        /// At the no-load speed.
        edges_per_s: f64,
        /// What the chip counts.
        limit_per_s: f64,
    },
    /// The law needs an encoder.
    #[error(
        "the {law} needs an encoder, and the rig has none: the firmware takes a position from the encoder's counts alone, and a speed from these or a tachogenerator; add encoder.counts_per_rev, or control the speed with a tachogenerator"
    )]
    NoEncoder {
        /// Which law.
        law: &'static str,
    },
    /// The tachogenerator's voltage is nothing the firmware can measure.
    #[error("the tachogenerator: {what}")]
    Tachogenerator {
        /// What is wrong with it, and what to do.
        what: String,
    },
    /// The core cannot hold a setting.
    #[error("{name} = {value} {unit} {why}: {advice}")]
    Setting {
        /// Its name on the console.
        name: String,
        /// The value.
        value: f64,
        /// Its unit.
        unit: String,
        /// Which rule it breaks.
        why: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// No loop came up to the specification.
    #[error("the {law} cannot be that fast: {reached}. Ask for a lower bandwidth, or allow more overshoot")]
    TooSlow {
        /// Which law.
        law: &'static str,
        /// How fast it came.
        reached: String,
    },
    /// No fast enough loop kept the overshoot.
    #[error(
        "the {law} overshoots by {found_percent:.1} % at least, {asked_percent} % are allowed: allow more, or ask for another speed"
    )]
    Overshoot {
        /// Which law.
        law: &'static str,
        /// Least found.
        found_percent: f64,
        /// Asked for.
        asked_percent: f64,
    },
    /// Rounded to the core's formats, the gains miss the specification.
    #[error(
        "rounded to the core's formats, the {law} has a bandwidth of {bandwidth_hz:.3} Hz, settles in {settling_s:.3} s and overshoots by {overshoot_percent:.1} %: ask for a faster loop"
    )]
    Quantised {
        /// Which law.
        law: &'static str,
        /// Bandwidth that is left.
        bandwidth_hz: f64,
        /// Settling time.
        settling_s: f64,
        /// Overshoot.
        overshoot_percent: f64,
    },
    /// The loop would not withstand what it meets.
    #[error("the {law} would not be robust: {weakness}; ask for a slower loop")]
    NotRobust {
        /// Which law.
        law: &'static str,
        /// What it does not withstand.
        weakness: Weakness,
    },
    /// The voltage comes too late for a loop that has it in its states.
    #[error(
        "the model's actuation_delay.delay_s = {delay_s} s exceeds the {most_s} s that a design can handle at this tick rate (a tachogenerator's speed_lag.time_constant_s is included). Find and remove what delays the voltage or the reading"
    )]
    Delay {
        /// The model's.
        delay_s: f64,
        /// The longest.
        most_s: f64,
    },
    /// They are no weights.
    #[error(transparent)]
    BadWeight(#[from] BadWeight),
    /// Weights were given for which there are no gains.
    #[error("the {law} with {options} has no gains with which a step settles within {within_s} s; {WEIGHTS_ADVICE}")]
    NoGains {
        /// Which law.
        law: &'static str,
        /// The weights.
        options: String,
        /// As long as it was looked at.
        within_s: f64,
    },
    /// The same, where no numbers could tell the loop that they ask for.
    #[error(
        "the {law} with {options} has no solution: the largest weight is {times:.0e} times the smallest. A weight is one over the square of an acceptable deviation. Bring the weights closer together, or give the deviations (--largest, --largest-V)"
    )]
    OutOfProportion {
        /// Which law.
        law: &'static str,
        /// The weights.
        options: String,
        /// From the smallest to the largest.
        times: f64,
    },
    /// Weights were given, and the loop is refused for another reason.
    #[error("with {options}, {error}; {WEIGHTS_ADVICE}")]
    Weighed {
        /// The weights.
        options: String,
        /// Why it is refused.
        error: Box<Self>,
    },
    /// The core in closed loop does not do what the linear loop does.
    #[error("the {law} fails in fixed point: {what}; ask for a slower loop, or raise current-limit-A")]
    Trial {
        /// Which law.
        law: &'static str,
        /// What went wrong.
        what: String,
    },
    /// The same with the effects of the model.
    #[error(
        "with the effects of the model the {law} does not work: {what}; ask for a slower loop, raise current-limit-A, or compensate friction and drop where that is not done yet (--compensate)"
    )]
    WithEffects {
        /// Which law.
        law: &'static str,
        /// What went wrong.
        what: String,
    },
}

/// A gain of a design.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DesignedGain {
    /// The setting's name on the console.
    pub name: String,
    /// The setting's unit.
    pub unit: String,
    /// As it is set.
    pub value: f64,
    /// As the core's fixed-point format holds it.
    pub held: f64,
}

/// The core in closed loop with the motor of the model, behind an ideal bridge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialFigures {
    /// Step of the reference, in rad/s or rad.
    pub step: f64,
    /// Largest deviation from the reference in the last fifth, in rad/s or rad.
    pub last_deviation: f64,
    /// Largest excess over the step, in percent of it.
    pub overshoot_percent: f64,
    /// Largest voltage.
    #[serde(rename = "peak_V")]
    pub peak_v: f64,
    /// Largest current.
    #[serde(rename = "peak_A")]
    pub peak_a: f64,
    /// Part of the time at a limit of voltage, slew or current.
    pub limited_part: f64,
    /// From the smallest to the largest voltage in the last fifth: what the resolution and the ripple of the sensors keep
    /// moving.
    #[serde(rename = "swing_V")]
    pub swing_v: f64,
}

/// A design: gains that were checked.
#[derive(Clone, Debug, Serialize)]
pub struct Design {
    /// Which law.
    pub law: ControlLaw,
    /// What was asked.
    pub specification: Specification,
    /// Its gains.
    pub gains: Vec<DesignedGain>,
    /// Lines for the console: the rig's settings and the gains.
    pub commands: Vec<String>,
    /// What the linear loop does with the gains as held.
    pub figures: LoopFigures,
    /// How robust it is with the gains as held.
    pub robustness: Robustness,
    /// What the core did.
    pub trial: TrialFigures,
    /// Voltage and current a plain step of the size of the trial's would take at most, without limits and profile.
    #[serde(rename = "plain_step_peak_V")]
    pub plain_step_peak_v: f64,
    /// The current.
    #[serde(rename = "plain_step_peak_A")]
    pub plain_step_peak_a: f64,
    /// An LQR of a rig without a current sensor: what the sensor would bring, the observer does, and nothing would. Else empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub current_sensor: Vec<current_sensor::Comparison>,
    /// Why the law does without a gain on a current that it has: what is said against the loop with one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current_left_out: Option<String>,
    /// What a load does to a position loop, which its step does not show.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load: Option<LoadFigures>,
    /// What measures the speed in place of the encoder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tachogenerator: Option<Tachogenerator>,
    /// The weights it came from, given or found. Given by hand they are the same gains.
    pub weights: Weights,
    /// Settings, for a simulation or the board.
    #[serde(skip)]
    pub settings: SettingList,
    /// Gains as the core holds them.
    #[serde(skip)]
    pub held: Gains,
    /// Sampling as the core does it.
    #[serde(skip)]
    pub sampling: Sampling,
    /// The trial, tick by tick.
    #[serde(skip)]
    pub points: Vec<Point>,
}

impl Design {
    /// The controlled quantity at each tick of the trial, had everything been linear and exact.
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

    /// What a position law adds for each rad/s of its reference.
    fn reference_speed_gain(&self) -> f64 {
        match self.law {
            ControlLaw::SpeedPid | ControlLaw::SpeedLqr => 0.0,
            ControlLaw::PositionPid => self.settings.all.get(Param::PositionKff).into(),
            ControlLaw::PositionLqr => self.settings.all.get(Param::LqrPositionKw).into(),
        }
    }
}

/// Ticks that a voltage may be on its way: each is a state of the loop, and the search takes time with their cube.
const MOST_DELAY_TICKS: f64 = 20.0;

/// Designs one law for a motor.
///
/// # Errors
/// [`DesignError`]: what is wrong, or what the best loop found does not do.
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
    let mut design = best_shape(motor, bench, law, specification)?;
    if !bench.current_measured {
        let Sampling { delay_s, speed, .. } = design.sampling;
        design.current_sensor = current_sensor::compare(motor, Seen { period_s, delay_s, speed }, law, specification);
    }
    Ok(design)
}

/// The design with the first shape of weights that passes all checks, or by the weights given; without a gain on the current
/// where one would not be robust or cannot be held, nor the speed fit to observe it.
fn best_shape(
    motor: &MotorParameters,
    bench: &Bench,
    law: ControlLaw,
    specification: &Specification,
) -> Result<Design, DesignError> {
    let period_s = 1.0 / bench.tick_rate_hz;
    let rig = fixed_point::rig_settings(motor, bench, specification)?;
    let seen = Seen { period_s, delay_s: bench.delay_s, speed: fixed_point::speed_path(&rig)? };
    let rig = Rig { settings: rig, tachogenerator: bench.tachogenerator };
    let observer = observes_current(bench).then(|| observer::CurrentObserver::of_core(motor, &seen));
    let with = |current_used: bool| {
        let used: Vec<bool> =
            law.feedback().iter().map(|(_, signal)| current_used || *signal != Signal::Current).collect();
        let search = Search { motor, law, seen, used: &used, observer: observer.clone().filter(|_| current_used) };
        match specification.speed {
            Speed::Weights(weights) => weighed(&search, &rig, specification, &weights),
            Speed::BandwidthHz(_) | Speed::SettlingS(_) => searched(&search, &rig, specification),
        }
    };
    let current_known = bench.current_measured || observer.is_some();
    match with(current_known) {
        // The current may tell the speed sooner than the speed's own way does: a gain that lives on it bears no delay.
        Err(error) if current_known && is_for_the_current(law, &error) => match with(false) {
            Ok(design) => Ok(Design { current_left_out: Some(error.to_string()), ..design }),
            Err(_) => Err(error),
        },
        designed => designed,
    }
}

/// Whether a loop that does without the current may do what this one does not: the gain on it made the loop fragile, or is
/// itself beyond its format, as with a slow winding.
fn is_for_the_current(law: ControlLaw, error: &DesignError) -> bool {
    let on_current = law.feedback().iter().find(|(_, signal)| *signal == Signal::Current);
    on_current.is_some_and(|&(param, _)| match error {
        DesignError::NotRobust { .. } => true,
        DesignError::Setting { name, .. } => *name == setting_name(param),
        _ => false,
    })
}

/// Whether the core has to observe the current: a tachogenerator's speed is too coarse, and filtered.
fn observes_current(bench: &Bench) -> bool {
    !bench.current_measured && bench.tachogenerator.is_none()
}

/// The loop of weights that are searched.
fn searched(search: &Search, rig: &Rig, specification: &Specification) -> Result<Design, DesignError> {
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
        match checked(motor, rig, law, specification, candidate) {
            Ok(design) => return Ok(design),
            Err(error) => refusals.checked = Some(error),
        }
    }
    Err(refusals.error(law, specification))
}

/// What every law of a rig has in common.
struct Rig {
    settings: SettingList,
    tachogenerator: Option<Tachogenerator>,
}

/// What to do about a loop by the weights that were given.
const WEIGHTS_ADVICE: &str = "a larger r makes the loop slower, a smaller weight on the integral lets it overshoot less, a larger one on the speed damps";

/// Weights farther apart than this are no loop's: what they say is lost in the digits of a number.
const OUT_OF_PROPORTION: f64 = 1e12;

/// The loop of weights that were given.
fn weighed(
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
        let within_s = search::MAX_SAMPLES as f64 * search.seen.period_s;
        DesignError::NoGains { law, options, within_s }
    })?;
    let found_percent = candidate.figures.step.overshoot_percent;
    let design = if found_percent > asked_percent {
        Err(DesignError::Overshoot { law: law.title(), found_percent, asked_percent })
    } else {
        checked(motor, rig, law, specification, candidate)
    };
    design.map_err(|error| DesignError::Weighed { options, error: Box::new(error) })
}

/// Why shapes were refused; the one that came farthest is reported.
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

/// Quantises a candidate, and checks what is left.
fn checked(
    motor: &MotorParameters,
    rig: &Rig,
    law: ControlLaw,
    specification: &Specification,
    candidate: Candidate,
) -> Result<Design, DesignError> {
    let design = tried(motor, rig, law, specification, candidate)?;
    if let Some(tachogenerator) = rig.tachogenerator {
        tachogenerator.check_reversal(motor, design.settings.all.get(Param::Acceleration).into())?;
    }
    Ok(design)
}

/// The same, without asking what a tachogenerator sees of a reversal.
fn tried(
    motor: &MotorParameters,
    rig: &Rig,
    law: ControlLaw,
    specification: &Specification,
    candidate: Candidate,
) -> Result<Design, DesignError> {
    let mut settings = fixed_point::law_settings(&rig.settings, motor, law, &candidate.sampling, &candidate.gains)?;
    let (held, sampling) = fixed_point::read_back(&settings, law)?;
    // Of the settings they know the filters; the delay and the observer's constants are the model's.
    let Sampling { delay_s, observer, .. } = candidate.sampling.clone();
    let sampling = Sampling { delay_s, observer, ..sampling };
    let not_robust = |weakness| DesignError::NotRobust { law: law.title(), weakness };
    let robustness = robustness::check(motor, law, &sampling, &held).map_err(not_robust)?;
    let sampled = SampledLoop::new(motor, law, &sampling);
    let figures = search::figures(&sampled, &held, candidate.crossover_rad_per_s)
        .ok_or_else(|| not_robust(Weakness::Unstable { radius: robustness.spectral_radius }))?;
    kept(law, specification, &candidate.figures, &figures)?;
    let trials =
        StepTrial { motor, law, tachogenerator: rig.tachogenerator, delay_s, settling_s: figures.step.settling_s };
    let (trial, points) = trials.gentle(&mut settings, specification)?;
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

/// Part of a figure of the specification that quantising may cost.
const QUANTISING: f64 = 0.05;

/// Whether the loop keeps the specification with the gains as the core holds them; one by weights that were given, what
/// it does with the exact gains.
fn kept(
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

/// Profiles tried, each gentler than the one before, and by how much where nothing says more.
const PROFILES: usize = 12;
const GENTLER: f64 = 0.6;
/// Overshoot of the core that no specification forbids: what the resolution of sensors and duty leaves.
const LEAST_OVERSHOOT_PERCENT: f64 = 0.5;
/// Part of the no-load speed that the trial's speed step goes to.
const TRIAL_SPEED_PART: f64 = 0.4;
/// Angle the trial's position step goes to.
const TRIAL_ANGLE_RAD: f64 = std::f64::consts::TAU;
/// Part of the trial at its end in which it must have settled.
const SETTLED_PART: usize = 5;
/// Counts a position may be off at the end, and bits a speed.
const SETTLED_COUNTS: f64 = 2.0;
const SETTLED_SPEED_BITS: f64 = 8.0;
/// Steps of the converter a speed by the tachogenerator may be off: one that is cut off, one between which the loop hunts.
const SETTLED_TACHO_STEPS: f64 = 2.0;
/// Part of the step that a trial may be off at its end, where that is more.
const SETTLED_STEP_PART: f64 = 0.02;

/// The trial of a law on the core with the motor of the model.
struct StepTrial<'a> {
    motor: &'a MotorParameters,
    law: ControlLaw,
    tachogenerator: Option<Tachogenerator>,
    /// Of the voltage.
    delay_s: f64,
    /// Of the linear loop.
    settling_s: f64,
}

impl StepTrial<'_> {
    /// A trial with the feed-forward lowered and the reference's profile slowed down until overshoot and current stay
    /// where they may.
    fn gentle(
        &self,
        settings: &mut SettingList,
        specification: &Specification,
    ) -> Result<(TrialFigures, Vec<Point>), DesignError> {
        let law = self.law;
        let most_a = fixed_point::ACCELERATION_PART * specification.current_limit_a;
        let most_percent = specification.overshoot_percent.max(self.least_overshoot_percent(settings));
        for _ in 0..PROFILES {
            match self.run(settings) {
                Ok((figures, _)) if figures.peak_a > most_a => settings.slow_down(0.95 * most_a / figures.peak_a)?,
                Ok((figures, _)) if figures.overshoot_percent > most_percent => {
                    if !settings.feed_less_forward(law, GENTLER)? {
                        settings.slow_down(GENTLER)?;
                    }
                }
                Ok(done) => return Ok(done),
                Err(_) => settings.slow_down(GENTLER)?,
            }
        }
        let (figures, points) = self.run(settings)?;
        let what = if figures.peak_a > specification.current_limit_a {
            format!("the current reaches {:.2} A", figures.peak_a)
        } else if figures.overshoot_percent > most_percent {
            format!("through the profile it overshoots by {:.1} %", figures.overshoot_percent)
        } else {
            return Ok((figures, points));
        };
        Err(DesignError::Trial { law: law.title(), what })
    }

    /// The core follows a step through its profile and settles; with a tachogenerator, whose sign is the drive's, also back
    /// through standstill.
    fn run(&self, settings: &SettingList) -> Result<(TrialFigures, Vec<Point>), DesignError> {
        let (step, ramp_s) = trial_step(self.motor, self.law, settings);
        let duration_s = ramp_s + (8.0 * self.settling_s).max(0.5);
        let mut trial = self.started(&settings.all)?;
        let (figures, points) = follow_step(&mut trial, self.law, step, duration_s)?;
        self.settled(settings, step, figures.last_deviation)?;
        if self.tachogenerator.is_some() {
            // Twice as far.
            let (back, _) = follow_step(&mut trial, self.law, -step, duration_s + ramp_s)?;
            self.settled(settings, step, back.last_deviation)?;
        }
        Ok((figures, points))
    }

    fn started(&self, settings: &Settings) -> Result<Trial<DcMotor>, DesignError> {
        let mut trial =
            Trial::new(DcMotor::new(ideal(self.motor)), *settings).map_err(|error| refused(error, settings))?;
        trial.delay_by(self.delay_s);
        start(&mut trial, self.law, self.tachogenerator.as_ref());
        Ok(trial)
    }

    fn settled(&self, settings: &SettingList, step: f64, last_deviation: f64) -> Result<(), DesignError> {
        if last_deviation > self.finest(settings).max(SETTLED_STEP_PART * step) {
            let what = format!("at the end it is off by {last_deviation:.3} of {step:.3}");
            return Err(DesignError::Trial { law: self.law.title(), what });
        }
        Ok(())
    }

    /// What the sensor's resolution leaves, in rad or rad/s.
    fn finest(&self, settings: &SettingList) -> f64 {
        let get = |param| f64::from(settings.all.get(param));
        if self.law.is_position() {
            return SETTLED_COUNTS * std::f64::consts::TAU / get(Param::CountsPerRev);
        }
        let bits = SETTLED_SPEED_BITS * speed_bit_rad_per_s(&settings.all);
        let steps = |tachogenerator: Tachogenerator| SETTLED_TACHO_STEPS * tachogenerator.resolution_rad_per_s();
        self.tachogenerator.map_or(bits, steps).max(bits)
    }

    /// Overshoot that no specification forbids.
    fn least_overshoot_percent(&self, settings: &SettingList) -> f64 {
        let (step, _) = trial_step(self.motor, self.law, settings);
        let resolution = if self.tachogenerator.is_some() { 100.0 * self.finest(settings) / step } else { 0.0 };
        LEAST_OVERSHOOT_PERCENT.max(resolution)
    }
}

/// A law's trial with the effects of the model: its figures and its course.
pub type TrialWithEffects = (ControlLaw, TrialFigures, Vec<Point>);

/// The design's own trial again, with the board's `settings`, which may compensate, and with a motor that has effects the
/// design does not know. Its figures are told and not judged: compensation, slower profiles and other motors are the
/// reader's choice.
///
/// # Errors
/// [`DesignError::WithEffects`] if a trip comes: nobody can use such a loop.
pub fn trial_with_effects(
    model: &Model,
    design: &Design,
    settings: &Settings,
) -> Result<TrialWithEffects, DesignError> {
    let duration_s = design.points.last().map_or(0.0, |point| point.t_s);
    let mut trial = Trial::of_model(model, *settings).map_err(|error| refused(error, settings))?;
    start(&mut trial, design.law, design.tachogenerator.as_ref());
    match follow_step(&mut trial, design.law, design.trial.step, duration_s) {
        Ok((figures, points)) => Ok((design.law, figures, points)),
        Err(DesignError::Trial { law, what }) => Err(DesignError::WithEffects { law, what }),
        Err(other) => Err(other),
    }
}

fn refused(error: BuildError, settings: &Settings) -> DesignError {
    fixed_point::refusal(error, settings.get(error.param).into())
}

/// Arms the core, in the mode of a law.
fn start(trial: &mut Trial<impl Plant>, law: ControlLaw, tachogenerator: Option<&Tachogenerator>) {
    if let Some(tachogenerator) = tachogenerator {
        tachogenerator.onto(trial);
    }
    trial.enter(law.mode());
}

/// The core follows a step through its profile.
fn follow_step(
    trial: &mut Trial<impl Plant>,
    law: ControlLaw,
    step: f64,
    duration_s: f64,
) -> Result<(TrialFigures, Vec<Point>), DesignError> {
    let points = trial.follow(step, duration_s);
    if trial.sample().trip != Trip::None {
        return Err(DesignError::Trial {
            law: law.title(),
            what: format!("the trip `{}` comes", motorbench_data::names::trip_words(trial.sample().trip)),
        });
    }
    let tail = &points[points.len() - points.len() / SETTLED_PART..];
    let output = |point: &Point| if law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
    let last_deviation = tail.iter().map(|point| (output(point) - step).abs()).fold(0.0, f64::max);
    let most = |of: fn(&Point) -> f64| points.iter().map(|point| of(point).abs()).fold(0.0, f64::max);
    let limited = points.iter().filter(|point| point.limited).count();
    let figures = TrialFigures {
        step,
        last_deviation,
        overshoot_percent: 100.0 * points.iter().map(|point| output(point) / step - 1.0).fold(0.0, f64::max),
        peak_v: most(|point| point.u_v),
        peak_a: most(|point| point.i_a),
        limited_part: limited as f64 / points.len() as f64,
        swing_v: tail.iter().map(|point| point.u_v).fold(f64::MIN, f64::max)
            - tail.iter().map(|point| point.u_v).fold(f64::MAX, f64::min),
    };
    Ok((figures, points))
}

/// The trial's step, and how long the profile takes for it.
fn trial_step(motor: &MotorParameters, law: ControlLaw, settings: &SettingList) -> (f64, f64) {
    let get = |param| f64::from(settings.all.get(param));
    let (acceleration, cruise) = (get(Param::Acceleration), get(Param::CruiseSpeed));
    if law.is_position() {
        let ramp_s = TRIAL_ANGLE_RAD / cruise + 2.0 * (TRIAL_ANGLE_RAD / acceleration).sqrt();
        return (TRIAL_ANGLE_RAD, ramp_s);
    }
    let no_load = get(Param::SupplyVoltage) * motor_model::speed(motor).dc_gain();
    // Viscous friction at this speed must leave current to accelerate.
    let friction = motor.viscous_friction_nm_s / motor.torque_constant_nm_per_a;
    let by_current = 0.5 * get(Param::TripContinuous) / friction.max(f64::MIN_POSITIVE);
    let step = (TRIAL_SPEED_PART * no_load).min(by_current);
    (step, step / acceleration)
}

/// The motor of the model behind a bridge without losses.
pub fn ideal(motor: &MotorParameters) -> DcMotorParameters {
    DcMotorParameters {
        resistance_ohm: motor.resistance_ohm,
        inductance_h: motor.inductance_h,
        torque_constant_nm_per_a: motor.torque_constant_nm_per_a,
        inertia_kg_m2: motor.inertia_kg_m2,
        viscous_friction_nms_per_rad: motor.viscous_friction_nm_s,
        coulomb_friction_nm: 0.0,
        bridge: BridgeLosses::IDEAL,
    }
}

#[cfg(test)]
mod tests;

//! Scenarios: the core in closed loop with a motor on this computer, as a file. The keys are in `docs/reference/scenarios.md`.
//!
//! ```toml
//! duration_s = 2.0
//! mode = "speed"              # open, speed, position, lqr_speed, lqr_position
//! model = "model.toml"        # or the tables [motor] and [effects.…] of a model file in here
//! [settings]                  # the firmware's settings by name; the others keep their defaults
//! speed_kp = 0.07
//! [[reference]]               # V (open), rad/s or rad, from this time on
//! time_s = 0.1
//! value = 100.0
//! [[load]]                    # torque against positive rotation, from this time on
//! time_s = 1.0
//! torque_Nm = 0.01
//! [[fault]]
//! time_s = 1.5
//! kind = "encoder_unplugged"
//! ```

mod file;
pub mod reference;
mod refusal;
pub mod sequence;

use crate::figures::{Figures, JUMP, disturbance_figures, step_figures, tracking_figures};
use crate::plant::ModelPlant;
use crate::trial::{Point, Surroundings, Trial};
use motorbench_core::message::{Mode, Request, Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::recording::Recording;
use motorbench_data::telemetry;
use motorbench_model::{Model, ModelError};
use reference::{Course, Reference};
pub use refusal::refusal;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Tolerance of a sum of times: without it, rounding would delay an event by a tick.
const ROUNDING_S: f64 = 1e-9;

/// A load torque from a time on.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// Start time.
    pub time_s: f64,
    /// Torque against positive rotation.
    #[serde(rename = "torque_Nm")]
    pub torque_nm: f64,
}

/// A fault and its duration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// Start time.
    pub time_s: f64,
    /// End time; infinite: until the end.
    pub until_s: f64,
    /// The kind of fault.
    pub kind: FaultKind,
}

/// Kinds of faults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// No edges of the encoder arrive.
    EncoderUnplugged,
    /// The current sensor's output stays at a voltage.
    CurrentPinned {
        /// From 0 to 5 V.
        voltage_v: f64,
    },
    /// Another supply voltage.
    Supply {
        /// Not negative.
        voltage_v: f64,
    },
    /// The rotor is held fast.
    RotorBlocked,
    /// Frames of the telemetry do not arrive: their samples are missing from the recording.
    FramesLost,
}

/// Noise of the sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    /// Standard deviation of one conversion of the current.
    #[serde(rename = "current_A")]
    pub current_a: f64,
    /// Amplitude of the tachogenerator's ripple relative to the mean, 0 to 1.
    pub tacho_ripple: f64,
    /// The same seed gives the same run.
    pub seed: u64,
}

/// A scenario that can be run.
#[derive(Debug)]
pub struct Scenario {
    /// Length.
    pub duration_s: f64,
    /// Control mode.
    pub mode: Mode,
    /// The motor.
    pub model: Model,
    /// The model file that it names, if no other model was given.
    pub model_file: Option<PathBuf>,
    /// The firmware's settings.
    pub settings: Settings,
    /// In the order of time.
    pub references: Vec<Reference>,
    /// In the order of time.
    pub loads: Vec<Load>,
    /// What breaks.
    pub faults: Vec<Fault>,
    /// Noise of the sensors.
    pub noise: Noise,
    /// The expected trip, [`Trip::None`] for none.
    pub expected_trip: Trip,
}

/// Why a scenario cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// A file cannot be read.
    #[error("{path}: {source}")]
    Read {
        /// Which.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not a scenario: the message has line and key.
    #[error("{path}: {message}")]
    Syntax {
        /// Which.
        path: String,
        /// Where and why.
        message: String,
    },
    /// The motor is not usable.
    #[error("{path}: {source}")]
    Model {
        /// Which file.
        path: String,
        /// Why.
        source: Box<ModelError>,
    },
    /// An invalid value.
    #[error("{path}: {what}")]
    Value {
        /// Which file.
        path: String,
        /// What and what was expected.
        what: String,
    },
}

/// Result of a scenario.
pub struct Outcome {
    /// The recording as the firmware would send it.
    pub recording: Recording,
    /// The ticks behind it.
    pub samples: Vec<Sample>,
    /// The true motion.
    pub points: Vec<Point>,
    /// Figures of each reference, and of each disturbance of a step.
    pub figures: Vec<Figures>,
    /// Why the drive switched itself off, if it did.
    pub trip: Trip,
    /// The time of the trip.
    pub trip_s: Option<f64>,
}

impl Scenario {
    /// Reads the text of a scenario. `path` is for messages. `model` replaces its own model, which it need not have.
    /// `beside` reads the model file that the scenario names.
    ///
    /// # Errors
    /// [`ScenarioError`], which says file, line or key, and what is expected.
    pub fn parse(
        path: &Path,
        text: &str,
        model: Option<Model>,
        beside: impl Fn(&Path) -> Result<String, ScenarioError>,
    ) -> Result<Self, ScenarioError> {
        file::parse(path, text, model, beside)
    }

    /// Runs it.
    ///
    /// # Errors
    /// [`ScenarioError::Value`] for a setting that the core's formats cannot hold.
    pub fn run(&self) -> Result<Outcome, ScenarioError> {
        let refused = |error| ScenarioError::Value { path: "settings".into(), what: refusal(&self.settings, error) };
        let mut trial = Trial::of_model(&self.model, self.settings).map_err(refused)?;
        trial.seed(self.noise.seed);
        trial.enter(self.mode);
        let (mut points, mut samples): (Vec<Point>, Vec<Sample>) = (Vec::new(), Vec::new());
        let mut asked = Asked::default();
        let mut trip_s = None;
        for tick in 0..((self.duration_s + ROUNDING_S) / trial.period_s()) as usize {
            let now_s = tick as f64 * trial.period_s();
            trial.surroundings = self.surroundings(now_s + ROUNDING_S);
            let request = asked.request(self, now_s + ROUNDING_S, &trial);
            points.push(trial.tick(request));
            if !self.active(now_s + ROUNDING_S).any(|kind| kind == FaultKind::FramesLost) {
                samples.push(*trial.sample());
            }
            if trip_s.is_none() && trial.sample().trip != Trip::None {
                trip_s = Some(now_s);
            }
        }
        Ok(Outcome {
            recording: telemetry::recording("scenario", &samples, &self.settings),
            samples,
            figures: self.figures(&points),
            points,
            trip: trial.sample().trip,
            trip_s,
        })
    }

    fn active(&self, now_s: f64) -> impl Iterator<Item = FaultKind> {
        let active = move |fault: &&Fault| fault.time_s <= now_s && now_s < fault.until_s;
        self.faults.iter().filter(active).map(|fault| fault.kind)
    }

    fn surroundings(&self, now_s: f64) -> Surroundings {
        let mut now = Surroundings::new(&self.settings);
        now.current_noise_v = self.noise.current_a * 1e-3 * f64::from(self.settings.get(Param::CurrentGain));
        now.tacho_ripple = self.noise.tacho_ripple;
        if let Some(load) = self.loads.iter().rfind(|load| load.time_s <= now_s) {
            now.load_torque_nm = load.torque_nm;
        }
        for kind in self.active(now_s) {
            match kind {
                FaultKind::EncoderUnplugged => now.encoder_unplugged = true,
                FaultKind::CurrentPinned { voltage_v } => now.current_pinned_v = Some(voltage_v),
                FaultKind::Supply { voltage_v } => now.supply_v = voltage_v,
                FaultKind::RotorBlocked => now.rotor_blocked = true,
                FaultKind::FramesLost => {}
            }
        }
        now
    }

    /// The true quantity that the mode controls; in open loop the speed.
    pub fn controlled(&self, point: &Point) -> f64 {
        if self.mode.is_position() { point.theta_rad } else { point.omega_rad_per_s }
    }

    /// Figures of the stretches between one reference and the next. A load or a fault after a step has figures of its
    /// own. In open loop a reference is a voltage, so there are no figures.
    pub fn figures(&self, points: &[Point]) -> Vec<Figures> {
        if self.mode == Mode::OpenLoop {
            return Vec::new();
        }
        let start = |time_s: f64| start(points, time_s);
        let ends = self.references.iter().skip(1).map(|next| next.time_s).chain([f64::INFINITY]);
        let stretches =
            self.references.iter().zip(ends).flat_map(|(reference, end_s)| self.stretches(reference, end_s));
        stretches
            .map(|Stretch { from_s, until_s, course, cause }| (start(from_s)..start(until_s), course, cause))
            .filter(|(range, ..)| range.len() > 1)
            .flat_map(|(range, course, cause)| {
                let (stretch, of) = (&points[range], |point: &Point| self.controlled(point));
                let figures = match (course, cause) {
                    (Course::Step { value }, None) => step_figures(stretch, of, *value),
                    (Course::Step { value }, Some(cause)) => disturbance_figures(stretch, of, *value, cause),
                    _ => tracking_figures(stretch, of, course.name()),
                };
                [Some(figures), self.jump_figures(stretch, course)].into_iter().flatten()
            })
            .collect()
    }

    /// Figures of the largest step of a sequence.
    fn jump_figures(&self, points: &[Point], course: &Course) -> Option<Figures> {
        let Course::Sequence(order) = course else { return None };
        let jump = order.largest_jump(self.mode, &self.settings)?;
        let stretch = &points[start(points, jump.from_s)..start(points, jump.until_s)];
        if stretch.len() < 2 {
            return None;
        }
        let of = |point: &Point| self.controlled(point);
        // A position counts from the start of the sequence.
        let origin = if self.mode.is_position() { of(&points[0]) } else { 0.0 };
        Some(Figures { course: JUMP, ..step_figures(stretch, of, origin + jump.value) })
    }

    /// A reference until the next, and separately the disturbances after a step.
    fn stretches<'a>(&self, reference: &'a Reference, end_s: f64) -> Vec<Stretch<'a>> {
        let (from_s, course) = (reference.time_s, &reference.course);
        let loads = self.loads.iter().map(|load| (load.time_s, "load"));
        let felt = self.faults.iter().filter(|fault| fault.kind != FaultKind::FramesLost);
        let faults = felt.map(|fault| (fault.time_s, "fault"));
        let after = |(time_s, _): &(f64, _)| from_s + ROUNDING_S < *time_s && *time_s < end_s;
        let is_step = matches!(course, Course::Step { .. });
        let mut causes: Vec<(f64, &'static str)> = loads.chain(faults).filter(after).filter(|_| is_step).collect();
        causes.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let starts = [(from_s, None)].into_iter().chain(causes.iter().map(|&(time_s, cause)| (time_s, Some(cause))));
        let ends = causes.iter().map(|(time_s, _)| *time_s).chain([end_s]);
        starts.zip(ends).map(|((from_s, cause), until_s)| Stretch { from_s, until_s, course, cause }).collect()
    }
}

/// A part of a scenario that has figures of its own.
struct Stretch<'a> {
    from_s: f64,
    until_s: f64,
    course: &'a Course,
    /// What disturbs the loop from its beginning on, if anything does.
    cause: Option<&'static str>,
}

/// The first point at least this long after the first one.
fn start(points: &[Point], time_s: f64) -> usize {
    let first_s = points.first().map_or(0.0, |point| point.t_s);
    points.partition_point(|point| point.t_s - first_s + ROUNDING_S < time_s)
}

/// State of the references.
#[derive(Default)]
struct Asked {
    /// Number of references that have begun.
    begun: usize,
    /// End value of the previous reference, and the last requested value.
    before: f64,
    last: f64,
}

impl Asked {
    /// The request to the core at this tick.
    fn request(&mut self, scenario: &Scenario, now_s: f64, trial: &Trial<ModelPlant>) -> Option<Request> {
        let begun = scenario.references.iter().take_while(|reference| reference.time_s <= now_s).count();
        let begins = begun > self.begun;
        if begins {
            (self.begun, self.before) = (begun, self.last);
        }
        let reference = &scenario.references[self.begun.checked_sub(1)?];
        if let Course::Sequence(order) = &reference.course {
            // Values that the core would refuse are refused when the scenario is read.
            let sequence = order.of_core(scenario.mode, &scenario.settings).ok()?;
            return begins.then_some(Request::Play(sequence));
        }
        let value = reference.course.value(now_s - reference.time_s, self.before)?;
        let changed = begins || value != self.last;
        self.last = value;
        changed.then(|| trial.reference(value))
    }
}

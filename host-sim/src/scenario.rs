//! Scenarios: the core in closed loop with a motor on this computer, as a file.
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
//! ```

use crate::design::trial::{Point, Trial};
use crate::figures::{Figures, step_figures};
use crate::model::{Model, ModelError};
use crate::plant::ModelPlant;
use crate::recording::Recording;
use crate::telemetry;
use motorbench_core::message::{Mode, Sample, Trip};
use motorbench_core::settings::{Param, Settings, Text, text};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// A scenario file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    duration_s: f64,
    mode: String,
    model: Option<String>,
    motor: Option<toml::Table>,
    effects: Option<toml::Table>,
    #[serde(default)]
    settings: BTreeMap<String, f64>,
    #[serde(default)]
    reference: Vec<Reference>,
    #[serde(default)]
    load: Vec<Load>,
}

/// What is asked for from a time on.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// From when.
    pub time_s: f64,
    /// In the unit of the mode.
    pub value: f64,
}

/// What works on the shaft from a time on.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// From when.
    pub time_s: f64,
    /// Against positive rotation.
    #[serde(rename = "torque_Nm")]
    pub torque_nm: f64,
}

/// A scenario that can be run.
#[derive(Debug)]
pub struct Scenario {
    /// Length.
    pub duration_s: f64,
    /// Who sets the voltage.
    pub mode: Mode,
    /// The motor.
    pub model: Model,
    /// The firmware's settings.
    pub settings: Settings,
    /// In the order of time.
    pub references: Vec<Reference>,
    /// In the order of time.
    pub loads: Vec<Load>,
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
    #[error("{path}: {source}")]
    Syntax {
        /// Which.
        path: String,
        /// Where and why.
        source: toml::de::Error,
    },
    /// The motor is not usable.
    #[error("{path}: {source}")]
    Model {
        /// Which file.
        path: String,
        /// Why.
        source: ModelError,
    },
    /// A value that means nothing.
    #[error("{path}: {what}")]
    Value {
        /// Which file.
        path: String,
        /// What and what was expected.
        what: String,
    },
}

/// What came of a scenario.
pub struct Outcome {
    /// As the firmware would have sent it.
    pub recording: Recording,
    /// As it was.
    pub points: Vec<Point>,
    /// Figures of each step of the reference.
    pub figures: Vec<Figures>,
    /// Why the drive switched itself off, if it did.
    pub trip: Trip,
}

impl Scenario {
    /// Reads a scenario; a model file is looked for beside it.
    ///
    /// # Errors
    /// [`ScenarioError`], which says file, line or key, and what was expected.
    pub fn read(path: &Path) -> Result<Self, ScenarioError> {
        let name = path.display().to_string();
        let text = read(path)?;
        let file: File =
            toml::from_str(&text).map_err(|source| ScenarioError::Syntax { path: name.clone(), source })?;
        let model = file.model_text(path)?;
        let model = Model::parse(&model).map_err(|source| ScenarioError::Model { path: name.clone(), source })?;
        let value = |what: String| ScenarioError::Value { path: name.clone(), what };
        let mode = mode(&file.mode).ok_or_else(|| {
            value(format!("mode = \"{}\": expected open, speed, position, lqr_speed or lqr_position", file.mode))
        })?;
        if !(file.duration_s > 0.0 && file.duration_s <= 3600.0) {
            return Err(value(format!("duration_s = {}: expected more than 0 and at most 3600", file.duration_s)));
        }
        let settings = settings(&file.settings).map_err(value)?;
        let (mut references, mut loads) = (file.reference, file.load);
        references.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        loads.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(Self { duration_s: file.duration_s, mode, model, settings, references, loads })
    }

    /// Runs it.
    ///
    /// # Errors
    /// [`ScenarioError::Value`] for a setting that the core's formats cannot hold.
    pub fn run(&self) -> Result<Outcome, ScenarioError> {
        let refused = |error| ScenarioError::Value {
            path: "settings".into(),
            what: format!("the core's fixed-point formats refuse: {error:?}"),
        };
        let mut trial = Trial::new(ModelPlant::new(self.model.clone()), self.settings).map_err(refused)?;
        trial.enter(self.mode);
        let (mut points, mut samples): (Vec<Point>, Vec<Sample>) = (Vec::new(), Vec::new());
        let (mut references, mut loads) = (self.references.iter().peekable(), self.loads.iter().peekable());
        let ticks = (self.duration_s / trial.period_s()) as usize;
        for tick in 0..ticks {
            let now_s = tick as f64 * trial.period_s();
            while let Some(load) = loads.next_if(|load| load.time_s <= now_s) {
                trial.load_torque_nm = load.torque_nm;
            }
            let request = references.next_if(|next| next.time_s <= now_s).map(|next| trial.reference(next.value));
            points.push(trial.tick(request));
            samples.push(*trial.sample());
        }
        Ok(Outcome {
            recording: telemetry::recording("scenario", &samples, &self.settings),
            figures: self.figures(&points),
            points,
            trip: trial.sample().trip,
        })
    }

    /// Figures of the stretches between one reference and the next.
    fn figures(&self, points: &[Point]) -> Vec<Figures> {
        let starts: Vec<usize> = self
            .references
            .iter()
            .filter_map(|reference| points.iter().position(|point| point.t_s - points[0].t_s >= reference.time_s))
            .collect();
        let ends = starts.iter().skip(1).copied().chain([points.len()]);
        let of = |point: &Point| if self.mode.is_position() { point.theta_rad } else { point.omega_rad_per_s };
        let stretches = starts.iter().zip(ends).zip(&self.references).filter(|((start, end), _)| end - *start > 1);
        stretches.map(|((start, end), reference)| step_figures(&points[*start..end], of, reference.value)).collect()
    }
}

impl File {
    fn model_text(&self, path: &Path) -> Result<String, ScenarioError> {
        if let Some(model) = &self.model {
            return read(&path.with_file_name(model));
        }
        let mut table = toml::Table::new();
        for (key, value) in [("motor", &self.motor), ("effects", &self.effects)] {
            if let Some(value) = value {
                table.insert(key.into(), toml::Value::Table(value.clone()));
            }
        }
        Ok(table.to_string())
    }
}

fn read(path: &Path) -> Result<String, ScenarioError> {
    std::fs::read_to_string(path).map_err(|source| ScenarioError::Read { path: path.display().to_string(), source })
}

fn mode(name: &str) -> Option<Mode> {
    Some(match name {
        "open" => Mode::OpenLoop,
        "speed" => Mode::SpeedPid,
        "position" => Mode::PositionPid,
        "lqr_speed" => Mode::SpeedLqr,
        "lqr_position" => Mode::PositionLqr,
        _ => return None,
    })
}

fn settings(given: &BTreeMap<String, f64>) -> Result<Settings, String> {
    let mut settings = Settings::defaults();
    for (name, value) in given {
        let param = Param::ALL.iter().find(|param| text(**param, Text::Name).eq(name.bytes()));
        let param =
            *param.ok_or_else(|| format!("[settings] {name}: no such setting; see `cargo run --bin firmware`"))?;
        let (min, max) = param.range();
        settings
            .set(param, *value as f32)
            .map_err(|_| format!("[settings] {name} = {value}: expected {min} to {max}"))?;
    }
    Ok(settings)
}

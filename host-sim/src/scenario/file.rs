//! The scenario file: read, and everything in it checked. Messages say file, table and key.

use super::reference::{Course, Reference};
use super::refusal::refusal;
use super::sequence::{self, SequenceOrder};
use super::{Fault, FaultKind, Load, Noise, Scenario, ScenarioError};
use motorbench_core::control_loop::LoopConfig;
use motorbench_core::excitation::Kind;
use motorbench_core::message::{Mode, Trip};
use motorbench_core::settings::{Param, Settings, Text, text};
use motorbench_data::names::setting_name;
use motorbench_model::Model;
use motorbench_text::keys;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Longest scenario.
const LONGEST_S: f64 = 3600.0;
/// Largest voltage a reference can be, as the core's format has it.
const LARGEST_V: f64 = 31.99;
/// Largest angle: far within the core's count.
const LARGEST_RAD: f64 = 1e5;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    duration_s: f64,
    mode: Option<String>,
    model: Option<String>,
    motor: Option<toml::Table>,
    effects: Option<toml::Table>,
    expected_trip: Option<String>,
    #[serde(default)]
    settings: BTreeMap<String, f64>,
    #[serde(default)]
    noise: Noise,
    #[serde(default)]
    reference: Vec<FileReference>,
    #[serde(default)]
    load: Vec<Load>,
    #[serde(default)]
    fault: Vec<FileFault>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileReference {
    time_s: f64,
    kind: Option<String>,
    value: Option<f64>,
    duration_s: Option<f64>,
    amplitude: Option<f64>,
    offset: Option<f64>,
    #[serde(rename = "frequency_Hz")]
    frequency_hz: Option<f64>,
    points: Option<Vec<[f64; 2]>>,
    sequence: Option<String>,
    period_ms: Option<u16>,
    count: Option<u16>,
    seed: Option<u16>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileFault {
    time_s: f64,
    until_s: Option<f64>,
    kind: String,
    #[serde(rename = "voltage_V")]
    voltage_v: Option<f64>,
}

/// See [`Scenario::parse`].
pub fn parse(
    path: &Path,
    text: &str,
    model: Option<Model>,
    beside: impl Fn(&Path) -> Result<String, ScenarioError>,
) -> Result<Scenario, ScenarioError> {
    let name = path.display().to_string();
    let file: File = toml::from_str(text).map_err(|error| {
        let message = if is_another_file(text) { ANOTHER_FILE.into() } else { keys::explained(&error) };
        ScenarioError::Syntax { path: name.clone(), message }
    })?;
    let own = || {
        Model::parse(&file.model_text(path, text, &beside)?)
            .map_err(|source| ScenarioError::Model { path: name.clone(), source: Box::new(source) })
    };
    let named = || file.model.as_ref().map(|model| path.with_file_name(model));
    let (model, model_file) = match model {
        Some(model) => (model, None),
        None => (own()?, named()),
    };
    file.scenario((model, model_file), text).map_err(|what| ScenarioError::Value { path: name, what })
}

/// Whether a text in TOML has nothing that could be the length of a scenario: a model or rig file.
fn is_another_file(text: &str) -> bool {
    let table: Option<toml::Table> = text.parse().ok();
    table.is_some_and(|table| table.keys().all(|key| keys::nearest(key, ["duration_s"]).is_none()))
}

/// What is wrong with it.
const ANOTHER_FILE: &str = "this is no scenario: duration_s is missing (docs/reference/scenarios.md lists the keys). If it is a model file, give it with --model";

impl File {
    /// The file of the model, or this one's own `text`.
    fn model_text(
        &self,
        path: &Path,
        text: &str,
        beside: impl Fn(&Path) -> Result<String, ScenarioError>,
    ) -> Result<String, ScenarioError> {
        if let Some(model) = &self.model {
            if self.motor.is_some() || self.effects.is_some() {
                let what = "model and [motor] or [effects]: give the one or the others".into();
                return Err(ScenarioError::Value { path: path.display().to_string(), what });
            }
            return beside(Path::new(model));
        }
        if self.motor.is_none() {
            let what =
                "it has no motor: give it [motor], model = \"FILE.toml\", or say --model MODEL.toml beside the scenario".into();
            return Err(ScenarioError::Value { path: path.display().to_string(), what });
        }
        Ok(text.into())
    }

    fn scenario(self, (model, model_file): (Model, Option<PathBuf>), text: &str) -> Result<Scenario, String> {
        let mode = mode(self.mode.as_deref())?;
        if !(self.duration_s > 0.0 && self.duration_s <= LONGEST_S) {
            return Err(format!("duration_s = {}: expected more than 0 and at most {LONGEST_S}", self.duration_s));
        }
        let settings = settings(&self.settings, text)?;
        check_noise(&self.noise)?;
        let within =
            Within { duration_s: self.duration_s, largest: largest(mode, &settings), mode, settings: &settings };
        let mut references = Vec::new();
        for (index, reference) in self.reference.iter().enumerate() {
            references.push(reference.checked(&within).map_err(|what| format!("[[reference]] {}{what}", index + 1))?);
        }
        for (index, load) in self.load.iter().enumerate() {
            let at = |what: String| format!("[[load]] {}: {what}", index + 1);
            within.time(load.time_s).map_err(at)?;
            finite("torque_Nm", load.torque_nm).map_err(at)?;
        }
        let mut faults = Vec::new();
        for (index, fault) in self.fault.iter().enumerate() {
            faults.push(fault.checked(&within).map_err(|what| format!("[[fault]] {}: {what}", index + 1))?);
        }
        let mut loads = self.load;
        references.sort_by(|a: &Reference, b| a.time_s.total_cmp(&b.time_s));
        if let Some(pair) = references.windows(2).find(|pair| pair[0].time_s == pair[1].time_s) {
            let time_s = pair[0].time_s;
            return Err(format!(
                "two [[reference]] at time_s = {time_s}: one would take the other's place; leave one out"
            ));
        }
        loads.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let expected_trip = self.expected_trip.as_deref().map_or(Ok(Trip::None), trip)?;
        Ok(Scenario {
            duration_s: self.duration_s,
            mode,
            model,
            model_file,
            settings,
            references,
            loads,
            faults,
            noise: self.noise,
            expected_trip,
        })
    }
}

/// What times and values are checked against.
struct Within<'a> {
    duration_s: f64,
    /// Largest reference.
    largest: f64,
    mode: Mode,
    settings: &'a Settings,
}

impl Within<'_> {
    fn time(&self, time_s: f64) -> Result<f64, String> {
        let inside = (0.0..=self.duration_s).contains(&time_s);
        inside
            .then_some(time_s)
            .ok_or_else(|| format!("time_s = {time_s}: expected 0 to duration_s = {}", self.duration_s))
    }

    fn value(&self, name: &str, value: f64) -> Result<f64, String> {
        let inside = value.abs() <= self.largest;
        let unit = if self.mode.is_position() {
            "rad"
        } else if self.mode.is_speed() {
            "rad/s, the setting speed_range"
        } else {
            "V"
        };
        inside.then_some(value).ok_or_else(|| format!("{name} = {value}: expected at most {} {unit}", self.largest))
    }
}

fn finite(name: &str, value: f64) -> Result<f64, String> {
    value.is_finite().then_some(value).ok_or_else(|| format!("{name} = {value}: expected a number"))
}

fn positive(name: &str, value: f64) -> Result<f64, String> {
    let good = value > 0.0 && value.is_finite();
    good.then_some(value).ok_or_else(|| format!("{name} = {value}: expected a positive number"))
}

impl FileReference {
    fn checked(&self, within: &Within) -> Result<Reference, String> {
        let kind = self.kind.as_deref().unwrap_or("step");
        let course = self.course(kind, within).map_err(|what| format!(" ({kind}): {what}"))?;
        let time_s = within.time(self.time_s).map_err(|what| format!(": {what}"))?;
        Ok(Reference { time_s, course })
    }

    fn course(&self, kind: &str, within: &Within) -> Result<Course, String> {
        let used: &[&str] = match kind {
            "step" => &["value"],
            "ramp" => &["value", "duration_s"],
            "sine" => &["amplitude", "offset", "frequency_Hz"],
            "points" => &["points"],
            "sequence" => &["sequence", "amplitude", "offset", "period_ms", "count", "seed"],
            _ => return Err("expected step, ramp, sine, points or sequence".into()),
        };
        if let Some(key) = self.given().find(|key| !used.contains(key)) {
            return Err(format!("{key} means nothing here; there are {}", used.join(", ")));
        }
        let need = |name: &str, value: Option<f64>| value.ok_or_else(|| format!("{name} is missing"));
        let level = |name: &str, value: Option<f64>| need(name, value).and_then(|value| within.value(name, value));
        let offset = within.value("offset", self.offset.unwrap_or(0.0))?;
        Ok(match kind {
            "step" => Course::Step { value: level("value", self.value)? },
            "ramp" => Course::Ramp {
                value: level("value", self.value)?,
                duration_s: positive("duration_s", need("duration_s", self.duration_s)?)?,
            },
            "sine" => {
                let amplitude = level("amplitude", self.amplitude)?;
                within.value("offset + amplitude", offset.abs() + amplitude.abs())?;
                let frequency_hz = positive("frequency_Hz", need("frequency_Hz", self.frequency_hz)?)?;
                Course::Sine { amplitude, offset, frequency_hz }
            }
            "points" => Course::Points(self.checked_points(within)?),
            _ => {
                let order = SequenceOrder {
                    kind: kind_of_sequence(self.sequence.as_deref())?,
                    amplitude: level("amplitude", self.amplitude)?,
                    offset,
                    period_ms: self.period_ms.unwrap_or(500),
                    count: self.count.unwrap_or(1),
                    seed: self.seed.unwrap_or(1),
                };
                order.of_core(within.mode, within.settings)?;
                Course::Sequence(order)
            }
        })
    }

    fn checked_points(&self, within: &Within) -> Result<Vec<[f64; 2]>, String> {
        let points = self.points.clone().ok_or("points is missing")?;
        if points.is_empty() {
            return Err("points is empty: expected [[time_s, value], …]".into());
        }
        if let Some(pair) =
            points.windows(2).find(|pair| pair[1][0].partial_cmp(&pair[0][0]) != Some(std::cmp::Ordering::Greater))
        {
            return Err(format!("points: the time goes from {} to {}; it has to increase", pair[0][0], pair[1][0]));
        }
        points.iter().try_for_each(|point| within.value("points", point[1]).map(|_| ()))?;
        Ok(points)
    }

    fn given(&self) -> impl Iterator<Item = &'static str> {
        [
            ("value", self.value.is_some()),
            ("duration_s", self.duration_s.is_some()),
            ("amplitude", self.amplitude.is_some()),
            ("offset", self.offset.is_some()),
            ("frequency_Hz", self.frequency_hz.is_some()),
            ("points", self.points.is_some()),
            ("sequence", self.sequence.is_some()),
            ("period_ms", self.period_ms.is_some()),
            ("count", self.count.is_some()),
            ("seed", self.seed.is_some()),
        ]
        .into_iter()
        .filter_map(|(name, given)| given.then_some(name))
    }
}

impl FileFault {
    fn checked(&self, within: &Within) -> Result<Fault, String> {
        let time_s = within.time(self.time_s)?;
        let until_s = self.until_s.unwrap_or(f64::INFINITY);
        if until_s <= time_s || until_s.is_nan() {
            return Err(format!("until_s = {until_s}: expected more than time_s = {time_s}"));
        }
        let voltage = |most: f64| match self.voltage_v {
            None => Err(format!("voltage_V is missing: {} needs it", self.kind)),
            Some(voltage_v) if (0.0..=most).contains(&voltage_v) => Ok(voltage_v),
            Some(voltage_v) => Err(format!("voltage_V = {voltage_v}: expected 0 to {most}")),
        };
        let kind = match self.kind.as_str() {
            "encoder_unplugged" => FaultKind::EncoderUnplugged,
            "rotor_blocked" => FaultKind::RotorBlocked,
            "frames_lost" => FaultKind::FramesLost,
            "current_pinned" => FaultKind::CurrentPinned { voltage_v: voltage(5.0)? },
            "supply" => FaultKind::Supply { voltage_v: voltage(60.0)? },
            other => {
                let known = "encoder_unplugged, current_pinned, supply, rotor_blocked or frames_lost";
                return Err(format!("kind = \"{other}\": expected {known}"));
            }
        };
        let needs_voltage = matches!(kind, FaultKind::CurrentPinned { .. } | FaultKind::Supply { .. });
        if self.voltage_v.is_some() && !needs_voltage {
            return Err(format!("voltage_V means nothing for {}", self.kind));
        }
        Ok(Fault { time_s, until_s, kind })
    }
}

fn check_noise(noise: &Noise) -> Result<(), String> {
    if !(0.0..=10.0).contains(&noise.current_a) {
        return Err(format!("[noise] current_A = {}: expected a standard deviation of 0 to 10", noise.current_a));
    }
    if !(0.0..=1.0).contains(&noise.tacho_ripple) {
        return Err(format!("[noise] tacho_ripple = {}: expected a share of 0 to 1", noise.tacho_ripple));
    }
    Ok(())
}

/// Largest reference of a mode.
fn largest(mode: Mode, settings: &Settings) -> f64 {
    if mode.is_position() {
        LARGEST_RAD
    } else if mode.is_speed() {
        settings.get(Param::SpeedRange).into()
    } else {
        LARGEST_V
    }
}

fn mode(name: Option<&str>) -> Result<Mode, String> {
    let expected = "expected open, speed, position, lqr_speed or lqr_position";
    Ok(match name.ok_or_else(|| format!("mode is missing: {expected}"))? {
        "open" => Mode::OpenLoop,
        "speed" => Mode::SpeedPid,
        "position" => Mode::PositionPid,
        "lqr_speed" => Mode::SpeedLqr,
        "lqr_position" => Mode::PositionLqr,
        other => return Err(format!("mode = \"{other}\": {expected}")),
    })
}

fn kind_of_sequence(name: Option<&str>) -> Result<Kind, String> {
    let kinds = (0..Kind::COUNT).filter_map(Kind::from_number);
    let known = kinds.clone().map(sequence::name).collect::<Vec<_>>().join(", ");
    let name = name.ok_or_else(|| format!("sequence is missing: expected one of {known}"))?;
    kinds
        .into_iter()
        .find(|kind| sequence::name(*kind) == name)
        .ok_or(format!("sequence = \"{name}\": expected one of {known}"))
}

fn trip(name: &str) -> Result<Trip, String> {
    let trips = (1..=u8::MAX).map_while(Trip::from_number);
    let known = trips.clone().map(|trip| format!("{trip:?}")).collect::<Vec<_>>().join(", ");
    trips
        .into_iter()
        .find(|trip| format!("{trip:?}") == name)
        .ok_or_else(|| format!("expected_trip = \"{name}\": expected one of {known}"))
}

fn unknown_setting(typed: &str, text_of_file: &str) -> String {
    let known: Vec<String> = Param::ALL.iter().map(|param| setting_name(*param)).collect();
    let meant = keys::suggestion(keys::nearest(typed, known.iter().map(String::as_str)));
    let line = keys::line(text_of_file, &["settings", typed]).unwrap_or(1);
    format!("line {line}: [settings] {typed}: no such setting{meant}; see `cargo run --bin firmware`")
}

fn settings(given: &BTreeMap<String, f64>, text_of_file: &str) -> Result<Settings, String> {
    let mut settings = Settings::defaults();
    for (typed, value) in given {
        let param = Param::ALL.iter().find(|param| text(**param, Text::Name).eq(typed.bytes()));
        let param = *param.ok_or_else(|| unknown_setting(typed, text_of_file))?;
        let (min, max) = param.range();
        settings
            .set(param, *value as f32)
            .map_err(|_| format!("[settings] {typed} = {value}: expected {min} to {max}"))?;
    }
    match LoopConfig::build(&settings) {
        Ok(_) => Ok(settings),
        Err(error) => {
            let at = keys::line(text_of_file, &["settings", &setting_name(error.param)]);
            let line = at.map_or_else(String::new, |line| format!("line {line}: "));
            Err(format!("{line}[settings] {}", refusal(&settings, error)))
        }
    }
}

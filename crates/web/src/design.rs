//! Gains for a motor, and what a motor would do with the settings of a board.

use crate::{Message, json, said};
use host_sim::figures::step_figures;
use host_sim::trial::{Point, Trial};
use motorbench_core::message::{Mode, Trip};
use motorbench_core::settings::{Settings, find};
use motorbench_data::names::trip_words;
use motorbench_data::rig::Rig;
use motorbench_design::law::ControlLaw;
use motorbench_design::specification::{Specification, Speed};
use motorbench_design::{Bench, design, fastest_possible, trial_with_effects};
use motorbench_model::Model;
use motorbench_report::design as report;
use serde::{Deserialize, Serialize};
use wasm_bindgen::prelude::*;

/// What is asked of a loop.
#[derive(Deserialize)]
struct Asked {
    law: String,
    #[serde(rename = "bandwidth_Hz")]
    bandwidth_hz: f64,
    overshoot_percent: f64,
    #[serde(rename = "current_limit_A")]
    current_limit_a: f64,
}

fn law(name: &str) -> Result<ControlLaw, Message> {
    Ok(match name {
        "speed" => ControlLaw::SpeedPid,
        "lqr_speed" => ControlLaw::SpeedLqr,
        "position" => ControlLaw::PositionPid,
        "lqr_position" => ControlLaw::PositionLqr,
        _ => return Err(format!("{name}: expected speed, position, lqr_speed or lqr_position")),
    })
}

/// A design.
#[derive(Serialize)]
struct Designed {
    commands: Vec<String>,
    text: String,
}

/// Designs one law as the program does. `rig`: text of a rig file; `model`: text of a model file, or empty.
#[wasm_bindgen]
pub fn design_law(rig: &str, model: &str, asked: &str) -> Result<String, Message> {
    let asked: Asked = serde_json::from_str(asked).map_err(said)?;
    let rig = Rig::parse("rig file", rig).map_err(said)?;
    let model = if model.is_empty() { None } else { Some(Model::parse(model).map_err(said)?) };
    let motor = match &model {
        Some(model) => model.motor,
        None => rig.motor.parameters().map_err(said)?,
    };
    let bench = Bench::of_rig(&rig, model.as_ref()).map_err(|why| format!("rig file: {why}"))?;
    let law = law(&asked.law)?;
    let specification = Specification {
        speed: Speed::BandwidthHz(asked.bandwidth_hz),
        overshoot_percent: asked.overshoot_percent,
        current_limit_a: asked.current_limit_a,
    };
    let found = design(&motor, &bench, law, &specification).map_err(|why| {
        match fastest_possible(&motor, &bench, law, &specification).map(|possible| possible.speed) {
            Some(Speed::BandwidthHz(hz)) => format!("{why}. It can meet {hz} Hz"),
            _ => why.to_string(),
        }
    })?;
    let extended = model.filter(|model| !model.terms.is_empty());
    let trial =
        extended.map(|model| trial_with_effects(&model, &found, &found.settings.all)).transpose().map_err(said)?;
    let trials: Vec<_> = trial.into_iter().collect();
    json(&Designed {
        commands: found.settings.commands(),
        text: report::summary(&found) + &report::beyond_linear(&trials, &[]),
    })
}

/// The answer to a step of the reference.
#[derive(Serialize)]
struct Predicted {
    t_s: Vec<f64>,
    value: Vec<f64>,
    voltage: Vec<f64>,
    current: Vec<f64>,
    rise_s: Option<f64>,
    settling_s: Option<f64>,
    overshoot_percent: Option<f64>,
}

/// What a model does after a step of the reference from rest, on a board with these settings: pairs of name and value.
#[wasm_bindgen]
pub fn predict_step(model: &str, settings: &str, mode: &str, step: f64, duration_s: f64) -> Result<String, Message> {
    let model = Model::parse(model).map_err(said)?;
    let pairs: Vec<(String, f32)> = serde_json::from_str(settings).map_err(said)?;
    let mut board = Settings::defaults();
    for (name, value) in pairs {
        let param = find(name.as_bytes()).ok_or_else(|| format!("{name}: no such setting"))?;
        board.set(param, value).map_err(|rule| format!("{name} {value}: {rule:?}"))?;
    }
    let mode = if mode == "open" { Mode::OpenLoop } else { law(mode)?.mode() };
    let mut trial = Trial::of_model(&model, board).map_err(|error| format!("{error:?}"))?;
    trial.enter(mode);
    let points = trial.follow(step, duration_s);
    if trial.sample().trip != Trip::None {
        return Err(format!("the model would trip: {}", trip_words(trial.sample().trip)));
    }
    let value = |point: &Point| if mode.is_position() { point.theta_rad } else { point.measured_rad_per_s };
    let to = if mode == Mode::OpenLoop { points.last().map_or(0.0, value) } else { step };
    let figures = step_figures(&points, value, to);
    let start_s = points.first().map_or(0.0, |point| point.t_s);
    json(&Predicted {
        t_s: points.iter().map(|point| point.t_s - start_s).collect(),
        value: points.iter().map(value).collect(),
        voltage: points.iter().map(|point| point.u_v).collect(),
        current: points.iter().map(|point| point.i_a).collect(),
        rise_s: figures.rise_s,
        settling_s: figures.settling_s,
        overshoot_percent: figures.overshoot_percent,
    })
}

/// Figures of a step that a board was recorded at, as those of a prediction: arrays of one length.
#[wasm_bindgen]
pub fn measured_step(t_s: &[f64], value: &[f64], voltage: &[f64], current: &[f64], to: f64) -> Result<String, Message> {
    if t_s.len() < 2 || [value, voltage, current].iter().any(|other| other.len() != t_s.len()) {
        return Err("too few samples for a step: wait longer".into());
    }
    let point = |row: usize| Point {
        t_s: t_s[row],
        reference: to,
        u_v: voltage[row],
        measured_rad_per_s: value[row],
        omega_rad_per_s: value[row],
        theta_rad: value[row],
        i_a: current[row],
        limited: false,
    };
    let points: Vec<Point> = (0..t_s.len()).map(point).collect();
    json(&step_figures(&points, |point| point.measured_rad_per_s, to))
}

//! A board without hardware, for a worker that steps it in real time.

use crate::{Message, json, said};
use host_sim::hidden_bench::{ClassCode, HIDDEN, SUPPLY_V};
use host_sim::virtual_board;
use motorbench_data::rig::{CurrentSensor, Encoder, Rig, Supply};
use motorbench_model::Model;
use motorbench_model::motor::MotorParameters;
use serde::Serialize;
use wasm_bindgen::prelude::*;

/// A board with a simulated motor.
#[wasm_bindgen]
pub struct VirtualBoard {
    board: virtual_board::VirtualBoard,
    /// Ticks that have not made a whole one yet.
    rest: f64,
}

#[wasm_bindgen]
impl VirtualBoard {
    /// With the motor of a model file.
    #[wasm_bindgen(constructor)]
    pub fn new(model: &str) -> Result<Self, Message> {
        Self::with(Model::parse(model).map_err(said)?)
    }

    /// With the bench that a class code hides.
    pub fn of_code(code: &str) -> Result<Self, Message> {
        Self::with(code.parse::<ClassCode>().map_err(said)?.bench().0)
    }

    fn with(model: Model) -> Result<Self, Message> {
        let board = virtual_board::VirtualBoard::new(model).map_err(|error| format!("{error:?}"))?;
        Ok(Self { board, rest: 0.0 })
    }

    /// Takes bytes from the host.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.board.receive(bytes);
    }

    /// Lets time pass; returns the bytes for the host.
    pub fn advance(&mut self, duration_s: f64) -> Vec<u8> {
        let ticks = duration_s * self.board.tick_rate_hz() + self.rest;
        self.rest = ticks.fract();
        self.board.advance(ticks as u32)
    }

    /// As a real board when its port is opened.
    pub fn reset(&mut self) -> Result<(), Message> {
        self.board.reset().map_err(|error| format!("{error:?}"))
    }

    /// Another motor at the same speed.
    pub fn set_model(&mut self, model: &str) -> Result<(), Message> {
        self.board.set_model(Model::parse(model).map_err(said)?);
        Ok(())
    }

    /// Sets load, brake, supply, or a fault.
    pub fn set(&mut self, what: &str, value: f64) -> Result<(), Message> {
        let surroundings = self.board.surroundings();
        match what {
            "load_Nm" => surroundings.load_torque_nm = value,
            "brake_Nm" => self.board.brake(value),
            "supply_V" => surroundings.supply_v = value,
            "blocked" => surroundings.rotor_blocked = value > 0.0,
            "encoder_unplugged" => surroundings.encoder_unplugged = value > 0.0,
            "current_sensor_open" => surroundings.current_pinned_v = (value > 0.0).then_some(0.0),
            "stop" => surroundings.stop_closed = value > 0.0,
            _ => return Err(format!("{what}: a virtual board has nothing of this name")),
        }
        Ok(())
    }

    /// True speed of the shaft, in rad/s.
    #[must_use]
    pub fn speed_rad_per_s(&self) -> f64 {
        self.board.speed_rad_per_s()
    }
}

/// The motor of the virtual board without a class code: a model file.
#[wasm_bindgen]
#[must_use]
pub fn usual_model() -> String {
    let friction = motorbench_model::catalogue::effect("coulomb_friction").expect("an effect of the catalogue");
    let motor = MotorParameters { inertia_kg_m2: 2.0 * MotorParameters::PIVT6.inertia_kg_m2, ..MotorParameters::PIVT6 };
    Model::linear(motor).with(friction, vec![0.006]).to_toml()
}

/// The class code of a number.
#[wasm_bindgen]
#[must_use]
pub fn class_code(number: u32) -> String {
    ClassCode::of(number).to_string()
}

/// The effects that a class code may hide.
#[wasm_bindgen]
#[must_use]
pub fn hidden_effects() -> Vec<String> {
    HIDDEN.map(str::to_owned).into()
}

/// What a student knows of the bench that a class code hides: a rig file with values as of a data sheet.
#[wasm_bindgen]
pub fn class_rig(code: &str) -> Result<String, Message> {
    let (_, nominal) = code.parse::<ClassCode>().map_err(said)?.bench();
    let rig = Rig {
        supply: Supply { voltage_v: Some(SUPPLY_V) },
        encoder: Encoder { counts_per_rev: Some(2000.0) },
        current_sensor: CurrentSensor::default(),
        motor: nominal.into(),
        ..Rig::default()
    };
    toml::to_string(&rig).map_err(said)
}

/// What a class code hides.
#[derive(Serialize)]
struct Answer {
    is_right: bool,
    /// The effect, and its constants.
    hidden: String,
    constants: Vec<(&'static str, &'static str, f64)>,
}

/// Compares an answer with what a class code hides.
#[wasm_bindgen]
pub fn check_answer(code: &str, effect: &str) -> Result<String, Message> {
    let (truth, _) = code.parse::<ClassCode>().map_err(said)?.bench();
    let hidden = truth.terms.last().map_or("", |term| term.id());
    let of = |term: &motorbench_model::Term| {
        let id = term.id();
        term.without_defaults().map(|(_, parameter, value)| (id, parameter.name, value)).collect::<Vec<_>>()
    };
    let constants = truth.terms.iter().flat_map(of).collect();
    json(&Answer { is_right: effect == hidden, hidden: hidden.into(), constants })
}

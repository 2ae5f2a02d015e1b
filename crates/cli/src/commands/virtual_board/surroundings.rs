//! What a person changes around the virtual board while it runs: motor, effects, load, supply, faults.

use super::Failure;
use crate::commands::read_model;
use host_sim::plant::{BridgeLosses, ModelPlant};
use motorbench_chip::{Bench, EncoderFault, ResetCause, SensorFault};
use motorbench_core::HARDWARE;
use motorbench_data::rig::Rig;
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_model::motor::MotorParameters;
use motorbench_text::terminal_text::short;
use std::ops::RangeInclusive;
use std::path::Path;
use toml::{Table, Value};

/// By how much a hand that turns the rotor pushes harder in each slice, and how fast it turns it at most.
const PUSH_NM: f64 = 1e-3;
const HAND_RAD_PER_S: f64 = 30.0;
/// What a supply for such motors gives.
const SUPPLY_V: RangeInclusive<f64> = 0.0..=40.0;
/// What it gives when nothing is said.
pub(super) const USUAL_SUPPLY_V: f64 = 12.0;
/// How far a hand turns the rotor, and how long a script waits.
const TURN_DEGREES: RangeInclusive<f64> = 0.0..=36_000.0;
const WAIT_S: RangeInclusive<f64> = 0.0..=1e6;
/// A dip of the supply: to this voltage, for so long.
const DIP_V: f64 = 3.0;
const DIP_S: f64 = 0.05;
/// Dry friction of the motor when none is given.
const COULOMB_NM: f64 = 0.012;
/// The lines' first words.
pub(super) const ORDERS: &str =
    "motor, effect, model, load, brake, supply, block, turn, encoder, current, adc,\nuart, stop, reset, wait, quit";
const EXPECTED: &str = "expected motor NAME=VALUE, effect NAME CONSTANT=VALUE|off, model FILE.toml, load NM, brake NM, supply V, block on|off, turn DEGREES, encoder ok|unplugged|swapped|a-open|b-open|a-high|b-high|a-low|b-low|shorted|noisy|slipping, current ok|open|high|low|frozen, adc ok|dead, uart ok|stuck, supply dip, stop on|off, reset, wait S or quit";

/// The file of a line that names one, which may have spaces in its name.
pub(super) fn model_file(order: &str) -> Option<&str> {
    order.trim().strip_prefix("model").filter(|rest| rest.starts_with(char::is_whitespace)).map(str::trim)
}

/// How long a line is at work.
#[derive(Clone, Copy)]
pub(super) enum Until {
    Now,
    /// The rotor is where it shall be.
    Turned,
    /// Of the chip's time.
    Cycle(u64),
}

/// The motor, and what hands do at its shaft.
pub(super) struct Surroundings {
    model: Model,
    bridge: BridgeLosses,
    load_nm: f64,
    /// Dry friction of a brake at the shaft, beside the motor's own.
    brake_nm: f64,
    /// Angle to which the rotor is turned, to be held there, and with which torque by now.
    turning: Option<(f64, f64)>,
    supply_v: f64,
    /// Cycle at which the supply comes back.
    dips_until: Option<u64>,
}

impl Surroundings {
    /// The motor of a model file, else that of the rig file, else the test stand's behind an L293D.
    pub(super) fn new(model: Option<&Path>, rig: Option<(&Path, &Rig)>) -> Result<Self, Failure> {
        let (model, bridge) = match (model, rig) {
            (Some(path), _) => (read_model(path)?, BridgeLosses::DIODES),
            (None, Some((path, rig))) => {
                let missing = |error| Failure::input(format!("{}: {error}", path.display()));
                (Model::linear(rig.motor.parameters().map_err(missing)?), BridgeLosses::DIODES)
            }
            (None, None) => {
                let friction = effect("coulomb_friction").expect("an effect of the catalogue");
                (Model::linear(MotorParameters::PIVT6).with(friction, vec![COULOMB_NM]), BridgeLosses::L293D)
            }
        };
        let supply_v = rig.and_then(|(_, rig)| rig.supply.voltage_v).unwrap_or(USUAL_SUPPLY_V);
        Ok(Self { model, bridge, load_nm: 0.0, brake_nm: 0.0, turning: None, supply_v, dips_until: None })
    }

    /// The motor, without what hands do at its shaft.
    pub(super) fn model(&self) -> &Model {
        &self.model
    }

    /// What the bridge takes of the voltage.
    pub(super) fn bridge(&self) -> BridgeLosses {
        self.bridge
    }

    /// The motor at rest.
    pub(super) fn plant(&self) -> ModelPlant {
        ModelPlant::behind(self.bridge, self.braked())
    }

    /// The motor with the brake at its shaft.
    fn braked(&self) -> Model {
        let friction = effect("coulomb_friction").expect("an effect of the catalogue");
        let mut model = self.model.clone();
        match model.terms.iter_mut().find(|term| term.id() == friction.about().id) {
            Some(term) => term.values[0] += self.brake_nm,
            None if self.brake_nm > 0.0 => return model.with(friction, vec![self.brake_nm]),
            None => {}
        }
        model
    }

    /// Does what a line says.
    pub(super) fn obey(&mut self, bench: &mut Bench<ModelPlant>, order: &str) -> Result<Until, String> {
        let words: Vec<&str> = order.split_whitespace().collect();
        match words[..] {
            [] => {}
            ["motor", ref pairs @ ..] if !pairs.is_empty() => self.become_motor(bench, self.with_motor(pairs)?),
            ["effect", id, "off"] => self.become_motor(bench, self.without_effect(id)?),
            ["effect", id, ref pairs @ ..] => self.become_motor(bench, self.with_effect(id, pairs)?),
            ["model", _, ..] => {
                let file = model_file(order).expect("the rest of the line");
                let model = read_model(Path::new(file)).map_err(|failure| failure.message)?;
                self.bridge = BridgeLosses::DIODES;
                self.become_motor(bench, model);
            }
            ["load", torque_nm] => {
                let most_nm = self.most_torque_nm();
                self.load_nm = within(torque_nm, -most_nm..=most_nm, "Nm")?;
                bench.set_load_torque_nm(self.load_nm);
            }
            ["brake", torque_nm] => {
                self.brake_nm = within(torque_nm, 0.0..=self.most_torque_nm(), "Nm")?;
                self.become_motor(bench, self.model.clone());
            }
            ["turn", degrees] => {
                let angle_rad = within(degrees, TURN_DEGREES, "degrees")?.to_radians();
                bench.block_rotor(false);
                self.turning = Some((bench.now().angle_rad + angle_rad, 0.0));
                return Ok(Until::Turned);
            }
            ["wait", duration_s] => {
                let cycles = within(duration_s, WAIT_S, "s")? * f64::from(HARDWARE.clock_hz);
                return Ok(Until::Cycle(bench.cycle() + cycles as u64));
            }
            ["supply", "dip"] => {
                let end = bench.cycle() + (DIP_S * f64::from(HARDWARE.clock_hz)) as u64;
                self.dips_until = Some(end);
                bench.set_supply_v(DIP_V.min(self.supply_v));
                return Ok(Until::Cycle(end));
            }
            ["supply", supply_v] => {
                self.supply_v = within(supply_v, SUPPLY_V, "V")?;
                self.dips_until = None;
                bench.set_supply_v(self.supply_v);
            }
            ["block", on @ ("on" | "off")] => bench.block_rotor(on == "on"),
            ["stop", on @ ("on" | "off")] => bench.press_emergency_stop(on == "on"),
            ["encoder", fault] if encoder_fault(fault).is_some() => {
                bench.set_encoder_fault(encoder_fault(fault).flatten());
            }
            ["current", "ok"] => bench.set_current_sensor_fault(None),
            ["current", "open"] => bench.set_current_sensor_fault(Some(SensorFault::Open)),
            ["current", "high"] => bench.set_current_sensor_fault(Some(SensorFault::PinnedV(5.0))),
            ["current", "frozen"] => bench.freeze_current_sensor(),
            ["adc", state @ ("ok" | "dead")] => bench.set_converter_dead(state == "dead"),
            ["uart", state @ ("ok" | "stuck")] => bench.set_transmitter_stuck(state == "stuck"),
            ["current", "low"] => bench.set_current_sensor_fault(Some(SensorFault::PinnedV(0.0))),
            ["reset"] => bench.reset(ResetCause::External),
            _ => return Err(format!("{order}: {EXPECTED}")),
        }
        Ok(Until::Now)
    }

    /// Whether a line is no longer at work.
    pub(super) fn is_over(&self, bench: &Bench<ModelPlant>, until: Until) -> bool {
        match until {
            Until::Now => true,
            Until::Turned => self.turning.is_none(),
            Until::Cycle(cycle) => bench.cycle() >= cycle,
        }
    }

    /// The most that a hand or a load takes at the shaft: what the motor itself gives at rest with the greatest supply.
    fn most_torque_nm(&self) -> f64 {
        let motor = &self.model.motor;
        SUPPLY_V.end() / motor.resistance_ohm * motor.torque_constant_nm_per_a
    }

    /// What goes on by itself: a supply that comes back, a hand at the rotor.
    pub(super) fn go_on(&mut self, bench: &mut Bench<ModelPlant>) {
        if self.dips_until.is_some_and(|end| bench.cycle() >= end) {
            self.dips_until = None;
            bench.set_supply_v(self.supply_v);
        }
        self.push(bench);
    }

    /// A hand that turns the rotor pushes harder until it turns, not too fast, and holds it where it shall be.
    fn push(&mut self, bench: &mut Bench<ModelPlant>) {
        let Some((until_rad, torque_nm)) = &mut self.turning else { return };
        let now = bench.now();
        let there = now.angle_rad >= *until_rad;
        *torque_nm += if now.speed_rad_per_s < HAND_RAD_PER_S { PUSH_NM } else { -PUSH_NM };
        bench.set_load_torque_nm(if there { self.load_nm } else { self.load_nm - *torque_nm });
        if there {
            bench.block_rotor(true);
            self.turning = None;
        }
    }

    fn become_motor(&mut self, bench: &mut Bench<ModelPlant>, model: Model) {
        self.model = model;
        bench.change_plant(|plant| plant.replace(self.bridge, self.braked()));
    }

    fn with_motor(&self, pairs: &[&str]) -> Result<Model, String> {
        self.changed(|file| set(file, "motor", pairs))
    }

    fn without_effect(&self, id: &str) -> Result<Model, String> {
        if self.model.has(id) {
            return Ok(self.model.without(id));
        }
        let present = self.model.terms.iter().map(|term| term.id()).collect::<Vec<_>>().join(", ");
        Err(match present.is_empty() {
            true => format!("effect {id} off: the motor has no effects"),
            false => format!("effect {id} off: the motor does not have it, its effects are {present}"),
        })
    }

    /// With other constants of an effect; those that are not given stay.
    fn with_effect(&self, id: &str, pairs: &[&str]) -> Result<Model, String> {
        if effect(id).is_some_and(|effect| !ModelPlant::simulates(effect)) {
            return Err(format!(
                "effect {id}: it is not the motor's; the virtual board's sensors and timing are the chip's own"
            ));
        }
        self.changed(|file| {
            let effects = file.entry("effects").or_insert_with(|| Value::Table(Table::new()));
            set(effects.as_table_mut().expect("a model file's effects are a table"), id, pairs)
        })
    }

    /// The model with a change in its file.
    fn changed(&self, change: impl FnOnce(&mut Table) -> Result<(), String>) -> Result<Model, String> {
        let mut file: Table = self.model.to_toml().parse().expect("what was written as TOML");
        change(&mut file)?;
        // The lines are those of a text that nobody has seen.
        let without_line = |text: &str| match text.strip_prefix("line ").and_then(|rest| rest.split_once(": ")) {
            Some((_, what)) => what.to_owned(),
            None => text.to_owned(),
        };
        Model::parse(&file.to_string()).map_err(|error| without_line(error.to_string().trim_end()))
    }
}

/// The encoder's fault of this name, or none at all; an open line is held high by its pull-up.
fn encoder_fault(name: &str) -> Option<Option<EncoderFault>> {
    Some(Some(match name {
        "ok" => return Some(None),
        "unplugged" => EncoderFault::Unplugged,
        "swapped" => EncoderFault::Swapped,
        "a-open" | "a-high" => EncoderFault::AStuck(true),
        "a-low" => EncoderFault::AStuck(false),
        "b-open" | "b-high" => EncoderFault::BStuck(true),
        "b-low" => EncoderFault::BStuck(false),
        "shorted" => EncoderFault::Shorted,
        "noisy" => EncoderFault::Noisy,
        "slipping" => EncoderFault::Slipping,
        _ => return None,
    }))
}

/// Puts `NAME=VALUE` pairs into a section.
fn set(file: &mut Table, section: &str, pairs: &[&str]) -> Result<(), String> {
    let section = file.entry(section).or_insert_with(|| Value::Table(Table::new()));
    let section = section.as_table_mut().expect("a model file's sections are tables");
    for pair in pairs {
        let (name, value) = pair.split_once('=').ok_or_else(|| format!("{pair}: expected NAME=VALUE"))?;
        section.insert(name.into(), number(value)?.into());
    }
    Ok(())
}

fn number(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| format!("{text}: expected a number"))
}

/// A number that the bench can have.
fn within(text: &str, range: RangeInclusive<f64>, unit: &str) -> Result<f64, String> {
    let (least, most) = (short(*range.start()), short(*range.end()));
    let value = number(text)?;
    Some(value)
        .filter(|value| range.contains(value))
        .ok_or_else(|| format!("{text}: expected {least} to {most} {unit}"))
}

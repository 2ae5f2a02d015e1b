//! `motorbench demo`

use super::{Failure, Outputs, is_terminal, terminal};
use crate::board::words;
#[cfg(feature = "chip")]
use crate::board::{Board, BoardError, untripped};
use crate::catalogue::{Effect, Scales, effect};
use crate::design::compensation::{Losses, compensation};
use crate::design::law::ControlLaw;
use crate::design::specification::{Specification, Speed};
use crate::design::trial::{Point, Trial};
use crate::design::{Bench, Design, design};
use crate::diagnose::{Diagnosis, diagnose, page, report};
use crate::model::Model;
use crate::motor::MotorParameters;
use crate::panels::{Panel, panels_in_page};
#[cfg(feature = "chip")]
use crate::plant::ModelPlant;
use crate::recording::Recording;
use crate::rig::NominalMotor;
use crate::telemetry;
use crate::terminal_text::short;
use crate::web_page::{code, escaped, table};
use clap::Args;
use motorbench_core::excitation::{Kind, Sequence};
#[cfg(feature = "chip")]
use motorbench_core::message::State;
use motorbench_core::message::{Mode, Request, Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::VOLT;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Effects of a motor and its load that the demonstration hides, beside friction and the bridge's drop.
const HIDDEN: [&str; 8] = [
    "stribeck_friction",
    "quadratic_drag",
    "cogging",
    "gravity_unbalance",
    "supply_sag",
    "winding_heating",
    "load_step",
    "shaft_compliance",
];
/// Level of the identifying sequence, and the length of its steps.
const LEVEL_V: f64 = 10.0;
const STEP_TICKS: u16 = 500;
const SUPPLY_V: f64 = 12.0;
/// Until the sequence is over, and a little more.
#[cfg(feature = "chip")]
const DURATION_S: f64 = 20.1;
/// Speed loop that is asked for, and the references it is tried with, each for so long.
const BANDWIDTH_HZ: f64 = 5.0;
const REFERENCES_RAD_PER_S: [f64; 6] = [5.0, -5.0, 5.0, 60.0, -60.0, 0.0];
const HOLD_S: f64 = 0.8;
/// The first of them are slow.
const SLOW: usize = 3;

/// Without any hardware: a motor with an effect drawn at random is recorded by the firmware, understood, and controlled.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench demo --report demo.html")]
pub struct Arguments {
    /// Draws the same motor again.
    #[arg(long)]
    seed: Option<u64>,
    /// Writes diagnosis, loops and what was hidden as a page with plots.
    #[arg(long, value_name = "FILE.html", overrides_with = "report")]
    report: Option<PathBuf>,
    /// Prints the result as JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Writes the recording for the other commands, and what a data sheet would say beside it (.rig.toml).
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`], when a file cannot be written or the loop cannot be designed.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let clock = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let seed = arguments.seed.unwrap_or(clock);
    let outputs = arguments.outputs()?;
    let say = |text: &str| outputs.say(&format!("{text}\n"));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    say(&format!("A motor with something hidden in it (seed {seed})."));
    let truth = draw(&mut random);
    let nominal = wrong(&truth.motor, &mut random);
    let settings = recording_settings();
    say("\n1. Recording 20 s of the sequence `identify` at 1 kHz ...");
    let samples = record(&truth, settings, &say)?;
    let recording = telemetry::recording("demo", &samples, &settings);
    if let Some(path) = &arguments.csv {
        super::write(path, &recording.to_csv())?;
        let rig = telemetry::rig(&settings, NominalMotor::from(nominal));
        super::write(&rig_of(path), &toml::to_string(&rig).map_err(Failure::machine)?)?;
    }
    let missing: u32 = samples.windows(2).map(|pair| pair[1].tick - pair[0].tick - 1).sum();
    say(&format!("   {} samples, {missing} missing.\n\n2. Diagnosis ...\n", samples.len()));
    let diagnosis = diagnosed(recording, &settings, nominal)?;
    say(page::page(&diagnosis).trim_end());
    say(&format!(
        "\n3. A speed loop of {BANDWIDTH_HZ} Hz, from the data sheet and from what was found,\n   on the motor as it is\n"
    ));
    let loops = Loops::compared(&truth, &nominal, &diagnosis)?;
    say(&loops.table());
    let revealed = revealed(&truth, &diagnosis.model);
    say(&format!("\nWhat was hidden, and what was found\n{}", revealed_text(&revealed)));
    if let Some(path) = &arguments.report {
        let section = loops.section() + &revealed_html(&revealed);
        super::write(path, &report::report_with(&diagnosis, &[format!("demo --seed {seed}")], &section))?;
        say(&format!("\nThe page with plots: {}", path.display()));
    }
    if arguments.json {
        let result = serde_json::json!({
            "seed": seed,
            "samples": samples.len(),
            "missing": missing,
            "diagnosis": diagnosis.outcome,
            "loops": loops.attempts.iter().map(Attempt::json).collect::<Vec<_>>(),
            "commands": loops.commands,
            "hidden": truth.effects(),
            "motor": truth.motor,
        });
        println!("{result:#}");
    }
    Ok(())
}

/// The rig file of a recording.
fn rig_of(recording: &Path) -> PathBuf {
    recording.with_extension("rig.toml")
}

impl Arguments {
    fn outputs(&self) -> Result<Outputs, Failure> {
        if self.csv.as_deref().is_some_and(is_terminal) {
            return Err(Failure::input("--csv -: a rig file is written beside the recording: give it a name"));
        }
        let (rig, json) = (self.csv.as_deref().map(rig_of), terminal(self.json));
        Outputs::new([], [&self.report, &self.csv, &rig, &json].into_iter().flatten())
    }
}

/// A bench that has friction and a bridge drop, and one thing more.
fn draw(random: &mut ChaCha8Rng) -> Model {
    let pivt6 = MotorParameters::PIVT6;
    let mut about = |value: f64| value * random.random_range(0.85..1.15);
    let motor = MotorParameters {
        resistance_ohm: about(pivt6.resistance_ohm),
        inductance_h: about(pivt6.inductance_h),
        torque_constant_nm_per_a: about(pivt6.torque_constant_nm_per_a),
        inertia_kg_m2: about(2.0 * pivt6.inertia_kg_m2),
        viscous_friction_nm_s: about(pivt6.viscous_friction_nm_s),
    };
    let scales = Scales {
        motor,
        voltage_v: SUPPLY_V,
        speed_rad_per_s: SUPPLY_V / motor.torque_constant_nm_per_a,
        supply_v: SUPPLY_V,
        current_a: SUPPLY_V / motor.resistance_ohm,
        duration_s: 20.0,
        interval_s: 1e-3,
        pwm_hz: 20_000.0,
    };
    let known = |id: &str| effect(id).expect("an effect of the catalogue");
    let hidden = known(HIDDEN[random.random_range(0..HIDDEN.len())]);
    Model::linear(motor)
        .with(known("coulomb_friction"), vec![random.random_range(0.03..0.06) * scales.stall_torque_nm()])
        .with(known("voltage_drop"), vec![random.random_range(1.0..2.2)])
        .with(hidden, values(hidden, &scales, random))
}

/// One of the effect's usual values, its size up to three times as much.
fn values(effect: &dyn Effect, scales: &Scales, random: &mut ChaCha8Rng) -> Vec<f64> {
    let mut starts = effect.starts(scales);
    let mut values = starts.swap_remove(random.random_range(0..starts.len()));
    let factor = random.random_range(1.0..3.0);
    for value in values.iter_mut().take(effect.about().linear_in) {
        *value *= factor;
    }
    values
}

/// What a data sheet would say: off by up to 15 %.
fn wrong(motor: &MotorParameters, random: &mut ChaCha8Rng) -> MotorParameters {
    let mut off = |value: f64| value * random.random_range(0.85..1.15);
    MotorParameters {
        resistance_ohm: off(motor.resistance_ohm),
        inductance_h: off(motor.inductance_h),
        torque_constant_nm_per_a: off(motor.torque_constant_nm_per_a),
        inertia_kg_m2: off(motor.inertia_kg_m2),
        viscous_friction_nm_s: off(motor.viscous_friction_nm_s),
    }
}

/// Identification needs the whole voltage: nothing limits it, and trips are as wide as they go.
fn recording_settings() -> Settings {
    let mut settings = Settings::defaults();
    let wide = [
        (Param::SupplyVoltage, SUPPLY_V as f32),
        (Param::VoltageLimit, SUPPLY_V as f32),
        (Param::SlewLimit, 30_000.0),
        (Param::CurrentLimit, 0.0),
        (Param::TripPeak, 5.0),
        (Param::TripContinuous, 3.0),
        (Param::TripStall, 0.0),
        (Param::TripEncoder, 0.0),
    ];
    for (param, value) in wide {
        settings.set(param, value).expect("within the settings' ranges");
    }
    settings
}

/// By the firmware on the simulated chip; where that cannot be, by its control core on this computer.
#[cfg(feature = "chip")]
fn record(truth: &Model, settings: Settings, say: &dyn Fn(&str)) -> Result<Vec<Sample>, Failure> {
    match super::firmware() {
        Ok(elf) => {
            say("   by the firmware on a simulated ATmega328P, over its serial port");
            Ok(record_on_chip(&elf, truth, &settings)?)
        }
        Err(error) => {
            say(&format!("   (no firmware for the simulated chip: {error})"));
            record_on_host(truth, settings, say)
        }
    }
}

/// By the firmware's control core on this computer.
#[cfg(not(feature = "chip"))]
fn record(truth: &Model, settings: Settings, say: &dyn Fn(&str)) -> Result<Vec<Sample>, Failure> {
    say("   (built without the simulated chip: `scripts/setup chip` installs what it needs)");
    record_on_host(truth, settings, say)
}

#[cfg(feature = "chip")]
fn record_on_chip(elf: &std::path::Path, truth: &Model, settings: &Settings) -> Result<Vec<Sample>, BoardError> {
    let failed = |error: &dyn std::fmt::Display| BoardError::Failed(error.to_string());
    let circuit = crate::chip::Rig { supply_v: SUPPLY_V, ..crate::chip::Rig::default() };
    let plant = ModelPlant::new(truth.clone());
    let bench = crate::chip::Bench::new(elf, circuit, plant).map_err(|error| failed(&error))?;
    let mut board = crate::chip::ChipBoard::start(bench)?;
    let defaults = Settings::defaults();
    for param in Param::ALL.iter().copied().filter(|param| settings.get(*param) != defaults.get(*param)) {
        board.command(&format!("set {} {}", crate::link::name(param), settings.get(param)))?;
    }
    board.command("arm")?;
    board.command("mode open")?;
    board.samples(0.0)?;
    board.command(&format!("sequence identify {LEVEL_V} 0 {STEP_TICKS}"))?;
    let mut samples = untripped(board.samples(DURATION_S)?)?;
    board.command("disarm")?;
    samples.retain(|sample| sample.state.has(State::PLAYING));
    Ok(samples)
}

fn record_on_host(truth: &Model, settings: Settings, say: &dyn Fn(&str)) -> Result<Vec<Sample>, Failure> {
    say("   by the firmware's control core on this computer");
    let refused = |error| Failure::input(format!("the core refuses its settings: {error:?}"));
    let mut trial = Trial::of_model(truth, settings).map_err(refused)?;
    trial.enter(Mode::OpenLoop);
    let sequence = Sequence::new(Kind::Identify, (LEVEL_V * f64::from(VOLT)) as i16, 0, STEP_TICKS, 1, 1);
    trial.tick(Some(Request::Play(sequence)));
    let mut samples = Vec::new();
    for _ in 0..sequence.duration_ticks() {
        trial.tick(None);
        samples.push(*trial.sample());
    }
    match trial.sample().trip {
        Trip::None => Ok(samples),
        trip => Err(Failure::input(format!("the drive switched off while recording: {}", words(trip)))),
    }
}

fn diagnosed(recording: Recording, settings: &Settings, nominal: MotorParameters) -> Result<Diagnosis, Failure> {
    let rig = telemetry::rig(settings, NominalMotor::from(nominal));
    let bar = super::spinner();
    let result = diagnose(&[recording], &rig, &|text| bar.set_message(text.to_string()));
    bar.finish_and_clear();
    result.map_err(Failure::input)
}

/// A loop and how it followed.
struct Attempt {
    name: &'static str,
    /// Root mean square errors of the true speed: of the slow references, and of all.
    slow_rms: f64,
    all_rms: f64,
    points: Vec<Point>,
}

impl Attempt {
    fn json(&self) -> serde_json::Value {
        let Self { name, slow_rms, all_rms, .. } = self;
        serde_json::json!({
            "design": name, "standstill_rms_rad_per_s": slow_rms, "all_rms_rad_per_s": all_rms
        })
    }
}

/// Loops on the motor as it is, and what the board's console takes of the last.
struct Loops {
    attempts: Vec<Attempt>,
    commands: Vec<String>,
}

impl Loops {
    /// Designed from the data sheet, from the linear motor found, and with the friction and the drop made up for.
    fn compared(truth: &Model, nominal: &MotorParameters, diagnosis: &Diagnosis) -> Result<Self, Failure> {
        let found = &diagnosis.model;
        let before = designed(nominal)?.settings.all;
        let mut list = designed(&found.motor)?.settings;
        let without = list.all;
        let motor = &found.motor;
        let losses = compensation(&Losses::of(found), motor.resistance_ohm, motor.torque_constant_nm_per_a);
        for setting in losses.map_err(Failure::input)? {
            list.set(setting.param, setting.value).map_err(Failure::input)?;
        }
        let attempts =
            [("designed from the data sheet", before), ("from what was found", without), ("and compensated", list.all)];
        let attempts = attempts.into_iter().map(|(name, settings)| tracking(name, truth, settings));
        Ok(Self { attempts: attempts.collect::<Result<_, _>>()?, commands: list.commands() })
    }

    fn table(&self) -> String {
        let mut text = format!("   {:30} {:>22} {:>16}\n", "speed error, rms", "about standstill", "in all");
        for Attempt { name, slow_rms, all_rms, .. } in &self.attempts {
            text += &format!("   {name:30} {:>16} rad/s {:>10} rad/s\n", short(*slow_rms), short(*all_rms));
        }
        text += "\n   For the board's console:";
        self.commands.iter().for_each(|command| text += &format!("\n     {command}"));
        text
    }

    /// For the page: all speeds on one plot, the slow part larger, the table, and the gains.
    fn section(&self) -> String {
        let panel = |title: &str, count: usize| {
            let first = &self.attempts[0].points[..count];
            let reference = Panel::new(title).line("reference", first.iter().map(|point| point.reference).collect());
            self.attempts.iter().fold(reference, |panel, attempt| {
                let speeds = attempt.points[..count].iter().map(|point| point.omega_rad_per_s);
                panel.line(attempt.name, speeds.collect())
            })
        };
        let all = self.attempts[0].points.len();
        let slow = all * SLOW / REFERENCES_RAD_PER_S.len();
        let interval_s = HOLD_S * REFERENCES_RAD_PER_S.len() as f64 / all as f64;
        let plots = [panel("speed, rad/s", all), panel("speed about standstill, rad/s", slow)]
            .map(|panel| panels_in_page(interval_s, &[panel]));
        let rows = self.attempts.iter().map(|Attempt { name, slow_rms, all_rms, .. }| {
            let [slow_rms, all_rms] = [slow_rms, all_rms].map(|rms| format!("{} rad/s", short(*rms)));
            [(*name).into(), slow_rms, all_rms]
        });
        format!(
            "<h2>The speed loop before and after</h2><p>{BANDWIDTH_HZ} Hz, on the motor as it is.</p>{}{}\
             <h2>For the board's console</h2><pre>{}</pre>\n",
            plots.concat(),
            table(&["speed error, rms", "about standstill", "in all"], rows),
            escaped(&self.commands.join("\n"))
        )
    }
}

fn designed(motor: &MotorParameters) -> Result<Design, Failure> {
    let specification =
        Specification { speed: Speed::BandwidthHz(BANDWIDTH_HZ), overshoot_percent: 10.0, current_limit_a: 1.5 };
    design(motor, &Bench::default(), ControlLaw::SpeedPid, &specification).map_err(Failure::input)
}

fn tracking(name: &'static str, truth: &Model, settings: Settings) -> Result<Attempt, Failure> {
    let refused = |error| Failure::input(format!("the core refuses the designed settings: {error:?}"));
    let mut trial = Trial::of_model(truth, settings).map_err(refused)?;
    trial.enter(Mode::SpeedPid);
    let points: Vec<Vec<Point>> = REFERENCES_RAD_PER_S.iter().map(|speed| trial.follow(*speed, HOLD_S)).collect();
    let rms = |points: &[Vec<Point>]| {
        let squares = points.iter().flatten().map(|point| (point.omega_rad_per_s - point.reference).powi(2));
        (squares.sum::<f64>() / points.iter().flatten().count() as f64).sqrt()
    };
    Ok(Attempt { name, slow_rms: rms(&points[..SLOW]), all_rms: rms(&points), points: points.concat() })
}

/// A constant that was hidden, and what the diagnosis made of it.
struct Revealed {
    /// Its effect; empty for the motor's own.
    effect: &'static str,
    name: &'static str,
    hidden: Option<f64>,
    found: Option<f64>,
}

/// Everything that was hidden or found, effects first.
fn revealed(truth: &Model, found: &Model) -> Vec<Revealed> {
    let [hidden, found] = [truth, found].map(constants);
    let value =
        |of: &[(Constant, f64)], constant| of.iter().find(|(other, _)| *other == constant).map(|(_, value)| *value);
    let only_found = found.iter().filter(|(constant, _)| value(&hidden, *constant).is_none());
    let all = hidden.iter().chain(only_found).map(|(constant @ (effect, name), _)| Revealed {
        effect,
        name,
        hidden: value(&hidden, *constant),
        found: value(&found, *constant),
    });
    let mut all: Vec<Revealed> = all.collect();
    all.sort_by_key(|constant| constant.effect.is_empty());
    all
}

/// An effect and one of its constants.
type Constant = (&'static str, &'static str);

fn constants(model: &Model) -> Vec<(Constant, f64)> {
    let effects = model.terms.iter().flat_map(|term| term.said().map(|(_, name, value)| ((term.id(), name), value)));
    effects.chain(model.motor.named().map(|(name, value)| (("", name), value))).collect()
}

/// A number, or that there is none.
fn value_or_dash(value: Option<f64>) -> String {
    value.map_or("-".into(), short)
}

fn revealed_text(constants: &[Revealed]) -> String {
    let mut text = format!("  {:46} {:>10} {:>10}", "", "hidden", "found");
    for Revealed { effect, name, hidden, found } in constants {
        let name = format!("{effect} {name}");
        text += &format!("\n  {:46} {:>10} {:>10}", name.trim_start(), value_or_dash(*hidden), value_or_dash(*found));
    }
    text
}

fn revealed_html(constants: &[Revealed]) -> String {
    let rows = constants.iter().map(|Revealed { effect, name, hidden, found }| {
        let name = if effect.is_empty() { code([*name]) } else { format!("{} {}", code([*effect]), code([*name])) };
        [name, value_or_dash(*hidden), value_or_dash(*found)]
    });
    format!("<h2>What was hidden, and what was found</h2>{}", table(&["", "hidden", "found"], rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_hidden_can_be_hidden() {
        for id in HIDDEN {
            let hidden = effect(id).expect("of the catalogue");
            assert!(hidden.acts_on_motor(), "{id} is not the motor's");
        }
    }

    #[test]
    fn what_was_missed_and_what_was_not_there_are_revealed_too() {
        let linear = Model::linear(MotorParameters::PIVT6);
        let known = |id: &str| effect(id).expect("of the catalogue");
        let truth = linear.clone().with(known("voltage_drop"), vec![1.5]);
        let found = linear.with(known("coulomb_friction"), vec![0.01]);
        let text = revealed_text(&revealed(&truth, &found));
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
        assert_eq!(
            rows[..3],
            [
                vec!["hidden", "found"],
                vec!["voltage_drop", "drop_V", "1.50", "-"],
                vec!["coulomb_friction", "torque_Nm", "-", "0.0100"]
            ]
        );
        assert_eq!(rows.len(), 8, "{text}");
        assert!(rows[3..].iter().all(|row| row[1] == row[2]) && text.lines().all(|line| line.len() <= 80), "{text}");
    }
}

//! `motorbench demo`: a whole session with a simulated motor.

mod loops;
mod revealed;

use super::own_files::WRITTEN;
use super::{Failure, JSON_TO, Outputs, TERMINAL, is_terminal, open_next, provenance, write_json};
use clap::Args;
use host_sim::hidden_bench::{RECORDED_S, SUPPLY_V, data_sheet, draw};
#[cfg(feature = "chip")]
use host_sim::plant::ModelPlant;
use host_sim::trial::Trial;
use indicatif::ProgressBar;
use loops::Loops;
use motorbench_core::excitation::{Kind, Sequence};
#[cfg(feature = "chip")]
use motorbench_core::message::State;
use motorbench_core::message::{Mode, Request, Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::VOLT;
#[cfg(feature = "chip")]
use motorbench_data::names::setting_name;
use motorbench_data::names::trip_words;
use motorbench_data::rig::{NominalMotor, Rig};
use motorbench_data::telemetry::{self, IDENTIFICATION_SETTINGS};
use motorbench_diagnosis::diagnose::outcome::Outcome;
use motorbench_diagnosis::diagnose::{Diagnosis, diagnose};
#[cfg(feature = "chip")]
use motorbench_link::board::{Board, BoardError, untripped};
use motorbench_link::record::missing_ticks;
use motorbench_model::Model;
use motorbench_report::diagnosis_page::{self as report, Besides};
use motorbench_report::diagnosis_text as page;
use motorbench_report::web_page::{Provenance, lines};
use motorbench_text::terminal_text::{quoted, short, wrapped};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use revealed::Revealed;
use std::fs::File;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Level of the identifying sequence, and the length of its steps.
const LEVEL_V: f64 = 10.0;
const STEP_TICKS: u32 = 500;
/// Duration of the sequence, and a slightly longer waiting time.
const SEQUENCE_S: f64 = RECORDED_S;
#[cfg(feature = "chip")]
const WAIT_S: f64 = SEQUENCE_S + 0.1;
/// Message during the recording.
const RECORDING: &str = "20 s of the sequence `identify` are recorded";
/// Name of the page, beside those of diagnoses.
const TITLE: &str = "motorbench demo";
/// A constant of an effect that is a time.
const TIME: &str = "time_s";

/// Records, diagnoses and controls a simulated motor with a random hidden effect.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench demo --report demo.html")]
pub struct Arguments {
    /// Seed of the draw: the same seed gives the same motor.
    #[arg(long)]
    seed: Option<u64>,
    /// Page with plots; default: motorbench-demo-SEED.html, unless that file exists or --json is given.
    #[arg(long, value_name = "FILE.html", overrides_with = "report")]
    report: Option<PathBuf>,
    /// Prints the result as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
    /// Writes the recording for the other commands, and beside it a rig file with values as of a data sheet (.rig.toml).
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
}

/// Lines of a terminal without those for the place of the page and for the prompt.
const SCREENFUL: u16 = 22;

/// Runs it.
///
/// # Errors
/// [`Failure`], when a file cannot be written or the loop cannot be designed.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let clock = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let seed = arguments.seed.unwrap_or(clock);
    let outputs = arguments.outputs()?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let truth = draw(&mut random);
    let nominal = data_sheet(&truth.motor, &mut random);
    let settings = recording_settings();
    let recorded = record(&truth, settings)?;
    let drawn = wrapped(&format!("A motor with a hidden effect (seed {seed}): {}.", recorded.words()), "", "");
    outputs.say(&drawn);
    let recording = telemetry::recording("demo", &recorded.samples, &settings);
    let rig = (recorded.rig)(&settings, NominalMotor::from(nominal));
    if let Some(path) = &arguments.csv {
        super::write(path, &recording.to_csv())?;
        let rig = toml::to_string(&rig).map_err(Failure::machine)?;
        super::write(&rig_of(path), &(WRITTEN.to_owned() + &rig))?;
    }
    let diagnosis = working("diagnosis", |bar| diagnose(&[recording], &rig, &|text| bar.set_message(text.to_string())))
        .map_err(Failure::input)?;
    let hidden = on_clock_of(&recorded.samples, &truth, &settings);
    let revealed = Revealed::of(&hidden, &diagnosis.model);
    // With a table, what was written and what comes next take two lines. One is that of the page, the other this empty one.
    let gap = if arguments.csv.is_some() { "" } else { "\n" };
    let [verdict, errors] = [page::verdict(&diagnosis.outcome), errors(&diagnosis.outcome)];
    let found = format!("\n{verdict}\n{errors}{}{gap}", revealed.text());
    outputs.say(&found);
    let loops = working("three loops are designed and tried", |_| Loops::compared(&truth, &nominal, &diagnosis))?;
    let taken = drawn.lines().chain(found.lines()).count() + usize::from(arguments.csv.is_some());
    outputs.say(&loops.picture(SCREENFUL.saturating_sub(taken as u16)));
    let whole = Whole { seed, recorded, hidden, diagnosis, loops, revealed };
    match &arguments.report {
        Some(path) => super::write(path, &whole.html())?,
        None if arguments.json.is_some() => {}
        None => outputs.say(&unasked(&PathBuf::from(format!("motorbench-demo-{seed}.html")), &whole.html())),
    }
    if let Some(path) = &arguments.json {
        write_json(path, &whole.json())?;
    }
    let next = arguments.csv.as_ref().map(|csv| format!("motorbench diagnose {}", quoted(&csv.display().to_string())));
    outputs.wrote(&next.unwrap_or_else(|| open_next(arguments.report.as_deref())));
    Ok(())
}

/// All results.
struct Whole {
    seed: u64,
    recorded: Recorded,
    hidden: Model,
    diagnosis: Diagnosis,
    loops: Loops,
    revealed: Revealed,
}

impl Whole {
    /// The page: the diagnosis with its plots, the loops, the hidden effect, and the diagnosis in words.
    fn html(&self) -> String {
        let from = provenance::of_files([Path::new(&format!("motorbench demo --seed {}", self.seed))]);
        let from = Provenance { left_out: vec![format!("{}.", self.recorded.words())], ..from };
        let words = ("In the words of diagnose".into(), lines(&page::page(&self.diagnosis)));
        let besides = Besides { early: vec![self.loops.section(), self.revealed.html()], folded: vec![words] };
        report::report_with(TITLE, "A simulated motor with a hidden effect", &self.diagnosis, from, besides)
    }

    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "seed": self.seed,
            "recorded_by": self.recorded.by,
            "samples": self.recorded.samples.len(),
            "missing": missing_ticks(&self.recorded.samples),
            "diagnosis": self.diagnosis.outcome,
            "loops": self.loops.json(),
            "commands": self.loops.commands,
            "hidden": self.hidden.effects(),
            "motor": self.hidden.motor,
        })
    }
}

fn page_is_at(path: &Path) -> String {
    format!("All of it, with plots: {}\n", path.display())
}

/// Writes the page under its default name and prints its place. It never replaces an existing file. Errors are reported
/// but do not fail the command.
fn unasked(path: &Path, html: &str) -> String {
    let error = match File::create_new(path).and_then(|mut file| file.write_all(html.as_bytes())) {
        Ok(()) => return page_is_at(path),
        Err(error) => error,
    };
    let why = match error.kind() {
        ErrorKind::AlreadyExists => format!("{} exists and is not replaced", path.display()),
        _ => super::cannot_write(path, &error).message,
    };
    wrapped(&format!("No page with plots: {why}; --report FILE.html writes it elsewhere"), "", "")
}

/// The error of the linear motor, and the gain by the named causes.
fn errors(outcome: &Outcome) -> String {
    let mut text = row("rms error on held-out data", ["linear", "extended", "noise"]);
    for channel in outcome.fit["base"].keys() {
        let of = ["base", "extended", "noise_floor"].map(|which| short(outcome.fit[which][channel].rmse));
        text += &row(&format!("  {channel}"), of.each_ref().map(String::as_str));
    }
    text
}

/// A line of a table: a name, and numbers.
fn row<const COUNT: usize>(what: &str, numbers: [&str; COUNT]) -> String {
    let numbers: String = numbers.iter().map(|number| format!(" {number:>10}")).collect();
    format!("{what:44}{numbers}\n")
}

/// The rig file of a recording.
fn rig_of(recording: &Path) -> PathBuf {
    recording.with_extension("rig.toml")
}

impl Arguments {
    fn outputs(&self) -> Result<Outputs, Failure> {
        if self.csv.as_deref().is_some_and(is_terminal) {
            return Err(Failure::input("--csv -: a rig file is written beside the recording, so give it a file name"));
        }
        let rig = self.csv.as_deref().map(rig_of);
        Outputs::new([], [&self.report, &self.csv, &rig, &self.json].into_iter().flatten())
    }
}

/// Settings for identification: nothing limits the voltage, and trips are as wide as possible.
fn recording_settings() -> Settings {
    let mut settings = Settings::defaults();
    let supply = [(Param::SupplyVoltage, SUPPLY_V as f32), (Param::VoltageLimit, SUPPLY_V as f32)];
    for (param, value) in supply.into_iter().chain(IDENTIFICATION_SETTINGS) {
        settings.set(param, value).expect("within the settings' ranges");
    }
    settings
}

/// The samples, and how they were recorded.
struct Recorded {
    samples: Vec<Sample>,
    by: String,
    /// Rig of the recording.
    rig: fn(&Settings, NominalMotor) -> Rig,
}

impl Recorded {
    /// Part of a sentence.
    fn words(&self) -> String {
        let missing = missing_ticks(&self.samples);
        format!("{} samples in {SEQUENCE_S} s, {missing} missing, recorded by {}", self.samples.len(), self.by)
    }
}

/// By the firmware on the simulated chip. If that is not available, by its control core on this computer.
#[cfg(feature = "chip")]
fn record(truth: &Model, settings: Settings) -> Result<Recorded, Failure> {
    match super::firmware() {
        Ok(elf) => {
            let samples = working(RECORDING, |_| record_on_chip(&elf, truth, &settings))?;
            Ok(Recorded {
                samples,
                by: "the firmware on a simulated ATmega328P, over its serial port".into(),
                rig: telemetry::rig,
            })
        }
        Err(error) => record_on_host(truth, settings, &format!("no firmware for the simulated chip: {error}")),
    }
}

/// By the firmware's control core on this computer.
#[cfg(not(feature = "chip"))]
fn record(truth: &Model, settings: Settings) -> Result<Recorded, Failure> {
    let why = "built without the simulated chip: `scripts/setup chip` installs its requirements";
    record_on_host(truth, settings, why)
}

#[cfg(feature = "chip")]
fn record_on_chip(elf: &std::path::Path, truth: &Model, settings: &Settings) -> Result<Vec<Sample>, BoardError> {
    let failed = |error: &dyn std::fmt::Display| BoardError::Failed(error.to_string());
    let circuit = motorbench_chip::Rig { supply_v: SUPPLY_V, ..motorbench_chip::Rig::default() };
    let plant = ModelPlant::new(truth.clone());
    let bench = motorbench_chip::Bench::new(elf, circuit, plant).map_err(|error| failed(&error))?;
    let mut board = motorbench_chip::ChipBoard::start(bench)?;
    let defaults = Settings::defaults();
    for param in Param::ALL.iter().copied().filter(|param| settings.get(*param) != defaults.get(*param)) {
        board.command(&format!("set {} {}", setting_name(param), settings.get(param)))?;
    }
    board.command("arm")?;
    board.command("mode open")?;
    board.samples(0.0)?;
    board.command(&format!("sequence identify {LEVEL_V} 0 {STEP_TICKS}"))?;
    let mut samples = untripped(board.samples(WAIT_S)?)?;
    board.command("disarm")?;
    samples.retain(|sample| sample.state.has(State::PLAYING));
    Ok(samples)
}

fn record_on_host(truth: &Model, settings: Settings, why: &str) -> Result<Recorded, Failure> {
    let refused = |error| Failure::input(format!("the core refuses its settings: {error:?}"));
    let mut trial = Trial::of_model(truth, settings).map_err(refused)?;
    trial.enter(Mode::OpenLoop);
    let sequence = Sequence::new(Kind::Identify, (LEVEL_V * f64::from(VOLT)) as i16, 0, STEP_TICKS, 1, 1)
        .expect("the sequence is a valid constant");
    trial.tick(Some(Request::Play(sequence)));
    let mut samples = Vec::new();
    working(RECORDING, |_| {
        for _ in 0..sequence.duration_ticks() {
            trial.tick(None);
            samples.push(*trial.sample());
        }
    });
    match trial.sample().trip {
        Trip::None => Ok(Recorded {
            samples,
            by: format!("the firmware's control core on this computer ({why})"),
            rig: telemetry::rig_of_core,
        }),
        trip => Err(Failure::input(format!("the drive switched off while recording: {}", trip_words(trip)))),
    }
}

/// Runs a long task and shows its progress on a terminal.
fn working<T>(what: &'static str, work: impl FnOnce(&ProgressBar) -> T) -> T {
    let bar = super::spinner();
    bar.set_message(what);
    let done = work(&bar);
    bar.finish_and_clear();
    done
}

/// The hidden effect by the clock of the recording. The motor had its supply some time before the recording.
fn on_clock_of(samples: &[Sample], truth: &Model, settings: &Settings) -> Model {
    let first = samples.first().map_or(0, |sample| sample.tick);
    let before_s = f64::from(first) / f64::from(settings.get(Param::TickRate));
    let mut model = truth.clone();
    for term in &mut model.terms {
        let constants = term.effect.about().parameters.iter().zip(&mut term.values);
        constants.filter(|(constant, _)| constant.name == TIME).for_each(|(_, value)| *value -= before_s);
    }
    model
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;

    #[test]
    fn a_page_that_nobody_asked_for_is_written_over_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("page.html");
        assert!(unasked(&path, "first").ends_with("page.html\n"));
        assert!(unasked(&path, "second").contains("is not replaced"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "first");
        let said = unasked(&directory.path().join("none/page.html"), "third");
        assert!(
            said.starts_with("No page") && said.contains("make its folder first") && said.contains("--report"),
            "{said}"
        );
    }

    #[test]
    fn hidden_times_are_by_the_clock_of_the_recording() {
        let load = effect("load_step").expect("of the catalogue");
        let truth = Model::linear(MotorParameters::PIVT6).with(load, vec![0.004, 12.0]);
        let samples = [Sample { tick: 500, ..Sample::default() }];
        let hidden = on_clock_of(&samples, &truth, &Settings::defaults());
        assert_eq!(hidden.terms[0].values, [0.004, 11.5]);
    }
}

//! `motorbench ports`, `motorbench connect`, `motorbench record`, `motorbench send`, `motorbench tune`: the commands that talk to a board.

use super::live::LiveArguments;
use super::{Failure, bar, write};
use crate::board::{Board, BoardError};
use crate::link::coverage::{Coverage, Lack};
use crate::link::port::{Port, only_board, open, ports};
use crate::link::record::{Ended, Record, by_name, duration_ticks, record};
use crate::link::{self, Link, VERSION};
use crate::live::Live;
use crate::rig::{NominalMotor, Rig};
use crate::telemetry;
use crate::tune::{Keeper, Session, screen};
use clap::{Args, ValueEnum};
use indicatif::ProgressStyle;
use motorbench_core::excitation::Kind;
use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings, find};
use std::collections::BTreeMap;
use std::io::{BufRead, IsTerminal, stdin};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

impl From<BoardError> for Failure {
    fn from(error: BoardError) -> Self {
        match error {
            BoardError::Failed(_) | BoardError::Silent { .. } => Self::machine(error),
            BoardError::Refused { .. } | BoardError::Tripped(_) => Self::input(error),
        }
    }
}

/// Which port.
#[derive(Args)]
pub struct PortArguments {
    /// The board's port, for instance /dev/ttyACM0, COM3, or the link that `motorbench virtual` makes; without it the only
    /// board that is plugged in.
    #[arg(long)]
    port: Option<String>,
}

impl PortArguments {
    pub(super) fn open(&self) -> Result<(Link<Port>, String), Failure> {
        let name = match &self.port {
            Some(name) => name.clone(),
            None => only_board().map_err(Failure::machine)?,
        };
        Ok((open(&name)?, name))
    }
}

/// Lists the serial ports and says which are boards.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench ports --json")]
pub struct PortsArguments {
    /// One JSON list for programs.
    #[arg(long)]
    json: bool,
}

/// Runs `ports`.
///
/// # Errors
/// When the system does not tell.
pub fn list(arguments: &PortsArguments) -> Result<(), Failure> {
    let found = ports().map_err(Failure::machine)?;
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&found).map_err(Failure::machine)?);
        return Ok(());
    }
    if found.is_empty() {
        println!("no serial port here; without a board: motorbench virtual");
    }
    for port in found {
        println!("{:24} {}{}", port.port, if port.board { "board: " } else { "" }, port.what);
    }
    Ok(())
}

/// Talks to a board's console: what is given, or line by line from the terminal.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench connect                         (line by line; an empty line stops the motor, Ctrl-D ends)
  motorbench connect --port /dev/ttyACM0 status 'show speed_kp'")]
pub struct ConnectArguments {
    #[command(flatten)]
    port: PortArguments,
    /// Lines of the console.
    lines: Vec<String>,
    /// One line of JSON for each line of the console, for programs.
    #[arg(long)]
    json: bool,
}

/// Runs `connect`.
///
/// # Errors
/// [`Failure`] when the board does not answer or refuses.
pub fn connect(arguments: &ConnectArguments) -> Result<(), Failure> {
    let (mut link, name) = arguments.port.open()?;
    for line in &arguments.lines {
        say(arguments.json, line, &link.ask(line)?);
    }
    if !arguments.lines.is_empty() {
        return Ok(());
    }
    if !arguments.json {
        println!(
            "{} at {name}, program {VERSION}; help lists the commands, an empty line stops the motor",
            link.firmware
        );
    }
    for line in stdin().lock().lines() {
        let line = line.map_err(Failure::machine)?;
        match link.ask(if line.is_empty() { "stop" } else { &line }) {
            Ok(replies) => say(arguments.json, &line, &replies),
            Err(BoardError::Refused { reply, .. }) => say(arguments.json, &line, &[reply]),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

fn say(json: bool, line: &str, replies: &[String]) {
    if json {
        println!("{}", serde_json::json!({ "line": line, "reply": replies }));
    } else {
        replies.iter().for_each(|reply| println!("{reply}"));
    }
}

/// Excitations, by the console's names.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Excitation {
    Steps,
    Ramp,
    Stairs,
    Prbs,
    Levels,
    Chirp,
    Coast,
    Identify,
}

impl Excitation {
    fn kind(self) -> Kind {
        Kind::from_number(self as u8).expect("in the order of the core's own list")
    }
}

/// Plays an excitation on a board and records it at full rate, with rig file and side file.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench record --out run.csv                                 (20 s of the sequence that tells most apart)
  motorbench record --sequence steps --amplitude 6 --period 800 --count 4 --out steps.csv
  motorbench record --mode speed --sequence levels --amplitude 80 --out loop.csv
  motorbench record --live plotjuggler --live teleplot=192.168.1.20:47269

Beside run.csv it writes run.rig.toml, for motorbench diagnose, run.scenario.toml, for validate, and run.json: firmware,
settings, what was lost.
Ctrl-C stops the motor and keeps what has come.")]
pub struct RecordArguments {
    #[command(flatten)]
    port: PortArguments,
    /// What to play.
    #[arg(long, value_enum, default_value = "identify")]
    sequence: Excitation,
    /// In the unit of the mode; without it eight tenths of the supply.
    #[arg(long)]
    amplitude: Option<f64>,
    /// Added to it.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    offset: f64,
    /// How long one part lasts, in ms.
    #[arg(long, default_value_t = 500)]
    period: u16,
    /// How often.
    #[arg(long, default_value_t = 1)]
    count: u16,
    /// Of random excitations.
    #[arg(long, default_value_t = 1)]
    seed: u16,
    /// Who sets the voltage: open, speed, position, lqr_speed, lqr_position.
    #[arg(long, default_value = "open")]
    mode: String,
    /// Settings to change for this recording: NAME=VALUE.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// A rig file whose nominal constants of the motor go into the new one.
    #[arg(long, value_name = "RIG.toml")]
    motor: Option<PathBuf>,
    /// Where to.
    #[arg(long, default_value = "run.csv")]
    out: PathBuf,
    #[command(flatten)]
    live: LiveArguments,
    /// Prints the side file instead of text.
    #[arg(long)]
    json: bool,
}

/// Runs `record`.
///
/// # Errors
/// [`Failure`] when nothing could be recorded, or when the recording ended before its time; what has come is written.
pub fn run_record(arguments: &RecordArguments) -> Result<(), Failure> {
    let nominal = match &arguments.motor {
        Some(path) => Rig::read(path).map_err(Failure::input)?.motor,
        None => NominalMotor::default(),
    };
    // Before the motor turns: a full disk or a wrong folder shall not cost a recording.
    write(&arguments.out, "")?;
    let stopped = on_interrupt()?;
    let mut live = arguments.live.open()?;
    let (mut link, _) = arguments.port.open()?;
    let (settings, played) = prepare(&mut link, arguments)?;
    let kind = arguments.sequence.kind();
    let ticks = duration_ticks(kind, arguments.period, arguments.count, &settings);
    let mut coverage = Coverage::new(&settings);
    let bar = bar(ticks.into());
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {percent} % {elapsed}\n{msg}").expect("a constant that is right"),
    );
    let done = record(&mut link, settings, &played.order(), &|| stopped.load(Ordering::Relaxed), &mut |came| {
        bar.inc(came.len() as u64);
        coverage.add(came);
        bar.set_message(coverage.covered().to_string());
        send(&mut live, came, &settings);
    });
    bar.finish_and_clear();
    let side = write_all(arguments, &done, &link.firmware, &played, nominal)?;
    if arguments.json {
        print!("{side}");
        return ended(&done.ended, &arguments.out);
    }
    report(arguments, &done)
}

/// Sends samples on to plotters, and no more of them once that fails: a plotter shall not cost a recording.
fn send(live: &mut Option<Live>, samples: &[Sample], settings: &Settings) {
    if let Some(Err(error)) = live.as_ref().map(|live| live.send_samples(samples, settings)) {
        eprintln!("nothing more is sent to the plotter: {error}");
        *live = None;
    }
}

/// Ctrl-C and a closed terminal no longer end the program; they set this.
pub(super) fn on_interrupt() -> Result<Arc<AtomicBool>, Failure> {
    let stopped = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stopped);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(Failure::machine)?;
    Ok(stopped)
}

/// A sequence as the board plays it.
#[derive(serde::Serialize)]
struct Played {
    time_s: f64,
    kind: &'static str,
    sequence: String,
    amplitude: f64,
    offset: f64,
    period_ms: u16,
    count: u16,
    seed: u16,
}

impl Played {
    /// For the console.
    fn order(&self) -> String {
        let Self { sequence, amplitude, offset, period_ms, count, seed, .. } = self;
        format!("sequence {sequence} {amplitude} {offset} {period_ms} {count} {seed}")
    }

    /// The recording as a scenario, without a motor: mode, what the settings have of their own, and this as its reference.
    fn scenario(&self, mode: &str, done: &Record) -> Result<String, Failure> {
        let defaults = Settings::defaults();
        let own = Param::ALL.iter().filter(|param| done.settings.get(**param) != defaults.get(**param));
        // The shortest decimals that say the number.
        let value = |param: &Param| done.settings.get(*param).to_string().parse::<f64>().map_err(Failure::machine);
        let settings =
            own.map(|param| Ok((link::name(*param), value(param)?))).collect::<Result<BTreeMap<_, _>, Failure>>()?;
        let ticks = done.samples.len() as f64 + f64::from(done.missing_ticks());
        let scenario = Course {
            duration_s: ticks / f64::from(done.settings.get(Param::TickRate)),
            mode,
            settings,
            reference: [self],
        };
        toml::to_string(&scenario).map_err(Failure::machine)
    }
}

/// What a scenario file has of a recording.
#[derive(serde::Serialize)]
struct Course<'a> {
    duration_s: f64,
    mode: &'a str,
    settings: BTreeMap<String, f64>,
    reference: [&'a Played; 1],
}

/// Settings, mode, armed; the settings as the board then has them and what to play.
fn prepare(link: &mut Link<Port>, arguments: &RecordArguments) -> Result<(Settings, Played), Failure> {
    link.command("disarm")?;
    for pair in &arguments.set {
        let (name, value) = pair.split_once('=').ok_or_else(|| {
            Failure::input(format!("--set {pair}: expected NAME=VALUE, for instance current_limit=0"))
        })?;
        link.command(&format!("set {name} {value}"))?;
    }
    let settings = link.settings()?;
    let amplitude =
        arguments.amplitude.unwrap_or_else(|| (8.0 * f64::from(settings.get(Param::SupplyVoltage))).round() / 10.0);
    let sequence = arguments.sequence.to_possible_value().expect("none is skipped").get_name().to_owned();
    link.command("arm")?;
    link.command(&format!("mode {}", arguments.mode))?;
    let RecordArguments { offset, period: period_ms, count, seed, .. } = *arguments;
    Ok((settings, Played { time_s: 0.0, kind: "sequence", sequence, amplitude, offset, period_ms, count, seed }))
}

pub(super) fn beside(out: &Path, extension: &str) -> PathBuf {
    out.with_extension(extension)
}

/// Writes the recording and what belongs beside it; the side file's text.
fn write_all(
    arguments: &RecordArguments,
    done: &Record,
    firmware: &str,
    played: &Played,
    nominal: NominalMotor,
) -> Result<String, Failure> {
    let side = write_recording(&arguments.out, done, nominal, &done.side_file(firmware, &played.order()))?;
    if !done.samples.is_empty() {
        write(&beside(&arguments.out, "scenario.toml"), &played.scenario(&arguments.mode, done)?)?;
    }
    Ok(side)
}

/// Writes a recording, rig and side file; the latter's text.
fn write_recording(
    out: &Path,
    done: &Record,
    nominal: NominalMotor,
    side: &serde_json::Value,
) -> Result<String, Failure> {
    write(out, &telemetry::recording("record", &done.samples, &done.settings).to_csv())?;
    let rig = toml::to_string(&telemetry::rig(&done.settings, nominal)).map_err(Failure::machine)?;
    write(&beside(out, "rig.toml"), &rig)?;
    let side = serde_json::to_string_pretty(side).map_err(Failure::machine)? + "\n";
    write(&beside(out, "json"), &side)?;
    Ok(side)
}

fn report(arguments: &RecordArguments, done: &Record) -> Result<(), Failure> {
    let out = arguments.out.display();
    let rate_hz = f64::from(done.settings.get(Param::TickRate));
    let seconds = done.samples.len() as f64 / rate_hz;
    let missing = done.missing_ticks();
    println!("{out}: {} samples, {seconds:.2} s, {missing} missing", done.samples.len());
    if done.losses != link::Losses::default() {
        println!(
            "on the line {} frames were lost and {} damaged: use a shorter cable or another USB port",
            done.losses.lost_frames, done.losses.damaged_frames
        );
    }
    if !done.samples.is_empty() {
        let covered = done.coverage();
        println!("{covered}");
        covered.lacks.iter().for_each(|Lack { what, remedy }| println!("  lacks {what}: {remedy}"));
    }
    ended(&done.ended, &arguments.out)?;
    let rig = beside(&arguments.out, "rig.toml");
    let (rig, scenario) = (rig.display(), beside(&arguments.out, "scenario.toml"));
    match arguments.mode.as_str() {
        "open" => println!("next: motorbench diagnose {out} --rig {rig}"),
        _ => {
            println!("next: motorbench validate {out} --scenario {} --rig {rig} --model MODEL.toml", scenario.display())
        }
    }
    Ok(())
}

/// An end before its time is a failure, with what was kept.
pub(super) fn ended(ended: &Ended, out: &Path) -> Result<(), Failure> {
    let out = out.display();
    match ended {
        Ended::Complete => Ok(()),
        Ended::Interrupted => Err(Failure::input(format!("stopped by hand; {out} holds what had come"))),
        Ended::Tripped(trip) => Err(Failure::input(format!(
            "the drive tripped ({trip}); {out} holds what had come. Clear the cause, then `clear`; for a recording limits can be raised with --set, for instance --set current_limit=0 --set trip_peak=2"
        ))),
        Ended::Failed(why) => Err(Failure::machine(format!("{why}; {out} holds what had come"))),
    }
}

/// Sends a file of console lines, as `motorbench design` writes them, and reads back what the board made of it.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench design --rig rig.toml --model model.toml --speed --bandwidth-Hz 10 --console gains.txt
  motorbench send gains.txt --save")]
pub struct SendArguments {
    #[command(flatten)]
    port: PortArguments,
    /// Lines of the console; empty lines and those that begin with # are left out. - reads the terminal.
    file: PathBuf,
    /// Keeps the settings in the board's EEPROM.
    #[arg(long)]
    save: bool,
    /// Prints what was sent as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs `send`.
///
/// # Errors
/// [`Failure`] at the first line the board refuses, or when a setting does not read back as it was sent.
pub fn run_send(arguments: &SendArguments) -> Result<(), Failure> {
    let text = if arguments.file == Path::new("-") {
        std::io::read_to_string(stdin().lock()).map_err(Failure::machine)?
    } else {
        std::fs::read_to_string(&arguments.file)
            .map_err(|error| Failure::input(format!("{}: {error}", arguments.file.display())))?
    };
    let (mut link, name) = arguments.port.open()?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut sent = 0;
    for (number, line) in lines.enumerate() {
        link.command(line)
            .map_err(|error| Failure::input(format!("{}, line {}: {error}", arguments.file.display(), number + 1)))?;
        sent += 1;
    }
    let checked = read_back(&mut link, &text)?;
    if arguments.save {
        link.save()?;
    }
    if arguments.json {
        let sent = serde_json::json!({
            "port": name, "lines": sent, "settings_read_back": checked, "saved": arguments.save
        });
        println!("{sent}");
        return Ok(());
    }
    println!(
        "{sent} lines sent to {name}, {checked} settings read back{}",
        if arguments.save { ", saved" } else { "" }
    );
    if !stdin().is_terminal() || arguments.save {
        return Ok(());
    }
    println!("they are lost at the next reset: --save keeps them");
    Ok(())
}

/// Compares every setting that was sent with what the board shows, to the three digits it prints.
fn read_back(link: &mut Link<Port>, text: &str) -> Result<usize, Failure> {
    let settings = link.settings()?;
    let mut checked = 0;
    for line in text.lines().filter_map(|line| line.trim().strip_prefix("set ")) {
        let words: Vec<&str> = line.split_whitespace().collect();
        for pair in words.chunks_exact(2) {
            let (Some(param), Ok(sent)) = (find(pair[0].as_bytes()), pair[1].parse::<f32>()) else { continue };
            let shown = settings.get(param);
            if (shown - sent).abs() > 2e-3 * sent.abs().max(1e-3) {
                return Err(Failure::input(format!("{} reads back as {shown} instead of {sent}", pair[0])));
            }
            checked += 1;
        }
    }
    Ok(checked)
}

/// The tuning console: live traces, gains and reference under the fingers, step tests with figures before and after.
#[derive(Args)]
#[command(after_help = "Keys: a arm, space stop, s step test, up/down choose a gain, left/right 10 % less or more,
-/+ reference, tab PID or LQR, u undo, w save on the board, r begin and end a recording (every sample at the
board's time), q quit. Without this program the drive stops by itself after half a second.

Example:
  motorbench tune --reference 60")]
pub struct TuneArguments {
    #[command(flatten)]
    port: PortArguments,
    /// Speed that a step test goes to, in rad/s.
    #[arg(long, default_value_t = 40.0, allow_negative_numbers = true)]
    reference: f64,
    /// Where recordings go, with rig and side file; those after the first get a number.
    #[arg(long, default_value = "tune.csv")]
    out: PathBuf,
    #[command(flatten)]
    live: LiveArguments,
}

/// Numbered recordings of a tuning session.
struct Numbered {
    out: PathBuf,
    kept: u32,
}

impl Keeper for Numbered {
    fn keep(&mut self, record: &Record, before: &Settings, firmware: &str) -> String {
        self.kept += 1;
        let out = match self.kept {
            1 => self.out.clone(),
            number => beside(&self.out, &format!("{number}.csv")),
        };
        let mut side = record.side_file(firmware, "by hand, in motorbench tune");
        side["settings_before"] = by_name(before).into();
        match write_recording(&out, record, NominalMotor::default(), &side) {
            Ok(_) => format!("{}: {} samples, {} missing", out.display(), record.samples.len(), record.missing_ticks()),
            Err(failure) => format!("not kept: {}", failure.message),
        }
    }
}

/// Runs `tune`.
///
/// # Errors
/// [`Failure`] when the board is gone, or when there is no terminal.
pub fn run_tune(arguments: &TuneArguments) -> Result<(), Failure> {
    if !std::io::stdout().is_terminal() {
        return Err(Failure::machine("tune needs a terminal; for programs: `motorbench connect`, `send` and `record`"));
    }
    let stopped = on_interrupt()?;
    let live = arguments.live.open()?;
    let (link, _) = arguments.port.open()?;
    let keeper = Numbered { out: arguments.out.clone(), kept: 0 };
    let session = Session::new(link, arguments.reference, live, Box::new(keeper))?;
    screen::run(session, &|| stopped.load(Ordering::Relaxed)).map_err(Failure::from)
}

//! `motorbench ports`, `motorbench record`, `motorbench send`, and functions that all commands for a board share.

use super::files::{beside, free_name, is_terminal, with_beside};
use super::live::LiveArguments;
use super::{Failure, JSON_TO, Outputs, TERMINAL, bar, cannot_write, read_rig, tell, write, write_json};
use clap::{Args, ValueEnum};
use host_sim::scenario::sequence::SequenceOrder;
use indicatif::ProgressStyle;
use motorbench_core::excitation::Kind;
use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings, find};
use motorbench_data::names::setting_name;
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry;
use motorbench_files::text_file;
use motorbench_link::board::{Board, BoardError, LOST_AFTER_MS, arm, leave_host, limit, watch_host};
use motorbench_link::coverage::{Coverage, Lack};
use motorbench_link::growing::GrowingCsv;
use motorbench_link::live::Live;
use motorbench_link::port::{Port, only_board, open, ports};
use motorbench_link::record::{Ended, Record, is_played, record, side_file_of_running};
use motorbench_link::{self, Link, Losses, OTHER_READER};
use motorbench_text::keys;
use motorbench_text::terminal_text::quoted;
use std::collections::BTreeMap;
use std::io::{BufRead, IsTerminal, stdin};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, LazyLock};

impl From<BoardError> for Failure {
    fn from(error: BoardError) -> Self {
        match error {
            BoardError::Silent { .. } | BoardError::NoTelemetry => Self::machine(format!("{error}; {OTHER_READER}")),
            BoardError::Failed(_) => Self::machine(error),
            BoardError::Refused { .. } | BoardError::Tripped(_) | BoardError::Interrupted => Self::input(error),
        }
    }
}

/// The port of a board.
#[derive(Args)]
pub struct PortArguments {
    /// Port of the board, for instance /dev/ttyACM0 or COM3; without it the only board on USB, or else the virtual one.
    #[arg(long)]
    port: Option<String>,
}

/// Beginning of hints about `connect`, and about other programs at the port: the code that makes hints does not know
/// the port.
const CONNECT: &str = "`motorbench connect";
const LSOF: &str = "`lsof PORT`";

impl PortArguments {
    /// A text whose hints contain the port, if the user named one.
    pub(super) fn named_in(&self, text: &str) -> String {
        match &self.port {
            Some(port) => {
                let port = quoted(port);
                text.replace(CONNECT, &format!("{CONNECT} --port {port}")).replace(LSOF, &format!("`lsof {port}`"))
            }
            None => text.into(),
        }
    }

    /// A failure with such a text.
    pub(super) fn failure(&self, failure: Failure) -> Failure {
        Failure { message: self.named_in(&failure.message), ..failure }
    }

    pub(super) fn open(&self) -> Result<(Link<Port>, String), Failure> {
        let name = match &self.port {
            Some(name) => name.clone(),
            None => only_board().map_err(Failure::machine)?,
        };
        let mut link = open(&name, Arc::clone(&STOPPED))?;
        take_back_watch(&mut link)?;
        Ok((link, name))
    }

    /// The same for a motor that will be driven; returns the settings of the board, and reports protections that are
    /// off or weaker.
    pub(super) fn open_to_drive(&self) -> Result<(Link<Port>, String, Settings), Failure> {
        let (mut link, name) = self.open()?;
        let settings = link.settings()?;
        if let Some(lifted) = lifted_protections(&settings) {
            let remedy =
                format!("{CONNECT} load` restores the saved settings, {CONNECT} defaults` the factory settings");
            tell(&self.named_in(&format!("{lifted}; {remedy}")));
        }
        Ok((link, name, settings))
    }
}

/// Settings that protect motor and bridge. Greater values protect less, except for the lowest supply.
const PROTECTIONS: [Param; 8] = [
    Param::CurrentLimit,
    Param::TripPeak,
    Param::TripContinuous,
    Param::TripStall,
    Param::TripEncoder,
    Param::TripRunaway,
    Param::TripSupplyLow,
    Param::TripSupplyHigh,
];

/// Protections that are off, or weaker than the firmware's defaults: they were saved so, or a killed `record --set`
/// left them.
pub(super) fn lifted_protections(settings: &Settings) -> Option<String> {
    let usual = Settings::defaults();
    let lifted = PROTECTIONS.iter().filter_map(|&param| {
        let (is, was, name) = (settings.get(param), usual.get(param), setting_name(param));
        match param {
            Param::TripSupplyLow if is < was => Some(format!("{name} {is}, usually {was}")),
            Param::TripSupplyLow => None,
            _ if is == 0.0 && was > 0.0 => Some(format!("{name} off, usually {was}")),
            _ => (is > was).then(|| format!("{name} {is}, usually {was}")),
        }
    });
    let lifted: Vec<String> = lifted.collect();
    (!lifted.is_empty()).then(|| format!("protections are lifted: {}", lifted.join("; ")))
}

/// Switches off the motor, and then the `trip_host` that a killed program left. Otherwise it would pass for the board's
/// own setting, and nobody would stop a motor that still turns.
fn take_back_watch(link: &mut Link<Port>) -> Result<(), BoardError> {
    if link.shows("trip_host")? != Some(LOST_AFTER_MS) {
        return Ok(());
    }
    link.command("disarm")?;
    link.command("set trip_host 0")?;
    tell(&format!(
        "a program that was killed had left trip_host at {LOST_AFTER_MS} ms; it is 0 again, and the drive is off"
    ));
    Ok(())
}

/// Lists the serial ports and says which are boards.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench ports --json")]
pub struct PortsArguments {
    /// One JSON list for programs.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs `ports`.
///
/// # Errors
/// If the system does not list its ports.
pub fn list(arguments: &PortsArguments) -> Result<(), Failure> {
    let outputs = Outputs::new([], &arguments.json)?;
    let found = ports().map_err(Failure::machine)?;
    if let Some(path) = &arguments.json {
        write_json(path, &found)?;
    }
    if found.is_empty() {
        outputs.say("no serial port found; without a board: motorbench virtual\n");
    }
    for port in found {
        outputs.say(&format!("{:24} {}{}\n", port.port, if port.board { "board: " } else { "" }, port.what));
    }
    Ok(())
}

/// The lines from the terminal or a pipe. Reading blocks, so it runs in a thread beside Ctrl-C and the board.
pub(super) fn typed_lines() -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let lines = stdin().lock().split(b'\n').map_while(Result::ok);
        lines
            .map(|line| String::from_utf8_lossy(line.trim_ascii_end()).into_owned())
            .try_for_each(|line| sender.send(line))
    });
    receiver
}

/// Default duration of a random excitation.
const RANDOM_MS: u16 = 10_000;

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

    /// Default number of repetitions: random ones for [`RANDOM_MS`].
    fn usual_count(self, period_ms: u16) -> u16 {
        match self {
            Self::Prbs | Self::Levels => RANDOM_MS.div_ceil(period_ms),
            _ => 1,
        }
    }
}

/// The mode in which the excitation is the voltage.
const OPEN: &str = "open";

/// Plays an excitation on a board and records it at full rate, with rig file and side file.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench record
  motorbench record --out motor_a.csv
  motorbench record --sequence steps --amplitude 6 --period 800 --count 4
  motorbench record --mode speed --sequence levels --amplitude 80 --out loop.csv
  motorbench record --live plotjuggler --live teleplot=192.168.1.20:47269

Without --sequence it plays identify, the 20 s that separate the most causes.
Beside run.csv, or the name of --out, it writes run.rig.toml for motorbench
diagnose, run.scenario.toml for validate, and run.json with firmware, settings
and losses. Ctrl-C stops the motor and keeps the samples that have arrived.")]
pub struct RecordArguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Excitation to play.
    #[arg(long, value_enum, default_value = "identify")]
    sequence: Excitation,
    /// Amplitude in the unit of the mode; default: 80 % of the supply.
    #[arg(long, allow_negative_numbers = true, value_parser = finite)]
    amplitude: Option<f64>,
    /// Offset in the unit of the mode.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    offset: f64,
    /// How long one part lasts, in ms.
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u16).range(1..))]
    period: u16,
    /// Number of repetitions; default: once, or as many random levels or bits as fill 10 s.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    count: Option<u16>,
    /// Seed of random excitations.
    #[arg(long, default_value_t = 1)]
    seed: u16,
    /// Control mode: open plays a voltage, the others a reference.
    #[arg(long, default_value = OPEN, value_parser = [OPEN, "speed", "position", "lqr_speed", "lqr_position"])]
    mode: String,
    /// Setting for this recording alone: NAME=VALUE. In mode open, slew_limit is at most 500 unless it is set here.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, f64)>,
    /// A rig file whose nominal constants of the motor go into the new one.
    #[arg(long, value_name = "RIG.toml")]
    motor: Option<PathBuf>,
    /// Output .csv; default: the first free name of run.csv, run-2.csv, ....
    #[arg(long, value_parser = table_file)]
    out: Option<PathBuf>,
    #[command(flatten)]
    live: LiveArguments,
    /// Prints the side file instead of text.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// A number that the console takes.
pub(super) fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or("expected a number, for instance 6 or -2.5".into())
}

fn assignment(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(name, value)| Some((name, finite(value).ok()?)));
    let (name, value) = parts.ok_or("expected NAME=VALUE, for instance current_limit=0")?;
    if find(name.as_bytes()).is_none() {
        let known: Vec<String> = Param::ALL.iter().map(|param| setting_name(*param)).collect();
        let meant = keys::nearest(name, known.iter().map(String::as_str));
        return Err(format!(
            "{name}: no such setting{}; `motorbench connect show` lists them",
            keys::suggestion(meant)
        ));
    }
    Ok((name.into(), value))
}

/// Runs `record`.
///
/// # Errors
/// [`Failure`] if nothing could be recorded, or if the recording ended early; the samples that came are written.
pub fn run_record(arguments: &RecordArguments) -> Result<(), Failure> {
    let out = &arguments.out.clone().unwrap_or_else(|| free_name("run", &BESIDE));
    let outputs = Outputs::new(&arguments.motor, with_beside(out, &BESIDE).iter().chain(&arguments.json))?;
    let nominal = match &arguments.motor {
        Some(path) => read_rig(path)?.motor,
        None => NominalMotor::default(),
    };
    // Before the motor turns: a wrong folder must not cost a recording.
    let mut growing = GrowingCsv::new(out).map_err(|error| cannot_write(out, &error))?;
    let stopped = on_interrupt()?;
    let mut live = arguments.live.open()?;
    let (mut link, _, before) = arguments.port.open_to_drive()?;
    let changed = arguments.changes(&before);
    let stop = || stopped.load(Ordering::Relaxed);
    let done = play((arguments, out), &changed, &mut link, nominal, &mut growing, &mut live, &stop);
    let put_back = put_back(&mut link, &before, &changed);
    let finished = done.and_then(|(mut done, played)| {
        // Messages on a recording name its file.
        done.samples.truncate(growing.rows());
        let not_put_back = put_back.as_ref().err().map(|failure| arguments.port.named_in(&failure.message));
        finish((arguments, out, &outputs), &done, (&link.firmware, not_put_back.as_deref()), &played, nominal)
    });
    if let (Err(_), Err(kept)) = (&finished, &put_back) {
        tell(&arguments.port.named_in(&format!("motorbench: {}", kept.message)));
    }
    finished.and(put_back)
}

/// The files beside a recording.
const BESIDE: [&str; 3] = ["scenario.toml", "rig.toml", "json"];

impl RecordArguments {
    /// Settings changed for this recording: those of the user, and the slew limit in open loop. A loop's slew limit
    /// would let an excitation reverse the motor faster than the current limit can react.
    fn changes(&self, before: &Settings) -> Vec<(String, f64)> {
        let slew_limit = Settings::defaults().get(Param::SlewLimit);
        let is_said = self.set.iter().any(|(name, _)| find(name.as_bytes()) == Some(Param::SlewLimit));
        let is_slower = self.mode == OPEN && !is_said && before.get(Param::SlewLimit) > slew_limit;
        let slower = is_slower.then(|| (setting_name(Param::SlewLimit), slew_limit.into()));
        self.set.iter().cloned().chain(slower).collect()
    }
}

/// Prepares the board, plays and records; returns the samples and the played sequence.
fn play(
    (arguments, out): (&RecordArguments, &Path),
    changed: &[(String, f64)],
    link: &mut Link<Port>,
    nominal: NominalMotor,
    growing: &mut GrowingCsv,
    live: &mut Option<Live>,
    stop: &dyn Fn() -> bool,
) -> Result<(Record, Played), Failure> {
    let (settings, played) = prepare(link, arguments, changed)?;
    let ticks = played.order.duration_ticks(&settings).map_err(Failure::input)?;
    let mut side = side_file_of_running(&settings, &link.firmware, &played.order.line());
    side["file"] = out.display().to_string().into();
    let files = files_beside((arguments, out), &settings, nominal, &played, ticks.into(), &side)?;
    let mut coverage = Coverage::new(&settings);
    let bar = bar(ticks.into());
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {percent} % {elapsed}\n{msg}").expect("a constant that is right"),
    );
    let mut done = record(link, settings, &played.order.line(), stop, &mut |came| {
        bar.inc(came.len() as u64);
        coverage.add(came);
        bar.set_message(coverage.covered().to_string());
        send(live, came, &settings);
        if growing.rows() == 0 && !came.is_empty() {
            write_first(&files)?;
        }
        growing.add(came, &settings).map_err(|error| cannot_grow(out, &error))
    });
    bar.finish_and_clear();
    if !played.agrees(&done) {
        done.ended = Ended::Failed(
            "the board played another sequence than it was sent: the line damages data. Use a shorter cable or another USB port".into(),
        );
    }
    Ok((done, played))
}

/// Restores the settings that were changed for a recording, the last first: later ones may depend on earlier ones.
///
/// # Errors
/// [`Failure`] if the board keeps changed settings. A board that is gone has lost them with its supply.
fn put_back(link: &mut Link<Port>, before: &Settings, changed: &[(String, f64)]) -> Result<(), Failure> {
    let mut known = changed.iter().rev().filter_map(|(name, _)| Some((name, find(name.as_bytes())?)));
    let done = leave_host(link, before)
        .and_then(|()| known.try_for_each(|(name, param)| link.command(&format!("set {name} {}", before.get(param)))));
    match done {
        Err(error) if !link.is_gone() => Err(Failure::machine(format!(
            "{error}; the changed settings and trip_host stay until the board is reset{}",
            named(changed)
        ))),
        _ => Ok(()),
    }
}

/// The changed settings in brackets; empty if there are none.
fn named(changed: &[(String, f64)]) -> String {
    match changed {
        [] => String::new(),
        changed => format!(" ({})", changed.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")),
    }
}

/// Advice on a file that cannot be written while the motor turns.
const OTHER_FILE: &str = "--out names another file";

pub(super) fn cannot_grow(path: &Path, error: &std::io::Error) -> String {
    format!("{}; {OTHER_FILE}", cannot_write(path, error).message)
}

/// Writes the files beside the recording and reports how it ended.
fn finish(
    (arguments, out, outputs): (&RecordArguments, &Path, &Outputs),
    done: &Record,
    (firmware, not_put_back): (&str, Option<&str>),
    played: &Played,
    nominal: NominalMotor,
) -> Result<(), Failure> {
    let kept = done.samples.len();
    let mut side = done.side_file(firmware, &played.order.line());
    side["file"] = out.display().to_string().into();
    if let Some(why) = not_put_back {
        side["not_put_back"] = why.into();
    }
    let ticks = done.samples.len() as f64 + f64::from(done.missing_ticks());
    // The files of an earlier recording stay if no samples came.
    let written = match kept {
        0 => Ok(()),
        _ => write_each(&files_beside((arguments, out), &done.settings, nominal, played, ticks, &side)?),
    };
    if let Some(path) = &arguments.json {
        write_json(path, &side)?;
    }
    if kept > 0 {
        outputs.say(&report((arguments, out), done));
    }
    let ended = ended(&done.ended, kept, out).map_err(|failure| with_limit(failure, &done.ended));
    both(ended, written)?;
    outputs.say(&next(arguments, out));
    Ok(())
}

/// The end of a recording, and the files that can no longer be written.
fn both(ended: Result<(), Failure>, written: Result<(), Unwritten>) -> Result<(), Failure> {
    let Err(unwritten) = written else { return ended };
    Err(match ended {
        Ok(()) => Failure::machine(unwritten.beside("")),
        Err(failure) => {
            Failure { message: format!("{}; {}", failure.message, unwritten.beside(&failure.message)), ..failure }
        }
    })
}

/// Advice of `record` on a trip with a limit.
fn with_limit(failure: Failure, ended: &Ended) -> Failure {
    let Ended::Tripped(trip) = ended else { return failure };
    match limit(*trip) {
        Some(limit) => Failure {
            message: format!("{}. --set {limit}=VALUE changes its limit for one recording", failure.message),
            ..failure
        },
        None => failure,
    }
}

/// Sends samples to plotters until that fails once: a plotter must not cost a recording.
fn send(live: &mut Option<Live>, samples: &[Sample], settings: &Settings) {
    if let Some(Err(error)) = live.as_ref().map(|live| live.send_samples(samples, settings)) {
        eprintln!("sending to the plotter has stopped: {error}");
        *live = None;
    }
}

/// Set by Ctrl-C and a closed terminal, after [`on_interrupt`].
static STOPPED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Makes Ctrl-C and a closed terminal set this flag instead of ending the program; an opened link watches it as well.
pub(super) fn on_interrupt() -> Result<Arc<AtomicBool>, Failure> {
    ctrlc::set_handler(|| STOPPED.store(true, Ordering::Relaxed)).map_err(Failure::machine)?;
    Ok(Arc::clone(&STOPPED))
}

/// A sequence as the board plays it.
#[derive(serde::Serialize)]
struct Played {
    time_s: f64,
    kind: &'static str,
    #[serde(flatten)]
    order: SequenceOrder,
}

impl Played {
    /// Whether a whole recording is of this.
    fn agrees(&self, done: &Record) -> bool {
        let Some(first) = done.samples.first().filter(|_| done.ended == Ended::Complete) else { return true };
        let sequence = self.order.of_core(first.state.mode(), &done.settings);
        sequence.is_ok_and(|sequence| is_played(&done.samples, &sequence))
    }

    /// The recording as a scenario, without a motor: mode, settings that differ from the defaults, and this sequence as
    /// its reference.
    fn scenario(&self, mode: &str, settings: &Settings, ticks: f64) -> Result<String, Failure> {
        let defaults = Settings::defaults();
        let own = Param::ALL.iter().filter(|param| settings.get(**param) != defaults.get(**param));
        // The shortest decimals of the number.
        let value = |param: &Param| settings.get(*param).to_string().parse::<f64>().map_err(Failure::machine);
        let own =
            own.map(|param| Ok((setting_name(*param), value(param)?))).collect::<Result<BTreeMap<_, _>, Failure>>()?;
        let duration_s = ticks / f64::from(settings.get(Param::TickRate));
        let scenario = Course { duration_s, mode, settings: own, reference: [self] };
        toml::to_string(&scenario).map_err(Failure::machine)
    }
}

/// A scenario file of a recording.
#[derive(serde::Serialize)]
struct Course<'a> {
    duration_s: f64,
    mode: &'a str,
    settings: BTreeMap<String, f64>,
    reference: [&'a Played; 1],
}

/// Applies settings and mode and arms; returns the settings of the board and the sequence.
fn prepare(
    link: &mut Link<Port>,
    arguments: &RecordArguments,
    changed: &[(String, f64)],
) -> Result<(Settings, Played), Failure> {
    link.command("disarm")?;
    for (name, value) in changed {
        link.command(&format!("set {name} {value}"))?;
    }
    let settings = link.settings()?;
    for (name, value) in changed {
        reads_back(&settings, name, *value as f32)?;
    }
    // Off if the user says so.
    if !arguments.set.iter().any(|(name, _)| find(name.as_bytes()) == Some(Param::TripHost)) {
        watch_host(link, &settings)?;
    }
    let amplitude =
        arguments.amplitude.unwrap_or_else(|| (8.0 * f64::from(settings.get(Param::SupplyVoltage))).round() / 10.0);
    arm(link)?;
    link.command(&format!("mode {}", arguments.mode))?;
    let RecordArguments { offset, period: period_ms, seed, .. } = *arguments;
    let count = arguments.count.unwrap_or_else(|| arguments.sequence.usual_count(period_ms));
    let order = SequenceOrder { kind: arguments.sequence.kind(), amplitude, offset, period_ms, count, seed };
    Ok((settings, Played { time_s: 0.0, kind: "sequence", order }))
}

/// A measured table (.csv): its other files have its name and other endings.
pub(super) fn table_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv")) {
        return Ok(path);
    }
    Err(format!(
        "expected a name that ends in .csv, for instance {}; `motorbench convert` makes other formats of it",
        path.with_extension("csv").display()
    ))
}

/// What belongs beside a recording of so many ticks.
fn files_beside(
    (arguments, out): (&RecordArguments, &Path),
    settings: &Settings,
    nominal: NominalMotor,
    played: &Played,
    ticks: f64,
    side: &serde_json::Value,
) -> Result<Vec<(PathBuf, String)>, Failure> {
    let scenario = (beside(out, "scenario.toml"), played.scenario(&arguments.mode, settings, ticks)?);
    // The side file last: it says that the others are there.
    Ok([scenario].into_iter().chain(rig_and_side(out, settings, nominal, side)?).collect())
}

fn pretty(side: &serde_json::Value) -> Result<String, Failure> {
    Ok(serde_json::to_string_pretty(side).map_err(Failure::machine)? + "\n")
}

/// Rig and side file of a recording.
pub(super) fn rig_and_side(
    out: &Path,
    settings: &Settings,
    nominal: NominalMotor,
    side: &serde_json::Value,
) -> Result<Vec<(PathBuf, String)>, Failure> {
    let rig = toml::to_string(&telemetry::rig(settings, nominal)).map_err(Failure::machine)?;
    Ok(vec![(beside(out, "rig.toml"), rig), (beside(out, "json"), pretty(side)?)])
}

/// Files that could not be written, by reason.
pub(super) struct Unwritten(BTreeMap<String, Vec<String>>);

impl Unwritten {
    /// Each reason with its files; of one that was `said` already only these.
    fn named(&self, said: &str) -> String {
        let why = |why: &str| if said.contains(why) { String::new() } else { why.to_owned() };
        self.0.iter().map(|(reason, names)| names.join(", ") + &why(reason)).collect::<Vec<_>>().join("; ")
    }

    /// Of those beside a recording that is over.
    pub(super) fn beside(&self, said: &str) -> String {
        format!("beside it stands what was written at its beginning: {}", self.named(said))
    }
}

/// Writes all files, even if one of them fails.
pub(super) fn write_each(files: &[(PathBuf, String)]) -> Result<(), Unwritten> {
    let mut failed: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (path, text) in files {
        let name = path.display().to_string();
        if let Err(failure) = write(path, text) {
            let why = failure.message.trim_start_matches(&name).to_owned();
            failed.entry(why).or_default().push(name);
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(Unwritten(failed)) }
}

/// The end of a recording adds at most this to the files beside it; the disk may be full by then.
const ROOM: usize = 2048;

/// Writes the files beside a recording before its first row: those of an earlier recording would not match its rows.
/// Each reserves room for its final content.
pub(super) fn write_first(files: &[(PathBuf, String)]) -> Result<(), String> {
    let with_room = files.iter().map(|(path, text)| (path.clone(), format!("{text}{:ROOM$}\n", "")));
    write_each(&with_room.collect::<Vec<_>>()).map_err(|unwritten| format!("{}; {OTHER_FILE}", unwritten.named("")))
}

fn report((arguments, out): (&RecordArguments, &Path), done: &Record) -> String {
    let out = out.display();
    let rate_hz = f64::from(done.settings.get(Param::TickRate));
    let missing = done.missing_ticks();
    let seconds = (done.samples.len() as f64 + f64::from(missing)) / rate_hz;
    let mut text = format!("{out}: {} samples, {seconds:.2} s, {missing} missing\n", done.samples.len());
    if done.losses != Losses::default() {
        let Losses { lost_frames, damaged_frames } = done.losses;
        text += &format!("{lost_frames} frames were lost on the line, {damaged_frames} of them damaged:\n");
        text += "use a shorter cable, another USB port, no hub; or the computer was too busy; or\n";
        text += &format!("{}\n", arguments.port.named_in(OTHER_READER));
    }
    let covered = done.coverage();
    text += &format!("{covered}\n");
    covered.lacks.iter().for_each(|Lack { what, remedy }| text += &format!("  lacks {what}: {remedy}\n"));
    text
}

/// The next commands for the user.
fn next(arguments: &RecordArguments, out: &Path) -> String {
    let [out, rig, scenario] =
        [out, &beside(out, "rig.toml"), &beside(out, "scenario.toml")].map(|path| quoted(&path.to_string_lossy()));
    match arguments.mode.as_str() {
        OPEN => format!("next: motorbench diagnose {out} --rig {rig}\n"),
        _ => format!("next: motorbench validate {out} --scenario {scenario} \\\n  --rig {rig} --model MODEL.toml\n"),
    }
}

/// An early end is a failure that says what was kept.
pub(super) fn ended(ended: &Ended, kept: usize, out: &Path) -> Result<(), Failure> {
    let kept = match kept {
        0 => "nothing of it is kept".to_string(),
        _ => format!("{} holds what had come", out.display()),
    };
    match ended {
        Ended::Complete => Ok(()),
        Ended::Interrupted => Err(Failure::input(format!("stopped by hand; {kept}"))),
        Ended::Tripped(trip) => Err(Failure::input(format!("{}; {kept}", BoardError::Tripped(*trip)))),
        Ended::Refused(why) => Err(Failure::input(why)),
        Ended::Failed(why) => Err(Failure::machine(format!("{why}; {kept}"))),
    }
}

/// Sends a file of console lines, as `motorbench design` writes them, and reads the settings back.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench design --rig rig.toml --speed --bandwidth-Hz 10 --console gains.txt
  motorbench send gains.txt --save")]
pub struct SendArguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Lines of the console; empty lines and those that begin with # are left out. - reads the terminal.
    file: PathBuf,
    /// Keeps the settings in the board's EEPROM.
    #[arg(long)]
    save: bool,
    /// Prints what was sent as JSON.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs `send`.
///
/// # Errors
/// [`Failure`] at the first line the board refuses, or when a setting does not read back as it was sent.
pub fn run_send(arguments: &SendArguments) -> Result<(), Failure> {
    let outputs = Outputs::new([&arguments.file].into_iter().filter(|file| !is_terminal(file)), &arguments.json)?;
    let text = if is_terminal(&arguments.file) {
        std::io::read_to_string(stdin().lock()).map_err(Failure::machine)?
    } else {
        text_file::read(&arguments.file, "a file of lines for the console")
            .map_err(|error| Failure::input(format!("{}: {error}", arguments.file.display())))?
    };
    let lines = console_lines(&text);
    if lines.is_empty() {
        let file = arguments.file.display();
        return Err(Failure::input(format!("{file} has no console line, such as `set speed_kp 0.05`")));
    }
    let (mut link, name) = arguments.port.open()?;
    let obeyed = lines.len();
    let checked = send_lines(&mut link, &lines)
        .and_then(|()| read_back(&mut link, lines.iter().map(|(line, _)| *line)).map_err(|why| Unsent { obeyed, why }))
        .map_err(|unsent| unsent.failure(arguments, &name, &lines))?;
    if arguments.save {
        link.save()?;
    }
    let sent = lines.len();
    if let Some(path) = &arguments.json {
        let sent = serde_json::json!({
            "port": name, "lines": sent, "settings_read_back": checked, "saved": arguments.save
        });
        write_json(path, &sent)?;
    }
    let confirmed = match checked {
        0 => "each answered by ok; no setting is among them".into(),
        1 => "1 setting read back".into(),
        checked => format!("{checked} settings read back"),
    };
    let lines_sent = if sent == 1 { "1 line".into() } else { format!("{sent} lines") };
    outputs.say(&format!("{lines_sent} sent to {name}, {confirmed}{}\n", if arguments.save { ", saved" } else { "" }));
    if lines.iter().any(|(line, _)| *line == "arm") {
        outputs.say("the drive is off again; only `connect`, `tune` and `record` keep it on\n");
    }
    if checked > 0 && stdin().is_terminal() && !arguments.save {
        outputs.say("they are lost at the next reset; --save keeps them\n");
    }
    Ok(())
}

/// Why not all lines of a file were accepted.
struct Unsent {
    /// Number of lines that were accepted before.
    obeyed: usize,
    why: Failure,
}

impl Unsent {
    /// As text and as JSON, with the present settings of the board.
    fn failure(self, arguments: &SendArguments, port: &str, lines: &[(&str, u32)]) -> Failure {
        let (done, left) = lines.split_at(self.obeyed);
        let place = left.first().map_or(String::new(), |(_, number)| format!(", line {number}"));
        let why = format!("{}{place}: {}", arguments.file.display(), self.why.message);
        if let Some(path) = &arguments.json {
            let texts = |lines: &[(&str, u32)]| lines.iter().map(|(line, _)| (*line).to_owned()).collect::<Vec<_>>();
            let sent = serde_json::json!({
                "port": port, "lines": done.len(), "done": texts(done), "not_done": texts(left), "saved": false, "error": why
            });
            if let Err(unwritten) = write_json(path, &sent) {
                tell(&format!("motorbench: {}", unwritten.message));
            }
        }
        Failure { message: format!("{why}; {}", told(done, left)), ..self.why }
    }
}

/// The lines of a file that were done, and those that were not.
fn told(done: &[(&str, u32)], left: &[(&str, u32)]) -> String {
    let names = |lines: &[(&str, u32)]| match lines {
        [(_, only)] => format!("line {only}"),
        [(_, first), .., (_, last)] => format!("lines {first} to {last}"),
        [] => "none".into(),
    };
    match (done, left) {
        ([], _) => "nothing of the file was done".into(),
        (done, []) => format!("done: {}", names(done)),
        (done, left) => {
            format!("done: {}; not done: {}; {CONNECT} load` restores the saved settings", names(done), names(left))
        }
    }
}

/// Sends the lines one after the other.
fn send_lines(board: &mut impl Board, lines: &[(&str, u32)]) -> Result<(), Unsent> {
    for (obeyed, (line, _)) in lines.iter().enumerate() {
        board.command(line).map_err(|error| Unsent { obeyed, why: error.into() })?;
    }
    Ok(())
}

/// What a file has for the console, with the numbers of its lines.
fn console_lines(text: &str) -> Vec<(&str, u32)> {
    let lines = text
        .lines()
        .zip(1..)
        .flat_map(|(line, number)| motorbench_link::lines(line).map(move |line| (line.trim(), number)));
    lines.filter(|(line, _)| !line.is_empty() && !line.starts_with('#')).collect()
}

/// A setting is held as it was read, and printed in six digits. The firmware reads within 3e-6 of what was sent and prints within
/// 1.2e-5 of what it holds, as the tests of its console's numbers have it; what differs more was damaged on its way.
const READ_BACK_SHARE: f32 = 2e-5;

/// Commands to the board have no check sum.
fn reads_back(settings: &Settings, name: &str, sent: f32) -> Result<(), Failure> {
    let shown = find(name.as_bytes()).map(|param| settings.get(param));
    match shown.filter(|shown| (shown - sent).abs() > READ_BACK_SHARE * sent.abs()) {
        Some(shown) => Err(Failure::input(format!("{name} reads back as {shown} instead of {sent}"))),
        None => Ok(()),
    }
}

/// Compares every setting that was sent with what the board shows.
fn read_back<'a>(link: &mut Link<Port>, lines: impl Iterator<Item = &'a str>) -> Result<usize, Failure> {
    let settings = link.settings()?;
    let mut checked = 0;
    for line in lines.filter_map(|line| line.strip_prefix("set ")) {
        let words: Vec<&str> = line.split_whitespace().collect();
        for pair in words.chunks_exact(2) {
            let Ok(sent) = pair[1].parse::<f32>() else { continue };
            reads_back(&settings, pair[0], sent)?;
            checked += 1;
        }
    }
    Ok(checked)
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_core::console::number;

    #[test]
    fn random_levels_are_enough_when_nobody_says_how_many() {
        let parts =
            [(Excitation::Levels, 500), (Excitation::Prbs, 60), (Excitation::Levels, 60_000), (Excitation::Steps, 500)];
        assert_eq!(parts.map(|(excitation, period_ms)| excitation.usual_count(period_ms)), [20, 167, 1, 1]);
    }

    #[test]
    fn lifted_protections_are_named() {
        let mut settings = Settings::defaults();
        assert_eq!(lifted_protections(&settings), None);
        for (param, value) in [(Param::TripPeak, 0.5), (Param::TripSupplyLow, 9.0)] {
            settings.set(param, value).unwrap();
        }
        assert_eq!(lifted_protections(&settings), None, "they protect more");
        for (param, value) in [(Param::TripPeak, 5.0), (Param::CurrentLimit, 0.0), (Param::TripSupplyLow, 0.0)] {
            settings.set(param, value).unwrap();
        }
        let lifted = lifted_protections(&settings).unwrap();
        let expected = "protections are lifted: current_limit off, usually 1; trip_peak 5, usually 1.2; trip_supply_low 0, usually 5";
        assert_eq!(lifted, expected);
    }

    #[test]
    fn a_full_disk_is_said_once() {
        let why = ": no space: make room on the disk";
        let unwritten = || Unwritten([(why.to_owned(), vec!["run.json".to_owned()])].into());
        let ended = Failure::machine(format!("run.csv{why}; run.csv holds what had come"));
        let told = both(Err(ended), Err(unwritten())).unwrap_err().message;
        assert!(told.matches("make room").count() == 1 && told.ends_with("at its beginning: run.json"), "{told}");
        let told = both(Ok(()), Err(unwritten())).unwrap_err().message;
        assert!(told.ends_with(&format!("run.json{why}")), "{told}");
    }

    /// Beside what the firmware makes of a number, one digit that is another.
    #[test]
    fn a_damaged_digit_does_not_read_back() {
        let mut settings = Settings::defaults();
        let mut reads = |param: Param, sent: &str, shown: f32| {
            settings.values[param as usize] = shown;
            reads_back(&settings, &setting_name(param), sent.parse().unwrap()).is_ok()
        };
        for sent in ["2000", "0.055108", "1.23456789", "-3.3333333", "2.2e-5", "987654.3", "0"] {
            let read = number::parse(sent.as_bytes()).unwrap();
            let printed = number::Decimal::of(read);
            let shown = std::str::from_utf8(printed.as_bytes()).unwrap().parse().unwrap();
            assert!(reads(Param::SpeedKp, sent, shown), "{sent} {shown}");
        }
        for (sent, shown) in
            [("2000", 2003.0), ("2000", 2000.1), ("0.055108", 0.055_118), ("2.2e-5", 2.3e-5), ("0", 1e-6)]
        {
            assert!(!reads(Param::CountsPerRev, sent, shown), "{sent} {shown}");
        }
    }

    /// A board whose answer to everything is this.
    struct Failing(BoardError);

    impl Board for Failing {
        fn command(&mut self, _line: &str) -> Result<(), BoardError> {
            Err(self.0.clone())
        }

        fn samples(&mut self, _duration_s: f64) -> Result<Vec<Sample>, BoardError> {
            Err(self.0.clone())
        }

        fn stay_alive(&mut self) -> Result<(), BoardError> {
            Err(self.0.clone())
        }
    }

    #[test]
    fn a_line_that_is_not_sent_for_the_cable_is_no_fault_of_the_file() {
        let line = String::from("set speed_kp 1");
        let refused = BoardError::Refused { line: line.clone(), reply: "error: out of range".into() };
        let ends = [(refused, 1), (BoardError::Silent { line }, 3), (BoardError::Failed("gone".into()), 3)];
        for (error, code) in ends {
            let unsent = send_lines(&mut Failing(error.clone()), &[("set speed_kp 1", 7)]).unwrap_err();
            assert_eq!((unsent.obeyed, unsent.why.code), (0, code), "{error}");
            assert!(unsent.why.message.starts_with(&error.to_string()), "{}", unsent.why.message);
        }
    }
}

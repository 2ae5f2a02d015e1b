//! `motorbench tune`: the tuning console, and a scripted session of it.

use super::files::{beside, free_name, is_terminal, say_written, with_beside};
use super::interaction::on_interrupt;
use super::live::LiveArguments;
use super::port::PortArguments;
use super::record::finite;
use super::recording_files::{cannot_grow, rig_and_side, table_file, write_each, write_first};
use super::{Failure, JSON_TO, Outputs, TERMINAL, tell, write_json};
use crate::tune::{Key, REFERENCE, RecordingStore, Session, StoredRecording, screen};
use clap::Args;
use motorbench_core::message::Sample;
use motorbench_core::settings::Settings;
use motorbench_data::rig::NominalMotor;
use motorbench_link::board::BoardError;
use motorbench_link::growing::GrowingCsv;
use motorbench_link::record::{Ended, Record, by_name, side_file_of_running};
use motorbench_text::terminal_text::quoted;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Tuning console: live traces, gains and reference to change by keys, step tests with figures before and after.
#[derive(Args)]
#[command(after_help = "Keys: a arm, space stop, s step test, up/down choose a gain, left/right 10 %
less or more, -/+ reference, tab PID or LQR, u undo, w save on the board,
r begin and end a recording (every sample at the board's time), q quit. Without
this program the drive stops by itself after half a second.

Examples:
  motorbench tune --reference 60
  motorbench tune --json session.json
  motorbench tune --keys 'a s right s w' --json -

--keys needs no terminal: each key is pressed when the one before has finished.
A step test takes two seconds, including the return to rest. Keys are written as
above, and space, tab, up, down, left, right. It ends with exit code 1 at the
first refused key or a trip, and with 3 where r cannot write.")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Speed that a step test goes to, in rad/s.
    #[arg(long, default_value_t = 40.0, allow_negative_numbers = true, value_parser = finite)]
    reference: f64,
    /// Recordings to write (.csv), with rig and side file; those after the first get a number. Default: the first free name of
    /// tune.csv, tune-2.csv, ...
    #[arg(long, value_parser = table_file)]
    out: Option<PathBuf>,
    #[command(flatten)]
    live: LiveArguments,
    /// Runs a session by a script: these keys one after another, separated by spaces.
    #[arg(long, value_name = "KEYS", value_delimiter = ' ', allow_hyphen_values = true, value_parser = key)]
    keys: Option<Vec<Key>>,
    /// Prints the session as JSON when it ends, or writes it into a file. It has step tests with figures and
    /// gains, gains before and after, whether they are saved, and recordings.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

fn key(name: &str) -> Result<Key, String> {
    screen::key_named(name)
        .ok_or_else(|| "expected a s r u w - + space tab up down left right, as in --keys 'a s right s'".into())
}

/// The files beside a recording.
const BESIDE: [&str; 2] = ["rig.toml", "json"];

/// Numbered recordings of a tuning session.
struct Numbered {
    /// Name of the first one, if the user gave it.
    out: Option<PathBuf>,
    kept: u32,
    /// The present recording, or the last one.
    path: PathBuf,
    growing: Option<GrowingCsv>,
    /// The files beside it before its first row.
    first: Vec<(PathBuf, String)>,
}

impl Numbered {
    fn new(out: Option<PathBuf>) -> Self {
        let mut new = Self { out, kept: 0, path: PathBuf::new(), growing: None, first: Vec::new() };
        new.path = new.next();
        new
    }

    /// Name of the next recording.
    fn next(&self) -> PathBuf {
        match (&self.out, self.kept) {
            (None, _) => free_name("tune", &BESIDE),
            (Some(out), 0) => out.clone(),
            (Some(out), kept) => beside(out, &format!("{}.csv", kept + 1)),
        }
    }
}

/// Description of the excitation in the side file.
const BY_HAND: &str = "by hand, in motorbench tune";

/// Rig and side file, with the gains at the start of the recording.
fn files_beside(
    out: &Path,
    settings: &Settings,
    before: &Settings,
    mut side: serde_json::Value,
) -> Result<Vec<(PathBuf, String)>, Failure> {
    side["settings_before"] = by_name(before).into();
    rig_and_side(out, settings, NominalMotor::default(), &side)
}

impl RecordingStore for Numbered {
    fn begin(&mut self, settings: &Settings, firmware: &str) -> Result<(), String> {
        self.path = self.next();
        let growing = GrowingCsv::new(&self.path).map_err(|error| cannot_grow(&self.path, &error))?;
        self.growing = Some(growing.of_mode(REFERENCE));
        let side = side_file_of_running(settings, firmware, BY_HAND);
        self.first = files_beside(&self.path, settings, settings, side).map_err(|failure| failure.message)?;
        Ok(())
    }

    fn grow(&mut self, samples: &[Sample], settings: &Settings) -> Result<(), String> {
        let Some(growing) = &mut self.growing else { return Ok(()) };
        if growing.rows() == 0 && !samples.is_empty() {
            write_first(&self.first)?;
        }
        growing.add(samples, settings).map_err(|error| cannot_grow(&self.path, &error))
    }

    fn keep(&mut self, record: &Record, before: &Settings, firmware: &str) -> StoredRecording {
        let out = self.path.clone();
        self.growing = None;
        if record.samples.is_empty() {
            return StoredRecording { text: "nothing had come".into(), file: None, is_whole: true };
        }
        self.kept += 1;
        let text = format!("{}: {} samples, {} missing", out.display(), record.samples.len(), record.missing_ticks());
        let files = files_beside(&out, &record.settings, before, record.side_file(firmware, BY_HAND));
        let lacks = match files.map(|files| write_each(&files)) {
            Ok(Ok(())) => None,
            Ok(Err(unwritten)) => Some(unwritten.beside("")),
            Err(failure) => Some(failure.message),
        };
        let is_whole = lacks.is_none();
        let text = [Some(text), lacks].into_iter().flatten().collect::<Vec<_>>().join("; ");
        StoredRecording { text, file: Some(out), is_whole }
    }
}

/// Runs it.
///
/// # Errors
/// [`Failure`] if the board is gone, if an interactive session has no terminal, or if a key of a script failed.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.keys.is_none() && !std::io::stdout().is_terminal() {
        return Err(Failure::machine(
            "tune needs a terminal, or --keys for a session by a script. Programs can also use `motorbench connect`, `send` and `record`",
        ));
    }
    let keeper = Numbered::new(arguments.out.clone());
    let recording = with_beside(&keeper.path, &BESIDE);
    let outputs = Outputs::new([], recording.iter().chain(&arguments.json))?;
    let stopped = on_interrupt()?;
    let stop = || stopped.load(Ordering::Relaxed);
    let live = arguments.live.open()?;
    let (link, ..) = arguments.port.open_to_drive()?;
    let mut session = Session::new(link, arguments.reference, live, Box::new(keeper))?;
    let says = |text: &str| outputs.say(&format!("{text}\n"));
    let mut ended = match &arguments.keys {
        Some(keys) => {
            session.play(keys, &stop, &|key, did| says(&format!("{:10} {did}", format!("{key:?}").to_lowercase())))
        }
        None => screen::run(&mut session, &stop).map_or_else(Ended::from, |()| Ended::Complete),
    };
    let failed = if let Ended::Failed(why) = &ended { Some(BoardError::Failed(why.clone())) } else { None };
    if let Some(StoredRecording { text, is_whole, .. }) = session.end_recording(failed.as_ref())
        // If a session has no other failure, an incomplete recording is its failure.
        && (is_whole || ended != Ended::Complete)
    {
        tell(&text);
    }
    // Also after a trip. A board that is gone was reported already.
    let left = session.leave();
    let is_off = left.is_ok();
    if let (Err(error), Ended::Complete) = (left, &ended) {
        ended = error.into();
    }
    let account = session.account(ended);
    if arguments.keys.is_some() {
        screen::figure_lines(&account.step_tests).iter().for_each(|line| says(line));
    }
    if is_off {
        account.left().iter().for_each(|line| says(line));
    }
    if let Some(path) = &arguments.json {
        write_json(path, &account)?;
    }
    say_what_is_kept(&account.recordings, arguments.json.as_deref());
    outcome(account.ended)
}

/// Says which files the session has left.
fn say_what_is_kept(recordings: &[String], json: Option<&Path>) {
    let json = json.filter(|path| !is_terminal(path)).map(|path| path.display().to_string());
    let files: Vec<String> = recordings.iter().chain(&json).map(|name| quoted(name)).collect();
    let next = recordings.last().map_or_else(String::new, |last| {
        let rig = beside(Path::new(last), "rig.toml").display().to_string();
        format!("motorbench diagnose {} --rig {}", quoted(last), quoted(&rig))
    });
    say_written(&files, &next);
}

/// The exit code for the end of the session.
fn outcome(ended: Ended) -> Result<(), Failure> {
    match ended {
        Ended::Complete => Ok(()),
        Ended::Interrupted => Err(Failure::input("stopped by hand")),
        Ended::Tripped(trip) => Err(BoardError::Tripped(trip).into()),
        Ended::Refused(why) => Err(Failure::input(why)),
        Ended::Failed(why) => Err(Failure::machine(why)),
    }
}

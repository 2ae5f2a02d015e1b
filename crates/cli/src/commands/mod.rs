//! The commands of the program `motorbench`, one file each.
//!
//! Exit codes: `EXIT_CODES`, which the manual pages show.

mod analyse;
mod autotune;
mod compare;
mod connect;
mod convert;
mod demo;
mod design;
mod diagnose;
mod files;
mod identify;
mod interaction;
mod live;
mod manual;
mod own_files;
mod port;
mod provenance;
mod record;
mod recording_files;
mod recordings;
mod send;
mod settings;
mod simulate;
mod stand;
mod tune;
mod validate;
mod virtual_board;
mod web;

use clap::{CommandFactory, FromArgMatches as _, Parser, Subcommand};
use files::{JSON_TO, Outputs, TERMINAL, beside, is_terminal, with_json_joined};
use host_sim::scenario::Scenario;
use indicatif::{ProgressBar, ProgressStyle};
#[cfg(feature = "chip")]
use motorbench_chip::{ProgramError, firmware_at_hand};
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_files::text_file;
use motorbench_model::{Axis, Model, ModelError, Motion};
use motorbench_report::picture::{self, Format};
use motorbench_text::terminal_text::{COLUMNS, narrow, quoted, set_columns, wrapped_to};
use ratatui::crossterm::terminal::window_size;
use serde::Serialize;
use std::any::Any;
use std::env::args_os;
use std::ffi::OsString;
use std::fmt::Display;
use std::fs;
use std::io::{self, ErrorKind, IsTerminal as _, Write as _};
use std::panic;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// How often a progress bar moves.
const TICK: Duration = Duration::from_millis(100);

/// Identify, diagnose and control a DC motor on an Arduino Uno.
#[derive(Parser)]
#[command(name = "motorbench", version, max_term_width = motorbench_text::terminal_text::COLUMNS, arg_required_else_help = true)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Analyse(analyse::Arguments),
    Compare(compare::Arguments),
    Convert(convert::Arguments),
    Design(design::Arguments),
    Diagnose(diagnose::Arguments),
    Identify(identify::Arguments),
    Live(live::Arguments),
    Simulate(simulate::Arguments),
    Stand(stand::Arguments),
    Validate(validate::Arguments),
    Virtual(virtual_board::Arguments),
    Web(web::Arguments),
    Ports(port::PortsArguments),
    Connect(connect::Arguments),
    Record(record::Arguments),
    Send(send::Arguments),
    Settings(settings::Arguments),
    Tune(tune::Arguments),
    Autotune(autotune::Arguments),
    Completions(manual::CompletionsArguments),
    Man(manual::ManArguments),
}

/// Exit codes for scripts, with the text of docs/reference/commands.md.
const EXIT_CODES: [(u8, &str); 4] = [
    (0, "done"),
    (1, "the input or the result is not usable: the message says which file, where in it and what to do"),
    (2, "the command line is wrong"),
    (
        3,
        "something is missing or not permitted on this machine: a file or an output that cannot be written, a port, a library",
    ),
];

/// Why a command ended without its result.
#[derive(Debug)]
pub struct Failure {
    /// What happened, where, and what to do.
    pub message: String,
    /// Exit code, one of `EXIT_CODES`.
    pub code: u8,
}

impl Failure {
    /// The input or the result is not usable.
    pub fn input(message: impl Display) -> Self {
        Self { message: message.to_string(), code: 1 }
    }

    /// The command line is wrong, but this is noticed only during the run.
    #[cfg(all(feature = "chip", unix))]
    fn command_line(message: impl Display) -> Self {
        Self { message: message.to_string(), code: 2 }
    }

    /// Something is missing on this machine.
    pub fn machine(message: impl Display) -> Self {
        Self { message: message.to_string(), code: 3 }
    }
}

/// The commands by what a person wants to do.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Start", &["demo", "virtual", "web"]),
    ("Understand a motor", &["diagnose", "identify", "analyse", "simulate", "compare"]),
    ("Use a board", &["ports", "connect", "settings", "record", "live", "send"]),
    ("Control", &["design", "tune", "autotune", "validate"]),
    ("Measure on a test stand", &["stand"]),
    ("Files and help", &["convert", "completions", "man", "help"]),
];

/// The command line: every command with its options and examples.
pub fn command() -> clap::Command {
    Program::command()
}

/// The command line with the commands of its help in groups.
fn grouped(command: clap::Command, columns: u16) -> clap::Command {
    let usage = "{about-with-newline}\n{usage-heading} {usage}\n\n";
    let template = format!("{usage}{}Options:\n{{options}}\n", groups(&command, columns));
    command.help_template(template)
}

/// The commands in their groups, each with the first sentence of its help.
fn groups(command: &clap::Command, columns: u16) -> String {
    const NAME: usize = 14;
    let about = |name: &str| {
        let found = command.find_subcommand(name).and_then(clap::Command::get_about).map(ToString::to_string);
        let text = found.unwrap_or_else(|| "Prints this help, or that of a command".into());
        text.split('.').next().unwrap_or_default().to_string()
    };
    let line = |name: &&str| {
        let (first, other) = (format!("  {name:NAME$}"), " ".repeat(NAME + 2));
        wrapped_to(usize::from(columns).min(COLUMNS), &about(name), &first, &other)
    };
    let group =
        |(heading, names): &(&str, &[&str])| format!("{heading}:\n{}\n", names.iter().map(line).collect::<String>());
    GROUPS.iter().map(group).collect()
}

/// A command line as the program takes it: `--json FILE.json` is one argument.
pub fn arguments(line: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    with_json_joined(line)
}

/// Columns that the help needs beside the options.
const BESIDE_OPTIONS: u16 = 60;

/// The command line for a terminal of this width. On a narrow one the help is below the options.
fn command_on(columns: u16) -> clap::Command {
    grouped(command(), columns).next_line_help(columns < BESIDE_OPTIONS)
}

/// Columns of the terminal; the maximum if it does not report them, or if there is none.
fn columns() -> u16 {
    window_size().map(|window| window.columns).ok().filter(|columns| *columns > 0).unwrap_or(u16::MAX)
}

/// Runs the program with the arguments of this process.
pub fn main() -> ExitCode {
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |information| {
        if why_not_printed(information.payload()).is_none() {
            usual(information);
        }
    }));
    set_columns(if io::stdout().is_terminal() { columns().into() } else { COLUMNS });
    let parsed = || Program::from_arg_matches(&command_on(columns()).try_get_matches_from(arguments(args_os()))?);
    let result = panic::catch_unwind(|| match parsed() {
        Ok(program) => run(program).map(|()| ExitCode::SUCCESS),
        Err(error) => {
            error.print().or_else(|error| cannot_print(&error))?;
            Ok(ExitCode::from(error.exit_code() as u8))
        }
    });
    let failure = match result {
        Ok(Ok(code)) => return code,
        Ok(Err(failure)) => failure,
        Err(payload) => match why_not_printed(&*payload) {
            Some(why) if why.contains("Broken pipe") => return ExitCode::SUCCESS,
            Some(why) => not_printed(why),
            None => panic::resume_unwind(payload),
        },
    };
    tell(&format!("motorbench: {}", failure.message));
    ExitCode::from(failure.code)
}

/// Prints a message that is not part of the result. On a terminal its lines are wrapped.
fn tell(text: &str) {
    let mut error = io::stderr();
    let text = if error.is_terminal() { narrow(text) } else { text.into() };
    // If the terminal was closed, the exit code still reports the failure.
    let _ = writeln!(error, "{text}");
}

/// The error because of which `println!` panicked: the reader ended, as `head` does, or a disk is full. The panic
/// unwinds, so a motor is stopped; a signal or a plain exit would not do that.
fn why_not_printed(payload: &(dyn Any + Send)) -> Option<&str> {
    let (_, after) = payload.downcast_ref::<String>()?.split_once("failed printing to std")?;
    after.split_once(": ").map(|(_, why)| why)
}

fn run(program: Program) -> Result<(), Failure> {
    match program.command {
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Stand(arguments) => stand::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Live(arguments) => live::run(&arguments),
        Command::Validate(arguments) => validate::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Analyse(arguments) => analyse::run(&arguments),
        Command::Design(arguments) => design::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Virtual(arguments) => virtual_board::run(&arguments),
        Command::Web(arguments) => web::run(&arguments),
        Command::Ports(arguments) => port::list(&arguments),
        Command::Connect(arguments) => connect::run(&arguments).map_err(|failure| arguments.port.failure(failure)),
        Command::Record(arguments) => record::run(&arguments).map_err(|failure| arguments.port.failure(failure)),
        Command::Send(arguments) => send::run(&arguments).map_err(|failure| arguments.port.failure(failure)),
        Command::Settings(arguments) => settings::run(&arguments),
        Command::Tune(arguments) => tune::run(&arguments).map_err(|failure| arguments.port.failure(failure)),
        Command::Autotune(arguments) => autotune::run(&arguments).map_err(|failure| arguments.port.failure(failure)),
        Command::Completions(arguments) => manual::completions(&arguments),
        Command::Man(arguments) => manual::man(arguments),
    }
}

/// Reads a rig file and reports keys that are ignored.
fn read_rig(path: &Path) -> Result<Rig, Failure> {
    let rig = motorbench_files::rig(path).map_err(Failure::input)?;
    if rig.is_model {
        let path = path.display();
        tell(&format!(
            "motorbench: {path} is a model file. It is used as a rig file: its [motor] gives nominal values, its [effects] are ignored"
        ));
    }
    for key in &rig.ignored {
        tell(&format!("motorbench: {}: {key} is no key of a rig file and is ignored", path.display()));
    }
    Ok(rig)
}

/// Reads a recording and reports columns that are not used.
fn read_recording(path: &Path, columns: &[Mapping]) -> Result<Recording, Failure> {
    let recording = motorbench_files::recording(path, columns).map_err(Failure::input)?;
    if !recording.ignored.is_empty() {
        let (path, ignored) = (path.display(), recording.ignored.join(", "));
        let how = match &*recording.suggestion {
            "" => "Name them with --column NAME=CHANNEL".to_owned(),
            likely => format!("Likely: {likely}"),
        };
        tell(&format!("motorbench: {path}: columns without a known name are not used: {ignored}. {how}"));
    }
    Ok(recording)
}

/// The rig file beside a recording, if it exists.
fn rig_beside(recording: &Path) -> Option<PathBuf> {
    // The name `.` cannot get another ending.
    Some(beside(recording, "rig.toml")).filter(|path| path.exists() && !path.is_dir())
}

/// The given rig file, or the one beside the recording.
fn rig_file(named: Option<&Path>, recording: Option<&Path>) -> Option<PathBuf> {
    named.map(Path::to_path_buf).or_else(|| recording.and_then(rig_beside))
}

/// Reads [`rig_file`]. Without one, nothing is known about the rig.
fn rig_for(named: Option<&Path>, recording: Option<&Path>) -> Result<Rig, Failure> {
    rig_file(named, recording).map_or_else(|| Ok(Rig::default()), |path| read_rig(&path))
}

/// The firmware for the simulated chip. It is built if it is missing, or older than its sources.
#[cfg(feature = "chip")]
fn firmware() -> Result<PathBuf, ProgramError> {
    let bar = spinner();
    let building = "building the firmware; the first time takes a minute";
    bar.set_message(building);
    let elf = firmware_at_hand(
        || {
            if bar.is_hidden() {
                tell(building)
            }
        },
        |note| bar.suspend(|| tell(note)),
    );
    bar.finish_and_clear();
    elf
}

/// A model file.
fn read_model(path: &Path) -> Result<Model, Failure> {
    parsed_model(path, Model::parse)
}

fn parsed_model<T>(path: &Path, parse: impl Fn(&str) -> Result<T, ModelError>) -> Result<T, Failure> {
    let failed = |error: &dyn Display| Failure::input(format!("{}: {error}", path.display()));
    let text = text_file::read(path, "a model file (TOML)").map_err(|error| failed(&error))?;
    parse(&text).map_err(|error| failed(&error))
}

/// Writes a model.
fn write_model(path: &Path, axis: Axis, model: &Model) -> Result<(), Failure> {
    write(path, &(own_files::WRITTEN.to_owned() + &model.to_toml_of(axis)))
}

/// A result with the names and units of the axis.
fn in_units_of(axis: Axis, result: &impl Serialize) -> Result<serde_json::Value, Failure> {
    let value = serde_json::to_value(result).map_err(Failure::machine)?;
    Ok(if axis.motion == Motion::Rotary { value } else { renamed(axis.motion, value) })
}

fn renamed(motion: Motion, value: serde_json::Value) -> serde_json::Value {
    use serde_json::Value;
    match value {
        Value::String(text) => Value::String(motion.words(&text).into_owned()),
        Value::Array(all) => all.into_iter().map(|one| renamed(motion, one)).collect(),
        Value::Object(all) => {
            all.into_iter().map(|(name, one)| (motion.words(&name).into_owned(), renamed(motion, one))).collect()
        }
        other => other,
    }
}

/// What comes after a model was found.
fn next_with_model(axis: Axis, model: &Path, rig: Option<&Path>) -> String {
    let model = quoted(&model.display().to_string());
    if !axis.drive.is_voltage() {
        return format!("motorbench compare OTHER.csv {model}");
    }
    let rig = rig.map_or_else(|| "RIG.toml".into(), |rig| quoted(&rig.display().to_string()));
    format!("motorbench design --rig {rig} --model {model} --speed --bandwidth-Hz 5")
}

/// What comes after a page.
fn open_next(page: Option<&Path>) -> String {
    page.map_or_else(String::new, |page| format!("open {} in a browser", page.display()))
}

/// A scenario, with another model than its own if one is given.
fn scenario(path: &Path, model: Option<&Path>) -> Result<Scenario, Failure> {
    let Some(file) = model else { return motorbench_files::scenario(path, None).map_err(Failure::input) };
    motorbench_files::scenario(path, Some(read_model(file)?)).map_err(Failure::input)
}

/// A file for a plot. A wrong ending is refused before any work is done.
fn plot_file(text: &str) -> Result<PathBuf, picture::WrongEnding> {
    let path = PathBuf::from(text);
    picture::Format::of(&path).map(|_| path)
}

/// Writes a plot, as SVG or PNG by the file's ending.
fn write_plot(path: &Path, svg: &str) -> Result<(), Failure> {
    match picture::Format::of(path).map_err(Failure::input)? {
        Format::Svg => write(path, svg),
        Format::Png => {
            write(path, &picture::png(svg).map_err(|error| Failure::input(format!("{}: {error}", path.display())))?)
        }
    }
}

/// Writes a file completely or not at all. The name `-` means the standard output.
fn write(path: &Path, contents: &(impl AsRef<[u8]> + ?Sized)) -> Result<(), Failure> {
    if is_terminal(path) {
        let mut output = io::stdout();
        return output.write_all(contents.as_ref()).and_then(|()| output.flush()).or_else(|error| cannot_print(&error));
    }
    if let Some(why) = own_files::wrong_ending(path, contents.as_ref()) {
        return Err(Failure::input(why));
    }
    let there = own_files::held_in(path);
    if let Some(why) = there.and_then(|there| own_files::other_kind(path, &there, contents.as_ref())) {
        return Err(Failure::input(why));
    }
    write_whole(path, &own_files::marked(contents.as_ref())).map_err(|error| cannot_write(path, &error))
}

/// Writes a temporary file beside it and renames that. On a full disk the old file stays, and no partial file appears.
fn write_whole(path: &Path, contents: &[u8]) -> io::Result<()> {
    // The target of a symbolic link, not the link itself.
    let path = path.canonicalize().unwrap_or_else(|_| path.into());
    let there = fs::metadata(&path).ok();
    if there.as_ref().is_some_and(|there| !there.is_file()) {
        return fs::write(&path, contents);
    }
    if there.is_some() {
        // A read-only file is not replaced.
        fs::OpenOptions::new().append(true).open(&path)?;
    }
    let beside = path.with_added_extension(format!("{}.part", std::process::id()));
    let keep_mode = || there.as_ref().map_or(Ok(()), |there| fs::set_permissions(&beside, there.permissions()));
    let written = fs::write(&beside, contents).and_then(|()| keep_mode()).and_then(|()| fs::rename(&beside, &path));
    written.or_else(|error| {
        let _ = fs::remove_file(&beside);
        match (error.kind(), there) {
            // If the folder takes no new file, the old file is overwritten in place...
            (ErrorKind::PermissionDenied, Some(_)) => fs::write(&path, contents),
            // ... and on a full disk only if its size suffices.
            (ErrorKind::StorageFull | ErrorKind::QuotaExceeded, Some(there))
                if there.len() >= contents.len() as u64 =>
            {
                write_within(&path, contents)
            }
            _ => Err(error),
        }
    })
}

/// Overwrites the beginning of a longer file, and then truncates it.
fn write_within(path: &Path, contents: &[u8]) -> io::Result<()> {
    let mut file = fs::OpenOptions::new().write(true).open(path)?;
    file.write_all(contents)?;
    file.set_len(contents.len() as u64)
}

/// Writes a result as JSON.
fn write_json(path: &Path, result: &impl Serialize) -> Result<(), Failure> {
    write(path, &(serde_json::to_string_pretty(result).map_err(Failure::machine)? + "\n"))
}

/// A reader that ended early, as `head` does, is no failure.
fn cannot_print(error: &io::Error) -> Result<(), Failure> {
    match error.kind() {
        ErrorKind::BrokenPipe => Ok(()),
        _ => Err(not_printed(error)),
    }
}

/// Why the standard output cannot be written, and what to do.
fn not_printed(why: impl Display) -> Failure {
    Failure::machine(format!("cannot write to the standard output: {why}. Make room there, or redirect it"))
}

/// The path of a file, whether it exists or not.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."))
}

/// Why a file cannot be written, and what to do.
fn cannot_write(path: &Path, error: &io::Error) -> Failure {
    let remedy = match error.kind() {
        ErrorKind::NotFound if !folder(path).is_dir() => ": make its folder first",
        ErrorKind::NotFound | ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => ": choose another folder",
        ErrorKind::StorageFull | ErrorKind::FileTooLarge | ErrorKind::QuotaExceeded => ": make room on the disk",
        ErrorKind::IsADirectory => ": it is a folder, name a file in it",
        _ => "",
    };
    Failure::machine(format!("{}: {error}{remedy}", path.display()))
}

/// A description of the present task with its duration; visible on a terminal only.
fn spinner() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    bar.set_style(ProgressStyle::with_template("{spinner} {elapsed} {msg}").expect("the template is a valid constant"));
    bar.enable_steady_tick(TICK);
    bar
}

/// The progress of a task of known size; visible on a terminal only.
fn bar(length: u64) -> ProgressBar {
    let bar = ProgressBar::new(length);
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {percent} % {elapsed}").expect("the template is a valid constant"),
    );
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole_and_a_link_stays_one() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link] = ["run.json", "link.json"].map(|name| folder.path().join(name));
        fs::write(&file, "a longer text of before").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write(if cfg!(unix) { &link } else { &file }, "new").unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        assert_eq!(link.is_symlink(), cfg!(unix));
        assert_eq!(folder.path().read_dir().unwrap().count(), if cfg!(unix) { 2 } else { 1 }, "nothing beside them");
        write(Path::new("/dev/null"), "nothing").unwrap();
        assert_eq!(write(&folder.path().join("none/run.json"), "new").unwrap_err().code, 3);
    }

    /// There is no room for the temporary file.
    #[cfg(target_os = "linux")]
    #[test]
    fn on_a_full_disk_a_file_is_written_into_the_room_it_has() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.json");
        let beside = file.with_added_extension(format!("{}.part", std::process::id()));
        for (before, is_written) in [("running, and room", true), ("short", false)] {
            fs::write(&file, before).unwrap();
            std::os::unix::fs::symlink("/dev/full", &beside).unwrap();
            assert_eq!(write(&file, "complete").is_ok(), is_written);
            assert_eq!(fs::read_to_string(&file).unwrap(), if is_written { "complete" } else { before });
        }
    }

    #[test]
    fn a_model_by_hand_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("model.toml");
        let model = Model::linear(motorbench_model::motor::MotorParameters::PIVT6);
        for _ in 0..2 {
            Outputs::new([], [&file]).unwrap();
            write_model(&file, Axis::default(), &model).unwrap();
            assert_eq!(read_model(&file).unwrap().motor, model.motor);
        }
        fs::write(&file, model.to_toml()).unwrap();
        assert_eq!(Outputs::new([], [&file]).err().map(|failure| failure.code), Some(1));
    }

    #[test]
    fn each_command_stands_in_one_group() {
        let program = command();
        let mut names: Vec<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
        names.push("help");
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        names.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(grouped, names);
    }

    #[test]
    fn help_fits_a_narrow_terminal() {
        let asked = command_on(40).term_width(40).try_get_matches_from(["motorbench", "connect", "--help"]);
        let help = asked.expect_err("help").to_string();
        let options = help.split_once("Options:").expect("options").1.split_once("Examples:").expect("examples").0;
        assert!(options.lines().all(|line| line.chars().count() <= 40), "{help}");
        assert!(options.lines().count() < 25, "{help}");
    }
}

//! Every command as users and programs see it: its help, its output on a terminal and in a pipe, its JSON, its exit
//! codes. The list of commands comes from the program: a command without a row in the table fails.

mod table;

use crate::demonstration::{ARGUMENTS, demonstration};
use crate::motor::PIVT6_TOML;
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry;
use motorbench_model::motor::MotorParameters;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Stdio};
#[cfg(feature = "chip")]
use table::WITH_A_BOARD;
use table::{Row, TABLE, row};
use tempfile::TempDir;

const COLUMNS: usize = 80;
/// Commands that print a line of JSON for each line or recording, while they run.
const IN_LINES: [&str; 2] = ["connect", "virtual"];
/// First character of every escape sequence. Colours are ESC [ ... m.
const ESCAPE: char = '\u{1b}';

/// Input files of the runs of the table.
fn files() -> TempDir {
    let folder = TempDir::new().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // Causes, some of them with long names.
    let effects = "[effects.coulomb_friction]\ntorque_Nm = 0.01\n[effects.voltage_drop]\ndrop_V = 1.6\n\
        [effects.stribeck_friction]\nexcess_torque_Nm = 0.006\nstribeck_speed_rad_per_s = 8\n";
    let play = |name: &str, mode: &str, sequence: &str| {
        let scenario =
            format!("duration_s = 6.0\nmode = \"{mode}\"\n{PIVT6_TOML}{effects}[noise]\ncurrent_A = 0.01\n{sequence}");
        put(&format!("{name}.toml"), &scenario);
        let scenario = motorbench_files::scenario(&folder.path().join(format!("{name}.toml")), None).unwrap();
        put(&format!("{name}.csv"), &scenario.run().unwrap().recording.to_csv());
        let nominal = NominalMotor::from(MotorParameters::PIVT6);
        put("rig.toml", &toml::to_string(&telemetry::rig(&scenario.settings, nominal)).unwrap());
    };
    play(
        "run",
        "open",
        "[[reference]]\ntime_s = 0.1\nkind = \"sequence\"\nsequence = \"prbs\"\namplitude = 8\nperiod_ms = 60\ncount = 90\n",
    );
    let steps = [60, 20, -50, 40, -20, 70, 10];
    let steps = steps
        .iter()
        .enumerate()
        .map(|(index, to)| format!("[[reference]]\ntime_s = {}\nvalue = {to}\n", 0.1 + 0.8 * index as f64));
    play("loop", "speed", &steps.collect::<String>());
    put(
        "scenario.toml",
        &format!("duration_s = 0.5\nmode = \"speed\"\n{PIVT6_TOML}[[reference]]\ntime_s = 0.1\nvalue = 40\n"),
    );
    // Numbers with many digits.
    put("position.toml", include_str!("../../../../scenarios/position_lqr.toml"));
    put("model.toml", PIVT6_TOML);
    put("other.toml", &format!("{PIVT6_TOML}[effects.coulomb_friction]\ntorque_Nm = 0.01\n"));
    put("stand.toml", PIVT6_TOML);
    let table = |loads_nm: &[f64]| {
        let mut table = String::from("u_V,load_Nm,i_A,omega_rad_per_s\n");
        for u in [10.0, 15.0, 20.0, 25.0, 30.0] {
            for (load, scatter) in
                loads_nm.iter().flat_map(|load| [1.0, -1.0, 0.5, -0.5].map(|scatter| (load, scatter)))
            {
                let omega = (u - 2.0 - 5.84 * (0.015 + load) / 0.072) / (0.072 + 5.84 * 5e-6 / 0.072);
                let current = (0.015 + load + 5e-6 * omega) / 0.072 + 0.003 * scatter;
                table += &format!("{u},{load},{current},{}\n", omega - 0.4 * scatter);
            }
        }
        table
    };
    put("table.csv", &table(&[0.0]));
    put("loaded.csv", &table(&[0.0, 0.02, 0.05]));
    put("positions.csv", "resistance_ohm\n5.8\n5.9\n6.1\n");
    put("found.json", "{\"parameters\": {\"resistance_ohm\": {\"value\": 5.8, \"ci95\": [5.7, 5.9]}}}");
    put("gains.txt", "# from a design\nset speed_kp 0.05 speed_ki 1\n");
    put("bad.txt", "# the second is too much\nset speed_kp 0.05\nset speed_kp 99999\n");
    let rows = |from: usize| (from..from + 100).map(|row| format!("{row},{},1\n", row % 7)).collect::<String>();
    put("slow.csv", &format!("t_s,u_V,omega_rad_per_s\n{}", rows(0)));
    put("time.csv", &format!("time,u_V,omega_rad_per_s\n{}", rows(0)));
    put("glitch.csv", &format!("t_s,u_V,omega_rad_per_s\n0,1,1\n1,1,1e300\n{}", rows(2)));
    put("bad.csv", "t_s,omega_rad_per_s\n0,1\nzero,2\n");
    put("bad.toml", "[motor\n");
    put("bare.toml", "[encoder]\ncounts_per_rev = 2000\n");
    put("names.csv", "time,volts\n0,1\n");
    put("typo.toml", "[moter]\nresistance_ohm = 5\n");
    put("empty.csv", "");
    std::fs::write(folder.path().join("junk.csv"), b"\x93NUMPY\x01\0").unwrap();
    folder
}

fn motorbench(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_motorbench"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    command
}

/// Result of a run: exit code, standard output, standard error.
struct Done {
    code: Option<i32>,
    out: String,
    err: String,
}

fn piped(arguments: &[&str], folder: &Path) -> Done {
    let output = motorbench(arguments, folder).output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("UTF-8"));
    Done { code: output.status.code(), out, err }
}

/// A pseudo-terminal, and a thread that collects its output.
fn terminal() -> (File, std::thread::JoinHandle<String>) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let size = Winsize { ws_row: 24, ws_col: COLUMNS as u16, ws_xpixel: 0, ws_ypixel: 0 };
    tcsetwinsize(&master, size).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let slave = File::options().read(true).write(true).open(std::ffi::OsStr::from_bytes(name.as_bytes())).unwrap();
    let mut master = File::from(master);
    let heard = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // The error at the end means that no process has the terminal open.
        let _ = master.read_to_end(&mut bytes);
        String::from_utf8(bytes).expect("UTF-8").replace("\r\n", "\n")
    });
    (slave, heard)
}

/// Runs with standard output and standard error each on a terminal.
fn on_terminals(arguments: &[&str], folder: &Path, no_color: bool) -> Done {
    let ((out, out_heard), (err, err_heard)) = (terminal(), terminal());
    let mut command = motorbench(arguments, folder);
    command.env("TERM", "xterm-256color").env_remove("NO_COLOR").env_remove("CLICOLOR").stdout(out).stderr(err);
    if no_color {
        command.env("NO_COLOR", "1");
    }
    let mut running = command.spawn().unwrap();
    // The command keeps the terminals open until it is dropped.
    drop(command);
    let code = running.wait().unwrap().code();
    Done { code, out: out_heard.join().unwrap(), err: err_heard.join().unwrap() }
}

/// Arguments with the port of the test, which is longer than a usual one.
fn long_port(arguments: &[&str]) -> String {
    let port = arguments.iter().position(|argument| *argument == "--port").map(|at| arguments[at + 1]);
    port.unwrap_or("/tmp/motorbench").into()
}

/// Whether a text sets colours or other attributes: ESC [ digits and semicolons m.
fn is_coloured(text: &str) -> bool {
    text.split(ESCAPE).skip(1).any(|after| {
        let parameters =
            after.strip_prefix('[').map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';'));
        parameters.is_some_and(|rest| rest.starts_with('m'))
    })
}

/// All complaints: one run of this test reports all of them.
#[derive(Default)]
struct Complaints(Vec<String>);

impl Complaints {
    fn expect(&mut self, right: bool, what: &str, wrong: &str) {
        if !right {
            self.0.push(format!("motorbench {what}: {wrong}"));
        }
    }

    /// The output fits the terminal.
    fn fits(&mut self, text: &str, what: &str) {
        for line in text.lines().filter(|line| line.chars().count() > COLUMNS) {
            self.expect(false, what, &format!("wider than {COLUMNS} columns: {line}"));
        }
    }

    /// The final message fits too. A single word that is wider, such as a path, is not broken.
    fn message_fits(&mut self, err: &str, what: &str) {
        let message = err.rfind("motorbench: ").map_or("", |at| &err[at..]);
        self.expect(!message.is_empty(), what, "no message on a terminal");
        let lines: Vec<&str> = message.lines().filter(|line| line.trim().contains(' ')).collect();
        self.fits(&lines.join("\n"), what);
    }

    /// No escape sequences, no progress bar.
    fn plain(&mut self, text: &str, what: &str) {
        self.expect(!text.contains([ESCAPE, '\r']), what, &format!("escape sequences or a progress bar: {text:?}"));
    }

    fn ended(&mut self, done: &Done, code: i32, what: &str) {
        let Done { code: found, out, err } = done;
        let panicked = err.contains("panicked");
        self.expect(*found == Some(code) && !panicked, what, &format!("exit code {found:?}, not {code}: {out}{err}"));
    }

    fn none(self) {
        assert!(self.0.is_empty(), "{} complaints:\n{}", self.0.len(), self.0.join("\n"));
    }

    /// A run that succeeds, in a pipe, on a terminal, and with JSON.
    fn good(&mut self, row: &Row, arguments: &[&str], folder: &Path) {
        let what = arguments.join(" ");
        if row.is_long {
            let done = match arguments == ARGUMENTS {
                true => self.demonstrated(),
                false => self.json_file(arguments, folder),
            };
            return self.readable(row, arguments, &done);
        }
        let done = piped(arguments, folder);
        self.ended(&done, 0, &what);
        self.expect(!done.out.is_empty(), &what, "it says nothing");
        self.readable(row, arguments, &done);
        let what = format!("{what} (on a terminal, with NO_COLOR)");
        let shown = on_terminals(arguments, folder, true);
        self.ended(&shown, 0, &what);
        self.plain(&shown.out, &what);
        // A spinner moves the cursor but has no colours.
        self.expect(!is_coloured(&shown.err), &what, &format!("coloured: {:?}", shown.err));
        if !row.json.is_empty() {
            self.json(&[arguments, row.json].concat(), 0, true, folder);
        }
        if row.json == ["--json"] {
            self.json(&[arguments, &["--json", "-"]].concat(), 0, true, folder);
            if !IN_LINES.contains(&row.command) {
                let _ = self.json_file(arguments, folder);
            }
        }
    }

    /// Plain text that fits a terminal, unless it is for programs.
    fn readable(&mut self, row: &Row, arguments: &[&str], done: &Done) {
        let what = arguments.join(" ");
        for text in [&done.out, &done.err] {
            self.plain(text, &what);
            if !row.for_programs {
                self.fits(&text.replace(&long_port(arguments), "/tmp/motorbench"), &what);
            }
        }
    }

    /// A file gets the JSON, and the standard output the text for a person.
    fn json_file(&mut self, arguments: &[&str], folder: &Path) -> Done {
        let arguments = [arguments, &["--json", "made.json"]].concat();
        let (what, file) = (arguments.join(" "), folder.join("made.json"));
        let done = piped(&arguments, folder);
        self.ended(&done, 0, &what);
        let made = std::fs::read(&file).ok().and_then(|text| serde_json::from_slice::<serde_json::Value>(&text).ok());
        self.expect(made.is_some(), &what, "no JSON in the file");
        self.expect(!done.out.is_empty(), &what, "it says nothing");
        let _ = std::fs::remove_file(file);
        done
    }

    /// The same of the demonstration that other tests have run.
    fn demonstrated(&mut self) -> Done {
        let run = demonstration();
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("UTF-8");
        let done =
            Done { code: run.output.status.code(), out: text(&run.output.stdout), err: text(&run.output.stderr) };
        self.ended(&done, 0, "demo");
        let made = std::fs::read(run.file("demo.json")).ok();
        let made = made.and_then(|text| serde_json::from_slice::<serde_json::Value>(&text).ok());
        self.expect(made.is_some(), "demo", "no JSON in the file");
        self.expect(!done.out.is_empty(), "demo", "it says nothing");
        done
    }

    /// The standard output has JSON and nothing else.
    fn json(&mut self, arguments: &[&str], code: i32, wanted: bool, folder: &Path) {
        let what = arguments.join(" ");
        let done = piped(arguments, folder);
        self.ended(&done, code, &what);
        let values = serde_json::Deserializer::from_str(&done.out).into_iter::<serde_json::Value>();
        let right = values.collect::<Result<Vec<_>, _>>().is_ok_and(|values| !wanted || !values.is_empty());
        self.expect(right, &what, &format!("no JSON, or something beside it: {}", done.out));
        self.plain(&done.err, &what);
    }

    /// A run that fails.
    fn bad(&mut self, row: &Row, arguments: &[&str], code: i32, message: &str, folder: &Path) {
        let what = arguments.join(" ");
        let done = piped(arguments, folder);
        self.ended(&done, code, &what);
        self.expect(done.err.contains(message), &what, &format!("no \"{message}\" in: {}", done.err));
        self.plain(&done.err, &what);
        if code != 2 {
            self.message_fits(&on_terminals(arguments, folder, true).err, &what);
        }
        if !row.json.is_empty() && code != 2 && !arguments.iter().any(|argument| argument.starts_with("--json")) {
            self.json(&[arguments, row.json].concat(), code, false, folder);
        }
    }

    /// Checks a row of the table; `before`: first arguments of every run.
    fn row(&mut self, row: &Row, before: &[&str], folder: &Path) {
        for good in row.good {
            self.good(row, &[&[row.command], before, good].concat(), folder);
        }
        for (bad, code, message) in row.bad {
            self.bad(row, &[&[row.command], before, bad].concat(), *code, message, folder);
        }
    }
}

#[test]
fn the_table_has_every_command() {
    let program = motorbench_cli::commands::command();
    let commands: BTreeSet<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
    // It serves until the user ends it; the tests of the page try it.
    let serves = std::iter::once("web");
    let tried: BTreeSet<&str> = TABLE.iter().map(|row| row.command).chain(serves).collect();
    assert_eq!(tried, commands);
    for command in program.get_subcommands() {
        let has_json = command.get_arguments().any(|argument| argument.get_id() == "json");
        assert!(has_json, "{} has no --json", command.get_name());
    }
}

/// Every run that succeeds is tried with JSON, and every command has such a run.
#[cfg(feature = "chip")]
#[test]
fn the_table_tries_the_json_of_every_command() {
    let rows = || TABLE.iter().chain(WITH_A_BOARD);
    for row in rows().filter(|row| !row.good.is_empty()) {
        assert!(!row.json.is_empty(), "{}: its JSON is not tried", row.command);
    }
    for Row { command, .. } in TABLE {
        assert!(rows().any(|row| row.command == *command && !row.good.is_empty()), "{command} is not tried");
    }
}

#[test]
fn help_has_an_example_and_fits_the_terminal() {
    let folder = TempDir::new().unwrap();
    let program = motorbench_cli::commands::command();
    let mut calls = vec![vec!["--help"], vec!["-h"]];
    for row in TABLE {
        calls.extend([vec![row.command, "--help"], vec![row.command, "-h"], vec!["help", row.command]]);
    }
    let mut complaints = Complaints::default();
    for arguments in &calls {
        let what = arguments.join(" ");
        for done in [piped(arguments, folder.path()), on_terminals(arguments, folder.path(), true)] {
            complaints.ended(&done, 0, &what);
            complaints.plain(&done.out, &what);
            complaints.fits(&done.out, &what);
        }
    }
    for command in program.get_subcommands() {
        let name = command.get_name();
        let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        complaints.expect(examples.contains(&format!("motorbench {name}")), name, "no example in its help");
        // Examples wrapped by the program could not be copied.
        complaints.fits(&examples, name);
    }
    complaints.none();
    // The help has colours, so it matters that a pipe gets none.
    assert!(is_coloured(&on_terminals(&["--help"], folder.path(), false).out));
}

#[test]
fn a_wrong_command_line_is_told_apart_from_a_wrong_input() {
    let folder = TempDir::new().unwrap();
    let mut complaints = Complaints::default();
    for row in TABLE {
        complaints.bad(row, &[row.command, "--no-such-option"], 2, "--no-such-option", folder.path());
    }
    complaints.bad(&row(""), &["no-such-command"], 2, "no-such-command", folder.path());
    complaints.none();
}

#[test]
fn a_reason_that_two_laws_share_is_said_once() {
    let arguments = ["design", "--rig", "rig.toml", "--model", "model.toml", "--speed", "--bandwidth-Hz", "800"];
    let done = piped(&arguments, files().path());
    assert_eq!((done.code, done.err.matches("a tenth of the tick rate").count()), (Some(1), 1), "{}", done.err);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_in_one_line() {
    let (folder, mut complaints) = (files(), Complaints::default());
    for arguments in [
        &["--help"][..],
        &["man"],
        &["completions", "bash"],
        &["ports"],
        &["analyse", "--rig", "model.toml"],
        &["simulate", "scenario.toml", "--json", "-"],
        &["convert", "run.csv", "-"],
        &["diagnose", "--batch", "table.csv", "--rig", "stand.toml"],
    ] {
        let what = format!("{} > /dev/full", arguments.join(" "));
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = motorbench(arguments, folder.path()).stdout(full).output().unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        let done = Done { code: output.status.code(), out: String::new(), err };
        complaints.ended(&done, 3, &what);
        let is_one_line = done.err.lines().count() == 1 && done.err.contains("No space left on device");
        complaints.expect(is_one_line, &what, &done.err);
    }
    complaints.none();
}

/// `-` is the terminal for every text file, and then nothing else is printed.
#[test]
fn a_recording_goes_to_the_terminal() {
    let folder = files();
    for arguments in [&["simulate", "scenario.toml", "--csv", "-"][..], &["convert", "run.csv", "-"]] {
        let done = piped(arguments, folder.path());
        assert!(done.code == Some(0) && done.out.starts_with("t_s,"), "{arguments:?}: {}{}", done.out, done.err);
        assert!(done.out.lines().all(|line| line.contains(',')), "{arguments:?}: something else is printed as well");
        assert!(!folder.path().join("-").exists(), "{arguments:?}");
    }
}

#[test]
fn output_json_and_exit_codes_are_those_of_the_page() {
    let (folder, mut complaints) = (files(), Complaints::default());
    TABLE.iter().for_each(|row| complaints.row(row, &[], folder.path()));
    complaints.none();
}

/// Commands for boards behave as the others. Each part has a board of its own: most of the time they wait for it.
#[cfg(feature = "chip")]
mod with_a_board {
    use super::{Complaints, WITH_A_BOARD, files};

    const PARTS: usize = 4;

    fn behaves_as_the_others(part: usize) {
        let board = crate::board::Board::new(&format!("terminal{part}"));
        let (folder, mut complaints) = (files(), Complaints::default());
        let port = board.port();
        let before = ["--port", port.to_str().unwrap()];
        let rows = WITH_A_BOARD.iter().skip(part).step_by(PARTS);
        rows.for_each(|row| complaints.row(row, &before, folder.path()));
        complaints.none();
    }

    #[test]
    fn first_part() {
        behaves_as_the_others(0);
    }

    #[test]
    fn second_part() {
        behaves_as_the_others(1);
    }

    #[test]
    fn third_part() {
        behaves_as_the_others(2);
    }

    #[test]
    fn fourth_part() {
        behaves_as_the_others(3);
    }
}

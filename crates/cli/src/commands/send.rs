//! `motorbench send`: a file of console lines to a board.

use super::files::is_terminal;
use super::port::{CONNECT, PortArguments, option};
use super::{Failure, JSON_TO, Outputs, TERMINAL, tell, write_json};
use clap::Args;
use motorbench_core::settings::{Settings, find};
use motorbench_files::text_file;
use motorbench_link::board::Board;
use motorbench_link::port::Port;
use motorbench_link::{Link, is_comment};
use std::io::{IsTerminal, stdin};
use std::path::PathBuf;

/// Sends a file of console lines, as `motorbench design` writes them, and reads the settings back.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench design --rig rig.toml --speed --bandwidth-Hz 10 --console gains.txt
  motorbench send gains.txt --save")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Lines of the console; empty lines and those that begin with # are left out. - reads the terminal.
    file: PathBuf,
    /// Keeps the settings in the board's EEPROM.
    #[arg(long)]
    save: bool,
    /// Prints what was sent as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] at the first line the board refuses, or when a setting does not read back as it was sent.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
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
    if checked > 0 {
        let port = arguments.port.name().map(option).unwrap_or_default();
        outputs.say(&format!("next: motorbench tune{port}\n"));
    }
    Ok(())
}

/// Reason why not all lines of a file were accepted.
struct Unsent {
    /// Number of lines that were accepted before.
    obeyed: usize,
    why: Failure,
}

impl Unsent {
    /// The failure as text and as JSON. It says which lines the board has accepted.
    fn failure(self, arguments: &Arguments, port: &str, lines: &[(&str, u32)]) -> Failure {
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
        Failure { message: format!("{why}; {}", progress(done, left)), ..self.why }
    }
}

/// The lines of a file that were done, and those that were not.
fn progress(done: &[(&str, u32)], left: &[(&str, u32)]) -> String {
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

/// The console lines of a file, with their line numbers.
fn console_lines(text: &str) -> Vec<(&str, u32)> {
    let lines = text
        .lines()
        .zip(1..)
        .flat_map(|(line, number)| motorbench_link::lines(line).map(move |line| (line.trim(), number)));
    lines.filter(|(line, _)| !line.is_empty() && !is_comment(line)).collect()
}

/// Tolerance for reading a setting back. The firmware reads a number within 3e-6 and prints six digits, within 1.2e-5
/// of its value, as its tests show. A larger difference means that the line damaged it.
const READ_BACK_SHARE: f32 = 2e-5;

/// Commands to the board have no check sum.
pub(super) fn reads_back(settings: &Settings, name: &str, sent: f32) -> Result<(), Failure> {
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
    use motorbench_core::message::Sample;
    use motorbench_core::settings::Param;
    use motorbench_data::names::setting_name;
    use motorbench_link::board::BoardError;

    /// Numbers as the firmware reads and prints them, and numbers with one wrong digit.
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

    /// A board that always answers with this error.
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

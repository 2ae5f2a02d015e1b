//! `motorbench connect`: a board's console. The drive never stays on when the program ends.

use super::interaction::{on_interrupt, typed_lines};
use super::port::{PortArguments, lifted_protections};
use super::{Failure, TERMINAL, tell};
use clap::Args;
use motorbench_core::console::explanation;
use motorbench_core::message::{Sample, State, Trip};
use motorbench_data::names::trip_words;
use motorbench_data::rig::NominalMotor;
use motorbench_data::sensor_scales::SensorScales;
use motorbench_link::board::{Board as _, BoardError, LOST_AFTER_MS, cause, clear};
use motorbench_link::port::Port;
use motorbench_link::{self, Link, VERSION, is_comment};
use motorbench_text::terminal_text::narrow;
use std::io::{IsTerminal as _, Write as _, stderr, stdin, stdout};
use std::slice;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::TryRecvError;

/// Interval at which the board is read while waiting for the user.
const READ_INTERVAL_S: f64 = 0.02;
/// Commands that would end the binary stream of this program, and the message for them.
const OF_THE_STREAM: [&str; 2] = ["stream", "record"];
const NOT_HERE: &str = "is not possible in connect, which uses the binary stream itself. Use `sequence` to play, `motorbench tune` to watch, `motorbench record` to record";
/// Commands that show, change or keep settings. For commands whose answer is a list, the chip has the names and this
/// program the explanations.
const LISTS: [&str; 2] = ["help", "show"];
const OF_SETTINGS: [&str; 5] = ["set", "show", "save", "load", "defaults"];

/// Sends lines to a board's console, or opens it in the terminal.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench connect
  motorbench connect --port /dev/ttyACM0 status 'show speed_kp'

Without lines it reads them from the terminal or a pipe. An empty line stops
the motor; Ctrl-D and Ctrl-C end. The exit code is 1 if a line of a pipe was
refused. The drive is off at the end. If this program dies, an armed drive stops
by itself after half a second.")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Lines of the console.
    lines: Vec<String>,
    /// Prints one line of JSON for each line of the console, instead of text.
    #[arg(long, value_name = TERMINAL, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL, value_parser = [TERMINAL])]
    json: Option<String>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] when the board does not answer or refuses.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let stopped = on_interrupt()?;
    let (mut link, name) = arguments.port.open()?;
    // A damaged line is no reason to refuse the console.
    if let Some(lifted) = link.settings().ok().as_ref().and_then(lifted_protections) {
        tell(&format!("{lifted}; `load` restores the saved settings, `defaults` the factory settings"));
    }
    let mut console = Console {
        link,
        port: &arguments.port,
        json: arguments.json.is_some(),
        armed: false,
        watch: Watch::Unknown,
        refused: None,
    };
    if !arguments.lines.is_empty() {
        return console.carry_out(&arguments.lines, &stopped);
    }
    if arguments.json.is_none() {
        let firmware = &console.link.firmware;
        let greeting =
            format!("{firmware} at {name}, program {VERSION}; help lists the commands, an empty line stops the motor");
        print_line(&greeting);
    }
    console.converse(&stopped)
}

/// How an armed drive stops if this program dies.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Watch {
    /// The board's own `trip_host`, which may be off.
    Unknown,
    /// This program: `trip_host` was off, and it sets it.
    Set,
    /// The user's setting.
    Own,
}

/// What the board has shown so far.
#[derive(Default)]
struct Watched {
    trip: Trip,
    scales: Scales,
}

/// Whether the samples fit the scales of the sensors.
#[derive(Default)]
enum Scales {
    /// The board has not been asked for its settings.
    #[default]
    Unknown,
    Judged(Box<SensorScales>),
    /// They do not, and the user knows.
    Told,
}

impl Scales {
    /// A line that may have changed a setting makes them unknown again.
    fn after(&mut self, line: &str) {
        let command = line.split_whitespace().next().unwrap_or_default();
        if OF_SETTINGS.contains(&command) && !matches!(self, Self::Told) {
            *self = Self::Unknown;
        }
    }
}

/// A board's console.
struct Console<'a> {
    link: Link<Port>,
    /// The port as the user named it.
    port: &'a PortArguments,
    json: bool,
    /// The drive has been armed from here.
    armed: bool,
    watch: Watch,
    /// The first typed line that failed.
    refused: Option<Failure>,
}

impl Console<'_> {
    /// Sends the given lines.
    fn carry_out(&mut self, lines: &[String], stopped: &AtomicBool) -> Result<(), Failure> {
        for line in lines.iter().flat_map(|text| single_lines(text)) {
            if stopped.load(Ordering::Relaxed) {
                return Err(BoardError::Interrupted.into());
            }
            if let Some(why) = not_here(line) {
                return Err(Failure::input(why));
            }
            let asked = self.ask(line);
            if let (Err(BoardError::Refused { reply, .. }), true) = (&asked, self.json) {
                self.say(line, slice::from_ref(reply));
            }
            self.say(line, &asked?);
        }
        Ok(())
    }

    /// Reads lines from the terminal. Meanwhile it keeps the board alive and reports a trip or a lost board.
    fn converse(&mut self, stopped: &AtomicBool) -> Result<(), Failure> {
        let lines = typed_lines();
        let mut watched = Watched::default();
        while !stopped.load(Ordering::Relaxed) {
            match lines.try_recv() {
                Ok(line) if is_comment(&line) => {}
                Ok(line) => {
                    self.answer(&line)?;
                    watched.scales.after(&line);
                }
                // A script uses the exit code; a user has read the message.
                Err(TryRecvError::Disconnected) => {
                    return self.refused.take().filter(|_| !stdin().is_terminal()).map_or(Ok(()), Err);
                }
                Err(TryRecvError::Empty) => self.look(&mut watched)?,
            }
        }
        Err(BoardError::Interrupted.into())
    }

    /// Prints the answer to a typed line; a refused line does not end the program.
    fn answer(&mut self, line: &str) -> Result<(), BoardError> {
        let asked = not_here(line)
            .map_or_else(|| self.ask(line), |reply| Err(BoardError::Refused { line: line.into(), reply }));
        let replies = match asked {
            Err(BoardError::Refused { line, reply }) => {
                let refused = || BoardError::Refused { line, reply: reply.clone() }.into();
                self.refused.get_or_insert_with(refused);
                vec![reply]
            }
            // The cause of the trip is still present.
            Err(tripped @ BoardError::Tripped(_)) => {
                let reply = format!("error: {tripped}");
                self.refused.get_or_insert(tripped.into());
                vec![reply]
            }
            answer => answer?,
        };
        self.say(line, &replies);
        Ok(())
    }

    /// Sends a line, and watches the drive from `arm` on. An empty line stops the motor and has no answer.
    fn ask(&mut self, line: &str) -> Result<Vec<String>, BoardError> {
        let line = if line.trim().is_empty() { "stop" } else { line };
        let words: Vec<&str> = line.split_whitespace().collect();
        let command = words.first().copied().unwrap_or_default();
        // The user's own settings are shown and saved, without those of this program.
        if OF_SETTINGS.contains(&command) || command == "disarm" {
            self.unwatch()?;
        }
        let replies = match command {
            // The confirmation of a save must not come after the answer to the next line.
            "save" if words.len() == 1 => self.link.save().map(|()| Vec::new())?,
            "clear" if words.len() == 1 => clear(&mut self.link).map(|()| Vec::new())?,
            _ => self.link.ask(line)?,
        };
        match command {
            "arm" => self.armed = true,
            "disarm" => self.armed = false,
            "set" if words.contains(&"trip_host") => self.watch = Watch::Own,
            _ => {}
        }
        self.watch()?;
        Ok(replies)
    }

    /// Reads the board between two lines.
    fn look(&mut self, watched: &mut Watched) -> Result<(), BoardError> {
        self.watch()?;
        self.link.stay_alive()?;
        let samples = self.link.samples(READ_INTERVAL_S)?;
        for sample in &samples {
            if sample.trip != watched.trip && sample.trip != Trip::None {
                tell(&format!("the drive tripped ({}): {}; then `clear`", trip_words(sample.trip), cause(sample.trip)));
            }
            watched.trip = sample.trip;
        }
        let is_driven = |sample: &Sample| sample.state.has(State::ENABLED) && sample.duty != 0;
        if self.armed && samples.iter().any(is_driven) {
            self.check_scales(&samples, &mut watched.scales)?;
        }
        Ok(())
    }

    /// Says once if the samples contradict the scales of a new board.
    fn check_scales(&mut self, samples: &[Sample], scales: &mut Scales) -> Result<(), BoardError> {
        if matches!(scales, Scales::Unknown) {
            *scales = Scales::Judged(Box::new(SensorScales::new(&self.link.settings()?, &NominalMotor::default())));
        }
        let Scales::Judged(judged) = scales else { return Ok(()) };
        judged.add(samples);
        if let Some(contradiction) = judged.contradiction() {
            tell(&self.port.named_in(&contradiction));
            *scales = Scales::Told;
        }
        Ok(())
    }

    /// Makes an armed drive stop by itself if this program dies, where the board's own `trip_host` is off.
    fn watch(&mut self) -> Result<(), BoardError> {
        if !self.armed || self.watch != Watch::Unknown {
            return Ok(());
        }
        if self.link.shows("trip_host")? == Some(0.0) {
            match self.link.command(&format!("set trip_host {LOST_AFTER_MS}")) {
                Ok(()) => self.watch = Watch::Set,
                // While settings are saved, the board is not asked.
                Err(BoardError::Refused { .. }) => {}
                Err(error) => return Err(error),
            }
        } else {
            self.watch = Watch::Own;
        }
        Ok(())
    }

    /// Restores the board's own `trip_host`.
    fn unwatch(&mut self) -> Result<(), BoardError> {
        if self.watch == Watch::Set {
            self.link.command("set trip_host 0")?;
            self.watch = Watch::Unknown;
        }
        Ok(())
    }

    fn say(&self, line: &str, replies: &[String]) {
        if self.json {
            println!("{}", serde_json::json!({ "line": line, "reply": replies }));
            return;
        }
        let lists = line.split_whitespace().next().is_some_and(|word| LISTS.contains(&word));
        for reply in replies {
            let word = reply.split_whitespace().next().unwrap_or_default();
            match explanation(word).filter(|_| lists) {
                Some(explanation) => print_line(&format!("{reply}, {explanation}")),
                None => print_line(reply),
            }
        }
    }

    /// Switches the drive off and restores the user's settings.
    fn leave(&mut self) -> Result<(), BoardError> {
        self.link.command("disarm")?;
        self.unwatch()
    }
}

impl Drop for Console<'_> {
    /// Also runs when the reader of the output ends early, as `head` does.
    fn drop(&mut self) {
        if !self.armed || self.link.is_gone() {
            return;
        }
        let said = match self.leave() {
            Ok(()) => "the drive was armed; it is off now".to_string(),
            Err(error) => format!("motorbench: {error}; check that the motor has stopped"),
        };
        // A closed terminal must not prevent the link from stopping the board.
        let _ = writeln!(stderr(), "{said}");
    }
}

/// The lines of an argument, which may be the text of a file. An empty line, which stops the motor, counts only if it
/// is the only one.
fn single_lines(text: &str) -> impl Iterator<Item = &str> {
    let is_empty = text.trim().is_empty();
    motorbench_link::lines(text).filter(move |line| is_empty || !line.trim().is_empty() && !is_comment(line))
}

/// Prints a line, which a terminal gets broken to its width.
fn print_line(line: &str) {
    println!("{}", if stdout().is_terminal() { narrow(line) } else { line.into() });
}

/// Reason for not sending a line.
fn not_here(line: &str) -> Option<String> {
    let command = line.split_whitespace().next().filter(|command| OF_THE_STREAM.contains(command))?;
    Some(format!("{command} {NOT_HERE}"))
}

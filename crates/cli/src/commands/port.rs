//! `motorbench ports`, and the option `--port` of all commands for a board.

use super::interaction::STOPPED;
use super::{Failure, JSON_TO, Outputs, TERMINAL, tell, write_json};
use clap::Args;
use motorbench_core::settings::{Param, Settings};
use motorbench_data::names::setting_name;
use motorbench_link::board::{Board, BoardError, LOST_AFTER_MS};
use motorbench_link::port::{Port, USUAL_LINK, only_board, open, ports};
#[cfg(unix)]
use motorbench_link::virtual_control::Starting;
use motorbench_link::{Link, OTHER_READER};
use motorbench_text::terminal_text::quoted;
use std::path::{Path, PathBuf};
use std::sync::Arc;
#[cfg(unix)]
use std::sync::atomic::Ordering;
#[cfg(unix)]
use std::time::Duration;

impl From<BoardError> for Failure {
    fn from(error: BoardError) -> Self {
        match error {
            BoardError::Silent { .. } | BoardError::NoTelemetry => Self::machine(format!("{error}; {OTHER_READER}")),
            BoardError::Failed(_) => Self::machine(error),
            BoardError::Refused { .. }
            | BoardError::Tripped(_)
            | BoardError::TrippedBefore(_)
            | BoardError::Interrupted => Self::input(error),
        }
    }
}

/// How often it is looked for a virtual board that is starting.
#[cfg(unix)]
const LOOK_AGAIN: Duration = Duration::from_millis(200);

/// The port of a board.
#[derive(Args)]
pub struct PortArguments {
    /// Port of the board, for instance /dev/ttyACM0 or COM3; without it the only board on USB, or else the virtual one.
    #[arg(long)]
    port: Option<String>,
}

/// Placeholders in hints about `connect` and about other programs at the port. The code that makes hints does not know
/// the port.
pub(super) const CONNECT: &str = "`motorbench connect";

/// Tolerance between two values of the encoder's counts.
pub(super) const SAME_COUNTS: f64 = 1e-3;

const LSOF: &str = "`lsof PORT`";

/// The option that names a port, behind a command.
pub(super) fn option(port: &str) -> String {
    format!(" --port {}", quoted(port))
}

impl PortArguments {
    /// A text whose hints contain the port, if the user named one.
    pub(super) fn named_in(&self, text: &str) -> String {
        match &self.port {
            Some(port) => {
                let lsof = format!("`lsof {}`", quoted(port));
                text.replace(CONNECT, &format!("{CONNECT}{}", option(port))).replace(LSOF, &lsof)
            }
            None => text.into(),
        }
    }

    /// A failure with such a text.
    pub(super) fn failure(&self, failure: Failure) -> Failure {
        Failure { message: self.named_in(&failure.message), ..failure }
    }

    /// The port, if the user named one.
    pub(super) fn name(&self) -> Option<&str> {
        self.port.as_deref()
    }

    pub(super) fn open(&self) -> Result<(Link<Port>, String), Failure> {
        let name = match &self.port {
            Some(name) => name.clone(),
            None => {
                wait_for_virtual(Path::new(USUAL_LINK));
                only_board().map_err(Failure::machine)?
            }
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

/// Waits for a virtual board that is on its way.
#[cfg(unix)]
fn wait_for_virtual(link: &Path) {
    if !Starting::is_at(link) {
        return;
    }
    tell("waiting for `motorbench virtual`, which is starting");
    while Starting::is_at(link) && !STOPPED.load(Ordering::Relaxed) {
        std::thread::sleep(LOOK_AGAIN);
    }
}

#[cfg(not(unix))]
fn wait_for_virtual(_link: &Path) {}

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

/// Protections that are off, or weaker than the firmware's defaults. They were saved so, or a killed `record --set`
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

/// Switches off the motor, and then the `trip_host` that a killed program left. Otherwise it would count as the board's
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
    /// Prints the list as JSON instead of text, or writes it into a file.
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

#[cfg(test)]
mod tests {
    use super::*;

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
}

//! `motorbench live`: replays a recording to a plotter.

use super::{Failure, JSON_TO, Outputs, TERMINAL, read_recording, write_json};
use clap::Args;
use motorbench_data::mapping::Mapping;
use motorbench_link::live::{Live, PLOTJUGGLER, TELEPLOT};
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Replays a recording in real time to PlotJuggler or Teleplot, with its own time stamps.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench live run.csv
  motorbench live run.csv --teleplot
  motorbench live run.csv --udp 192.168.1.20:9870 --speed 0.2

The first goes to PlotJuggler on this computer (UDP Server, JSON).")]
pub struct Arguments {
    /// Recording to replay.
    recording: PathBuf,
    /// A column of the file that has another name or unit: speed=omega_rad_per_s*6.2832, pwm=duty/255.
    #[arg(long = "column", visible_alias = "map", value_name = "NAME=CHANNEL")]
    columns: Vec<Mapping>,
    /// Address of PlotJuggler's UDP server. If no plotter is named, its default address is used.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = PLOTJUGGLER, value_parser = address)]
    udp: Option<SocketAddr>,
    /// Address of Teleplot's UDP server.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = TELEPLOT, value_parser = address)]
    teleplot: Option<SocketAddr>,
    /// Speed of the replay, as a multiple of real time.
    #[arg(long, default_value_t = 1.0, value_parser = rate, allow_negative_numbers = true)]
    speed: f64,
    /// Prints a summary as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] for a recording without time, and for an invalid address.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = Outputs::new([&arguments.recording], &arguments.json)?;
    let recording = read_recording(&arguments.recording, &arguments.columns)?;
    let Some(time_s) = recording.time_s() else {
        return Err(Failure::input(format!(
            "{}: no column t_s: a table of steady states cannot be replayed",
            recording.name
        )));
    };
    let neither = arguments.udp.is_none() && arguments.teleplot.is_none();
    let usual = neither.then(|| address(PLOTJUGGLER).map_err(Failure::machine)).transpose()?;
    let udp = arguments.udp.or(usual);
    let live = Live::new(udp, arguments.teleplot).map_err(Failure::machine)?;
    let start = Instant::now();
    for (index, t_s) in time_s.iter().enumerate() {
        let due = start + Duration::from_secs_f64((t_s - time_s[0]) / arguments.speed);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        live.send(&recording, index).map_err(Failure::machine)?;
    }
    if let Some(path) = &arguments.json {
        let sent = serde_json::json!({ "samples": recording.len(), "udp": udp, "teleplot": arguments.teleplot });
        write_json(path, &sent)?;
    }
    let to: Vec<String> = udp.iter().chain(&arguments.teleplot).map(SocketAddr::to_string).collect();
    outputs.say(&format!("{} samples sent to {}\n", recording.len(), to.join(" and ")));
    outputs.wrote("");
    Ok(())
}

/// Addresses to which a command for a board sends its samples.
#[derive(Args)]
pub(super) struct LiveArguments {
    /// Sends every sample to PlotJuggler or Teleplot over UDP, with the board's time.
    #[arg(long, value_name = "plotjuggler|teleplot[=HOST:PORT]", value_parser = plotter)]
    live: Vec<(Plotter, SocketAddr)>,
}

#[derive(Clone, Copy, PartialEq)]
enum Plotter {
    PlotJuggler,
    Teleplot,
}

impl LiveArguments {
    /// The sender, if requested.
    pub(super) fn open(&self) -> Result<Option<Live>, Failure> {
        let of = |plotter| self.live.iter().rev().find(|(which, _)| *which == plotter).map(|(_, address)| *address);
        let [plotjuggler, teleplot] = [Plotter::PlotJuggler, Plotter::Teleplot].map(of);
        let wanted = !self.live.is_empty();
        wanted.then(|| Live::new(plotjuggler, teleplot).map_err(Failure::machine)).transpose()
    }
}

fn plotter(text: &str) -> Result<(Plotter, SocketAddr), String> {
    let (name, place) = text.split_once('=').map_or((text, None), |(name, place)| (name, Some(place)));
    let (plotter, usual) = match name {
        "plotjuggler" => (Plotter::PlotJuggler, PLOTJUGGLER),
        "teleplot" => (Plotter::Teleplot, TELEPLOT),
        _ => return Err("expected plotjuggler or teleplot, with =HOST:PORT when it is on another computer".into()),
    };
    Ok((plotter, address(place.unwrap_or(usual))?))
}

fn address(text: &str) -> Result<SocketAddr, String> {
    let failed = |why: String| format!("{why}; expected HOST:PORT, for instance {PLOTJUGGLER}");
    let mut found = text.to_socket_addrs().map_err(|error| failed(error.to_string()))?;
    found.next().ok_or_else(|| failed("no such host".into()))
}

fn rate(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|rate: &f64| *rate > 0.0 && rate.is_finite()).ok_or("expected a number above 0".into())
}

//! `motorbench live`

use super::Failure;
use crate::live::{Live, PLOTJUGGLER, TELEPLOT};
use crate::recording::Recording;
use clap::Args;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Replays a recording in real time to PlotJuggler or Teleplot, with its own time stamps.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench live run.csv                      (PlotJuggler on this computer: UDP Server, JSON)
  motorbench live run.csv --teleplot
  motorbench live run.csv --udp 192.168.1.20:9870 --speed 0.2")]
pub struct Arguments {
    /// What to replay.
    recording: PathBuf,
    /// PlotJuggler's UDP server; the default when no plotter is named.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = PLOTJUGGLER)]
    udp: Option<String>,
    /// Teleplot's.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = TELEPLOT)]
    teleplot: Option<String>,
    /// How many times as fast as it was recorded.
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
    /// Prints what was sent as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] for a recording without time and for an address that is none.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if !(arguments.speed > 0.0 && arguments.speed.is_finite()) {
        return Err(Failure::input(format!("--speed {}: expected a number above 0", arguments.speed)));
    }
    let recording = Recording::read(&arguments.recording, &[]).map_err(Failure::input)?;
    let Some(time_s) = recording.time_s() else {
        return Err(Failure::input(format!(
            "{}: no column t_s: a table of steady states has no course",
            recording.name
        )));
    };
    let neither = arguments.udp.is_none() && arguments.teleplot.is_none();
    let udp = arguments.udp.as_deref().or(neither.then_some(PLOTJUGGLER));
    let live = Live::new(udp.map(address).transpose()?, arguments.teleplot.as_deref().map(address).transpose()?)
        .map_err(Failure::machine)?;
    let start = Instant::now();
    for (index, t_s) in time_s.iter().enumerate() {
        let due = start + Duration::from_secs_f64((t_s - time_s[0]) / arguments.speed);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        live.send(&recording, index).map_err(Failure::machine)?;
    }
    if arguments.json {
        println!("{}", serde_json::json!({ "samples": recording.len(), "udp": udp, "teleplot": arguments.teleplot }));
    } else {
        let to: Vec<&str> = udp.into_iter().chain(arguments.teleplot.as_deref()).collect();
        println!("{} samples sent to {}", recording.len(), to.join(" and "));
    }
    Ok(())
}

/// Where a command for a board sends its samples while they come.
#[derive(Args)]
pub(super) struct LiveArguments {
    /// Sends what comes to PlotJuggler or Teleplot over UDP, with the board's time; on this computer or at HOST:PORT.
    #[arg(long, value_name = "plotjuggler|teleplot[=HOST:PORT]")]
    live: Vec<String>,
}

impl LiveArguments {
    /// Ready to send, if that is wanted.
    pub(super) fn open(&self) -> Result<Option<Live>, Failure> {
        let (mut plotjuggler, mut teleplot) = (None, None);
        for given in &self.live {
            let (plotter, place) = given.split_once('=').map_or((&given[..], None), |(name, at)| (name, Some(at)));
            match plotter {
                "plotjuggler" => plotjuggler = Some(address(place.unwrap_or(PLOTJUGGLER))?),
                "teleplot" => teleplot = Some(address(place.unwrap_or(TELEPLOT))?),
                _ => {
                    return Err(Failure::input(format!(
                        "--live {given}: expected plotjuggler or teleplot, with =HOST:PORT when it is on another computer"
                    )));
                }
            }
        }
        let wanted = plotjuggler.is_some() || teleplot.is_some();
        wanted.then(|| Live::new(plotjuggler, teleplot).map_err(Failure::machine)).transpose()
    }
}

fn address(text: &str) -> Result<SocketAddr, Failure> {
    let failed = |why: String| Failure::input(format!("{text}: {why}; expected HOST:PORT, for instance {PLOTJUGGLER}"));
    let mut found = text.to_socket_addrs().map_err(|error| failed(error.to_string()))?;
    found.next().ok_or_else(|| failed("no such host".into()))
}

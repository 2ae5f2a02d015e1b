//! Recording an excitation that the firmware plays: everything that came, whatever ended it.

use super::coverage::{Coverage, Covered};
use super::{Line, Link, Losses};
use crate::board::{Board, BoardError};
use motorbench_core::excitation::{Kind, Sequence};
use motorbench_core::message::{Sample, State, Trip};
use motorbench_core::settings::{Param, Settings};
use std::time::{Duration, Instant};

/// How closely the telemetry is fetched.
const SLICE_S: f64 = 0.02;
/// A sequence that has not begun after this long does not begin.
const BEGINNING: Duration = Duration::from_secs(2);
/// The telemetry may pause this long, no longer.
const PAUSE: Duration = Duration::from_secs(1);
/// How often a board that trips without its host hears of it.
const KEEP_ALIVE: Duration = Duration::from_millis(100);

/// How a recording ended.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// The sequence was played to its end.
    Complete,
    /// The person stopped it.
    Interrupted,
    /// The drive switched itself off.
    Tripped(String),
    /// The board or the line failed.
    Failed(String),
}

impl From<BoardError> for Ended {
    fn from(error: BoardError) -> Self {
        match error {
            BoardError::Tripped(trip) => Self::Tripped(format!("{trip:?}")),
            error => Self::Failed(error.to_string()),
        }
    }
}

/// A recording and how it came about.
#[derive(Clone, Debug)]
pub struct Record {
    /// The samples from the first to the last of the sequence.
    pub samples: Vec<Sample>,
    /// The settings it was made with.
    pub settings: Settings,
    /// How it ended.
    pub ended: Ended,
    /// What was lost on the line.
    pub losses: Losses,
}

impl Record {
    /// Ticks between the first and the last sample of which nothing came.
    pub fn missing_ticks(&self) -> u32 {
        self.samples.windows(2).map(|pair| pair[1].tick.wrapping_sub(pair[0].tick).saturating_sub(1)).sum()
    }

    /// What it has covered of what an identification needs.
    pub fn coverage(&self) -> Covered {
        let mut coverage = Coverage::new(&self.settings);
        coverage.add(&self.samples);
        coverage.covered()
    }

    /// What a recording's side file says.
    pub fn side_file(&self, firmware: &str, sequence: &str) -> serde_json::Value {
        serde_json::json!({
            "program": format!("motorbench {}", super::VERSION),
            "firmware": firmware,
            "sequence": sequence,
            "rate_Hz": self.settings.get(Param::TickRate),
            "samples": self.samples.len(),
            "missing_ticks": self.missing_ticks(),
            "losses": self.losses,
            "coverage": self.coverage(),
            "ended": self.ended,
            "settings": by_name(&self.settings),
        })
    }
}

/// Settings by their names on the console.
pub fn by_name(settings: &Settings) -> serde_json::Map<String, serde_json::Value> {
    Param::ALL.iter().map(|param| (super::name(*param), settings.get(*param).into())).collect()
}

/// Plays `order`, a `sequence` line of the console, in the present mode of an armed drive, and records it; disarms at the
/// end. `stop` is asked again and again whether the person wants to; `hears` gets the samples of the sequence as they come.
///
/// What has come is never thrown away: whatever goes wrong is in [`Record::ended`].
pub fn record<L: Line>(
    link: &mut Link<L>,
    settings: Settings,
    order: &str,
    stop: &dyn Fn() -> bool,
    hears: &mut dyn FnMut(&[Sample]),
) -> Record {
    let mut samples = Vec::new();
    let alive = settings.get(Param::TripHost) > 0.0;
    let ended = play(link, order, alive, &mut samples, stop, hears).unwrap_or_else(Ended::from);
    let off = link.command("disarm");
    let ended = match (ended, off) {
        (Ended::Complete, Err(error)) => Ended::Failed(error.to_string()),
        (ended, _) => ended,
    };
    Record { samples, settings, ended, losses: link.losses() }
}

fn play<L: Line>(
    link: &mut Link<L>,
    order: &str,
    alive: bool,
    samples: &mut Vec<Sample>,
    stop: &dyn Fn() -> bool,
    hears: &mut dyn FnMut(&[Sample]),
) -> Result<Ended, BoardError> {
    link.samples(0.0)?;
    link.command(order)?;
    let mut heard = Instant::now();
    let begun = heard;
    let mut spoke = heard;
    loop {
        if alive && spoke.elapsed() > KEEP_ALIVE {
            link.command("alive")?;
            spoke = Instant::now();
        }
        let came = link.samples(SLICE_S)?;
        if came.is_empty() && heard.elapsed() > PAUSE {
            return Err(BoardError::Failed(
                "the telemetry stopped: look at the cable and the supply of the board".into(),
            ));
        }
        if !came.is_empty() {
            heard = Instant::now();
        }
        let before = samples.len();
        let ended = keep(&came, samples);
        hears(&samples[before..]);
        if let Some(ended) = ended? {
            return Ok(ended);
        }
        if samples.is_empty() && begun.elapsed() > BEGINNING {
            return Err(BoardError::Failed(
                "the sequence does not begin: is the drive armed and in the right mode?".into(),
            ));
        }
        if stop() {
            link.command("stop")?;
            return Ok(Ended::Interrupted);
        }
    }
}

/// Keeps the samples of the sequence, and says when it is over.
fn keep(came: &[Sample], samples: &mut Vec<Sample>) -> Result<Option<Ended>, BoardError> {
    for sample in came {
        if sample.trip != Trip::None {
            samples.push(*sample);
            return Err(BoardError::Tripped(sample.trip));
        }
        if sample.state.has(State::PLAYING) {
            samples.push(*sample);
        } else if !samples.is_empty() {
            return Ok(Some(Ended::Complete));
        }
    }
    Ok(None)
}

/// How many ticks a sequence takes.
pub fn duration_ticks(kind: Kind, period_ms: u16, count: u16, settings: &Settings) -> u32 {
    let ticks = if settings.get(Param::TickRate) > 1500.0 { period_ms.saturating_mul(2) } else { period_ms };
    Sequence::new(kind, 0, 0, ticks, count, 1).duration_ticks()
}

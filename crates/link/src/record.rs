//! Records an excitation that the firmware plays. It keeps every sample, however the recording ends.

use super::{Line, Link, Losses};
use crate::board::{Board, BoardError, Silence};
use motorbench_core::excitation::{Player, Sequence};
use motorbench_core::message::{Sample, State, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::coverage::{Coverage, Covered, Lack};
use std::time::{Duration, Instant};

/// Interval at which the telemetry is fetched.
const SLICE_S: f64 = 0.02;
/// A sequence that has not begun after this long has failed.
const BEGINNING: Duration = Duration::from_secs(2);
/// Number of times the drive is switched off until it confirms.
const TRIES: u32 = 3;
/// For the check of the played sequence: samples that may be lost at either end, and rounding differences in bits.
const LOST_AT_AN_END: usize = 100;
const ROUNDING: i32 = 2;

/// The missing property of an interrupted recording. Other missing properties follow from it.
const REST: Lack = Lack { what: "the rest of its sequence", remedy: "play it whole" };

/// State of a recording that has not ended.
pub const RUNNING: &str = "running";

/// How a recording ended.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// The sequence was played to its end.
    Complete,
    /// The user stopped it.
    Interrupted,
    /// The drive switched itself off.
    Tripped(#[serde(serialize_with = "by_its_name")] Trip),
    /// The board refused a command.
    Refused(String),
    /// The board or the line failed.
    Failed(String),
}

/// The name of a trip in files.
fn by_its_name<S: serde::Serializer>(trip: &Trip, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{trip:?}"))
}

impl From<BoardError> for Ended {
    fn from(error: BoardError) -> Self {
        match error {
            BoardError::Tripped(trip) => Self::Tripped(trip),
            BoardError::Interrupted => Self::Interrupted,
            refused @ (BoardError::Refused { .. } | BoardError::TrippedBefore(_)) => Self::Refused(refused.to_string()),
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
    /// Ticks between the first and the last sample that are missing.
    pub fn missing_ticks(&self) -> u32 {
        missing_ticks(&self.samples)
    }

    /// Whether it suffices for an identification.
    pub fn coverage(&self) -> Covered {
        let mut coverage = Coverage::new(&self.settings);
        coverage.add(&self.samples);
        let mut covered = coverage.covered();
        if self.ended != Ended::Complete {
            covered.lacks = vec![REST];
        }
        covered
    }

    /// Content of a recording's side file.
    pub fn side_file(&self, firmware: &str, sequence: &str) -> serde_json::Value {
        let mut side = side_file_of_running(&self.settings, firmware, sequence);
        side["samples"] = self.samples.len().into();
        side["missing_ticks"] = self.missing_ticks().into();
        side["losses"] = serde_json::json!(self.losses);
        side["coverage"] = serde_json::json!(self.coverage());
        side["ended"] = serde_json::json!(self.ended);
        side
    }
}

/// The side file during a recording; it remains if the program is killed.
pub fn side_file_of_running(settings: &Settings, firmware: &str, sequence: &str) -> serde_json::Value {
    serde_json::json!({
        "program": format!("motorbench {}", super::VERSION),
        "firmware": firmware,
        "sequence": sequence,
        "rate_Hz": settings.get(Param::TickRate),
        "ended": RUNNING,
        "settings": by_name(settings),
    })
}

/// Missing ticks between the first and the last of some samples.
pub fn missing_ticks(samples: &[Sample]) -> u32 {
    samples.windows(2).map(|pair| pair[1].tick.wrapping_sub(pair[0].tick).saturating_sub(1)).sum()
}

/// Settings by their console names, with as few digits as there: 0.05 instead of 0.05000000074505806.
pub fn by_name(settings: &Settings) -> serde_json::Map<String, serde_json::Value> {
    let decimal = |value: f32| value.to_string().parse::<f64>().unwrap_or_else(|_| value.into());
    Param::ALL
        .iter()
        .map(|param| (motorbench_data::names::setting_name(*param), decimal(settings.get(*param)).into()))
        .collect()
}

/// Plays `order`, a `sequence` line of the console, in the present mode of an armed drive, and records it. Disarms at
/// the end. `stop` is polled for an interruption by the user. `sink` gets the samples of the sequence as they come; if
/// it cannot keep them, the recording ends.
///
/// Samples are never discarded: errors are reported in [`Record::ended`].
pub fn record<L: Line>(
    link: &mut Link<L>,
    settings: Settings,
    order: &str,
    stop: &dyn Fn() -> bool,
    sink: SampleSink,
) -> Record {
    let mut samples = Vec::new();
    let mut ended = play(link, order, &mut samples, stop, sink).unwrap_or_else(Ended::from);
    if matches!(ended, Ended::Failed(_)) {
        // Samples that came before the line failed and were not fetched yet.
        let before = samples.len();
        if let Err(error) = keep(&link.come(), &mut samples) {
            ended = error.into();
        }
        let _ = sink(&samples[before..]);
    }
    let off = switched_off(link);
    let ended = match (ended, off) {
        (Ended::Complete, Err(error)) => Ended::Failed(error.to_string()),
        (ended, _) => ended,
    };
    // An interrupted recording ends with its last sample, so losses after it do not count.
    let losses = match (&ended, samples.last()) {
        (Ended::Complete, _) | (_, None) => link.losses(),
        (_, Some(last)) => link.losses_before(last.tick),
    };
    Record { samples, settings, ended, losses }
}

/// Receives the samples while they come; its error says why it could not keep them.
pub type SampleSink<'a> = &'a mut dyn FnMut(&[Sample]) -> Result<(), String>;

/// Repeats until the drive confirms, or until the line is gone.
fn switched_off<L: Line>(link: &mut Link<L>) -> Result<(), BoardError> {
    let mut off = link.command("disarm");
    for _ in 1..TRIES {
        if off.is_err() && !link.is_gone() {
            off = link.command("disarm");
        }
    }
    off
}

fn play<L: Line>(
    link: &mut Link<L>,
    order: &str,
    samples: &mut Vec<Sample>,
    stop: &dyn Fn() -> bool,
    sink: SampleSink,
) -> Result<Ended, BoardError> {
    link.samples(0.0)?;
    link.begin(order)?;
    let mut silence = Silence::default();
    let begun = Instant::now();
    loop {
        link.stay_alive()?;
        let slice = Instant::now();
        let came = link.samples(SLICE_S)?;
        silence.after(slice, &came)?;
        let before = samples.len();
        let ended = keep(&came, samples);
        sink(&samples[before..]).map_err(BoardError::Failed)?;
        if let Some(ended) = ended? {
            return Ok(ended);
        }
        if samples.is_empty() && begun.elapsed() > BEGINNING {
            return Err(BoardError::Failed(
                "the sequence did not begin: check that the drive is armed and the mode is set".into(),
            ));
        }
        if stop() {
            link.command("stop")?;
            return Ok(Ended::Interrupted);
        }
    }
}

/// Keeps the samples of the sequence, and reports its end.
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

/// Whether samples have the references of a whole sequence. Commands have no check sum: a line that damages data can
/// change the sequence, or its length.
pub fn is_played(samples: &[Sample], sequence: &Sequence) -> bool {
    let playing: Vec<&Sample> = samples.iter().filter(|sample| sample.state.has(State::PLAYING)).collect();
    let (Some(first), Some(last)) = (playing.first(), playing.last()) else { return true };
    // Positions are relative to the start of the sequence.
    let is_position = first.state.mode().is_position();
    let after_first = |sample: &Sample| sample.tick.wrapping_sub(first.tick) as usize;
    let lasted = after_first(last) + 1;
    let whole = sequence.duration_ticks() as usize;
    if !(lasted..=lasted + 2 * LOST_AT_AN_END).contains(&whole) {
        return false;
    }
    let mut player = Player::default();
    player.start(sequence);
    let plays: Vec<i32> = (0..whole).map(|_| player.step().value.into()).collect();
    (0..=LOST_AT_AN_END.min(whole - lasted)).any(|lost| {
        let at = |sample: &Sample| plays[lost + after_first(sample)];
        let origin = if is_position { first.reference - at(first) } else { 0 };
        playing.iter().all(|sample| (sample.reference - origin - at(sample)).abs() <= ROUNDING)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_core::excitation::Kind;
    use motorbench_core::message::Mode;

    #[test]
    fn an_end_is_written_as_programs_know_it() {
        let written = |ended: Ended| serde_json::to_value(ended).unwrap();
        assert_eq!(written(Ended::Complete), "complete");
        assert_eq!(written(Ended::Tripped(Trip::OverCurrentPeak)), serde_json::json!({ "tripped": "OverCurrentPeak" }));
    }

    /// The samples of two steps both ways of 40 ticks, all or some of them, played to the end or not.
    fn samples_of(count: u16, ticks: std::ops::Range<usize>) -> Vec<Sample> {
        let mut player = Player::default();
        player.start(&steps(count));
        let samples = (0..).map_while(|tick| {
            let play = player.step();
            let state = State(State::PLAYING | Mode::OpenLoop as u8);
            (!play.done).then_some(Sample { tick, state, reference: play.value.into(), ..Sample::default() })
        });
        samples.collect::<Vec<_>>()[ticks].to_vec()
    }

    fn steps(count: u16) -> Sequence {
        Sequence::new(Kind::Steps, 500, 0, 40, count, 1).unwrap()
    }

    #[test]
    fn another_sequence_is_noticed_by_values_and_length() {
        let whole = 4 * 40 * 4;
        assert!(is_played(&samples_of(4, 0..whole), &steps(4)));
        assert!(is_played(&samples_of(4, 30..whole), &steps(4)), "the first ones are lost");
        assert!(is_played(&samples_of(4, 30..whole - 30), &steps(4)), "as well as the last ones");
        assert!(!is_played(&samples_of(2, 0..whole / 2), &steps(4)), "half of it");
        assert!(!is_played(&samples_of(4, 0..whole), &steps(2)), "twice as much");
        let other = Sequence::new(Kind::Steps, 400, 0, 40, 4, 1).unwrap();
        assert!(!is_played(&samples_of(4, 0..whole), &other), "another amplitude");
    }

    #[test]
    fn settings_are_written_as_they_were_set() {
        let mut settings = Settings::defaults();
        settings.set(Param::SpeedKp, 0.055_108).unwrap();
        assert_eq!(by_name(&settings)["speed_kp"].to_string(), "0.055108");
    }
}

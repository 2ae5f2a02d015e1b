//! The interface of a board with the firmware, as experiments use it. The board is real, or the simulated chip.

use motorbench_core::message::{Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::names::trip_words;
pub use motorbench_data::names::{trip_cause as cause, trip_limit as limit};
pub use motorbench_data::telemetry::LOST_AFTER_MS;
use std::time::{Duration, Instant};

/// Interval of the keep-alive lines for a board that trips without its host (`trip_host`).
pub const KEEP_ALIVE: Duration = Duration::from_millis(100);
/// Reply of the board while saved settings of another version are not resolved.
const NOT_LOADED: &str = "not loaded";

/// A device that runs the firmware, with its binary stream on.
pub trait Board {
    /// Sends a line of the console and waits for its `ok`.
    ///
    /// # Errors
    /// [`BoardError`].
    fn command(&mut self, line: &str) -> Result<(), BoardError>;

    /// Waits `duration_s`. Returns the telemetry samples since the last call, including those that came while a command
    /// was answered.
    ///
    /// # Errors
    /// [`BoardError`].
    fn samples(&mut self, duration_s: f64) -> Result<Vec<Sample>, BoardError>;

    /// Sends a keep-alive line, if the last one is [`KEEP_ALIVE`] old.
    ///
    /// # Errors
    /// [`BoardError`], when the line is gone.
    fn stay_alive(&mut self) -> Result<(), BoardError>;
}

/// Why the board did not carry out a command.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// The firmware refuses.
    #[error("the board refuses `{line}`: {reply}{}", remedy(.reply))]
    Refused {
        /// What was sent.
        line: String,
        /// The reply.
        reply: String,
    },
    /// No answer.
    #[error(
        "no answer to `{line}`: check the port, the baud rate and the cable; flash the firmware with `cargo flash`"
    )]
    Silent {
        /// What was sent.
        line: String,
    },
    /// No samples come; commands may still get through.
    #[error("the telemetry stopped: check the cable and the supply of the board")]
    NoTelemetry,
    /// The drive switched itself off.
    #[error("the drive tripped ({}): {}; then `motorbench connect clear`", trip_words(*.0), cause(*.0))]
    Tripped(Trip),
    /// The drive had switched itself off before this command.
    #[error("the drive is off since an earlier trip ({}): {}; then `motorbench connect clear`", trip_words(*.0), cause(*.0))]
    TrippedBefore(Trip),
    /// The user stopped it.
    #[error("stopped by hand")]
    Interrupted,
    /// The firmware or the connection failed.
    #[error("{0}")]
    Failed(String),
}

/// The command that follows from a refusal of the console.
fn remedy(reply: &str) -> &'static str {
    if reply.ends_with("clear it") { " (`motorbench connect clear`)" } else { "" }
}

/// After a trip the board reports its reason within this time.
const LATCHED_S: f64 = 0.05;

/// Arms the drive. If a trip is latched, the error is that trip.
///
/// # Errors
/// [`BoardError`], [`BoardError::TrippedBefore`] for such a trip.
pub fn arm(board: &mut impl Board) -> Result<(), BoardError> {
    let refused = match board.command("arm") {
        Err(refused @ BoardError::Refused { .. }) => refused,
        done => return done,
    };
    match latched(board) {
        Err(BoardError::Tripped(trip)) => Err(BoardError::TrippedBefore(trip)),
        looked => looked.and(Err(refused)),
    }
}

/// Clears a trip. If its cause is still present, it returns at once.
///
/// # Errors
/// [`BoardError`], [`BoardError::Tripped`] for such a trip.
pub fn clear(board: &mut impl Board) -> Result<(), BoardError> {
    board.command("clear")?;
    latched(board)
}

/// Whether the board has no trip at present.
fn latched(board: &mut impl Board) -> Result<(), BoardError> {
    match board.samples(LATCHED_S)?.last() {
        Some(Sample { trip, .. }) if *trip != Trip::None => Err(BoardError::Tripped(*trip)),
        _ => Ok(()),
    }
}

/// Makes the drive stop by itself if this program dies, unless the board has a `trip_host` of its own. The caller then
/// keeps the board alive. `settings`: those of the board.
///
/// # Errors
/// [`BoardError`].
pub fn watch_host(board: &mut impl Board, settings: &Settings) -> Result<(), BoardError> {
    if settings.get(Param::TripHost) > 0.0 {
        return Ok(());
    }
    // If saved settings could not be loaded, the board treats any `set` as the user's consent to the present ones. Only
    // the user may give that.
    match board.command("arm") {
        Err(refused @ BoardError::Refused { .. }) if refused.to_string().contains(NOT_LOADED) => return Err(refused),
        _ => board.command("disarm")?,
    }
    board.command(&format!("set trip_host {LOST_AFTER_MS}"))
}

/// Switches the drive off, and then restores the board's own `trip_host`.
///
/// # Errors
/// [`BoardError`].
pub fn leave_host(board: &mut impl Board, settings: &Settings) -> Result<(), BoardError> {
    board.command("disarm")?;
    board.command(&format!("set trip_host {}", settings.get(Param::TripHost)))
}

/// The telemetry may pause this long at most.
const LONGEST_SILENCE: Duration = Duration::from_secs(1);
/// If a read took longer than this, the program itself was delayed, and the line was not silent all the time.
const LONGEST_READ: Duration = Duration::from_millis(200);

/// Time without telemetry. A program that drives a motor by its samples must stop without them: keep-alive lines ask
/// for no answer.
#[derive(Default)]
pub struct Silence {
    lasted: Duration,
}

impl Silence {
    /// Evaluates a read that began at this time.
    ///
    /// # Errors
    /// [`BoardError::NoTelemetry`], when it has lasted too long.
    pub fn after(&mut self, look: Instant, came: &[Sample]) -> Result<(), BoardError> {
        self.lasted = if came.is_empty() { self.lasted + look.elapsed().min(LONGEST_READ) } else { Duration::ZERO };
        if self.lasted > LONGEST_SILENCE { Err(BoardError::NoTelemetry) } else { Ok(()) }
    }
}

/// Interval at which a board is read while waiting.
const READ_INTERVAL_S: f64 = 0.1;
/// A duration has passed when this share of its samples has come.
const PASSED_SHARE: f64 = 0.98;

/// The samples of a duration by the board's own clock, `rate_hz`. A busy computer may simulate a board more slowly than
/// real time. The board is kept alive meanwhile.
///
/// # Errors
/// [`BoardError`], [`BoardError::NoTelemetry`] when the duration does not pass.
pub fn samples_of(board: &mut impl Board, duration_s: f64, rate_hz: f64) -> Result<Vec<Sample>, BoardError> {
    let (mut samples, mut silence) = (Vec::new(), Silence::default());
    let passed_s = |samples: &[Sample]| match (samples.first(), samples.last()) {
        (Some(first), Some(last)) => f64::from(last.tick.wrapping_sub(first.tick) + 1) / rate_hz,
        _ => 0.0,
    };
    while passed_s(&samples) < PASSED_SHARE * duration_s {
        board.stay_alive()?;
        let look = Instant::now();
        let came = board.samples(READ_INTERVAL_S.min(duration_s))?;
        silence.after(look, &came)?;
        samples.extend(came);
    }
    Ok(samples)
}

/// The samples, if the drive did not switch itself off during them.
///
/// # Errors
/// [`BoardError::Tripped`].
pub fn untripped(samples: Vec<Sample>) -> Result<Vec<Sample>, BoardError> {
    match samples.iter().map(|sample| sample.trip).find(|trip| *trip != Trip::None) {
        Some(trip) => Err(BoardError::Tripped(trip)),
        None => Ok(samples),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fake_board::FakeBoard as Fake;
    use motorbench_core::settings::find;

    #[test]
    fn a_trip_that_stays_says_what_to_do() {
        let mut board = Fake::that_sends(u32::MAX);
        assert_eq!([arm(&mut board), clear(&mut board)], [Ok(()), Ok(())]);
        board.trip = Trip::EmergencyStop;
        let (before, stays) =
            (BoardError::TrippedBefore(Trip::EmergencyStop), BoardError::Tripped(Trip::EmergencyStop));
        assert_eq!([arm(&mut board), clear(&mut board)], [Err(before.clone()), Err(stays.clone())]);
        assert!(stays.to_string().contains("release the emergency stop; then"));
        assert!(before.to_string().starts_with("the drive is off since an earlier trip"));
    }

    #[test]
    fn every_trip_says_what_to_look_for() {
        for trip in (1..).map_while(Trip::from_number) {
            let (cause, words) = (cause(trip), trip_words(trip));
            assert!(words.contains(' ') && words.to_lowercase() == words, "{trip:?}: {words}");
            for setting in cause.split('`').skip(1).step_by(2) {
                assert!(find(setting.as_bytes()).is_some(), "{trip:?}: no setting {setting}");
            }
        }
        assert_eq!([Trip::Runaway, Trip::EmergencyStop, Trip::Stall].map(limit), [None, None, Some("trip_stall")]);
        let message = BoardError::Tripped(Trip::EncoderSilent).to_string();
        assert!(message.contains("`trip_encoder` 0") && message.ends_with("`motorbench connect clear`"), "{message}");
    }
}

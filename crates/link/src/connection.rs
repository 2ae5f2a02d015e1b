//! The firmware over a serial line: a board on a USB port, or the simulated chip behind a pseudo-terminal.
//!
//! [`Link`] sends the console's lines inside the binary stream of [`motorbench_core::protocol`]. Telemetry continues
//! while a command is answered, and lost or damaged frames are counted. When it is dropped it disarms the drive.

mod answers;
mod settings;
mod start;

use crate::board::{Board, BoardError, KEEP_ALIVE};
use crate::line::Line;
use motorbench_core::message::Sample;
use motorbench_core::protocol::{Frame, StreamDecoder};
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Longest time for an answer; `show` takes longest.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(4);
/// Hint for bytes that are missing without a fault of the cable; `PORT` stands for the port's name.
pub const OTHER_READER: &str = "another program may be reading the port (`lsof PORT` names it)";
/// Number of times a line is sent that may have been damaged.
const TRIES: u32 = 3;
/// The same over a line that loses frames, as long as some come whole.
const LOSSY_TRIES: u32 = 10;
/// Marks lost frames within a line of a reply.
const GAP: char = char::REPLACEMENT_CHARACTER;
/// Longest wait for a late answer to a line that was given up, by both clocks.
const LATE_ANSWER_TIMEOUT: Duration = Duration::from_millis(200);
/// [`KEEP_ALIVE`] in samples: the board's clock may be ahead of a program that had to wait.
const KEEP_ALIVE_TICKS: u32 = 100;
/// The greeting of a board after a reset: two lines outside of any frame.
const GREETING: &[u8] = b"# motorbench ";
const GREETING_CAUSE: &[u8] = b"# reset: ";
/// The board's own message, some time after the answer to `save`.
const SAVED: &str = "# saved\n";
/// Longer than the greeting, and than any frame.
const MOST_UNFRAMED_BYTES: usize = 256;
/// Leaving a board takes three lines. From the second on, which ends the stream, its answers are not frames.
const LEAVE: &[u8] = b"\ndisarm\nstream off\necho on\n";
const LEAVE_LINES: usize = 3;
/// Longest wait for these answers.
const LEAVE_TIMEOUT: Duration = Duration::from_millis(500);
/// Firmware and program are compatible within one version of the protocol.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Losses on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Losses {
    /// Frames that never came.
    pub lost_frames: u32,
    /// Of them those that came damaged.
    pub damaged_frames: u32,
}

/// The firmware at the other end of a line.
pub struct Link<L: Line> {
    line: L,
    decoder: StreamDecoder,
    samples: Vec<Sample>,
    reply: String,
    /// When the last byte came, or was asked for, by both clocks.
    replied: (Instant, u32),
    /// Losses up to then.
    lost_before_reply: u32,
    last_tick: Option<u32>,
    /// Losses up to each tick at which more were noticed.
    noticed: Vec<(u32, Losses)>,
    /// When the last frame came.
    heard: Instant,
    /// Bytes since the end of the last frame: a board greets there after a reset.
    outside: Vec<u8>,
    /// Lines whose answers are in `reply`, or may still come.
    unanswered: u32,
    /// When the board was last kept alive, by both clocks.
    kept_alive: (Instant, u32),
    gone: bool,
    /// Set by Ctrl-C.
    stopped: Arc<AtomicBool>,
    /// Version line of the firmware.
    pub firmware: String,
}

impl<L: Line> Link<L> {
    /// Losses since the start.
    pub fn losses(&self) -> Losses {
        let StreamDecoder { lost, damaged, .. } = self.decoder;
        // Damaged bytes since the last whole frame are lost as well.
        Losses { lost_frames: lost.max(damaged), damaged_frames: damaged }
    }

    /// Losses before a given tick.
    pub fn losses_before(&self, tick: u32) -> Losses {
        let last = self.noticed.iter().rev().find(|(noticed, _)| *noticed <= tick);
        last.map_or(Losses::default(), |(_, losses)| *losses)
    }

    /// The samples that have come and were not fetched: those before the line failed.
    pub fn come(&mut self) -> Vec<Sample> {
        std::mem::take(&mut self.samples)
    }

    /// Whether commands can no longer reach the firmware: the line is gone, or the board was reset.
    pub fn is_gone(&self) -> bool {
        self.gone
    }

    /// Processes the bytes that have come.
    fn poll(&mut self) -> Result<(), BoardError> {
        let mut buffer = [0; 4096];
        let count = self.line.receive(&mut buffer).map_err(|error| self.lost_line(&error))?;
        for &byte in &buffer[..count] {
            let frame = self.decoder.push(byte);
            if frame.is_some() {
                self.heard = Instant::now();
            }
            match frame {
                Some(Frame::Sample(sample)) => self.take(sample)?,
                Some(Frame::Text(text, length)) => {
                    self.note_gap();
                    self.reply += &String::from_utf8_lossy(&text[..length]).replace('\r', "");
                }
                None => {}
            }
            if byte == 0 {
                self.outside.clear();
            } else if self.outside.len() < MOST_UNFRAMED_BYTES {
                self.outside.push(byte);
            }
        }
        self.greeted()
    }

    /// Processes text: whether it continues where the last ended.
    fn note_gap(&mut self) {
        let is_within = !self.reply.is_empty() && !self.reply.ends_with('\n');
        if is_within && self.decoder.lost != self.lost_before_reply {
            self.reply.push(GAP);
        }
        self.replied = (Instant::now(), self.last_tick.unwrap_or(0));
        self.lost_before_reply = self.decoder.lost;
    }

    /// Reads answers outside of frames until this many have come: a port keeps unread bytes for the program that opens
    /// it next.
    fn take_rest(&mut self, answers: usize) {
        let (begun, mut said, mut buffer) = (Instant::now(), Vec::new(), [0; 1024]);
        while begun.elapsed() < LEAVE_TIMEOUT {
            let Ok(count) = self.line.receive(&mut buffer) else { return };
            said.extend_from_slice(&buffer[..count]);
            let text = said.rsplit(|byte| *byte == 0).next().unwrap_or_default();
            if String::from_utf8_lossy(text).matches("ok\r\n").count() >= answers {
                return;
            }
        }
    }

    /// A board after a reset greets, and does not stream.
    fn greeted(&mut self) -> Result<(), BoardError> {
        let after = |bytes: &[u8], what: &[u8]| {
            let at = bytes.windows(what.len()).position(|window| window == what)?;
            Some(bytes[at + what.len()..].to_vec())
        };
        let Some(rest) = after(&self.outside, GREETING).and_then(|rest| after(&rest, GREETING_CAUSE)) else {
            return Ok(());
        };
        // On a busy computer the board's next lines follow directly.
        let Some(end) = rest.iter().position(|byte| *byte == b'\n') else { return Ok(()) };
        self.gone = true;
        Err(reset(String::from_utf8_lossy(&rest[..end]).trim_end()))
    }

    /// Ticks count up from a reset, so a smaller tick shows another reset.
    fn take(&mut self, sample: Sample) -> Result<(), BoardError> {
        if self.last_tick.is_some_and(|last| sample.tick < last) {
            self.gone = true;
            return Err(reset("unknown"));
        }
        self.last_tick = Some(sample.tick);
        let losses = self.losses();
        if losses != self.noticed.last().map_or(Losses::default(), |(_, noticed)| *noticed) {
            self.noticed.push((sample.tick, losses));
        }
        self.samples.push(sample);
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        self.line.send(bytes).map_err(|error| self.lost_line(&error))
    }

    fn lost_line(&mut self, error: &io::Error) -> BoardError {
        self.gone = true;
        BoardError::Failed(format!(
            "the connection is gone ({error}): plug the board in again. The drive stops by itself if `trip_host` is set, as record, tune, stand and autotune do"
        ))
    }
}

/// Splits a text at the console's line ends.
pub fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.split(['\r', '\n'])
}

/// Whether a line of a file is for its reader. The board has no such lines, and answers them with an error.
pub fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with('#')
}

/// `cause`: in the firmware's words.
fn reset(cause: &str) -> BoardError {
    let remedy = match cause {
        "external" => "check whether its button was pressed, or another program opened its port",
        "power on" | "brown-out" => "check its supply and the USB cable, and whether the motor uses the same supply",
        "watchdog" | "main loop hung" | "panic" => "this is a fault of the firmware: please report it",
        _ => "`motorbench connect status` shows the cause; look for a loose supply",
    };
    BoardError::Failed(format!("the board was reset ({cause}), its drive is off: {remedy}"))
}

fn damaged_line(losses: Losses, what: &str) -> BoardError {
    let Losses { lost_frames, damaged_frames } = losses;
    BoardError::Failed(format!(
        "{what}: {lost_frames} frames were lost on the line so far, of them {damaged_frames} damaged. Use a shorter cable, another USB port, no hub; keep the motor's leads away from the cable; or {OTHER_READER}"
    ))
}

impl<L: Line> Board for Link<L> {
    fn command(&mut self, line: &str) -> Result<(), BoardError> {
        self.ask_again(line).map(|_| ())
    }

    fn samples(&mut self, duration_s: f64) -> Result<Vec<Sample>, BoardError> {
        let end = Instant::now() + Duration::from_secs_f64(duration_s);
        loop {
            self.poll()?;
            if Instant::now() >= end {
                return Ok(std::mem::take(&mut self.samples));
            }
        }
    }

    fn stay_alive(&mut self) -> Result<(), BoardError> {
        let (spoke, tick) = self.kept_alive;
        let now = self.last_tick.unwrap_or(0);
        if spoke.elapsed() > KEEP_ALIVE || now.saturating_sub(tick) > KEEP_ALIVE_TICKS {
            self.keep_alive()?;
        }
        Ok(())
    }
}

impl<L: Line> Drop for Link<L> {
    /// Leaves the motor without drive and the console in text mode; sent twice in case the line damages it.
    fn drop(&mut self) {
        let times = if self.decoder.damaged == 0 { 1 } else { TRIES };
        for _ in 0..if self.gone { 0 } else { times } {
            let _ = self.line.send(LEAVE);
        }
        if !self.gone {
            self.take_rest(LEAVE_LINES * times as usize - 1);
        }
    }
}

//! Finds the firmware at the other end of a line, checks its version, and switches to the binary stream.

use super::{Link, TRIES, VERSION};
use crate::board::{Board, BoardError};
use crate::line::Line;
use motorbench_core::protocol::StreamDecoder;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// After a reset the boot loader waits this long for a new program, at most.
const START_TIMEOUT: Duration = Duration::from_secs(8);
/// Interval between two calls to a starting board.
const CALL_INTERVAL: Duration = Duration::from_millis(300);
/// Ctrl-U: the console discards the line so far.
const DISCARD_LINE: &str = "\x15";

impl<L: Line> Link<L> {
    /// Waits for the firmware, checks its version and switches the binary stream on.
    ///
    /// # Errors
    /// [`BoardError`]: nothing answers, or another version does.
    pub fn start(line: L) -> Result<Self, BoardError> {
        Self::start_unless(line, Arc::default())
    }

    /// The same with Ctrl-C, which sets `stopped`: then the link stops waiting for answers. Answers to the lines that
    /// switch the drive off are waited for only briefly.
    ///
    /// # Errors
    /// As [`Link::start`], and [`BoardError::Interrupted`].
    pub fn start_unless(line: L, stopped: Arc<AtomicBool>) -> Result<Self, BoardError> {
        let mut link = Self {
            line,
            decoder: StreamDecoder::default(),
            samples: Vec::new(),
            reply: String::new(),
            replied: (Instant::now(), 0),
            lost_before_reply: 0,
            last_tick: None,
            noticed: Vec::new(),
            heard: Instant::now(),
            outside: Vec::new(),
            unanswered: 0,
            kept_alive: (Instant::now(), 0),
            gone: false,
            stopped,
            firmware: String::new(),
        };
        link.firmware = link.call()?;
        if version(&link.firmware) != VERSION {
            // Text has no check sum, so it is asked for twice.
            link.firmware = link.call()?;
        }
        let version = version(&link.firmware);
        if version != VERSION {
            return Err(BoardError::Failed(format!(
                "the board runs motorbench {version}, this program is {VERSION}: flash this version's firmware (`cargo flash`), or use the program of the board's version"
            )));
        }
        link.switch_over()?;
        link.settle()?;
        Ok(link)
    }

    /// Switches from text to the binary stream, in which the answer comes.
    fn switch_over(&mut self) -> Result<(), BoardError> {
        for given_up in 0..TRIES {
            match self.command("stream binary") {
                Err(BoardError::Silent { .. } | BoardError::Failed(_) | BoardError::Refused { .. })
                    if !self.gone && given_up + 1 < TRIES => {}
                Err(error) => return Err(error),
                Ok(()) => {
                    // It may answer the line before; the stream then starts again with the last line.
                    self.unanswered += given_up;
                    return self.late_answers();
                }
            }
        }
        Ok(())
    }

    /// Calls until the firmware answers with its version, as text. A board that was streaming is stopped first.
    fn call(&mut self) -> Result<String, BoardError> {
        let end = Instant::now() + START_TIMEOUT;
        while Instant::now() < end {
            if self.is_stopped() {
                return Err(BoardError::Interrupted);
            }
            // An incomplete line of a program that died must not be carried out.
            self.write(format!("{DISCARD_LINE}\nstream off\necho off\nversion\n").as_bytes())?;
            let heard = self.hear(CALL_INTERVAL)?;
            let text = String::from_utf8_lossy(&heard).replace('\r', "");
            let version = text.rfind("motorbench ").map(|at| text[at..].lines().next().unwrap_or_default().to_owned());
            if let Some(version) = version.filter(|_| text.ends_with("ok\n")) {
                return Ok(version);
            }
        }
        Err(BoardError::Silent { line: "version".into() })
    }

    /// Reads raw bytes until nothing has come for some time.
    fn hear(&mut self, duration: Duration) -> Result<Vec<u8>, BoardError> {
        let (begun, mut last, mut heard, mut buffer) = (Instant::now(), Instant::now(), Vec::new(), [0; 1024]);
        while last.elapsed() < duration && begun.elapsed() < START_TIMEOUT {
            let count = self.line.receive(&mut buffer).map_err(|error| self.lost_line(&error))?;
            heard.extend_from_slice(&buffer[..count]);
            if count > 0 {
                last = Instant::now();
            }
        }
        Ok(heard)
    }

    /// Discards what came before the stream was synchronised.
    fn settle(&mut self) -> Result<(), BoardError> {
        self.poll()?;
        self.samples.clear();
        self.outside.clear();
        (self.decoder.lost, self.decoder.damaged) = (0, 0);
        self.lost_before_reply = 0;
        self.noticed.clear();
        Ok(())
    }
}

/// The version in the firmware's answer.
fn version(greeting: &str) -> &str {
    greeting.trim_start_matches("motorbench ").split([',', ' ']).next().unwrap_or_default()
}

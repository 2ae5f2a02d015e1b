//! The firmware over a serial line: a board on a USB port, or the simulated chip behind a pseudo-terminal.
//!
//! [`Link`] speaks the console's lines inside the binary stream of [`motorbench_core::protocol`]: telemetry goes on while a
//! command is answered, and what is lost or damaged on the way is counted. When it is dropped it disarms the drive.

pub mod coverage;
pub mod port;
pub mod record;

use crate::board::{Board, BoardError};
use motorbench_core::message::Sample;
use motorbench_core::protocol::{Frame, StreamDecoder};
use motorbench_core::settings::{Param, Settings, Text, find, text};
use std::io::{self, Read, Write};
use std::time::{Duration, Instant};

/// After a reset the boot loader waits this long for a new program, at most.
const START: Duration = Duration::from_secs(5);
/// Between two calls to a board that starts.
const CALL_AGAIN: Duration = Duration::from_millis(300);
/// How long an answer may take; `show` is the longest.
const ANSWER: Duration = Duration::from_secs(4);
/// Firmware and program understand each other within one version of the protocol.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// A serial line. A read that times out is no error: it returns 0 bytes.
pub trait Line: Send {
    /// Reads what has come, waiting a few milliseconds at most.
    ///
    /// # Errors
    /// When the line is gone.
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Writes everything.
    ///
    /// # Errors
    /// When the line is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;
}

impl<T: Read + Write + Send + ?Sized> Line for Box<T> {
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.read(buffer) {
            // A pseudo-terminal whose other end is closed, and a USB port that was unplugged.
            Ok(0) => Err(io::ErrorKind::BrokenPipe.into()),
            Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => Ok(0),
            other => other,
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_all(bytes)
    }
}

/// What was lost on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Losses {
    /// Frames that never came.
    pub lost_frames: u32,
    /// Frames that came damaged.
    pub damaged_frames: u32,
}

/// The firmware at the other end of a line.
pub struct Link<L: Line> {
    line: L,
    decoder: StreamDecoder,
    samples: Vec<Sample>,
    reply: String,
    last_tick: Option<u32>,
    gone: bool,
    /// What the firmware says of itself.
    pub firmware: String,
}

impl<L: Line> Link<L> {
    /// Waits for the firmware, checks its version and switches the binary stream on.
    ///
    /// # Errors
    /// [`BoardError`]: nothing answers, or another version does.
    pub fn start(line: L) -> Result<Self, BoardError> {
        let mut link = Self {
            line,
            decoder: StreamDecoder::default(),
            samples: Vec::new(),
            reply: String::new(),
            last_tick: None,
            gone: false,
            firmware: String::new(),
        };
        link.firmware = link.call()?;
        let version = link.firmware.trim_start_matches("motorbench ").split([',', ' ']).next().unwrap_or_default();
        if version != VERSION {
            return Err(BoardError::Failed(format!(
                "the board runs motorbench {version}, this program is {VERSION}: flash the firmware of this version (`cargo flash`), or use the program of that one"
            )));
        }
        link.command("stream binary")?;
        link.settle()?;
        Ok(link)
    }

    /// Calls until the firmware says its version, as text. A board that was streaming is told to stop first.
    fn call(&mut self) -> Result<String, BoardError> {
        let end = Instant::now() + START;
        while Instant::now() < end {
            self.write(b"\nstream off\necho off\nversion\n")?;
            let heard = self.hear(CALL_AGAIN)?;
            let text = String::from_utf8_lossy(&heard).replace('\r', "");
            let version = text.rfind("motorbench ").map(|at| text[at..].lines().next().unwrap_or_default().to_owned());
            if let Some(version) = version.filter(|_| text.ends_with("ok\n")) {
                return Ok(version);
            }
        }
        Err(BoardError::Silent { line: "version".into() })
    }

    /// Everything that comes within some time, as it is.
    fn hear(&mut self, duration: Duration) -> Result<Vec<u8>, BoardError> {
        let (end, mut heard, mut buffer) = (Instant::now() + duration, Vec::new(), [0; 1024]);
        while Instant::now() < end {
            let count = self.line.receive(&mut buffer).map_err(|error| self.lost_line(&error))?;
            heard.extend_from_slice(&buffer[..count]);
        }
        Ok(heard)
    }

    /// Forgets what came before the stream was in step.
    fn settle(&mut self) -> Result<(), BoardError> {
        self.poll()?;
        self.samples.clear();
        (self.decoder.lost, self.decoder.damaged) = (0, 0);
        Ok(())
    }

    /// What was lost since the start.
    pub fn losses(&self) -> Losses {
        Losses { lost_frames: self.decoder.lost, damaged_frames: self.decoder.damaged }
    }

    /// Sends a line of the console; the lines of its answer, without `# ` and without the closing `ok`.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn ask(&mut self, line: &str) -> Result<Vec<String>, BoardError> {
        self.reply.clear();
        self.write(format!("{line}\n").as_bytes())?;
        let end = Instant::now() + ANSWER;
        while Instant::now() < end {
            self.poll()?;
            let whole = self.reply.ends_with('\n');
            match self.reply.lines().last().filter(|_| whole) {
                Some("ok") => {
                    let lines = self.reply.lines().filter_map(|line| line.strip_prefix("# "));
                    return Ok(lines.map(str::to_owned).collect());
                }
                Some(reply) if reply.starts_with("error: ") => {
                    return Err(BoardError::Refused { line: line.into(), reply: reply.into() });
                }
                _ => {}
            }
        }
        Err(BoardError::Silent { line: line.into() })
    }

    /// Saves the settings and waits until they are in the EEPROM, 3.4 ms a byte that differs.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn save(&mut self) -> Result<(), BoardError> {
        self.command("save")?;
        let end = Instant::now() + ANSWER;
        while !self.reply.lines().any(|line| line == "# saved") {
            if Instant::now() > end {
                return Err(BoardError::Failed("the board does not say that the settings are saved".into()));
            }
            self.poll()?;
        }
        Ok(())
    }

    /// The settings as the board has them.
    ///
    /// # Errors
    /// [`BoardError`], also when it knows other settings than this program.
    pub fn settings(&mut self) -> Result<Settings, BoardError> {
        let lines = self.ask("show")?;
        let mut settings = Settings::defaults();
        let mut known = 0;
        for line in &lines {
            let mut words = line.split(' ');
            let (name, value) = (words.next().unwrap_or_default(), words.next().and_then(|word| word.parse().ok()));
            if let (Some(param), Some(value)) = (find(name.as_bytes()), value) {
                settings.values[param as usize] = value;
                known += 1;
            }
        }
        if known == Param::COUNT && known == lines.len() {
            return Ok(settings);
        }
        Err(BoardError::Failed(format!(
            "the board lists {} settings, of which this program knows {known} of its {}: flash the firmware of this version",
            lines.len(),
            Param::COUNT
        )))
    }

    /// Takes what has come.
    fn poll(&mut self) -> Result<(), BoardError> {
        let mut buffer = [0; 4096];
        let count = self.line.receive(&mut buffer).map_err(|error| self.lost_line(&error))?;
        for &byte in &buffer[..count] {
            match self.decoder.push(byte) {
                Some(Frame::Sample(sample)) => self.take(sample)?,
                Some(Frame::Text(text, length)) => {
                    self.reply += &String::from_utf8_lossy(&text[..length]).replace('\r', "");
                }
                None => {}
            }
        }
        Ok(())
    }

    /// Ticks count up from a reset: one that goes back means another.
    fn take(&mut self, sample: Sample) -> Result<(), BoardError> {
        if self.last_tick.is_some_and(|last| sample.tick < last) {
            self.gone = true;
            return Err(BoardError::Failed(
                "the board was reset: the drive is off; look for a loose supply or a watchdog (`status` says the cause)".into(),
            ));
        }
        self.last_tick = Some(sample.tick);
        self.samples.push(sample);
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        self.line.send(bytes).map_err(|error| self.lost_line(&error))
    }

    fn lost_line(&mut self, error: &io::Error) -> BoardError {
        self.gone = true;
        BoardError::Failed(format!(
            "the connection is gone ({error}): plug the board in again; set `trip_host` and the drive stops by itself in such a case"
        ))
    }
}

/// The console's name of a setting.
pub fn name(param: Param) -> String {
    text(param, Text::Name).map(char::from).collect()
}

impl<L: Line> Board for Link<L> {
    fn command(&mut self, line: &str) -> Result<(), BoardError> {
        self.ask(line).map(|_| ())
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
}

impl<L: Line> Drop for Link<L> {
    /// Leaves the motor without drive and the console as a person expects it.
    fn drop(&mut self) {
        if !self.gone {
            let _ = self.line.send(b"\ndisarm\nstream off\necho on\n");
        }
    }
}

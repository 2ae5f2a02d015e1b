//! The firmware over a serial line: a board on a USB port, or the simulated chip behind a pseudo-terminal.
//!
//! [`Link`] sends the console's lines inside the binary stream of [`motorbench_core::protocol`]. Telemetry continues
//! while a command is answered, and lost or damaged frames are counted. When it is dropped it disarms the drive.

use crate::board::{Board, BoardError, KEEP_ALIVE};
use crate::line::Line;
use motorbench_core::message::{Sample, State};
use motorbench_core::protocol::{Frame, StreamDecoder};
use motorbench_core::settings::{Param, Settings, find};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// After a reset the boot loader waits this long for a new program, at most.
const START_TIMEOUT: Duration = Duration::from_secs(8);
/// Interval between two calls to a starting board.
const CALL_INTERVAL: Duration = Duration::from_millis(300);
/// Longest time for an answer; `show` takes longest.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(4);
/// The same by the board's own clock, and the limit by the computer's clock.
const ANSWER_TICKS: u32 = 4000;
const LONGEST_ANSWER: Duration = Duration::from_secs(60);
/// The same after Ctrl-C.
const INTERRUPTED_ANSWER_TIMEOUT: Duration = Duration::from_secs(1);
const INTERRUPTED_ANSWER_TICKS: u32 = 1000;
/// Hint for bytes that are missing without a fault of the cable; `PORT` stands for the port's name.
pub const OTHER_READER: &str = "another program may be reading the port (`lsof PORT` names it)";
/// Number of times a line is sent that may have been damaged.
const TRIES: u32 = 3;
/// The same over a line that loses frames, as long as some come whole.
const LOSSY_TRIES: u32 = 10;
/// Longest wait for a damaged answer after its last part, by both clocks. With [`LATE_ANSWER_TIMEOUT`] it is well within
/// [`LOST_AFTER_MS`](crate::board::LOST_AFTER_MS), so that the board does not miss its host.
const DAMAGED_ANSWER_TIMEOUT: Duration = Duration::from_millis(120);
const DAMAGED_ANSWER_TICKS: u32 = 120;
/// Marks lost frames within a line of a reply.
const GAP: char = char::REPLACEMENT_CHARACTER;
/// Longest wait for a late answer to a line that was given up, by both clocks.
const LATE_ANSWER_TIMEOUT: Duration = Duration::from_millis(200);
const LATE_ANSWER_TICKS: u32 = 200;
/// [`KEEP_ALIVE`] in samples: the board's clock may be ahead of a program that had to wait.
const KEEP_ALIVE_TICKS: u32 = 100;
/// Longest wait for the answer to a keep-alive line.
const KEEP_ALIVE_TIMEOUT: Duration = Duration::from_millis(50);
/// The greeting of a board after a reset: two lines outside of any frame.
const GREETING: &[u8] = b"# motorbench ";
const GREETING_CAUSE: &[u8] = b"# reset: ";
/// Ctrl-U: the console discards the line so far.
const DISCARD_LINE: &str = "\x15";
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

    /// Sends a line of the console; the lines of its answer, without `# ` and without the closing `ok`.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn ask(&mut self, line: &str) -> Result<Vec<String>, BoardError> {
        if lines(line).nth(1).is_some() {
            let reply = "error: more than one line; each line has its own answer".into();
            return Err(BoardError::Refused { line: line.into(), reply });
        }
        self.late_answers()?;
        self.say(line)?;
        let (begun, tick, is_last, before) = (Instant::now(), self.last_tick, self.is_stopped(), self.losses());
        let (within, ticks) = if is_last {
            (INTERRUPTED_ANSWER_TIMEOUT, INTERRUPTED_ANSWER_TICKS)
        } else {
            (ANSWER_TIMEOUT, ANSWER_TICKS)
        };
        while begun.elapsed() < within || self.is_slow(begun, tick, ticks) {
            self.poll()?;
            if let Some(answer) = self.answer(line) {
                return answer;
            }
            // A working board has answered by then. The motor is stopped before the link is closed.
            if !is_last && self.is_stopped() && begun.elapsed() > INTERRUPTED_ANSWER_TIMEOUT {
                return Err(BoardError::Interrupted);
            }
            if self.losses() != before && self.is_overdue() {
                break;
            }
        }
        Err(match self.losses() {
            Losses { lost_frames: 0, damaged_frames: 0 } => BoardError::Silent { line: line.into() },
            losses => damaged_line(losses, &format!("no answer to `{line}`")),
        })
    }

    /// Repeats a line until an answer comes whole, as long as the line loses only some of them. A refused line had no
    /// effect: it is sent again, as it may have been damaged on the way.
    fn ask_again(&mut self, line: &str) -> Result<Vec<String>, BoardError> {
        for tried in 1.. {
            let asked = self.ask_noting_losses(line);
            let again = match &asked {
                (Ok(lines), is_lossy) => *is_lossy && lines.iter().any(|line| line.contains(GAP)),
                (Err(BoardError::Refused { .. }), is_lossy) => tried < TRIES || *is_lossy,
                (Err(_), is_lossy) => *is_lossy,
            };
            if !again || tried >= LOSSY_TRIES {
                return asked.0;
            }
        }
        unreachable!("the loop only ends by its return")
    }

    /// Also returns whether frames were lost meanwhile, and others came.
    fn ask_noting_losses(&mut self, line: &str) -> (Result<Vec<String>, BoardError>, bool) {
        let (begun, before) = (Instant::now(), self.losses());
        let asked = self.ask(line);
        let is_lossy = self.losses() != before && self.heard > begun && !self.gone && !self.is_stopped();
        (asked, is_lossy)
    }

    /// Whether the board has had enough time for the answer, and sends other things.
    fn is_overdue(&self) -> bool {
        let (replied, tick) = self.replied;
        let ticks = self.last_tick.unwrap_or(0).saturating_sub(tick);
        replied.elapsed() > DAMAGED_ANSWER_TIMEOUT && ticks > DAMAGED_ANSWER_TICKS
    }

    fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Sends a line; `reply` then starts with its answer.
    fn say(&mut self, line: &str) -> Result<(), BoardError> {
        // Any line keeps the board alive.
        self.kept_alive = (Instant::now(), self.last_tick.unwrap_or(0));
        self.unanswered = self.unanswered.saturating_sub(self.answers()) + 1;
        self.reply.clear();
        (self.replied, self.lost_before_reply) = (self.kept_alive, self.decoder.lost);
        // Ends the remains of a damaged line before this one begins.
        self.write(format!("\n{line}\n").as_bytes())
    }

    /// Waits for answers to lines that were given up, so that they are not taken as the answer to the next line.
    fn late_answers(&mut self) -> Result<(), BoardError> {
        let (begun, tick) = (Instant::now(), self.last_tick);
        while self.answers() < self.unanswered
            && (begun.elapsed() < LATE_ANSWER_TIMEOUT || self.is_slow(begun, tick, LATE_ANSWER_TICKS))
        {
            self.poll()?;
        }
        self.unanswered = 0;
        Ok(())
    }

    /// Number of whole answers in `reply`.
    fn answers(&self) -> u32 {
        let whole = self.reply.split_inclusive('\n').filter(|line| line.ends_with('\n'));
        whole.filter(|line| *line == "ok\n" || line.starts_with("error: ")).count() as u32
    }

    /// Whether the board still sends samples or a long answer, and its own clock has not reached this many ticks. A
    /// busy computer may delay a simulated board, or the bytes.
    fn is_slow(&self, begun: Instant, tick: Option<u32>, within: u32) -> bool {
        let ticks = self.last_tick.unwrap_or(0).saturating_sub(tick.unwrap_or(0));
        ticks < within && self.heard.elapsed() < ANSWER_TIMEOUT && begun.elapsed() < LONGEST_ANSWER
    }

    /// The answer, once it is whole: it ends with the last line. An error before that belongs to the remains of a
    /// damaged line. The board's own messages may follow.
    fn answer(&self, line: &str) -> Option<Result<Vec<String>, BoardError>> {
        let reply = self.reply.strip_suffix(SAVED).unwrap_or(&self.reply);
        let last = reply.ends_with('\n').then(|| reply.lines().last())??;
        if last == "ok" {
            let lines = reply.lines().filter_map(|line| line.strip_prefix("# "));
            return Some(Ok(lines.map(str::to_owned).collect()));
        }
        let refused = || Err(BoardError::Refused { line: line.into(), reply: last.into() });
        last.starts_with("error: ").then(refused)
    }

    /// Sends a keep-alive line. If it is damaged, the next one replaces it.
    fn keep_alive(&mut self) -> Result<(), BoardError> {
        self.say("alive")?;
        let end = Instant::now() + KEEP_ALIVE_TIMEOUT;
        while self.answers() < self.unanswered && Instant::now() < end {
            self.poll()?;
        }
        Ok(())
    }

    /// Saves the settings and waits until they are in the EEPROM, 3.4 ms for each byte that differs.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn save(&mut self) -> Result<(), BoardError> {
        self.command("save")?;
        let end = Instant::now() + ANSWER_TIMEOUT;
        while !self.reply.contains(SAVED) {
            if Instant::now() > end {
                return Err(BoardError::Failed("the board does not confirm that the settings are saved".into()));
            }
            self.poll()?;
        }
        Ok(())
    }

    /// The settings of the board. If the line loses part of the list, several lists are combined.
    ///
    /// # Errors
    /// [`BoardError`], also if its settings differ from those of this program.
    pub fn settings(&mut self) -> Result<Settings, BoardError> {
        let mut known = [None; Param::COUNT];
        for tried in 1..=LOSSY_TRIES {
            let (lines, is_lossy) = match self.ask_noting_losses("show") {
                (Ok(lines), is_lossy) => (lines, is_lossy),
                (Err(_), true) => (self.whole_lines(), true),
                // The line may have been damaged on its way.
                (Err(BoardError::Refused { .. }), false) if tried < TRIES => continue,
                (Err(error), false) => return Err(error),
            };
            take_settings(&lines, &mut known)?;
            let unknown = known.iter().filter(|value| value.is_none()).count();
            if unknown == 0 {
                return Ok(Settings { values: known.map(Option::unwrap_or_default) });
            }
            if !is_lossy {
                return Err(other_settings(lines.len(), Param::COUNT - unknown));
            }
        }
        Err(damaged_line(self.losses(), "the list of settings stays incomplete"))
    }

    /// The part of an answer that has come.
    fn whole_lines(&self) -> Vec<String> {
        let whole = self.reply.split_inclusive('\n').filter_map(|line| line.strip_prefix("# ")?.strip_suffix('\n'));
        whole.map(str::to_owned).collect()
    }

    /// The value that the board shows of one setting.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn shows(&mut self, setting: &str) -> Result<Option<f32>, BoardError> {
        let mut shown = None;
        for _ in 0..LOSSY_TRIES {
            let before = self.losses();
            let lines = self.ask_again(&format!("show {setting}"))?;
            shown = lines.first().and_then(|line| line.split(' ').nth(1)?.parse().ok());
            if shown.is_some() || self.losses() == before {
                break;
            }
        }
        Ok(shown)
    }

    /// Whether unread samples of a sequence come: a busy computer may be behind.
    fn comes_to_play(&mut self) -> Result<bool, BoardError> {
        let begun = Instant::now();
        loop {
            if self.samples.iter().any(|sample| sample.state.has(State::PLAYING)) {
                return Ok(true);
            }
            if begun.elapsed() > LATE_ANSWER_TIMEOUT {
                return Ok(false);
            }
            self.stay_alive()?;
            self.poll()?;
        }
    }

    /// Begins a sequence, once: if the answer is lost but it plays, it is not begun again.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn begin(&mut self, order: &str) -> Result<(), BoardError> {
        for tried in 1.. {
            let (asked, is_lossy) = self.ask_noting_losses(order);
            match asked {
                Ok(_) => return Ok(()),
                Err(_) if is_lossy && self.comes_to_play()? => return Ok(()),
                Err(_) if is_lossy && tried < LOSSY_TRIES => {}
                Err(BoardError::Refused { .. }) if tried < TRIES => {}
                Err(error) => return Err(error),
            }
        }
        unreachable!("the loop only ends by its return")
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

/// Reads the values of a list of settings; incomplete lines are ignored.
fn take_settings(lines: &[String], known: &mut [Option<f32>; Param::COUNT]) -> Result<(), BoardError> {
    for line in lines.iter().filter(|line| !line.contains(GAP)) {
        let mut words = line.split(' ');
        let (name, value) = (words.next().unwrap_or_default(), words.next().and_then(|word| word.parse().ok()));
        match (find(name.as_bytes()), value) {
            (Some(param), Some(value)) => known[param as usize] = Some(value),
            _ => return Err(other_settings(lines.len(), known.iter().flatten().count())),
        }
    }
    Ok(())
}

fn other_settings(listed: usize, known: usize) -> BoardError {
    let all = Param::COUNT;
    BoardError::Failed(format!(
        "the board lists {listed} settings; this program knows {known} of them and expects {all}. Flash the firmware of this version"
    ))
}

/// Splits a text at the console's line ends.
pub fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.split(['\r', '\n'])
}

/// The version in the firmware's answer.
fn version(greeting: &str) -> &str {
    greeting.trim_start_matches("motorbench ").split([',', ' ']).next().unwrap_or_default()
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

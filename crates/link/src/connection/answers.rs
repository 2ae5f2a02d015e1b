//! Lines of the console and their answers. Answers may be late, damaged, or never come.

use super::{ANSWER_TIMEOUT, GAP, LATE_ANSWER_TIMEOUT, LOSSY_TRIES, Link, Losses, SAVED, TRIES, damaged_line, lines};
use crate::board::{Board, BoardError};
use crate::line::Line;
use motorbench_core::message::State;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// [`ANSWER_TIMEOUT`] by the board's own clock, and the limit by the computer's clock.
pub(super) const ANSWER_TICKS: u32 = 4000;
const LONGEST_ANSWER: Duration = Duration::from_secs(60);
/// The same after Ctrl-C.
const INTERRUPTED_ANSWER_TIMEOUT: Duration = Duration::from_secs(1);
const INTERRUPTED_ANSWER_TICKS: u32 = 1000;
/// Longest wait for a damaged answer after its last part, by both clocks. With [`LATE_ANSWER_TIMEOUT`] it is well within
/// [`LOST_AFTER_MS`](crate::board::LOST_AFTER_MS), so that the board does not miss its host.
const DAMAGED_ANSWER_TIMEOUT: Duration = Duration::from_millis(120);
const DAMAGED_ANSWER_TICKS: u32 = 120;
/// [`LATE_ANSWER_TIMEOUT`] by the board's clock.
const LATE_ANSWER_TICKS: u32 = 200;
/// Longest wait for the answer to a keep-alive line.
const KEEP_ALIVE_TIMEOUT: Duration = Duration::from_millis(50);

impl<L: Line> Link<L> {
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
        while self.has_time(begun, tick, within, ticks) {
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
    /// effect: it is sent again, as it may have been damaged on the way. So the board has refused it when it says the same
    /// several times while nothing is lost.
    pub(super) fn ask_again(&mut self, line: &str) -> Result<Vec<String>, BoardError> {
        let before = self.losses();
        let (mut refusal, mut said) = (String::new(), 0);
        for tried in 1.. {
            let (asked, is_lossy) = self.ask_noting_losses(line);
            let again = match &asked {
                Ok(lines) => is_lossy && lines.iter().any(|line| line.contains(GAP)),
                Err(BoardError::Refused { reply, .. }) => {
                    if !is_lossy {
                        said = if *reply == refusal { said + 1 } else { 1 };
                        refusal.clone_from(reply);
                    }
                    said < TRIES
                }
                Err(_) => is_lossy,
            };
            if again && tried < LOSSY_TRIES {
                continue;
            }
            return match asked {
                Err(refused @ BoardError::Refused { .. }) if again && self.losses() != before => {
                    Err(damaged_line(self.losses(), &refused.to_string()))
                }
                asked => asked,
            };
        }
        unreachable!("the loop only ends by its return")
    }

    /// Also returns whether frames were lost meanwhile, and others came.
    pub(super) fn ask_noting_losses(&mut self, line: &str) -> (Result<Vec<String>, BoardError>, bool) {
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

    pub(super) fn is_stopped(&self) -> bool {
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
    pub(super) fn late_answers(&mut self) -> Result<(), BoardError> {
        let (begun, tick) = (Instant::now(), self.last_tick);
        while self.answers() < self.unanswered && self.has_time(begun, tick, LATE_ANSWER_TIMEOUT, LATE_ANSWER_TICKS) {
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

    /// Whether this time is not over by the computer's clock, or by the board's while it still sends samples or a long answer.
    /// A busy computer may delay a simulated board, or the bytes.
    pub(super) fn has_time(&self, begun: Instant, tick: Option<u32>, within: Duration, ticks: u32) -> bool {
        let passed = self.last_tick.unwrap_or(0).saturating_sub(tick.unwrap_or(0));
        let is_slow = passed < ticks && self.heard.elapsed() < ANSWER_TIMEOUT && begun.elapsed() < LONGEST_ANSWER;
        begun.elapsed() < within || is_slow
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
    pub(super) fn keep_alive(&mut self) -> Result<(), BoardError> {
        self.say("alive")?;
        let end = Instant::now() + KEEP_ALIVE_TIMEOUT;
        while self.answers() < self.unanswered && Instant::now() < end {
            self.poll()?;
        }
        Ok(())
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
}

//! The settings of a board: read from lists that the line may damage, and saved.

use super::answers::ANSWER_TICKS;
use super::{ANSWER_TIMEOUT, GAP, LOSSY_TRIES, Link, SAVED, TRIES, damaged_line};
use crate::board::{Board, BoardError};
use crate::line::Line;
use motorbench_core::settings::{Param, Settings, find};
use std::time::Instant;

impl<L: Line> Link<L> {
    /// Saves the settings and waits until they are in the EEPROM, 3.4 ms for each byte that differs.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn save(&mut self) -> Result<(), BoardError> {
        self.command("save")?;
        let (begun, tick) = (Instant::now(), self.last_tick);
        while !self.reply.contains(SAVED) {
            if !self.has_time(begun, tick, ANSWER_TIMEOUT, ANSWER_TICKS) {
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

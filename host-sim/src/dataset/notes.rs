//! What is said of how the recordings were made, where the rig file does not say it.

use super::{
    Contradiction, Dataset, EdgeTiming, EndOfRange, Output, PWM_HZ, SHORTEST_S, Stretch, dead_current, held_rotor,
    row_order,
};
use crate::recording::Channel;
use crate::terminal_text::short;

/// Said of commands that changed between rows.
const BETWEEN_ROWS: &str = "The commands changed between rows, and the rows do not say when: the moments of these changes were found in the readings, in the data kept back as well, and the intervals do not know what they leave open. Write a row for each command; [recording] command_delay_s = 0 in the rig file takes them as they stand.";

/// Said of an angle that only a tachogenerator tells.
const BY_RIPPLE: &str = "Where on the revolution the shaft is, the ripple of the speed says, in the data kept back as well: the speed's integral loses it. An encoder would say it.";

/// Said of a speed that is no more than taken for that.
const OVER_ITS_ROW: &str = "The speed is taken for a mean since the row before, which explains it as well as a delay would: [recording] speed_window_s in the rig file says what it is (0: of the moment).";

impl Dataset {
    /// What was found of how the recordings were made, where the rig file does not say it.
    pub fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.origin.contradictions.iter().map(Contradiction::note).collect();
        notes.extend(self.origin.empty.iter().map(|channel| without_a_number(*channel)));
        if !self.origin.held_rotor.is_empty() {
            notes.push(held_rotor::note(&self.origin.held_rotor));
        }
        notes.extend(self.origin.dead_current_a.map(dead_current::note));
        if self.origin.written_after {
            notes.push(row_order::WRITTEN_AFTER.into());
        }
        if self.has_moments() {
            notes.push(BETWEEN_ROWS.into());
        }
        if let Some(Stretch { window, interval_s, .. }) = self.stretches.first()
            && self.motion().output == Output::MeanSpeed
            && self.origin.timing.speed_window_s.is_none()
        {
            notes.push(if self.origin.taken_over_its_row { OVER_ITS_ROW.into() } else { window.note(*interval_s) });
        }
        if self.origin.angle_by_ripple {
            notes.push(BY_RIPPLE.into());
        }
        notes.extend(self.origin.edge_timing.as_ref().and_then(EdgeTiming::note));
        if let Some(first) = self.origin.counter_stops.first() {
            notes.push(format!(
                "In {} places the counter stood while the motor was driven on (the first at {:.3} s, for {:.3} s): those rows are not compared. What holds the program up there, an interrupt or a serial line?",
                self.origin.counter_stops.len(), self.time_s[first.rows.start], self.length_s(first)
            ));
        }
        if let Some(EndOfRange { value, rows }) = self.origin.end_of_range {
            notes.push(format!(
                "{} runs against {} rad/s and stands there, in {:.0} % of the rows: the range of its sensor ends there. Those rows are not compared. Record slower, or with a sensor of more range.",
                self.motion().output.channel(), short(value), 100.0 * rows as f64 / self.len() as f64
            ));
        }
        if self.origin.impossible > 0 {
            notes.push(format!(
                "{} rows are left out, each of a speed that no shaft can have had for one row alone: were lines garbled?",
                self.origin.impossible
            ));
        }
        if self.origin.without_time > 0 {
            notes.push(format!(
                "{} rows are left out, whose t_s is no number: were lines garbled?",
                self.origin.without_time
            ));
        }
        if self.span_s() < SHORTEST_S {
            notes.push(format!(
                "{:.1} s are little to tell causes apart: play the sequence `identify` (20 s), which shows most of them.",
                self.span_s()
            ));
        }
        if self.origin.lost_share > 0.0 {
            notes.push(format!(
                "{:.1} % of all counts are taken for lost, by their scatter, and speeds and angles for as much greater: every constant here is one of the motor with that.",
                100.0 * self.origin.lost_share
            ));
        }
        if self.origin.timing.current_window_s.is_none() && self.origin.current_window_s > 0.0 {
            notes.push(format!(
                "The current is taken for a mean over the {:.4} s before its row, which explains it as well as a lag or more inductance would: [recording] current_window_s in the rig file says what it is.",
                self.origin.current_window_s
            ));
        }
        if let Some(phase) = self.origin.pwm_phase {
            notes.push(format!(
                "Each current is taken for one of the moment of its row, in the phase {phase:.2} of the PWM at time 0, which explains it much better than a mean does. Average the current over a period of the PWM: then nobody has to find that out."
            ));
        }
        if !self.origin.pwm_is_known && self.origin.pwm_hz != PWM_HZ {
            notes.push(format!(
                "The PWM is taken for one of {:.0} Hz: the model explains more with it, or as much by an inductance nearer to the nominal one. It may stand for something else in the current. [bridge] pwm_Hz in the rig file says what it is.",
                self.origin.pwm_hz
            ));
        }
        notes
    }
}

fn without_a_number(channel: Channel) -> String {
    format!("{} has no number in any row, and is taken for not recorded.", channel.column())
}

//! Notes on how the recordings were made, where the rig file does not say it.

use super::{
    Averaged, Contradiction, Dataset, EdgeTiming, EndOfRange, Hum, Latch, LimitedDuty, Output, PWM_HZ, SHORTEST_S,
    Stretch, dead_current, held_rotor, row_order,
};
use motorbench_data::recording::Channel;
use motorbench_text::terminal_text::short;

/// Note on commands that changed between rows.
const BETWEEN_ROWS: &str = "The commands changed between rows. The times of these changes were estimated from the readings, also in the held-out data. The intervals do not contain that uncertainty. Write a row for each command. [recording] command_delay_s = 0 in the rig file takes the rows as they are.";

/// Note on an angle that was estimated from a tachogenerator.
const BY_RIPPLE: &str = "The angle of the shaft was estimated from the ripple of the speed, also in the held-out data. The integral of the speed is too noisy for it. An encoder would measure it.";

/// Note on a speed that is assumed to be a mean.
const OVER_ITS_ROW: &str = "The speed is compared as a mean since the row before; a delay would explain it as well. Set [recording] speed_window_s in the rig file to say which it is (0: of the moment).";

/// Note on commands of which the rows hold only some.
fn smooth_earlier(share: f64) -> String {
    format!(
        "Where the command changes smoothly, it acts {share} of a row before its row: the program seems to send more commands than it writes rows. Write a row for each command. [recording] command_delay_s in the rig file takes the rows as they are."
    )
}

/// Note on a speed that was found to be a moving average.
fn averaged(window_s: f64) -> String {
    format!(
        "The speed is compared as a mean over the last {} s: a lag explains it less well, or no better. If that is right, write [recording] speed_window_s = {0} into the rig file. A shorter window, or the counts themselves, would show more of the motor.",
        short(window_s)
    )
}

/// Note on a stated window that is one of readings.
fn of_readings(count: usize) -> String {
    format!(
        "The speed is compared as the mean of the last {count} readings. The mean over the time of [recording] speed_window_s explains much less."
    )
}

/// Note on readings with a hum.
fn hum(Hum { of, hz, amplitude }: &Hum) -> String {
    let (channel, unit) = (of.channel(), of.unit());
    format!(
        "{channel} has a hum of {hz:.2} Hz with an amplitude of {} {unit}, as of the mains. It was taken out of the readings. Twist or shield the wires of the sensor, and keep them away from the supply.",
        short(*amplitude)
    )
}

impl Dataset {
    /// Notes on what was found about the recordings and is not in the rig file.
    pub fn notes(&self) -> Vec<String> {
        let parts = [
            self.notes_on_the_files(),
            self.notes_on_times(),
            self.notes_on_rows_left_out(),
            self.notes_on_length_and_losses(),
            self.notes_on_the_current(),
        ];
        parts.concat()
    }

    fn notes_on_the_files(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.origin.contradictions.iter().map(Contradiction::note).collect();
        notes.extend(self.origin.reading.iter().cloned());
        notes.extend(self.origin.empty.iter().map(|channel| without_a_number(*channel)));
        if !self.origin.held_rotor.is_empty() {
            notes.push(held_rotor::note(&self.origin.held_rotor));
        }
        notes.extend(self.origin.dead_current_a.map(dead_current::note));
        notes.extend(self.origin.hums.iter().map(hum));
        notes
    }

    /// On command times, the window of a speed, and what tells the angle.
    fn notes_on_times(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.origin.written_after {
            notes.push(row_order::WRITTEN_AFTER.into());
        }
        notes.extend(self.origin.late_readings.map(|late| late.note()));
        match self.origin.smooth_earlier {
            Some(share) => notes.push(smooth_earlier(share)),
            None if self.has_moments() => notes.push(BETWEEN_ROWS.into()),
            None => (),
        }
        if let Some(Stretch { window, interval_s, .. }) = self.stretches.first()
            && self.motion().output == Output::MeanSpeed
        {
            let is_stated = self.origin.timing.speed_window_s.is_some();
            notes.extend(match (self.origin.taken_over_its_row, self.origin.averaged) {
                (_, Some(Averaged::Readings)) if is_stated => Some(of_readings(window.span + 1)),
                _ if is_stated => None,
                (true, _) => Some(OVER_ITS_ROW.into()),
                (_, Some(_)) => Some(averaged(window.span as f64 * interval_s)),
                _ => Some(window.note(*interval_s)),
            });
        }
        if self.origin.angle_by_ripple {
            notes.push(BY_RIPPLE.into());
        }
        notes.extend(self.origin.edge_timing.as_ref().and_then(EdgeTiming::note));
        notes
    }

    fn notes_on_rows_left_out(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some(first) = self.origin.counter_stops.first() {
            notes.push(format!(
                "The counter stood still in {} places while the motor was driven (first at {:.3} s, for {:.3} s). Those rows are not compared. Find what blocks the program there: an interrupt, or the serial line?",
                self.origin.counter_stops.len(), self.time_s[first.rows.start], self.length_s(first)
            ));
        }
        if let Some(EndOfRange { value, rows }) = self.origin.end_of_range {
            notes.push(format!(
                "{} stays at {} rad/s in {:.0} % of the rows: the end of its sensor's range. Those rows are not compared. Record at lower speed, or with a sensor of a wider range.",
                self.motion().output.channel(), short(value), 100.0 * rows as f64 / self.len() as f64
            ));
        }
        if let Some(LimitedDuty { rows, greatest }) = self.origin.limited_duty {
            notes.push(format!(
                "duty goes up to {} and is above 1 in {rows} rows. The whole supply is taken for it there, as a timer does. If its unit is another, --column duty=duty/VALUE corrects it.",
                short(greatest)
            ));
        }
        for rows in &self.origin.left_out {
            let [from_s, to_s] = [rows.start, rows.end - 1].map(|row| self.time_s[row]);
            notes.push(format!(
                "From {from_s:.2} s to {to_s:.2} s the motion does not follow its command, so these rows are left out: they would bend every constant. Did the program pause there, or did something touch the shaft?"
            ));
        }
        if self.origin.impossible > 0 {
            notes.push(format!(
                "{} rows are left out: each has a speed that no shaft can have for a single row. Lines may be garbled.",
                self.origin.impossible
            ));
        }
        if self.origin.without_time > 0 {
            notes.push(format!(
                "{} rows are left out because their t_s is no number. Lines may be garbled.",
                self.origin.without_time
            ));
        }
        notes
    }

    fn notes_on_length_and_losses(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.span_s() < SHORTEST_S {
            notes.push(format!(
                "{:.1} s are short to tell causes apart. Record the sequence `identify` (20 s).",
                self.span_s()
            ));
        }
        if self.origin.lost_share > 0.0 {
            notes.push(format!(
                "The scatter of the counts shows that {:.1} % of them are lost. Speeds and angles are corrected for that, and so are all constants.",
                100.0 * self.origin.lost_share
            ));
        }
        notes
    }

    /// On its window, and on the PWM in it.
    fn notes_on_the_current(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.origin.current_is_magnitude {
            notes.push("i_A never becomes negative though the voltage reverses. Its sensor has no sign, so it is compared with the magnitude of the current.".to_owned());
        }
        let window_s = self.origin.current_window_s;
        if self.origin.is_current_window_assumed() {
            notes.push(format!(
                "The current is compared as a mean over the {window_s:.4} s before its row; a lag or more inductance would explain it as well. Set [recording] current_window_s in the rig file to say which it is."
            ));
        }
        if let Some(phase) = self.origin.pwm_phase.filter(|_| self.reads_instants()) {
            let read = match window_s {
                0.0 => "an instantaneous value".to_owned(),
                _ => format!("a mean over the {window_s:.4} s before its row"),
            };
            notes.push(format!(
                "Each current is compared as {read}, {phase:.2} of a PWM period after the begin of one at t_s = 0. That fits much better than a mean over whole periods. Average the current over a PWM period in the program."
            ));
        }
        if let Some(stated) = self.origin.ripple_shows {
            let besides = stated.map_or(String::new(), |hz| format!(" The rig file says {} Hz.", short(hz)));
            notes.push(format!("The ripple of the current shows a PWM of {:.2} Hz.{besides}", self.origin.pwm_hz));
        }
        if self.origin.current_filter_s > 0.0 {
            notes.push(format!(
                "The ripple also shows a low-pass of {:.3} ms in front of the conversion, as of a capacitor at the sensor. It is simulated.",
                1e3 * self.origin.current_filter_s
            ));
        }
        if self.is_switched() {
            let since = if self.origin.latch == Latch::AtOnce {
                "A command changes the duty at once, within a period.".to_owned()
            } else {
                let period_ms = short(1e3 / self.origin.pwm_hz);
                format!("A command waits for the next period, up to {period_ms} ms. A faster PWM shortens that.")
            };
            notes.push(format!("The PWM is slow, so each of its edges is simulated. {since}"));
        }
        if !self.origin.pwm_is_known && self.origin.pwm_hz != PWM_HZ {
            notes.push(format!(
                "A PWM of {:.0} Hz is assumed: the model fits better with it, or its inductance is nearer to the nominal one. Something else in the current may cause that. Set [bridge] pwm_Hz in the rig file to the true frequency.",
                self.origin.pwm_hz
            ));
        }
        notes
    }
}

fn without_a_number(channel: Channel) -> String {
    format!("{} has no number in any row and is not used.", channel.column())
}

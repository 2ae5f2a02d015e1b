//! Recordings prepared for identification: the command, the measured quantities, and the held-out part.

use crate::configuration::dataset::{
    AT_REST, DIFFERENCE_SPAN_S, GREATEST_DUTY, LEFT_AFTER_A_ROW, LONGEST_INTERVAL_S, LONGEST_OF_ALL_S,
    ONE_MAGNITUDE_ROWS, SAME_MAGNITUDE, SETTLED, SHORTEST_S, SHORTEST_STRETCH, STEP,
};
pub use crate::configuration::dataset::{LONG_ROW, PWM_HZ};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_model::{Axis, Drive};
use std::ops::Range;

mod columns;
mod contradictions;
mod counted_edges;
mod counter_stops;
mod dead_current;
mod edge_timing;
mod end_of_range;
mod error;
mod held_out;
mod held_rotor;
mod late_readings;
mod measured;
mod mistakes;
mod noise;
mod notes;
mod origin;
mod otherwise;
mod pwm;
mod reading;
mod resolution;
mod row_order;
mod speed_window;
mod thinned;
mod turns;

use columns::held;
pub use columns::{NORMAL_MEDIAN, difference, greatest, median, runs, spread};
pub use contradictions::{Contradiction, contradictions};
pub use counter_stops::CounterStop;
pub use edge_timing::{BetweenEdges, EdgeTiming};
pub use end_of_range::EndOfRange;
pub use error::DatasetError;
pub use held_rotor::HeldRotor;
pub use late_readings::{LateCourse, LateReadings};
pub use measured::{Measured, Output, TOLERANCE};
pub use noise::{correlated_noise, noise};
pub use origin::{Averaged, Hum, Latch, LimitedDuty, Origin, Pulse};
pub use speed_window::Window;

/// Rows without a gap; the simulation restarts with each stretch.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Its rows.
    pub rows: Range<usize>,
    /// Usual time between them.
    pub interval_s: f64,
    /// Window over which a mean speed was taken.
    pub window: Window,
}

impl Stretch {
    /// Length of the window; one row for an instantaneous speed.
    pub fn window_s(&self) -> f64 {
        self.window.span.max(1) as f64 * self.interval_s
    }
}

/// Recordings of one rig, one after the other.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    /// Its parts; those of one recording are alike.
    pub stretches: Vec<Stretch>,
    /// Time of each sample since the start of its recording.
    pub time_s: Vec<f64>,
    /// What is imposed, and how the axis moves.
    pub axis: Axis,
    /// What was asked for from this sample to the next, or flowed: volts, amperes or newton metres, as the drive has it.
    pub command: Vec<f64>,
    /// The same as share of the supply, or of its greatest value.
    pub duty: Vec<f64>,
    /// How long before its row each command acted, if rows are fewer than commands; empty: at its row.
    pub earlier_s: Vec<f64>,
    /// Supply voltage; where no voltage is imposed, the greatest command.
    pub supply_v: Vec<f64>,
    /// The bridge is off from this sample to the next.
    pub open: Vec<bool>,
    /// Known load torque.
    pub load_nm: Vec<f64>,
    /// Angle of the shaft, as measured or integrated from the measured speed.
    pub angle_rad: Vec<f64>,
    /// The measured quantities.
    pub measured: Vec<Measured>,
    /// Samples that no fit uses.
    pub held_out: Vec<bool>,
    /// Usual time between samples; for several recordings that of the first.
    pub interval_s: f64,
    /// Step of the encoder; 0 without one.
    pub count_rad: f64,
    /// How it was recorded.
    pub origin: Origin,
}

impl Dataset {
    /// Joins recordings of one rig.
    ///
    /// # Errors
    /// [`DatasetError`], which says what to record or to write into the rig file.
    pub fn new(recordings: &[Recording], rig: &Rig) -> Result<Self, DatasetError> {
        for (index, recording) in recordings.iter().enumerate() {
            if let Some(same) = recordings[..index].iter().find(|earlier| earlier.has_the_rows_of(recording)) {
                return Err(DatasetError::Twice(recording.name.clone(), same.name.clone()));
            }
        }
        let mut each = Self::each(recordings, rig)?;
        dead_current::leave_out(&mut each, rig.current_sensor.resolution_a);
        each.iter_mut().zip(recordings).for_each(|(one, recording)| one.recognise_held_rotor(&recording.name));
        let mut all = Self::default();
        for (recording, one) in recordings.iter().zip(each) {
            if all.stretches.is_empty() {
                all = one;
                continue;
            }
            let has_the_same = all.measured.iter().map(|m| m.output).eq(one.measured.iter().map(|m| m.output));
            if !has_the_same || all.axis != one.axis {
                return Err(DatasetError::Mixed(recording.name.clone(), recordings[0].name.clone()));
            }
            all.append(one);
        }
        all.judge_noise(rig.current_sensor.resolution_a);
        // A measured current is none that was written.
        let may_be_written_after = rig.recording.command_delay_s.is_none() && all.axis.drive != Drive::Current;
        if may_be_written_after && row_order::is_written_after(&all) {
            all.origin.written_after = true;
            row_order::move_commands(&mut all, row_order::Towards::Before);
        }
        all.hold_out();
        if let Some(first) = recordings.first() {
            all.check_that_it_turns(&first.name)?;
            all.check(&first.name)?;
            all.check_signs(&first.name, &first.channels().collect::<Vec<_>>())?;
        }
        Ok(all)
    }

    /// The stretch that a row is in.
    pub fn stretch_of(&self, row: usize) -> Option<&Stretch> {
        self.stretches.iter().find(|stretch| stretch.rows.contains(&row))
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// The measured current, where there is one.
    pub fn current(&self) -> Option<&Measured> {
        self.measured.iter().find(|measured| measured.output == Output::Current)
    }

    fn current_mut(&mut self) -> Option<&mut Measured> {
        self.measured.iter_mut().find(|measured| measured.output == Output::Current)
    }

    /// The speed, or the quantity in its place.
    pub fn motion(&self) -> &Measured {
        &self.measured[self.motion_index()]
    }

    /// Its index in [`measured`](Self::measured).
    pub fn motion_index(&self) -> usize {
        let is_motion = |measured: &Measured| measured.output != Output::Current;
        self.measured.iter().position(is_motion).expect("checked when it was made")
    }

    /// When the command of a row began to act.
    pub fn acts_from_s(&self, row: usize) -> f64 {
        self.time_s[row] - self.earlier_s.get(row).copied().unwrap_or(0.0)
    }

    /// Whether the command times are estimated instead of taken from the rows.
    pub fn has_moments(&self) -> bool {
        !self.earlier_s.is_empty()
    }

    /// The angle from which a mean speed was computed: in each stretch from zero.
    fn integrate_mean_speed(&mut self) {
        let speed = held(&self.motion().values);
        for Stretch { rows, window, .. } in &self.stretches {
            let of_stretch = speed_window::angle_rad(&speed[rows.clone()], *window, &self.time_s[rows.clone()]);
            self.angle_rad[rows.clone()].copy_from_slice(&of_stretch);
        }
    }

    fn append(&mut self, other: Self) {
        let before = self.len();
        let moved = |rows: Range<usize>| rows.start + before..rows.end + before;
        self.stretches.extend(other.stretches.into_iter().map(|one| Stretch { rows: moved(one.rows), ..one }));
        self.time_s.extend(other.time_s);
        self.command.extend(other.command);
        self.duty.extend(other.duty);
        self.supply_v.extend(other.supply_v);
        self.open.extend(other.open);
        self.load_nm.extend(other.load_nm);
        self.angle_rad.extend(other.angle_rad);
        self.origin.append(other.origin, before);
        for (mine, theirs) in self.measured.iter_mut().zip(other.measured) {
            mine.values.extend(theirs.values);
            mine.of_counting = mine.of_counting.max(theirs.of_counting);
        }
    }

    /// Whether the motor is only driven by one voltage, in one direction and the other. An imposed current has no such
    /// doubt about it.
    pub fn has_one_magnitude(&self) -> bool {
        if !self.axis.drive.is_voltage() {
            return false;
        }
        let motion = &self.motion().values;
        let (asked_v, fastest) = (greatest(&self.command), greatest(motion));
        let drives = |row: usize, share: f64| !self.open[row] && self.command[row].abs() > share * asked_v;
        let happens = |row: &usize| drives(*row, AT_REST) || motion[*row].abs() > AT_REST * fastest;
        let happening = (0..self.len()).filter(happens).count();
        let by_that = (0..self.len()).filter(|row| drives(*row, SAME_MAGNITUDE)).count();
        by_that as f64 >= ONE_MAGNITUDE_ROWS * happening as f64
    }

    /// Whether it was driven in one direction from beginning to end.
    pub fn is_steady(&self) -> bool {
        spread(&self.command) < 1e-3 * greatest(&self.command)
    }

    /// Whether steps are seen on their way, and not only before and after: by the median over all steps.
    fn shows_steps(&self) -> bool {
        let motion = held(&self.motion().values);
        let least = STEP * greatest(&self.command);
        let is_step = |row: &usize| {
            let after = &self.command[*row..row + SETTLED];
            (after[0] - self.command[row - 1]).abs() > least && after.iter().all(|volts| *volts == after[0])
        };
        let left = |row: usize| {
            let [before, next, last] = [0, 1, SETTLED].map(|rows| motion[row + rows]);
            (last - next) / (last - before)
        };
        let rows = 1..self.len().saturating_sub(SETTLED);
        median(rows.filter(is_step).map(left)) > LEFT_AFTER_A_ROW
    }

    /// The same with one stretch of at most this length: the one in which the command changes most.
    pub fn excerpt(&self, length_s: f64) -> Self {
        let changes = |rows: &Range<usize>| {
            let volts = self.command[rows.clone()].windows(2);
            volts.map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>()
        };
        let parts = self.stretches.iter().flat_map(|stretch| {
            let most = ((length_s / stretch.interval_s) as usize).max(SHORTEST_STRETCH);
            let begins = stretch.rows.clone().step_by(most);
            let rows = begins.map(move |begin| begin..(begin + most).min(stretch.rows.end));
            rows.filter(|rows| rows.len() >= SHORTEST_STRETCH).map(move |rows| Stretch { rows, ..stretch.clone() })
        });
        let busiest = parts.max_by(|one, other| changes(&one.rows).total_cmp(&changes(&other.rows)));
        Self { stretches: busiest.into_iter().collect(), ..self.clone() }
    }

    /// Leaves out rows that do not follow their command. The simulation begins anew behind them, with what is measured
    /// there.
    pub fn leave_out_rows(&mut self, rows: Range<usize>) {
        for measured in &mut self.measured {
            measured.values[rows.clone()].fill(f64::NAN);
        }
        let parts = |stretch: &Stretch| {
            let before = stretch.rows.start..stretch.rows.end.min(rows.start);
            let after = stretch.rows.start.max(rows.end)..stretch.rows.end;
            let long = [before, after].into_iter().filter(|rows| rows.len() > SHORTEST_STRETCH);
            long.map(|rows| Stretch { rows, ..stretch.clone() }).collect::<Vec<_>>()
        };
        self.stretches = self.stretches.iter().flat_map(parts).collect();
        self.origin.left_out.push(rows);
        self.origin.left_out.sort_by_key(|rows| rows.start);
        // Rows between two of them that are too few went as well.
        self.origin.left_out.dedup_by(|next, last| {
            let adjoins = next.start <= last.end + SHORTEST_STRETCH;
            last.end = if adjoins { next.end.max(last.end) } else { last.end };
            adjoins
        });
    }

    /// Total length of all stretches.
    pub(crate) fn span_s(&self) -> f64 {
        self.stretches.iter().map(|Stretch { rows, .. }| self.time_s[rows.end - 1] - self.time_s[rows.start]).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;
    use std::fmt::Write as _;

    const COUNTS_PER_REV: f64 = 400.0;

    /// Counts of a shaft that goes both ways, and the duty of each half second.
    fn counts(time_s: f64) -> f64 {
        ((300.0 * (1.0 - (2.0 * time_s).cos()) - 40.0 * time_s) * COUNTS_PER_REV / TAU).floor()
    }

    fn duty(time_s: f64) -> f64 {
        (7.0 * (2.0 * time_s).floor()).sin()
    }

    /// Rows of time, duty and what `reading` says.
    fn recording(time_s: &[f64], column: &str, reading: impl Fn(f64) -> String) -> Recording {
        driven_recording(time_s, duty, column, reading)
    }

    fn driven_recording(
        time_s: &[f64],
        duty: impl Fn(f64) -> f64,
        column: &str,
        reading: impl Fn(f64) -> String,
    ) -> Recording {
        let mut text = format!("t_s,duty,{column}\n");
        for time_s in time_s {
            let _ = writeln!(text, "{time_s:.4},{:.4},{}", duty(*time_s), reading(*time_s));
        }
        Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()
    }

    /// Of the same counts, written at any rate: what a perfect model leaves is their rounding, and taken for that.
    #[test]
    fn rounding_counts_as_its_true_noise() {
        for interval_s in [1e-3, 4e-3, 1e-2] {
            let time_s: Vec<f64> = (0..(8.0 / interval_s) as usize).map(|row| row as f64 * interval_s).collect();
            let with_the_motion = |time_s: f64| 0.9 * (2.0 * time_s).sin();
            let reading = |time_s: f64| counts(time_s).to_string();
            let data = dataset(&[driven_recording(&time_s, with_the_motion, "counts", reading)]);
            let turned_rad = |time_s: f64| 300.0 * (1.0 - (2.0 * time_s).cos()) - 40.0 * time_s;
            let span_s = data.stretches[0].window_s();
            let (motion, ahead_s) = (data.motion(), data.stretches[0].window.ahead as f64 * interval_s);
            let exact = |end_s: f64| (turned_rad(end_s) - turned_rad(end_s - span_s)) / span_s;
            let rows = motion.values.iter().zip(&data.time_s);
            let left: Vec<f64> = rows.map(|(value, time_s)| value - exact(time_s + ahead_s)).collect();
            let seen = || left.iter().filter(|value| value.is_finite());
            let error = (seen().map(|value| value * value).sum::<f64>() / seen().count() as f64).sqrt();
            let ratio = motion.noise_in(&left) / error;
            assert!((0.85..1.2).contains(&ratio), "{interval_s} s, window {span_s} s: {ratio}");
        }
    }

    fn dataset(recordings: &[Recording]) -> Dataset {
        let rig = format!("[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = {COUNTS_PER_REV}\n");
        Dataset::new(recordings, &Rig::parse("rig.toml", &rig).unwrap()).unwrap()
    }

    fn rows(interval_s: f64, length_s: f64) -> Vec<f64> {
        (0..(length_s / interval_s) as usize).map(|row| row as f64 * interval_s).collect()
    }

    /// Where it begins does not matter, nor where the sketch lets it wrap.
    #[test]
    fn an_angle_within_a_revolution_goes_on_beyond_it() {
        let time_s = rows(1e-3, 4.0);
        let angle_rad = |time_s: f64| counts(time_s) * TAU / COUNTS_PER_REV;
        let whole = dataset(&[recording(&time_s, "theta_rad", |t_s| format!("{:.5}", angle_rad(t_s)))]);
        for least_rad in [0.0, -0.5 * TAU, -1.0] {
            let wrapped = |t_s: f64| format!("{:.5}", least_rad + (angle_rad(t_s) - least_rad).rem_euclid(TAU));
            let wrapped = dataset(&[recording(&time_s, "theta_rad", wrapped)]);
            for (row, (angle, other)) in wrapped.angle_rad.iter().zip(&whole.angle_rad).enumerate() {
                let since = [angle - wrapped.angle_rad[0], other - whole.angle_rad[0]];
                assert!((since[0] - since[1]).abs() < 1e-4, "row {row}: {since:?}");
            }
        }
    }

    /// A count that is not there is none that stands still.
    #[test]
    fn missing_counts_are_missing() {
        let time_s = rows(1e-3, 4.0);
        let whole = dataset(&[recording(&time_s, "counts", |t_s| counts(t_s).to_string())]);
        let is_missing = |t_s: f64| (t_s * 1e3).round() as usize % 97 == 50;
        let some = |t_s: f64| if is_missing(t_s) { String::new() } else { (counts(t_s) as i64 as i16).to_string() };
        let some = dataset(&[recording(&time_s, "counts", some)]);
        let pairs = || some.motion().values.iter().zip(&whole.motion().values);
        assert!(pairs().all(|(some, whole)| some.is_nan() || (some - whole).abs() < 1e-9));
        assert_eq!(pairs().filter(|(some, whole)| some.is_nan() && whole.is_finite()).count(), 2 * 41);
    }

    proptest! {
        // Each case is a recording of 4000 rows.
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// Over a pause the motor goes on as it was told, if it was told nothing else.
        #[test]
        fn a_pause_divides_where_the_command_may_have_changed(from_s in 0.6_f64..3.4, length_s in 0.02_f64..0.4) {
            let mut time_s = rows(1e-3, 4.0);
            time_s.retain(|t_s| !(from_s..from_s + length_s).contains(t_s));
            let data = dataset(&[recording(&time_s, "counts", |t_s| counts(t_s).to_string())]);
            let after = time_s.iter().position(|t_s| *t_s > from_s).unwrap();
            let is_held = duty(time_s[after - 1]) == duty(time_s[after]);
            prop_assert_eq!(data.stretches.len(), if is_held { 1 } else { 2 });
        }
    }

    /// A program that writes milliseconds into t_s, or microseconds; a table by hand.
    #[test]
    fn what_is_too_slow_to_show_a_motor_is_refused() {
        for (scale, expected) in [(1e3, "in milliseconds? Then"), (1e6, "--column t_s=t_s*0.000001")] {
            let time_s: Vec<f64> = rows(1e-3, 4.0).iter().map(|t_s| scale * t_s).collect();
            let slow = recording(&time_s, "counts", |t_s| counts(t_s / scale).to_string());
            let error = Dataset::new(&[slow], &Rig::default()).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("100 Hz or more"), "{error}");
        }
    }

    /// An encoder beside it does not make it one of counts.
    #[test]
    fn a_speed_that_runs_against_its_end_does_so_beside_an_encoder() {
        let speed = |t_s: f64| (600.0 * (2.0 * t_s).sin() - 40.0).clamp(-300.0, 300.0);
        let data = dataset(&[recording(&rows(1e-3, 4.0), "omega_rad_per_s", |t_s| format!("{:.3}", speed(t_s)))]);
        assert_eq!(data.origin.end_of_range.map(|end| end.value), Some(300.0));
    }

    #[test]
    fn an_empty_current_column_is_not_used() {
        let mut text = String::from("t_s,duty,counts,i_A\n");
        for t_s in rows(1e-3, 4.0) {
            let _ = writeln!(text, "{t_s:.4},{:.4},{},nan", duty(t_s), counts(t_s));
        }
        let data = dataset(&[Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()]);
        assert!(data.current().is_none());
        assert!(data.notes().iter().any(|note| note.starts_with("i_A has no number")), "{:?}", data.notes());
    }

    /// Each has speeds over as long as its own rows let it.
    #[test]
    fn recordings_of_one_rig_may_have_other_rates() {
        let at = |interval_s: f64| recording(&rows(interval_s, 4.0), "counts", |t_s| counts(t_s).to_string());
        let data = dataset(&[at(5e-3), at(1e-3), at(2.5e-3)]);
        let of = |stretch: &Stretch| (stretch.rows.len(), stretch.window.span);
        assert_eq!(data.stretches.iter().map(of).collect::<Vec<_>>(), [(800, 1), (4000, 5), (1600, 2)]);
        for Stretch { rows, .. } in &data.stretches {
            let greatest = greatest(&data.motion().values[rows.clone()]);
            assert!((greatest / 600.0 - 1.0).abs() < 0.1, "{greatest}");
        }
    }

    /// What does not hold as it stands, and how it is mended.
    fn refusal(text: &str) -> String {
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap();
        Dataset::new(&[Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()], &rig).unwrap_err().to_string()
    }

    #[test]
    fn a_duty_in_percent_or_steps_is_told_so() {
        for scale in [100.0, 255.0] {
            let mut text = String::from("t_s,duty,omega_rad_per_s\n");
            for t_s in rows(1e-3, 4.0) {
                let _ = writeln!(text, "{t_s:.4},{:.1},{:.3}", scale * duty(t_s), 50.0 * duty(t_s - 0.1));
            }
            let error = refusal(&text);
            assert!(error.contains("--column duty=duty/100") && error.contains("255 steps"), "{error}");
        }
    }

    #[test]
    fn what_runs_against_its_drive_has_the_wrong_sign() {
        for (column, motion, current) in [("omega_rad_per_s", -1.0, 1.0), ("i_A", 1.0, -1.0)] {
            let mut text = String::from("t_s,duty,omega_rad_per_s,i_A\n");
            for t_s in rows(1e-3, 4.0) {
                let speed = 50.0 * motion * duty(t_s - 0.05);
                let _ = writeln!(text, "{t_s:.4},{:.4},{speed:.3},{:.4}", duty(t_s), current * duty(t_s - 0.001));
            }
            let error = refusal(&text);
            assert!(error.contains(&format!("--column {column}={column}*-1")), "{error}");
        }
    }
}

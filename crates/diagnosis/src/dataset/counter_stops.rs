//! Stops of a counter: for a while no edge is counted though the motor turns, for instance while another interrupt or a
//! serial line blocks the program.
//!
//! No model of a motor predicts such a stop, but the counts show it. A motor that stops slows down before and
//! accelerates after. A blocked counter counts at full speed up to the last edge and again from the first, while the
//! command stays as it was. If some stops are known, a standstill of the same length is one too, if it begins or ends
//! more abruptly than the shaft can change its speed.

use super::{DIFFERENCE_SPAN_S, Dataset, Output, Stretch};
use crate::configuration::dataset::counter_stops::{
    ABRUPT, AROUND, BESIDE, FEWEST, FEWEST_COUNTS, MOST_STANDING, MOST_STANDING_APART, ROUNDED, SPANS, STILL_DRIVEN,
    STILL_TURNING,
};
use std::ops::{Range, RangeInclusive};

/// A stop.
#[derive(Clone, Debug, PartialEq)]
pub struct CounterStop {
    /// Rows with the same count.
    pub rows: Range<usize>,
    /// Counts that the motor turned meanwhile, from its speed before and after.
    pub lost_counts: f64,
    /// Standard error of the counts.
    pub error_counts: f64,
}

impl CounterStop {
    /// The same stop, this many rows later.
    pub(super) fn later_by(self, others: usize) -> Self {
        Self { rows: self.rows.start + others..self.rows.end + others, ..self }
    }

    /// Counts lost until a row.
    pub(super) fn lost_before(&self, row: usize) -> f64 {
        let since = row.saturating_sub(self.rows.start) as f64 / self.rows.len() as f64;
        self.lost_counts * since.min(1.0)
    }
}

/// The stops of a counter with these counts, missing ones as NaN. `drive`: the command of the bridge.
pub(super) fn find(counts: &[f64], drive: &[f64]) -> Vec<CounterStop> {
    let mut stops: Vec<CounterStop> = stands(counts).filter_map(|stand| stand.stop(drive)).collect();
    let rows: Vec<Range<usize>> = stops.iter().map(|stop| stop.rows.clone()).collect();
    stops.retain(|stop| turns_on_around(stop, &rows, counts, drive));
    // Where most were the shaft's own, the others are as well.
    if stops.len() < FEWEST || 2 * stops.len() <= rows.len() {
        return Vec::new();
    }
    stops.extend(like(&stops, counts));
    stops
}

/// Whether the shaft turns on around a stop, where it is driven as much. A shaft that is driven in slow pulses stands between
/// them, again and again.
fn turns_on_around(stop: &CounterStop, all: &[Range<usize>], counts: &[f64], drive: &[f64]) -> bool {
    let (length, drive_then) = (stop.rows.len(), drive[stop.rows.start]);
    let around = stop.rows.start.saturating_sub(AROUND * length)..stop.rows.end + (AROUND + 1) * length;
    let stops: Vec<&Range<usize>> = all.iter().filter(|rows| meet(rows, &around)).collect();
    let is_driven = |row: usize| drive[row] * drive_then >= STILL_DRIVEN * drive_then * drive_then;
    let least = STILL_TURNING * stop.lost_counts;
    let stands = |rows: &Range<usize>| (counts[rows.end] - counts[rows.start]) * least.signum() < least.abs();
    let windows = around.map(|start| start..start + length).take_while(|rows| rows.end < counts.len());
    let (mut driven, mut standing, mut apart, mut standing_apart) = (0.0, 0.0, 0.0, 0.0);
    for rows in windows.filter(|rows| rows.clone().all(is_driven)) {
        let stands = f64::from(u8::from(stands(&rows)));
        (driven, standing) = (driven + 1.0, standing + stands);
        if !stops.iter().any(|stop| meet(stop, &rows)) {
            (apart, standing_apart) = (apart + 1.0, standing_apart + stands);
        }
    }
    standing <= MOST_STANDING * driven && standing_apart <= MOST_STANDING_APART * apart
}

/// Whether two parts of a recording overlap or touch.
fn meet(one: &Range<usize>, other: &Range<usize>) -> bool {
    one.start <= other.end && other.start <= one.end
}

/// Further stops of the same length as known ones: they begin or end too abruptly for the shaft, even if it
/// accelerated, braked or reversed meanwhile.
fn like(known: &[CounterStop], counts: &[f64]) -> Vec<CounterStop> {
    let lengths = lengths_like(known);
    let as_long: Vec<Range<usize>> = of_one_count(counts).filter(|rows| lengths.contains(&rows.len())).collect();
    let most_per_row = greatest_change(counts, &as_long);
    let is_known = |rows: &Range<usize>| known.iter().any(|stop| stop.rows == *rows);
    let others = as_long.into_iter().filter(|rows| !is_known(rows)).filter_map(|rows| Stand::between(counts, rows));
    // One row is only partly within the stop.
    others.filter(|stand| stand.fastest() > 2.0 * most_per_row + ROUNDED).map(|stand| stand.lost()).collect()
}

/// Lengths in rows of the known stops, within one row.
fn lengths_like(stops: &[CounterStop]) -> RangeInclusive<usize> {
    let lengths = stops.iter().map(|stop| stop.rows.len());
    let (shortest, longest) = (lengths.clone().min().unwrap_or(1), lengths.max().unwrap_or(0));
    shortest - 1..=longest + 1
}

/// Greatest change of the counts per row from one row to the next, except at these rows and their neighbours.
fn greatest_change(counts: &[f64], but_for: &[Range<usize>]) -> f64 {
    let mut is_left_out = vec![false; counts.len()];
    for rows in but_for {
        is_left_out[rows.start.saturating_sub(1)..(rows.end + 1).min(counts.len())].fill(true);
    }
    let of_span = |span: usize| {
        let starts = (0..counts.len().saturating_sub(2 * span)).filter(|row| {
            let looked_at = *row..=row + 2 * span;
            !is_left_out[looked_at].contains(&true)
        });
        let changes = starts.map(|row| (counts[row + 2 * span] - 2.0 * counts[row + span] + counts[row]).abs());
        changes.map(|change| (change - ROUNDED) / (span * span) as f64).fold(0.0, f64::max)
    };
    SPANS.into_iter().map(of_span).fold(0.0, f64::max)
}

/// Rows with the same count, and the speed right before and after.
struct Stand {
    rows: Range<usize>,
    /// From the row before to the row after: this part of the first and last interval was counted.
    counted: f64,
    before: Rate,
    after: Rate,
}

/// Counts per row over the nearest rows that have enough of them.
#[derive(Clone, Copy)]
struct Rate {
    per_row: f64,
    over: usize,
}

/// Consecutive rows with the same count.
fn of_one_count(counts: &[f64]) -> impl Iterator<Item = Range<usize>> {
    // After a stop the counts are not whole.
    let is_same = |row: usize| counts.get(row).is_some_and(|count| (count - counts[row - 1]).abs() < 0.5);
    let ends = (1..=counts.len()).filter(move |row| !is_same(*row));
    ends.scan(0, |start, end| Some(std::mem::replace(start, end)..end)).filter(|rows| rows.len() > 2)
}

fn stands(counts: &[f64]) -> impl Iterator<Item = Stand> {
    of_one_count(counts).filter_map(|rows| {
        // An angle that is read less often than it is written also stands before and after.
        let longest = rows.len() / 2;
        let before = Rate::of(|over| turned_before(counts, &rows, over), longest)?;
        let after = Rate::of(|over| turned_after(counts, &rows, over), longest)?;
        Some(Stand { counted: counted_around(counts, &rows)?, rows, before, after })
    })
}

/// Counts in the rows before: in the row at the edge some are counted and some are lost.
fn turned_before(counts: &[f64], rows: &Range<usize>, over: usize) -> Option<f64> {
    Some(counts[rows.start.checked_sub(1)?] - counts[rows.start.checked_sub(1 + over)?])
}

/// The same of the rows after.
fn turned_after(counts: &[f64], rows: &Range<usize>, over: usize) -> Option<f64> {
    Some(counts.get(rows.end + over)? - counts.get(rows.end)?)
}

fn counted_around(counts: &[f64], rows: &Range<usize>) -> Option<f64> {
    Some(counts.get(rows.end)? - counts[rows.start.checked_sub(1)?])
}

impl Rate {
    /// Over at most `longest` rows, where the rate hardly differs over as many rows beyond.
    fn of(turned: impl Fn(usize) -> Option<f64>, longest: usize) -> Option<Self> {
        let over = (1..=longest).find(|by| turned(*by).is_some_and(|turned| turned.abs() >= FEWEST_COUNTS))?;
        let near = turned(over)?;
        let far = turned(2 * over)? - near;
        (far.abs() < ABRUPT * near.abs()).then_some(Self { per_row: near / over as f64, over })
    }
}

impl Stand {
    /// From the rows right before and after, whatever the rates are.
    fn between(counts: &[f64], rows: Range<usize>) -> Option<Self> {
        let rate = |turned: f64| Rate { per_row: turned / BESIDE as f64, over: BESIDE };
        let before = rate(turned_before(counts, &rows, BESIDE)?);
        let after = rate(turned_after(counts, &rows, BESIDE)?);
        Some(Self { counted: counted_around(counts, &rows)?, rows, before, after })
    }

    /// Counts per row right before or right after.
    fn fastest(&self) -> f64 {
        self.before.per_row.abs().max(self.after.per_row.abs())
    }

    /// Whether the motor was driven on, in the same direction.
    fn stop(&self, drive: &[f64]) -> Option<CounterStop> {
        let Self { before, after, .. } = *self;
        let slowest = before.per_row.abs().min(after.per_row.abs());
        let goes_on = before.per_row * after.per_row > 0.0 && slowest * self.whole_rows() >= FEWEST_COUNTS;
        let sense = before.per_row.signum();
        let start = self.rows.start;
        let drive_before = mean(&drive[start - before.over..start]) * sense;
        let least_drive = drive[self.rows.clone()].iter().fold(f64::INFINITY, |least, drive| least.min(drive * sense));
        let is_driven = drive_before > 0.0 && least_drive >= STILL_DRIVEN * drive_before;
        (goes_on && is_driven).then(|| self.lost())
    }

    fn lost(&self) -> CounterStop {
        let intervals = self.rows.len() as f64 + 1.0;
        let rates = [self.before, self.after];
        let rounded = rates.map(|rate| 1.0 / rate.over as f64);
        let [before, after] = rates.map(|rate| rate.per_row);
        // Any speed between the two is equally likely; one edge more or less at either end.
        let error_per_row = (before - after).hypot(rounded[0].hypot(rounded[1])) / 12_f64.sqrt();
        CounterStop {
            rows: self.rows.clone(),
            lost_counts: 0.5 * (before + after) * intervals - self.counted,
            error_counts: 1.0_f64.hypot(error_per_row * intervals),
        }
    }

    fn whole_rows(&self) -> f64 {
        (self.rows.len() - 2) as f64
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

impl Dataset {
    /// Duration of a stop.
    pub fn length_s(&self, stop: &CounterStop) -> f64 {
        self.time_s[stop.rows.end - 1] - self.time_s[stop.rows.start]
    }

    /// Stops that the counts themselves show.
    pub(super) fn find_counter_stops(&self) -> Vec<CounterStop> {
        // From a recorded angle, or from the counts behind a speed.
        if self.count_rad <= 0.0 {
            return Vec::new();
        }
        let count = |row: usize| match self.motion().values[row].is_finite() {
            true => (self.angle_rad[row] / self.count_rad).round(),
            false => f64::NAN,
        };
        let of_stretch = |Stretch { rows, .. }: &Stretch| {
            let counts: Vec<f64> = rows.clone().map(count).collect();
            let stops = find(&counts, &self.command[rows.clone()]).into_iter();
            stops.map(|stop| stop.later_by(rows.start)).collect::<Vec<_>>()
        };
        self.stretches.iter().flat_map(of_stretch).collect()
    }

    /// No model predicts a stop: rows whose window contains one are missing, and the angle continues.
    pub fn leave_out(&mut self, stops: Vec<CounterStop>) {
        let is_recorded = matches!(self.motion().output, Output::Speed | Output::TimedSpeed);
        for stop in stops {
            let stretch = self.stretch_of(stop.rows.start).cloned();
            let Some(Stretch { rows, interval_s, window }) = stretch else { continue };
            // A window that a speed from another source would have is no longer than that of an angle difference.
            let span = if is_recorded { (DIFFERENCE_SPAN_S / interval_s).ceil() as usize } else { window.span };
            let seen_from = stop.rows.start.saturating_sub(span).max(rows.start);
            self.leave_out_motion(seen_from..(stop.rows.end + span).min(rows.end));
            self.add_to_angle(&stop);
            self.origin.counter_stops.push(stop);
        }
        self.origin.counter_stops.sort_by_key(|stop| stop.rows.start);
    }

    /// Rows in which nothing is counted for as long as in known stops, within one row.
    pub fn stands_as_long_as_stops(&self) -> Vec<Range<usize>> {
        if self.origin.counter_stops.is_empty() {
            return Vec::new();
        }
        let lengths = lengths_like(&self.origin.counter_stops);
        let of_stretch = |Stretch { rows, .. }: &Stretch| {
            let since_first = |row: usize| (self.angle_rad[row] - self.angle_rad[rows.start]) / self.count_rad;
            let counts: Vec<f64> = rows.clone().map(since_first).collect();
            let stands = of_one_count(&counts).filter(|rows| lengths.contains(&rows.len()));
            stands.map(|stand| rows.start + stand.start..rows.start + stand.end).collect::<Vec<_>>()
        };
        self.stretches.iter().flat_map(of_stretch).collect()
    }

    /// The same stop with as many counts lost.
    pub fn set_lost_in_stop(&mut self, index: usize, lost_counts: f64, error_counts: f64) {
        let stop = &mut self.origin.counter_stops[index];
        let more = CounterStop { lost_counts: lost_counts - stop.lost_counts, ..stop.clone() };
        (stop.lost_counts, stop.error_counts) = (lost_counts, error_counts);
        self.add_to_angle(&more);
    }

    /// Adds the lost counts of a stop to the angle, to the end of its stretch.
    fn add_to_angle(&mut self, stop: &CounterStop) {
        let Some(end) = self.stretch_of(stop.rows.start).map(|stretch| stretch.rows.end) else { return };
        for row in stop.rows.start..end {
            self.angle_rad[row] += stop.lost_before(row) * self.count_rad;
        }
    }

    fn leave_out_motion(&mut self, rows: Range<usize>) {
        let index = self.motion_index();
        let motion = &mut self.measured[index];
        for row in rows {
            let read = std::mem::replace(&mut motion.values[row], f64::NAN);
            if read.is_finite() {
                self.origin.read_in_stops.push((row, read));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Counts of a motor with this time constant driven by `drive`; the rows of `lost` are not counted.
    fn counts(drive: &[f64], time_constant_rows: f64, top: f64, lost: &[Range<usize>]) -> Vec<f64> {
        let (mut speed, mut angle, mut missed) = (0.0, 0.0_f64, 0.0);
        let mut counted = Vec::new();
        for (row, drive) in drive.iter().enumerate() {
            counted.push((angle - missed).floor());
            for _ in 0..10 {
                // Dry friction of a tenth of the stall torque holds and stops it.
                let driven = top * drive;
                let friction =
                    if speed == 0.0 { driven.clamp(-0.1 * top, 0.1 * top) } else { 0.1 * top * f64::signum(speed) };
                let next = speed + 0.1 * (driven - friction - speed) / time_constant_rows;
                speed = if speed * next < 0.0 { 0.0 } else { next };
                angle += 0.1 * speed;
                if lost.iter().any(|lost| lost.contains(&row)) {
                    missed += 0.1 * speed;
                }
            }
        }
        counted
    }

    /// Levels that last some rows each.
    fn drive(levels: &[f64], rows: usize) -> Vec<f64> {
        levels.iter().flat_map(|level| std::iter::repeat_n(*level, rows)).collect()
    }

    proptest! {
        #[test]
        fn a_stop_of_the_counter_is_found(top in 4.0_f64..30.0, length in 20_usize..60, level in 0.4_f64..1.0, back: bool) {
            let drive = drive(&[if back { -level } else { level }], 1000);
            let stops = [400, 600, 800].map(|row| row..row + length);
            let found = find(&counts(&drive, 25.0, top, &stops), &drive);
            prop_assert_eq!(found.len(), stops.len());
            let lost = (level - 0.1) * top * length as f64;
            for (found, stop) in found.iter().zip(&stops) {
                prop_assert!(found.rows.start.abs_diff(stop.start) < 3 && found.rows.end.abs_diff(stop.end) < 4, "{found:?}");
                let off = (found.lost_counts.abs() - lost).abs();
                prop_assert!(off < 4.0 * found.error_counts.max(0.5 * top), "{found:?} {lost}");
            }
            prop_assert!(find(&counts(&drive, 25.0, top, &stops[1..]), &drive).is_empty(), "twice may be chance");
        }

        #[test]
        fn others_as_long_are_found_while_the_motor_is_turned_round(top in 10.0_f64..30.0, length in 20_usize..40) {
            let drive = drive(&[1.0, -1.0], 500);
            let known = [200, 300, 400].map(|row| row..row + length);
            // It comes to a stand in between, and is as fast the other way at the end.
            let turned = 500 - length / 3..500 - length / 3 + length;
            let all = [&known[..], std::slice::from_ref(&turned)].concat();
            let found = find(&counts(&drive, 6.0, top, &all), &drive);
            prop_assert_eq!(found.len(), all.len());
            prop_assert!(found[3].rows.start.abs_diff(turned.start) < 3, "{:?}", found[3]);
            let motor_alone = find(&counts(&drive, 6.0, top, &known), &drive);
            prop_assert_eq!(motor_alone.len(), known.len());
        }

        #[test]
        fn a_stop_of_the_motor_is_none(
            top in 0.3_f64..60.0,
            time_constant_rows in 0.5_f64..200.0,
            rows in 5_usize..100,
            levels in prop::collection::vec(prop_oneof![Just(0.0), -1.0..1.0_f64], 40),
        ) {
            let drive = drive(&levels, rows);
            let found = find(&counts(&drive, time_constant_rows, top, &[]), &drive);
            prop_assert!(found.is_empty(), "{found:?}");
        }

        /// The pulses are shorter than their pauses, and the recorded command is their mean.
        #[test]
        fn a_shaft_that_turns_in_pulses_has_no_stops(
            top in 4.0_f64..60.0,
            time_constant_rows in 1.0_f64..20.0,
            rows in 5_usize..40,
            duty in 0.1_f64..0.5,
        ) {
            let steps = ((duty * rows as f64).round() as usize).clamp(1, rows - 1);
            let pulses: Vec<f64> = (0..1000).map(|row| if row % rows < steps { 1.0 } else { 0.0 }).collect();
            let found = find(&counts(&pulses, time_constant_rows, top, &[]), &vec![duty; pulses.len()]);
            prop_assert!(found.is_empty(), "{found:?}");
        }
    }

    #[test]
    fn an_angle_that_is_read_more_seldom_has_no_stops() {
        let drive = vec![1.0; 3000];
        let each = counts(&drive, 25.0, 5.0, &[]);
        let seldom: Vec<f64> = (0..each.len()).map(|row| each[row - row % 10]).collect();
        assert_eq!(find(&seldom, &drive), Vec::new());
    }

    #[test]
    fn missing_rows_are_no_stop() {
        let drive = vec![1.0; 300];
        let mut counts = counts(&drive, 5.0, 5.0, &[]);
        counts[150..180].fill(f64::NAN);
        assert_eq!(find(&counts, &drive), Vec::new());
    }
}

//! Readings that come late by a time that changes: a host that stamps what it takes out of a buffer.

use super::columns::held;
use super::{Dataset, LONG_ROW, Output, Stretch};
use std::ops::Range;

/// How late readings came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LateReadings {
    /// Least and greatest lateness.
    between_s: [f64; 2],
    course: LateCourse,
}

/// How a lateness went on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LateCourse {
    /// How much later each second, in the last stretch.
    pub growth: f64,
    /// How often it jumped.
    pub jumps: usize,
}

impl LateReadings {
    /// How often the lateness jumped.
    pub fn jumps(&self) -> usize {
        self.course.jumps
    }

    pub(super) fn note(&self) -> String {
        let [least_s, most_s] = self.between_s;
        let LateCourse { growth, jumps } = self.course;
        let grows = match growth {
            growth if growth.abs() < 1e-4 => String::new(),
            growth => format!(", with {:.1} ms more each second", 1e3 * growth),
        };
        let jumps = if jumps == 1 { "once".to_owned() } else { format!("{jumps} times") };
        format!(
            "The readings come {:.0} to {:.0} ms after their command{grows}, and the difference jumps {jumps}: the program that writes the rows falls behind and catches up. Each reading is compared at its own time, also in the held-out data. The intervals do not contain that uncertainty. Let the board send its time with each reading, or empty the buffer of the port faster than it fills.",
            1e3 * least_s,
            1e3 * most_s
        )
    }
}

impl Dataset {
    /// The same with each reading at the row at which it was true: `late_s` before its own row. Rows without a reading miss
    /// it.
    pub fn with_late_readings(&self, late_s: &[f64], course: LateCourse) -> Self {
        let mut data = self.clone();
        for Stretch { rows, interval_s, .. } in &self.stretches {
            let true_at_s = |row: usize| self.time_s[row] - late_s[row];
            let between = between(rows.clone(), &true_at_s, &self.time_s, *interval_s);
            let moved = |from: &[f64]| -> Vec<f64> {
                let read = |two: &Option<Between>| two.as_ref().map_or(f64::NAN, |two| two.of(from));
                between.iter().map(read).collect()
            };
            for (to, from) in data.measured.iter_mut().zip(&self.measured) {
                to.values[rows.clone()].copy_from_slice(&moved(&from.values));
            }
            data.angle_rad[rows.clone()].copy_from_slice(&held(&moved(&self.angle_rad)));
        }
        if data.motion().output == Output::MeanSpeed {
            data.integrate_mean_speed();
        }
        let all_s = || self.stretches.iter().flat_map(|stretch| late_s[stretch.rows.clone()].iter().copied());
        let between_s = [all_s().fold(f64::INFINITY, f64::min), all_s().fold(0.0, f64::max)];
        data.origin.late_readings = Some(LateReadings { between_s, course });
        data
    }
}

/// Two readings, and the share of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Between {
    readings: [usize; 2],
    share: f64,
}

impl Between {
    fn of(&self, values: &[f64]) -> f64 {
        let [before, after] = self.readings.map(|reading| values[reading]);
        if self.share == 0.0 { before } else { before + self.share * (after - before) }
    }
}

/// For each row, the readings that were true right before and after it, if they are close enough. Of those that a jump
/// repeats, the later one counts.
fn between(
    rows: Range<usize>,
    true_at_s: &dyn Fn(usize) -> f64,
    time_s: &[f64],
    interval_s: f64,
) -> Vec<Option<Between>> {
    let mut in_order: Vec<usize> = Vec::with_capacity(rows.len());
    for row in rows.clone() {
        while in_order.last().is_some_and(|last| true_at_s(*last) >= true_at_s(row)) {
            in_order.pop();
        }
        in_order.push(row);
    }
    let mut next = 0;
    let find = move |row: usize| {
        while next < in_order.len() && true_at_s(in_order[next]) <= time_s[row] {
            next += 1;
        }
        let before = in_order[next.checked_sub(1)?];
        let off_s = time_s[row] - true_at_s(before);
        let Some(after) = in_order.get(next).copied() else {
            return (off_s < 1e-6 * interval_s).then_some(Between { readings: [before; 2], share: 0.0 });
        };
        let apart_s = true_at_s(after) - true_at_s(before);
        let share = off_s / apart_s;
        (share < 1e-6 || apart_s < LONG_ROW * interval_s).then_some(Between { readings: [before, after], share })
    };
    rows.map(find).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moved(late: [f64; 8]) -> [f64; 8] {
        let time_s: Vec<f64> = (0..8).map(f64::from).collect();
        let found = between(0..8, &|row| time_s[row] - late[row], &time_s, 1.0);
        std::array::from_fn(|row| found[row].map_or(-1.0, |two| two.of(&time_s)))
    }

    #[test]
    fn each_row_gets_the_reading_of_its_time() {
        // Two rows late, and on time after a jump; -1 where none is.
        assert_eq!(moved([2.0, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0]), [2.0, 3.0, -1.0, -1.0, 4.0, 5.0, 6.0, 7.0]);
        // On time, and two rows late after a jump.
        assert_eq!(moved([0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 2.0]), [0.0, 1.0, 4.0, 5.0, 6.0, 7.0, -1.0, -1.0]);
        // Half a row late.
        assert_eq!(moved([0.5; 8]), [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, -1.0]);
    }
}

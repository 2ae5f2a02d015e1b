//! Speeds that a program computed from an encoder's counts: differences over some rows, multiples of one count each.
//!
//! Such a speed is late by half its window, or not at all if the window reaches as far ahead as back. Taken as an
//! instantaneous speed it looks like a delay, a gap or another winding.

use crate::configuration::dataset::speed_window::{
    CLOSE, EVEN, FEWEST_COUNTS, FEWEST_ROWS, HOPELESS_SHARE, LEAST_SHARE, LONGEST_S, MOST_PARTS, NEXT_GREATER, ONE_IN,
    SAME,
};
use std::f64::consts::TAU;

/// The rows over which a mean speed is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Number of intervals.
    pub span: usize,
    /// Number of them after its row.
    pub ahead: usize,
}

impl Window {
    /// The last `span` intervals.
    pub fn up_to_now(span: usize) -> Self {
        Self { span, ahead: 0 }
    }

    /// First and last row of the window of a row, where it is complete.
    pub(super) fn rows(self, row: usize, rows: usize) -> Option<(usize, usize)> {
        let last = row + self.ahead;
        (last < rows).then_some((last.checked_sub(self.span)?, last))
    }

    fn length_s(self, row: usize, time_s: &[f64]) -> Option<f64> {
        let (first, last) = self.rows(row, time_s.len())?;
        Some(time_s[last] - time_s[first])
    }

    /// The note on a speed that was found to be taken over it.
    pub(super) fn note(self, interval_s: f64) -> String {
        let [span_s, ahead_s] = [self.span, self.ahead].map(|rows| rows as f64 * interval_s);
        format!(
            "The speed is compared as a difference of counts over {:.3} s, of which {:.3} s lie after its row. Record the counts as well: they contain more. [recording] speed_window_s and speed_ahead_s in the rig file override this.",
            span_s, ahead_s
        )
    }
}

/// Whether a speed is a difference of the angle over some window, and contains nothing more.
pub(super) fn is_made_of(speed: &[f64], angle_rad: &[f64], interval_s: f64) -> bool {
    let Some(count_rad) = count_rad(angle_rad) else { return false };
    let counts = |window: Window, row: usize| {
        let last = row + window.ahead;
        let turned_rad = angle_rad.get(last)? - angle_rad[last.checked_sub(window.span)?];
        let of_speed = speed[row] * window.span as f64 * interval_s;
        (of_speed.abs() > FEWEST_COUNTS * count_rad).then(|| (of_speed - turned_rad) / count_rad)
    };
    let moving = angle_rad.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let agrees = |window: Window| {
        let rows = (0..speed.len()).filter_map(|row| counts(window, row)).filter(|counts| counts.is_finite());
        mostly(rows.map(|counts| counts.abs() < SAME), FEWEST_ROWS.max(moving / ONE_IN))
    };
    spans(interval_s).any(|span| (0..=span).any(|ahead| agrees(Window { span, ahead })))
}

/// The step of an angle: the least change, or a part of it of which the next greater changes are multiples too. Rows
/// that are far apart may contain no change of a single count.
pub(super) fn count_rad(angle_rad: &[f64]) -> Option<f64> {
    let steps = || angle_rad.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 0.0);
    let least = Some(steps().fold(f64::INFINITY, f64::min)).filter(|least| least.is_finite())?;
    let in_all = |part: f64| steps().filter(|step| *step < NEXT_GREATER * least).map(move |step| step / part);
    let is_whole = |number: f64| (number - number.round()).abs() < CLOSE;
    let mut parts = (1..=MOST_PARTS).map(|parts| least / f64::from(parts));
    Some(parts.find(|part| in_all(*part).all(is_whole)).unwrap_or(least))
}

/// What is known of the window of a speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Found {
    /// Number of its intervals.
    pub span: usize,
    /// Number of them after the row; even intervals do not show it.
    pub ahead: Option<usize>,
}

/// The window of a speed, if it comes from counts: every speed is a whole number of them.
pub(super) fn of_counts(speed: &[f64], time_s: &[f64], interval_s: f64, counts_per_rev: f64) -> Option<Found> {
    let is_even = |pair: &[f64]| ((pair[1] - pair[0]) / interval_s - 1.0).abs() < EVEN;
    let are_even = time_s.windows(2).all(is_even);
    let are_whole = |length_s: &dyn Fn(usize) -> Option<f64>| {
        let counts_of = |row: usize| Some(speed[row] * length_s(row)? * counts_per_rev / TAU);
        let counts = || (0..speed.len()).filter_map(counts_of).filter(|counts| counts.is_finite());
        let is_whole = |counts: f64| (counts - counts.round()).abs() < CLOSE;
        let changes_by_one = counts().zip(counts().skip(1)).any(|(a, b)| (b - a).abs().round() == 1.0);
        changes_by_one && mostly(counts().filter(|counts| counts.abs() > 0.5).map(is_whole), FEWEST_ROWS)
    };
    if are_even {
        let span = spans(interval_s).find(|span| are_whole(&|_| Some(*span as f64 * interval_s)))?;
        return Some(Found { span, ahead: None });
    }
    let windows = spans(interval_s).flat_map(|span| (0..=span).map(move |ahead| Window { span, ahead }));
    let mut found = windows.filter(|window| are_whole(&|row| window.length_s(row, time_s)));
    found.next().map(|Window { span, ahead }| Found { span, ahead: Some(ahead) })
}

/// The angle behind a mean speed; the first window is assumed to have the speed of its row.
pub(super) fn angle_rad(speed: &[f64], window: Window, time_s: &[f64]) -> Vec<f64> {
    let mut angle_rad = vec![0.0; speed.len()];
    for row in 0..speed.len() {
        let whole =
            row.checked_sub(window.ahead).and_then(|written| Some((written, window.length_s(written, time_s)?)));
        angle_rad[row] = match whole {
            Some((written, length_s)) => angle_rad[row - window.span] + speed[written] * length_s,
            None => speed[0] * (time_s[row] - time_s[0]),
        };
    }
    angle_rad
}

fn spans(interval_s: f64) -> std::ops::RangeInclusive<usize> {
    1..=(LONGEST_S / interval_s).round().max(1.0) as usize
}

/// Whether it holds in all rows but a few, and in enough of them.
fn mostly(rows: impl Iterator<Item = bool>, fewest: usize) -> bool {
    let (mut all, mut right) = (0, 0_u32);
    for is_right in rows {
        all += 1;
        right += u32::from(is_right);
        if all >= FEWEST_ROWS && f64::from(right) < HOPELESS_SHARE * all as f64 {
            return false;
        }
    }
    all >= fewest && f64::from(right) >= LEAST_SHARE * all as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, Output, difference};
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use proptest::prelude::*;
    use std::fmt::Write as _;

    const INTERVAL_S: f64 = 1e-3;
    const ROWS: usize = 4000;
    /// Longer than any window.
    const AT_REST: f64 = 40.0;

    /// A shaft that speeds up, slows down and reverses, from rest.
    fn turned_rad() -> Vec<f64> {
        let mut angle_rad = 0.0;
        let speed = |time_s: f64| 80.0 * (2.0 * time_s).sin() + 30.0 * (1.0 - (7.3 * time_s).cos());
        (0..ROWS)
            .map(|row| {
                angle_rad += INTERVAL_S * speed((row as f64 - AT_REST).max(0.0) * INTERVAL_S);
                angle_rad
            })
            .collect()
    }

    fn counted_rad(counts_per_rev: f64) -> Vec<f64> {
        let count_rad = TAU / counts_per_rev;
        turned_rad().iter().map(|angle| (angle / count_rad).floor() * count_rad).collect()
    }

    fn time_s() -> Vec<f64> {
        (0..ROWS).map(|row| row as f64 * INTERVAL_S).collect()
    }

    /// An encoder so coarse that at the greatest speed alone three of its counts come in a row.
    #[test]
    fn a_peak_that_agrees_by_chance_is_no_window() {
        let exact = difference(&turned_rad(), &time_s(), Window { span: 2, ahead: 1 });
        for counts_per_rev in (100..200).map(f64::from) {
            assert!(!is_made_of(&exact, &counted_rad(counts_per_rev), INTERVAL_S), "{counts_per_rev}");
        }
    }

    /// Two recordings of one rig: in one of them hardly anything moves.
    #[test]
    fn one_recording_tells_of_the_others() {
        for (span, still_first) in (2..20).flat_map(|span| [(span, false), (span, true)]) {
            let counts_per_rev = 400.0;
            let speed = difference(&counted_rad(counts_per_rev), &time_s(), Window::up_to_now(span));
            let csv = |rows: usize| {
                let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
                for (row, speed) in speed.iter().take(rows).enumerate() {
                    let speed = if speed.is_finite() { *speed } else { 0.0 };
                    let _ = writeln!(
                        text,
                        "{:.4},{},{speed:.4}",
                        row as f64 * INTERVAL_S,
                        5.0 * (row as f64 / 300.0).sin()
                    );
                }
                Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()
            };
            let mut recordings = [csv(90), csv(ROWS)];
            if !still_first {
                recordings.reverse();
            }
            let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12.0\n[encoder]\ncounts_per_rev = 400\n").unwrap();
            let data = Dataset::new(&recordings, &rig).unwrap();
            let centred = data.with_window_centred().unwrap();
            // Whichever is first, the rig file has not said it.
            assert!(
                data.notes().iter().any(|note| note.starts_with("The speed is compared as a difference of counts"))
            );
            for (data, ahead) in [(data, 0), (centred, span / 2)] {
                assert_eq!(data.motion().output, Output::MeanSpeed);
                let window = Window { span, ahead };
                assert!(data.stretches.iter().all(|stretch| stretch.window == window));
                assert!(data.stretches.iter().all(|stretch| data.angle_rad[stretch.rows.start] == 0.0));
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        /// Whatever the encoder and the window, printed with four digits; and the angle comes back to a count.
        #[test]
        fn a_speed_made_of_counts_is_known(counts_per_rev in 100_u32..2400, span in 2_usize..30, ahead in 0_usize..30) {
            let counts_per_rev = f64::from(counts_per_rev);
            let window = Window { span, ahead: ahead.min(span) };
            let angle_rad = counted_rad(counts_per_rev);
            let printed = |speed: f64| (speed * 1e4).round() / 1e4;
            let speed: Vec<f64> = difference(&angle_rad, &time_s(), window).into_iter().map(printed).collect();
            prop_assert!(is_made_of(&speed, &angle_rad, INTERVAL_S));
            prop_assert_eq!(of_counts(&speed, &time_s(), INTERVAL_S, counts_per_rev), Some(Found { span, ahead: None }));
            let whole: Vec<f64> = speed.iter().map(|speed| if speed.is_finite() { *speed } else { 0.0 }).collect();
            let found_rad = super::angle_rad(&whole, window, &time_s());
            // Rows without a whole window at the end have no speed.
            for row in 0..ROWS - 2 * span {
                let off_counts = (found_rad[row] - angle_rad[row]) * counts_per_rev / TAU;
                prop_assert!(off_counts.abs() < 0.5, "{row}: {off_counts} counts");
            }
        }

        /// Uneven rows tell as well where in its window a speed stands.
        #[test]
        fn uneven_rows_tell_the_end_of_the_window(counts_per_rev in 100_u32..2400, span in 2_usize..12, seed: u64) {
            let counts_per_rev = f64::from(counts_per_rev);
            let window = Window { span, ahead: seed as usize % (span + 1) };
            // A congruential generator is random enough for a jitter.
            let jitter = (0..ROWS as u64).map(|row| (seed ^ row.wrapping_mul(6_364_136_223_846_793_005)) >> 40);
            let time_s: Vec<f64> =
                time_s().iter().zip(jitter).map(|(t_s, j)| t_s + 0.6 * INTERVAL_S * j as f64 / (1 << 24) as f64).collect();
            let speed = difference(&counted_rad(counts_per_rev), &time_s, window);
            let found = of_counts(&speed, &time_s, INTERVAL_S, counts_per_rev);
            prop_assert_eq!(found, Some(Found { span, ahead: Some(window.ahead) }));
        }

        /// A speed timed by edges, or of a tachogenerator, is none.
        #[test]
        fn another_speed_is_not(counts_per_rev in 100_u32..2400, step in 1e-3_f64..0.5) {
            let counts_per_rev = f64::from(counts_per_rev);
            let turned_rad = turned_rad();
            let exact = difference(&turned_rad, &time_s(), Window { span: 2, ahead: 1 });
            let read: Vec<f64> = exact.iter().map(|speed| (speed / step).round() * step).collect();
            prop_assert!(!is_made_of(&exact, &counted_rad(counts_per_rev), INTERVAL_S));
            prop_assert_eq!(of_counts(&exact, &time_s(), INTERVAL_S, counts_per_rev), None);
            // By chance a step of the converter is a count in some window, or nearly.
            let counts = step * counts_per_rev / TAU * INTERVAL_S;
            let by_chance = (1..=100).any(|span| (counts * f64::from(span) - 1.0).abs() < 0.01);
            prop_assert!(by_chance || of_counts(&read, &time_s(), INTERVAL_S, counts_per_rev).is_none());
        }
    }
}

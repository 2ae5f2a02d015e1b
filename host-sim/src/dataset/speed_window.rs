//! Speeds that a program has made of an encoder's counts: differences over some rows, a multiple of one count each.
//!
//! Such a speed is late by half its window, or not at all where the window reaches as far ahead as back. Taken for the speed
//! of the moment it looks like a delay, a gap or another winding.

use std::f64::consts::TAU;

/// Longest window that is looked for.
const LONGEST_S: f64 = 0.1;
/// So many rows in motion have to agree...
const LEAST_SHARE: f64 = 0.98;
const FEWEST_ROWS: usize = 50;
/// ... and a window of which fewer do after so many is given up.
const HOPELESS_SHARE: f64 = 0.9;
/// ... to this part of a count.
const CLOSE: f64 = 0.1;
/// Two speeds of the same counts are closer to each other than this part of one; one timed by edges is not.
const SAME: f64 = 0.25;
/// Rows with fewer counts in the window say nothing.
const FEWEST_COUNTS: f64 = 3.0;
/// Intervals are equal when they differ by less than this share.
const EVEN: f64 = 0.01;
/// Share of a window after its row where that stands in the middle.
pub const CENTRED: f64 = 0.5;

/// Rows over which a mean speed is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// How many intervals.
    pub span: usize,
    /// How many of them after the row in which it stands.
    pub ahead: usize,
}

impl Window {
    /// The last `span` intervals.
    pub fn up_to_now(span: usize) -> Self {
        Self { span, ahead: 0 }
    }
}

/// Whether a speed is a difference of the angle over some window, and says nothing that the angle does not.
pub(super) fn is_made_of(speed: &[f64], angle_rad: &[f64], interval_s: f64) -> bool {
    let steps = angle_rad.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 0.0);
    let count_rad = steps.fold(f64::INFINITY, f64::min);
    if !count_rad.is_finite() {
        return false;
    }
    let counts = |window: Window, row: usize| {
        let last = row + window.ahead;
        let turned_rad = angle_rad.get(last)? - angle_rad[last.checked_sub(window.span)?];
        let of_speed = speed[row] * window.span as f64 * interval_s;
        (of_speed.abs() > FEWEST_COUNTS * count_rad).then(|| (of_speed - turned_rad) / count_rad)
    };
    let agrees = |window: Window| {
        let rows = (0..speed.len()).filter_map(|row| counts(window, row)).filter(|counts| counts.is_finite());
        mostly(rows.map(|counts| counts.abs() < SAME))
    };
    spans(interval_s).any(|span| (0..=span).any(|ahead| agrees(Window { span, ahead })))
}

/// How many intervals a speed's window has, if it is one of counts: every speed is a whole number of them.
pub(super) fn of_counts(speed: &[f64], time_s: &[f64], interval_s: f64, counts_per_rev: f64) -> Option<usize> {
    let is_even = |pair: &[f64]| ((pair[1] - pair[0]) / interval_s - 1.0).abs() < EVEN;
    if !time_s.windows(2).all(is_even) {
        return None;
    }
    spans(interval_s).find(|span| {
        let counts_of = *span as f64 * interval_s * counts_per_rev / TAU;
        let counts = || speed.iter().map(|speed| speed * counts_of).filter(|counts| counts.is_finite());
        let is_whole = |counts: f64| (counts - counts.round()).abs() < CLOSE;
        let changes_by_one = counts().zip(counts().skip(1)).any(|(a, b)| (b - a).abs().round() == 1.0);
        changes_by_one && mostly(counts().filter(|counts| counts.abs() > 0.5).map(is_whole))
    })
}

/// The angle of which a mean speed was made, where the first window was as fast as its row says.
pub(super) fn angle_rad(speed: &[f64], window: Window, interval_s: f64) -> Vec<f64> {
    let Window { span, ahead } = window;
    let mut angle_rad = vec![0.0; speed.len()];
    for row in 0..speed.len() {
        angle_rad[row] = match row.checked_sub(ahead) {
            Some(written) if row >= span => angle_rad[row - span] + speed[written] * span as f64 * interval_s,
            _ => speed[0] * row as f64 * interval_s,
        };
    }
    angle_rad
}

fn spans(interval_s: f64) -> std::ops::RangeInclusive<usize> {
    1..=(LONGEST_S / interval_s).round().max(1.0) as usize
}

fn mostly(rows: impl Iterator<Item = bool>) -> bool {
    let (mut all, mut right) = (0, 0_u32);
    for is_right in rows {
        all += 1;
        right += u32::from(is_right);
        if all >= FEWEST_ROWS && f64::from(right) < HOPELESS_SHARE * all as f64 {
            return false;
        }
    }
    all >= FEWEST_ROWS && f64::from(right) >= LEAST_SHARE * all as f64
}

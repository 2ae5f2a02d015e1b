//! Unwraps counters that overflow and angles within one revolution.

use super::LONG_ROW;
use super::columns::{median, width};
use crate::configuration::dataset::turns::{AMBIGUOUS_SHARE, BYTE, LONG_SPANS, MOST_OF_SPAN, ROUNDED};
use std::f64::consts::TAU;

/// A column that wraps after this span, too fast to tell how far it went.
#[derive(Debug, PartialEq)]
pub(super) struct Ambiguous {
    pub span: f64,
}

/// A counter without its overflows; missing values stay missing.
pub(super) fn counts(time_s: &[f64], counts: &[f64], per_rev: f64) -> Result<Vec<f64>, Ambiguous> {
    // One that a program resets with each revolution, or a counter of one byte.
    let goes_round = |span: &f64| width(counts) < *span && steps(counts).any(|step| step.abs() > 0.5 * span);
    if let Some(span) = [BYTE, per_rev].into_iter().find(goes_round) {
        return the_shorter_way(time_s, counts, span);
    }
    let span_of = |step: f64| LONG_SPANS.into_iter().find(|span| (step.abs() - span).abs() < 0.1 * span);
    Ok(without_jumps(time_s, counts, |Step { way, .. }| span_of(way).map_or(0.0, |span| span * way.signum())))
}

/// An angle that is recorded within one revolution, unwrapped; missing values stay missing.
pub(super) fn angle_rad(time_s: &[f64], angle_rad: &[f64]) -> Result<Vec<f64>, Ambiguous> {
    match width(angle_rad) <= TAU * (1.0 + ROUNDED) {
        true => the_shorter_way(time_s, angle_rad, TAU),
        false => Ok(angle_rad.to_vec()),
    }
}

/// In the nearer direction; over missing rows, in the one nearer to the previous speed.
fn the_shorter_way(time_s: &[f64], values: &[f64], span: f64) -> Result<Vec<f64>, Ambiguous> {
    let usual_s = median(time_s.windows(2).map(|pair| pair[1] - pair[0]));
    let expected = |step: &Step| if step.time_s > LONG_ROW * usual_s { step.rate_before * step.time_s } else { 0.0 };
    let continued = without_jumps(time_s, values, |step| span * ((step.way - expected(&step)) / span).round());
    let (mut all, mut ambiguous) = (0, 0);
    for (times, pair) in time_s.windows(2).zip(continued.windows(2)) {
        let is_usual = times[1] - times[0] <= LONG_ROW * usual_s && (pair[1] - pair[0]).is_finite();
        all += u32::from(is_usual);
        ambiguous += u32::from(is_usual && (pair[1] - pair[0]).abs() > MOST_OF_SPAN * span);
    }
    if f64::from(ambiguous) > AMBIGUOUS_SHARE * f64::from(all) { Err(Ambiguous { span }) } else { Ok(continued) }
}

/// From each row to the next, where both are there.
fn steps(values: &[f64]) -> impl Iterator<Item = f64> {
    values.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| step.is_finite())
}

/// From one value that is there to the next.
struct Step {
    way: f64,
    time_s: f64,
    /// The previous speed.
    rate_before: f64,
}

/// The values less the `jump` of each step between existing values.
fn without_jumps(time_s: &[f64], values: &[f64], jump: impl Fn(Step) -> f64) -> Vec<f64> {
    let (mut last, mut offset, mut rate_before) = (None, 0.0, 0.0);
    let mut continued = |(at_s, value): (f64, f64)| {
        if value.is_finite() {
            if let Some((last_s, last)) = last {
                let (way, time_s) = (value - last, at_s - last_s);
                let jumped = jump(Step { way, time_s, rate_before });
                rate_before = (way - jumped) / time_s;
                offset -= jumped;
            }
            last = Some((at_s, value));
        }
        value + offset
    };
    time_s.iter().copied().zip(values.iter().copied()).map(&mut continued).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shaft of 400 counts that speeds up to so many counts a row, and back.
    fn shaft(fastest: f64) -> Vec<f64> {
        (0..2000).map(|row| (fastest * 300.0 * (1.0 - (f64::from(row) / 300.0).cos())).floor()).collect()
    }

    /// Milliseconds.
    fn times(rows: usize) -> Vec<f64> {
        (0..rows).map(|row| 1e-3 * row as f64).collect()
    }

    /// At 90 counts a row three rows are more than the half of a byte.
    #[test]
    fn a_short_counter_goes_on_over_missing_rows() {
        let whole = shaft(90.0);
        let is_there = |row: &usize| !(50..).step_by(37).take(50).any(|lost| (lost..lost + 2).contains(row));
        let kept: Vec<usize> = (0..whole.len()).filter(is_there).collect();
        let of = |values: &[f64]| -> Vec<f64> { kept.iter().map(|row| values[*row]).collect() };
        let wrapped: Vec<f64> = whole.iter().map(|count| count.rem_euclid(256.0)).collect();
        assert_eq!(counts(&of(&times(whole.len())), &of(&wrapped), 400.0), Ok(of(&whole)));
    }

    #[test]
    fn short_counters_go_on_whatever_their_span() {
        let whole = shaft(90.0);
        for span in [256.0, 400.0] {
            let wrapped: Vec<f64> = whole.iter().map(|count| count.rem_euclid(span)).collect();
            assert_eq!(counts(&times(whole.len()), &wrapped, 400.0), Ok(whole.clone()), "{span}");
        }
        assert_eq!(counts(&times(whole.len()), &whole, 400.0), Ok(whole));
    }

    #[test]
    fn what_goes_round_too_fast_is_no_angle() {
        let whole = shaft(390.0);
        let wrapped: Vec<f64> = whole.iter().map(|count| count.rem_euclid(400.0)).collect();
        assert_eq!(counts(&times(whole.len()), &wrapped, 400.0), Err(Ambiguous { span: 400.0 }));
        let angle: Vec<f64> = wrapped.iter().map(|count| count * TAU / 400.0).collect();
        assert_eq!(angle_rad(&times(angle.len()), &angle), Err(Ambiguous { span: TAU }));
        // A counter of two bytes is not too fast for that.
        let long: Vec<f64> = whole.iter().map(|count| count.rem_euclid(65_536.0)).collect();
        assert_eq!(counts(&times(whole.len()), &long, 400.0), Ok(whole));
    }
}

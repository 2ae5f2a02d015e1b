//! Counters that wrap and angles within one revolution, as they go on beyond.

use std::f64::consts::TAU;

/// By how much an angle within a revolution may be beyond it.
const ROUNDED: f64 = 1e-3;
/// Wrap-arounds of counters whose steps from row to row are small beside them.
const LONG_SPANS: [f64; 2] = [65_536.0, 4_294_967_296.0];
/// A counter of one byte.
const BYTE: f64 = 256.0;
/// A step of more than this share of the span may as well be one the other way round.
const MOST_OF_SPAN: f64 = 0.4;
/// As many steps as that are more than a glitch.
const AMBIGUOUS_SHARE: f64 = 0.01;

/// What begins anew after this, too fast to be told how far it went.
#[derive(Debug, PartialEq)]
pub(super) struct Ambiguous {
    pub span: f64,
}

/// A counter without its wrap-arounds; missing values stay missing.
pub(super) fn counts(counts: &[f64], per_rev: f64) -> Result<Vec<f64>, Ambiguous> {
    // One that a sketch sets back with each revolution, or that is a byte.
    let goes_round = |span: &f64| width(counts) < *span && steps(counts).any(|step| step.abs() > 0.5 * span);
    if let Some(span) = [BYTE, per_rev].into_iter().find(goes_round) {
        return the_shorter_way(counts, span);
    }
    let span_of = |step: f64| LONG_SPANS.into_iter().find(|span| (step.abs() - span).abs() < 0.1 * span);
    Ok(without_jumps(counts, |step| span_of(step).map_or(0.0, |span| span * step.signum())))
}

/// An angle that is recorded within one revolution, as it goes on beyond; missing values stay missing.
pub(super) fn angle_rad(angle_rad: &[f64]) -> Result<Vec<f64>, Ambiguous> {
    match width(angle_rad) <= TAU * (1.0 + ROUNDED) {
        true => the_shorter_way(angle_rad, TAU),
        false => Ok(angle_rad.to_vec()),
    }
}

fn the_shorter_way(values: &[f64], span: f64) -> Result<Vec<f64>, Ambiguous> {
    let continued = without_jumps(values, |step| span * (step / span).round());
    let (mut all, mut ambiguous) = (0, 0);
    for step in steps(&continued) {
        all += 1;
        ambiguous += usize::from(step.abs() > MOST_OF_SPAN * span);
    }
    if ambiguous as f64 > AMBIGUOUS_SHARE * f64::from(all) { Err(Ambiguous { span }) } else { Ok(continued) }
}

fn width(values: &[f64]) -> f64 {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min)
}

/// From each row to the next, where both are there.
fn steps(values: &[f64]) -> impl Iterator<Item = f64> {
    values.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| step.is_finite())
}

/// Values less what `jump` says of each step from one that is there to the next.
fn without_jumps(values: &[f64], jump: impl Fn(f64) -> f64) -> Vec<f64> {
    let (mut last, mut offset) = (None, 0.0);
    let mut continued = |value: f64| {
        if value.is_finite() {
            offset -= last.map_or(0.0, |last| jump(value - last));
            last = Some(value);
        }
        value + offset
    };
    values.iter().map(|value| continued(*value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shaft of 400 counts that speeds up to so many counts a row, and back.
    fn shaft(fastest: f64) -> Vec<f64> {
        (0..2000).map(|row| (fastest * 300.0 * (1.0 - (f64::from(row) / 300.0).cos())).floor()).collect()
    }

    #[test]
    fn short_counters_go_on_whatever_their_span() {
        let whole = shaft(90.0);
        for span in [256.0, 400.0] {
            let wrapped: Vec<f64> = whole.iter().map(|count| count.rem_euclid(span)).collect();
            assert_eq!(counts(&wrapped, 400.0), Ok(whole.clone()), "{span}");
        }
        assert_eq!(counts(&whole, 400.0), Ok(whole));
    }

    #[test]
    fn what_goes_round_too_fast_is_no_angle() {
        let whole = shaft(390.0);
        let wrapped: Vec<f64> = whole.iter().map(|count| count.rem_euclid(400.0)).collect();
        assert_eq!(counts(&wrapped, 400.0), Err(Ambiguous { span: 400.0 }));
        let angle: Vec<f64> = wrapped.iter().map(|count| count * TAU / 400.0).collect();
        assert_eq!(angle_rad(&angle), Err(Ambiguous { span: TAU }));
        // A counter of two bytes is not too fast for that.
        let long: Vec<f64> = whole.iter().map(|count| count.rem_euclid(65_536.0)).collect();
        assert_eq!(counts(&long, 400.0), Ok(whole));
    }
}

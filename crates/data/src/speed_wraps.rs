//! Speeds of 16 bits that wrap, as some motor controllers report them.

use crate::statistics::greatest;

/// Half of the range: such a speed is from minus this to this.
const HALF: f64 = 32_768.0;
const RANGE: f64 = 2.0 * HALF;
/// Rows that decide how the speed follows the command; more change nothing.
const MOST_ROWS: usize = 5_000;
/// A speed is at most so many times the range's half at the greatest command.
const FASTEST: f64 = 8.0;
/// The shortest way from row to row is the right one if it is at most this share of half the range.
const SURELY_SHORT: f64 = 0.75;
/// The simple law of the speed leaves at most this share of half a range. Without a law it would be a half.
const LEFT_BY_THE_LAW: f64 = 0.25;

/// Whether values go over the ends of 16 bits: a wrap leaves one end of the range and comes back at the other.
pub fn wrap(values: &[f64]) -> bool {
    let is_of_16_bits =
        values.iter().all(|value| value.is_nan() || value.fract() == 0.0 && (-HALF..HALF).contains(value));
    let jumps = values.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > HALF).count();
    is_of_16_bits && greatest(values) > 0.9 * HALF && jumps > 1
}

/// Values that wrap, continued over the shortest way from row to row. `None`: they never come back, or they change so
/// quickly that the shortest way may be the wrong one.
pub fn continued(values: &[f64]) -> Option<Vec<f64>> {
    let (mut turns, mut last) = (0.0, None);
    let on_turn = |value: &f64| {
        let step: f64 = value - last.unwrap_or(*value);
        if step.abs() > HALF {
            turns -= step.signum();
        }
        last = Some(*value).filter(|value| value.is_finite()).or(last);
        value + RANGE * turns
    };
    let continued: Vec<f64> = values.iter().map(on_turn).collect();
    let is_sure = continued.windows(2).all(|pair| !((pair[1] - pair[0]).abs() > SURELY_SHORT * HALF));
    (is_sure && greatest(&continued) < 2.0 * RANGE).then_some(continued)
}

/// Values that change by more than half of the range between rows, continued by the command. A motor follows its
/// command with a lag, so a simple law says on which turn of the counter a speed is. `None`: no law does.
pub fn continued_by(command: &[f64], values: &[f64]) -> Option<Vec<f64>> {
    let rows = values.len().min(MOST_ROWS);
    let most = greatest(command);
    if most <= 0.0 || command.len() != values.len() {
        return None;
    }
    let mut best: Option<(f64, Vec<f64>)> = None;
    for lag_rows in lags() {
        let follows = Law::new(command, lag_rows);
        for per_unit in gains().map(|share| share * HALF / most) {
            let off = follows.off(&values[..rows], per_unit);
            if best.as_ref().is_none_or(|(least, _)| off < *least) {
                best = Some((off, follows.speed(per_unit, 0.0)));
            }
        }
    }
    let mut on_turns = on_turns_of(&best?.1, values);
    // With the dead band of friction and drop, which the first look has left out.
    for _ in 0..2 {
        on_turns = on_turns_of(&fitted(command, &on_turns)?, values);
    }
    let law = fitted(command, &on_turns)?;
    let left: Vec<f64> = on_turns.iter().zip(&law).map(|(value, law)| value - law).collect();
    let finite = || left.iter().filter(|left| left.is_finite());
    let mean = finite().map(|left| left.abs()).sum::<f64>() / finite().count() as f64;
    // A wrong turn is a whole range off.
    let is_whole = left.windows(2).all(|pair| !((pair[1] - pair[0]).abs() > HALF));
    (mean < LEFT_BY_THE_LAW * HALF && is_whole).then_some(on_turns)
}

/// Time constants to try, in rows.
fn lags() -> impl Iterator<Item = f64> {
    (0..16).map(|step| 0.5 * 1.5_f64.powi(step))
}

/// Speeds at the greatest command to try, in halves of the range. Steps are less than what a turn is told by.
fn gains() -> impl Iterator<Item = f64> {
    let sizes = (0..90).map(|step| 0.5 * 1.032_f64.powi(step)).filter(|share| *share < FASTEST);
    sizes.flat_map(|share| [share, -share])
}

/// What the command and its sign make of a speed with a lag.
struct Law {
    command: Vec<f64>,
    sign: Vec<f64>,
}

impl Law {
    fn new(command: &[f64], lag_rows: f64) -> Self {
        let sign = |value: &f64| if *value == 0.0 { 0.0 } else { value.signum() };
        Self { command: lagged(command.iter().copied(), lag_rows), sign: lagged(command.iter().map(sign), lag_rows) }
    }

    fn speed(&self, per_unit: f64, by_sign: f64) -> Vec<f64> {
        self.command.iter().zip(&self.sign).map(|(command, sign)| per_unit * command + by_sign * sign).collect()
    }

    /// Mean distance of wrapped values from this law.
    fn off(&self, values: &[f64], per_unit: f64) -> f64 {
        let off = |(value, command): (&f64, &f64)| {
            let off = value - per_unit * command;
            (off - RANGE * (off / RANGE).round()).abs()
        };
        let known = || values.iter().zip(&self.command).filter(|(value, _)| value.is_finite());
        known().map(off).sum::<f64>() / known().count() as f64
    }
}

/// What follows a value with a lag; a missing one holds.
fn lagged(values: impl Iterator<Item = f64>, lag_rows: f64) -> Vec<f64> {
    let (mut input, mut output) = (0.0, 0.0);
    let left = (-1.0 / lag_rows).exp();
    let next = |value: f64| {
        output = left * output + (1.0 - left) * input;
        input = if value.is_finite() { value } else { input };
        output
    };
    values.map(next).collect()
}

/// The values on the turns that are nearest to a law.
fn on_turns_of(law: &[f64], values: &[f64]) -> Vec<f64> {
    values.iter().zip(law).map(|(value, law)| value + RANGE * ((law - value) / RANGE).round()).collect()
}

/// The law with a dead band that fits values best.
fn fitted(command: &[f64], values: &[f64]) -> Option<Vec<f64>> {
    let fits = lags().filter_map(|lag_rows| {
        let law = Law::new(command, lag_rows);
        let rows = || law.command.iter().zip(&law.sign).zip(values).filter(|(_, value)| value.is_finite());
        let sum = |of: &dyn Fn(f64, f64, f64) -> f64| rows().map(|((u, s), w)| of(*u, *s, *w)).sum::<f64>();
        let (uu, us, ss) = (sum(&|u, _, _| u * u), sum(&|u, s, _| u * s), sum(&|_, s, _| s * s));
        let (uw, sw) = (sum(&|u, _, w| u * w), sum(&|_, s, w| s * w));
        let determinant = uu * ss - us * us;
        // A command of one size has no dead band of its own.
        let (per_unit, by_sign) = match determinant > 1e-6 * uu * ss {
            true => ((uw * ss - sw * us) / determinant, (sw * uu - uw * us) / determinant),
            false => (uw / uu, 0.0),
        };
        let speed = law.speed(per_unit, by_sign);
        let left = speed.iter().zip(values).map(|(law, value)| (value - law).powi(2)).filter(|left| left.is_finite());
        Some((left.sum::<f64>(), speed)).filter(|(left, _)| left.is_finite())
    });
    fits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, speed)| speed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrapped(speed: &[f64]) -> Vec<f64> {
        speed.iter().map(|value| (value.round() + HALF).rem_euclid(RANGE) - HALF).collect()
    }

    #[test]
    fn slow_changes_are_continued() {
        let speed: Vec<f64> = (0..200).map(|row| (45_000.0 * (f64::from(row) * 0.05).sin()).round()).collect();
        assert!(wrap(&wrapped(&speed)));
        assert_eq!(continued(&wrapped(&speed)), Some(speed.clone()));
        let small: Vec<f64> = speed.iter().map(|value| (value * 0.7).round()).collect();
        assert!(!wrap(&small));
    }

    /// Steps of a motor with a dead band: the speed changes by up to two thirds of the range from row to row.
    #[test]
    fn quick_changes_are_continued_by_the_command() {
        let levels = [0.0, 8.9, -6.4, 10.0, 1.0, -9.5, 4.0, 0.0, -4.6, 8.8];
        let command: Vec<f64> = (0..1000).map(|row| levels[row / 100]).collect();
        let mut speed = vec![0.0];
        for volts in &command[..999] {
            let last = *speed.last().unwrap();
            let free = 9_700.0 * f64::max(volts.abs() - 1.8, 0.0) * volts.signum();
            speed.push(last + 0.25 * (free - last));
        }
        let speed: Vec<f64> = speed.into_iter().map(f64::round).collect();
        assert!(wrap(&wrapped(&speed)) && continued(&wrapped(&speed)) != Some(speed.clone()));
        assert_eq!(continued_by(&command, &wrapped(&speed)), Some(speed.clone()));
        // Against the sense of the command as well.
        let other: Vec<f64> = command.iter().map(|volts| -volts).collect();
        assert_eq!(continued_by(&other, &wrapped(&speed)), Some(speed.clone()));
        // A command that has nothing to do with it.
        let strange: Vec<f64> = (0..1000).map(|row| f64::from(row % 7) - 3.0).collect();
        assert_eq!(continued_by(&strange, &wrapped(&speed)), None);
    }
}

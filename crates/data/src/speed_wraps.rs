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
/// What counts of the distance to the law, beside the changes from row to row: it is no more than a motor's own way.
const NEAR: f64 = 0.05;
/// Turns to either side, for the fastest speed.
const MOST_TURNS: usize = 4;
const TURNS: usize = 2 * MOST_TURNS + 1;
/// The law and the turns find each other in so many fits, or not at all.
const MOST_FITS: usize = 4;

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
    (!jumps(&continued) && greatest(&continued) < 2.0 * RANGE).then_some(continued)
}

/// Whether values change from row to row by so much that another turn may be the right one.
fn jumps(values: &[f64]) -> bool {
    values.windows(2).any(|pair| (pair[1] - pair[0]).abs() > SURELY_SHORT * HALF)
}

/// Values that change by more than half of the range between rows, continued by the command. A motor follows its
/// command with a lag, so a simple law says on which turn of the counter a speed is. `None`: no law does.
pub fn continued_by(command: &[f64], values: &[f64]) -> Option<Vec<f64>> {
    if greatest(command) <= 0.0 || command.len() != values.len() {
        return None;
    }
    let mut law = first_law(command, values)?;
    let mut on_turns = on_likeliest_turns(&law, values);
    for _ in 0..MOST_FITS {
        law = fitted(command, &on_turns)?;
        let again = on_likeliest_turns(&law, values);
        if again == on_turns {
            break;
        }
        on_turns = again;
    }
    let left: Vec<f64> = on_turns.iter().zip(&law).map(|(value, law)| value - law).collect();
    let finite = || left.iter().filter(|left| left.is_finite());
    let mean = finite().map(|left| left.abs()).sum::<f64>() / finite().count() as f64;
    // A wrong turn is a whole range off.
    (mean < LEFT_BY_THE_LAW * HALF && !jumps(&left)).then_some(on_turns)
}

/// Time constants to try, in rows.
fn lags() -> impl Iterator<Item = f64> {
    (0..16).map(|step| 0.5 * 1.5_f64.powi(step))
}

/// Dead bands of friction and drop to try, as shares of the greatest command.
fn dead_bands() -> impl Iterator<Item = f64> {
    (0..10).map(|step| 0.05 * f64::from(step))
}

/// Speeds at the greatest command to try, in halves of the range. Steps are less than what a turn is told by.
fn gains() -> impl Iterator<Item = f64> {
    let sizes = (0..90).map(|step| 0.5 * 1.032_f64.powi(step)).filter(|share| *share < FASTEST);
    sizes.flat_map(|share| [share, -share])
}

/// What is beyond the dead band of a command, with a lag, as a share of the greatest. A missing command holds.
fn followed(command: &[f64], dead_band: f64, lag_rows: f64) -> Vec<f64> {
    let most = greatest(command);
    let left = (-1.0 / lag_rows).exp();
    let (mut input, mut output) = (0.0, 0.0);
    let next = |command: &f64| {
        output = left * output + (1.0 - left) * input;
        if command.is_finite() {
            input = command.signum() * (command.abs() / most - dead_band).max(0.0);
        }
        output
    };
    command.iter().map(next).collect()
}

/// The law that leaves least of wrapped values, each on its nearest turn.
fn first_law(command: &[f64], values: &[f64]) -> Option<Vec<f64>> {
    let rows = values.len().min(MOST_ROWS);
    let mut best: Option<(f64, f64, Vec<f64>)> = None;
    for dead_band in dead_bands().step_by(2) {
        for lag_rows in lags() {
            let shape = followed(command, dead_band, lag_rows);
            let known: Vec<(f64, f64)> = values[..rows]
                .iter()
                .zip(&shape)
                .filter(|(value, _)| value.is_finite())
                .map(|(value, shape)| (*value, *shape))
                .collect();
            for gain in gains().map(|halves| halves * HALF) {
                let off = |(value, shape): &(f64, f64)| {
                    let off = value - gain * shape;
                    (off - RANGE * (off / RANGE).round()).abs()
                };
                let off = known.iter().map(off).sum::<f64>();
                if best.as_ref().is_none_or(|(least, ..)| off < *least) {
                    best = Some((off, gain, shape.clone()));
                }
            }
        }
    }
    best.map(|(_, gain, shape)| shape.into_iter().map(|shape| gain * shape).collect())
}

/// The law that fits continued values best.
fn fitted(command: &[f64], values: &[f64]) -> Option<Vec<f64>> {
    let laws = dead_bands().flat_map(|dead_band| lags().map(move |lag_rows| followed(command, dead_band, lag_rows)));
    let fits = laws.filter_map(|shape| {
        let known = || values.iter().zip(&shape).filter(|(value, _)| value.is_finite());
        let gain = known().map(|(value, shape)| value * shape).sum::<f64>()
            / known().map(|(_, shape)| shape * shape).sum::<f64>();
        let left = known().map(|(value, shape)| (value - gain * shape).powi(2)).sum::<f64>();
        left.is_finite().then(|| (left, shape.iter().map(|shape| gain * shape).collect()))
    });
    fits.min_by(|a: &(f64, Vec<f64>), b| a.0.total_cmp(&b.0)).map(|(_, law)| law)
}

/// The turns on which values change as a law does and are near it, over all rows together.
fn on_likeliest_turns(law: &[f64], values: &[f64]) -> Vec<f64> {
    let known: Vec<usize> = (0..values.len()).filter(|row| values[*row].is_finite()).collect();
    let on = |turn: usize, row: usize| values[row] + RANGE * (turn as f64 - MOST_TURNS as f64);
    let far = |turn: usize, row: usize| NEAR * (on(turn, row) - law[row]).powi(2);
    let Some(&first) = known.first() else { return values.to_vec() };
    let mut costs: Vec<f64> = (0..TURNS).map(|turn| far(turn, first)).collect();
    let mut ways: Vec<[usize; TURNS]> = Vec::new();
    for pair in known.windows(2) {
        let (before, row) = (pair[0], pair[1]);
        let change = law[row] - law[before];
        let bend = |from: usize, to: usize| (on(to, row) - on(from, before) - change).powi(2);
        let best = |to: usize| {
            let ways = (0..TURNS).map(|from| (from, costs[from] + bend(from, to)));
            ways.min_by(|a, b| a.1.total_cmp(&b.1)).expect("there are turns")
        };
        let found: [(usize, f64); TURNS] = std::array::from_fn(best);
        ways.push(found.map(|(from, _)| from));
        costs = found.iter().enumerate().map(|(to, (_, cost))| cost + far(to, row)).collect();
    }
    let mut turn = (0..TURNS).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).expect("there are turns");
    let mut found = values.to_vec();
    for (index, &row) in known.iter().enumerate().rev() {
        found[row] = on(turn, row);
        if index > 0 {
            turn = ways[index - 1][turn];
        }
    }
    found
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

    /// Steps of a motor whose bridge drops voltage: within the drop it coasts. The speed changes by up to two thirds of
    /// the range from row to row.
    #[test]
    fn quick_changes_are_continued_by_the_command() {
        let levels = [0.0, 8.9, 2.1, -6.4, 10.0, 1.0, -9.5, -2.5, 4.0, 0.0, -4.6, 8.8];
        let command: Vec<f64> = (0..1200).map(|row| levels[row / 100]).collect();
        let mut speed = vec![0.0_f64];
        for volts in &command[..1199] {
            let last = *speed.last().unwrap();
            let drive = volts - last / 14_000.0;
            let driven = 3_500.0 * drive.signum() * (drive.abs() - 1.6).max(0.0);
            let next: f64 = last + driven;
            speed.push(next.signum() * (next.abs() - 1_300.0).max(0.0));
        }
        let speed: Vec<f64> = speed.into_iter().map(f64::round).collect();
        assert!(wrap(&wrapped(&speed)) && continued(&wrapped(&speed)) != Some(speed.clone()));
        assert_eq!(continued_by(&command, &wrapped(&speed)), Some(speed.clone()));
        // Against the sense of the command as well.
        let other: Vec<f64> = command.iter().map(|volts| -volts).collect();
        assert_eq!(continued_by(&other, &wrapped(&speed)), Some(speed.clone()));
        // A command that has nothing to do with it.
        let strange: Vec<f64> = (0..1200).map(|row| f64::from(row % 7) - 3.0).collect();
        assert_eq!(continued_by(&strange, &wrapped(&speed)), None);
    }
}

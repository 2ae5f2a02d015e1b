//! Times that are not what they should be: counters that wrap, boards that start again, stamps in clumps, rows out of
//! order. They are mended where only one explanation fits, with a note that says which.

use crate::statistics::median;

/// Pause between two runs in one file, so that each begins anew.
const PAUSE_S: f64 = 2.0;
/// Counters wrap after so many bits...
const BITS: [i32; 3] = [32, 16, 31];
/// ... of these units, in s.
const UNITS_S: [(f64, &str); 3] = [(1e-6, "microseconds"), (1e-3, "milliseconds"), (1.0, "seconds")];
/// A clock without a date begins anew after this.
const DAY_S: f64 = 86_400.0;
/// The step over a wrap is at most so many usual ones.
const LONGEST_STEP: f64 = 3.0;
/// A run after a restart has at least so many rows; fewer are out of order.
const SHORTEST_RUN: usize = 20;
/// Stamps are in clumps if this share of the intervals...
const CLUMPED: f64 = 0.1;
/// ... is shorter than this share of the mean one.
const SHORT: f64 = 0.2;
/// Even rows are at most so many clumps away from their stamps.
const OFF_BY: f64 = 1.5;
/// Largest share of rows that may be out of order.
const MOST_OUT_OF_ORDER: f64 = 0.01;

/// Times that increase, and how they came about.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mended {
    /// The times.
    pub time_s: Vec<f64>,
    /// Rows that are kept; the others are out of order.
    pub kept: Vec<bool>,
    /// What was done.
    pub notes: Vec<String>,
}

/// Mends times. `tick_s` is the unit in which the file counts. `None` for those that need it not, or that nothing explains.
pub fn mended(time_s: &[f64], tick_s: f64) -> Option<Mended> {
    if time_s.windows(2).all(|pair| pair[1] > pair[0]) && !is_clumped(time_s) {
        return None;
    }
    let mut mended = Mended { time_s: time_s.to_vec(), kept: vec![true; time_s.len()], notes: Vec::new() };
    let runs = forward(&mut mended, tick_s)?;
    for run in runs {
        evenly_spaced(&mut mended, run)?;
    }
    let left: Vec<f64> = mended.kept_times();
    let out = time_s.len() - left.len();
    if !left.windows(2).all(|pair| pair[1] > pair[0]) || out as f64 > MOST_OUT_OF_ORDER * time_s.len() as f64 {
        return None;
    }
    if out > 0 {
        mended
            .notes
            .push(format!("{out} rows are left out because their times are out of order. Lines may be garbled."));
    }
    mended.time_s = left;
    mended.notes.dedup();
    Some(mended)
}

impl Mended {
    fn kept_times(&self) -> Vec<f64> {
        self.time_s.iter().zip(&self.kept).filter(|(_, kept)| **kept).map(|(t_s, _)| *t_s).collect()
    }
}

/// Continues counters that wrap, puts runs one after the other, and takes out rows out of order. Returns the runs.
fn forward(mended: &mut Mended, tick_s: f64) -> Option<Vec<std::ops::Range<usize>>> {
    let time_s = mended.time_s.clone();
    let usual_s = median(time_s.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0));
    let (mut offset_s, mut wraps, mut after_s, mut starts) = (0.0, 0, "", vec![0]);
    let mut wrap_s = 0.0;
    let mut last = 0;
    for row in 1..time_s.len() {
        let step_s = time_s[row] - time_s[last];
        if step_s >= 0.0 {
            let is_glitch = step_s > LONGEST_STEP * usual_s
                && time_s.get(row + 1).is_some_and(|next| *next < time_s[row] && *next > time_s[last]);
            if is_glitch && wrapped(time_s[row + 1] - time_s[row], usual_s, tick_s).is_none() {
                mended.kept[row] = false;
                continue;
            }
        } else if let Some((period_s, unit)) = wrapped(step_s, usual_s, tick_s) {
            offset_s += period_s;
            (wraps, after_s, wrap_s) = (wraps + 1, unit, period_s);
        } else if goes_on(&time_s[row..]) && time_s[row + 1] < time_s[last] - LONGEST_STEP * usual_s {
            offset_s += time_s[last] - time_s[row] + PAUSE_S;
            starts.push(row);
        } else {
            mended.kept[row] = false;
            continue;
        }
        mended.time_s[row] = time_s[row] + offset_s;
        last = row;
    }
    if wraps > 0 {
        let times = if wraps == 1 { "once".to_owned() } else { format!("{wraps} times") };
        mended.notes.push(format!("t_s wraps {times} after {wrap_s} s ({after_s}). The times are continued."));
    }
    if starts.len() > 1 {
        mended.notes.push(format!(
            "t_s starts again {} times, as after a reset of the board. The runs are taken one after the other.",
            starts.len() - 1
        ));
    }
    let ends = starts.iter().skip(1).copied().chain([time_s.len()]);
    Some(starts.iter().zip(ends).map(|(start, end)| *start..end).collect())
}

/// The period of the counter that explains a step back, and its name.
fn wrapped(step_s: f64, usual_s: f64, tick_s: f64) -> Option<(f64, &'static str)> {
    let units = UNITS_S.into_iter().chain([(tick_s, "counts of the file's clock")]);
    let counters = units.flat_map(|(unit_s, name)| BITS.map(|bits| (2_f64.powi(bits) * unit_s, name)));
    let periods = counters.chain([(DAY_S, "the clock of a day"), (0.5 * DAY_S, "the clock of half a day")]);
    let fits = periods.filter(|(period_s, _)| (0.0..=LONGEST_STEP * usual_s).contains(&(step_s + period_s)));
    fits.min_by(|a, b| (step_s + a.0 - usual_s).abs().total_cmp(&(step_s + b.0 - usual_s).abs()))
}

/// Whether a run follows.
fn goes_on(time_s: &[f64]) -> bool {
    time_s.len() >= SHORTEST_RUN && time_s[..SHORTEST_RUN].windows(2).all(|pair| pair[1] >= pair[0])
}

/// Whether many rows have nearly the time of the row before.
fn is_clumped(time_s: &[f64]) -> bool {
    let [first, .., last] = time_s else { return false };
    let count = time_s.len() - 1;
    let mean_s = (last - first) / count as f64;
    let short = time_s.windows(2).filter(|pair| pair[1] - pair[0] < SHORT * mean_s).count();
    count >= SHORTEST_RUN && short as f64 > CLUMPED * count as f64
}

/// Spaces the rows of a run evenly, if their stamps come in clumps and no row is missing.
fn evenly_spaced(mended: &mut Mended, run: std::ops::Range<usize>) -> Option<()> {
    let rows: Vec<usize> = run.filter(|row| mended.kept[*row]).collect();
    let stamps: Vec<f64> = rows.iter().map(|row| mended.time_s[*row]).collect();
    if !is_clumped(&stamps) {
        take_repeated_out(mended, &rows);
        return Some(());
    }
    let mut steps: Vec<f64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let clump_s = steps[steps.len() * 9 / 10];
    let (start_s, step_s) = line(&stamps);
    let even = |index: usize| start_s + step_s * index as f64;
    let off = stamps.iter().enumerate().map(|(index, stamp)| (stamp - even(index)).abs()).fold(0.0, f64::max);
    // Between clumps the steps are long, within one they are short. Steps of every length are those of the rows.
    let mean_s = steps.iter().sum::<f64>() / steps.len() as f64;
    let between = steps.iter().filter(|step| (SHORT * mean_s..0.5 * clump_s).contains(*step)).count();
    if off > OFF_BY * clump_s || between as f64 > CLUMPED * steps.len() as f64 {
        // Rows are missing, or they really came so. Only rows at one time are no samples.
        take_repeated_out(mended, &rows);
        return Some(());
    }
    for (index, row) in rows.iter().enumerate() {
        // Whole nanoseconds.
        mended.time_s[*row] = (even(index) * 1e9).round() / 1e9;
    }
    let note = format!(
        "The times come in clumps of {:.4} s, as stamps of a computer or a coarse clock do. The rows are taken as evenly spaced, {step_s:.6} s apart.",
        clump_s
    );
    mended.notes.push(note);
    Some(())
}

/// A row with the time of the row before is that row again.
fn take_repeated_out(mended: &mut Mended, rows: &[usize]) {
    for pair in rows.windows(2) {
        if mended.time_s[pair[1]] <= mended.time_s[pair[0]] {
            mended.kept[pair[1]] = false;
        }
    }
}

/// Offset and slope of the line through values at 0, 1, 2, ...
fn line(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let (middle, mean) = ((count - 1.0) / 2.0, values.iter().sum::<f64>() / count);
    let (mut with, mut of) = (0.0, 0.0);
    for (index, value) in values.iter().enumerate() {
        let x = index as f64 - middle;
        with += x * (value - mean);
        of += x * x;
    }
    let slope = with / of;
    (mean - slope * middle, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(count: usize, step_s: f64) -> Vec<f64> {
        (0..count).map(|row| row as f64 * step_s).collect()
    }

    fn assert_even(mended: &Mended, step_s: f64) {
        for pair in mended.time_s.windows(2) {
            assert!((pair[1] - pair[0] - step_s).abs() < 1e-6, "{pair:?}");
        }
    }

    #[test]
    fn counters_that_wrap_are_continued() {
        for (period, name) in [
            (2_f64.powi(32) * 1e-6, "microseconds"),
            (65.536, "milliseconds"),
            (0.065_536, "microseconds"),
            (DAY_S, "day"),
        ] {
            let step_s = if period < 1.0 { 0.01 } else { 0.02 };
            let wrapping: Vec<f64> = times(300, step_s).iter().map(|t_s| (period - 0.03 + t_s) % period).collect();
            let found = mended(&wrapping, 1.0).unwrap();
            assert_even(&found, step_s);
            assert!(found.notes[0].contains(name), "{:?}", found.notes);
        }
    }

    #[test]
    fn runs_after_a_reset_follow_one_another() {
        let twice = [times(100, 0.01), times(150, 0.01)].concat();
        let found = mended(&twice, 1.0).unwrap();
        assert_eq!(found.time_s.len(), 250);
        assert!((found.time_s[100] - found.time_s[99] - PAUSE_S).abs() < 1e-9);
        assert!(found.notes[0].contains("starts again 1 times"), "{:?}", found.notes);
    }

    #[test]
    fn clumps_are_spread() {
        let stamps: Vec<f64> = times(500, 0.01).iter().map(|t_s| (t_s / 0.016).ceil() * 0.016).collect();
        let found = mended(&stamps, 1.0).unwrap();
        assert!((found.time_s[499] - found.time_s[0] - 4.99).abs() < 0.01);
        assert!(found.time_s.windows(2).all(|pair| (pair[1] - pair[0] - 0.01).abs() < 1e-4));
        // Two rows in each millisecond.
        let found =
            mended(&times(500, 0.0005).iter().map(|t_s| (t_s * 1e3).floor() * 1e-3).collect::<Vec<_>>(), 1.0).unwrap();
        assert!(found.time_s.windows(2).all(|pair| (pair[1] - pair[0] - 0.0005).abs() < 1e-5));
    }

    #[test]
    fn what_nothing_explains_is_not_mended() {
        assert_eq!(mended(&times(100, 0.01), 1.0), None);
        // Uneven, but in order.
        let uneven: Vec<f64> = (0..200).map(|row| f64::from(row) * 0.01 + f64::from(row % 7) * 0.001).collect();
        assert_eq!(mended(&uneven, 1.0), None);
        // Steps of every length are no clumps, though some are short.
        let steps_s = [0.5, 4.0, 1.2, 3.3, 0.4, 5.0, 2.1, 1.6, 4.4];
        let any: Vec<f64> = (0..99).map(|row| steps_s.iter().cycle().take(row).sum()).collect();
        assert!(is_clumped(&any));
        assert_eq!(mended(&any, 1.0).unwrap(), Mended { time_s: any.clone(), kept: vec![true; 99], notes: Vec::new() });
        let falling: Vec<f64> = times(100, 0.01).into_iter().rev().collect();
        assert_eq!(mended(&falling, 1.0), None);
        assert_eq!(mended(&[0.0, 0.0], 1.0), None);
    }

    #[test]
    fn single_rows_out_of_order_are_left_out() {
        for wrong in [1.0, 1e6] {
            let mut stamps = times(400, 0.01);
            stamps[300] = wrong;
            let found = mended(&stamps, 1.0).unwrap();
            assert_eq!((found.time_s.len(), found.kept[300]), (399, false), "{wrong}: {:?}", found.notes);
        }
    }
}

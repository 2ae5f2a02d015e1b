//! Speeds that a program times by the edges of an encoder: one step of it over the time from edge to edge.
//!
//! Such a speed is a mean that ended with the last edge. Until the next edge it is held, or it fades as one step over the time
//! since. With a coarse encoder that turns slowly it is late by more than a motor's time constant. Taken for the speed of the
//! moment it looks like a delay, or like something that is missing.

use super::columns::integrated;
use crate::configuration::dataset::edge_timing::{
    APART_ROWS, CLOSER, DECODED, FEWEST_EDGES, FEWEST_OF_RIG, FEWEST_OLD_ROWS, FEWEST_TIMES, KNOWN_TO_ROWS,
    LEAST_RANGE, LEAST_SHARE, MOST_EDGES, SAME_STEP, SLOW_ROWS, STEPS_FROM_REST,
};
use std::f64::consts::TAU;

/// Where the mean lies that a row reads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BetweenEdges {
    /// From its end to the row.
    pub age_s: f64,
    /// How long it is.
    pub length_s: f64,
}

/// Which edges a program takes the time between.
#[derive(Clone, Copy)]
enum Edges {
    /// The last two.
    LastTwo,
    /// The last one, and the last one that a row before had seen.
    SinceRowBefore,
}

/// How a speed was timed.
#[derive(Clone, Debug)]
pub struct EdgeTiming {
    /// Angle between two edges.
    pub step_rad: f64,
    /// Where the mean of each row lies.
    pub between: Vec<BetweenEdges>,
    /// Where it lies if it is since the last edge that a row before had seen; none where the counts say between which.
    since_row_before: Option<Vec<BetweenEdges>>,
}

impl EdgeTiming {
    /// Of edges that are counted.
    pub(super) fn of_counts(step_rad: f64, between: Vec<BetweenEdges>) -> Self {
        Self { step_rad, between, since_row_before: None }
    }

    /// The same since the last edge that a row before had seen; none where nothing leaves that open.
    pub(super) fn since_row_before(mut self) -> Option<Self> {
        self.between = self.since_row_before.take()?;
        Some(self)
    }

    /// What is said of a speed that was found to be timed; nothing where the counts are there as well.
    pub(super) fn note(&self) -> Option<String> {
        self.since_row_before.as_ref()?;
        Some(format!(
            "The speed is timed by encoder edges, {:.0} a revolution. It is compared as the mean between two edges. Record the counts as well: they contain more. If the speed is of the moment, set [recording] speed_window_s = 0 in the rig file.",
            TAU / self.step_rad
        ))
    }

    pub(super) fn append(&mut self, other: Self) {
        self.between.extend(other.between);
        match (&mut self.since_row_before, other.since_row_before) {
            (Some(mine), Some(theirs)) => mine.extend(theirs),
            (mine, _) => *mine = None,
        }
    }
}

/// A timed speed.
#[derive(Clone, Copy)]
pub(super) struct Timed<'a> {
    speed: &'a [f64],
    time_s: &'a [f64],
    /// Angle between two edges.
    step_rad: f64,
}

impl<'a> Timed<'a> {
    /// A speed, if its rows without an edge say that it is timed by edges.
    pub(super) fn recognised(speed: &'a [f64], time_s: &'a [f64], counts_per_rev: Option<f64>) -> Option<Self> {
        let is_equal = |row: usize| speed[row] != 0.0 && speed[row] == speed[row - 1];
        let old = (2..speed.len()).filter(|row| (is_equal(*row) && is_equal(row - 1)) || fades(speed, time_s, *row));
        if old.count() < FEWEST_OLD_ROWS {
            return None;
        }
        let of_rig = counts_per_rev.into_iter().flat_map(|per_rev| DECODED.map(|share| per_rev / share));
        let others = std::iter::successors(Some(FEWEST_EDGES), |edges| Some(edges * CLOSER));
        let told = |edges_per_rev: f64, fewest: usize| Self::new(speed, time_s, TAU / edges_per_rev).told(fewest);
        let of_rig = of_rig.filter_map(|edges| told(edges, FEWEST_OF_RIG));
        let others = others.take_while(|edges| *edges < MOST_EDGES).filter_map(|edges| told(edges, FEWEST_TIMES));
        let best = of_rig.max_by_key(|told| told.times).or_else(|| others.max_by_key(|told| told.times))?;
        Some(Self::new(speed, time_s, best.step_rad))
    }

    /// What the times from edge to edge tell of the step, where enough of them agree with the speeds read at their ends.
    fn told(self, fewest: usize) -> Option<Told> {
        let (mut all, mut times, mut last_news) = (0_usize, 0_usize, None);
        let (mut shortest, mut longest, mut passed_rows, mut said_rows) = (f64::INFINITY, 0.0_f64, 0.0, 0.0);
        for row in 1..self.speed.len() {
            if self.speed[row] * self.speed[row - 1] <= 0.0 {
                last_news = None;
            } else if self.is_news(row) {
                let said = self.step_s(row) / self.interval_s(row);
                let Some(last) = last_news.replace(row).filter(|_| said >= SLOW_ROWS) else { continue };
                let passed = (row - last) as f64;
                all += 1;
                if (passed - said).abs() < KNOWN_TO_ROWS {
                    times += 1;
                    passed_rows += passed;
                    said_rows += said;
                    (shortest, longest) = (shortest.min(passed), longest.max(passed));
                }
            }
        }
        let is_enough = all >= fewest && times as f64 >= LEAST_SHARE * all as f64;
        let told = || Told { times, step_rad: self.step_rad * passed_rows / said_rows };
        (is_enough && longest >= LEAST_RANGE * shortest).then(told)
    }

    pub(super) fn new(speed: &'a [f64], time_s: &'a [f64], step_rad: f64) -> Self {
        Self { speed, time_s, step_rad }
    }

    /// Of most programs by the last two edges.
    pub(super) fn timing(self) -> EdgeTiming {
        EdgeTiming {
            step_rad: self.step_rad,
            between: self.between(Edges::LastTwo),
            since_row_before: Some(self.between(Edges::SinceRowBefore)),
        }
    }

    /// The readings that say something of the motion, the others missing.
    pub(super) fn readings(self) -> Vec<f64> {
        let mut readings: Vec<f64> =
            (0..self.speed.len()).map(|row| if self.is_news(row) { self.speed[row] } else { f64::NAN }).collect();
        for row in (1..self.speed.len()).filter(|row| self.speed[row - 1] == 0.0 && self.speed[*row] != 0.0) {
            self.leave_out_start(row, &mut readings);
        }
        readings
    }

    /// Where the mean of each row lies; of a row at rest it is that of the row.
    fn between(self, edges: Edges) -> Vec<BetweenEdges> {
        let mut last_news = 0;
        let of_row = |row: usize| {
            let interval_s = self.interval_s(row);
            if self.speed[row] == 0.0 {
                return BetweenEdges { age_s: 0.0, length_s: interval_s };
            }
            let step_s = self.step_s(row);
            let steps = match edges {
                Edges::LastTwo => 1.0,
                Edges::SinceRowBefore => ((self.time_s[row] - self.time_s[last_news]) / step_s).round().max(1.0),
            };
            if self.is_news(row) {
                last_news = row;
            }
            BetweenEdges { age_s: 0.5 * step_s.min(interval_s), length_s: steps * step_s }
        };
        (0..self.speed.len()).map(of_row).collect()
    }

    /// The angle, by the speeds that are news at the middle of their means, and between them on straight lines.
    pub(super) fn angle_rad(self, between: &[BetweenEdges]) -> Vec<f64> {
        let middle_s = |row: usize| self.time_s[row] - between[row].age_s - 0.5 * between[row].length_s;
        let mut known: Vec<(f64, f64)> = (0..self.speed.len())
            .filter(|row| self.is_news(*row))
            .map(|row| (middle_s(row), self.speed[row]))
            .collect();
        known.sort_by(|a, b| a.0.total_cmp(&b.0));
        let at = |time_s: f64| {
            let after = known.partition_point(|(known_s, _)| *known_s <= time_s);
            match (after.checked_sub(1).map(|before| known[before]), known.get(after)) {
                (Some((from_s, from)), Some((to_s, to))) => from + (to - from) * (time_s - from_s) / (to_s - from_s),
                (Some((_, speed)), None) | (None, Some(&(_, speed))) => speed,
                (None, None) => 0.0,
            }
        };
        let speed: Vec<f64> = self.time_s.iter().map(|time_s| at(*time_s)).collect();
        integrated(&speed, self.time_s)
    }

    /// What it makes of a speed that an edge may be anywhere in its row.
    pub(super) fn noise(self) -> f64 {
        let within_s = |row: usize| self.step_s(row).min(self.interval_s(row));
        noise_of_ages(self.speed, self.time_s, |row| if self.is_news(row) { within_s(row) } else { f64::NAN })
    }

    fn step_s(self, row: usize) -> f64 {
        self.step_rad / self.speed[row].abs()
    }

    fn interval_s(self, row: usize) -> f64 {
        let first = row.saturating_sub(1);
        self.time_s[first + 1] - self.time_s[first]
    }

    /// Whether a row reads two edges that the row before had not. Between edges on either side of a reversal the shaft has
    /// turned anything.
    fn is_news(self, row: usize) -> bool {
        let value = self.speed[row];
        if value == 0.0 || row == 0 {
            return value == 0.0;
        }
        let before = self.speed[row - 1];
        let is_held = value == before && self.step_s(row) > self.interval_s(row);
        let fades = |row: usize| {
            step_of(self.speed, self.time_s, row).is_some_and(|step| (step / self.step_rad - 1.0).abs() < SAME_STEP)
        };
        let last = self.speed.len() - 1;
        before * value > 0.0 && !is_held && !fades(row) && (row == last || !fades(row + 1) && !self.faded_once(row))
    }

    /// Whether it is less than before for no more than a row: two edges so near each other the next speed knows nothing of.
    fn faded_once(self, row: usize) -> bool {
        let [before, value, next] = [row - 1, row, row + 1].map(|row| self.speed[row]);
        let is_less = value.abs() < before.abs();
        is_less && next != value && next * value > 0.0 && self.step_s(row + 1) >= APART_ROWS * self.interval_s(row + 1)
    }

    /// A program says "at rest" until the second edge.
    fn leave_out_start(self, first: usize, readings: &mut [f64]) {
        let start_s = self.time_s[first] - STEPS_FROM_REST * self.step_s(first) - self.interval_s(first);
        for row in (0..first).rev().take_while(|row| self.speed[*row] == 0.0 && self.time_s[*row] > start_s) {
            readings[row] = f64::NAN;
        }
    }
}

/// What it makes of a speed that the last edge of a row may be anywhere within so long; NaN: nothing is read there.
pub(super) fn noise_of_ages(speed: &[f64], time_s: &[f64], within_s: impl Fn(usize) -> f64) -> f64 {
    let squares = (1..speed.len() - 1).map(|row| {
        let change = (speed[row + 1] - speed[row - 1]) / (time_s[row + 1] - time_s[row - 1]);
        within_s(row).powi(2) * change.powi(2) / 12.0
    });
    let (sum, count) = squares.filter(|s| s.is_finite()).fold((0.0, 0.0), |(sum, count), s| (sum + s, count + 1.0));
    f64::sqrt(sum / f64::max(count, 1.0))
}

/// A step of the encoder, and how many times from edge to edge agree with it.
struct Told {
    times: usize,
    step_rad: f64,
}

/// The step that a row tells in which the speed is one step over the time since the last edge, as in the row before.
fn step_of(speed: &[f64], time_s: &[f64], row: usize) -> Option<f64> {
    let (value, before) = (speed[row], speed[row.checked_sub(1)?]);
    let is_less = value * before > 0.0 && value.abs() < before.abs();
    is_less.then(|| (time_s[row] - time_s[row - 1]) / (1.0 / value.abs() - 1.0 / before.abs()))
}

/// Whether two rows after each other tell the same step.
fn fades(speed: &[f64], time_s: &[f64], row: usize) -> bool {
    let steps = step_of(speed, time_s, row - 1).zip(step_of(speed, time_s, row));
    steps.is_some_and(|(step, next)| (next / step - 1.0).abs() < SAME_STEP)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const INTERVAL_S: f64 = 1e-3;
    const ROWS: usize = 6000;
    const LOOKS: usize = 50;
    const AT_REST_S: f64 = 0.2;

    /// A shaft that goes both ways, fast and slowly.
    fn turned_rad(time_s: f64) -> f64 {
        30.0 * (2.1 * time_s).sin() * (0.3 * time_s).cos() + 4.0 * time_s
    }

    fn time_s() -> Vec<f64> {
        (0..ROWS).map(|row| row as f64 * INTERVAL_S).collect()
    }

    /// What a program reads that times edges so far from each other, and holds its speed or lets it fade.
    fn timed(step_rad: f64, fades: bool) -> Vec<f64> {
        let passed = |look: usize| (turned_rad(look as f64 * INTERVAL_S / LOOKS as f64) / step_rad).floor();
        let (mut edges, mut last_s, mut speed) = (passed(0), 0.0, 0.0_f64);
        let mut read = Vec::new();
        for look in 1..=ROWS * LOOKS {
            let now_s = look as f64 * INTERVAL_S / LOOKS as f64;
            let now = passed(look);
            if now != edges {
                speed = (now - edges) * step_rad / (now_s - last_s);
                (edges, last_s) = (now, now_s);
            }
            if look % LOOKS == 0 {
                let most = step_rad / (now_s - last_s).max(1e-6);
                let shown = if fades { speed.clamp(-most, most) } else { speed };
                read.push(if now_s - last_s > AT_REST_S { 0.0 } else { shown });
            }
        }
        read
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Whichever way; and what it then says of the motion is what the shaft did, but for edges anywhere in their row.
        #[test]
        fn a_speed_timed_by_edges_is_known(edges_per_rev in 11_u32..100, fades: bool) {
            let step_rad = TAU / f64::from(edges_per_rev);
            let (speed, time_s) = (timed(step_rad, fades), time_s());
            let found = Timed::recognised(&speed, &time_s, None).expect("recognised");
            prop_assert!((found.step_rad / step_rad - 1.0).abs() < 0.05, "{}", found.step_rad / step_rad);
            let (between, readings) = (found.between(Edges::LastTwo), found.readings());
            let off = |row: usize| {
                let end_s = time_s[row] + INTERVAL_S - between[row].age_s;
                let mean = (turned_rad(end_s) - turned_rad(end_s - between[row].length_s)) / between[row].length_s;
                readings[row] - mean
            };
            let rows: Vec<usize> = (1..ROWS).filter(|row| readings[*row].is_finite()).step_by(7).collect();
            let square = rows.iter().map(|row| off(*row).powi(2)).sum::<f64>() / rows.len() as f64;
            let of_the_moment = (1..ROWS).step_by(7).map(|row| {
                let [from, to] = [0.0, INTERVAL_S].map(|ahead_s| turned_rad(time_s[row] + ahead_s));
                (speed[row] - (to - from) / INTERVAL_S).powi(2)
            });
            let taken_as_it_is = of_the_moment.sum::<f64>() / (ROWS as f64 / 7.0);
            prop_assert!(square < 0.25 * taken_as_it_is, "{square} {taken_as_it_is}");
        }

        /// Noise, steps of a converter, and what is made anew every so many rows.
        #[test]
        fn another_speed_is_not(step in 0.01_f64..2.0, every in 2_usize..30) {
            let time_s = time_s();
            let speed = |row: usize| (turned_rad(time_s[row] + 1e-4) - turned_rad(time_s[row])) / 1e-4;
            let rounded: Vec<f64> = (0..ROWS).map(|row| (speed(row) / step).round() * step).collect();
            let held: Vec<f64> = (0..ROWS).map(|row| speed(row - row % every)).collect();
            for speed in [rounded, held] {
                prop_assert!(Timed::recognised(&speed, &time_s, None).is_none());
            }
        }
    }
}

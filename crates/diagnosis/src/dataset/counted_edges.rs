//! Speeds timed by the edges of an encoder whose counts are recorded beside them, as this project's firmware does: at each tick
//! with edges the angle between the last edge and the last one known before, over the time between the two.
//!
//! Such a reading is late by half of that time and by the age of its last edge. Below one edge a tick the delay exceeds
//! a tick. The counts give the number of edges in between, so the delay and the averaging time are known.

use super::LONG_ROW;
use super::edge_timing::{BetweenEdges, EdgeTiming, noise_of_ages};
use super::speed_window::count_rad;
use crate::configuration::dataset::counted_edges::{
    CREEP_RAD_PER_S, FEWEST_TIMES, LEAST_SHARE, OLDEST_STEPS, QUOTIENT, STILL_ENDS, STILL_S,
};

/// A recording's speed beside its counts.
pub(super) struct Counted<'a> {
    counts: Vec<f64>,
    speed: &'a [f64],
    time_s: &'a [f64],
    step_rad: f64,
    interval_s: f64,
}

/// A row with edges.
#[derive(Clone, Copy)]
struct News {
    row: usize,
    /// The last edge came between these times.
    edge_s: [f64; 2],
    /// Time since the last edge of the row before, where the reading gives it.
    length_s: Option<f64>,
    /// Error of that time.
    slack_s: f64,
}

/// A speed as means between edges.
pub(super) struct Readings {
    /// Speeds of the motion, the others missing.
    pub speed: Vec<f64>,
    pub timing: EdgeTiming,
    /// Standard deviation of the speed from the uncertain time of an edge.
    pub noise: f64,
}

impl<'a> Counted<'a> {
    pub(super) fn new(angle_rad: &[f64], speed: &'a [f64], time_s: &'a [f64], step_rad: f64, interval_s: f64) -> Self {
        let counts = angle_rad.iter().map(|angle| (angle / step_rad).round()).collect();
        Self { counts, speed, time_s, step_rad, interval_s }
    }

    /// The speed as means between edges; `is_told`: another recording shows it. Otherwise `None`, if the times from
    /// edge to edge do not connect the rows.
    pub(super) fn readings(&self, is_told: bool) -> Option<Readings> {
        let mut news = self.news();
        let (agreeing, all) = follow(&mut news);
        let is_timed = agreeing >= FEWEST_TIMES && agreeing as f64 >= LEAST_SHARE * all as f64;
        (is_timed || is_told).then(|| {
            lead_back(&mut news);
            self.means(&news)
        })
    }

    /// Every row with edges, by itself.
    fn news(&self) -> Vec<News> {
        let quantum = count_rad(self.speed).unwrap_or(0.0);
        // Position of the last edge, in counts: half a count below one that was reached going up.
        let mut last_edge: Option<f64> = None;
        let mut news = Vec::new();
        for row in 1..self.counts.len() {
            let turned = self.counts[row] - self.counts[row - 1];
            // A reading does not contain the edges before a pause.
            if self.time_s[row] - self.time_s[row - 1] > LONG_ROW * self.interval_s || !turned.is_finite() {
                last_edge = None;
                continue;
            }
            if turned == 0.0 {
                continue;
            }
            let edge = self.counts[row] - 0.5 * turned.signum();
            let between = last_edge.replace(edge).map(|before| edge - before);
            let length_s = between.map(|steps| steps * self.step_rad / self.speed[row]);
            let length_s = length_s.filter(|length_s| length_s.is_finite() && *length_s > 0.0);
            let slack_s = length_s.unwrap_or(0.0) * (0.5 * quantum / self.speed[row].abs() + QUOTIENT);
            news.push(News { row, edge_s: self.edge_between(row), length_s, slack_s });
        }
        news
    }

    /// Bounds of the time of the last edge before a row, by that row alone.
    fn edge_between(&self, row: usize) -> [f64; 2] {
        let oldest_s = OLDEST_STEPS * self.step_rad / self.speed[row].abs();
        [(self.time_s[row] - oldest_s).max(self.time_s[row - 1]), self.time_s[row]]
    }

    fn means(&self, news: &[News]) -> Readings {
        let mut speed = vec![f64::NAN; self.speed.len()];
        let at_rest = BetweenEdges { age_s: 0.0, length_s: self.interval_s };
        let mut between = vec![at_rest; self.speed.len()];
        let mut widths_s = vec![f64::NAN; self.speed.len()];
        for (index, now) in news.iter().enumerate() {
            let row = now.row;
            let Some(read_s) = now.length_s else { continue };
            // For a long time the reading's last digit exceeds the uncertainty of both edges.
            let before = &news[index - 1];
            let is_rough = now.slack_s > before.width_s() + now.width_s();
            let length_s = if is_rough { now.middle_s() - before.middle_s() } else { read_s };
            speed[row] = self.speed[row];
            between[row] = BetweenEdges { age_s: self.time_s[row] - now.middle_s(), length_s };
            widths_s[row] = now.width_s();
        }
        for row in self.still_rows(news) {
            speed[row] = 0.0;
        }
        let noise = noise_of_ages(self.speed, self.time_s, |row| widths_s[row]);
        Readings { speed, timing: EdgeTiming::of_counts(self.step_rad, between), noise }
    }

    /// Rows in long times without an edge, their ends left out.
    fn still_rows(&self, news: &[News]) -> Vec<usize> {
        let last = self.time_s.len() - 1;
        let ends: Vec<usize> = [0].into_iter().chain(news.iter().map(|news| news.row)).chain([last]).collect();
        let still = |pair: &[usize]| {
            let [from_s, to_s] = [pair[0], pair[1]].map(|row| self.time_s[row]);
            let is_still = to_s - from_s > STILL_S.max(self.step_rad / CREEP_RAD_PER_S);
            let end_s = STILL_ENDS * (to_s - from_s);
            let is_inside = move |row: &usize| (from_s + end_s..to_s - end_s).contains(&self.time_s[*row]);
            (pair[0]..pair[1]).filter(move |row| is_still && is_inside(row))
        };
        ends.windows(2).flat_map(still).collect()
    }
}

/// Narrows the time of each edge by the edge before it and the time between. Returns how many agree, and of how many.
fn follow(news: &mut [News]) -> (usize, usize) {
    let (mut agreeing, mut all) = (0, 0);
    for index in 1..news.len() {
        let (before, now) = (news[index - 1], &mut news[index]);
        let Some(length_s) = now.length_s else { continue };
        all += 1;
        if now.narrow(before.edge_s, length_s, now.slack_s) {
            agreeing += 1;
        }
    }
    (agreeing, all)
}

/// The same by the edge after it.
fn lead_back(news: &mut [News]) {
    for index in (1..news.len()).rev() {
        let after = news[index];
        if let Some(length_s) = after.length_s {
            news[index - 1].narrow(after.edge_s, -length_s, after.slack_s);
        }
    }
}

impl News {
    fn middle_s(&self) -> f64 {
        0.5 * (self.edge_s[0] + self.edge_s[1])
    }

    fn width_s(&self) -> f64 {
        self.edge_s[1] - self.edge_s[0]
    }

    /// Bounds of an edge this much earlier; returns whether that is possible.
    fn narrow(&mut self, other_s: [f64; 2], later_s: f64, slack_s: f64) -> bool {
        let from_s = self.edge_s[0].max(other_s[0] + later_s - slack_s);
        let to_s = self.edge_s[1].min(other_s[1] + later_s + slack_s);
        let is_possible = from_s <= to_s;
        if is_possible {
            self.edge_s = [from_s, to_s];
        }
        is_possible
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    const INTERVAL_S: f64 = 1e-3;
    const ROWS: usize = 6000;
    const LOOKS: usize = 50;
    const AT_REST_S: f64 = 1.05;
    const BIT: f64 = 0.01;

    /// A shaft that goes both ways, and stands in between.
    fn turned_rad(time_s: f64, fast: f64) -> f64 {
        let course = (2.1 * time_s).sin();
        fast * (course.abs() - 0.6).max(0.0).powi(2) * course.signum()
    }

    /// Angle, speed and time as the firmware has them (`motorbench_core::encoder`).
    fn recorded(step_rad: f64, fast: f64) -> [Vec<f64>; 3] {
        let count_at = |time_s: f64| (turned_rad(time_s, fast) / step_rad).round();
        let (mut count, mut edge, mut edge_s, mut speed) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        let (mut seen, mut seen_s) = (edge, edge_s);
        let mut columns = [vec![], vec![], vec![]];
        let look_s = INTERVAL_S / LOOKS as f64;
        for look in 1..=ROWS * LOOKS {
            let now_s = look as f64 * look_s;
            let now = count_at(now_s);
            if now != count {
                edge = now - 0.5 * (now - count).signum();
                let [before_s, angle, before] =
                    [now_s - look_s, turned_rad(now_s, fast), turned_rad(now_s - look_s, fast)];
                edge_s = before_s + look_s * (edge * step_rad - before) / (angle - before);
                count = now;
            }
            if look % LOOKS == 0 {
                let most = step_rad / (now_s - edge_s);
                speed = match edge_s > seen_s {
                    true => (edge - seen) * step_rad / (edge_s - seen_s),
                    false if now_s - edge_s > AT_REST_S => 0.0,
                    false => speed.clamp(-most, most),
                };
                (seen, seen_s) = (edge, edge_s);
                let row = [count * step_rad, (speed / BIT).round() * BIT, now_s];
                columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
            }
        }
        columns
    }

    /// Mean square deviation of the recorded speed from the true mean between the edges.
    fn off(readings: &Readings, time_s: &[f64], fast: f64) -> f64 {
        let of_row = |row: usize| {
            let BetweenEdges { age_s, length_s } = readings.timing.between[row];
            let end_s = time_s[row] - age_s;
            let mean = (turned_rad(end_s, fast) - turned_rad(end_s - length_s, fast)) / length_s;
            (readings.speed[row] - mean).powi(2)
        };
        let squares: Vec<f64> = (1..ROWS).map(of_row).filter(|square| square.is_finite()).collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        /// Coarse or fine, fast or slow: it gives the true motion of the shaft.
        #[test]
        fn a_speed_beside_its_counts_is_known(counts_per_rev in 200_u32..4000, fast in 20.0_f64..200.0) {
            let step_rad = TAU / f64::from(counts_per_rev);
            let [angle, speed, time_s] = recorded(step_rad, fast);
            let counted = Counted::new(&angle, &speed, &time_s, step_rad, INTERVAL_S);
            let readings = counted.readings(false).expect("the counts lead from edge to edge");
            let said = readings.speed.iter().filter(|speed| speed.is_finite()).count();
            prop_assert!(said > ROWS / 8, "{said} rows say something");
            let of_the_moment = (1..ROWS).map(|row| {
                let mean = (turned_rad(time_s[row], fast) - turned_rad(time_s[row] - INTERVAL_S, fast)) / INTERVAL_S;
                (speed[row] - mean).powi(2)
            });
            let taken_as_it_is = of_the_moment.sum::<f64>() / ROWS as f64;
            let square = off(&readings, &time_s, fast);
            prop_assert!(square < 0.1 * taken_as_it_is, "{square} {taken_as_it_is}");
            prop_assert!(square < 9.0 * (readings.noise.powi(2) + BIT.powi(2)), "{square} {}", readings.noise);
        }

        /// A tachogenerator's speed beside counts, or a difference of them.
        #[test]
        fn another_speed_beside_counts_is_not(counts_per_rev in 1000_u32..4000, by_counts: bool) {
            let step_rad = TAU / f64::from(counts_per_rev);
            let [angle, _, time_s] = recorded(step_rad, 100.0);
            let at = |row: usize| if by_counts { angle[row] } else { turned_rad(time_s[row], 100.0) };
            let speed: Vec<f64> = (0..ROWS).map(|row| (at(row.max(8)) - at(row.max(8) - 8)) / (8.0 * INTERVAL_S)).collect();
            let counted = Counted::new(&angle, &speed, &time_s, step_rad, INTERVAL_S);
            prop_assert!(counted.readings(false).is_none());
        }
    }
}

//! Finds the angle of the shaft where only a tachogenerator is recorded. The integral of the speed drifts: in 20 s its
//! noise makes half a radian, and a ripple sampled too rarely makes more. At 14 ripples a revolution half a radian is a
//! whole ripple. So the phase of the ripple is tracked stretch by stretch, and corrects the angle.

use crate::configuration::diagnose::ripple_phase::{
    CELL_S, CELLS, CLEAR, FEWEST_RIPPLES, LEAST_GAIN, ROUNDS, SLOW_S, TELLS_PHASE,
};
use crate::dataset::{Dataset, Output, Stretch};
use crate::identify::{Effort, Fit, Prior, fit, scales};
use crate::parallel;
use motorbench_model::catalogue::{Effect, effect};
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Identifier of the tracked effect.
const ID: &str = "tacho_ripple";

/// Corrects the angle if a ripple with it explains more than without. Returns whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    let is_integrated = data.motion().output == Output::Speed && data.count_rad <= 0.0;
    let Some(effect) = effect(ID).filter(|_| is_integrated) else { return false };
    let anew = found.model.has(ID).then(|| fit(&found.model.without(ID), data, prior, Effort::TRIAL));
    let bare = anew.as_ref().unwrap_or(found);
    let Some((other, start)) = with_angle_by_ripple(data, bare, effect) else { return false };
    let with_ripple = bare.model.with(effect, start);
    let explains = fit(&with_ripple, &other, prior, Effort::TRIAL).cost <= LEAST_GAIN * found.cost;
    if explains {
        *data = other;
    }
    explains
}

/// The data with the angle from the ripple, and starting values of the effect.
fn with_angle_by_ripple(data: &Dataset, found: &Fit, effect: &dyn Effect) -> Option<(Dataset, Vec<f64>)> {
    let place = effect.about().number()?;
    let starts = effect.starts(&scales(&found.model.motor, data));
    let mut ripple = Ripple::new(data, found);
    let explained: Vec<f64> = parallel::map(&starts, |start| ripple.explained(start[place]));
    let mut sorted = explained.clone();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let (best, next, usual) = (*sorted.first()?, *sorted.get(1)?, sorted[sorted.len() / 2]);
    if best <= 0.0 || best < CLEAR[0] * usual || best < CLEAR[1] * next {
        return None;
    }
    let start = starts.into_iter().zip(&explained).find(|(_, explained)| **explained == best)?.0;
    for _ in 0..ROUNDS {
        ripple.correct(start[place]);
    }
    let mut other = data.clone();
    other.angle_rad = ripple.angle_rad;
    other.origin.angle_by_ripple = true;
    Some((other, start))
}

/// The residual of the speed over the angle.
struct Ripple<'a> {
    data: &'a Dataset,
    speed: &'a [f64],
    left: Vec<f64>,
    angle_rad: Vec<f64>,
}

/// Sums of a cell for the least squares of the residual on speed times cosine and sine.
#[derive(Clone, Copy, Default)]
struct Sums {
    normal: [f64; 3],
    towards: [f64; 2],
    turned_rad: f64,
}

impl Sums {
    fn plus(self, other: Self) -> Self {
        Self {
            normal: std::array::from_fn(|index| self.normal[index] + other.normal[index]),
            towards: std::array::from_fn(|index| self.towards[index] + other.towards[index]),
            turned_rad: self.turned_rad + other.turned_rad,
        }
    }

    /// Factors of cosine and sine, and by how much they lower the sum of squares; `None` if there are too few ripples.
    fn solved(self, ripples_per_rev: f64) -> Option<([f64; 2], f64)> {
        let [cc, cs, ss] = self.normal;
        let determinant = cc * ss - cs * cs;
        if ripples_per_rev * self.turned_rad < FEWEST_RIPPLES * TAU || determinant <= 1e-3 * cc * ss {
            return None;
        }
        let [c, s] = self.towards;
        let factors = [(ss * c - cs * s) / determinant, (cc * s - cs * c) / determinant];
        Some((factors, factors[0] * c + factors[1] * s))
    }
}

impl<'a> Ripple<'a> {
    fn new(data: &'a Dataset, found: &'a Fit) -> Self {
        let motion = data.motion_index();
        let speed = &found.prediction[motion];
        let rest = found.residual_of(data, motion);
        let (mut left, mut angle_rad) = (vec![f64::NAN; data.len()], data.angle_rad.clone());
        for Stretch { rows, .. } in &data.stretches {
            let slow = slow(&rest[rows.clone()], ((SLOW_S / data.interval_s) as usize).max(1));
            for (row, slow) in rows.clone().zip(&slow) {
                left[row] = rest[row] - slow;
            }
            for row in rows.clone().skip(1) {
                let mean = |at: usize| speed[at] + slow[at - rows.start];
                let turned_rad = 0.5 * (mean(row) + mean(row - 1)) * (data.time_s[row] - data.time_s[row - 1]);
                angle_rad[row] = angle_rad[row - 1] + turned_rad;
            }
        }
        Self { data, speed, left, angle_rad }
    }

    /// Sums of the windows of a stretch, and their middle rows; each begins a cell after the one before.
    fn windows(&self, rows: &Range<usize>, ripples_per_rev: f64) -> Vec<(f64, Sums)> {
        let cell = ((CELL_S / self.data.interval_s) as usize).max(1);
        let starts = rows.clone().step_by(cell);
        let sums: Vec<Sums> =
            starts.map(|start| self.sums(start..(start + cell).min(rows.end), ripples_per_rev)).collect();
        let middle = |index: usize| (rows.start + index * cell) as f64 + 0.5 * (CELLS * cell) as f64;
        let windows = sums.windows(CELLS).enumerate();
        windows.map(|(index, cells)| (middle(index), cells.iter().copied().fold(Sums::default(), Sums::plus))).collect()
    }

    fn sums(&self, rows: Range<usize>, ripples_per_rev: f64) -> Sums {
        let mut sums =
            Sums { turned_rad: (self.angle_rad[rows.end - 1] - self.angle_rad[rows.start]).abs(), ..Sums::default() };
        for row in rows.filter(|row| self.left[*row].is_finite()) {
            let (sine, cosine) = (ripples_per_rev * self.angle_rad[row]).sin_cos();
            let (c, s) = (self.speed[row] * cosine, self.speed[row] * sine);
            for (sum, of_row) in sums.normal.iter_mut().zip([c * c, c * s, s * s]) {
                *sum += of_row;
            }
            for (sum, of_row) in sums.towards.iter_mut().zip([c, s]) {
                *sum += of_row * self.left[row];
            }
        }
        sums
    }

    /// By how much this number of ripples, with a separate phase in each window, lowers the sum of squares.
    fn explained(&self, ripples_per_rev: f64) -> f64 {
        let of_stretch = |stretch: &Stretch| -> f64 {
            let windows = self.windows(&stretch.rows, ripples_per_rev);
            windows.into_iter().filter_map(|(_, sums)| Some(sums.solved(ripples_per_rev)?.1)).sum()
        };
        self.data.stretches.iter().map(of_stretch).sum::<f64>() / CELLS as f64
    }

    /// Shifts the angle so that the ripple is a cosine everywhere.
    fn correct(&mut self, ripples_per_rev: f64) {
        let finite = || self.left.iter().filter(|left| left.is_finite());
        let squares: f64 = finite().map(|left| left * left).sum();
        let noise = (squares - self.explained(ripples_per_rev)).max(0.0) / finite().count().max(1) as f64;
        for Stretch { rows, .. } in &self.data.stretches {
            let mut phases: Vec<(f64, f64)> = Vec::new();
            for (middle, sums) in self.windows(rows, ripples_per_rev) {
                let Some(([cosine, sine], explains)) = sums.solved(ripples_per_rev) else { continue };
                if explains > TELLS_PHASE * noise {
                    let phase = sine.atan2(cosine);
                    let before = phases.last().map_or(phase, |(_, before)| *before);
                    // The nearest of all equivalent phases.
                    phases.push((middle, before + (phase - before + PI).rem_euclid(TAU) - PI));
                }
            }
            for row in rows.clone() {
                self.angle_rad[row] -= between(&phases, row as f64) / ripples_per_rev;
            }
        }
    }
}

/// Mean of the rows around each, missing ones left out.
fn slow(rest: &[f64], rows: usize) -> Vec<f64> {
    let mean = |row: usize| {
        let around = rest[row.saturating_sub(rows / 2)..(row + rows / 2 + 1).min(rest.len())].iter();
        let (sum, count) =
            around.filter(|rest| rest.is_finite()).fold((0.0, 0.0), |(sum, count), rest| (sum + rest, count + 1.0));
        sum / f64::max(count, 1.0)
    };
    (0..rest.len()).map(mean).collect()
}

/// Linear between points in order, constant beyond them, zero without any.
fn between(points: &[(f64, f64)], at: f64) -> f64 {
    let next = points.partition_point(|(place, _)| *place < at);
    match (next.checked_sub(1).map(|before| points[before]), points.get(next)) {
        (Some((from, before)), Some((to, after))) => before + (after - before) * (at - from) / (to - from),
        (Some((_, only)), None) | (None, Some(&(_, only))) => only,
        (None, None) => 0.0,
    }
}

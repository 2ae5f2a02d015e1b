//! Counts lost in bursts that the counts alone do not show: they are too short, or fall in a braking phase.
//!
//! A model that is right otherwise shows them. Its residual is noise but for a few moments, and in each of these fewer
//! counts come than the shaft turns. They are never more and never of the other sign. At the end the full speed is back
//! at once, as no shaft with inertia can do. The current does not show a held shaft.

use super::judge::noise;
use super::residuals;
use crate::configuration::diagnose::unseen_losses::{
    ABRUPT, FEWEST_ABRUPT, LEAST_COUNTS, LEAST_SHARE, MOST_COUNTED, MOST_ROWS, RIGHT_OTHERWISE, STANDS_OUT,
};
use crate::dataset::{CounterStop, Dataset, NORMAL_MEDIAN, Output, Stretch, median, runs};
use crate::identify::Fit;
use motorbench_model::linear::motor_model::TimeConstants;
use std::ops::Range;

/// Leaves these rows out. Returns whether there were any.
pub(super) fn settle(data: &mut Dataset, found: &Fit) -> bool {
    let stops = Losses::of(data, found).stops();
    let is_any = !stops.is_empty();
    data.leave_out(stops);
    is_any
}

/// The simulated motion, and by how much less is measured.
struct Losses<'a> {
    data: &'a Dataset,
    found: &'a Fit,
    predicted: &'a [f64],
    /// Measured minus simulated, per quantity, and its usual size.
    residuals: Vec<Vec<f64>>,
    usual: Vec<f64>,
    /// In the direction of the motion.
    shortfall: Vec<f64>,
    /// Beyond this a row stands out.
    threshold: f64,
}

impl<'a> Losses<'a> {
    fn of(data: &'a Dataset, found: &'a Fit) -> Self {
        let motion = data.motion_index();
        let predicted = &found.prediction[motion];
        let residuals = residuals(data, &found.prediction);
        let usual: Vec<f64> = residuals.iter().map(|residual| of_most(residual)).collect();
        let window_s = data.stretches.first().map_or(data.interval_s, Stretch::window_s);
        let of_counts = LEAST_COUNTS * data.count_rad / window_s;
        let threshold = (STANDS_OUT * usual[motion]).max(of_counts).max(data.motion().tolerance);
        let in_its_sense = residuals[motion].iter().zip(predicted);
        let shortfall = in_its_sense.map(|(residual, speed)| -residual * speed.signum()).collect();
        Self { data, found, predicted, residuals, usual, shortfall, threshold }
    }

    /// The stops of the counter, if they are what stands out.
    fn stops(&self) -> Vec<CounterStop> {
        if self.data.count_rad <= 0.0 || !self.is_right_otherwise() {
            return Vec::new();
        }
        let moments: Vec<(&Stretch, Range<usize>)> = self
            .data
            .stretches
            .iter()
            .flat_map(|stretch| self.moments(stretch).into_iter().map(move |rows| (stretch, rows)))
            .collect();
        let losses: Vec<&(&Stretch, Range<usize>)> =
            moments.iter().filter(|(stretch, rows)| self.is_loss(stretch, rows)).collect();
        let rows: usize = moments.iter().map(|(_, rows)| rows.len()).sum();
        let is_rare = rows as f64 <= MOST_ROWS * self.data.len() as f64;
        let abrupt = losses.iter().filter(|(stretch, rows)| self.is_abrupt(stretch, rows)).count();
        // If some are already known, the others need not prove by themselves that they are losses.
        let are_known = abrupt >= FEWEST_ABRUPT || !self.data.origin.counter_stops.is_empty();
        match is_rare && are_known && losses.len() as f64 >= LEAST_SHARE * moments.len() as f64 {
            true => losses.into_iter().map(|(stretch, rows)| self.stop(stretch, rows)).collect(),
            false => Vec::new(),
        }
    }

    fn is_right_otherwise(&self) -> bool {
        self.data.measured.iter().enumerate().all(|(output, measured)| {
            self.usual[output]
                <= RIGHT_OTHERWISE * measured.least_error(noise(self.data, &self.residuals[output], output))
        })
    }

    /// Consecutive rows that stand out.
    fn moments(&self, stretch: &Stretch) -> Vec<Range<usize>> {
        runs(stretch.rows.clone().filter(|row| self.shortfall[*row].abs() > self.threshold))
    }

    /// Whether less is measured than turned, as much less is counted, and the current fits the model.
    fn is_loss(&self, stretch: &Stretch, rows: &Range<usize>) -> bool {
        let falls_short =
            |row: usize| (0.0..=self.predicted[row].abs() + self.threshold).contains(&self.shortfall[row]);
        let measured_rad = self.shortfall[rows.clone()].iter().sum::<f64>() * stretch.interval_s;
        rows.clone().all(falls_short)
            && self.stands_within(stretch, rows)
            && self.lost_rad(stretch, rows).abs() > 0.5 * measured_rad
            && self.current_is_usual(rows)
    }

    /// If it lasts longer than the windows of its first and last rows, nothing is counted between them.
    fn stands_within(&self, stretch: &Stretch, rows: &Range<usize>) -> bool {
        let span = stretch.window.span.max(1);
        let counted_share = |row: usize| 1.0 - self.shortfall[row] / self.predicted[row].abs();
        let within = rows.start + span..rows.end.saturating_sub(span);
        median(within.map(counted_share)) < MOST_COUNTED
    }

    fn current_is_usual(&self, rows: &Range<usize>) -> bool {
        let measured = &self.data.measured;
        let Some(current) = measured.iter().position(|measured| measured.output == Output::Current) else {
            return true;
        };
        let own = median(self.residuals[current][rows.clone()].iter().map(|left| left.abs()));
        own <= STANDS_OUT * self.usual[current]
    }

    /// No shaft gains so much speed in so short a time, even with a load behind a gap or a spring.
    fn is_abrupt(&self, stretch: &Stretch, rows: &Range<usize>) -> bool {
        let model = &self.found.model;
        let time_constant_s = TimeConstants::of(&model.motor).electromechanical_s * model.motor_share();
        // From inside the burst to the first row after it.
        let back = stretch.window.span.max(1) + 1;
        let inside = self.shortfall[rows.end.saturating_sub(back).max(rows.start)..rows.end]
            .iter()
            .fold(0.0, |a, b| f64::max(a, *b));
        let by_a_shaft = (-(back as f64) * stretch.interval_s / time_constant_s).exp();
        inside * by_a_shaft > ABRUPT * self.threshold
    }

    /// The angle that was turned and not counted; a speed from another sensor may fail by itself.
    fn lost_rad(&self, stretch: &Stretch, rows: &Range<usize>) -> f64 {
        let seen = seen_in(stretch, rows);
        let motion = self.data.motion();
        match motion.output {
            Output::Speed | Output::TimedSpeed => {
                let turned_rad = self.predicted[seen.clone()].iter().sum::<f64>() * stretch.interval_s;
                turned_rad - (self.data.angle_rad[seen.end] - self.data.angle_rad[seen.start])
            }
            _ => {
                let lost = seen.map(|row| self.predicted[row] - motion.values[row]).filter(|lost| lost.is_finite());
                lost.sum::<f64>() * stretch.interval_s
            }
        }
    }

    fn stop(&self, stretch: &Stretch, moment: &Range<usize>) -> CounterStop {
        let span = stretch.window.span.max(1);
        let start = (moment.start + stretch.window.ahead).saturating_sub(1).max(stretch.rows.start);
        let end = (moment.end + stretch.window.ahead + 1).saturating_sub(span).clamp(start + 2, stretch.rows.end);
        // One count at either end, and the uncertainty of the model.
        let uncertain_rad = self.threshold / STANDS_OUT * (moment.len() as f64).sqrt() * stretch.interval_s;
        CounterStop {
            rows: start..end,
            lost_counts: self.lost_rad(stretch, moment) / self.data.count_rad,
            error_counts: 1.0_f64.hypot(uncertain_rad / self.data.count_rad),
        }
    }
}

/// From before the first missing count to after the last.
fn seen_in(stretch: &Stretch, rows: &Range<usize>) -> Range<usize> {
    let span = stretch.window.span.max(1);
    rows.start.saturating_sub(span).max(stretch.rows.start)..(rows.end + span).min(stretch.rows.end - 1)
}

/// Standard deviation of most values, robust against the others.
fn of_most(values: &[f64]) -> f64 {
    median(values.iter().map(|value| value.abs())) / NORMAL_MEDIAN
}

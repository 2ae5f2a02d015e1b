//! Readings of a model's sensors from its motion.

use super::{Motion, Prediction};
use crate::dataset::{Averaged, BetweenEdges, Dataset, Output, Stretch, difference};
use motorbench_data::rig;
use motorbench_model::between_rows::Bulge;
use motorbench_model::catalogue::{Readings, Sampling};
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::{Model, Term};
use std::ops::Range;

/// Reads a motion with the sensors of the model.
pub fn read(model: &Model, data: &Dataset, mut motion: Motion) -> Prediction {
    if data.origin.current_window_s > 0.0 && !data.is_switched() {
        motion.current_a = mean_current(model, &motion, data);
    }
    if let Some(late_s) = data.origin.timing.current_late_s {
        read_late(&mut motion.current_a, data, late_s);
    }
    if data.origin.current_is_magnitude {
        motion.current_a.iter_mut().for_each(|current| *current = current.abs());
    }
    if (data.origin.timing.readings, data.motion().output) == (rig::Readings::Mean, Output::Speed) {
        motion.speed_rad_per_s = mean_since_row_before(&motion, data);
    }
    let shaft_bulges = shaft_bulges(model, &motion, data);
    for term in model.in_turn(|effect| !effect.acts_on_motor()) {
        for stretch in &data.stretches {
            falsify(term, model, data, (stretch.rows.clone(), &shaft_bulges), &mut motion);
        }
    }
    data.measured
        .iter()
        .map(|measured| match measured.output {
            // Each is measured once at most.
            Output::Current => std::mem::take(&mut motion.current_a),
            Output::Speed => std::mem::take(&mut motion.speed_rad_per_s),
            Output::MeanSpeed if data.origin.averaged == Some(Averaged::Readings) => mean_of_readings(&motion, data),
            Output::MeanSpeed | Output::AngleDifference => mean_speed(&motion, data),
            Output::TimedSpeed => timed_speed(&motion, data),
        })
        .collect()
}

/// The deviation of the speed from a straight line between rows, from the turned angle. It is computed only if an
/// effect needs it.
fn shaft_bulges(model: &Model, motion: &Motion, data: &Dataset) -> Vec<Bulge> {
    let mut bulges = Vec::new();
    if model.tachogenerator_lag_s() == 0.0 {
        return bulges;
    }
    bulges.resize(data.len(), Bulge::NONE);
    for index in data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1)) {
        let step_s = data.time_s[index] - data.time_s[index - 1];
        let mean = (motion.angle_rad[index] - motion.angle_rad[index - 1]) / step_s;
        let of_line = 0.5 * (motion.speed_rad_per_s[index - 1] + motion.speed_rad_per_s[index]);
        bulges[index] = Bulge::parabola(mean - of_line);
    }
    bulges
}

/// The current as a mean over the window before each row.
fn mean_current(model: &Model, motion: &Motion, data: &Dataset) -> Vec<f64> {
    let winding_s = TimeConstants::of(&model.motor).electromagnetic_s;
    let mut means = motion.current_a.clone();
    for Stretch { rows, .. } in &data.stretches {
        for (mean_a, row) in means[rows.clone()].iter_mut().zip(rows.clone()).skip(1) {
            *mean_a =
                mean_current_before(motion, &data.time_s, rows.start..row, data.origin.current_window_s, winding_s);
        }
    }
    means
}

/// Readings delayed by this time, by interpolation.
fn read_late(readings: &mut [f64], data: &Dataset, late_s: f64) {
    for row in data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1).rev()) {
        let share = (late_s / (data.time_s[row] - data.time_s[row - 1])).min(1.0);
        readings[row] += share * (readings[row - 1] - readings[row]);
    }
}

/// Integral of a current over the last share of an interval, in lengths of the interval, from its values at both ends.
pub(super) fn in_the_last(share: f64, [first_a, last_a]: [f64; 2], bulge: &Bulge) -> f64 {
    let even_a = last_a - 0.5 * share * (last_a - first_a);
    share * even_a + bulge.in_the_last(share)
}

/// Mean current over the last `window_s` of these rows and the one after them, or over all of that if it is shorter.
fn mean_current_before(motion: &Motion, time_s: &[f64], rows: Range<usize>, window_s: f64, winding_s: f64) -> f64 {
    let (mut charge, mut length_s) = (0.0, 0.0);
    for first in rows.rev() {
        if length_s >= window_s {
            break;
        }
        let last = first + 1;
        let interval_s = time_s[last] - time_s[first];
        let share = ((window_s - length_s) / interval_s).min(1.0);
        let bulge = Bulge::new(motion.bulge_a[last], interval_s, winding_s);
        charge += interval_s * in_the_last(share, [first, last].map(|row| motion.current_a[row]), &bulge);
        length_s += share * interval_s;
    }
    charge / length_s
}

fn mean_since_row_before(motion: &Motion, data: &Dataset) -> Vec<f64> {
    let mut means = motion.speed_rad_per_s.clone();
    for row in data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1)) {
        let turned_rad = motion.angle_rad[row] - motion.angle_rad[row - 1];
        means[row] = turned_rad / (data.time_s[row] - data.time_s[row - 1]);
    }
    means
}

fn mean_speed(motion: &Motion, data: &Dataset) -> Vec<f64> {
    let mut speed = vec![f64::NAN; data.len()];
    for Stretch { rows, window, .. } in &data.stretches {
        let differences = difference(&motion.angle_rad[rows.clone()], &data.time_s[rows.clone()], *window);
        speed[rows.clone()].copy_from_slice(&differences);
    }
    speed
}

/// Means of as many readings at rows as the window has.
fn mean_of_readings(motion: &Motion, data: &Dataset) -> Vec<f64> {
    let mut speed = vec![f64::NAN; data.len()];
    for Stretch { rows, window, .. } in &data.stretches {
        let readings = window.span + 1;
        let mut sum: f64 = motion.speed_rad_per_s[rows.clone()].iter().take(window.span).sum();
        for row in rows.clone().skip(window.span) {
            sum += motion.speed_rad_per_s[row];
            speed[row] = sum / readings as f64;
            sum -= motion.speed_rad_per_s[row - window.span];
        }
    }
    speed
}

/// Means between the edges that the recording gives.
fn timed_speed(motion: &Motion, data: &Dataset) -> Vec<f64> {
    let mut speed = vec![f64::NAN; data.len()];
    let Some(timing) = &data.origin.edge_timing else { return speed };
    for Stretch { rows, .. } in &data.stretches {
        for row in rows.clone() {
            let BetweenEdges { age_s, length_s } = timing.between[row];
            let end_s = data.time_s[row] - age_s;
            let turned_rad = || {
                let at = |time_s: f64| motion.angle_before(row, rows.start, &data.time_s, time_s);
                Some(at(end_s)? - at(end_s - length_s)?)
            };
            speed[row] = turned_rad().map_or(f64::NAN, |turned_rad| turned_rad / length_s);
        }
    }
    speed
}

/// Applies one sensor's effect to the readings of one stretch.
fn falsify(
    term: &Term,
    model: &Model,
    data: &Dataset,
    (range, shaft_bulges): (Range<usize>, &[Bulge]),
    motion: &mut Motion,
) {
    let winding_s = TimeConstants::of(&model.motor).electromagnetic_s;
    let mut state = vec![0.0; term.effect.states()];
    for index in range.clone() {
        let step_s = if index > range.start { data.time_s[index] - data.time_s[index - 1] } else { 0.0 };
        let mut readings = Readings {
            current_a: motion.current_a[index],
            speed_rad_per_s: motion.speed_rad_per_s[index],
            angle_rad: motion.angle_rad[index],
        };
        let bulge = Bulge::new(motion.bulge_a[index], step_s, winding_s);
        let speed_bulge = shaft_bulges.get(index).copied().unwrap_or(Bulge::NONE);
        let at = Sampling { angle_rad: motion.shaft_rad[index], step_s, bulge, speed_bulge };
        term.effect.sense(&term.values, &at, &mut state, &mut readings);
        motion.current_a[index] = readings.current_a;
        motion.speed_rad_per_s[index] = readings.speed_rad_per_s;
        motion.angle_rad[index] = readings.angle_rad;
    }
}

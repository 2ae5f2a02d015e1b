//! Estimates how late the readings came, where that changes during a recording. A program that takes readings out of a
//! buffer more slowly than they come falls behind, and loses some when the buffer is full. Its rows then have wrong times.
//! A model that does not know it takes the lateness for a winding or a gap.

use super::bad_stretches::MOST_LEFT_OUT;
use super::channels::excluded;
use super::command_times::LEAST_GAIN;
use super::judge::motion_above_floor;
use super::lateness::{QUICK_S, at_once, errors, late_s, with_time_constant, without_lag};
use super::select::{SMALL_REST, usual_model};
use crate::dataset::{Dataset, LateCourse, median};
use crate::free_run::free_run;
use crate::identify::{Effort, Fit, Prior, fit};
use maybe_rayon::prelude::*;
use motorbench_model::Model;

/// A lateness is another than usual if it differs by this share of its range.
const ANOTHER: f64 = 0.25;
/// Model and lateness are estimated in turn, this often...
const ROUNDS: usize = 8;
/// ... while that lowers the cost to this share.
const CLOSER: f64 = 0.9;
/// Share of the first error that is expected of anything else.
const NOT_LATENESS: f64 = 0.2;
/// Time constants of the motors that the search begins with. One that is far off finds another lateness.
const TIME_CONSTANTS_S: [f64; 3] = [QUICK_S, 0.02, 0.1];
/// First and last step in the search for what is the motor's own of a lateness.
const FIRST_STEP_S: f64 = 0.02;
const LAST_STEP_S: f64 = 1e-3;

/// The data with each reading at its own time, if a lateness that changes explains most of the rest.
pub(super) fn settled(data: Dataset, prior: &Prior) -> Dataset {
    if !data.axis.drive.is_voltage() {
        return data;
    }
    let usual = usual_model(&data, prior, &excluded(&data));
    // Readings of the motion are late with those of the current.
    if motion_above_floor(&data, &usual) < SMALL_REST {
        return data;
    }
    // What the usual model lacks is mostly the lateness. Later, as much is expected as the best model so far has lacked.
    let mut expected: Vec<f64> = errors(&data, &usual.prediction);
    expected.iter_mut().for_each(|error| *error *= NOT_LATENESS);
    let first = TIME_CONSTANTS_S.into_par_iter().map(|time_constant_s| {
        let model = at_once(&with_time_constant(&usual.model, time_constant_s), prior);
        moved(&data, &model, &expected, prior)
    });
    let first: Vec<_> = first.collect();
    let mut best =
        first.into_iter().flatten().min_by(|(_, one), (_, other)| mean_square(one).total_cmp(&mean_square(other)));
    for _ in 1..ROUNDS {
        let Some((retimed, found)) = &best else { break };
        let lacked = errors(retimed, &found.prediction);
        expected.iter_mut().zip(lacked).for_each(|(expected, lacked)| *expected = expected.min(lacked));
        let again = moved(&data, &without_lag(&found.model, prior), &expected, prior);
        match again {
            Some(again) if mean_square(&again.1) >= CLOSER * mean_square(found) => break,
            // Nothing is late beside a better model.
            again => best = again,
        }
    }
    let explains = |found: &Fit| mean_square(found) < LEAST_GAIN * mean_square(&usual);
    best.filter(|(_, found)| explains(found)).map_or(data, |(retimed, _)| retimed)
}

/// The data with the lateness that brings them closest to a model, and the model fitted to them; `None` if it never jumps,
/// or in one place alone.
fn moved(data: &Dataset, model: &Model, errors: &[f64], prior: &Prior) -> Option<(Dataset, Fit)> {
    let (late_s, course) = late_s(data, &free_run(model, data), errors);
    (course.jumps > 0 && is_throughout(&late_s)).then(|| less_late(data, (&late_s, course), model, prior))
}

/// Whether more rows than those of an accident are late by another time than usual.
fn is_throughout(late_s: &[f64]) -> bool {
    let usual_s = median(late_s.iter().copied());
    let [least_s, most_s] = [f64::min, f64::max].map(|of| late_s.iter().copied().fold(usual_s, of));
    let others = late_s.iter().filter(|late_s| (*late_s - usual_s).abs() > ANOTHER * (most_s - least_s)).count();
    others as f64 > MOST_LEFT_OUT * late_s.len() as f64
}

/// The data with the lateness that was found, or with less of it everywhere, and the model fitted to them. A quick model
/// takes the motor's own slowness for a lateness, and a model with that lateness stays quick.
fn less_late(data: &Dataset, (late_s, course): (&[f64], LateCourse), model: &Model, prior: &Prior) -> (Dataset, Fit) {
    let by = |less_s: f64, model: &Model| {
        let less: Vec<f64> = late_s.iter().map(|late_s| (late_s - less_s).max(0.0)).collect();
        let retimed = data.with_late_readings(&less, course);
        let found = fit(model, &retimed, prior, Effort::AGAIN);
        (retimed, found)
    };
    let mut best = by(0.0, model);
    let (mut less_s, mut step_s) = (0.0, FIRST_STEP_S);
    while step_s > LAST_STEP_S {
        let other = by(less_s + step_s, &best.1.model);
        if mean_square(&other.1) < mean_square(&best.1) {
            (best, less_s) = (other, less_s + step_s);
        } else {
            step_s /= 2.0;
        }
    }
    best
}

/// Cost of a reading: fewer remain where some come twice.
fn mean_square(fit: &Fit) -> f64 {
    fit.cost / fit.used().max(1) as f64
}

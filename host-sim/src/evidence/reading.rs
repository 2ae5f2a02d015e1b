//! What a rig file leaves open of how the current was read: as the mean over a period of the PWM, over some other window, or at
//! the moment of its row, and then in which phase of the period.

use super::fit::{Fitted, Problem};
use super::search::Progress;
use super::whiten::Unknown;
use crate::dataset::Dataset;
use crate::model::Model;
use crate::rig::Readings;
use rayon::prelude::*;

/// Phases that are looked at first.
const PHASES: usize = 12;
/// And then halvings of their distance.
const HALVINGS: usize = 4;

/// Where the program's own delay is known, a duty waits for the next period of the PWM besides: half of one in the mean.
pub fn latch(data: &mut Dataset) {
    let pwm_hz = data.origin.pwm_hz;
    if let Some(delay_s) = data.origin.timing.command_delay_s.as_mut().filter(|_| pwm_hz > 0.0) {
        *delay_s += 0.5 / pwm_hz;
    }
}

/// Ways to read the current that the rig file leaves open, the one as it stands first.
fn ways(data: &Dataset) -> Vec<Dataset> {
    let timing = &data.origin.timing;
    let is_open = timing.readings == Readings::Instant
        && timing.current_sampled_at.is_none()
        && timing.current_window_s.is_none()
        && data.current().is_some()
        && data.origin.pwm_hz > 0.0;
    let mut ways = vec![data.clone()];
    if is_open {
        ways.extend((0..PHASES).map(|phase| with_phase(data, phase as f64 / PHASES as f64)));
        let windows_s = [1.0 / data.origin.pwm_hz, data.interval_s, 0.5 * data.interval_s];
        ways.extend(windows_s.into_iter().map(|window_s| with_window(data, window_s)));
    }
    ways
}

fn with_phase(data: &Dataset, phase: f64) -> Dataset {
    let mut other = data.clone();
    other.origin.pwm_phase = Some(phase.rem_euclid(1.0));
    other
}

fn with_window(data: &Dataset, window_s: f64) -> Dataset {
    let mut other = data.clone();
    other.origin.current_window_s = window_s;
    other
}

/// The data as they were most probably read, by what a model says of them.
pub fn most_probable(problem: &Problem, model: &Model, unknown: Unknown, progress: Progress) -> Option<Dataset> {
    let cost = |data: &Dataset| {
        let other = Problem::new(data, problem.prior, problem.set);
        other.as_it_stands(model, unknown)
    };
    let ways = ways(problem.data);
    if ways.len() < 2 {
        return None;
    }
    let costs: Vec<f64> = ways.par_iter().map(cost).collect();
    let mut best = (0..ways.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).map(|index| (costs[index], ways[index].clone()))?;
    let mut distance = 0.5 / PHASES as f64;
    for _ in 0..HALVINGS {
        let Some(phase) = best.1.origin.pwm_phase else { break };
        for side in [-distance, distance] {
            let other = with_phase(problem.data, phase + side);
            let there = cost(&other);
            if there < best.0 {
                best = (there, other);
            }
        }
        distance *= 0.5;
    }
    progress(&format!(
        "reading: {:.0} -> {:.0}, phase {:?}, window {:.2e}",
        costs[0], best.0, best.1.origin.pwm_phase, best.1.origin.current_window_s
    ));
    (best.0 < costs[0] - problem.set.reading_odds).then_some(best.1)
}

/// The same as a fit that has been made.
pub fn of(problem: &Problem, fitted: &Fitted, progress: Progress) -> Option<Dataset> {
    most_probable(problem, &fitted.model, fitted.unknown, progress)
}

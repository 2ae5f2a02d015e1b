//! What a rig file leaves open of how the current was read: as the mean over a period of the PWM, over some other window, or at
//! the moment of its row, and then in which phase of the period.

use super::fit::{Fitted, Problem};
use crate::catalogue::observation::ReadingPhase;
use crate::dataset::Dataset;
use crate::model::Model;
use crate::rig::Readings;
use rayon::prelude::*;

/// Phases that are looked at first.
const PHASES: usize = 12;

/// Whether the rig file leaves open where in a period of the PWM the current is read.
fn is_open(data: &Dataset) -> bool {
    let timing = &data.origin.timing;
    timing.readings == Readings::Instant
        && timing.current_sampled_at.is_none()
        && timing.current_window_s.is_none()
        && data.current().is_some()
        && data.origin.pwm_hz > 0.0
}

/// A model with the current read in a phase of the PWM.
fn with_phase(model: &Model, periods: f64) -> Model {
    model.without("reading_phase").with(&ReadingPhase, vec![periods])
}

fn with_window(data: &Dataset, window_s: f64) -> Dataset {
    let mut other = data.clone();
    other.origin.current_window_s = window_s;
    other
}

/// Data and candidate as the current was most probably read; nothing where that is how they stand.
pub fn most_probable(problem: &Problem, fitted: &Fitted) -> Option<(Dataset, Model)> {
    let data = problem.data;
    if !is_open(data) {
        return None;
    }
    let as_it_stands = problem.as_it_stands(&fitted.model, fitted.unknown);
    let phases = (0..PHASES).into_par_iter().map(|phase| {
        let model = with_phase(&fitted.model, phase as f64 / PHASES as f64);
        (problem.as_it_stands(&model, fitted.unknown), data.clone(), model)
    });
    let windows_s = [1.0 / data.origin.pwm_hz, data.interval_s, 0.5 * data.interval_s];
    let windows = windows_s.into_par_iter().map(|window_s| {
        let other = with_window(data, window_s);
        let model = fitted.model.clone();
        (Problem::new(&other, problem.prior, problem.set).as_it_stands(&model, fitted.unknown), other, model)
    });
    let ways: Vec<(f64, Dataset, Model)> = phases.chain(windows).collect();
    let (least, read, model) = ways.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    (least < as_it_stands - problem.set.reading_odds).then_some((read, model))
}

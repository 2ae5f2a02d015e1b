//! Finds whether a command waits for the next period of the PWM. The compare registers of a microcontroller's timer are
//! double buffered in its PWM modes (ATmega328P data sheet, 15.7 and 16.9), so at 490 Hz a command acts up to 2 ms late.

use crate::dataset::Dataset;
use crate::identify::{Effort, Prior, fit, scales};
use maybe_rayon::prelude::*;
use motorbench_model::Model;
use motorbench_model::catalogue::{USUAL, effect};

/// It shows wherever the command changes; this much of a recording suffices.
const EXCERPT_S: f64 = 3.0;
/// Number of phases that are tried.
const PHASES: usize = 16;
/// A period shorter than this share of the time between two rows does not show.
const SHORT: f64 = 0.1;

/// Lets commands wait if the nominal motor fits better so. Its bridge has a drop, and brakes or coasts in the off phase.
pub(super) fn settle_at_first(data: &mut Dataset, prior: &Prior) {
    if data.origin.pwm_is_known && 1.0 / data.origin.pwm_hz > SHORT * data.interval_s {
        data.origin.latch_phase = likelier(&data.excerpt(EXCERPT_S), prior);
    }
}

fn likelier(data: &Dataset, prior: &Prior) -> Option<f64> {
    let scales = scales(&prior.motor, data);
    let usual = USUAL.iter().filter_map(|id| effect(id));
    let braking = usual.fold(Model::linear(prior.motor), |model, effect| model.with_start(effect, &scales));
    let coasting = effect("coast_decay").map(|effect| braking.with_start(effect, &scales));
    let models: Vec<Model> = [Some(braking), coasting].into_iter().flatten().collect();
    let at_once = models.into_par_iter().map(|model| fit(&model, data, prior, Effort::TRIAL));
    let at_once = at_once.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    let late = |phase: f64, effort: Effort| {
        let mut other = data.clone();
        other.origin.latch_phase = Some(phase);
        (fit(&at_once.model, &other, prior, effort).cost, phase)
    };
    let least = |ways: Vec<(f64, f64)>| ways.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let phases = (0..PHASES).into_par_iter().map(|phase| late(phase as f64 / PHASES as f64, Effort::NONE));
    let (_, phase) = least(phases.collect())?;
    let (cost, phase) = late(phase, Effort::TRIAL);
    (cost < at_once.cost).then_some(phase)
}

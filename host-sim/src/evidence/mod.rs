//! The diagnosis by evidence: one model of a recording, one criterion, one search. See `docs/method.md`.

pub mod constants;
pub mod fit;
pub mod outcome;
pub mod reading;
pub mod search;
pub mod settings;
pub mod whiten;

use crate::dataset::Dataset;
use crate::diagnose::outcome::Outcome;
use crate::identify::Prior;
use fit::{Fitted, Problem};
use rayon::prelude::*;
use search::Progress;
use settings::Settings;

/// What recordings of a motor say of it.
pub fn diagnosed(data: Dataset, prior: &Prior, progress: Progress) -> Outcome {
    let set = Settings::USUAL;
    let first = Problem::new(&data, prior, set);
    let begun = first.begin(progress);
    // How the current was read depends on what the bridge does between pulses, and the other way round.
    let ways: Vec<(Dataset, Fitted)> = begun
        .into_par_iter()
        .map(|begin| match reading::most_probable(&first, &begin, progress) {
            Some((read, model)) => {
                let begin = Problem::new(&read, prior, set).fit_to_the_end(&model, begin.unknown);
                (read, begin)
            }
            None => (data.clone(), begin),
        })
        .collect();
    for (_, begin) in &ways {
        progress(&format!("as read {:.0} {:?} {:?} {:?}", begin.evidence, begin.model.motor, begin.model.terms, begin.unknown));
    }
    let best = ways.into_iter().max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence));
    let (everything, begin) = best.expect("there are some");
    let problem = Problem::new(&everything, prior, set);
    let mut found = problem.search(begin, progress);
    if found.0.unknown.torque.max(found.0.unknown.voltage) > set.missing
        && let Some(later) = problem.later(progress)
        && later.evidence > found.0.evidence
    {
        found = problem.search(later, progress);
    }
    let (best, standings) = found;
    progress(&format!("evidence {:.1} {:?} {:?} {:?}", best.evidence, best.model.motor, best.model.terms, best.unknown));
    // Errors are told of all rows.
    let mut told = everything.clone();
    told.kept_back.fill(true);
    Problem::new(&told, prior, set).outcome(&best, &standings)
}

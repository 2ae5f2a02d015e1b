//! The diagnosis by evidence: one model of a recording, one criterion, one search. See `docs/method.md`.

pub mod constants;
pub mod fit;
pub mod outcome;
pub mod reading;
pub mod search;
pub mod settings;
pub mod whiten;

use crate::catalogue::ActsOn;
use crate::dataset::{Dataset, DatasetError};
use crate::diagnose::{Diagnosis, missing};
use crate::free_run::free_run;
use crate::identify::Prior;
use crate::model::Model;
use crate::recording::Recording;
use crate::rig::Rig;
use fit::{Effort, Fitted, Problem};
use rayon::prelude::*;
use search::Progress;
use settings::Settings;
use whiten::Unknown;

/// Diagnoses recordings of one rig by evidence.
///
/// # Errors
/// [`DatasetError`], when the recordings cannot be used; it says what to record instead.
pub fn diagnose(recordings: &[Recording], rig: &Rig, progress: Progress) -> Result<Diagnosis, DatasetError> {
    let data = Dataset::new(recordings, rig)?;
    let prior = Prior::new(&rig.motor, &data);
    Ok(diagnosed(data, &prior, progress))
}

/// What prepared recordings of a motor say of it.
pub fn diagnosed(mut data: Dataset, prior: &Prior, progress: Progress) -> Diagnosis {
    let set = Settings::USUAL;
    data.kept_back.fill(false);
    let (mut data, begin) = begun(data, prior, set, progress);
    let problem = Problem::new(&data, prior, set);
    let (best, standings) = searched(&problem, begin, progress);
    progress("intervals");
    let linear = Model::linear(prior.motor);
    let base = problem.fit(&linear, Unknown { torque: 30.0, voltage: 10.0, ..Unknown::USUAL }, Effort::FULL).model;
    // Every row was seen, and errors are told of all of them.
    data.kept_back.fill(true);
    let problem = Problem::new(&data, prior, set);
    let outcome = problem.outcome(&best, &standings, &base);
    let extended = free_run(&best.model, &data);
    let mut model = best.model;
    model.terms.retain(|term| !term.effect.is_observation());
    let bare = Model::linear(model.motor);
    let left = outcome::residuals(&data, &free_run(&bare, &data));
    let lacks = [ActsOn::Torque, ActsOn::Voltage].map(|place| missing::lack(&data, &bare.motor, &left, place)).to_vec();
    let base_said = free_run(&base, &data);
    Diagnosis { outcome, model, base: base_said, extended, base_model: base, lacks, steps: Vec::new(), data }
}

/// The data as the current was most probably read, and the best of the first candidates. How it was read depends on what the
/// bridge does between pulses, and the other way round.
fn begun(data: Dataset, prior: &Prior, set: Settings, progress: Progress) -> (Dataset, Fitted) {
    let first = Problem::new(&data, prior, set);
    let ways: Vec<(Dataset, Fitted)> = first
        .begin(progress)
        .into_par_iter()
        .map(|begin| match reading::most_probable(&first, &begin) {
            Some((read, model)) => {
                let begin = Problem::new(&read, prior, set).fit_to_the_end(&model, begin.unknown);
                (read, begin)
            }
            None => (data.clone(), begin),
        })
        .collect();
    let best = ways.into_iter().max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence));
    best.expect("there is a first candidate")
}

/// The most probable candidate. Where something remains, a long delay may have been missed.
fn searched(problem: &Problem, begin: Fitted, progress: Progress) -> (Fitted, Vec<search::Standing>) {
    let found = problem.search(begin, progress);
    let unknown = found.0.unknown;
    if unknown.torque.max(unknown.voltage) < problem.set.missing {
        return found;
    }
    progress("with a long delay");
    match problem.later().filter(|later| later.evidence > found.0.evidence) {
        Some(later) => problem.search(later, progress),
        None => found,
    }
}

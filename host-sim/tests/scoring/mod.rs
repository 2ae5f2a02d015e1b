//! What was hidden against what was named. The diagnosis sees the texts of the recording and of the rig file alone.

use hidden_effects::Trial;
use host_sim::diagnose::outcome::Outcome;
use host_sim::diagnose::{Diagnosis, diagnose};
use host_sim::recording::Recording;
use host_sim::rig::Rig;

/// The diagnosis of a trial's texts.
pub fn diagnosed(trial: &Trial) -> Diagnosis {
    let recording = Recording::parse("recording.csv", trial.csv.as_bytes(), &[]).unwrap();
    let rig = Rig::parse("rig.toml", &trial.rig_toml).unwrap();
    diagnose(&[recording], &rig, &|_| ()).unwrap()
}

/// What was hidden, by the catalogue's names.
pub fn hidden(trial: &Trial) -> Vec<&'static str> {
    let mut hidden: Vec<_> = trial.truth.effects.iter().map(|(effect, _)| effect.id()).collect();
    hidden.retain(|id| !id.starts_with("outside"));
    hidden.sort_unstable();
    hidden
}

/// What was named; a name that the diagnosis itself says cannot be told from a hidden one stands for it.
pub fn named(outcome: &Outcome, hidden: &[&'static str]) -> Vec<String> {
    let causes = || outcome.causes.iter().filter(|cause| !cause.effect.starts_with("parameter:"));
    let mut named: Vec<String> = causes()
        .map(|cause| {
            let taken = |id: &str| causes().any(|cause| cause.effect == id);
            let same = cause.not_separable_from.iter().find(|other| hidden.contains(other) && !taken(other));
            match same {
                Some(same) if !hidden.contains(&cause.effect.as_str()) => (*same).to_string(),
                _ => cause.effect.clone(),
            }
        })
        .collect();
    named.sort_unstable();
    named.dedup();
    named
}

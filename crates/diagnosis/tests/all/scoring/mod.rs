//! Draws the hidden effects, and compares them with the named ones. The diagnosis sees only the texts of recording and
//! rig file.

use hidden_effects::{Channels, Effect, Excitation, Mistake, Recipe, Trial, random_effects};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::outcome::Outcome;
use motorbench_diagnosis::diagnose::{Diagnosis, diagnose};

/// The recipe of one trial of a kind, or of an effect alone.
pub fn recipe(kind: &str, seed: u64) -> Recipe {
    let turn = |effects: &[Effect]| effects[(seed % effects.len() as u64) as usize];
    let single = || Recipe::of(&[turn(&Effect::CATALOGUE)]);
    let of_the_current = [Effect::CurrentOffset, Effect::CurrentLag, Effect::CurrentClipping];
    let without_current: Vec<Effect> = Effect::CATALOGUE.into_iter().filter(|e| !of_the_current.contains(e)).collect();
    // The ripple of a tachogenerator is not in the counts.
    let counted: Vec<Effect> = Effect::CATALOGUE.into_iter().filter(|effect| *effect != Effect::TachoRipple).collect();
    let real = || Recipe::of(&random_effects(seed, 1, true)).on_real_rig();
    let recipe = match kind {
        "clean" => Recipe::of(&[]),
        "single" => single(),
        "real" => real(),
        "pairs" => Recipe::of(&random_effects(seed, 2, false)),
        "triples" => Recipe::of(&random_effects(seed, 3, false)),
        "further" => Recipe::of(&[turn(&Effect::ASKED_FOR)]).on_real_rig(),
        "outside" => Recipe::of(&[turn(&Effect::OUTSIDE)]),
        "outside-real" => Recipe::of(&[turn(&Effect::OUTSIDE)]).on_real_rig(),
        "voltage-speed" => Recipe { channels: Channels::VoltageSpeed, ..Recipe::of(&[turn(&without_current)]) },
        "counts" => Recipe { channels: Channels::DutyCountsCurrent, ..Recipe::of(&[turn(&counted)]) },
        "levels" => Recipe { excitation: Excitation::Levels, ..single() },
        "binary" => {
            // A coasting off phase only scales the voltage as well.
            let others: Vec<Effect> = counted.iter().copied().filter(|effect| *effect != Effect::CoastDecay).collect();
            Recipe { excitation: Excitation::Prbs, ..Recipe::of(&[turn(&others)]).on_real_rig() }
        }
        "closed-loop" => Recipe { excitation: Excitation::ClosedLoop, ..single() },
        "slow" => Recipe { rate_hz: 200.0, ..real() },
        "slowest" => Recipe { rate_hz: 100.0, ..real() },
        "fewer" => {
            let excitation = [Excitation::ClosedLoop, Excitation::Identify][(seed % 2) as usize];
            Recipe { excitation, one_row_of: [5, 10][(seed / 2 % 2) as usize], ..real() }
        }
        "window" => {
            Recipe { channels: Channels::VoltageMeanSpeedCurrent, ..Recipe::of(&[turn(&counted)]).on_real_rig() }
        }
        "edges" => {
            // Of which the rig file says nothing is not asked what it counts.
            let of_the_encoder = [Effect::TachoRipple, Effect::EncoderEccentricity, Effect::MissedCounts];
            let others: Vec<Effect> = counted.iter().copied().filter(|e| !of_the_encoder.contains(e)).collect();
            Recipe { channels: Channels::VoltageTimedSpeedCurrent, ..Recipe::of(&[turn(&others)]).on_real_rig() }
        }
        "timer" => Recipe { timer_of_the_uno: true, ..real() },
        "darlingtons" => {
            Recipe { darlingtons: true, ..Recipe::of(&random_effects(seed, (seed % 2) as usize, true)).on_real_rig() }
        }
        "burst" => Recipe { burst: true, ..real() },
        "scale" => {
            let mistake = Some(Mistake::draw(seed));
            Recipe { mistake, channels: Channels::DutyCountsCurrent, ..Recipe::of(&[turn(&counted)]).on_real_rig() }
        }
        "filtered" => {
            let of_an_encoder = [Effect::EncoderEccentricity, Effect::MissedCounts];
            let others: Vec<Effect> =
                Effect::CATALOGUE.into_iter().filter(|effect| !of_an_encoder.contains(effect)).collect();
            let channels = Channels::VoltageSpeedCurrent;
            Recipe { channels, ..Recipe::of(&[Effect::SpeedLag, turn(&others)]).on_real_rig() }
        }
        "after" => Recipe { written_after: true, ..single() },
        id => Recipe::of(&[effect_of(id).expect("KIND is known")]),
    };
    recipe.with_random_strengths(seed)
}

/// A hidden effect by its identifier.
pub fn effect_of(id: &str) -> Option<Effect> {
    let mut all = Effect::CATALOGUE.into_iter().chain(Effect::ASKED_FOR).chain(Effect::OUTSIDE);
    all.find(|effect| effect.id() == id)
}

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
    hidden.retain(|id| *id != Effect::VoltageDrop.id() || trial.truth.drop_shows);
    hidden.extend(trial.truth.mistake.map(Mistake::id));
    hidden.sort_unstable();
    hidden
}

/// What was named, values called wrong included: none is further off than a data sheet's tolerance. A name that the
/// diagnosis itself says cannot be told from a hidden one stands for it.
pub fn named(outcome: &Outcome, hidden: &[&'static str]) -> Vec<String> {
    let causes = &outcome.causes;
    let mut named: Vec<String> = causes
        .iter()
        .map(|cause| {
            let taken = |id: &str| causes.iter().any(|cause| cause.effect == id);
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

//! `docs/diagnosis.schema.json` is what programs are promised: results of every kind keep to it, and it refuses others.

use hidden_effects::{Channels, Effect, Recipe, draw};
use host_sim::catalogue::CATALOGUE;
use host_sim::diagnose::diagnose;
use host_sim::diagnose::outcome::Verdict;
use host_sim::recording::Recording;
use host_sim::rig::Rig;
use jsonschema::Validator;
use serde_json::{Value, json};

fn schema() -> Value {
    serde_json::from_str(include_str!("../../docs/diagnosis.schema.json")).unwrap()
}

fn validator() -> Validator {
    jsonschema::validator_for(&schema()).unwrap()
}

fn outcome(recipe: &Recipe, verdict: Verdict) -> Value {
    let trial = draw(3, recipe);
    let recording = Recording::parse("recording.csv", trial.csv.as_bytes(), &[]).unwrap();
    let rig = Rig::parse("rig.toml", &trial.rig_toml).unwrap();
    let outcome = diagnose(&[recording], &rig, &|_| ()).unwrap().outcome;
    assert_eq!(outcome.verdict, verdict, "{outcome:?}");
    serde_json::to_value(&outcome).unwrap()
}

#[test]
fn results_of_every_kind_keep_to_it() {
    let validator = validator();
    let cogging = Recipe::of(&[Effect::Cogging]).on_real_rig();
    for (recipe, verdict) in [
        (Recipe::of(&[]), Verdict::Sufficient),
        (cogging.clone(), Verdict::Explained),
        (Recipe { channels: Channels::VoltageSpeed, ..cogging }, Verdict::Explained),
        (Recipe::of(&[Effect::OutsideShaker]), Verdict::Unexplained),
    ] {
        let outcome = outcome(&recipe, verdict);
        let errors: Vec<String> =
            validator.iter_errors(&outcome).map(|error| format!("{}: {error}", error.instance_path())).collect();
        assert!(errors.is_empty(), "{errors:?}\n{outcome:#}");
    }
}

#[test]
fn it_refuses_what_is_wrong() {
    let validator = validator();
    let right = outcome(&Recipe::of(&[Effect::VoltageDrop]), Verdict::Explained);
    assert!(validator.is_valid(&right));
    let wrong = |pointer: &str, value: Value| {
        let mut wrong = right.clone();
        *wrong.pointer_mut(pointer).unwrap() = value;
        assert!(!validator.is_valid(&wrong), "{pointer}");
    };
    wrong("/verdict", json!("perfect"));
    wrong("/causes/0/effect", json!("ghost"));
    wrong("/causes/0/confidence", json!(1.5));
    wrong("/causes/0/parameters/drop_V/ci95", json!([1.0]));
    wrong("/fit/base", json!(7));
    wrong("/unexplained", json!({ "acts_on": "mind", "depends_on": "time", "share": 1.0 }));
    let mut less = right.clone();
    less.as_object_mut().unwrap().remove("advice");
    assert!(!validator.is_valid(&less));
}

#[test]
fn its_effects_are_those_of_the_catalogue() {
    let known: Vec<&str> = CATALOGUE.iter().map(|effect| effect.about().id).collect();
    let schema = schema();
    let listed = schema.pointer("/$defs/effect/enum").unwrap().as_array().unwrap();
    assert_eq!(listed.len(), known.len());
    assert!(listed.iter().all(|id| known.contains(&id.as_str().unwrap())), "{listed:?}");
}

//! Effects outside the catalogue get no name. What the rig has besides is named where it is sure.

use crate::benches::{assert_found, assert_is_named, shaken, shaken_rig};
use crate::scoring::{diagnosed, named};
use hidden_effects::{Effect, Recipe, draw};
use motorbench_diagnosis::diagnose::Diagnosis;
use motorbench_diagnosis::diagnose::outcome::{Cause, Verdict};
use motorbench_model::catalogue::ActsOn;

#[test]
fn an_effect_outside_the_catalogue_gets_no_name() {
    assert_has_no_name(Effect::OutsideShaker, &shaken().diagnosis);
}

#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn no_effect_outside_the_catalogue_gets_a_name() {
    for (seed, effect) in (2000..).zip(Effect::OUTSIDE) {
        assert_has_no_name(effect, &diagnosed(&draw(seed, &Recipe::of(&[effect]))));
    }
}

fn assert_has_no_name(effect: Effect, diagnosis: &Diagnosis) {
    let outcome = &diagnosis.outcome;
    assert_eq!(named(outcome, &[]), [""; 0], "{}", effect.id());
    assert_eq!(outcome.verdict, Verdict::Unexplained, "{}", effect.id());
    let acts_on = outcome.unexplained.as_ref().map(|rest| rest.acts_on);
    assert!(acts_on.is_some_and(|place| places(effect).contains(&place)), "{}: {acts_on:?}", effect.id());
}

/// Where a cause outside the catalogue acts.
fn places(effect: Effect) -> &'static [ActsOn] {
    match effect {
        Effect::OutsideDropouts => &[ActsOn::Voltage],
        // The torque constant is that of the back-EMF as well.
        Effect::OutsideSaturation => &[ActsOn::Torque, ActsOn::Voltage],
        Effect::OutsideDrift | Effect::OutsideDeadBand => &[ActsOn::AngleSensor],
        _ => &[ActsOn::Torque],
    }
}

/// Effects of nearly every bench are trusted beside an unknown effect as well. It biases all constants of the motor,
/// which must not be reported as another scale.
#[test]
fn only_friction_and_drop_are_named_beside_an_unknown_effect() {
    let bench = shaken_rig();
    assert_is_named(&bench.diagnosis, &bench.trial, "a rig that is shaken");
    assert_eq!(bench.diagnosis.outcome.verdict, Verdict::PartlyExplained);
    assert_no_scale_is_named(&bench.diagnosis, "a rig that is shaken");
}

/// The same beside other unknown effects.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn friction_and_drop_are_named_beside_each_unknown_effect() {
    for (seed, effect) in [(1, Effect::OutsideDrift), (2, Effect::OutsideShaker), (3, Effect::OutsideSaturation)] {
        let diagnosis = assert_found(seed, &Recipe::of(&[effect]).on_real_rig());
        assert_eq!(diagnosis.outcome.verdict, Verdict::PartlyExplained, "seed {seed}");
    }
}

#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn no_scale_is_named_beside_an_unknown_effect() {
    for (seed, effect) in [(18, Effect::OutsideDeadBand), (19, Effect::OutsideSpindle)] {
        let recipe = Recipe::of(&[effect]).on_real_rig().with_random_strengths(seed);
        assert_no_scale_is_named(&diagnosed(&draw(seed, &recipe)), &format!("seed {seed}"));
    }
}

fn assert_no_scale_is_named(diagnosis: &Diagnosis, bench: &str) {
    let causes = &diagnosis.outcome.causes;
    assert_eq!(causes.iter().filter(|cause| cause.is_value()).count(), 0, "{bench}: {causes:?}");
}

/// A spring that is wound up within a few turns is no load that comes and goes, although it looks like one over time.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn beside_an_unknown_torque_no_load_step_is_named() {
    for seed in [1, 10, 14] {
        let recipe = Recipe::of(&[Effect::OutsideSpring]).on_real_rig().with_random_strengths(seed);
        let outcome = diagnosed(&draw(seed, &recipe)).outcome;
        let of_rig = |cause: &Cause| ["coulomb_friction", "voltage_drop"].contains(&&*cause.effect);
        assert!(outcome.causes.iter().all(of_rig), "seed {seed}: {:?}", outcome.causes);
        assert!(outcome.unexplained.is_some(), "seed {seed}");
    }
}

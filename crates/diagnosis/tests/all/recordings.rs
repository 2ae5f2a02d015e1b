//! What a program, a sensor or a rig file makes of a recording: times, scales, means, commands that are not recorded.

use crate::benches::{assert_found, assert_is_named, in_the_suite, in_turn, short, with_cells};
use crate::fresh_seed;
use crate::scoring::{diagnosed, hidden, named, recipe};
use hidden_effects::{Channels, Effect, Excitation, Motor, Recipe, Trial, draw};
use motorbench_data::recording::Recording;
use motorbench_data::rig::{NominalMotor, Rig};
use motorbench_diagnosis::diagnose::outcome::Verdict;
use motorbench_diagnosis::diagnose::{Diagnosis, diagnose};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// The causes of a clean bench, recorded as duty, counts and current. The rig file has the true values, changed by
/// `falsify`.
fn causes_with(falsify: impl Fn(&mut Rig)) -> Vec<String> {
    let trial = draw(11, &short(Recipe { channels: Channels::DutyCountsCurrent, ..Recipe::of(&[]) }));
    let mut rig = Rig::parse("rig.toml", &trial.rig_toml).unwrap();
    let motor = trial.truth.motor;
    rig.motor = NominalMotor {
        resistance_ohm: Some(motor.resistance_ohm),
        inductance_h: Some(motor.inductance_h),
        torque_constant_nm_per_a: Some(motor.torque_constant_nm_per_a),
        inertia_kg_m2: Some(motor.inertia_kg_m2),
        viscous_friction_nm_s: Some(motor.viscous_friction_nm_s),
    };
    falsify(&mut rig);
    let recording = Recording::parse("recording.csv", trial.csv.as_bytes(), &[]).unwrap();
    let causes = diagnose(&[recording], &rig, &|_| ()).unwrap().outcome.causes;
    causes.into_iter().map(|cause| cause.effect).collect()
}

#[test]
fn a_wrong_value_is_a_cause() {
    type Falsify = fn(&mut Rig);
    let wrong: [(Falsify, &str); 4] = [
        (|rig| *rig.motor.torque_constant_nm_per_a.as_mut().unwrap() *= 0.7, "parameter:torque_constant"),
        (|rig| *rig.supply.voltage_v.as_mut().unwrap() *= 1.33, "parameter:supply_voltage"),
        (|rig| *rig.motor.inertia_kg_m2.as_mut().unwrap() *= 1.5, "parameter:inertia"),
        (|rig| *rig.encoder.counts_per_rev.as_mut().unwrap() *= 4.0, "parameter:counts_per_rev"),
    ];
    assert_eq!(causes_with(|_| ()), [""; 0]);
    for (falsify, named) in in_turn(fresh_seed(), 2, wrong.into_iter()) {
        assert_eq!(causes_with(falsify), [named]);
    }
}

/// A wrong scale beside the effects of the motor, with nominal values off by a fifth: half of the edges, another
/// supply, milliamperes. The constants must be those of the motor.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn a_recording_may_be_in_another_scale() {
    for seed in in_the_suite([1, 3, 8, 12]) {
        assert_found(seed, &recipe("scale", seed));
    }
}

/// The rig file does not give the frequency: in a closed loop cogging made any frequency look likely.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn a_frequency_of_the_pwm_is_not_taken_from_what_is_missing() {
    let trial = draw(71001, &recipe("closed-loop", 71001));
    let without: Vec<&str> = trial.rig_toml.lines().filter(|line| !line.starts_with("pwm_Hz")).collect();
    let rig = Rig::parse("rig.toml", &without.join("\n")).unwrap();
    let recording = Recording::parse("recording.csv", trial.csv.as_bytes(), &[]).unwrap();
    let outcome = diagnose(&[recording], &rig, &|_| ()).unwrap().outcome;
    let of_pwm: Vec<&String> = outcome.advice.iter().filter(|advice| advice.contains("A PWM of")).collect();
    assert_eq!(of_pwm, [""; 0]);
    assert_eq!(named(&outcome, &hidden(&trial)), hidden(&trial));
}

/// A current sensor with a capacitor of its own: its noise is correlated from row to row. What is left is noise as before.
#[test]
fn noise_behind_a_low_pass_is_no_cause() {
    let seed = fresh_seed();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let filter_s: f64 = random.random_range(0.5e-3..2e-3);
    let mut trial = draw(seed, &short(Recipe::of(&[]).on_real_rig()));
    let mut left: f64 = 0.0;
    trial.csv = with_cells(&trial.csv, "i_A", |_, current_a| {
        // The 21 mA of an ACS712, more or less.
        let share = (-1e-3 / filter_s).exp();
        left = share * left + (1.0 - share * share).sqrt() * 0.025 * 12.0_f64.sqrt() * random.random_range(-0.5..0.5);
        format!("{:.5}", current_a.parse::<f64>().unwrap() + left)
    });
    let case = format!("seed {seed}, {filter_s} s");
    let found = diagnosed(&trial);
    assert_is_named(&found, &trial, &case);
    assert_eq!(found.outcome.verdict, Verdict::Explained, "{case}: {:?}", found.outcome.unexplained);
}

/// Wires of a sensor beside the mains.
#[test]
fn a_hum_of_the_mains_is_taken_out_and_told() {
    let seed = fresh_seed();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let hz = if random.random() { 50.0 } else { 60.0 } * random.random_range(0.998..1.002);
    let (amplitude_a, begin) = (random.random_range(0.02..0.06), random.random_range(0.0..TAU));
    let mut trial = draw(seed, &short(Recipe::of(&[]).on_real_rig()));
    trial.csv = with_cells(&trial.csv, "i_A", |row, current_a| {
        let hum_a = amplitude_a * (TAU * hz * row as f64 * 1e-3 + begin).cos();
        format!("{:.5}", current_a.parse::<f64>().unwrap() + hum_a)
    });
    let case = format!("seed {seed}, {amplitude_a} A at {hz} Hz");
    let found = diagnosed(&trial);
    assert_is_named(&found, &trial, &case);
    assert_eq!(found.outcome.verdict, Verdict::Explained, "{case}: {:?}", found.outcome.unexplained);
    let note = found.outcome.advice.iter().find(|note| note.contains("i_A has a hum of"));
    let note = note.unwrap_or_else(|| panic!("{case}: {:?}", found.outcome.advice));
    let told: Vec<f64> = note.split(' ').filter_map(|word| word.parse().ok()).collect();
    assert!((told[0] - hz).abs() < 0.05 && (told[1] / amplitude_a - 1.0).abs() < 0.1, "{case}: {note}");
}

/// Rows 10 ms apart, in which the shaft passes several magnets.
#[test]
fn rows_may_be_far_apart() {
    for (kind, seed) in in_the_suite([("slowest", 30), ("slowest", 45), ("slow", 26)]) {
        let diagnosis = assert_found(seed, &recipe(kind, seed));
        assert!(!diagnosis.data.has_moments(), "{kind} {seed}: each row has its command");
    }
}

/// The same bench, recorded by a program that writes a row when its command has acted.
#[test]
fn rows_may_be_written_before_or_after_the_command_acts() {
    for (seed, effect) in
        in_the_suite([(3001, Effect::Cogging), (3002, Effect::ActuationDelay), (3003, Effect::CurrentLag)])
    {
        for written_after in [false, true] {
            let diagnosis = assert_found(seed, &short(Recipe { written_after, ..Recipe::of(&[effect]) }));
            assert_eq!(
                diagnosis.data.origin.written_after,
                written_after && effect != Effect::ActuationDelay,
                "{}",
                effect.id()
            );
        }
    }
}

/// Readings as simple programs compute them. A speed is a difference of counts or timed by edges. A current is the mean
/// of a burst, and the rig file does not give the PWM.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn readings_of_simple_programs_are_diagnosed() {
    let of_counts = [("window", 2), ("window", 16), ("edges", 1), ("edges", 13), ("edges", 15), ("edges", 18)];
    for (kind, seed) in
        in_the_suite(of_counts).chain(in_the_suite([("timer", 3)])).chain(in_the_suite([("burst", 1), ("burst", 2)]))
    {
        assert_found(seed, &recipe(kind, seed));
    }
}

/// A loop that runs each millisecond and writes a row every five or ten: the commands in between are not recorded.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn commands_may_change_between_rows() {
    for seed in in_the_suite([1, 5, 8]) {
        let diagnosis = assert_found(seed, &recipe("fewer", seed));
        assert!(diagnosis.data.has_moments(), "seed {seed}");
    }
}

/// Ten milliseconds from row to row, or five: a mean over that is late by more than the current is.
#[test]
fn a_speed_may_be_a_mean_since_the_row_before() {
    for (seed, rate_hz, has_encoder) in
        in_the_suite([(21, 200.0, true), (22, 200.0, false), (23, 100.0, true), (24, 100.0, false)])
    {
        let trial = draw(seed, &Recipe { rate_hz, ..Recipe::of(&[Effect::QuadraticDrag]).on_real_rig() });
        let rig = Rig::parse("rig.toml", &trial.rig_toml).unwrap();
        let rad_per_s = TAU / rig.encoder.counts_per_rev.unwrap() * rate_hz;
        let mut last = 0.0;
        let mut csv = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for line in trial.csv.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let counts: f64 = cells[3].parse().unwrap();
            let speed = rad_per_s * (counts - std::mem::replace(&mut last, counts));
            csv += &format!("{},{},{speed:.4},{}\n", cells[0], cells[2], cells[5]);
        }
        let silent = trial.rig_toml.replace("[encoder]", "[encoder_that_nobody_asks]");
        let rig_toml = if has_encoder { trial.rig_toml.clone() } else { silent };
        let diagnosis = diagnosed(&Trial { csv, rig_toml, ..trial.clone() });
        assert_is_named(&diagnosis, &trial, &format!("seed {seed}"));
    }
}

/// Plus and minus one voltage: a drop is not named, and the intervals contain its uncertainty.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn a_drop_is_not_named_with_one_magnitude() {
    for seed in in_the_suite([1, 8, 20]) {
        let recipe = recipe("binary", seed);
        let Diagnosis { outcome, model, .. } = assert_found(seed, &recipe);
        assert!(
            outcome.advice.iter().any(|text| text.starts_with("The command has only one magnitude")),
            "seed {seed}"
        );
        assert!(model.has("voltage_drop"), "seed {seed}: the model is of the voltage asked for");
        let [lowest, highest] = outcome.parameters["resistance_ohm"].ci95;
        let truth = draw(seed, &recipe).truth.motor.resistance_ohm;
        assert!((lowest..highest).contains(&truth), "seed {seed}: {truth} is not in {lowest}..{highest}");
    }
}

/// Other levels with the rotor held show the drop and the winding's resistance.
#[test]
fn a_held_rotor_shows_the_drop_that_one_magnitude_hides() {
    for seed in in_the_suite([1, 8]) {
        let recipe = Recipe {
            excitation: Excitation::Prbs,
            channels: Channels::VoltageSpeedCurrent,
            ..Recipe::of(&[]).on_real_rig()
        };
        let Trial { csv, rig_toml, truth } = draw(seed, &recipe);
        let constants = truth.effects.iter().flat_map(|(_, constants)| constants);
        let (_, drop_v) = constants.into_iter().find(|(name, _)| *name == "drop_V").unwrap();
        let recording = |name: &str, csv: &str| Recording::parse(name, csv.as_bytes(), &[]).unwrap();
        let recordings = [recording("free.csv", &csv), recording("held.csv", &held(&truth.motor, *drop_v))];
        let rig = Rig::parse("rig.toml", &rig_toml).unwrap();
        let Diagnosis { outcome, data, .. } = diagnose(&recordings, &rig, &|_| ()).unwrap();
        assert_eq!(data.origin.held_rotor.len(), 1, "seed {seed}");
        let mut causes: Vec<&str> = outcome.causes.iter().map(|cause| &*cause.effect).collect();
        causes.sort_unstable();
        assert_eq!(causes, ["coulomb_friction", "voltage_drop"], "seed {seed}");
        let found_v = outcome.causes.iter().find_map(|cause| cause.parameters.get("drop_V")).unwrap().value;
        assert!((found_v - drop_v).abs() < 0.05 * drop_v, "seed {seed}: {found_v} instead of {drop_v}");
        let found_ohm = outcome.parameters["resistance_ohm"].value;
        let off = found_ohm / truth.motor.resistance_ohm - 1.0;
        assert!(off.abs() < 0.01, "seed {seed}: {found_ohm}, off by {off}");
    }
}

/// Levels of half a second through a winding behind a drop, as `t_s, u_V, omega_rad_per_s, i_A`.
fn held(motor: &Motor, drop_v: f64) -> String {
    let mut csv = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut current_a: f64 = 0.0;
    for row in 0..8000 {
        let volts = (3.0 * drop_v).min(6.0) * (f64::from(row / 100) * 2.3).sin();
        let [speed, read_a] = [0.0, current_a].map(|about| about + random.random_range(-0.02..0.02));
        let _ = writeln!(csv, "{},{volts},{},{read_a}", f64::from(row) * 1e-3, speed);
        for _ in 0..50 {
            let free = current_a + 2e-5 / motor.inductance_h * (volts - motor.resistance_ohm * current_a);
            let dry = 2e-5 / motor.inductance_h * drop_v;
            current_a = free.signum() * (free.abs() - dry).max(0.0);
        }
    }
    csv
}

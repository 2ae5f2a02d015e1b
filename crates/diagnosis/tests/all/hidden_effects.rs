//! The diagnosis finds the hidden effect, and no other.
//!
//! The benches come from the crate `hidden-effects`, which is independent of the models here. The diagnosis gets only
//! the texts of recording and rig file. Committed seeds must all be right.

use crate::benches::{assert_found, assert_is_named, clean, in_the_suite, in_turn, short};
use crate::fresh_seed;
use crate::scoring::{diagnosed, hidden, named, recipe};
use hidden_effects::{Channels, Effect, Recipe, draw};
use motorbench_data::recording::Recording;
use motorbench_data::rig::{NominalMotor, Rig};
use motorbench_diagnosis::dataset::{Dataset, Output};
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::diagnose::outcome::Verdict;
use motorbench_diagnosis::free_run::{Steps, drive, read};
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_model::motor::MotorParameters;
use std::fmt::Write as _;

#[test]
fn a_clean_bench_is_sufficiently_explained_by_the_linear_motor() {
    assert_is_named(&clean().diagnosis, &clean().trial, "clean");
    assert_eq!(clean().diagnosis.outcome.verdict, Verdict::Sufficient);
}

#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn clean_benches_are_sufficiently_explained_by_the_linear_motor() {
    for seed in [2, 3] {
        let diagnosis = assert_found(seed, &Recipe::of(&[]));
        assert_eq!(diagnosis.outcome.verdict, Verdict::Sufficient, "seed {seed}");
    }
}

/// With a jump every now and then, late readings come closer to any model, as to one without the torque that acts.
#[test]
fn a_constant_torque_is_no_lateness_of_the_readings() {
    let seed = 51039;
    let diagnosis = assert_found(seed, &recipe("real", seed));
    assert!(diagnosis.data.origin.late_readings.is_none());
}

/// Effects with a test of their own are left out.
#[test]
fn every_effect_is_found_alone() {
    for (seed, effect) in in_turn(fresh_seed(), 3, (1000..).zip(Effect::CATALOGUE)) {
        assert_found(seed, &short(Recipe::of(&[effect])));
    }
    assert_found(1, &short(Recipe::of(&[Effect::SpeedLag]).on_real_rig()));
}

#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn every_effect_is_found_alone_in_a_long_recording() {
    for (seed, effect) in (1000..).zip(Effect::CATALOGUE) {
        assert_found(seed, &Recipe::of(&[effect]));
    }
}

/// Rows in step with the PWM see its ripple as a current that depends on the duty alone. What the linear motor lacks looks
/// like one, in currents that have none.
#[test]
fn what_the_linear_motor_lacks_is_no_ripple_of_the_pwm() {
    for (seed, effect) in in_the_suite([(51012, Effect::CurrentOffset), (51021, Effect::QuadraticDrag)]) {
        let recipe = recipe("single", seed);
        assert_eq!(recipe.effects[0].0, effect);
        assert_eq!(assert_found(seed, &recipe).data.origin.pwm_phase, None, "seed {seed}");
    }
}

/// The same torque, friction or offset would fit one speed, not all of them.
#[test]
fn a_bridge_may_give_less_one_way() {
    for (seed, channels) in
        in_the_suite([(1, Channels::Full), (2, Channels::VoltageSpeed), (3, Channels::DutyCountsCurrent)])
    {
        let recipe = short(Recipe { channels, ..Recipe::of(&[Effect::BridgeAsymmetry]).on_real_rig() });
        let outcome = assert_found(seed, &recipe.with_random_strengths(seed)).outcome;
        let cause = outcome.causes.iter().find(|cause| cause.effect == "bridge_asymmetry").expect("it is named");
        let [low, high] = cause.parameters["backward_share"].ci95.expect("an interval");
        assert!(low * high > 0.0, "seed {seed}: {cause:?}");
    }
}

/// The loss of such a bridge grows with the command, while a drop is the same at any duty.
#[test]
fn a_drop_may_differ_between_directions() {
    for (seed, channels) in
        in_the_suite([(1, Channels::Full), (2, Channels::VoltageSpeedCurrent), (3, Channels::DutyCountsCurrent)])
    {
        let recipe = short(Recipe { channels, ..Recipe::of(&[Effect::DropAsymmetry]).on_real_rig() });
        let outcome = assert_found(seed, &recipe.with_random_strengths(seed)).outcome;
        let cause = outcome.causes.iter().find(|cause| cause.effect == "drop_asymmetry").expect("it is named");
        assert_eq!(cause.not_separable_from, [""; 0], "seed {seed}");
    }
}

/// A load behind a gap or a spring also turns at the start of a recording that begins in motion.
#[test]
fn a_recording_may_begin_in_motion() {
    for (seed, effect) in in_the_suite([(1, Effect::ShaftCompliance), (2, Effect::Backlash)]) {
        let mut trial = draw(seed, &short(Recipe::of(&[effect]).on_real_rig()));
        let rows: Vec<&str> = trial.csv.lines().collect();
        let turns =
            |row: &&str| row.split(',').nth(4).is_some_and(|speed| speed.parse::<f64>().is_ok_and(|w| w > 60.0));
        let begin = rows.iter().position(turns).expect("it turns");
        trial.csv = [&rows[..1], &rows[begin..]].concat().join("\n");
        assert_is_named(&diagnosed(&trial), &trial, &format!("seed {seed}"));
    }
}

/// A sagging supply takes voltage at large duties, this effect at high speeds; steady points alone could not separate
/// them.
#[test]
fn a_resistance_may_grow_with_the_speed() {
    for (seed, channels) in
        in_the_suite([(1, Channels::Full), (2, Channels::VoltageSpeed), (3, Channels::DutyCountsCurrent)])
    {
        let recipe = short(Recipe { channels, ..Recipe::of(&[Effect::ResistanceGrowingWithSpeed]).on_real_rig() });
        let outcome = assert_found(seed, &recipe.with_random_strengths(seed)).outcome;
        let cause =
            outcome.causes.iter().find(|cause| cause.effect == "resistance_growing_with_speed").expect("it is named");
        assert_eq!(cause.not_separable_from, [""; 0], "seed {seed}");
    }
}

/// The current shows the ripple in proportion to the speed, where cogging shows it most when slow.
#[test]
fn a_torque_constant_may_vary_over_the_angle() {
    for (seed, channels) in in_the_suite([(1, Channels::Full), (2, Channels::Full), (3, Channels::DutyCountsCurrent)]) {
        let recipe = Recipe { channels, ..Recipe::of(&[Effect::CommutationRipple]).on_real_rig() };
        let recipe = recipe.with_random_strengths(seed);
        let outcome = assert_found(seed, &recipe).outcome;
        let cause = outcome.causes.iter().find(|cause| cause.effect == "commutation_ripple").expect("it is named");
        assert_eq!(cause.not_separable_from, [""; 0], "seed {seed}");
        let truth = draw(seed, &recipe).truth;
        let (_, constants) = truth.effects.iter().find(|(id, _)| *id == Effect::CommutationRipple).expect("hidden");
        for (name, hidden) in constants {
            let found = cause.parameters[*name].value;
            assert!((found / hidden - 1.0).abs() < 0.1, "seed {seed}: {name} is {found} for {hidden}");
        }
    }
}

/// A wave on a rig with friction and drop, far below what matters to most: as a rule it lowers the error by a few percent.
fn of_a_small_wave(effect: Effect, strength: f64) -> Recipe {
    let mut recipe = short(Recipe::of(&[effect]).on_real_rig());
    recipe.effects[0].1 = strength;
    recipe
}

#[test]
fn a_small_wave_is_found_by_its_number() {
    let benches = [(109, Effect::CommutationRipple, 0.0), (107, Effect::Cogging, -0.4), (102, Effect::Cogging, -0.4)];
    for (seed, effect, strength) in in_the_suite(benches) {
        assert_found(seed, &of_a_small_wave(effect, strength));
    }
}

/// It may be too small to be found. No other wave takes its place.
#[test]
fn a_small_wave_has_no_other_number() {
    let seed = fresh_seed();
    let effect = [Effect::CommutationRipple, Effect::Cogging][(seed % 2) as usize];
    let trial = draw(seed, &of_a_small_wave(effect, -0.1 * (seed % 8) as f64));
    let outcome = diagnosed(&trial).outcome;
    let hidden = hidden(&trial);
    let is_hidden = |name: &String| hidden.contains(&name.as_str());
    assert!(named(&outcome, &hidden).iter().all(is_hidden), "seed {seed}: {outcome:?}");
    let (_, constants) = trial.truth.effects.iter().find(|(id, _)| *id == effect).expect("it is hidden");
    let (name, number) = constants.iter().find(|(name, _)| name.ends_with("per_rev")).expect("it has a number");
    if let Some(cause) = outcome.causes.iter().find(|cause| cause.effect == effect.id()) {
        assert_eq!(cause.parameters[*name].value, *number, "seed {seed}: {outcome:?}");
    }
}

/// The responses come earlier and earlier, or later and later. A winding that heats up, and friction that warms up,
/// change them over time as well.
#[test]
fn two_clocks_may_run_unequally_fast() {
    for seed in in_the_suite([1, 2, 3, 4]) {
        let recipe = Recipe::of(&[Effect::ClockDrift]).on_real_rig().with_random_strengths(seed);
        let outcome = assert_found(seed, &recipe).outcome;
        let cause = outcome.causes.iter().find(|cause| cause.effect == "clock_drift").expect("it is named");
        let truth = draw(seed, &recipe).truth;
        let (_, constants) = truth.effects.iter().find(|(id, _)| *id == Effect::ClockDrift).expect("hidden");
        let found = cause.parameters["drift_ppm"].value;
        assert!((found / constants[0].1 - 1.0).abs() < 0.05, "seed {seed}: {found} for {constants:?}");
    }
}

/// The load begins in held-out data, which no fit sees; a gap must not absorb a step at a wrong time.
#[test]
fn a_load_may_begin_in_the_held_out_data() {
    let diagnosis = assert_found(3019, &recipe("load_step", 3019));
    let [reached, floor] = ["extended", "noise_floor"].map(|fit| diagnosis.outcome.fit[fit]["omega_rad_per_s"].rmse);
    assert!(reached < 1.1 * floor, "{reached} {floor}");
}

/// Behind a bridge that coasts, a wave of any period number can hold the shaft at standstill; only the right one leaves
/// no rest.
#[test]
fn a_wave_is_found_behind_a_coasting_bridge() {
    assert_found(9007, &recipe("pairs", 9007));
}

/// An early load resembles both a friction that warms up and one that differs between directions.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn two_frictions_are_no_load_that_comes() {
    assert_found(31139, &recipe("triples", 31139));
}

/// A wave over the angle is visible only if each stop of the counter is known, and the angle that was turned meanwhile.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn counter_stops_are_found_beside_a_wave() {
    assert_found(41055, &recipe("pairs", 41055));
}

/// With an offset of the current, a drop that differs between directions resembles such a friction. It also needs a
/// drop.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn a_drop_difference_is_told_from_a_friction_difference() {
    assert_found(41016, &recipe("pairs", 41016));
}

/// Nine milliseconds, with the speed alone: a lag would round the response.
#[test]
fn a_delay_is_no_lag_of_the_speed() {
    for seed in in_the_suite([1, 2, 3]) {
        let recipe = Recipe { channels: Channels::VoltageSpeed, ..Recipe::of(&[]).on_real_rig() };
        assert_found(seed, &short(Recipe { effects: vec![(Effect::ActuationDelay, 0.85)], ..recipe }));
    }
}

#[test]
fn constants_are_found_to_a_few_percent() {
    let trial = draw(5, &Recipe::of(&[]).on_real_rig());
    let diagnosis = diagnosed(&trial);
    for (effect, constants) in &trial.truth.effects {
        let cause = diagnosis.outcome.causes.iter().find(|cause| cause.effect == effect.id()).unwrap();
        for (name, truth) in constants {
            let found = cause.parameters[*name].value;
            assert!((found / truth - 1.0).abs() < 0.03, "{name}: {found} instead of {truth}");
        }
    }
    let found = diagnosis.outcome.parameters["torque_constant_Nm_per_A"];
    let truth = trial.truth.motor.torque_constant_nm_per_a;
    assert!((found.value / truth - 1.0).abs() < 0.01, "{found:?} instead of {truth}");
    assert!((found.nominal.unwrap() / truth - 1.0).abs() > 0.01, "the nominal value was no help");
}

/// The integral of the speed drifts, so the phase of the ripple is lost; there is no encoder.
#[test]
fn the_tachogenerator_ripple_gives_the_angle() {
    let diagnosis = assert_found(37, &recipe("voltage-speed", 37));
    assert!(diagnosis.data.origin.angle_by_ripple, "{:?}", diagnosis.outcome.advice);
}

/// The generator adds such a friction to a Coulomb friction; here the model itself makes the recording, with rounding
/// as noise.
#[test]
fn friction_may_fall_off_to_nothing() {
    let volts = |time_s: f64| match time_s < 8.0 {
        true => 3.0 * (1.0 - (time_s.rem_euclid(4.0) - 2.0).abs()),
        false => 5.0 * (13.0 * (time_s / 0.4).floor()).sin(),
    };
    let text = |speed_and_current: &dyn Fn(usize) -> [f64; 2]| {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..8000 {
            let (time_s, [speed, current]) = (row as f64 * 2e-3, speed_and_current(row));
            let _ = writeln!(text, "{time_s:.3},{:.3},{speed:.1},{current:.2}", volts(time_s));
        }
        Recording::parse("run.csv", text.as_bytes(), &[]).unwrap()
    };
    let motor = MotorParameters::PIVT6;
    let rig = Rig { motor: NominalMotor::from(motor), ..Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap() };
    // Only its commands are used.
    let undriven = Dataset::new(&[text(&|row| [(row % 200) as f64, (row % 2) as f64])], &rig).unwrap();
    for exponential in in_the_suite([1.0, 0.0]) {
        let stribeck = effect("stribeck_friction").unwrap();
        let model = Model::linear(motor).with(stribeck, vec![0.01, 12.0, exponential]);
        let drive = drive(&model, &undriven, Steps::Fine);
        let prediction = read(&model, &undriven, drive);
        let output = |wanted: Output| undriven.measured.iter().position(|measured| measured.output == wanted).unwrap();
        let (speed, current) = (&prediction[output(Output::Speed)], &prediction[output(Output::Current)]);
        let outcome = diagnose(&[text(&|row| [speed[row], current[row]])], &rig, &|_| ()).unwrap().outcome;
        let causes: Vec<&str> = outcome.causes.iter().map(|cause| &*cause.effect).collect();
        assert_eq!(causes, ["stribeck_friction"], "{exponential}");
        let found = &outcome.causes[0].parameters;
        assert!((found["excess_torque_Nm"].value / 0.01 - 1.0).abs() < 0.05, "{found:?}");
        assert!((found["stribeck_speed_rad_per_s"].value / 12.0 - 1.0).abs() < 0.1, "{found:?}");
        assert_eq!(found.contains_key("exponential"), exponential > 0.0, "{found:?}");
    }
}

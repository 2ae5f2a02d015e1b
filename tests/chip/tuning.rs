//! Tuning without a model, on the real firmware. The motor has friction and breakaway friction, and its bridge loses
//! voltage. Relay and step experiments over the serial line give gains that hold a speed. They refuse where they would
//! measure nothing but friction.

use host_sim::plant::ModelPlant;
use motorbench_chip::{Bench, ChipBoard, Rig, firmware_elf};
use motorbench_core::message::Trip;
use motorbench_core::settings::Settings;
use motorbench_design::relay::{Relay, RelayError, tyreus_luyben};
use motorbench_design::step_tuning::simc;
use motorbench_link::board::Board;
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_model::linear::motor_model;
use motorbench_model::motor::MotorParameters;
use motorbench_stand::on_board::{self, TuningError};

/// A board with the paper's motor: Coulomb friction, half as much again to break away, and 2 V lost in the bridge.
fn board() -> ChipBoard<ModelPlant> {
    let with = |model: Model, id, values| model.with(effect(id).expect("an effect of the catalogue"), values);
    let motor = with(Model::linear(MotorParameters::PIVT6), "coulomb_friction", vec![0.01]);
    let motor = with(motor, "stribeck_friction", vec![0.005, 1.0]);
    let motor = with(motor, "voltage_drop", vec![2.0]);
    let bench = Bench::new(firmware_elf().expect("firmware"), Rig::default(), ModelPlant::new(motor)).expect("bench");
    ChipBoard::start(bench).expect("the firmware starts")
}

/// Sets the gains, goes to 60 rad/s, and returns overshoot in percent and the largest error of the last quarter, by the
/// true speed.
fn hold_60(board: &mut ChipBoard<ModelPlant>, gains: &[(String, f64)]) -> (f64, f64) {
    for (name, value) in gains {
        board.command(&format!("set {name} {value}")).expect("a gain that the firmware takes");
    }
    for line in ["arm", "mode speed", "ref 60"] {
        board.command(line).expect(line);
    }
    let mut speeds = Vec::new();
    for _ in 0..800 {
        let samples = board.samples(1e-3).expect("the chip runs");
        assert!(samples.iter().all(|sample| sample.trip == Trip::None));
        speeds.push(board.bench.now().speed_rad_per_s);
    }
    board.command("disarm").expect("disarm");
    let highest = speeds.iter().copied().fold(0.0, f64::max);
    let last = speeds[600..].iter().map(|speed| (speed - 60.0).abs()).fold(0.0, f64::max);
    (100.0 * (highest / 60.0 - 1.0), last)
}

const RELAY: Relay =
    Relay { reference_rad_per_s: 60.0, bias_v: 7.2, amplitude_v: 1.0, hysteresis_rad_per_s: 0.5, timeout_s: 5.0 };

#[test]
fn a_relay_over_the_console_tunes_the_speed_loop() {
    let (mut board, settings) = (board(), Settings::defaults());
    let found = on_board::relay(&mut board, &settings, &RELAY).unwrap_or_else(|error| panic!("{error}"));
    println!("{found:?}");
    // 60 rad/s take k w + R (b w + c) / k and the drop.
    assert!((found.cycle.bias_v - (4.34 + 0.81 + 2.0)).abs() < 0.2, "{found:?}");
    // The way over the line is a few ticks.
    assert!((1e-3..6e-3).contains(&found.delay_s), "{found:?}");
    let (overshoot_percent, error) = hold_60(&mut board, &tyreus_luyben(&found.cycle));
    println!("relay: overshoot {overshoot_percent:.1} %, at the end off by {error:.2} rad/s");
    assert!(overshoot_percent < 30.0 && error < 0.5, "{overshoot_percent} {error}");
}

#[test]
fn a_cycle_of_friction_is_refused() {
    let (mut board, settings) = (board(), Settings::defaults());
    // About a speed so low that the motor sticks at every turn.
    let relay = Relay { reference_rad_per_s: 3.0, bias_v: 3.0, amplitude_v: 1.5, hysteresis_rad_per_s: 0.2, ..RELAY };
    let error = on_board::relay(&mut board, &settings, &relay).expect_err("friction is no loop");
    println!("{error}");
    assert_eq!(error, TuningError::Relay(RelayError::Standstill));
    assert!(error.to_string().contains("friction causes the cycle"), "{error}");
    // And a relay too weak to move it at all.
    let weak = Relay { bias_v: 1.0, timeout_s: 0.4, ..RELAY };
    let error = on_board::relay(&mut board, &settings, &weak).expect_err("it does not move");
    assert!(error.to_string().contains("raise the relay's amplitude"), "{error}");
}

#[test]
fn a_step_over_the_console_tunes_the_speed_loop() {
    let (mut board, settings) = (board(), Settings::defaults());
    let model = on_board::step(&mut board, &settings, [6.0, 8.0], 0.5).unwrap_or_else(|error| panic!("{error}"));
    println!("{model:?}");
    // From one speed to another friction and drop are constant: the gain is that of the linear motor.
    let gain = motor_model::speed(&MotorParameters::PIVT6).dc_gain();
    assert!((model.gain_rad_per_s_per_v / gain - 1.0).abs() < 0.03, "{model:?} {gain}");
    assert!((0.015..0.03).contains(&model.time_constant_s), "{model:?}");
    let (overshoot_percent, error) = hold_60(&mut board, &simc(&model, 0.01));
    println!("step: overshoot {overshoot_percent:.1} %, at the end off by {error:.2} rad/s");
    assert!(overshoot_percent < 20.0 && error < 0.5, "{overshoot_percent} {error}");

    let error = on_board::step(&mut board, &settings, [1.0, 8.0], 0.3).expect_err("it stands");
    assert_eq!(error, TuningError::Standstill);
}

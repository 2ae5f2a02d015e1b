//! The firmware on the simulated chip, with a motor attached: it holds what it is told to hold.

use crate::common::Uno;
use motorbench_core::message::{State, Trip};

/// How a step was answered: what the firmware reports and what the shaft does must tell the same.
struct Answer {
    rise_s: f64,
    overshoot: f64,
    error: f64,
}

/// Follows a step from `from` to `to` for `duration_s`, by the true value.
fn answer(uno: &mut Uno, from: f64, to: f64, duration_s: f64, value: impl Fn(&mut Uno) -> f64) -> Answer {
    let mut values = Vec::new();
    for _ in 0..(duration_s * 1000.0) as usize {
        uno.run_s(0.001);
        values.push((value(uno) - from) / (to - from));
    }
    let reached = |part: f64| values.iter().position(|&v| v >= part).unwrap_or(values.len()) as f64 * 0.001;
    let tail = &values[values.len() - 200..];
    Answer {
        rise_s: reached(0.9) - reached(0.1),
        overshoot: values.iter().copied().fold(0.0, f64::max) - 1.0,
        error: (tail.iter().sum::<f64>() / tail.len() as f64 - 1.0) * (to - from),
    }
}

#[test]
fn holds_a_speed_from_rest_through_reversal_and_a_load_step() {
    for mode in ["speed", "lqr_speed"] {
        let mut uno = Uno::start();
        uno.order("arm");
        uno.order(&format!("mode {mode}"));
        let mut from = 0.0;
        for target in [60.0, -60.0] {
            uno.order(&format!("ref {target}"));
            let speed = |uno: &mut Uno| uno.bench.now().speed_rad_per_s;
            let step = answer(&mut uno, from, target, 1.5, speed);
            let (sample, truth) = (uno.last(), uno.bench.now());
            println!(
                "{mode}: {from} to {target} rad/s: rise {:.0} ms, overshoot {:.1} %, error {:.2} rad/s; reports {:.2}",
                step.rise_s * 1e3,
                step.overshoot * 100.0,
                step.error,
                sample.speed as f64 / 64.0,
            );
            assert_eq!(sample.trip, Trip::None);
            assert!(step.rise_s < 0.4 && step.overshoot < 0.02 && step.error.abs() < 0.1);
            assert!((truth.speed_rad_per_s - target).abs() < 0.5, "{truth:?}");
            assert!((sample.speed as f64 / 64.0 - truth.speed_rad_per_s).abs() < 0.5);
            from = target;
        }
        uno.bench.set_load_torque_nm(-0.01);
        uno.run_s(1.0);
        assert!((uno.bench.now().speed_rad_per_s + 60.0).abs() < 0.5);
        assert_eq!((uno.decoder.lost, uno.decoder.damaged), (0, 0));
        let ticks: Vec<u32> = uno.samples.iter().map(|sample| sample.tick).collect();
        let gaps: Vec<_> = ticks.windows(2).filter(|pair| pair[1] != pair[0] + 1).collect();
        assert!(gaps.is_empty(), "samples are missing: {gaps:?}");
    }
}

#[test]
fn holds_a_position_from_rest_through_reversal_and_a_load_step() {
    for mode in ["position", "lqr_position"] {
        let mut uno = Uno::start();
        // So fast that it has carried the friction within the two seconds that are looked at.
        uno.order("set lqr_position_ki 30");
        uno.order("arm");
        uno.order(&format!("mode {mode}"));
        let mut from = 0.0;
        for target in [4000.0, -2000.0] {
            uno.order(&format!("ref {}", target / 2000.0 * std::f64::consts::TAU));
            let counts = |uno: &mut Uno| uno.bench.now().encoder_count as f64;
            let step = answer(&mut uno, from, target, 2.0, counts);
            let (sample, truth) = (uno.last(), uno.bench.now());
            println!(
                "{mode}: {from} to {target} counts: rise {:.0} ms, overshoot {:.1} %, error {:.0} counts",
                step.rise_s * 1e3,
                step.overshoot * 100.0,
                step.error
            );
            assert_eq!(sample.trip, Trip::None);
            assert_eq!(sample.counts as i64, truth.encoder_count);
            assert!(step.error.abs() < 30.0, "{}", step.error);
            assert!(step.rise_s < 0.2 && step.overshoot < 0.1);
            from = target;
        }
        uno.bench.set_load_torque_nm(0.01);
        uno.run_s(2.0);
        let error = uno.bench.now().encoder_count as f64 - from;
        println!("{mode}: under a load of 0.01 Nm: error {error:.0} counts");
        assert!(error.abs() < 30.0, "{error}");
    }
}

#[test]
fn nothing_drives_before_it_is_armed() {
    let mut uno = Uno::start();
    uno.refused("mode speed");
    uno.refused("ref 93");
    uno.order("mode off");
    uno.run_s(0.5);
    assert_eq!(uno.last().duty, 0);
    assert!(!uno.last().state.has(State::ARMED));
    assert_eq!(uno.bench.now().speed_rad_per_s, 0.0);
}

#[test]
fn the_emergency_stop_stops() {
    let mut uno = Uno::start();
    for order in ["arm", "mode speed", "ref 47"] {
        uno.order(order);
    }
    uno.run_s(0.5);
    assert!(uno.bench.now().speed_rad_per_s > 30.0);
    uno.bench.press_emergency_stop(true);
    uno.run_s(0.003);
    assert_eq!(uno.last().trip, Trip::EmergencyStop);
    assert!(!uno.last().state.has(State::ENABLED));
    // Released, it stays off until cleared and armed again.
    uno.bench.press_emergency_stop(false);
    uno.run_s(0.5);
    assert_eq!(uno.last().trip, Trip::EmergencyStop);
}

//! Every trip provoked on the chip: it comes, in how many milliseconds, and the bridge is off.

mod common;

use common::Uno;
use host_sim::chip::{EncoderFault, SensorFault, registers};
use host_sim::plant::Bridge;
use motorbench_core::message::{State, Trip};

/// Runs a speed loop, provokes, and expects the trip within the limit; then that the drive is and stays off.
fn provoke(reference_rad_per_s: f64, trip: Trip, limit_ms: u32, provoke: impl FnOnce(&mut Uno)) {
    let mut uno = Uno::start();
    uno.order("t1");
    uno.order("a");
    uno.order("m2");
    uno.order(&format!("r{}", (reference_rad_per_s * 64.0) as i32));
    uno.run_s(0.6);
    assert_eq!(uno.last().trip, Trip::None);
    let before = uno.last().tick;
    provoke(&mut uno);
    uno.run_s(limit_ms as f64 / 1000.0 + 0.2);
    let tripped = uno.samples.iter().find(|sample| sample.trip != Trip::None).expect("a trip");
    assert_eq!(tripped.trip, trip);
    let after = tripped.tick - before;
    println!("{trip:?}: after {after} ms");
    assert!(after <= limit_ms, "{after} ms");
    assert!(!tripped.state.has(State::ARMED) && !tripped.state.has(State::ENABLED) && tripped.duty == 0);
    // It cannot be armed before it is cleared.
    uno.bench.serial().write("a\nm2\n");
    uno.run_s(0.05);
    assert!(!uno.last().state.has(State::ARMED) && uno.last().duty == 0);
}

#[test]
fn a_suddenly_blocked_rotor_trips() {
    provoke(100.0, Trip::OverCurrentPeak, 60, |uno| uno.bench.block_rotor(true));
}

#[test]
fn a_stalled_motor_trips() {
    let mut uno = Uno::start();
    uno.bench.block_rotor(true);
    // 6.5 V less the bridge's drop over 5.84 ohm: 0.67 A, above the continuous rating and below the peak.
    for order in ["t1", "a", "m1", "r6656"] {
        uno.order(order);
    }
    uno.run_s(0.4);
    assert_eq!(uno.last().trip, Trip::None);
    uno.run_s(0.3);
    assert_eq!(uno.last().trip, Trip::Stall);
    assert!(!uno.last().state.has(State::ENABLED));
}

#[test]
fn a_silent_encoder_trips() {
    provoke(100.0, Trip::EncoderSilent, 600, |uno| uno.bench.set_encoder_fault(Some(EncoderFault::Unplugged)));
}

#[test]
fn a_wrong_feedback_sign_trips() {
    provoke(60.0, Trip::Runaway, 800, |uno| uno.bench.set_encoder_fault(Some(EncoderFault::Swapped)));
}

#[test]
fn a_current_sensor_at_either_rail_trips() {
    for rail_v in [0.0, 5.0] {
        provoke(60.0, Trip::SensorRange, 10, |uno| {
            uno.bench.set_current_sensor_fault(Some(SensorFault::PinnedV(rail_v)));
        });
    }
}

#[test]
fn the_emergency_stop_trips() {
    provoke(60.0, Trip::EmergencyStop, 2, |uno| uno.bench.press_emergency_stop(true));
}

#[test]
fn when_the_tick_dies_the_watchdog_stops_the_motor() {
    let mut uno = Uno::start();
    for order in ["t1", "a", "m2", "r3840"] {
        uno.order(order);
    }
    uno.run_s(0.5);
    assert!(uno.bench.now().duty > 0.1);
    // Nothing interrupts any more to compute the drive, and nothing feeds the watchdog.
    uno.bench.chip_mut().write(registers::TIMSK0, 0);
    let stopped = (0..200).find(|_| {
        uno.run_s(0.001);
        uno.bench.now().bridge == Bridge::Coast
    });
    println!("tick dead: bridge off after {stopped:?} ms");
    assert!(stopped.is_some_and(|ms| ms <= 80), "{stopped:?}");
    // The chip has started again, disarmed, and answers.
    uno.run_s(0.5);
    assert_eq!(uno.bench.now().bridge, Bridge::Coast);
    uno.order("t1");
    uno.run_s(0.01);
    assert!(!uno.last().state.has(State::ARMED) && uno.last().duty == 0);
}

#[test]
fn noise_on_the_encoder_is_counted_and_does_not_stop_the_loop() {
    let mut uno = Uno::start();
    for order in ["t1", "a", "m2", "r3840"] {
        uno.order(order);
    }
    uno.run_s(0.5);
    for _ in 0..20 {
        uno.bench.encoder_illegal_transition(500);
        uno.run_s(0.01);
    }
    uno.run_s(0.5);
    assert_eq!(uno.last().trip, Trip::None);
    assert!((uno.bench.now().speed_rad_per_s - 60.0).abs() < 1.0);
}

#[test]
fn random_bytes_arm_nothing() {
    let mut uno = Uno::start();
    let mut random = 0x1234_5678u32;
    for _ in 0..200 {
        let bytes: Vec<u8> = std::iter::repeat_with(|| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            // A valid order of two bytes comes by chance; none that arms may be among them.
            let byte = (random >> 24) as u8;
            if byte == b'a' { b'b' } else { byte }
        })
        .take(500)
        .collect();
        uno.bench.serial().write(&bytes);
        uno.run_s(0.011);
    }
    uno.run_s(0.1);
    let now = uno.bench.now();
    assert_eq!((now.duty, now.speed_rad_per_s), (0.0, 0.0));
    uno.bench.serial().write("\n");
    uno.run_s(0.05);
    uno.order("t1");
    uno.run_s(0.05);
    assert!(!uno.last().state.has(State::ARMED));
}

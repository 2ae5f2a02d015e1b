//! Every trip provoked on the chip: it comes, in how many milliseconds, and the bridge is off.

use crate::common::Uno;
use host_sim::plant::Bridge;
use motorbench_chip::{EncoderFault, SensorFault, registers};
use motorbench_core::message::{State, Trip};

/// Runs a speed loop, provokes, and expects the trip within the limit; then that the drive is and stays off.
fn provoke(reference_rad_per_s: f64, trip: Trip, limit_ms: u32, provoke: impl FnOnce(&mut Uno)) {
    let mut uno = Uno::start();
    uno.order("arm");
    uno.order("mode speed");
    uno.order(&format!("ref {reference_rad_per_s}"));
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
    uno.refused("arm");
    uno.refused("mode speed");
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
    for order in ["arm", "mode open", "ref 6.5"] {
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
    provoke(100.0, Trip::EncoderSilent, 60, |uno| uno.bench.set_encoder_fault(Some(EncoderFault::Unplugged)));
}

#[test]
fn a_wrong_feedback_sign_trips() {
    provoke(60.0, Trip::Runaway, 60, |uno| uno.bench.set_encoder_fault(Some(EncoderFault::Swapped)));
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

/// Contact to ground; 2 is normally closed, so that a broken wire stops as well.
#[test]
fn an_emergency_stop_that_is_normally_closed_trips_when_it_opens() {
    let mut uno = Uno::start();
    uno.bench.press_emergency_stop(true);
    uno.run_s(0.02);
    assert_eq!(uno.last().trip, Trip::EmergencyStop, "closed, as the default would have it pressed");
    for order in ["set emergency_stop 2", "clear", "arm", "mode speed", "ref 40"] {
        uno.order(order);
    }
    uno.refused("set emergency_stop 1");
    uno.run_s(0.3);
    assert_eq!(uno.last().trip, Trip::None);
    uno.bench.press_emergency_stop(false);
    uno.run_s(0.01);
    assert_eq!((uno.last().trip, uno.last().duty), (Trip::EmergencyStop, 0));
    uno.refused("arm");
    for order in ["set emergency_stop 0", "clear", "arm"] {
        uno.order(order);
    }
}

#[test]
fn a_converter_that_stops_trips_and_does_not_arm() {
    provoke(60.0, Trip::ConverterSilent, 8, |uno| uno.bench.set_converter_dead(true));
    let mut uno = Uno::power_on();
    uno.bench.set_converter_dead(true);
    uno.listen();
    let reply = uno.ask("arm");
    assert!(reply.starts_with("error: trip 13 converter silent, ") && reply.ends_with(" s ago; clear it\n"), "{reply}");
    uno.bench.set_converter_dead(false);
    uno.run_s(0.01);
    uno.order("clear");
    uno.order("arm");
}

/// A sensor that is unplugged shows a current that no bridge drives.
#[test]
fn a_current_with_the_drive_off_is_the_sensors() {
    let mut uno = Uno::start();
    uno.bench.set_current_sensor_fault(Some(SensorFault::PinnedV(1.5)));
    uno.run_s(0.02);
    assert_eq!(uno.last().trip, Trip::SensorRange);
    uno.run_s(2.5);
    let status = uno.ask("status");
    assert!(status.contains("trip 6 current sensor: a rail, or current when off, 2 s ago; clear it"), "{status}");
}

/// What the transmitter keeps nobody hears; what is said to the board it does.
#[test]
fn a_transmitter_that_is_stuck_leaves_the_console_its_ears() {
    let mut uno = Uno::start();
    for order in ["arm", "mode speed", "ref 60"] {
        uno.order(order);
    }
    uno.run_s(0.4);
    uno.bench.set_transmitter_stuck(true);
    uno.run_s(0.3);
    assert!(uno.bench.now().bridge != Bridge::Coast, "it drives on");
    uno.bench.serial().write("status\n");
    uno.run_s(0.05);
    uno.bench.serial().write("disarm\n");
    let off = (0..100).find(|_| {
        uno.run_s(0.001);
        uno.bench.now().bridge == Bridge::Coast
    });
    println!("transmitter stuck: disarmed after {off:?} ms");
    assert!(off.is_some_and(|ms| ms <= 20), "{off:?}");
    // What was lost is counted.
    uno.bench.set_transmitter_stuck(false);
    uno.run_s(0.1);
    assert!(uno.ask("status").contains("unsent bytes 255"), "{}", uno.replies);
}

/// Settings of another version are neither taken nor passed over in silence.
#[test]
fn settings_of_another_version_are_said_and_must_be_answered() {
    const SAID: &str = "# saved settings are of another version: not loaded, defaults in force";
    for answer in ["defaults", "set trip_peak 1", "save"] {
        let mut uno = Uno::power_on();
        let mut image = vec![0xff; 1024];
        image[..300].fill(0x5a);
        uno.bench.chip_mut().set_eeprom(&image);
        uno.bench.run_s(0.4).expect("the chip runs");
        let greeting = String::from_utf8_lossy(&uno.bench.serial().read()).into_owned();
        assert!(greeting.contains(SAID), "{greeting}");
        uno.listen();
        assert!(uno.ask("status").contains(SAID), "{}", uno.replies);
        let refused = uno.ask("arm");
        assert!(refused.starts_with("error: saved settings are of another version"), "{refused}");
        uno.refused("load");
        uno.refused("arm");
        uno.order(answer);
        assert!(!uno.ask("status").contains(SAID), "{}", uno.replies);
        uno.order("arm");
    }
    // A board that is new has nothing to say.
    let mut uno = Uno::power_on();
    uno.bench.run_s(0.4).expect("the chip runs");
    let greeting = String::from_utf8_lossy(&uno.bench.serial().read()).into_owned();
    assert!(!greeting.contains("settings are"), "{greeting}");
}

/// The stack comes to the variables: off, and a new start.
#[test]
fn a_stack_that_overflows_stops_the_motor_and_is_reported() {
    let mut uno = Uno::start();
    for order in ["arm", "mode speed", "ref 60"] {
        uno.order(order);
    }
    uno.run_s(0.4);
    let first_free = uno.bench.program().variable("_end").expect("_end");
    uno.bench.chip_mut().write(first_free, 0);
    uno.run_s(0.006);
    assert_eq!(uno.bench.now().bridge, Bridge::Coast);
    uno.run_s(0.01);
    assert_eq!(uno.last().trip, Trip::StackOverflow);
    uno.listen();
    assert!(uno.ask("version").contains("reset: stack overflow"), "{}", uno.replies);
}

#[test]
fn when_the_tick_dies_the_watchdog_stops_the_motor() {
    let mut uno = Uno::start();
    for order in ["arm", "mode speed", "ref 60"] {
        uno.order(order);
    }
    uno.run_s(0.5);
    assert!(uno.bench.now().duty > 0.1);
    // Nothing interrupts any more to compute the drive, and nothing feeds the watchdog.
    // A tick that is under way would switch its interrupt on again.
    for _ in 0..4 {
        uno.bench.chip_mut().write(registers::TIMSK0, 0);
        uno.run_s(0.0003);
    }
    let stopped = (0..200).find(|_| {
        uno.run_s(0.001);
        uno.bench.now().bridge == Bridge::Coast
    });
    println!("tick dead: bridge off after {stopped:?} ms");
    assert!(stopped.is_some_and(|ms| ms <= 80), "{stopped:?}");
    // The chip has started again, disarmed, and answers.
    uno.listen();
    assert_eq!(uno.bench.now().bridge, Bridge::Coast);
    assert!(uno.ask("version").contains("reset: watchdog"));
    uno.run_s(0.01);
    assert!(!uno.last().state.has(State::ARMED) && uno.last().duty == 0);
}

#[test]
fn noise_on_the_encoder_is_counted_and_does_not_stop_the_loop() {
    let mut uno = Uno::start();
    for order in ["arm", "mode speed", "ref 60"] {
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

/// The rotor held at a voltage that drives a current between the continuous and the peak limit.
#[test]
fn a_lasting_over_current_trips() {
    let mut uno = Uno::start();
    uno.bench.block_rotor(true);
    for order in ["set trip_stall 0 trip_continuous 0.5", "arm", "mode open", "ref 7.5"] {
        uno.order(order);
    }
    let started = uno.last().tick;
    uno.run_s(4.0);
    let tripped = uno.samples.iter().find(|sample| sample.trip != Trip::None).expect("a trip");
    println!("{:?}: after {} ms", tripped.trip, tripped.tick - started);
    assert_eq!(tripped.trip, Trip::OverCurrentThermal);
    assert!((300..3000).contains(&(tripped.tick - started)));
    assert!(!tripped.state.has(State::ENABLED));
}

#[test]
fn a_supply_out_of_range_trips() {
    for supply_v in [4.0, 18.5] {
        let mut uno = Uno::start();
        for order in ["set supply_divider 4 trip_supply_high 16", "arm", "mode speed", "ref 40"] {
            uno.order(order);
        }
        uno.run_s(0.3);
        assert_eq!(uno.last().trip, Trip::None);
        let before = uno.last().tick;
        uno.bench.set_supply_v(supply_v);
        uno.run_s(0.1);
        let tripped = uno.samples.iter().find(|sample| sample.trip != Trip::None).expect("a trip");
        println!("{:?} at {supply_v} V: after {} ms", tripped.trip, tripped.tick - before);
        assert_eq!(tripped.trip, Trip::SupplyRange);
        assert!(tripped.tick - before <= 15 && !tripped.state.has(State::ENABLED));
    }
}

#[test]
fn a_lost_host_trips() {
    let mut uno = Uno::start();
    for order in ["set trip_host 250", "arm", "mode speed", "ref 40"] {
        uno.order(order);
    }
    for _ in 0..5 {
        uno.run_s(0.1);
        uno.order("alive");
    }
    assert_eq!(uno.last().trip, Trip::None);
    let before = uno.last().tick;
    uno.run_s(0.5);
    let tripped = uno.samples.iter().find(|sample| sample.trip != Trip::None).expect("a trip");
    println!("{:?}: after {} ms", tripped.trip, tripped.tick - before);
    assert_eq!(tripped.trip, Trip::HostLost);
    assert!(tripped.tick - before <= 260 && !tripped.state.has(State::ENABLED));
}

/// A listing of the settings takes longer than the host may be silent. What the host says meanwhile counts when it
/// comes. A host that is gone is missed in time.
#[test]
fn a_host_is_heard_and_missed_while_a_reply_is_written() {
    for goes_on in [true, false] {
        let mut uno = Uno::start();
        for order in ["set trip_host 100", "arm", "mode speed", "ref 40"] {
            uno.order(order);
        }
        uno.replies.clear();
        uno.bench.serial().write("show\n");
        let off = (0..160).find(|ms| {
            if goes_on && ms % 50 == 49 {
                uno.bench.serial().write("alive\n");
            }
            uno.run_s(0.001);
            uno.bench.now().bridge == Bridge::Coast
        });
        assert!(!uno.replies.is_empty() && !uno.replies.contains("ok\r\n"), "the reply is still written");
        println!("goes on {goes_on}: off after {off:?} ms");
        if goes_on {
            assert_eq!(off, None);
            continue;
        }
        assert!(off.is_some_and(|ms| (95..=110).contains(&ms)), "{off:?}");
        // The reply comes first, then the samples again.
        uno.run_s(0.4);
        assert_eq!(uno.last().trip, Trip::HostLost);
    }
}

/// Runs a speed loop, then lets the next tick return to `target` instead of the main loop. Returns after how many
/// milliseconds the bridge was off.
fn divert_the_main_loop(uno: &mut Uno, target: u32) -> usize {
    for order in ["arm", "mode speed", "ref 60"] {
        uno.order(order);
    }
    uno.run_s(0.5);
    assert!(uno.bench.now().duty > 0.1);
    divert(uno, target);
    let stopped = (0..300).find(|_| {
        uno.run_s(0.001);
        uno.bench.now().bridge == Bridge::Coast
    });
    stopped.expect("the bridge goes off")
}

/// Lets the next tick return to `target` instead of the main loop.
fn divert(uno: &mut Uno, target: u32) {
    let handler = uno.bench.program().function("__vector_14").expect("the tick");
    let chip = uno.bench.chip_mut();
    assert!(chip.step_until(40_000, |chip| chip.program_counter() == handler).expect("the chip runs"));
    // The return address stands above the stack pointer, high byte first, in words.
    let [high, low] = ((target / 2) as u16).to_be_bytes();
    let stack = chip.stack_pointer();
    chip.write(stack + 1, high);
    chip.write(stack + 2, low);
}

#[test]
fn a_hung_main_loop_stops_the_motor_and_is_reported() {
    let mut uno = Uno::start();
    // Where the start-up code would go after `main`: an endless loop.
    let hang = uno.bench.program().function("__stop_program").expect("the end of the program");
    let stopped = divert_the_main_loop(&mut uno, hang);
    println!("main loop hung: bridge off after {stopped} ms");
    assert!(stopped <= 105);
    uno.listen();
    assert!(uno.ask("version").contains("reset: main loop hung"), "{}", uno.replies);
    assert_eq!(uno.bench.now().bridge, Bridge::Coast);
}

/// The trip that is latched is another, and the one that is looked for first would be, too.
#[test]
fn a_main_loop_that_hangs_while_tripped_is_restarted() {
    for pressed in [true, false] {
        let mut uno = Uno::start();
        let hang = uno.bench.program().function("__stop_program").expect("the end of the program");
        uno.bench.press_emergency_stop(true);
        uno.run_s(0.02);
        assert_eq!(uno.last().trip, Trip::EmergencyStop);
        uno.bench.press_emergency_stop(pressed);
        divert(&mut uno, hang);
        uno.run_s(0.3);
        uno.bench.press_emergency_stop(false);
        uno.listen();
        assert!(uno.ask("version").contains("reset: main loop hung"), "{}", uno.replies);
        uno.ask("clear");
        uno.order("arm");
    }
}

#[test]
fn a_panic_stops_the_motor_and_is_reported() {
    let mut uno = Uno::start();
    let panicked = uno
        .bench
        .program()
        .symbols()
        .find(|(name, _)| name.contains("watchdog") && name.ends_with("panicked"))
        .map(|(_, address)| address as u32)
        .expect("the end of the panic handler");
    let stopped = divert_the_main_loop(&mut uno, panicked);
    println!("panic: bridge off after {stopped} ms");
    assert!(stopped <= 2);
    uno.listen();
    assert!(uno.ask("version").contains("reset: panic"), "{}", uno.replies);
    assert_eq!(uno.bench.now().bridge, Bridge::Coast);
}

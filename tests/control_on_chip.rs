//! The firmware on the simulated chip, with a motor attached: it holds what it is told to hold.

mod common;

use common::Uno;
use motorbench_core::message::{State, Trip};

/// Bits of speed at the default range of 512 rad/s.
fn speed_bits(rad_per_s: f64) -> i32 {
    (rad_per_s * 64.0) as i32
}

#[test]
fn holds_a_speed_from_rest_through_reversal_and_a_load_step() {
    for (mode, name) in [(2, "PID"), (4, "LQR")] {
        let mut uno = Uno::start();
        uno.order("t1");
        uno.order("a");
        uno.order(&format!("m{mode}"));
        for target in [60.0, -60.0] {
            uno.order(&format!("r{}", speed_bits(target)));
            uno.run_s(1.5);
            let (sample, truth) = (uno.last(), uno.bench.now());
            println!(
                "{name}: {target} rad/s: reports {:.2}, turns {:.2}",
                sample.speed as f64 / 64.0,
                truth.speed_rad_per_s
            );
            assert_eq!(sample.trip, Trip::None);
            assert!((truth.speed_rad_per_s - target).abs() < 0.5, "{truth:?}");
            assert!((sample.speed as f64 / 64.0 - truth.speed_rad_per_s).abs() < 0.5);
        }
        uno.bench.set_load_torque_nm(-0.01);
        uno.run_s(1.0);
        assert!((uno.bench.now().speed_rad_per_s + 60.0).abs() < 0.5);
        assert_eq!((uno.decoder.lost, uno.decoder.damaged), (0, 0));
        let ticks: Vec<u32> = uno.samples.iter().map(|sample| sample.tick).collect();
        assert!(ticks.windows(2).all(|pair| pair[1] == pair[0] + 1), "a sample is missing");
    }
}

#[test]
fn holds_a_position() {
    for mode in [3, 5] {
        let mut uno = Uno::start();
        uno.order("t1");
        uno.order("a");
        uno.order(&format!("m{mode}"));
        uno.order("r4000");
        uno.run_s(2.0);
        let (sample, truth) = (uno.last(), uno.bench.now());
        println!("mode {mode}: at {} counts, truly {}", sample.counts, truth.encoder_count);
        assert_eq!(sample.trip, Trip::None);
        assert_eq!(sample.counts as i64, truth.encoder_count);
        assert!((sample.counts - 4000).abs() < 150, "{}", sample.counts);
    }
}

#[test]
fn nothing_drives_before_it_is_armed() {
    let mut uno = Uno::start();
    uno.order("t1");
    uno.order("m2");
    uno.order("r6000");
    uno.run_s(0.5);
    assert_eq!(uno.last().duty, 0);
    assert!(!uno.last().state.has(State::ARMED));
    assert_eq!(uno.bench.now().speed_rad_per_s, 0.0);
}

#[test]
fn the_emergency_stop_stops() {
    let mut uno = Uno::start();
    for order in ["t1", "a", "m2", "r3000"] {
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

#[test]
fn what_the_interrupts_cost() {
    use host_sim::chip::registers::vector;
    let mut uno = Uno::start();
    for order in ["t1", "a", "m2", "r3000"] {
        uno.order(order);
    }
    uno.run_s(0.05);
    uno.bench.chip_mut().measure(None);
    uno.run_s(0.2);
    let chip = uno.bench.chip();
    for (name, number) in [
        ("INT0", vector::INT0),
        ("TIMER0_COMPA", vector::TIMER0_COMPA),
        ("ADC", vector::ADC),
        ("USART_RX", vector::USART_RX),
        ("USART_UDRE", vector::USART_UDRE),
    ] {
        println!("{name}: {:?}", chip.meter().handler_cycles(number));
    }
    println!("jitter {:?}", chip.meter().entry_jitter_cycles(vector::TIMER0_COMPA, 16_000));
    println!("adc {:?}", chip.meter().sample_jitter_cycles(0, 800));
}

/// The wide count must follow an encoder at 100,000 edges/s with the loop and full telemetry running. At 16 MHz that
/// leaves 160 cycles an edge, of which the handler takes 46.
#[test]
fn no_count_is_lost_at_the_fastest_edges() {
    for edges_per_ms in [20, 50, 100] {
        let mut uno = Uno::start();
        uno.order("t1");
        uno.order("a");
        uno.order("m1");
        uno.bench.set_edge_train_per_s(Some(edges_per_ms as f64 * 1000.0));
        uno.run_s(0.05);
        uno.samples.clear();
        uno.run_s(1.0);
        let (first, last) = (uno.samples[0], uno.last());
        let ticks = last.tick - first.tick;
        let missing = ticks as usize + 1 - uno.samples.len();
        println!(
            "{edges_per_ms} edges/ms: {} counts in {ticks} ticks, {missing} samples missing",
            last.counts - first.counts
        );
        // The edges are exactly periodic, and so are the ticks.
        assert!((last.counts - first.counts - ticks as i32 * edges_per_ms).abs() <= 1);
        assert!(ticks > 980 && missing == 0);
        assert_eq!((uno.decoder.lost, uno.decoder.damaged), (0, 0));
    }
}

#[test]
fn the_stack_has_room() {
    let mut uno = Uno::start();
    // Static variables end here; the start-up code has written below.
    let first_free = uno.bench.program().variable("_end").expect("_end");
    uno.bench.chip_mut().paint_stack(first_free);
    for order in ["t1", "a", "m5", "r3000", "m4", "r3000", "p7"] {
        uno.order(order);
        uno.run_s(0.2);
    }
    let free = uno.bench.chip().stack_free_bytes(first_free);
    println!("{} bytes of static RAM, {free} bytes of stack never used", first_free - 0x100);
    assert!(free >= 200, "{free}");
}

/// What a bootloader of 512 bytes leaves of the flash, and the goal for static RAM.
#[test]
fn it_fits_the_uno() {
    let uno = Uno::start();
    let program = uno.bench.program();
    let ram = program.variable("_end").expect("_end") - 0x100;
    println!("{} bytes of flash, {ram} bytes of static RAM", program.flash_bytes());
    assert!(program.flash_bytes() <= 32_256 && ram <= 1024);
}

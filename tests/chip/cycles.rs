//! What the firmware costs on the chip stays within its bounds. A bound is the goal, or what was reached where the goal
//! was not (docs/reference/benchmarks.md). The figures themselves: `cargo bench --features chip --bench firmware`.

use crate::common::{Uno, figures};
use motorbench_board::pins::{CURRENT_SENSE, SUPPLY_SENSE};
use motorbench_chip::Sample;
use motorbench_chip::registers::vector;
use motorbench_core::HARDWARE;
use motorbench_data::rig::Timing;

#[test]
fn controllers() {
    for (name, spread) in figures::controllers() {
        println!("{name}: {spread:?}");
        assert!(spread.max <= if name.starts_with("PID") { 300 } else { 250 }, "{name}");
    }
}

#[test]
fn interrupts_are_short_and_come_on_time() {
    let interrupts = figures::interrupts();
    assert!(interrupts.encoder.max <= 56, "{:?}", interrupts.encoder);
    assert!(interrupts.adc.max <= 120, "{:?}", interrupts.adc);
    assert!(interrupts.transmit.max <= 70, "{:?}", interrupts.transmit);
    assert_eq!(interrupts.sampling_jitter_cycles, 0);
    // The longest of the other handlers.
    assert!(interrupts.tick_jitter_cycles <= 120, "{}", interrupts.tick_jitter_cycles);
}

/// A start from saved settings takes longer than one from the defaults. The last conversion of a round, the supply's,
/// comes before each tick all the same.
#[test]
fn a_round_of_conversions_ends_with_each_tick() {
    for mut uno in started_from_defaults_and_from_saved_settings() {
        uno.bench.chip_mut().measure(None);
        uno.run_s(0.05);
        let meter = uno.bench.chip().meter();
        let before = |cycle| meter.samples().iter().rfind(|sample| sample.cycle < cycle).map(|sample| sample.channel);
        let ticks = meter.handler_runs(vector::TIMER0_COMPA).iter();
        let channels: Vec<u8> = ticks.filter_map(|tick| before(tick.entry_cycle)).collect();
        assert!(channels.len() > 40 && channels.iter().all(|channel| *channel == SUPPLY_SENSE.bit), "{channels:?}");
    }
}

fn started_from_defaults_and_from_saved_settings() -> [Uno; 2] {
    let mut uno = Uno::start();
    uno.order("set cruise_speed 55");
    uno.order("save");
    uno.run_s(2.0);
    let mut from_saved = Uno::power_on();
    from_saved.bench.chip_mut().set_eeprom(&uno.bench.chip().eeprom());
    from_saved.listen();
    [Uno::start(), from_saved]
}

#[test]
fn the_tick_leaves_the_main_loop_its_time() {
    for tick in figures::ticks() {
        println!("{}: {:?}", tick.what, tick.own);
        assert!(tick.own.max <= 3650 && tick.all.max < 4300, "{}: {:?} {:?}", tick.what, tick.own, tick.all);
    }
}

/// The wide count must follow an encoder at 100,000 edges/s with the loop and full telemetry running. At 16 MHz that
/// leaves 160 cycles an edge, of which the handler takes 47.
#[test]
fn no_count_is_lost_at_the_fastest_edges() {
    for edges_per_ms in [20, 50, 100] {
        let edges = figures::edges(edges_per_ms);
        assert!(edges.miscounted.abs() <= 1, "{} at {edges_per_ms} edges/ms", edges.miscounted);
        assert!(edges.ticks > 980 && edges.samples_missing == 0 && edges.frames_damaged == 0);
    }
}

/// What a bootloader of 512 bytes leaves of the flash, and the goal for static RAM.
#[test]
fn it_fits_the_uno() {
    let memory = figures::memory();
    println!(
        "{} bytes of flash, {} of static RAM, {} of stack never used",
        memory.flash, memory.static_ram, memory.stack_free
    );
    assert!(memory.flash <= 32_256 && memory.static_ram <= 1024 && memory.stack_free >= 256);
}

/// What rig files of recordings say of times holds however long the start has taken. They say when a voltage follows
/// its tick, and of when its mean current is.
#[test]
fn a_recording_is_of_the_times_that_its_rig_file_says() {
    for mut uno in started_from_defaults_and_from_saved_settings() {
        for order in ["arm", "mode open", "sequence levels 6 0 5 200 1"] {
            uno.order(order);
        }
        uno.run_s(0.05);
        uno.bench.chip_mut().measure(None);
        uno.bench.record(16);
        uno.run_s(0.8);
        let rows = uno.bench.take_recording();
        let meter = uno.bench.chip().meter();
        let ticks: Vec<u64> = meter.handler_runs(vector::TIMER0_COMPA).iter().map(|run| run.entry_cycle).collect();
        let changes = rows.windows(2).filter(|pair| pair[0].duty != pair[1].duty).map(|pair| pair[1].cycle);
        let since_tick = |cycle: u64| ticks.iter().rfind(|tick| **tick < cycle).map(|tick| seconds(cycle - tick));
        let delays_s: Vec<f64> = changes.filter_map(since_tick).collect();
        let delay_s = delays_s.iter().sum::<f64>() / delays_s.len() as f64;
        let [before, tick] = [ticks[ticks.len() - 2], ticks[ticks.len() - 1]];
        let of_current =
            |sample: &&Sample| sample.channel == CURRENT_SENSE.bit && (before..tick).contains(&sample.cycle);
        let ages_s: Vec<f64> =
            meter.samples().iter().filter(of_current).map(|sample| seconds(tick - sample.cycle)).collect();
        let late_s = ages_s.iter().sum::<f64>() / ages_s.len() as f64 - 0.5 * seconds(tick - before);
        println!(
            "{} voltages {delay_s} s after their ticks; {} currents {late_s} s late",
            delays_s.len(),
            ages_s.len()
        );
        assert!(
            delays_s.len() > 100 && (delay_s - Timing::FIRMWARE.command_delay_s.unwrap()).abs() < 5e-6,
            "{delay_s}"
        );
        assert!(ages_s.len() == 8 && (late_s - Timing::FIRMWARE.current_late_s.unwrap()).abs() < 2e-6, "{late_s}");
    }
}

fn seconds(cycles: u64) -> f64 {
    cycles as f64 / f64::from(HARDWARE.clock_hz)
}

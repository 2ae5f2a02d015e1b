//! What the firmware costs on the simulated chip, in exact cycles. `tests/chip/cycles.rs` holds it to its bounds. It is
//! printed as the table of docs/reference/benchmarks.md by `cargo bench --features chip --bench firmware`.

use super::Uno;
use host_sim::plant::DcMotor;
use motorbench_chip::registers::{self, vector};
use motorbench_chip::{Bench, Rig, Spread, avr_elf};

/// The tick in one mode of use.
pub struct Tick {
    pub what: &'static str,
    /// Without what interrupted it.
    pub own: Spread,
    /// With it.
    pub all: Spread,
}

/// A way to use the tick, and the orders that lead there from the start.
const USES: [(&str, &[&str]); 7] = [
    ("disarmed", &[]),
    ("speed PID", &["arm", "mode speed", "ref 47"]),
    ("speed LQI", &["arm", "mode lqr_speed", "ref 47"]),
    ("position PID at rest", &["arm", "mode position", "ref 1"]),
    ("position PID on the way, S-curve", &["set jerk_time 64 cruise_speed 20", "arm", "mode position", "ref 60"]),
    ("speed PID on a ramp", &["set acceleration 50", "arm", "mode speed", "ref 90"]),
    (
        "speed PID of a chirp, compensated",
        &[
            "set comp_drop 1 comp_friction_fwd 0.5 comp_friction_rev 0.5",
            "arm",
            "mode speed",
            "sequence chirp 30 40 900",
        ],
    ),
];

/// The tick in each of its uses, with full telemetry.
pub fn ticks() -> Vec<Tick> {
    USES.iter()
        .map(|&(what, orders)| {
            let uno = measured(orders);
            let meter = uno.bench.chip().meter();
            let spread = |spread: Option<Spread>| spread.expect("ticks");
            Tick {
                what,
                own: spread(meter.own_cycles(vector::TIMER0_COMPA)),
                all: spread(meter.handler_cycles(vector::TIMER0_COMPA)),
            }
        })
        .collect()
}

/// 0.2 s with the meter on, after these orders.
fn measured(orders: &[&str]) -> Uno {
    let mut uno = Uno::start();
    for order in orders {
        uno.order(order);
    }
    uno.run_s(0.05);
    uno.bench.chip_mut().measure(None);
    uno.run_s(0.2);
    uno
}

/// The short handlers, and how exactly the periodic ones come, with the speed loop and full telemetry running.
pub struct Interrupts {
    pub encoder: Spread,
    pub adc: Spread,
    pub transmit: Spread,
    pub tick_jitter_cycles: u64,
    pub sampling_jitter_cycles: u64,
}

pub fn interrupts() -> Interrupts {
    let uno = measured(&["arm", "mode speed", "ref 47"]);
    let meter = uno.bench.chip().meter();
    Interrupts {
        encoder: meter.handler_cycles(vector::INT0).expect("edges"),
        adc: meter.handler_cycles(vector::ADC).expect("conversions"),
        transmit: meter.handler_cycles(vector::USART_UDRE).expect("telemetry"),
        tick_jitter_cycles: meter.entry_jitter_cycles(vector::TIMER0_COMPA, 16_000).expect("ticks"),
        sampling_jitter_cycles: meter.sample_jitter_cycles(0, 800).expect("samples"),
    }
}

/// One step of each controller, inputs and outputs in memory.
pub fn controllers() -> Vec<(&'static str, Spread)> {
    let elf = avr_elf("cycles").expect("the program");
    let mut bench = Bench::new(elf, Rig::default(), DcMotor::default()).expect("bench");
    bench.chip_mut().measure(Some(registers::GPIOR0));
    bench.run_s(0.5).expect("the chip runs");
    [(1, "PID step, speed"), (2, "PID step, position"), (3, "LQI step, speed"), (4, "LQI step, position")]
        .map(|(mark, name)| {
            let spread = Spread::of(bench.chip().meter().between_markers(mark, 0, 1)).expect("marks");
            assert_eq!(spread.count, 200, "{name}");
            (name, spread)
        })
        .into()
}

/// What came of a second of encoder edges at a fixed rate, with the loop and full telemetry running.
pub struct Edges {
    pub ticks: u32,
    /// Counts, less those there were to count.
    pub miscounted: i64,
    pub samples_missing: usize,
    pub frames_damaged: u32,
}

pub fn edges(edges_per_ms: u32) -> Edges {
    let mut uno = Uno::start();
    uno.order("arm");
    uno.order("mode open");
    uno.bench.set_edge_train_per_s(Some(edges_per_ms as f64 * 1000.0));
    uno.run_s(0.05);
    uno.samples.clear();
    uno.run_s(1.0);
    let (first, last) = (uno.samples[0], uno.last());
    let ticks = last.tick - first.tick;
    Edges {
        ticks,
        // The edges are exactly periodic, and so are the ticks.
        miscounted: i64::from(last.counts) - i64::from(first.counts) - i64::from(ticks * edges_per_ms),
        samples_missing: ticks as usize + 1 - uno.samples.len(),
        frames_damaged: uno.decoder.lost + uno.decoder.damaged,
    }
}

/// Bytes of memory.
pub struct Memory {
    pub flash: usize,
    pub static_ram: u16,
    /// Never used in a run of every command in every mode, with all that interrupts it.
    pub stack_free: u16,
}

/// Every command that may come while a motor turns.
const COMMANDS: [&str; 17] = [
    "set speed_kp 0.06 speed_ki 1.1 position_kp 6",
    "save",
    "load",
    "defaults",
    "set jerk_time 64 cruise_speed 20 trip_stall 0",
    "status",
    "version",
    "show",
    "help",
    "alive",
    "zero position",
    "stream text 20",
    "stream binary",
    "sequence identify 64 0 100",
    "record chirp 3 0 100 2",
    "ref 1e9",
    "nonsense",
];

pub fn memory() -> Memory {
    let mut uno = Uno::start();
    // Static variables end here; the firmware has painted what is above.
    let first_free = uno.bench.program().variable("_end").expect("_end");
    for (mode, reference) in [("open", 5), ("speed", 47), ("lqr_speed", 47), ("position", 900), ("lqr_position", 900)] {
        uno.order("set jerk_time 64 cruise_speed 20");
        uno.order("arm");
        uno.order(&format!("mode {mode}"));
        for command in COMMANDS {
            // A move under way is the deepest tick.
            uno.ask(&format!("ref {reference}"));
            uno.ask(command);
            // Lines of telemetry are the deepest of the main loop: some that other interrupts meet at any place.
            uno.run_s(if command.starts_with("stream text") { 0.5 } else { 0.02 });
        }
        uno.ask("stream binary");
        uno.order("disarm");
        uno.run_s(0.5);
        uno.ask("clear");
    }
    let stack_free = uno.bench.chip().stack_free_bytes(first_free);
    let status = uno.ask("status");
    assert!(status.contains(&format!("stack free {stack_free}")), "{status}");
    Memory { flash: uno.bench.program().flash_bytes(), static_ram: first_free - 0x100, stack_free }
}

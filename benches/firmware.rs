//! The table of docs/reference/benchmarks.md: what the firmware costs on the simulated chip. It is exact, so one run is enough and a
//! statistical benchmark would say no more. `cargo bench --features chip --bench firmware`.

#[path = "../tests/common/mod.rs"]
mod common;

use common::figures;
use motorbench_chip::Spread;

fn main() {
    println!("| what | measured | goal |\n|---|---|---|");
    let interrupts = figures::interrupts();
    row("encoder interrupt, response to return", range(interrupts.encoder), "56");
    row("ADC interrupt", range(interrupts.adc), "");
    row("transmit interrupt, a byte", range(interrupts.transmit), "");
    row("sampling instant of the current within the PWM period: jitter", interrupts.sampling_jitter_cycles, "");
    row("entry of the control tick: jitter", interrupts.tick_jitter_cycles, "");
    for (name, spread) in figures::controllers() {
        row(name, range(spread), if name.starts_with("PID") { "300" } else { "250" });
    }
    for tick in figures::ticks() {
        row(&format!("control tick, {}", tick.what), range(tick.own), "1,000");
        row(&format!("the same, with what interrupts it, {}", tick.what), range(tick.all), "");
    }
    for edges_per_ms in [20, 50, 100] {
        let edges = figures::edges(edges_per_ms);
        let name = format!("{edges_per_ms},000 edges/s, loop and full telemetry, {} ticks: lost", edges.ticks);
        let measured =
            format!("{} counts, {} samples, {} frames", edges.miscounted, edges.samples_missing, edges.frames_damaged);
        row(&name, measured, "0");
    }
    let memory = figures::memory();
    row("flash, bytes", memory.flash, "16,384");
    row("static RAM, bytes", memory.static_ram, "1,024");
    row("stack never used, bytes", memory.stack_free, "");
    println!(
        "\nPeers on the same simulator (avr-gcc 5.4 -Os), cycles without the 4 of the response:\n\n| peer | cycles |\n|---|---|"
    );
    for (peer, cycles) in PEERS {
        println!("| {peer} | {cycles} |");
    }
}

/// Measured once; they do not change.
const PEERS: [(&str, &str); 9] = [
    ("Arduino PID_v1 1.2.1, a step", "1,704"),
    ("QuickPID 2.2.1, a step", "1,165"),
    ("SimpleFOC 2.4.0, PID step with derivative and ramp / PI", "3,938 / 2,086"),
    ("crate `pid` 4.0.0, f32, a step (with avr-libc's floats)", "11,400 (3,140)"),
    ("SimpleFOC low-pass", "1,645"),
    ("SimpleFOC encoder, `getVelocity`", "1,056"),
    ("PaulStoffregen Encoder, an edge", "146-148"),
    ("`attachInterrupt` with two `digitalRead`, an edge", "256-261"),
    ("SimpleFOC, an edge", "186-318"),
];

fn row(what: &str, measured: impl std::fmt::Display, goal: &str) {
    println!("| {what} | {measured} | {goal} |");
}

fn range(spread: Spread) -> String {
    if spread.min == spread.max { spread.min.to_string() } else { format!("{}-{}", spread.min, spread.max) }
}

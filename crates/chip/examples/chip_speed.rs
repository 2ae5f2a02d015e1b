//! How fast the simulated chip runs against real time.
//!
//! `cargo run --release --features chip -p motorbench-chip --example chip_speed [ELF]`; without an ELF file it builds
//! the firmware. With `CC=clang` in the environment when simavr is compiled it runs a fifth faster. Three loads: as it is, with 20,000 encoder edges per second, and with 100,000.

use std::time::Instant;

use host_sim::plant::DcMotor;
use motorbench_chip::{Bench, Rig, firmware_elf};

/// Simulated time per load.
const SIMULATED_S: f64 = 3.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let elf = match std::env::args().nth(1) {
        Some(path) => path.into(),
        None => firmware_elf()?,
    };
    for edges_per_s in [None, Some(20_000.0), Some(100_000.0)] {
        let mut bench = Bench::new(&elf, Rig::default(), DcMotor::default())?;
        bench.run_s(0.1)?;
        bench.set_edge_train_per_s(edges_per_s);
        bench.record(800);
        let begun = Instant::now();
        bench.run_s(SIMULATED_S)?;
        let speed_up = SIMULATED_S / begun.elapsed().as_secs_f64();
        let rows = bench.take_recording().len();
        println!("{:>7.0} edges/s: {speed_up:5.1} times real time, {rows} rows", edges_per_s.unwrap_or(0.0));
    }
    Ok(())
}

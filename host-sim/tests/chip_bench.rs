//! Chip and motor together.
#![cfg(feature = "chip")]

mod common;

use host_sim::chip::{Bench, Rig};
use host_sim::plant::DcMotor;

#[test]
fn chip_drives_the_motor_and_sees_it_turn() {
    let mut bench = Bench::new(common::elf("drive"), Rig::default(), DcMotor::default()).unwrap();
    bench.run_s(0.2).unwrap();
    let truth = bench.now();
    let edges = bench.chip().read_u16(24) + bench.chip().read_u16(26);
    eprintln!("{truth:?} {edges}");
    assert!(truth.speed_rad_per_s > 20.0);
    assert_eq!(i64::from(edges), truth.encoder_count);
}

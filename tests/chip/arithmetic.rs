//! The assembly of the control path computes on the chip what its Rust twins compute on the host.

use host_sim::plant::DcMotor;
use motorbench_chip::{Bench, Rig, avr_elf};
use motorbench_core::arith::digests;

#[test]
fn chip_and_host_agree() {
    let elf = avr_elf("arithmetic").expect("the program");
    let mut bench = Bench::new(elf, Rig::default(), DcMotor::default()).expect("bench");
    bench.run_s(2.0).expect("the chip runs");
    let at = bench.program().variable("DIGESTS").expect("DIGESTS");
    let digest = |i: usize| u32::from_le_bytes(bench.chip().read_bytes::<4>(at + 4 * i as u16));
    assert_eq!(digest(digests::COUNT), 1, "not finished");
    let names = [
        "mul_i16",
        "mul_u16",
        "mul_i16_u16",
        "multiply_add",
        "multiply_add_u16",
        "saturating_add_i32",
        "saturating_sub_i16",
        "saturate_shift_8",
    ];
    for (i, expected) in digests::compute().into_iter().enumerate() {
        assert_eq!(digest(i), expected, "{}", names[i]);
    }
}

//! Runs the arithmetic of the control path on many arguments and leaves a digest of each function's results in memory;
//! a test compares them with the host's. On the chip these functions are assembly.
#![cfg_attr(target_arch = "avr", no_std, no_main)]

#[cfg(target_arch = "avr")]
mod on_chip {
    /// The digests; the last place is one when all are there.
    #[unsafe(no_mangle)]
    static mut DIGESTS: [u32; motorbench_core::arith::digests::COUNT + 1] =
        [0; motorbench_core::arith::digests::COUNT + 1];

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo) -> ! {
        loop {
            avr_device::asm::nop();
        }
    }

    #[avr_device::entry]
    fn main() -> ! {
        let digests = motorbench_core::arith::digests::compute();
        // SAFETY: nobody else runs; volatile, because only a simulation reads it.
        unsafe {
            let place = (&raw mut DIGESTS).cast::<u32>();
            for (i, digest) in digests.into_iter().enumerate() {
                place.add(i).write_volatile(digest);
            }
            place.add(motorbench_core::arith::digests::COUNT).write_volatile(1);
        }
        loop {
            avr_device::asm::nop();
        }
    }
}

#[cfg(not(target_arch = "avr"))]
fn main() {
    println!("{:08x?}", motorbench_core::arith::digests::compute());
}

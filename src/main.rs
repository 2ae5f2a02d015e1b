//! The Uno firmware; built for the host it prints the protocol and the default settings.
#![cfg_attr(target_arch = "avr", no_std, no_main, feature(abi_avr_interrupt))]

#[cfg(target_arch = "avr")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {}
}

#[cfg(target_arch = "avr")]
#[avr_device::entry]
fn main() -> ! {
    loop {}
}

#[cfg(not(target_arch = "avr"))]
fn main() {}

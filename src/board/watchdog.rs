//! Watchdog and the last words: a hang resets the chip, and the cause survives the reset.

use avr_device::atmega328p::Peripherals;
use core::mem::MaybeUninit;
use motorbench_core::console::ResetCause;

/// Survives every reset but a loss of power.
#[unsafe(link_section = ".noinit")]
static mut LAST_WORDS: MaybeUninit<(u16, u8)> = MaybeUninit::uninit();
/// Says that the last words were spoken, not found in the RAM by chance.
const SPOKEN: u16 = 0x5a3c;
const PANIC: u8 = 1;
const MAIN_LOOP: u8 = 2;
const STACK: u8 = 3;

/// 64 ms, reset. The two stores must follow each other within four cycles.
pub fn start(p: &Peripherals) {
    avr_device::interrupt::free(|_| {
        avr_device::asm::wdr();
        // SAFETY: the change enable, then WDE with a time-out of 64 ms.
        unsafe {
            p.WDT.wdtcsr().write(|w| w.bits(0b0001_1000));
            p.WDT.wdtcsr().write(|w| w.bits(0b0000_1010));
        }
    });
}

/// Why the chip was reset; to be asked once, first of all.
pub fn reset_cause(p: &Peripherals) -> ResetCause {
    let flags = p.CPU.mcusr().read().bits();
    // SAFETY: all flags cleared; while WDRF is set the watchdog could not be changed.
    p.CPU.mcusr().write(|w| unsafe { w.bits(0) });
    // SAFETY: read and cleared before any interrupt may run; the magic number tells words from noise.
    let (spoken, word) = unsafe { (&raw const LAST_WORDS).read_volatile().assume_init() };
    speak(0, 0);
    match (spoken == SPOKEN, word) {
        (true, PANIC) => ResetCause::Panic,
        (true, MAIN_LOOP) => ResetCause::MainLoopHung,
        (true, STACK) => ResetCause::StackOverflow,
        _ if flags & 0b1000 != 0 => ResetCause::Watchdog,
        _ if flags & 0b0001 != 0 => ResetCause::PowerOn,
        _ if flags & 0b0100 != 0 => ResetCause::BrownOut,
        _ if flags & 0b0010 != 0 => ResetCause::External,
        _ => ResetCause::Unknown,
    }
}

fn speak(spoken: u16, word: u8) {
    // SAFETY: one writer at a time: the start before interrupts, the tick, or the panic handler with interrupts off.
    unsafe { (&raw mut LAST_WORDS).write_volatile(MaybeUninit::new((spoken, word))) };
}

/// The tick has found the stack in the variables, or the main loop hung.
pub fn given_up(overflown: bool) {
    speak(SPOKEN, if overflown { STACK } else { MAIN_LOOP });
}

/// A panic: bridge off, words spoken, and the watchdog does the rest.
pub fn panicked(p: &Peripherals) -> ! {
    avr_device::interrupt::disable();
    super::bridge::off(p);
    speak(SPOKEN, PANIC);
    loop {
        // The watchdog ends it.
        avr_device::asm::nop();
    }
}

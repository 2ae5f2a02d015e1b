//! The Uno's registers: the only place that touches hardware. `unsafe` elsewhere has its reason beside it. It stands for
//! what the language cannot say or what would not fit. These are products in assembler, tables and texts read out of flash,
//! states that are all zeros, numbers that are an enum's, and sections for the linker.
//!
//! The handler of [`encoder`] is served first. Nothing else may keep interrupts off for longer than 100 cycles, so that no
//! edge is lost at 100,000 edges/s. The tick therefore takes its inputs with interrupts off and computes with interrupts
//! on. The main loop never turns interrupts off for longer than a few loads and stores.

pub mod adc;
pub mod bridge;
pub mod eeprom;
pub mod encoder;
pub mod serial;
pub mod stack;
pub mod tick;
pub mod watchdog;

use avr_device::atmega328p::Peripherals;
use motorbench_board::pins;

/// Sets up everything but the sampling, which the tick starts; bridge first and off, interrupts disabled until all handlers
/// may run.
pub fn start(peripherals: &Peripherals) {
    bridge::start(peripherals);
    // Inputs with pull-up: encoder (open collector outputs are common) and emergency stop.
    let inputs = pins::ENCODER_A.mask() | pins::ENCODER_B.mask() | pins::EMERGENCY_STOP.mask();
    // SAFETY: any value is valid for a port's output register.
    peripherals.PORTD.portd().modify(|r, w| unsafe { w.bits(r.bits() | inputs) });
    serial::start(peripherals);
    encoder::start(peripherals);
    tick::start(peripherals);
}

/// The registers, for interrupt handlers.
pub fn registers() -> Peripherals {
    // SAFETY: this module settles which register belongs to whom. Handlers and main loop share no register that both
    // read, change and write. The exceptions are PORTD, PORTB and TCCR1A, which only the tick writes after the start.
    // The structure has no content. `Peripherals::steal` would note in every handler that it was given away.
    unsafe { core::mem::transmute::<(), Peripherals>(()) }
}

/// Sleeps until the next interrupt; at the latest the next sample of the current, 100 us away.
pub fn idle(p: &Peripherals) {
    // SAFETY: idle mode, sleep enabled.
    p.CPU.smcr().write(|w| unsafe { w.bits(0b0001) });
    avr_device::asm::sleep();
}

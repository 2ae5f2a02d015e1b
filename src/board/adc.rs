//! ADC: one conversion every second PWM period, always at the same instant of the period.
//!
//! Timer1's compare B triggers. Sample and hold follows two ADC clocks (128 cycles) and the synchronisation later, at
//! [`motorbench_core::HARDWARE.current_sampling_step`]. That is the end of the off phase, where nothing has switched lately
//! unless the duty is above 96 %. A conversion takes 13.5 ADC clocks of 4 us, longer than one period, so the handler arms
//! the trigger for the period after. Ten slots make one millisecond, a round that begins with a tick: 4 x current,
//! tachogenerator, 4 x current, supply.

use avr_device::atmega328p::Peripherals;
use avr_device::interrupt::CriticalSection;
use core::cell::Cell;
use motorbench_board::pins;
use motorbench_core::converter::{BLOCK, SLOTS, STEPS};

use avr_device::interrupt::Mutex;

/// Compare B: the synchronisation of 4 cycles and two ADC clocks before the sampling instant.
pub const TRIGGER: u16 = motorbench_core::HARDWARE.current_sampling_step - 4 - 128;

/// AVcc as reference.
const REFERENCE: u8 = 0b0100_0000;
/// A block of the current in the middle of the range.
const MIDDLE: u16 = BLOCK as u16 * (STEPS / 2);

/// What the handler keeps. Cells, because handlers do not nest and the tick reads with interrupts off.
struct Samples {
    slot: Cell<u8>,
    sum: Cell<u16>,
    block: Cell<u16>,
    current_sum: Cell<u16>,
    tacho: Cell<u16>,
    supply: Cell<u16>,
}

static SAMPLES: Mutex<Samples> = Mutex::new(Samples {
    slot: Cell::new(0),
    sum: Cell::new(0),
    block: Cell::new(MIDDLE),
    current_sum: Cell::new(2 * MIDDLE),
    tacho: Cell::new(0),
    supply: Cell::new(0),
});

/// Starts sampling with the next trigger.
pub fn start(p: &Peripherals) {
    // SAFETY: writing a one clears the flag; set, it would be the first trigger itself.
    p.TC1.tifr1().write(|w| unsafe { w.bits(0b100) });
    // SAFETY: documented values: AVcc reference, current channel; trigger on compare B; enabled, auto trigger,
    // interrupt, prescaler 64; digital inputs of the three channels off.
    unsafe {
        p.ADC.admux().write(|w| w.bits(REFERENCE | pins::CURRENT_SENSE.bit));
        p.ADC.adcsrb().write(|w| w.bits(0b101));
        p.ADC.didr0().write(|w| w.bits(0b111));
        p.ADC.adcsra().write(|w| w.bits(0b1010_1110));
    }
}

/// In place of a sum that has been taken.
pub const TAKEN: u16 = u16::MAX;

/// Sum of the last eight current samples, or [`TAKEN`] if no block has been completed since the last call; last
/// tachogenerator, last supply. There are one or two blocks in each tick: the handler need not count.
#[inline(always)]
pub fn latest(cs: CriticalSection) -> (u16, u16, u16) {
    let samples = SAMPLES.borrow(cs);
    (samples.current_sum.replace(TAKEN), samples.tacho.get(), samples.supply.get())
}

// Conversion complete.
#[avr_device::interrupt(atmega328p)]
fn ADC() {
    let p = super::registers();
    // SAFETY: a handler runs with interrupts off.
    let samples = SAMPLES.borrow(unsafe { CriticalSection::new() });
    // SAFETY: writing a one clears the flag, so that the next compare match is an edge again.
    p.TC1.tifr1().write(|w| unsafe { w.bits(0b100) });
    let value = p.ADC.adc().read().bits();
    let slot = samples.slot.get();
    let next = if slot == SLOTS - 1 { 0 } else { slot + 1 };
    samples.slot.set(next);
    let mut channel = pins::CURRENT_SENSE.bit;
    if slot == BLOCK {
        samples.tacho.set(value);
    } else if slot == SLOTS - 1 {
        samples.supply.set(value);
    } else {
        let sum = samples.sum.get() + value;
        samples.sum.set(sum);
        if next == BLOCK || next == SLOTS - 1 {
            samples.current_sum.set(samples.block.get() + sum);
            samples.block.set(sum);
            samples.sum.set(0);
            channel = if next == BLOCK { pins::TACHOGENERATOR.bit } else { pins::SUPPLY_SENSE.bit };
        }
    }
    // SAFETY: one of the channels 0..=2.
    p.ADC.admux().write(|w| unsafe { w.bits(REFERENCE | channel) });
}

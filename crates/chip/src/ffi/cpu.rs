//! The running chip as a device sees it: its registers and memory, its interrupts and timers.

use std::cell::{Cell, RefCell};
use std::ffi::c_void;

use simavr_ffi as sim;

use super::TIMERS;
use crate::registers::{OCR2A, SRAM_END, VECTORS};

/// The running chip as a device sees it.
pub struct Cpu {
    pub(super) avr: *mut sim::avr_t,
    pub(super) vectors: [*mut sim::avr_int_vector_t; VECTORS],
    pub(super) timer1: *mut sim::avr_timer_t,
    pub(super) timer2: *mut sim::avr_timer_t,
    pub(super) port_d: *mut sim::avr_irq_t,
    /// Cycles before the last reset; simavr counts from zero after each.
    pub(super) epoch: Cell<u64>,
    /// Cycle of a reset that the run loop has not handled yet.
    pub(super) reset_at: Cell<Option<u64>>,
    /// The processor slept when the present stretch began.
    pub(super) slept: Cell<bool>,
    pub(super) timer_callback: sim::avr_cycle_timer_t,
    pub(super) timer_parameters: [*mut c_void; TIMERS],
    /// simavr's own handlers of the registers that were taken over, for [`Cpu::write_through`].
    pub(super) originals: RefCell<Vec<(u16, sim::avr_io_write_t, *mut c_void)>>,
}

impl Cpu {
    /// Cycles since power-on, not restarted by resets.
    pub fn now(&self) -> u64 {
        // SAFETY: `avr` points to the simulator, which lives as long as this `Cpu`; nothing else runs now.
        self.epoch.get() + unsafe { (*self.avr).cycle }
    }

    /// Byte of data memory: registers, I/O, SRAM. Addresses beyond the SRAM read as 0.
    pub fn read(&self, address: u16) -> u8 {
        if address > SRAM_END {
            return 0;
        }
        // SAFETY: `data` has `ramend + 1` bytes and the address was checked against that.
        unsafe { *(*self.avr).data.add(address.into()) }
    }

    /// Writes a byte of data memory without any side effect; ignored beyond the SRAM.
    pub fn write(&self, address: u16, value: u8) {
        if address <= SRAM_END {
            // SAFETY: as in `read`.
            unsafe { *(*self.avr).data.add(address.into()) = value }
        }
    }

    /// Lets simavr's own handler of a register that was taken over act on a write.
    pub fn write_through(&self, address: u16, value: u8) {
        let original = self.originals.borrow().iter().find(|o| o.0 == address).copied();
        match original {
            // SAFETY: the handler and its parameter were installed by simavr for this register of this chip.
            Some((_, Some(handler), parameter)) => unsafe { handler(self.avr, address as _, value, parameter) },
            _ => self.write(address, value),
        }
    }

    /// Byte address of the instruction being executed.
    pub fn program_counter(&self) -> u32 {
        // SAFETY: see `now`.
        unsafe { (*self.avr).pc }
    }

    /// Lets `cycles` pass for the processor, as a halt or a response time does.
    pub fn stall(&self, cycles: u64) {
        // SAFETY: see `now`. The stretch that simavr may run before its next timer becomes shorter by as much; it must
        // not become 0, which would mean without limit.
        unsafe {
            (*self.avr).cycle += cycles;
            (*self.avr).run_cycle_count = (*self.avr).run_cycle_count.saturating_sub(cycles).max(1);
        }
    }

    /// Whether the processor slept when the current stretch began.
    pub fn slept(&self) -> bool {
        self.slept.get()
    }

    /// Raises an interrupt: sets its flag and, if it is enabled, requests it.
    pub fn raise(&self, vector: u8) {
        if let Some(&vector) = self.vectors.get(usize::from(vector)).filter(|v| !v.is_null()) {
            // SAFETY: the table holds simavr's own vectors of this chip.
            unsafe { sim::avr_raise_interrupt(self.avr, vector) };
        }
    }

    /// Clears the flag of an interrupt and its request.
    pub fn clear(&self, vector: u8) {
        if let Some(&vector) = self.vectors.get(usize::from(vector)).filter(|v| !v.is_null()) {
            // SAFETY: as in `raise`.
            unsafe { sim::avr_clear_interrupt(self.avr, vector) };
        }
    }

    /// Whether an interrupt is requested and waits for its turn.
    pub fn requested(&self, vector: u8) -> bool {
        match self.vectors.get(usize::from(vector)) {
            // SAFETY: as in `raise`.
            Some(&vector) if !vector.is_null() => unsafe { (*vector).pending() != 0 },
            _ => false,
        }
    }

    /// Start of a Timer1 period (some period, past or present) and its length in cycles; `None` while it stands.
    pub fn timer1_period(&self) -> Option<(u64, u64)> {
        // SAFETY: `timer1` points into this chip.
        let (base, length) = unsafe { ((*self.timer1).tov_base, (*self.timer1).tov_cycles) };
        (length > 0).then(|| (self.epoch.get() + base, length))
    }

    /// Cycles from the start of a Timer1 period to its compare match B.
    pub fn timer1_compare_b(&self) -> u64 {
        // SAFETY: as in `timer1_period`.
        unsafe { (*self.timer1).comp[1].comp_cycles }
    }

    /// Lets compare unit A (0) or B (1) of Timer2 work or rest. A resting unit raises no flag and costs the simulator
    /// nothing; the caller writes its compare register through afterwards, so that simavr arms it anew.
    pub fn set_timer2_compare(&self, unit: usize, works: bool) {
        let register = if works { OCR2A + unit as u16 } else { 0 };
        // SAFETY: `timer2` points into this chip, whose Timer2 has both units. Without a register simavr leaves the
        // unit out.
        unsafe { (&mut (*self.timer2).comp)[unit].r_ocr = register };
    }

    /// Sets the level of an input pin of port D.
    pub fn drive_port_d(&self, bit: u8, level: bool) {
        debug_assert!(bit < 8);
        // SAFETY: the port has an IRQ for each of its eight pins, and `bit` is one of them.
        unsafe { sim::avr_raise_irq(self.port_d.add(usize::from(bit & 7)), level.into()) }
    }

    /// Calls [`Device::timer`] at the cycle `at`, or as soon as possible if that has passed; replaces an earlier setting.
    pub fn schedule(&self, timer: u8, at: u64) {
        // simavr adds the present cycle again, so that an instant that has just passed keeps its exact value.
        let ahead = at.wrapping_sub(self.now());
        // SAFETY: callback and parameter belong to each other and live as long as the simulator.
        unsafe {
            let parameter = self.timer_parameters[usize::from(timer)];
            sim::avr_cycle_timer_register(self.avr, ahead, self.timer_callback, parameter);
        }
    }
}

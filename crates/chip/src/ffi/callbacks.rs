//! What simavr calls while it runs, and the block that these calls reach.

use std::cell::RefCell;
use std::ffi::{c_int, c_void};

use simavr_ffi as sim;

use super::{Cpu, Device, Interrupt, Port, STOP_TIMER};

/// Parameter of callbacks that have to tell one source from another.
pub(super) struct Tag<D> {
    pub(super) shared: *const Shared<D>,
    pub(super) number: u16,
}

/// What the callbacks reach.
pub(super) struct Shared<D> {
    pub(super) cpu: Cpu,
    pub(super) device: RefCell<D>,
    pub(super) timers: Vec<Tag<D>>,
    pub(super) ports: Vec<Tag<D>>,
    pub(super) bits: Vec<Tag<D>>,
}

impl<D: Device> Shared<D> {
    /// Calls the device unless it is already at work.
    fn notify(&self, call: impl FnOnce(&mut D, &Cpu)) {
        if let Ok(mut device) = self.device.try_borrow_mut() {
            call(&mut device, &self.cpu);
        }
    }
}

pub(super) fn parameter<T>(tag: &T) -> *mut c_void {
    std::ptr::from_ref(tag).cast_mut().cast()
}

/// simavr would sleep in real time here, and then let one cycle too many pass.
pub(super) unsafe extern "C" fn skip_sleep(avr: *mut sim::avr_t, _cycles: u64) {
    // SAFETY: called by simavr with its own chip.
    unsafe { (*avr).cycle -= 1 }
}

pub(super) unsafe extern "C" fn note_reset<D: Device>(avr: *mut sim::avr_t) {
    // SAFETY: `custom.data` was set to the block together with this handler.
    let shared = unsafe { &*(*avr).custom.data.cast::<Shared<D>>() };
    shared.cpu.reset_at.set(Some(shared.cpu.now()));
}

pub(super) unsafe extern "C" fn on_write<D: Device>(
    _: *mut sim::avr_t,
    address: sim::avr_io_addr_t,
    value: u8,
    block: *mut c_void,
) {
    // SAFETY: installed with the block as its parameter.
    let shared = unsafe { &*block.cast::<Shared<D>>() };
    shared.notify(|device, cpu| device.io_write(cpu, address, value));
}

pub(super) unsafe extern "C" fn on_read<D: Device>(
    _: *mut sim::avr_t,
    address: sim::avr_io_addr_t,
    block: *mut c_void,
) -> u8 {
    // SAFETY: installed with the block as its parameter.
    let shared = unsafe { &*block.cast::<Shared<D>>() };
    shared.device.borrow_mut().io_read(&shared.cpu, address)
}

pub(super) unsafe extern "C" fn on_bit<D: Device>(_: *mut sim::avr_t, bit: u8, value: u8, tag: *mut c_void) -> c_int {
    // SAFETY: installed with a tag as its parameter, whose block lives as long.
    let (shared, address) = unsafe { (&*(*tag.cast::<Tag<D>>()).shared, (*tag.cast::<Tag<D>>()).number) };
    if value != 0 {
        shared.notify(|device, cpu| device.bit_set(cpu, address, bit));
    }
    1
}

pub(super) unsafe extern "C" fn on_timer<D: Device>(_: *mut sim::avr_t, when: u64, tag: *mut c_void) -> u64 {
    // SAFETY: registered with a tag as its parameter, whose block lives as long.
    let (shared, number) = unsafe { (&*(*tag.cast::<Tag<D>>()).shared, (*tag.cast::<Tag<D>>()).number as u8) };
    if number == STOP_TIMER {
        return 0;
    }
    let cpu = &shared.cpu;
    let next = match shared.device.try_borrow_mut() {
        Ok(mut device) => device.timer(cpu, number, cpu.epoch.get() + when),
        Err(_) => None,
    };
    match next {
        None => 0,
        Some(next) if next > cpu.now() => next - cpu.epoch.get(),
        // simavr would call back at once, before other timers that are due earlier.
        Some(next) => {
            cpu.schedule(number, next);
            0
        }
    }
}

pub(super) unsafe extern "C" fn on_port<D: Device>(irq: *mut sim::avr_irq_t, value: u32, tag: *mut c_void) {
    // SAFETY: registered with a tag as its parameter, whose block lives as long; simavr passes a valid IRQ.
    let (shared, number, index) =
        unsafe { (&*(*tag.cast::<Tag<D>>()).shared, (*tag.cast::<Tag<D>>()).number, (*irq).irq) };
    let port = if number == 0 { Port::B } else { Port::D };
    let direction = index == sim::IOPORT_IRQ_DIRECTION_ALL;
    shared.notify(|device, cpu| device.port_written(cpu, port, direction, value as u8));
}

pub(super) unsafe extern "C" fn on_flag<D: Device>(irq: *mut sim::avr_irq_t, value: u32, block: *mut c_void) {
    // SAFETY: registered with the block as its parameter; the IRQ's number holds the vector above its low byte.
    let (shared, vector) = unsafe { (&*block.cast::<Shared<D>>(), ((*irq).irq >> 8) as u8) };
    let event = if value != 0 { Interrupt::Raised } else { Interrupt::Cleared };
    shared.notify(|device, cpu| device.interrupt(cpu, vector, event));
}

pub(super) unsafe extern "C" fn on_running<D: Device>(irq: *mut sim::avr_irq_t, value: u32, block: *mut c_void) {
    // SAFETY: as in `on_flag`.
    let (shared, vector) = unsafe { (&*block.cast::<Shared<D>>(), ((*irq).irq >> 8) as u8) };
    let event = if value != 0 { Interrupt::Entered } else { Interrupt::Returned };
    shared.notify(|device, cpu| device.interrupt(cpu, vector, event));
}

pub(super) unsafe extern "C" fn on_invalid_opcode<D: Device>(_: *mut sim::avr_irq_t, opcode: u32, block: *mut c_void) {
    // SAFETY: registered with the block as its parameter.
    let shared = unsafe { &*block.cast::<Shared<D>>() };
    shared.notify(|device, cpu| device.invalid_opcode(cpu, opcode as u16));
    // simavr would step over it and go on.
    // SAFETY: called while the chip runs, on its own behalf.
    unsafe { (*shared.cpu.avr).state = sim::cpu_Crashed as c_int };
}

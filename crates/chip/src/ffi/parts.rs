//! Finds the parts of simavr's ATmega328P: ports, interrupt vectors, timers.

use simavr_ffi as sim;

use super::Port;
use crate::registers::VECTORS;

/// `AVR_IOCTL_IOPORT_GETIRQ`
pub(super) fn port_ioctl(port: Port) -> u32 {
    let letter = match port {
        Port::B => b'B',
        Port::D => b'D',
    };
    u32::from_be_bytes([b'i', b'o', b'g', letter])
}

/// The interrupt vectors of the chip by number.
///
/// # Safety
/// `avr` is initialised.
pub(super) unsafe fn vectors(avr: *mut sim::avr_t) -> [*mut sim::avr_int_vector_t; VECTORS] {
    let mut table = [std::ptr::null_mut(); VECTORS];
    // SAFETY: simavr's table holds `vector_count` valid pointers.
    unsafe {
        let interrupts = &(*avr).interrupts;
        for &vector in &interrupts.vector[..interrupts.vector_count.into()] {
            if let Some(slot) = table.get_mut(usize::from((*vector).vector)) {
                *slot = vector;
            }
        }
    }
    table
}

/// The timer with this digit.
///
/// # Safety
/// `avr` is an initialised ATmega328P.
pub(super) unsafe fn timer(avr: *mut sim::avr_t, digit: u8) -> *mut sim::avr_timer_t {
    let ioctl = u32::from_be_bytes([b't', b'm', b'r', digit]);
    // SAFETY: `io_port` is simavr's list of the chip's modules; the one that answers to this code is the timer, whose
    // first field is the list's element.
    unsafe {
        let mut module = (*avr).io_port;
        while !module.is_null() && (*module).irq_ioctl_get != ioctl {
            module = (*module).next;
        }
        assert!(!module.is_null(), "simavr's ATmega328P has no such timer");
        module.cast()
    }
}

/// Timer1 of the chip, with its compare unit A cut off from the port. simavr would write PORTB1 with each edge of OC1A;
/// here `pwm` computes the pin's level.
///
/// # Safety
/// `avr` is an initialised ATmega328P.
pub(super) unsafe fn timer1(avr: *mut sim::avr_t) -> *mut sim::avr_timer_t {
    // SAFETY: the caller's promise; the pin's IRQ exists.
    unsafe {
        let timer = timer(avr, b'1');
        let compare_a = (*timer).io.irq.add(sim::TIMER_IRQ_OUT_COMP as usize);
        sim::avr_unconnect_irq(compare_a, sim::avr_io_getirq(avr, port_ioctl(Port::B), 1));
        // Without this, the next reset would connect it again.
        (*timer).comp[0].com_pin.set_reg(0);
        timer
    }
}

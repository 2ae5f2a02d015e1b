//! Starting timers together through GTCCR (data sheet sections 17.4.1 and 18.11.9), which simavr ignores.
//!
//! While TSM is set, the timers whose prescalers are held (PSRSYNC: Timer0 and Timer1, PSRASY: Timer2) stand; the
//! counts written meanwhile begin to run in the cycle in which TSM is cleared. Modelled for the counts of Timer0 and
//! Timer2 that are written as 0 during the hold, which is what it is used for. A prescaler reset without TSM, and the
//! standstill of Timer1 for these few cycles, are not modelled.

use super::ffi::Cpu;
use super::registers::{GTCCR, TCNT0, TCNT2};

const TSM: u8 = 1 << 7;
const PSRASY: u8 = 1 << 1;
const PSRSYNC: u8 = 1;

/// Counts that wait for the end of the hold.
#[derive(Default)]
pub(super) struct Prescaler {
    waiting: Vec<(u16, u8)>,
}

impl Prescaler {
    /// GTCCR was written. The reset bits clear themselves unless TSM holds them.
    pub fn control_written(&mut self, cpu: &Cpu, value: u8) {
        let hold = value & TSM != 0;
        cpu.write(GTCCR, if hold { value } else { 0 });
        if !hold {
            self.waiting.drain(..).for_each(|(address, count)| cpu.write_through(address, count));
        }
    }

    /// TCNT0 or TCNT2 was written.
    pub fn count_written(&mut self, cpu: &Cpu, address: u16, count: u8) {
        let mask = if address == TCNT0 { PSRSYNC } else { PSRASY };
        debug_assert!(address == TCNT0 || address == TCNT2);
        cpu.write_through(address, count);
        if cpu.read(GTCCR) & (TSM | mask) == TSM | mask {
            self.waiting.push((address, count));
        }
    }
}

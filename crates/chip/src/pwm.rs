//! OC1A of Timer1 in mode 14, computed from the registers.
//!
//! On the chip OCR1A is double buffered: what is written takes effect at BOTTOM (section 16.9.3). A compare value equal
//! to TOP gives a constant level. With COM1A1:0 = 0 the pin shows PORTB1. simavr takes a new value at once and misses
//! one with an unchanged low byte. It gives 0 % for TOP, and writes PORTB1 with each edge. Here the two bytes are taken
//! together when the low one is written, as the chip does through its TEMP register (section 16.3). OCR1B, which
//! simavr's timer keeps on serving, is held back until BOTTOM as well.
//!
//! The COM1A bits and the port take effect at once, as they do on the chip. Not modelled: other modes than 14 (the pin
//! then shows PORTB1), and the last state of the waveform generator. A pin that is connected within a period shows what
//! it would show had it been connected from the start.

use super::ffi::Cpu;
use super::registers::*;

/// Settings of Timer1 that shape OC1A.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PwmSetting {
    /// COM1A1:0: 0 disconnected, 2 high from BOTTOM to the compare match, 3 low from BOTTOM to the compare match.
    pub com1a: u8,
    /// Compare value in force during this period.
    pub compare: u16,
    /// Cycles of a period; 0 while Timer1 stands or is in another mode than 14.
    pub period_cycles: u32,
}

impl PwmSetting {
    /// The part of the period before the compare match, from 1/800 to 1; 0 if the pin is disconnected.
    pub fn duty(&self) -> f64 {
        if self.com1a < 2 || self.period_cycles == 0 {
            return 0.0;
        }
        f64::from(u32::from(self.compare) + 1).min(self.period_cycles.into()) / f64::from(self.period_cycles)
    }
}

/// The waveform generator.
#[derive(Default)]
pub(super) struct Pwm {
    setting: PwmSetting,
    /// What the program has written for the next period.
    buffered: u16,
    /// Cycle of the last BOTTOM.
    bottom: u64,
    /// OCR1B was written and waits for BOTTOM.
    compare_b_waits: bool,
}

impl Pwm {
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    pub fn setting(&self) -> PwmSetting {
        self.setting
    }

    /// The low byte of OCR1A was written; the high byte stands in its register.
    pub fn compare_written(&mut self, cpu: &Cpu, low: u8) {
        cpu.write(OCR1AL, low);
        self.buffered = u16::from_le_bytes([low, cpu.read(OCR1AH)]);
        if self.setting.period_cycles == 0 {
            self.setting.compare = self.buffered;
        }
    }

    /// The low byte of OCR1B was written, which is buffered just as OCR1A; simavr would use it at once.
    pub fn compare_b_written(&mut self, cpu: &Cpu, low: u8) {
        if self.setting.period_cycles == 0 {
            cpu.write_through(OCR1BL, low);
        } else {
            cpu.write(OCR1BL, low);
            self.compare_b_waits = true;
        }
    }

    /// Hands a new OCR1B to simavr's timer.
    fn apply_compare_b(&mut self, cpu: &Cpu) {
        if std::mem::take(&mut self.compare_b_waits) {
            let low = cpu.read(OCR1BL);
            // simavr ignores a write that changes nothing.
            cpu.write(OCR1BL, !low);
            cpu.write_through(OCR1BL, low);
        }
    }

    /// TCCR1A or TCCR1B was written.
    pub fn control_written(&mut self, cpu: &Cpu, address: u16, value: u8) {
        cpu.write_through(address, value);
        let (a, b) = (cpu.read(TCCR1A), cpu.read(TCCR1B));
        self.setting.com1a = a >> 6;
        let mode_14 = a & 0b11 == 0b10 && b & 0b1_1000 == 0b1_1000;
        let was_running = self.setting.period_cycles != 0;
        match cpu.timer1_period() {
            Some((bottom, period)) if mode_14 && b & 0b111 != 0 => {
                self.setting.period_cycles = period as u32;
                if !was_running {
                    self.setting.compare = self.buffered;
                    self.bottom = bottom;
                }
            }
            _ => self.setting.period_cycles = 0,
        }
    }

    /// Level of OC1A at `cycle`; `None` if the pin belongs to the port.
    pub fn level(&self, cycle: u64) -> Option<bool> {
        if self.setting.com1a < 2 || self.setting.period_cycles == 0 {
            return None;
        }
        let before_match = cycle.saturating_sub(self.bottom) <= u64::from(self.setting.compare);
        Some(before_match == (self.setting.com1a == 2))
    }

    /// Notes that time has come to `cycle`; takes over the buffered value at BOTTOM.
    pub fn advance(&mut self, cpu: &Cpu, cycle: u64) {
        let period = u64::from(self.setting.period_cycles);
        if period == 0 || cycle < self.bottom + period {
            return;
        }
        self.setting.compare = self.buffered;
        self.apply_compare_b(cpu);
        self.bottom += (cycle - self.bottom) / period * period;
        // A write to TCNT1 moves simavr's timer; follow it from the next BOTTOM on.
        if let Some((base, _)) = cpu.timer1_period()
            && base > self.bottom
            && base <= cycle
        {
            self.bottom = base;
        }
    }

    /// The next instant after `cycle` at which something may change.
    pub fn next_event(&self, cycle: u64) -> Option<u64> {
        if self.setting.period_cycles == 0 {
            return None;
        }
        let compare = self.bottom + u64::from(self.setting.compare) + 1;
        let bottom = self.bottom + u64::from(self.setting.period_cycles);
        Some(if self.setting.com1a >= 2 && compare > cycle { compare.min(bottom) } else { bottom })
    }
}

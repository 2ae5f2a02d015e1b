//! The analogue-to-digital converter (section 24), which replaces simavr's.
//!
//! simavr takes 24 ADC clocks for a conversion, knows no trigger but free running, and keeps its result in eight bits
//! too few. The chip, in clocks of the ADC (table 24-1): a conversion started by the program takes 13 and is sampled
//! after 1.5. One started by a trigger takes 13.5 and is sampled after 2. Three processor cycles of synchronisation
//! precede it, because the trigger resets the prescaler. The first one after switching on takes 25 and is sampled after
//! 13.5.
//!
//! A trigger is a rising edge of an interrupt flag. As long as the flag stays up there is no other, and an edge during
//! a conversion is lost (section 24.4). Not modelled: the triggers from the analogue comparator and from INT0.

use super::ffi::Cpu;
use super::registers::*;
use super::{AVCC_V, BANDGAP_V};

const ADEN: u8 = 1 << 7;
const ADSC: u8 = 1 << 6;
const ADATE: u8 = 1 << 5;
const ADIF: u8 = 1 << 4;
const ADIE: u8 = 1 << 3;
const ADLAR: u8 = 1 << 5;
/// Processor cycles between a trigger and the start of the conversion.
const SYNCHRONISATION_CYCLES: u64 = 3;

struct Conversion {
    channel: u8,
    reference_v: f64,
    done_at: u64,
    code: Option<u16>,
}

/// The converter.
#[derive(Default)]
pub(super) struct Adc {
    running: Option<Conversion>,
    /// No conversion since it was switched on.
    first: bool,
    enabled_at: u64,
    /// The result registers wait for ADCH to be read.
    locked: bool,
    /// Flags that are up, by vector.
    flags: u32,
    /// A fault: no conversion ends.
    pub dead: bool,
}

impl Adc {
    pub fn reset(&mut self) {
        *self = Self { dead: self.dead, ..Self::default() };
    }

    pub fn control_written(&mut self, cpu: &Cpu, value: u8) -> Option<u64> {
        if value & ADIF != 0 {
            cpu.clear(vector::ADC);
        }
        let old = cpu.read(ADCSRA);
        let mut new = (value & !(ADIF | ADSC)) | (old & (ADIF | ADSC));
        if value & ADEN == 0 {
            self.running = None;
            new &= !ADSC;
        } else if old & ADEN == 0 {
            self.first = true;
            self.enabled_at = cpu.now();
        }
        cpu.write(ADCSRA, new);
        if new & !old & ADIE != 0 && new & ADIF != 0 {
            cpu.raise(vector::ADC);
        }
        let start = value & ADEN != 0 && value & ADSC != 0 && self.running.is_none();
        start.then(|| {
            // The conversion starts with the next clock of the prescaler, which runs since switching on.
            let clock = prescaler(cpu);
            let since = cpu.now() - self.enabled_at;
            self.start(cpu, self.enabled_at + since.next_multiple_of(clock), 3, 26)
        })
    }

    /// An interrupt flag went up. Returns the instant of sampling if that starts a conversion.
    pub fn flag_raised(&mut self, cpu: &Cpu, vector: u8) -> Option<u64> {
        let edge = self.flags & (1 << vector) == 0;
        self.flags |= 1 << vector;
        let control = cpu.read(ADCSRA);
        let selected = trigger_vector(cpu.read(ADCSRB)) == Some(vector);
        let ready = control & ADEN != 0 && control & ADATE != 0 && self.running.is_none();
        (edge && selected && ready)
            .then(|| self.start(cpu, trigger_instant(cpu, vector) + SYNCHRONISATION_CYCLES, 4, 27))
    }

    /// An interrupt flag was cleared.
    pub fn flag_cleared(&mut self, vector: u8) {
        self.flags &= !(1 << vector);
    }

    /// Begins a conversion; times in half clocks of the ADC. Returns the instant of sampling.
    fn start(&mut self, cpu: &Cpu, begin: u64, sample: u64, done: u64) -> u64 {
        let (sample, done) = if self.first { (27, 50) } else { (sample, done) };
        self.first = false;
        let half = prescaler(cpu) / 2;
        let admux = cpu.read(ADMUX);
        let reference_v = if admux >> 6 == 3 { BANDGAP_V } else { AVCC_V };
        self.running =
            Some(Conversion { channel: admux & 0x0F, reference_v, done_at: begin + done * half, code: None });
        cpu.write(ADCSRA, cpu.read(ADCSRA) | ADSC);
        begin + sample * half
    }

    /// The channel whose input is held now, if the conversion has got that far and no further.
    pub fn sampling(&self) -> Option<u8> {
        self.running.as_ref().filter(|c| c.code.is_none()).map(|c| c.channel)
    }

    /// Takes the sample. Returns the instant at which the conversion is done.
    pub fn sample(&mut self, input_v: f64) -> Option<u64> {
        let conversion = self.running.as_mut()?;
        let code = (input_v / conversion.reference_v * 1024.0).floor();
        conversion.code = Some(code.clamp(0.0, 1023.0) as u16);
        Some(conversion.done_at)
    }

    /// Ends the conversion at `when`. Returns the instant of the next sample in free-running mode.
    pub fn done(&mut self, cpu: &Cpu, when: u64) -> Option<u64> {
        if self.dead {
            // It looks again after as long as a conversion takes.
            return Some(when + 13 * prescaler(cpu));
        }
        let code = self.running.take()?.code?;
        if !self.locked {
            let word = if cpu.read(ADMUX) & ADLAR != 0 { code << 6 } else { code };
            let [low, high] = word.to_le_bytes();
            cpu.write(ADCL, low);
            cpu.write(ADCH, high);
        }
        let control = cpu.read(ADCSRA) & !ADSC;
        cpu.write(ADCSRA, control);
        cpu.raise(vector::ADC);
        let free_running = control & ADATE != 0 && cpu.read(ADCSRB) & 0b111 == 0;
        free_running.then(|| self.start(cpu, when, 3, 26))
    }

    /// Reading ADCL keeps the pair from being overwritten until ADCH has been read (section 24.9.3).
    pub fn result_read(&mut self, cpu: &Cpu, address: u16) -> u8 {
        self.locked = address == ADCL;
        cpu.read(address)
    }
}

/// Processor cycles per clock of the ADC.
fn prescaler(cpu: &Cpu) -> u64 {
    1 << (cpu.read(ADCSRA) & 0b111).max(1)
}

/// The interrupt whose flag triggers a conversion (table 24-6).
fn trigger_vector(adcsrb: u8) -> Option<u8> {
    match adcsrb & 0b111 {
        3 => Some(vector::TIMER0_COMPA),
        4 => Some(vector::TIMER0_OVF),
        5 => Some(vector::TIMER1_COMPB),
        6 => Some(vector::TIMER1_OVF),
        7 => Some(vector::TIMER1_CAPT),
        _ => None,
    }
}

/// When a flag went up that simavr has just raised. For Timer1 it is exact to the cycle; for the others it is the end
/// of the instruction.
fn trigger_instant(cpu: &Cpu, vector: u8) -> u64 {
    let now = cpu.now();
    let offset = match vector {
        vector::TIMER1_COMPB => cpu.timer1_compare_b(),
        vector::TIMER1_OVF => 0,
        _ => return now,
    };
    match cpu.timer1_period() {
        Some((base, period)) if base <= now => now - (now - base + period - offset % period) % period,
        _ => now,
    }
}

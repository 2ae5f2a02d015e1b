//! USART0 (section 20) with the host at the other end of the line; it replaces simavr's.
//!
//! simavr lets a byte of 8N1 last 11 bits, has no transmit buffer and a receive FIFO of 64 bytes. The chip has one byte
//! of buffer before its transmit shift register and two behind the receive shift register. A third byte waits in the
//! shift register; if a start bit arrives then, the waiting byte is lost (DOR, section 20.11.2).
//!
//! The baud clock starts with the byte: a lone byte is up to one bit early, bytes in a row are exact.

use std::collections::VecDeque;

use motorbench_core::HARDWARE;

use super::ffi::Cpu;
use super::registers::*;

const RXC: u8 = 1 << 7;
const TXC: u8 = 1 << 6;
const UDRE: u8 = 1 << 5;
const DOR: u8 = 1 << 3;
const U2X: u8 = 1 << 1;
const MPCM: u8 = 1;
const RXCIE: u8 = 1 << 7;
const TXCIE: u8 = 1 << 6;
const UDRIE: u8 = 1 << 5;
const RXEN: u8 = 1 << 4;
const TXEN: u8 = 1 << 3;
/// Bytes of the receive buffer.
const RECEIVE_BUFFER: usize = 2;
/// Difference of the bit times beyond which the last bit of a byte is sampled outside of it (table 20-2).
const BAUD_TOLERANCE: f64 = 0.04;

/// What went wrong on the serial line so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SerialErrors {
    /// Bytes from the host that the program did not fetch in time.
    pub overruns: u64,
    /// Bytes the program wrote while the transmit buffer was full.
    pub transmit_overwrites: u64,
    /// Bytes lost in either direction because program and host use different speeds.
    pub baud_mismatches: u64,
    /// Bytes from the host that arrived while the receiver was switched off.
    pub receiver_off: u64,
    /// The most bytes that ever waited for the program, 0..=3.
    pub deepest_backlog: u64,
}

/// A byte from the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimedByte {
    /// Cycle at which its stop bit ended.
    pub cycle: u64,
    /// The byte.
    pub byte: u8,
}

/// The USART and the line to the host.
pub(super) struct Usart {
    sending: Option<u8>,
    send_buffer: Option<u8>,
    receive_buffer: VecDeque<u8>,
    receive_shift: Option<u8>,
    overrun: bool,
    /// Bytes that the host still has to send, and the one on the line.
    pub from_host: VecDeque<u8>,
    on_line: Option<u8>,
    pub to_host: Vec<TimedByte>,
    pub errors: SerialErrors,
    pub host_baud: u32,
    /// A fault: what is in the transmitter stays there.
    stuck: bool,
}

impl Usart {
    pub fn new() -> Self {
        Self {
            sending: None,
            send_buffer: None,
            receive_buffer: VecDeque::new(),
            receive_shift: None,
            overrun: false,
            from_host: VecDeque::new(),
            on_line: None,
            to_host: Vec::new(),
            errors: SerialErrors::default(),
            host_baud: HARDWARE.baud,
            stuck: false,
        }
    }

    /// The chip was reset; the host's bytes stay. Returns when the byte on the line ends.
    pub fn reset(&mut self, cpu: &Cpu) -> Option<u64> {
        self.sending = None;
        self.send_buffer = None;
        self.empty_receiver();
        cpu.write(UCSR0A, UDRE);
        cpu.write(UCSR0B, 0);
        cpu.write(UCSR0C, 0b110);
        self.on_line.is_some().then(|| cpu.now() + self.host_byte_cycles())
    }

    fn empty_receiver(&mut self) {
        self.receive_buffer.clear();
        self.receive_shift = None;
        self.overrun = false;
    }

    fn host_bit_cycles(&self) -> f64 {
        f64::from(HARDWARE.clock_hz) / f64::from(self.host_baud)
    }

    /// Start bit, eight data bits, stop bit.
    fn host_byte_cycles(&self) -> u64 {
        (10.0 * self.host_bit_cycles()).round() as u64
    }

    fn speeds_agree(&self, cpu: &Cpu) -> bool {
        (bit_cycles(cpu) as f64 / self.host_bit_cycles() - 1.0).abs() < BAUD_TOLERANCE
    }

    /// Shows the flags in UCSR0A and requests the interrupts that follow from them.
    fn publish(&self, cpu: &Cpu) {
        let flag = |set: bool, mask: u8| if set { mask } else { 0 };
        let kept = cpu.read(UCSR0A) & (TXC | U2X | MPCM);
        let status = kept
            | flag(!self.receive_buffer.is_empty(), RXC)
            | flag(self.send_buffer.is_none(), UDRE)
            | flag(self.overrun, DOR);
        cpu.write(UCSR0A, status);
        let levels = [(RXC, RXCIE, vector::USART_RX), (UDRE, UDRIE, vector::USART_UDRE)];
        for (flag, enable, vector) in levels {
            let wanted = status & flag != 0 && cpu.read(UCSR0B) & enable != 0;
            match (wanted, cpu.requested(vector)) {
                (true, false) => cpu.raise(vector),
                (false, true) => cpu.clear(vector),
                _ => {}
            }
        }
    }

    /// A handler returned: RXC and UDRE ask again as long as their cause persists (sections 20.6.3 and 20.7.3).
    pub fn handler_returned(&self, cpu: &Cpu) {
        self.publish(cpu);
    }

    pub fn status_written(&self, cpu: &Cpu, value: u8) {
        if value & TXC != 0 {
            cpu.clear(vector::USART_TX);
        }
        cpu.write(UCSR0A, (cpu.read(UCSR0A) & TXC) | (value & (U2X | MPCM)));
        self.publish(cpu);
    }

    pub fn control_written(&mut self, cpu: &Cpu, value: u8) {
        let newly = value & !cpu.read(UCSR0B);
        cpu.write(UCSR0B, value);
        if value & RXEN == 0 {
            self.empty_receiver();
        }
        self.publish(cpu);
        if newly & TXCIE != 0 && cpu.read(UCSR0A) & TXC != 0 {
            cpu.raise(vector::USART_TX);
        }
    }

    /// The program wrote UDR0. Returns when the byte has left, if it left at once.
    pub fn data_written(&mut self, cpu: &Cpu, byte: u8) -> Option<u64> {
        if cpu.read(UCSR0B) & TXEN == 0 {
            return None;
        }
        let mut done = None;
        if self.sending.is_none() {
            self.sending = Some(byte);
            done = Some(cpu.now() + frame_cycles(cpu));
        } else if self.send_buffer.is_none() {
            self.send_buffer = Some(byte);
        } else {
            self.errors.transmit_overwrites += 1;
        }
        self.publish(cpu);
        done
    }

    /// Lets the transmitter keep its byte, or go on. Returns when the byte that it had will have left.
    pub fn set_stuck(&mut self, cpu: &Cpu, stuck: bool) -> Option<u64> {
        let released = self.stuck && !stuck && self.sending.is_some();
        self.stuck = stuck;
        released.then(|| cpu.now() + frame_cycles(cpu))
    }

    /// The byte in the transmit shift register has left at `when`. Returns when the next one will have.
    pub fn sent(&mut self, cpu: &Cpu, when: u64) -> Option<u64> {
        if self.stuck {
            return None;
        }
        let byte = self.sending.take()?;
        if self.speeds_agree(cpu) {
            self.to_host.push(TimedByte { cycle: when, byte });
        } else {
            self.errors.baud_mismatches += 1;
        }
        self.sending = self.send_buffer.take();
        if self.sending.is_none() {
            cpu.raise(vector::USART_TX);
        }
        self.publish(cpu);
        self.sending.map(|_| when + frame_cycles(cpu))
    }

    /// The program reads UDR0.
    pub fn data_read(&mut self, cpu: &Cpu) -> u8 {
        let byte = self.receive_buffer.pop_front().unwrap_or(0);
        self.receive_buffer.extend(self.receive_shift.take());
        self.overrun = false;
        self.publish(cpu);
        byte
    }

    /// Puts the host's next byte on the line at `now` if the line is free. Returns when it has arrived.
    pub fn host_sends(&mut self, now: u64) -> Option<u64> {
        if self.on_line.is_some() {
            return None;
        }
        self.on_line = self.from_host.pop_front();
        self.on_line?;
        if self.receive_shift.take().is_some() {
            self.overrun = true;
            self.errors.overruns += 1;
        }
        Some(now + self.host_byte_cycles())
    }

    /// The byte on the line has arrived at `when`. Returns when the next one will have.
    pub fn received(&mut self, cpu: &Cpu, when: u64) -> Option<u64> {
        let byte = self.on_line.take()?;
        if cpu.read(UCSR0B) & RXEN == 0 {
            self.errors.receiver_off += 1;
        } else if !self.speeds_agree(cpu) {
            self.errors.baud_mismatches += 1;
        } else if self.receive_buffer.len() < RECEIVE_BUFFER {
            self.receive_buffer.push_back(byte);
        } else {
            self.receive_shift = Some(byte);
        }
        let backlog = self.receive_buffer.len() + usize::from(self.receive_shift.is_some());
        self.errors.deepest_backlog = self.errors.deepest_backlog.max(backlog as u64);
        let next = self.host_sends(when);
        self.publish(cpu);
        next
    }
}

/// Cycles per bit (table 20-1).
fn bit_cycles(cpu: &Cpu) -> u64 {
    let divisor = u64::from(u16::from_le_bytes([cpu.read(UBRR0L), cpu.read(UBRR0H) & 0x0F])) + 1;
    divisor * if cpu.read(UCSR0A) & U2X != 0 { 8 } else { 16 }
}

/// Cycles per byte with start, parity and stop bits (section 20.4).
fn frame_cycles(cpu: &Cpu) -> u64 {
    let format = cpu.read(UCSR0C);
    let data = 5 + u64::from(format >> 1 & 0b11);
    let parity = u64::from(format >> 5 & 1);
    let stop = 1 + u64::from(format >> 3 & 1);
    (1 + data + parity + stop) * bit_cycles(cpu)
}

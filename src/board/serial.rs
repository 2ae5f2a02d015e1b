//! USART0 behind the Uno's USB bridge: 500 kBd, 8N1, interrupts and two rings.

use avr_device::atmega328p::Peripherals;
use avr_device::interrupt::{CriticalSection, Mutex};
use core::cell::Cell;
use motorbench_core::HARDWARE;

/// A ring of `N` bytes (a power of two) between one writer and one reader.
struct Ring<const N: usize> {
    bytes: [Cell<u8>; N],
    head: Cell<u8>,
    tail: Cell<u8>,
}

impl<const N: usize> Ring<N> {
    const fn new() -> Self {
        Self { bytes: [const { Cell::new(0) }; N], head: Cell::new(0), tail: Cell::new(0) }
    }

    #[inline(always)]
    fn next(index: u8) -> u8 {
        (index + 1) & (N as u8 - 1)
    }

    /// Puts a byte in; false when full.
    #[inline(always)]
    fn push(&self, byte: u8) -> bool {
        let head = self.head.get();
        let next = Self::next(head);
        if next == self.tail.get() {
            return false;
        }
        if let Some(cell) = self.bytes.get(head as usize) {
            cell.set(byte);
        }
        self.head.set(next);
        true
    }

    /// How many bytes are in it.
    #[inline(always)]
    fn waiting(&self) -> u8 {
        self.head.get().wrapping_sub(self.tail.get()) & (N as u8 - 1)
    }

    /// Takes the oldest byte out.
    #[inline(always)]
    fn pop(&self) -> Option<u8> {
        let tail = self.tail.get();
        if tail == self.head.get() {
            return None;
        }
        self.tail.set(Self::next(tail));
        self.bytes.get(tail as usize).map(Cell::get)
    }
}

static RECEIVED: Mutex<Ring<64>> = Mutex::new(Ring::new());
static OUTGOING: Mutex<Ring<64>> = Mutex::new(Ring::new());
/// Bytes lost because nobody took them, in the chip or in the ring.
static OVERRUNS: Mutex<Cell<u8>> = Mutex::new(Cell::new(0));

const UDRIE: u8 = 1 << 5;
/// Receiver, transmitter and receive interrupt on.
const ENABLED: u8 = 0b1001_1000;

/// Opens the line.
pub fn start(p: &Peripherals) {
    // SAFETY: documented values: double speed, divisor, 8N1 (the reset value), receiver with interrupt, transmitter.
    unsafe {
        p.USART0.ucsr0a().write(|w| w.bits(0b10));
        p.USART0.ubrr0().write(|w| w.bits((HARDWARE.clock_hz / 8 / HARDWARE.baud - 1) as u16));
        p.USART0.ucsr0b().write(|w| w.bits(ENABLED));
    }
}

/// The next received byte.
pub fn read() -> Option<u8> {
    avr_device::interrupt::free(|cs| RECEIVED.borrow(cs).pop())
}

/// Queues a byte; false when there is no room.
pub fn try_write(byte: u8) -> bool {
    let queued = avr_device::interrupt::free(|cs| OUTGOING.borrow(cs).push(byte));
    // SAFETY: the constant and the transmit interrupt; only the main loop turns it on.
    super::registers().USART0.ucsr0b().write(|w| unsafe { w.bits(ENABLED | UDRIE) });
    queued
}

/// Received bytes that nobody has read, and those lost since reset, modulo 256: while nobody reads, more with each byte
/// that comes.
pub fn unread() -> u8 {
    avr_device::interrupt::free(|cs| RECEIVED.borrow(cs).waiting().wrapping_add(OVERRUNS.borrow(cs).get()))
}

/// Bytes lost since reset; stays at 255.
pub fn overruns() -> u8 {
    avr_device::interrupt::free(|cs| OVERRUNS.borrow(cs).get())
}

// A byte has come.
#[avr_device::interrupt(atmega328p)]
fn USART_RX() {
    let p = super::registers();
    let overrun = p.USART0.ucsr0a().read().bits() & (1 << 3) != 0;
    let byte = p.USART0.udr0().read().bits();
    // SAFETY: a handler runs with interrupts off.
    let cs = unsafe { CriticalSection::new() };
    if !RECEIVED.borrow(cs).push(byte) || overrun {
        let lost = OVERRUNS.borrow(cs);
        lost.set(lost.get().saturating_add(1));
    }
}

// The transmitter wants a byte.
#[avr_device::interrupt(atmega328p)]
fn USART_UDRE() {
    let p = super::registers();
    // SAFETY: a handler runs with interrupts off.
    match OUTGOING.borrow(unsafe { CriticalSection::new() }).pop() {
        // SAFETY: any byte is valid.
        Some(byte) => p.USART0.udr0().write(|w| unsafe { w.bits(byte) }),
        // SAFETY: the constant without the transmit interrupt.
        None => p.USART0.ucsr0b().write(|w| unsafe { w.bits(ENABLED) }),
    };
}

//! Registers and vectors of the ATmega328P (data sheet, sections 12.4 and 36), as far as the harness uses them.
//!
//! All addresses are those of the data memory, which LDS and STS use.
#![allow(missing_docs)]

/// Address of the first I/O register.
pub const IO_BASE: u16 = 0x20;
/// First and last byte of the SRAM.
pub const SRAM_START: u16 = 0x100;
pub const SRAM_END: u16 = 0x8FF;
/// Bytes of the EEPROM.
pub const EEPROM_BYTES: usize = 1024;

pub const PIND: u16 = 0x29;
pub const TIFR0: u16 = 0x35;
pub const TIFR1: u16 = 0x36;
pub const TIFR2: u16 = 0x37;
pub const EIFR: u16 = 0x3C;
pub const EIMSK: u16 = 0x3D;
pub const GPIOR0: u16 = 0x3E;
pub const EECR: u16 = 0x3F;
pub const EEDR: u16 = 0x40;
pub const EEARL: u16 = 0x41;
pub const EEARH: u16 = 0x42;
pub const GTCCR: u16 = 0x43;
pub const TCNT0: u16 = 0x46;
pub const GPIOR1: u16 = 0x4A;
pub const GPIOR2: u16 = 0x4B;
pub const MCUSR: u16 = 0x54;
pub const SPL: u16 = 0x5D;
pub const SPH: u16 = 0x5E;
pub const EICRA: u16 = 0x69;
pub const TIMSK0: u16 = 0x6E;
pub const TIMSK1: u16 = 0x6F;
pub const TIMSK2: u16 = 0x70;
pub const ADCL: u16 = 0x78;
pub const ADCH: u16 = 0x79;
pub const ADCSRA: u16 = 0x7A;
pub const ADCSRB: u16 = 0x7B;
pub const ADMUX: u16 = 0x7C;
pub const TCCR1A: u16 = 0x80;
pub const TCCR1B: u16 = 0x81;
pub const OCR1AL: u16 = 0x88;
pub const OCR1AH: u16 = 0x89;
pub const OCR1BL: u16 = 0x8A;
pub const TCNT2: u16 = 0xB2;
pub const OCR2A: u16 = 0xB3;
pub const OCR2B: u16 = 0xB4;
pub const UCSR0A: u16 = 0xC0;
pub const UCSR0B: u16 = 0xC1;
pub const UCSR0C: u16 = 0xC2;
pub const UBRR0L: u16 = 0xC4;
pub const UBRR0H: u16 = 0xC5;
pub const UDR0: u16 = 0xC6;

/// Number of vectors, reset included.
pub const VECTORS: usize = 26;

/// An interrupt, by the number simavr, avr-libc and avr-device call it: reset is 0.
pub mod vector {
    pub const INT0: u8 = 1;
    pub const INT1: u8 = 2;
    pub const WDT: u8 = 6;
    pub const TIMER2_COMPA: u8 = 7;
    pub const TIMER2_COMPB: u8 = 8;
    pub const TIMER2_OVF: u8 = 9;
    pub const TIMER1_CAPT: u8 = 10;
    pub const TIMER1_COMPA: u8 = 11;
    pub const TIMER1_COMPB: u8 = 12;
    pub const TIMER1_OVF: u8 = 13;
    pub const TIMER0_COMPA: u8 = 14;
    pub const TIMER0_COMPB: u8 = 15;
    pub const TIMER0_OVF: u8 = 16;
    pub const USART_RX: u8 = 18;
    pub const USART_UDRE: u8 = 19;
    pub const USART_TX: u8 = 20;
    pub const ADC: u8 = 21;
    pub const EE_READY: u8 = 22;
}

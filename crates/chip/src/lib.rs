//! The firmware's own machine code on a simulated ATmega328P, with a simulated motor at its pins.
//!
//! [`Chip`] is the processor with its peripherals, [`Bench`] puts a [`Plant`](host_sim::plant::Plant), an encoder and
//! the analogue sensors around it. The processor core, the timers' counters, the ports, INT0/INT1 and the watchdog are
//! simavr's. One module each has what simavr leaves out or gets wrong:
//!
//! | module | replaces or cures |
//! |---|---|
//! | `pwm` | OC1A: double buffering, constant levels, disconnected pin |
//! | `adc` | conversion times, triggers, sampling instant |
//! | `usart` | byte times, transmit buffer, receive buffer of two, overruns |
//! | `eeprom` | write times, EE_READY, halted processor |
//! | `flags` | flags raised while disabled, EIFR, SBI on flag registers |
//! | `prescaler` | timers started together through GTCCR |
//! | `board` | four cycles of interrupt response, eight out of sleep |
//! | `ffi` | sleep without waiting, pull-ups, cycle count across resets |
//!
//! Sections and tables named in comments are those of the ATmega328P data sheet DS40002061.
//!
//! Times are processor cycles of 62.5 ns since power-on. An output pin changes at the start of the instruction that
//! writes it, up to two cycles early. Not modelled are start-up times after a reset, and the synchronisers of the input
//! pins (one to two cycles). The pins of Timer1 in other modes than 14 are not either. Nor are the bootloader, and the
//! compare flags of Timer2 while their interrupts are disabled.
#![cfg(feature = "chip")]

mod adc;
mod bench;
mod board;
mod console;
mod core;
mod eeprom;
mod encoder;
mod ffi;
mod flags;
mod meter;
mod prescaler;
mod program;
mod pwm;
mod recorder;
pub mod registers;
mod rig;
mod sensors;
mod serial;
mod surroundings;
mod usart;
mod world;

pub use self::core::{Chip, Crash, ResetCause};
pub use bench::Bench;
pub use console::ChipBoard;
pub use encoder::EncoderFault;
pub use meter::{HandlerRun, Marker, Meter, Sample, Spread};
pub use program::{Program, ProgramError, assemble, avr_elf, firmware_at_hand, firmware_elf};
pub use pwm::PwmSetting;
pub use recorder::{Recording, Row};
pub use registers::EEPROM_BYTES;
pub use rig::{Rig, Wiring};
pub use sensors::{Acs712, SensorFault, SupplyDivider, Tachogenerator};
pub use serial::Serial;
pub use surroundings::Surroundings;
pub use usart::{SerialErrors, TimedByte};
pub use world::{Outputs, Unconnected, World};

/// Supply of the chip and full scale of its converter.
pub const AVCC_V: f64 = 5.0;
/// Internal reference and channel 14 of the converter.
pub const BANDGAP_V: f64 = 1.1;

//! The simulated chip against the data sheet.
#![cfg(feature = "chip")]

mod chip_adc;
mod chip_bench;
mod chip_core;
mod chip_eeprom;
mod chip_flags;
mod chip_pwm;
mod chip_usart;
mod common;

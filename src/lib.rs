//! The hardware-free control core of motorbench: `no_std`, builds for the host and for AVR.
#![no_std]

pub mod pins;

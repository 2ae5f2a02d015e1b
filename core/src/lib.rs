//! The hardware-free control core of motorbench: `no_std`, the same code on the Uno and on the host.
//!
//! ```
//! use motorbench_core::control_loop::{ControlLoop, Inputs, LoopConfig};
//! use motorbench_core::encoder::Edges;
//! use motorbench_core::excitation::Bridge;
//! use motorbench_core::settings::Settings;
//!
//! let config = LoopConfig::build(&Settings::defaults()).unwrap();
//! let mut control = ControlLoop::new(config, Edges::default());
//! // One tick without a request: the drive stays off.
//! let inputs = Inputs { flags: Inputs::MAIN_LOOP_ALIVE, ..Inputs::default() };
//! assert_eq!(control.tick(None, &inputs).bridge, Bridge::Coast);
//! ```
//!
//! The three types to know: [`settings::Settings`] (in SI units), [`control_loop::LoopConfig`] (the same, quantised),
//! [`control_loop::ControlLoop`] (one tick, from inputs to drive).
#![cfg_attr(not(test), no_std)]
#![cfg_attr(target_arch = "avr", feature(asm_experimental_arch))]

pub use motorbench_board::{HARDWARE, Hardware};

pub mod arith;
pub mod compensation;
pub mod console;
pub mod control_loop;
pub mod converter;
mod crc16;
pub mod current;
pub mod encoder;
pub mod excitation;
mod flash_text;
pub mod limits;
pub mod low_pass;
pub mod lqr;
pub mod message;
pub mod observer;
pub mod pid;
pub mod protocol;
pub mod quantiser;
pub mod settings;
pub mod storage;
pub mod tachogenerator;
pub mod trajectory;
pub mod trips;
pub mod units;

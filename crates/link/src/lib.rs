//! A board on a serial port: its console, its telemetry, and recordings made with it.
//!
//! ```no_run
//! use motorbench_link::board::{Board, arm};
//! use motorbench_link::port;
//! use std::sync::Arc;
//!
//! let mut board = port::open(&port::only_board()?, Arc::default())?;
//! arm(&mut board)?;
//! board.command("mode speed")?;
//! board.command("ref 60")?;
//! let samples = board.samples(1.0)?;
//! println!("{} samples", samples.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The three types to know: [`board::Board`] (what an experiment needs of a board), [`Link`] (the same over a line),
//! [`Line`] (a serial port, or something that behaves like one). A [`Link`] that is dropped disarms the drive.

pub mod board;
mod connection;

#[doc(hidden)]
pub mod fake_board;
pub mod growing;
mod line;
pub mod live;
pub mod port;
pub mod record;
#[cfg(unix)]
pub mod virtual_control;

pub use connection::{Link, Losses, OTHER_READER, VERSION, is_comment, lines};
pub use line::Line;

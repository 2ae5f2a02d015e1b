//! A board on a serial port: its console, its telemetry, and recordings made with it.

pub mod board;
mod connection;
pub mod coverage;
#[doc(hidden)]
pub mod fake_board;
pub mod growing;
pub mod live;
pub mod port;
pub mod record;
#[cfg(unix)]
pub mod virtual_control;

pub use connection::{Line, Link, Losses, OTHER_READER, VERSION, lines};

//! The program `motorbench`: the only place that knows the command line, the terminal's colours and exit codes.

pub mod commands;
pub mod terminal_plot;
pub mod tune;

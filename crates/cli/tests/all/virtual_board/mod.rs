//! The commands for a board, as a person types them, against the real firmware behind `motorbench virtual`.

mod console;
mod faults;
mod plotters;
mod process;
mod recording;
mod stand;
mod terminal;
mod tuning;

/// A recording of 3.2 s in which the motor turns both ways.
const STEPS: [&str; 8] = ["--sequence", "steps", "--amplitude", "5", "--period", "400", "--count", "2"];

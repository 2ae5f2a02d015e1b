//! The firmware on the simulated chip, with a motor at its pins. The tests are one binary: it is linked once, and they
//! run in parallel.

mod arithmetic;
#[path = "../common/mod.rs"]
mod common;
mod console;
mod control;
mod cycles;
mod diagnosis;
mod faults;
mod host_agrees;
mod safety;
mod tachogenerator;
mod thesis;
mod tuning;

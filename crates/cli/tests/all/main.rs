//! The program as a user runs it. It is one binary, so that tests that wait for a terminal run in parallel to those
//! that compute.

#[cfg(all(unix, feature = "chip"))]
mod board;
#[path = "../common/motor.rs"]
mod motor;

mod batch;
mod convert;
mod demonstration;
mod link;
mod nothing_destroyed;
mod pages;
mod program;
#[cfg(all(unix, feature = "chip"))]
mod protocol_page;
#[cfg(all(unix, feature = "chip"))]
mod robustness;
mod stand;
#[cfg(unix)]
mod terminal;
mod validate;
#[cfg(all(unix, feature = "chip"))]
mod virtual_board;

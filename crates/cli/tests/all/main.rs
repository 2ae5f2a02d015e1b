//! The program as a person runs it. One binary, so that tests that wait for a terminal run beside those that compute.

#[cfg(unix)]
mod board;
#[path = "../common/motor.rs"]
mod motor;

mod batch;
mod convert;
mod link;
mod pages;
mod program;
#[cfg(all(unix, feature = "chip"))]
mod protocol_page;
#[cfg(all(unix, feature = "chip"))]
mod robustness;
#[cfg(unix)]
mod terminal;
#[cfg(all(unix, feature = "chip"))]
mod virtual_board;

//! motorbench on the host.
//!
//! | module | what it is |
//! |---|---|
//! | [`recording`], [`rig`] | what was measured, and on what |
//! | [`keys`] | mistyped keys of files: what was meant, and where |
//! | [`convert`] | recordings to and from the formats of other tools |
//! | [`motor`], [`linear`] | the linear motor: constants, transfer functions, responses, margins, discrete forms |
//! | [`catalogue`] | the effects that the linear motor lacks, one file each |
//! | [`model`], [`free_run`] | the motor with effects, as a file and simulated over a recording |
//! | [`dataset`], [`identify`] | recordings made ready; constants fitted to them |
//! | [`diagnose`], [`steady_state`] | what a simulation gets wrong, by what cause, and what naming it gains |
//! | [`stand`] | losses, condition and efficiency of a motor from a table of steady states |
//! | [`design`] | controllers for a motor: PID and LQR, checked on the fixed-point core |
//! | [`compare`] | two recordings on common times, the delay taken off |
//! | [`live`] | samples to PlotJuggler and Teleplot while they come |
//! | [`scenario`], [`figures`] | the core in closed loop on this computer, and its figures of merit |
//! | [`board`], [`thesis`] | a board, real or simulated; identification, design and both loops on it as one experiment |
//! | [`link`] | a board on a serial port: console, telemetry, recording |
//! | [`tune`] | the tuning console in the terminal |
//! | [`plant`] | the motor and its surroundings, for closed loops and for the simulated chip |
//! | [`panels`], [`picture`] | plots over time, one under the other; plots as SVG and PNG files |
//! | [`terminal_text`], [`web_page`] | texts for a person at a terminal; pages for a browser |
//! | [`text_file`] | text files that a person names |
//! | [`commands`] | the program `motorbench` |
//! | `chip` | the firmware on a simulated ATmega328P (feature `chip`) |

pub mod board;
pub mod catalogue;
#[cfg(feature = "chip")]
pub mod chip;
pub mod commands;
pub mod compare;
pub mod convert;
pub mod dataset;
pub mod delimited;
pub mod design;
pub mod diagnose;
pub mod evidence;
pub mod figures;
pub mod free_run;
pub mod identify;
pub mod keys;
pub mod linear;
pub mod link;
pub mod live;
pub mod model;
pub mod motor;
pub mod panels;
pub mod picture;
pub mod plant;
pub mod recording;
pub mod rig;
pub mod scenario;
pub mod stand;
pub mod steady_state;
pub mod telemetry;
pub mod terminal_plot;
pub mod terminal_text;
pub mod text_file;
pub mod thesis;
pub mod tune;
pub mod web_page;

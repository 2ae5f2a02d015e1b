//! motorbench on the host.
//!
//! | module | what it is |
//! |---|---|
//! | [`design`] | controllers for a motor: PID and LQR, checked on the fixed-point core |
//! | [`linear`] | linear models: transfer functions, responses, margins, discrete forms, Riccati equation |
//! | [`motor`] | the five constants of the linear motor, in SI units |
//! | [`plant`] | the motor and its surroundings, simulated |
//! | [`recording`], [`rig`] | what was measured, and on what |
//! | [`commands`] | the program `motorbench` |
//! | `chip` | the firmware on a simulated ATmega328P (feature `chip`) |

pub mod catalogue;
#[cfg(feature = "chip")]
pub mod chip;
pub mod commands;
pub mod design;
pub mod linear;
pub mod dataset;
pub mod diagnose;
pub mod free_run;
pub mod identify;
pub mod model;
pub mod motor;
pub mod plant;
pub mod recording;
pub mod rig;
pub mod steady_state;

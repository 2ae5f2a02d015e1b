//! The DC motor: its constants, the linear systems they make, the laws of the effects that a linear motor lacks, and the
//! extended model with its one step.

pub mod between_rows;
pub mod catalogue;
pub mod closed_form;
mod extended;
pub mod linear;
mod linear_step;
pub mod motor;
pub mod pwm_period;

pub use extended::{Model, ModelError, Term};
pub use linear_step::{LinearStep, Reached, SAME_LENGTH_S, oppose_motion};

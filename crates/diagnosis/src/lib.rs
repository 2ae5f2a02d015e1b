//! What a simulation of the motor gets wrong, by what physical cause, and what naming it gains.

pub mod compare;
pub mod dataset;
pub mod diagnose;
pub mod free_run;
pub mod identify;
pub mod steady_state;

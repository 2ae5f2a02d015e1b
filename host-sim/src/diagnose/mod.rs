//! Diagnosis.
pub mod judge;
pub mod select;

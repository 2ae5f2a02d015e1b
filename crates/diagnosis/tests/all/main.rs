//! The diagnosis on benches with a hidden effect, on published tables and on real recordings.

mod axis;
mod determined;
mod hidden_effects;
mod outcome_schema;
mod paper;
mod real_recordings;
mod scoring;
mod steady_tables;

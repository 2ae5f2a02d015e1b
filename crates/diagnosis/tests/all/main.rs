//! The diagnosis on benches with a hidden effect, on published tables and on real recordings.

mod axis;
mod benches;
mod determined;
mod fan;
mod fresh_draw;
mod hidden_effects;
mod hosts_and_bridges;
mod kinds_of_files;
mod lost_counts;
mod outcome_schema;
mod paper;
mod real_recordings;
mod recordings;
mod schema;
mod scoring;
mod single_step;
mod slow_pwm;
mod slow_ramp;
mod steady_tables;
mod unknown_effects;

use std::time::{SystemTime, UNIX_EPOCH};

/// Another one in each run, or that of `MOTORBENCH_SEED`, to repeat a run that failed.
fn fresh_seed() -> u64 {
    let of_the_time = || SystemTime::now().duration_since(UNIX_EPOCH).expect("it is after 1970").as_nanos() as u64;
    let seed = match std::env::var("MOTORBENCH_SEED") {
        Ok(given) => given.parse().expect("MOTORBENCH_SEED is a whole number"),
        Err(_) => of_the_time(),
    };
    println!("seed {seed}");
    seed
}

/// What is left of a value after a loss, which takes at most all of it.
fn less(value: f64, loss: f64) -> f64 {
    value.signum() * (value.abs() - loss).max(0.0)
}

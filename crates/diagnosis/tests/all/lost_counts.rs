//! Edges of the encoder that are lost, and a shaft that really stands.

use crate::benches::{assert_found, in_the_suite, with_cells};
use crate::scoring::{diagnosed, named};
use hidden_effects::{Channels, Effect, Recipe, Trial, draw};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Each edge is lost with the same probability at all speeds. The mean motion fits another motor, but the losses
/// scatter. The counts of the generator are thinned out here.
#[test]
fn counts_may_be_lost_at_random_at_all_speeds() {
    for (seed, share) in in_the_suite([(1, 0.02), (2, 0.1), (3, 0.25)]) {
        let trial = draw(seed, &recipe_of_counts());
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let thinned = with_counts(&trial.csv, |_| !random.random_bool(share));
        let outcome = diagnosed(&Trial { csv: thinned, ..trial.clone() }).outcome;
        let causes: Vec<&str> = outcome.causes.iter().map(|cause| &*cause.effect).collect();
        assert_eq!(causes, ["missed_counts"], "seed {seed}");
        let found = outcome.causes[0].parameters["lost_share"];
        let [low, high] = found.ci95.unwrap();
        // 1.5 times the interval of 95 % is missed once in 300 times.
        assert!(
            (found.value - share).abs() < 0.75 * (high - low) && high - low < 0.4 * share,
            "seed {seed}: {found:?}"
        );
        let torque_constant = outcome.parameters["torque_constant_Nm_per_A"];
        let off = torque_constant.value / trial.truth.motor.torque_constant_nm_per_a - 1.0;
        assert!(off.abs() < 0.1 * share, "seed {seed}: {off}");
    }
    // No loss is reported without losses.
    assert_found(4, &recipe_of_counts());
}

fn recipe_of_counts() -> Recipe {
    Recipe { channels: Channels::DutyCountsCurrent, ..Recipe::of(&[]) }
}

/// A recording with the counts for which `is_kept` is true in their row.
fn with_counts(csv: &str, mut is_kept: impl FnMut(usize) -> bool) -> String {
    let (mut last, mut counted) = (0_i64, 0_i64);
    with_cells(csv, "counts", |row, cell| {
        let counts: i64 = cell.parse().unwrap();
        let passed = counts - std::mem::replace(&mut last, counts);
        let kept = (0..passed.abs()).filter(|_| is_kept(row)).count();
        counted += passed.signum() * kept as i64;
        counted.to_string()
    })
}

/// Bursts of a few rows that the counts do not show, with and without a current: the residual shows them.
#[test]
fn counts_may_be_lost_in_short_bursts() {
    for (seed, has_current) in in_the_suite([(11, true), (12, false), (13, true), (14, false)]) {
        let trial = draw(seed, &recipe_of_counts());
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let bursts: Vec<usize> = (0..20).map(|burst| 800 * burst + random.random_range(0..800)).collect();
        let is_lost = |row: usize| bursts.iter().any(|burst| (*burst..burst + 4).contains(&row));
        let mut csv = with_counts(&trial.csv, |row| !is_lost(row));
        if !has_current {
            csv = with_cells(&csv, "i_A", |_, _| String::new());
        }
        let outcome = diagnosed(&Trial { csv, ..trial.clone() }).outcome;
        let causes: Vec<&str> = outcome.causes.iter().map(|cause| &*cause.effect).collect();
        assert_eq!(causes, ["missed_counts"], "seed {seed}");
        let stop_s = outcome.causes[0].parameters["stop_s"].value;
        assert!((0.002..0.007).contains(&stop_s), "seed {seed}: {stop_s}");
    }
}

/// A gripped shaft really stands, which its speed and its current show.
#[test]
fn a_gripped_shaft_is_not_reported_as_lost_counts() {
    for (seed, has_current) in in_the_suite([(21, true), (22, false), (23, true), (24, false)]) {
        let recipe = Recipe { channels: Channels::DutyCountsCurrent, ..Recipe::of(&[Effect::OutsideGrip]) };
        let mut trial = draw(seed, &recipe);
        if !has_current {
            trial.csv = with_cells(&trial.csv, "i_A", |_, _| String::new());
        }
        let outcome = diagnosed(&trial).outcome;
        assert_eq!(named(&outcome, &[]), [""; 0], "seed {seed}");
    }
}

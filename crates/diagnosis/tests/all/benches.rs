//! Benches with a committed seed, and what is asserted of them in many tests.

use crate::scoring::{diagnosed, hidden, named};
use hidden_effects::{Channels, Effect, Recipe, Trial, draw};
use motorbench_diagnosis::diagnose::Diagnosis;
use std::sync::OnceLock;

/// `scripts/trials committed` takes all benches.
fn all_are_asked_for() -> bool {
    std::env::var_os("MOTORBENCH_ALL_BENCHES").is_some()
}

/// Of several benches of a kind the first stands in the suite.
pub fn in_the_suite<Bench, const COUNT: usize>(benches: [Bench; COUNT]) -> impl Iterator<Item = Bench> {
    benches.into_iter().take(if all_are_asked_for() { COUNT } else { 1 })
}

/// Every `nth` of many benches, others with another seed.
pub fn in_turn<Bench>(seed: u64, nth: usize, benches: impl Iterator<Item = Bench>) -> impl Iterator<Item = Bench> {
    let (skipped, step) = if all_are_asked_for() { (0, 1) } else { (seed as usize % nth, nth) };
    benches.skip(skipped).step_by(step)
}

/// Half as long as usual: where the length is not what is tested.
pub fn short(recipe: Recipe) -> Recipe {
    Recipe { duration_s: 10.0, ..recipe }
}

/// A recording with other cells in a column.
pub fn with_cells(csv: &str, column: &str, mut cell: impl FnMut(usize, &str) -> String) -> String {
    let (head, rows) = csv.split_once('\n').unwrap();
    let place = head.split(',').position(|name| name == column).unwrap();
    let line = |(row, line): (usize, &str)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[place] = cell(row, &cells[place]);
        format!("{}\n", cells.join(","))
    };
    format!("{head}\n{}", rows.lines().enumerate().map(line).collect::<String>())
}

/// What was hidden is named, and nothing else.
pub fn assert_found(seed: u64, recipe: &Recipe) -> Diagnosis {
    let trial = draw(seed, recipe);
    let diagnosis = diagnosed(&trial);
    assert_is_named(&diagnosis, &trial, &format!("seed {seed}"));
    diagnosis
}

pub fn assert_is_named(diagnosis: &Diagnosis, trial: &Trial, bench: &str) {
    let hidden = hidden(trial);
    assert_eq!(named(&diagnosis.outcome, &hidden), hidden, "{bench}, {:?}", trial.truth);
}

/// A bench that several tests look at.
pub struct Bench {
    pub trial: Trial,
    pub diagnosis: Diagnosis,
}

impl Bench {
    fn new(seed: u64, recipe: &Recipe) -> Self {
        let trial = draw(seed, recipe);
        Self { diagnosis: diagnosed(&trial), trial }
    }
}

/// Functions that diagnose a bench once.
macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident: $seed:literal, $recipe:expr;)*) => {
        $(
            $(#[$doc])*
            pub fn $name() -> &'static Bench {
                static BENCH: OnceLock<Bench> = OnceLock::new();
                BENCH.get_or_init(|| Bench::new($seed, &$recipe))
            }
        )*
    };
}

shared! {
    /// Nothing is hidden.
    clean: 1, short(Recipe::of(&[]));
    /// Coulomb friction, with every column.
    rubbing: 2, short(Recipe::of(&[Effect::CoulombFriction]));
    /// The same effect, without a current.
    rubbing_without_current: 4,
        short(Recipe { channels: Channels::VoltageSpeed, ..Recipe::of(&[Effect::CoulombFriction]) });
    /// Both dry effects, behind a duty and counts.
    dry: 3, Recipe {
        channels: Channels::DutyCountsCurrent,
        ..Recipe::of(&[Effect::CoulombFriction, Effect::VoltageDrop])
    };
    /// Something that the catalogue does not know.
    shaken: 2000, short(Recipe::of(&[Effect::OutsideShaker]));
    /// The same on a rig with friction and drop.
    shaken_rig: 14, short(Recipe::of(&[Effect::OutsideShaker]).on_real_rig().with_random_strengths(14));
}

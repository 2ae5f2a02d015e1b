//! Thousands of trials of the diagnosis:
//! `cargo run --release -p host-sim --example trials -- KIND COUNT [FIRST_SEED]`
//!
//! KIND is `clean`, `single`, `real` (one effect on a rig with Coulomb friction and a bridge drop), `pairs`, `triples`,
//! `outside`, `outside-real`, `power` (an effect at ten strengths) or the identifier of an effect. Prints the rate of exact
//! names, what was named instead, how often the 95 % intervals hold the truth, and how far the errors are above the noise.

#[path = "../tests/scoring/mod.rs"]
mod scoring;

use hidden_effects::{Effect, Recipe, Trial, draw, random_effects};
use host_sim::diagnose::outcome::Outcome;
use scoring::{diagnosed, hidden, named};
use std::collections::BTreeMap;
use std::time::Instant;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [kind, count, rest @ ..] = &arguments[..] else {
        eprintln!("usage: trials KIND COUNT [FIRST_SEED]");
        std::process::exit(2);
    };
    let count: u64 = count.parse().expect("COUNT is a number");
    let first: u64 = rest.first().map_or(1, |text| text.parse().expect("FIRST_SEED is a number"));
    if kind == "power" {
        return power(count, first);
    }
    let mut score = Score::default();
    for seed in first..first + count {
        score.add(seed, &draw(seed, &recipe(kind, seed)));
    }
    score.print(kind);
}

/// The recipe of one trial.
fn recipe(kind: &str, seed: u64) -> Recipe {
    let turn = |effects: &[Effect]| effects[(seed % effects.len() as u64) as usize];
    let recipe = match kind {
        "clean" => Recipe::of(&[]),
        "single" => Recipe::of(&[turn(&Effect::CATALOGUE)]),
        "real" => Recipe::of(&random_effects(seed, 1, true)).on_real_rig(),
        "pairs" => Recipe::of(&random_effects(seed, 2, false)),
        "triples" => Recipe::of(&random_effects(seed, 3, false)),
        "outside" => Recipe::of(&[turn(&Effect::OUTSIDE)]),
        "outside-real" => Recipe::of(&[turn(&Effect::OUTSIDE)]).on_real_rig(),
        id => {
            let all = Effect::CATALOGUE.into_iter().chain(Effect::OUTSIDE);
            Recipe::of(&[all.into_iter().find(|effect| effect.id() == id).expect("KIND is known")])
        }
    };
    recipe.with_random_strengths(seed)
}

#[derive(Default)]
struct Score {
    trials: usize,
    exact: usize,
    wrong_name: usize,
    covered: usize,
    intervals: usize,
    /// Greatest error over noise floor of each trial.
    excess: Vec<f64>,
    /// What was named too much or too little, and how often.
    confusions: BTreeMap<String, usize>,
    seconds: f64,
}

impl Score {
    fn add(&mut self, seed: u64, trial: &Trial) {
        let start = Instant::now();
        let outcome = diagnosed(trial).outcome;
        self.seconds += start.elapsed().as_secs_f64();
        let hidden = hidden(trial);
        let named = named(&outcome, &hidden);
        self.trials += 1;
        self.exact += usize::from(named == hidden);
        let extra: Vec<&str> = named.iter().map(String::as_str).filter(|id| !hidden.contains(id)).collect();
        let missed: Vec<&str> = hidden.iter().copied().filter(|id| !named.iter().any(|name| name == id)).collect();
        self.wrong_name += usize::from(!extra.is_empty());
        if named != hidden {
            let what =
                format!("hidden {}: missed [{}], extra [{}]", hidden.join("+"), missed.join(" "), extra.join(" "));
            println!("seed {seed}: {what}");
            *self.confusions.entry(what).or_default() += 1;
        }
        self.cover(trial, &outcome);
        let floor = &outcome.fit["noise_floor"];
        let excess = outcome.fit["extended"].iter().map(|(channel, fit)| fit.rmse / floor[channel].rmse);
        self.excess.push(excess.fold(0.0, f64::max));
    }

    /// Counts the intervals that hold the truth, of what was named.
    fn cover(&mut self, trial: &Trial, outcome: &Outcome) {
        let motor = trial.truth.motor;
        let mut check = |truth: f64, ci95: [f64; 2]| {
            self.intervals += 1;
            self.covered += usize::from((ci95[0]..=ci95[1]).contains(&truth));
        };
        check(motor.resistance_ohm, outcome.parameters["resistance_ohm"].ci95);
        check(motor.torque_constant_nm_per_a, outcome.parameters["torque_constant_Nm_per_A"].ci95);
        check(motor.inertia_kg_m2, outcome.parameters["inertia_kg_m2"].ci95);
        for (effect, constants) in &trial.truth.effects {
            let Some(cause) = outcome.causes.iter().find(|cause| cause.effect == effect.id()) else { continue };
            for (name, truth) in constants {
                if let Some(ci95) = cause.parameters[*name].ci95 {
                    check(*truth, ci95);
                }
            }
        }
    }

    fn print(mut self, kind: &str) {
        self.excess.sort_unstable_by(f64::total_cmp);
        let share = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
        println!(
            "| {kind} | {} trials | exact {:.1} % | a wrong name {:.1} % | truth within 95 % intervals {:.1} % | error over noise floor: median {:.3}, nine tenths below {:.3} | {:.2} s a trial |",
            self.trials,
            share(self.exact, self.trials),
            share(self.wrong_name, self.trials),
            share(self.covered, self.intervals),
            self.excess[self.excess.len() / 2],
            self.excess[self.excess.len() * 9 / 10],
            self.seconds / self.trials as f64,
        );
    }
}

/// How often each effect is found at each tenth of its range of strengths, alone.
fn power(count: u64, first: u64) {
    println!("| effect | strength 0 | 0.25 | 0.5 | 0.75 | 1 |\n|---|---|---|---|---|---|");
    for effect in Effect::CATALOGUE {
        print!("| {} |", effect.id());
        for strength in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let found = (first..first + count).filter(|seed| {
                let mut recipe = Recipe::of(&[effect]);
                recipe.effects[0].1 = strength;
                let trial = draw(*seed, &recipe);
                let hidden = hidden(&trial);
                named(&diagnosed(&trial).outcome, &hidden).iter().any(|id| id == effect.id())
            });
            print!(" {}/{count} |", found.count());
        }
        println!();
    }
}

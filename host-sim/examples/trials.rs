//! Trials of the diagnosis on benches with a hidden effect:
//! `cargo run --release -p host-sim --example trials -- KIND COUNT [FIRST_SEED]`
//!
//! KIND is one of [`KINDS`], the identifier of an effect, `power` (every effect from its greatest strength down to where it
//! is no longer found) or `report`: all kinds with COUNT trials each, and the power curves, written to `docs/trials.md`.

#[path = "../tests/scoring/mod.rs"]
mod scoring;

use hidden_effects::{Channels, Effect, Excitation, Recipe, Trial, draw, random_effects};
use host_sim::diagnose::outcome::Outcome;
use scoring::{diagnosed, hidden, named};
use statrs::distribution::{Beta, ContinuousCDF};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Instant;

/// Kinds of trials, and what each is.
const KINDS: [(&str, &str); 12] = [
    ("clean", "nothing hidden"),
    ("single", "each effect alone"),
    ("real", "one effect on a rig that has Coulomb friction and a bridge drop anyway"),
    ("pairs", "two effects"),
    ("triples", "three effects"),
    ("outside", "a cause that the catalogue does not know"),
    ("outside-real", "the same on the rig with friction and bridge drop"),
    ("voltage-speed", "one effect, voltage and speed alone recorded"),
    ("counts", "one effect, duty, counts and current recorded"),
    ("levels", "one effect, driven by random levels only"),
    ("closed-loop", "one effect, recorded in a closed speed loop"),
    ("slow", "one effect on the rig with friction and bridge drop, recorded at 200 Hz"),
];
/// Of the trials of a kind, so many are drawn for each point of the power curves.
const POWER_SHARE: u64 = 4;
/// Strengths of the power curves: 0 to 1 is the range that matters on a bench, each unit below it a tenth.
const STRENGTHS: [f64; 6] = [-1.5, -1.0, -0.5, -0.25, 0.0, 1.0];
const REPORT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/trials.md");

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize| arguments.get(index).and_then(|text| text.parse::<u64>().ok());
    let (Some(kind), Some(count)) = (arguments.first(), number(1)) else {
        eprintln!("usage: trials KIND COUNT [FIRST_SEED]; KIND: an effect, power, report, or one of");
        for (kind, what) in KINDS {
            eprintln!("  {kind:14} {what}");
        }
        std::process::exit(2);
    };
    let first = number(2).unwrap_or(1);
    match kind.as_str() {
        "power" => print!("{}", power(count, first)),
        "report" => report(count, first),
        kind => {
            let score = Score::of(kind, count, first);
            print!("{HEAD}{}\n{ERRORS}{}", score.line(kind), errors(&[score]));
        }
    }
}

/// The recipe of one trial.
fn recipe(kind: &str, seed: u64) -> Recipe {
    let turn = |effects: &[Effect]| effects[(seed % effects.len() as u64) as usize];
    let single = || Recipe::of(&[turn(&Effect::CATALOGUE)]);
    let of_the_current = [Effect::CurrentOffset, Effect::CurrentLag, Effect::CurrentClipping];
    let without_current: Vec<Effect> = Effect::CATALOGUE.into_iter().filter(|e| !of_the_current.contains(e)).collect();
    let real = || Recipe::of(&random_effects(seed, 1, true)).on_real_rig();
    let recipe = match kind {
        "clean" => Recipe::of(&[]),
        "single" => single(),
        "real" => real(),
        "pairs" => Recipe::of(&random_effects(seed, 2, false)),
        "triples" => Recipe::of(&random_effects(seed, 3, false)),
        "outside" => Recipe::of(&[turn(&Effect::OUTSIDE)]),
        "outside-real" => Recipe::of(&[turn(&Effect::OUTSIDE)]).on_real_rig(),
        "voltage-speed" => Recipe { channels: Channels::VoltageSpeed, ..Recipe::of(&[turn(&without_current)]) },
        "counts" => Recipe { channels: Channels::DutyCountsCurrent, ..single() },
        "levels" => Recipe { excitation: Excitation::Levels, ..single() },
        "closed-loop" => Recipe { excitation: Excitation::ClosedLoop, ..single() },
        "slow" => Recipe { rate_hz: 200.0, ..real() },
        id => {
            let all = Effect::CATALOGUE.into_iter().chain(Effect::OUTSIDE);
            Recipe::of(&[all.into_iter().find(|effect| effect.id() == id).expect("KIND is known")])
        }
    };
    recipe.with_random_strengths(seed)
}

/// How often an effect was hidden and found, and what was said instead or besides.
#[derive(Default)]
struct Row {
    hidden: usize,
    found: usize,
    /// Names that nothing hidden stands for, in trials with this effect.
    besides: BTreeMap<String, usize>,
}

/// Errors of a constant: relative, and whether its interval held the truth.
#[derive(Default)]
struct Errors {
    relative: Vec<f64>,
    covered: usize,
}

#[derive(Default)]
struct Score {
    trials: usize,
    exact: usize,
    wrong_name: usize,
    /// Greatest error over noise floor of each trial.
    excess: Vec<f64>,
    rows: BTreeMap<&'static str, Row>,
    constants: BTreeMap<String, Errors>,
    /// What went wrong, with its seed.
    failures: Vec<String>,
    seconds: f64,
}

const HEAD: &str = "| kind | trials | exact, 95 % interval | a wrong name | truth within its 95 % interval | error over noise floor: median, nine tenths below | s a trial |\n|---|---|---|---|---|---|---|\n";

const ERRORS: &str =
    "| constant | times | median error | nine tenths below | truth within its 95 % interval |\n|---|---|---|---|---|\n";

impl Score {
    fn of(kind: &str, count: u64, first: u64) -> Self {
        let mut score = Self::default();
        for seed in first..first + count {
            score.add(seed, &draw(seed, &recipe(kind, seed)));
        }
        score
    }

    fn add(&mut self, seed: u64, trial: &Trial) {
        let start = Instant::now();
        let outcome = diagnosed(trial).outcome;
        self.seconds += start.elapsed().as_secs_f64();
        let hidden = hidden(trial);
        let named = named(&outcome, &hidden);
        let extra: Vec<&str> = named.iter().map(String::as_str).filter(|id| !hidden.contains(id)).collect();
        let missed: Vec<&str> = hidden.iter().copied().filter(|id| !named.iter().any(|name| name == id)).collect();
        self.trials += 1;
        self.exact += usize::from(named == hidden);
        self.wrong_name += usize::from(!extra.is_empty());
        for (effect, _) in &trial.truth.effects {
            let row = self.rows.entry(effect.id()).or_default();
            row.hidden += 1;
            row.found += usize::from(named.iter().any(|name| name == effect.id()));
            for id in &extra {
                *row.besides.entry((*id).to_string()).or_default() += 1;
            }
        }
        if named != hidden {
            let list = |names: &[&str]| if names.is_empty() { "-".to_string() } else { names.join(" + ") };
            self.failures.push(format!(
                "seed {seed}: hidden {}, missed {}, too much {}",
                list(&hidden),
                list(&missed),
                list(&extra)
            ));
            eprintln!("{}", self.failures[self.failures.len() - 1]);
        }
        self.cover(trial, &outcome);
        let floor = &outcome.fit["noise_floor"];
        let excess = outcome.fit["extended"].iter().map(|(channel, fit)| fit.rmse / floor[channel].rmse);
        self.excess.push(excess.fold(0.0, f64::max));
    }

    /// Errors of the constants of what was named, and of the motor's where nothing remains unexplained.
    fn cover(&mut self, trial: &Trial, outcome: &Outcome) {
        let motor = trial.truth.motor;
        let mut check = |name: String, truth: f64, value: f64, ci95: [f64; 2]| {
            let errors = self.constants.entry(name).or_default();
            errors.relative.push((value / truth - 1.0).abs());
            errors.covered += usize::from((ci95[0]..=ci95[1]).contains(&truth));
        };
        if outcome.unexplained.is_none() {
            for (name, truth) in [
                ("resistance_ohm", motor.resistance_ohm),
                ("torque_constant_Nm_per_A", motor.torque_constant_nm_per_a),
                ("inertia_kg_m2", motor.inertia_kg_m2),
            ] {
                let found = outcome.parameters[name];
                check(format!("motor {name}"), truth, found.value, found.ci95);
            }
        }
        for (effect, constants) in &trial.truth.effects {
            let Some(cause) = outcome.causes.iter().find(|cause| cause.effect == effect.id()) else { continue };
            for (name, truth) in constants {
                let found = &cause.parameters[*name];
                if let Some(ci95) = found.ci95 {
                    check(format!("{} {name}", effect.id()), *truth, found.value, ci95);
                }
            }
        }
    }

    fn line(&self, kind: &str) -> String {
        let mut excess = self.excess.clone();
        excess.sort_unstable_by(f64::total_cmp);
        let (low, high) = interval(self.exact, self.trials);
        let covered: usize = self.constants.values().map(|errors| errors.covered).sum();
        let intervals: usize = self.constants.values().map(|errors| errors.relative.len()).sum();
        format!(
            "| {kind} | {} | {:.1} % [{low:.1}, {high:.1}] | {:.1} % | {} | {:.3}, {:.3} | {:.2} |\n",
            self.trials,
            share(self.exact, self.trials),
            share(self.wrong_name, self.trials),
            if intervals > 0 { format!("{:.1} %", share(covered, intervals)) } else { "-".into() },
            excess[excess.len() / 2],
            excess[excess.len() * 9 / 10],
            self.seconds / self.trials as f64,
        )
    }
}

fn share(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

/// 95 % interval of a rate in percent (Clopper and Pearson, Biometrika 26 (1934)).
fn interval(part: usize, whole: usize) -> (f64, f64) {
    let (hits, misses) = (part as f64, (whole - part) as f64);
    let quantile = |a: f64, b: f64, p: f64| 100.0 * Beta::new(a, b).expect("both are positive").inverse_cdf(p);
    let low = if part == 0 { 0.0 } else { quantile(hits, misses + 1.0, 0.025) };
    let high = if part == whole { 100.0 } else { quantile(hits + 1.0, misses, 0.975) };
    (low, high)
}

/// Everything, into `docs/trials.md`.
fn report(count: u64, first: u64) {
    let scores = KINDS.map(|(kind, _)| {
        let score = Score::of(kind, count, first);
        eprint!("{}", score.line(kind));
        score
    });
    let mut text = format!(
        "# Trials of the diagnosis\n\nWritten by `cargo run --release -p host-sim --example trials -- report {count} {first}`: {count} benches of each \
         kind, seeds from {first}, strengths at random in the range that matters on a bench. *Exact*: everything that was hidden is \
         named and nothing else; for causes outside the catalogue: no name. A name counts when it is the hidden one, or when the \
         report itself says that it cannot be told from it.\n\n{HEAD}"
    );
    for ((kind, what), score) in KINDS.iter().zip(&scores) {
        text += &score.line(&format!("{kind}: {what}"));
    }
    text += "\n## What was named instead\nOver all kinds in which the effect was hidden.\n\n| hidden | times | found | wrong names in the same trials |\n|---|---|---|---|\n";
    text += &confusion(&scores);
    text += "\n## Errors of the constants\nKinds with every column recorded.\n\n";
    text += ERRORS;
    text += &errors(&scores[..7]);
    text += "\n## Power\nEach effect alone, at strengths from a thirtieth of the weakest that matters up to the strongest.\n\n";
    text += &power((count / POWER_SHARE).max(4), first);
    text += "\n## Every trial that was not exact\n";
    for ((kind, _), score) in KINDS.iter().zip(&scores) {
        for failure in &score.failures {
            let _ = writeln!(text, "- {kind}, {failure}");
        }
    }
    std::fs::write(REPORT, text).unwrap_or_else(|error| panic!("{REPORT}: {error}"));
}

fn confusion(scores: &[Score]) -> String {
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    for (id, row) in scores.iter().flat_map(|score| &score.rows) {
        let sum = rows.entry(id).or_default();
        sum.hidden += row.hidden;
        sum.found += row.found;
        for (name, times) in &row.besides {
            *sum.besides.entry(name.clone()).or_default() += times;
        }
    }
    let mut text = String::new();
    for (id, row) in rows {
        let found = if id.starts_with("outside") {
            "(no name)".into()
        } else {
            format!("{:.1} %", share(row.found, row.hidden))
        };
        let besides: Vec<String> = row.besides.iter().map(|(name, times)| format!("{name} {times}")).collect();
        let _ = writeln!(text, "| {id} | {} | {found} | {} |", row.hidden, besides.join(", "));
    }
    text
}

fn errors(scores: &[Score]) -> String {
    let mut all: BTreeMap<&str, Errors> = BTreeMap::new();
    for (name, errors) in scores.iter().flat_map(|score| &score.constants) {
        let sum = all.entry(name).or_default();
        sum.relative.extend(&errors.relative);
        sum.covered += errors.covered;
    }
    let mut text = String::new();
    for (name, mut errors) in all {
        errors.relative.sort_unstable_by(f64::total_cmp);
        let times = errors.relative.len();
        let percent = |index: usize| 100.0 * errors.relative[index];
        let _ = writeln!(
            text,
            "| {name} | {times} | {:.2} % | {:.2} % | {:.0} % |",
            percent(times / 2),
            percent(times * 9 / 10),
            share(errors.covered, times)
        );
    }
    text
}

/// How often each effect is found at each strength, alone, and where it is found half the time and nine times in ten.
fn power(count: u64, first: u64) -> String {
    let weakest =
        |strength: f64| if strength > 0.0 { "strongest".into() } else { format!("x {:.2}", 10_f64.powf(strength)) };
    let mut text = "| effect | found half the time at | nine times in ten at |".to_string();
    for strength in STRENGTHS {
        let _ = write!(text, " {} |", weakest(strength));
    }
    let _ = writeln!(text, "\n|---|---|---|{}", "---|".repeat(STRENGTHS.len()));
    for effect in Effect::CATALOGUE.into_iter().filter(|effect| effect.has_strength()) {
        eprintln!("power of {}", effect.id());
        let found = STRENGTHS.map(|strength| found_alone(effect, strength, count, first));
        let _ = write!(text, "| {} | {} | {} |", effect.id(), reaches(&found, count, 0.5), reaches(&found, count, 0.9));
        for times in found {
            let _ = write!(text, " {times}/{count} |");
        }
        text += "\n";
    }
    text
}

fn found_alone(effect: Effect, strength: f64, count: u64, first: u64) -> u64 {
    (first..first + count)
        .filter(|seed| {
            let mut recipe = Recipe::of(&[effect]);
            recipe.effects[0].1 = strength;
            let trial = draw(*seed, &recipe);
            named(&diagnosed(&trial).outcome, &hidden(&trial)).iter().any(|id| id == effect.id())
        })
        .count() as u64
}

/// The strength, as a multiple of the weakest that matters, from which on at least `rate` are found; between two
/// strengths by straight line.
fn reaches(found: &[u64], count: u64, rate: f64) -> String {
    let rates: Vec<f64> = found.iter().map(|times| *times as f64 / count as f64).collect();
    let Some(last_below) = rates.iter().rposition(|found| *found < rate) else { return "below x 0.03".into() };
    if last_below + 1 == rates.len() {
        return "never".into();
    }
    let part = (rate - rates[last_below]) / (rates[last_below + 1] - rates[last_below]);
    let strength = STRENGTHS[last_below] + part * (STRENGTHS[last_below + 1] - STRENGTHS[last_below]);
    if strength > 0.0 { "above the weakest".into() } else { format!("x {:.2}", 10_f64.powf(strength)) }
}

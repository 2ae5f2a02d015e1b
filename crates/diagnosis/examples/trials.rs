//! Trials of the diagnosis on benches with a hidden effect:
//! `scripts/trials KIND COUNT [FIRST_SEED]`
//!
//! KIND is one of [`KINDS`], or the identifier of an effect. `power` takes every effect from its greatest strength down to
//! where it is no longer found. `report` takes all kinds with COUNT trials each, and the power curves. It writes
//! `docs/explanation/trials.md`.

#[path = "../tests/all/scoring/mod.rs"]
mod scoring;

use hidden_effects::{Effect, Recipe, Trial, draw};
use motorbench_diagnosis::diagnose::outcome::{Cause, Estimate, Outcome};
use motorbench_model::catalogue::effect;
use rayon::prelude::*;
use scoring::{diagnosed, effect_of, hidden, named, recipe};
use serde::{Deserialize, Serialize};
use statrs::distribution::{Beta, ContinuousCDF};
use std::collections::BTreeMap;
use std::collections::hash_map::DefaultHasher;
use std::fmt::Write as _;
use std::fs::File;
use std::hash::{Hash, Hasher};
use std::io::Write as _;
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;

/// What is hidden how, and what is to be reached with it.
struct Kind {
    name: &'static str,
    what: &'static str,
    goal: &'static str,
}

impl Kind {
    const fn new(name: &'static str, what: &'static str) -> Self {
        Self::with_goal(name, what, "")
    }

    const fn with_goal(name: &'static str, what: &'static str, goal: &'static str) -> Self {
        Self { name, what, goal }
    }
}

/// Kinds of trials.
const KINDS: [Kind; 24] = [
    Kind::with_goal("clean", "nothing hidden", "false alarm at most 1 %"),
    Kind::with_goal("single", "each effect alone, but for those of `further`", "98 % exact"),
    Kind::with_goal("real", "one effect on a rig that has Coulomb friction and a bridge drop anyway", "95 % exact"),
    Kind::with_goal("pairs", "two effects", "92 % exact"),
    Kind::with_goal("triples", "three effects", "85 % exact"),
    Kind::new(
        "further",
        "a speed lag, a bridge that gives less one way, a resistance that grows with the speed, a drop that differs between directions, a torque constant that varies over the angle, or two clocks that drift apart; on the rig with friction and bridge drop",
    ),
    Kind::with_goal("outside", "a cause that the catalogue does not know", "wrong name at most 3 %"),
    Kind::with_goal("outside-real", "the same on the rig with friction and bridge drop", "wrong name at most 3 %"),
    Kind::new("voltage-speed", "one effect, voltage and speed alone recorded"),
    Kind::new("counts", "one effect, duty, counts and current recorded"),
    Kind::new("levels", "one effect, driven by random levels only"),
    Kind::new(
        "binary",
        "one effect on the rig with friction and bridge drop, driven by plus or minus one voltage at random: no drop shows",
    ),
    Kind::new("closed-loop", "one effect, recorded in a closed speed loop"),
    Kind::new("slow", "one effect on the rig with friction and bridge drop, recorded at 200 Hz"),
    Kind::new("slowest", "the same at 100 Hz"),
    Kind::new(
        "fewer",
        "one effect on that rig, one row written in five or ten milliseconds though the command changes each millisecond, in a closed speed loop or at any moment",
    ),
    Kind::new(
        "scale",
        "one effect on that rig and a mistake of scale: half or a quarter of the edges counted, another supply, a current in mA or by another type of ACS712",
    ),
    Kind::new(
        "filtered",
        "one effect on the rig with friction and bridge drop, the speed read through a low-pass of a tachogenerator's or a program's",
    ),
    Kind::new("after", "one effect, each row with the command that had acted before it was read"),
    Kind::new("window", "as `real`, the speed a difference of counts over some rows"),
    Kind::new("edges", "as `real`, the speed timed by edges of a coarse encoder, not in the rig file"),
    Kind::new("timer", "one effect on that rig, the PWM of a timer of the Uno's that the rig file does not name"),
    Kind::new("burst", "one effect on that rig, each current the mean of conversions that ended with its row"),
    Kind::new(
        "darlingtons",
        "nothing else or one effect on that rig, behind a bridge of bipolar transistors that drops more of a greater current, and less in the off phase",
    ),
];
/// In the report there are so many times as many of the first kinds, every column recorded and every cause in the catalogue.
const OFTEN: u64 = 8;
const FIRST_KINDS: usize = 5;
/// Bounds of the bands of confidence.
const CONFIDENCES: [f64; 6] = [0.0, 0.4, 0.6, 0.8, 0.95, 1.01];
/// Of the trials of a kind, so many are drawn for each point of the power curves.
const POWER_SHARE: u64 = 4;
/// Strengths of the power curves: 0 to 1 is the range that matters on a bench, each unit below it a tenth.
const STRENGTHS: [f64; 6] = [-1.5, -1.0, -0.5, -0.25, 0.0, 1.0];
const REPORT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/explanation/trials.md");

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize| arguments.get(index).and_then(|text| text.parse::<u64>().ok());
    if let [command, kind, count, first, folder] = &arguments[..]
        && command == "files"
    {
        let [count, first] = [count, first].map(|text| text.parse().unwrap_or_else(|_| usage()));
        let kind = if is_kind(kind) { kind } else { usage() };
        return write_files(kind, first..first + count, Path::new(folder));
    }
    let (Some(kind), Some(count)) = (arguments.first(), number(1)) else { usage() };
    let first = number(2).unwrap_or(1);
    let done = Done::of_this_program();
    match kind.as_str() {
        "power" => print!("{}", power(&done, count, first)),
        "report" => report(&done, count, first),
        kind if !is_kind(kind) => usage(),
        kind => {
            let score = Score::of(&done, kind, count, first);
            for failure in &score.failures {
                println!("- {failure}");
            }
            print!("{HEAD}{}\n{BELIEFS}{}\n{ERRORS}{}", score.line(kind, ""), beliefs(&[&score]), errors(&[&score]));
        }
    }
}

fn is_kind(kind: &str) -> bool {
    KINDS.iter().any(|known| known.name == kind) || effect_of(kind).is_some()
}

/// Says how it is called, and ends.
fn usage() -> ! {
    eprintln!("usage: trials KIND COUNT [FIRST_SEED], or trials files KIND COUNT FIRST_SEED FOLDER");
    eprintln!("KIND: an effect, power, report, or one of");
    for Kind { name, what, .. } in KINDS {
        eprintln!("  {name:14} {what}");
    }
    std::process::exit(2);
}

/// Writes the recording and the rig file of each bench into a folder of its own, `KIND-SEED`.
fn write_files(kind: &str, seeds: Range<u64>, folder: &Path) {
    for seed in seeds {
        let trial = draw(seed, &recipe(kind, seed));
        let own = folder.join(format!("{kind}-{seed}"));
        std::fs::create_dir_all(&own).expect("the folder can be made");
        for (name, text) in [("recording.csv", &trial.csv), ("rig.toml", &trial.rig_toml)] {
            std::fs::write(own.join(name), text).expect("the disk has room");
        }
    }
}

/// What came out of one trial.
#[derive(Clone, Serialize, Deserialize)]
struct Result {
    /// What was hidden, causes outside the catalogue included.
    truth: Vec<String>,
    /// What of it the catalogue knows.
    hidden: Vec<String>,
    /// What was named, with its confidence.
    named: Vec<(String, f64)>,
    /// Of each constant its relative error and whether its interval held the truth.
    constants: Vec<Constant>,
    /// Greatest error over noise floor.
    excess: f64,
}

impl Result {
    fn of(trial: &Trial) -> Self {
        let outcome = diagnosed(trial).outcome;
        let hidden = hidden(trial);
        let named = named(&outcome, &hidden);
        let confidence = |id: &str| {
            let stands_for = |cause: &&Cause| cause.effect == id || cause.not_separable_from.contains(&id);
            outcome.causes.iter().find(stands_for).map_or(0.0, |cause| cause.confidence)
        };
        let floor = &outcome.fit["noise_floor"];
        let excess = outcome.fit["extended"].iter().map(|(channel, fit)| fit.rmse / floor[channel].rmse);
        Self {
            truth: trial.truth.effects.iter().map(|(effect, _)| effect.id().to_string()).collect(),
            hidden: hidden.iter().map(|id| (*id).to_string()).collect(),
            constants: constants(trial, &outcome),
            excess: excess.fold(0.0, f64::max),
            named: named.into_iter().map(|id| (id.clone(), confidence(&id))).collect(),
        }
    }

    fn has_named(&self, id: &str) -> bool {
        self.named.iter().any(|(name, _)| name == id)
    }

    fn extra(&self) -> Vec<&str> {
        self.named
            .iter()
            .map(|(id, _)| id.as_str())
            .filter(|id| !self.hidden.iter().any(|hidden| hidden == id))
            .collect()
    }

    fn missed(&self) -> Vec<&str> {
        self.hidden.iter().map(String::as_str).filter(|id| !self.has_named(id)).collect()
    }
}

/// A constant, its relative error, and whether its interval held the truth.
type Constant = (String, f64, bool);

/// Errors of the constants of what was named, and of the motor's where nothing remains unexplained.
fn constants(trial: &Trial, outcome: &Outcome) -> Vec<Constant> {
    let motor = trial.truth.motor;
    let of_motor = [
        ("resistance_ohm", motor.resistance_ohm),
        ("inductance_H", motor.inductance_h),
        ("torque_constant_Nm_per_A", motor.torque_constant_nm_per_a),
        ("inertia_kg_m2", motor.inertia_kg_m2),
    ];
    let is_known = outcome.unexplained.is_none();
    let shows = |name: &str| name != "resistance_ohm" || !trial.truth.bridge_resists;
    let of_motor = of_motor.into_iter().filter(|(name, _)| is_known && shows(name)).map(|(name, truth)| {
        let found = outcome.parameters[name];
        compared(format!("motor {name}"), truth, found.value, found.ci95)
    });
    let of_effects = trial.truth.effects.iter().flat_map(|(effect, truths)| {
        let cause = outcome.causes.iter().find(|cause| cause.effect == effect.id());
        cause.map(|cause| constants_of(cause, truths)).unwrap_or_default()
    });
    of_motor.chain(of_effects).collect()
}

fn compared(name: String, truth: f64, value: f64, ci95: [f64; 2]) -> Constant {
    (name, (value / truth - 1.0).abs(), (ci95[0]..=ci95[1]).contains(&truth))
}

/// Those of an effect. Which of its laws it follows is right or wrong, and the constants of another law are others.
fn constants_of(cause: &Cause, truths: &[(&'static str, f64)]) -> Vec<Constant> {
    let parameters = effect(&cause.effect).expect("it is in the catalogue").about().parameters;
    let is_choice = |name: &str| parameters.iter().any(|parameter| parameter.name == name && parameter.is_choice());
    let found = |name: &str| cause.parameters.get(name);
    let is_right = |(name, law): &(&str, f64)| found(name).map_or(0.0, |found| found.value) == *law;
    let (laws, values): (Vec<_>, Vec<_>) = truths.iter().copied().partition(|(name, _)| is_choice(name));
    let right = |law: &(&str, f64)| {
        (format!("{} by its law, {}", cause.effect, law.0), f64::from(u8::from(!is_right(law))), is_right(law))
    };
    let comparable = values.iter().filter(|_| laws.iter().all(is_right));
    let with_interval = comparable.filter_map(|(name, truth)| {
        let Estimate { value, ci95 } = *found(name)?;
        Some(compared(format!("{} {name}", cause.effect), *truth, value, ci95?))
    });
    laws.iter().map(right).chain(with_interval).collect()
}

/// Trials that this very program has done before: a report that was cut off goes on where it was.
struct Done {
    results: Mutex<BTreeMap<String, Result>>,
    file: Mutex<File>,
}

impl Done {
    fn of_this_program() -> Self {
        let program = std::env::current_exe().expect("it runs");
        let mut hasher = DefaultHasher::new();
        std::fs::read(&program).expect("it runs").hash(&mut hasher);
        let path = program.with_file_name(format!("trials-{:016x}.jsonl", hasher.finish()));
        let lines = std::fs::read_to_string(&path).unwrap_or_default();
        // A last line may be cut off.
        let results = lines.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let file = File::options().create(true).append(true).open(&path);
        let file = file.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self { results: Mutex::new(results), file: Mutex::new(file) }
    }

    /// The trials of many seeds, in their order.
    fn results(&self, what: &str, seeds: Range<u64>, recipe: impl Fn(u64) -> Recipe + Sync) -> Vec<Result> {
        let one = |seed: u64| {
            let key = format!("{what} {seed}");
            if let Some(result) = self.results.lock().expect("no trial panics").get(&key) {
                return result.clone();
            }
            let result = Result::of(&draw(seed, &recipe(seed)));
            let line = serde_json::to_string(&(&key, &result)).expect("plain data");
            writeln!(self.file.lock().expect("no trial panics"), "{line}").expect("the disk has room");
            self.results.lock().expect("no trial panics").insert(key, result.clone());
            result
        };
        seeds.into_par_iter().map(one).collect()
    }
}

/// How often an effect was hidden and found, and what was said instead or besides.
#[derive(Default)]
struct Row {
    hidden: usize,
    found: usize,
    /// Names that nothing hidden stands for, in trials with this effect.
    besides: BTreeMap<String, usize>,
}

#[derive(Default)]
struct Score {
    results: Vec<Result>,
    /// What went wrong, with its seed.
    failures: Vec<String>,
}

const HEAD: &str = "| kind | trials | exact, 95 % interval | a wrong name | goal | truth within its 95 % interval | error over noise floor: median, nine tenths below |\n|---|---|---|---|---|---|---|\n";
const ERRORS: &str =
    "| constant | times | median error | nine tenths below | truth within its 95 % interval |\n|---|---|---|---|---|\n";
const BELIEFS: &str = "| confidence | names | right |\n|---|---|---|\n";

impl Score {
    fn of(done: &Done, kind: &str, count: u64, first: u64) -> Self {
        let results = done.results(kind, first..first + count, |seed| recipe(kind, seed));
        let list = |names: &[&str]| if names.is_empty() { "-".to_string() } else { names.join(" + ") };
        let failure = |(seed, result): (u64, &Result)| {
            let (missed, extra) = (result.missed(), result.extra());
            let hidden: Vec<&str> = result.truth.iter().map(String::as_str).collect();
            (!missed.is_empty() || !extra.is_empty()).then(|| {
                format!("seed {seed}: hidden {}, missed {}, too much {}", list(&hidden), list(&missed), list(&extra))
            })
        };
        let failures = (first..).zip(&results).filter_map(failure).collect();
        Self { results, failures }
    }

    fn line(&self, kind: &str, goal: &str) -> String {
        let trials = self.results.len();
        let exact = trials - self.failures.len();
        let wrong_name = self.results.iter().filter(|result| !result.extra().is_empty()).count();
        let mut excess: Vec<f64> = self.results.iter().map(|result| result.excess).collect();
        excess.sort_unstable_by(f64::total_cmp);
        let (low, high) = interval(exact, trials);
        let constants = || self.results.iter().flat_map(|result| &result.constants);
        let (covered, intervals) = (constants().filter(|(_, _, covered)| *covered).count(), constants().count());
        format!(
            "| {kind} | {trials} | {:.1} % [{low:.1}, {high:.1}] | {:.1} % | {goal} | {} | {:.3}, {:.3} |\n",
            share(exact, trials),
            share(wrong_name, trials),
            if intervals > 0 { format!("{:.1} %", share(covered, intervals)) } else { "-".into() },
            excess[trials / 2],
            excess[trials * 9 / 10],
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

/// Everything, into `docs/explanation/trials.md`.
fn report(done: &Done, count: u64, first: u64) {
    let mut scores = Vec::new();
    for (index, Kind { name, goal, .. }) in KINDS.iter().enumerate() {
        let times = if index < FIRST_KINDS { OFTEN } else { 1 };
        let score = Score::of(done, name, times * count, first);
        eprint!("{}", score.line(name, goal));
        scores.push(score);
    }
    let all: Vec<&Score> = scores.iter().collect();
    let mut text = format!(
        "# Trials of the diagnosis\n\nThis page is written by a program; [how it was tried](how-it-was-tried.md) explains it.\n\n\
         ```sh\nscripts/trials report {count} {first}\n```\n\n\
         It draws {count} benches of each kind, and {OFTEN} times as many of the first {FIRST_KINDS}, with seeds from {first}. Strengths \
         are at random in the range that matters on a bench. When it is cut off, the command goes on where it was.\n\n\
         *Exact* means that everything that was hidden is named, and nothing else. For causes outside the catalogue it means that \
         no name is given. A name counts when it is the hidden one, or when the report itself says that it cannot be told from \
         it.\n\n{HEAD}"
    );
    for (Kind { name, what, goal }, score) in KINDS.iter().zip(&scores) {
        text += &score.line(&format!("{name}: {what}"), goal);
    }
    text += "\n## Confusion matrix: what was named instead\nOver all kinds in which the effect was hidden.\n\n| hidden | times | found | wrong names in the same trials |\n|---|---|---|---|\n";
    text += &confusion(&all);
    text += "\n## What a confidence is worth\nAll names of all kinds.\n\n";
    text += BELIEFS;
    text += &beliefs(&all);
    let _ = write!(
        text,
        "\n## Errors of the constants\nThe first {FIRST_KINDS} kinds: every column recorded, every cause in the catalogue.\n\n"
    );
    text += ERRORS;
    text += &errors(&all[..FIRST_KINDS]);
    text += "\n## Power\nEach effect alone, at strengths from a thirtieth of the weakest that matters up to the strongest.\n\n";
    text += &power(done, (count / POWER_SHARE).max(4), first);
    text += "\n## Every trial that was not exact\n";
    for (Kind { name, .. }, score) in KINDS.iter().zip(&scores) {
        for failure in &score.failures {
            let _ = writeln!(text, "- {name}, {failure}");
        }
    }
    std::fs::write(REPORT, text).unwrap_or_else(|error| panic!("{REPORT}: {error}"));
}

fn confusion(scores: &[&Score]) -> String {
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    for result in scores.iter().flat_map(|score| &score.results) {
        for id in &result.truth {
            let row = rows.entry(id).or_default();
            row.hidden += 1;
            row.found += usize::from(result.has_named(id));
            for name in result.extra() {
                *row.besides.entry(name.to_string()).or_default() += 1;
            }
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

/// How many of the names given with a confidence were right.
fn beliefs(scores: &[&Score]) -> String {
    let names = || {
        scores
            .iter()
            .flat_map(|score| &score.results)
            .flat_map(|result| result.named.iter().map(|(id, confidence)| (*confidence, result.hidden.contains(id))))
    };
    let mut text = String::new();
    for band in CONFIDENCES.windows(2) {
        let within = || names().filter(|(confidence, _)| (band[0]..band[1]).contains(confidence));
        let (right, all) = (within().filter(|(_, right)| *right).count(), within().count());
        let right = if all > 0 { format!("{right} ({:.1} %)", share(right, all)) } else { "-".into() };
        let _ = writeln!(text, "| {:.0} to {:.0} % | {all} | {right} |", 100.0 * band[0], 100.0 * band[1].min(1.0));
    }
    text
}

fn errors(scores: &[&Score]) -> String {
    let mut all: BTreeMap<&str, (Vec<f64>, usize)> = BTreeMap::new();
    for (name, error, covered) in scores.iter().flat_map(|score| &score.results).flat_map(|result| &result.constants) {
        let sum = all.entry(name).or_default();
        sum.0.push(*error);
        sum.1 += usize::from(*covered);
    }
    let mut text = String::new();
    for (name, (mut relative, covered)) in all {
        relative.sort_unstable_by(f64::total_cmp);
        let times = relative.len();
        let percent = |index: usize| 100.0 * relative[index];
        let _ = writeln!(
            text,
            "| {name} | {times} | {:.2} % | {:.2} % | {:.0} % |",
            percent(times / 2),
            percent(times * 9 / 10),
            share(covered, times)
        );
    }
    text
}

/// How often each effect is found at each strength, alone, and where it is found half the time and nine times in ten.
fn power(done: &Done, count: u64, first: u64) -> String {
    let weakest =
        |strength: f64| if strength > 0.0 { "strongest".into() } else { format!("x {:.2}", 10_f64.powf(strength)) };
    let mut text = "| effect | found half the time at | nine times in ten at |".to_string();
    for strength in STRENGTHS {
        let _ = write!(text, " {} |", weakest(strength));
    }
    let _ = writeln!(text, "\n|---|---|---|{}", "---|".repeat(STRENGTHS.len()));
    for effect in Effect::CATALOGUE.into_iter().filter(|effect| effect.has_strength()) {
        eprintln!("power of {}", effect.id());
        let found = STRENGTHS.map(|strength| found_alone(done, effect, strength, first..first + count));
        let _ = write!(text, "| {} | {} | {} |", effect.id(), reaches(&found, count, 0.5), reaches(&found, count, 0.9));
        for times in found {
            let _ = write!(text, " {times}/{count} |");
        }
        text += "\n";
    }
    text
}

fn found_alone(done: &Done, effect: Effect, strength: f64, seeds: Range<u64>) -> u64 {
    let results = done.results(&format!("{} at {strength}", effect.id()), seeds, |_| {
        let mut recipe = Recipe::of(&[effect]);
        recipe.effects[0].1 = strength;
        recipe
    });
    results.iter().filter(|result| result.has_named(effect.id())).count() as u64
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

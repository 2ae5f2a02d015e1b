//! `motorbench simulate`: the control core in closed loop with a simulated motor.

use super::{Failure, JSON_TO, Outputs, TERMINAL, plot_file, spinner, tell, write, write_json, write_plot};
use clap::Args;
use host_sim::figures::Figures;
use host_sim::scenario::{Outcome, Scenario};
use host_sim::trial::Point;
use motorbench_core::message::{Mode, Trip};
use motorbench_core::settings::{Settings, find};
use motorbench_data::names::trip_words;
use motorbench_files::text_file;
use motorbench_link::is_comment;
use motorbench_report::panels::{Panel, panels};
use motorbench_text::terminal_text::{quoted, short};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::slice;

/// Runs the firmware's control core in closed loop with a motor on this computer.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench simulate scenarios/speed_step.toml --csv run.csv --plot run.svg
  motorbench simulate loop.toml --model found.toml --console gains.txt")]
pub struct Arguments {
    /// The scenario; its keys are in docs/reference/scenarios.md.
    scenario: PathBuf,
    /// Writes the recording as the firmware would send it, - for the terminal instead of the table.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Model to use instead of the scenario's. A scenario from `record` has none.
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// Console lines of `motorbench design --console`; their settings replace the scenario's.
    #[arg(long, value_name = "GAINS.txt")]
    console: Option<PathBuf>,
    /// Draws reference, true and measured quantity, current and voltage.
    #[arg(long, value_name = "FILE.svg|png", value_parser = plot_file)]
    plot: Option<PathBuf>,
    /// Prints the figures as JSON instead of the table, or writes them into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with what is wrong with the scenario, or when the drive tripped.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut scenario = super::scenario(&arguments.scenario, arguments.model.as_deref())?;
    let outputs = arguments.outputs(&scenario)?;
    if let Some(path) = &arguments.console {
        set(&mut scenario.settings, path)?;
    }
    let busy = spinner();
    busy.set_message(format!("{} s in closed loop", scenario.duration_s));
    let outcome = scenario.run();
    busy.finish_and_clear();
    let outcome = outcome.map_err(Failure::input)?;
    if let Some(path) = &arguments.csv {
        write(path, &outcome.recording.to_csv())?;
    }
    if let Some(path) = &arguments.plot {
        write_plot(path, &plot(&scenario, &outcome))?;
    }
    let result =
        serde_json::json!({ "figures": outcome.figures, "trip": trip_name(outcome.trip), "trip_s": outcome.trip_s });
    if let Some(path) = &arguments.json {
        write_json(path, &result)?;
    }
    match outcome.figures.is_empty() {
        true => {
            outputs.say(&format!("{} s simulated in open loop: no reference, so no figures\n", scenario.duration_s))
        }
        false => outputs.say(&table(&outcome.figures)),
    }
    if let Some(expected) = judged(&scenario, &outcome)? {
        tell(&expected);
    }
    let next = arguments.csv.as_ref().map(|csv| format!("motorbench diagnose {}", quoted(&csv.display().to_string())));
    outputs.wrote(&next.unwrap_or_default());
    Ok(())
}

impl Arguments {
    fn outputs(&self, scenario: &Scenario) -> Result<Outputs, Failure> {
        let given = [&self.model, &self.console, &scenario.model_file].into_iter().flatten();
        let written = [&self.csv, &self.plot, &self.json].into_iter().flatten();
        Outputs::new(slice::from_ref(&self.scenario).iter().chain(given), written)
    }
}

/// Takes the `set` lines of a file for a board's console.
fn set(settings: &mut Settings, path: &Path) -> Result<(), Failure> {
    let wrong = |number: usize, why: &str| Failure::input(format!("{}, line {number}: {why}", path.display()));
    let text = text_file::read(path, "a file of lines for the console")
        .map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
    for (line, number) in text.lines().zip(1..) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [command, pairs @ ..] = &words[..] else { continue };
        if is_comment(command) {
            continue;
        }
        if *command != "set" || pairs.is_empty() || pairs.len() % 2 == 1 {
            return Err(wrong(number, "expected set NAME VALUE [NAME VALUE ...]"));
        }
        for pair in pairs.chunks_exact(2) {
            let param = find(pair[0].as_bytes()).ok_or_else(|| wrong(number, &format!("no setting {}", pair[0])))?;
            let (min, max) = param.range();
            let value = pair[1].parse().ok().filter(|value| settings.set(param, *value).is_ok());
            value.ok_or_else(|| wrong(number, &format!("{}: expected a number in {min}..{max}", pair[0])))?;
        }
    }
    Ok(())
}

/// A trip as scenarios and programs name it.
pub(super) fn trip_name(trip: Trip) -> Option<String> {
    (trip != Trip::None).then(|| format!("{trip:?}"))
}

/// A trip is a failure unless the scenario expects it. A missing expected trip is a failure too.
pub(super) fn judged(scenario: &Scenario, outcome: &Outcome) -> Result<Option<String>, Failure> {
    let at = outcome.trip_s.map_or(String::new(), |trip_s| format!(" at {trip_s:.3} s"));
    let off = format!("the drive switched itself off{at}: {}", trip_words(outcome.trip));
    match (scenario.expected_trip, outcome.trip) {
        (Trip::None, Trip::None) => Ok(None),
        (expected, trip) if expected == trip => Ok(Some(format!("as expected {off}"))),
        (Trip::None, _) => Err(Failure::input(off)),
        (expected, Trip::None) => {
            Err(Failure::input(format!("the expected trip did not come: {}", trip_words(expected))))
        }
        (expected, _) => Err(Failure::input(format!("{off} instead of {}", trip_words(expected)))),
    }
}

fn table(figures: &[Figures]) -> String {
    let mut text = String::from("   time_s   course     from       to   rise_s settle_s  over_% steady_error\n");
    let or_dash = |value: Option<f64>| value.map_or("-".into(), short);
    for row in figures {
        let _ = writeln!(
            text,
            "  {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7} {:>12}",
            short(row.time_s),
            row.course,
            short(row.from),
            short(row.to),
            or_dash(row.rise_s),
            or_dash(row.settling_s),
            or_dash(row.overshoot_percent),
            or_dash(row.steady_error)
        );
        let _ = writeln!(
            text,
            "          error {} rms, {} summed{}; voltage {} V rms; peak {} A",
            short(row.tracking_rms),
            short(row.iae),
            row.largest_error.map_or(String::new(), |largest| format!(", at most {}", short(largest))),
            short(row.effort_v),
            short(row.peak_a)
        );
    }
    text
}

fn plot(scenario: &Scenario, outcome: &Outcome) -> String {
    let of = |value: &dyn Fn(&Point) -> f64| outcome.points.iter().map(value).collect::<Vec<f64>>();
    let (position, closed) = (scenario.mode.is_position(), scenario.mode != Mode::OpenLoop);
    let title = if position { "position, rad" } else { "speed, rad/s" };
    let mut controlled = Panel::new(title);
    if closed {
        controlled = controlled.line("reference", of(&|point| point.reference));
    }
    controlled = controlled.line("true", of(&|point| scenario.controlled(point)));
    if !position {
        controlled = controlled.line("measured", of(&|point| point.measured_rad_per_s));
    }
    let current = Panel::new("current, A").line("true", of(&|point| point.i_a));
    let voltage = Panel::new("voltage asked of the bridge, V").line("u", of(&|point| point.u_v));
    let period_s = outcome.points.get(1).map_or(1e-3, |point| point.t_s - outcome.points[0].t_s);
    panels(period_s, &[controlled, current, voltage])
}

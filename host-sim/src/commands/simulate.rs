//! `motorbench simulate`

use super::{Failure, write};
use crate::design::trial::Point;
use crate::diagnose::page::short;
use crate::diagnose::report::time_plot;
use crate::figures::Figures;
use crate::scenario::{Outcome, Scenario};
use clap::Args;
use motorbench_core::message::Trip;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Runs the firmware's control core in closed loop with a motor on this computer.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench simulate scenarios/speed_step.toml --csv run.csv --plot run.svg")]
pub struct Arguments {
    /// The scenario; its keys are in docs/scenarios.md.
    scenario: PathBuf,
    /// Writes the recording as the firmware would have sent it.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Draws reference, true quantity, current and voltage.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Writes the figures as JSON, - for the terminal instead of the table.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with what is wrong with the scenario, or when the drive tripped.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let scenario = Scenario::read(&arguments.scenario).map_err(Failure::input)?;
    let outcome = scenario.run().map_err(Failure::input)?;
    if let Some(path) = &arguments.csv {
        write(path, &outcome.recording.to_csv())?;
    }
    if let Some(path) = &arguments.plot {
        write(path, &plot(&scenario, &outcome))?;
    }
    let json = serde_json::to_string_pretty(&outcome.figures).map_err(Failure::machine)? + "\n";
    match &arguments.json {
        Some(path) if path == Path::new("-") => print!("{json}"),
        Some(path) => {
            write(path, &json)?;
            print!("{}", table(&outcome.figures));
        }
        None => print!("{}", table(&outcome.figures)),
    }
    match outcome.trip {
        Trip::None => Ok(()),
        trip => Err(Failure::input(format!("the drive switched itself off: {trip:?}"))),
    }
}

fn table(figures: &[Figures]) -> String {
    let mut text =
        String::from("   time_s     from       to   rise_s settle_s  over_%  steady_err     IAE   rms_V  peak_A\n");
    let or_dash = |value: Option<f64>| value.map_or("-".into(), short);
    for row in figures {
        let _ = writeln!(
            text,
            "  {:>7} {:>8} {:>8} {:>8} {:>8} {:>7} {:>11} {:>7} {:>7} {:>7}",
            short(row.time_s),
            short(row.from),
            short(row.to),
            or_dash(row.rise_s),
            or_dash(row.settling_s),
            short(row.overshoot_percent),
            short(row.steady_error),
            short(row.iae),
            short(row.effort_v),
            short(row.peak_a)
        );
    }
    text
}

fn plot(scenario: &Scenario, outcome: &Outcome) -> String {
    let position = scenario.mode.is_position();
    let of = |value: fn(&Point) -> f64| outcome.points.iter().map(value).collect::<Vec<f64>>();
    let (name, truth) = if position {
        ("theta_rad", of(|point| point.theta_rad))
    } else {
        ("omega_rad_per_s", of(|point| point.omega_rad_per_s))
    };
    let period_s = outcome.points.get(1).map_or(1e-3, |point| point.t_s - outcome.points[0].t_s);
    time_plot(name, period_s, &[&of(|point| point.reference), &truth])
}

//! `motorbench validate`

use super::compare::{plot, table};
use super::{Failure, mapping, plot_file, read_rig, spinner, write, write_plot};
use crate::compare::{Comparison, compare};
use crate::design::trial::Point;
use crate::diagnose::diagnose;
use crate::diagnose::page::verdict;
use crate::figures::Figures;
use crate::recording::{Channel, Recording};
use crate::rig::Rig;
use crate::scenario::Scenario;
use crate::terminal_text::{short, wrapped};
use clap::Args;
use serde_json::json;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Puts a measured closed loop beside the simulated one: one plot, fit per channel, figures of both, and what remains.
#[derive(Args)]
#[command(after_help = "Example:
  motorbench validate loop.csv --scenario loop.scenario.toml \\
    --rig loop.rig.toml --model found.toml --plot both.svg

A scenario has the references and settings that were recorded; motorbench record
writes it: docs/scenarios.md")]
pub struct Arguments {
    /// The recording of the loop, from the start of the scenario or from up to a quarter of its length before.
    measured: PathBuf,
    /// The same course as a scenario.
    #[arg(long, value_name = "SCENARIO.toml")]
    scenario: PathBuf,
    /// Another model than the scenario's.
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// What is known of the rig (TOML).
    #[arg(long)]
    rig: Option<PathBuf>,
    /// A column that has another name: FILE_NAME=PROJECT_NAME.
    #[arg(long = "column", value_name = "FROM=TO", value_parser = mapping)]
    columns: Vec<(String, String)>,
    /// Draws both.
    #[arg(long, value_name = "FILE.svg|png", value_parser = plot_file)]
    plot: Option<PathBuf>,
    /// Writes the result as JSON into a file, - for the terminal.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with file and what to do.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let rig = arguments.rig.as_deref().map_or_else(|| Ok(Rig::default()), read_rig)?;
    let measured = Recording::read(&arguments.measured, &arguments.columns).map_err(Failure::input)?;
    let scenario = super::scenario(&arguments.scenario, arguments.model.as_deref())?;
    let simulated = scenario.run().map_err(Failure::input)?.recording;
    // The simulation first: its times are those of the scenario.
    let compared = compare(&simulated, &measured, None).map_err(Failure::input)?;
    let figures = [
        scenario.figures(&points(&simulated, &rig, 0.0)),
        scenario.figures(&points(&measured, &rig, compared.delay_s)),
    ];
    let bar = spinner();
    let remaining = remaining(&[measured], &rig, &scenario, &|text| bar.set_message(text.to_string()));
    bar.finish_and_clear();
    if let Some(path) = &arguments.plot {
        write_plot(path, &plot(&compared, ["simulated", "measured"]))?;
    }
    let result = json!({
        "comparison": compared,
        "figures": { "simulated": figures[0], "measured": figures[1] },
        "remaining": remaining,
    });
    let json = serde_json::to_string_pretty(&result).map_err(Failure::machine)? + "\n";
    match &arguments.json {
        Some(path) if path == Path::new("-") => {
            print!("{json}");
            return Ok(());
        }
        Some(path) => write(path, &json)?,
        None => {}
    }
    print!("{}", page(&compared, &figures, &remaining));
    Ok(())
}

/// A recording as the figures take it, from the start of the scenario on. `late_s`: by how much it began earlier.
fn points(recording: &Recording, rig: &Rig, late_s: f64) -> Vec<Point> {
    let column = |channel: Channel, factor: f64| {
        recording.get(channel).map(|values| values.iter().map(|value| value * factor).collect::<Vec<f64>>())
    };
    let missing = || vec![f64::NAN; recording.len()];
    let speed = column(Channel::Speed, 1.0).or_else(|| column(Channel::Rpm, TAU / 60.0)).unwrap_or_else(missing);
    let per_rev = rig.encoder.counts_per_rev.unwrap_or(f64::NAN);
    let angle = column(Channel::Angle, 1.0).or_else(|| column(Channel::Counts, TAU / per_rev)).unwrap_or_else(missing);
    let reference = column(Channel::SpeedReference, 1.0).or_else(|| column(Channel::AngleReference, 1.0));
    let reference = reference.unwrap_or_else(missing);
    let voltage = column(Channel::Voltage, 1.0).unwrap_or_else(missing);
    let current = column(Channel::Current, 1.0).unwrap_or_else(missing);
    let time_s = recording.time_s().unwrap_or_default();
    let start_s = time_s.first().copied().unwrap_or(0.0) + late_s;
    (0..time_s.len())
        .filter(|index| time_s[*index] >= start_s)
        .map(|index| Point {
            t_s: time_s[index] - start_s,
            reference: reference[index],
            u_v: voltage[index],
            measured_rad_per_s: speed[index],
            omega_rad_per_s: speed[index],
            theta_rad: angle[index] - angle[0],
            i_a: current[index],
            limited: false,
        })
        .collect()
}

/// What a diagnosis of the measured loop names that the scenario lacks, or why it says nothing.
fn remaining(
    measured: &[Recording],
    rig: &Rig,
    scenario: &Scenario,
    progress: crate::diagnose::select::Progress,
) -> Vec<String> {
    match diagnose(measured, rig, progress) {
        Err(error) => vec![format!("no diagnosis of what remains: {error}")],
        Ok(diagnosis) => {
            let causes = &diagnosis.outcome.causes;
            // The scenario's own loads are no news.
            let known = |id: &str| scenario.model.has(id) || id == "load_step" && !scenario.loads.is_empty();
            let new: Vec<&str> = causes.iter().map(|cause| cause.effect.as_str()).filter(|id| !known(id)).collect();
            let lacks = match new.is_empty() {
                true => "the model has every effect that the measured loop shows".to_string(),
                false => format!("the measured loop shows what the model lacks: {}", new.join(", ")),
            };
            vec![lacks, verdict(&diagnosis.outcome)]
        }
    }
}

fn page(compared: &Comparison, figures: &[Vec<Figures>; 2], remaining: &[String]) -> String {
    let mut text = String::from("Measured (second) against simulated (first)\n") + &table(compared);
    text += "\n  at, s    figure                     simulated     measured\n";
    for (simulated, measured) in figures[0].iter().zip(&figures[1]) {
        let rows = [
            ("rise, s", simulated.rise_s, measured.rise_s),
            ("settling, s", simulated.settling_s, measured.settling_s),
            ("overshoot, %", simulated.overshoot_percent, measured.overshoot_percent),
            ("steady error", simulated.steady_error, measured.steady_error),
            ("tracking error, rms", Some(simulated.tracking_rms), Some(measured.tracking_rms)),
        ];
        for (name, simulated_value, measured_value) in rows {
            let or_dash = |value: Option<f64>| value.filter(|value| value.is_finite()).map_or("-".into(), short);
            let (time, a, b) = (short(simulated.time_s), or_dash(simulated_value), or_dash(measured_value));
            text += &format!("  {time:<8} {name:<22} {a:>13} {b:>12}\n");
        }
    }
    text.push('\n');
    for line in remaining {
        line.lines().for_each(|line| text += &wrapped(line, "", "  "));
    }
    text
}

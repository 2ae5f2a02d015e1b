//! `motorbench diagnose`

use super::{Failure, spinner, write};
use crate::diagnose::{diagnose, page, report};
use crate::recording::Recording;
use crate::rig::Rig;
use crate::steady_state;
use clap::Args;
use std::path::{Path, PathBuf};

/// Shows what a simulation gets wrong, names the cause, extends the model and measures the gain.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench diagnose run.csv --rig rig.toml
  motorbench diagnose a.csv b.csv --rig rig.toml --report diagnosis.html --model model.toml
  motorbench diagnose log.csv --column time=t_s --column speed=omega_rad_per_s --json -
  motorbench diagnose no_load_table.csv --rig rig.toml      (steady states, without t_s)")]
pub struct Arguments {
    /// Recordings of one rig: CSV with units in the column names (t_s with duty or u_V and omega_rad_per_s, rpm,
    /// theta_rad or counts, and i_A), or one table of steady states without t_s.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// What is known of the rig (TOML).
    #[arg(long)]
    rig: Option<PathBuf>,
    /// A column of the file that has another name: FILE_NAME=PROJECT_NAME.
    #[arg(long = "column", value_name = "FROM=TO", value_parser = mapping)]
    columns: Vec<(String, String)>,
    /// Writes the result as JSON into a file, - for the terminal.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
    /// Writes a page with plots.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Writes the extended model.
    #[arg(long, value_name = "OUT.toml")]
    model: Option<PathBuf>,
}

fn mapping(text: &str) -> Result<(String, String), String> {
    let (from, to) = text.split_once('=').ok_or("expected FROM=TO, for instance speed=omega_rad_per_s")?;
    Ok((from.into(), to.into()))
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with what is wrong with the input, and where.
pub fn run(args: &Arguments) -> Result<(), Failure> {
    let rig = match &args.rig {
        Some(path) => Rig::read(path).map_err(Failure::input)?,
        None => Rig::default(),
    };
    for key in &rig.ignored {
        eprintln!("motorbench: the rig file's {key} has no meaning here and is ignored");
    }
    let read = |path: &PathBuf| Recording::read(path, &args.columns).map_err(Failure::input);
    let recordings = args.recordings.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    if let [table] = &recordings[..]
        && table.time_s().is_none()
    {
        return run_table(args, table, &rig);
    }
    let bar = spinner();
    let result = diagnose(&recordings, &rig, &|text| bar.set_message(text.to_string()));
    bar.finish_and_clear();
    let diagnosis = result.map_err(Failure::input)?;
    let names: Vec<String> = recordings.iter().map(|recording| recording.name.clone()).collect();
    if let Some(path) = &args.model {
        write(path, &diagnosis.model.to_toml())?;
    }
    if let Some(path) = &args.report {
        write(path, &report::report(&diagnosis, &names))?;
    }
    finish(args, &diagnosis.outcome, || page::page(&diagnosis))
}

fn run_table(args: &Arguments, table: &Recording, rig: &Rig) -> Result<(), Failure> {
    let study = steady_state::study(table, rig).map_err(Failure::input)?;
    if let Some(path) = &args.model {
        return Err(Failure::input(format!(
            "{}: a table of steady states says nothing of inertia and inductance; a model needs a recording over time",
            path.display()
        )));
    }
    if let Some(path) = &args.report {
        write(path, &study.html(&table.name))?;
    }
    finish(args, &study, || study.page())
}

/// JSON where it was asked for, the page unless the terminal is taken by the JSON.
fn finish(args: &Arguments, result: &impl serde::Serialize, page: impl FnOnce() -> String) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(result).map_err(Failure::input)? + "\n";
    match &args.json {
        Some(path) if path == Path::new("-") => print!("{json}"),
        Some(path) => {
            write(path, &json)?;
            print!("{}", page());
        }
        None => print!("{}", page()),
    }
    Ok(())
}

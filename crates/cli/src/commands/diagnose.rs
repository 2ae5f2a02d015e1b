//! `motorbench diagnose`: names what the linear motor lacks.

use super::recordings::RecordingArguments;
use super::{
    Failure, JSON_TO, Outputs, TERMINAL, in_units_of, next_with_model, open_next, provenance, read_recording,
    rig_beside, rig_file, rig_for, spinner, tell, write, write_json, write_model,
};
use clap::Args;
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::dataset::contradictions;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::steady_state;
use motorbench_model::Motion;
use motorbench_report::web_page::Provenance;
use motorbench_report::{diagnosis_page as report, diagnosis_text as page, steady_state as table_report};
use rayon::prelude::*;
use std::io;
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};

/// Finds what the linear model of the motor lacks, names the cause, extends the model, and measures the improvement.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench diagnose run.csv --rig rig.toml
  motorbench diagnose a.csv b.csv --rig rig.toml --report diagnosis.html
  motorbench diagnose log.csv --column time=t_s \\
    --column speed=omega_rad_per_s --json -
  motorbench diagnose no_load_table.csv --rig rig.toml
  motorbench diagnose --batch runs/ --rig rig.toml > results.jsonl

A table without t_s is one of steady states. --batch diagnoses each file alone
and prints one line of JSON for each.")]
pub struct Arguments {
    #[command(flatten)]
    recordings: RecordingArguments,
    /// Diagnoses each recording alone, on all cores. Prints one line of JSON for each: file, rig, and outcome or error.
    /// A folder means its .csv files. Without --rig each file uses the rig file beside it.
    #[arg(long, conflicts_with_all = ["json", "report", "model"])]
    batch: bool,
    /// Prints the result as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
    /// Writes a page with plots.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Writes the extended model; a file that motorbench did not write is not replaced.
    #[arg(long, value_name = "OUT.toml")]
    model: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with what is wrong with the input, and where.
pub fn run(args: &Arguments) -> Result<(), Failure> {
    if args.batch {
        return batch(args, &rig_for(args.recordings.rig.as_deref(), None)?);
    }
    let outputs =
        Outputs::new(&args.recordings.files(), [&args.json, &args.report, &args.model].into_iter().flatten())?;
    let (rig, recordings) = (args.recordings.rig()?, args.recordings.read()?);
    if let [table] = &recordings[..]
        && table.time_s().is_none()
    {
        return run_table(args, &outputs, table, &rig);
    }
    // The search may take a minute, and a wrong rig file makes it useless.
    for contradiction in recordings.iter().flat_map(|recording| contradictions(recording, &rig)) {
        tell(&format!("motorbench: {}", contradiction.note()));
    }
    let bar = spinner();
    let result = diagnose(&recordings, &rig, &|text| bar.set_message(text.to_string()));
    bar.finish_and_clear();
    let diagnosis = result.map_err(Failure::input)?;
    let axis = diagnosis.data.axis;
    if let Some(path) = &args.model {
        write_model(path, axis, &diagnosis.model)?;
    }
    if let Some(path) = &args.report {
        write(path, &report::report(&diagnosis, args.provenance()))?;
    }
    match axis.motion {
        Motion::Rotary => finish(args, &outputs, &diagnosis.outcome, || page::page(&diagnosis))?,
        Motion::Linear => finish(args, &outputs, &in_units_of(axis, &diagnosis.outcome)?, || page::page(&diagnosis))?,
    }
    let next = args.model.as_deref().map(|model| next_with_model(axis, model, args.rig().as_deref()));
    outputs.wrote(&next.unwrap_or_else(|| open_next(args.report.as_deref())));
    Ok(())
}

impl Arguments {
    /// The rig file that is read.
    fn rig(&self) -> Option<PathBuf> {
        rig_file(self.recordings.rig.as_deref(), self.recordings.recordings.first().map(PathBuf::as_path))
    }

    /// Where the page comes from.
    fn provenance(&self) -> Provenance {
        let files = &self.recordings.recordings;
        provenance::with(provenance::of_files(files.iter().map(PathBuf::as_path)), "Rig file", self.rig().as_deref())
    }
}

/// One line for each file, in order of completion; a bad file does not stop the others.
fn batch(args: &Arguments, rig: &Rig) -> Result<(), Failure> {
    let files = expanded(&args.recordings.recordings)?;
    let bar = super::bar(files.len() as u64);
    let failed = files
        .par_iter()
        .filter(|path| {
            let beside = if args.recordings.rig.is_none() { rig_beside(path) } else { None };
            let own = beside.as_deref().map(motorbench_files::rig).transpose().map_err(|error| error.to_string());
            let result = own.and_then(|own| guarded(|| alone(path, args, own.as_ref().unwrap_or(rig))));
            let rig = args.recordings.rig.as_ref().or(beside.as_ref());
            let failed = result.is_err();
            // On some systems file names are arbitrary bytes, but JSON is text.
            let (path, rig) = (path.to_string_lossy(), rig.map(|rig| rig.to_string_lossy()));
            let line = match result {
                Ok(outcome) => serde_json::json!({ "file": path, "rig": rig, "outcome": outcome }),
                Err(error) => serde_json::json!({ "file": path, "rig": rig, "error": error }),
            };
            println!("{line}");
            bar.inc(1);
            failed
        })
        .count();
    bar.finish_and_clear();
    match failed {
        0 => Ok(()),
        failed => Err(Failure::input(format!("{failed} of {} recordings could not be diagnosed", files.len()))),
    }
}

/// An internal fault in one file is an error of that file, and does not stop the others.
fn guarded<T>(study: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    panic::catch_unwind(AssertUnwindSafe(study)).unwrap_or_else(|payload| {
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let why = text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("no reason is known");
        Err(format!("an internal fault of motorbench ({why}): please report it, with the recording"))
    })
}

fn alone(path: &Path, args: &Arguments, rig: &Rig) -> Result<serde_json::Value, String> {
    let recording = read_recording(path, &args.recordings.columns).map_err(|failure| failure.message)?;
    recording.advice_on_time().map_or(Ok(()), Err)?;
    let outcome = if recording.time_s().is_none() {
        serde_json::to_value(steady_state::study(&recording, rig, None).map_err(|error| error.to_string())?)
    } else {
        let outcome = diagnose(&[recording], rig, &|_| ()).map_err(|error| error.to_string())?.outcome;
        return in_units_of(outcome.axis, &outcome).map_err(|failure| failure.message);
    };
    outcome.map_err(|error| error.to_string())
}

/// Folders replaced by the recordings in them, in the order of their names.
fn expanded(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path);
        let inside = entries.and_then(|entries| recordings_of(entries.map(|entry| Ok(entry?.path()))));
        let mut inside = inside.map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
        if inside.is_empty() {
            return Err(Failure::input(format!("{}: no .csv file in this folder", path.display())));
        }
        files.append(&mut inside);
    }
    Ok(files)
}

/// The recordings of a folder. If a part of the folder cannot be read, the command fails instead of leaving it out.
fn recordings_of(entries: impl Iterator<Item = io::Result<PathBuf>>) -> io::Result<Vec<PathBuf>> {
    let mut files = entries.collect::<io::Result<Vec<PathBuf>>>()?;
    // Reading a pipe may never end.
    let is_recording = |file: &PathBuf| file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
    let is_no_file = |file: &PathBuf| file.metadata().is_ok_and(|found| !found.is_file());
    files.retain(|file| is_recording(file) && !is_no_file(file));
    files.sort();
    Ok(files)
}

fn run_table(args: &Arguments, outputs: &Outputs, table: &Recording, rig: &Rig) -> Result<(), Failure> {
    table.advice_on_time().map_or(Ok(()), |advice| Err(Failure::input(advice)))?;
    let study = steady_state::study(table, rig, None).map_err(Failure::input)?;
    if let Some(path) = &args.report {
        write(path, &table_report::html(&study, args.provenance()))?;
    }
    finish(args, outputs, &study, || table_report::page(&study))?;
    outputs.wrote(&open_next(args.report.as_deref()));
    // All other results are written by now.
    args.model.as_ref().map_or(Ok(()), |path| {
        Err(Failure::input(format!(
            "{}: a table of steady states shows neither inertia nor inductance; --model needs a recording over time",
            path.display()
        )))
    })
}

/// Writes JSON and page where the user asked for them.
fn finish(
    args: &Arguments,
    outputs: &Outputs,
    result: &impl serde::Serialize,
    page: impl FnOnce() -> String,
) -> Result<(), Failure> {
    if let Some(path) = &args.json {
        write_json(path, result)?;
    }
    outputs.say(&page());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_of_the_program_is_the_error_of_one_file() {
        assert_eq!(guarded(|| Ok(1)), Ok(1));
        let text = String::from("min > max");
        for error in [guarded::<()>(|| panic!("min > max")), guarded(|| panic!("{text}"))] {
            assert!(error.is_err_and(|why| why.contains("an internal fault of motorbench (min > max)")));
        }
    }

    #[test]
    fn a_folder_that_cannot_be_read_whole_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, other] = ["a.CSV", "b.csv", "run.json"].map(|name| folder.path().join(name));
        [&a, &b, &other].into_iter().for_each(|file| std::fs::write(file, "").unwrap());
        let folders = folder.path().join("old.csv");
        std::fs::create_dir(&folders).unwrap();
        let found = recordings_of([&b, &other, &folders, &a].map(|file| Ok(file.clone())).into_iter()).unwrap();
        assert_eq!(found, [a.clone(), b]);
        let lost = Err(io::Error::other("input/output error"));
        let error = recordings_of([Ok(a), lost].into_iter()).unwrap_err();
        assert!(error.to_string().contains("input/output error"));
    }
}

//! `motorbench identify`: the constants of the linear motor.

use super::recordings::RecordingArguments;
use super::{
    Failure, JSON_TO, Outputs, TERMINAL, in_units_of, next_with_model, rig_file, spinner, write_json, write_model,
};
use clap::Args;
use motorbench_data::rig::NominalMotor;
use motorbench_diagnosis::dataset::Dataset;
use motorbench_diagnosis::diagnose::determined::{AllDetermined, determined};
use motorbench_diagnosis::diagnose::judge;
use motorbench_diagnosis::free_run::free_run;
use motorbench_diagnosis::identify::{Effort, Place, Prior, fit, with_window_settled};
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Model, Motion};
use motorbench_report::diagnosis_text::determined_lines;
use motorbench_text::terminal_text::{short, wrapped};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Finds the five constants of the linear motor, with their uncertainty and the fit on held-out data.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench identify run.csv --rig rig.toml --model motor.toml
  motorbench identify a.csv b.csv --json -

`motorbench diagnose` names what the linear motor lacks.")]
pub struct Arguments {
    #[command(flatten)]
    recordings: RecordingArguments,
    /// Writes the motor as a model file; a file that motorbench did not write is not replaced.
    #[arg(long, value_name = "OUT.toml")]
    model: Option<PathBuf>,
    /// Prints the result as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// The result. Units are in the names or beside the values.
#[derive(Serialize)]
struct Identified {
    /// What the data determine, whatever the scale of torque and resistance.
    determined: AllDetermined,
    parameters: BTreeMap<&'static str, Constant>,
    fit: BTreeMap<&'static str, Fitted>,
    /// If this is set, the model does not hold, and the intervals are not valid.
    leaves_more_than_noise: bool,
    /// Notes on the recording.
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Constant {
    value: f64,
    ci95: [f64; 2],
}

/// Errors of a free-running simulation on the held-out data.
#[derive(Serialize)]
struct Fitted {
    rmse: f64,
    unit: &'static str,
    fit_percent: f64,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with what is wrong with the input, and where.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = Outputs::new(&arguments.recordings.files(), arguments.model.iter().chain(&arguments.json))?;
    let (rig, recordings) = (arguments.recordings.rig()?, arguments.recordings.read()?);
    let nominal = rig.nominal();
    let data = with_window_settled(Dataset::new(&recordings, &rig).map_err(Failure::input)?, &nominal);
    let axis = data.axis;
    let bar = spinner();
    let (model, identified) = identify(&data, &nominal, &|text| bar.set_message(text.to_string()));
    bar.finish_and_clear();
    if let Some(path) = &arguments.model {
        write_model(path, axis, &model)?;
    }
    if let Some(path) = &arguments.json {
        match axis.motion {
            Motion::Rotary => write_json(path, &identified)?,
            Motion::Linear => write_json(path, &in_units_of(axis, &identified)?)?,
        }
    }
    outputs.say(&axis.motion.words(&page(&identified)));
    let first = arguments.recordings.recordings.first().map(PathBuf::as_path);
    let rig_file = rig_file(arguments.recordings.rig.as_deref(), first);
    let next = arguments.model.as_deref().map(|model| next_with_model(axis, model, rig_file.as_deref()));
    outputs.wrote(&next.unwrap_or_default());
    Ok(())
}

/// Fits without the held-out data and evaluates on them. Then it fits all data for the constants.
fn identify(data: &Dataset, nominal: &NominalMotor, progress: &dyn Fn(&str)) -> (Model, Identified) {
    let prior = Prior::new(nominal, data);
    progress("fit to two thirds of the data");
    let seen = fit(&Model::linear(prior.motor), data, &prior, Effort::FULL);
    let prediction = free_run(&seen.model, data);
    let quality = data.measured.iter().enumerate().map(|(output, measured)| {
        let rmse = judge::rmse(data, &prediction, output);
        let fit_percent = judge::fit_percent(data, &prediction, output);
        (measured.output.channel(), Fitted { rmse, unit: measured.output.unit(), fit_percent })
    });
    let quality: BTreeMap<_, _> = quality.collect();
    let reached: Vec<String> =
        quality.iter().map(|(channel, fitted)| format!("{channel} {:.1} %", fitted.fit_percent)).collect();
    progress(&format!("fit on the rest: {}; now to all of it", reached.join(", ")));
    let everything = data.with_nothing_held_out();
    let last = fit(&seen.model, &everything, &prior, Effort::FULL);
    let uncertainty = last.uncertainty(&everything);
    let intervals = uncertainty.intervals();
    let determined = determined(&uncertainty, &everything, |_, _, ci95| ci95);
    let constant = |(index, (name, value)): (usize, (&'static str, f64))| {
        let interval = intervals.iter().find(|interval| interval.place == Place::Motor(index));
        (name, Constant { value, ci95: interval.map_or([value, value], |interval| interval.ci95) })
    };
    let named = last.model.motor.named().into_iter().enumerate();
    let parameters = named.filter(|(index, _)| data.axis.drive.has_constant(*index)).map(constant).collect();
    let leaves_more_than_noise = judge::above_floor(data, &seen) > judge::NOT_NOISE;
    (last.model, Identified { determined, parameters, fit: quality, leaves_more_than_noise, notes: data.notes() })
}

/// Warning about the intervals.
const LEAVES_MORE: &str = "The linear motor leaves more than noise. Its constants are bent to make up for what it lacks, and their intervals do not show that. `motorbench diagnose` names the cause.";

fn page(identified: &Identified) -> String {
    let mut text = determined_lines(&identified.determined);
    text += "The linear motor, with 95 % intervals\n";
    for (name, _) in MotorParameters::PIVT6.named() {
        let Some(Constant { value, ci95: [low, high] }) = identified.parameters.get(name) else { continue };
        let _ = writeln!(text, "  {name:<26} {:>10}  [{}, {}]", short(*value), short(*low), short(*high));
    }
    text += "Free-running simulation against held-out data\n";
    for (channel, fitted) in &identified.fit {
        let Fitted { rmse, unit, fit_percent } = fitted;
        let _ = writeln!(text, "  {channel:<26} {:>10} {unit} rms, fit {fit_percent:.1} %", short(*rmse));
    }
    if identified.leaves_more_than_noise {
        text += &wrapped(LEAVES_MORE, "", "");
    }
    for note in &identified.notes {
        text += &wrapped(note, "", "");
    }
    text
}

//! `motorbench compare`: two recordings, two models, or a recording and a model.

mod with_model;

use super::{
    Failure, JSON_TO, Outputs, TERMINAL, open_next, plot_file, provenance, read_model, read_recording, rig_file, write,
    write_json, write_plot,
};
use clap::Args;
use host_sim::plant::{Bridge, Inputs, ModelPlant, Plant};
use maud::{Markup, html};
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::Channel;
use motorbench_diagnosis::compare::{Comparison, Difference, compare};
use motorbench_diagnosis::identify::Z95;
use motorbench_files::text_file;
use motorbench_model::Model;
use motorbench_model::linear::motor_model::speed;
use motorbench_report::comparison_page::{self, Compared};
use motorbench_report::panels::{Panel, panels};
use motorbench_report::plot::quantity;
use motorbench_report::web_page::{code, number, table as page_table};
use motorbench_text::terminal_text::{fixed, short};
use nalgebra::Complex;
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Compares two recordings, two models, or a recording with a model.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench compare monday.csv friday.csv --plot both.svg
  motorbench compare linear.toml extended.toml --voltage 12
  motorbench compare run.csv model.toml --rig rig.toml
  motorbench compare before.json after.json

The last example compares two results of identify or diagnose --json: their
differences in standard deviations.")]
pub struct Arguments {
    /// Recording (.csv), model (.toml), or constants with intervals (.json of identify or diagnose).
    first: PathBuf,
    /// What to compare it with, of the same kinds.
    second: PathBuf,
    /// Rig file (TOML), for a recording with a model; default: the rig file beside the recording, if there is one.
    #[arg(long)]
    rig: Option<PathBuf>,
    /// A column that has another name or unit: speed=omega_rad_per_s*6.2832, pwm=duty/255.
    #[arg(long = "column", visible_alias = "map", value_name = "NAME=CHANNEL")]
    columns: Vec<Mapping>,
    /// Delay of the second recording, or of the commands beside a model; default: found.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true)]
    delay: Option<f64>,
    /// Voltage of the step that two models are compared by.
    #[arg(long, default_value_t = 6.0, value_name = "VOLTS", allow_negative_numbers = true)]
    voltage: f64,
    /// Draws both: recordings over time, models by step and frequency response.
    #[arg(long, value_name = "FILE.svg|png", value_parser = plot_file)]
    plot: Option<PathBuf>,
    /// Writes a page with plots and figures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Prints the result as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Recording,
    Model,
    Constants,
}

fn kind(path: &Path) -> Result<Kind, Failure> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("csv") => Ok(Kind::Recording),
        Some("toml") => Ok(Kind::Model),
        Some("json") => Ok(Kind::Constants),
        _ => Err(Failure::input(format!(
            "{}: expected .csv (recording), .toml (model) or .json (constants)",
            path.display()
        ))),
    }
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with file and what to do.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let (first, second) = (&arguments.first, &arguments.second);
    arguments.outputs()?;
    match (kind(first)?, kind(second)?) {
        (Kind::Recording, Kind::Recording) => recordings(arguments),
        (Kind::Recording, Kind::Model) => with_model::with_model(arguments, first, second),
        (Kind::Model, Kind::Recording) => with_model::with_model(arguments, second, first),
        (Kind::Model, Kind::Model) => models(arguments),
        (Kind::Constants, Kind::Constants) => constants(arguments),
        _ => Err(Failure::input("a .json (constants with intervals) can be compared only with another .json")),
    }
}

/// What is drawn: panels over time with a sample for each interval, or over frequency.
pub type Drawn = (f64, Vec<Panel>);

/// What a comparison says: its result in a sentence, its text for a terminal, and its figures for a page.
struct Said<'a> {
    verdict: &'a str,
    text: &'a str,
    figures: Markup,
}

fn finish(arguments: &Arguments, result: &Value, said: Said, (interval_s, drawn): &Drawn) -> Result<(), Failure> {
    let Said { verdict, text, figures } = said;
    if let Some(path) = &arguments.plot {
        write_plot(path, &panels(*interval_s, drawn))?;
    }
    if let Some(path) = &arguments.report {
        let files = format!("{} and {}", arguments.first.display(), arguments.second.display());
        let compared = Compared {
            title: "motorbench compare",
            kind: "Comparison",
            verdict: format!("{files}: {verdict}."),
            conclusions: Vec::new(),
            panels: drawn,
            interval_s: *interval_s,
            figures,
        };
        let from = provenance::of_files([arguments.first.as_path(), &arguments.second]);
        write(path, &comparison_page::html(&compared, provenance::with(from, "Rig file", arguments.rig.as_deref())))?;
    }
    if let Some(path) = &arguments.json {
        write_json(path, result)?;
    }
    let outputs = arguments.outputs()?;
    outputs.say(text);
    outputs.wrote(&open_next(arguments.report.as_deref()));
    Ok(())
}

impl Arguments {
    /// Names of both in plots: those of their files, if these differ.
    fn names(&self) -> [String; 2] {
        let names = [&self.first, &self.second].map(|path| path.file_stem().unwrap_or_default().to_string_lossy());
        if names[0] == names[1] { ["first", "second"].map(String::from) } else { names.map(String::from) }
    }

    fn outputs(&self) -> Result<Outputs, Failure> {
        let inputs = [&self.first, &self.second];
        let rigs: Vec<PathBuf> = inputs.iter().filter_map(|path| rig_file(self.rig.as_deref(), Some(path))).collect();
        Outputs::new(inputs.into_iter().chain(&rigs), self.plot.iter().chain(&self.report).chain(&self.json))
    }
}

fn recordings(arguments: &Arguments) -> Result<(), Failure> {
    let read = |path: &Path| read_recording(path, &arguments.columns);
    let compared =
        compare(&read(&arguments.first)?, &read(&arguments.second)?, arguments.delay).map_err(Failure::input)?;
    let result = serde_json::to_value(&compared).map_err(Failure::machine)?;
    let verdict = format!("they {}", agreement(&compared));
    let said = Said { verdict: &verdict, text: &table(&compared), figures: table_html(&compared) };
    let [first, second] = arguments.names();
    finish(arguments, &result, said, &drawn(&compared, [&first, &second]))
}

/// Delay, and difference of each channel.
pub fn table(compared: &Comparison) -> String {
    let (delay, duration) = (short(1e3 * compared.delay_s), short(compared.duration_s));
    let mut text = format!("The second is {delay} ms later; compared over {duration} s\n");
    text += "  channel            rms difference        fit\n";
    for channel in &compared.channels {
        let fit = channel.fit_percent.map_or("-".into(), |fit| format!("{fit:.1} %"));
        text += &format!("  {:<18} {:>14} {fit:>10}\n", channel.channel, short(channel.rms));
    }
    text
}

/// The same for a page.
pub fn table_html(compared: &Comparison) -> Markup {
    let rows = compared.channels.iter().map(|channel| {
        let fit = channel.fit_percent.map_or("-".into(), |fit| format!("{fit:.1} %"));
        [code([channel.channel]), number(short(channel.rms)), number(fit)]
    });
    let (delay, duration) = (short(1e3 * compared.delay_s), short(compared.duration_s));
    html! {
        p { "The second is " (delay) " ms later; compared over " (duration) " s." }
        (page_table(&["channel", "rms difference", "fit"], rows))
    }
}

/// How well two recordings agree in what the motor does and in its current: `agree in speed to 94.0 %, current to 59.0 %`.
pub fn agreement(compared: &Comparison) -> String {
    let mut channels: Vec<&Difference> = compared.channels.iter().filter(|one| is_of_the_motor(one.channel)).collect();
    channels.sort_by_key(|channel| place(channel.channel));
    let fits = channels.iter().filter_map(|one| Some((one.title(), one.fit_percent?)));
    agreement_in(&fits.collect::<Vec<_>>())
}

/// The same from the titles of axes with their fits. A fit below zero is no agreement: a constant would do better.
fn agreement_in(fits: &[(&str, f64)]) -> String {
    let (good, bad): (Vec<_>, Vec<_>) = fits.iter().partition(|(_, fit_percent)| *fit_percent > 0.0);
    let good: Vec<String> = good.iter().map(|(title, fit)| format!("{} to {fit:.1} %", quantity(title))).collect();
    let bad: Vec<String> = bad.iter().map(|(title, fit)| format!("{} (fit {fit:.1} %)", quantity(title))).collect();
    match (good.join(", "), bad.join(", ")) {
        (good, bad) if good.is_empty() && bad.is_empty() => "are compared in figures".into(),
        (good, bad) if bad.is_empty() => format!("agree in {good}"),
        (good, bad) if good.is_empty() => format!("do not agree in {bad}"),
        (good, bad) => format!("agree in {good}, but not in {bad}"),
    }
}

/// What the motor does, and its current. A page folds the other channels away.
pub fn is_of_the_motor(channel: &str) -> bool {
    place(channel) <= 2
}

/// Where a channel stands in a page: what the motor does, then the current, then what drives it.
pub fn place(channel: &str) -> usize {
    match Channel::of_column(channel) {
        Some(Channel::Speed | Channel::Rpm | Channel::Velocity) => 0,
        Some(Channel::Angle | Channel::Position) => 1,
        Some(Channel::Current) => 2,
        Some(Channel::Voltage) => 3,
        Some(Channel::Duty) => 4,
        Some(Channel::Counts) => 5,
        _ => 6,
    }
}

/// Both over time, a panel for each channel, and below it one for their difference.
pub fn drawn(compared: &Comparison, names: [&str; 2]) -> Drawn {
    let mut channels: Vec<&Difference> = compared.channels.iter().collect();
    channels.sort_by_key(|channel| place(channel.channel));
    let of_channel = |channel: &&Difference| {
        let both =
            Panel::new(channel.title()).line(names[0], channel.first.clone()).line(names[1], channel.second.clone());
        let title = channel.title_of_difference(names);
        let apart =
            channel.differs().then(|| Panel::new(&title).difference().line("difference", channel.second_less_first()));
        let is_aside = !is_of_the_motor(channel.channel);
        [both].into_iter().chain(apart).map(move |panel| panel.aside(is_aside))
    };
    (compared.interval_s, channels.iter().flat_map(of_channel).collect())
}

/// Length of the step response of models, in electromechanical time constants, and its samples.
const STEP_LENGTH: f64 = 8.0;
const STEP_SAMPLES: usize = 400;
/// Frequencies of the magnitudes, around the motor's own.
const RELATIVE_FREQUENCIES: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];
/// Points of the frequency responses in the plot, and decades on either side of the motor's own frequency.
const BODE_POINTS: usize = 120;
const BODE_DECADES: f64 = 2.0;

fn models(arguments: &Arguments) -> Result<(), Failure> {
    let models = [read_model(&arguments.first)?, read_model(&arguments.second)?];
    let corner_rad_per_s = corner_rad_per_s(&models[0]);
    let [constants, magnitudes] = [constants_of(&models), magnitudes(&models, corner_rad_per_s)];
    let interval_s = STEP_LENGTH / corner_rad_per_s / STEP_SAMPLES as f64;
    let steps = models.each_ref().map(|model| step(model.clone(), arguments.voltage, interval_s));
    let [a, b] = steps.each_ref().map(|step| step.last().copied().unwrap_or(0.0));
    let volts = short(arguments.voltage);
    let text = format!(
        "{}\n{}\n  speed after a step of {volts} V, with all effects: {} and {} rad/s\n",
        constants.text,
        magnitudes.text,
        short(a),
        short(b)
    );
    let result = json!({
        "parameters": constants.json, "magnitudes": magnitudes.json,
        "step": { "voltage_V": arguments.voltage, "first_rad_per_s": a, "second_rad_per_s": b },
    });
    let [first, second] = steps;
    let names = arguments.names();
    let names = names.each_ref().map(String::as_str);
    let step = Panel::new("speed after the step, rad/s").line(names[0], first).line(names[1], second);
    let [gain, phase] = bode(&models, names, corner_rad_per_s);
    let verdict = format!("after {volts} V they turn at {} and {} rad/s", short(a), short(b));
    let figures = html! {
        (page_table(&["constant", names[0], names[1], "change"], constants.rows))
        p { "Magnitude of speed over voltage of the linear part, in dB re 1 rad/s/V:" }
        (page_table(&["Hz", names[0], names[1], "change"], magnitudes.rows))
    };
    finish(arguments, &result, Said { verdict: &verdict, text: &text, figures }, &(interval_s, vec![step, gain, phase]))
}

/// A table of two models, for a terminal, a page and a program.
#[derive(Default)]
struct SideBySide {
    text: String,
    rows: Vec<[Markup; 4]>,
    json: Vec<Value>,
}

/// The constants of motor and effects. One that both models leave at its default is left out.
fn constants_of(models: &[Model; 2]) -> SideBySide {
    let mut table = SideBySide {
        text: format!("  {:<42} {:>10} {:>10} {:>10}\n", "constant", "first", "second", "change"),
        ..SideBySide::default()
    };
    let mut row = |name: &str, a: Option<f64>, b: Option<f64>| {
        let change = a.zip(b).filter(|(a, _)| *a != 0.0).map(|(a, b)| 100.0 * (b / a - 1.0));
        let or_dash = |value: Option<f64>| value.map_or("-".into(), short);
        let percent = change.map_or("-".into(), |change| format!("{} %", short(change)));
        table.text += &format!("  {name:<42} {:>10} {:>10} {percent:>10}\n", or_dash(a), or_dash(b));
        table.rows.push([code([name]), number(or_dash(a)), number(or_dash(b)), number(percent)]);
        table.json.push(json!({ "name": name, "first": a, "second": b, "change_percent": change }));
    };
    for ((name, a), (_, b)) in models[0].motor.named().into_iter().zip(models[1].motor.named()) {
        row(name, Some(a), Some(b));
    }
    for effect in motorbench_model::catalogue::CATALOGUE {
        let about = effect.about();
        let of = |model: &Model, index: usize| model.term(about.id).map(|term| term.values[index]);
        for (index, parameter) in about.parameters.iter().enumerate() {
            let (a, b) = (of(&models[0], index), of(&models[1], index));
            if [a, b].into_iter().flatten().any(|value| Some(value) != parameter.default) {
                row(&format!("{}.{}", about.id, parameter.name), a, b);
            }
        }
    }
    table
}

/// Magnitudes of speed over voltage of the linear parts, around this frequency.
fn magnitudes(models: &[Model; 2], corner_rad_per_s: f64) -> SideBySide {
    let mut table = SideBySide {
        text: "  magnitude of speed over voltage (linear part), dB re 1 rad/s/V\n".into(),
        ..SideBySide::default()
    };
    for relative in RELATIVE_FREQUENCIES {
        let omega = relative * corner_rad_per_s;
        let [a, b] = [0, 1].map(|index| 20.0 * speed(&models[index].motor).at(Complex::new(0.0, omega)).norm().log10());
        table.text += &format!("  {:>10} Hz {a:>29.2} {b:>12.2} {:>7} dB\n", short(omega / TAU), fixed(b - a, 2));
        table.rows.push([short(omega / TAU), fixed(a, 2), fixed(b, 2), fixed(b - a, 2)].map(number));
        table.json.push(json!({ "frequency_Hz": omega / TAU, "first_dB": a, "second_dB": b }));
    }
    table
}

/// Gain and phase of the linear parts, around the motor's own frequency.
fn bode(models: &[Model; 2], names: [&str; 2], corner_rad_per_s: f64) -> [Panel; 2] {
    let omegas: Vec<f64> = (0..=BODE_POINTS)
        .map(|point| corner_rad_per_s * 10f64.powf(BODE_DECADES * (2.0 * point as f64 / BODE_POINTS as f64 - 1.0)))
        .collect();
    let frequencies_hz: Vec<f64> = omegas.iter().map(|omega| omega / TAU).collect();
    let panel = |title: &str, of: fn(Complex<f64>) -> f64| {
        let line =
            |model: &Model| omegas.iter().map(|omega| of(speed(&model.motor).at(Complex::new(0.0, *omega)))).collect();
        Panel::over_frequencies(title, frequencies_hz.clone())
            .line(names[0], line(&models[0]))
            .line(names[1], line(&models[1]))
    };
    [
        panel("gain, dB re 1 rad/s/V", |response| 20.0 * response.norm().log10()),
        panel("phase, degrees", |response| response.arg().to_degrees()),
    ]
}

/// k^2 / (J R): the electromechanical corner.
fn corner_rad_per_s(model: &Model) -> f64 {
    let motor = &model.motor;
    motor.torque_constant_nm_per_a.powi(2) / (motor.inertia_kg_m2 * motor.resistance_ohm)
}

fn step(model: Model, voltage_v: f64, interval_s: f64) -> Vec<f64> {
    let mut plant = ModelPlant::new(model);
    let inputs = Inputs { bridge: Bridge::Forward, supply_v: voltage_v, ..Inputs::default() };
    (0..STEP_SAMPLES)
        .map(|_| {
            plant.advance(interval_s, &inputs);
            plant.speed_rad_per_s()
        })
        .collect()
}

/// A constant that differs by more is another one.
const FAR: f64 = 2.0;

/// Constants with intervals, and their difference in standard deviations.
fn constants(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(path) = &arguments.plot {
        let path = path.display();
        return Err(Failure::input(format!(
            "{path}: constants have no plot. Compare recordings or models, or omit --plot"
        )));
    }
    let read = |path: &Path| -> Result<Value, Failure> {
        let failed = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
        let text = text_file::read(path, "JSON of identify or diagnose").map_err(|error| failed(&error))?;
        let value: Value = serde_json::from_str(&text).map_err(|error| failed(&error))?;
        let parameters = value["parameters"].as_object().filter(|parameters| !parameters.is_empty());
        parameters.cloned().map(Value::Object).ok_or_else(|| {
            failed(&"no \"parameters\": expected a result of `motorbench identify --json` or `diagnose --json`")
        })
    };
    let (first, second) = (read(&arguments.first)?, read(&arguments.second)?);
    let mut text = format!("  {:<28} {:>12} {:>12} {:>8}\n", "constant", "first", "second", "sigmas");
    let (mut rows, mut cells, mut far) = (Vec::new(), Vec::new(), 0);
    for (name, a) in first.as_object().into_iter().flatten() {
        let end = |of: &Value, side: usize| of["ci95"][side].as_f64();
        let known = |of: &Value| Some((of["value"].as_f64()?, 0.5 * (end(of, 1)? - end(of, 0)?) / Z95));
        let Some(((a, a_error), (b, b_error))) = known(a).zip(known(&second[name])) else { continue };
        let sigmas = (b - a) / a_error.hypot(b_error).max(f64::MIN_POSITIVE);
        text += &format!("  {name:<28} {:>12} {:>12} {sigmas:>8.1}\n", short(a), short(b));
        cells.push([code([&**name]), number(short(a)), number(short(b)), number(format!("{sigmas:.1}"))]);
        far += usize::from(sigmas.abs() > FAR);
        rows.push(json!({ "name": name, "first": a, "second": b, "sigmas": sigmas }));
    }
    let verdict = format!("{far} of {} constants differ by more than {FAR} standard deviations", rows.len());
    let [first, second] = arguments.names();
    let figures = page_table(&["constant", &first, &second, "standard deviations"], cells);
    finish(
        arguments,
        &json!({ "parameters": rows }),
        Said { verdict: &verdict, text: &text, figures },
        &(1.0, Vec::new()),
    )
}

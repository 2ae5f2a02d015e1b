//! `motorbench validate`: measured closed loops compared with simulated ones.

mod page;
mod pairing;

use super::compare::{Drawn, agreement, drawn, is_of_the_motor, place};
use super::files::beside;
use super::simulate::{judged, trip_name};
use super::{
    Failure, JSON_TO, Outputs, TERMINAL, open_next, plot_file, provenance, read_recording, rig_file, rig_for, spinner,
    write, write_json, write_plot,
};
use clap::Args;
use host_sim::figures::Figures;
use host_sim::scenario::Scenario;
use host_sim::trial::Point;
use motorbench_core::message::Trip;
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::Rig;
use motorbench_design::law::ControlLaw;
use motorbench_diagnosis::compare::{Comparison, Difference};
use motorbench_diagnosis::dataset::contradictions;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_report::comparison_page::{self, Compared};
use motorbench_report::diagnosis_text::verdict;
use motorbench_report::panels::{Panel, panels};
use motorbench_report::plot::capital;
use motorbench_report::web_page::Provenance;
use page::{figures_html, page};
use pairing::{NOTHING_BEYOND, agrees_by_course, agrees_by_mode, compared, is_short};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Compares measured closed loops with simulated ones: one plot, fit per channel, figures of both, and what the model lacks.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench validate loop.csv --scenario loop.scenario.toml \\
    --rig loop.rig.toml --model found.toml --plot both.svg
  motorbench validate pid.csv lqr.csv --model found.toml --plot laws.svg

motorbench record writes the scenario beside the recording. It has the recorded
references and settings: docs/reference/scenarios.md

If the simulated drive switches itself off, the comparison ends there and the
exit code is 1, as with simulate.")]
pub struct Arguments {
    /// Recordings of loops. Each begins with its scenario, or up to a quarter of its length earlier. Several, for instance of
    /// PID and LQR, share one table.
    #[arg(required = true, value_name = "MEASURED.csv")]
    measured: Vec<PathBuf>,
    /// The recorded scenario, one for each recording in their order; default: NAME.scenario.toml beside NAME.csv.
    #[arg(long, value_name = "SCENARIO.toml")]
    scenario: Vec<PathBuf>,
    /// Model to use instead of the scenario's.
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// Rig file (TOML); default: NAME.rig.toml beside the first recording, if there is one.
    #[arg(long)]
    rig: Option<PathBuf>,
    /// A column that has another name or unit: speed=omega_rad_per_s*6.2832, pwm=duty/255.
    #[arg(long = "column", visible_alias = "map", value_name = "NAME=CHANNEL")]
    columns: Vec<Mapping>,
    /// Draws all loops, simulated and measured.
    #[arg(long, value_name = "FILE.svg|png", value_parser = plot_file)]
    plot: Option<PathBuf>,
    /// Writes a page with plots and figures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Prints the result as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// One loop, measured and simulated.
struct Loop {
    /// Its law, or its file if another loop has the same law.
    name: String,
    scenario: Scenario,
    measured: Recording,
    compared: Comparison,
    /// Simulated, measured.
    figures: [Vec<Figures>; 2],
    /// Trip of the simulated drive, and its time.
    trip: Trip,
    trip_s: Option<f64>,
    /// An outcome that the scenario does not expect.
    unexpected: Option<Failure>,
    /// Notes for the reader of the comparison.
    notes: Vec<String>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with file and what to do.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.outputs(&[])?;
    let rig = arguments.rig()?;
    let mut loops = Vec::new();
    for (measured, scenario) in arguments.measured.iter().zip(arguments.scenarios()?) {
        loops.push(Loop::new(arguments, measured, &scenario, &rig)?);
    }
    let outputs = arguments.outputs(&loops)?;
    name(&mut loops, &arguments.measured);
    let bar = spinner();
    let remaining = remaining(&loops, &rig, &|text| bar.set_message(text.to_string()));
    bar.finish_and_clear();
    let text = page(&loops, &remaining);
    let (interval_s, drawn) = picture(&loops);
    if let Some(path) = &arguments.plot {
        write_plot(path, &panels(interval_s, &drawn))?;
    }
    if let Some(path) = &arguments.report {
        let compared = Compared {
            title: "motorbench validate",
            kind: "Closed loops, measured and simulated",
            verdict: sentence(&loops),
            conclusions: conclusions(&loops, &remaining),
            panels: &drawn,
            interval_s,
            figures: figures_html(&loops),
        };
        write(path, &comparison_page::html(&compared, arguments.provenance()))?;
    }
    if let Some(path) = &arguments.json {
        write_json(path, &result(&loops, &remaining))?;
    }
    outputs.say(&text);
    outputs.wrote(&open_next(arguments.report.as_deref()));
    match loops.into_iter().find_map(|one| Some((one.name, one.unexpected?))) {
        Some((name, failure)) => Err(Failure { message: format!("{name}, simulated: {}", failure.message), ..failure }),
        None => Ok(()),
    }
}

/// How well the loops agree in what the motor does and in its current, in a sentence.
fn sentence(loops: &[Loop]) -> String {
    let of_loop =
        |one: &Loop| format!("{}: simulation and measurement {}.", capital(&one.name), agreement(&one.compared));
    loops.iter().map(of_loop).collect::<Vec<_>>().join(" ")
}

/// What the page says below: what the models lack, and notes on the recordings.
fn conclusions(loops: &[Loop], remaining: &[String]) -> Vec<String> {
    let notes = loops.iter().flat_map(|one| one.notes.iter().map(|note| format!("{}: {note}", one.name)));
    remaining
        .iter()
        .cloned()
        .chain(notes)
        .map(|text| capital(&text) + if text.ends_with('.') { "" } else { "." })
        .collect()
}

impl Arguments {
    /// Where the page comes from.
    fn provenance(&self) -> Provenance {
        let from = provenance::of_files(self.measured.iter().map(PathBuf::as_path));
        let from = provenance::with(from, "Rig file", self.rig.as_deref());
        let from = provenance::with(from, "Model", self.model.as_deref());
        self.scenario.iter().fold(from, |from, scenario| provenance::with(from, "Scenario", Some(scenario)))
    }

    /// The scenarios of the recordings.
    fn scenarios(&self) -> Result<Vec<PathBuf>, Failure> {
        if self.scenario.is_empty() {
            return self.measured.iter().map(|measured| scenario_beside(measured)).collect();
        }
        if self.scenario.len() != self.measured.len() {
            let (recordings, scenarios) = (self.measured.len(), self.scenario.len());
            return Err(Failure::input(format!(
                "recordings: {recordings}, scenarios: {scenarios}: give one --scenario for each recording, in their order. Or give none, to use the files that motorbench record writes beside them"
            )));
        }
        Ok(self.scenario.clone())
    }

    /// The loops name additional input files.
    fn outputs(&self, loops: &[Loop]) -> Result<Outputs, Failure> {
        let scenarios = self.scenarios()?;
        let models = loops.iter().filter_map(|one| one.scenario.model_file.as_ref());
        let rig = rig_file(self.rig.as_deref(), self.measured.first().map(PathBuf::as_path));
        let read = self.measured.iter().chain(&scenarios).chain(&self.model).chain(&rig).chain(models);
        Outputs::new(read, self.plot.iter().chain(&self.report).chain(&self.json))
    }

    fn rig(&self) -> Result<Rig, Failure> {
        rig_for(self.rig.as_deref(), self.measured.first().map(PathBuf::as_path))
    }
}

/// The scenario beside a recording.
fn scenario_beside(measured: &Path) -> Result<PathBuf, Failure> {
    let scenario = beside(measured, "scenario.toml");
    if scenario.exists() {
        return Ok(scenario);
    }
    let missing = scenario.display();
    Err(Failure::input(format!("{missing} does not exist: give the recorded scenario with --scenario")))
}

impl Loop {
    fn new(arguments: &Arguments, file: &Path, scenario_file: &Path, rig: &Rig) -> Result<Self, Failure> {
        let measured = read_recording(file, &arguments.columns)?;
        let scenario = super::scenario(scenario_file, arguments.model.as_deref())?;
        let is_not_of = |why: String| {
            let (file, scenario) = (file.display(), scenario_file.display());
            Failure::input(format!("{file} is not a recording of {scenario}: {why}. Give its scenario with --scenario"))
        };
        let unknown = agrees_by_mode(&scenario, &measured, file).map_err(is_not_of)?;
        let outcome = scenario.run().map_err(Failure::input)?;
        let judged = judged(&scenario, &outcome);
        // Only the time with an active drive is compared.
        let until_s = outcome.trip_s.filter(|_| judged.is_err());
        let (compared, moved) = compared(&scenario, &outcome.recording, &measured, until_s)?;
        agrees_by_course(&scenario, &compared).map_err(is_not_of)?;
        let figures = [(&outcome.recording, 0.0), (&moved, compared.delay_s)].map(|(recording, late_s)| {
            let mut points = points(recording, rig, late_s);
            points.retain(|point| until_s.is_none_or(|until_s| point.t_s < until_s));
            scenario.figures(&points)
        });
        let cut = until_s
            .and(judged.as_ref().err())
            .map(|off| format!("in the simulation {}; {NOTHING_BEYOND}", off.message));
        let short = || is_short(&scenario, &compared);
        let contradicted = contradictions(&measured, rig).into_iter().map(|found| found.note());
        let notes = contradicted.chain([unknown, cut.or_else(short)].into_iter().flatten()).collect();
        Ok(Self {
            name: title(&scenario).into(),
            scenario,
            measured,
            compared,
            figures,
            trip: outcome.trip,
            trip_s: outcome.trip_s,
            unexpected: judged.err(),
            notes,
        })
    }
}

/// Name of a scenario's loop.
fn title(scenario: &Scenario) -> &'static str {
    ControlLaw::ALL.into_iter().find(|law| law.mode() == scenario.mode).map_or("open loop", ControlLaw::title)
}

/// Loops of the same law are named by their files.
fn name(loops: &mut [Loop], files: &[PathBuf]) {
    let laws: Vec<String> = loops.iter().map(|one| one.name.clone()).collect();
    for (index, one) in loops.iter_mut().enumerate() {
        if laws.iter().filter(|law| **law == laws[index]).count() > 1 {
            one.name = files[index].file_stem().unwrap_or_default().to_string_lossy().into();
        }
    }
}

/// As JSON: an object for one loop, a list for several.
fn result(loops: &[Loop], remaining: &[String]) -> Value {
    let figures = |one: &Loop| json!({ "simulated": one.figures[0], "measured": one.figures[1] });
    if let [only] = loops {
        return json!({
            "comparison": only.compared, "figures": figures(only), "trip": trip_name(only.trip), "trip_s": only.trip_s,
            "notes": only.notes, "remaining": remaining
        });
    }
    let list = loops.iter().map(|one| {
        let law = ControlLaw::ALL.into_iter().find(|law| law.mode() == one.scenario.mode);
        json!({
            "name": one.name, "law": law, "comparison": one.compared, "figures": figures(one), "trip": trip_name(one.trip),
            "trip_s": one.trip_s, "notes": one.notes
        })
    });
    json!({ "loops": list.collect::<Vec<_>>(), "remaining": remaining })
}

/// One loop: a plot as in `compare`. Several: all channels that they share, over the time of the first. Each loop has a
/// plot of its own, as what is measured has one colour; their differences are in one.
fn picture(loops: &[Loop]) -> Drawn {
    if let [only] = loops {
        return drawn(&only.compared, ["simulated", "measured"]);
    }
    let interval_s = loops[0].compared.interval_s;
    let sampled = |one: &Loop, values: &[f64]| -> Vec<f64> {
        let step = interval_s / one.compared.interval_s;
        let places = (0..).map(|index| (f64::from(index) * step).round() as usize);
        places.map_while(|place| values.get(place).copied()).collect()
    };
    let of_channel = |channel: &str| {
        let found: Vec<_> = loops.iter().map(|one| (one, difference(one, channel))).collect();
        let title = found[0].1.title();
        let each = found.iter().map(|(one, difference)| {
            Panel::new(title)
                .about(&one.name)
                .line(&format!("{}, simulated", one.name), sampled(one, &difference.first))
                .line(&format!("{}, measured", one.name), sampled(one, &difference.second))
        });
        let each: Vec<Panel> = each.collect();
        let apart = found.iter().any(|(_, difference)| difference.differs()).then(|| {
            let new = Panel::new(&found[0].1.title_of_difference(["simulated", "measured"])).difference();
            found.iter().fold(new, |panel, (one, difference)| {
                panel.line(&one.name, sampled(one, &difference.second_less_first()))
            })
        });
        let is_aside = !is_of_the_motor(channel);
        each.into_iter().chain(apart).map(move |panel| panel.aside(is_aside))
    };
    (interval_s, shared(loops).into_iter().flat_map(of_channel).collect())
}

/// Channels that all loops have.
fn shared(loops: &[Loop]) -> Vec<&'static str> {
    let has = |one: &Loop, name: &str| one.compared.channels.iter().any(|channel| channel.channel == name);
    let of_first = loops[0].compared.channels.iter().map(|channel| channel.channel);
    let mut shared: Vec<&str> = of_first.filter(|name| loops.iter().all(|one| has(one, name))).collect();
    shared.sort_by_key(|channel| place(channel));
    shared
}

fn difference<'a>(one: &'a Loop, channel: &str) -> &'a Difference {
    one.compared.channels.iter().find(|found| found.channel == channel).expect("all loops have it")
}

/// A recording for the figures, from the start of the scenario on. `late_s`: by how much it began earlier.
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
    // Without a position reference, the zero of the angle has no meaning.
    let origin = angle.first().filter(|_| recording.get(Channel::AngleReference).is_none());
    let origin_rad = origin.copied().unwrap_or(0.0);
    (0..time_s.len())
        .filter(|index| time_s[*index] >= start_s)
        .map(|index| Point {
            t_s: time_s[index] - start_s,
            reference: reference[index],
            u_v: voltage[index],
            measured_rad_per_s: speed[index],
            omega_rad_per_s: speed[index],
            theta_rad: angle[index] - origin_rad,
            i_a: current[index],
            limited: false,
        })
        .collect()
}

/// Effects that a diagnosis of the measured loops names and the scenarios lack, or why there is no diagnosis.
fn remaining(loops: &[Loop], rig: &Rig, progress: motorbench_diagnosis::diagnose::select::Progress) -> Vec<String> {
    let measured: Vec<Recording> = loops.iter().map(|one| one.measured.clone()).collect();
    match diagnose(&measured, rig, progress) {
        Err(error) => vec![format!("no diagnosis of what remains: {error}")],
        Ok(diagnosis) => {
            let causes = &diagnosis.outcome.causes;
            // Known loads of the scenario are no effects.
            let in_scenario = |one: &Loop, id: &str| {
                one.scenario.model.has(id) || id == "load_step" && !one.scenario.loads.is_empty()
            };
            let known = |id: &str| loops.iter().all(|one| in_scenario(one, id));
            let new: Vec<&str> = causes.iter().map(|cause| cause.effect.as_str()).filter(|id| !known(id)).collect();
            let lacks = match new.is_empty() {
                true => "the model has every effect that the measured loop shows".to_string(),
                false => format!("the measured loop shows what the model lacks: {}", new.join(", ")),
            };
            let verdict = verdict(&diagnosis.outcome).replace('\n', " ");
            let alone = format!("Diagnosis of the measured loop alone: {verdict}");
            vec![lacks, alone]
        }
    }
}

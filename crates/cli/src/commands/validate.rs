//! `motorbench validate`: measured closed loops compared with simulated ones.

use super::compare::{Drawn, drawn, table};
use super::files::{beside, side_file};
use super::simulate::{judged, trip_name};
use super::{
    Failure, JSON_TO, Outputs, TERMINAL, plot_file, provenance, read_recording, rig_file, rig_for, spinner, write,
    write_json, write_plot,
};
use clap::Args;
use host_sim::figures::{Figures, JUMP};
use host_sim::scenario::Scenario;
use host_sim::trial::Point;
use motorbench_core::message::Trip;
use motorbench_core::settings::Param;
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::Rig;
use motorbench_design::law::ControlLaw;
use motorbench_diagnosis::compare::{Comparison, Difference, compare, distance};
use motorbench_diagnosis::dataset::{contradictions, median};
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_report::comparison_page::{self, Compared};
use motorbench_report::diagnosis_text::verdict;
use motorbench_report::panels::{Panel, panels};
use motorbench_report::web_page::Provenance;
use motorbench_text::terminal_text::{rounded, short, wrapped};
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
        let (title, kind, verdict) = ("motorbench validate", "Closed loops, measured and simulated", sentence(&loops));
        let compared = Compared { title, kind, verdict, panels: &drawn, interval_s, figures: &text };
        write(path, &comparison_page::html(&compared, arguments.provenance()))?;
    }
    if let Some(path) = &arguments.json {
        write_json(path, &result(&loops, &remaining))?;
    }
    outputs.say(&text);
    outputs.wrote("");
    match loops.into_iter().find_map(|one| Some((one.name, one.unexpected?))) {
        Some((name, failure)) => Err(Failure { message: format!("{name}, simulated: {}", failure.message), ..failure }),
        None => Ok(()),
    }
}

/// How well the channels of the loops agree, in a sentence.
fn sentence(loops: &[Loop]) -> String {
    let of_loop = |one: &Loop| {
        let fits = one.compared.channels.iter().filter_map(|channel| Some((channel.title(), channel.fit_percent?)));
        let fits: Vec<String> = fits.map(|(title, fit)| format!("{title}: {fit:.0} %")).collect();
        format!("{}, simulated and measured, agree by {}", one.name, fits.join("; "))
    };
    loops.iter().map(of_loop).collect::<Vec<_>>().join(". ")
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

/// Note about a simulated drive that has tripped.
const NOTHING_BEYOND: &str = "the comparison ends there";

/// Pairs the measured loop with the simulated one, whose drive may have tripped. Returns them as compared, from the
/// origin of the simulation.
fn compared(
    scenario: &Scenario,
    simulated: &Recording,
    measured: &Recording,
    until_s: Option<f64>,
) -> Result<(Comparison, Recording), Failure> {
    let upto = until_s.map_or_else(|| simulated.clone(), |until_s| simulated.before(until_s));
    // The delay is determined by the references up to that time.
    let mut blank = simulated.clone();
    for channel in simulated.channels().filter(|channel| *channel != Channel::Time) {
        let values = simulated.get(channel).unwrap_or_default().iter().enumerate();
        blank.set(channel, values.map(|(row, value)| if row < upto.len() { *value } else { f64::NAN }).collect());
    }
    // The simulation comes first: its times are those of the scenario.
    let asked = compare(&blank, measured, None).map_err(Failure::input)?;
    let moved = from_origin(scenario, &asked, measured);
    let compared = compare(&upto, &moved, Some(asked.delay_s)).map_err(Failure::input)?;
    Ok((compared, moved))
}

/// The measured loop with the positions of the simulated one. A loop starts at any angle, and its sequence is relative
/// to that.
fn from_origin(scenario: &Scenario, asked: &Comparison, measured: &Recording) -> Recording {
    let mut moved = measured.clone();
    let column = Channel::AngleReference.column();
    let Some(reference) = asked.channels.iter().find(|found| found.channel == column) else { return moved };
    let origin_rad = median(reference.second_less_first().into_iter());
    let counts_per_rad = f64::from(scenario.settings.get(Param::CountsPerRev)) / TAU;
    for (channel, per_rad) in [(Channel::AngleReference, 1.0), (Channel::Angle, 1.0), (Channel::Counts, counts_per_rad)]
    {
        if let Some(values) = measured.get(channel) {
            moved.set(channel, values.iter().map(|value| value - origin_rad * per_rad).collect());
        }
    }
    moved
}

/// The column with the reference of a mode; an open loop has none.
fn reference(scenario: &Scenario) -> Option<Channel> {
    match scenario.mode {
        mode if mode.is_speed() => Some(Channel::SpeedReference),
        mode if mode.is_position() => Some(Channel::AngleReference),
        _ => None,
    }
}

/// Whether a recording has the reference of the scenario's mode. If this cannot be checked, a note says so.
fn agrees_by_mode(scenario: &Scenario, measured: &Recording, file: &Path) -> Result<Option<String>, String> {
    let wanted = reference(scenario);
    let has =
        [Channel::SpeedReference, Channel::AngleReference].into_iter().find(|channel| measured.get(*channel).is_some());
    let mode = format!("that is of the {}", title(scenario));
    match (wanted, has) {
        (Some(wanted), _) if measured.get(wanted).is_some() => Ok(None),
        (None, None) => Ok(None),
        (_, Some(other)) => Err(format!("{mode}, the recording has a column {}", other.column())),
        (Some(wanted), None) if side_file(file).is_some() => {
            Err(format!("{mode}, the recording of an open loop, without a column {}", wanted.column()))
        }
        (Some(wanted), None) => {
            let (file, column) = (file.display(), wanted.column());
            Ok(Some(format!("{file} has no {column}, so the program cannot check that it belongs to this scenario")))
        }
    }
}

/// Largest share of the reference by which two references may differ. The second value is for open loop, where limits
/// of the motor change the voltage.
const SAME_COURSE: f64 = 0.25;
const SAME_VOLTAGE: f64 = 0.5;

/// Whether the recording has the same reference as the simulation.
fn agrees_by_course(scenario: &Scenario, compared: &Comparison) -> Result<(), String> {
    let (channel, most) =
        reference(scenario).map_or((Channel::Voltage, SAME_VOLTAGE), |channel| (channel, SAME_COURSE));
    let Some(asked) = compared.channels.iter().find(|found| found.channel == channel.column()) else { return Ok(()) };
    let (apart, _) = distance(&asked.first, &asked.second);
    let (size, _) = distance(&asked.first, &vec![0.0; asked.first.len()]);
    match apart > most * size {
        true => Err(format!("{} of the two differ by {} rms", asked.channel, short(apart))),
        false => Ok(()),
    }
}

/// Share of the scenario below which a note reports a short recording.
const WHOLE: f64 = 0.95;

fn is_short(scenario: &Scenario, compared: &Comparison) -> Option<String> {
    let Comparison { duration_s, .. } = compared;
    (*duration_s < WHOLE * scenario.duration_s).then(|| {
        format!("the scenario lasts {} s; the recording has {} s of it", short(scenario.duration_s), short(*duration_s))
    })
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

/// One loop: a plot as in `compare`. Several: all channels that they share, over the time of the first, and the
/// differences.
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
        let both = found.iter().fold(Panel::new(title), |panel, (one, difference)| {
            panel
                .line(&format!("{}, simulated", one.name), sampled(one, &difference.first))
                .line(&format!("{}, measured", one.name), sampled(one, &difference.second))
        });
        let apart = found.iter().any(|(_, difference)| difference.differs()).then(|| {
            let new = Panel::new(&found[0].1.title_of_difference(["simulated", "measured"]));
            found.iter().fold(new, |panel, (one, difference)| {
                panel.line(&one.name, sampled(one, &difference.second_less_first()))
            })
        });
        [both].into_iter().chain(apart)
    };
    (interval_s, shared(loops).into_iter().flat_map(of_channel).collect())
}

/// Channels that all loops have.
fn shared(loops: &[Loop]) -> Vec<&'static str> {
    let has = |one: &Loop, name: &str| one.compared.channels.iter().any(|channel| channel.channel == name);
    let of_first = loops[0].compared.channels.iter().map(|channel| channel.channel);
    of_first.filter(|name| loops.iter().all(|one| has(one, name))).collect()
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

fn page(loops: &[Loop], remaining: &[String]) -> String {
    let mut text = match loops {
        [only] => {
            let (table, figures) = (table(&only.compared), figures_table(&only.figures));
            let between = if figures.is_empty() { "" } else { "\n" };
            format!("Measured (second) against simulated (first)\n{table}{between}{figures}")
        }
        _ => side_by_side(loops),
    };
    for one in loops {
        let name = if loops.len() > 1 { format!("{}: ", one.name) } else { String::new() };
        one.notes.iter().for_each(|note| text += &format!("\n{}", wrapped(&format!("{name}{note}"), "", "  ")));
    }
    text.push('\n');
    for line in remaining {
        line.lines().for_each(|line| text += &wrapped(line, "", "  "));
    }
    text
}

/// Figures of one loop, a line each.
fn figures_table(figures: &[Vec<Figures>; 2]) -> String {
    if figures[0].is_empty() {
        // An open loop has no reference.
        return String::new();
    }
    let mut text = String::from("  at, s    figure                     simulated     measured\n");
    for (simulated, measured) in figures[0].iter().zip(&figures[1]) {
        let rows = [
            ("rise, s", simulated.rise_s, measured.rise_s),
            ("settling, s", simulated.settling_s, measured.settling_s),
            ("overshoot, %", simulated.overshoot_percent, measured.overshoot_percent),
            ("steady error", simulated.steady_error, measured.steady_error),
            ("tracking error, rms", Some(simulated.tracking_rms), Some(measured.tracking_rms)),
        ];
        let largest = simulated.largest_error.map(|error| ("largest error", Some(error), measured.largest_error));
        // A continuous reference has no rise time.
        let told = |(_, simulated, measured): &(_, Option<f64>, Option<f64>)| simulated.is_some() || measured.is_some();
        for (name, simulated_value, measured_value) in rows.into_iter().chain(largest).filter(told) {
            let (time, a, b) = (short(simulated.time_s), or_dash(simulated_value, 3), or_dash(measured_value, 3));
            text += &format!("  {time:<8} {name:<22} {a:>13} {b:>12}\n");
        }
    }
    text
}

fn or_dash(value: Option<f64>, digits: i32) -> String {
    value.filter(|value| value.is_finite()).map_or("-".into(), |value| rounded(value, digits))
}

/// Channels in the table of several loops, as many as fit a line.
const TABLE_CHANNELS: usize = 4;
/// References of two loops are the same if their times differ by less than this.
const SAME_TIME_S: f64 = 0.02;

/// Fit of each loop, and figures of each reference, with the loops in rows.
fn side_by_side(loops: &[Loop]) -> String {
    let told = |channel: &&str| *channel != "duty" && !channel.starts_with("ref_");
    let channels: Vec<&str> = shared(loops).into_iter().filter(told).take(TABLE_CHANNELS).collect();
    let mut text = String::from("Measured against simulated: fit in % (rms of the difference)\n  loop        ");
    channels.iter().for_each(|channel| text += &format!("{channel:>16}"));
    for one in loops {
        text += &format!("\n  {:<12.12}", one.name);
        for channel in &channels {
            let found = difference(one, channel);
            let fit = found.fit_percent.map_or("-".into(), |fit| format!("{fit:.1}"));
            text += &format!("{:>16}", format!("{fit} ({})", rounded(found.rms, 2)));
        }
    }
    text.push('\n');
    if !same_course(loops) {
        text += "\nThe loops follow different courses: each by itself.\n";
        for one in loops {
            text += &format!("\n{}\n{}", one.name, figures_table(&one.figures));
        }
        return text;
    }
    for (index, first) in loops[0].figures[0].iter().enumerate() {
        text += &format!("\n  {:<22}", format!("{} at {} s", first.course, short(first.time_s)));
        text.extend(COLUMNS.map(|title| format!("{title:>8}")));
        text.push('\n');
        for one in loops {
            for (source, figures) in ["simulated", "measured"].into_iter().zip(&one.figures) {
                let Some(figures) = figures.get(index) else { continue };
                text += &format!("  {:<12.12} {source:<9}{}\n", one.name, cells(figures));
            }
        }
    }
    text + "\n" + &wrapped(&ranking(loops), "", "  ")
}

/// Titles of [`cells`].
const COLUMNS: [&str; 7] = ["rise, s", "settled", "over, %", "error", "summed", "rms, V", "peak, A"];

fn cells(figures: &Figures) -> String {
    let cells = [
        (figures.rise_s, 3),
        (figures.settling_s, 3),
        (figures.overshoot_percent, 3),
        (figures.steady_error, 2),
        (Some(figures.iae), 3),
        (Some(figures.effort_v), 3),
        (Some(figures.peak_a), 3),
    ];
    cells.into_iter().map(|(value, digits)| format!("{:>8}", or_dash(value, digits))).collect()
}

/// Whether all loops had the same references in the same order.
fn same_course(loops: &[Loop]) -> bool {
    let first = &loops[0].figures[0];
    let same = |a: &Figures, b: &Figures| {
        a.course == b.course && (a.time_s - b.time_s).abs() < SAME_TIME_S && (a.to - b.to).abs() <= 1e-3 * b.to.abs()
    };
    !first.is_empty()
        && loops.iter().all(|one| {
            let figures = &one.figures[0];
            figures.len() == first.len() && figures.iter().zip(first).all(|(a, b)| same(a, b))
        })
}

/// The loop with the smallest summed error, and whether the simulation predicted it.
fn ranking(loops: &[Loop]) -> String {
    // A jump belongs to its sequence.
    let references = |figures: &&Figures| figures.course != JUMP;
    let sum = |figures: &[Figures]| figures.iter().filter(references).map(|figures| figures.iae).sum::<f64>();
    let sums: Vec<[f64; 2]> = loops.iter().map(|one| one.figures.each_ref().map(|figures| sum(figures))).collect();
    let least = |source: usize| (0..loops.len()).min_by(|a, b| sums[*a][source].total_cmp(&sums[*b][source]));
    let (Some(simulated), Some(measured)) = (least(0), least(1)) else { return String::new() };
    let each = loops.iter().zip(&sums).map(|(one, [simulated, measured])| {
        format!("{} {} ({})", one.name, rounded(*measured, 4), rounded(*simulated, 4))
    });
    let predicted = match simulated == measured {
        true => "as simulated".to_string(),
        false => format!("in simulation the {}", loops[simulated].name),
    };
    format!(
        "Summed error over all references, measured (simulated): {}. The {} has the smallest, {predicted}.",
        each.collect::<Vec<_>>().join(", "),
        loops[measured].name
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_loop_has_no_table_of_figures() {
        assert_eq!(figures_table(&[Vec::new(), Vec::new()]), "");
    }
}

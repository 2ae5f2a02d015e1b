//! `motorbench record`: an excitation played on a board, and the recording of it.

use super::files::{beside, free_name, with_beside};
use super::interaction::on_interrupt;
use super::live::LiveArguments;
use super::own_files::WRITTEN;
use super::port::{CONNECT, PortArguments, SAME_COUNTS};
use super::recording_files::{cannot_grow, rig_and_side, table_file, with_unwritten, write_each, write_first};
use super::send::reads_back;
use super::{Failure, JSON_TO, Outputs, TERMINAL, bar, cannot_write, read_rig, tell, write_json};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use host_sim::scenario::sequence::{self, SequenceOrder};
use indicatif::ProgressStyle;
use motorbench_core::excitation::Kind;
use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings, find};
use motorbench_data::coverage::{Coverage, Lack};
use motorbench_data::names::setting_name;
use motorbench_data::rig::{NominalMotor, Rig};
use motorbench_data::sensor_scales::SensorScales;
use motorbench_link::board::{Board, BoardError, arm, leave_host, limit, watch_host};

use motorbench_link::growing::GrowingCsv;
use motorbench_link::live::Live;
use motorbench_link::port::Port;
use motorbench_link::record::{Ended, Record, is_played, record, side_file_of_running};
use motorbench_link::{Link, Losses, OTHER_READER};
use motorbench_text::keys;
use motorbench_text::terminal_text::{quoted, wrapped};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Default duration of a random excitation.
const RANDOM_MS: u16 = 10_000;

/// Parses the console's name of an excitation; the help text lists all of them.
fn excitation_name() -> impl TypedValueParser<Value = Kind> {
    let kinds = || (0..Kind::COUNT).filter_map(Kind::from_number);
    PossibleValuesParser::new(kinds().map(sequence::name)).map(move |name| {
        kinds().find(|kind| sequence::name(*kind) == name).expect("the parser accepts only these names")
    })
}

/// Default number of repetitions: random excitations last [`RANDOM_MS`].
fn default_count(kind: Kind, period_ms: u16) -> u16 {
    match kind {
        Kind::Prbs | Kind::Levels => RANDOM_MS.div_ceil(period_ms),
        _ => 1,
    }
}

/// The mode in which the excitation is the voltage.
const OPEN: &str = "open";

/// Plays an excitation on a board and records it at full rate, with rig file and side file.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench record
  motorbench record --out motor_a.csv
  motorbench record --sequence steps --amplitude 6 --period 800 --count 4
  motorbench record --mode speed --sequence levels --amplitude 80 --out loop.csv
  motorbench record --live plotjuggler --live teleplot=192.168.1.20:47269

Without --sequence it plays identify, the 20 s that separate the most causes.
Beside run.csv, or the name of --out, it writes run.rig.toml for motorbench
diagnose, run.scenario.toml for validate, and run.json with firmware, settings
and losses. Ctrl-C stops the motor and keeps the samples that have arrived.")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Excitation to play.
    #[arg(long, default_value = "identify", value_parser = excitation_name())]
    sequence: Kind,
    /// Amplitude in the unit of the mode; default: 80 % of the supply.
    #[arg(long, allow_negative_numbers = true, value_parser = finite)]
    amplitude: Option<f64>,
    /// Offset in the unit of the mode.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    offset: f64,
    /// Duration of one part, in ms.
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u16).range(1..))]
    period: u16,
    /// Number of repetitions; default: once, or as many random levels or bits as fill 10 s.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    count: Option<u16>,
    /// Seed of random excitations.
    #[arg(long, default_value_t = 1)]
    seed: u16,
    /// Control mode: open plays a voltage, the others a reference.
    #[arg(long, default_value = OPEN, value_parser = [OPEN, "speed", "position", "lqr_speed", "lqr_position"])]
    mode: String,
    /// Setting for this recording alone: NAME=VALUE. In mode open, slew_limit is at most 500 unless it is set here.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, f64)>,
    /// A rig file with nominal constants of the motor. They are copied to the new rig file.
    #[arg(long, value_name = "RIG.toml")]
    motor: Option<PathBuf>,
    /// Output .csv; default: the first free name of run.csv, run-2.csv, ....
    #[arg(long, value_parser = table_file)]
    out: Option<PathBuf>,
    #[command(flatten)]
    live: LiveArguments,
    /// Prints the side file, which is JSON, instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// A number that the console accepts.
pub(super) fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or("expected a number, for instance 6 or -2.5".into())
}

fn assignment(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(name, value)| Some((name, finite(value).ok()?)));
    let (name, value) = parts.ok_or("expected NAME=VALUE, for instance current_limit=0")?;
    if find(name.as_bytes()).is_none() {
        let known: Vec<String> = Param::ALL.iter().map(|param| setting_name(*param)).collect();
        let meant = keys::nearest(name, known.iter().map(String::as_str));
        return Err(format!(
            "{name}: no such setting{}; `motorbench connect show` lists them",
            keys::suggestion(meant)
        ));
    }
    Ok((name.into(), value))
}

/// Runs it.
///
/// # Errors
/// [`Failure`] if nothing could be recorded, or if the recording ended early; the samples that came are written.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let out = &arguments.out.clone().unwrap_or_else(|| free_name("run", &BESIDE));
    let outputs = Outputs::new(&arguments.motor, with_beside(out, &BESIDE).iter().chain(&arguments.json))?;
    let rig = arguments.motor.as_deref().map(read_rig).transpose()?;
    let nominal = rig.as_ref().map_or_else(NominalMotor::default, |rig| rig.motor);
    // Checked before the motor turns: a wrong folder must not cost a recording.
    let mut growing = GrowingCsv::new(out).map_err(|error| cannot_write(out, &error))?;
    let stopped = on_interrupt()?;
    let mut live = arguments.live.open()?;
    let (mut link, _, before) = arguments.port.open_to_drive()?;
    if let Some(other) = rig.as_ref().and_then(|rig| other_encoder(rig, &before)) {
        tell(&arguments.port.named_in(&other));
    }
    let changed = arguments.changes(&before);
    let stop = || stopped.load(Ordering::Relaxed);
    let done = play((arguments, out), &changed, &mut link, nominal, &mut growing, &mut live, &stop);
    let put_back = put_back(&mut link, &before, &changed);
    let finished = done.and_then(|(mut done, played)| {
        // Messages about a recording name its file.
        done.samples.truncate(growing.rows());
        let not_put_back = put_back.as_ref().err().map(|failure| arguments.port.named_in(&failure.message));
        finish((arguments, out, &outputs), &done, (&link.firmware, not_put_back.as_deref()), &played, nominal)
    });
    if let (Err(_), Err(kept)) = (&finished, &put_back) {
        tell(&arguments.port.named_in(&format!("motorbench: {}", kept.message)));
    }
    finished.and(put_back)
}

/// What is wrong if the rig file has another encoder than the board.
fn other_encoder(rig: &Rig, settings: &Settings) -> Option<String> {
    let board = f64::from(settings.get(Param::CountsPerRev));
    let of_rig = rig.encoder.counts_per_rev.filter(|of_rig| (of_rig / board - 1.0).abs() > SAME_COUNTS)?;
    Some(format!(
        "the rig file has {of_rig} counts a revolution, the board {board}: all speeds are wrong by that. {CONNECT} 'set counts_per_rev {of_rig}' save` sets it, as current_gain for the current sensor"
    ))
}

/// The files beside a recording.
const BESIDE: [&str; 3] = ["scenario.toml", "rig.toml", "json"];

impl Arguments {
    /// Settings changed for this recording: those of the user, and the slew limit in open loop. With the slew limit of
    /// a loop an excitation could reverse the motor faster than the current limit reacts.
    fn changes(&self, before: &Settings) -> Vec<(String, f64)> {
        let slew_limit = Settings::defaults().get(Param::SlewLimit);
        let is_said = self.set.iter().any(|(name, _)| find(name.as_bytes()) == Some(Param::SlewLimit));
        let is_slower = self.mode == OPEN && !is_said && before.get(Param::SlewLimit) > slew_limit;
        let slower = is_slower.then(|| (setting_name(Param::SlewLimit), slew_limit.into()));
        self.set.iter().cloned().chain(slower).collect()
    }
}

/// Prepares the board, plays and records; returns the samples and the played sequence.
fn play(
    (arguments, out): (&Arguments, &Path),
    changed: &[(String, f64)],
    link: &mut Link<Port>,
    nominal: NominalMotor,
    growing: &mut GrowingCsv,
    live: &mut Option<Live>,
    stop: &dyn Fn() -> bool,
) -> Result<(Record, Played), Failure> {
    let (settings, played) = prepare(link, arguments, changed)?;
    let ticks = played.order.duration_ticks(&settings).map_err(Failure::input)?;
    let mut side = side_file_of_running(&settings, &link.firmware, &played.order.line());
    side["file"] = out.display().to_string().into();
    let files = files_beside((arguments, out), &settings, nominal, &played, ticks.into(), &side)?;
    let mut coverage = Coverage::new(&settings);
    let mut scales = SensorScales::new(&settings, &nominal);
    let bar = bar(ticks.into());
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {percent} % {elapsed}\n{msg}")
            .expect("the template is a valid constant"),
    );
    let mut done = record(link, settings, &played.order.line(), stop, &mut |came| {
        bar.inc(came.len() as u64);
        coverage.add(came);
        scales.add(came);
        bar.set_message(coverage.covered().to_string());
        send(live, came, &settings);
        if growing.rows() == 0 && !came.is_empty() {
            write_first(&files)?;
        }
        growing.add(came, &settings).map_err(|error| cannot_grow(out, &error))
    });
    bar.finish_and_clear();
    if let Some(contradiction) = scales.contradiction() {
        tell(&arguments.port.named_in(&contradiction));
    }
    if !played.agrees(&done) {
        done.ended = Ended::Failed(
            "the board played another sequence than it was sent: the line damages data. Use a shorter cable or another USB port".into(),
        );
    }
    Ok((done, played))
}

/// Restores the settings that were changed for a recording, the last first, since later ones may depend on earlier
/// ones.
///
/// # Errors
/// [`Failure`] if the board keeps changed settings. A board that is gone has lost them with its supply.
fn put_back(link: &mut Link<Port>, before: &Settings, changed: &[(String, f64)]) -> Result<(), Failure> {
    let mut known = changed.iter().rev().filter_map(|(name, _)| Some((name, find(name.as_bytes())?)));
    let done = leave_host(link, before)
        .and_then(|()| known.try_for_each(|(name, param)| link.command(&format!("set {name} {}", before.get(param)))));
    match done {
        Err(error) if !link.is_gone() => Err(Failure::machine(format!(
            "{error}; the changed settings and trip_host stay until the board is reset{}",
            in_brackets(changed)
        ))),
        _ => Ok(()),
    }
}

/// The changed settings in brackets; empty if there are none.
fn in_brackets(changed: &[(String, f64)]) -> String {
    match changed {
        [] => String::new(),
        changed => format!(" ({})", changed.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")),
    }
}

/// Writes the files beside the recording and reports how it ended.
fn finish(
    (arguments, out, outputs): (&Arguments, &Path, &Outputs),
    done: &Record,
    (firmware, not_put_back): (&str, Option<&str>),
    played: &Played,
    nominal: NominalMotor,
) -> Result<(), Failure> {
    let kept = done.samples.len();
    let mut side = done.side_file(firmware, &played.order.line());
    side["file"] = out.display().to_string().into();
    if let Some(why) = not_put_back {
        side["not_put_back"] = why.into();
    }
    let ticks = done.samples.len() as f64 + f64::from(done.missing_ticks());
    // The files of an earlier recording stay if no samples came.
    let written = match kept {
        0 => Ok(()),
        _ => write_each(&files_beside((arguments, out), &done.settings, nominal, played, ticks, &side)?),
    };
    if let Some(path) = &arguments.json {
        write_json(path, &side)?;
    }
    if kept > 0 {
        outputs.say(&report((arguments, out), done));
    }
    let ended = ended(&done.ended, kept, out).map_err(|failure| with_limit(failure, &done.ended));
    with_unwritten(ended, written)?;
    outputs.say(&next(arguments, out));
    Ok(())
}

/// Advice of `record` on a trip with a limit.
fn with_limit(failure: Failure, ended: &Ended) -> Failure {
    let Ended::Tripped(trip) = ended else { return failure };
    match limit(*trip) {
        Some(limit) => Failure {
            message: format!("{}. --set {limit}=VALUE changes its limit for one recording", failure.message),
            ..failure
        },
        None => failure,
    }
}

/// Sends samples to plotters until an error occurs. An error of a plotter must not cost a recording.
fn send(live: &mut Option<Live>, samples: &[Sample], settings: &Settings) {
    if let Some(Err(error)) = live.as_ref().map(|live| live.send_samples(samples, settings)) {
        tell(&format!("sending to the plotter has stopped: {error}"));
        *live = None;
    }
}

/// A sequence as the board plays it.
#[derive(serde::Serialize)]
struct Played {
    time_s: f64,
    kind: &'static str,
    #[serde(flatten)]
    order: SequenceOrder,
}

impl Played {
    /// Whether a complete recording has this sequence.
    fn agrees(&self, done: &Record) -> bool {
        let Some(first) = done.samples.first().filter(|_| done.ended == Ended::Complete) else { return true };
        let sequence = self.order.of_core(first.state.mode(), &done.settings);
        sequence.is_ok_and(|sequence| is_played(&done.samples, &sequence))
    }

    /// The recording as a scenario without a motor. It has the mode, the settings that differ from the defaults, and
    /// this sequence as its reference.
    fn scenario(&self, mode: &str, settings: &Settings, ticks: f64) -> Result<String, Failure> {
        let defaults = Settings::defaults();
        let own = Param::ALL.iter().filter(|param| settings.get(**param) != defaults.get(**param));
        // The shortest decimals that give the same number.
        let value = |param: &Param| settings.get(*param).to_string().parse::<f64>().map_err(Failure::machine);
        let own =
            own.map(|param| Ok((setting_name(*param), value(param)?))).collect::<Result<BTreeMap<_, _>, Failure>>()?;
        let duration_s = ticks / f64::from(settings.get(Param::TickRate));
        let scenario = Course { duration_s, mode, settings: own, reference: [self] };
        toml::to_string(&scenario).map_err(Failure::machine)
    }
}

/// A scenario file of a recording.
#[derive(serde::Serialize)]
struct Course<'a> {
    duration_s: f64,
    mode: &'a str,
    settings: BTreeMap<String, f64>,
    reference: [&'a Played; 1],
}

/// Applies settings and mode and arms; returns the settings of the board and the sequence.
fn prepare(
    link: &mut Link<Port>,
    arguments: &Arguments,
    changed: &[(String, f64)],
) -> Result<(Settings, Played), Failure> {
    link.command("disarm")?;
    for (name, value) in changed {
        link.command(&format!("set {name} {value}"))?;
    }
    let settings = link.settings()?;
    for (name, value) in changed {
        reads_back(&settings, name, *value as f32)?;
    }
    // The user can switch it off with --set.
    if !arguments.set.iter().any(|(name, _)| find(name.as_bytes()) == Some(Param::TripHost)) {
        watch_host(link, &settings)?;
    }
    let amplitude =
        arguments.amplitude.unwrap_or_else(|| (8.0 * f64::from(settings.get(Param::SupplyVoltage))).round() / 10.0);
    arm(link)?;
    link.command(&format!("mode {}", arguments.mode))?;
    let Arguments { offset, period: period_ms, seed, .. } = *arguments;
    let count = arguments.count.unwrap_or_else(|| default_count(arguments.sequence, period_ms));
    let order = SequenceOrder { kind: arguments.sequence, amplitude, offset, period_ms, count, seed };
    Ok((settings, Played { time_s: 0.0, kind: "sequence", order }))
}

/// The files beside a recording of so many ticks.
fn files_beside(
    (arguments, out): (&Arguments, &Path),
    settings: &Settings,
    nominal: NominalMotor,
    played: &Played,
    ticks: f64,
    side: &serde_json::Value,
) -> Result<Vec<(PathBuf, String)>, Failure> {
    let scenario = WRITTEN.to_owned() + &played.scenario(&arguments.mode, settings, ticks)?;
    let scenario = (beside(out, "scenario.toml"), scenario);
    // The side file is the last: it says that the others exist.
    Ok([scenario].into_iter().chain(rig_and_side(out, settings, nominal, side)?).collect())
}

fn report((arguments, out): (&Arguments, &Path), done: &Record) -> String {
    let out = out.display();
    let rate_hz = f64::from(done.settings.get(Param::TickRate));
    let missing = done.missing_ticks();
    let seconds = (done.samples.len() as f64 + f64::from(missing)) / rate_hz;
    let mut text = format!("{out}: {} samples, {seconds:.2} s, {missing} missing\n", done.samples.len());
    if done.losses != Losses::default() {
        let Losses { lost_frames, damaged_frames } = done.losses;
        text += &format!("{lost_frames} frames were lost on the line, {damaged_frames} of them damaged:\n");
        text += "use a shorter cable, another USB port, no hub; or the computer was too busy; or\n";
        text += &format!("{}\n", arguments.port.named_in(OTHER_READER));
    }
    let covered = done.coverage();
    text += &format!("{covered}\n");
    covered.lacks.iter().for_each(|Lack { what, remedy }| text += &format!("  lacks {what}: {remedy}\n"));
    text
}

/// What was written, and the next command for the user.
fn next(arguments: &Arguments, out: &Path) -> String {
    let named = |path: &Path| quoted(&path.to_string_lossy());
    let files: Vec<String> = with_beside(out, &BESIDE).iter().map(|path| named(path)).collect();
    let [out, scenario, rig] = [out, &beside(out, "scenario.toml"), &beside(out, "rig.toml")].map(named);
    let next = match arguments.mode.as_str() {
        OPEN => format!("next: motorbench diagnose {out} --rig {rig}\n"),
        _ => format!("next: motorbench validate {out} --scenario {scenario} \\\n  --rig {rig} --model MODEL.toml\n"),
    };
    wrapped(&format!("wrote {}", files.join(", ")), "", "  ") + &next
}

/// An early end is a failure that says what was kept.
pub(super) fn ended(ended: &Ended, kept: usize, out: &Path) -> Result<(), Failure> {
    let kept = match kept {
        0 => "nothing of it is kept".to_string(),
        _ => format!("{} holds what had come", out.display()),
    };
    match ended {
        Ended::Complete => Ok(()),
        Ended::Interrupted => Err(Failure::input(format!("stopped by hand; {kept}"))),
        Ended::Tripped(trip) => Err(Failure::input(format!("{}; {kept}", BoardError::Tripped(*trip)))),
        Ended::Refused(why) => Err(Failure::input(why)),
        Ended::Failed(why) => Err(Failure::machine(format!("{why}; {kept}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_levels_are_enough_when_nobody_says_how_many() {
        let parts = [(Kind::Levels, 500), (Kind::Prbs, 60), (Kind::Levels, 60_000), (Kind::Steps, 500)];
        assert_eq!(parts.map(|(kind, period_ms)| default_count(kind, period_ms)), [20, 167, 1, 1]);
    }
}

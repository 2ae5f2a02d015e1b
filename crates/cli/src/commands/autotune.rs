//! `motorbench autotune`: gains from an experiment on a board.

use super::interaction::on_interrupt;
use super::port::PortArguments;
use super::record::finite;
use super::{Failure, JSON_TO, Outputs, TERMINAL, write, write_json};
use acceptance::{STEP_RAD, acceptance, acceptance_of_position, rad_per_count};
use clap::Args;
use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings, find};
use motorbench_data::names::setting_name;
use motorbench_design::fixed_point::{cruise_speed, friction_width, move_acceleration, rounded, speed_range};
use motorbench_design::relay::{Relay, tyreus_luyben};
use motorbench_design::step_tuning::{simc, simc_position};
use motorbench_link::Link;
use motorbench_link::board::{Board, BoardError, leave_host, watch_host};
use motorbench_link::port::Port;
use motorbench_stand::on_board::{self, TuningError};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

mod acceptance;

/// Usual speed of the experiments and of the test, and its largest share of what the motor has shown.
const USUAL_RAD_PER_S: f64 = 60.0;
const REACHED_SHARE: f64 = 0.8;
/// Settings in a console line, which has at most 96 characters.
const SETTINGS_A_LINE: usize = 3;
/// A range of the speed up to so many times the needed one costs no more than two bits.
const WIDEST: f64 = 4.0;
/// A position cannot be nearer than its counts.
const LEAST_COUNTS: f64 = 2.0;
/// Usual time constants of the closed loops.
const SPEED_LOOP_MS: f64 = 10.0;
const POSITION_LOOP_MS: f64 = 30.0;
/// Where the board's numbers do not hold the gains of a usual closed loop, the next one is slower by this.
const SLOWER: f64 = 1.25;
/// Limits of the acceptance test.
const MOST_OVERSHOOT_PERCENT: f64 = 35.0;
const MOST_ERROR_SHARE: f64 = 0.03;

/// Gains of the speed or position PID without a model, by an experiment on the board, with an acceptance test.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench autotune --from 6 --to 8
  motorbench autotune --position --closed-loop 50
  motorbench autotune --relay 1 --bias 7 --reference 60 --console gains.txt

A motor that sticks is refused: its friction would be measured instead of the
loop. Where the range of the speed does not fit the motor, as with a gear motor,
it is set with the gains. Where the board's numbers do not hold the gains of a
usual closed loop, a slower one is taken and told.")]
pub struct Arguments {
    #[command(flatten)]
    pub(super) port: PortArguments,
    /// Voltage before the step, at which the motor turns.
    #[arg(long, value_name = "V", default_value_t = 6.0, allow_negative_numbers = true, value_parser = finite)]
    from: f64,
    /// Voltage after the step.
    #[arg(long, value_name = "V", default_value_t = 8.0, allow_negative_numbers = true, value_parser = finite)]
    to: f64,
    /// How long each voltage is held.
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = hold, allow_negative_numbers = true)]
    hold: f64,
    /// Gains of the position PID instead of the speed PID.
    #[arg(long, conflicts_with = "relay")]
    position: bool,
    /// Wanted time constant of the closed loop, in ms; default: 10 for the speed, 30 for the position.
    #[arg(long, value_name = "MS", value_parser = positive, allow_negative_numbers = true)]
    closed_loop: Option<f64>,
    /// Does a relay experiment with this voltage amplitude instead of a step.
    #[arg(long, value_name = "V", value_parser = positive, allow_negative_numbers = true)]
    relay: Option<f64>,
    /// First guess of the voltage that the motor needs at the reference of the relay experiment.
    #[arg(long, value_name = "V", default_value_t = 7.0, allow_negative_numbers = true, value_parser = finite)]
    bias: f64,
    /// Speed of the relay experiment and of the acceptance test, in rad/s; default: 60, or 80 % of the motor's speed in the
    /// experiment where that is less.
    #[arg(long, allow_negative_numbers = true, value_parser = turning, conflicts_with = "position")]
    reference: Option<f64>,
    /// Writes the gains as console lines, for `motorbench send`.
    #[arg(long, value_name = "FILE.txt")]
    console: Option<PathBuf>,
    /// Prints experiment, gains and acceptance test as JSON instead of text, or writes them into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// How long a voltage may be held, in seconds: the motor has to settle while the user waits.
const HOLD_S: RangeInclusive<f64> = 0.2..=60.0;

fn hold(text: &str) -> Result<f64, String> {
    let expected = || format!("expected {} to {} seconds", HOLD_S.start(), HOLD_S.end());
    text.parse().ok().filter(|seconds| HOLD_S.contains(seconds)).ok_or_else(expected)
}

fn positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0).ok_or("expected a number above 0".into())
}

fn turning(text: &str) -> Result<f64, String> {
    let turns = |speed: &f64| speed.is_finite() && *speed != 0.0;
    text.parse()
        .ok()
        .filter(turns)
        .ok_or("expected a speed other than 0: at rest friction would be measured instead of the loop".into())
}

/// A board with a user who can stop it.
struct Attended {
    link: Link<Port>,
    stopped: Arc<AtomicBool>,
}

impl Board for Attended {
    fn command(&mut self, line: &str) -> Result<(), BoardError> {
        self.link.command(line)
    }

    fn samples(&mut self, duration_s: f64) -> Result<Vec<Sample>, BoardError> {
        match self.stopped.load(Ordering::Relaxed) {
            true => Err(BoardError::Interrupted),
            false => self.link.samples(duration_s),
        }
    }

    fn stay_alive(&mut self) -> Result<(), BoardError> {
        self.link.stay_alive()
    }
}

/// Runs it.
///
/// # Errors
/// [`Failure`]: the board, a useless experiment, or gains that fail the test.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.relay.is_some() && arguments.reference.is_some_and(|reference| reference < 0.0) {
        return Err(Failure::input("--relay needs a --reference above 0; only the step experiment can go backwards"));
    }
    let outputs = Outputs::new([], arguments.console.iter().chain(&arguments.json))?;
    let stopped = on_interrupt()?;
    let (link, _, settings) = arguments.port.open_to_drive()?;
    let mut board = Attended { link, stopped };
    watch_host(&mut board, &settings)?;
    let tuned = tuned(&mut board, &settings, arguments, &outputs);
    let left = leave_host(&mut board, &settings);
    // The reason for missing gains is reported first.
    tuned.and(left.map_err(Failure::from))
}

/// Experiment, gains, acceptance test.
fn tuned(board: &mut Attended, settings: &Settings, arguments: &Arguments, outputs: &Outputs) -> Result<(), Failure> {
    let (found, rule) = experiment(board, settings, arguments)?;
    let mut ranges = set_ranges(board, settings, found.greatest_rad_per_s)?;
    if arguments.position {
        ranges.extend(set_moves(board, settings, &found)?);
    }
    let now = with(settings, &ranges)?;
    let Sent { gains, closed_loop_s, result } = rule.sent(board);
    let put_back = |board: &mut Attended| {
        [&gains, &ranges].into_iter().try_for_each(|changed| send(board, &before(settings, changed)))
    };
    let tested = result.and_then(|()| match arguments.position {
        true => acceptance_of_position(board, &now),
        false => acceptance(board, &now, found.reference_rad_per_s),
    });
    if tested.is_err() {
        // The reason is reported below. A board that is gone has lost the gains with its supply.
        let _ = put_back(board);
    }
    let test = Test { arguments, reference_rad_per_s: found.reference_rad_per_s, now: &now, result: tested? };
    let accepted = test.is_passed();
    let set: Vec<(String, f64)> = ranges.iter().chain(&gains).cloned().collect();
    if let Some(path) = &arguments.json {
        let result = json!({
            "experiment": found.json,
            "closed_loop_ms": closed_loop_s.map(|seconds| 1e3 * seconds),
            "gains": gains.iter().cloned().collect::<BTreeMap<_, _>>(),
            "ranges": ranges.iter().cloned().collect::<BTreeMap<_, _>>(),
            "test": test.json(),
            "accepted": accepted,
        });
        write_json(path, &result)?;
    }
    outputs.say(&format!("{}\n{}gains\n", found.text, rule.slower_text(closed_loop_s)));
    set.iter().for_each(|(name, value)| outputs.say(&format!("  {name} {value:.6}\n")));
    outputs.say(&test.text());
    if !accepted {
        put_back(board)?;
        return Err(Failure::input(test.refusal()));
    }
    if let Some(path) = &arguments.console {
        let lines = [lines(&ranges), lines(&gains)].concat();
        write(path, &(lines.join("\n") + "\n"))?;
    }
    let accepted = "accepted; the gains are lost at the next reset.\n`motorbench connect save` keeps them\n";
    outputs.say(&arguments.port.named_in(accepted));
    outputs.wrote("");
    Ok(())
}

/// Settings as console lines, as few as the board takes in one. A setting has single precision.
fn lines(values: &[(String, f64)]) -> Vec<String> {
    let line = |values: &[(String, f64)]| {
        values.iter().fold("set".to_string(), |line, (name, value)| format!("{line} {name} {}", *value as f32))
    };
    values.chunks(SETTINGS_A_LINE).map(line).collect()
}

fn send(board: &mut impl Board, values: &[(String, f64)]) -> Result<(), BoardError> {
    lines(values).iter().try_for_each(|line| board.command(line))
}

/// What some settings were before.
fn before(settings: &Settings, changed: &[(String, f64)]) -> Vec<(String, f64)> {
    let value = |name: &str| find(name.as_bytes()).map_or(0.0, |param| settings.get(param).into());
    changed.iter().map(|(name, _)| (name.clone(), value(name))).collect()
}

/// Sets the range of the speed for a motor with this greatest speed, if the present one does not fit. A range that is
/// too fine for the encoder is doubled. Returns what was set.
fn set_ranges(
    board: &mut impl Board,
    settings: &Settings,
    greatest_rad_per_s: f64,
) -> Result<Vec<(String, f64)>, BoardError> {
    let mut range = speed_range(greatest_rad_per_s);
    let present = f64::from(settings.get(Param::SpeedRange));
    if (range..=WIDEST * range).contains(&present) {
        return Ok(Vec::new());
    }
    loop {
        let set = [(Param::SpeedRange, range), (Param::CompFrictionWidth, friction_width(range))]
            .map(|(param, value)| (setting_name(param), value));
        match send(board, &set) {
            Err(BoardError::Refused { .. }) if 2.0 * range < present => range *= 2.0,
            done => return done.map(|()| set.into()),
        }
    }
}

/// Sets the speed and the acceleration of moves where the motor does not reach the present ones: it would stay behind,
/// and overshoot. Returns what was set.
fn set_moves(board: &mut impl Board, settings: &Settings, found: &Found) -> Result<Vec<(String, f64)>, BoardError> {
    let speed = (Param::CruiseSpeed, Some(found.greatest_rad_per_s), cruise_speed as fn(f64) -> f64);
    let acceleration = (Param::Acceleration, found.greatest_rad_per_s2, move_acceleration as fn(f64) -> f64);
    let set: Vec<(String, f64)> = [speed, acceleration]
        .into_iter()
        .filter_map(|(param, greatest, of)| {
            let greatest = greatest.filter(|greatest| *greatest < f64::from(settings.get(param)))?;
            Some((setting_name(param), rounded(of(greatest))))
        })
        .collect();
    send(board, &set)?;
    Ok(set)
}

/// Settings with some that the board has accepted.
fn with(settings: &Settings, changed: &[(String, f64)]) -> Result<Settings, Failure> {
    let mut settings = *settings;
    for (name, value) in changed {
        if let Some(param) = find(name.as_bytes()) {
            settings.set(param, *value as f32).map_err(|rule| Failure::machine(format!("{name}: {rule:?}")))?;
        }
    }
    Ok(settings)
}

/// The acceptance test and its result: overshoot in percent, and error at the end in rad/s or rad.
struct Test<'a> {
    arguments: &'a Arguments,
    reference_rad_per_s: f64,
    now: &'a Settings,
    result: (f64, f64),
}

impl Test<'_> {
    fn most_error(&self) -> f64 {
        match self.arguments.position {
            true => (MOST_ERROR_SHARE * STEP_RAD).max(LEAST_COUNTS * rad_per_count(self.now)),
            false => MOST_ERROR_SHARE * self.reference_rad_per_s.abs(),
        }
    }

    fn is_passed(&self) -> bool {
        let (overshoot_percent, error) = self.result;
        overshoot_percent <= MOST_OVERSHOOT_PERCENT && error <= self.most_error()
    }

    fn json(&self) -> Value {
        let (overshoot_percent, error) = self.result;
        match self.arguments.position {
            true => json!({ "step_rad": STEP_RAD, "overshoot_percent": overshoot_percent, "steady_error_rad": error }),
            false => json!({
                "reference_rad_per_s": self.reference_rad_per_s,
                "overshoot_percent": overshoot_percent,
                "steady_error_rad_per_s": error,
            }),
        }
    }

    fn text(&self) -> String {
        let (overshoot_percent, error) = self.result;
        match self.arguments.position {
            true => format!(
                "acceptance test, {STEP_RAD} rad on: overshoot {overshoot_percent:.1} %, error at the end {error:.4} rad\n"
            ),
            false => format!(
                "acceptance test to {} rad/s: overshoot {overshoot_percent:.1} %, error at the end {error:.2} rad/s\n",
                rounded(self.reference_rad_per_s)
            ),
        }
    }

    fn refusal(&self) -> String {
        let most_error = match self.arguments.position {
            true => format!("{:.3} rad", self.most_error()),
            false => format!("{:.1} rad/s", self.most_error()),
        };
        format!(
            "not accepted (limits: {MOST_OVERSHOOT_PERCENT} % overshoot, {most_error} error); the old gains are restored. Try a slower --closed-loop, or a voltage and a reference at which the motor turns freely"
        )
    }
}

/// Result of an experiment, as text and as JSON.
struct Found {
    text: String,
    json: Value,
    /// The motor's greatest speed, as the experiment shows it.
    greatest_rad_per_s: f64,
    /// Its greatest acceleration from rest, if the experiment shows it.
    greatest_rad_per_s2: Option<f64>,
    /// Speed of the acceptance test.
    reference_rad_per_s: f64,
}

/// Gains by the time constant of the closed loop.
struct Rule {
    gains: Box<dyn Fn(f64) -> Vec<(String, f64)>>,
    /// `None`: the gains follow from the experiment alone.
    closed_loop_s: Option<f64>,
    /// The slowest loop that may be taken instead: that of the motor itself, or the one that a person asks for.
    slowest_s: f64,
}

/// What was sent.
struct Sent {
    gains: Vec<(String, f64)>,
    closed_loop_s: Option<f64>,
    result: Result<(), BoardError>,
}

impl Rule {
    /// Sends the gains. If the board refuses them as too large for its numbers, those of a slower loop.
    fn sent(&self, board: &mut impl Board) -> Sent {
        let mut loop_s = self.closed_loop_s.unwrap_or_default();
        loop {
            let gains = (self.gains)(loop_s);
            match send(board, &gains) {
                Err(BoardError::Refused { .. }) if SLOWER * loop_s <= self.slowest_s && loop_s > 0.0 => {
                    loop_s *= SLOWER;
                }
                result => return Sent { gains, closed_loop_s: self.closed_loop_s.map(|_| loop_s), result },
            }
        }
    }

    /// What a person should know of a loop that was taken instead.
    fn slower_text(&self, taken_s: Option<f64>) -> String {
        let slower = self.closed_loop_s.zip(taken_s).filter(|(usual_s, taken_s)| taken_s > usual_s);
        slower.map_or_else(String::new, |(usual_s, taken_s)| {
            let [usual_ms, taken_ms] = [usual_s, taken_s].map(|seconds| 1e3 * seconds);
            format!(
                "closed loop of {taken_ms:.0} ms: the board's numbers do not hold the gains of the usual {usual_ms:.0} ms\n"
            )
        })
    }
}

fn experiment(board: &mut Attended, settings: &Settings, arguments: &Arguments) -> Result<(Found, Rule), Failure> {
    match arguments.relay {
        Some(amplitude_v) => by_relay(board, settings, arguments, amplitude_v),
        None => by_step(board, settings, arguments),
    }
    .map_err(|error| match error {
        TuningError::Board(error) => Failure::from(error),
        other => Failure::input(other),
    })
}

fn by_step(board: &mut Attended, settings: &Settings, arguments: &Arguments) -> Result<(Found, Rule), TuningError> {
    let model = on_board::step(board, settings, [arguments.from, arguments.to], arguments.hold)?;
    let text = format!(
        "step: {:.2} rad/s per volt, time constant {:.1} ms, dead time {:.1} ms",
        model.gain_rad_per_s_per_v,
        1e3 * model.time_constant_s,
        1e3 * model.dead_time_s
    );
    let more_v = f64::from(settings.get(Param::VoltageLimit)) - arguments.to.abs();
    let reached = model.end_rad_per_s.abs();
    let greatest_rad_per_s = reached + model.gain_rad_per_s_per_v * more_v.max(0.0);
    let found = Found {
        text,
        json: json!({ "kind": "step", "model": model }),
        greatest_rad_per_s,
        greatest_rad_per_s2: Some(greatest_rad_per_s / model.time_constant_s),
        reference_rad_per_s: arguments.reference_below(reached),
    };
    let is_position = arguments.position;
    let usual_ms = if is_position { POSITION_LOOP_MS } else { SPEED_LOOP_MS };
    let closed_loop_s = 1e-3 * arguments.closed_loop.unwrap_or(usual_ms);
    let slowest_s = if arguments.closed_loop.is_some() { closed_loop_s } else { model.time_constant_s };
    let gains = move |loop_s: f64| if is_position { simc_position(&model, loop_s) } else { simc(&model, loop_s) };
    Ok((found, Rule { gains: Box::new(gains), closed_loop_s: Some(closed_loop_s), slowest_s }))
}

fn by_relay(
    board: &mut Attended,
    settings: &Settings,
    arguments: &Arguments,
    amplitude_v: f64,
) -> Result<(Found, Rule), TuningError> {
    let reached = match arguments.reference {
        Some(reference) => reference,
        None => on_board::steady_speed(board, settings, arguments.bias, arguments.hold)?.abs(),
    };
    let reference_rad_per_s = arguments.reference_below(reached);
    let relay =
        Relay { reference_rad_per_s, bias_v: arguments.bias, amplitude_v, hysteresis_rad_per_s: 0.5, timeout_s: 10.0 };
    let found = on_board::relay(board, settings, &relay)?;
    let text = format!(
        "relay: period {:.1} ms, ultimate gain {:.3} V s/rad; {:.1} ms of the period are the delay to the computer and back",
        1e3 * found.cycle.period_s,
        found.cycle.ultimate_gain_v_s_per_rad,
        1e3 * found.delay_s
    );
    let json = json!({ "kind": "relay", "cycle": found.cycle, "delay_s": found.delay_s });
    let share = f64::from(settings.get(Param::VoltageLimit)) / arguments.bias.abs().max(f64::MIN_POSITIVE);
    let greatest_rad_per_s = reference_rad_per_s * share.max(1.0);
    let gains = tyreus_luyben(&found.cycle);
    let rule = Rule { gains: Box::new(move |_| gains.clone()), closed_loop_s: None, slowest_s: 0.0 };
    Ok((Found { text, json, greatest_rad_per_s, greatest_rad_per_s2: None, reference_rad_per_s }, rule))
}

impl Arguments {
    /// Speed of the test for a motor that has reached this one.
    fn reference_below(&self, reached_rad_per_s: f64) -> f64 {
        self.reference.unwrap_or_else(|| USUAL_RAD_PER_S.min(REACHED_SHARE * reached_rad_per_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_link::fake_board::FakeBoard as Fake;

    /// A gear motor needs a finer range of the speed, and a fast one a wider one. What fits is left as it is.
    #[test]
    fn the_range_of_the_speed_is_set_where_it_does_not_fit() {
        let set = |greatest: f64| set_ranges(&mut Fake::that_sends(0), &Settings::defaults(), greatest).unwrap();
        let of = |range: f64| vec![("speed_range".into(), range), ("comp_friction_width".into(), range / 256.0)];
        assert_eq!([set(140.0), set(300.0), set(15.0), set(600.0)], [vec![], vec![], of(32.0), of(1024.0)]);
    }

    /// A gear motor asks for more gain than the board's numbers hold. Only where nobody asked for a loop it is slower.
    #[test]
    fn gains_that_the_board_does_not_hold_are_those_of_a_slower_loop() {
        let rule = |closed_loop_s: f64, slowest_s: f64| Rule {
            gains: Box::new(|loop_s| vec![("position_kp".into(), 1.0 / loop_s)]),
            closed_loop_s: Some(closed_loop_s),
            slowest_s,
        };
        let mut board = Fake::that_sends(0);
        board.most = Some(("position_kp", 20.0));
        let usual = rule(0.03, 0.15);
        let sent = usual.sent(&mut board);
        let taken_s = sent.closed_loop_s.unwrap();
        assert!(sent.result.is_ok() && taken_s > 0.05 && taken_s < 0.05 * SLOWER, "{taken_s}");
        assert_eq!(board.heard.len(), 4, "{:?}", board.heard);
        assert!(
            usual.slower_text(Some(taken_s)).starts_with("closed loop of 59 ms"),
            "{}",
            usual.slower_text(Some(taken_s))
        );
        assert_eq!(usual.slower_text(Some(0.03)), "");
        for asked in [rule(0.03, 0.03), rule(0.03, 0.05)] {
            assert!(matches!(asked.sent(&mut board).result, Err(BoardError::Refused { .. })));
        }
    }
}

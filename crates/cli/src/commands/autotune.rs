//! `motorbench autotune`: gains from an experiment on a board.

use super::interaction::on_interrupt;
use super::port::PortArguments;
use super::record::finite;
use super::{Failure, JSON_TO, Outputs, TERMINAL, write, write_json};
use clap::Args;
use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings};
use motorbench_data::telemetry::speed_bit_rad_per_s;
use motorbench_design::relay::{Relay, tyreus_luyben};
use motorbench_design::step_tuning::simc;
use motorbench_link::Link;
use motorbench_link::board::{Board, BoardError, arm, leave_host, samples_of, untripped, watch_host};
use motorbench_link::port::Port;
use motorbench_link::record::missing_ticks;
use motorbench_stand::on_board::{self, TuningError};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The acceptance test lasts a second on the reference. Its last quarter counts. This share of the samples has to
/// arrive.
const TEST_S: f64 = 1.0;
const LAST_PART: f64 = 0.25;
const LEAST_SAMPLES_SHARE: f64 = 0.9;
/// Before the test the motor comes to rest: below this share of the reference, checked at this interval, this many
/// times.
const RESTING_SHARE: f64 = 0.05;
const READ_INTERVAL_S: f64 = 0.1;
const MOST_LOOKS: usize = 100;
/// Limits of the acceptance test.
const MOST_OVERSHOOT_PERCENT: f64 = 35.0;
const MOST_ERROR_SHARE: f64 = 0.03;

/// Gains of the speed PID without a model, by an experiment on the board, with an acceptance test.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench autotune --from 6 --to 8
  motorbench autotune --relay 1 --bias 7 --reference 60 --console gains.txt

A motor that sticks is refused: its friction would be measured instead of the
loop.")]
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
    /// Wanted time constant of the closed loop, in ms.
    #[arg(long, value_name = "MS", default_value_t = 10.0, value_parser = positive, allow_negative_numbers = true)]
    closed_loop: f64,
    /// Does a relay experiment with this voltage amplitude instead of a step.
    #[arg(long, value_name = "V", value_parser = positive, allow_negative_numbers = true)]
    relay: Option<f64>,
    /// First guess of the voltage that the motor needs at the reference of the relay experiment.
    #[arg(long, value_name = "V", default_value_t = 7.0, allow_negative_numbers = true, value_parser = finite)]
    bias: f64,
    /// Speed of the relay experiment and of the acceptance test, in rad/s.
    #[arg(long, default_value_t = 60.0, allow_negative_numbers = true, value_parser = turning)]
    reference: f64,
    /// Writes the gains as console lines, for `motorbench send`.
    #[arg(long, value_name = "FILE.txt")]
    console: Option<PathBuf>,
    /// Prints experiment, gains and acceptance test as JSON.
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
    if arguments.relay.is_some() && arguments.reference < 0.0 {
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
    let (found, gains) = experiment(board, settings, arguments)?;
    let line = gains.iter().fold("set".to_string(), |line, (name, value)| format!("{line} {name} {value:.6}"));
    let before: Vec<String> = gains.iter().map(|(name, _)| shown(settings, name)).collect();
    board.command(&line)?;
    let restore = format!("set {}", before.join(" "));
    let tested = acceptance(board, settings, arguments.reference);
    if tested.is_err() {
        // The reason is reported below. A board that is gone has lost the gains with its supply.
        let _ = board.command(&restore);
    }
    let (overshoot_percent, error) = tested?;
    let most_error = MOST_ERROR_SHARE * arguments.reference.abs();
    let accepted = overshoot_percent <= MOST_OVERSHOOT_PERCENT && error <= most_error;
    if let Some(path) = &arguments.json {
        let result = json!({
            "experiment": found.json,
            "gains": gains.iter().cloned().collect::<BTreeMap<_, _>>(),
            "test": {
                "reference_rad_per_s": arguments.reference,
                "overshoot_percent": overshoot_percent,
                "steady_error_rad_per_s": error,
            },
            "accepted": accepted,
        });
        write_json(path, &result)?;
    }
    outputs.say(&format!("{}\ngains\n", found.text));
    gains.iter().for_each(|(name, value)| outputs.say(&format!("  {name} {value:.6}\n")));
    outputs.say(&format!(
        "acceptance test to {} rad/s: overshoot {overshoot_percent:.1} %, error at the end {error:.2} rad/s\n",
        arguments.reference
    ));
    if !accepted {
        board.command(&restore)?;
        return Err(Failure::input(format!(
            "not accepted (limits: {MOST_OVERSHOOT_PERCENT} % overshoot, {most_error:.1} rad/s error); the old gains are restored. Try a slower --closed-loop, or a voltage and a reference at which the motor turns freely"
        )));
    }
    if let Some(path) = &arguments.console {
        write(path, &(line + "\n"))?;
    }
    let accepted = "accepted; the gains are lost at the next reset.\n`motorbench connect save` keeps them\n";
    outputs.say(&arguments.port.named_in(accepted));
    outputs.wrote("");
    Ok(())
}

/// Result of an experiment, as text and as JSON.
struct Found {
    text: String,
    json: Value,
}

fn experiment(
    board: &mut Attended,
    settings: &Settings,
    arguments: &Arguments,
) -> Result<(Found, Vec<(String, f64)>), Failure> {
    let failed = |error: TuningError| match error {
        TuningError::Board(error) => Failure::from(error),
        other => Failure::input(other),
    };
    let Some(amplitude_v) = arguments.relay else {
        let volts = [arguments.from, arguments.to];
        let model = on_board::step(board, settings, volts, arguments.hold).map_err(failed)?;
        let text = format!(
            "step: {:.2} rad/s per volt, time constant {:.1} ms, dead time {:.1} ms",
            model.gain_rad_per_s_per_v,
            1e3 * model.time_constant_s,
            1e3 * model.dead_time_s
        );
        let found = Found { text, json: json!({ "kind": "step", "model": model }) };
        return Ok((found, simc(&model, 1e-3 * arguments.closed_loop)));
    };
    let relay = Relay {
        reference_rad_per_s: arguments.reference,
        bias_v: arguments.bias,
        amplitude_v,
        hysteresis_rad_per_s: 0.5,
        timeout_s: 10.0,
    };
    let found = on_board::relay(board, settings, &relay).map_err(failed)?;
    let text = format!(
        "relay: period {:.1} ms, ultimate gain {:.3} V s/rad; {:.1} ms of the period are the delay to the computer and back",
        1e3 * found.cycle.period_s,
        found.cycle.ultimate_gain_v_s_per_rad,
        1e3 * found.delay_s
    );
    let json = json!({ "kind": "relay", "cycle": found.cycle, "delay_s": found.delay_s });
    Ok((Found { text, json }, tyreus_luyben(&found.cycle)))
}

/// A setting as `NAME VALUE`.
fn shown(settings: &Settings, name: &str) -> String {
    let value = motorbench_core::settings::find(name.as_bytes()).map_or(0.0, |param| settings.get(param));
    format!("{name} {value}")
}

/// Lets the bridge brake the motor, which may still turn from the experiment. That motion is no overshoot.
fn come_to_rest(board: &mut impl Board, settings: &Settings, reference: f64) -> Result<(), BoardError> {
    arm(board)?;
    board.command("mode open")?;
    board.samples(0.0)?;
    let resting = RESTING_SHARE * reference.abs() / speed_bit_rad_per_s(settings);
    for _ in 0..MOST_LOOKS {
        let samples = untripped(samples_of(board, READ_INTERVAL_S, settings.get(Param::TickRate).into())?)?;
        if samples.last().is_some_and(|last| f64::from(last.speed).abs() <= resting) {
            break;
        }
    }
    board.command("disarm")
}

/// Goes to the reference from rest; returns overshoot in percent, and mean error at the end.
fn acceptance(board: &mut impl Board, settings: &Settings, reference: f64) -> Result<(f64, f64), BoardError> {
    come_to_rest(board, settings, reference)?;
    arm(board)?;
    board.command("mode speed")?;
    board.samples(0.0)?;
    board.command(&format!("ref {reference}"))?;
    let samples = samples_of(board, TEST_S, settings.get(Param::TickRate).into()).and_then(untripped);
    let off = board.command("disarm");
    let samples = samples?;
    off?;
    has_come(&samples)?;
    let share = |sample: &Sample| f64::from(sample.speed) * speed_bit_rad_per_s(settings) / reference;
    let shares: Vec<f64> = samples.iter().map(share).collect();
    let last = &shares[shares.len() - (LAST_PART * shares.len() as f64) as usize..];
    let error = last.iter().map(|share| (share - 1.0) * reference).sum::<f64>() / last.len() as f64;
    Ok((100.0 * (shares.iter().copied().fold(1.0, f64::max) - 1.0), error.abs()))
}

/// Lost samples may contain an overshoot.
fn has_come(samples: &[Sample]) -> Result<(), BoardError> {
    let (came, missing) = (samples.len(), missing_ticks(samples));
    let sent = came as f64 + f64::from(missing);
    if came as f64 >= LEAST_SAMPLES_SHARE * sent {
        return Ok(());
    }
    Err(BoardError::Failed(format!(
        "the acceptance test cannot judge: {missing} of its samples were lost on the line ({came} came). Use a shorter cable, another USB port, no hub"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_link::fake_board::FakeBoard as Fake;

    fn tested(board: &mut Fake) -> Result<(f64, f64), BoardError> {
        acceptance(board, &Settings::defaults(), 60.0)
    }

    #[test]
    fn gains_are_not_accepted_by_samples_that_did_not_come() {
        let (overshoot_percent, error) = tested(&mut Fake::that_sends(u32::MAX)).unwrap();
        assert!(overshoot_percent < 0.1 && error < 0.1, "{overshoot_percent} % {error}");
        // The motor comes to rest within the first 100 samples. Then the test begins, or does not.
        for samples in [50, 100, 400] {
            let mut board = Fake::that_sends(samples);
            assert_eq!(tested(&mut board), Err(BoardError::NoTelemetry), "{samples}");
        }
        let mut gaps = Fake::that_sends(u32::MAX);
        gaps.every = 20;
        let lost = tested(&mut gaps).unwrap_err().to_string();
        assert!(lost.contains("lost on the line") && gaps.heard.last().is_some_and(|line| line == "disarm"), "{lost}");
    }
}

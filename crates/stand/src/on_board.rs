//! Tuning on a board by a relay or a step response. This computer switches the voltage over the console in open loop,
//! and the telemetry is the measurement. The firmware has no tuning mode.
//!
//! The relay switches some ticks after the sample that crossed the reference, because of the line and the console. That
//! delay is part of the cycling loop, and is reported. It makes the period longer and the ultimate gain smaller than
//! those of the firmware's own loop, so the gains are on the safe side.

use motorbench_core::HARDWARE;
use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::VOLT;
use motorbench_data::telemetry::speed_bit_rad_per_s;
use motorbench_design::relay::{LimitCycle, Relay, RelayError, Switching};
use motorbench_design::step_tuning::{FirstOrder, StepError, fit};
use motorbench_link::board::{Board, BoardError, Silence, arm, samples_of, untripped};
use std::time::Instant;

/// Slew limit during an experiment: the voltage has to jump.
const JUMP_V_PER_S: f32 = 30_000.0;
/// Interval at which the relay reads the speed.
const READ_INTERVAL_S: f64 = 1e-3;
/// Counts in the last part before a step from which the motor counts as turning.
const TURNING_COUNTS: i32 = 20;
const LAST_PART_S: f64 = 0.1;

/// Why there are no gains.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TuningError {
    /// On the board.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The relay found no usable cycle.
    #[error(transparent)]
    Relay(#[from] RelayError),
    /// The step cannot be used.
    #[error(transparent)]
    Step(#[from] StepError),
    /// Friction would count as missing gain.
    #[error(
        "the motor stands still before the step, so its friction would reduce the measured gain: begin at a voltage at which it turns"
    )]
    Standstill,
}

/// A limit cycle, and the part of its period between board and computer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardCycle {
    /// The cycle.
    pub cycle: LimitCycle,
    /// Mean time from the sample that crossed to the tick that had the new voltage.
    pub delay_s: f64,
}

/// Relay experiment; `settings` are those of the board. Ends disarmed.
///
/// # Errors
/// [`TuningError`].
pub fn relay(board: &mut impl Board, settings: &Settings, relay: &Relay) -> Result<BoardCycle, TuningError> {
    jumping(board, settings, |board| cycle(board, settings, relay))
}

/// Step from one voltage to another, each held for `hold_s`; `settings` are those of the board. Ends disarmed.
///
/// # Errors
/// [`TuningError`].
pub fn step(
    board: &mut impl Board,
    settings: &Settings,
    [from_v, to_v]: [f64; 2],
    hold_s: f64,
) -> Result<FirstOrder, TuningError> {
    let rate_hz = f64::from(settings.get(Param::TickRate));
    let samples = jumping(board, settings, |board| {
        board.command(&format!("ref {from_v}"))?;
        samples_of(board, hold_s - LAST_PART_S, rate_hz)?;
        let mut samples = untripped(samples_of(board, LAST_PART_S, rate_hz)?)?;
        let turned = match (samples.first(), samples.last()) {
            (Some(first), Some(last)) => last.counts.wrapping_sub(first.counts),
            _ => 0,
        };
        if turned.abs() < TURNING_COUNTS {
            return Err(TuningError::Standstill);
        }
        board.command(&format!("ref {to_v}"))?;
        samples.extend(untripped(samples_of(board, hold_s, rate_hz)?)?);
        Ok(samples)
    })?;
    let first = samples[0].tick;
    let column = |of: &dyn Fn(&Sample) -> f64| samples.iter().map(of).collect::<Vec<f64>>();
    let time_s = column(&|sample| f64::from(sample.tick.wrapping_sub(first)) / rate_hz);
    let volts = column(&|sample| {
        f64::from(sample.duty) / f64::from(HARDWARE.pwm_steps) * f64::from(sample.supply) / f64::from(VOLT)
    });
    Ok(fit(&time_s, &volts, &column(&|sample| speed(sample, settings)))?)
}

/// Speed at a voltage that is held for `hold_s`. Ends disarmed.
///
/// # Errors
/// [`TuningError`].
pub fn steady_speed(
    board: &mut impl Board,
    settings: &Settings,
    voltage_v: f64,
    hold_s: f64,
) -> Result<f64, TuningError> {
    let rate_hz = f64::from(settings.get(Param::TickRate));
    jumping(board, settings, |board| {
        board.command(&format!("ref {voltage_v}"))?;
        samples_of(board, hold_s - LAST_PART_S, rate_hz)?;
        let samples = untripped(samples_of(board, LAST_PART_S, rate_hz)?)?;
        let mean = samples.iter().map(|sample| speed(sample, settings)).sum::<f64>() / samples.len().max(1) as f64;
        if mean == 0.0 { Err(TuningError::Standstill) } else { Ok(mean) }
    })
}

/// Sets open loop without a slew limit for an experiment, and restores the board after it.
fn jumping<B: Board, R>(
    board: &mut B,
    settings: &Settings,
    experiment: impl FnOnce(&mut B) -> Result<R, TuningError>,
) -> Result<R, TuningError> {
    board.command(&format!("set slew_limit {JUMP_V_PER_S}"))?;
    // If the board refuses to arm, as with a latched trip, the slew limit is restored as well. Without a slew limit
    // motors trip.
    let result = begin(board).map_err(TuningError::from).and_then(|()| experiment(board));
    let left = board
        .command("disarm")
        .and_then(|()| board.command(&format!("set slew_limit {}", settings.get(Param::SlewLimit))));
    // The reason for a missing result is reported first.
    let found = result?;
    left?;
    Ok(found)
}

fn begin(board: &mut impl Board) -> Result<(), BoardError> {
    arm(board)?;
    board.command("mode open")?;
    board.samples(0.0).map(drop)
}

fn cycle(board: &mut impl Board, settings: &Settings, relay: &Relay) -> Result<BoardCycle, TuningError> {
    let tick_s = 1.0 / f64::from(settings.get(Param::TickRate));
    let mut switching = Switching::new(relay);
    let mut delays = Delays::default();
    board.command(&format!("ref {:.3}", switching.voltage_v()))?;
    let (mut first, mut last): (Option<u32>, Option<u32>) = (None, None);
    // The timeout counts the ticks of samples, so it needs some.
    let mut silence = Silence::default();
    loop {
        board.stay_alive()?;
        let look = Instant::now();
        let came = board.samples(READ_INTERVAL_S)?;
        silence.after(look, &came)?;
        for sample in untripped(came)? {
            let ticks = last.map_or(0, |last| sample.tick.wrapping_sub(last));
            let begun = *first.get_or_insert(sample.tick);
            last = Some(sample.tick);
            delays.see(&sample);
            if f64::from(sample.tick.wrapping_sub(begun)) * tick_s > relay.timeout_s {
                return Err(relay.no_cycle().into());
            }
            if switching.observe(speed(&sample, settings), ticks) {
                delays.switched(&sample);
                board.command(&format!("ref {:.3}", switching.voltage_v()))?;
            }
            if let Some(found) = switching.found(tick_s) {
                return Ok(BoardCycle { cycle: found?, delay_s: delays.mean_ticks() * tick_s });
            }
        }
    }
}

/// Ticks between the samples that crossed and the changes of the reference that followed.
#[derive(Default)]
struct Delays {
    waiting: Option<(u32, i32)>,
    sum: f64,
    number: f64,
}

impl Delays {
    fn switched(&mut self, sample: &Sample) {
        self.waiting = Some((sample.tick, sample.reference));
    }

    fn see(&mut self, sample: &Sample) {
        if let Some((tick, _)) = self.waiting.take_if(|(_, reference)| *reference != sample.reference) {
            self.sum += f64::from(sample.tick.wrapping_sub(tick));
            self.number += 1.0;
        }
    }

    fn mean_ticks(&self) -> f64 {
        self.sum / self.number
    }
}

fn speed(sample: &Sample, settings: &Settings) -> f64 {
    f64::from(sample.speed) * speed_bit_rad_per_s(settings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_link::fake_board::FakeBoard as Fake;

    /// Without samples nothing would end the experiment, while the board is kept alive.
    #[test]
    fn a_relay_without_telemetry_ends_and_stops_the_motor() {
        let mut board = Fake::that_sends(300);
        let relay = Relay {
            reference_rad_per_s: 60.0,
            bias_v: 7.0,
            amplitude_v: 1.0,
            hysteresis_rad_per_s: 0.5,
            timeout_s: 10.0,
        };
        let error = super::relay(&mut board, &Settings::defaults(), &relay).expect_err("there is nothing to switch by");
        assert_eq!(error, TuningError::Board(BoardError::NoTelemetry));
        assert!(board.heard.contains(&"disarm".into()), "{:?}", board.heard);
        assert_eq!(board.heard.last().map(String::as_str), Some("set slew_limit 500"));
    }
}

//! The test that gains have to pass on the board.

use super::USUAL_RAD_PER_S;
use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings};
use motorbench_data::telemetry::speed_bit_rad_per_s;
use motorbench_link::board::{Board, BoardError, arm, samples_of, untripped};
use motorbench_link::record::missing_ticks;

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
/// Step of the acceptance test of a position, and its time.
pub(super) const STEP_RAD: f64 = 2.0;
const POSITION_TEST_S: f64 = 2.0;

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
pub(super) fn acceptance(
    board: &mut impl Board,
    settings: &Settings,
    reference: f64,
) -> Result<(f64, f64), BoardError> {
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
    Ok(judged(&shares, reference))
}

/// Goes on by a step from rest; returns overshoot in percent, and mean error at the end in rad.
pub(super) fn acceptance_of_position(board: &mut impl Board, settings: &Settings) -> Result<(f64, f64), BoardError> {
    come_to_rest(board, settings, USUAL_RAD_PER_S)?;
    arm(board)?;
    let rate_hz = f64::from(settings.get(Param::TickRate));
    let begun = untripped(samples_of(board, READ_INTERVAL_S, rate_hz)?)?;
    let start = begun.last().map_or(0, |sample| sample.counts);
    let angle = |counts: i32| f64::from(counts.wrapping_sub(start)) * rad_per_count(settings);
    board.command("mode position")?;
    board.samples(0.0)?;
    board.command(&format!("ref {:.5}", f64::from(start) * rad_per_count(settings) + STEP_RAD))?;
    let samples = samples_of(board, POSITION_TEST_S, rate_hz).and_then(untripped);
    let off = board.command("disarm");
    let samples = samples?;
    off?;
    has_come(&samples)?;
    let shares: Vec<f64> = samples.iter().map(|sample| angle(sample.counts) / STEP_RAD).collect();
    Ok(judged(&shares, STEP_RAD))
}

/// Overshoot in percent, and the mean error at the end, of a course in shares of what was asked for.
fn judged(shares: &[f64], asked: f64) -> (f64, f64) {
    let last = &shares[shares.len() - (LAST_PART * shares.len() as f64) as usize..];
    let error = last.iter().map(|share| (share - 1.0) * asked).sum::<f64>() / last.len() as f64;
    (100.0 * (shares.iter().copied().fold(1.0, f64::max) - 1.0), error.abs())
}

pub(super) fn rad_per_count(settings: &Settings) -> f64 {
    std::f64::consts::TAU / f64::from(settings.get(Param::CountsPerRev))
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

//! Whether a recording belongs to a scenario, and the two paired in time and origin.

use super::super::Failure;
use super::super::files::side_file;
use super::title;
use host_sim::scenario::Scenario;
use motorbench_core::settings::Param;
use motorbench_data::recording::{Channel, Recording};
use motorbench_diagnosis::compare::{Comparison, compare, distance};
use motorbench_diagnosis::dataset::median;
use motorbench_text::terminal_text::short;
use std::f64::consts::TAU;
use std::path::Path;

/// Note about a simulated drive that has tripped.
pub(super) const NOTHING_BEYOND: &str = "the comparison ends there";

/// Pairs the measured loop with the simulated one, whose drive may have tripped. Returns them as compared, from the
/// origin of the simulation.
pub(super) fn compared(
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
pub(super) fn agrees_by_mode(scenario: &Scenario, measured: &Recording, file: &Path) -> Result<Option<String>, String> {
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
pub(super) fn agrees_by_course(scenario: &Scenario, compared: &Comparison) -> Result<(), String> {
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

pub(super) fn is_short(scenario: &Scenario, compared: &Comparison) -> Option<String> {
    let Comparison { duration_s, .. } = compared;
    (*duration_s < WHOLE * scenario.duration_s).then(|| {
        format!("the scenario lasts {} s; the recording has {} s of it", short(scenario.duration_s), short(*duration_s))
    })
}

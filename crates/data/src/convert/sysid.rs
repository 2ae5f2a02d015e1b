//! The legacy JSON of `WPILib` `SysId`. It has the tests `slow-forward`, `slow-backward`, `fast-forward` and
//! `fast-backward`, each a list of `[time in s, V, rotations, rotations/s]`.

use super::{Column, Fault, times};
use crate::recording::{Channel, Recording};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::ops::Range;

const TESTS: [&str; 4] = ["slow-forward", "slow-backward", "fast-forward", "fast-backward"];
/// Pause between two tests, so that each counts as a separate recording.
const PAUSE_S: f64 = 1.0;
/// A step reaches this share of its largest voltage within its first quarter; a ramp does not.
const STEP_SHARE: f64 = 0.75;

/// The four tests in the order of time, with pauses between them.
pub fn read(bytes: &[u8]) -> Result<Vec<Column>, Fault> {
    let file: Value = serde_json::from_slice(bytes).map_err(|error| {
        Fault::at(format_args!("line {}, column {}", error.line(), error.column()), error.to_string())
    })?;
    if file.get("sysid").is_none() {
        return Err(Fault::whole(
            "no key \"sysid\": expected the legacy JSON of SysId, with \"sysid\": true and four tests",
        ));
    }
    if file["test"] == "Drivetrain" {
        return Err(Fault::at("\"test\"", "a drivetrain has two motors: export one side as a test \"Simple\""));
    }
    let mut tests = Vec::new();
    for name in TESTS {
        let rows =
            file[name].as_array().ok_or_else(|| Fault::at(format_args!("\"{name}\""), "this test is missing"))?;
        let samples = rows.iter().enumerate().map(|(row, value)| sample(name, row, value));
        tests.push(samples.collect::<Result<Vec<_>, _>>()?);
    }
    tests.retain(|test| !test.is_empty());
    tests.sort_by(|a, b| a[0][0].total_cmp(&b[0][0]));
    let mut all: Vec<[f64; 4]> = Vec::new();
    for test in tests {
        let start_s = all.last().map_or(0.0, |last| last[0] + PAUSE_S);
        let first_s = test[0][0];
        all.extend(test.iter().map(|[t_s, u, turns, rate]| [start_s + t_s - first_s, *u, turns * TAU, rate * TAU]));
    }
    let channels = [Channel::Time, Channel::Voltage, Channel::Angle, Channel::Speed];
    let column = |(index, channel): (usize, Channel)| Column {
        name: channel.column().into(),
        values: all.iter().map(|sample| sample[index]).collect(),
    };
    Ok(channels.into_iter().enumerate().map(column).collect())
}

fn sample(test: &str, row: usize, value: &Value) -> Result<[f64; 4], Fault> {
    let numbers: Option<Vec<f64>> = value.as_array().and_then(|row| row.iter().map(Value::as_f64).collect());
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        let place = format!("\"{test}\", sample {}", row + 1);
        Fault::at(place, format!("expected [time, voltage, position, velocity], found {value}"))
    })
}

/// The longest ramp and the longest step of the voltage in each direction as the four tests.
pub fn write(recording: &Recording) -> Result<Vec<u8>, Fault> {
    let time_s = times(recording)?;
    let need = |channel: Channel| {
        recording
            .get(channel)
            .ok_or_else(|| Fault::at(channel.column(), "SysId needs this column, but the recording does not have it"))
    };
    let (voltage, speed) = (need(Channel::Voltage)?, need(Channel::Speed)?);
    let angle = recording.get(Channel::Angle).map_or_else(|| integrated(time_s, speed), <[f64]>::to_vec);
    let mut file = json!({ "sysid": true, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0 });
    let runs = runs(time_s, voltage);
    for (name, (slow, forward)) in TESTS.into_iter().zip([(true, true), (true, false), (false, true), (false, false)]) {
        let is_it =
            |run: &&Range<usize>| (voltage[run.start] > 0.0) == forward && is_ramp(&voltage[(*run).clone()]) == slow;
        let run = runs.iter().filter(is_it).max_by_key(|run| run.len()).ok_or_else(|| {
            let (what, sign) = (if slow { "slow ramp" } else { "step" }, if forward { "positive" } else { "negative" });
            Fault::at(
                format_args!("\"{name}\""),
                format!("this test is a {what} of {sign} voltage, but the recording has none"),
            )
        })?;
        let sample = |index: usize| [time_s[index], voltage[index], angle[index] / TAU, speed[index] / TAU];
        file[name] = run.clone().filter(|index| speed[*index].is_finite()).map(sample).collect();
    }
    serde_json::to_vec_pretty(&file).map_err(|error| Fault::whole(error.to_string()))
}

fn integrated(time_s: &[f64], speed: &[f64]) -> Vec<f64> {
    let mut angle_rad = vec![0.0; time_s.len()];
    for index in 1..time_s.len() {
        let step = 0.5 * (speed[index] + speed[index - 1]) * (time_s[index] - time_s[index - 1]);
        angle_rad[index] = angle_rad[index - 1] + if step.is_finite() { step } else { 0.0 };
    }
    angle_rad
}

/// Stretches with one direction of the voltage, without pauses.
fn runs(time_s: &[f64], voltage: &[f64]) -> Vec<Range<usize>> {
    let driven = |index: usize| voltage[index].abs() > 0.0;
    let follows = |index: usize| {
        driven(index)
            && voltage[index].signum() == voltage[index - 1].signum()
            && time_s[index] - time_s[index - 1] < PAUSE_S / 2.0
    };
    let starts: Vec<usize> = (0..voltage.len())
        .filter(|index| driven(*index) && (*index == 0 || !driven(index - 1) || !follows(*index)))
        .collect();
    starts
        .into_iter()
        .map(|start| start..(start + 1..voltage.len()).find(|index| !follows(*index)).unwrap_or(voltage.len()))
        .collect()
}

fn is_ramp(voltage: &[f64]) -> bool {
    let greatest = crate::statistics::greatest(voltage);
    crate::statistics::greatest(&voltage[..voltage.len().div_ceil(4)]) < STEP_SHARE * greatest
}

//! The legacy JSON of `WPILib` `SysId`. It has the tests `slow-forward`, `slow-backward`, `fast-forward` and
//! `fast-backward`, each a list of `[time in s, V, rotations, rotations/s]`.

use super::{Fault, times};
use crate::content::{Column, Content};
use crate::recording::{Channel, Recording};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::ops::Range;

const TESTS: [&str; 4] = ["slow-forward", "slow-backward", "fast-forward", "fast-backward"];
/// What a sample has, and what brings it to SI units.
const SIMPLE: [(&str, f64); 4] = [("t_s", 1.0), ("u_V", 1.0), ("theta_rad", TAU), ("omega_rad_per_s", TAU)];
/// The same for a drivetrain. Its two sides are two motors.
const DRIVETRAIN: [(&str, f64); 9] = [
    ("t_s", 1.0),
    ("left/u_V", 1.0),
    ("right/u_V", 1.0),
    ("left/theta_rad", TAU),
    ("right/theta_rad", TAU),
    ("left/omega_rad_per_s", TAU),
    ("right/omega_rad_per_s", TAU),
    ("gyro/angle_rad", 1.0),
    ("gyro/rate_rad_per_s", 1.0),
];
/// Pause between two tests, so that each counts as a separate recording.
const PAUSE_S: f64 = 1.0;
/// A step reaches this share of its largest voltage within its first quarter; a ramp does not.
const STEP_SHARE: f64 = 0.75;

/// The tests in the order of time, with pauses between them.
pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    let file: Value = serde_json::from_slice(&with_nulls(bytes)).map_err(|error| {
        Fault::at(format_args!("line {}, column {}", error.line(), error.column()), error.to_string())
    })?;
    if file.get("sysid").is_none() {
        return Err(Fault::whole(
            "no key \"sysid\": expected the legacy JSON of SysId, with \"sysid\": true and four tests",
        ));
    }
    let columns = if file["test"] == "Drivetrain" { &DRIVETRAIN[..] } else { &SIMPLE[..] };
    let (mut tests, mut missing) = (Vec::new(), Vec::new());
    for name in TESTS {
        let rows = file[name].as_array().map(Vec::as_slice).unwrap_or_default();
        let samples = rows.iter().enumerate().map(|(row, value)| sample(name, row, value, columns.len()));
        let samples = samples.collect::<Result<Vec<_>, _>>()?;
        if samples.is_empty() {
            missing.push(name);
        } else {
            tests.push(samples);
        }
    }
    if tests.is_empty() {
        return Err(Fault::whole(format!("all tests are missing or empty: expected {}", TESTS.join(", "))));
    }
    tests.sort_by(|a, b| a[0][0].total_cmp(&b[0][0]));
    let mut content = Content::of(columns.iter().map(|(name, _)| Column::new(*name, Vec::new())).collect());
    let mut start_s = 0.0;
    for test in tests {
        let first_s = test[0][0];
        for row in &test {
            content.columns[0].values.push(start_s + row[0] - first_s);
            for ((column, (_, factor)), value) in content.columns.iter_mut().zip(columns).zip(row).skip(1) {
                column.values.push(value * factor);
            }
        }
        start_s = content.columns[0].values.last().copied().unwrap_or(0.0) + PAUSE_S;
    }
    if !missing.is_empty() {
        content.notes.push(format!(
            "Of the four tests {} is missing or empty. With all four the constants are surer.",
            missing.join(", ")
        ));
    }
    Ok(content)
}

/// Python writes NaN and Infinity, which JSON does not have: null instead.
fn with_nulls(bytes: &[u8]) -> Vec<u8> {
    let (mut kept, mut rest, mut is_text) = (Vec::with_capacity(bytes.len()), bytes, false);
    while let Some((&byte, after)) = rest.split_first() {
        let word = ["-Infinity", "Infinity", "NaN"].into_iter().find(|word| rest.starts_with(word.as_bytes()));
        match word.filter(|_| !is_text) {
            Some(word) => {
                kept.extend(b"null");
                rest = &rest[word.len()..];
            }
            None => {
                is_text ^= byte == b'"' && kept.last() != Some(&b'\\');
                kept.push(byte);
                rest = after;
            }
        }
    }
    kept
}

fn sample(test: &str, row: usize, value: &Value, width: usize) -> Result<Vec<f64>, Fault> {
    let number = |cell: &Value| if cell.is_null() { Some(f64::NAN) } else { cell.as_f64() };
    let numbers: Option<Vec<f64>> = value.as_array().and_then(|row| row.iter().map(number).collect());
    numbers.filter(|numbers| numbers.len() == width).ok_or_else(|| {
        let expected = match width {
            4 => "[time, voltage, position, velocity]",
            _ => "[time, and voltages, positions, velocities left and right, angle, angular rate]",
        };
        let place = format!("\"{test}\", sample {}", row + 1);
        Fault::at(place, format!("expected {expected}, found {value}"))
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

//! Values of the rig file that the recorded columns contradict. Counts beside a speed or an angle give the counts per
//! revolution; a duty beside a voltage gives the supply.

use super::columns::{greatest, held, median};
use super::{GREATEST_DUTY, LONG_ROW, end_of_range, turns};
use crate::configuration::dataset::contradictions::{
    AGREE, AS_IT_STANDS, BLOCK_S, FEWEST_BLOCKS, FEWEST_COUNTS, FEWEST_ROWS, LOST, OFF, SUBSTANTIAL_DUTY,
};
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::Rig;
use motorbench_text::terminal_text::short;
use std::f64::consts::TAU;

/// A value of the rig file, and the value that a recording gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Contradiction {
    /// Its key.
    pub key: &'static str,
    /// The columns that contradict it.
    columns: String,
    recording: String,
    /// By the rig file.
    pub of_rig: f64,
    /// By the columns.
    pub of_data: f64,
}

impl Contradiction {
    /// The note on it.
    pub fn note(&self) -> String {
        let Self { key, columns, recording, of_rig, of_data } = self;
        let cause = match *key {
            COUNTS => "Check x4 decoding, and that the encoder is on the motor's shaft, not behind a gear.",
            _ => "Was it measured at the bridge?",
        };
        format!(
            "The rig file contradicts {recording}: it has {key} = {}, but {columns} give {}. {cause} Correct the rig file, or convert the column (`motorbench convert` with --map).",
            short(*of_rig),
            short(*of_data)
        )
    }
}

const COUNTS: &str = "[encoder] counts_per_rev";
const SUPPLY: &str = "[supply] voltage_V";

/// The contradictions between a recording and a rig file.
pub fn contradictions(recording: &Recording, rig: &Rig) -> Vec<Contradiction> {
    [of_counts(recording, rig), of_supply(recording, rig)].into_iter().flatten().collect()
}

fn of_counts(recording: &Recording, rig: &Rig) -> Option<Contradiction> {
    let of_rig = rig.encoder.counts_per_rev?;
    let time_s = recording.time_s()?;
    let counts = turns::counts(time_s, recording.get(Channel::Counts)?, of_rig).ok()?;
    let (column, angle_rad) = turned(recording, time_s)?;
    let per_rev = blocks(time_s, &counts, &angle_rad).into_iter().map(|(counts, rad)| TAU * counts / rad);
    let of_data = agreed(&per_rev.collect::<Vec<f64>>(), of_rig)?;
    let is_off = of_data / of_rig > 1.0 + OFF || of_data / of_rig < 1.0 - LOST;
    is_off.then(|| Contradiction {
        key: COUNTS,
        columns: format!("counts and {}", column.column()),
        recording: recording.name.clone(),
        of_rig,
        of_data,
    })
}

/// Angle turned since the row before, by the column beside the counts; NaN where it is unknown.
fn turned(recording: &Recording, time_s: &[f64]) -> Option<(Channel, Vec<f64>)> {
    if let Some(angle) = recording.get(Channel::Angle) {
        let angle = turns::angle_rad(time_s, angle).ok()?;
        return Some((Channel::Angle, angle.windows(2).map(|pair| pair[1] - pair[0]).collect()));
    }
    let of = |channel: Channel, unit: f64| {
        let mut speed: Vec<f64> = recording.get(channel)?.iter().map(|value| unit * value).collect();
        // A saturated reading shows less than the shaft turns.
        end_of_range::leave_out(&mut speed);
        let way = |(pair, times): (&[f64], &[f64])| 0.5 * (pair[0] + pair[1]) * (times[1] - times[0]);
        Some((channel, speed.windows(2).zip(time_s.windows(2)).map(way).collect()))
    };
    of(Channel::Speed, 1.0).or_else(|| of(Channel::Rpm, TAU / 60.0))
}

/// Counts and angle of each block in which the shaft goes far enough. `turned_rad`: from each row to the next.
fn blocks(time_s: &[f64], counts: &[f64], turned_rad: &[f64]) -> Vec<(f64, f64)> {
    let usual_s = median(time_s.windows(2).map(|pair| pair[1] - pair[0]));
    let (mut found, mut begun_s, mut sum) = (Vec::new(), time_s[0], (0.0, 0.0));
    for (row, turned_rad) in turned_rad.iter().enumerate() {
        let counted = counts[row + 1] - counts[row];
        let is_usual = time_s[row + 1] - time_s[row] < LONG_ROW * usual_s;
        if is_usual && counted.is_finite() && turned_rad.is_finite() {
            sum = (sum.0 + counted, sum.1 + turned_rad);
        }
        if time_s[row + 1] - begun_s >= BLOCK_S {
            found.push(std::mem::take(&mut sum));
            begun_s = time_s[row + 1];
        }
    }
    found.retain(|(counted, rad)| counted.abs() >= FEWEST_COUNTS && counted * rad > 0.0);
    found
}

/// The median, if the values agree well enough to exclude the other value.
fn agreed(values: &[f64], other: f64) -> Option<f64> {
    let middle = median(values.iter().copied());
    let usual = median(values.iter().map(|value| (value / middle).ln().abs()));
    (values.len() >= FEWEST_BLOCKS && usual < AGREE * (middle / other).ln().abs()).then_some(middle)
}

fn of_supply(recording: &Recording, rig: &Rig) -> Option<Contradiction> {
    let of_rig = rig.supply.voltage_v?;
    let (duty, volts) = (held(recording.get(Channel::Duty)?), recording.get(Channel::Voltage)?);
    if greatest(&duty) > GREATEST_DUTY {
        return None;
    }
    let driven: Vec<(f64, f64)> = duty
        .iter()
        .zip(volts)
        .filter(|(duty, volts)| duty.abs() > SUBSTANTIAL_DUTY && volts.is_finite())
        .map(|(duty, volts)| (*duty, *volts))
        .collect();
    let of_data = supply_v(&driven)?;
    let is_off = |volts: f64| (volts / of_rig - 1.0).abs() > OFF && (volts > of_rig) == (of_data > of_rig);
    let mut each: Vec<f64> = driven.iter().map(|(duty, volts)| volts / duty).collect();
    each.sort_unstable_by(f64::total_cmp);
    let share = |share: f64| each[(share * (each.len() - 1) as f64) as usize];
    let ends = [AS_IT_STANDS, 1.0 - AS_IT_STANDS].map(share);
    let all_are_off = is_off(of_data) && ends.into_iter().all(is_off);
    all_are_off.then(|| Contradiction {
        key: SUPPLY,
        columns: format!("{} and {}", Channel::Duty.column(), Channel::Voltage.column()),
        recording: recording.name.clone(),
        of_rig,
        of_data,
    })
}

/// Slope of the voltage over the duty, beside a constant voltage drop. If only one magnitude was played, the voltage
/// over the duty.
fn supply_v(driven: &[(f64, f64)]) -> Option<f64> {
    if driven.len() < FEWEST_ROWS {
        return None;
    }
    let magnitudes = || driven.iter().map(|(duty, volts)| (duty.abs(), volts * duty.signum()));
    let mean = |of: &dyn Fn((f64, f64)) -> f64| magnitudes().map(of).sum::<f64>() / driven.len() as f64;
    let (duty, volts) = (mean(&|(duty, _)| duty), mean(&|(_, volts)| volts));
    let square = mean(&|(other, _)| (other - duty).powi(2));
    let product = mean(&|(other, other_v)| (other - duty) * (other_v - volts));
    Some(if square > (OFF * duty).powi(2) { product / square } else { volts / duty })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 8000;
    const PER_REV: f64 = 400.0;
    const SUPPLY_V: f64 = 12.0;

    fn speed(t_s: f64) -> f64 {
        150.0 * (2.0 * t_s).sin() + 60.0 * (9.0 * t_s).sin() - 20.0
    }

    fn angle(t_s: f64) -> f64 {
        75.0 * (1.0 - (2.0 * t_s).cos()) + 60.0 / 9.0 * (1.0 - (9.0 * t_s).cos()) - 20.0 * t_s
    }

    fn duty(t_s: f64) -> f64 {
        (7.0 * (2.0 * t_s).floor()).sin()
    }

    /// The readings at each time, of the wanted columns.
    fn recording(columns: &[(Channel, &dyn Fn(f64) -> f64)]) -> Recording {
        let times = || (0..ROWS).map(|row| 1e-3 * row as f64);
        let mut recording = Recording::new("run.csv");
        recording.set(Channel::Time, times().collect());
        columns.iter().for_each(|(channel, of)| recording.set(*channel, times().map(of).collect()));
        recording
    }

    fn found(recording: &Recording, rig: &str) -> Vec<(&'static str, f64)> {
        let found = contradictions(recording, &Rig::parse("rig.toml", rig).unwrap());
        found.into_iter().map(|found| (found.key, found.of_data)).collect()
    }

    fn counts(t_s: f64) -> f64 {
        (angle(t_s) * PER_REV / TAU).floor()
    }

    #[test]
    fn counts_beside_a_speed_or_an_angle_say_how_many_make_a_revolution() {
        let beside: [(Channel, &dyn Fn(f64) -> f64); 4] = [
            (Channel::Speed, &speed),
            (Channel::Rpm, &|t_s| speed(t_s) * 60.0 / TAU),
            (Channel::Angle, &angle),
            (Channel::Angle, &|t_s| angle(t_s).rem_euclid(TAU)),
        ];
        for (channel, of) in beside {
            let recorded = recording(&[(Channel::Counts, &counts), (channel, of)]);
            for of_rig in [100.0, 200.0, 380.0, 1600.0, 30.0 * PER_REV] {
                let found = found(&recorded, &format!("[encoder]\ncounts_per_rev = {of_rig}\n"));
                let [(COUNTS, of_data)] = found[..] else { panic!("{channel:?} {of_rig}: {found:?}") };
                assert!((of_data / PER_REV - 1.0).abs() < 0.02, "{channel:?} {of_rig}: {of_data}");
            }
            for of_rig in [390.0, 400.0, 410.0] {
                assert_eq!(found(&recorded, &format!("[encoder]\ncounts_per_rev = {of_rig}\n")), [], "{channel:?}");
            }
        }
    }

    /// Of the same encoder, and of other sensors beside it.
    #[test]
    fn what_sensors_do_to_a_speed_is_no_contradiction() {
        let lagging = |t_s: f64| speed(t_s - 0.03);
        let noisy = |t_s: f64| speed(t_s) + 40.0 * (1e6 * t_s).sin();
        let ripple = |t_s: f64| speed(t_s) * (1.0 + 0.2 * (22.0 * angle(t_s)).sin());
        let clipped = |t_s: f64| speed(t_s).clamp(-60.0, 60.0);
        let off_scale = |t_s: f64| 0.96 * speed(t_s);
        let speeds: [&dyn Fn(f64) -> f64; 5] = [&lagging, &noisy, &ripple, &clipped, &off_scale];
        let eccentric = |t_s: f64| ((angle(t_s) + 0.3 * angle(t_s).sin()) * PER_REV / TAU).floor();
        let lost = |t_s: f64| (0.82 * angle(t_s) * PER_REV / TAU).floor();
        let short = |t_s: f64| counts(t_s).rem_euclid(65_536.0);
        let counters: [&dyn Fn(f64) -> f64; 4] = [&counts, &eccentric, &lost, &short];
        for (speed_kind, speed) in speeds.into_iter().enumerate() {
            for (counter, counts) in counters.into_iter().enumerate() {
                let recorded = recording(&[(Channel::Counts, counts), (Channel::Speed, speed)]);
                let found = found(&recorded, "[encoder]\ncounts_per_rev = 400\n");
                assert_eq!(found, [], "speed {speed_kind} counts {counter}");
            }
        }
    }

    #[test]
    fn a_duty_beside_a_voltage_says_what_the_supply_was() {
        let (volts, steps) = (|t_s: f64| SUPPLY_V * duty(t_s), |t_s: f64| 0.5 * duty(t_s).signum());
        for duty in [&duty as &dyn Fn(f64) -> f64, &steps] {
            let volts = |t_s: f64| SUPPLY_V * duty(t_s);
            let recorded = recording(&[(Channel::Duty, duty), (Channel::Voltage, &volts)]);
            for of_rig in [9.0, 11.3, 24.0] {
                let found = found(&recorded, &format!("[supply]\nvoltage_V = {of_rig}\n"));
                let [(SUPPLY, of_data)] = found[..] else { panic!("{of_rig}: {found:?}") };
                assert!((of_data / SUPPLY_V - 1.0).abs() < 1e-6, "{of_data}");
            }
        }
        let sagging = |t_s: f64| duty(t_s) * (SUPPLY_V - 3.0 * duty(t_s).abs() * (7.0 * t_s).sin().abs());
        let behind_a_bridge = |t_s: f64| SUPPLY_V * duty(t_s) - 2.0 * duty(t_s).signum();
        let percent = |t_s: f64| 100.0 * duty(t_s);
        for (duty, volts) in [
            (&duty as &dyn Fn(f64) -> f64, &volts as &dyn Fn(f64) -> f64),
            (&duty, &sagging),
            (&duty, &behind_a_bridge),
            (&percent, &volts),
        ] {
            let recorded = recording(&[(Channel::Duty, duty), (Channel::Voltage, volts)]);
            assert_eq!(found(&recorded, "[supply]\nvoltage_V = 12\n"), []);
        }
    }
}

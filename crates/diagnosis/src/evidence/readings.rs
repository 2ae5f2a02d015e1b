//! The lack of a reading: measured, less simulated without the cause.

use super::axis::{Axis, coordinate, rows};
use super::{Bin, Case};
use crate::configuration::evidence::FINER;
use crate::configuration::evidence::readings::{NEARLY_ALL, STEP};
use crate::dataset::{Dataset, Output};
use crate::free_run::{Steps, drive, read};
use motorbench_model::catalogue::{ActsOn, Coordinate, Strength};

/// Milliseconds in a second.
const MS: f64 = 1e3;

/// A row: its coordinate, what a unit of the strength changes, and by how much the reading differs, measured and by the law.
struct Place {
    coordinate: f64,
    unit: f64,
    lack: f64,
    law: f64,
    /// How far the shaft turns in it.
    turned_rad: f64,
}

/// What lacks, and its unit.
pub(super) fn quantity(case: &Case) -> (&'static str, &'static str) {
    let output = case.data.measured[output(case)].output;
    match (case.term.effect.about().shown.as_a, output) {
        (Strength::ShareOfReading, Output::Current) => ("change of the current's reading", "%"),
        (Strength::ShareOfReading, _) => ("change of the speed's reading", "%"),
        (_, Output::Current) => ("change of the current", "A"),
        _ => ("change of the speed", "rad/s"),
    }
}

/// The reading that shows it.
fn output(case: &Case) -> usize {
    let data = case.data;
    let current = data.measured.iter().position(|measured| measured.output == Output::Current);
    match (case.term.effect.about().acts_on, current) {
        ([ActsOn::CurrentSensor], Some(current)) => current,
        _ => data.motion_index(),
    }
}

pub(super) fn binned(case: &Case) -> Option<(Vec<Bin>, Vec<[f64; 2]>)> {
    let Case { model, data, term, predicted, .. } = case;
    let over = term.effect.about().shown.over;
    let output = output(case);
    let without = model.without(term.id());
    let motion = drive(&without, data, Steps::Fine);
    let simulated = &read(&without, data, motion.clone())[output];
    let mut places: Vec<Place> = match over {
        Coordinate::SinceStep => since_steps(data),
        over => rows(data).map(|row| (row, coordinate(over, &motion.instant(data, row)), 1.0)).collect(),
    }
    .into_iter()
    .map(|(row, coordinate, sign)| Place {
        coordinate,
        unit: sign * unit(term.effect.about().shown.as_a, data, simulated, row),
        lack: data.measured[output].values[row] - simulated[row],
        law: predicted[output][row] - simulated[row],
        turned_rad: if over == Coordinate::Angle { motion.instant(data, row).turned_rad.abs() } else { 0.0 },
    })
    .filter(|place| [place.unit, place.lack, place.law].iter().all(|value| value.is_finite()))
    .collect();
    if over == Coordinate::SinceStep {
        let end = end_of_response(&mut places)?;
        places.retain(|place| place.coordinate <= end);
    }
    let axis = Axis::of(term, places.iter().map(|place| place.coordinate))?;
    // In a longer row the shaft passes through several bins.
    places.retain(|place| over != Coordinate::Angle || place.turned_rad < axis.first_width());
    let bins = bins(&places, &axis);
    // Readings come row by row: finer bins than the rows would be empty.
    let finer = if over == Coordinate::SinceStep { 1 } else { FINER };
    let law = self::bins(&places, &axis.finer(finer)).into_iter().map(|bin| [bin.at, bin.law]).collect();
    Some((bins, law))
}

/// What one unit of a strength changes in a reading.
fn unit(strength: Strength, data: &Dataset, simulated: &[f64], row: usize) -> f64 {
    match strength {
        Strength::ShareOfReading => 0.01 * simulated[row],
        Strength::Delay if row > 0 && row + 1 < simulated.len() => {
            -(simulated[row + 1] - simulated[row - 1]) / (data.time_s[row + 1] - data.time_s[row - 1]) / MS
        }
        Strength::Delay => 0.0,
        _ => 1.0,
    }
}

/// Rows with the time since the last step of the command in milliseconds, and which way it went.
fn since_steps(data: &Dataset) -> Vec<(usize, f64, f64)> {
    let mut found = Vec::new();
    for stretch in &data.stretches {
        let mut last: Option<(f64, f64)> = None;
        for row in stretch.rows.clone().skip(1) {
            let by_v = data.command[row] - data.command[row - 1];
            if by_v.abs() > STEP * data.supply_v[row] {
                last = Some((data.time_s[row], by_v.signum()));
            }
            found.extend(last.map(|(begin_s, sign)| (row, MS * (data.time_s[row] - begin_s), sign)));
        }
    }
    found
}

/// When nearly all of the law has been seen after a step.
fn end_of_response(places: &mut [Place]) -> Option<f64> {
    places.sort_by(|a, b| a.coordinate.total_cmp(&b.coordinate));
    let all: f64 = places.iter().map(|place| place.law * place.law).sum();
    let mut seen = 0.0;
    let place = places.iter().find(|place| {
        seen += place.law * place.law;
        seen > NEARLY_ALL * all
    })?;
    Some(place.coordinate)
}

/// Means in the bins; the noise is what the law leaves.
fn bins(places: &[Place], axis: &Axis) -> Vec<Bin> {
    let left = places.iter().map(|place| (place.lack - place.law).powi(2)).sum::<f64>();
    let noise = (left / places.len().max(1) as f64).sqrt();
    let mut sums = vec![[0.0; 5]; axis.len()];
    for place in places {
        let Some(bin) = axis.bin(place.coordinate) else { continue };
        let Place { coordinate, unit, lack, law, .. } = place;
        for (sum, value) in sums[bin].iter_mut().zip([1.0, *coordinate, unit * unit, unit * lack, unit * law]) {
            *sum += value;
        }
    }
    let bin = |[count, at, units, lack, law]: [f64; 5]| {
        let bin = || Bin { at: at / count, lack: lack / units, law: law / units, deviation: noise / units.sqrt() };
        (units > 0.0).then(bin)
    };
    sums.into_iter().filter_map(bin).collect()
}

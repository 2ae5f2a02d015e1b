//! When commands changed, where rows are fewer than commands: a loop that runs ten times as often as it writes rows, or a program
//! that counts the time of a step and the time of a row by two clocks. The rows say what the command was, and not since when;
//! the motion says that.

use super::judge::{NOT_NOISE, above_floor};
use crate::dataset::{Dataset, LONG_ROW};
use crate::free_run::free_run;
use crate::identify::{Effort, Fit, Prior, fit};
use motorbench_model::Model;

/// Rows that are closer hardly lack commands, unless one is missing...
const SHORTEST_ROW_S: f64 = 1.5e-3;
/// ... which a long row says, or commands and rows go by two clocks: then they change in no more than this share of the rows.
const RARELY: f64 = 0.05;
/// A change by this share of the greatest voltage has a moment of its own; smaller ones are taken for halfway between the rows.
const LEAST_CHANGE: f64 = 0.002;
/// What a change does is looked at for so long.
const ANSWER_S: f64 = 0.1;
/// Moments and model are found in turn, so often.
const ROUNDS: usize = 5;
/// What is shifted to see what it does, as a share of the row.
const SHIFT: f64 = 0.1;
/// Moments have to bring the cost down to this share of that of commands that stand with their rows...
const LEAST_GAIN: f64 = 0.5;
/// ... where rows are close, and hardly lack commands, to this one...
const LEAST_GAIN_OF_CLOSE_ROWS: f64 = 0.2;
/// ... and those that were found by a poorer model to this share of what it was.
const CLOSER: f64 = 0.98;

/// Finds when the commands changed, if that explains most of a rest; whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    if above_floor(data, found) < NOT_NOISE {
        return false;
    }
    let is_refined = data.has_moments();
    let ways: Vec<(Dataset, Vec<usize>)> = match is_refined {
        true => {
            vec![(data.clone(), sought(data, |row| data.interval_s >= SHORTEST_ROW_S || data.earlier_s[row] > 0.0))]
        }
        false => with_commands_between(data),
    };
    let best = ways.into_iter().map(|(way, sought)| with_moments(way, &sought, prior, &found.model));
    let Some((other, cost)) = best.min_by(|a, b| a.1.total_cmp(&b.1)) else { return false };
    let least_gain = match (is_refined, data.interval_s < SHORTEST_ROW_S) {
        (true, _) => CLOSER,
        (false, true) => LEAST_GAIN_OF_CLOSE_ROWS,
        (false, false) => LEAST_GAIN,
    };
    let explains = cost <= least_gain * found.cost;
    if explains {
        *data = other;
    }
    explains
}

/// The data with commands that changed at moments of their own, and the rows before which they did: all of them, or those that
/// are longer than others.
fn with_commands_between(recorded: &Dataset) -> Vec<(Dataset, Vec<usize>)> {
    let Some(data) = recorded.with_commands_as_written() else { return Vec::new() };
    let data = &data;
    let all = sought(data, |_| true);
    let of_long_rows = sought(data, |row| data.time_s[row] - data.time_s[row - 1] > LONG_ROW * data.interval_s);
    let rows = data.len() as f64;
    // What looks as if it had been written after its command at close rows mostly was.
    let are_rare = (all.len() as f64) < RARELY * rows && !recorded.origin.written_after;
    let any = data.interval_s >= SHORTEST_ROW_S || are_rare;
    let ways = [any.then_some(all), (!of_long_rows.is_empty()).then_some(of_long_rows)];
    ways.into_iter().flatten().map(|sought| (data.with_commands_between(&sought), sought)).collect()
}

/// The same with the moments that the readings say, and what the model costs with them.
fn with_moments(mut data: Dataset, sought: &[usize], prior: &Prior, model: &Model) -> (Dataset, f64) {
    let mut best = fit(model, &data, prior, Effort::TRIAL);
    for _ in 0..ROUNDS {
        data.earlier_s = moments(&data, &best.model, sought);
        best = fit(&best.model, &data, prior, Effort::TRIAL);
    }
    (data, best.cost)
}

/// Rows with commands that are far from those before, of those that are `chosen`.
fn sought(data: &Dataset, chosen: impl Fn(usize) -> bool) -> Vec<usize> {
    let volts = &data.voltage_v;
    let greatest_v = volts.iter().fold(0.0, |greatest: f64, volts| greatest.max(volts.abs()));
    let changes = |row: usize| (volts[row] - volts[row - 1]).abs() > LEAST_CHANGE * greatest_v;
    let rows = data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1));
    rows.filter(|row| changes(*row) && chosen(*row)).collect()
}

/// The moments that bring the model closest to what was measured after each change, one step of least squares; where that says
/// nothing, the middle between the rows.
fn moments(data: &Dataset, model: &Model, changes: &[usize]) -> Vec<f64> {
    let row_s = |row: usize| data.time_s[row] - data.time_s[row - 1];
    let mut shifted = data.clone();
    for row in changes {
        let to_the_middle = if data.earlier_s[*row] > 0.5 * row_s(*row) { -SHIFT } else { SHIFT };
        shifted.earlier_s[*row] += to_the_middle * row_s(*row);
    }
    let (as_is, moved) = (free_run(model, data), free_run(model, &shifted));
    let mut earlier_s = data.earlier_s.clone();
    let ends = changes.iter().skip(1).copied().chain([data.len()]);
    for (row, end) in changes.iter().copied().zip(ends) {
        let answer = row..end.min(row + (ANSWER_S / data.interval_s) as usize + 1);
        let shift_s = shifted.earlier_s[row] - data.earlier_s[row];
        // Anywhere in the row: a spread of its length over the root of twelve.
        let known = 12.0 / row_s(row).powi(2);
        let (mut normal, mut towards) = (known, known * (0.5 * row_s(row) - data.earlier_s[row]));
        for (output, measured) in data.measured.iter().enumerate() {
            let weight = measured.least_error(measured.noise).powi(-2);
            for index in answer.clone() {
                let slope = (moved[output][index] - as_is[output][index]) / shift_s;
                let left = measured.values[index] - as_is[output][index];
                // Neither a missing reading nor a mean over rows that are not there says anything.
                if slope.is_finite() && left.is_finite() {
                    normal += weight * slope * slope;
                    towards += weight * slope * left;
                }
            }
        }
        earlier_s[row] = (data.earlier_s[row] + towards / normal).clamp(0.0, row_s(row));
    }
    earlier_s
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::motor::MotorParameters;
    use proptest::prelude::*;
    use std::fmt::Write as _;

    const FINE_S: f64 = 1e-3;
    const FINE_ROWS: usize = 2000;
    /// Of so many a row is written.
    const ONE_OF: usize = 10;

    /// Rows of a command and of readings as a program writes them.
    fn dataset(interval_s: f64, rows: impl Iterator<Item = [f64; 3]>) -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for (row, [volts, speed, current]) in rows.enumerate() {
            let _ = writeln!(text, "{:.4},{volts},{speed:.3},{current:.4}", row as f64 * interval_s);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    /// The mean over a window that begins before the recording is in the readings and in no simulation.
    #[test]
    fn a_change_before_the_first_mean_has_a_moment() {
        let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
        for row in 0..400 {
            let volts = if row % 100 < 2 { 2 } else { 9 };
            let _ = writeln!(text, "{:.3},{volts},{}", f64::from(row) * 1e-2, row % 100);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let rig = "[supply]\nvoltage_V = 12\n[recording]\nspeed_window_s = 0.05\n";
        let data = Dataset::new(&[recording], &Rig::parse("rig.toml", rig).unwrap()).unwrap();
        let changes = sought(&data, |_| true);
        assert_eq!(changes.first(), Some(&2));
        let found = moments(&data.with_commands_between(&changes), &Model::linear(MotorParameters::PIVT6), &changes);
        assert!(found.iter().all(|earlier_s| earlier_s.is_finite()), "{:?}", &found[..5]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        /// Against commands that were held for a time of their own each, in milliseconds.
        #[test]
        fn the_moments_of_steps_are_found(holds in prop::collection::vec((60usize..200, -10.0_f64..10.0), 20)) {
            let commands = || holds.iter().flat_map(|(hold, volts)| std::iter::repeat_n(*volts, *hold)).take(FINE_ROWS);
            prop_assume!(commands().count() == FINE_ROWS);
            let model = Model::linear(MotorParameters::PIVT6);
            // Only its commands are used.
            let undriven = commands().enumerate().map(|(row, volts)| [volts, (row % 200) as f64, (row % 2) as f64]);
            let fine = dataset(FINE_S, undriven);
            let moved = free_run(&model, &fine);
            let [speed, current] = [1, 0].map(|output| &moved[output]);
            let written = (0..FINE_ROWS).step_by(ONE_OF).map(|row| [fine.voltage_v[row], speed[row], current[row]]);
            let mut data = dataset(FINE_S * ONE_OF as f64, written);
            let changes = sought(&data, |_| true);
            data = data.with_commands_between(&changes);
            prop_assert!(changes.len() > 5);
            for _ in 0..ROUNDS {
                data.earlier_s = moments(&data, &model, &changes);
            }
            for row in changes {
                let (before, after) = (data.voltage_v[row - 1], data.voltage_v[row]);
                let back = (1..=ONE_OF).find(|back| fine.voltage_v[ONE_OF * row - back] != after).unwrap();
                let off_s = data.earlier_s[row] - (back - 1) as f64 * FINE_S;
                // Half a millisecond of a step of 10 V.
                prop_assert!((off_s * (after - before)).abs() < 5e-3, "{row}: {off_s} s of {} V", after - before);
            }
        }
    }
}

//! Estimates when the commands changed, where rows are fewer than commands. Examples: a loop that runs ten times as
//! often as it writes rows; a program that times its steps and its rows by two clocks. The rows give the command, but
//! not since when it acts; the motion shows that.

use super::judge::{AS_GOOD, NOT_NOISE, VERY_STRONG_NATS, above_floor, evidence_nats};
pub(super) use crate::configuration::diagnose::command_times::LEAST_GAIN;
use crate::configuration::diagnose::command_times::{
    ANSWER_S, CLOSER, EARLIER, LEAST_CHANGE, LEAST_GAIN_OF_CLOSE_ROWS, RARELY, ROUNDS_APART, ROUNDS_TOGETHER, SHIFT,
    SHORTEST_ROW_S,
};
use crate::dataset::{Dataset, LONG_ROW, greatest};
use crate::free_run::free_run;
use crate::identify::{Effort, Fit, Prior, fit};
use crate::parallel;
use motorbench_model::{Drive, Model, Term};
use std::ops::Range;

/// Estimates when the commands changed, if that explains most of the rest. Returns whether it did.
pub(super) fn settle(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    // A measured current is no command, and where smooth commands act is known.
    let is_known = data.axis.drive == Drive::Current || data.origin.smooth_earlier.is_some();
    if above_floor(data, found) < NOT_NOISE || is_known {
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
    let Some((other, best)) = best.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost)) else { return false };
    let least_gain = match (is_refined, data.interval_s < SHORTEST_ROW_S) {
        (true, _) => CLOSER,
        (false, true) => LEAST_GAIN_OF_CLOSE_ROWS,
        (false, false) => LEAST_GAIN,
    };
    let explains = best.cost <= least_gain * found.cost || explains_all(data, found, &other, &best);
    if explains {
        *data = other;
    }
    explains
}

/// Whether estimated times leave no more than noise, with very strong evidence: each of them counts as a constant.
fn explains_all(data: &Dataset, found: &Fit, other: &Dataset, best: &Fit) -> bool {
    let estimated = other.earlier_s.iter().filter(|earlier_s| **earlier_s > 0.0).count() as f64;
    let price = 0.5 * estimated * best.independent_residuals(data).ln();
    above_floor(other, best) < NOT_NOISE && evidence_nats(data, found, best) > VERY_STRONG_NATS + price
}

/// Takes a smooth command as changing between the rows, if that explains as much as two clocks that differ. A program that
/// sends more commands than it writes rows holds a sine for a shorter time than the rows say, but not a step: the two seem
/// to act late by different times. Returns whether it did.
pub(super) fn settle_smooth(data: &mut Dataset, prior: &Prior, found: &Fit) -> bool {
    let drifts = |term: &&Term| term.effect.delay_growth(&term.values) != 0.0;
    let Some(drift) = found.model.terms.iter().find(drifts).map(Term::id) else { return false };
    let Some(written) = data.with_commands_as_written().filter(|_| !data.has_moments()) else { return false };
    let model = found.model.without(drift);
    let smooth = smooth(&written);
    let ways = parallel::map(EARLIER, |share| {
        let other = written.with_smooth_commands_earlier(&smooth, share);
        let cost = fit(&model, &other, prior, Effort::TRIAL).cost;
        (other, cost)
    });
    let best = ways.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let best = best.filter(|(_, cost)| *cost <= AS_GOOD * found.cost);
    let explains = best.is_some();
    if let Some((other, _)) = best {
        *data = other;
    }
    explains
}

/// The rows in which a command goes on to change as it did before.
fn smooth(data: &Dataset) -> Vec<usize> {
    let change = |row: usize| data.command[row] - data.command[row - 1];
    let goes_on = |row: &usize| change(row - 1) * change(*row) > 0.0 && change(*row) * change(row + 1) > 0.0;
    let inner = |rows: &Range<usize>| rows.start + 2..rows.end.saturating_sub(1);
    data.stretches.iter().flat_map(|stretch| inner(&stretch.rows)).filter(goes_on).collect()
}

/// The data with estimated command times, and the rows before which they changed: all rows, or only the long ones.
fn with_commands_between(recorded: &Dataset) -> Vec<(Dataset, Vec<usize>)> {
    let Some(data) = recorded.with_commands_as_written() else { return Vec::new() };
    let data = &data;
    let all = sought(data, |_| true);
    let of_long_rows = sought(data, |row| data.time_s[row] - data.time_s[row - 1] > LONG_ROW * data.interval_s);
    let rows = data.len() as f64;
    // At short row intervals, rows that seem to be written after their command mostly were.
    let are_rare = (all.len() as f64) < RARELY * rows && !recorded.origin.written_after;
    let any = data.interval_s >= SHORTEST_ROW_S || are_rare;
    let ways = [any.then_some(all), (!of_long_rows.is_empty()).then_some(of_long_rows)];
    ways.into_iter().flatten().map(|sought| (data.with_commands_between(&sought), sought)).collect()
}

/// The data with the times that the readings give, and the model with them.
fn with_moments(mut data: Dataset, sought: &[usize], prior: &Prior, model: &Model) -> (Dataset, Fit) {
    let mut best = fit(model, &data, prior, Effort::TRIAL);
    for moved in rounds(sought) {
        data.earlier_s = moments(&data, &best.model, sought, &moved);
        best = fit(&best.model, &data, prior, Effort::TRIAL);
    }
    (data, best)
}

/// The changes whose moments are estimated in each round: all, then every second one in turn. What all of them move
/// together behind a great step is mostly that step's, and a small one next to it keeps a wrong moment.
fn rounds(sought: &[usize]) -> impl Iterator<Item = Vec<usize>> {
    let every_second = |first: usize| sought.iter().skip(first).step_by(2).copied().collect();
    let together = std::iter::repeat_n(sought.to_vec(), ROUNDS_TOGETHER);
    together.chain((0..ROUNDS_APART).map(move |round| every_second(round % 2)))
}

/// The `chosen` rows whose command differs clearly from the one before.
fn sought(data: &Dataset, chosen: impl Fn(usize) -> bool) -> Vec<usize> {
    let volts = &data.command;
    let greatest_v = greatest(volts);
    let changes = |row: usize| (volts[row] - volts[row - 1]).abs() > LEAST_CHANGE * greatest_v;
    let rows = data.stretches.iter().flat_map(|stretch| stretch.rows.clone().skip(1));
    rows.filter(|row| changes(*row) && chosen(*row)).collect()
}

/// The times that bring the model closest to the measurement after each of the `moved` changes, by one step of least
/// squares. Without information, the middle between the rows.
fn moments(data: &Dataset, model: &Model, changes: &[usize], moved: &[usize]) -> Vec<f64> {
    let row_s = |row: usize| data.time_s[row] - data.time_s[row - 1];
    let mut shifted = data.clone();
    for row in moved {
        let to_the_middle = if data.earlier_s[*row] > 0.5 * row_s(*row) { -SHIFT } else { SHIFT };
        shifted.earlier_s[*row] += to_the_middle * row_s(*row);
    }
    let (as_is, later) = (free_run(model, data), free_run(model, &shifted));
    let mut earlier_s = data.earlier_s.clone();
    let ends = changes.iter().skip(1).copied().chain([data.len()]);
    for (row, end) in changes.iter().copied().zip(ends).filter(|(row, _)| moved.binary_search(row).is_ok()) {
        let answer = row..end.min(row + (ANSWER_S / data.interval_s) as usize + 1);
        let shift_s = shifted.earlier_s[row] - data.earlier_s[row];
        // Anywhere in the row: a standard deviation of its length over the root of twelve.
        let known = 12.0 / row_s(row).powi(2);
        let (mut normal, mut towards) = (known, known * (0.5 * row_s(row) - data.earlier_s[row]));
        for (output, measured) in data.measured.iter().enumerate() {
            let weight = measured.least_error(measured.noise).powi(-2);
            for index in answer.clone() {
                let slope = (later[output][index] - as_is[output][index]) / shift_s;
                let left = measured.values[index] - as_is[output][index];
                // Missing readings, and means over rows that do not exist, contain no information.
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
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;
    use proptest::prelude::*;
    use std::fmt::Write as _;

    const FINE_S: f64 = 1e-3;
    const FINE_ROWS: usize = 2000;
    /// One row is written for this many steps.
    const ONE_OF: usize = 10;

    /// Rows of commands and readings as a program writes them.
    fn dataset(interval_s: f64, rows: impl Iterator<Item = [f64; 3]>) -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for (row, [volts, speed, current]) in rows.enumerate() {
            let _ = writeln!(text, "{:.4},{volts},{speed:.3},{current:.4}", row as f64 * interval_s);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    /// The mean over a window that begins before the recording is in the readings, but in no simulation.
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
        let model = Model::linear(MotorParameters::PIVT6);
        let found = moments(&data.with_commands_between(&changes), &model, &changes, &changes);
        assert!(found.iter().all(|earlier_s| earlier_s.is_finite()), "{:?}", &found[..5]);
    }

    /// Of two rows one is written. Steps first and a sine then: with the commands at their rows the sine seems to come ever
    /// earlier than the steps.
    #[test]
    fn a_sine_that_is_held_for_half_a_row_is_no_second_clock() {
        let command = |time_s: f64| match time_s {
            ..3.0 => [8.0, -6.0, 3.0][time_s as usize],
            _ => 9.0 * (40.0 * time_s).sin(),
        };
        let fine_rows = || (0..FINE_ROWS * 3).map(|row| command(row as f64 * FINE_S));
        let undriven = fine_rows().enumerate().map(|(row, volts)| [volts, (row % 200) as f64, (row % 2) as f64]);
        let fine = dataset(FINE_S, undriven);
        let is_settled = |drift_ppm: f64| {
            let drift = effect("clock_drift").unwrap();
            let moved = free_run(&Model::linear(MotorParameters::PIVT6).with(drift, vec![drift_ppm]), &fine);
            let [speed, current] = [1, 0].map(|output| &moved[output]);
            let rows = fine_rows().enumerate().step_by(2).map(|(row, volts)| [volts, speed[row], current[row]]);
            let mut data = dataset(2.0 * FINE_S, rows);
            let prior = Prior::new(&Rig::default().nominal(), &data);
            let start = Model::linear(MotorParameters::PIVT6).with(drift, vec![drift_ppm - 50.0]);
            let found = fit(&start, &data, &prior, Effort::FULL);
            (settle_smooth(&mut data, &prior, &found), data.origin.smooth_earlier)
        };
        assert_eq!(is_settled(0.0), (true, Some(0.25)));
        assert_eq!(is_settled(3000.0), (false, None));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        /// Compared with commands that are held for a given time each, in milliseconds. Every second step is small.
        #[test]
        fn the_moments_of_steps_are_found(
            holds in prop::collection::vec(([60usize..120, 60usize..200], -10.0_f64..10.0, -1.5_f64..1.5), 10..20),
        ) {
            let steps = holds.iter().flat_map(|(hold, great, small)| [(hold[0], *great), (hold[1], great + small)]);
            let holds: Vec<(usize, f64)> = steps.collect();
            let commands = || holds.iter().flat_map(|(hold, volts)| std::iter::repeat_n(*volts, *hold)).take(FINE_ROWS);
            prop_assume!(commands().count() == FINE_ROWS);
            let model = Model::linear(MotorParameters::PIVT6);
            // Only its commands are used.
            let undriven = commands().enumerate().map(|(row, volts)| [volts, (row % 200) as f64, (row % 2) as f64]);
            let fine = dataset(FINE_S, undriven);
            let moved = free_run(&model, &fine);
            let [speed, current] = [1, 0].map(|output| &moved[output]);
            let written = (0..FINE_ROWS).step_by(ONE_OF).map(|row| [fine.command[row], speed[row], current[row]]);
            let mut data = dataset(FINE_S * ONE_OF as f64, written).with_commands_as_written().unwrap();
            let changes = sought(&data, |_| true);
            data = data.with_commands_between(&changes);
            prop_assert!(changes.len() > 5);
            for moved in rounds(&changes) {
                data.earlier_s = moments(&data, &model, &changes, &moved);
            }
            for row in changes {
                let (before, after) = (data.command[row - 1], data.command[row]);
                let back = (1..=ONE_OF).find(|back| fine.command[ONE_OF * row - back] != after).unwrap();
                let off_s = data.earlier_s[row] - (back - 1) as f64 * FINE_S;
                // The effect of half a millisecond of a step of 10 V.
                prop_assert!((off_s * (after - before)).abs() < 5e-3, "{row}: {off_s} s of {} V", after - before);
            }
        }
    }
}

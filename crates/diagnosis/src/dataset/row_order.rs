//! Which command stands beside a reading: the one that follows it, or the one that acted before.
//!
//! A program may read its sensors, compute a command and write both. Then the reading comes first, as [`Dataset`]
//! assumes. Another sets a voltage, waits, reads and writes: each row then has the command that *has* acted. The motion
//! seems to begin a row before its command, which no constant of a motor explains. The impulse response shows it: no
//! reading responds to a command that has not been given.

use super::{Dataset, Output, Stretch};
use crate::configuration::dataset::row_order::{
    LEAST_SHARE_OF_CURRENT, LEAST_SHARE_OF_MOTION, LEAST_SIGMAS, ROWS, ROWS_PER_COEFFICIENT,
};
use nalgebra::{DMatrix, DVector};

/// Note on such a recording.
pub const WRITTEN_AFTER: &str = "Each row was written after its command had acted, so the commands were moved one row earlier. [recording] command_delay_s = 0 in the rig file takes the rows as they are.";

/// Coefficients: changes of the command a row ahead, in the row itself and in those before; levels of reading, motion
/// and command a row before; a constant.
const AHEAD: usize = 0;
const OWN: usize = 1;
const LAST_CHANGE: usize = OWN + ROWS;
const LEVELS: usize = 4;
const COEFFICIENTS: usize = LAST_CHANGE + 1 + LEVELS;

/// Whether the command of a row had acted before the row was read.
pub(super) fn is_written_after(data: &Dataset) -> bool {
    let Some(answers) = Answers::of(data) else { return false };
    let (own, own_error) = answers.coefficient(OWN);
    let (ahead, _) = answers.coefficient(AHEAD);
    // The level of a row contains the change that led to it.
    let (level, _) = answers.coefficient(COEFFICIENTS - 1);
    let later = (OWN + 1..=LAST_CHANGE).map(|row| answers.coefficient(row).0 + level);
    let greatest = later.fold(own.max(ahead), f64::max);
    let least_share = if data.current().is_some() { LEAST_SHARE_OF_CURRENT } else { LEAST_SHARE_OF_MOTION };
    own > LEAST_SIGMAS * own_error && own > least_share * greatest && own > 2.0 * ahead.abs()
}

/// The direction in which commands are moved.
#[derive(Clone, Copy)]
pub(super) enum Towards {
    /// To the row that was read before they acted; the last row also keeps its own.
    Before,
    /// Back from there; the first row keeps what it has.
    After,
}

/// Moves each command by a row.
pub(super) fn move_commands(data: &mut Dataset, towards: Towards) {
    for Stretch { rows, .. } in &data.stretches {
        moved(&mut data.command[rows.clone()], towards);
        moved(&mut data.duty[rows.clone()], towards);
        moved(&mut data.open[rows.clone()], towards);
    }
}

fn moved<T: Copy>(values: &mut [T], towards: Towards) {
    match towards {
        Towards::Before => values.copy_within(1.., 0),
        Towards::After => values.copy_within(..values.len() - 1, 1),
    }
}

/// Response of a reading to a change of the command: least squares. The standard errors hold for uneven scatter (White,
/// Econometrica 48 (1980)), and are at least those of even scatter: around a single step nothing scatters.
struct Answers {
    values: DVector<f64>,
    /// Variances of the values.
    variances: DVector<f64>,
}

impl Answers {
    /// The response of the current, which responds first, or of the motion; `None` if neither shows one.
    fn of(data: &Dataset) -> Option<Self> {
        let motion = data.motion();
        let longest = data.stretches.iter().map(|stretch| stretch.window.span).max().unwrap_or(0);
        let reading = match (data.current(), motion.output) {
            (Some(current), _) => current,
            // A difference over several rows would blur the response.
            (None, Output::AngleDifference) if longest > 1 => return None,
            (None, Output::MeanSpeed) => return None,
            (None, _) => motion,
        };
        // A window may reach ahead: then every command would seem to act before it is given.
        let motion_before = 1 + if motion.output == Output::MeanSpeed { longest } else { 0 };
        let first = ROWS.max(motion_before) + 1;
        let rows = || data.stretches.iter().flat_map(|Stretch { rows, .. }| rows.start + first..rows.end - 1);
        let regressors = |row: usize| -> [f64; COEFFICIENTS] {
            std::array::from_fn(|index| match index {
                0..=LAST_CHANGE => data.command[row + 1 - index] - data.command[row - index],
                index => [1.0, reading.values[row - 1], motion.values[row - motion_before], data.command[row - 1]]
                    [index - LAST_CHANGE - 1],
            })
        };
        let samples: Vec<([f64; COEFFICIENTS], f64)> = rows()
            .map(|row| (regressors(row), reading.values[row] - reading.values[row - 1]))
            .filter(|(regressors, change)| change.is_finite() && regressors.iter().all(|value| value.is_finite()))
            .collect();
        if samples.len() < ROWS_PER_COEFFICIENT * COEFFICIENTS {
            return None;
        }
        Self::least_squares(&samples)
    }

    fn least_squares(samples: &[([f64; COEFFICIENTS], f64)]) -> Option<Self> {
        let mut normal = DMatrix::zeros(COEFFICIENTS, COEFFICIENTS);
        let mut moments = DVector::zeros(COEFFICIENTS);
        let column = |regressors: &[f64; COEFFICIENTS]| DVector::from_column_slice(regressors);
        for (regressors, change) in samples {
            let regressors = column(regressors);
            normal.ger(1.0, &regressors, &regressors, 1.0);
            moments.axpy(*change, &regressors, 1.0);
        }
        // Volts, amperes and radians a second have different sizes.
        let sizes = DVector::from_fn(COEFFICIENTS, |index, _| f64::sqrt(normal[(index, index)]).max(f64::MIN_POSITIVE));
        let scaled = DMatrix::from_fn(COEFFICIENTS, COEFFICIENTS, |row, column| {
            normal[(row, column)] / (sizes[row] * sizes[column]) + if row == column { 1e-9 } else { 0.0 }
        });
        let mut inverse = scaled.cholesky()?.inverse();
        for row in 0..COEFFICIENTS {
            for column in 0..COEFFICIENTS {
                inverse[(row, column)] /= sizes[row] * sizes[column];
            }
        }
        let values = &inverse * moments;
        let mut middle = DMatrix::zeros(COEFFICIENTS, COEFFICIENTS);
        let mut squares = 0.0;
        for (regressors, change) in samples {
            let regressors = column(regressors);
            let left = change - regressors.dot(&values);
            middle.ger(left * left, &regressors, &regressors, 1.0);
            squares += left * left;
        }
        let uneven = (&inverse * middle * &inverse).diagonal();
        let even = inverse.diagonal() * (squares / samples.len() as f64);
        Some(Self { values, variances: uneven.sup(&even) })
    }

    /// A coefficient and its standard error.
    fn coefficient(&self, index: usize) -> (f64, f64) {
        (self.values[index], self.variances[index].max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use crate::dataset::Dataset;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::fmt::Write as _;

    const STEP_S: f64 = 2e-5;
    const INDUCTANCE_H: f64 = 6e-3;
    const INERTIA_KG_M2: f64 = 2e-5;

    /// Levels, some of them held for long, through a winding and a rotor, read every millisecond.
    fn csv(seed: u64, after: bool, feedback: f64) -> String {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        let (mut current_a, mut speed, mut level_v, mut before_v) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        let mut random = seed;
        let mut draw = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        for row in 0..3000 {
            if draw() > 0.48 {
                level_v = 16.0 * draw();
            }
            let (read_a, read) = (current_a + 0.03 * draw(), speed + draw());
            let voltage_v = level_v - feedback * read;
            let written_v = if after { before_v } else { voltage_v };
            let _ = writeln!(text, "{},{written_v},{read},{read_a}", 1e-3 * f64::from(row));
            for _ in 0..50 {
                current_a += STEP_S / INDUCTANCE_H * (voltage_v - 4.0 * current_a - 0.04 * speed);
                speed += STEP_S / INERTIA_KG_M2 * (0.04 * current_a - 2e-3 * speed.signum());
            }
            before_v = voltage_v;
        }
        text
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// In an open and in a closed loop, with the current and without, and with noise.
        #[test]
        fn the_row_of_a_command_is_recognised(
            seed: u64, after: bool, feedback in prop_oneof![Just(0.0), 0.001f64..0.05], with_current: bool,
        ) {
            let rig = "[supply]\nvoltage_V = 12.0\n";
            let mut text = csv(seed, after, feedback);
            if !with_current {
                text = text.replacen(",i_A", ",spare", 1);
            }
            let recording = || Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
            let data = Dataset::new(&[recording()], &Rig::parse("rig.toml", rig).unwrap()).unwrap();
            prop_assert_eq!(data.origin.written_after, after);
            let given = format!("{rig}[recording]\ncommand_delay_s = 0.0\n");
            let data = Dataset::new(&[recording()], &Rig::parse("rig.toml", &given).unwrap()).unwrap();
            prop_assert!(!data.origin.written_after, "the rig file decides");
        }

        /// Noise in its row is no response.
        #[test]
        fn a_single_step_does_not_tell_the_row_of_its_command(seed: u64, rows_late in 0_u32..80) {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
            let step_row = random.random_range(50..200);
            for row in 0..1000 {
                let since_s = 4e-3 * (f64::from(row) - f64::from(step_row + rows_late));
                let speed = 80.0 * (1.0 - (-since_s.max(0.0) / 0.05).exp()) + random.random_range(-0.3..0.3);
                let _ = writeln!(text, "{:.3},{},{speed:.4}", 4e-3 * f64::from(row), if row < step_row { 0 } else { 5 });
            }
            let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
            let data = Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12.0\n").unwrap()).unwrap();
            prop_assert!(!data.origin.written_after);
        }
    }
}

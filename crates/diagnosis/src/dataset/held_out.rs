//! The part of the data that no fit sees, to judge by.
//!
//! One block in three is held out. The blocks are of equal length, so that each part has its share of what happens. Where
//! most of it happens at once, such as after the only step, they are shorter there: each part then has its share of
//! the step as well.

use super::{Dataset, spread};
use crate::configuration::dataset::held_out::{BLOCK_S, EVERY, FAIR, FEWEST_BLOCKS, HELD_OUT, PART_OF_BLOCK};

impl Dataset {
    pub(super) fn hold_out(&mut self) {
        self.keep_back(HELD_OUT);
    }

    /// The same data with each of the other parts held out in turn.
    pub fn with_others_held_out(&self) -> impl Iterator<Item = Self> {
        (0..EVERY).filter(|part| *part != HELD_OUT).map(|part| {
            let mut other = self.clone();
            other.keep_back(part);
            other
        })
    }

    fn keep_back(&mut self, part: usize) {
        self.held_out = self.blocks().into_iter().map(|block| block % EVERY == part).collect();
    }

    /// The block of each row.
    fn blocks(&self) -> Vec<usize> {
        let rows_of_block = (BLOCK_S.min(self.span_s() / FEWEST_BLOCKS) / self.interval_s).max(1.0) as usize;
        let mut changes = [0.0; EVERY];
        for (block, speeds) in self.motion().values.chunks(rows_of_block).enumerate() {
            changes[block % EVERY] += spread(speeds).powi(2) * speeds.len() as f64;
        }
        let all: f64 = changes.iter().sum();
        if all == 0.0 || FAIR.contains(&(changes[HELD_OUT] / all)) {
            return (0..self.len()).map(|row| row / rows_of_block).collect();
        }
        self.blocks_of_changes(rows_of_block)
    }

    /// As many blocks, each with its share of the time and of the changes. Where a row has more than a share, the next rows
    /// are blocks as well: otherwise chance would decide which part has the begin of a step.
    fn blocks_of_changes(&self, rows_of_block: usize) -> Vec<usize> {
        let (speeds, span) = (&self.motion().values, (rows_of_block / PART_OF_BLOCK).max(1));
        let change = |row: usize| {
            let change = speeds[row] - speeds[row.saturating_sub(span)];
            if change.is_finite() { change * change } else { 0.0 }
        };
        let changes: Vec<f64> = (0..self.len()).map(change).collect();
        let all = changes.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let count = self.len() as f64 / rows_of_block as f64;
        let (mut passed, mut block) = (0.0, 0);
        let block_of = |change: f64| {
            passed += 0.5 * (1.0 / self.len() as f64 + change / all);
            block += usize::from(passed * count >= (block + 1) as f64);
            block
        };
        changes.into_iter().map(block_of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use proptest::prelude::*;
    use std::fmt::Write as _;

    /// 4 s in rows of 4 ms: a voltage, and the speed of a quick motor.
    fn data(volts: impl Fn(f64) -> f64) -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
        let mut speed = 0.0;
        for row in 0..1000 {
            let time_s = f64::from(row) * 4e-3;
            let _ = writeln!(text, "{time_s:.3},{:.4},{:.3}", volts(time_s), speed + f64::from(row % 2));
            speed += 4e-3 / 0.03 * (10.0 * volts(time_s) - speed);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Wherever the step is.
        #[test]
        fn each_part_has_its_share_of_the_only_step(step_s in 0.3_f64..3.0) {
            let data = data(|time_s| if time_s < step_s { 0.0 } else { 8.0 });
            let moves = |row: &usize| data.time_s[*row] > step_s && data.time_s[*row] < step_s + 0.06;
            let held_out = (0..data.len()).filter(moves).filter(|row| data.held_out[*row]).count();
            prop_assert!((3..=9).contains(&held_out), "{held_out} of 15 rows");
            let all = data.held_out.iter().filter(|held_out| **held_out).count();
            prop_assert!((250..=420).contains(&all), "{all} of 1000 rows");
        }
    }

    #[test]
    fn blocks_are_equal_where_something_happens_all_the_time() {
        let data = data(|time_s| 8.0 * (3.0 * time_s).sin());
        let rows: Vec<usize> = data.held_out.chunk_by(|a, b| a == b).map(<[bool]>::len).collect();
        assert!(rows[1..rows.len() - 1].chunks(2).all(|pair| pair == [41, 82] || pair == [41]), "{rows:?}");
    }
}

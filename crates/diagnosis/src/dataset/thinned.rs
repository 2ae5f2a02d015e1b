//! Fewer rows, where a speed is recorded faster than a motor can change it. Every simulation takes as long as there are
//! rows. A current changes faster, so its rows stay.

use super::{Dataset, Measured, Output, Window};
use crate::configuration::dataset::thinned::SHORTEST_ROW_S;

impl Dataset {
    /// Makes one row of several. A command becomes its mean, which moves a motor as far. A speed becomes the mean around
    /// its row. A mean speed stays a mean over the same time, or becomes one over the whole row. Returns the window of a
    /// mean speed, in the new rows.
    pub(super) fn thin(&mut self, window: Window) -> Window {
        let Some(one_of) = self.one_of(window) else { return window };
        let rows = self.len() / one_of;
        let firsts = || (0..rows).map(|row| row * one_of);
        let mean = |values: &[f64]| -> Vec<f64> {
            firsts().map(|first| values[first..first + one_of].iter().sum::<f64>() / one_of as f64).collect()
        };
        let first = |values: &[f64]| -> Vec<f64> { firsts().map(|first| values[first]).collect() };
        self.command = mean(&self.command);
        self.duty = mean(&self.duty);
        self.supply_v = mean(&self.supply_v);
        self.load_nm = mean(&self.load_nm);
        self.time_s = first(&self.time_s);
        self.angle_rad = first(&self.angle_rad);
        self.open = vec![false; rows];
        self.interval_s *= one_of as f64;
        for measured in &mut self.measured {
            measured.values = firsts().map(|row| reading(measured, row, one_of, window)).collect();
        }
        match self.motion().output {
            Output::MeanSpeed => Window::up_to_now((window.span / one_of).max(1)),
            _ => Window { span: window.span / one_of, ahead: window.ahead / one_of },
        }
    }

    /// How many rows become one; `None` where they stay.
    fn one_of(&self, window: Window) -> Option<usize> {
        // Rounded, since the times of a table are: rows of a sixth of a millisecond seem to be a little longer.
        let usual = (SHORTEST_ROW_S / self.interval_s).round() as usize;
        // Rows of an open bridge are no mean of others, and the speed between edges has its own times.
        let can = self.current().is_none()
            && self.axis.drive.is_voltage()
            && !self.open.contains(&true)
            && matches!(self.motion().output, Output::Speed | Output::MeanSpeed | Output::AngleDifference);
        let is_whole = |one_of: &usize| window.span <= 1 || window.span.is_multiple_of(*one_of);
        (2..=2 * usual).filter(is_whole).min_by_key(|one_of| one_of.abs_diff(usual)).filter(|_| can && usual > 1)
    }
}

/// The reading of a new row, which begins at an old one.
fn reading(measured: &Measured, row: usize, one_of: usize, window: Window) -> f64 {
    let rows = measured.values.len();
    let at = |row: usize| measured.values.get(row).copied().unwrap_or(f64::NAN);
    let (from, until) = match (measured.output, window.span) {
        (Output::Speed, _) => (row.saturating_sub(one_of / 2), (row + one_of.div_ceil(2)).min(rows)),
        // The differences from row to row since the row before.
        (Output::MeanSpeed, 0 | 1) => ((row + 1).saturating_sub(one_of), row + 1),
        // The mean whose window ends at this row.
        (Output::MeanSpeed, _) => return row.checked_sub(window.ahead).map_or(f64::NAN, at),
        _ => return at(row),
    };
    (from..until).map(at).sum::<f64>() / (until - from) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use proptest::prelude::*;
    use std::fmt::Write as _;

    const COUNT_RAD: f64 = std::f64::consts::TAU / 1000.0;
    const RAD_PER_S: f64 = 300.0;

    fn speed(time_s: f64) -> f64 {
        RAD_PER_S * (3.0 * time_s).sin()
    }

    fn angle_rad(time_s: f64) -> f64 {
        RAD_PER_S / 3.0 * (1.0 - (3.0 * time_s).cos())
    }

    /// 4 s of rows: a wave of the command, and what `reading` makes of a time.
    fn dataset(interval_s: f64, reading: impl Fn(f64) -> f64) -> Dataset {
        let mut text = String::from("t_s,u_V,omega_rad_per_s\n");
        for row in 0..(4.0 / interval_s).round() as usize {
            let time_s = row as f64 * interval_s;
            let _ = writeln!(text, "{time_s:.9},{:.5},{:.6}", 9.0 * (3.0 * time_s + 0.1).sin(), reading(time_s));
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let rig = "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 1000\n";
        Dataset::new(&[recording], &Rig::parse("rig.toml", rig).unwrap()).unwrap()
    }

    /// How far its readings are from the true mean over their windows.
    fn off(data: &Dataset) -> f64 {
        let window = data.stretches[0].window;
        let rows = data.motion().values.iter().zip(&data.time_s).skip(60).take(data.len() - 120);
        let of = |(value, time_s): (&f64, &f64)| {
            let end_s = time_s + window.ahead as f64 * data.interval_s;
            let span_s = window.span as f64 * data.interval_s;
            let mean = (angle_rad(end_s) - angle_rad(end_s - span_s)) / span_s;
            (value - if window.span == 0 { speed(*time_s) } else { mean }).abs()
        };
        rows.map(of).fold(0.0, f64::max)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(6))]
        /// However fast it is recorded: of the moment, or as counts over some rows.
        #[test]
        fn a_fast_recording_keeps_its_speed_in_fewer_rows(rows_in_ms in 3_u32..12, span in 1_u32..4) {
            let interval_s = 1e-3 / f64::from(rows_in_ms);
            let window_s = f64::from(span * rows_in_ms) * interval_s;
            let counted = |time_s: f64| (angle_rad(time_s) / COUNT_RAD).floor() * COUNT_RAD;
            let of_counts = |time_s: f64| (counted(time_s) - counted(time_s - window_s)) / window_s;
            for (data, tolerated) in [(dataset(interval_s, speed), 0.5), (dataset(interval_s, of_counts), COUNT_RAD / window_s)] {
                prop_assert!((0.8e-3..1.5e-3).contains(&data.interval_s), "{} s", data.interval_s);
                prop_assert!(off(&data) < 1.1 * tolerated, "{:?}: {} of {tolerated}", data.motion().output, off(&data));
            }
        }
    }
}

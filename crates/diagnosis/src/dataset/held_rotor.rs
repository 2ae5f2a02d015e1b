//! Recordings with the rotor held: the motor is driven and draws current, but does not turn. Only the winding and the
//! bridge are then compared.
//!
//! With an unplugged encoder nothing seems to turn either. Then the back-EMF reduces the current while the command is
//! constant. With a held rotor the present command alone determines the current.

use super::columns::{greatest, spread};
use super::noise::noise;
use super::{Dataset, DatasetError, Output, Stretch};
use crate::configuration::dataset::held_rotor::{ANSWERS, COUNTS, DRIVEN, GIVES_WAY, NOISES, PARTS, SETTLED_S};
use std::ops::Range;

/// A recording with the rotor held.
#[derive(Clone, Debug)]
pub struct HeldRotor {
    /// Which.
    pub name: String,
    /// Its rows.
    pub rows: Range<usize>,
}

impl HeldRotor {
    pub(super) fn later_by(self, rows: usize) -> Self {
        Self { rows: self.rows.start + rows..self.rows.end + rows, ..self }
    }
}

impl Dataset {
    /// Whether the rotor was held in a stretch.
    pub fn is_held(&self, stretch: &Stretch) -> bool {
        self.origin.held_rotor.iter().any(|held| held.rows.contains(&stretch.rows.start))
    }

    /// Treats a recording as one with the rotor held, if nothing turns though the current shows that the motor is
    /// driven.
    pub(super) fn recognise_held_rotor(&mut self, name: &str) {
        if !self.answers_without_motion() {
            return;
        }
        let motion = self.motion_index();
        self.measured[motion].values.fill(f64::NAN);
        self.origin.held_rotor.push(HeldRotor { name: name.into(), rows: 0..self.len() });
    }

    /// If the rotor is held in all recordings, the motion is unknown.
    pub(super) fn check_that_it_turns(&self, name: &str) -> Result<(), DatasetError> {
        match self.stretches.iter().all(|stretch| self.is_held(stretch)) && !self.stretches.is_empty() {
            true => Err(DatasetError::Held(name.into())),
            false => Ok(()),
        }
    }

    fn answers_without_motion(&self) -> bool {
        let Some(current) = self.current() else { return false };
        let driven_v = DRIVEN * greatest(&self.command);
        let is_driven = |row: &usize| !self.open[*row] && self.command[*row].abs() > driven_v;
        let driven: Vec<usize> = (0..self.len()).filter(is_driven).collect();
        let motion = self.motion();
        let of_counts = match motion.output {
            Output::Speed | Output::TimedSpeed => 0.0,
            _ => COUNTS * self.count_rad / self.stretches.first().map_or(f64::INFINITY, Stretch::window_s),
        };
        let still = of_counts.max(NOISES * noise(&motion.values));
        let moves = |row: &usize| motion.values[*row].abs() > still;
        let moving = driven.iter().filter(|row| moves(row)).count();
        // A position loop drives hard only to start and to stop.
        let moving_at_all = (0..self.len()).filter(moves).count();
        driven_v > 0.0
            && moving as f64 <= GIVES_WAY * driven.len() as f64
            && moving_at_all as f64 <= GIVES_WAY * self.len() as f64
            && greatest(&current.values) > NOISES * noise(&current.values)
            && self.share_of_the_command(&current.values) > ANSWERS
    }

    /// Share of a reading's variance that the present command explains.
    fn share_of_the_command(&self, reading: &[f64]) -> f64 {
        let most_v = greatest(&self.command);
        let part = |row: usize| ((self.command[row] / most_v + 1.0) * 0.5 * (PARTS - 1) as f64).round() as usize;
        let mut parts = vec![Vec::new(); PARTS];
        let mut since_s = f64::NEG_INFINITY;
        for row in 0..self.len() {
            if row == 0 || self.command[row] != self.command[row - 1] || self.open[row] {
                since_s = self.time_s[row];
            }
            if self.time_s[row] - since_s > SETTLED_S && reading[row].is_finite() {
                parts[part(row)].push(reading[row]);
            }
        }
        let variation = |values: &[f64]| spread(values).powi(2) * values.len() as f64;
        let within: f64 = parts.iter().map(|values| variation(values)).sum();
        1.0 - within / variation(&parts.concat()).max(f64::MIN_POSITIVE)
    }
}

/// The note on them.
pub(super) fn note(held: &[HeldRotor]) -> String {
    let names: Vec<&str> = held.iter().map(|held| &*held.name).collect();
    format!(
        "In {} the motor is driven and draws current, but does not turn. The rotor is assumed to be held, and only the current is compared.",
        names.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use std::fmt::Write as _;

    const RESISTANCE_OHM: f64 = 2.0;

    /// Levels that change every 50 ms, through a winding without inductance. The shaft turns by this share of its free
    /// motion, and its sensor shows this share of that.
    fn recording(name: &str, column: &str, [turns, seen]: [f64; 2], unrest: f64) -> Recording {
        let mut text = format!("t_s,u_V,i_A,{column}\n");
        let (mut angle_rad, mut speed) = (0.0, 0.0);
        for row in 0..4000 {
            let volts = 4.0 * (f64::from(row / 50) * 2.3).sin();
            speed += 1e-3 / 0.03 * (turns * 25.0 * volts - speed);
            let current_a = (volts - 0.036 * speed) / RESISTANCE_OHM + 0.01 * (f64::from(row) * 12.9).sin();
            angle_rad += 1e-3 * speed;
            let shaken = unrest * (f64::from(row) * 7.7).sin();
            let reading =
                if column == "counts" { (seen * angle_rad * 300.0 + shaken).round() } else { seen * speed + shaken };
            let _ = writeln!(text, "{},{volts},{current_a},{reading}", f64::from(row) * 1e-3);
        }
        Recording::parse(name, text.as_bytes(), &[]).unwrap()
    }

    fn dataset(recordings: &[Recording]) -> Result<Dataset, DatasetError> {
        let rig = "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 1885\n";
        Dataset::new(recordings, &Rig::parse("rig.toml", rig).unwrap())
    }

    #[test]
    fn a_held_rotor_is_recognised_beside_a_turning_one() {
        for (column, unrest) in [("omega_rad_per_s", 0.1), ("omega_rad_per_s", 0.0), ("counts", 0.6), ("counts", 0.0)] {
            let recordings =
                [recording("free.csv", column, [1.0; 2], unrest), recording("held.csv", column, [0.0, 1.0], unrest)];
            let data = dataset(&recordings).unwrap();
            let held: Vec<bool> = data.stretches.iter().map(|stretch| data.is_held(stretch)).collect();
            assert_eq!(held, [false, true], "{column} {unrest}");
            let notes = data.notes();
            assert!(notes.iter().any(|note| note.starts_with("In held.csv the motor is driven")), "{notes:?}");
            let alone = dataset(&recordings[1..]).unwrap_err().to_string();
            assert!(
                alone.starts_with("held.csv: ") && alone.contains("a recording of the same rig that turns"),
                "{alone}"
            );
        }
    }

    /// However slowly.
    #[test]
    fn a_rotor_that_turns_is_not_held() {
        for (column, unrest) in [("omega_rad_per_s", 0.1), ("counts", 0.6)] {
            for turns in [0.03, 0.1, 1.0] {
                let data = dataset(&[recording("free.csv", column, [turns, 1.0], unrest)]).unwrap();
                assert!(data.origin.held_rotor.is_empty(), "{column} {turns}");
            }
        }
    }

    /// A position loop drives hard to start from rest. Then it continues with a voltage of which friction takes most.
    #[test]
    fn a_rotor_that_is_driven_hard_only_to_start_is_not_held() {
        let mut text = String::from("t_s,u_V,i_A,counts\n");
        let (mut angle_rad, mut speed) = (0.0, 0.0_f64);
        for row in 0..8000 {
            let volts = match row % 400 {
                0..5 => 10.0,
                5..200 => 2.0,
                _ => 0.0,
            };
            let towards = if volts == 0.0 { 0.0 } else { 40.0 };
            speed += 1e-3 / 0.03 * (towards - speed) * if volts == 10.0 { 0.1 } else { 1.0 };
            let current_a = volts / RESISTANCE_OHM - 0.002 * speed + 0.01 * (f64::from(row) * 12.9).sin();
            angle_rad += 1e-3 * speed;
            let _ = writeln!(text, "{},{volts},{current_a},{}", f64::from(row) * 1e-3, (angle_rad * 300.0_f64).round());
        }
        let data = dataset(&[Recording::parse("moves.csv", text.as_bytes(), &[]).unwrap()]).unwrap();
        assert!(data.origin.held_rotor.is_empty());
    }

    #[test]
    fn a_sensor_that_is_unplugged_holds_no_rotor() {
        for column in ["omega_rad_per_s", "counts"] {
            let error = dataset(&[recording("free.csv", column, [1.0, 0.0], 0.0)]).unwrap_err();
            assert!(matches!(error, DatasetError::Quiet(_)), "{error}");
        }
    }
}

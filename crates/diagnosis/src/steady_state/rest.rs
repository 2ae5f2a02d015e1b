//! The unexplained rest of a table: in which of the two balances it acts, and what it depends on.

use super::line::{Errors, Line, rms};
use super::{ALIKE_SHARE, Explanation, Friction, Level, NEEDED_SIGMAS};
use crate::configuration::steady_state::rest::{AS_WELL, LEAST_SHARE, LEVELS_TOO_MANY, MOST_POWERS};
use crate::diagnose::outcome::{RmseGain, Unexplained};
use crate::diagnose::{LEAST_OF_REST, NOTHING_SEEN};
use motorbench_model::catalogue::ActsOn;

/// A figure of a level.
type Column = fn(&Level) -> f64;

/// Quantities that a rest may depend on, in words.
const AXES: [(&str, Column); 4] = [
    ("voltage", |level| level.u_V),
    ("speed", |level| level.omega_rad_per_s),
    ("current", |level| level.i_A),
    ("load", |level| level.load_Nm),
];

/// The rest of one balance.
pub(super) struct Rest {
    acts_on: ActsOn,
    /// Errors at a level left out, including those of the readings.
    left: f64,
    noise: f64,
    /// Relative to the greatest value of its quantity.
    of_greatest: f64,
    depends_on: String,
}

impl Rest {
    /// The rest of the voltages with the named explanation; `fullest`: the one before untrusted terms were removed.
    pub fn of_voltage(levels: &[Level], named: &Explanation, fullest: &Explanation) -> Option<Self> {
        let most_v = greatest(levels, |level| level.u_V);
        let (left, noise) = (named.left_out_rmse_v, rms_of(levels, |level| level.voltage_error));
        (!named.holds() || left >= ALIKE_SHARE * most_v).then(|| Self {
            acts_on: ActsOn::Voltage,
            left,
            noise,
            of_greatest: left / most_v,
            depends_on: goes_with(levels, &fullest.left_v),
        })
    }

    /// The rest of the torques beside friction, if it exceeds the scatter of the levels and contains a curve.
    pub fn of_torque(levels: &[Level], friction: &Friction) -> Option<Self> {
        let most_a = greatest(levels, |level| level.i_A);
        let (left, noise) = (friction.gain.rmse_after, rms_of(levels, |level| level.current_error));
        (friction.lacks_sigmas >= NEEDED_SIGMAS && left >= ALIKE_SHARE * most_a).then(|| Self {
            acts_on: ActsOn::Torque,
            left,
            noise,
            of_greatest: left / most_a,
            depends_on: goes_with(levels, &friction.left_nm),
        })
    }

    /// Whether a term of the same balance explains too little beside it.
    pub fn outweighs(&self, gain: &RmseGain) -> bool {
        let explained = gain.rmse_before.powi(2) - gain.rmse_after.powi(2);
        explained < LEAST_OF_REST * (self.left.powi(2) - self.noise.powi(2))
    }

    /// The greater of two.
    pub fn greater(self, other: Self) -> Self {
        if other.of_greatest > self.of_greatest { other } else { self }
    }

    /// In the form of every diagnosis.
    pub fn told(self) -> Unexplained {
        let share = 1.0 - (self.noise.min(self.left) / self.left).powi(2);
        Unexplained { acts_on: self.acts_on, depends_on: self.depends_on, share }
    }
}

fn greatest(levels: &[Level], of: Column) -> f64 {
    levels.iter().map(of).fold(0.0, f64::max)
}

fn rms_of(levels: &[Level], of: Column) -> f64 {
    rms(&levels.iter().map(of).collect::<Vec<_>>())
}

/// The column over which a curve explains most, and those that explain as much.
fn goes_with(levels: &[Level], left: &[f64]) -> String {
    let shares: Vec<(&str, f64)> = AXES.iter().map(|(name, of)| (*name, explained_share(levels, left, *of))).collect();
    let most = shares.iter().map(|(_, share)| *share).fold(0.0, f64::max);
    if most < LEAST_SHARE {
        return NOTHING_SEEN.into();
    }
    let as_much = shares.iter().filter(|(_, share)| *share > most - AS_WELL).map(|(name, _)| *name);
    as_much.collect::<Vec<_>>().join(" or ")
}

/// Share of the variance that a curve over a column explains, less what a curve through random values would.
fn explained_share(levels: &[Level], left: &[f64], of: Column) -> f64 {
    let most = greatest(levels, of).max(f64::MIN_POSITIVE);
    let column = |power: usize| levels.iter().map(|level| (of(level) / most).powi(power as i32)).collect::<Vec<_>>();
    let columns: Vec<Vec<f64>> =
        (0..=MOST_POWERS.min(levels.len().saturating_sub(LEVELS_TOO_MANY))).map(column).collect();
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let alike = Errors::InProportion(vec![1.0; levels.len()]);
    let variance = |powers: usize| Some(Line::new(&columns[..=powers], left, &alike)?.chi2_per_dof());
    // A column of few values allows fewer powers.
    let curve = (1..columns.len()).rev().find_map(variance);
    curve.zip(variance(0)).filter(|(_, all)| *all > 0.0).map_or(0.0, |(curve, all)| 1.0 - curve / all)
}

/// Distance from zero of a curve over speed or load, beside the columns of a torque balance.
pub(super) fn curve_sigmas(levels: &[Level], columns: [&[f64]; 2], target_nm: &[f64], errors: &Errors) -> f64 {
    let curves: [Column; 2] = [|level| level.omega_rad_per_s.powi(2), |level| level.load_Nm];
    let sigmas = curves.into_iter().filter_map(|of| {
        let curve: Vec<f64> = levels.iter().map(of).collect();
        let line = Line::new(&[columns[0], columns[1], &curve], target_nm, errors)?;
        Some(line.sigmas(2, line.noise()))
    });
    sigmas.fold(0.0, f64::max)
}

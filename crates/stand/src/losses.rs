//! Evaluates a table of steady states. It gives losses with the constants found, the winding's resistance from rows at
//! rest, and the motor's condition compared with an earlier test. The efficiency is measured if a brake of known torque
//! was at the shaft, otherwise predicted.

use crate::condition::{Condition, condition};
use crate::derived::WrongCell;
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::outcome::Estimate;
use motorbench_diagnosis::steady_state::{
    Level, Line, Row, Rows, Study, StudyError, Winding, errors, is_loaded, nominal, same_level, study,
};
use serde::Serialize;

/// Voltages and torques of the efficiency map.
const MAP_SIZE: usize = 40;

/// The two directions at one voltage.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct Directions {
    /// Voltage, either way.
    pub u_V: f64,
    /// Torque of the brake.
    pub load_Nm: f64,
    /// Mean current forwards.
    pub forward_A: f64,
    /// Magnitude of the mean current backwards.
    pub reverse_A: f64,
    /// Mean speed forwards.
    pub forward_rad_per_s: f64,
    /// Magnitude of the mean speed backwards.
    pub reverse_rad_per_s: f64,
}

/// Constants of the motor in steady state.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct Constants {
    /// Resistance.
    pub resistance_ohm: f64,
    /// Back-EMF and torque constant.
    pub torque_constant_Nm_per_A: f64,
    /// Voltage drop of brushes and bridge, independent of the current.
    pub drop_V: f64,
    /// Torque of dry friction.
    pub coulomb_Nm: f64,
    /// Torque of viscous friction per speed.
    pub viscous_Nm_s: f64,
}

/// Distribution of the electrical power at a level.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct Losses {
    /// Voltage.
    pub u_V: f64,
    /// Torque of the brake.
    pub load_Nm: f64,
    /// Power of the brake. It is no loss.
    pub shaft_W: f64,
    /// I^2 R.
    pub winding_W: f64,
    /// I times the voltage drop.
    pub drop_W: f64,
    /// Dry friction times speed.
    pub coulomb_W: f64,
    /// Viscous friction times speed.
    pub viscous_W: f64,
    /// The unexplained rest.
    pub rest_W: f64,
}

/// A steady state under load.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct OperatingPoint {
    /// Voltage.
    pub u_V: f64,
    /// Torque at the shaft.
    pub torque_Nm: f64,
    /// Speed.
    pub omega_rad_per_s: f64,
    /// Current.
    pub i_A: f64,
    /// Mechanical over electrical power.
    pub efficiency: f64,
}

/// A steady state with a brake of known torque. It has the efficiency by the stand's formulas, at the brake, and by the
/// constants found.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct LoadedPoint {
    /// Voltage.
    pub u_V: f64,
    /// Torque of the brake, as it was stated.
    pub load_Nm: f64,
    /// Speed.
    pub omega_rad_per_s: f64,
    /// Current.
    pub i_A: f64,
    /// k w / U with the nominal constant, which ignores friction.
    pub formula_efficiency: f64,
    /// Power at the brake over electrical power.
    pub shaft_efficiency: f64,
    /// The same from the constants found; `None` if the motor does not turn with them.
    pub model_efficiency: Option<f64>,
}

impl LoadedPoint {
    fn of(level: &Level, constants: &Constants) -> Self {
        let Level { u_V, load_Nm, omega_rad_per_s, i_A, p_in_W, efficiency, .. } = *level;
        Self {
            u_V,
            load_Nm,
            omega_rad_per_s,
            i_A,
            formula_efficiency: efficiency,
            shaft_efficiency: load_Nm * omega_rad_per_s / p_in_W,
            model_efficiency: constants.operating_point(u_V, load_Nm).map(|point| point.efficiency),
        }
    }
}

/// Operating points in the middle of a grid's cells; `None` where the motor does not turn.
#[derive(Clone, Debug)]
pub struct EfficiencyMap {
    /// Width of a cell, in volts.
    pub step_v: f64,
    /// Height of a cell.
    pub step_nm: f64,
    /// One operating point for each cell.
    pub points: Vec<OperatingPoint>,
}

/// All results of a table.
#[derive(Clone, Debug, Serialize)]
pub struct Stand {
    /// The derived table, explanations and causes.
    #[serde(flatten)]
    pub study: Study,
    /// From rows with the rotor held or hardly turning, if there are any.
    pub winding: Option<Winding>,
    /// The constants that the losses are computed with.
    pub constants: Constants,
    /// One for each level.
    pub losses: Vec<Losses>,
    /// For each voltage that was measured in both directions.
    pub directions: Vec<Directions>,
    /// Comparison with the earlier test.
    pub condition: Vec<Condition>,
    /// Every level, if a brake was at the shaft, including the level without load.
    pub loaded: Vec<LoadedPoint>,
    /// Factor of the loads according to the currents: 1 if the brake's scale is right.
    pub load_scale: Option<Estimate>,
    /// The most efficient load at each voltage of the table, by the constants.
    pub most_efficient: Vec<OperatingPoint>,
    /// Wrong cells of the table that a study derived from the same readings.
    pub slips: Vec<WrongCell>,
}

impl Stand {
    /// Reads the printed table (CSV) that a study derived from the same readings, and keeps its wrong cells.
    ///
    /// # Errors
    /// What is wrong with the text, and where.
    pub fn check(&mut self, derived: &str, rig: &Rig) -> Result<(), String> {
        let (_, k) = nominal(rig).map_err(|error| error.to_string())?;
        self.slips = crate::derived::slips(derived, &self.study.levels, k)?;
        Ok(())
    }
}

/// Evaluates a table. `earlier`: a table of the same motor. `resistances_ohm`: of the winding, if measured separately.
/// Otherwise the rows with the rotor held give it.
///
/// # Errors
/// [`StudyError`].
pub fn evaluate(
    table: &Recording,
    earlier: Option<&Recording>,
    resistances_ohm: Option<Vec<f64>>,
    rig: &Rig,
) -> Result<Stand, StudyError> {
    let measured_apart = resistances_ohm.and_then(Winding::of);
    let study = study(table, rig, measured_apart.as_ref())?;
    let constants = Constants::of(&study, rig).ok_or(StudyError::NoNominal)?;
    let losses = study.levels.iter().map(|level| constants.losses(level)).collect();
    let condition = match earlier {
        Some(earlier) => condition(earlier, &study.levels, rig)?,
        None => Vec::new(),
    };
    let mut voltages_v: Vec<f64> = study.levels.iter().map(|level| level.u_V).collect();
    voltages_v.dedup();
    let most_efficient = voltages_v.iter().filter_map(|u_v| constants.most_efficient(*u_v)).collect();
    let directions = study.levels.iter().filter_map(|level| directions(&study.rows, level)).collect();
    let (mut loaded, mut load_scale) = (Vec::new(), None);
    if is_loaded(&study.levels) {
        loaded = study.levels.iter().map(|level| LoadedPoint::of(level, &constants)).collect();
        load_scale = scale_of_loads(&study.levels, constants.torque_constant_Nm_per_A);
    }
    let (_, k) = nominal(rig)?;
    let held = study.rows.held.iter();
    let of_held = || Winding::of(held.map(|row| (row.u_v - k * row.omega_rad_per_s) / row.i_a).collect());
    Ok(Stand {
        winding: measured_apart.or_else(of_held),
        constants,
        losses,
        directions,
        condition,
        loaded,
        load_scale,
        most_efficient,
        slips: Vec::new(),
        study,
    })
}

/// The factor before the stated load in k i = dry friction + viscous friction w + factor load.
fn scale_of_loads(levels: &[Level], k: f64) -> Option<Estimate> {
    let column = |of: &dyn Fn(&Level) -> f64| levels.iter().map(of).collect::<Vec<f64>>();
    let columns = [column(&|_| 1.0), column(&|level| level.omega_rad_per_s), column(&|level| level.load_Nm)];
    let columns = columns.each_ref().map(|column| &column[..]);
    let errors = errors(levels, |level| k * level.current_error);
    let torques = Line::new(&columns, &column(&|level| k * level.i_A), &errors)?;
    (levels.len() > columns.len()).then(|| torques.estimate(2))
}

/// Means of both directions at a level; `None` if one of them is missing.
fn directions(rows: &Rows, level: &Level) -> Option<Directions> {
    let greatest_v = rows.greatest_v();
    let mean = |sign: f64, of: fn(&Row) -> f64| {
        let rows = rows.turning.iter().filter(|row| same_level(sign * row.u_v, level.u_V, greatest_v));
        let rows = rows.filter(|row| sign * row.load_nm == level.load_Nm);
        let (count, sum) = rows.fold((0, 0.0), |(count, sum), row| (count + 1, sum + sign * of(row)));
        (count > 0).then(|| sum / f64::from(count))
    };
    let (i, w) = (|row: &Row| row.i_a, |row: &Row| row.omega_rad_per_s);
    Some(Directions {
        u_V: level.u_V,
        load_Nm: level.load_Nm,
        forward_A: mean(1.0, i)?,
        reverse_A: mean(-1.0, i)?,
        forward_rad_per_s: mean(1.0, w)?,
        reverse_rad_per_s: mean(-1.0, w)?,
    })
}

impl Constants {
    /// Values of the best explanation; nominal where it has none.
    fn of(study: &Study, rig: &Rig) -> Option<Self> {
        let found = |name: &str| study.explanations.first()?.constants.get(name).map(|constant| constant.value);
        let viscous = study.outcome.parameters.get("viscous_friction_Nm_s").map(|parameter| parameter.value);
        let nominal_k = rig.motor.torque_constant_nm_per_a?;
        let k = found("back_emf_constant_V_s").unwrap_or(nominal_k);
        // Without a load, friction was computed as current times the nominal constant.
        let torque = if is_loaded(&study.levels) { 1.0 } else { k / nominal_k };
        Some(Self {
            resistance_ohm: found("resistance_ohm").or(rig.motor.resistance_ohm)?,
            torque_constant_Nm_per_A: k,
            drop_V: found("drop_V").unwrap_or(0.0),
            coulomb_Nm: torque * study.coulomb_nm,
            viscous_Nm_s: torque * viscous.unwrap_or(0.0).max(0.0),
        })
    }

    fn losses(&self, level: &Level) -> Losses {
        let (i, w) = (level.i_A, level.omega_rad_per_s);
        let winding = i * i * self.resistance_ohm;
        let (drop, coulomb, viscous) = (i * self.drop_V, self.coulomb_Nm * w, self.viscous_Nm_s * w * w);
        let shaft = level.load_Nm * w;
        let rest = level.p_in_W - shaft - winding - drop - coulomb - viscous;
        Losses {
            u_V: level.u_V,
            load_Nm: level.load_Nm,
            shaft_W: shaft,
            winding_W: winding,
            drop_W: drop,
            coulomb_W: coulomb,
            viscous_W: viscous,
            rest_W: rest,
        }
    }

    /// The steady state at a voltage under a load; `None` if the motor does not turn.
    pub fn operating_point(&self, u: f64, torque: f64) -> Option<OperatingPoint> {
        let Self { resistance_ohm: r, torque_constant_Nm_per_A: k, .. } = *self;
        let dry = torque + self.coulomb_Nm;
        let w = (u - self.drop_V - r * dry / k) / (k + r * self.viscous_Nm_s / k);
        let i = (dry + self.viscous_Nm_s * w) / k;
        let point =
            OperatingPoint { u_V: u, torque_Nm: torque, omega_rad_per_s: w, i_A: i, efficiency: torque * w / (u * i) };
        (w > 0.0 && i > 0.0).then_some(point)
    }

    /// Torque that stalls the motor.
    fn stall_nm(&self, u: f64) -> f64 {
        (u - self.drop_V) * self.torque_constant_Nm_per_A / self.resistance_ohm - self.coulomb_Nm
    }

    /// The load at which the efficiency is greatest.
    pub fn most_efficient(&self, u: f64) -> Option<OperatingPoint> {
        let stall_nm = self.stall_nm(u);
        (1..1000)
            .filter_map(|step| self.operating_point(u, stall_nm * f64::from(step) / 1000.0))
            .max_by(|a, b| a.efficiency.total_cmp(&b.efficiency))
    }

    /// Operating points over voltage and torque, up to a voltage.
    pub fn map(&self, greatest_v: f64) -> EfficiencyMap {
        // Half the stall torque. Beyond it the efficiency falls and the motor only gets warm.
        let step_v = greatest_v / MAP_SIZE as f64;
        let step_nm = 0.5 * self.stall_nm(greatest_v) / MAP_SIZE as f64;
        let middles = |step: f64| (0..MAP_SIZE).map(move |index| (index as f64 + 0.5) * step);
        let points =
            middles(step_v).flat_map(|u| middles(step_nm).filter_map(move |torque| self.operating_point(u, torque)));
        EfficiencyMap { step_v, step_nm, points: points.collect() }
    }
}

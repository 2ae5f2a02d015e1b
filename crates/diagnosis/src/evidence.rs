//! The evidence of a named cause: what the model lacks without it, over the quantity on which its law depends, and the law
//! itself. All other causes are in the model.
//!
//! A force in the motor is not measured. The residual of the full model says by how much the force in each bin differs
//! from the law: it is the sum of the linear motor's responses to a force in each bin alone. Law and difference together
//! are the measured lack (a partial residual: Larsen and McCleary, Technometrics 14 (1972)). A reading is measured, so its
//! lack is measured less simulated without the cause.

mod axis;
mod forces;
mod readings;

use crate::configuration::evidence::LEAST_KNOWN;
use crate::dataset::Dataset;
use crate::diagnose::Diagnosis;
use crate::diagnose::outcome::Cause;
use crate::free_run::{Motion, Steps, drive, read};
use motorbench_model::catalogue::{Coordinate, Strength};
use motorbench_model::{Model, Term};

/// What proves a cause.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// What is lacking, and its unit.
    pub quantity: (&'static str, &'static str),
    /// What it depends on, and its unit.
    pub coordinate: (&'static str, &'static str),
    /// The measured lack.
    pub bins: Vec<Bin>,
    /// The fitted law: coordinate and value, in finer bins.
    pub law: Vec<[f64; 2]>,
}

/// The mean of a lack where the coordinate is within a bin.
#[derive(Clone, Copy, Debug)]
pub struct Bin {
    /// Mean of the coordinate.
    pub at: f64,
    /// Lack as measured.
    pub lack: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// Lack by the law.
    pub law: f64,
}

impl Evidence {
    /// Share of the measured lack (mean square, each bin by how well it is known) that the law explains.
    pub fn explained(&self) -> f64 {
        let sum = |of: fn(&Bin) -> f64| self.bins.iter().map(|bin| (of(bin) / bin.deviation).powi(2)).sum::<f64>();
        let (left, all) = (sum(|bin| bin.lack - bin.law), sum(|bin| bin.lack));
        if all > 0.0 { (1.0 - left / all).max(0.0) } else { 0.0 }
    }
}

/// The evidence of a cause that is an effect in the model; `None` for a wrong value, and for what was corrected in the data.
pub fn evidence(diagnosis: &Diagnosis, cause: &Cause) -> Option<Evidence> {
    of_effect(&diagnosis.fitted, &diagnosis.data, &cause.effect)
}

/// The evidence of an effect in a model of these data; `None` if the model does not have it, or the data do not show it.
pub fn of_effect(model: &Model, data: &Dataset, id: &str) -> Option<Evidence> {
    let term = model.term(id)?;
    let shown = term.effect.about().shown;
    let motion = drive(model, data, Steps::Fine);
    let predicted = read(model, data, motion.clone());
    let case = Case { model, data, motion: &motion, predicted: &predicted, term };
    let (bins, law) = match shown.as_a.is_of_a_reading() {
        true => readings::binned(&case)?,
        false => forces::binned(&case)?,
    };
    let greatest = bins.iter().map(|bin| bin.law.abs()).fold(0.0, f64::max);
    let is_known = |bin: &Bin| bin.deviation > 0.0 && bin.deviation < LEAST_KNOWN * greatest;
    let bins: Vec<Bin> = bins.into_iter().filter(is_known).collect();
    let quantity = match shown.as_a {
        Strength::Reading | Strength::ShareOfReading => readings::quantity(&case),
        other => quantity(other),
    };
    (!bins.is_empty()).then(|| Evidence { quantity, coordinate: coordinate(shown.over), bins, law })
}

/// A cause in its model and data.
struct Case<'a> {
    model: &'a Model,
    data: &'a Dataset,
    /// Motion and readings of the full model.
    motion: &'a Motion,
    predicted: &'a [Vec<f64>],
    term: &'a Term,
}

fn quantity(strength: Strength) -> (&'static str, &'static str) {
    match strength {
        Strength::Torque => ("missing torque", "Nm"),
        Strength::Friction => ("added friction torque", "Nm"),
        Strength::TorqueConstant => ("change of the torque constant", "%"),
        Strength::Voltage => ("missing voltage", "V"),
        Strength::SupplyVoltage => ("voltage that the supply loses", "V"),
        Strength::Resistance => ("added resistance", "ohm"),
        Strength::Delay => ("delay", "ms"),
        Strength::Reading | Strength::ShareOfReading => ("change of the reading", ""),
    }
}

fn coordinate(over: Coordinate) -> (&'static str, &'static str) {
    match over {
        Coordinate::Speed => ("speed", "rad/s"),
        Coordinate::SpeedSize => ("speed without its sign", "rad/s"),
        Coordinate::Angle => ("angle of the shaft", "rad"),
        Coordinate::Current => ("current", "A"),
        Coordinate::SupplyCurrent => ("current of the supply", "A"),
        Coordinate::Voltage => ("commanded voltage", "V"),
        Coordinate::Duty => ("duty", ""),
        Coordinate::Time => ("time", "s"),
        Coordinate::SinceStep => ("time since a step of the command", "ms"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::free_run::free_run;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;
    use std::fmt::Write as _;

    const LEVELS_V: [f64; 12] = [2.0, 6.0, 12.0, -3.0, -8.0, -12.0, 4.0, 1.5, -1.5, 9.0, -5.0, 0.0];
    const ROWS: usize = 2400;

    /// Steps up and down through all voltages, with these readings of current and speed.
    fn dataset(readings: impl Fn(usize) -> [f64; 2]) -> Dataset {
        let mut text = String::from("t_s,u_V,i_A,omega_rad_per_s\n");
        for row in 0..ROWS {
            let (volts, [current, speed]) = (LEVELS_V[row / 200 % 12], readings(row));
            let _ = writeln!(text, "{:.3},{volts},{current},{speed}", row as f64 * 1e-3);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        Dataset::new(&[recording], &Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap()).unwrap()
    }

    /// A recording of a model, with noise.
    fn recorded(truth: &Model) -> Dataset {
        // Any values from which the sensors get their noise.
        let noise = |row: usize, prime: usize| (row * prime % 101) as f64 / 101.0 - 0.5;
        let mut data = dataset(|row| [LEVELS_V[row / 200 % 12] / 6.0, 13.0 * LEVELS_V[row / 200 % 12]]);
        // The angle of a recording comes from its speed, and a wave acts by the angle.
        let has_wave = truth.terms.iter().any(|term| term.effect.wave(&term.values).is_some());
        for _ in 0..if has_wave { 8 } else { 2 } {
            let read = free_run(truth, &data);
            data = dataset(|row| [read[0][row] + 0.01 * noise(row, 59), read[1][row] + 0.2 * noise(row, 37)]);
        }
        data
    }

    fn with(id: &str, values: &[f64]) -> Model {
        Model::linear(MotorParameters::PIVT6)
            .with(effect("coulomb_friction").unwrap(), vec![0.006])
            .without(id)
            .with(effect(id).unwrap(), values.to_vec())
    }

    const LAWS: [(&str, &[f64]); 12] = [
        ("coulomb_friction", &[0.006]),
        ("quadratic_drag", &[8e-8]),
        ("load_torque", &[0.004]),
        ("load_step", &[0.005, 1.1]),
        ("gravity_unbalance", &[0.004, 0.003]),
        ("cogging", &[0.004, 0.003, 7.0]),
        ("voltage_drop", &[1.5]),
        ("supply_sag", &[1.0]),
        ("winding_heating", &[0.02, 1.0]),
        ("current_offset", &[0.1]),
        ("actuation_delay", &[4e-3]),
        ("backlash", &[0.06, 0.4, 120.0, 0.3]),
    ];

    #[test]
    fn a_right_law_explains_what_is_measured() {
        for (id, values) in LAWS {
            let truth = with(id, values);
            let found = of_effect(&truth, &recorded(&truth), id).unwrap_or_else(|| panic!("{id}: no plot"));
            assert!(found.explained() > 0.97, "{id}: {:.3} of {:?}", found.explained(), found.bins);
            assert!(found.law.len() >= 2 && found.bins.len() >= 2, "{id}: {found:?}");
        }
    }

    /// The measured lack is that of the data whatever the law says: with half the strength in the model it stays, and the
    /// law explains three quarters of its square.
    #[test]
    fn a_wrong_law_is_seen_beside_what_is_measured() {
        for (id, values) in
            [("coulomb_friction", vec![0.006]), ("cogging", vec![0.004, 0.003, 7.0]), ("voltage_drop", vec![1.5])]
        {
            let (truth, mut half) = (with(id, &values), values.clone());
            half.iter_mut().take(if id == "cogging" { 2 } else { 1 }).for_each(|value| *value *= 0.5);
            let data = recorded(&truth);
            let [right, wrong] = [&truth, &with(id, &half)].map(|model| of_effect(model, &data, id).unwrap());
            let size =
                |found: &Evidence| found.bins.iter().map(|bin| bin.lack.abs()).sum::<f64>() / found.bins.len() as f64;
            assert!((size(&wrong) / size(&right) - 1.0).abs() < 0.15, "{id}: {} {}", size(&wrong), size(&right));
            assert!((0.6..0.85).contains(&wrong.explained()), "{id}: {}", wrong.explained());
        }
    }

    #[test]
    fn a_wave_is_resolved() {
        let truth = with("cogging", &[0.004, 0.003, 7.0]);
        let found = of_effect(&truth, &recorded(&truth), "cogging").unwrap();
        assert!(found.bins.len() >= 8 * 7 - 4, "{}", found.bins.len());
        let most = found.bins.iter().map(|bin| bin.lack).fold(0.0, f64::max);
        assert!((most / 0.005 - 1.0).abs() < 0.2, "{most}");
    }
}

//! A scale of which a recording says nothing. Only what was known before decides on it.
//!
//! *Torques*, where no current is measured. Let every torque, friction, inertia and current be `c` times as great, and
//! resistance and inductance `c` times as small: the motor turns exactly as before.
//!
//! *Voltages*, where a bridge has a drop of its own on each way that a current takes. Let every voltage, torque and
//! resistance be `c` times as great, and the drops such that what they leave of the supply is `c` times as much: current
//! and speed are exactly as before.
//!
//! Finite differences know a scale no better than to a thousandth, and a thousandth of ten thousand samples outweighs every
//! data sheet. So what they say of it is taken out.

use super::dot;
use super::unknowns::{Place, Unknown, prior_cost};
use crate::configuration::identify::unknown_scale::{CLOSENESS, DIFFERENCE, ROUNDING, SECTION, WIDEST};
use crate::dataset::Dataset;
use motorbench_model::motor::MotorParameters;
use motorbench_model::unit::Quantity;
use motorbench_model::{Drive, Model, Term};
use nalgebra::DVector;

/// Whether nothing measured has the scale of the torques in it.
pub fn has_unknown_torque_scale(data: &Dataset) -> bool {
    data.axis.drive.is_voltage() && data.current().is_none() && has_no_load(data)
}

/// Whether the torque constant only scales all torques: a current is imposed, and no load is known.
pub fn scales_all_torques(data: &Dataset) -> bool {
    data.axis.drive == Drive::Current && has_no_load(data)
}

/// Whether the drops of the model's bridge leave the scale of all its voltages open.
pub fn has_unknown_voltage_scale(model: &Model, data: &Dataset) -> bool {
    matches!(UnknownScale::of(model, data), Some(UnknownScale::Voltages { .. }))
}

fn has_no_load(data: &Dataset) -> bool {
    data.load_nm.iter().all(|load_nm| *load_nm == 0.0)
}

/// What is scaled.
#[derive(Clone, Copy, Debug)]
pub(super) enum UnknownScale {
    Torques,
    Voltages { supply_v: f64 },
}

impl UnknownScale {
    /// The one that the data leave open for this model.
    pub fn of(model: &Model, data: &Dataset) -> Option<Self> {
        if has_unknown_torque_scale(data) {
            return Some(Self::Torques);
        }
        let supply_v = *data.supply_v.first()?;
        // Few models get past the first two, and the last two look at every row.
        let is_unknown = model.terms.iter().any(|term| scaled_term(term, supply_v, 1.0).is_some())
            && !model.terms.iter().any(|term| term.effect.about().tells_scale_of_voltages)
            && data.axis.drive.is_voltage()
            && has_no_load(data)
            && data.supply_v.iter().all(|other_v| *other_v == supply_v);
        is_unknown.then_some(Self::Voltages { supply_v })
    }

    /// A coordinate of the fit, with this logarithm of the scale more.
    fn coordinate(self, model: &Model, unknown: &Unknown, logarithm: f64) -> f64 {
        let quantity = match (self, unknown.place) {
            // Voltages and motions stay, so that the scale is that of the current.
            (Self::Torques, _) => Quantity::Current,
            (Self::Voltages { supply_v }, Place::Term(term, index)) => {
                if let Some(values) = scaled_term(&model.terms[term], supply_v, logarithm.exp()) {
                    return values[index] / unknown.size;
                }
                Quantity::Voltage
            }
            (Self::Voltages { .. }, Place::Motor(_)) => Quantity::Voltage,
        };
        let unit = match unknown.place {
            Place::Motor(index) => MotorParameters::UNITS[index],
            Place::Term(term, index) => model.terms[term].effect.about().parameters[index].unit,
        };
        let here = unknown.get(model);
        let power = quantity.power(unit) * logarithm;
        if unknown.logarithmic { here + power } else { here * power.exp() }
    }

    /// The coordinates' derivatives by its logarithm.
    pub fn direction(self, model: &Model, unknowns: &[Unknown]) -> DVector<f64> {
        let slope = |unknown: &Unknown| {
            let [back, ahead] = [-DIFFERENCE, DIFFERENCE].map(|step| self.coordinate(model, unknown, step));
            (ahead - back) / (2.0 * DIFFERENCE)
        };
        DVector::from_iterator(unknowns.len(), unknowns.iter().map(slope))
    }

    /// Takes out of the sensitivities what they say of it. That is shared out as the columns' own errors are: in proportion
    /// to their squares.
    pub fn take_out(self, columns: &mut [Vec<f64>], unknowns: &[Unknown], model: &Model) {
        let along = self.direction(model, unknowns);
        let squares: Vec<f64> = columns.iter().map(|column| dot(column, column)).collect();
        let whole: f64 = along.iter().zip(&squares).map(|(along, square)| along * along * square).sum();
        if whole == 0.0 {
            return;
        }
        let mut error = vec![0.0; columns[0].len()];
        for (column, along) in columns.iter().zip(&along) {
            error.iter_mut().zip(column).for_each(|(error, value)| *error += along * value);
        }
        for ((column, along), square) in columns.iter_mut().zip(&along).zip(&squares) {
            let share = along * square / whole;
            column.iter_mut().zip(&error).for_each(|(value, error)| *value -= share * error);
        }
    }

    /// The model at the scale that was most plausible before, and whether it reads the same: not where a constant comes to
    /// its bound.
    pub fn most_plausible(self, model: &Model, unknowns: &[Unknown]) -> (Model, bool) {
        let cost = |logarithm: f64| prior_cost(&self.scaled(model, unknowns, logarithm), unknowns);
        let (mut low, mut high) = (-WIDEST, WIDEST);
        while high - low > CLOSENESS {
            let inner = [high - SECTION * (high - low), low + SECTION * (high - low)];
            if cost(inner[0]) < cost(inner[1]) {
                high = inner[1];
            } else {
                low = inner[0];
            }
        }
        let logarithm = 0.5 * (low + high);
        let scaled = self.scaled(model, unknowns, logarithm);
        let is_in_bounds = |unknown: &Unknown| {
            let wanted = self.coordinate(model, unknown, logarithm);
            (unknown.get(&scaled) - wanted).abs() <= ROUNDING * wanted.abs().max(1.0)
        };
        let keeps_readings = unknowns.iter().all(is_in_bounds);
        (scaled, keeps_readings)
    }

    fn scaled(self, model: &Model, unknowns: &[Unknown], logarithm: f64) -> Model {
        let mut scaled = model.clone();
        for unknown in unknowns {
            unknown.set(&mut scaled, self.coordinate(model, unknown, logarithm));
        }
        scaled
    }
}

fn scaled_term(term: &Term, supply_v: f64, factor: f64) -> Option<Vec<f64>> {
    term.effect.with_scaled_voltages(&term.values, supply_v, factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::free_run::free_run;
    use crate::identify::unknowns::{motor_values, unknowns};
    use crate::identify::{Prior, scales};
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::catalogue::{CATALOGUE, Sensor, effect};

    /// Voltage to and fro, with the speed as a linear motor has it.
    fn without_a_current() -> (Dataset, Prior) {
        let rig = "[supply]\nvoltage_V = 12.0\n[motor]\nresistance_ohm = 4.0\ninductance_H = 4e-3\n\
                   torque_constant_Nm_per_A = 0.04\ninertia_kg_m2 = 2e-5\nviscous_friction_Nm_s = 1e-5\n";
        let rig = Rig::parse("rig.toml", rig).unwrap();
        let mut csv = String::from("t_s,u_V,omega_rad_per_s\n");
        let mut speed = 0.0_f64;
        for sample in 0..3000 {
            let voltage_v = 9.0 * (0.007 * f64::from(sample)).sin() + 2.0 * (0.0011 * f64::from(sample)).cos();
            csv += &format!("{},{voltage_v},{speed}\n", 1e-3 * f64::from(sample));
            speed += 0.02 * (voltage_v / 0.04 - speed);
        }
        let data = Dataset::new(&[Recording::parse("run.csv", csv.as_bytes(), &[]).unwrap()], &rig).unwrap();
        let prior = Prior::new(&rig.motor, &data);
        (data, prior)
    }

    /// With any effect, the motor turns the same at any scale: the units tell how each constant goes with it.
    #[test]
    fn no_reading_depends_on_the_torque_scale() {
        let (data, prior) = without_a_current();
        for effect in CATALOGUE.iter().filter(|effect| effect.about().sensor != Some(Sensor::Current)) {
            let linear = Model::linear(prior.motor);
            let model = linear.with_start(*effect, &scales(&prior.motor, &data));
            let other = UnknownScale::Torques.scaled(&model, &unknowns(&model, &data, &prior), 0.4);
            assert!(other.motor.resistance_ohm < 0.7 * model.motor.resistance_ohm);
            let (here, there) = (free_run(&model, &data), free_run(&other, &data));
            let apart = here[0].iter().zip(&there[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let size = here[0].iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
            assert!(apart < 1e-6 * size, "{}: {apart} of {size}", effect.about().id);
        }
    }

    /// Behind a bridge that drops another voltage on each way of the current, with any effect that does not tell the scale.
    #[test]
    fn no_reading_depends_on_the_voltage_scale() {
        let (_, prior) = without_a_current();
        let mut csv = String::from("t_s,duty,omega_rad_per_s,i_A\n");
        for sample in 0..1500 {
            let (time_s, swing) = (1e-3 * f64::from(sample), (0.02 * f64::from(sample)).sin());
            csv += &format!("{time_s},{:.4},{:.2},{:.3}\n", 0.8 * swing, 150.0 * swing, 0.4 * swing);
        }
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n[bridge]\npwm_Hz = 20000\n").unwrap();
        let data = Dataset::new(&[Recording::parse("run.csv", csv.as_bytes(), &[]).unwrap()], &rig).unwrap();
        let drop = effect("voltage_drop").unwrap();
        for effect in CATALOGUE.iter().filter(|effect| !effect.about().tells_scale_of_voltages) {
            let bridge = Model::linear(prior.motor).with(drop, vec![1.9, 0.0, -0.5, 0.6, -0.3]);
            let id = effect.about().id;
            let model = if bridge.has(id) { bridge } else { bridge.with_start(*effect, &scales(&prior.motor, &data)) };
            let scale = UnknownScale::of(&model, &data).expect("the drops leave it open");
            let other = scale.scaled(&model, &unknowns(&model, &data, &prior), 0.06);
            assert!(other.motor.resistance_ohm > 1.05 * model.motor.resistance_ohm);
            let (here, there) = (free_run(&model, &data), free_run(&other, &data));
            for (here, there) in here.iter().zip(&there) {
                let apart = here.iter().zip(there).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                let size = here.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
                assert!(apart < 1e-6 * size, "{id}: {apart} of {size}");
            }
        }
    }

    #[test]
    fn the_prior_decides_the_torque_scale() {
        let (data, prior) = without_a_current();
        let model = Model::linear(prior.motor);
        let unknowns = unknowns(&model, &data, &prior);
        let scale = UnknownScale::of(&model, &data).expect("no current is measured");
        let (found, keeps_readings) = scale.most_plausible(&scale.scaled(&model, &unknowns, 0.3), &unknowns);
        assert!(keeps_readings, "{found:?}");
        for (found, nominal) in motor_values(&found.motor).into_iter().zip(motor_values(&prior.motor)) {
            assert!((found / nominal - 1.0).abs() < 1e-3, "{found} {nominal}");
        }
    }
}

//! The scale of all torques, of which a recording without a current says nothing.
//!
//! Let every torque, friction, inertia and current be `c` times as great, and resistance and inductance `c` times as small:
//! the motor turns exactly as before. Only what was known before decides on `c`. Finite differences
//! know that no better than to a thousandth, and a thousandth of ten thousand samples outweighs every data sheet.

use super::dot;
use super::unknowns::{Place, Unknown, prior_cost};
use crate::dataset::Dataset;
use motorbench_model::motor::MotorParameters;
use motorbench_model::unit::Quantity;
use motorbench_model::{Drive, Model};

/// Golden section.
const SECTION: f64 = 0.618_033_988_749_895;
/// Logarithm of the greatest factor looked at, and how closely the best one is found.
const WIDEST: f64 = 4.0;
const CLOSENESS: f64 = 1e-4;

/// Whether nothing measured has the scale in it.
pub fn is_unknown(data: &Dataset) -> bool {
    data.axis.drive.is_voltage() && data.current().is_none() && has_no_load(data)
}

/// Whether the torque constant only scales all torques: a current is imposed, and no load is known.
pub fn scales_all(data: &Dataset) -> bool {
    data.axis.drive == Drive::Current && has_no_load(data)
}

fn has_no_load(data: &Dataset) -> bool {
    data.load_nm.iter().all(|load_nm| *load_nm == 0.0)
}

/// With which power of the scale a constant goes. Voltages and motions stay, so that the scale is that of the current.
fn exponent_of(place: Place, model: &Model) -> f64 {
    Quantity::Current.power(match place {
        Place::Motor(index) => MotorParameters::UNITS[index],
        Place::Term(term, index) => model.terms[term].effect.about().parameters[index].unit,
    })
}

/// Takes out of the sensitivities what they say of the scale. It is shared out as the columns' own errors are: in proportion
/// to their squares.
pub(super) fn take_out(columns: &mut [Vec<f64>], unknowns: &[Unknown], model: &Model) {
    let along: Vec<f64> = unknowns
        .iter()
        .map(|unknown| exponent_of(unknown.place, model) * if unknown.logarithmic { 1.0 } else { unknown.get(model) })
        .collect();
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

/// The same motion at the scale that was most plausible before.
pub(super) fn most_plausible(model: &Model, unknowns: &[Unknown]) -> Model {
    let cost = |logarithm: f64| prior_cost(&scaled(model, unknowns, logarithm), unknowns);
    let (mut low, mut high) = (-WIDEST, WIDEST);
    while high - low > CLOSENESS {
        let inner = [high - SECTION * (high - low), low + SECTION * (high - low)];
        if cost(inner[0]) < cost(inner[1]) {
            high = inner[1];
        } else {
            low = inner[0];
        }
    }
    scaled(model, unknowns, 0.5 * (low + high))
}

fn scaled(model: &Model, unknowns: &[Unknown], logarithm: f64) -> Model {
    let mut scaled = model.clone();
    for unknown in unknowns {
        let power = exponent_of(unknown.place, model) * logarithm;
        let here = unknown.get(model);
        unknown.set(&mut scaled, if unknown.logarithmic { here + power } else { here * power.exp() });
    }
    scaled
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::free_run::free_run;
    use crate::identify::unknowns::{motor_values, unknowns};
    use crate::identify::{Prior, scales};
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::catalogue::{CATALOGUE, Sensor};

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
            let other = scaled(&model, &unknowns(&model, &data, &prior), 0.4);
            assert!(other.motor.resistance_ohm < 0.7 * model.motor.resistance_ohm);
            let (here, there) = (free_run(&model, &data), free_run(&other, &data));
            let apart = here[0].iter().zip(&there[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let size = here[0].iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
            assert!(apart < 1e-6 * size, "{}: {apart} of {size}", effect.about().id);
        }
    }

    #[test]
    fn the_prior_decides_the_torque_scale() {
        let (data, prior) = without_a_current();
        let model = Model::linear(prior.motor);
        let unknowns = unknowns(&model, &data, &prior);
        let found = most_plausible(&scaled(&model, &unknowns, 0.3), &unknowns);
        for (found, nominal) in motor_values(&found.motor).into_iter().zip(motor_values(&prior.motor)) {
            assert!((found / nominal - 1.0).abs() < 1e-3, "{found} {nominal}");
        }
    }
}

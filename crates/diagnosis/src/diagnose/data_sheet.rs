//! How far a motor is from its data sheet: farther than one errs, and something else has been made up for.

use super::DATA_SHEET_TOLERANCE;
use super::judge::{NOT_NOISE, above_floor};
use crate::dataset::Dataset;
use crate::identify::{Fit, Prior};
use motorbench_model::motor::MotorParameters;
use motorbench_model::unit::Unit;

/// Standard deviation of the logarithm of a nominal viscous friction.
const VISCOUS_SPREAD: f64 = 0.5;
/// Squares of the deviations of R, k and J from their nominal values, in standard deviations, that no data sheet explains:
/// as many for each that has one.
const STRANGE_EACH: f64 = 8.0;
/// Resistance, torque constant and inertia, by their units: they say how large a motor is. An inductance depends on the
/// frequency it is measured at.
pub(super) const OF_SIZE: [Unit; 3] = [Unit::Ohm, Unit::NewtonMetrePerAmpere, Unit::KilogramMetre2];

/// What speaks against a fit: something remains, its motor is strange. The fewer of these the better, the first before the second.
pub(super) fn doubts(data: &Dataset, prior: &Prior, fit: &Fit) -> [bool; 2] {
    [above_floor(data, fit) > NOT_NOISE, is_strange(prior, fit)]
}

/// Whether the motor is another one than the rig's: then something that is not in the model has been made up for.
pub(super) fn is_strange(prior: &Prior, fit: &Fit) -> bool {
    let given = off_data_sheet(prior, fit).count().max(1);
    strangeness(prior, fit) > STRANGE_EACH * given as f64
}

/// Whether several of the motor's constants are farther from the data sheet than it is wrong by itself: more likely something
/// else has been made up for.
pub(super) fn has_wrong_values(prior: &Prior, fit: &Fit) -> bool {
    off_data_sheet(prior, fit).filter(|(_, off)| off.abs() > DATA_SHEET_TOLERANCE).count() > 1
}

/// Logarithms of resistance, torque constant and inertia over those of them that the data sheet gives, with their units.
pub(super) fn off_data_sheet(prior: &Prior, fit: &Fit) -> impl Iterator<Item = (Unit, f64)> {
    let found = fit.model.motor.named().map(|(_, found)| found);
    let constants = MotorParameters::UNITS.into_iter().zip(found).zip(prior.nominal.values());
    let of_size = constants.filter(|((unit, _), _)| OF_SIZE.contains(unit));
    of_size.filter_map(|((unit, found), nominal)| Some((unit, (found / nominal?).ln())))
}

/// Squares of the motor's deviations from its data sheet, in standard deviations. Of viscous friction a data sheet says
/// little; many times as much is another friction.
pub(super) fn strangeness(prior: &Prior, fit: &Fit) -> f64 {
    let values = |motor: &MotorParameters| [motor.resistance_ohm, motor.torque_constant_nm_per_a, motor.inertia_kg_m2];
    let spread = [prior.spread[0], prior.spread[2], prior.spread[3]];
    let off = values(&fit.model.motor).into_iter().zip(values(&prior.motor)).zip(spread);
    let constants: f64 = off.map(|((found, nominal), spread)| ((found / nominal).ln() / spread).powi(2)).sum();
    let viscous = prior.nominal.viscous_friction_nm_s.filter(|nominal| *nominal > 0.0).map_or(0.0, |nominal| {
        ((fit.model.motor.viscous_friction_nm_s / nominal).max(1.0).ln() / VISCOUS_SPREAD).powi(2)
    });
    constants + viscous
}

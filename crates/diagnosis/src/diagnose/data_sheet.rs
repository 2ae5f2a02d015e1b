//! Distance of a motor from its data sheet. If it exceeds the tolerance of data sheets, the constants compensate for a
//! missing effect.

use super::DATA_SHEET_TOLERANCE;
use super::judge::{NOT_NOISE, above_floor};
use crate::dataset::Dataset;
use crate::identify::{Fit, GIVEN_DROP_SPREAD_V, Prior};
use motorbench_model::motor::MotorParameters;
use motorbench_model::unit::Unit;

/// Standard deviation of the logarithm of a nominal viscous friction.
const VISCOUS_SPREAD: f64 = 0.5;
/// Squared deviations of R, k and J from their nominal values, in standard deviations, for each nominal value: more is
/// implausible.
const IMPLAUSIBLE_EACH: f64 = 8.0;
/// Resistance, torque constant and inertia, by their units: they show the size of a motor. An inductance depends on the
/// frequency of its measurement.
pub(super) const OF_SIZE: [Unit; 3] = [Unit::Ohm, Unit::NewtonMetrePerAmpere, Unit::KilogramMetre2];

/// Reasons against a fit: a rest remains; its motor is implausible. Fewer are better, and the first weighs more.
pub(super) fn doubts(data: &Dataset, prior: &Prior, fit: &Fit) -> [bool; 2] {
    [above_floor(data, fit) > NOT_NOISE, is_implausible(prior, fit)]
}

/// Whether the motor is far from the rig's: then its constants compensate for an effect outside the model.
pub(super) fn is_implausible(prior: &Prior, fit: &Fit) -> bool {
    let given = off_data_sheet(prior, fit).count().max(1);
    squared_deviations(prior, fit) > IMPLAUSIBLE_EACH * given as f64
}

/// Whether several constants are beyond the tolerance of the data sheet: then they more likely compensate for something
/// else.
pub(super) fn has_wrong_values(prior: &Prior, fit: &Fit) -> bool {
    off_data_sheet(prior, fit).filter(|(_, off)| off.abs() > DATA_SHEET_TOLERANCE).count() > 1
}

/// Logarithms of found over nominal resistance, torque constant and inertia, of those that are nominal, with their units.
pub(super) fn off_data_sheet(prior: &Prior, fit: &Fit) -> impl Iterator<Item = (Unit, f64)> {
    let found = fit.model.motor.named().map(|(_, found)| found);
    let constants = MotorParameters::UNITS.into_iter().zip(found).zip(prior.nominal.values());
    let of_size = constants.filter(|((unit, _), _)| OF_SIZE.contains(unit));
    of_size.filter_map(|((unit, found), nominal)| Some((unit, (found / nominal?).ln())))
}

/// Squared deviations of the motor from its data sheet, in standard deviations. A data sheet says little about viscous
/// friction, but many times its value is another friction. The drop of the bridge has its own data sheet.
pub(super) fn squared_deviations(prior: &Prior, fit: &Fit) -> f64 {
    let values = |motor: &MotorParameters| [motor.resistance_ohm, motor.torque_constant_nm_per_a, motor.inertia_kg_m2];
    let spread = [prior.spread[0], prior.spread[2], prior.spread[3]];
    let off = values(&fit.model.motor).into_iter().zip(values(&prior.motor)).zip(spread);
    let constants: f64 = off.map(|((found, nominal), spread)| ((found / nominal).ln() / spread).powi(2)).sum();
    let viscous = prior.nominal.viscous_friction_nm_s.filter(|nominal| *nominal > 0.0).map_or(0.0, |nominal| {
        ((fit.model.motor.viscous_friction_nm_s / nominal).max(1.0).ln() / VISCOUS_SPREAD).powi(2)
    });
    let drop_v = fit.model.dry_losses().bridge_drop_v;
    let drop = prior.bridge_drop_v.map_or(0.0, |given_v| ((drop_v - given_v) / GIVEN_DROP_SPREAD_V).powi(2));
    constants + viscous + drop
}

//! Distance of a motor from its data sheet. If it exceeds the tolerance of data sheets, the constants compensate for a
//! missing effect.

use super::DATA_SHEET_TOLERANCE;
use super::judge::{NOT_NOISE, above_floor};
use crate::configuration::diagnose::data_sheet::{EXCESSIVE_INDUCTANCE, IMPLAUSIBLE_EACH, MOST_DROP_V, VISCOUS_SPREAD};
use crate::dataset::Dataset;
use crate::identify::{Fit, GIVEN_DROP_SPREAD_V, Prior};
use motorbench_model::motor::MotorParameters;
use motorbench_model::unit::Unit;

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

/// Excess of the inductance over the nominal one, where it is large.
pub(super) fn excessive_inductance_h(prior: &Prior, fit: &Fit) -> Option<f64> {
    let nominal_h = prior.nominal.inductance_h?;
    let found_h = fit.model.motor.inductance_h;
    (found_h > EXCESSIVE_INDUCTANCE * nominal_h).then_some(found_h - nominal_h)
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
/// friction, but many times its value is another friction. The drop of the bridge has its own data sheet, or a limit.
pub(super) fn squared_deviations(prior: &Prior, fit: &Fit) -> f64 {
    let values = |motor: &MotorParameters| [motor.resistance_ohm, motor.torque_constant_nm_per_a, motor.inertia_kg_m2];
    let spread = [prior.spread[0], prior.spread[2], prior.spread[3]];
    let off = values(&fit.model.motor).into_iter().zip(values(&prior.motor)).zip(spread);
    let constants: f64 = off.map(|((found, nominal), spread)| ((found / nominal).ln() / spread).powi(2)).sum();
    let viscous = prior.nominal.viscous_friction_nm_s.filter(|nominal| *nominal > 0.0).map_or(0.0, |nominal| {
        ((fit.model.motor.viscous_friction_nm_s / nominal).max(1.0).ln() / VISCOUS_SPREAD).powi(2)
    });
    let drop_v = fit.model.dry_losses().bridge_drop_v;
    let off_v = prior.bridge_drop_v.map_or((drop_v - MOST_DROP_V).max(0.0), |given_v| drop_v - given_v);
    let drop = (off_v / GIVEN_DROP_SPREAD_V).powi(2);
    constants + viscous + drop
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use crate::identify::{Effort, fit};
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::Model;
    use motorbench_model::catalogue::{VOLTAGE_DROP, effect};
    use std::fmt::Write as _;

    /// Levels of several magnitudes.
    fn levels() -> (Dataset, Rig) {
        let mut text = String::from("t_s,duty,omega_rad_per_s,i_A\n");
        for row in 0..600 {
            let duty = [0.9, 0.4, -0.7, 0.2, -0.5, 0.6][row / 100];
            let _ = writeln!(text, "{},{duty},{},{}", row as f64 * 1e-3, 150.0 * duty, duty + 0.01 * (row % 3) as f64);
        }
        let rig = "[supply]\nvoltage_V = 12\n[bridge]\npwm_Hz = 20000\ndrop_V = 2.6\n";
        let rig = Rig::parse("rig.toml", rig).unwrap();
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        (Dataset::new(&[recording], &rig).unwrap(), rig)
    }

    #[test]
    fn a_bridge_has_a_data_sheet_as_well() {
        let (data, rig) = levels();
        let prior = Prior::new(&rig.motor, &data);
        let by_data_sheet = prior.clone().with_bridge(&rig.bridge, &data);
        let squares_of_the_drop = |drop_v: f64| {
            let model = Model::linear(prior.motor).with(effect(VOLTAGE_DROP).unwrap(), vec![drop_v]);
            let fit = fit(&model, &data, &prior, Effort::NONE);
            squared_deviations(&by_data_sheet, &fit) - squared_deviations(&prior, &fit)
        };
        for (drop_v, deviations) in [(2.6, 0.0), (2.3, 1.0), (0.8, 6.0)] {
            let found = squares_of_the_drop(drop_v);
            assert!((found - f64::powi(deviations, 2)).abs() < 1e-6, "{drop_v}: {found}");
        }
        // Without a data sheet any drop will do that a bridge can have.
        let squares = |drop_v: f64| {
            let model = Model::linear(prior.motor).with(effect(VOLTAGE_DROP).unwrap(), vec![drop_v]);
            squared_deviations(&prior, &fit(&model, &data, &prior, Effort::NONE))
        };
        assert_eq!(squares(0.8), squares(3.0));
        assert!(squares(6.0) > squares(3.0) + 20.0);
    }

    /// The data cannot tell the drop in the pulses from the voltage of the diodes in the off phase, which is held.
    #[test]
    fn intervals_contain_what_held_constants_leave_open() {
        let (data, rig) = levels();
        let prior = Prior::new(&rig.motor, &data);
        let braking = Model::linear(prior.motor).with(effect(VOLTAGE_DROP).unwrap(), vec![2.0]);
        let coasting = braking.with(effect("coast_decay").unwrap(), vec![1.0]);
        let widths = |model: &Model| {
            let fit = fit(model, &data, &prior, Effort::NONE);
            [fit.uncertainty(&data).intervals(), fit.with_held_open(&data).uncertainty(&data).intervals()].map(
                |intervals| {
                    let fitted = intervals.iter().take(fit.moved());
                    fitted.map(|interval| interval.ci95[1] - interval.ci95[0]).collect::<Vec<_>>()
                },
            )
        };
        let [alone, with_held] = widths(&braking);
        assert_eq!(alone, with_held, "nothing is held");
        let [alone, with_held] = widths(&coasting);
        assert_eq!(alone.len(), with_held.len());
        assert!(with_held.iter().zip(&alone).any(|(with, without)| *with > 1.2 * without), "{alone:?} {with_held:?}");
    }
}

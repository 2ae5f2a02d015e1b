//! The linear DC motor: five constants, two equations.
//!
//! ```text
//! L di/dt = u - R i - k w        J dw/dt = k i - b w
//! ```

use crate::unit::Unit;
use serde::{Deserialize, Serialize};

/// Constants of the linear motor, seen at its own shaft. The names are those of rig and model files.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorParameters {
    /// Armature resistance R, positive.
    pub resistance_ohm: f64,
    /// Armature inductance L, positive.
    #[serde(rename = "inductance_H")]
    pub inductance_h: f64,
    /// Torque constant k, equal to the back-EMF constant in V s/rad; positive.
    #[serde(rename = "torque_constant_Nm_per_A")]
    pub torque_constant_nm_per_a: f64,
    /// Inertia J of rotor and load, positive.
    pub inertia_kg_m2: f64,
    /// Viscous friction b, not negative.
    #[serde(rename = "viscous_friction_Nm_s")]
    pub viscous_friction_nm_s: f64,
}

/// A constant that no motor has.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} = {}: {rule}", written(*.value))]
pub struct NonPhysical {
    /// Name of the constant as in a rig file.
    pub name: &'static str,
    /// What it was.
    pub value: f64,
    /// What it has to be.
    pub rule: String,
}

/// A value as a person writes it.
fn written(value: f64) -> String {
    if value == 0.0 || (1e-4..1e6).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// What a constant of a motor can be: decades around anything from a watch to a ship, so that what is outside is a slip.
struct Range {
    name: &'static str,
    least: f64,
    most: f64,
    unit: &'static str,
    /// The unit that is most often left unconverted.
    slip: &'static str,
}

const RANGES: [Range; 5] = [
    Range { name: "resistance_ohm", least: 1e-5, most: 1e6, unit: "ohm", slip: "1 mohm is 1e-3 ohm" },
    Range { name: "inductance_H", least: 1e-9, most: 1e3, unit: "H", slip: "1 mH is 1e-3 H" },
    Range { name: "torque_constant_Nm_per_A", least: 1e-7, most: 1e4, unit: "Nm/A", slip: "1 mNm/A is 1e-3 Nm/A" },
    Range { name: "inertia_kg_m2", least: 1e-12, most: 1e4, unit: "kg m^2", slip: "1 g cm^2 is 1e-7 kg m^2" },
    Range { name: "viscous_friction_Nm_s", least: 0.0, most: 1e4, unit: "Nm s", slip: "1 uNm s is 1e-6 Nm s" },
];

/// Refuses a value that no motor has; other names have no range here.
///
/// # Errors
/// [`NonPhysical`], which says what it has to be.
pub fn check_constant(name: &str, value: f64) -> Result<(), NonPhysical> {
    let Some(range) = RANGES.iter().find(|range| range.name == name) else { return Ok(()) };
    let refused = |rule| Err(NonPhysical { name: range.name, value, rule });
    if !value.is_finite() || value < 0.0 || value == 0.0 && range.least > 0.0 {
        let positive = if range.least > 0.0 { "a positive number" } else { "zero or a positive number" };
        return refused(format!("it must be {positive}"));
    }
    if !(range.least..=range.most).contains(&value) {
        let Range { least, most, unit, slip, .. } = range;
        return refused(format!(
            "no motor has that; expected {} to {} {unit} ({slip})",
            written(*least),
            written(*most)
        ));
    }
    Ok(())
}

impl MotorParameters {
    /// The PIVT-6 25/3A: 5.84 ohm measured at rest, 0.072 Nm/A. Its data sheet has the time constants, 2 ms
    /// electromagnetic and 25 ms electromechanical. They imply inductance and inertia.
    pub const PIVT6: Self = Self {
        resistance_ohm: 5.84,
        inductance_h: 5.84 * 2e-3,
        torque_constant_nm_per_a: 0.072,
        inertia_kg_m2: 25e-3 * 0.072 * 0.072 / 5.84,
        viscous_friction_nm_s: 5e-6,
    };

    /// The unit of each constant, in the order of [`named`](Self::named).
    pub const UNITS: [Unit; 5] =
        [Unit::Ohm, Unit::Henry, Unit::NewtonMetrePerAmpere, Unit::KilogramMetre2, Unit::NewtonMetreSecond];

    /// Name as in a rig file and value of each constant.
    pub fn named(&self) -> [(&'static str, f64); 5] {
        [
            ("resistance_ohm", self.resistance_ohm),
            ("inductance_H", self.inductance_h),
            ("torque_constant_Nm_per_A", self.torque_constant_nm_per_a),
            ("inertia_kg_m2", self.inertia_kg_m2),
            ("viscous_friction_Nm_s", self.viscous_friction_nm_s),
        ]
    }

    /// Refuses what no motor has.
    ///
    /// # Errors
    /// The first constant that is not finite, not positive, (viscous friction) negative, or out of all proportion.
    pub fn check(&self) -> Result<(), NonPhysical> {
        self.named().into_iter().try_for_each(|(name, value)| check_constant(name, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_their_units() {
        for ((name, _), unit) in MotorParameters::PIVT6.named().into_iter().zip(MotorParameters::UNITS) {
            assert!(unit.is_said_by(name), "{name}: {unit:?}");
        }
    }

    #[test]
    fn what_no_motor_has_is_refused_with_the_likely_slip() {
        assert_eq!(MotorParameters::PIVT6.check(), Ok(()));
        let of = |motor: MotorParameters| motor.check().unwrap_err().to_string();
        let pivt6 = MotorParameters::PIVT6;
        assert_eq!(
            of(MotorParameters { inertia_kg_m2: -1.0, ..pivt6 }),
            "inertia_kg_m2 = -1: it must be a positive number"
        );
        assert_eq!(
            of(MotorParameters { inertia_kg_m2: 1e-300, ..pivt6 }),
            "inertia_kg_m2 = 1e-300: no motor has that; expected 1e-12 to 10000 kg m^2 (1 g cm^2 is 1e-7 kg m^2)"
        );
        assert!(of(MotorParameters { inductance_h: 1e-20, ..pivt6 }).contains("1 mH is 1e-3 H"));
        assert!(of(MotorParameters { viscous_friction_nm_s: -1e-9, ..pivt6 }).ends_with("zero or a positive number"));
        assert!(of(MotorParameters { resistance_ohm: f64::NAN, ..pivt6 }).ends_with("it must be a positive number"));
    }
}

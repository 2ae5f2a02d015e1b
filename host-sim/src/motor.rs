//! The linear DC motor: five constants, two equations.
//!
//! ```text
//! L di/dt = u - R i - k w        J dw/dt = k i - b w
//! ```

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
#[error("{name} = {value}: it must be {rule}")]
pub struct NonPhysical {
    /// Name of the constant as in a rig file.
    pub name: &'static str,
    /// What it was.
    pub value: f64,
    /// What it has to be.
    pub rule: &'static str,
}

impl MotorParameters {
    /// The PIVT-6 25/3A: 5.84 ohm measured at rest, 0.072 Nm/A, electromagnetic time constant 2 ms and electromechanical
    /// one 25 ms from its data sheet, which imply inductance and inertia.
    pub const PIVT6: Self = Self {
        resistance_ohm: 5.84,
        inductance_h: 5.84 * 2e-3,
        torque_constant_nm_per_a: 0.072,
        inertia_kg_m2: 25e-3 * 0.072 * 0.072 / 5.84,
        viscous_friction_nm_s: 5e-6,
    };

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
    /// The first constant that is not finite, not positive, or (viscous friction) negative.
    pub fn check(&self) -> Result<(), NonPhysical> {
        for (name, value) in self.named() {
            let may_be_zero = name == "viscous_friction_Nm_s";
            if !(value > 0.0 || may_be_zero && value == 0.0) || !value.is_finite() {
                let rule = if may_be_zero { "zero or a positive number" } else { "a positive number" };
                return Err(NonPhysical { name, value, rule });
            }
        }
        Ok(())
    }
}

//! The nominal constants of a rig file: those of a motor, or of a linear axis.

use super::Rig;
use motorbench_model::Motion;
use motorbench_model::motor::MotorParameters;
use serde::{Deserialize, Serialize};

/// Nominal constants of the motor; see [`MotorParameters`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[allow(missing_docs)]
pub struct NominalMotor {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resistance_ohm: Option<f64>,
    #[serde(rename = "inductance_H", skip_serializing_if = "Option::is_none")]
    pub inductance_h: Option<f64>,
    #[serde(rename = "torque_constant_Nm_per_A", skip_serializing_if = "Option::is_none")]
    pub torque_constant_nm_per_a: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inertia_kg_m2: Option<f64>,
    #[serde(rename = "viscous_friction_Nm_s", skip_serializing_if = "Option::is_none")]
    pub viscous_friction_nm_s: Option<f64>,
}

/// How the axis moves. The constants are those of a linear one, in place of the motor's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AxisKeys {
    /// Rotary or linear; left out: by the columns of a recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<Motion>,
    /// Force over current.
    #[serde(rename = "force_constant_N_per_A", skip_serializing_if = "Option::is_none")]
    pub force_constant_n_per_a: Option<f64>,
    /// Everything that moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// Viscous friction.
    #[serde(rename = "viscous_friction_N_s_per_m", skip_serializing_if = "Option::is_none")]
    pub viscous_friction_n_s_per_m: Option<f64>,
}

impl AxisKeys {
    /// Rotary or linear, where the file says it.
    pub fn stated(&self) -> Option<Motion> {
        let constants = [self.force_constant_n_per_a, self.mass_kg, self.viscous_friction_n_s_per_m];
        self.motion.or(constants.iter().any(Option::is_some).then_some(Motion::Linear))
    }
}

impl NominalMotor {
    /// In the order of [`MotorParameters::named`](motorbench_model::motor::MotorParameters::named).
    pub fn values(&self) -> [Option<f64>; 5] {
        [
            self.resistance_ohm,
            self.inductance_h,
            self.torque_constant_nm_per_a,
            self.inertia_kg_m2,
            self.viscous_friction_nm_s,
        ]
    }

    /// All five constants.
    ///
    /// # Errors
    /// The first missing constant, by its name in the file.
    pub fn parameters(&self) -> Result<MotorParameters, MissingConstant> {
        let given = |name, value: Option<f64>| value.ok_or(MissingConstant(name));
        Ok(MotorParameters {
            resistance_ohm: given("resistance_ohm", self.resistance_ohm)?,
            inductance_h: given("inductance_H", self.inductance_h)?,
            torque_constant_nm_per_a: given("torque_constant_Nm_per_A", self.torque_constant_nm_per_a)?,
            inertia_kg_m2: given("inertia_kg_m2", self.inertia_kg_m2)?,
            viscous_friction_nm_s: given("viscous_friction_Nm_s", self.viscous_friction_nm_s)?,
        })
    }
}

impl From<MotorParameters> for NominalMotor {
    fn from(motor: MotorParameters) -> Self {
        Self {
            resistance_ohm: Some(motor.resistance_ohm),
            inductance_h: Some(motor.inductance_h),
            torque_constant_nm_per_a: Some(motor.torque_constant_nm_per_a),
            inertia_kg_m2: Some(motor.inertia_kg_m2),
            viscous_friction_nm_s: Some(motor.viscous_friction_nm_s),
        }
    }
}

impl Rig {
    /// The nominal constants, those of a linear axis in the places of a motor's.
    pub fn nominal(&self) -> NominalMotor {
        match self.axis.stated() {
            Some(Motion::Linear) => NominalMotor {
                torque_constant_nm_per_a: self.axis.force_constant_n_per_a,
                inertia_kg_m2: self.axis.mass_kg,
                viscous_friction_nm_s: self.axis.viscous_friction_n_s_per_m,
                ..self.motor
            },
            _ => self.motor,
        }
    }
}

/// A constant of the motor that the file does not give.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("motor.{0} is missing: add it, or identify the motor from a recording")]
pub struct MissingConstant(pub &'static str);

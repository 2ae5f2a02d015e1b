//! What is known of a motor before its data: the rig file, and the extremes of the data.

use super::Fit;
use super::unknowns::TORQUE_CONSTANT;
use crate::configuration::identify::prior::{
    FRICTION_SPREAD, GUESS_SPREAD, LATE_READINGS_S, SCALE_SPREAD, UNKNOWN_FRICTION_SPREAD, USUAL_TIME_CONSTANTS_S,
};
pub use crate::configuration::identify::prior::{GIVEN_DROP_SPREAD_V, NOMINAL_SPREAD};
use crate::dataset::{Dataset, greatest};
use motorbench_data::rig::{Bridge, NominalMotor};
use motorbench_model::Drive;
use motorbench_model::motor::MotorParameters;

/// The prior of the motor.
#[derive(Clone, Debug)]
pub struct Prior {
    /// Most plausible values.
    pub motor: MotorParameters,
    /// Standard deviations: of the logarithms of R, L, k and J, and of b in its own unit.
    pub spread: [f64; 5],
    /// What the rig file gave.
    pub nominal: NominalMotor,
    /// The bridge's drop by the rig file, where the data can show one.
    pub bridge_drop_v: Option<f64>,
    /// What the squares of its deviations weigh beside the squares of the residuals: the mean square of the residuals over the
    /// share of them that is independent; 1 where they are noise.
    pub weight: f64,
}

/// How late a speed is read after its command: one standard deviation of what the rows leave open.
pub fn lateness_s(data: &Dataset) -> f64 {
    // A command may act anywhere in the first half of its row.
    let command_s = if data.origin.timing.command_delay_s.is_some() { 0.0 } else { 0.5 * data.interval_s };
    let of_readings_s = if data.origin.late_readings.is_some() { LATE_READINGS_S } else { 0.0 };
    uniform_deviation(command_s.hypot(data.interval_s)).hypot(of_readings_s)
}

/// Standard deviation of a uniform distribution over this width.
pub fn uniform_deviation(width: f64) -> f64 {
    width / 12.0_f64.sqrt()
}

impl Prior {
    /// From nominal values, and from the extremes of the data where there are none.
    pub fn new(nominal: &NominalMotor, data: &Dataset) -> Self {
        match data.axis.drive {
            Drive::Voltage => Self::behind_a_voltage(nominal, data),
            Drive::Current | Drive::Torque => Self::behind_an_imposed_current(nominal, data),
        }
    }

    fn behind_a_voltage(nominal: &NominalMotor, data: &Dataset) -> Self {
        let voltage_v = greatest(&data.command);
        let speed = greatest(&data.motion().values).max(1e-9);
        let k = nominal.torque_constant_nm_per_a.unwrap_or(0.9 * voltage_v / speed);
        let peak_a = data.current().map(|current| greatest(&current.values));
        let r = nominal.resistance_ohm.unwrap_or_else(|| voltage_v / peak_a.unwrap_or(1.0).max(1e-6));
        let (mechanical_s, electrical_s) = USUAL_TIME_CONSTANTS_S;
        let motor = MotorParameters {
            resistance_ohm: r,
            inductance_h: nominal.inductance_h.unwrap_or(electrical_s * r),
            torque_constant_nm_per_a: k,
            inertia_kg_m2: nominal.inertia_kg_m2.unwrap_or(mechanical_s * k * k / r),
            viscous_friction_nm_s: nominal.viscous_friction_nm_s.unwrap_or(0.02 * k * k / r),
        };
        let spread = |given: Option<f64>| if given.is_some() { NOMINAL_SPREAD } else { GUESS_SPREAD };
        // Derived from the resistance, which without a current is an estimate itself.
        let is_scale_known = peak_a.is_some() || nominal.resistance_ohm.is_some();
        let of_scale = if is_scale_known { 0.0 } else { SCALE_SPREAD };
        let scaled = |given: Option<f64>| spread(given).hypot(if given.is_some() { 0.0 } else { of_scale });
        let friction = if nominal.viscous_friction_nm_s.is_some() { FRICTION_SPREAD } else { UNKNOWN_FRICTION_SPREAD };
        // Without a current the inductance shows as a lateness of the speed, and the rows leave that open.
        let of_lateness = match peak_a {
            Some(_) => 0.0,
            None => lateness_s(data) * motor.resistance_ohm / motor.inductance_h,
        };
        Self {
            motor,
            spread: [
                scaled(nominal.resistance_ohm),
                scaled(nominal.inductance_h).hypot(of_lateness),
                spread(nominal.torque_constant_nm_per_a),
                scaled(nominal.inertia_kg_m2),
                friction * motor.viscous_friction_nm_s.max(0.005 * k * k / r),
            ],
            nominal: *nominal,
            bridge_drop_v: None,
            weight: 1.0,
        }
    }

    /// Without a winding: the constants of one are there for the form's sake, and no fit moves them. Without a torque constant
    /// all torques are in amperes, and nominal values in newton metres say nothing.
    fn behind_an_imposed_current(nominal: &NominalMotor, data: &Dataset) -> Self {
        let k = nominal.torque_constant_nm_per_a.filter(|_| data.axis.drive.has_constant(TORQUE_CONSTANT));
        let is_in_amperes = data.axis.drive == Drive::Current && k.is_none();
        let nominal = if is_in_amperes { &NominalMotor::default() } else { nominal };
        let torque_nm = k.unwrap_or(1.0) * greatest(&data.command).max(f64::MIN_POSITIVE);
        let speed = greatest(&data.motion().values).max(1e-9);
        let motor = MotorParameters {
            resistance_ohm: 1.0,
            inductance_h: 1.0,
            torque_constant_nm_per_a: k.unwrap_or(1.0),
            inertia_kg_m2: nominal.inertia_kg_m2.unwrap_or(USUAL_TIME_CONSTANTS_S.0 * torque_nm / speed),
            viscous_friction_nm_s: nominal.viscous_friction_nm_s.unwrap_or(0.02 * torque_nm / speed),
        };
        let inertia = if nominal.inertia_kg_m2.is_some() { NOMINAL_SPREAD } else { GUESS_SPREAD };
        let friction = if nominal.viscous_friction_nm_s.is_some() { FRICTION_SPREAD } else { 10.0 };
        let least = 0.005 * torque_nm / speed;
        Self {
            motor,
            spread: [
                NOMINAL_SPREAD,
                NOMINAL_SPREAD,
                NOMINAL_SPREAD,
                inertia,
                friction * motor.viscous_friction_nm_s.max(least),
            ],
            nominal: NominalMotor {
                torque_constant_nm_per_a: k,
                inertia_kg_m2: nominal.inertia_kg_m2,
                viscous_friction_nm_s: nominal.viscous_friction_nm_s,
                ..NominalMotor::default()
            },
            bridge_drop_v: None,
            weight: 1.0,
        }
    }

    /// The same beside the residuals of a fit. What a model lacks makes them large and alike over many rows: counted as so many
    /// readings, they would outweigh every nominal value.
    pub fn beside(&self, found: &Fit, data: &Dataset) -> Self {
        Self { weight: found.square_of_independent(data).max(1.0), ..self.clone() }
    }

    /// The same with a bridge by its data sheet.
    pub fn with_bridge(self, bridge: &Bridge, data: &Dataset) -> Self {
        let can_show_one = data.axis.drive.is_voltage() && !data.has_one_magnitude();
        Self { bridge_drop_v: bridge.drop_v.filter(|_| can_show_one), ..self }
    }
}

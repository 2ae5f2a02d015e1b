//! The motor as a linear system.
//!
//! ```text
//! w(s)/U(s)     =  k      / D(s)        D(s) = J L s^2 + (J R + L b) s + (R b + k^2)
//! I(s)/U(s)     = (J s+b) / D(s)
//! theta(s)/U(s) =  k      / (s D(s))
//! ```

use super::{Matrix, state_space::StateSpace, transfer_function::TransferFunction};
use crate::motor::MotorParameters;

/// The two time constants a data sheet gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeConstants {
    /// `J R / k^2`: of the speed, if the armature had no inductance and the shaft no friction.
    pub electromechanical_s: f64,
    /// `L / R`: of the current at a blocked shaft.
    pub electromagnetic_s: f64,
}

impl TimeConstants {
    /// Of a motor.
    pub fn of(motor: &MotorParameters) -> Self {
        let k = motor.torque_constant_nm_per_a;
        Self {
            electromechanical_s: motor.inertia_kg_m2 * motor.resistance_ohm / (k * k),
            electromagnetic_s: motor.inductance_h / motor.resistance_ohm,
        }
    }
}

/// States and outputs (speed, current), input voltage.
pub fn armature(motor: &MotorParameters) -> StateSpace {
    let MotorParameters { resistance_ohm: r, inductance_h: l, torque_constant_nm_per_a: k, .. } = *motor;
    let (j, b) = (motor.inertia_kg_m2, motor.viscous_friction_nm_s);
    StateSpace {
        a: Matrix::from_row_slice(2, 2, &[-b / j, k / j, -k / l, -r / l]),
        b: Matrix::from_row_slice(2, 1, &[0.0, 1.0 / l]),
        c: Matrix::identity(2, 2),
    }
}

/// Speed over voltage, rad/s per volt.
pub fn speed(motor: &MotorParameters) -> TransferFunction {
    TransferFunction { numerator: vec![motor.torque_constant_nm_per_a], denominator: denominator(motor) }
}

/// Current over voltage, amperes per volt.
pub fn current(motor: &MotorParameters) -> TransferFunction {
    TransferFunction {
        numerator: vec![motor.inertia_kg_m2, motor.viscous_friction_nm_s],
        denominator: denominator(motor),
    }
}

/// Angle over voltage, radians per volt.
pub fn angle(motor: &MotorParameters) -> TransferFunction {
    let mut speed = speed(motor);
    speed.denominator.push(0.0);
    speed
}

fn denominator(motor: &MotorParameters) -> Vec<f64> {
    let MotorParameters { resistance_ohm: r, inductance_h: l, torque_constant_nm_per_a: k, .. } = *motor;
    let (j, b) = (motor.inertia_kg_m2, motor.viscous_friction_nm_s);
    vec![j * l, j * r + l * b, r * b + k * k]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Complex;

    #[test]
    fn the_papers_motor_has_the_time_constants_of_its_data_sheet() {
        let motor = MotorParameters::PIVT6;
        let constants = TimeConstants::of(&motor);
        assert!((constants.electromechanical_s - 25e-3).abs() < 1e-12, "{constants:?}");
        assert!((constants.electromagnetic_s - 2e-3).abs() < 1e-12, "{constants:?}");
        // What they imply.
        assert!((motor.inertia_kg_m2 - 2.22e-5).abs() < 0.005e-5, "{motor:?}");
        assert!((motor.inductance_h - 11.7e-3).abs() < 0.05e-3, "{motor:?}");
        // The exact poles: both time constants are shifted by each other, and a little by friction.
        let stiffening = 1.0 + 5.84 * 5e-6 / (0.072 * 0.072);
        let sum_s = (25e-3 + 2e-3 * (stiffening - 1.0)) / stiffening;
        let poles = speed(&motor).poles();
        let (slow_s, fast_s) = (-1.0 / poles[0].re, -1.0 / poles[1].re);
        assert!(
            (slow_s + fast_s - sum_s).abs() < 1e-9 && (slow_s * fast_s - 50e-6 / stiffening).abs() < 1e-12,
            "{poles:?}"
        );
    }

    #[test]
    fn matrices_and_polynomials_are_the_same_system() {
        let motor = MotorParameters::PIVT6;
        for omega in [0.1, 10.0, 1e3, 1e5] {
            let s = Complex::new(0.0, omega);
            let matrices = armature(&motor).at(s).unwrap();
            for (value, polynomials) in matrices.iter().zip([speed(&motor), current(&motor)]) {
                assert!((value / polynomials.at(s) - 1.0).norm() < 1e-9);
            }
            assert!((angle(&motor).at(s) * s / speed(&motor).at(s) - 1.0).norm() < 1e-9);
        }
    }
}

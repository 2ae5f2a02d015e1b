//! An estimate of the current where it is not measured: a Kalman filter in steady state, from speed and voltage.
//!
//! ```text
//! x(k+1) = A x(k) + B u(k) + w(k)        y(k) = C x(k) + v(k)
//! estimate(k|k) = estimate(k|k-1) + M (y(k) - C estimate(k|k-1))
//! estimate(k+1|k) = A estimate(k|k) + B u(k)
//! ```
//! `x` is speed, current, the voltages on their way and the measured speed `y`, as [`motor_seen`] has them; `w` (a voltage
//! and a torque that the model does not know) and `v` are white. The core has no observer: this one tells what it would
//! be worth.

use super::sampled_loop::{SpeedPath, motor_seen};
use crate::linear::Matrix;
use crate::linear::riccati::{self, NoSolution};
use crate::linear::state_space::Discrete;
use crate::motor::MotorParameters;

/// Standard deviations of what the model does not know, relative to each other, as voltages: in the armature, as the
/// torque that a voltage brings about at standstill, and as the back-EMF of the measured speed's error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknown {
    /// In the armature.
    pub voltage: f64,
    /// At the shaft.
    pub torque: f64,
    /// In the measurement.
    pub speed: f64,
}

/// The observer as a system of its own: `z(k+1) = A z(k) + b u(k) + g y(k)`, `current(k) = c z(k) + d y(k)`.
#[derive(Clone, Debug, PartialEq)]
pub struct CurrentObserver {
    /// `A`; `z` is the estimate of [`motor_seen`]'s states before the measurement.
    pub a: Matrix,
    /// `b`, one column.
    pub of_voltage: Matrix,
    /// `g`, one column.
    pub of_speed: Matrix,
    /// `c`, one row.
    pub current: Matrix,
    /// `d`, in amperes per rad/s.
    pub direct: f64,
}

impl CurrentObserver {
    /// For a motor whose speed is measured by `speed` once in `period_s`.
    ///
    /// # Errors
    /// [`NoSolution`] if the current does not show in the speed.
    pub fn new(
        motor: &MotorParameters,
        period_s: f64,
        speed: SpeedPath,
        unknown: &Unknown,
    ) -> Result<Self, NoSolution> {
        let system = motor_seen(motor, period_s, speed);
        let (a, b, c) = (&system.a, &system.b, &system.c);
        let states = a.nrows();
        // What a volt that acts for the whole tick does, and a torque: on the mean over the tick by half, on a conversion
        // that is as old as the tick not at all.
        let mut voltage = a.column(2) + b.column(0);
        voltage[2] = 0.0;
        let per_volt = motor.torque_constant_nm_per_a / motor.resistance_ohm / motor.inertia_kg_m2 * period_s;
        let mut torque = nalgebra::DVector::zeros(states);
        torque[0] = per_volt;
        if speed == SpeedPath::Mean {
            torque[states - 1] = 0.5 * per_volt;
        }
        let scatter = unknown.speed / motor.torque_constant_nm_per_a;
        let process = unknown.voltage.powi(2) * &voltage * voltage.transpose()
            + unknown.torque.powi(2) * &torque * torque.transpose();
        let gain = kalman_gain(&system, &process, &Matrix::from_element(1, 1, scatter * scatter))?;
        let corrected = Matrix::identity(states, states) - &gain * c;
        Ok(Self {
            a: a * &corrected,
            of_voltage: b.clone(),
            of_speed: a * &gain,
            current: corrected.rows(1, 1).into_owned(),
            direct: gain[(1, 0)],
        })
    }
}

/// `M` (states x outputs) of a system whose outputs are measured, by the dual Riccati equation.
///
/// # Errors
/// [`NoSolution`] if an unstable mode does not show in the outputs, or `measurement` is singular.
pub fn kalman_gain(system: &Discrete, process: &Matrix, measurement: &Matrix) -> Result<Matrix, NoSolution> {
    let (a, c) = (&system.a, &system.c);
    let covariance = riccati::solve(&a.transpose(), &c.transpose(), process, measurement)?;
    let innovation = c * &covariance * c.transpose() + measurement;
    Ok(innovation.lu().solve(&(c * covariance)).ok_or(NoSolution)?.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::spectral_radius;

    /// The scalar filter in closed form: `p = a^2 p r / (p + r) + q` with `a = q = r = 1` is the golden ratio.
    #[test]
    fn the_gain_of_a_random_walk_is_the_golden_section() {
        let one = Matrix::identity(1, 1);
        let walk = Discrete { a: one.clone(), b: one.clone(), c: one.clone(), period_s: 1.0 };
        let gain = kalman_gain(&walk, &one, &one).unwrap()[(0, 0)];
        assert!((gain - 0.5 * (5.0_f64.sqrt() - 1.0)).abs() < 1e-12, "{gain}");
    }

    /// From a wrong start, and with the motor driven to and fro, the estimate comes to the motor's own current.
    #[test]
    fn the_current_follows_from_speed_and_voltage() {
        let motor = MotorParameters::PIVT6;
        let system = motor_seen(&motor, 1e-3, SpeedPath::Mean);
        for (voltage, torque) in [(1.0, 0.1), (0.1, 1.0)] {
            let unknown = Unknown { voltage, torque, speed: 0.1 };
            let observer = CurrentObserver::new(&motor, 1e-3, SpeedPath::Mean, &unknown).unwrap();
            assert!(spectral_radius(&observer.a) < 0.99);
            let mut x = nalgebra::DVector::zeros(system.a.nrows());
            let mut z = nalgebra::DVector::repeat(x.len(), 3.0);
            let mut largest = 0.0_f64;
            for tick in 0..600 {
                let speed = (&system.c * &x)[0];
                let current = (&observer.current * &z)[0] + observer.direct * speed;
                let u = if tick / 20 % 2 == 0 { 6.0 } else { -4.0 };
                if tick > 500 {
                    assert!((current - x[1]).abs() < 1e-3, "{tick}: {current} A for {} A", x[1]);
                    largest = largest.max(x[1].abs());
                }
                z = &observer.a * z + &observer.of_voltage * u + &observer.of_speed * speed;
                x = &system.a * x + &system.b * u;
            }
            assert!(largest > 0.5, "{largest}");
        }
    }

    #[test]
    fn what_grows_unseen_cannot_be_observed() {
        let system = Discrete {
            a: Matrix::from_diagonal(&nalgebra::dvector![0.5, 1.1]),
            b: Matrix::zeros(2, 1),
            c: Matrix::from_row_slice(1, 2, &[1.0, 0.0]),
            period_s: 1.0,
        };
        assert!(kalman_gain(&system, &Matrix::identity(2, 2), &Matrix::identity(1, 1)).is_err());
    }
}

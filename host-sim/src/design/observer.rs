//! A Kalman filter in steady state: an estimate of states that are not measured.
//!
//! ```text
//! x(k+1) = A x(k) + B u(k) + w(k)        y(k) = C x(k) + v(k)
//! estimate(k|k) = estimate(k|k-1) + M (y(k) - C estimate(k|k-1))
//! estimate(k+1|k) = A estimate(k|k) + B u(k)
//! ```
//! `w` and `v` are white with covariances `W` and `V`. The core has no observer (it measures the current); this one is
//! for a rig without a current sensor, and for the host.

use crate::linear::riccati::{self, NoSolution};
use crate::linear::state_space::Discrete;
use crate::linear::{Matrix, eigenvalues};
use nalgebra::Complex;

/// A designed observer.
#[derive(Clone, Debug, PartialEq)]
pub struct Observer {
    /// `M`: states x outputs.
    pub gain: Matrix,
    /// Covariance of the error before the measurement is used.
    pub error_covariance: Matrix,
    system: Discrete,
}

impl Observer {
    /// The gain for a system whose outputs are measured, by the dual Riccati equation.
    ///
    /// # Errors
    /// [`NoSolution`] if an unstable mode does not show in the outputs, or `measurement_noise` is singular.
    pub fn design(system: &Discrete, process_noise: &Matrix, measurement_noise: &Matrix) -> Result<Self, NoSolution> {
        let (a, c) = (&system.a, &system.c);
        let covariance = riccati::solve(&a.transpose(), &c.transpose(), process_noise, measurement_noise)?;
        let innovation = c * &covariance * c.transpose() + measurement_noise;
        let gain = innovation.lu().solve(&(c * &covariance)).ok_or(NoSolution)?.transpose();
        Ok(Self { gain, error_covariance: covariance, system: system.clone() })
    }

    /// Eigenvalues of the error's dynamics.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        let Discrete { a, c, .. } = &self.system;
        eigenvalues(&(a - a * &self.gain * c))
    }

    /// One sample: from the estimate before the measurement to the estimate with it, and the prediction for the next
    /// sample. Columns: estimate, measurement, input.
    pub fn step(&self, predicted: &Matrix, measured: &Matrix, input: &Matrix) -> (Matrix, Matrix) {
        let Discrete { a, b, c, .. } = &self.system;
        let estimate = predicted + &self.gain * (measured - c * predicted);
        let next = a * &estimate + b * input;
        (estimate, next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::motor_model::armature;
    use crate::motor::MotorParameters;

    /// The speed of the PIVT-6 alone shows its current, from a wrong start, within a few electrical time constants.
    #[test]
    fn the_current_follows_from_the_speed() {
        let mut motor = armature(&MotorParameters::PIVT6);
        motor.c = Matrix::from_row_slice(1, 2, &[1.0, 0.0]);
        let system = motor.discretise(1e-3, 0.0);
        let process = Matrix::from_diagonal(&nalgebra::dvector![0.1, 1e-3]);
        let observer = Observer::design(&system, &process, &Matrix::identity(1, 1)).unwrap();
        assert!(observer.poles().iter().all(|pole| pole.norm() < 0.99), "{:?}", observer.poles());
        let (mut truth, mut predicted) = (Matrix::zeros(2, 1), Matrix::from_column_slice(2, 1, &[30.0, -2.0]));
        let input = Matrix::from_element(1, 1, 6.0);
        let mut estimate = predicted.clone();
        for _ in 0..60 {
            let measured = &system.c * &truth;
            (estimate, predicted) = observer.step(&predicted, &measured, &input);
            truth = &system.a * truth + &system.b * &input;
        }
        let last = system.a.clone().try_inverse().unwrap() * (&truth - &system.b * &input);
        assert!((estimate[(1, 0)] - last[(1, 0)]).abs() < 0.01, "{estimate} {last}");
    }

    #[test]
    fn what_does_not_show_cannot_be_observed() {
        let mut integrators = armature(&MotorParameters::PIVT6);
        integrators.a.fill(0.0);
        integrators.c = Matrix::from_row_slice(1, 2, &[1.0, 0.0]);
        let system = integrators.discretise(1e-3, 0.0);
        let identity = Matrix::identity(2, 2);
        assert!(Observer::design(&system, &identity, &Matrix::identity(1, 1)).is_err());
    }
}

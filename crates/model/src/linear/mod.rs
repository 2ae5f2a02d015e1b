//! Linear models: state space and transfer functions of the motor, their responses, discrete forms, and the Riccati
//! equation. SI units; angular frequencies in rad/s.
//!
//! | module | what it is |
//! |---|---|
//! | [`motor_model`] | the motor's equations as matrices and transfer functions, its time constants |
//! | [`state_space`] | `x' = A x + B u`, and its discrete form with an input delay |
//! | [`transfer_function`] | ratios of polynomials: poles, zeros, gain |
//! | [`step_response`] | rise time, settling time, overshoot |
//! | [`frequency_response`] | Bode data, bandwidth, stability margins |
//! | [`riccati`] | the discrete algebraic Riccati and Lyapunov equations |

pub mod frequency_response;
pub mod motor_model;
pub mod riccati;
pub mod state_space;
pub mod step_response;
pub mod transfer_function;

use nalgebra::{Complex, DMatrix, linalg::balancing::balance_parlett_reinsch};

/// A real matrix.
pub type Matrix = DMatrix<f64>;

/// Iterations after which the eigenvalues count as not converging; usual are two or three for each.
const MAX_QR_ITERATIONS: usize = 10_000;

/// Eigenvalues by increasing magnitude, conjugates with the negative imaginary part first; empty if the matrix holds
/// something that is not finite.
pub fn eigenvalues(matrix: &Matrix) -> Vec<Complex<f64>> {
    if matrix.iter().any(|value| !value.is_finite()) {
        return Vec::new();
    }
    // States differ by many decades (radians and amperes): unbalanced, the small eigenvalues would drown.
    let mut balanced = matrix.clone();
    balance_parlett_reinsch(&mut balanced);
    let Some(schur) = balanced.try_schur(f64::EPSILON, MAX_QR_ITERATIONS) else { return Vec::new() };
    let mut values: Vec<_> = schur.complex_eigenvalues().iter().copied().collect();
    values.sort_by(|a, b| a.norm().total_cmp(&b.norm()).then(a.im.total_cmp(&b.im)));
    values
}

/// Largest magnitude of an eigenvalue; infinite where there are none to be had.
pub fn spectral_radius(matrix: &Matrix) -> f64 {
    eigenvalues(matrix).last().map_or(f64::INFINITY, |value| value.norm())
}

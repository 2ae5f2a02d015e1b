//! The discrete algebraic Riccati equation, and the Lyapunov equation.

use super::Matrix;

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the Riccati equation has no stabilising solution: an unstable mode cannot be influenced, or is missing in the weights"
)]
pub struct NoSolution;

/// Doublings after which a solution is not expected any more: 2^50 steps of the recursion.
const MAX_DOUBLINGS: usize = 50;
/// Relative change at which the doubling has converged; it converges quadratically, so the next change is its square.
const CONVERGED: f64 = 1e-13;

/// The stabilising solution `X` of `X = A'XA - A'XB (R + B'XB)^-1 B'XA + Q`.
///
/// By the structure-preserving doubling algorithm (Chu, Fan, Lin, Wang, "Structure-preserving algorithms for periodic
/// discrete-time algebraic Riccati equations", 2004).
///
/// # Errors
/// [`NoSolution`].
pub fn solve(a: &Matrix, b: &Matrix, q: &Matrix, r: &Matrix) -> Result<Matrix, NoSolution> {
    let identity = Matrix::identity(a.nrows(), a.nrows());
    let mut a = a.clone();
    let mut g = b * r.clone().try_inverse().ok_or(NoSolution)? * b.transpose();
    let mut h = q.clone();
    for _ in 0..MAX_DOUBLINGS {
        let inverse = (&identity + &g * &h).try_inverse().ok_or(NoSolution)?;
        let a_inverse = &a * &inverse;
        let change = a.transpose() * &h * &inverse * &a;
        g += &a_inverse * &g * a.transpose();
        h += &change;
        a = a_inverse * a;
        // Rounding must not make them lean to one side.
        g = 0.5 * (&g + g.transpose());
        h = 0.5 * (&h + h.transpose());
        if !h.norm().is_finite() {
            return Err(NoSolution);
        }
        if change.norm() <= CONVERGED * h.norm() {
            return Ok(h);
        }
    }
    Err(NoSolution)
}

/// The state feedback `u = -K x` that the solution stands for: `K = (R + B'XB)^-1 B'XA`.
///
/// # Errors
/// [`NoSolution`].
pub fn feedback(a: &Matrix, b: &Matrix, q: &Matrix, r: &Matrix) -> Result<Matrix, NoSolution> {
    let x = solve(a, b, q, r)?;
    let weight = r + b.transpose() * &x * b;
    weight.lu().solve(&(b.transpose() * x * a)).ok_or(NoSolution)
}

/// `X = A X A' + Q`, by squaring; `None` unless every eigenvalue of `A` lies within the unit circle.
pub fn lyapunov(a: &Matrix, q: &Matrix) -> Option<Matrix> {
    let (mut power, mut x) = (a.clone(), q.clone());
    for _ in 0..MAX_DOUBLINGS {
        let change = &power * &x * power.transpose();
        x += &change;
        power = &power * &power;
        let size = x.norm();
        if !size.is_finite() {
            return None;
        }
        if change.norm() <= CONVERGED * size {
            return (power.norm() < 1.0).then_some(x);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scalar_equation_has_its_closed_solution() {
        // x = a^2 x - a^2 x^2 / (1 + x) + 1 with a = 1: x^2 = x + 1.
        let one = Matrix::identity(1, 1);
        let x = solve(&one, &one, &one, &one).unwrap();
        assert!((x[(0, 0)] - (1.0 + 5.0_f64.sqrt()) / 2.0).abs() < 1e-12);
        let sum = lyapunov(&Matrix::from_element(1, 1, 0.5), &one).unwrap();
        assert!((sum[(0, 0)] - 4.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn an_unstable_mode_out_of_reach_has_no_solution() {
        let a = Matrix::from_diagonal(&nalgebra::dvector![1.1, 0.5]);
        let b = Matrix::from_column_slice(2, 1, &[0.0, 1.0]);
        let identity = Matrix::identity(2, 2);
        assert_eq!(solve(&a, &b, &identity, &Matrix::identity(1, 1)), Err(NoSolution));
        assert_eq!(lyapunov(&a, &identity), None);
    }
}

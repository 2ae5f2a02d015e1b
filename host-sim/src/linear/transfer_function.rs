//! Ratios of polynomials in `s`.

use super::{Matrix, eigenvalues, state_space::StateSpace};
use nalgebra::Complex;
use std::fmt;

/// `numerator(s) / denominator(s)`, coefficients from the highest power down.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    /// Coefficients of the numerator; degree below the denominator's.
    pub numerator: Vec<f64>,
    /// Coefficients of the denominator; the first is not zero.
    pub denominator: Vec<f64>,
}

impl TransferFunction {
    /// The value at `s`.
    pub fn at(&self, s: Complex<f64>) -> Complex<f64> {
        polynomial(&self.numerator, s) / polynomial(&self.denominator, s)
    }

    /// Roots of the denominator, by increasing magnitude.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        roots(&self.denominator)
    }

    /// Roots of the numerator, by increasing magnitude.
    pub fn zeros(&self) -> Vec<Complex<f64>> {
        roots(&self.numerator)
    }

    /// The value at zero frequency; infinite behind an integrator.
    pub fn dc_gain(&self) -> f64 {
        self.numerator[self.numerator.len() - 1] / self.denominator[self.denominator.len() - 1]
    }

    /// The controllable canonical form.
    pub fn state_space(&self) -> StateSpace {
        let order = self.denominator.len() - 1;
        let leading = self.denominator[0];
        let offset = order - self.numerator.len();
        StateSpace {
            a: Matrix::from_fn(order, order, |row, column| match row {
                0 => -self.denominator[column + 1] / leading,
                _ => f64::from(u8::from(row == column + 1)),
            }),
            b: Matrix::from_fn(order, 1, |row, _| f64::from(u8::from(row == 0))),
            c: Matrix::from_fn(1, order, |_, column| {
                column.checked_sub(offset).map_or(0.0, |at| self.numerator[at] / leading)
            }),
        }
    }
}

fn polynomial(coefficients: &[f64], s: Complex<f64>) -> Complex<f64> {
    coefficients.iter().fold(Complex::new(0.0, 0.0), |sum, &coefficient| sum * s + coefficient)
}

/// Eigenvalues of the companion matrix.
fn roots(coefficients: &[f64]) -> Vec<Complex<f64>> {
    let degree = coefficients.len() - 1;
    if degree == 0 {
        return Vec::new();
    }
    eigenvalues(&Matrix::from_fn(degree, degree, |row, column| match row {
        0 => -coefficients[column + 1] / coefficients[0],
        _ => f64::from(u8::from(row == column + 1)),
    }))
}

impl fmt::Display for TransferFunction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let print = |coefficients: &[f64]| {
            let degree = coefficients.len() - 1;
            let terms = coefficients.iter().enumerate().filter(|(_, value)| **value != 0.0);
            let terms: Vec<_> = terms
                .map(|(index, value)| match degree - index {
                    0 => format!("{value:.4e}"),
                    1 => format!("{value:.4e} s"),
                    power => format!("{value:.4e} s^{power}"),
                })
                .collect();
            terms.join(" + ")
        };
        write!(f, "({}) / ({})", print(&self.numerator), print(&self.denominator))
    }
}

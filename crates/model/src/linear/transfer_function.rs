//! Ratios of polynomials in `s`, or of sampled systems in `z`.

use super::state_space::{Discrete, StateSpace};
use super::{Matrix, eigenvalues};
use nalgebra::Complex;
use std::fmt;

/// `numerator(s) / denominator(s)`, coefficients from the highest power down. Of a sampled system the variable is `z`.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    /// Coefficients of the numerator; degree below the denominator's.
    pub numerator: Vec<f64>,
    /// Coefficients of the denominator; the first is not zero.
    pub denominator: Vec<f64>,
}

impl TransferFunction {
    /// From the input to an output of a sampled system with one input, in `z`.
    pub fn sampled(system: &Discrete, output: usize) -> Self {
        let denominator = eigenvalues(&system.a).iter().fold(vec![Complex::new(1.0, 0.0)], |product, root| {
            let shifted = product.iter().copied().chain([Complex::new(0.0, 0.0)]);
            let times_root = [Complex::new(0.0, 0.0)].into_iter().chain(product.iter().map(|value| value * root));
            shifted.zip(times_root).map(|(shifted, times_root)| shifted - times_root).collect()
        });
        // Of roots at zero, where a delay is waited for, rounding leaves a little.
        let real = |value: &Complex<f64>| if value.re.abs() < ROUNDING { 0.0 } else { value.re };
        let denominator: Vec<f64> = denominator.iter().map(real).collect();
        // The impulse response is the series of the quotient: C B, C A B, C A^2 B, ...
        let (c, mut x) = (system.c.row(output), system.b.column(0).into_owned());
        let mut impulse = Vec::new();
        for _ in 1..denominator.len() {
            impulse.push((c * &x)[0]);
            x = &system.a * x;
        }
        let coefficient = |power: usize| (0..=power).map(|at| denominator[at] * impulse[power - at]).sum();
        Self { numerator: (0..impulse.len()).map(coefficient).collect(), denominator }
    }

    /// In a variable of this name. In `z` the poles lie close to 1, and what tells them apart in the last digits.
    pub fn text(&self, variable: &str) -> String {
        let decimals = if variable == "z" { 11 } else { 4 };
        let print = |coefficients: &[f64]| {
            let powers = coefficients.iter().zip((0..coefficients.len()).rev());
            let terms = powers.filter(|(value, _)| **value != 0.0).map(|(value, power)| match power {
                0 => format!("{value:.decimals$e}"),
                1 => format!("{value:.decimals$e} {variable}"),
                power => format!("{value:.decimals$e} {variable}^{power}"),
            });
            terms.collect::<Vec<_>>().join(" + ").replace("+ -", "- ")
        };
        format!("({}) / ({})", print(&self.numerator), print(&self.denominator))
    }

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

/// Coefficients of a monic polynomial with roots within the unit circle that stand for nothing.
const ROUNDING: f64 = 1e-13;

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
        f.write_str(&self.text("s"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::motor_model;
    use crate::motor::MotorParameters;

    /// A first-order lag by hand; the motor against its own matrices, with an input that comes late.
    #[test]
    fn sampled_forms() {
        let lag = TransferFunction { numerator: vec![3.0], denominator: vec![0.02, 1.0] };
        let sampled = TransferFunction::sampled(&lag.state_space().discretise(1e-3, 0.0), 0);
        let left = (-1e-3_f64 / 0.02).exp();
        assert!((sampled.denominator[1] + left).abs() < 1e-14, "{sampled:?}");
        assert!((sampled.numerator[0] - 3.0 * (1.0 - left)).abs() < 1e-14, "{sampled:?}");
        assert_eq!(sampled.text("z").matches('z').count(), 1);
        for (motor, delay_s) in [(MotorParameters::PIVT6, 0.0), (MotorParameters::PIVT6, 1.2e-3)] {
            let system = motor_model::armature(&motor).discretise(1e-3, delay_s);
            for output in 0..2 {
                let sampled = TransferFunction::sampled(&system, output);
                for omega in [1.0, 40.0, 900.0, 3000.0] {
                    let expected = system.at(omega).unwrap()[(output, 0)];
                    let found = sampled.at(Complex::from_polar(1.0, omega * 1e-3));
                    assert!((found / expected - 1.0).norm() < 1e-9, "{output} {omega}: {found} {expected}");
                }
            }
        }
    }
}

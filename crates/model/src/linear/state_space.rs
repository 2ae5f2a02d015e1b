//! State space, continuous and discrete.

use super::{Matrix, eigenvalues, spectral_radius};
use nalgebra::Complex;

/// `x' = A x + B u`, `y = C x`.
#[derive(Clone, Debug, PartialEq)]
pub struct StateSpace {
    /// n x n.
    pub a: Matrix,
    /// n x inputs.
    pub b: Matrix,
    /// outputs x n.
    pub c: Matrix,
}

/// `x(k+1) = A x(k) + B u(k)`, `y(k) = C x(k)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Discrete {
    /// n x n.
    pub a: Matrix,
    /// n x inputs.
    pub b: Matrix,
    /// outputs x n.
    pub c: Matrix,
    /// Time between two samples, in seconds.
    pub period_s: f64,
}

impl StateSpace {
    /// Eigenvalues of `A`, in rad/s.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        eigenvalues(&self.a)
    }

    /// `C (s I - A)^-1 B`; `None` at a pole.
    pub fn at(&self, s: Complex<f64>) -> Option<nalgebra::DMatrix<Complex<f64>>> {
        resolvent(&self.a, &self.b, &self.c, s)
    }

    /// What an input that is held between samples (zero-order hold) makes of the system, when the input takes effect
    /// `delay_s` (not negative) after its sample. Exact.
    ///
    /// The states are followed by the inputs that are still on their way, the oldest first.
    pub fn discretise(&self, period_s: f64, delay_s: f64) -> Discrete {
        let (states, inputs) = (self.a.nrows(), self.b.ncols());
        let whole = (delay_s / period_s).floor();
        let part_s = delay_s - whole * period_s;
        let late = usize::from(part_s > 0.0);
        let waiting = whole as usize + late;
        let (phi, _) = self.hold(period_s);
        let (phi_new, gamma_new) = self.hold(period_s - part_s);
        let (_, gamma_old) = self.hold(part_s);
        let size = states + waiting * inputs;
        let (mut a, mut b) = (Matrix::zeros(size, size), Matrix::zeros(size, inputs));
        a.view_mut((0, 0), (states, states)).copy_from(&phi);
        // Of the inputs in order of age (those waiting, then the present one) the first `late + 1` act in this period.
        let mut acts = |age: usize, gamma: Matrix| {
            if age < waiting {
                a.view_mut((0, states + age * inputs), (states, inputs)).copy_from(&gamma);
            } else {
                b.view_mut((0, 0), (states, inputs)).copy_from(&gamma);
            }
        };
        if late == 1 {
            acts(0, phi_new * gamma_old);
        }
        acts(late, gamma_new);
        for place in 0..waiting {
            let mut next = if place + 1 < waiting {
                a.view_mut((states + place * inputs, states + (place + 1) * inputs), (inputs, inputs))
            } else {
                b.view_mut((states + place * inputs, 0), (inputs, inputs))
            };
            next.fill_with_identity();
        }
        let mut c = Matrix::zeros(self.c.nrows(), size);
        c.view_mut((0, 0), (self.c.nrows(), states)).copy_from(&self.c);
        Discrete { a, b, c, period_s }
    }

    /// `exp(A t)`, and its integral times `B`.
    fn hold(&self, t: f64) -> (Matrix, Matrix) {
        let (states, inputs) = (self.a.nrows(), self.b.ncols());
        let mut block = Matrix::zeros(states + inputs, states + inputs);
        block.view_mut((0, 0), (states, states)).copy_from(&self.a);
        block.view_mut((0, states), (states, inputs)).copy_from(&self.b);
        let exponential = (block * t).exp();
        (
            exponential.view((0, 0), (states, states)).into_owned(),
            exponential.view((0, states), (states, inputs)).into_owned(),
        )
    }
}

impl Discrete {
    /// Eigenvalues of `A`.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        eigenvalues(&self.a)
    }

    /// Whether every eigenvalue lies within the unit circle.
    pub fn is_stable(&self) -> bool {
        spectral_radius(&self.a) < 1.0
    }

    /// The frequency response at `omega_rad_per_s`, below `pi / period_s`; `None` at a pole.
    pub fn at(&self, omega_rad_per_s: f64) -> Option<nalgebra::DMatrix<Complex<f64>>> {
        resolvent(&self.a, &self.b, &self.c, Complex::from_polar(1.0, omega_rad_per_s * self.period_s))
    }

    /// The outputs from rest at the first `samples` instants, with the first input at 1 from instant zero on; a row
    /// an output.
    pub fn step_response(&self, samples: usize) -> Matrix {
        let mut x = nalgebra::DVector::zeros(self.a.nrows());
        let input = self.b.column(0).into_owned();
        let mut outputs = Matrix::zeros(self.c.nrows(), samples);
        for k in 0..samples {
            outputs.set_column(k, &(&self.c * &x));
            x = &self.a * x + &input;
        }
        outputs
    }
}

fn resolvent(a: &Matrix, b: &Matrix, c: &Matrix, at: Complex<f64>) -> Option<nalgebra::DMatrix<Complex<f64>>> {
    let complex = |matrix: &Matrix| matrix.map(|value| Complex::new(value, 0.0));
    let mut system = -complex(a);
    for i in 0..a.nrows() {
        system[(i, i)] += at;
    }
    Some(complex(c) * system.lu().solve(&complex(b))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An integrator with the input 2.25 periods late: the step arrives a quarter into the third period.
    #[test]
    fn a_delay_of_any_length_shifts_the_step() {
        let one = Matrix::identity(1, 1);
        let integrator = StateSpace { a: Matrix::zeros(1, 1), b: one.clone(), c: one };
        for (delay_s, expected) in [
            (0.0, [0.0, 1.0, 2.0, 3.0, 4.0]),
            (0.25, [0.0, 0.75, 1.75, 2.75, 3.75]),
            (1.0, [0.0, 0.0, 1.0, 2.0, 3.0]),
            (2.25, [0.0, 0.0, 0.0, 0.75, 1.75]),
        ] {
            let response = integrator.discretise(1.0, delay_s).step_response(5);
            for (y, expected) in response.iter().zip(expected) {
                assert!((y - expected).abs() < 1e-12, "{delay_s}: {response}");
            }
        }
    }
}

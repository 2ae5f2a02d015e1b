//! Linear equations of two states with constant inputs in closed form: `x' = A x + u`.
//!
//! By Cayley and Hamilton `A^2 = trace A - determinant`. So the exponential of `A t` and its integrals are all sums of
//! the identity and of `A`. Each has two [`Weights`] that depend on trace, determinant and time alone. They come from
//! Taylor's series. A time that is too long for it is halved until it is short, and the result is doubled again.

/// Largest product of rate and time for the series: what follows its last term is below 1e-15.
const SHORT: f64 = 0.1;
const TERMS: usize = 8;

/// A column of two.
pub type Vector = [f64; 2];
/// Two by two, row by row.
pub type Matrix = [Vector; 2];

/// Every matrix with one trace and one determinant.
#[derive(Clone, Copy, Debug)]
pub struct Family {
    trace: f64,
    determinant: f64,
    /// Not less than the magnitude of either eigenvalue.
    fastest_per_s: f64,
    /// Weights of identity and matrix in the second integral: factors of `t^2`, `t^3` and so on.
    series: [Vector; TERMS],
}

/// Weights of identity and matrix.
#[derive(Clone, Copy, Debug)]
pub struct Weights {
    /// In `exp(A t)`.
    pub exponential: Vector,
    /// In its integral over time, from zero.
    pub integral: Vector,
    /// In the integral of that.
    pub second: Vector,
}

impl Family {
    /// Of matrices with this trace and determinant.
    pub fn new(trace: f64, determinant: f64) -> Self {
        let mut power = [1.0, 0.0];
        let mut over = 0.5;
        let series = std::array::from_fn(|term| {
            let now = power.map(|weight| over * weight);
            power = [-determinant * power[1], power[0] + trace * power[1]];
            over /= term as f64 + 3.0;
            now
        });
        let mean = 0.5 * trace;
        Self { trace, determinant, fastest_per_s: mean.abs() + (mean * mean - determinant).abs().sqrt(), series }
    }

    /// After `t` seconds.
    #[inline]
    pub fn weights(&self, t: f64) -> Weights {
        if self.fastest_per_s * t <= SHORT { self.short(t) } else { self.long(t) }
    }

    #[inline(always)]
    fn short(&self, t: f64) -> Weights {
        let (s, t2) = (&self.series, t * t);
        let t4 = t2 * t2;
        // In pairs rather than one after the other: the processor does them at once.
        let sum = |of: usize| {
            let pair = |low: usize| s[low][of] + s[low + 1][of] * t;
            t2 * ((pair(0) + pair(2) * t2) + (pair(4) + pair(6) * t2) * t4)
        };
        self.weights_of([sum(0), sum(1)], t)
    }

    #[cold]
    fn long(&self, t: f64) -> Weights {
        let halvings = (self.fastest_per_s * t / SHORT).log2().ceil();
        let mut h = t * (-halvings).exp2();
        let mut weights = self.short(h);
        for _ in 0..halvings as u32 {
            let Weights { exponential, integral, second } = weights;
            let moved = self.product(exponential, second);
            let doubled = [0, 1].map(|of| second[of] + h * integral[of] + moved[of]);
            // The exponential itself is squared: from the integral it would lose digits when little of it is left.
            let squared = self.product(exponential, exponential);
            let onward = self.product(exponential, integral);
            weights = Weights {
                exponential: squared,
                integral: [integral[0] + onward[0], integral[1] + onward[1]],
                second: doubled,
            };
            h += h;
        }
        weights
    }

    /// `exp(A t) = 1 + A integral` and `integral = t + A second`.
    #[inline(always)]
    fn weights_of(&self, second: Vector, t: f64) -> Weights {
        let times_a = |w: Vector| [-self.determinant * w[1], w[0] + self.trace * w[1]];
        let of_second = times_a(second);
        let integral = [t + of_second[0], of_second[1]];
        let of_integral = times_a(integral);
        Weights { exponential: [1.0 + of_integral[0], of_integral[1]], integral, second }
    }

    /// Of two sums of identity and matrix.
    fn product(&self, p: Vector, q: Vector) -> Vector {
        let square = p[1] * q[1];
        [p[0] * q[0] - self.determinant * square, p[0] * q[1] + p[1] * q[0] + self.trace * square]
    }
}

/// `weights[0] + weights[1] A`.
#[inline(always)]
pub fn combine(weights: Vector, a: &Matrix) -> Matrix {
    [
        [weights[0] + weights[1] * a[0][0], weights[1] * a[0][1]],
        [weights[1] * a[1][0], weights[0] + weights[1] * a[1][1]],
    ]
}

#[inline(always)]
/// `a x`.
pub fn apply(a: &Matrix, x: Vector) -> Vector {
    [dot(a[0], x), dot(a[1], x)]
}

#[inline(always)]
/// `a . b`.
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// A row times a matrix.
#[inline(always)]
pub fn row_times(row: Vector, a: &Matrix) -> Vector {
    [row[0] * a[0][0] + row[1] * a[1][0], row[0] * a[0][1] + row[1] * a[1][1]]
}

/// `a b`.
pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|row| row_times(row, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix6;

    /// Against the exponential of the matrix that integrates twice: real, equal, complex and far apart eigenvalues, one of
    /// zero; short and long times.
    #[test]
    fn weights_make_the_exponential_and_its_integrals() {
        let matrices: [Matrix; 5] = [
            [[-0.2, 3243.0], [-6.15, -499.0]],
            [[-0.2, 36_000.0], [-6.15, -499.0]],
            [[-30.0, 1.0], [0.0, -30.0]],
            [[-0.2, 3243.0], [-12_329.0, -1e6]],
            [[-40.0, 0.0], [0.0, 0.0]],
        ];
        for (a, t) in matrices.iter().flat_map(|a| [1e-9, 31e-6, 1e-4].map(|t| (a, t))) {
            let family = Family::new(a[0][0] + a[1][1], a[0][0] * a[1][1] - a[0][1] * a[1][0]);
            let weights = family.weights(t);
            let mut chain = Matrix6::zeros();
            for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                chain[(row, column)] = a[row][column] * t;
            }
            for at in 0..4 {
                chain[(at, at + 2)] = t;
            }
            let expected = chain.exp();
            let scale = expected.fixed_view::<2, 2>(0, 0).amax().max(1.0);
            for (part, found) in [weights.exponential, weights.integral, weights.second].into_iter().enumerate() {
                let found = combine(found, a);
                for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let (found, expected) = (found[row][column], expected[(row, column + 2 * part)]);
                    let bound = 1e-12 * (expected.abs() + scale * t.powi(part as i32));
                    assert!((found - expected).abs() <= bound, "{a:?} {t} {part}: {found} {expected}");
                }
            }
        }
    }
}

//! The gains of least cost for a law: linear-quadratic control if not every state is fed back.
//!
//! If every state is fed back, the Riccati equation gives the gains. The core feeds back only what it measures. It does
//! not know the voltages on their way, nor the speed between two ticks.
//!
//! The cheapest gains on the measured signals are found by the iteration of Anderson and Moore. It starts from the
//! Riccati solution, projected onto the signals. Sources: Anderson and Moore, Linear Optimal Control, 1971; Makila and
//! Toivonen, "Computational methods for parametric LQ problems", IEEE Trans. Automatic Control 32, 1987.

use super::sampled_loop::SampledLoop;
use motorbench_model::linear::Matrix;
use motorbench_model::linear::riccati::{self, lyapunov};
use nalgebra::DVector;

/// Largest number of iterations; usually it takes 10 to 30.
const MAX_ITERATIONS: usize = 80;
/// Largest number of halvings of a step that does not lower the cost.
const MAX_HALVINGS: usize = 12;
/// Relative improvement at which the iteration ends.
const CONVERGED: f64 = 1e-9;
/// Part of the signals' covariance that is added to its diagonal. Two signals that always agree then share their gain.
const RIDGE: f64 = 1e-10;

/// Gains and their cost.
#[derive(Clone, Debug)]
pub struct Optimum {
    /// A gain for each signal; zero if it is not used.
    pub feedback: Vec<f64>,
    /// Expected cost.
    pub cost: f64,
}

/// The cheapest gains on the signals that `used` marks. `weights` act on the states, one acts on the square of the
/// voltage. The start is one of [`SampledLoop::deviations`] in units of `scales`, all equally likely. `None` if no
/// stabilising gains were found.
pub fn optimum(sampled: &SampledLoop, weights: &Matrix, scales: &DVector<f64>, used: &[bool]) -> Option<Optimum> {
    let problem = Problem::new(sampled, weights, scales, used)?;
    let mut best = problem.start()?;
    for _ in 0..MAX_ITERATIONS {
        let target = problem.improved(&best)?;
        let step = &target - &best.gain;
        let tried = (0..MAX_HALVINGS).find_map(|halving| {
            let gain = &best.gain + &step * 0.5_f64.powi(halving as i32);
            problem.state_of(gain).filter(|state| state.cost < best.cost)
        });
        let Some(next) = tried else { break };
        let gained = (best.cost - next.cost) / best.cost;
        best = next;
        if gained < CONVERGED {
            break;
        }
    }
    Some(Optimum { feedback: problem.in_units(&best.gain), cost: best.cost })
}

/// The problem in scaled states and signals.
struct Problem {
    a: Matrix,
    b: Matrix,
    /// The used signals.
    c: Matrix,
    q: Matrix,
    /// Covariance of the initial state.
    start: Matrix,
    /// Scale of each used signal, and its index among all signals.
    signals: Vec<(f64, usize)>,
    all_signals: usize,
}

/// A stabilising gain with its cost matrices.
struct State {
    gain: Matrix,
    cost: f64,
    /// Cost to go.
    p: Matrix,
    closed: Matrix,
}

impl Problem {
    fn new(sampled: &SampledLoop, weights: &Matrix, scales: &DVector<f64>, used: &[bool]) -> Option<Self> {
        let (a, b) = sampled.system();
        let scale = Matrix::from_diagonal(scales);
        let unscale = Matrix::from_diagonal(&scales.map(f64::recip));
        let all = sampled.signals() * &scale;
        let deviations = sampled.deviations();
        let signals: Vec<(f64, usize)> =
            (0..all.nrows()).filter(|&row| used[row]).map(|row| (all.row(row).norm(), row)).collect();
        let c = Matrix::from_fn(signals.len(), a.nrows(), |row, column| {
            let (size, place) = signals[row];
            all[(place, column)] / size
        });
        Some(Self {
            a: &unscale * a * &scale,
            b: &unscale * b,
            c,
            q: &scale * weights * &scale,
            start: &deviations * deviations.transpose(),
            signals,
            all_signals: used.len(),
        })
    }

    /// The full feedback, fitted to the signals with the covariance that it causes.
    fn start(&self) -> Option<State> {
        let one = Matrix::identity(1, 1);
        let full = riccati::feedback(&self.a, &self.b, &self.q, &one).ok()?;
        let covariance = lyapunov(&(&self.a - &self.b * &full), &self.start)?;
        let fitted = self.fit(&full, &covariance)?;
        // Sometimes the fit does not stabilise; a smaller feedback does.
        (0..MAX_HALVINGS).find_map(|halving| self.state_of(&fitted * 0.5_f64.powi(halving as i32)))
    }

    /// The gains on the signals that are closest to a feedback of all states.
    fn fit(&self, full: &Matrix, covariance: &Matrix) -> Option<Matrix> {
        let mut signal = &self.c * covariance * self.c.transpose();
        let ridge = RIDGE * signal.trace();
        for i in 0..signal.nrows() {
            signal[(i, i)] += ridge;
        }
        let mixed = full * covariance * self.c.transpose();
        Some(signal.cholesky()?.solve(&mixed.transpose()).transpose())
    }

    /// The solution of the optimum's conditions while everything else is held.
    fn improved(&self, state: &State) -> Option<Matrix> {
        let covariance = lyapunov(&state.closed, &self.start)?;
        let weight = 1.0 + (self.b.transpose() * &state.p * &self.b)[(0, 0)];
        let full = self.b.transpose() * &state.p * &self.a / weight;
        self.fit(&full, &covariance)
    }

    /// `None` if the gain does not stabilise.
    fn state_of(&self, gain: Matrix) -> Option<State> {
        let row = &gain * &self.c;
        let closed = &self.a - &self.b * &row;
        let p = lyapunov(&closed.transpose(), &(&self.q + row.transpose() * &row))?;
        let cost = (&p * &self.start).trace();
        (cost.is_finite() && cost > 0.0).then_some(State { gain, cost, p, closed })
    }

    fn in_units(&self, gain: &Matrix) -> Vec<f64> {
        let mut feedback = vec![0.0; self.all_signals];
        for (value, (scale, place)) in gain.iter().zip(&self.signals) {
            feedback[*place] = value / scale;
        }
        feedback
    }
}

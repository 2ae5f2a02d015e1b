//! The gains of least cost that a law can have: linear-quadratic control when not every state is fed back.
//!
//! With every state fed back the Riccati equation gives the gains. The core feeds back what it measures: not the
//! voltage that is still on its way, not the speed between two ticks. Among the gains on the measured signals the
//! cheapest are found by the iteration of Anderson and Moore (Anderson and Moore, Linear Optimal Control, 1971; Makila
//! and Toivonen, "Computational methods for parametric LQ problems", IEEE Trans. Automatic Control 32, 1987), which
//! starts from the Riccati solution seen through the signals.

use super::sampled_loop::SampledLoop;
use motorbench_model::linear::Matrix;
use motorbench_model::linear::riccati::{self, lyapunov};
use nalgebra::DVector;

/// Iterations; usual are 10 to 30.
const MAX_ITERATIONS: usize = 80;
/// Halvings of a step that does not lower the cost.
const MAX_HALVINGS: usize = 12;
/// Relative gain below which there is nothing more to be had.
const CONVERGED: f64 = 1e-9;
/// Part of the signals' covariance added to its diagonal: two signals that always agree share their gain.
const RIDGE: f64 = 1e-10;

/// Gains and what they cost.
#[derive(Clone, Debug)]
pub struct Optimum {
    /// A gain for each signal; zero where it is not used.
    pub feedback: Vec<f64>,
    /// Expected cost.
    pub cost: f64,
}

/// The gains on the signals marked in `used` that cost least: `weights` on the states, one on the square of the
/// voltage; from [`SampledLoop::deviations`] of `scales`, each as likely as the others. `None` if no stabilising gains
/// were found.
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
    /// Covariance of what it starts from.
    start: Matrix,
    /// Scale of each used signal, and its place among all.
    signals: Vec<(f64, usize)>,
    all_signals: usize,
}

/// A stabilising gain with what belongs to it.
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

    /// The full feedback, fitted to the signals in the covariance it brings about.
    fn start(&self) -> Option<State> {
        let one = Matrix::identity(1, 1);
        let full = riccati::feedback(&self.a, &self.b, &self.q, &one).ok()?;
        let covariance = lyapunov(&(&self.a - &self.b * &full), &self.start)?;
        let fitted = self.fit(&full, &covariance)?;
        // Seldom the fit does not stabilise; less of what it feeds back does.
        (0..MAX_HALVINGS).find_map(|halving| self.state_of(&fitted * 0.5_f64.powi(halving as i32)))
    }

    /// The gains on the signals that come closest to a feedback of all states.
    fn fit(&self, full: &Matrix, covariance: &Matrix) -> Option<Matrix> {
        let mut signal = &self.c * covariance * self.c.transpose();
        let ridge = RIDGE * signal.trace();
        for i in 0..signal.nrows() {
            signal[(i, i)] += ridge;
        }
        let mixed = full * covariance * self.c.transpose();
        Some(signal.cholesky()?.solve(&mixed.transpose()).transpose())
    }

    /// Where the conditions of the optimum, with everything else held, have their solution.
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

//! Weights for a specification, and gains for weights.
//!
//! The cost is `sum(u^2 + (s^2 q^2 + d^2 y^2) / |G(js)|^2)` for a speed `y` with integral `q`. For a position it is
//! `sum(u^2 + (e^2 s^2 q^2 + y^2 + d^2 y'^2 / s^2) / |G(js)|^2)`. `G` is the motor's transfer function from voltage to
//! `y`, so `s` is about the bandwidth of the loop. `d` adds damping. `e` is the speed of the integral relative to the
//! loop. A shape is a pair of `d` and `e`; `s` is the smallest that is fast enough.
//!
//! Gains, filter and figures depend on nothing but the weights. So weights from a search give the same gains if they
//! are given by hand.

use super::law::{ControlLaw, Signal};
use super::observer::CurrentObserver;
use super::optimum::{Optimum, optimum};
use super::sampled_loop::{Gains, MotorTiming, SampledLoop, Sampling};
use super::specification::{Specification, Speed};
use super::weights::{MOST_DAMPING, Weights};
use motorbench_model::linear::motor_model;
use motorbench_model::linear::step_response::StepFigures;
use motorbench_model::motor::MotorParameters;
use nalgebra::{Complex, DVector};
use serde::Serialize;
use std::f64::consts::TAU;

/// Number of bisections of the interval of `s`, on a logarithmic scale.
const BISECTIONS: usize = 14;
/// Interval of `s` relative to the requested speed.
const SLOWEST: f64 = 0.02;
const FASTEST: f64 = 10.0;
/// Largest `s` as a fraction of a revolution in one tick. Beyond it the delay dominates.
pub(super) const LARGEST_TURN: f64 = 1.0;
/// Smallest share of the cost that a derivative must save. Otherwise it is left out, since it only amplifies noise.
const DERIVATIVE_SAVES: f64 = 0.02;
/// Length of a step response: at least so many times 1/s, at most so many samples.
const RESPONSE_LENGTH: f64 = 60.0;
/// Length in time constants of the slowest eigenvalue, whose rest is then below 0.1 %.
const SLOW_LENGTH: f64 = 8.0;
pub(super) const MAX_SAMPLES: usize = 20_000;
/// Number of steps in which the gain on the reference is lowered to meet the overshoot.
const REFERENCE_STEPS: usize = 20;

/// Linear figures of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LoopFigures {
    /// From reference to output, -3 dB.
    #[serde(rename = "bandwidth_Hz")]
    pub bandwidth_hz: f64,
    /// After a plain step of the reference.
    #[serde(flatten)]
    pub step: StepFigures,
}

/// Shape of the weights; see the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// `d`.
    pub damping: f64,
    /// `e`; for a speed loop always one.
    pub integral: f64,
}

/// Effect of a load on a loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LoadFigures {
    /// Largest deviation from the reference that a load torque causes.
    #[serde(rename = "peak_rad_per_Nm")]
    pub peak_rad_per_nm: f64,
    /// Time until the integral has removed 98 % of it.
    pub gone_s: f64,
}

/// Gains found, before they are quantised.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The gains.
    pub gains: Gains,
    /// How the derivative is filtered.
    pub sampling: Sampling,
    /// Figures of the loop.
    pub figures: LoopFigures,
    /// Its weights.
    pub weights: Weights,
    /// Approximate crossover of these weights.
    pub crossover_rad_per_s: f64,
}

/// The search for one law on one motor.
#[derive(Clone, Debug)]
pub struct Search<'a> {
    /// The motor.
    pub motor: &'a MotorParameters,
    /// The law.
    pub law: ControlLaw,
    /// Delay and speed measurement.
    pub timing: MotorTiming,
    /// Which feedback gains may be used, in the order of [`ControlLaw::feedback`].
    pub used: &'a [bool],
    /// Estimates a current that is not measured.
    pub observer: Option<CurrentObserver>,
}

/// The fastest loop of a shape, if it was too slow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reached {
    /// Highest bandwidth.
    pub bandwidth_hz: f64,
    /// Shortest settling.
    pub settling_s: f64,
}

impl Search<'_> {
    /// Shapes to try, the best against disturbances first.
    pub fn shapes(&self) -> Vec<Shape> {
        let dampings = [0.0, 0.5, 1.0, 1.5, MOST_DAMPING];
        if self.law.is_position() {
            let integrals = [0.6, 0.4, 0.25, 0.15, 0.08, 0.04, 0.02, 0.01];
            integrals.iter().flat_map(|&integral| [0.7, 1.4].map(|damping| Shape { damping, integral })).collect()
        } else {
            dampings.iter().map(|&damping| Shape { damping, integral: 1.0 }).collect()
        }
    }

    /// The gentlest loop of a shape that is fast enough.
    ///
    /// # Errors
    /// The fastest loop.
    pub fn gentlest(&self, shape: Shape, specification: &Specification) -> Result<Candidate, Reached> {
        let asked_rad_per_s = specification.speed.rad_per_s(self.motor, self.timing.period_s);
        let fast_enough = |candidate: &Candidate| match specification.speed {
            Speed::BandwidthHz(hz) => candidate.figures.bandwidth_hz >= hz,
            Speed::SettlingS(settling_s) => candidate.figures.step.settling_s <= settling_s,
            Speed::Weights(_) => true,
        };
        let overshoot = specification.overshoot_percent;
        let highest = (FASTEST * asked_rad_per_s).min(LARGEST_TURN / self.timing.period_s);
        let (mut slow, mut fast) = ((SLOWEST * asked_rad_per_s).ln(), highest.ln());
        let mut best = None;
        let mut reached = Reached { bandwidth_hz: 0.0, settling_s: f64::INFINITY };
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (slow + fast);
            match self.candidate(&self.weights(shape, middle.exp()), overshoot) {
                Some(candidate) if fast_enough(&candidate) => {
                    best = Some(candidate);
                    fast = middle;
                }
                Some(candidate) => {
                    reached.bandwidth_hz = reached.bandwidth_hz.max(candidate.figures.bandwidth_hz);
                    reached.settling_s = reached.settling_s.min(candidate.figures.step.settling_s);
                    slow = middle;
                }
                None => slow = middle,
            }
        }
        best.ok_or(reached)
    }

    /// The weights of a shape at `s`.
    fn weights(&self, shape: Shape, s: f64) -> Weights {
        let Shape { damping: d, integral: e } = shape;
        let at = Complex::new(0.0, s);
        if self.law.is_position() {
            let gain = motor_model::angle(self.motor).at(at).norm_sqr();
            Weights::found(true, 1.0 / gain, d * d / (s * s) / gain, e * e * s * s / gain)
        } else {
            let gain = motor_model::speed(self.motor).at(at).norm_sqr();
            Weights::found(false, 0.0, d * d / gain, s * s / gain)
        }
    }

    /// The cheapest loop for some weights; `None` without stabilising gains or without a step that settles.
    pub fn candidate(&self, weights: &Weights, overshoot_percent: f64) -> Option<Candidate> {
        let MotorTiming { period_s, delay_s, speed } = self.timing;
        let s = weights.crossover_rad_per_s(self.motor, period_s);
        let observer = self.observer.clone();
        let sampling = Sampling { speed, delay_s, observer, ..Sampling::new(period_s, filter_s(self.law, s)) };
        let sampled = SampledLoop::new(self.motor, self.law, &sampling);
        let feedback = self.feedback(&sampled, weights, s)?.feedback;
        let samples = response_samples(&sampled, &feedback, s);
        let (gains, step) = with_reference(&sampled, self.law, feedback, samples, overshoot_percent)?;
        let bandwidth_hz = sampled.bandwidth_rad_per_s(&gains)? / TAU;
        let figures = LoopFigures { bandwidth_hz, step };
        Some(Candidate { gains, sampling, figures, weights: *weights, crossover_rad_per_s: s })
    }

    fn feedback(&self, sampled: &SampledLoop, weights: &Weights, s: f64) -> Option<Optimum> {
        let weights = sampled.weights(weights);
        let scales: DVector<f64> = sampled.scales(self.motor, s);
        let full = optimum(sampled, &weights, &scales, self.used)?;
        let derivative = self.law.feedback().iter().position(|(_, signal)| *signal == Signal::Derivative);
        let Some(derivative) = derivative.filter(|&row| self.used[row]) else { return Some(full) };
        let mut used = self.used.to_vec();
        used[derivative] = false;
        let without = optimum(sampled, &weights, &scales, &used)?;
        let worth = full.feedback[derivative] > 0.0 && full.cost < (1.0 - DERIVATIVE_SAVES) * without.cost;
        Some(if worth { full } else { without })
    }
}

/// Number of samples of a step response: enough for a loop with a crossover of about `s`, and for a slow eigenvalue.
fn response_samples(sampled: &SampledLoop, feedback: &[f64], s: f64) -> usize {
    let own_s = RESPONSE_LENGTH / s;
    let slow_s = SLOW_LENGTH * slowest_s(sampled, feedback);
    (own_s.max(slow_s) / sampled.period_s()).clamp(200.0, MAX_SAMPLES as f64) as usize
}

/// Time constant of the slowest eigenvalue.
fn slowest_s(sampled: &SampledLoop, feedback: &[f64]) -> f64 {
    let radius = sampled.spectral_radius(&Gains { feedback: feedback.to_vec(), reference: 0.0 });
    sampled.period_s() / -radius.min(1.0).ln()
}

/// Linear figures of a loop with a crossover of about `s`; `None` if its step does not settle.
pub fn figures(sampled: &SampledLoop, gains: &Gains, s: f64) -> Option<LoopFigures> {
    let samples = response_samples(sampled, &gains.feedback, s);
    let response = sampled.closed(gains).step_response(samples);
    let response: Vec<f64> = response.row(0).iter().copied().collect();
    let step = StepFigures::of(&response, sampled.period_s(), 1.0)?;
    Some(LoopFigures { bandwidth_hz: sampled.bandwidth_rad_per_s(gains)? / TAU, step })
}

/// A load's deviation must come back to this share of its largest value.
const LOAD_GONE: f64 = 0.02;

/// Effect of a `load` torque of 1 Nm ([`SampledLoop::load`]) on a position loop with a crossover of about `s`.
pub fn load_figures(sampled: &SampledLoop, gains: &Gains, load: &DVector<f64>, s: f64) -> LoadFigures {
    let closed = sampled.closed(gains);
    let mut x = DVector::zeros(sampled.states());
    let course: Vec<f64> = (0..response_samples(sampled, &gains.feedback, s))
        .map(|_| {
            x = &closed.a * &x + load;
            (&closed.c * &x)[0].abs()
        })
        .collect();
    let peak_rad_per_nm = course.iter().copied().fold(0.0, f64::max);
    let gone = LOAD_GONE * peak_rad_per_nm;
    let samples = course.iter().rposition(|off| *off > gone).map_or(0, |last| last + 1);
    // If the response was cut off, its rest decays with the slowest eigenvalue.
    let left = course.last().map_or(0.0, |off| (off / gone).ln().max(0.0));
    let rest_s = left * slowest_s(sampled, &gains.feedback);
    LoadFigures { peak_rad_per_nm, gone_s: samples as f64 * sampled.period_s() + rest_s }
}

/// A tenth of the loop's own time, so that the filter costs little phase. It is limited to one tick and 50 ms.
fn filter_s(law: ControlLaw, s: f64) -> f64 {
    match law.filter() {
        // Rounded as the console does, so that the analysed filter is the one that is sent.
        Some(_) => super::fixed_point::rounded((0.1 / s).clamp(1e-3, 50e-3)),
        None => 0.0,
    }
}

/// The largest gain on the reference that meets the overshoot; the smallest if none does.
fn with_reference(
    sampled: &SampledLoop,
    law: ControlLaw,
    feedback: Vec<f64>,
    samples: usize,
    overshoot_percent: f64,
) -> Option<(Gains, StepFigures)> {
    let proportional = feedback[0];
    let figures = |response: &[f64]| StepFigures::of(response, sampled.period_s(), 1.0);
    let response = |reference: f64| {
        let gains = Gains { feedback: feedback.clone(), reference };
        sampled.closed(&gains).step_response(samples).row(0).iter().copied().collect::<Vec<f64>>()
    };
    let whole = response(proportional);
    if law.is_position() {
        return figures(&whole).map(|step| (Gains { feedback, reference: proportional }, step));
    }
    // The response is linear in the gain on the reference.
    let none = response(0.0);
    let mut last = None;
    for step in 0..=REFERENCE_STEPS {
        let part = 1.0 - step as f64 / REFERENCE_STEPS as f64;
        let mixed: Vec<f64> = whole.iter().zip(&none).map(|(all, no)| part * all + (1.0 - part) * no).collect();
        if let Some(figures) = figures(&mixed) {
            last = Some((Gains { feedback: feedback.clone(), reference: part * proportional }, figures));
            if figures.overshoot_percent <= overshoot_percent {
                break;
            }
        }
    }
    last
}

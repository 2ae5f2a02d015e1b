//! How well a fit knows its constants, and what follows from them.

use super::sensitivities::Sensitivities;
use super::unknowns::{INERTIA, Place, VISCOUS_FRICTION, unknowns_of_terms};
use super::{Fit, Unknown, dot, square, weighted_residual};
pub use crate::configuration::identify::uncertainty::Z95;
use crate::configuration::identify::uncertainty::{BLOCKS_S, DIFFERENCE, GUESSED_PWM, SYSTEMATIC};
use crate::dataset::Dataset;
use crate::free_run::{Steps, drive, read};
use motorbench_model::Model;
use nalgebra::{DMatrix, DVector};
use std::sync::OnceLock;

/// A fitted constant and its interval.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    /// Which.
    pub place: Place,
    /// Most plausible value.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// Covariances and systematic errors of a fit.
pub struct Uncertainty<'a> {
    fit: &'a Fit,
    /// One for each block length.
    covariances: Vec<DMatrix<f64>>,
    /// Error of each coordinate from the steps of the simulation.
    shift: DVector<f64>,
    /// Error of each coordinate from the model's simplifications.
    simplified: Vec<f64>,
}

/// A quantity that follows from the constants of a model.
#[derive(Clone, Copy, Debug)]
pub struct Derived {
    /// Its most plausible value.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// The same before the data were seen; infinite if it depends on a constant without a prior.
    pub prior_deviation: f64,
}

impl Fit {
    /// `data`: those of the fit.
    pub fn uncertainty(&self, data: &Dataset) -> Uncertainty<'_> {
        let simplified = |unknown: &Unknown| {
            self.simplified(unknown.place, data) * if unknown.logarithmic { 1.0 } else { unknown.get(&self.model) }
        };
        Uncertainty {
            fit: self,
            covariances: BLOCKS_S.iter().map(|block_s| self.covariance(data, *block_s)).collect(),
            shift: self.error_of_steps(data),
            simplified: self.unknowns.iter().map(simplified).collect(),
        }
    }

    /// Number of residuals, less what their correlation within the shorter blocks takes.
    pub fn independent_residuals(&self, data: &Dataset) -> f64 {
        let block = (BLOCKS_S[0] / data.interval_s).max(1.0) as usize;
        let blocks = self.residual.chunks(data.len()).flat_map(|output| output.chunks(block));
        let of_sums: f64 = blocks.map(|block| block.iter().sum::<f64>().powi(2)).sum();
        let correlation = of_sums / square(&self.residual).max(f64::MIN_POSITIVE);
        self.used() as f64 / correlation.max(1.0)
    }

    /// Sum of the squares of the residuals for each that is independent.
    pub(super) fn square_of_independent(&self, data: &Dataset) -> f64 {
        square(&self.residual) / self.independent_residuals(data).max(1.0)
    }

    /// Covariance of the coordinates that holds for residuals correlated within a block.
    fn covariance(&self, data: &Dataset, block_s: f64) -> DMatrix<f64> {
        let block = (block_s / data.interval_s).max(1.0) as usize;
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        let size = columns.len();
        let mut middle = DMatrix::zeros(size, size);
        let samples = data.len();
        for start in (0..samples).step_by(block) {
            let gradient = DVector::from_iterator(
                size,
                columns.iter().map(|column| {
                    (0..data.measured.len())
                        .map(|output| {
                            let range = output * samples + start..output * samples + (start + block).min(samples);
                            dot(&column[range.clone()], &self.residual[range])
                        })
                        .sum::<f64>()
                }),
            );
            middle += &gradient * gradient.transpose();
        }
        for (index, unknown) in self.unknowns.iter().enumerate() {
            middle[(index, index)] += unknown.weight * unknown.stiffness();
        }
        inverse * middle * inverse
    }

    /// Twice the shift of each coordinate with steps half as long: the error of steps, if it is in proportion to their length.
    fn error_of_steps(&self, data: &Dataset) -> DVector<f64> {
        let halved = weighted_residual(data, &read(&self.model, data, drive(&self.model, data, Steps::Halved)));
        let change: Vec<f64> = halved.iter().zip(&self.residual).map(|(halved, fine)| 2.0 * (halved - fine)).collect();
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        inverse * DVector::from_iterator(columns.len(), columns.iter().map(|column| dot(column, &change)))
    }

    /// Relative error of a constant from the model's simplifications.
    fn simplified(&self, place: Place, data: &Dataset) -> f64 {
        let of_the_pwm = if data.origin.pwm_is_known { 0.0 } else { GUESSED_PWM };
        let terms = self.model.terms.iter().map(|term| term.effect.simplification());
        match place {
            Place::Motor(INERTIA) => terms.map(|law| law.inertia).fold(SYSTEMATIC, f64::hypot),
            Place::Motor(VISCOUS_FRICTION) => terms.map(|law| law.viscous_friction).fold(SYSTEMATIC, f64::hypot),
            Place::Motor(_) => SYSTEMATIC,
            Place::Term(term, _) => self.model.terms[term].effect.simplification().own.hypot(of_the_pwm),
        }
    }

    /// The same with the constants that the model holds at their prior means among the unknown ones: then the uncertainty
    /// contains what they leave open. They come last.
    pub fn with_held_open(&self, data: &Dataset) -> Self {
        let weight = self.unknowns.first().map_or(1.0, |unknown| unknown.weight);
        let held = unknowns_of_terms(&self.model, data, None, weight, |term| self.model.holds(term));
        if held.is_empty() {
            return self.clone();
        }
        Self { unknowns: [&self.unknowns[..], &held].concat(), sensitivities: OnceLock::new(), ..self.clone() }
    }
}

impl Uncertainty<'_> {
    /// Value and 95 % interval of every fitted constant, from statistics, steps and simplifications.
    pub fn intervals(&self) -> Vec<Interval> {
        let size = self.fit.unknowns.len();
        let interval = |(index, unknown): (usize, &Unknown)| {
            let here = unknown.get(&self.fit.model);
            let alone = DVector::from_fn(size, |other, _| if other == index { 1.0 } else { 0.0 });
            let half = Z95 * self.deviation(&alone);
            let value =
                |coordinate: f64| if unknown.logarithmic { coordinate.exp() } else { coordinate * unknown.size };
            // A constant cannot leave its range.
            let bound = |coordinate: f64| value(coordinate).clamp(unknown.min, unknown.max);
            Interval { place: unknown.place, value: value(here), ci95: [bound(here - half), bound(here + half)] }
        };
        self.fit.unknowns.iter().enumerate().map(interval).collect()
    }

    /// A quantity that follows from the model, to the first order.
    pub fn of(&self, quantity: impl Fn(&Model) -> f64) -> Derived {
        let slope = |unknown: &Unknown| {
            let here = unknown.get(&self.fit.model);
            // A constant at its bound moves one way only.
            let [(low, low_value), (high, high_value)] = [-DIFFERENCE, DIFFERENCE].map(|step| {
                let mut moved = self.fit.model.clone();
                unknown.set(&mut moved, here + step);
                (unknown.get(&moved), quantity(&moved))
            });
            (high_value - low_value) / (high - low).max(f64::MIN_POSITIVE)
        };
        let gradient = DVector::from_iterator(self.fit.unknowns.len(), self.fit.unknowns.iter().map(slope));
        let before = |(unknown, slope): (&Unknown, &f64)| match unknown.prior {
            Some((_, spread)) => slope * spread,
            None if *slope == 0.0 => 0.0,
            None => f64::INFINITY,
        };
        let prior = self.fit.unknowns.iter().zip(&gradient).map(before);
        Derived {
            value: quantity(&self.fit.model),
            deviation: self.deviation(&gradient),
            prior_deviation: prior.fold(0.0, f64::hypot),
        }
    }

    /// Standard deviation along a direction of the coordinates. Of several block lengths the one with the widest counts.
    fn deviation(&self, direction: &DVector<f64>) -> f64 {
        let variance = |covariance: &DMatrix<f64>| (direction.transpose() * covariance * direction)[0];
        let statistical = self.covariances.iter().map(variance).fold(0.0, f64::max).sqrt();
        let simplified = direction.iter().zip(&self.simplified).map(|(slope, error)| slope * error);
        simplified.fold(statistical.hypot(direction.dot(&self.shift)), f64::hypot)
    }
}

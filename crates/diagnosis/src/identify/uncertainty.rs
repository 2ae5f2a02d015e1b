//! How well a fit knows its constants, and what follows from them.

use super::{BLOCKS_S, Fit, Interval, Unknown, Z95};
use crate::dataset::Dataset;
use motorbench_model::Model;
use nalgebra::{DMatrix, DVector};

/// Step of the derivatives of a quantity, in coordinates of the fit.
const DIFFERENCE: f64 = 1e-5;

/// Covariances and systematic errors of a fit.
pub struct Uncertainty<'a> {
    fit: &'a Fit,
    /// One for each block length.
    covariances: Vec<DMatrix<f64>>,
    /// Shift of each coordinate with steps twice as long.
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
            shift: self.shift_of_coarse_steps(data),
            simplified: self.unknowns.iter().map(simplified).collect(),
        }
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

//! What an effect outside the model promises to gain, from first derivatives alone (score test; Rao 1948).

use super::sensitivities::{Base, Sensitivities};
use super::{Fit, dot, square};
pub use crate::configuration::identify::promises::LEAST_PROMISE;
use crate::configuration::identify::promises::{MOST_NEIGHBOURS, REFINED, REFINEMENTS, SCREENED, WORTH_A_WALK};
use crate::dataset::Dataset;
use crate::free_run::{Replay, Steps};
use crate::parallel;
use motorbench_model::catalogue::{Alone, CATALOGUE, Effect, Scales};
use nalgebra::{DMatrix, DVector};

/// Expected gain of adding an effect, from the first derivatives alone.
#[derive(Clone, Debug)]
pub struct Promise {
    /// Index in [`CATALOGUE`].
    pub effect: usize,
    /// Starting values of the fit.
    pub start: Vec<f64>,
    /// The next best start, since the best by expected gain may not be the nearest.
    pub other_starts: Vec<Vec<f64>>,
    /// Expected fall of the cost.
    pub gain: f64,
}

impl Promise {
    /// Its best start belongs to another effect.
    fn improve(&mut self, better: Self) {
        (self.start, self.gain) = (better.start, better.gain);
    }
}

/// The change of the residual in each direction of an effect's constants from `start`.
fn lines(effect: &dyn Effect, start: &[f64], change: impl Fn(Vec<f64>) -> Vec<f64>) -> Vec<Vec<f64>> {
    let without = |constant: usize| {
        let mut values = start.to_vec();
        values[constant] = 0.0;
        values
    };
    match effect.about().linear_in {
        2 => vec![change(without(1)), change(without(0))],
        _ => vec![change(start.to_vec())],
    }
}

impl Fit {
    /// Expected gain of each effect outside the model (score test; Rao 1948), with its best start, best first.
    pub fn promises(&self, replay: &Replay, scales: &Scales, excluded: &[&str]) -> Vec<Promise> {
        let fine = self.weighted_residual(replay.data);
        let base = Base::new(&self.model, replay, Steps::Coarse, &fine);
        // Computed before the threads start: otherwise they would wait for each other.
        self.sensitivities(replay.data);
        let candidates: Vec<(usize, Vec<f64>)> = CATALOGUE
            .iter()
            .enumerate()
            .filter(|(_, effect)| !self.model.has(effect.about().id) && !excluded.contains(&effect.about().id))
            .filter(|(_, effect)| self.model.alone(**effect) != Some(Alone::Never))
            .flat_map(|(index, effect)| {
                let starts = self.screened(&base, *effect, effect.starts(scales));
                starts.into_iter().map(move |start| (index, start))
            })
            .collect();
        let mut all: Vec<Promise> = parallel::map(candidates, |(effect, start)| self.promise(&base, effect, start));
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut best: Vec<Promise> = Vec::new();
        for promise in all {
            match best.iter_mut().find(|other| other.effect == promise.effect) {
                None => best.push(promise),
                Some(other) => {
                    if 1 + other.other_starts.len() < CATALOGUE[other.effect].starts_fitted(scales) {
                        other.other_starts.push(promise.start);
                    }
                }
            }
        }
        best.truncate(REFINED);
        let least = LEAST_PROMISE.max(WORTH_A_WALK * best.first().map_or(0.0, |promise| promise.gain));
        let mut best: Vec<Promise> = parallel::map(best, |promise| self.refined(&base, scales, promise, least));
        best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        best
    }

    /// The starts of an effect that are worth a simulation.
    fn screened(&self, base: &Base, effect: &dyn Effect, starts: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if !effect.about().responds_linearly || starts.len() <= SCREENED {
            return starts;
        }
        let mut promised: Vec<(f64, Vec<f64>)> = parallel::map(starts, |start| {
            let change = |values: Vec<f64>| base.change_by_linear_response(&self.model, effect, &values);
            let (gain, _) = self.least_squares(base.replay.data, &lines(effect, &start, change));
            (gain, start)
        });
        promised.sort_by(|a, b| b.0.total_cmp(&a.0));
        promised.into_iter().take(SCREENED).map(|(_, start)| start).collect()
    }

    /// A better start near the best of the catalogue's.
    fn refined(&self, base: &Base, scales: &Scales, promise: Promise, worth_a_walk: f64) -> Promise {
        match CATALOGUE[promise.effect].spacing(scales) {
            Some((index, spacing)) => self.between(base, promise, index, spacing),
            None if promise.gain > worth_a_walk => self.uphill(base, promise),
            None => promise,
        }
    }

    /// Halves the distance between the alternatives of a nonlinear constant repeatedly around the best.
    fn between(&self, base: &Base, mut promise: Promise, index: usize, spacing: f64) -> Promise {
        for round in 1..=REFINEMENTS {
            let distance = spacing / f64::from(1 << round);
            for side in [-distance, distance] {
                let mut start = promise.start.clone();
                start[index] += side;
                let other = self.promise(base, promise.effect, start);
                if other.gain > promise.gain {
                    promise.improve(other);
                }
            }
        }
        promise
    }

    /// Moves to a neighbour while it promises more.
    fn uphill(&self, base: &Base, mut promise: Promise) -> Promise {
        for _ in 0..MOST_NEIGHBOURS {
            let neighbours = CATALOGUE[promise.effect].neighbours(&promise.start);
            let others = parallel::map(neighbours, |start| self.promise(base, promise.effect, start));
            match others.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain)) {
                Some(better) if better.gain > promise.gain => promise.improve(better),
                _ => break,
            }
        }
        promise
    }

    fn promise(&self, base: &Base, index: usize, start: Vec<f64>) -> Promise {
        let effect = CATALOGUE[index];
        let about = effect.about();
        let change = |values| base.change(&self.model.with(effect, values), effect.changes_motion());
        let lines = lines(effect, &start, change);
        let (gain, factors) = self.least_squares(base.replay.data, &lines);
        // The derivative at zero of an effect without a sign does not hold for negative values.
        let signed = about.parameters[0].min < 0.0;
        let possible = about.linear_in == 2 || factors[0] > 0.0 || signed && about.linear_in == 1;
        let mut start = start;
        for (value, factor) in start.iter_mut().zip(&factors).take(about.linear_in) {
            let magnitude = factor.abs().clamp(0.05, 10.0);
            *value *= magnitude * if signed { factor.signum() } else { 1.0 };
        }
        // If the effect is not linear, the whole step is evaluated, not the best multiple of it.
        let gain = match about.linear_in {
            0 => gain.min(self.gain_of_whole(&lines[0]).max(0.25 * gain)),
            _ => gain,
        };
        Promise { effect: index, start, other_starts: Vec::new(), gain: if possible { gain } else { 0.0 } }
    }

    /// Expected fall of the cost if what `other` reads of the same motor differently is in the data, by any factor.
    pub fn promised_by(&self, data: &Dataset, other: &Fit) -> f64 {
        let change: Vec<f64> = other.residual.iter().zip(&self.residual).map(|(there, here)| there - here).collect();
        self.least_squares(data, &[change]).0
    }

    fn gain_of_whole(&self, line: &[f64]) -> f64 {
        -2.0 * dot(line, &self.residual) - square(line)
    }

    /// Best combination of new columns beside the model's own: gain and factors.
    fn least_squares(&self, data: &Dataset, lines: &[Vec<f64>]) -> (f64, Vec<f64>) {
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        let along =
            |line: &[f64]| DVector::from_iterator(columns.len(), columns.iter().map(|column| dot(column, line)));
        let own: Vec<DVector<f64>> = lines.iter().map(|line| along(line)).collect();
        let pull = along(&self.residual);
        let size = lines.len();
        let mut normal = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        for row in 0..size {
            for column in 0..size {
                normal[(row, column)] =
                    dot(&lines[row], &lines[column]) - (own[row].transpose() * inverse * &own[column])[0];
            }
            normal[(row, row)] += 1e-9 * square(&lines[row]) + f64::MIN_POSITIVE;
            gradient[row] = dot(&lines[row], &self.residual) - (own[row].transpose() * inverse * &pull)[0];
        }
        let Some(factors) = normal.clone().cholesky().map(|cholesky| -cholesky.solve(&gradient)) else {
            return (0.0, vec![0.0; size]);
        };
        (-gradient.dot(&factors), factors.iter().copied().collect())
    }

    /// By how much the cost would fall if an effect with these constants were in the data: what the model's own constants
    /// and their priors cannot take of it.
    pub fn would_gain(&self, data: &Dataset, effect: &'static dyn Effect, values: Vec<f64>) -> f64 {
        let (replay, fine) = (Replay::new(data), self.weighted_residual(data));
        let base = Base::new(&self.model, &replay, Steps::Coarse, &fine);
        let line = base.change(&self.model.with(effect, values), effect.changes_motion());
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        let along = DVector::from_iterator(columns.len(), columns.iter().map(|column| dot(column, &line)));
        square(&line) - (along.transpose() * inverse * &along)[0]
    }
}

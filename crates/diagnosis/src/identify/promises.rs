//! What an effect outside the model promises to gain, from first derivatives alone (score test; Rao 1948).

use super::sensitivities::{Base, Sensitivities};
use super::{Fit, dot, square};
pub use crate::configuration::identify::promises::LEAST_PROMISE;
use crate::configuration::identify::promises::{
    MORE_TOGETHER, MOST_NEIGHBOURS, REFINED, REFINEMENTS, SCREENED, WORTH_A_WALK,
};
use crate::dataset::Dataset;
use crate::free_run::{Replay, Steps};
use crate::parallel;
use motorbench_model::Term;
use motorbench_model::catalogue::{Alone, CATALOGUE, Effect, Scales, USUAL};
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, Gamma};

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
    /// The values whose multiples are in the start...
    values: Vec<f64>,
    /// ... and the directions in which they move the residual.
    lines: Vec<Line>,
}

impl Promise {
    /// Its best start belongs to another effect.
    fn improve(&mut self, better: Self) {
        let other_starts = std::mem::take(&mut self.other_starts);
        *self = Self { other_starts, ..better };
    }

    /// Whether the effect can have these multiples of the values. The derivative at zero of an effect without a sign does not
    /// hold for negative values.
    fn allows(&self, factors: &[f64]) -> bool {
        let about = CATALOGUE[self.effect].about();
        about.linear_in == 2 || factors[0] > 0.0 || self.is_signed() && about.linear_in == 1
    }

    fn is_signed(&self) -> bool {
        CATALOGUE[self.effect].about().parameters[0].min < 0.0
    }

    /// Starting values with these multiples.
    fn scaled(&self, factors: &[f64]) -> Vec<f64> {
        let mut start = self.values.clone();
        for (value, factor) in start.iter_mut().zip(factors).take(CATALOGUE[self.effect].about().linear_in) {
            let magnitude = factor.abs().clamp(0.05, 10.0);
            *value *= magnitude * if self.is_signed() { factor.signum() } else { 1.0 };
        }
        start
    }
}

/// What the effects outside a model promise.
pub struct Promises {
    /// Each alone, the best first.
    pub alone: Vec<Promise>,
    /// Two that promise much more together than alone, and more than any other.
    pub together: Option<[EffectStart; 2]>,
}

/// An effect with starting values of a fit.
pub struct EffectStart {
    /// Index in [`CATALOGUE`].
    pub effect: usize,
    /// Of its constants.
    pub values: Vec<f64>,
}

/// A change of the residual, with what each of the model's own constants sees of it.
#[derive(Clone, Debug)]
struct Line {
    change: Vec<f64>,
    own: DVector<f64>,
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

/// What effects outside a model are tested against.
struct ScoreTest<'a> {
    /// The model's own simulation.
    base: Base<'a>,
    /// What its constants see of the residual.
    pull: DVector<f64>,
}

impl Fit {
    /// Expected gain of each effect outside the model (score test; Rao 1948), with its best start.
    pub fn promises(&self, replay: &Replay, scales: &Scales, excluded: &[&str]) -> Promises {
        let fine = self.weighted_residual(replay.data);
        let test = self.score_test(replay, &fine);
        let candidates: Vec<(usize, Vec<f64>)> = CATALOGUE
            .iter()
            .enumerate()
            .filter(|(_, effect)| !self.model.has(effect.about().id) && !excluded.contains(&effect.about().id))
            .filter(|(_, effect)| self.model.alone(**effect) != Some(Alone::Never))
            .flat_map(|(index, effect)| {
                let starts = self.screened(&test, *effect, effect.starts(scales));
                starts.into_iter().map(move |start| (index, start))
            })
            .collect();
        let mut all: Vec<Promise> = parallel::map(candidates, |(effect, start)| self.promise(&test, effect, start));
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
        let together = self.promising_together(replay.data, &test.pull, &best);
        best.truncate(REFINED);
        let least = LEAST_PROMISE.max(WORTH_A_WALK * best.first().map_or(0.0, |promise| promise.gain));
        let mut best: Vec<Promise> = parallel::map(best, |promise| self.refined(&test, scales, promise, least));
        best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        Promises { alone: best, together }
    }

    /// `fine`: the weighted residual in fine steps.
    fn score_test<'a>(&'a self, replay: &'a Replay<'a>, fine: &'a [f64]) -> ScoreTest<'a> {
        let base = Base::new(&self.model, replay, Steps::Coarse, fine);
        // The sensitivities are computed before threads start: otherwise they would wait for each other.
        ScoreTest { base, pull: self.along_own(replay.data, &self.residual) }
    }

    /// The best effect beside one of the usual ones, where the two promise more than any alone, and much more than one by one.
    /// The linear motor's viscous friction lies between a constant and a growing one, and hides both.
    fn promising_together(&self, data: &Dataset, pull: &DVector<f64>, alone: &[Promise]) -> Option<[EffectStart; 2]> {
        let is_linear = |promise: &&Promise| CATALOGUE[promise.effect].about().linear_in > 0;
        let usual = alone.iter().filter(is_linear).filter(|one| USUAL.contains(&CATALOGUE[one.effect].about().id));
        let pairs = usual.flat_map(|one| {
            let others = alone.iter().filter(is_linear).filter(|other| other.effect != one.effect);
            others.filter_map(|other| self.together(data, pull, one, other))
        });
        let (gain, best) = pairs.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let best_alone = alone.first().map_or(0.0, |promise| promise.gain);
        (gain > LEAST_PROMISE.max(best_alone)).then_some(best)
    }

    /// The gain and the starting values of two effects that promise much more together.
    fn together(
        &self,
        data: &Dataset,
        pull: &DVector<f64>,
        one: &Promise,
        other: &Promise,
    ) -> Option<(f64, [EffectStart; 2])> {
        let lines: Vec<&Line> = one.lines.iter().chain(&other.lines).collect();
        let (gain, factors) = self.least_squares(data, pull, &lines);
        let (of_one, of_other) = factors.split_at(one.lines.len());
        let is_possible = one.allows(of_one) && other.allows(of_other);
        let start = |of: &Promise, factors: &[f64]| EffectStart { effect: of.effect, values: of.scaled(factors) };
        (is_possible && gain > MORE_TOGETHER * (one.gain + other.gain))
            .then(|| (gain, [start(one, of_one), start(other, of_other)]))
    }

    /// The starts of an effect that are worth a simulation.
    fn screened(&self, test: &ScoreTest, effect: &dyn Effect, starts: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if !effect.about().responds_linearly || starts.len() <= SCREENED {
            return starts;
        }
        let ScoreTest { base, pull } = test;
        let mut promised: Vec<(f64, Vec<f64>)> = parallel::map(starts, |start| {
            let change = |values: Vec<f64>| base.change_by_linear_response(&self.model, effect, &values);
            (self.gain(base.replay.data, pull, lines(effect, &start, change)).0, start)
        });
        promised.sort_by(|a, b| b.0.total_cmp(&a.0));
        promised.into_iter().take(SCREENED).map(|(_, start)| start).collect()
    }

    /// By how much the number of a wave outside the model stands out from the effect's other numbers, in natural units; zero
    /// for what has no number. The others show what a wave gains that is not in the data, whatever the laws leave out: sums of
    /// squares of two amplitudes, as a gamma distribution, of which the best was chosen (as for the lines of a periodogram:
    /// Scargle, Astrophysical Journal 263 (1982)).
    pub fn number_stands_out(&self, replay: &Replay, scales: &Scales, wave: &Term) -> f64 {
        let Some(index) = wave.effect.about().number() else { return 0.0 };
        let fine = self.weighted_residual(replay.data);
        let test = self.score_test(replay, &fine);
        let gain = |start: Vec<f64>| self.simulated(&test, wave.effect, &start).0;
        let others = wave.effect.starts(scales).into_iter().filter(|start| start[index] != wave.values[index]);
        let others = parallel::map(others, gain);
        let count = others.len() as f64;
        let mean = others.iter().sum::<f64>() / count;
        let variance = others.iter().map(|other| (other - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let by_chance = Gamma::new(mean * mean / variance, mean / variance);
        by_chance.map_or(0.0, |gains| -((1.0 + count) * gains.sf(gain(wave.values.clone()))).ln())
    }

    /// A better start near the best of the catalogue's.
    fn refined(&self, test: &ScoreTest, scales: &Scales, promise: Promise, worth_a_walk: f64) -> Promise {
        if promise.gain <= worth_a_walk {
            return promise;
        }
        match CATALOGUE[promise.effect].spacing(scales) {
            Some((index, spacing)) => self.between(test, promise, index, spacing),
            None => self.uphill(test, promise),
        }
    }

    /// Halves the distance between the alternatives of a nonlinear constant repeatedly around the best.
    fn between(&self, test: &ScoreTest, mut promise: Promise, index: usize, spacing: f64) -> Promise {
        for round in 1..=REFINEMENTS {
            let distance = spacing / f64::from(1 << round);
            for side in [-distance, distance] {
                let mut start = promise.start.clone();
                start[index] += side;
                let other = self.promise(test, promise.effect, start);
                if other.gain > promise.gain {
                    promise.improve(other);
                }
            }
        }
        promise
    }

    /// Moves to a neighbour while it promises more.
    fn uphill(&self, test: &ScoreTest, mut promise: Promise) -> Promise {
        for _ in 0..MOST_NEIGHBOURS {
            let neighbours = CATALOGUE[promise.effect].neighbours(&promise.start);
            let others = parallel::map(neighbours, |start| self.promise(test, promise.effect, start));
            match others.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain)) {
                Some(better) if better.gain > promise.gain => promise.improve(better),
                _ => break,
            }
        }
        promise
    }

    /// Best combination of what an effect changes in a simulation, as [`Self::gain`].
    fn simulated(
        &self,
        ScoreTest { base, pull }: &ScoreTest,
        effect: &'static dyn Effect,
        start: &[f64],
    ) -> (f64, Vec<f64>, Vec<Line>) {
        let change = |values| base.change(&self.model.with(effect, values), effect.changes_motion());
        self.gain(base.replay.data, pull, lines(effect, start, change))
    }

    fn promise(&self, test: &ScoreTest, index: usize, start: Vec<f64>) -> Promise {
        let effect = CATALOGUE[index];
        let (gain, factors, lines) = self.simulated(test, effect, &start);
        // If the effect is not linear, the whole step is evaluated, not the best multiple of it.
        let gain = match effect.about().linear_in {
            0 => gain.min(self.gain_of_whole(&lines[0].change).max(0.25 * gain)),
            _ => gain,
        };
        let (start, values) = (Vec::new(), start);
        let mut promise = Promise { effect: index, start, other_starts: Vec::new(), gain, values, lines };
        promise.start = promise.scaled(&factors);
        promise.gain = if promise.allows(&factors) { gain } else { 0.0 };
        promise
    }

    /// Expected fall of the cost if what `other` reads of the same motor differently is in the data, by any factor.
    pub fn promised_by(&self, data: &Dataset, other: &Fit) -> f64 {
        let change = other.residual.iter().zip(&self.residual).map(|(there, here)| there - here).collect();
        self.gain(data, &self.along_own(data, &self.residual), vec![change]).0
    }

    fn gain_of_whole(&self, change: &[f64]) -> f64 {
        -2.0 * dot(change, &self.residual) - square(change)
    }

    /// Best combination of new columns beside the model's own: gain, factors, and the columns.
    fn gain(&self, data: &Dataset, pull: &DVector<f64>, changes: Vec<Vec<f64>>) -> (f64, Vec<f64>, Vec<Line>) {
        let lines: Vec<Line> = changes.into_iter().map(|change| self.line(data, change)).collect();
        let (gain, factors) = self.least_squares(data, pull, &lines.iter().collect::<Vec<_>>());
        (gain, factors, lines)
    }

    fn line(&self, data: &Dataset, change: Vec<f64>) -> Line {
        Line { own: self.along_own(data, &change), change }
    }

    /// What each of the model's own constants sees of a change.
    fn along_own(&self, data: &Dataset, change: &[f64]) -> DVector<f64> {
        let (Sensitivities { columns, .. }, _) = self.sensitivities(data);
        DVector::from_iterator(columns.len(), columns.iter().map(|column| dot(column, change)))
    }

    /// Inner product of what the model's own constants and their priors cannot take of two lines.
    fn beside(&self, data: &Dataset, one: &Line, other: &Line) -> f64 {
        let (_, inverse) = self.sensitivities(data);
        dot(&one.change, &other.change) - (one.own.transpose() * inverse * &other.own)[0]
    }

    /// Best combination of new columns beside the model's own: gain and factors. `pull`: the residual along those.
    fn least_squares(&self, data: &Dataset, pull: &DVector<f64>, lines: &[&Line]) -> (f64, Vec<f64>) {
        let size = lines.len();
        let mut normal = DMatrix::from_fn(size, size, |row, column| self.beside(data, lines[row], lines[column]));
        for (row, line) in lines.iter().enumerate() {
            normal[(row, row)] += 1e-9 * square(&line.change) + f64::MIN_POSITIVE;
        }
        let (_, inverse) = self.sensitivities(data);
        let gradient = DVector::from_fn(size, |row, _| {
            dot(&lines[row].change, &self.residual) - (lines[row].own.transpose() * inverse * pull)[0]
        });
        let Some(factors) = normal.cholesky().map(|cholesky| -cholesky.solve(&gradient)) else {
            return (0.0, vec![0.0; size]);
        };
        (-gradient.dot(&factors), factors.iter().copied().collect())
    }

    /// By how much the cost would fall if an effect with these constants were in the data: what the model's own constants
    /// and their priors cannot take of it.
    pub fn would_gain(&self, data: &Dataset, effect: &'static dyn Effect, values: Vec<f64>) -> f64 {
        let (replay, fine) = (Replay::new(data), self.weighted_residual(data));
        let base = Base::new(&self.model, &replay, Steps::Coarse, &fine);
        let line = self.line(data, base.change(&self.model.with(effect, values), effect.changes_motion()));
        self.beside(data, &line, &line)
    }
}

//! The search for the most probable candidate: effects are added by what the score test promises (Rao 1948), dropped and
//! swapped by evidence.

use super::fit::{Effort, Fitted, Problem, weighted};
use super::whiten::Unknown;
use crate::catalogue::observation::CommandTiming;
use crate::catalogue::{Alone, Balance, CATALOGUE, Channels, Effect, effect};
use crate::dataset::Output;
use crate::free_run::{Motion, Steps, drive, nudged, read};
use crate::identify::scales;
use crate::model::{Model, Term};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Called with a sentence whenever the work goes on.
pub type Progress<'a> = &'a (dyn Fn(&str) + Sync);

/// Of many starts of a torque from outside so many are simulated whole: the best by their linear response.
const SCREENED: usize = 3;
/// A promise is no more than this multiple of its start, nor less than the other.
const FACTORS: [f64; 2] = [0.05, 10.0];

/// The best start of an effect, and what it promises.
struct Promise {
    effect: &'static dyn Effect,
    start: Vec<f64>,
    gain: f64,
}

/// A simulation that others are compared with.
struct Base<'a> {
    fitted: &'a Fitted,
    filter: super::whiten::Whitener,
    weights: Vec<f64>,
    predicted: Vec<Vec<f64>>,
    motion: Motion,
    inverse: DMatrix<f64>,
    pull: DVector<f64>,
}

/// What holds of an effect of the most probable candidate.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Which.
    pub id: &'static str,
    /// By how much the evidence is less without it.
    pub gain: f64,
    /// The candidate without it.
    pub without: Model,
    /// Effects that serve as well in its place.
    pub same: Vec<&'static str>,
    /// The next best in its place, and by how much that is less probable.
    pub rival: Option<(&'static str, f64)>,
}

impl Problem<'_> {
    /// Effects that these recordings can say something of.
    pub fn possible(&self) -> Vec<&'static dyn Effect> {
        let data = self.data;
        let channels = Channels {
            current: data.current().is_some(),
            speed: data.motion().output == Output::Speed,
            counts: data.origin.is_counted,
            moments: data.has_moments(),
            one_magnitude: data.has_one_magnitude(),
        };
        CATALOGUE.iter().copied().filter(|effect| effect.shows_in(&channels)).collect()
    }

    /// Some first candidates, the best first: the linear motor, and the motor of the rig file with the usual set, be the off phase
    /// of its PWM one that brakes or one that coasts.
    pub fn begin(&self, progress: Progress) -> Vec<Fitted> {
        progress("first candidates");
        let linear = Model::linear(self.prior.motor);
        let usual = self.usual_set(&linear);
        let sizes = scales(&linear.motor, self.data);
        let coasting = self
            .possible()
            .into_iter()
            .filter(|effect| effect.is_of_switching())
            .map(|effect| usual.with_start(effect, &sizes));
        let large = Unknown { torque: 30.0, voltage: 10.0, ..Unknown::USUAL };
        let small = Unknown { torque: 3.0, voltage: 3.0, ..Unknown::USUAL };
        let starts: Vec<(Model, Unknown)> =
            [(linear, large), (usual.clone(), small)].into_iter().chain(coasting.map(|model| (model, small))).collect();
        let mut fits: Vec<Fitted> =
            starts.into_par_iter().map(|(model, unknown)| self.fit_to_the_end(&model, unknown)).collect();
        fits.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        fits
    }

    /// The usual set with the longer delays: a fit does not come from one to another.
    pub fn later(&self) -> Option<Fitted> {
        let sizes = scales(&self.prior.motor, self.data);
        let mut usual = self.usual_set(&Model::linear(self.prior.motor));
        if !usual.has("actuation_delay") {
            usual = usual.with_start(effect("actuation_delay")?, &sizes);
        }
        let index = usual.terms.iter().position(|term| term.id() == "actuation_delay")?;
        let starts = usual.terms[index].effect.starts(&scales(&usual.motor, self.data));
        let large = Unknown { torque: 30.0, voltage: 10.0, ..Unknown::USUAL };
        let fits: Vec<Fitted> = starts[1..]
            .par_iter()
            .map(|start| self.fit(&usual.with_values(index, start.clone()), large, Effort::FULL))
            .collect();
        fits.into_iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }

    /// The most probable candidate, from a first one on.
    pub fn search(&self, begin: Fitted, progress: Progress) -> (Fitted, Vec<Standing>) {
        let begin = self.fit_to_the_end(&begin.model, begin.unknown);
        let best = self.grown(begin, progress);
        self.backward(best, progress)
    }

    /// The linear motor with what hardly any bench is without.
    pub fn usual_set(&self, linear: &Model) -> Model {
        let sizes = scales(&linear.motor, self.data);
        let possible = self.possible();
        let is_there = |id: &str| possible.iter().any(|effect| effect.about().id == id);
        // A stated delay is that of the program; its duty still waits for the next period of the PWM.
        let timing_is_known = self.data.origin.timing.command_delay_s.is_some();
        let linear = &match timing_is_known && self.data.origin.pwm_hz > 0.0 {
            true => linear.with_start(&CommandTiming, &sizes),
            false => linear.clone(),
        };
        ["coulomb_friction", "voltage_drop", "actuation_delay"]
            .into_iter()
            .filter(|id| is_there(id) && !(timing_is_known && *id == "actuation_delay"))
            .filter_map(effect)
            .fold(linear.clone(), |model, effect| model.with_start(effect, &sizes))
    }

    /// Adds what makes a candidate more probable until nothing does.
    fn grown(&self, mut best: Fitted, progress: Progress) -> Fitted {
        while best.model.terms.iter().filter(|term| !term.effect.is_observation()).count() < self.set.most_effects {
            let promises = self.promises(&best);
            let tried: Vec<(&'static str, Fitted)> = promises
                .par_iter()
                .take(self.set.tried)
                .filter(|promise| promise.gain > self.set.named_odds)
                .map(|promise| {
                    let model = best.model.with(promise.effect, promise.start.clone());
                    (promise.effect.about().id, self.fit(&model, best.unknown, Effort::TRIAL))
                })
                .collect();
            let better = tried.into_iter().max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence));
            match better {
                Some((id, better)) if better.evidence > best.evidence => {
                    progress(&format!("with {id}"));
                    best = self.fit_to_the_end(&better.model, better.unknown);
                }
                _ => break,
            }
        }
        best
    }

    /// Drops what is not needed; swaps what something else explains better.
    fn backward(&self, mut best: Fitted, progress: Progress) -> (Fitted, Vec<Standing>) {
        let mut standings = Vec::new();
        for _ in 0..2 * self.set.most_effects {
            let causes = best.model.terms.iter().filter(|term| !term.effect.is_observation());
            let ids: Vec<&'static str> = causes.map(Term::id).collect();
            let without: Vec<(&'static str, Fitted)> = ids
                .par_iter()
                .map(|id| (*id, self.fit(&best.model.without(id), best.unknown, Effort::TRIAL)))
                .collect();
            // When a command acts is always unknown: a delay is no name by itself.
            let needed = |id: &str| if id == "actuation_delay" { 0.0 } else { self.set.named_odds };
            let surplus = |(id, fitted): &(&'static str, Fitted)| fitted.evidence - best.evidence + needed(id);
            let weakest = without.iter().max_by(|a, b| surplus(a).total_cmp(&surplus(b)));
            if let Some((id, fitted)) = weakest.filter(|weakest| surplus(weakest) > 0.0) {
                progress(&format!("without {id}"));
                best = self.fit_to_the_end(&fitted.model, fitted.unknown);
                continue;
            }
            let swaps: Vec<(&'static str, Option<&'static str>, Fitted)> =
                without.par_iter().flat_map(|(id, without)| self.swaps(&best, without, id)).collect();
            standings =
                without.iter().map(|(id, without)| standing(&best, id, without, &swaps, self.set.same_odds)).collect();
            let better = swaps.into_iter().max_by(|a, b| a.2.evidence.total_cmp(&b.2.evidence));
            match better {
                Some((id, rival, better)) if better.evidence > best.evidence + 1.0 => {
                    progress(&format!("{} in the place of {id}", rival.unwrap_or("another law")));
                    best = self.fit_to_the_end(&better.model, better.unknown);
                }
                _ => return (best, standings),
            }
        }
        (best, standings)
    }

    /// Candidates with something else in the place of an effect, or with another of its laws.
    fn swaps(&self, best: &Fitted, without: &Fitted, id: &'static str) -> Vec<Swap> {
        let sizes = scales(&best.model.motor, self.data);
        let index = best.model.terms.iter().position(|term| term.id() == id).expect("one of its own terms");
        let term = &best.model.terms[index];
        let laws = term.effect.other_laws(&term.values, &sizes).into_iter();
        let elsewhere = term.effect.elsewhere(&term.values, &sizes).into_iter();
        let mut models: Vec<(Option<&'static str>, Model)> =
            laws.chain(elsewhere).map(|values| (None, best.model.with_values(index, values))).collect();
        for other in self.possible().into_iter().filter(|other| !best.model.has(other.about().id)) {
            if let Some(values) = other.instead_of(id, &term.values) {
                models.push((Some(other.about().id), without.model.with(other, values)));
            }
        }
        let makes_sense = |model: &Model| model.terms.iter().all(|term| model.alone(term.effect) != Some(Alone::Never));
        models
            .into_par_iter()
            .filter(|(_, model)| makes_sense(model))
            .map(|(rival, model)| (id, rival, self.fit(&model, best.unknown, Effort::TRIAL)))
            .collect()
    }

    /// What each effect that a candidate does not have promises, best first.
    fn promises(&self, fitted: &Fitted) -> Vec<Promise> {
        let filter =
            super::whiten::Whitener::new(self.data, &self.channels, &fitted.model.motor, fitted.unknown, &self.set);
        let dof = self.set.degrees_of_freedom;
        let weights: Vec<f64> = fitted.innovations.iter().map(|e| (dof + 1.0) / (dof + e * e)).collect();
        let pull = DVector::from_iterator(
            fitted.columns.len(),
            fitted.columns.iter().map(|column| weighted(column, &fitted.innovations, &weights)),
        );
        let size = fitted.normal.nrows();
        let inverse = fitted.normal.clone().try_inverse().unwrap_or_else(|| DMatrix::zeros(size, size));
        let base = Base {
            fitted,
            filter,
            weights,
            predicted: self.predict(&fitted.model, Steps::Coarse),
            motion: drive(&fitted.model, self.data, Steps::Coarse),
            inverse,
            pull,
        };
        let sizes = scales(&fitted.model.motor, self.data);
        let candidates: Vec<(&'static dyn Effect, Vec<f64>)> = self
            .possible()
            .into_iter()
            .filter(|effect| !fitted.model.has(effect.about().id))
            .filter(|effect| fitted.model.alone(*effect) != Some(Alone::Never))
            .flat_map(|effect| {
                self.screened(&base, effect, effect.starts(&sizes)).into_iter().map(move |start| (effect, start))
            })
            .collect();
        let mut all: Vec<Promise> =
            candidates.into_par_iter().map(|(effect, start)| self.promise(&base, effect, start)).collect();
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut best: Vec<Promise> = Vec::new();
        for promise in all {
            if best.iter().all(|other| other.effect.about().id != promise.effect.about().id) {
                best.push(promise);
            }
        }
        best
    }

    fn screened(&self, base: &Base, effect: &'static dyn Effect, starts: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if !effect.is_outer_torque() || starts.len() <= SCREENED {
            return starts;
        }
        let mut promised: Vec<(f64, Vec<f64>)> = starts
            .into_par_iter()
            .map(|start| {
                let lines: Vec<Vec<f64>> = lines(effect, &start)
                    .into_iter()
                    .map(|values| self.whitened(base, self.response(base, effect, &values)))
                    .collect();
                (self.gain(base, &lines).0, start)
            })
            .collect();
        promised.sort_by(|a, b| b.0.total_cmp(&a.0));
        promised.into_iter().take(SCREENED).map(|(_, start)| start).collect()
    }

    /// What a torque from outside changes, to the first order.
    fn response(&self, base: &Base, effect: &dyn Effect, values: &[f64]) -> Vec<Vec<f64>> {
        let model = &base.fitted.model;
        let motion = nudged(model, self.data, &base.motion, |at| {
            let mut terms = Balance::default();
            effect.contribute(values, &model.motor, at, &mut [], &mut terms);
            terms.torque_nm
        });
        self.read_motion(model, motion)
    }

    fn whitened(&self, base: &Base, mut predicted: Vec<Vec<f64>>) -> Vec<f64> {
        for (there, here) in predicted.iter_mut().zip(&base.predicted) {
            there.iter_mut().zip(here).for_each(|(there, here)| *there -= here);
        }
        base.filter.innovations(&predicted)
    }

    fn promise(&self, base: &Base, effect: &'static dyn Effect, start: Vec<f64>) -> Promise {
        let model = &base.fitted.model;
        let about = effect.about();
        let change = |values: Vec<f64>| self.whitened(base, self.predict(&model.with(effect, values), Steps::Coarse));
        let lines: Vec<Vec<f64>> = lines(effect, &start).into_iter().map(change).collect();
        let (gain, factors) = self.gain(base, &lines);
        let signed = about.parameters[0].min < 0.0;
        let possible = about.linear_in == 2 || factors[0] > 0.0 || signed && about.linear_in == 1;
        let mut start = start;
        for (value, factor) in start.iter_mut().zip(&factors).take(about.linear_in) {
            let magnitude = factor.abs().clamp(FACTORS[0], FACTORS[1]);
            *value *= magnitude * if signed { factor.signum() } else { 1.0 };
        }
        Promise { effect, start, gain: if possible { gain } else { 0.0 } }
    }

    /// What the best combination of new columns gains beside the candidate's own, in nats, and the factors of it.
    fn gain(&self, base: &Base, lines: &[Vec<f64>]) -> (f64, Vec<f64>) {
        let columns = &base.fitted.columns;
        let along = |line: &[f64]| {
            DVector::from_iterator(columns.len(), columns.iter().map(|column| weighted(column, line, &base.weights)))
        };
        let own: Vec<DVector<f64>> = lines.iter().map(|line| along(line)).collect();
        let size = lines.len();
        let mut normal = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        for row in 0..size {
            for column in 0..size {
                normal[(row, column)] = weighted(&lines[row], &lines[column], &base.weights)
                    - (own[row].transpose() * &base.inverse * &own[column])[0];
            }
            normal[(row, row)] += 1e-9 * weighted(&lines[row], &lines[row], &base.weights) + f64::MIN_POSITIVE;
            gradient[row] = weighted(&lines[row], &base.fitted.innovations, &base.weights)
                - (own[row].transpose() * &base.inverse * &base.pull)[0];
        }
        match normal.cholesky() {
            Some(cholesky) => {
                let factors = -cholesky.solve(&gradient);
                (-0.5 * gradient.dot(&factors), factors.iter().copied().collect())
            }
            None => (0.0, vec![0.0; size]),
        }
    }

    /// What the sensors of a model say of a motion, channel by channel.
    fn read_motion(&self, model: &Model, motion: Motion) -> Vec<Vec<f64>> {
        let place = self.channels.iter().position(|channel| channel.quantity == super::whiten::Quantity::Angle);
        let angle = place.map(|place| (place, crate::free_run::read_angle(model, self.data, motion.clone())));
        let mut predicted = read(model, self.data, motion);
        if let Some((place, angle)) = angle {
            predicted[place] = angle;
        }
        predicted
    }
}

/// An effect, the one in its place or none where it is another of its laws, and the candidate with that.
type Swap = (&'static str, Option<&'static str>, Fitted);

fn standing(best: &Fitted, id: &'static str, without: &Fitted, swaps: &[Swap], same_odds: f64) -> Standing {
    let mut rivals: Vec<(&'static str, f64)> = swaps
        .iter()
        .filter(|(of, ..)| *of == id)
        .filter_map(|(_, rival, fitted)| Some(((*rival)?, best.evidence - fitted.evidence)))
        .collect();
    rivals.sort_by(|a, b| a.1.total_cmp(&b.1));
    Standing {
        id,
        gain: best.evidence - without.evidence,
        without: without.model.clone(),
        same: rivals.iter().filter(|(_, worse)| *worse < same_odds).map(|(rival, _)| *rival).collect(),
        rival: rivals.first().copied(),
    }
}

/// The directions in which the constants of an effect are looked at.
fn lines(effect: &dyn Effect, start: &[f64]) -> Vec<Vec<f64>> {
    let without = |constant: usize| {
        let mut values = start.to_vec();
        values[constant] = 0.0;
        values
    };
    match effect.about().linear_in {
        2 => vec![without(1), without(0)],
        _ => vec![start.to_vec()],
    }
}

//! Selects effects. Forward: candidates by their derivatives, fitted in free run, judged on held-out data. Backward:
//! every effect is checked without it and against every rival.

mod backward;
mod forward;
mod winding;

use super::data_sheet::{doubts, has_wrong_values, is_implausible};
use super::judge::{AS_GOOD, Gain, NOT_NOISE, VERY_STRONG_NATS, above_floor, evidence_nats, gain};
use super::{another_part, bad_stretches, lateness, laws};
use crate::configuration::diagnose::select::{HALF_SUPPLY, LEAST_SIGMAS, MOST_EFFECTS, SAME_SHARE, SAME_SIGMAS};
pub(super) use crate::configuration::diagnose::select::{LEAST_SHARE, NEAR, SMALL_REST};
use crate::dataset::Dataset;
use crate::free_run::{Steps, drive, longest_step_s, read};
use crate::identify::{Effort, Fit, Fits, LEAST_PROMISE, Prior, Promise, Promises, scales};
use crate::parallel;
pub(super) use backward::NAMED_SIGMAS;
use forward::Lead;
use motorbench_model::catalogue::{ACTUATION_DELAY, CATALOGUE, Effect};
use motorbench_model::{Model, Term};
use std::collections::BTreeSet;

/// A step from one model to a larger one.
#[derive(Clone, Debug)]
pub struct Step {
    /// The effects that were added.
    pub added: Vec<&'static str>,
    /// Their gain on held-out data.
    pub gain: Gain,
}

impl Step {
    fn new(before: &Fit, after: &Fit, gain: Gain) -> Self {
        let ids = after.model.terms.iter().map(Term::id);
        Self { added: ids.filter(|id| !before.model.has(id)).collect(), gain }
    }
}

/// The evidence for one effect in the final model.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Its identifier.
    pub id: &'static str,
    /// The gain by it over a model without it, all others refitted.
    pub gain: Gain,
    /// Its best rival, and the gain of the effect over it.
    pub rival: Option<(&'static str, Gain)>,
    /// Effects that explain as much in its place.
    pub same: Vec<&'static str>,
}

/// The models from the linear one to the last.
#[derive(Clone)]
pub struct Selection {
    /// The linear motor, fitted.
    pub base: Fit,
    /// What was added in turn.
    pub steps: Vec<Step>,
    /// The model with every effect that was added.
    pub widest: Fit,
    /// The model with every effect that passed.
    pub last: Fit,
    /// The evidence for each of its effects.
    pub standings: Vec<Standing>,
}

/// A model, and the steps that led to it.
type Way = (Fit, Vec<Step>);

/// Called with a sentence when a step of the work begins.
pub type Progress<'a> = &'a (dyn Fn(&str) + Sync);

/// Selects the effects. `gives_up` is asked where the first way ends: if it does, there is none.
pub fn select(
    data: &Dataset,
    prior: &Prior,
    excluded: &[&str],
    gives_up: impl Fn(&Fit) -> bool,
    progress: Progress,
) -> Option<Selection> {
    progress("linear motor");
    let fits = Fits::new(data, prior);
    let base = fits.fit(&Model::linear(prior.motor), Effort::FULL);
    let chooser = Chooser { fits: &fits, data, prior, excluded, progress };
    let first = chooser.first_way(&base);
    if gives_up(&first.0) {
        return None;
    }
    let way = chooser.best_way(&base, first);
    let was_doubtful = chooser.is_doubtful(&way.0);
    let chosen = chooser.finished(&base, way);
    // What only many effects together explain may lose them one by one. A fit that is even better without has lost nothing.
    let has_lost = chosen.last.cost > chosen.widest.cost;
    if has_lost && !was_doubtful && chooser.is_doubtful(&chosen.last) {
        let other = chooser.finished(&base, chooser.way_from_usual(&base));
        if chooser.rank(&other.last) < chooser.rank(&chosen.last) {
            return Some(other);
        }
    }
    Some(chosen)
}

/// The rig file's motor with the effects that hardly any bench is without, fitted.
pub(super) fn usual_model(data: &Dataset, prior: &Prior, excluded: &[&str]) -> Fit {
    Chooser { fits: &Fits::new(data, prior), data, prior, excluded, progress: &|_| () }.usual_model()
}

/// The evidence for the effects of a model that was selected from other data.
pub fn anew_from(
    data: &Dataset,
    prior: &Prior,
    excluded: &[&str],
    found: Fit,
    steps: Vec<Step>,
    progress: Progress,
) -> Selection {
    beside_linear(data, prior, excluded, progress, |chooser, base| {
        let (last, standings) = chooser.backward(found.clone());
        Selection { base: base.clone(), steps, widest: found, last, standings }
    })
}

/// Selects further effects beside those that other data showed, and drops what these data do not show.
pub(super) fn select_beside(
    data: &Dataset,
    prior: &Prior,
    excluded: &[&str],
    found: Fit,
    steps: Vec<Step>,
    progress: Progress,
) -> Selection {
    beside_linear(data, prior, excluded, progress, |chooser, base| {
        let further = chooser.forward(found, steps, Lead::Significance);
        chooser.finished(base, further)
    })
}

/// Chooses effects with the linear motor fitted.
fn beside_linear<Chosen>(
    data: &Dataset,
    prior: &Prior,
    excluded: &[&str],
    progress: Progress,
    choose: impl FnOnce(&Chooser, &Fit) -> Chosen,
) -> Chosen {
    let fits = Fits::new(data, prior);
    let base = fits.fit(&Model::linear(prior.motor), Effort::FULL);
    choose(&Chooser { fits: &fits, data, prior, excluded, progress }, &base)
}

struct Chooser<'a> {
    fits: &'a Fits<'a>,
    data: &'a Dataset,
    prior: &'a Prior,
    excluded: &'a [&'a str],
    progress: Progress<'a>,
}

impl Chooser<'_> {
    /// The best way from the linear fit to a model without doubts.
    fn best_way(&self, base: &Fit, first: Way) -> Way {
        let mut way = self.way(base, first, f64::INFINITY);
        if let Some(of_any_course) = self.of_any_course(&way.0) {
            (self.progress)("without what follows any course");
            let excluded = [self.excluded, &[of_any_course]].concat();
            let without = Chooser { excluded: &excluded, ..*self };
            let other = without.way(base, without.first_way(base), NEAR * way.0.cost);
            way = self.better(way, other);
        }
        self.or_beside_nominal(way)
    }

    /// A way that ends with a plausible motor, if there is one beside the effects found.
    fn or_beside_nominal(&self, way: Way) -> Way {
        if !self.is_implausible(&way.0) && !self.may_coast_instead(&way.0) {
            return way;
        }
        let Some(other) = self.beside_nominal(&way.0) else { return way };
        let step = Step::new(&way.0, &other, self.gain(&way.0, &other));
        let steps = [&way.1[..], &[step]].concat();
        self.better(way, (other, steps))
    }

    /// Whether a drop takes half the supply. A bridge that coasts leaves `(2 duty - 1)` of the supply, less its own drop: so does
    /// one that drops half of it before a motor of half the size.
    fn may_coast_instead(&self, found: &Fit) -> bool {
        let supply_v = scales(&found.model.motor, self.data).supply_v;
        found.model.dry_losses().bridge_drop_v > HALF_SUPPLY * supply_v
    }

    /// A way to its end, with the effects that have evidence of their own.
    fn finished(&self, base: &Fit, (found, steps): Way) -> Selection {
        (self.progress)("to the end");
        let widest = self.replace_excessive_inductance(self.to_the_end(found));
        let (widest, steps) = self.or_beside_nominal(self.refined(widest, steps));
        let (last, standings) = self.backward(widest.clone());
        Selection { base: base.clone(), steps, widest, last, standings }
    }

    /// With a refined law of an effect where that has very strong evidence, and with what shows only beside it. Beside that
    /// law an effect that stood by the usual one may be nothing: then the law has to explain more than both.
    fn refined(&self, found: Fit, steps: Vec<Step>) -> Way {
        if !laws::may_be_refined(&found, self.data) {
            return (found, steps);
        }
        // What does not stand by the usual law need not stand by another.
        let (standing, _) = self.pruned(found.clone());
        let refined = laws::refined(&standing, self.data, self.prior).into_iter();
        let gains = |best: &Fit| standing.cost - best.cost > 2.0 * VERY_STRONG_NATS;
        // One that explains no more than this, were all readings independent, is the usual law: beside it shows what showed.
        let best = refined.min_by(|a, b| a.cost.total_cmp(&b.cost)).filter(gains);
        let Some(best) = best else { return (found, steps) };
        (self.progress)("beside another law");
        let (wider, added) = self.forward(best, Vec::new(), Lead::Evidence);
        // The looks of a way do not come to the end.
        let (wider, _) = self.pruned(self.to_the_end(wider));
        let least = VERY_STRONG_NATS + added.len() as f64 * (CATALOGUE.len() as f64).ln();
        match evidence_nats(self.data, &found, &wider) > least {
            true => (wider, [steps, added].concat()),
            false => (found, steps),
        }
    }

    /// Adds significant effects to the linear fit.
    fn first_way(&self, base: &Fit) -> Way {
        self.or_beside_nominal(self.forward(base.clone(), Vec::new(), Lead::Significance))
    }

    /// The first way, or the best of others as well where it ends with doubts. Where the first two are far from this cost, no
    /// other comes near.
    fn way(&self, base: &Fit, mut way: Way, far: f64) -> Way {
        if !self.is_doubtful(&way.0) || bad_stretches::are_all_that_remains(self.data, self.prior, &way.0) {
            return way;
        }
        let usual = self.way_from_usual(base);
        let agree = self.agree(&way.0, &usual.0);
        // Otherwise the rig file's motor is no good start: its values may be wrong.
        let is_no_start = usual.0.cost > way.0.cost;
        way = self.better(way, usual);
        if agree || way.0.cost > far {
            return way;
        }
        if is_no_start && self.is_doubtful(&way.0) {
            way = self.better(way, self.forward(base.clone(), Vec::new(), Lead::Cost));
        }
        if self.is_doubtful(&way.0)
            && let Some((anew, step)) = self.anew(base)
        {
            way = self.better(way, self.forward(anew, vec![step], Lead::Significance));
        }
        way
    }

    /// From the rig file's motor with the usual effects: a linear fit to a gap, a delay or a ramp puts them into its
    /// constants, and does not come back.
    fn way_from_usual(&self, base: &Fit) -> Way {
        (self.progress)("from the motor of the rig file");
        let usual = self.usual_model();
        let step = Step::new(base, &usual, self.gain(base, &usual));
        self.forward(usual, vec![step], Lead::Cost)
    }

    fn usual_model(&self) -> Fit {
        let model = self.with_usual(Model::linear(self.prior.motor), &scales(&self.prior.motor, self.data));
        let usual = self.fits.fit(&model, Effort::AGAIN);
        if above_floor(self.data, &usual) <= SMALL_REST {
            return usual;
        }
        // Beside a friction that is not there a fit does not find the delay.
        let late = [&usual.model, &Model::linear(self.prior.motor)].map(|model| self.delayed(model));
        let late: Vec<Model> = late.into_iter().flatten().collect();
        let effort = Effort::AGAIN.useless_above(usual.cost);
        let fits = parallel::map(late, |late| self.fits.fit(&late, effort));
        fits.into_iter().fold(usual, |best, late| if late.cost < best.cost { late } else { best })
    }

    /// With the delay by which a quick motor agrees best with the readings, if there is one. A fit that begins without one
    /// takes it for a slow winding, and does not come back.
    fn delayed(&self, model: &Model) -> Option<Model> {
        if !self.data.axis.drive.is_voltage() {
            return None;
        }
        let delay = self.possible().find(|effect| effect.about().id == ACTUATION_DELAY)?;
        let quick = lateness::at_once(&lateness::with_time_constant(model, lateness::QUICK_S), self.prior);
        let errors = lateness::errors(self.data, &self.fits.replay.free_run(model));
        let late_s = lateness::constant_s(self.data, &self.fits.replay.free_run(&quick), &errors);
        (late_s > 0.0).then(|| quick.with(delay, vec![late_s]))
    }

    /// Whether two ways from far apart end with the same effects and nearly the same small rest: a third one hardly ends
    /// with less.
    fn agree(&self, one: &Fit, other: &Fit) -> bool {
        let names = |fit: &Fit| fit.model.terms.iter().map(Term::id).collect::<BTreeSet<_>>();
        let are_as_good = |one: &Fit, other: &Fit| one.cost.max(other.cost) < AS_GOOD * one.cost.min(other.cost);
        // The looks of a way do not come to the end.
        let anew = |fit: &Fit| self.fits.fit(&fit.model, Effort::AGAIN);
        names(one) == names(other)
            && above_floor(self.data, one) < SMALL_REST
            && (are_as_good(one, other) || are_as_good(&anew(one), &anew(other)))
    }

    fn is_doubtful(&self, fit: &Fit) -> bool {
        self.doubts(fit) != ([false; 2], false) || self.excessive_inductance_h(fit).is_some()
    }

    fn better(&self, way: Way, other: Way) -> Way {
        if self.rank(&other.0) < self.rank(&way.0) { other } else { way }
    }

    /// The lower one is better.
    fn rank(&self, fit: &Fit) -> (([bool; 2], bool), f64) {
        (self.doubts(fit), fit.cost)
    }

    /// A rest that goes with another part held out is no doubt about the effects.
    fn doubts(&self, fit: &Fit) -> ([bool; 2], bool) {
        let [has_rest, is_implausible] = doubts(self.data, self.prior, fit);
        let has_rest = has_rest && another_part::held_out_and_explained(self.data, self.prior, fit).is_none();
        ([has_rest, is_implausible], has_wrong_values(self.prior, fit))
    }

    fn gain(&self, before: &Fit, after: &Fit) -> Gain {
        gain_over(self.data, before, after)
    }

    /// Effects that show in these channels.
    fn possible(&self) -> impl Iterator<Item = &'static dyn Effect> {
        CATALOGUE.iter().copied().filter(|effect| !self.excluded.contains(&effect.about().id))
    }

    fn promises(&self, from: &Fit) -> Promises {
        let scales = scales(&from.model.motor, self.data);
        let mut promises = from.promises(&self.fits.replay, &scales, self.excluded);
        promises.alone.retain(|promise| promise.gain > LEAST_PROMISE);
        promises
    }

    fn try_all(&self, from: &Fit, promises: &[Promise], effort: Effort) -> Vec<(&'static str, Fit)> {
        let tried = parallel::map(promises, |promise| {
            let effect = CATALOGUE[promise.effect];
            let starts = promise.other_starts.iter().chain([&promise.start]);
            let fits = parallel::map(starts, |start| {
                self.fits.fit_near(from, &from.model.with(effect, start.clone()), effort)
            });
            let best = fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("one start at least");
            (effect.about().id, best)
        });
        let is_there = |(id, fitted): &(&str, Fit)| fitted.model.term(id).is_some_and(Term::is_there);
        tried.into_iter().filter(is_there).collect()
    }

    /// Fits until nothing is gained, also from starting points where an effect may converge to a better solution.
    fn to_the_end(&self, mut last: Fit) -> Fit {
        last = self.or_other_laws(last, |_| true);
        last = self.fits.fit(&last.model, Effort::FULL);
        for index in 0..last.model.terms.len() {
            let Term { effect, values } = &last.model.terms[index];
            let elsewhere = effect.elsewhere(values, &scales(&last.model.motor, self.data));
            let others =
                parallel::map(elsewhere, |values| self.fits.fit(&last.model.with_values(index, values), Effort::TRIAL));
            let best = others.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
            if let Some(better) = best.filter(|best| best.cost < last.cost) {
                last = self.fits.fit(&better.model, Effort::FULL);
            }
        }
        last
    }

    /// The chosen effects with another of their laws, where that fits better, or equally well with fewer constants.
    fn or_other_laws(&self, mut found: Fit, chosen: impl Fn(&Term) -> bool) -> Fit {
        let scales = scales(&found.model.motor, self.data);
        for index in 0..found.model.terms.len() {
            let term = &found.model.terms[index];
            let others = term.effect.other_laws(&term.values, &scales);
            if !chosen(term) || others.is_empty() {
                continue;
            }
            let fitted = parallel::map(others, |values| {
                let start = self.fits.fit(&found.model.with_values(index, values), Effort::NONE);
                (start.cost < NEAR * found.cost).then(|| self.fits.fit(&start.model, Effort::TRIAL))
            });
            let mut fits: Vec<Fit> = fitted.into_iter().flatten().collect();
            if laws::is_refined(term, &scales) {
                // It came by very strong evidence, and goes only without it.
                fits.retain(|other| evidence_nats(self.data, other, &found) < VERY_STRONG_NATS);
            }
            fits.push(found);
            fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            let as_good = (0..fits.len()).filter(|law| is_same(&self.gain(&fits[*law], &fits[0])));
            let has_other_winding = |fit: &Fit| self.excessive_inductance_h(fit).is_some();
            let simplest =
                as_good.min_by_key(|law| (has_other_winding(&fits[*law]), fits[*law].model.terms[index].moving()));
            found = fits.swap_remove(simplest.unwrap_or(0));
        }
        found
    }

    /// The newest effect was tried with one law and beside one motor; this returns the best of all its laws.
    fn with_added_at_its_best(&self, found: Fit, added: impl Fn(&Term) -> bool) -> Fit {
        self.or_from_nominal(self.or_other_laws(found, added))
    }

    /// While a rest remains: the same effects beside the nominal motor, if that fits better. A motor fitted while an
    /// effect was missing does not always return to the right constants.
    fn or_from_nominal(&self, found: Fit) -> Fit {
        if above_floor(self.data, &found) < NOT_NOISE {
            return found;
        }
        let model = Model { motor: self.prior.motor, terms: found.model.terms.clone() };
        let other = self.fits.fit(&model, Effort::TRIAL);
        if other.cost < found.cost { other } else { found }
    }

    fn is_implausible(&self, fit: &Fit) -> bool {
        is_implausible(self.prior, fit)
    }
}

/// What one fit gains over another. If an effect's term needs finer time steps, both models are simulated with them, so
/// that the steps gain nothing.
fn gain_over(data: &Dataset, before: &Fit, after: &Fit) -> Gain {
    let step_s = [longest_step_s(&before.model), longest_step_s(&after.model)];
    let at = |fit: &Fit, own_s: f64| {
        let least_s = step_s[0].min(step_s[1]);
        (least_s < own_s).then(|| read(&fit.model, data, drive(&fit.model, data, Steps::AtMost(least_s))))
    };
    let finer = [at(before, step_s[0]), at(after, step_s[1])];
    let prediction = |fit: usize, own| finer[fit].as_ref().unwrap_or(own);
    gain(data, prediction(0, &before.prediction), prediction(1, &after.prediction))
}

/// Whether a model is no better than the other.
fn is_same(gain: &Gain) -> bool {
    gain.sigmas < SAME_SIGMAS || gain.share < SAME_SHARE
}

/// Very strong evidence for one effect of many: a priori it is as unlikely as they are many.
fn is_very_strong(nats: f64) -> bool {
    nats > VERY_STRONG_NATS + (CATALOGUE.len() as f64).ln()
}

fn has_evidence(gain: &Gain) -> bool {
    gain.sigmas > LEAST_SIGMAS && gain.share > LEAST_SHARE
}

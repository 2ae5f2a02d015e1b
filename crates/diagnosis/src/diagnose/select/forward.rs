//! Forward: what the derivatives promise is fitted in free run, and added while it earns its place.

use super::{Chooser, Gain, MOST_EFFECTS, Step, Way, earns_its_place};
use crate::diagnose::judge::{NOT_NOISE, above_floor, above_noise};
use crate::identify::{Effort, Fit, fit, scales};
use maybe_rayon::prelude::*;
use motorbench_model::catalogue::{ActsOn, CATALOGUE, Effect, Scales, USUAL};
use motorbench_model::{Model, Term};

/// Effects fitted at each step, of those that promise most.
const TRIED: usize = 4;
/// At each step only effects are fitted that promise this share of what the best does.
const TRIED_SHARE: f64 = 0.2;
/// While something remains, so many effects are added on trust: two that hide each other earn their places together.
const MOST_AHEAD: usize = 3;
/// They have to lower the cost to this share.
const LEAST_AHEAD: f64 = 0.9;
/// What lowers it to this share, and yet here and there makes it worse, has not been fitted to the end.
const NOT_THERE_YET: f64 = 0.5;

/// What says which effect is added next.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Lead {
    /// The lowest cost of those that earn their place by themselves.
    Significance,
    /// The lowest cost: what sticks in a few places gains most there, and is not significant before the rest is right.
    Cost,
}

impl Chooser<'_> {
    /// Adds effects to a model, as long as one is worth it, and tells the steps.
    pub(super) fn forward(&self, mut current: Fit, mut steps: Vec<Step>, lead: Lead) -> Way {
        let mut ahead = 0;
        while steps.len() < MOST_EFFECTS {
            let mut fits = self.candidates(&current, steps.is_empty());
            let significant = |fits: &[Fit]| match lead {
                Lead::Significance => self.first_that_earns_its_place(&current, fits),
                Lead::Cost => None,
            };
            let mut chosen = significant(&fits);
            if chosen.is_none()
                && let Some(best) = fits.first_mut().filter(|best| best.cost < NOT_THERE_YET * current.cost)
            {
                *best = fit(&best.model, self.data, self.prior, Effort::FULL);
                chosen = significant(&fits[..1]);
            }
            if chosen.is_none()
                && (ahead < MOST_AHEAD || lead == Lead::Cost)
                && above_floor(self.data, &current) > NOT_NOISE
            {
                ahead += 1;
                let best = fits.first().filter(|best| best.cost < LEAST_AHEAD * current.cost);
                chosen = best.map(|best| (0, self.gain(&current, best)));
            }
            let Some((chosen, gain)) = chosen else { break };
            let best = fits.swap_remove(chosen);
            steps.push(Step::new(&current, &best, gain));
            let added = |term: &Term| !current.model.has(term.id());
            current = self.with_added_at_its_best(best, added);
        }
        (current, steps)
    }

    /// Fits with one effect more, of those that promise most, the best first.
    fn candidates(&self, current: &Fit, is_linear_fit: bool) -> Vec<Fit> {
        let mut promises = self.promises(current);
        promises.truncate(TRIED);
        let best = promises.first().map_or(0.0, |promise| promise.gain);
        promises.retain(|promise| promise.gain > TRIED_SHARE * best);
        (self.progress)(&format!("{} effects, trying {}", current.model.terms.len(), promises.len()));
        let tried = self.try_all(&current.model, &promises, Effort::TRIAL.useless_above(current.cost));
        let mut fits: Vec<Fit> = tried.into_iter().map(|(_, fit)| fit).collect();
        if is_linear_fit && !promises.is_empty() {
            fits.extend(self.fresh(current));
        }
        fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        fits
    }

    fn first_that_earns_its_place(&self, current: &Fit, fits: &[Fit]) -> Option<(usize, Gain)> {
        let gains = fits.iter().map(|fit| self.gain(current, fit));
        gains.enumerate().find(|(_, gain)| earns_its_place(gain))
    }

    /// Fits from the nominal motor: of the effects that leave nothing of the linear fit, and of the two that hardly any
    /// bench is without, together and with the former.
    fn fresh(&self, base: &Fit) -> Vec<Fit> {
        let effort = Effort::TRIAL.useless_above(base.cost);
        let scales = scales(&self.prior.motor, self.data);
        let nominal = Model::linear(self.prior.motor);
        // Their rarer laws only where something remains: most that look like one at first are none.
        let mut models = self.with_what_changes_everything(&nominal, &scales);
        models.retain(|model| !model.terms.last().is_some_and(Term::has_another_law));
        if self.usual().count() == USUAL.len() {
            let bare = models.clone().into_iter().chain([nominal]);
            models.extend(bare.map(|model| self.with_usual(model, &scales)));
        }
        models.into_par_iter().map(|model| fit(&model, self.data, self.prior, effort)).collect()
    }

    /// Where the way from the linear fit has led to a dead end or to a strange motor, another: from the nominal motor, each
    /// effect together with the two that hardly any bench is without, or with one that changes everything. The best, of
    /// those with a motor that is not strange if there are any.
    pub(super) fn anew(&self, base: &Fit) -> Option<(Fit, Step)> {
        (self.progress)("other ways");
        let scales = scales(&self.prior.motor, self.data);
        let usual = |model| self.with_usual(model, &scales);
        let nominal = Model::linear(self.prior.motor);
        let changed = self.with_what_changes_everything(&nominal, &scales);
        let beginnings = [usual(nominal.clone())].into_iter().chain(changed.iter().cloned());
        let models = beginnings.flat_map(|from| {
            // Of an effect with alternatives the one that promises most.
            let promises = fit(&from, self.data, self.prior, Effort::NONE).promises(self.data, &scales, self.excluded);
            let others = promises.into_iter().map(|promise| (CATALOGUE[promise.effect], promise.start));
            others.map(|(effect, start)| from.with(effect, start)).collect::<Vec<_>>()
        });
        let fits: Vec<_> = models
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|model| fit(&model, self.data, self.prior, Effort::TRIAL))
            .collect();
        let key = |fit: &Fit| (self.is_strange(fit), fit.cost);
        let best =
            |fits: Vec<Fit>| fits.into_iter().min_by(|a, b| key(a).partial_cmp(&key(b)).expect("costs are finite"));
        // From so far away a trial does not arrive, with many effects at once not even near.
        let whole = changed.into_iter().map(usual);
        let last: Vec<Model> = [best(fits)?.model].into_iter().chain(whole).collect();
        let last = last.into_par_iter().map(|model| fit(&model, self.data, self.prior, Effort::AGAIN)).collect();
        let best = best(last)?;
        let step = Step::new(base, &best, self.gain(base, &best));
        Some((best, step))
    }

    /// What was found, beside the nominal motor and with an effect that changes everything in place of those of the voltage,
    /// a usual drop or none besides: a great drop and a motor of half the size make up for a bridge that coasts.
    pub(super) fn beside_nominal(&self, found: &Fit) -> Option<Fit> {
        let scales = scales(&self.prior.motor, self.data);
        let mut nominal = Model { motor: self.prior.motor, terms: found.model.terms.clone() };
        nominal.terms.retain(|term| term.effect.about().acts_on != [ActsOn::Voltage]);
        let changed = self.with_what_changes_everything(&nominal, &scales);
        let of_the_bridge = self.usual().filter(|effect| effect.about().acts_on == [ActsOn::Voltage]);
        let besides: Vec<Model> = of_the_bridge
            .flat_map(|effect| changed.iter().map(move |model| model.with_start(effect, &scales)))
            .collect();
        let fits = changed.into_iter().chain(besides).collect::<Vec<_>>().into_par_iter();
        fits.map(|model| fit(&model, self.data, self.prior, Effort::FULL)).min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// An effect that follows any course and yet leaves more than noise: what comes at some moment is the first to seize what
    /// two others do together.
    pub(super) fn of_any_course(&self, fit: &Fit) -> Option<&'static str> {
        let id = fit.model.terms.iter().find(|term| term.effect.about().fits_any_course)?.id();
        (above_noise(self.data, fit) > NOT_NOISE).then_some(id)
    }

    /// The effects that hardly any bench is without.
    fn usual(&self) -> impl Iterator<Item = &'static dyn Effect> {
        self.possible().filter(|effect| USUAL.contains(&effect.about().id))
    }

    fn with_usual(&self, model: Model, scales: &Scales) -> Model {
        self.usual().fold(model, |model, effect| model.with_start(effect, scales))
    }

    /// A model with each effect that changes everything and that it does not have, with each of its laws.
    fn with_what_changes_everything(&self, model: &Model, scales: &Scales) -> Vec<Model> {
        let effects =
            self.possible().filter(|effect| effect.about().changes_everything && !model.has(effect.about().id));
        effects
            .flat_map(|effect| effect.starts(scales).into_iter().map(move |start| (effect, start)))
            .map(|(effect, start)| model.with(effect, start))
            .collect()
    }
}

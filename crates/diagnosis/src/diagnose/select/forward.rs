//! Forward: fits the candidates in free run and adds those with evidence.

use super::backward::names_by_evidence;
use super::{Chooser, Gain, MOST_EFFECTS, Step, Way, has_evidence, is_very_strong};
use crate::configuration::diagnose::select_forward::{
    AT_A_TIME, LEAST_COST_WITHOUT_EVIDENCE, MOST_WITHOUT_EVIDENCE, NEARLY_AS_PROMISING, NOT_THERE_YET, TRIED,
    TRIED_SHARE,
};
use crate::diagnose::judge::{NOT_NOISE, above_floor, above_noise, evidence_nats};
use crate::identify::{EffectStart, Effort, Fit, Promises, scales};
use crate::parallel;
use motorbench_model::catalogue::{ActsOn, Alone, CATALOGUE, Effect, Scales, USUAL};
use motorbench_model::unit::Quantity;
use motorbench_model::{Model, Term};

/// The rule for the next effect.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Lead {
    /// The lowest cost among those with evidence of their own.
    Significance,
    /// The lowest cost. An effect at standstill gains most in a few places, and becomes significant only when the rest
    /// is right.
    Cost,
    /// The lowest cost among those with very strong evidence. For what is judged as a whole at its end.
    Evidence,
}

impl Chooser<'_> {
    /// Adds effects to a model while one has evidence, and records the steps.
    pub(super) fn forward(&self, mut current: Fit, mut steps: Vec<Step>, lead: Lead) -> Way {
        let mut ahead = 0;
        while steps.len() < MOST_EFFECTS {
            let mut fits = self.candidates(&current, lead, steps.is_empty());
            let significant = |fits: &[Fit]| match lead {
                Lead::Significance => self.first_with_evidence(&current, fits),
                Lead::Cost => None,
                Lead::Evidence => self.first_with_strong_evidence(&current, fits),
            };
            let mut chosen = significant(&fits);
            if chosen.is_none()
                && let Some(best) = fits.first_mut().filter(|best| best.cost < NOT_THERE_YET * current.cost)
            {
                *best = self.fits.fit(&best.model, Effort::FULL);
                chosen = significant(&fits[..1]);
            }
            let has_rest = above_floor(self.data, &current) > NOT_NOISE;
            // By cost, a wave comes when nothing greater remains.
            if chosen.is_none() && (lead != Lead::Cost || !has_rest) {
                chosen = self.first_by_number(&current, &fits);
            }
            if chosen.is_none() && lead == Lead::Significance && !has_rest {
                chosen = self.first_in_other_parts(&current, &fits);
            }
            if chosen.is_none() && has_rest {
                fits.extend(self.at_breakaway(&current));
                fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
                chosen = significant(&fits);
            }
            if chosen.is_none() && (ahead < MOST_WITHOUT_EVIDENCE || lead == Lead::Cost) && has_rest {
                ahead += 1;
                let best = fits.first().filter(|best| best.cost < LEAST_COST_WITHOUT_EVIDENCE * current.cost);
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

    /// Fits with one more effect, of the most promising ones, the best first.
    fn candidates(&self, current: &Fit, lead: Lead, is_first: bool) -> Vec<Fit> {
        let Promises { alone: mut promises, together } = self.promises(current);
        let best = promises.first().map_or(0.0, |promise| promise.gain);
        let nearly = promises.iter().take_while(|promise| promise.gain > NEARLY_AS_PROMISING * best).count();
        // Beside a refined law, what shows only together promises little: the law's constants move with it.
        if lead != Lead::Evidence {
            promises.truncate(nearly.max(TRIED));
        }
        promises.retain(|promise| promise.gain > TRIED_SHARE * best);
        (self.progress)(&format!("{} effects, trying {}", current.model.terms.len(), promises.len()));
        let effort = Effort::TRIAL.useless_above(current.cost);
        let tried = self.try_all(current, &promises, effort);
        let mut fits: Vec<Fit> = tried.into_iter().map(|(_, fit)| fit).collect();
        fits.extend(together.map(|pair| {
            let with = |model: Model, start: EffectStart| model.with(CATALOGUE[start.effect], start.values);
            self.fits.fit_near(current, &pair.into_iter().fold(current.model.clone(), with), effort)
        }));
        if is_first && lead != Lead::Evidence && !promises.is_empty() {
            fits.extend(self.fresh(current));
        }
        fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        fits
    }

    /// Fits with what acts where a resting shaft breaks loose. It moves the begin of the motion, so that the first
    /// derivatives promise nothing.
    fn at_breakaway(&self, current: &Fit) -> Vec<Fit> {
        let scales = scales(&current.model.motor, self.data);
        let absent = self.possible().filter(|effect| !current.model.has(effect.about().id));
        let starts = absent.filter(|effect| effect.about().acts_at_breakaway).flat_map(|effect| {
            effect.starts(&scales).into_iter().map(move |start| (effect, start)).collect::<Vec<_>>()
        });
        let models: Vec<Model> = starts.map(|(effect, start)| current.model.with(effect, start)).collect();
        let effort = Effort::TRIAL.useless_above(current.cost);
        parallel::map(models, |model| self.fits.fit_near(current, &model, effort))
    }

    fn first_with_evidence(&self, current: &Fit, fits: &[Fit]) -> Option<(usize, Gain)> {
        let gains = fits.iter().map(|fit| self.gain(current, fit));
        gains.enumerate().find(|(_, gain)| has_evidence(gain))
    }

    fn first_with_strong_evidence(&self, current: &Fit, fits: &[Fit]) -> Option<(usize, Gain)> {
        let gains = fits.iter().map(|fit| (self.gain(current, fit), evidence_nats(self.data, current, fit)));
        let (index, (gain, _)) = gains.enumerate().find(|(_, (gain, nats))| names_by_evidence(gain, *nats))?;
        Some((index, gain))
    }

    /// A wave that its number shows, however small it is.
    fn first_by_number(&self, current: &Fit, fits: &[Fit]) -> Option<(usize, Gain)> {
        fits.iter().enumerate().find_map(|(index, fit)| {
            let wave = fit.model.terms.iter().find(|term| !current.model.has(term.id()))?;
            let own = self.gain(current, fit);
            let is_named = is_very_strong(evidence_nats(self.data, current, fit))
                && self.names_by_number(&own, current, fit, wave)
                && self.number_matters(fit, current, wave.id());
            is_named.then_some((index, own))
        })
    }

    /// What acts in a few moments alone may hardly show in the part that is held out, nor in the mean of what is left.
    fn first_in_other_parts(&self, current: &Fit, fits: &[Fit]) -> Option<(usize, Gain)> {
        let gains = fits.iter().map(|fit| (fit, self.gain(current, fit), evidence_nats(self.data, current, fit)));
        let named = |(_, (fit, own, nats)): &(usize, (&Fit, Gain, f64))| {
            is_very_strong(*nats) && self.names_with_other_parts(own, current, fit, *nats)
        };
        gains.enumerate().find(named).map(|(index, (_, own, _))| (index, own))
    }

    /// Fits from the nominal motor, with effects of which the linear fit leaves no trace. Also with the two effects of
    /// nearly every bench, alone and together with the former.
    fn fresh(&self, base: &Fit) -> Vec<Fit> {
        let effort = Effort::TRIAL.useless_above(base.cost);
        let scales = scales(&self.prior.motor, self.data);
        let nominal = Model::linear(self.prior.motor);
        // The linear fit has put a delay into its winding.
        let delayed = self.delayed(&nominal);
        // Their rarer laws only if a rest remains: most that look like one at first are none.
        let mut models = self.with_global_effects(&nominal, &scales);
        models.retain(|model| !model.terms.last().is_some_and(Term::has_another_law));
        if self.usual().count() == USUAL.len() {
            let bare = models.clone().into_iter().chain([nominal]);
            models.extend(bare.map(|model| self.with_usual(model, &scales)));
        }
        models.extend(delayed);
        parallel::map(models, |model| self.fits.fit(&model, effort))
    }

    /// Another start, if the way from the linear fit failed or gave an implausible motor. From the nominal motor, each
    /// effect is combined with the two of nearly every bench, or with one that changes the whole motion. The best is
    /// taken, if possible with a plausible motor.
    pub(super) fn anew(&self, base: &Fit) -> Option<(Fit, Step)> {
        (self.progress)("other ways");
        let scales = scales(&self.prior.motor, self.data);
        let usual = |model| self.with_usual(model, &scales);
        let nominal = Model::linear(self.prior.motor);
        let changed = self.with_global_effects(&nominal, &scales);
        let beginnings = [usual(nominal.clone())].into_iter().chain(changed.iter().cloned());
        let starts = beginnings.flat_map(|from| {
            // Of an effect with alternative laws, the one that promises most.
            let from = self.fits.fit(&from, Effort::NONE);
            let promises = from.promises(&self.fits.replay, &scales, self.excluded).alone;
            let promised = promises
                .into_iter()
                .map(|promise| (from.cost - promise.gain, from.model.with(CATALOGUE[promise.effect], promise.start)));
            promised.collect::<Vec<_>>()
        });
        let fits = self.best_first(starts.collect());
        let key = |fit: &Fit| (self.is_implausible(fit), fit.cost);
        let best =
            |fits: Vec<Fit>| fits.into_iter().min_by(|a, b| key(a).partial_cmp(&key(b)).expect("costs are finite"));
        // From so far away a trial fit does not converge, and with many effects at once it does not come near.
        let whole = changed.into_iter().map(usual);
        let last = [best(fits)?.model].into_iter().chain(whole);
        let best = best(parallel::map(last, |model| self.fits.fit(&model, Effort::AGAIN)))?;
        let step = Step::new(base, &best, self.gain(base, &best));
        Some((best, step))
    }

    /// Fits from many starts with their expected costs, the most promising ones first. A fit ends where it cannot become
    /// better than those before, and all of them end when several in turn did not.
    fn best_first(&self, mut starts: Vec<(f64, Model)>) -> Vec<Fit> {
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut fits: Vec<Fit> = Vec::new();
        let least = |fits: &[Fit]| fits.iter().map(|fit| fit.cost).fold(f64::INFINITY, f64::min);
        for batch in starts.chunks(AT_A_TIME) {
            let before = least(&fits);
            let effort = Effort::TRIAL.useless_above(before);
            fits.extend(parallel::map(batch, |(_, model)| self.fits.fit(model, effort)));
            if least(&fits) >= before {
                break;
            }
        }
        fits
    }

    /// The effects found, beside the nominal motor, with an effect that changes the whole motion in place of a drop, and
    /// beside a usual one. A large drop and a motor of half the size resemble a bridge that coasts.
    pub(super) fn beside_nominal(&self, found: &Fit) -> Option<Fit> {
        let scales = scales(&self.prior.motor, self.data);
        let others = found.model.terms.iter().filter(|term| term.dry_losses().bridge_drop_v == 0.0);
        // As large beside this motor as they were beside the other one.
        let factor = self.prior.motor.torque_constant_nm_per_a / found.model.motor.torque_constant_nm_per_a;
        let terms = others.map(|term| term.scaled(Quantity::Voltage, factor)).collect();
        let without_drop = Model { motor: self.prior.motor, terms };
        let mut nominal = without_drop.clone();
        nominal.terms.retain(|term| without_drop.alone(term.effect) != Some(Alone::Never));
        let changed = self.with_global_effects(&nominal, &scales);
        let of_the_bridge = self.usual().filter(|effect| effect.about().acts_on == [ActsOn::Voltage]);
        let besides: Vec<Model> = of_the_bridge
            .flat_map(|effect| changed.iter().map(move |model| model.with_start(effect, &scales)))
            .collect();
        let fits = parallel::map(changed.into_iter().chain(besides), |model| self.fits.fit(&model, Effort::FULL));
        let ranked = fits.into_iter().map(|fit| (self.rank(&fit), fit));
        let best = ranked.min_by(|a, b| a.0.partial_cmp(&b.0).expect("costs are finite"));
        best.map(|(_, fit)| fit)
    }

    /// An effect that fits any course over time and still leaves more than noise: a change at some moment is the first
    /// to absorb what two others cause together.
    pub(super) fn of_any_course(&self, fit: &Fit) -> Option<&'static str> {
        let id = fit.model.terms.iter().find(|term| term.effect.about().fits_any_course)?.id();
        (above_noise(self.data, fit) > NOT_NOISE).then_some(id)
    }

    /// The effects that nearly every bench has.
    fn usual(&self) -> impl Iterator<Item = &'static dyn Effect> {
        self.possible().filter(|effect| USUAL.contains(&effect.about().id))
    }

    pub(super) fn with_usual(&self, model: Model, scales: &Scales) -> Model {
        self.usual().fold(model, |model, effect| model.with_start(effect, scales))
    }

    /// Models with each effect that changes the whole motion and is absent so far, with each of its laws.
    fn with_global_effects(&self, model: &Model, scales: &Scales) -> Vec<Model> {
        let effects =
            self.possible().filter(|effect| effect.about().changes_everything && !model.has(effect.about().id));
        effects
            .flat_map(|effect| effect.starts(scales).into_iter().map(move |start| (effect, start)))
            .map(|(effect, start)| model.with(effect, start))
            .collect()
    }
}

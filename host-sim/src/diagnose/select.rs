//! Which effects the data ask for: forward by what the derivatives promise, fitted in free run, judged on data kept back;
//! then backward, and against every rival.

use super::DATA_SHEET_TOLERANCE;
use super::judge::{Gain, NOT_NOISE, above_floor, gain, sigmas_together};
use crate::catalogue::{ActsOn, Alone, CATALOGUE, Effect, INDUCTANCE, Parameter, Scales, USUAL, effect};
use crate::dataset::{Dataset, Measured};
use crate::free_run::{Steps, drive, longest_step_s, read};
use crate::identify::{Effort, Fit, LEAST_PROMISE, Prior, Promise, fit, scales};
use crate::model::{Model, Term};
use crate::motor::MotorParameters;
use rayon::prelude::*;

/// Effects fitted at each step, of those that promise most.
const TRIED: usize = 4;
/// Effects at most.
const MOST_EFFECTS: usize = 7;
/// An effect is worth trying further with this significance...
const LEAST_SIGMAS: f64 = 3.0;
/// ... and is named with this one, everything else being there: many effects are tried, and residuals have long tails. On
/// benches invented for the purpose right names have more than ten.
pub(super) const NAMED_SIGMAS: f64 = 6.0;
/// ... or, where the data kept back leave it open, with this one on all data. More is asked of three times as much: what a
/// model does wrong everywhere repeats itself.
const NAMED_ON_ALL_SIGMAS: f64 = 8.0;
/// An effect that is rarely without the one that it stands on has at least this without; those that were wrong had ten.
const ALONE_SIGMAS: f64 = 50.0;
/// With at least this share of the error that is left.
const LEAST_SHARE: f64 = 0.02;
/// A law that looks like an effect's and is none is the better one with this significance, however little it gains.
const OTHER_LAW_SIGMAS: f64 = 3.0;
/// An effect that makes the error of a quantity so many times greater, beyond the noise, explains one at the cost of another.
const SPOILT: f64 = 1.5;
/// Two models closer than this cannot be told apart.
const SAME_SIGMAS: f64 = 2.5;
const SAME_SHARE: f64 = 0.02;
/// Rivals fitted in place of each effect found; beside the best only those that promise this share of what it gains.
const RIVALS: usize = 3;
const RIVAL_SHARE: f64 = 0.7;
/// At each step only effects are fitted that promise this share of what the best does.
const TRIED_SHARE: f64 = 0.2;
/// While something remains, so many effects are added on trust: two that hide each other earn their places together.
const MOST_AHEAD: usize = 3;
/// They have to lower the cost to this share.
const LEAST_AHEAD: f64 = 0.9;
/// What lowers it to this share, and yet here and there makes it worse, has not been fitted to the end.
const NOT_THERE_YET: f64 = 0.5;
/// Standard deviation of the logarithm of a nominal viscous friction.
const VISCOUS_SPREAD: f64 = 0.5;
/// Squares of the deviations of R, k and J from their nominal values, in standard deviations, that no data sheet explains:
/// as many for each that has one.
const STRANGE_EACH: f64 = 8.0;
/// As many more than with an effect speak for it as well: it is rather there than such a motor.
const STRANGER: f64 = 18.0;
/// Another law of an effect, or a rival, is fitted further if as it stands it costs no more than this many times what there is.
const NEAR: f64 = 10.0;
/// An inductance this many times the nominal one may be an effect.
const EXCESSIVE_INDUCTANCE: f64 = 1.35;
/// Constants that say how large a motor is. What an inductance is depends on the frequency it is measured at.
pub(super) const OF_SIZE: [&str; 3] = ["resistance_ohm", "torque_constant_Nm_per_A", "inertia_kg_m2"];
/// Spread of the logarithm of an inductance that is held.
const CERTAIN: f64 = 0.01;
/// Of a wave, so many other numbers of periods are looked at; it is none if more than half of them gain this share of what
/// it gains, and leave less than this many times what it leaves.
const OTHER_NUMBERS: usize = 6;
const GAINED_BY_ANY: f64 = 0.5;
const LEFT_BY_ANY: f64 = 2.0;

/// A step from one model to a larger one.
#[derive(Clone, Debug)]
pub struct Step {
    /// The effects that were added.
    pub added: Vec<&'static str>,
    /// What they gained on data kept back.
    pub gain: Gain,
}

impl Step {
    fn new(before: &Fit, after: &Fit, gain: Gain) -> Self {
        let ids = after.model.terms.iter().map(Term::id);
        Self { added: ids.filter(|id| !before.model.has(id)).collect(), gain }
    }
}

/// What holds of one effect in the final model.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Which.
    pub id: &'static str,
    /// What the model gains by it, all others refitted without it.
    pub gain: Gain,
    /// The best rival in its place, and what the effect gains over it.
    pub rival: Option<(&'static str, Gain)>,
    /// Effects that serve as well in its place.
    pub same: Vec<&'static str>,
}

/// The models from the linear one to the last.
#[derive(Clone)]
pub struct Selection {
    /// The linear motor, fitted.
    pub base: Fit,
    /// What was added in turn.
    pub steps: Vec<Step>,
    /// The model with everything that earns its place.
    pub last: Fit,
    /// What holds of each of its effects.
    pub standings: Vec<Standing>,
}

/// What says which effect is added next.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Lead {
    /// The lowest cost of those that earn their place by themselves.
    Significance,
    /// The lowest cost: what sticks in a few places gains most there, and is not significant before the rest is right.
    Cost,
}

/// A model, and the steps that led to it.
type Way = (Fit, Vec<Step>);

/// Called with a sentence whenever the work goes on.
pub type Progress<'a> = &'a (dyn Fn(&str) + Sync);

/// Selects.
pub fn select(data: &Dataset, prior: &Prior, excluded: &[&str], progress: Progress) -> Selection {
    progress("linear motor");
    let base = fit(&Model::linear(prior.motor), data, prior, Effort::FULL);
    let chooser = Chooser { data, prior, excluded, progress };
    let doubts = |fit: &Fit| (doubts(data, prior, fit), has_wrong_values(prior, fit));
    let key = |(fit, _): &Way| (doubts(fit), fit.cost);
    let better = |way: Way, other: Way| if key(&other) < key(&way) { other } else { way };
    let is_doubtful = |(fit, _): &Way| doubts(fit) != ([false; 2], false);
    let mut way = chooser.forward(base.clone(), Vec::new(), Lead::Significance);
    if is_doubtful(&way) {
        way = better(way, chooser.forward(base.clone(), Vec::new(), Lead::Cost));
    }
    if is_doubtful(&way)
        && let Some((anew, step)) = chooser.anew(&base)
    {
        way = better(way, chooser.forward(anew, vec![step], Lead::Significance));
    }
    if chooser.is_strange(&way.0)
        && let Some(other) = chooser.beside_nominal(&way.0)
    {
        let step = Step::new(&way.0, &other, chooser.gain(&way.0, &other));
        let steps = [&way.1[..], &[step]].concat();
        way = better(way, (other, steps));
    }
    let (mut last, steps) = way;
    progress("to the end");
    last = chooser.or_instead_of_inductance(chooser.to_the_end(last));
    let (last, standings) = chooser.backward(last);
    Selection { base, steps, last, standings }
}

/// A model without one of its effects.
struct Check {
    id: &'static str,
    without: Fit,
    /// What the effect gains over it.
    own: Gain,
    is_named: bool,
}

struct Chooser<'a> {
    data: &'a Dataset,
    prior: &'a Prior,
    excluded: &'a [&'a str],
    progress: Progress<'a>,
}

impl Chooser<'_> {
    /// What one fit gains over another. An effect whose term needs finer steps gains nothing by the steps themselves: the
    /// other one is simulated with the same.
    fn gain(&self, before: &Fit, after: &Fit) -> Gain {
        let step_s = [longest_step_s(&before.model), longest_step_s(&after.model)];
        let at = |fit: &Fit, own_s: f64| {
            let least_s = step_s[0].min(step_s[1]);
            (least_s < own_s).then(|| read(&fit.model, self.data, drive(&fit.model, self.data, Steps::AtMost(least_s))))
        };
        let finer = [at(before, step_s[0]), at(after, step_s[1])];
        let prediction = |fit: usize, own| finer[fit].as_ref().unwrap_or(own);
        gain(self.data, prediction(0, &before.prediction), prediction(1, &after.prediction))
    }

    /// Fits until nothing is gained, also from where some effect may come to a better end.
    fn to_the_end(&self, mut last: Fit) -> Fit {
        last = self.or_other_laws(last, |_| true);
        last = fit(&last.model, self.data, self.prior, Effort::FULL);
        for index in 0..last.model.terms.len() {
            let Term { effect, values } = &last.model.terms[index];
            let others = effect
                .elsewhere(values, &scales(&last.model.motor, self.data))
                .into_par_iter()
                .map(|values| fit(&last.model.with_values(index, values), self.data, self.prior, Effort::TRIAL));
            let best = others.min_by(|a, b| a.cost.total_cmp(&b.cost));
            if let Some(better) = best.filter(|best| best.cost < last.cost) {
                last = fit(&better.model, self.data, self.prior, Effort::FULL);
            }
        }
        last
    }

    /// The effects that are chosen with another of their laws, where that comes to a better end, or to one as good with fewer
    /// constants.
    fn or_other_laws(&self, mut found: Fit, chosen: impl Fn(&Term) -> bool) -> Fit {
        let scales = scales(&found.model.motor, self.data);
        for index in 0..found.model.terms.len() {
            let term = &found.model.terms[index];
            let others = term.effect.other_laws(&term.values, &scales);
            if !chosen(term) || others.is_empty() {
                continue;
            }
            let laws = others
                .into_par_iter()
                .map(|values| fit(&found.model.with_values(index, values), self.data, self.prior, Effort::NONE));
            let near = laws.filter(|fit| fit.cost < NEAR * found.cost);
            let mut fits: Vec<Fit> = near.map(|near| fit(&near.model, self.data, self.prior, Effort::TRIAL)).collect();
            fits.push(found);
            fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            let as_good = (0..fits.len()).filter(|law| is_same(&self.gain(&fits[*law], &fits[0])));
            let has_other_winding = |fit: &Fit| self.excessive_inductance_h(fit).is_some();
            let simplest =
                as_good.min_by_key(|law| (fits[*law].model.terms[index].moving(), has_other_winding(&fits[*law])));
            found = fits.swap_remove(simplest.unwrap_or(0));
        }
        found
    }

    /// In place of an inductance that no data sheet has: an effect that looks like it, where that says as much.
    fn or_instead_of_inductance(&self, found: Fit) -> Fit {
        let found = self.or_beside_nominal_inductance(found);
        let Some(excess_h) = self.excessive_inductance_h(&found) else { return found };
        let excess_s = excess_h / found.model.motor.resistance_ohm;
        let others = self.possible().filter(|effect| !found.model.has(effect.about().id));
        let like_it = others.filter_map(|effect| Some((effect, effect.instead_of(INDUCTANCE, &[excess_s])?)));
        let fits = like_it.map(|(effect, values)| {
            let mut model = found.model.with(effect, values);
            model.motor.inductance_h -= excess_h;
            self.or_other_laws(fit(&model, self.data, self.prior, Effort::FULL), |term| term.id() == effect.about().id)
        });
        let has_the_winding = fits.filter(|other| self.excessive_inductance_h(other).is_none());
        match has_the_winding.min_by(|a, b| a.cost.total_cmp(&b.cost)) {
            Some(other) if is_same(&self.gain(&other, &found)) => other,
            _ => found,
        }
    }

    /// Where such an effect is there already and has left the inductance what it had become without it: both from the nominal one.
    fn or_beside_nominal_inductance(&self, found: Fit) -> Fit {
        let has_like_it = found.model.terms.iter().any(|term| looks_like_inductance(term.id()));
        if !has_like_it || self.excessive_inductance_h(&found).is_none() {
            return found;
        }
        let held = self.with_nominal_inductance(&found);
        let other = fit(&held.model, self.data, self.prior, Effort::FULL);
        let other = self.or_other_laws(other, |term| looks_like_inductance(term.id()));
        if other.cost < found.cost { other } else { found }
    }

    /// By how much the inductance is above the nominal one, where that is much.
    fn excessive_inductance_h(&self, fit: &Fit) -> Option<f64> {
        let nominal_h = self.prior.nominal.inductance_h?;
        let found_h = fit.model.motor.inductance_h;
        (found_h > EXCESSIVE_INDUCTANCE * nominal_h).then_some(found_h - nominal_h)
    }

    /// What was just added has been tried with one law and beside one motor; this is the best of all.
    fn with_added_at_its_best(&self, found: Fit, added: impl Fn(&Term) -> bool) -> Fit {
        self.or_from_nominal(self.or_other_laws(found, added))
    }

    /// While something remains: the same effects beside the nominal motor, if that comes to a better end. A motor that was
    /// fitted while an effect was missing does not always come back.
    fn or_from_nominal(&self, found: Fit) -> Fit {
        if above_floor(self.data, &found) < NOT_NOISE {
            return found;
        }
        let model = Model { motor: self.prior.motor, terms: found.model.terms.clone() };
        let other = fit(&model, self.data, self.prior, Effort::TRIAL);
        if other.cost < found.cost { other } else { found }
    }

    /// Effects that these channels say something of.
    fn possible(&self) -> impl Iterator<Item = &'static dyn Effect> {
        CATALOGUE.iter().copied().filter(|effect| !self.excluded.contains(&effect.about().id))
    }

    fn promises(&self, from: &Fit) -> Vec<Promise> {
        let scales = scales(&from.model.motor, self.data);
        let mut promises = from.promises(self.data, &scales, self.excluded);
        promises.retain(|promise| promise.gain > LEAST_PROMISE);
        promises
    }

    fn try_all(&self, from: &Model, promises: &[Promise], effort: Effort) -> Vec<(&'static str, Fit)> {
        promises
            .par_iter()
            .map(|promise| {
                let effect = CATALOGUE[promise.effect];
                let starts = promise.other_starts.par_iter().chain([&promise.start]);
                let fits = starts.map(|start| fit(&from.with(effect, start.clone()), self.data, self.prior, effort));
                let best = fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("one start at least");
                (effect.about().id, best)
            })
            .filter(|(id, fitted)| fitted.model.term(id).is_some_and(Term::is_there))
            .collect()
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

    /// The effects that hardly any bench is without.
    fn usual(&self) -> impl Iterator<Item = &'static dyn Effect> {
        self.possible().filter(|effect| USUAL.contains(&effect.about().id))
    }

    fn with_usual(&self, model: Model, scales: &Scales) -> Model {
        self.usual().fold(model, |model, effect| model.with_start(effect, scales))
    }

    /// A model with each effect that changes everything and that it does not have, with each of its laws.
    fn with_what_changes_everything(&self, model: &Model, scales: &Scales) -> Vec<Model> {
        let effects = self.possible().filter(|effect| effect.changes_everything() && !model.has(effect.about().id));
        effects
            .flat_map(|effect| effect.starts(scales).into_iter().map(move |start| (effect, start)))
            .map(|(effect, start)| model.with(effect, start))
            .collect()
    }

    fn is_strange(&self, fit: &Fit) -> bool {
        is_strange(self.prior, fit)
    }

    /// Where the way from the linear fit has led to a dead end or to a strange motor, another: from the nominal motor, each
    /// effect together with the two that hardly any bench is without, or with one that changes everything. The best, of
    /// those with a motor that is not strange if there are any.
    fn anew(&self, base: &Fit) -> Option<(Fit, Step)> {
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
    fn beside_nominal(&self, found: &Fit) -> Option<Fit> {
        let scales = scales(&self.prior.motor, self.data);
        let mut nominal = Model { motor: self.prior.motor, terms: found.model.terms.clone() };
        nominal.terms.retain(|term| term.effect.about().acts_on != ActsOn::Voltage);
        let changed = self.with_what_changes_everything(&nominal, &scales);
        let of_the_bridge = self.usual().filter(|effect| effect.about().acts_on == ActsOn::Voltage);
        let besides: Vec<Model> = of_the_bridge
            .flat_map(|effect| changed.iter().map(move |model| model.with_start(effect, &scales)))
            .collect();
        let fits = changed.into_iter().chain(besides).collect::<Vec<_>>().into_par_iter();
        fits.map(|model| fit(&model, self.data, self.prior, Effort::FULL)).min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    fn forward(&self, mut current: Fit, mut steps: Vec<Step>, lead: Lead) -> Way {
        let mut ahead = 0;
        while steps.len() < MOST_EFFECTS {
            let mut promises = self.promises(&current);
            promises.truncate(TRIED);
            let best = promises.first().map_or(0.0, |promise| promise.gain);
            promises.retain(|promise| promise.gain > TRIED_SHARE * best);
            (self.progress)(&format!("{} effects, trying {}", current.model.terms.len(), promises.len()));
            let tried = self.try_all(&current.model, &promises, Effort::TRIAL.useless_above(current.cost));
            let mut fits: Vec<Fit> = tried.into_iter().map(|(_, fit)| fit).collect();
            if steps.is_empty() && !promises.is_empty() {
                // Nothing has been added: this is the linear fit.
                fits.extend(self.fresh(&current));
            }
            fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            let gained = |fits: &[Fit], index: usize| (index, self.gain(&current, &fits[index]));
            let leads = |(_, gain): &(usize, Gain)| lead == Lead::Significance && earns_its_place(gain);
            let mut chosen = (0..fits.len()).map(|index| gained(&fits, index)).find(leads);
            if chosen.is_none()
                && let Some(best) = fits.first_mut().filter(|best| best.cost < NOT_THERE_YET * current.cost)
            {
                *best = fit(&best.model, self.data, self.prior, Effort::FULL);
                chosen = Some(gained(&fits, 0)).filter(leads);
            }
            if chosen.is_none()
                && (ahead < MOST_AHEAD || lead == Lead::Cost)
                && above_floor(self.data, &current) > NOT_NOISE
            {
                ahead += 1;
                let best = fits.iter().position(|fit| fit.cost < LEAST_AHEAD * current.cost);
                chosen = best.map(|index| gained(&fits, index));
            }
            let Some((chosen, gain)) = chosen else { break };
            let best = fits.swap_remove(chosen);
            steps.push(Step::new(&current, &best, gain));
            let added = |term: &Term| !current.model.has(term.id());
            current = self.with_added_at_its_best(best, added);
        }
        (current, steps)
    }

    /// Drops what no longer earns its place and puts a rival where it is better; says of the others what holds.
    fn backward(&self, mut current: Fit) -> (Fit, Vec<Standing>) {
        let mut replacements = 0;
        'again: loop {
            let checks;
            (current, checks) = self.pruned(current);
            let mut standings = Vec::new();
            for check in checks {
                (self.progress)(&format!("rivals of {}", check.id));
                let rivals = self.rivals(&current, &check.without, check.id);
                if let Some((_, better)) = rivals.iter().find(|rival| self.is_better(&current, check.id, rival))
                    && replacements < MOST_EFFECTS
                {
                    replacements += 1;
                    current = better.clone();
                    continue 'again;
                }
                standings.push(self.standing(check.id, check.own, &current, &rivals));
            }
            return (current, standings);
        }
    }

    /// Drops what does not earn its name, the weakest first, until everything left does.
    fn pruned(&self, mut current: Fit) -> (Fit, Vec<Check>) {
        loop {
            // Beside what has come and gone since, the usual law may do.
            current = self.or_other_laws(current, Term::has_another_law);
            (self.progress)(&format!("checking {} effects", current.model.terms.len()));
            let ids: Vec<_> = current.model.terms.iter().map(|term| term.id()).collect();
            let mut checks: Vec<Check> = ids.into_par_iter().map(|id| self.check(&current, id)).collect();
            let weakest = (0..checks.len())
                .filter(|index| !checks[*index].is_named)
                .min_by(|a, b| checks[*a].own.sigmas.total_cmp(&checks[*b].own.sigmas));
            match weakest {
                Some(weakest) => current = checks.swap_remove(weakest).without,
                None => return (current, checks),
            }
        }
    }

    /// What the model would be without one of its effects.
    fn check(&self, current: &Fit, id: &'static str) -> Check {
        let without = fit(&current.model.without(id), self.data, self.prior, Effort::CHECK);
        let mut own = self.gain(&without, current);
        // Without it only another motor fits: then the data sheet speaks for it as well.
        let stranger = strangeness(self.prior, &without) - strangeness(self.prior, current);
        let keeps_the_motor = !self.is_strange(current) && (self.is_strange(&without) || stranger > STRANGER);
        if keeps_the_motor {
            own.sigmas = own.sigmas.max(0.0).hypot(strangeness(self.prior, &without).sqrt());
        }
        let stands = match effect(id).and_then(|effect| current.model.alone(effect)) {
            None => true,
            Some(Alone::Rarely) => own.sigmas > ALONE_SIGMAS,
            Some(Alone::Never) => false,
        };
        let is_excessive = |fit: &Fit| self.excessive_inductance_h(fit).is_some();
        let keeps_the_winding = || {
            looks_like_inductance(id)
                && is_excessive(&without)
                && (!is_excessive(current) || is_same(&self.gain(&self.with_nominal_inductance(current), current)))
                && !is_same(&self.gain(&self.with_nominal_inductance(&without), current))
        };
        let is_certain =
            || own.sigmas > NAMED_SIGMAS || self.sigmas_on_all(current, &without, &own) > NAMED_ON_ALL_SIGMAS;
        let is_named = stands
            && !self.spoils(&own)
            && (keeps_the_motor || keeps_the_winding() || earns_its_place(&own) && is_certain())
            && self.owes_it_to_its_number(current, &without, id)
            && self.owes_it_to_its_law(current, &without, id);
        Check { id, without, own, is_named }
    }

    /// Whether an effect explains one quantity at the cost of another.
    fn spoils(&self, own: &Gain) -> bool {
        let is_spoilt = |(&(before, after), measured): (&(f64, f64), &Measured)| {
            after > SPOILT * before && after > NOT_NOISE * measured.least_error(measured.noise)
        };
        own.rmse.iter().zip(&self.data.measured).any(is_spoilt)
    }

    fn with_nominal_inductance(&self, found: &Fit) -> Fit {
        let mut prior = self.prior.clone();
        prior.spread[1] = CERTAIN;
        let mut model = found.model.clone();
        model.motor.inductance_h = prior.motor.inductance_h;
        fit(&model, self.data, &prior, Effort::CHECK)
    }

    /// What an effect gains on all data, each part judged by fits that have not seen it.
    fn sigmas_on_all(&self, current: &Fit, without: &Fit, on_kept_back: &Gain) -> f64 {
        let on_other = |data: Dataset| {
            let anew = |found: &Fit| fit(&found.model, &data, self.prior, Effort::AGAIN);
            Chooser { data: &data, ..*self }.gain(&anew(without), &anew(current))
        };
        let mut parts: Vec<Gain> = self.data.with_others_kept_back().map(on_other).collect();
        parts.push(on_kept_back.clone());
        sigmas_together(&parts)
    }

    /// Whether another number of periods would do worse, where an effect has one: a wave of which any number does as well
    /// only shakes a model loose that sticks too long.
    fn owes_it_to_its_number(&self, current: &Fit, without: &Fit, id: &str) -> bool {
        let term = current.model.term(id).expect("one of its own terms");
        let Some(index) = term.effect.about().parameters.iter().position(Parameter::is_number) else { return true };
        let starts = term.effect.starts(&scales(&without.model.motor, self.data)).into_iter();
        let others: Vec<f64> = starts.map(|start| start[index]).filter(|other| *other != term.values[index]).collect();
        let looked_at: Vec<f64> = others.iter().step_by(others.len().div_ceil(OTHER_NUMBERS).max(1)).copied().collect();
        let does_as_well = |other: &f64| {
            let mut values = term.values.clone();
            values[index] = *other;
            let other = fit(&without.model.with(term.effect, values), self.data, self.prior, Effort::CHECK);
            let gains_as_much = without.cost - other.cost > GAINED_BY_ANY * (without.cost - current.cost);
            gains_as_much && other.cost < LEFT_BY_ANY * current.cost
        };
        let as_good = looked_at.par_iter().filter(|other| does_as_well(other)).count();
        2 * as_good <= looked_at.len()
    }

    /// Whether no law that only looks like its own, and has no name, would do better.
    fn owes_it_to_its_law(&self, current: &Fit, without: &Fit, id: &str) -> bool {
        let term = current.model.term(id).expect("one of its own terms");
        let others = term.effect.not_its_own(&term.values, &scales(&current.model.motor, self.data));
        others.into_iter().all(|(other, values)| {
            let other = fit(&without.model.with(other, values), self.data, self.prior, Effort::CHECK);
            self.gain(current, &other).sigmas < OTHER_LAW_SIGMAS
        })
    }

    /// Whether a rival is to take the place of `id`: it explains more, or as much with fewer constants or more plausibly.
    fn is_better(&self, current: &Fit, id: &str, (rival_id, rival): &(&'static str, Fit)) -> bool {
        if self.is_strange(rival) && !self.is_strange(current) {
            return false;
        }
        let over = self.gain(current, rival);
        if rival.cost < current.cost && over.sigmas > SAME_SIGMAS && over.share > SAME_SHARE {
            return true;
        }
        let under = self.gain(rival, current);
        let term = current.model.term(id).expect("one of its own terms");
        let rival_term = rival.model.terms.last().expect("it was added to the model");
        is_same(&under)
            && (rival_term.moving() < term.moving()
                || term.effect.yields_to(&term.values, rival_id, &current.model.terms))
    }

    /// Fits with other effects in place of `id`: those that promise most without it, and those that can look like it.
    fn rivals(&self, current: &Fit, without: &Fit, id: &str) -> Vec<(&'static str, Fit)> {
        let gained = without.cost - current.cost;
        let mut promises = self.promises(without);
        promises.retain(|promise| CATALOGUE[promise.effect].about().id != id);
        promises.truncate(RIVALS);
        let best = promises.first().map_or(0.0, |promise| promise.gain);
        promises.retain(|promise| promise.gain >= best || promise.gain > RIVAL_SHARE * gained);
        let mut rivals = self.try_all(&without.model, &promises, Effort::CHECK);
        for (lookalike, fit) in self.lookalikes(&current.model, id) {
            match rivals.iter_mut().find(|(rival, _)| *rival == lookalike) {
                Some((_, other)) if other.cost > fit.cost => *other = fit,
                Some(_) => {}
                None => rivals.push((lookalike, fit)),
            }
        }
        let at_its_best = |(rival, found): (&'static str, Fit)| match found.cost < NEAR * current.cost {
            true => (rival, self.with_added_at_its_best(found, |term| term.id() == rival)),
            false => (rival, found),
        };
        let is_there = |(rival, found): &(&str, Fit)| found.model.term(rival).is_some_and(Term::is_there);
        // Friction that is there one way alone and a load against it make up for a friction that is missing both ways.
        let makes_sense = |(_, found): &(&str, Fit)| {
            found.model.terms.iter().all(|term| found.model.alone(term.effect) != Some(Alone::Never))
        };
        rivals.into_par_iter().map(at_its_best).filter(is_there).filter(makes_sense).collect()
    }

    /// Fits from where another effect looks most like `id`.
    fn lookalikes(&self, model: &Model, id: &str) -> Vec<(&'static str, Fit)> {
        let values = &model.term(id).expect("one of its own terms").values;
        self.possible()
            .filter(|effect| !model.has(effect.about().id))
            .filter_map(|effect| {
                let start = model.without(id).with(effect, effect.instead_of(id, values)?);
                Some((effect.about().id, fit(&start, self.data, self.prior, Effort::CHECK)))
            })
            .collect()
    }

    fn standing(&self, id: &'static str, own: Gain, current: &Fit, rivals: &[(&'static str, Fit)]) -> Standing {
        let over = rivals.iter().map(|(rival, fit)| (*rival, fit, self.gain(fit, current)));
        // What serves as well with a motor that is not the rig's does not serve.
        let another_motor = |fit: &Fit| self.is_strange(fit) && !self.is_strange(current);
        let mut over: Vec<_> = over
            .filter(|(_, fit, gain)| !(is_same(gain) && another_motor(fit)))
            .map(|(rival, _, gain)| (rival, gain))
            .collect();
        over.sort_by(|a, b| a.1.share.total_cmp(&b.1.share));
        let mut same: Vec<_> = over.iter().filter(|(_, gain)| is_same(gain)).map(|(rival, _)| *rival).collect();
        if looks_like_inductance(id) && is_same(&own) {
            same.push(INDUCTANCE);
        }
        Standing { id, gain: own, rival: over.into_iter().next(), same }
    }
}

/// Whether the motor is another one than the rig's: then something that is not in the model has been made up for.
fn is_strange(prior: &Prior, fit: &Fit) -> bool {
    let given = off_data_sheet(prior, fit).count().max(1);
    strangeness(prior, fit) > STRANGE_EACH * given as f64
}

/// What speaks against a fit: something remains, its motor is strange. The fewer of these the better, the first before the second.
pub(super) fn doubts(data: &Dataset, prior: &Prior, fit: &Fit) -> [bool; 2] {
    [above_floor(data, fit) > NOT_NOISE, is_strange(prior, fit)]
}

/// Whether several of the motor's constants are farther from the data sheet than it is wrong by itself: more likely something
/// else has been made up for.
fn has_wrong_values(prior: &Prior, fit: &Fit) -> bool {
    off_data_sheet(prior, fit).filter(|(_, off)| off.abs() > DATA_SHEET_TOLERANCE).count() > 1
}

/// Logarithms of resistance, torque constant and inertia over those of them that the data sheet gives.
pub(super) fn off_data_sheet(prior: &Prior, fit: &Fit) -> impl Iterator<Item = (&'static str, f64)> {
    let constants = fit.model.motor.named().into_iter().zip(prior.nominal.values());
    let of_size = constants.filter(|((name, _), _)| OF_SIZE.contains(name));
    of_size.filter_map(|((name, found), nominal)| Some((name, (found / nominal?).ln())))
}

/// Squares of the motor's deviations from its data sheet, in standard deviations. Of viscous friction a data sheet says
/// little; many times as much is another friction.
pub(super) fn strangeness(prior: &Prior, fit: &Fit) -> f64 {
    let values = |motor: &MotorParameters| [motor.resistance_ohm, motor.torque_constant_nm_per_a, motor.inertia_kg_m2];
    let spread = [prior.spread[0], prior.spread[2], prior.spread[3]];
    let off = values(&fit.model.motor).into_iter().zip(values(&prior.motor)).zip(spread);
    let constants: f64 = off.map(|((found, nominal), spread)| ((found / nominal).ln() / spread).powi(2)).sum();
    let viscous = prior.nominal.viscous_friction_nm_s.filter(|nominal| *nominal > 0.0).map_or(0.0, |nominal| {
        ((fit.model.motor.viscous_friction_nm_s / nominal).max(1.0).ln() / VISCOUS_SPREAD).powi(2)
    });
    constants + viscous
}

/// Whether an effect can look like more inductance than the winding has.
fn looks_like_inductance(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.instead_of(INDUCTANCE, &[0.0]).is_some())
}

/// Whether a model is no better than the other.
fn is_same(gain: &Gain) -> bool {
    gain.sigmas < SAME_SIGMAS || gain.share < SAME_SHARE
}

fn earns_its_place(gain: &Gain) -> bool {
    gain.sigmas > LEAST_SIGMAS && gain.share > LEAST_SHARE
}

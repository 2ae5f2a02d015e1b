//! Backward: drops effects without evidence, and replaces an effect by a better rival.

use super::{
    Chooser, Gain, LEAST_SHARE, MOST_EFFECTS, NEAR, SAME_SHARE, SAME_SIGMAS, Standing, gain_over, has_evidence,
    is_same, is_very_strong,
};
pub(in crate::diagnose) use crate::configuration::diagnose::select_backward::NAMED_SIGMAS;
use crate::configuration::diagnose::select_backward::{
    ALONE_SIGMAS, CONFIRMED_SIGMAS, GAINED_BY_ANY, IMPLAUSIBLE_SQUARES, LEAST_OF_DRY_LOSSES, LEFT_BY_ANY,
    MATTERS_SHARE, MOVES_A_CONSTANT, OTHER_LAW_SIGMAS, OTHER_NUMBERS, RIVAL_SHARE, RIVALS, SPOILT,
};
use crate::dataset::{Dataset, Measured};
use crate::diagnose::data_sheet::squared_deviations;
use crate::diagnose::judge::{NOT_NOISE, VERY_STRONG_NATS, evidence_nats};
use crate::identify::{Effort, Fit, fit, scales};
use crate::parallel;
use motorbench_model::catalogue::{Alone, CATALOGUE, DryLosses, Effect, INDUCTANCE, USUAL, effect};
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Model, Term};

/// Whether the evidence of the seen data names an effect that the held-out data confirm, however few blocks of them it shows
/// in.
pub(super) fn names_by_evidence(gain: &Gain, nats: f64) -> bool {
    gain.sigmas > CONFIRMED_SIGMAS && gain.share > MATTERS_SHARE && is_very_strong(nats)
}

/// Whether another motor is found without an effect: its constants are wrong then, however little the readings differ.
fn moves_the_motor(with: &Fit, without: &Fit) -> bool {
    let constants = |fit: &Fit| {
        let motor = &fit.model.motor;
        [motor.resistance_ohm, motor.torque_constant_nm_per_a, motor.inertia_kg_m2]
    };
    let moved = constants(with).into_iter().zip(constants(without)).map(|(with, without)| (without / with).ln().abs());
    moved.fold(0.0, f64::max) > MOVES_A_CONSTANT
}

/// A model without one of its effects.
pub(super) struct Check {
    id: &'static str,
    without: Fit,
    /// The gain of the effect over it.
    own: Gain,
    /// Whether the effect that it depends on is present.
    stands: bool,
    is_named: bool,
}

impl Chooser<'_> {
    /// Drops effects without evidence and replaces those with a better rival. Returns the evidence for the others.
    pub(super) fn backward(&self, mut current: Fit) -> (Fit, Vec<Standing>) {
        let mut replacements = 0;
        loop {
            let checks;
            (current, checks) = self.pruned(current);
            let rivals_of = |check: &Check| {
                (self.progress)(&format!("rivals of {}", check.id));
                self.rivals(&current, &check.without, check.id)
            };
            let rivals: Vec<_> = parallel::map(&checks, rivals_of);
            let mut better = checks
                .iter()
                .zip(&rivals)
                .flat_map(|(check, rivals)| rivals.iter().find(|rival| self.is_better(&current, check.id, rival)));
            if let Some((_, better)) = better.next().filter(|_| replacements < MOST_EFFECTS) {
                replacements += 1;
                current = better.clone();
                continue;
            }
            let standing = |(check, rivals): (Check, Vec<_>)| self.standing(check.id, check.own, &current, &rivals);
            let standings = checks.into_iter().zip(rivals).map(standing).collect();
            return (current, standings);
        }
    }

    /// Drops effects without enough evidence, the weakest first.
    pub(super) fn pruned(&self, mut current: Fit) -> (Fit, Vec<Check>) {
        loop {
            // After other effects have come and gone, the usual law may suffice.
            current = self.or_other_laws(current, Term::has_another_law);
            (self.progress)(&format!("checking {} effects", current.model.terms.len()));
            let ids = current.model.terms.iter().map(Term::id);
            let mut checks: Vec<Check> = parallel::map(ids, |id| self.check(&current, id));
            let weakest = (0..checks.len())
                .filter(|index| !checks[*index].is_named)
                .min_by(|a, b| checks[*a].own.sigmas.total_cmp(&checks[*b].own.sigmas));
            match weakest {
                Some(weakest) => {
                    let weakest = checks.swap_remove(weakest);
                    current = self.in_its_place(&current, &weakest).unwrap_or(weakest.without);
                }
                None => return (current, checks),
            }
        }
    }

    /// A replacement for an effect whose companion has gone. A drop that differs between directions needs a drop, but a
    /// friction that differs looks like it.
    fn in_its_place(&self, current: &Fit, check: &Check) -> Option<Fit> {
        if check.stands || !has_evidence(&check.own) {
            return None;
        }
        let rivals = self.rivals(current, &check.without, check.id).into_iter().map(|(_, rival)| rival);
        let as_good = rivals.filter(|rival| is_same(&self.gain(rival, current)));
        as_good.min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// The model without one of its effects.
    fn check(&self, current: &Fit, id: &'static str) -> Check {
        let without = self.without(current, id);
        let mut own = self.gain(&without, current);
        // If only another motor fits without it, the data sheet counts for the effect as well.
        let more_deviation = squared_deviations(self.prior, &without) - squared_deviations(self.prior, current);
        let keeps_the_motor =
            !self.is_implausible(current) && (self.is_implausible(&without) || more_deviation > IMPLAUSIBLE_SQUARES);
        if keeps_the_motor {
            own.sigmas = own.sigmas.max(0.0).hypot(squared_deviations(self.prior, &without).sqrt());
        }
        let stands = match effect(id).and_then(|effect| current.model.alone(effect)) {
            None => true,
            Some(Alone::Rarely) => own.sigmas > ALONE_SIGMAS,
            Some(Alone::Never) => false,
        };
        let keeps_the_winding = || {
            self.looks_like_inductance(id)
                && self.excessive_inductance_h(&without).is_some()
                && self.has_the_winding(current)
                && self.needs_its_winding(&without, current, id)
        };
        let nats = evidence_nats(self.data, &without, current);
        let term = current.model.term(id).expect("one of its own terms");
        // Hardly any bench is without the usual effects, and many switch a bridge at its enable pin: for them very strong
        // evidence suffices, of the data and the data sheet together.
        let is_usual = USUAL.contains(&id) || term.effect.about().changes_everything;
        let is_named = stands
            && !term.effect.is_a_scale(&term.values, &scales(&current.model.motor, self.data))
            && !self.is_lost_in_dry_losses(&current.model, term)
            && !self.spoils(&own)
            && (keeps_the_motor
                || keeps_the_winding()
                || has_evidence(&own) && own.sigmas > NAMED_SIGMAS
                || names_by_evidence(&own, nats)
                || is_usual
                    && (own.share > LEAST_SHARE || moves_the_motor(current, &without))
                    && nats + 0.5 * more_deviation > VERY_STRONG_NATS
                || is_very_strong(nats)
                    && (self.names_by_number(&own, &without, current, term)
                        || self.names_with_other_parts(&own, &without, current, nats)))
            && self.number_matters(current, &without, id)
            && self.law_matters(current, &without, id);
        Check { id, without, own, stands, is_named }
    }

    /// Whether the evidence names an effect once every part of the data has been held out in turn: what acts in a few moments
    /// alone, such as a sag at a high current, may hardly show in one part.
    pub(super) fn names_with_other_parts(&self, own: &Gain, without: &Fit, current: &Fit, nats: f64) -> bool {
        own.sigmas > 0.0 && names_by_evidence(&self.with_other_parts(own, without, current), nats)
    }

    /// What an effect gains in every part of the data, held out in turn.
    fn with_other_parts(&self, own: &Gain, without: &Fit, current: &Fit) -> Gain {
        let in_part = |part: Dataset| {
            let [before, after] = [without, current].map(|found| fit(&found.model, &part, self.prior, Effort::CHECK));
            gain_over(&part, &before, &after)
        };
        let parts: Vec<Gain> = self.data.with_others_held_out().map(in_part).chain([own.clone()]).collect();
        let count = parts.len() as f64;
        let sum = |of: fn(&Gain) -> f64| parts.iter().map(of).sum::<f64>();
        let sigmas = sum(|gain| gain.sigmas) / count.sqrt();
        Gain { sigmas, share: sum(|gain| gain.share) / count, rmse: Vec::new() }
    }

    /// Whether the data show a wave by its number, with very strong evidence among the other numbers as well, and the parts agree
    /// that were held out. What another law leaves out has no number, so the gain may be small.
    pub(super) fn names_by_number(&self, own: &Gain, without: &Fit, current: &Fit, wave: &Term) -> bool {
        let scales = scales(&without.model.motor, self.data);
        let stands_out = || without.number_stands_out(&self.fits.replay, &scales, wave) > VERY_STRONG_NATS;
        let is_confirmed =
            || own.sigmas > CONFIRMED_SIGMAS || self.with_other_parts(own, without, current).sigmas > CONFIRMED_SIGMAS;
        own.sigmas > 0.0 && stands_out() && is_confirmed()
    }

    /// Whether a model explains less, by the held-out data or by very strong evidence.
    pub(super) fn is_worse(&self, fit: &Fit, than: &Fit) -> bool {
        !is_same(&self.gain(fit, than)) || is_very_strong(evidence_nats(self.data, fit, than))
    }

    /// Whether a model without an effect explains less with the nominal inductance. Of a delay very strong evidence says so as
    /// well: every command acts late, while a lag needs a filter.
    fn needs_its_winding(&self, without: &Fit, current: &Fit, id: &str) -> bool {
        let held = self.with_nominal_inductance(without);
        let is_delay = effect(id).is_some_and(|effect| effect.about().is_delay);
        if is_delay { self.is_worse(&held, current) } else { !is_same(&self.gain(&held, current)) }
    }

    /// The model without one of its effects. Without a current, friction and drop take the same volts at any speed: there the
    /// fit also starts from another effect that has taken over.
    fn without(&self, current: &Fit, id: &str) -> Fit {
        let without = self.fits.fit(&current.model.without(id), Effort::CHECK);
        if self.data.current().is_some() {
            return without;
        }
        let values = &current.model.term(id).expect("one of its own terms").values;
        let scales = scales(&current.model.motor, self.data);
        let taken_over = current.model.terms.iter().filter_map(|term| {
            let more = term.effect.takes_over(id, values, &scales)?;
            let mut model = current.model.without(id);
            let taking = model.terms.iter_mut().find(|other| other.id() == term.id())?;
            taking.values.iter_mut().zip(more).for_each(|(value, more)| *value += more);
            Some(self.fits.fit(&model, Effort::CHECK))
        });
        taken_over.fold(without, |best, other| if other.cost < best.cost { other } else { best })
    }

    /// Whether a friction or a drop is so small a part of all that is lost at any speed and current that it may be what the law
    /// of the others leaves out.
    fn is_lost_in_dry_losses(&self, model: &Model, term: &Term) -> bool {
        let MotorParameters { resistance_ohm, torque_constant_nm_per_a, .. } = model.motor;
        let volts = |losses: DryLosses| {
            let friction_nm = 0.5 * (losses.friction_forward_nm + losses.friction_reverse_nm);
            friction_nm * resistance_ohm / torque_constant_nm_per_a + losses.bridge_drop_v
        };
        let own_v = volts(term.dry_losses());
        self.data.axis.drive.is_voltage() && own_v > 0.0 && own_v < LEAST_OF_DRY_LOSSES * volts(model.dry_losses())
    }

    /// Whether an effect explains one quantity at the cost of another.
    fn spoils(&self, own: &Gain) -> bool {
        let is_spoilt = |(&(before, after), measured): (&(f64, f64), &Measured)| {
            after > SPOILT * before && after > NOT_NOISE * measured.least_error(measured.noise)
        };
        own.rmse.iter().zip(&self.data.measured).any(is_spoilt)
    }

    /// Whether other numbers of periods would do worse, if an effect has such a number. If any number does as well, the
    /// wave only helps the simulated motor out of standstill.
    pub(super) fn number_matters(&self, current: &Fit, without: &Fit, id: &str) -> bool {
        let term = current.model.term(id).expect("one of its own terms");
        let Some(index) = term.effect.about().number() else { return true };
        let starts = term.effect.starts(&scales(&without.model.motor, self.data)).into_iter();
        let others: Vec<f64> = starts.map(|start| start[index]).filter(|other| *other != term.values[index]).collect();
        let looked_at: Vec<f64> = others.iter().step_by(others.len().div_ceil(OTHER_NUMBERS).max(1)).copied().collect();
        let gains_as_much = without.cost - GAINED_BY_ANY * (without.cost - current.cost);
        let as_well = gains_as_much.min(LEFT_BY_ANY * current.cost);
        let does_as_well = |other: &f64| {
            let mut values = term.values.clone();
            values[index] = *other;
            let other = without.model.with(term.effect, values);
            self.fits.fit_near(without, &other, Effort::CHECK.useless_above(as_well)).cost < as_well
        };
        let do_as_well = parallel::map(&looked_at, does_as_well);
        2 * do_as_well.iter().filter(|does| **does).count() <= looked_at.len()
    }

    /// Whether no similar law outside the catalogue does better, or as well in place of several effects.
    fn law_matters(&self, current: &Fit, without: &Fit, id: &str) -> bool {
        let scales = scales(&current.model.motor, self.data);
        let term = current.model.term(id).expect("one of its own terms");
        term.effect.similar_laws(&term.values, &scales).into_iter().all(|(other, values)| {
            let like_it = |term: &Term| {
                let laws = term.effect.similar_laws(&term.values, &scales);
                laws.iter().any(|(law, _)| law.about().id == other.about().id)
            };
            let mut model = without.model.clone();
            model.terms.retain(|term| !like_it(term));
            let replaces_several = model.terms.len() < without.model.terms.len();
            let other = self.fits.fit(&model.with(other, values), Effort::CHECK);
            let is_better = self.gain(current, &other).sigmas > OTHER_LAW_SIGMAS;
            !(is_better || replaces_several && is_same(&self.gain(&other, current)))
        })
    }

    /// Whether a rival replaces `id`: it explains more, or as much with fewer constants or more plausibly.
    fn is_better(&self, current: &Fit, id: &str, (rival_id, rival): &(&'static str, Fit)) -> bool {
        if self.is_implausible(rival) && !self.is_implausible(current) {
            return false;
        }
        let over = self.gain(current, rival);
        if rival.cost < current.cost && over.sigmas > SAME_SIGMAS && over.share > SAME_SHARE {
            return true;
        }
        let term = current.model.term(id).expect("one of its own terms");
        let rival_term = rival.model.terms.last().expect("it was added to the model");
        !self.is_worse(rival, current)
            && (rival_term.moving() < term.moving()
                || term.effect.yields_to(&term.values, rival_id, &current.model.terms)
                || self.replaces_two(rival, rival_id))
    }

    /// Whether a rival makes another effect needless: one delay of the command looks like a lag of each sensor.
    fn replaces_two(&self, rival: &Fit, rival_id: &str) -> bool {
        let mut others = rival.model.terms.iter().map(Term::id).filter(|id| *id != rival_id && !USUAL.contains(id));
        // One that is farther away is needed.
        let effort = Effort::CHECK.useless_above(NEAR * rival.cost);
        others.any(|id| {
            let without = self.fits.fit(&rival.model.without(id), effort);
            is_same(&self.gain(&without, rival)) && evidence_nats(self.data, &without, rival) < VERY_STRONG_NATS
        })
    }

    /// Fits with other effects in place of `id`: those that promise most without it, and those that can look like it.
    fn rivals(&self, current: &Fit, without: &Fit, id: &str) -> Vec<(&'static str, Fit)> {
        let gained = without.cost - current.cost;
        let mut promises = self.promises(without).alone;
        promises.retain(|promise| CATALOGUE[promise.effect].about().id != id);
        promises.truncate(RIVALS);
        let best = promises.first().map_or(0.0, |promise| promise.gain);
        promises.retain(|promise| promise.gain >= best || promise.gain > RIVAL_SHARE * gained);
        // A rival farther away takes no place, and how far it is need not be known well.
        let effort = Effort::CHECK.useless_above(NEAR * current.cost);
        let mut rivals = self.try_all(without, &promises, effort);
        for (lookalike, fit) in self.lookalikes(&current.model, id, effort) {
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
        // A look may begin where no model can be simulated, such as at a quotient of zeros.
        let is_there = |(rival, found): &(&str, Fit)| {
            found.cost.is_finite() && found.model.term(rival).is_some_and(Term::is_there)
        };
        // Friction in one direction and a load against it together resemble friction in both directions.
        let makes_sense = |(_, found): &(&str, Fit)| {
            found.model.terms.iter().all(|term| found.model.alone(term.effect) != Some(Alone::Never))
        };
        let rivals = parallel::map(rivals, at_its_best).into_iter();
        rivals.filter(is_there).filter(makes_sense).collect()
    }

    /// Fits from where another effect looks most like `id`: beside the motor that was found with `id`, and beside the
    /// nominal one.
    fn lookalikes(&self, model: &Model, id: &str, effort: Effort) -> Vec<(&'static str, Fit)> {
        let values = &model.term(id).expect("one of its own terms").values;
        let scales = scales(&model.motor, self.data);
        let takes_the_same_volts = |effect: &'static dyn Effect| match self.data.current() {
            Some(_) => None,
            None => effect.takes_over(id, values, &scales),
        };
        let looks_alike = |effect: &'static dyn Effect| {
            let like_it = effect.instead_of(id, values, &scales).or_else(|| takes_the_same_volts(effect))?;
            let mut beside_found = model.without(id).with(effect, like_it);
            for term in &mut beside_found.terms {
                if let Some(left) = effect.leaves(id, values, term) {
                    term.values = left;
                }
            }
            let beside_nominal = Model { motor: self.prior.motor, terms: beside_found.terms.clone() };
            let fits = [beside_found, beside_nominal].map(|start| self.fits.fit(&start, effort));
            let best = fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
            best.map(|best| (effect.about().id, best))
        };
        let absent = self.possible().filter(|effect| !model.has(effect.about().id));
        parallel::map(absent, looks_alike).into_iter().flatten().collect()
    }

    fn standing(&self, id: &'static str, own: Gain, current: &Fit, rivals: &[(&'static str, Fit)]) -> Standing {
        let over = rivals.iter().map(|(rival, fit)| (*rival, fit, self.gain(fit, current)));
        // A rival that needs a motor unlike the rig's does not count.
        let another_motor = |fit: &Fit| self.is_implausible(fit) && !self.is_implausible(current);
        let mut over: Vec<_> = over
            .filter(|(_, fit, gain)| !(is_same(gain) && another_motor(fit)))
            .map(|(rival, _, gain)| (rival, gain))
            .collect();
        over.sort_by(|a, b| a.1.share.total_cmp(&b.1.share));
        let mut same: Vec<_> = over.iter().filter(|(_, gain)| is_same(gain)).map(|(rival, _)| *rival).collect();
        if self.looks_like_inductance(id) && is_same(&own) {
            same.push(INDUCTANCE);
        }
        Standing { id, gain: own, rival: over.into_iter().next(), same }
    }
}

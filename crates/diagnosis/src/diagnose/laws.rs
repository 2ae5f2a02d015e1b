//! Laws of the named effects that differ in their constants and not in their names. All the data decide which one is
//! reported. What the others would make of the constants goes into the intervals, and what a usual effect would that the
//! data neither show nor exclude.

use super::channels::excluded;
use super::judge::{AS_GOOD, evidence_nats};
use super::select::NEAR;
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Interval, Prior, fit, scales};
use crate::parallel;
use motorbench_model::Term;
use motorbench_model::catalogue::{Scales, USUAL, effect};

/// The laws of a model compared with others.
pub(super) struct Settled {
    /// A fit with more evidence than the model has.
    pub better: Option<Fit>,
    /// Intervals of the constants with each law that explains as much.
    pub others: Vec<Vec<Interval>>,
}

/// Tries the other laws of each effect of `found`, one at a time. `data`: those of the fit.
pub(super) fn settle(found: &Fit, data: &Dataset, prior: &Prior) -> Settled {
    let mut better: Option<Fit> = None;
    let mut tried = Vec::new();
    for other in others(found, data, prior) {
        if evidence_nats(data, better.as_ref().unwrap_or(found), &other) > 0.0 {
            tried.push(better.replace(other).unwrap_or_else(|| found.clone()));
        } else {
            tried.push(other);
        }
    }
    let better = better.map(|better| fit(&better.model, data, prior, Effort::FULL));
    let least = better.as_ref().unwrap_or(found).cost;
    tried.extend(with_usual(better.as_ref().unwrap_or(found), data, prior));
    let as_good = tried.into_iter().filter(|other| other.cost <= AS_GOOD * least);
    let with_held_open = |other: Fit| {
        let mut intervals = other.with_held_open(data).uncertainty(data).intervals();
        intervals.truncate(other.moved());
        intervals
    };
    let others = as_good.map(with_held_open).collect();
    Settled { better, others }
}

/// Fits with each usual effect that is absent.
fn with_usual(found: &Fit, data: &Dataset, prior: &Prior) -> Vec<Fit> {
    let scales = scales(&found.model.motor, data);
    let excluded = excluded(data);
    let absent = USUAL.iter().filter(|id| !found.model.has(id) && !excluded.contains(id)).filter_map(|id| effect(id));
    let models = absent.map(|effect| found.model.with_start(effect, &scales));
    let fitted = parallel::map(models, |model| fit(&model, data, prior, Effort::AGAIN));
    fitted.into_iter().filter(|wider| !wider.is_at_a_bound(found.model.terms.len())).collect()
}

/// Fits with another law of one effect, whose constants are not at the end of what makes sense.
fn others(found: &Fit, data: &Dataset, prior: &Prior) -> Vec<Fit> {
    with_laws(found, data, prior, |term, scales| {
        [term.effect.other_laws(&term.values, scales), refined_laws(term, data, scales)].concat()
    })
}

/// Fits with a refined law of one effect, whose constants are not at the end of what makes sense.
pub(super) fn refined(found: &Fit, data: &Dataset, prior: &Prior) -> Vec<Fit> {
    with_laws(found, data, prior, |term, scales| refined_laws(term, data, scales))
}

/// Whether an effect of a model has refined laws.
pub(super) fn may_be_refined(found: &Fit, data: &Dataset) -> bool {
    let scales = scales(&found.model.motor, data);
    data.current().is_some() && found.model.terms.iter().any(|term| !refined_laws(term, data, &scales).is_empty())
}

/// A current that is read at an unknown moment of a period is off by its ripple. That depends on the duty, as does what an
/// off phase takes.
fn refined_laws(term: &Term, data: &Dataset, scales: &Scales) -> Vec<Vec<f64>> {
    if data.is_ripple_known() { term.effect.refined_laws(&term.values, scales) } else { Vec::new() }
}

/// Whether an effect has one of its refined laws: the same constants move.
pub(super) fn is_refined(term: &Term, scales: &Scales) -> bool {
    let parameters = term.effect.about().parameters;
    let moving = |values: &[f64]| {
        parameters.iter().zip(values).map(|(parameter, value)| parameter.moves(*value)).collect::<Vec<_>>()
    };
    let usual = parameters.iter().zip(&term.values).map(|(parameter, value)| parameter.default.unwrap_or(*value));
    let refined = term.effect.refined_laws(&usual.collect::<Vec<_>>(), scales);
    refined.iter().any(|law| moving(law) == moving(&term.values))
}

fn with_laws(found: &Fit, data: &Dataset, prior: &Prior, laws: impl Fn(&Term, &Scales) -> Vec<Vec<f64>>) -> Vec<Fit> {
    let scales = scales(&found.model.motor, data);
    let of_term = |(index, term): (usize, &Term)| {
        laws(term, &scales).into_iter().map(move |values| (index, values)).collect::<Vec<_>>()
    };
    let laws = found.model.terms.iter().enumerate().flat_map(of_term);
    let fitted = parallel::map(laws, |(index, values)| {
        let start = fit(&found.model.with_values(index, values), data, prior, Effort::NONE);
        let near = (start.cost < NEAR * found.cost).then(|| fit(&start.model, data, prior, Effort::AGAIN))?;
        let Term { effect, values } = &near.model.terms[index];
        let makes_sense = !near.reaches_a_bound(data, index) && !effect.is_a_scale(values, &scales);
        makes_sense.then_some(near)
    });
    fitted.into_iter().flatten().collect()
}

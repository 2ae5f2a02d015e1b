//! Explains the voltage that nominal resistance and back-EMF leave: every combination of a few possible terms is
//! fitted, and tested.
//!
//! A combination holds if no other term, added to it, is significant beside the noise of the best predicting one. Of
//! those that hold, the one with the fewest terms is named. Others of that size cannot be told from it by the table:
//! which of them fits best is chance.

use super::Winding;
use super::line::{Errors, Line, Noise, left_out, rms};
use super::{Level, NEEDED_SIGMAS, errors};
use crate::configuration::steady_state::explanation::{
    DOUBTED_SIGMAS, HELD_AS_TURNING, MOST_TERMS, OTHER_POSITION, RARE,
};
use crate::diagnose::outcome::Estimate;
use serde::Serialize;
use std::collections::BTreeMap;

/// A term of the voltage, linear in its constant.
pub(super) struct Term {
    /// Identifier of the catalogue, or `parameter:NAME`.
    pub effect: &'static str,
    pub constant: &'static str,
    of: fn(&Level) -> f64,
    nominal: fn(r: f64, k: f64) -> f64,
    /// Whether a held winding shows its constant.
    is_resistance: bool,
}

/// The order of naming where a table cannot tell them apart. Every bridge has a voltage drop; the constant of a data
/// sheet may belong to another motor; a winding of several times its resistance is burnt.
pub(super) const TERMS: [Term; 4] = [
    Term { effect: "voltage_drop", constant: "drop_V", of: |_| 1.0, nominal: |_, _| 0.0, is_resistance: false },
    Term {
        effect: "parameter:torque_constant",
        constant: "back_emf_constant_V_s",
        of: |level| level.omega_rad_per_s,
        nominal: |_, k| k,
        is_resistance: false,
    },
    Term {
        effect: "parameter:resistance",
        constant: "resistance_ohm",
        of: |level| level.i_A,
        nominal: |r, _| r,
        is_resistance: true,
    },
    Term {
        effect: "resistance_growing_with_speed",
        constant: "growth_ohm_s",
        of: |level| level.i_A * level.omega_rad_per_s,
        nominal: |_, _| 0.0,
        is_resistance: false,
    },
];

/// An explanation of the missing voltage.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// Its terms: identifiers of the catalogue, or `parameter:NAME`.
    pub terms: Vec<&'static str>,
    /// Its constants.
    pub constants: BTreeMap<&'static str, Estimate>,
    /// Distance of each term from zero, in standard errors.
    pub sigmas: Vec<f64>,
    /// Weighted sum of squares over degrees of freedom; near 1 if it suffices.
    pub chi2_per_dof: f64,
    /// Distance from zero of the term that it lacks most, in standard errors.
    pub lacks_sigmas: f64,
    /// Error of the voltage at a level left out of the fit.
    pub left_out_rmse_v: f64,
    /// Its residual of the voltage at each level.
    #[serde(skip)]
    pub(super) left_v: Vec<f64>,
}

impl Explanation {
    /// Whether the table needs no further term.
    pub(super) fn holds(&self) -> bool {
        self.lacks_sigmas < NEEDED_SIGMAS
    }

    /// Order of naming; the first is named.
    fn place(&self) -> (bool, bool, usize, bool) {
        let lawless = self.terms.contains(&TERMS[RARE].effect);
        (!self.holds(), lawless, self.terms.len(), self.lacks_sigmas > DOUBTED_SIGMAS)
    }

    /// Terms that explain the table as well in place of one of its terms.
    pub(super) fn instead_of(&self, term: &str, all: &[Self]) -> Vec<&'static str> {
        self.replacements(term, all).filter(|(_, other)| other.holds()).map(|(rival, _)| rival).collect()
    }

    /// The best alternative to one of its terms, and the explanation with it.
    pub(super) fn next_best<'a>(&self, term: &str, all: &'a [Self]) -> Option<(&'static str, &'a Self)> {
        let order = |(_, a): &(_, &Self), (_, b): &(_, &Self)| {
            b.holds().cmp(&a.holds()).then(a.left_out_rmse_v.total_cmp(&b.left_out_rmse_v))
        };
        self.replacements(term, all).min_by(order)
    }

    /// Explanations with another term in place of one of its own, and all others kept.
    fn replacements<'a>(&self, term: &str, all: &'a [Self]) -> impl Iterator<Item = (&'static str, &'a Self)> {
        let kept = self.all_but(term);
        all.iter().filter(move |other| other.terms.len() == self.terms.len()).filter_map(move |other| {
            let rival = other.terms.iter().find(|rival| !self.terms.contains(rival))?;
            kept.iter().all(|kept| other.terms.contains(kept)).then_some((*rival, other))
        })
    }

    /// The same without one of its terms, all others fitted again; without more of them where that gives constants of
    /// no motor.
    pub(super) fn without<'a>(&self, term: &str, all: &'a [Self]) -> &'a Self {
        let kept = self.all_but(term);
        let less = all.iter().filter(|other| other.terms.iter().all(|other| kept.contains(other)));
        let order = |a: &&Self, b: &&Self| {
            b.terms.len().cmp(&a.terms.len()).then(a.left_out_rmse_v.total_cmp(&b.left_out_rmse_v))
        };
        less.min_by(order).expect("the nominal values are always tried")
    }

    fn all_but(&self, term: &str) -> Vec<&'static str> {
        self.terms.iter().copied().filter(|kept| *kept != term).collect()
    }
}

/// The voltage equations: one row a level, with the rotor turning and held, and one for the winding if its resistance
/// was measured separately.
struct Equation {
    columns: Vec<Vec<f64>>,
    missing: Vec<f64>,
    errors: Errors,
    /// The first this many rows are levels of a turning motor.
    turning: usize,
}

impl Equation {
    fn new(turning: &[Level], held: &[Level], winding: Option<&Winding>, r: f64) -> Self {
        let levels = || turning.iter().chain(held);
        let mut columns: Vec<Vec<f64>> = TERMS.iter().map(|term| levels().map(term.of).collect()).collect();
        let mut missing: Vec<f64> = levels().map(|level| level.missing_V).collect();
        let mut errors = errors(turning, |level| level.voltage_error)
            .and(held.iter().map(|level| OTHER_POSITION * r * level.i_A.abs()));
        if let Some(winding) = winding {
            columns.iter_mut().zip(&TERMS).for_each(|(column, term)| column.push(f64::from(term.is_resistance)));
            missing.push(winding.mean_ohm - r);
            errors = errors.and([winding_error_ohm(winding)]);
        }
        Self { columns, missing, errors, turning: turning.len() }
    }

    fn of(&self, terms: &[usize]) -> Vec<&[f64]> {
        terms.iter().map(|term| &self.columns[*term][..]).collect()
    }

    fn line(&self, terms: &[usize]) -> Option<Line> {
        Line::new(&self.of(terms), &self.missing, &self.errors)
    }

    /// Distances from zero of the terms outside the explanation.
    fn lacks_sigmas(&self, terms: &[usize], noise: Noise) -> f64 {
        let others = (0..TERMS.len()).filter(|term| !terms.contains(term));
        let with = others.filter_map(|other| self.line(&[terms, &[other]].concat()));
        with.map(|line| line.sigmas(terms.len(), noise)).fold(0.0, f64::max)
    }

    fn explanation(&self, fit: &Fit, noise: Noise, (r, k): (f64, f64)) -> Explanation {
        let Fit { terms, line, left_out_v } = fit;
        let constants = terms.iter().enumerate().map(|(index, term)| {
            let (Estimate { value, ci95 }, nominal) = (line.estimate(index), (TERMS[*term].nominal)(r, k));
            let above = Estimate { value: nominal + value, ci95: ci95.map(|ci95| ci95.map(|end| nominal + end)) };
            (TERMS[*term].constant, above)
        });
        let mut left_v = line.left(&self.of(terms), &self.missing);
        left_v.truncate(self.turning);
        Explanation {
            left_v,
            terms: terms.iter().map(|term| TERMS[*term].effect).collect(),
            constants: constants.collect(),
            sigmas: (0..terms.len()).map(|index| line.sigmas(index, noise)).collect(),
            chi2_per_dof: line.chi2_per_dof(),
            lacks_sigmas: self.lacks_sigmas(terms, noise),
            left_out_rmse_v: rms(&left_out_v[..self.turning]),
        }
    }
}

/// Terms as fitted.
struct Fit {
    terms: Vec<usize>,
    line: Line,
    /// Deviation of each row from the prediction by the others; that of the winding in ohms.
    left_out_v: Vec<f64>,
}

impl Fit {
    /// `None` if there are too few levels, or if a constant comes out that no motor has.
    fn new(equation: &Equation, terms: Vec<usize>, (r, k): (f64, f64)) -> Option<Self> {
        let line = equation.line(&terms).filter(|_| terms.len() < equation.missing.len())?;
        let left_out_v = left_out(&equation.of(&terms), &equation.missing, &equation.errors)?;
        let possible = terms.iter().zip(&line.values).all(|(term, value)| (TERMS[*term].nominal)(r, k) + value > 0.0);
        possible.then_some(Self { terms, line, left_out_v })
    }

    /// In standard errors of the rows.
    fn foretells_to_sigmas(&self, errors: &Errors) -> f64 {
        rms(&self.left_out_v.iter().zip(errors.each()).map(|(off, error)| off / error).collect::<Vec<_>>())
    }
}

/// Standard error of its mean, as the resistance of the turning winding.
fn winding_error_ohm(winding: &Winding) -> f64 {
    let count = winding.resistances_ohm.len() as f64;
    let spread_ohm = if count > 1.0 { winding.spread_ohm } else { OTHER_POSITION * winding.mean_ohm };
    (spread_ohm / count.sqrt()).max(HELD_AS_TURNING * winding.mean_ohm)
}

/// All possible explanations, the one to name first; the nominal values are always among them.
pub(super) fn explanations(
    turning: &[Level],
    held: &[Level],
    winding: Option<&Winding>,
    nominal: (f64, f64),
) -> Vec<Explanation> {
    let equation = Equation::new(turning, held, winding, nominal.0);
    let sets = (0..1_usize << TERMS.len()).map(|set| (0..TERMS.len()).filter(|term| set >> term & 1 == 1).collect());
    let mut sets: Vec<Vec<usize>> = sets.filter(|set: &Vec<usize>| set.len() <= MOST_TERMS).collect();
    sets.sort_unstable();
    let fits: Vec<Fit> = sets.into_iter().filter_map(|terms| Fit::new(&equation, terms, nominal)).collect();
    let off_sigmas = |fit: &Fit| fit.foretells_to_sigmas(&equation.errors);
    let best = fits.iter().min_by(|a, b| off_sigmas(a).total_cmp(&off_sigmas(b)));
    let noise = best.expect("the nominal values are among them").line.noise();
    let mut found: Vec<Explanation> = fits.iter().map(|fit| equation.explanation(fit, noise, nominal)).collect();
    found.sort_by(|a, b| match (a.holds(), b.holds()) {
        (false, false) => a.left_out_rmse_v.total_cmp(&b.left_out_rmse_v),
        _ => a.place().cmp(&b.place()),
    });
    found
}

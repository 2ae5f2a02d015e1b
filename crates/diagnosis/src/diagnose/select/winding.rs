//! An inductance far above the nominal one is likelier an effect that looks like it.

use super::Chooser;
use crate::configuration::diagnose::select_winding::HELD_SPREAD;
use crate::diagnose::data_sheet::excessive_inductance_h;
use crate::identify::{Effort, Fit, fit, scales};
use motorbench_model::catalogue::{INDUCTANCE, effect};

impl Chooser<'_> {
    /// In place of an implausible inductance: an effect that looks like it, if it explains as much.
    pub(super) fn replace_excessive_inductance(&self, found: Fit) -> Fit {
        let found = self.restart_from_nominal_inductance(found);
        let Some(excess_h) = self.excessive_inductance_h(&found) else { return found };
        let excess_s = excess_h / found.model.motor.resistance_ohm;
        let scales = scales(&self.prior.motor, self.data);
        let others = self.possible().filter(|effect| !found.model.has(effect.about().id));
        let like_it = others.filter_map(|effect| Some((effect, effect.instead_of(INDUCTANCE, &[excess_s], &scales)?)));
        let fits = like_it.map(|(effect, values)| {
            let mut model = found.model.with(effect, values);
            model.motor.inductance_h -= excess_h;
            self.or_other_laws(self.fits.fit(&model, Effort::FULL), |term| term.id() == effect.about().id)
        });
        let has_the_winding = fits.filter(|other| self.has_the_winding(other));
        match has_the_winding.min_by(|a, b| a.cost.total_cmp(&b.cost)) {
            Some(other) if !self.is_worse(&other, &found) => other,
            _ => found,
        }
    }

    /// Whether a model explains the data with the nominal inductance, or with one that is not far from it.
    pub(super) fn has_the_winding(&self, fit: &Fit) -> bool {
        self.excessive_inductance_h(fit).is_none() || !self.is_worse(&self.with_nominal_inductance(fit), fit)
    }

    /// If the inductance stayed implausible with an effect, or after a search without one: restarts from the nominal
    /// one.
    fn restart_from_nominal_inductance(&self, found: Fit) -> Fit {
        if self.excessive_inductance_h(&found).is_none() {
            return found;
        }
        let held = self.with_nominal_inductance(&found);
        let other = self.fits.fit(&held.model, Effort::FULL);
        let other = self.or_other_laws(other, |term| self.looks_like_inductance(term.id()));
        if other.cost < found.cost { other } else { found }
    }

    pub(super) fn excessive_inductance_h(&self, fit: &Fit) -> Option<f64> {
        excessive_inductance_h(self.prior, fit)
    }

    pub(super) fn with_nominal_inductance(&self, found: &Fit) -> Fit {
        let mut prior = self.prior.clone();
        prior.spread[1] = HELD_SPREAD;
        let mut model = found.model.clone();
        model.motor.inductance_h = prior.motor.inductance_h;
        fit(&model, self.data, &prior, Effort::CHECK)
    }

    /// Whether an effect can look like additional inductance.
    pub(super) fn looks_like_inductance(&self, id: &str) -> bool {
        let scales = scales(&self.prior.motor, self.data);
        effect(id).is_some_and(|effect| effect.instead_of(INDUCTANCE, &[0.0], &scales).is_some())
    }
}

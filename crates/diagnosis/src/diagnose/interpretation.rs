//! How recordings are interpreted: what the rig file leaves open about them is settled in turn, and after each step the
//! effects are selected anew.

use super::bad_stretches::{LEFT_OF_REST, MOST_PLACES};
use super::causes::is_between_rows;
use super::channels::excluded;
use super::hidden_drop::HiddenDrop;
use super::judge::{self, AS_GOOD, NOT_NOISE, VERY_STRONG_NATS, above_floor};
use super::random_losses::RandomLosses;
use super::scale::Scale;
use super::select::{self, Selection, Standing, select, usual_model};
use super::trust::{is_of_a_scale, may_be_nothing, remove_effect, remove_untrusted};
use super::{
    another_part, bad_stretches, command_times, counter_stops, current_window, data_sheet, laws, mains_hum,
    pwm_frequency, pwm_phase, ripple_phase, speed_reading, unseen_losses,
};
use crate::configuration::diagnose::interpretation::BEYOND_DOUBT_SIGMAS;
use crate::dataset::Dataset;
use crate::identify::{Effort, Fit, Interval, Prior, Z95, fit, has_unknown_torque_scale};
use motorbench_model::catalogue::{ACTUATION_DELAY, About, INDUCTANCE, USUAL, effect};
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::{Model, Term};
use std::cmp::Ordering;

/// How the data are interpreted, and the model that explains them so.
pub(super) struct Interpretation {
    pub data: Dataset,
    pub selection: Selection,
    /// The model with everything that was selected, untrusted effects included.
    pub fullest: Fit,
    /// The model with the trusted effects alone, fitted to all data.
    pub last: Fit,
    /// Intervals of its constants by other laws of the same effects that explain as much.
    pub by_other_laws: Vec<Vec<Interval>>,
    /// What the winding has at least beside a delay that neither the rig file nor the model has.
    pub least_inductance_h: Option<f64>,
}

impl Interpretation {
    /// With the laws that all the data suggest. Beside another law an effect may be nothing.
    fn settled(data: Dataset, prior: &Prior, mut selection: Selection, fullest: Fit, mut last: Fit) -> Self {
        let everything = data.with_nothing_held_out();
        let laws::Settled { better, others: mut by_other_laws } = laws::settle(&last, &everything, prior);
        if let Some(better) = better {
            let anew = fit(&better.model, &data, prior, Effort::FULL);
            // The held-out data must not speak against it.
            if judge::held_out_nats(&data, &selection.last, &anew) > 0.0 {
                (selection.last, last) = (anew, better);
                while let Some(index) = nothing(&selection, &last, &everything) {
                    remove_effect(&data, prior, &mut selection, index);
                    last = fit(&selection.last.model, &everything, prior, Effort::FULL);
                }
            } else {
                by_other_laws.push(better.uncertainty(&everything).intervals());
            }
        }
        Self { data, selection, fullest, last, by_other_laws, least_inductance_h: None }
    }

    /// The same behind a drop that the data do not show. It scales the voltage, so the same effects act.
    pub(super) fn behind(self, drop: HiddenDrop, prior: &Prior, progress: select::Progress) -> Self {
        let data = drop.before(&self.data);
        let refit = |model: &Model, data: &Dataset| fit(model, data, prior, Effort::FULL);
        let [last, fullest] =
            [&self.selection.last, &self.fullest].map(|found| refit(&drop.behind(&found.model, &self.data), &data));
        let selection = select::anew_from(&data, prior, &excluded(&data), last, self.selection.steps, progress);
        let last = refit(&selection.last.model, &data.with_nothing_held_out());
        Self::settled(data, prior, selection, fullest, last)
    }

    /// With what any bench may have, where it has evidence and cannot be named beside a rest: the usual effects, delays, and
    /// faults of sensors. A model without them puts them into its constants.
    pub(super) fn with_unnamed(mut self, prior: &Prior) -> Self {
        let Selection { last, widest, .. } = &self.selection;
        if above_floor(&self.data, last) < NOT_NOISE {
            return self;
        }
        let may_be = |about: &About| USUAL.contains(&about.id) || about.is_delay || about.sensor.is_some();
        let refit = |model: &Model, data: &Dataset| fit(model, data, prior, Effort::FULL);
        let is_unnamed = |term: &&Term| !last.model.has(term.id()) && may_be(term.effect.about());
        let unnamed: Vec<Term> = widest.model.terms.iter().filter(is_unnamed).cloned().collect();
        if unnamed.is_empty() {
            return self;
        }
        let model = Model { motor: widest.model.motor, terms: [&last.model.terms[..], &unnamed].concat() };
        let mut with = refit(&model, &self.data);
        loop {
            let evidence = |id: &'static str| {
                let without = refit(&with.model.without(id), &self.data);
                (judge::evidence_nats(&self.data, &without, &with), without)
            };
            let unnamed = with.model.terms.iter().map(Term::id).filter(|id| !last.model.has(id));
            match unnamed.map(evidence).min_by(|one, other| one.0.total_cmp(&other.0)) {
                None => return self,
                Some((nats, without)) if nats < VERY_STRONG_NATS => with = without,
                Some(_) => break,
            }
        }
        self.last = refit(&with.model, &self.data.with_nothing_held_out());
        self.selection.last = with;
        self
    }

    /// With a delay of the commands that the rig file does not state, where it has very strong evidence and explains too little to
    /// be named: without it, it would be inductance. Where it has none, what the winding has at least beside it.
    pub(super) fn with_unstated_delay(self, prior: &Prior) -> Self {
        let (data, last) = (&self.data, &self.selection.last);
        let is_open = data.origin.timing.command_delay_s.is_none() && !excluded(data).contains(&ACTUATION_DELAY);
        let is_known = last.model.has(ACTUATION_DELAY) || data.has_moments() || !data.axis.drive.is_voltage();
        let Some(delay) = effect(ACTUATION_DELAY).filter(|_| is_open && !is_known) else { return self };
        // A quarter of the winding's time constant is late in its place, so that the response stays nearly the same.
        let delay_s = 0.25 * TimeConstants::of(&last.model.motor).electromagnetic_s;
        let mut late = last.model.with(delay, vec![delay_s]);
        late.motor.inductance_h -= delay_s * late.motor.resistance_ohm;
        let late = fit(&late, data, prior, Effort::FULL);
        let is_delay = judge::evidence_nats(data, last, &late) > VERY_STRONG_NATS;
        if !is_delay || judge::held_out_nats(data, last, &late) < 0.0 {
            let least_h = || {
                let winding = late.uncertainty(data).of(|model| model.motor.inductance_h);
                winding.value * (-Z95 * winding.deviation / winding.value).exp()
            };
            // What rows too far apart say of it comes from what the laws leave out.
            let is_shown = !is_between_rows(INDUCTANCE, data, &late.model.motor);
            return Self { least_inductance_h: is_shown.then(least_h), ..self };
        }
        let on_everything = fit(&late.model, &data.with_nothing_held_out(), prior, Effort::FULL);
        Self { selection: Selection { last: late, ..self.selection }, last: on_everything, ..self }
    }

    /// With the prior weighed beside what remains without a name: a constant that the data hardly show is then near its nominal
    /// value, instead of where it takes a little of the rest.
    pub(super) fn with_prior_weighed(mut self, prior: &Prior) -> Self {
        if above_floor(&self.data, &self.selection.last) < NOT_NOISE {
            return self;
        }
        let everything = self.data.with_nothing_held_out();
        let prior = prior.beside(&self.last, &everything);
        self.selection.last = fit(&self.selection.last.model, &self.data, &prior, Effort::FULL);
        self.last = fit(&self.last.model, &everything, &prior, Effort::FULL);
        self
    }

    /// A constant share of lost counts, where no other effect explains lost counts.
    pub(super) fn random_losses(&self) -> Option<RandomLosses> {
        let Self { data, selection, .. } = self;
        let is_named = selection.last.model.has(counter_stops::ID) || !data.origin.counter_stops.is_empty();
        if is_named {
            return None;
        }
        RandomLosses::of(data, &selection.last.residual_of(data, data.motion_index()))
    }
}

/// The interpretation in the scale that the nominal values suggest, if the data fit better in it.
pub(super) fn with_corrected_scale(
    recorded: Interpretation,
    prior: &Prior,
    progress: select::Progress,
) -> (Option<Scale>, Interpretation) {
    let doubts = |way: &Interpretation| data_sheet::doubts(&way.data, prior, &way.selection.last);
    let of = |fit: &Fit| Scale::of(&recorded.data, prior, fit);
    // In a scale that is far off the search may have failed.
    let search_may_have_failed = doubts(&recorded).contains(&true);
    let scale =
        of(&recorded.selection.last).or_else(|| of(&recorded.selection.base).filter(|_| search_may_have_failed));
    // An unknown effect, or unknown command times, bias all constants, but hardly by as much as another unit does.
    let is_sure = |scale: &Scale, way: &Interpretation| {
        let [has_rest, _] = doubts(way);
        scale.is_another_unit() || !has_rest && !way.data.has_moments()
    };
    // In another scale most models leave the same rest.
    let Some(scale) = scale.filter(|scale| is_sure(scale, &recorded)) else { return (None, recorded) };
    progress("in another scale");
    let corrected = interpret_trusted(scale.corrected(&recorded.data), prior, &[], progress);
    if !is_sure(&scale, &corrected) {
        return (None, recorded);
    }
    // Only the nominal values show a scale: if the motor is farther from them afterwards, the scale is wrong.
    let off = |way: &Interpretation| data_sheet::squared_deviations(prior, &way.selection.last);
    let rank = |way: &Interpretation| (doubts(way), way.selection.last.cost);
    if off(&corrected) < off(&recorded) && rank(&corrected) < rank(&recorded) {
        (Some(scale), corrected)
    } else {
        (None, recorded)
    }
}

/// The best interpretation with trusted effects alone. An effect whose strength may be zero is removed. If it held the
/// place of another law (a spring without a gap, for instance), the search is repeated without it.
pub(super) fn interpret_trusted(
    data: Dataset,
    prior: &Prior,
    excluded_ids: &[&'static str],
    progress: select::Progress,
) -> Interpretation {
    let (seen, mut selection) = best_interpretation(data.clone(), prior, excluded_ids, progress);
    let fullest = selection.last.clone();
    remove_untrusted(&seen, prior, &mut selection);
    progress("intervals");
    let everything = seen.with_nothing_held_out();
    loop {
        let last = fit(&selection.last.model, &everything, prior, Effort::FULL);
        match nothing(&selection, &last, &everything) {
            Some(index) => match selection.standings[index].id {
                id if is_of_a_scale(id) => remove_effect(&seen, prior, &mut selection, index),
                id => return interpret_trusted(data, prior, &[excluded_ids, &[id]].concat(), progress),
            },
            None => return Interpretation::settled(seen, prior, selection, fullest, last),
        }
    }
}

/// The first effect of a selection whose strength may be zero in `last`, which is fitted to everything.
fn nothing(selection: &Selection, last: &Fit, everything: &Dataset) -> Option<usize> {
    let intervals = last.uncertainty(everything).intervals();
    let is_scale_unknown = has_unknown_torque_scale(everything);
    let nothing = |standing: &Standing| {
        let is_real = is_scale_unknown || standing.gain.sigmas > BEYOND_DOUBT_SIGMAS;
        !(is_of_a_scale(standing.id) && is_real) && may_be_nothing(standing, &last.model, &intervals)
    };
    selection.standings.iter().position(nothing)
}

/// The best choice of what the rig file leaves open about the recording. It is judged by the rest above the noise, the
/// distance from the data sheet, and the number of effects. Where the window of a speed lies is searched again only if the
/// effects that were found fit better with the other place.
fn best_interpretation(
    mut data: Dataset,
    prior: &Prior,
    excluded_ids: &[&'static str],
    progress: select::Progress,
) -> (Dataset, Selection) {
    speed_reading::settle_stated_window(&mut data, prior);
    let interpreter = Interpreter { prior, excluded_ids, progress };
    let way = interpreter.interpret(data.clone());
    let last = &way.1.last;
    let is_better = |centred: &Dataset| fit(&last.model, centred, prior, Effort::AGAIN).cost * AS_GOOD < last.cost;
    let is_centred = way.0.with_window_centred().is_some_and(|centred| is_better(&centred));
    let Some(centred) = data.with_window_centred().filter(|_| is_centred) else { return way };
    let other = interpreter.interpret(centred);
    let rank = |(data, selection): &(Dataset, Selection)| {
        let last = &selection.last;
        (data_sheet::doubts(data, prior, last), last.model.terms.len(), last.cost)
    };
    if rank(&other).partial_cmp(&rank(&way)) == Some(Ordering::Less) { other } else { way }
}

/// Settings that the rig file leaves open, in the order in which they are estimated from the current fit. Each returns
/// whether it changed the data.
const SETTLED_IN_TURN: [fn(&mut Dataset, &Prior, &Fit) -> bool; 15] = [
    |data, _, found| mains_hum::settle(data, found),
    pwm_phase::settle,
    pwm_phase::settle_timer,
    command_times::settle,
    command_times::settle_smooth,
    |data, _, found| counter_stops::settle(data, found),
    |data, _, found| counter_stops::settle(data, found),
    |data, _, found| counter_stops::settle(data, found),
    |data, _, found| unseen_losses::settle(data, found),
    pwm_frequency::settle,
    speed_reading::settle,
    speed_reading::settle_average,
    current_window::settle,
    ripple_phase::settle,
    command_times::settle,
];

/// Whether half of the rest of a quantity is left at most. Errors of each quantity over its noise floor.
fn halves_a_rest(before: &[f64], after: &[f64]) -> bool {
    before.iter().zip(after).any(|(before, after)| *before >= NOT_NOISE && *after < LEFT_OF_REST * before)
}

/// Settings that the rig file leaves open, estimated with the nominal motor.
fn settle_before_effects(data: &mut Dataset, prior: &Prior) {
    if data.axis.drive.is_voltage() {
        pwm_frequency::settle_at_first(data, prior);
    }
    counter_stops::settle_by_linear_motor(data, prior);
}

/// Interprets data with some effects excluded.
struct Interpreter<'a> {
    prior: &'a Prior,
    excluded_ids: &'a [&'static str],
    progress: select::Progress<'a>,
}

impl Interpreter<'_> {
    fn interpret(&self, recorded: Dataset) -> (Dataset, Selection) {
        let mut data = recorded.clone();
        if data.axis.drive.is_voltage() {
            pwm_phase::settle_at_first(&mut data, self.prior);
        }
        settle_before_effects(&mut data, self.prior);
        self.settle_by_usual(&mut data);
        let is_needed = |found: &Fit| {
            pwm_phase::is_needed(&data, self.prior, found) && current_window::is_needed(&data, self.prior, found)
        };
        // What explains no more than without it beside the first effects is not searched on.
        let found = select(&data, self.prior, &self.excluded(&data), |found| !is_needed(found), self.progress);
        let mut selection = match found.filter(|found| is_needed(&found.last)) {
            Some(found) => found,
            None => {
                (self.progress)("without a ripple of the PWM or a mean over it");
                data = recorded;
                settle_before_effects(&mut data, self.prior);
                self.select(&data)
            }
        };
        (data, selection) = self.settled(data, selection, |data, _| self.select(data));
        let is_explained = above_floor(&data, &selection.last) < NOT_NOISE;
        let another = || another_part::held_out(&data, self.prior, &selection.widest);
        if let Some((other, found)) = (!is_explained).then(another).flatten() {
            (self.progress)("with another part held out");
            let excluded = self.excluded(&other);
            selection = select::anew_from(&other, self.prior, &excluded, found, selection.steps, self.progress);
            data = other;
        }
        self.without_bad_stretches(&data, &selection).unwrap_or((data, selection))
    }

    /// Settings with which the usual effects explain everything, where they do not without them.
    fn settle_by_usual(&self, data: &mut Dataset) {
        if !data.axis.drive.is_voltage() {
            return;
        }
        let usual = pwm_frequency::usual_bridge(data, self.prior);
        if above_floor(data, &usual) < NOT_NOISE {
            return;
        }
        match another_part::held_out_and_explained(data, self.prior, &usual) {
            Some((other, _)) => *data = other,
            None => current_window::settle_at_first(data, self.prior, &usual),
        }
    }

    fn excluded(&self, data: &Dataset) -> Vec<&'static str> {
        [&excluded(data), self.excluded_ids].concat()
    }

    fn select(&self, data: &Dataset) -> Selection {
        select(data, self.prior, &self.excluded(data), |_| false, self.progress).expect("nothing is given up")
    }

    /// With what the rig file leaves open estimated in turn; `anew` selects the effects after each estimate.
    fn settled(
        &self,
        mut data: Dataset,
        mut selection: Selection,
        anew: impl Fn(&Dataset, Selection) -> Selection,
    ) -> (Dataset, Selection) {
        for settle in SETTLED_IN_TURN {
            if settle(&mut data, self.prior, &selection.last) {
                selection = anew(&data, selection);
            }
        }
        (data, selection)
    }

    /// Without stretches that do not follow their command, if that explains everything or half of what is left of a
    /// quantity. Such a stretch biases every fit, so the greatest is left out first. It may have hidden what else is open
    /// about the recording.
    fn without_bad_stretches(&self, data: &Dataset, found: &Selection) -> Option<(Dataset, Selection)> {
        if above_floor(data, &found.last) < NOT_NOISE {
            return None;
        }
        let usual = usual_model(data, self.prior, &self.excluded(data));
        let mut next = bad_stretches::without_greatest(data, &usual);
        let mut models = vec![usual.model, found.last.model.clone()];
        let (mut before, mut best) = (judge::of_all_rows_above_floor(data, &found.last), None);
        for _ in 0..MOST_PLACES {
            let Some(greatest) = next else { break };
            let (mut rest, mut without) = self.best_without_adjoining(&greatest, &models);
            let after = judge::of_all_rows_above_floor(&rest, &without);
            if above_floor(&rest, &without) < NOT_NOISE || halves_a_rest(&before, &after) {
                let selection;
                (rest, selection) = self.selected_without(rest, without, &found.steps);
                if above_floor(&rest, &selection.last) < NOT_NOISE {
                    return Some(self.without_remnants(rest, selection));
                }
                before = judge::of_all_rows_above_floor(&rest, &selection.last);
                without = selection.last.clone();
                best = Some((rest.clone(), selection));
            }
            next = bad_stretches::without_greatest(&rest, &without);
            models.push(without.model);
        }
        best
    }

    /// Effects and open settings without a stretch, and a fit to what is left. Where that fit does not explain everything, most
    /// effects are known: a search from the beginning would end with doubts again.
    fn selected_without(&self, rest: Dataset, without: Fit, steps: &[select::Step]) -> (Dataset, Selection) {
        (self.progress)("without a stretch that does not follow its command");
        if above_floor(&rest, &without) < NOT_NOISE {
            let selection = self.select(&rest);
            return self.settled(rest, selection, |data, _| self.select(data));
        }
        let beside = |data: &Dataset, found: Fit| {
            select::select_beside(data, self.prior, &self.excluded(data), found, steps.to_vec(), self.progress)
        };
        let selection = beside(&rest, without);
        self.settled(rest, selection, |data, found| beside(data, found.last))
    }

    /// Without what adjoins the stretches that are left out, by the model that explains most.
    fn best_without_adjoining(&self, rest: &Dataset, models: &[Model]) -> (Dataset, Fit) {
        let ways = models.iter().map(|model| bad_stretches::without_adjoining(rest.clone(), self.prior, model));
        ways.min_by(|a, b| a.1.mean_square().total_cmp(&b.1.mean_square())).expect("one model at least")
    }

    /// Without what adjoins the stretches that are left out, once everything is explained: beside them it did not stand out.
    fn without_remnants(&self, data: Dataset, selection: Selection) -> (Dataset, Selection) {
        let (rest, found) = bad_stretches::without_adjoining(data.clone(), self.prior, &selection.last.model);
        if rest.origin.left_out == data.origin.left_out {
            return (data, selection);
        }
        let anew = select::anew_from(&rest, self.prior, &self.excluded(&rest), found, selection.steps, self.progress);
        (rest, anew)
    }
}

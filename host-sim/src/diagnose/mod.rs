//! Given measured data: what the simulation gets wrong, by what cause, and what the model gains by it.
//!
//! 1. The linear motor is fitted in free run ([`identify`](crate::identify)) to two thirds of the data; the last third, in
//!    blocks spread over the recording, only judges; but when a load comes is read from all.
//! 2. Effects of the catalogue are added while they earn their place on the data kept back, then checked backward and
//!    against every rival ([`mod@select`]).
//! 3. What remains above the sensors' noise is located by the lack that makes it most likely ([`missing`]).
//! 4. The constants that are reported are fitted once more to all the data.

mod command_times;
mod counter_stops;
mod current_window;
mod data_sheet;
mod hidden_drop;
pub mod judge;
pub mod missing;
pub mod outcome;
pub mod page;
mod pwm_frequency;
mod random_losses;
mod reading_phase;
pub mod report;
mod ripple_phase;
mod scale;
pub mod select;
mod speed_reading;
mod unseen_losses;

use crate::catalogue::{ActsOn, CATALOGUE, Channels, INDUCTANCE, USUAL, effect};
use crate::dataset::{Dataset, DatasetError, Measured, Output, TOLERANCE, greatest};
use crate::free_run::{Prediction, free_run};
use crate::identify::{Effort, Fit, Interval, Place, Prior, Z95, fit};
use crate::linear::motor_model::TimeConstants;
use crate::model::Model;
use crate::motor::MotorParameters;
use crate::recording::Recording;
use crate::rig::{NominalMotor, Rig};
use crate::terminal_text::short;
use hidden_drop::HiddenDrop;
use judge::{NOT_NOISE, above_floor};
use outcome::{Cause, Estimate, Outcome, Parameter, Quality, RmseGain, RunnerUp, Unexplained, Verdict, confidence};
use random_losses::RandomLosses;
use scale::{Quantity, Scale};
use select::{NAMED_SIGMAS, Selection, Standing, select};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::ops::Range;

/// A model that explains less than this of the motion, with nothing but noise left, has had nothing to explain.
const LEAST_FIT_PERCENT: f64 = 20.0;
/// A name is not trusted while what it explains is less than this multiple of what remains unexplained: the largest part
/// of something unknown often looks like something known.
pub(crate) const LEAST_OF_REST: f64 = 3.0;
/// The share of it that is enough for what hardly any bench is without, where it is certain by itself: in the place of
/// something unknown it was found in none of eighteen benches without it.
const LEAST_OF_USUAL: f64 = 0.5;
/// The multiple for what any course over time has in it: right names had a hundred, wrong ones up to six.
const LEAST_OF_ANY_COURSE: f64 = 20.0;
/// The multiple for a fault of a sensor beside what is too little to be called missing: there the law of a torque may be another
/// one than is named, and no sensor is to blame for what mends the difference. Right names had three and more, wrong ones one.
const LEAST_OF_SMALL_REST: f64 = 2.0;
/// With this evidence an effect is there, though how strong it is may be unknown. Right names have more, wrong ones that were
/// seen less.
const BEYOND_DOUBT_SIGMAS: f64 = 12.0;
/// Data sheets are wrong by this much without being wrong: logarithm of found over nominal.
pub const DATA_SHEET_TOLERANCE: f64 = 0.25;
/// A value is called wrong when it is so many standard errors beyond that...
const BEYOND_TOLERANCE_SIGMAS: f64 = 3.0;
/// ... of which each (of a logarithm) is at least this: the tolerance itself is no sharp bound.
const LEAST_SPREAD: f64 = 0.02;
/// A value that is off by more than this factor is rather in another unit, or counted otherwise.
const OTHER_UNIT: f64 = 2.5;

/// By so much in the logarithm of its likelihood a sensor has to explain what remains better than the bench does to be blamed.
const CLEARLY: f64 = 10.0;

/// By how much a drop may differ between pulse and off phase, as a share of it (one standard deviation): there are two transistors in
/// the one, a transistor and a diode in the other.
const DROP_DIFFERENCE: f64 = 0.15;

/// On what something depends that no curve explains.
pub(crate) const NOTHING_SEEN: &str = "nothing seen";
/// An inductance shows from an electrical time constant of this share of the time between rows on.
const LEAST_ROWS: f64 = 0.3;
/// The constant that bridge and winding share.
const RESISTANCE_OHM: &str = "resistance_ohm";
/// The constant that says when a current answers.
const INDUCTANCE_H: &str = "inductance_H";

/// What is said of constants that were found beside something unknown.
const BESIDE_UNEXPLAINED: &str = "While that is missing all constants, those of the motor too, hold only roughly: their intervals know of the noise and not of what is missing.";
/// An error this many times the sensor's noise is told, though it is too little for a name.
const WORTH_TELLING: f64 = 1.5;

/// A diagnosis with everything that a report shows.
pub struct Diagnosis {
    /// The result.
    pub outcome: Outcome,
    /// The model with everything found, fitted to all the data.
    pub model: Model,
    /// The recordings as they were used.
    pub data: Dataset,
    /// What the linear motor says.
    pub base: Prediction,
    /// What the extended model says, fitted without the data kept back.
    pub extended: Prediction,
    /// Constants of the linear motor fitted alone.
    pub base_model: Model,
    /// What the linear motor lacks, with its constants as found beside the effects.
    pub lacks: Vec<missing::Lack>,
    /// What was added in turn, with the errors after it.
    pub steps: Vec<select::Step>,
}

/// Diagnoses recordings of one rig. `progress` hears what is being done.
///
/// # Errors
/// [`DatasetError`], when the recordings cannot be used; it says what to record instead.
pub fn diagnose(recordings: &[Recording], rig: &Rig, progress: select::Progress) -> Result<Diagnosis, DatasetError> {
    let data = Dataset::new(recordings, rig)?;
    let prior = Prior::new(&rig.motor, &data);
    let mut understood = certain(data, &prior, &[], progress);
    let losses = understood.random_losses();
    if let Some(losses) = losses {
        progress("with the counts that are lost");
        understood = certain(understood.data.with_counts_lost(losses.share), &prior, &[], progress);
    }
    let hidden_drop = HiddenDrop::of(&understood.data, &prior, &rig.bridge, &understood.selection.last);
    if let Some(drop) = hidden_drop {
        progress("behind a drop that the data do not show");
        understood = certain(drop.before(&understood.data), &prior, &[], progress);
    }
    let (scale, understood) = in_its_scale(understood, &prior, progress);
    let Understood { data, selection, fullest, last, intervals } = understood;
    let motion = data.motion_index();
    let fit_percent = judge::fit_percent(&data, &selection.last.prediction, motion);
    if fit_percent < LEAST_FIT_PERCENT && above_floor(&data, &selection.last) < NOT_NOISE {
        let name = recordings.first().map_or_else(String::new, |recording| recording.name.clone());
        return Err(match data.is_steady() {
            true => DatasetError::Steady(name),
            false => DatasetError::Drowned(name, fit_percent.max(0.0)),
        });
    }
    progress("what is missing");
    let bare = Model::linear(last.model.motor);
    let residuals = residuals(&data, &free_run(&bare, &data));
    let places = [ActsOn::Torque, ActsOn::Voltage];
    let lacks = places.map(|place| missing::lack(&data, &bare.motor, &residuals, place)).to_vec();
    let outcome = Outcome::of(
        &data,
        &prior,
        (&selection, &fullest),
        (&last.model, &intervals),
        Taken {
            losses,
            scale,
            hidden_drop,
            late_h: late_h(&data, &last.model),
            off_phase: off_phase(&data, &last.model),
        },
    );
    let model = losses.map_or(last.model.clone(), |losses| losses.also_in(&last.model));
    Ok(Diagnosis {
        outcome,
        model: hidden_drop::also_in(model, &data),
        base: selection.base.prediction,
        extended: selection.last.prediction,
        base_model: selection.base.model,
        lacks,
        steps: selection.steps,
        data: data.behind_a_drop(0.0),
    })
}

/// As what the data were taken, other than they were recorded.
#[derive(Clone, Copy)]
struct Taken {
    /// What an inductance is uncertain by when in its period a current is read.
    late_h: f64,
    losses: Option<RandomLosses>,
    scale: Option<Scale>,
    hidden_drop: Option<HiddenDrop>,
    /// By how much a drop that is another in the off phase of the PWM changes the supply: standard deviation of the logarithm.
    off_phase: f64,
}

impl Taken {
    /// The interval of a constant with what it is uncertain by that.
    fn widened(&self, constant: &str, value: f64, ci95: [f64; 2]) -> [f64; 2] {
        let of_losses = self.losses.map_or(0.0, |losses| losses.uncertainty(constant));
        let of_scale = self.scale.map_or(0.0, |scale| scale.uncertainty(constant));
        let of_drop = self.hidden_drop.map_or(0.0, |drop| drop.uncertainty(constant));
        let of_reading = if constant == INDUCTANCE_H { self.late_h / value } else { 0.0 };
        let of_off_phase = Quantity::Voltage.power(constant).abs() * self.off_phase;
        let besides = Z95 * of_losses.hypot(of_scale).hypot(of_drop).hypot(of_off_phase).hypot(of_reading) * value;
        let [low, high] = [value - (value - ci95[0]).hypot(besides), value + (ci95[1] - value).hypot(besides)];
        // What has no sign keeps none.
        if value > 0.0 && ci95[0] >= 0.0 { [low.max(0.0), high] } else { [low, high] }
    }
}

/// A bridge that drops another voltage in the off phase of its PWM than in the pulse is one with another supply: nothing in a
/// recording tells the two apart.
fn off_phase(data: &Dataset, model: &Model) -> f64 {
    DROP_DIFFERENCE * model.dry_losses().bridge_drop_v / greatest(&data.supply_v).max(f64::MIN_POSITIVE)
}

/// A current that is read anywhere in a period of the PWM is as much too late as a winding of more inductance is, and so is a
/// command that a program carries out somewhere in the first half of its row.
fn late_h(data: &Dataset, model: &Model) -> f64 {
    let timing = &data.origin.timing;
    if data.current().is_none() {
        return 0.0;
    }
    // Of rows that come faster each is elsewhere in the period.
    let period_s = (1.0 / data.origin.pwm_hz).min(data.interval_s);
    let reading_s = if timing.current_sampled_at.is_none() { period_s } else { 0.0 };
    let command_s = if timing.command_delay_s.is_none() { 0.5 * data.interval_s } else { 0.0 };
    // Standard deviation of what is anywhere in it.
    model.motor.resistance_ohm * reading_s.hypot(command_s) / 12.0_f64.sqrt()
}

/// What of the resistance may be the bridge's: a drop grows with the current at most by itself over all of it.
fn bridge_ohm(data: &Dataset, model: &Model) -> f64 {
    let greatest_a = data.current().map_or(f64::INFINITY, |current| greatest(&current.values));
    model.dry_losses().bridge_drop_v / greatest_a.max(f64::MIN_POSITIVE)
}

/// What is understood of data.
struct Understood {
    data: Dataset,
    selection: Selection,
    /// The model with all that was selected, what was not trusted as well.
    fullest: Fit,
    /// The trusted one, fitted to all of them.
    last: Fit,
    intervals: Vec<Interval>,
}

impl Understood {
    /// Counts lost at all speeds alike, where nothing else says that counts are lost.
    fn random_losses(&self) -> Option<RandomLosses> {
        let Self { data, selection, .. } = self;
        let is_named = selection.last.model.has(counter_stops::ID) || !data.origin.counter_stops.is_empty();
        if is_named {
            return None;
        }
        RandomLosses::of(data, &selection.last.residual_of(data, data.motion_index()))
    }
}

/// The same in the scale that the nominal values say, where the data are better understood by that.
fn in_its_scale(recorded: Understood, prior: &Prior, progress: select::Progress) -> (Option<Scale>, Understood) {
    let doubts = |way: &Understood| data_sheet::doubts(&way.data, prior, &way.selection.last);
    let of = |fit: &Fit| Scale::of(&recorded.data, prior, fit);
    // In a scale that is far off the search may have gone astray.
    let has_gone_astray = doubts(&recorded).contains(&true);
    let scale = of(&recorded.selection.last).or_else(|| of(&recorded.selection.base).filter(|_| has_gone_astray));
    let Some(scale) = scale else { return (None, recorded) };
    progress("in another scale");
    let corrected = certain(scale.corrected(&recorded.data), prior, &[], progress);
    // Something unknown drags all constants with it, as unknown commands do, though hardly into another unit.
    let [has_rest, _] = doubts(&corrected);
    if (has_rest || corrected.data.has_moments()) && !scale.is_another_unit() {
        return (None, recorded);
    }
    // Nothing but the nominal values tells of a scale: a motor that is farther from them speaks against it.
    let off = |way: &Understood| data_sheet::strangeness(prior, &way.selection.last);
    let rank = |way: &Understood| (doubts(way), way.selection.last.cost);
    if off(&corrected) < off(&recorded) && rank(&corrected) < rank(&recorded) {
        (Some(scale), corrected)
    } else {
        (None, recorded)
    }
}

/// The data as they are understood best by effects that are there without doubt. What turns out to be nothing is taken back;
/// where it had the place of another law, as of a spring when there is no gap, the data are looked at anew without it.
fn certain(data: Dataset, prior: &Prior, not: &[&'static str], progress: select::Progress) -> Understood {
    let (seen, mut selection) = best_understood(data.clone(), prior, not, progress);
    let fullest = selection.last.clone();
    distrust(&seen, prior, &mut selection);
    progress("intervals");
    let mut everything = seen.clone();
    everything.kept_back.fill(false);
    loop {
        let last = fit(&selection.last.model, &everything, prior, Effort::FULL);
        let intervals = last.intervals(&everything);
        let nothing = |standing: &Standing| may_be_nothing(standing, &last.model, &intervals);
        match selection.standings.iter().position(nothing) {
            Some(index) => match selection.standings[index].id {
                id if is_of_a_scale(id) => take_back(&seen, prior, &mut selection, index),
                id => return certain(data, prior, &[not, &[id]].concat(), progress),
            },
            None => return Understood { data: seen, selection, fullest, last, intervals },
        }
    }
}

/// The data with what the rig file leaves open of how they were recorded as they are understood best, and what they are
/// understood by: down to the noise, by the motor of the rig, by few effects.
fn best_understood(
    data: Dataset,
    prior: &Prior,
    not: &[&'static str],
    progress: select::Progress,
) -> (Dataset, Selection) {
    let centred = data.with_window_centred();
    let ways = [Some(data), centred].into_iter().flatten().map(|data| understood(data, prior, not, progress));
    let rank = |(data, selection): &(Dataset, Selection)| {
        let last = &selection.last;
        (data_sheet::doubts(data, prior, last), last.model.terms.len(), last.cost)
    };
    ways.min_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal)).expect("one way at least")
}

/// What the rig file leaves open, by what is understood so far; each says whether the data have changed by it.
const SETTLED_IN_TURN: [fn(&mut Dataset, &Prior, &Fit) -> bool; 10] = [
    command_times::settle,
    |data, _, found| counter_stops::settle(data, found),
    |data, _, found| counter_stops::settle(data, found),
    |data, _, found| counter_stops::settle(data, found),
    |data, _, found| unseen_losses::settle(data, found),
    pwm_frequency::settle,
    speed_reading::settle,
    current_window::settle,
    ripple_phase::settle,
    command_times::settle,
];

fn understood(
    mut data: Dataset,
    prior: &Prior,
    not: &[&'static str],
    progress: select::Progress,
) -> (Dataset, Selection) {
    let anew = |data: &Dataset| select(data, prior, &[&excluded(data), not].concat(), progress);
    pwm_frequency::settle_at_first(&mut data, prior);
    reading_phase::settle_at_first(&mut data, prior);
    counter_stops::settle_by_linear_motor(&mut data, prior);
    let mut selection = anew(&data);
    for settle in SETTLED_IN_TURN {
        if settle(&mut data, prior, &selection.last) {
            selection = anew(&data);
        }
    }
    (data, selection)
}

/// Effects that these channels say nothing of.
fn excluded(data: &Dataset) -> Vec<&'static str> {
    let channels = Channels {
        current: data.current().is_some(),
        speed: data.motion().output == Output::Speed,
        counts: data.origin.is_counted,
        moments: data.has_moments(),
        one_magnitude: data.has_one_magnitude(),
    };
    CATALOGUE.iter().filter(|effect| !effect.shows_in(&channels)).map(|effect| effect.about().id).collect()
}

/// Measured minus simulated, per quantity.
fn residuals(data: &Dataset, prediction: &Prediction) -> Vec<Vec<f64>> {
    let difference = |(measured, predicted): (&Measured, &Vec<f64>)| {
        measured.values.iter().zip(predicted).map(|(value, predicted)| value - predicted).collect()
    };
    data.measured.iter().zip(prediction).map(difference).collect()
}

/// Takes back names that explain too little beside what remains ([`Rest::outweighs`]): where something big is unknown, small things are not known. Beside a
/// rest that is none to speak of a name stays that has made it so.
fn distrust(data: &Dataset, prior: &Prior, selection: &mut Selection) {
    while let Some(rest) = Rest::of(data, &selection.last) {
        let mut weak = (0..selection.standings.len()).filter(|index| rest.outweighs(&selection.standings[*index]));
        let without = |index: usize| {
            let mut without = selection.clone();
            take_back(data, prior, &mut without, index);
            (rest.is_missing || above_floor(data, &without.last) < NOT_NOISE).then_some(without)
        };
        let Some(without) = weak.find_map(without) else { return };
        *selection = without;
    }
}

/// Whether an effect may be no more than a part of something unknown.
fn is_of_any_course(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.is_of_any_course())
}

/// Whether an effect is a sensor's.
fn is_of_a_sensor(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().acts_on.is_of_a_sensor())
}

/// What a model leaves of each measured quantity beyond the noise.
struct Rest {
    /// Whether it is so much that something is missing.
    is_missing: bool,
    /// Squares of what the quantities are weighed by.
    units: Vec<f64>,
    /// The sum of all, in these.
    weight: f64,
}

impl Rest {
    /// Of a model that leaves more than noise.
    fn of(data: &Dataset, fit: &Fit) -> Option<Self> {
        let outputs = 0..data.measured.len();
        let floors: Vec<f64> =
            outputs.clone().map(|output| judge::noise(data, &fit.residual_of(data, output), output)).collect();
        let left: Vec<f64> = outputs.clone().map(|output| judge::rmse(data, &fit.prediction, output)).collect();
        let is_missing = above_floor(data, fit) >= NOT_NOISE;
        if !is_missing && left.iter().zip(&floors).all(|(left, floor)| *left < NOT_NOISE * floor) {
            return None;
        }
        let tolerated = |output: usize| data.measured[output].least_error(data.measured[output].noise);
        let unit = |output: usize| if is_missing { tolerated(output) } else { floors[output] };
        let units: Vec<f64> = outputs.clone().map(|output| unit(output).powi(2)).collect();
        let weight = outputs.map(|output| (left[output].powi(2) - floors[output].powi(2)) / units[output]).sum();
        Some(Self { is_missing, units, weight })
    }

    /// Whether a name explains too little beside it.
    fn outweighs(&self, standing: &Standing) -> bool {
        let explained = standing.gain.rmse.iter().zip(&self.units);
        let own: f64 = explained.map(|((before, after), unit)| (before.powi(2) - after.powi(2)) / unit).sum();
        let least = match self.is_missing {
            true if is_of_any_course(standing.id) => LEAST_OF_ANY_COURSE,
            true if USUAL.contains(&standing.id) && standing.gain.sigmas > NAMED_SIGMAS => LEAST_OF_USUAL,
            true => LEAST_OF_REST,
            false if is_of_a_sensor(standing.id) => LEAST_OF_SMALL_REST,
            false => return false,
        };
        own < least * self.weight
    }
}

/// Whether the interval of an effect's strength holds nothing at all, and not because the data say nothing of the scale that
/// it is linear in, as of all torques: then the effect itself is beyond doubt.
fn may_be_nothing(standing: &Standing, model: &Model, intervals: &[Interval]) -> bool {
    let Some(index) = model.terms.iter().position(|term| term.id() == standing.id) else { return false };
    let effect = model.terms[index].effect;
    let parameters = effect.about().parameters;
    let holds_nothing = |interval: &Interval, group: &Range<usize>| match interval.place {
        Place::Term(term, constant) if term == index && group.contains(&constant) => {
            Some((interval.ci95[0]..=interval.ci95[1]).contains(&parameters[constant].nothing()))
        }
        _ => None,
    };
    let may_be_nothing = |group: Range<usize>| {
        let mut known = intervals.iter().filter_map(|interval| holds_nothing(interval, &group)).peekable();
        known.peek().is_some() && known.all(|holds_nothing| holds_nothing)
    };
    !(is_of_a_scale(standing.id) && standing.gain.sigmas > BEYOND_DOUBT_SIGMAS)
        && effect.strengths().into_iter().any(may_be_nothing)
}

/// Whether an effect's strength is a factor of what it does.
fn is_of_a_scale(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().linear_in > 0)
}

/// Takes a name back.
fn take_back(data: &Dataset, prior: &Prior, selection: &mut Selection, index: usize) {
    let taken = selection.standings.remove(index);
    let last = fit(&selection.last.model.without(taken.id), data, prior, Effort::CHECK);
    for standing in &mut selection.standings {
        let without = fit(&last.model.without(standing.id), data, prior, Effort::CHECK);
        standing.gain = judge::gain(data, &without.prediction, &last.prediction);
    }
    selection.last = last;
}

impl Outcome {
    fn of(
        data: &Dataset,
        prior: &Prior,
        (selection, fullest): (&Selection, &Fit),
        (model, intervals): (&Model, &[Interval]),
        taken: Taken,
    ) -> Self {
        let Taken { losses, scale, hidden_drop, .. } = taken;
        let mut causes: Vec<Cause> =
            selection.standings.iter().map(|standing| cause(data, standing, model, intervals)).collect();
        for (constant, Estimate { value, ci95 }) in causes.iter_mut().flat_map(|cause| &mut cause.parameters) {
            *ci95 = ci95.map(|ci95| taken.widened(constant, *value, ci95));
        }
        if !model.has(counter_stops::ID) {
            causes.extend(counter_stops::cause(data, &selection.last.prediction));
        }
        if let Some(losses) = losses {
            causes.push(losses.cause(data, judge::rmse(data, &selection.last.prediction, data.motion_index())));
        }
        causes.sort_by(|a, b| b.evidence_sigmas.total_cmp(&a.evidence_sigmas));
        causes.retain(|cause| !is_order_of_rows(&cause.effect, data, model));
        let mut parameters = parameters(model, &prior.nominal, intervals);
        for (constant, Parameter { value, ci95, .. }) in &mut parameters {
            *ci95 = taken.widened(constant, *value, *ci95);
        }
        causes.extend(scale.map(|scale| scale.cause(data, hidden_drop.is_some())));
        let unexplained = unexplained(data, selection, fullest);
        if unexplained.is_none() {
            // While something is missing it falsifies the constants as well.
            let shows = |cause: &Cause| {
                !is_of_the_reading(&cause.effect, data, model) && !is_between_rows(&cause.effect, data, &model.motor)
            };
            causes.extend(wrong_values(&parameters, bridge_ohm(data, model)).into_iter().filter(shows));
        }
        let verdict = match (causes.is_empty(), unexplained.is_some()) {
            (true, false) => Verdict::Sufficient,
            (false, false) => Verdict::Explained,
            (false, true) => Verdict::PartlyExplained,
            (true, true) => Verdict::Unexplained,
        };
        let mut outcome =
            Self { verdict, causes, unexplained, parameters, fit: fits(data, selection), advice: Vec::new() };
        outcome.advice = outcome.advice(data);
        outcome.advice.extend(outcome.small_rest());
        outcome.advice.extend(scale.map(|scale| scale.advice(data)));
        outcome.advice.extend(hidden_drop.map(|drop| drop.note()));
        outcome
    }

    /// What is left where nothing is missing: more than the noise, and too little for a name.
    fn small_rest(&self) -> Option<String> {
        let (reached, floor) = (&self.fit["extended"], &self.fit["noise_floor"]);
        let times = |(channel, quality): (&&'static str, &Quality)| (quality.rmse / floor[channel].rmse, *channel);
        let (times, channel) = reached.iter().map(times).max_by(|a, b| a.0.total_cmp(&b.0))?;
        (self.unexplained.is_none() && times > WORTH_TELLING).then(|| {
            format!(
                "The error left in {channel} is {times:.1} times its sensor's noise, yet less than {:.0} % of what it ranges over: something small may be missing that is not looked for.",
                100.0 * TOLERANCE
            )
        })
    }

    fn advice_on_values(&self) -> Vec<String> {
        let mut advice = Vec::new();
        let wrong =
            |name: &str| self.causes.iter().any(|cause| cause.is_value() && cause.parameters.contains_key(name));
        for (name, parameter) in self.parameters.iter().filter(|(name, found)| wrong(name) && !is_other_unit(found)) {
            let nominal = parameter.nominal.map_or_else(String::new, short);
            advice.push(format!("Write {name} = {} into the rig file in place of {nominal}.", short(parameter.value)));
        }
        if self.causes.iter().any(Cause::is_value) && self.parameters.values().any(is_other_unit) {
            advice.push(
                "So far off is rather a unit than a motor: is i_A in amperes, a speed in rad/s and not in rpm, counts_per_rev after x4 decoding, and the sensor on the motor's shaft and not behind a gear?".into(),
            );
        }
        advice
    }

    /// What to do next, by causes, rest and data.
    pub(crate) fn advice(&self, data: &Dataset) -> Vec<String> {
        let mut advice = Vec::new();
        for cause in &self.causes {
            let Some(about) = crate::catalogue::effect(&cause.effect).map(|effect| effect.about()) else { continue };
            if !cause.not_separable_from.is_empty() {
                let others = cause.not_separable_from.join(" or ");
                advice
                    .push(format!("{} could as well be {others}. To tell them apart: {}.", about.id, about.experiment));
            }
            advice.push(format!("Against {}: {}.", about.title, about.remedy));
        }
        advice.extend(self.advice_on_values());
        if let Some(unexplained) = &self.unexplained {
            advice.push(format!(
                "Something is missing that has no name here: {}. Look at the report's plots of what is missing.",
                unexplained.place()
            ));
            advice.push(BESIDE_UNEXPLAINED.into());
        }
        advice.extend(data.notes());
        if data.current().is_none() {
            advice.push("Without the current, torque and voltage can hardly be told apart: record i_A as well.".into());
        }
        let reverses = |sign: f64| data.motion().values.iter().any(|speed| sign * speed > 10.0 * data.motion().noise);
        if !(reverses(1.0) && reverses(-1.0)) {
            advice.push(
                "The motor never reverses here: what differs between directions, and friction from other losses, shows only in a recording through zero both ways (sequence `identify`).".into(),
            );
        }
        advice
    }
}

/// Whether found and nominal are in other units, rather than of another motor.
fn is_other_unit(parameter: &Parameter) -> bool {
    parameter.nominal.is_some_and(|nominal| (parameter.value / nominal).ln().abs() > OTHER_UNIT.ln())
}

/// Whether an effect is a delay of less than a row where rows were written after their commands had acted: it tells where in
/// its row a command acts, and is no delay of the bridge.
fn is_order_of_rows(id: &str, data: &Dataset, model: &Model) -> bool {
    let delay_s = model.term(id).map_or(0.0, |term| term.effect.delay_s(&term.values));
    data.origin.written_after && (f64::MIN_POSITIVE..data.interval_s).contains(&delay_s)
}

/// Whether a wrong value is an inductance that the frequency of the PWM, the windows of current and speed or the moments of the
/// commands may have made: where the rig file does not give them, only both together are certain.
fn is_of_the_reading(cause: &str, data: &Dataset, model: &Model) -> bool {
    let shows_pwm = || model.terms.iter().any(|term| term.effect.about().acts_on == ActsOn::Voltage);
    let of_pwm = || !data.origin.pwm_is_known && shows_pwm();
    let of_window = || data.origin.timing.current_window_s.is_none() && data.origin.current_window_s > 0.0;
    cause == INDUCTANCE && (of_pwm() || of_window() || data.has_moments() || data.origin.taken_over_its_row)
}

/// In words.
pub fn acts_on_words(acts_on: ActsOn) -> &'static str {
    match acts_on {
        ActsOn::Torque => "the torque",
        ActsOn::Voltage => "the voltage",
        ActsOn::CurrentSensor => "the current sensor",
        ActsOn::AngleSensor => "the angle or speed sensor",
    }
}

fn cause(data: &Dataset, standing: &Standing, model: &Model, intervals: &[Interval]) -> Cause {
    let rival_sigmas = standing.rival.as_ref().map_or(f64::INFINITY, |(_, gain)| gain.sigmas.max(0.0));
    let sigmas = standing.gain.sigmas.min(if standing.same.is_empty() { rival_sigmas } else { f64::INFINITY });
    let channels = data.measured.iter().map(|measured| measured.output.channel());
    Cause {
        effect: standing.id.into(),
        confidence: confidence(sigmas) / (1.0 + standing.same.len() as f64),
        parameters: constants(standing.id, model, intervals),
        gain: channels
            .zip(&standing.gain.rmse)
            .map(|(channel, (before, after))| (channel, RmseGain { rmse_before: *before, rmse_after: *after }))
            .collect(),
        not_separable_from: standing.same.clone(),
        evidence_sigmas: standing.gain.sigmas,
        runner_up: standing.rival.as_ref().map(|(effect, gain)| RunnerUp {
            effect,
            worse_by_sigmas: gain.sigmas,
            worse_by_share: gain.share,
        }),
    }
}

/// Constants of an effect with their intervals, and the amplitude of a wave.
fn constants(id: &str, model: &Model, intervals: &[Interval]) -> BTreeMap<String, Estimate> {
    let Some(term_index) = model.terms.iter().position(|term| term.id() == id) else { return BTreeMap::new() };
    let term = &model.terms[term_index];
    let interval = |index| intervals.iter().find(|interval| interval.place == Place::Term(term_index, index));
    let mut constants: BTreeMap<String, Estimate> = term
        .said()
        .map(|(index, name, value)| {
            (name.to_string(), Estimate { value, ci95: interval(index).map(|interval| interval.ci95) })
        })
        .collect();
    let wave = term.effect.about().parameters[0].name.strip_prefix("cosine_");
    if let (Some(unit), Some(cosine), Some(sine)) = (wave, interval(0), interval(1)) {
        let amplitude = cosine.value.hypot(sine.value);
        let half = |interval: &Interval| 0.5 * (interval.ci95[1] - interval.ci95[0]) * interval.value / amplitude;
        let half = half(cosine).hypot(half(sine));
        let ci95 = Some([(amplitude - half).max(0.0), amplitude + half]);
        constants.insert(format!("amplitude_{unit}"), Estimate { value: amplitude, ci95 });
    }
    constants
}

fn parameters(model: &Model, nominal: &NominalMotor, intervals: &[Interval]) -> BTreeMap<&'static str, Parameter> {
    let nominal = nominal.values();
    let named = model.motor.named().into_iter().enumerate();
    named
        .map(|(index, (name, value))| {
            let interval = intervals.iter().find(|interval| interval.place == Place::Motor(index));
            let ci95 = interval.map_or([value, value], |interval| interval.ci95);
            (name, Parameter { nominal: nominal[index], value, ci95 })
        })
        .collect()
}

/// Whether a cause is an inductance, of rows so far apart that a current is where it goes to whatever that is.
fn is_between_rows(effect: &str, data: &Dataset, motor: &MotorParameters) -> bool {
    effect == INDUCTANCE && TimeConstants::of(motor).electromagnetic_s < LEAST_ROWS * data.interval_s
}

/// Nominal values that are further off than a data sheet's tolerance. A resistance is that of the circuit, of which the bridge
/// may have `bridge_ohm`.
fn wrong_values(parameters: &BTreeMap<&'static str, Parameter>, bridge_ohm: f64) -> Vec<Cause> {
    // How many standard errors beyond what is tolerated.
    let sigmas_beyond = |name: &str| {
        let parameter = parameters.get(name)?;
        let nominal = parameter.nominal?;
        let of_bridge = if name == RESISTANCE_OHM { (parameter.value - nominal).clamp(0.0, bridge_ohm) } else { 0.0 };
        let off = ((parameter.value - of_bridge) / nominal).ln().abs();
        let spread = (parameter.ci95[1] / parameter.ci95[0].max(f64::MIN_POSITIVE)).ln() / (2.0 * Z95);
        Some((off - DATA_SHEET_TOLERANCE) / spread.max(LEAST_SPREAD))
    };
    let names = [
        ("resistance_ohm", "resistance"),
        ("inductance_H", "inductance"),
        ("torque_constant_Nm_per_A", "torque_constant"),
        ("inertia_kg_m2", "inertia"),
    ];
    names
        .into_iter()
        .filter_map(|(name, id)| {
            let sigmas = sigmas_beyond(name)?;
            let found = parameters[name];
            let estimate = Estimate { value: found.value, ci95: Some(found.ci95) };
            (sigmas > BEYOND_TOLERANCE_SIGMAS).then(|| value_cause(id, name, estimate, sigmas))
        })
        .collect()
}

fn value_cause(id: &str, constant: &str, estimate: Estimate, sigmas: f64) -> Cause {
    Cause {
        effect: format!("parameter:{id}"),
        confidence: confidence(sigmas),
        parameters: BTreeMap::from([(constant.to_string(), estimate)]),
        gain: BTreeMap::new(),
        not_separable_from: Vec::new(),
        evidence_sigmas: sigmas,
        runner_up: None,
    }
}

/// What remains, and where: what the fullest model lacks, since a drop or a friction that nobody trusts beside something
/// greater would be found in place of that.
fn unexplained(data: &Dataset, selection: &Selection, fullest: &Fit) -> Option<Unexplained> {
    if above_floor(data, &selection.last) < NOT_NOISE {
        return None;
    }
    let left = residuals(data, &fullest.prediction);
    let mut places = vec![ActsOn::Torque, ActsOn::AngleSensor];
    if data.current().is_some() {
        places.extend([ActsOn::Voltage, ActsOn::CurrentSensor]);
    }
    let lacks = places.into_iter().map(|place| missing::lack(data, &fullest.model.motor, &left, place));
    let likelihood =
        |lack: &missing::Lack| lack.log_likelihood - if lack.acts_on.is_of_a_sensor() { CLEARLY } else { 0.0 };
    let lack = lacks.max_by(|a, b| likelihood(a).total_cmp(&likelihood(b)))?;
    let dependence = missing::dependences(data, &lack.values).into_iter().next()?;
    let rest = |output: usize| {
        let after = judge::rmse(data, &selection.last.prediction, output);
        let noise = judge::noise(data, &selection.last.residual_of(data, output), output);
        1.0 - (noise.min(after) / after).powi(2)
    };
    Some(Unexplained {
        acts_on: lack.acts_on,
        depends_on: if dependence.share > 0.1 { dependence.on } else { NOTHING_SEEN }.into(),
        share: (0..data.measured.len()).map(rest).fold(0.0, f64::max),
    })
}

fn fits(data: &Dataset, selection: &Selection) -> BTreeMap<&'static str, BTreeMap<&'static str, Quality>> {
    let of = |prediction: &Prediction| {
        let channels = data.measured.iter().enumerate();
        channels
            .map(|(output, Measured { output: kind, .. })| {
                let quality = Quality {
                    rmse: judge::rmse(data, prediction, output),
                    ci95: Some(judge::rmse_interval(data, prediction, output)),
                    unit: kind.unit(),
                    fit_percent: judge::fit_percent(data, prediction, output),
                };
                (kind.channel(), quality)
            })
            .collect()
    };
    let floor = data.measured.iter().enumerate().map(|(output, Measured { output: kind, .. })| {
        let rmse = judge::noise(data, &selection.last.residual_of(data, output), output);
        let reached = judge::fit_percent(data, &selection.last.prediction, output);
        let after = judge::rmse(data, &selection.last.prediction, output);
        // The same spread of the signal, the floor in place of the error.
        let fit_percent = 100.0 - (100.0 - reached) * rmse / after.max(f64::MIN_POSITIVE);
        (kind.channel(), Quality { rmse, ci95: None, unit: kind.unit(), fit_percent })
    });
    BTreeMap::from([
        ("base", of(&selection.base.prediction)),
        ("extended", of(&selection.last.prediction)),
        ("noise_floor", floor.collect()),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An outcome with a torque constant so many times the nominal one, as it was found.
    fn with_torque_constant(found_over_nominal: f64) -> Outcome {
        let value = 0.07 * found_over_nominal;
        let found = Parameter { nominal: Some(0.07), value, ci95: [0.99 * value, 1.01 * value] };
        let parameters = BTreeMap::from([("torque_constant_Nm_per_A", found)]);
        let causes = wrong_values(&parameters, 0.0);
        let fit = BTreeMap::new();
        Outcome { verdict: Verdict::Explained, causes, unexplained: None, parameters, fit, advice: Vec::new() }
    }

    /// An oscilloscope's capture is shorter than anything warms up in.
    #[test]
    fn what_warms_up_may_be_fitted_to_a_tenth_of_a_second() {
        let mut text = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
        for row in 0..90 {
            let speed = 100.0 * (1.0 - f64::exp(-f64::from(row) / 20.0));
            text += &format!("{:.3},12,{speed:.3},{:.4}\n", f64::from(row) * 1e-3, 2.0 - 0.01 * speed);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n").unwrap();
        let data = Dataset::new(&[recording], &rig).unwrap();
        let prior = Prior::new(&rig.motor, &data);
        for id in ["winding_heating", "friction_warmup"] {
            let model = Model::linear(prior.motor)
                .with_start(effect(id).unwrap(), &crate::identify::scales(&prior.motor, &data));
            assert!(fit(&model, &data, &prior, Effort::TRIAL).cost.is_finite());
        }
    }

    #[test]
    fn an_interval_holds_its_own_value_whatever_its_sign() {
        let taken = Taken { late_h: 0.0, losses: None, scale: None, hidden_drop: None, off_phase: 0.03 };
        for (value, ci95) in [(-0.5, [-0.6, -0.4]), (0.5, [0.4, 0.6]), (0.01, [0.0, 0.02])] {
            let [low, high] = taken.widened("torque_Nm", value, ci95);
            assert!(low <= value && value <= high, "{value}: {low} {high}");
            assert!(low <= ci95[0] && ci95[1] <= high, "{value}: {low} {high}");
        }
        assert_eq!(taken.widened("torque_Nm", 0.01, [0.0, 0.02])[0], 0.0, "what has no sign keeps none");
    }

    #[test]
    fn a_wrong_value_is_told_from_a_wrong_unit() {
        let other_motor = with_torque_constant(1.6);
        assert_eq!(
            other_motor.advice_on_values(),
            ["Write torque_constant_Nm_per_A = 0.112 into the rig file in place of 0.0700."]
        );
        let said = page::against_nominal(&other_motor.causes[0], &other_motor).unwrap();
        assert!(said.starts_with("nominal 0.0700: off by 11.0 standard errors"), "{said}");
        let in_rpm = with_torque_constant(60.0 / std::f64::consts::TAU).advice_on_values();
        assert!(in_rpm.len() == 1 && in_rpm[0].contains("not in rpm"), "{in_rpm:?}");
        assert!(with_torque_constant(1.1).advice_on_values().is_empty());
    }
}

//! Diagnosis of recordings: what the simulation gets wrong, which effect causes it, and what the extended model gains.
//!
//! 1. The linear motor is fitted in free run ([`identify`](crate::identify)) to two thirds of the data. The last third,
//!    in blocks spread over the recording, is held out for judging. Only the time of a load step is read from all data.
//! 2. Effects of the catalogue are added while they improve the fit of the held-out data. Then each one is checked
//!    backward and against every rival ([`mod@select`]).
//! 3. What remains above the sensors' noise is located: the discrepancy at the torque or at the voltage that makes it
//!    most likely ([`missing`]).
//! 4. The reported constants are fitted once more to all the data.

mod bad_stretches;
mod command_times;
mod counter_stops;
mod current_window;
mod data_sheet;
pub mod determined;
mod hidden_drop;
pub mod judge;
mod laws;
pub mod missing;
pub mod outcome;
mod pwm_frequency;
mod random_losses;
mod reading_phase;
mod ripple_phase;
mod scale;
pub mod select;
mod speed_reading;
mod undecided;
mod unseen_losses;

use crate::dataset::{Dataset, DatasetError, Measured, Output, TOLERANCE, greatest};
use crate::free_run::{Prediction, free_run};
use crate::identify::{Effort, Fit, Interval, Place, Prior, Uncertainty, Z95, fit, has_unknown_torque_scale};
use determined::AllDetermined;
use hidden_drop::HiddenDrop;
use judge::{NOT_NOISE, above_floor};
use motorbench_data::recording::Recording;
use motorbench_data::rig::{NominalMotor, Rig};
use motorbench_model::catalogue::{ActsOn, CATALOGUE, Channels, Effect, INDUCTANCE, USUAL, effect};
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::motor::MotorParameters;
use motorbench_model::unit::{Quantity, Unit};
use motorbench_model::{Drive, Model};
use motorbench_text::terminal_text::short;
use outcome::{
    Cause, Estimate, Outcome, Parameter, Quality, RmseGain, RunnerUp, ScaleOrigin, Unexplained, Verdict, confidence,
};
use random_losses::RandomLosses;
use scale::Scale;
use select::{NAMED_SIGMAS, Selection, Standing, select};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::ops::Range;

/// A model that explains less than this of the motion, and leaves only noise, cannot be judged: the recording is mostly
/// noise.
const LEAST_FIT_PERCENT: f64 = 20.0;
/// A name needs at least this multiple of the unexplained rest. The largest part of an unknown effect often resembles a
/// known one.
pub(crate) const LEAST_OF_REST: f64 = 3.0;
/// The multiple for effects that nearly every bench has, if they are significant by themselves. In place of an unknown
/// effect none of eighteen benches without them showed one.
const LEAST_OF_USUAL: f64 = 0.5;
/// The multiple for an effect that fits any course over time. Right names had a hundred, wrong ones up to six.
const LEAST_OF_ANY_COURSE: f64 = 20.0;
/// The multiple for a fault of a sensor beside a rest below the threshold. There the law of a torque may differ from
/// the named one, and a sensor's fault would absorb the difference. Right names had three and more, wrong ones one.
const LEAST_OF_SMALL_REST: f64 = 2.0;
/// With this evidence an effect is real, though its strength may be unknown: the data may lack the scale that it is
/// proportional to, such as that of all torques. Right names had more, wrong names less.
const BEYOND_DOUBT_SIGMAS: f64 = 12.0;
/// Tolerance of a data sheet: logarithm of found over nominal.
pub const DATA_SHEET_TOLERANCE: f64 = 0.25;
/// A value is called wrong when it is this many standard errors beyond the tolerance...
const BEYOND_TOLERANCE_SIGMAS: f64 = 3.0;
/// ... and each standard error (of a logarithm) counts at least as this: the tolerance itself is not sharp.
const LEAST_SPREAD: f64 = 0.02;
/// A value that is off by more than this factor is probably in another unit, or decoded otherwise.
const OTHER_UNIT: f64 = 2.5;

/// A sensor is blamed if it explains the rest better than torque or voltage by this much log-likelihood.
const LEAST_LOG_LIKELIHOOD_GAIN: f64 = 10.0;

/// By how much a drop may differ between pulse and off phase, as a share of it (one standard deviation). The current flows
/// through two transistors in the pulse, and through a transistor and a diode in the off phase.
const DROP_DIFFERENCE: f64 = 0.15;

/// Stands for the dependence of a rest that no curve explains.
pub(crate) const NOTHING_SEEN: &str = "nothing seen";
/// An inductance is visible if its electrical time constant is at least this share of the time between rows.
const LEAST_ROWS: f64 = 0.3;
/// The constant that bridge and winding share.
const RESISTANCE_OHM: &str = "resistance_ohm";
/// Advice on constants that were found beside an unknown effect.
const BESIDE_UNEXPLAINED: &str =
    "Until this is explained, all constants are approximate. Their intervals contain the noise, not the missing cause.";
/// The constant without which an imposed current has no torque.
const TORQUE_CONSTANT: &str = "torque_constant_Nm_per_A";
/// Notes on an imposed current.
const IMPOSED_CURRENT: &str = "No voltage was recorded, so the current is the input. Bridge and winding cannot be judged: record u_V or duty as well if they matter.";
const IN_AMPERES: &str = "Without [motor] torque_constant_Nm_per_A in the rig file the scale of all torques is unknown: here 1 Nm stands for the torque of 1 A.";
/// An error this many times the sensor's noise is reported, even if it is too small for a name.
const REPORTED_ABOVE_NOISE: f64 = 1.5;

/// A diagnosis with everything that a report shows.
pub struct Diagnosis {
    /// The result.
    pub outcome: Outcome,
    /// The model with everything found, fitted to all the data.
    pub model: Model,
    /// The same as it was fitted to [`data`](Self::data): without the counts that were lost and are restored there.
    pub fitted: Model,
    /// The recordings as they were used.
    pub data: Dataset,
    /// Prediction of the linear motor.
    pub base: Prediction,
    /// Prediction of the extended model, fitted without the held-out data.
    pub extended: Prediction,
    /// Constants of the linear motor fitted alone.
    pub base_model: Model,
    /// What the linear motor lacks, with its constants as found beside the effects.
    pub lacks: Vec<missing::Lack>,
    /// What was added step by step, with the errors after each step.
    pub steps: Vec<select::Step>,
}

/// Diagnoses recordings of one rig. `progress` hears what is being done.
///
/// # Errors
/// [`DatasetError`], when the recordings cannot be used; it says what to record instead.
pub fn diagnose(recordings: &[Recording], rig: &Rig, progress: select::Progress) -> Result<Diagnosis, DatasetError> {
    let data = Dataset::new(recordings, rig)?;
    let prior = Prior::new(&rig.nominal(), &data).with_bridge(&rig.bridge, &data);
    let mut interpret = interpret_trusted(data, &prior, &[], progress);
    let losses = interpret.random_losses();
    if let Some(losses) = losses {
        progress("with the counts that are lost");
        interpret = interpret_trusted(interpret.data.with_counts_lost(losses.share), &prior, &[], progress);
    }
    let hidden_drop = HiddenDrop::of(&interpret.data, &prior, &rig.bridge, &interpret.selection.last);
    if let Some(drop) = hidden_drop {
        progress("behind a drop that the data do not show");
        interpret = interpret.behind(drop, &prior, progress);
    }
    let (scale, interpret) = with_corrected_scale(interpret, &prior, progress);
    let Interpretation { data, selection, fullest, last, by_other_laws } = interpret;
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
    let places = [ActsOn::Torque, ActsOn::Voltage].into_iter().filter(|place| data.axis.drive.shows(*place));
    let lacks = places.map(|place| missing::lack(&data, &bare.motor, &residuals, place)).collect();
    let everything = data.with_nothing_held_out();
    let opened = last.with_held_open(&everything);
    let outcome = Outcome::of(
        &data,
        &prior,
        (&selection, &fullest),
        &Found::of(&opened, last.moved(), &everything, &prior).or_by(&by_other_laws),
        Corrections {
            losses,
            scale,
            hidden_drop,
            timing_uncertainty: timing_uncertainty(&data, &last.model),
            off_phase_spread: off_phase_spread(&data, &last.model),
        },
    );
    let model = losses.map_or(last.model.clone(), |losses| losses.also_in(&last.model));
    Ok(Diagnosis {
        outcome,
        model: hidden_drop::also_in(model, &data),
        fitted: hidden_drop::also_in(last.model, &data),
        base: selection.base.prediction,
        extended: selection.last.prediction,
        base_model: selection.base.model,
        lacks,
        steps: selection.steps,
        data: data.behind_a_drop(0.0),
    })
}

/// The model that is reported, and how well it is known.
struct Found<'a> {
    fit: &'a Fit,
    intervals: Vec<Interval>,
    uncertainty: Uncertainty<'a>,
    scales: [ScaleOrigin; 5],
    /// With nothing held out.
    data: &'a Dataset,
}

impl<'a> Found<'a> {
    /// `opened`: fitted to all of the data, with the held constants open behind the `moved` ones of the fit.
    fn of(opened: &'a Fit, moved: usize, data: &'a Dataset, prior: &Prior) -> Self {
        let uncertainty = opened.uncertainty(data);
        let mut intervals = uncertainty.intervals();
        intervals.truncate(moved);
        let scales = determined::scales(&uncertainty, data, &prior.nominal);
        Self { fit: opened, intervals, uncertainty, scales, data }
    }

    /// The intervals contain what other laws that explain as much make of the constants.
    fn or_by(mut self, other_laws: &[Vec<Interval>]) -> Self {
        for interval in &mut self.intervals {
            let by_another = |other: &&Interval| other.place == interval.place;
            for other in other_laws.iter().flatten().filter(by_another).collect::<Vec<_>>() {
                interval.ci95 = [interval.ci95[0].min(other.ci95[0]), interval.ci95[1].max(other.ci95[1])];
            }
        }
        self
    }

    fn not_shown(&self) -> Vec<&'static dyn Effect> {
        undecided::not_shown(self.data, self.fit)
    }

    fn determined(&self, corrections: &Corrections) -> AllDetermined {
        let widened = |unit, value, ci95| corrections.widened(unit, value, ci95);
        determined::determined(&self.uncertainty, self.data, widened)
    }
}

/// How the data were corrected before the fit, and what they leave open.
#[derive(Clone, Copy, Default)]
struct Corrections {
    /// Relative uncertainty of the inductance where the moments of current samples or commands are unknown.
    timing_uncertainty: f64,
    /// Uncertainty of the supply by a drop that differs in the off phase of the PWM: standard deviation of the logarithm.
    off_phase_spread: f64,
    losses: Option<RandomLosses>,
    scale: Option<Scale>,
    hidden_drop: Option<HiddenDrop>,
}

impl Corrections {
    /// The interval of a constant, widened by the uncertainty of these corrections.
    fn widened(&self, unit: Unit, value: f64, ci95: [f64; 2]) -> [f64; 2] {
        let of_losses = self.losses.map_or(0.0, |losses| losses.uncertainty(unit));
        let of_scale = self.scale.map_or(0.0, |scale| scale.uncertainty(unit));
        let of_drop = self.hidden_drop.map_or(0.0, |drop| drop.uncertainty(unit));
        // The winding's is the only inductance.
        let of_reading = if unit == Unit::Henry { self.timing_uncertainty } else { 0.0 };
        let of_off_phase = Quantity::Voltage.power(unit).abs() * self.off_phase_spread;
        let besides = Z95 * of_losses.hypot(of_scale).hypot(of_drop).hypot(of_off_phase).hypot(of_reading) * value;
        let [low, high] = [value - (value - ci95[0]).hypot(besides), value + (ci95[1] - value).hypot(besides)];
        // The interval of a constant without a sign ends at zero.
        if ci95[0] >= 0.0 { [low.max(0.0), high] } else { [low, high] }
    }
}

/// A bridge that drops another voltage in the off phase of its PWM than in the pulse acts as another supply. Nothing in a
/// recording tells the two apart.
fn off_phase_spread(data: &Dataset, model: &Model) -> f64 {
    DROP_DIFFERENCE * model.dry_losses().bridge_drop_v / greatest(&data.supply_v).max(f64::MIN_POSITIVE)
}

/// Relative uncertainty of the inductance if the current is sampled anywhere in a PWM period, or if the command acts
/// anywhere in the first half of its row: an unknown delay acts as more inductance.
fn timing_uncertainty(data: &Dataset, model: &Model) -> f64 {
    if data.current().is_none() {
        return 0.0;
    }
    let timing = &data.origin.timing;
    let period_s = (1.0 / data.origin.pwm_hz).min(data.interval_s);
    let sampling_s = if timing.current_sampled_at.is_none() { period_s } else { 0.0 };
    let command_s = if timing.command_delay_s.is_none() { 0.5 * data.interval_s } else { 0.0 };
    // Standard deviations of uniform distributions.
    sampling_s.hypot(command_s) / 12.0_f64.sqrt() / TimeConstants::of(&model.motor).electromagnetic_s
}

/// The part of the resistance that may belong to the bridge: over all of the current, a drop grows at most by itself.
fn bridge_ohm(data: &Dataset, model: &Model) -> f64 {
    let greatest_a = data.current().map_or(f64::INFINITY, |current| greatest(&current.values));
    model.dry_losses().bridge_drop_v / greatest_a.max(f64::MIN_POSITIVE)
}

/// How the data are interpreted, and the model that explains them so.
struct Interpretation {
    data: Dataset,
    selection: Selection,
    /// The model with everything that was selected, untrusted effects included.
    fullest: Fit,
    /// The model with the trusted effects alone, fitted to all data.
    last: Fit,
    /// Intervals of its constants by other laws of the same effects that explain as much.
    by_other_laws: Vec<Vec<Interval>>,
}

impl Interpretation {
    /// With the laws that all the data suggest.
    fn settled(data: Dataset, prior: &Prior, mut selection: Selection, fullest: Fit, mut last: Fit) -> Self {
        let everything = data.with_nothing_held_out();
        let laws::Settled { better, others: mut by_other_laws } = laws::settle(&last, &everything, prior);
        if let Some(better) = better {
            let anew = fit(&better.model, &data, prior, Effort::FULL);
            // The held-out data must not speak against it.
            if judge::held_out_nats(&data, &selection.last, &anew) > 0.0 {
                (selection.last, last) = (anew, better);
            } else {
                by_other_laws.push(better.uncertainty(&everything).intervals());
            }
        }
        Self { data, selection, fullest, last, by_other_laws }
    }

    /// The same behind a drop that the data do not show. It scales the voltage, so the same effects act.
    fn behind(self, drop: HiddenDrop, prior: &Prior, progress: select::Progress) -> Self {
        let data = drop.before(&self.data);
        let refit = |found: &Fit, data: &Dataset| fit(&found.model, data, prior, Effort::FULL);
        let [last, fullest] = [&self.selection.last, &self.fullest].map(|found| refit(found, &data));
        let selection = select::anew_from(&data, prior, &excluded(&data), last, self.selection.steps, progress);
        let last = refit(&selection.last, &data.with_nothing_held_out());
        Self::settled(data, prior, selection, fullest, last)
    }

    /// A constant share of lost counts, where no other effect explains lost counts.
    fn random_losses(&self) -> Option<RandomLosses> {
        let Self { data, selection, .. } = self;
        let is_named = selection.last.model.has(counter_stops::ID) || !data.origin.counter_stops.is_empty();
        if is_named {
            return None;
        }
        RandomLosses::of(data, &selection.last.residual_of(data, data.motion_index()))
    }
}

/// The interpretation in the scale that the nominal values suggest, if the data fit better in it.
fn with_corrected_scale(
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
    let Some(scale) = scale else { return (None, recorded) };
    progress("in another scale");
    let corrected = interpret_trusted(scale.corrected(&recorded.data), prior, &[], progress);
    // An unknown effect, or unknown command times, bias all constants, but hardly by as much as another unit does.
    let [has_rest, _] = doubts(&corrected);
    if (has_rest || corrected.data.has_moments()) && !scale.is_another_unit() {
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
fn interpret_trusted(
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
        let intervals = last.uncertainty(&everything).intervals();
        let is_scale_unknown = has_unknown_torque_scale(&everything);
        let nothing = |standing: &Standing| {
            let is_real = is_scale_unknown || standing.gain.sigmas > BEYOND_DOUBT_SIGMAS;
            !(is_of_a_scale(standing.id) && is_real) && may_be_nothing(standing, &last.model, &intervals)
        };
        match selection.standings.iter().position(nothing) {
            Some(index) => match selection.standings[index].id {
                id if is_of_a_scale(id) => remove_effect(&seen, prior, &mut selection, index),
                id => return interpret_trusted(data, prior, &[excluded_ids, &[id]].concat(), progress),
            },
            None => return Interpretation::settled(seen, prior, selection, fullest, last),
        }
    }
}

/// The best choice of what the rig file leaves open about the recording. It is judged by the rest above the noise, the
/// distance from the data sheet, and the number of effects.
fn best_interpretation(
    data: Dataset,
    prior: &Prior,
    excluded_ids: &[&'static str],
    progress: select::Progress,
) -> (Dataset, Selection) {
    let centred = data.with_window_centred();
    let ways = [Some(data), centred].into_iter().flatten().map(|data| interpret(data, prior, excluded_ids, progress));
    let rank = |(data, selection): &(Dataset, Selection)| {
        let last = &selection.last;
        (data_sheet::doubts(data, prior, last), last.model.terms.len(), last.cost)
    };
    ways.min_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal)).expect("one way at least")
}

/// Settings that the rig file leaves open, in the order in which they are estimated from the current fit. Each returns
/// whether it changed the data.
const SETTLED_IN_TURN: [fn(&mut Dataset, &Prior, &Fit) -> bool; 11] = [
    command_times::settle,
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

fn interpret(
    mut data: Dataset,
    prior: &Prior,
    excluded_ids: &[&'static str],
    progress: select::Progress,
) -> (Dataset, Selection) {
    let anew = |data: &Dataset| select(data, prior, &[&excluded(data), excluded_ids].concat(), progress);
    if data.axis.drive.is_voltage() {
        pwm_frequency::settle_at_first(&mut data, prior);
        reading_phase::settle_at_first(&mut data, prior);
    }
    counter_stops::settle_by_linear_motor(&mut data, prior);
    let mut selection = anew(&data);
    for settle in SETTLED_IN_TURN {
        if settle(&mut data, prior, &selection.last) {
            selection = anew(&data);
        }
    }
    if let Some((other, found)) = with_another_part_held_out(&data, prior, &selection) {
        progress("with another part held out");
        let excluded = [&excluded(&other), excluded_ids].concat();
        selection = select::anew_from(&other, prior, &excluded, found, selection.steps, progress);
        data = other;
    }
    if let Some(rest) = bad_stretches::without(&data, prior, &selection.last) {
        progress("without a stretch that does not follow its command");
        let without = anew(&rest);
        if above_floor(&rest, &without.last) < NOT_NOISE {
            return (rest, without);
        }
    }
    (data, selection)
}

/// What happens once, such as the moment at which a shaft breaks loose, is not known to a fit without the part that has it.
/// If the seen data are explained and the held-out ones are not, another part is held out, where that one is explained.
fn with_another_part_held_out(data: &Dataset, prior: &Prior, selection: &Selection) -> Option<(Dataset, Fit)> {
    let widest = &selection.widest;
    let is_seen_explained = widest.cost < NOT_NOISE.powi(2) * widest.used() as f64;
    if above_floor(data, &selection.last) < NOT_NOISE || !is_seen_explained {
        return None;
    }
    let anew = |other: Dataset| {
        let found = fit(&widest.model, &other, prior, Effort::AGAIN);
        (other, found)
    };
    data.with_others_held_out().map(anew).find(|(other, found)| above_floor(other, found) < NOT_NOISE)
}

/// Effects that do not show in these channels.
fn excluded(data: &Dataset) -> Vec<&'static str> {
    let channels = Channels {
        axis: data.axis,
        current: data.current().is_some(),
        speed: data.motion().output == Output::Speed,
        counts: data.origin.is_counted,
        moments: data.has_moments(),
        one_magnitude: data.has_one_magnitude(),
    };
    CATALOGUE.iter().filter(|effect| !effect.shows_in(&channels)).map(|effect| effect.about().id).collect()
}

/// Measured minus simulated, per quantity.
pub fn residuals(data: &Dataset, prediction: &Prediction) -> Vec<Vec<f64>> {
    let difference = |(measured, predicted): (&Measured, &Vec<f64>)| {
        measured.values.iter().zip(predicted).map(|(value, predicted)| value - predicted).collect()
    };
    data.measured.iter().zip(prediction).map(difference).collect()
}

/// Removes effects that explain too little beside the rest ([`Rest::outweighs`]): while something large is unknown,
/// small effects cannot be trusted. Beside a rest below the threshold, an effect stays if the rest would exceed the
/// threshold without it.
fn remove_untrusted(data: &Dataset, prior: &Prior, selection: &mut Selection) {
    while let Some(rest) = Rest::of(data, &selection.last) {
        let mut weak = (0..selection.standings.len()).filter(|index| rest.outweighs(&selection.standings[*index]));
        let without = |index: usize| {
            let mut without = selection.clone();
            remove_effect(data, prior, &mut without, index);
            (rest.is_missing || above_floor(data, &without.last) < NOT_NOISE).then_some(without)
        };
        let Some(without) = weak.find_map(without) else { return };
        *selection = without;
    }
}

/// Whether an effect can fit any course over time, and so a part of an unknown effect.
fn fits_any_course(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().fits_any_course)
}

/// Whether an effect is a fault of a sensor.
fn is_of_a_sensor(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().sensor.is_some())
}

/// The rest: what a model leaves of each measured quantity beyond the noise.
struct Rest {
    /// Whether it exceeds the threshold, so that an effect is missing.
    is_missing: bool,
    /// Squares of the weights of the quantities.
    units: Vec<f64>,
    /// Weighted sum over all quantities.
    weight: f64,
}

impl Rest {
    /// The rest of a model that leaves more than noise.
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

    /// Whether an effect explains too little beside this rest.
    fn outweighs(&self, standing: &Standing) -> bool {
        let explained = standing.gain.rmse.iter().zip(&self.units);
        let own: f64 = explained.map(|((before, after), unit)| (before.powi(2) - after.powi(2)) / unit).sum();
        let least = match self.is_missing {
            true if fits_any_course(standing.id) => LEAST_OF_ANY_COURSE,
            true if USUAL.contains(&standing.id) && standing.gain.sigmas > NAMED_SIGMAS => LEAST_OF_USUAL,
            true => LEAST_OF_REST,
            false if is_of_a_sensor(standing.id) => LEAST_OF_SMALL_REST,
            false => return false,
        };
        own < least * self.weight
    }
}

/// Whether the interval of an effect's strength contains zero.
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
    effect.about().strengths().into_iter().any(may_be_nothing)
}

/// Whether an effect is proportional to its strength.
fn is_of_a_scale(id: &str) -> bool {
    effect(id).is_some_and(|effect| effect.about().linear_in > 0)
}

/// Removes an effect and refits the others.
fn remove_effect(data: &Dataset, prior: &Prior, selection: &mut Selection, index: usize) {
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
        found: &Found,
        corrections: Corrections,
    ) -> Self {
        let Found { fit: Fit { model, .. }, intervals, .. } = found;
        let Corrections { losses, scale, hidden_drop, .. } = corrections;
        let mut causes: Vec<Cause> =
            selection.standings.iter().map(|standing| cause(data, standing, model, intervals, &corrections)).collect();
        if !model.has(counter_stops::ID) {
            causes.extend(counter_stops::cause(data, &selection.last.prediction));
        }
        if let Some(losses) = losses {
            causes.push(losses.cause(data, judge::rmse(data, &selection.last.prediction, data.motion_index())));
        }
        causes.sort_by(|a, b| b.evidence_sigmas.total_cmp(&a.evidence_sigmas));
        causes.retain(|cause| !is_order_of_rows(&cause.effect, data, model));
        let parameters = parameters(found, &prior.nominal, &corrections);
        causes.extend(scale.map(|scale| scale.cause(data, hidden_drop.is_some())));
        let unexplained = unexplained(data, selection, fullest);
        let mut wrong = wrong_values(&parameters, bridge_ohm(data, model));
        wrong.retain(|cause| !is_between_rows(&cause.effect, data, &model.motor));
        // An unexplained effect biases the constants as well.
        let is_a_cause = |cause: &Cause| unexplained.is_none() && !is_of_the_reading(&cause.effect, data, model);
        let (wrong, contradicted): (Vec<Cause>, Vec<Cause>) = wrong.into_iter().partition(is_a_cause);
        causes.extend(wrong);
        let not_shown = if causes.is_empty() && unexplained.is_none() { found.not_shown() } else { Vec::new() };
        let verdict = match (causes.is_empty(), unexplained.is_some()) {
            (true, false) if !not_shown.is_empty() => Verdict::Undecided,
            (true, false) => Verdict::Sufficient,
            (false, false) => Verdict::Explained,
            (false, true) => Verdict::PartlyExplained,
            (true, true) => Verdict::Unexplained,
        };
        let mut outcome = Self {
            axis: data.axis,
            verdict,
            causes,
            unexplained,
            determined: found.determined(&corrections),
            parameters,
            fit: fits(data, selection),
            advice: Vec::new(),
        };
        outcome.advice = outcome.advice(data);
        outcome.advice.extend(not_shown.into_iter().map(undecided::advice));
        let contradictions = contradicted.iter().filter_map(|cause| outcome.contradiction(cause, &model.motor));
        let contradictions: Vec<String> = contradictions.collect();
        outcome.advice.extend(contradictions);
        outcome.advice.extend(outcome.small_rest());
        outcome.advice.extend(scale.map(|scale| scale.advice(data)));
        outcome.advice.extend(hidden_drop.map(|drop| drop.note()));
        outcome
    }

    /// Note on a nominal value that the constants contradict, where another reason is more likely than a wrong value.
    fn contradiction(&self, cause: &Cause, motor: &MotorParameters) -> Option<String> {
        let (name, found) = cause.parameters.iter().next()?;
        let nominal = self.parameters.get(name.as_str())?.nominal?;
        let [low, high] = found.ci95?;
        let likelier = match self.unexplained {
            Some(_) => "More likely what has no name bends it.".to_owned(),
            None => "More likely it is of the reading: a filter, a window or a delay that the rig file does not state."
                .to_owned(),
        };
        let of_winding = (cause.effect == INDUCTANCE).then(|| {
            let milliseconds = 1e3 * TimeConstants::of(motor).electromagnetic_s;
            format!(" It would be a winding of {} ms, which a filter or a delay resembles.", short(milliseconds))
        });
        Some(format!(
            "{name} = {} [{}, {}] contradicts the {} of the rig file. {likelier}{} Do not correct the rig file by it.",
            short(found.value),
            short(low),
            short(high),
            short(nominal),
            of_winding.unwrap_or_default()
        ))
    }

    /// Note on an error above the noise that is too small for a name.
    fn small_rest(&self) -> Option<String> {
        let (reached, floor) = (&self.fit["extended"], &self.fit["noise_floor"]);
        let times = |(channel, quality): (&&'static str, &Quality)| (quality.rmse / floor[channel].rmse, *channel);
        let (times, channel) = reached.iter().map(times).max_by(|a, b| a.0.total_cmp(&b.0))?;
        (self.unexplained.is_none() && times > REPORTED_ABOVE_NOISE).then(|| {
            format!(
                "The error left in {channel} is {times:.1} times the noise of its sensor, but less than {:.0} % of its range. A small effect may be missing; effects that small are not searched for.",
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
                "A value this far off is probably a wrong unit. Check: i_A in amperes; speed in rad/s, not rpm; counts_per_rev after x4 decoding; the sensor on the motor's shaft, not behind a gear.".into(),
            );
        }
        advice
    }

    fn advice(&self, data: &Dataset) -> Vec<String> {
        let mut advice = Vec::new();
        let reverses = |sign: f64| data.motion().values.iter().any(|speed| sign * speed > 10.0 * data.motion().noise);
        let is_one_way = !(reverses(1.0) && reverses(-1.0));
        for cause in &self.causes {
            let Some(about) = motorbench_model::catalogue::effect(&cause.effect).map(|effect| effect.about()) else {
                continue;
            };
            if !cause.not_separable_from.is_empty() {
                let others = cause.not_separable_from.join(" or ");
                advice
                    .push(format!("{} could as well be {others}. To tell them apart: {}.", about.id, about.experiment));
            }
            let remedy = if about.id == "coast_decay" && is_one_way { OF_ONE_TRANSISTOR } else { about.remedy };
            advice.push(format!("Against {}: {remedy}.", about.title));
        }
        advice.extend(self.advice_on_values());
        if let Some(unexplained) = &self.unexplained {
            advice.push(format!(
                "An effect outside the catalogue is missing: {}. See the plots of what remains in the report (--report).",
                unexplained.place()
            ));
            advice.push(BESIDE_UNEXPLAINED.into());
        }
        advice.extend(data.notes());
        if data.current().is_none() && data.axis.drive.is_voltage() {
            advice.push(self.advice_without_current());
        }
        if data.axis.drive == Drive::Current {
            advice.push(IMPOSED_CURRENT.into());
            if self.parameters.get(TORQUE_CONSTANT).is_some_and(|constant| constant.nominal.is_none()) {
                advice.push(IN_AMPERES.into());
            }
        }
        if is_one_way {
            advice.push(
                "The motor never reverses in this recording. Friction and differences between directions show only when it passes zero both ways: record the sequence `identify`.".into(),
            );
        }
        advice
    }
}

/// Against an off phase that coasts where the motor never reverses, as behind a single transistor.
const OF_ONE_TRANSISTOR: &str = "With a bridge leave enable high. One transistor and a diode always coast so at small currents: a second transistor in place of the diode, or a higher PWM frequency, makes the motor linear";

impl Outcome {
    /// What a recording without the current says of friction and drop together.
    fn advice_without_current(&self) -> String {
        let is_dry = |cause: &Cause| USUAL.contains(&cause.effect.as_str());
        let of = |name: &str| {
            self.determined.get(name).map(|found| format!("{name} = {} {}", short(found.value), found.unit))
        };
        match of("kS").filter(|_| self.causes.iter().any(is_dry)) {
            Some(sum) => {
                let others = ["kV", "kA"].into_iter().filter_map(of).collect::<Vec<_>>().join(", ");
                format!(
                    "Without the current, friction and a voltage drop cannot be told apart. Their sum is sure: {sum}, with {others}. Record i_A as well to know each."
                )
            }
            None => "Without the current, torque and voltage can hardly be told apart: record i_A as well.".into(),
        }
    }
}

/// Whether a value is so far from its nominal value that another unit is likelier than another motor.
fn is_other_unit(parameter: &Parameter) -> bool {
    parameter.nominal.is_some_and(|nominal| (parameter.value / nominal).ln().abs() > OTHER_UNIT.ln())
}

/// Whether an effect is a delay shorter than a row, where rows were written after their commands had acted. It then
/// gives the time within the row at which the command acts, not a delay of the bridge.
fn is_order_of_rows(id: &str, data: &Dataset, model: &Model) -> bool {
    let delay_s = model.term(id).map_or(0.0, |term| term.effect.delay_s(&term.values));
    data.origin.written_after && (f64::MIN_POSITIVE..data.interval_s).contains(&delay_s)
}

/// Whether a wrong value is an inductance that may come from an assumed PWM frequency, averaging window or command
/// time: the rig file does not give these, so only the combination is known.
fn is_of_the_reading(cause: &str, data: &Dataset, model: &Model) -> bool {
    let shows_pwm = || model.terms.iter().any(|term| term.effect.about().acts_on.contains(&ActsOn::Voltage));
    let of_pwm = || !data.origin.pwm_is_known && shows_pwm();
    let of_window = || data.origin.timing.current_window_s.is_none() && data.origin.current_window_s > 0.0;
    cause == INDUCTANCE && (of_pwm() || of_window() || data.has_moments() || data.origin.taken_over_its_row)
}

/// The place in words.
pub fn acts_on_words(acts_on: ActsOn) -> &'static str {
    match acts_on {
        ActsOn::Torque => "the torque",
        ActsOn::Voltage => "the voltage",
        ActsOn::CurrentSensor => "the current sensor",
        ActsOn::AngleSensor => "the angle or speed sensor",
    }
}

fn cause(
    data: &Dataset,
    standing: &Standing,
    model: &Model,
    intervals: &[Interval],
    corrections: &Corrections,
) -> Cause {
    let rival_sigmas = standing.rival.as_ref().map_or(f64::INFINITY, |(_, gain)| gain.sigmas.max(0.0));
    let sigmas = standing.gain.sigmas.min(if standing.same.is_empty() { rival_sigmas } else { f64::INFINITY });
    let channels = data.measured.iter().map(|measured| measured.output.channel());
    Cause {
        effect: standing.id.into(),
        confidence: confidence(sigmas) / (1.0 + standing.same.len() as f64),
        parameters: constants(standing.id, model, intervals, corrections),
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

/// Constants of an effect with their intervals; the two of a wave as one amplitude.
fn constants(id: &str, model: &Model, intervals: &[Interval], corrections: &Corrections) -> BTreeMap<String, Estimate> {
    let Some(term_index) = model.terms.iter().position(|term| term.id() == id) else { return BTreeMap::new() };
    let term = &model.terms[term_index];
    let interval = |index| intervals.iter().find(|interval| interval.place == Place::Term(term_index, index));
    let mut constants: BTreeMap<String, Estimate> = term
        .without_defaults()
        .map(|(index, parameter, value)| {
            let ci95 = interval(index).map(|interval| corrections.widened(parameter.unit, value, interval.ci95));
            (parameter.name.to_string(), Estimate { value, ci95 })
        })
        .collect();
    let wave = term.effect.about().parameters[0].name.strip_prefix("cosine_");
    if let (Some(unit), Some(cosine), Some(sine)) = (wave, interval(0), interval(1)) {
        let amplitude = cosine.value.hypot(sine.value);
        let half = |interval: &Interval| 0.5 * (interval.ci95[1] - interval.ci95[0]) * interval.value / amplitude;
        let half = half(cosine).hypot(half(sine));
        let ci95 = [(amplitude - half).max(0.0), amplitude + half];
        let ci95 = Some(corrections.widened(term.effect.about().parameters[0].unit, amplitude, ci95));
        constants.insert(format!("amplitude_{unit}"), Estimate { value: amplitude, ci95 });
    }
    constants
}

fn parameters(found: &Found, nominal: &NominalMotor, corrections: &Corrections) -> BTreeMap<&'static str, Parameter> {
    let nominal = nominal.values();
    let Found { fit: Fit { model, .. }, intervals, scales, data, .. } = found;
    let named = model.motor.named().into_iter().enumerate();
    named
        .filter(|(index, _)| data.axis.drive.has_constant(*index))
        .map(|(index, (name, value))| {
            let interval = intervals.iter().find(|interval| interval.place == Place::Motor(index));
            let ci95 = interval.map_or([value, value], |interval| interval.ci95);
            let ci95 = corrections.widened(MotorParameters::UNITS[index], value, ci95);
            (name, Parameter { nominal: nominal[index], value, ci95, scale: scales[index] })
        })
        .collect()
}

/// Whether a cause is the inductance, and the rows are too far apart to show it: the current has settled in each row.
fn is_between_rows(effect: &str, data: &Dataset, motor: &MotorParameters) -> bool {
    effect == INDUCTANCE && TimeConstants::of(motor).electromagnetic_s < LEAST_ROWS * data.interval_s
}

/// Nominal values that are off by more than a data sheet's tolerance. The resistance found is that of the circuit:
/// `bridge_ohm` of it may be the bridge's.
fn wrong_values(parameters: &BTreeMap<&'static str, Parameter>, bridge_ohm: f64) -> Vec<Cause> {
    // Number of standard errors beyond the tolerance.
    let sigmas_beyond = |name: &str| {
        let parameter = parameters.get(name)?;
        let nominal = parameter.nominal?;
        let of_bridge = if name == RESISTANCE_OHM { (parameter.value - nominal).clamp(0.0, bridge_ohm) } else { 0.0 };
        let off = ((parameter.value - of_bridge) / nominal).ln().abs();
        let spread = (parameter.ci95[1] / parameter.ci95[0].max(f64::MIN_POSITIVE)).ln() / (2.0 * Z95);
        Some((off - DATA_SHEET_TOLERANCE) / spread.max(LEAST_SPREAD))
    };
    let names = [
        (RESISTANCE_OHM, "resistance"),
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

/// What remains and where, judged by the fullest model: otherwise an untrusted drop or friction would be reported in
/// place of the larger rest.
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
    let likelihood = |lack: &missing::Lack| {
        lack.log_likelihood - if lack.acts_on.is_of_a_sensor() { LEAST_LOG_LIKELIHOOD_GAIN } else { 0.0 }
    };
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
        // With the same spread of the signal and the floor in place of the error.
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

    /// An outcome with a torque constant of this multiple of the nominal one.
    fn with_torque_constant(found_over_nominal: f64) -> Outcome {
        let value = 0.07 * found_over_nominal;
        let ci95 = [0.99 * value, 1.01 * value];
        let found = Parameter { nominal: Some(0.07), value, ci95, scale: ScaleOrigin::Measured };
        let parameters = BTreeMap::from([("torque_constant_Nm_per_A", found)]);
        let causes = wrong_values(&parameters, 0.0);
        Outcome {
            axis: motorbench_model::Axis::default(),
            verdict: Verdict::Explained,
            causes,
            unexplained: None,
            determined: AllDetermined::new(),
            parameters,
            fit: BTreeMap::new(),
            advice: Vec::new(),
        }
    }

    /// A capture of an oscilloscope is shorter than any warm-up.
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
    fn an_interval_contains_its_own_value_whatever_its_sign() {
        let corrections = Corrections { off_phase_spread: 0.03, ..Corrections::default() };
        let widened = |value: f64, ci95| corrections.widened(Unit::NewtonMetre, value, ci95);
        for (value, ci95) in [(-0.5, [-0.6, -0.4]), (0.5, [0.4, 0.6]), (0.01, [0.0, 0.02]), (0.01, [-0.01, 0.03])] {
            let [low, high] = widened(value, ci95);
            assert!(low <= value && value <= high, "{value}: {low} {high}");
            assert!(low <= ci95[0] && ci95[1] <= high, "{value}: {low} {high}");
        }
        assert_eq!(widened(0.01, [0.0, 0.02])[0], 0.0, "the interval of a constant without a sign ends at zero");
    }

    /// Beside an unexplained rest a value is no cause, but it is not passed over either.
    #[test]
    fn a_contradicted_value_is_told_where_it_is_no_cause() {
        let mut outcome = with_torque_constant(1.0);
        let found = Parameter { nominal: Some(3e-3), value: 11e-3, ci95: [9e-3, 13e-3], scale: ScaleOrigin::Measured };
        outcome.parameters.insert("inductance_H", found);
        outcome.unexplained =
            Some(Unexplained { acts_on: ActsOn::Torque, depends_on: NOTHING_SEEN.into(), share: 0.9 });
        let wrong = wrong_values(&outcome.parameters, 0.0);
        let motor = MotorParameters { resistance_ohm: 2.5, inductance_h: 11e-3, ..MotorParameters::PIVT6 };
        let [wrong] = &wrong[..] else { panic!("{wrong:?}") };
        let told = outcome.contradiction(wrong, &motor).unwrap();
        assert!(told.starts_with("inductance_H = 0.0110 [0.00900, 0.0130] contradicts the 0.00300"), "{told}");
        assert!(told.contains("what has no name bends it") && told.contains("a winding of 4.40 ms"), "{told}");
    }

    /// A bridge of transistors adds its slope to the winding's resistance.
    #[test]
    fn a_resistance_that_the_bridge_may_explain_is_not_wrong() {
        let found = Parameter { nominal: Some(8.0), value: 12.0, ci95: [11.9, 12.1], scale: ScaleOrigin::Measured };
        let parameters = BTreeMap::from([(RESISTANCE_OHM, found)]);
        let causes = |bridge_ohm: f64| wrong_values(&parameters, bridge_ohm).len();
        assert_eq!((causes(0.0), causes(1.0), causes(3.0)), (1, 1, 0));
    }

    #[test]
    fn a_wrong_value_is_told_from_a_wrong_unit() {
        let other_motor = with_torque_constant(1.6);
        assert_eq!(
            other_motor.advice_on_values(),
            ["Write torque_constant_Nm_per_A = 0.112 into the rig file in place of 0.0700."]
        );
        assert!((other_motor.causes[0].evidence_sigmas - 11.0).abs() < 0.05, "{:?}", other_motor.causes);
        let in_rpm = with_torque_constant(60.0 / std::f64::consts::TAU).advice_on_values();
        assert!(in_rpm.len() == 1 && in_rpm[0].contains("not rpm"), "{in_rpm:?}");
        assert!(with_torque_constant(1.1).advice_on_values().is_empty());
    }
}

//! Diagnosis of recordings: what the simulation gets wrong, which effect causes it, and what the extended model gains.
//!
//! 1. The linear motor is fitted in free run ([`identify`](crate::identify)) to two thirds of the data. The last third,
//!    in blocks spread over the recording, is held out for judging. Only the time of a load step is read from all data.
//! 2. Effects of the catalogue are added while they improve the fit of the held-out data. Then each one is checked
//!    backward and against every rival ([`mod@select`]).
//! 3. What remains above the sensors' noise is located: the discrepancy at the torque or at the voltage that makes it
//!    most likely ([`missing`]).
//! 4. The reported constants are fitted once more to all the data.

mod advice;
mod another_part;
mod bad_stretches;
mod causes;
mod channels;
mod command_times;
mod counter_stops;
mod current_window;
mod data_sheet;
pub mod determined;
mod hidden_drop;
mod interpretation;
pub mod judge;
mod late_readings;
mod lateness;
mod laws;
mod mains_hum;
pub mod missing;
pub mod outcome;
pub mod prediction;
mod pwm_frequency;
mod pwm_phase;
mod pwm_ripple;
mod random_losses;
mod ripple_phase;
mod scale;
pub mod select;
mod speed_reading;
mod trust;
mod undecided;
mod unseen_losses;

pub use crate::configuration::diagnose::DATA_SHEET_TOLERANCE;
use crate::configuration::diagnose::{DROP_DIFFERENCE, LEAST_FIT_PERCENT, LEAST_LOG_LIKELIHOOD_GAIN};
use crate::dataset::{Dataset, DatasetError, Measured, greatest};
use crate::free_run::{Prediction, free_run};
use crate::identify::{
    Fit, Interval, Prior, Uncertainty, Z95, has_unknown_voltage_scale, lateness_s, uniform_deviation,
};
use causes::{
    bridge_ohm, cause, is_between_rows, is_of_the_reading, parameters, settles_between_rows, stays_within_a_row,
    waits_for_the_pwm, wrong_values,
};
use determined::AllDetermined;
use hidden_drop::HiddenDrop;
use interpretation::{Interpretation, interpret_trusted, with_corrected_scale};
use judge::{NOT_NOISE, above_floor};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_model::Model;
use motorbench_model::catalogue::{ACTUATION_DELAY, ActsOn, Effect};
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::unit::{Quantity, Unit};
use outcome::{Cause, Outcome, Quality, ScaleOrigin, Unexplained, Verdict};
use random_losses::RandomLosses;
use scale::Scale;
use select::Selection;
use std::collections::BTreeMap;
pub(crate) use trust::LEAST_OF_REST;

/// Note on commands that act late by less than a period of the PWM.
const WAITS_FOR_THE_PWM: &str = "The commands act late by less than a period of the PWM: its timer takes a new duty at the begin of a period. A faster PWM shortens that.";
/// Identifier of two clocks that run unequally fast.
const CLOCK_DRIFT: &str = "clock_drift";
/// Note on a drift of the clocks that the rows are too far apart to tell.
const DRIFTS_WITHIN_A_ROW: &str = "The lateness of the commands changes by less than a row over the recording. The rows may not hold each command, which looks like two clocks. Write a row for each command to see whether they differ.";
/// Stands for the dependence of a rest that no curve explains.
pub(crate) const NOTHING_SEEN: &str = "nothing seen";

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
    let data = late_readings::settled(mains_hum::settled(data, &prior), &prior);
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
    let Interpretation { data, selection, fullest, last, by_other_laws, least_inductance_h } =
        interpret.with_unnamed(&prior).with_unstated_delay(&prior).with_prior_weighed(&prior);
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
            timing_uncertainty: timing_uncertainty(&data, &last.model, least_inductance_h),
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
    /// Relative uncertainty of the inductance where the moments of current samples or commands are unknown: towards less, and
    /// towards more.
    timing_uncertainty: [f64; 2],
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
        let of_reading = if unit == Unit::Henry { self.timing_uncertainty } else { [0.0; 2] };
        let of_off_phase = Quantity::Voltage.power(unit).abs() * self.off_phase_spread;
        let both_ways = of_losses.hypot(of_scale).hypot(of_drop).hypot(of_off_phase);
        let [less, more] = of_reading.map(|of_reading| Z95 * both_ways.hypot(of_reading) * value);
        let [low, high] = [value - (value - ci95[0]).hypot(less), value + (ci95[1] - value).hypot(more)];
        // The interval of a constant without a sign ends at zero.
        if ci95[0] >= 0.0 { [low.max(0.0), high] } else { [low, high] }
    }
}

/// A bridge that drops another voltage in the off phase of its PWM than in the pulse acts as another supply. Nothing in a
/// recording tells the two apart. Where the model has such drops, its own constants know that.
fn off_phase_spread(data: &Dataset, model: &Model) -> f64 {
    if has_unknown_voltage_scale(model, data) {
        return 0.0;
    }
    DROP_DIFFERENCE * model.dry_losses().bridge_drop_v / greatest(&data.supply_v).max(f64::MIN_POSITIVE)
}

/// Relative uncertainty of the inductance if the current is sampled anywhere in a PWM period, or if the command acts
/// anywhere in the first half of its row: an unknown delay acts as more inductance, and a reading that is late as less. Without
/// a current, the speed alone shows the inductance, and may be read anywhere in its row. `least_h`: what the winding has at
/// least beside a delay.
fn timing_uncertainty(data: &Dataset, model: &Model, least_h: Option<f64>) -> [f64; 2] {
    if data.current().is_none() {
        return [lateness_s(data) / TimeConstants::of(&model.motor).electromagnetic_s; 2];
    }
    let timing = &data.origin.timing;
    let period_s = (1.0 / data.origin.pwm_hz).min(data.interval_s);
    let is_sampling_known = timing.current_sampled_at.is_some()
        || timing.current_window_s.is_some_and(|window_s| window_s >= 1.0 / data.origin.pwm_hz)
        || data.origin.pwm_phase.is_some();
    let sampling_s = if is_sampling_known { 0.0 } else { period_s };
    // A command waits for the next period. Where commands come at any time in one, only whether they do is open.
    let waiting_s = match (data.is_switched(), data.may_wait()) {
        (true, _) => 0.0,
        (false, true) => 0.5 * period_s,
        (false, false) => period_s,
    };
    // The slope of a ripple shows the inductance, whenever the commands act.
    let shows_slopes = data.is_switched() && data.reads_instants();
    let is_delay_known = timing.command_delay_s.is_some() || shows_slopes;
    let command_s = if is_delay_known { 0.0 } else { 0.5 * data.interval_s };
    let both_ways_s = uniform_deviation(sampling_s.hypot(command_s).hypot(waiting_s));
    let winding_s = TimeConstants::of(&model.motor).electromagnetic_s;
    // A command is never early. Without a delay in the model, the winding may have less by the whole of it.
    let less_s = match least_h.map(|least_h| (1.0 - least_h / model.motor.inductance_h) * winding_s) {
        Some(left_open_s) => {
            uniform_deviation(sampling_s.hypot(waiting_s)).hypot(left_open_s.clamp(0.0, command_s) / Z95)
        }
        None if model.has(ACTUATION_DELAY) => both_ways_s,
        None => both_ways_s.max(command_s / Z95),
    };
    [less_s, both_ways_s].map(|lateness_s| lateness_s / winding_s)
}

/// Measured minus simulated, per quantity.
pub fn residuals(data: &Dataset, prediction: &Prediction) -> Vec<Vec<f64>> {
    let difference = |(measured, predicted): (&Measured, &Vec<f64>)| {
        measured.values.iter().zip(predicted).map(|(value, predicted)| value - predicted).collect()
    };
    data.measured.iter().zip(prediction).map(difference).collect()
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
        let drifts = |cause: &Cause| cause.effect == CLOCK_DRIFT && stays_within_a_row(CLOCK_DRIFT, data, model);
        let drifts = causes.iter().any(drifts);
        causes.retain(|cause| !stays_within_a_row(&cause.effect, data, model));
        causes.retain(|cause| !settles_between_rows(&cause.effect, data, model));
        let named = causes.len();
        causes.retain(|cause| !waits_for_the_pwm(&cause.effect, data, model));
        let waits = causes.len() < named;
        let parameters = parameters(found, &prior.nominal, &corrections);
        causes.extend(scale.map(|scale| scale.cause(data, hidden_drop.is_some())));
        let unexplained = unexplained(data, selection, fullest);
        let bridge_ohm = bridge_ohm(data, model);
        let mut wrong = wrong_values(&parameters, bridge_ohm);
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
        outcome.advice.extend(outcome.advice_on_undetermined());
        outcome.advice.extend(advice::of_unnamed(model, &selection.standings));
        outcome.advice.extend(not_shown.into_iter().map(undecided::advice));
        let contradictions = contradicted.iter().filter_map(|cause| outcome.contradiction(cause, &model.motor));
        let contradictions: Vec<String> = contradictions.collect();
        outcome.advice.extend(contradictions);
        outcome.advice.extend(outcome.of_circuit(bridge_ohm));
        outcome.advice.extend(outcome.small_rest());
        outcome.advice.extend(waits.then(|| WAITS_FOR_THE_PWM.to_owned()));
        outcome.advice.extend(drifts.then(|| DRIFTS_WITHIN_A_ROW.to_owned()));
        outcome.advice.extend(scale.map(|scale| scale.advice(data)));
        outcome.advice.extend(hidden_drop.map(|drop| drop.note()));
        outcome
    }
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
    use super::causes::RESISTANCE_OHM;
    use super::outcome::Parameter;
    use super::*;
    use crate::identify::{Effort, fit};
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;

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

    /// A ramp does not show the inertia. Viscous friction that may be nothing is known to be small.
    #[test]
    fn a_constant_that_may_be_anything_is_not_determined() {
        let mut outcome = with_torque_constant(1.0);
        let found = |value: f64, ci95| Parameter { nominal: None, value, ci95, scale: ScaleOrigin::Measured };
        outcome.parameters.insert("inertia_kg_m2", found(6e-8, [0.0, 3e17]));
        outcome.parameters.insert("inductance_H", found(3e-3, [1e-3, 9e-3]));
        outcome.parameters.insert("viscous_friction_Nm_s", found(1e-6, [0.0, 3e-6]));
        assert_eq!(outcome.undetermined().collect::<Vec<_>>(), ["inertia_kg_m2"]);
        let told = outcome.advice_on_undetermined().unwrap();
        assert!(told.starts_with("These data do not determine inertia_kg_m2:"), "{told}");
        // Held where it was.
        outcome.parameters.insert("inertia_kg_m2", found(6e-8, [6e-8; 2]));
        assert_eq!(outcome.advice_on_undetermined(), None);
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
        let mut outcome = with_torque_constant(1.0);
        let found = Parameter { nominal: Some(8.0), value: 12.0, ci95: [11.9, 12.1], scale: ScaleOrigin::Measured };
        outcome.parameters.insert(RESISTANCE_OHM, found);
        for (bridge_ohm, wrong) in [(0.0, 1), (1.0, 1), (3.0, 0)] {
            assert_eq!(wrong_values(&outcome.parameters, bridge_ohm).len(), wrong, "{bridge_ohm}");
            let told = outcome.of_circuit(bridge_ohm);
            assert_eq!(told.is_some_and(|told| told.contains("by up to 3.00 ohm")), wrong == 0, "{bridge_ohm}");
        }
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

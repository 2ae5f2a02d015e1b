//! Causes with their constants, and nominal values that the constants contradict.

use super::outcome::{Cause, Estimate, Parameter, RmseGain, RunnerUp, confidence};
use super::select::Standing;
use super::{Corrections, DATA_SHEET_TOLERANCE, Found};
use crate::configuration::diagnose::causes::{BEYOND_TOLERANCE_SIGMAS, LEAST_RATING_A, LEAST_ROWS, LEAST_SPREAD};
use crate::dataset::{Dataset, greatest};
use crate::identify::{Fit, Interval, Place, Z95};
use motorbench_data::rig::NominalMotor;
use motorbench_model::catalogue::{ActsOn, INDUCTANCE};
use motorbench_model::linear::motor_model::TimeConstants;
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Model, Term};
use std::collections::BTreeMap;

/// The constant that bridge and winding share.
pub(super) const RESISTANCE_OHM: &str = "resistance_ohm";

/// The part of the resistance that may belong to the bridge. Up to its rated current a drop grows at most by itself, and
/// then on as fast. A small bridge at a large motor is beyond its rating.
pub(super) fn bridge_ohm(data: &Dataset, model: &Model) -> f64 {
    let Some(current) = data.current() else { return 0.0 };
    model.dry_losses().bridge_drop_v / greatest(&current.values).clamp(f64::MIN_POSITIVE, LEAST_RATING_A)
}

pub(super) fn cause(
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

pub(super) fn parameters(
    found: &Found,
    nominal: &NominalMotor,
    corrections: &Corrections,
) -> BTreeMap<&'static str, Parameter> {
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

/// Nominal values that are off by more than a data sheet's tolerance. The resistance found is that of the circuit:
/// `bridge_ohm` of it may be the bridge's.
pub(super) fn wrong_values(parameters: &BTreeMap<&'static str, Parameter>, bridge_ohm: f64) -> Vec<Cause> {
    let names = [
        (RESISTANCE_OHM, "resistance"),
        ("inductance_H", "inductance"),
        ("torque_constant_Nm_per_A", "torque_constant"),
        ("inertia_kg_m2", "inertia"),
    ];
    names
        .into_iter()
        .filter_map(|(name, id)| {
            let found = parameters.get(name)?;
            let sigmas = sigmas_beyond_tolerance(found, if name == RESISTANCE_OHM { bridge_ohm } else { 0.0 })?;
            let estimate = Estimate { value: found.value, ci95: Some(found.ci95) };
            (sigmas > BEYOND_TOLERANCE_SIGMAS).then(|| value_cause(id, name, estimate, sigmas))
        })
        .collect()
}

/// Whether a value is clearly beyond a data sheet's tolerance, even if `bridge_ohm` of it may be the bridge's.
pub(super) fn is_wrong(found: &Parameter, bridge_ohm: f64) -> bool {
    sigmas_beyond_tolerance(found, bridge_ohm).is_some_and(|sigmas| sigmas > BEYOND_TOLERANCE_SIGMAS)
}

/// Standard errors from the end of a data sheet's tolerance to a value: of the value or of its logarithm, whichever are
/// fewer. A time that is not known adds to the value as much however small the constant is. None without a nominal value.
fn sigmas_beyond_tolerance(found: &Parameter, bridge_ohm: f64) -> Option<f64> {
    let Parameter { nominal, value, ci95: [low, high], .. } = *found;
    let nominal = nominal?;
    let own = value - (value - nominal).clamp(0.0, bridge_ohm);
    let off = (own / nominal).ln();
    let spread = (high / low.max(f64::MIN_POSITIVE)).ln() / (2.0 * Z95);
    let by_logarithm = (off.abs() - DATA_SHEET_TOLERANCE) / spread.max(LEAST_SPREAD);
    let end = nominal * DATA_SHEET_TOLERANCE.copysign(off).exp();
    let towards_end = if off > 0.0 { value - low } else { high - value } / Z95;
    let by_value = (own - end) * off.signum() / towards_end.max(f64::MIN_POSITIVE);
    Some(by_logarithm.min(by_value))
}

pub(super) fn value_cause(id: &str, constant: &str, estimate: Estimate, sigmas: f64) -> Cause {
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

/// Whether a cause is the inductance, and the rows are too far apart to show it: the current has settled in each row.
pub(super) fn is_between_rows(effect: &str, data: &Dataset, motor: &MotorParameters) -> bool {
    effect == INDUCTANCE && TimeConstants::of(motor).electromagnetic_s < LEAST_ROWS * data.interval_s
}

/// Whether an effect is a lag of a sensor that settles between two rows. No row says within it when it was read.
pub(super) fn settles_between_rows(id: &str, data: &Dataset, model: &Model) -> bool {
    let is_short = |late_s: f64| (f64::MIN_POSITIVE..LEAST_ROWS * data.interval_s).contains(&late_s);
    let late_s = |term: &Term| {
        let effect = term.effect;
        effect.current_late_s(&term.values).max(effect.speed_late_s(&term.values))
    };
    model.term(id).is_some_and(|term| term.effect.about().sensor.is_some() && is_short(late_s(term)))
}

/// By how much an effect changes the lateness of the commands over the recording.
fn grown_s(term: &Term, data: &Dataset) -> f64 {
    term.effect.delay_growth(&term.values).abs() * data.span_s()
}

/// Whether an effect is a lateness of the commands that stays within a row. A program may send more commands than it writes
/// rows, so a row does not say when within it a command acts: of a step otherwise than of a sine, which looks like a drift.
/// A delay stays open where rows were written after their commands had acted, or the times of the commands are estimated.
pub(super) fn stays_within_a_row(id: &str, data: &Dataset, model: &Model) -> bool {
    let is_short = |late_s: f64| (f64::MIN_POSITIVE..data.interval_s).contains(&late_s);
    let is_delay_open = data.origin.written_after || data.has_moments();
    model.term(id).is_some_and(|term| {
        is_short(grown_s(term, data)) || is_delay_open && is_short(term.effect.delay_s(&term.values))
    })
}

/// Whether an effect is a lateness of the commands that stays below a period of the PWM. A timer takes over a new duty at
/// the begin of a period (ATmega328P data sheet, 15.7 and 16.9), so that belongs to the PWM.
pub(super) fn waits_for_the_pwm(id: &str, data: &Dataset, model: &Model) -> bool {
    let is_late = |term: &Term| {
        let latest_s = term.effect.delay_s(&term.values).max(grown_s(term, data));
        (f64::MIN_POSITIVE..1.0 / data.origin.pwm_hz).contains(&latest_s)
    };
    data.origin.pwm_is_known && data.axis.drive.is_voltage() && model.term(id).is_some_and(is_late)
}

/// Whether a wrong value is an inductance that may come from an assumed PWM frequency, averaging window or command
/// time: the rig file does not give these, so only the combination is known. A speed alone shows an inductance by a lateness,
/// and the commands may act late.
pub(super) fn is_of_the_reading(cause: &str, data: &Dataset, model: &Model) -> bool {
    let shows_pwm = || model.terms.iter().any(|term| term.effect.about().acts_on.contains(&ActsOn::Voltage));
    let of_pwm = || !data.origin.pwm_is_known && shows_pwm();
    let of_lateness = || data.current().is_none() && data.origin.timing.command_delay_s.is_none();
    cause == INDUCTANCE
        && (of_pwm()
            || data.origin.is_current_window_assumed()
            || of_lateness()
            || data.has_moments()
            || data.origin.taken_over_its_row)
}

#[cfg(test)]
mod tests {
    use super::super::outcome::ScaleOrigin;
    use super::*;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;
    use motorbench_model::catalogue::effect;
    use std::fmt::Write as _;

    /// Some of a winding's time may be a command that acts late: an absolute error, and not a share of the value.
    #[test]
    fn a_value_is_as_far_beyond_the_tolerance_as_its_interval_says() {
        let sigmas = |value: f64, half_width: f64| {
            let ci95 = [value - half_width, value + half_width];
            let found = Parameter { nominal: Some(1.0), value, ci95, scale: ScaleOrigin::Measured };
            sigmas_beyond_tolerance(&found, 0.0).unwrap()
        };
        for (value, half_width, is_wrong) in
            [(5.0, 2.7, false), (5.0, 1.0, true), (0.2, 0.02, true), (0.2, 0.19, false), (1.2, 0.01, false)]
        {
            assert_eq!(sigmas(value, half_width) > BEYOND_TOLERANCE_SIGMAS, is_wrong, "{value} {half_width}");
        }
        assert!(sigmas(5.0, 0.1) > sigmas(2.0, 0.1) && sigmas(1.2, 0.01) < 0.0);
    }

    #[test]
    fn lateness_below_a_period_or_a_row_is_no_cause() {
        let mut text = String::from("t_s,duty,omega_rad_per_s\n");
        for row in 0..5000 {
            let duty = [0.9, 0.4, -0.7, 0.2, -0.5][row / 1000];
            let _ = writeln!(text, "{},{duty},{}", row as f64 * 1e-3, 150.0 * duty + 0.1 * (row % 3) as f64);
        }
        let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
        let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n[bridge]\npwm_Hz = 490\n").unwrap();
        let data = Dataset::new(&[recording], &rig).unwrap();
        for (id, value, belongs) in [
            ("actuation_delay", 0.001, true),
            ("actuation_delay", 0.003, false),
            // In ppm, over 5 s.
            ("clock_drift", 200.0, true),
            ("clock_drift", 1000.0, false),
        ] {
            let model = Model::linear(MotorParameters::PIVT6).with(effect(id).unwrap(), vec![value]);
            assert_eq!(waits_for_the_pwm(id, &data, &model), belongs, "{id} {value}");
        }
        // These readings answer in the row of their command, as where rows are written afterwards.
        let mut rows = data;
        rows.origin.written_after = false;
        let between = rows.with_commands_between(&[1000]);
        for (id, value, of_rows, of_moments) in [
            ("actuation_delay", 0.0009, false, true),
            ("actuation_delay", 0.0011, false, false),
            ("clock_drift", -190.0, true, true),
            ("clock_drift", 210.0, false, false),
        ] {
            let model = Model::linear(MotorParameters::PIVT6).with(effect(id).unwrap(), vec![value]);
            assert_eq!(stays_within_a_row(id, &rows, &model), of_rows, "{id} {value}");
            assert_eq!(stays_within_a_row(id, &between, &model), of_moments, "{id} {value}");
        }
    }
}

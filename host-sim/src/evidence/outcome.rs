//! What the most probable candidate says, as the result that programs read.

use super::fit::{Fitted, Problem};
use super::search::Standing;
use super::settings::Settings;
use crate::catalogue::ActsOn;
use crate::dataset::{Dataset, Measured};
use crate::diagnose::judge;
use crate::diagnose::missing;
use crate::diagnose::outcome::{
    Cause, Estimate, Outcome, Parameter, Quality, RmseGain, RunnerUp, Unexplained, Verdict,
};
use crate::free_run::{Prediction, free_run};
use crate::identify::{Place, Prior};
use crate::model::Model;
use std::collections::BTreeMap;

/// Half an interval of 95 % in standard errors.
const Z95: f64 = 1.96;
/// On what something depends that no curve explains a tenth of.
const NOTHING_SEEN: &str = "nothing seen";
const LEAST_SHARE: f64 = 0.1;

/// A constant with its interval.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    /// Which.
    pub place: Place,
    /// Most probable value.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// Intervals of all constants of a candidate, by the curvature of its probability.
pub fn intervals(data: &Dataset, fitted: &Fitted, set: &Settings) -> Vec<Interval> {
    let of_the_scale = scale_error(data, &fitted.model, set);
    let size = fitted.normal.nrows();
    let covariance = fitted.normal.clone().try_inverse().unwrap_or_else(|| nalgebra::DMatrix::zeros(size, size));
    let interval = |(index, constant): (usize, &super::constants::Constant)| {
        let here = constant.get(&fitted.model);
        let leaves_out = match constant.place {
            Place::Motor(_) => set.motor_error,
            Place::Term(term, _) => fitted.model.terms[term].effect.simplification().own.max(set.motor_error),
        };
        let systematic = if constant.unit.is_some() { leaves_out * here } else { leaves_out };
        let scaled = if of_the_scale.1(constant.place, &fitted.model) { of_the_scale.0 } else { 0.0 };
        let systematic = f64::hypot(systematic, if constant.unit.is_some() { scaled * here } else { scaled });
        let half = Z95 * covariance[(index, index)].max(0.0).sqrt().hypot(systematic);
        let ci95 = [constant.value(here - half), constant.value(here + half)];
        Interval { place: constant.place, value: constant.value(here), ci95 }
    };
    fitted.constants.iter().enumerate().map(interval).collect()
}

/// A drop that is another in the off phase of the PWM than in the pulse is another supply to every reading: by how much that
/// is unknown, as a share, and of which constants.
fn scale_error(data: &Dataset, model: &Model, set: &Settings) -> (f64, fn(Place, &Model) -> bool) {
    let drop_v = model.dry_losses().bridge_drop_v;
    let supply_v = crate::dataset::greatest(&data.supply_v).max(f64::MIN_POSITIVE);
    let in_the_scale = |place: Place, model: &Model| match place {
        Place::Motor(_) => true,
        Place::Term(term, index) => {
            let about = model.terms[term].effect.about();
            about.acts_on == ActsOn::Torque && index < about.linear_in
        }
    };
    (set.drop_difference * drop_v / supply_v, in_the_scale)
}

/// Whether an effect is no more than the moment within a row at which a command acts.
fn is_within_a_row(id: &str, data: &Dataset, model: &Model, set: &Settings) -> bool {
    let duration_s = crate::dataset::greatest(&data.time_s);
    let least_s = set.named_delay_rows * data.interval_s;
    match id {
        "actuation_delay" => model.delay_s() < least_s,
        "clock_drift" => model.delay_growth().abs() * duration_s < least_s,
        _ => false,
    }
}

impl Problem<'_> {
    /// The result of a candidate and of what holds of each of its effects.
    pub fn outcome(&self, fitted: &Fitted, standings: &[Standing], base: &Model) -> Outcome {
        let data = self.data;
        let intervals = intervals(data, fitted, &self.set);
        let extended = free_run(&fitted.model, data);
        let is_named = |standing: &&Standing| !is_within_a_row(standing.id, data, &fitted.model, &self.set);
        let mut causes: Vec<Cause> = standings
            .iter()
            .filter(is_named)
            .map(|standing| self.cause(fitted, standing, &intervals, &extended))
            .collect();
        causes.sort_by(|a, b| b.evidence_sigmas.total_cmp(&a.evidence_sigmas));
        let parameters = parameters(&fitted.model, self.prior, &intervals);
        let unexplained = self.unexplained(fitted, &extended);
        if unexplained.is_none() {
            causes.extend(wrong_values(&parameters, &self.set));
        }
        let verdict = match (causes.is_empty(), unexplained.is_some()) {
            (true, false) => Verdict::Sufficient,
            (false, false) => Verdict::Explained,
            (false, true) => Verdict::PartlyExplained,
            (true, true) => Verdict::Unexplained,
        };
        let left = residuals(data, &extended);
        let fit = BTreeMap::from([
            ("base", qualities(data, &free_run(base, data))),
            ("extended", qualities(data, &extended)),
            ("noise_floor", floors(data, &extended, &left)),
        ]);
        let mut outcome = Outcome { verdict, causes, unexplained, parameters, fit, advice: Vec::new() };
        outcome.advice = outcome.advice(data);
        outcome
    }

    fn cause(&self, fitted: &Fitted, standing: &Standing, intervals: &[Interval], extended: &Prediction) -> Cause {
        let before = free_run(&standing.without, self.data);
        let channels = self.data.measured.iter().enumerate();
        let gain = channels.map(|(output, measured)| {
            let [rmse_before, rmse_after] = [&before, extended].map(|said| judge::rmse(self.data, said, output));
            (measured.output.channel(), RmseGain { rmse_before, rmse_after })
        });
        let odds = standing.gain.min(500.0);
        Cause {
            effect: standing.id.into(),
            confidence: 1.0 / (1.0 + (-odds).exp()) / (1.0 + standing.same.len() as f64),
            parameters: constants(standing.id, &fitted.model, intervals),
            gain: gain.collect(),
            not_separable_from: standing.same.clone(),
            evidence_sigmas: (2.0 * standing.gain.max(0.0)).sqrt(),
            runner_up: standing.rival.map(|(effect, worse)| RunnerUp {
                effect,
                worse_by_sigmas: (2.0 * worse.max(0.0)).sqrt(),
                worse_by_share: 0.0,
            }),
        }
    }

    fn unexplained(&self, fitted: &Fitted, extended: &Prediction) -> Option<Unexplained> {
        let data = self.data;
        let [torque, voltage, ..] = fitted.unknown.list();
        if torque.max(voltage) < self.set.missing {
            return None;
        }
        let acts_on = if torque >= voltage { ActsOn::Torque } else { ActsOn::Voltage };
        let left = residuals(data, extended);
        let lack = missing::lack(data, &fitted.model.motor, &left, acts_on);
        let dependence = missing::dependences(data, &lack.values).into_iter().next()?;
        let rest = |output: usize| {
            let after = judge::rmse(data, extended, output);
            let noise = judge::noise(data, &left[output], output);
            1.0 - (noise.min(after) / after.max(f64::MIN_POSITIVE)).powi(2)
        };
        Some(Unexplained {
            acts_on,
            depends_on: if dependence.share > LEAST_SHARE { dependence.on } else { NOTHING_SEEN }.into(),
            share: (0..data.measured.len()).map(rest).fold(0.0, f64::max),
        })
    }
}

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

fn parameters(model: &Model, prior: &Prior, intervals: &[Interval]) -> BTreeMap<&'static str, Parameter> {
    let nominal = prior.nominal.values();
    let named = model.motor.named().into_iter().enumerate();
    named
        .map(|(index, (name, value))| {
            let interval = intervals.iter().find(|interval| interval.place == Place::Motor(index));
            let ci95 = interval.map_or([value, value], |interval| interval.ci95);
            (name, Parameter { nominal: nominal[index], value, ci95 })
        })
        .collect()
}

/// Nominal values that are further off than a data sheet's tolerance.
fn wrong_values(parameters: &BTreeMap<&'static str, Parameter>, set: &Settings) -> Vec<Cause> {
    let cause = |(name, id): (&'static str, &str)| {
        let parameter = parameters.get(name)?;
        let off = (parameter.value / parameter.nominal?).ln().abs();
        let spread = (parameter.ci95[1] / parameter.ci95[0].max(f64::MIN_POSITIVE)).ln() / (2.0 * Z95);
        let sigmas = (off - set.data_sheet_tolerance) / spread.max(set.least_spread);
        let estimate = Estimate { value: parameter.value, ci95: Some(parameter.ci95) };
        (sigmas > set.beyond_tolerance_sigmas).then(|| Cause {
            effect: format!("parameter:{id}"),
            confidence: crate::diagnose::outcome::confidence(sigmas),
            parameters: BTreeMap::from([(name.to_string(), estimate)]),
            gain: BTreeMap::new(),
            not_separable_from: Vec::new(),
            evidence_sigmas: sigmas,
            runner_up: None,
        })
    };
    [
        ("resistance_ohm", "resistance"),
        ("inductance_H", "inductance"),
        ("torque_constant_Nm_per_A", "torque_constant"),
        ("inertia_kg_m2", "inertia"),
    ]
    .into_iter()
    .filter_map(cause)
    .collect()
}

fn qualities(data: &Dataset, prediction: &Prediction) -> BTreeMap<&'static str, Quality> {
    let quality = |(output, measured): (usize, &Measured)| {
        let quality = Quality {
            rmse: judge::rmse(data, prediction, output),
            ci95: Some(judge::rmse_interval(data, prediction, output)),
            unit: measured.output.unit(),
            fit_percent: judge::fit_percent(data, prediction, output),
        };
        (measured.output.channel(), quality)
    };
    data.measured.iter().enumerate().map(quality).collect()
}

/// What the noise of each sensor alone would leave.
fn floors(data: &Dataset, prediction: &Prediction, left: &[Vec<f64>]) -> BTreeMap<&'static str, Quality> {
    let floor = |(output, measured): (usize, &Measured)| {
        let rmse = judge::noise(data, &left[output], output);
        let after = judge::rmse(data, prediction, output);
        let reached = judge::fit_percent(data, prediction, output);
        // The same spread of the signal, the floor in place of the error.
        let fit_percent = 100.0 - (100.0 - reached) * rmse / after.max(f64::MIN_POSITIVE);
        (measured.output.channel(), Quality { rmse, ci95: None, unit: measured.output.unit(), fit_percent })
    };
    data.measured.iter().enumerate().map(floor).collect()
}

/// Measured minus simulated, per quantity.
pub fn residuals(data: &Dataset, prediction: &Prediction) -> Vec<Vec<f64>> {
    let difference = |(measured, said): (&Measured, &Vec<f64>)| {
        measured.values.iter().zip(said).map(|(value, said)| value - said).collect()
    };
    data.measured.iter().zip(prediction).map(difference).collect()
}

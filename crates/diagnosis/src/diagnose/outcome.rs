//! The result of a diagnosis: the contract for programs, as JSON.
//!
//! Every number has its unit in its name or beside it. `null` stands for what could not be computed.

use super::acts_on_words;
use super::determined::AllDetermined;
use crate::configuration::diagnose::determined::WIDEST;
use motorbench_model::Axis;
use motorbench_model::catalogue::ActsOn;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;

/// A whole result.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// What is imposed and how it moves, where that is not a voltage and a turning shaft.
    #[serde(skip_serializing_if = "Axis::is_usual")]
    pub axis: Axis,
    /// What came out.
    pub verdict: Verdict,
    /// For a recording: the effects found, strongest first, then wrong values. For a table: in the order of its
    /// balances.
    pub causes: Vec<Cause>,
    /// The rest that no effect explains.
    pub unexplained: Option<Unexplained>,
    /// What the data determine whatever the scale of torque and resistance; what they do not is left out. Empty for a
    /// table.
    pub determined: AllDetermined,
    /// Constants of the linear motor.
    pub parameters: BTreeMap<&'static str, Parameter>,
    /// Errors on held-out data of `base`, `extended` and `noise_floor`, per channel.
    pub fit: BTreeMap<&'static str, BTreeMap<&'static str, Quality>>,
    /// What to do next.
    pub advice: Vec<String>,
}

/// What came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The linear motor with its found constants reaches the noise of the sensors.
    Sufficient,
    /// It does so as well, but the recording would not have shown friction or drop of a usual strength.
    Undecided,
    /// With the named causes the model reaches the noise of the sensors.
    Explained,
    /// The named causes hold, but a rest remains.
    PartlyExplained,
    /// No effect of the catalogue explains the rest.
    Unexplained,
}

/// An effect, or a nominal value that is wrong.
#[derive(Clone, Debug, Serialize)]
pub struct Cause {
    /// Identifier of the catalogue, or `parameter:NAME`.
    pub effect: String,
    /// 0 to 1.
    pub confidence: f64,
    /// Its constants.
    pub parameters: BTreeMap<String, Estimate>,
    /// Errors on held-out data without it and with it, everything else fitted in both, per channel.
    pub gain: BTreeMap<&'static str, RmseGain>,
    /// Effects, or a wrong value, that would explain this data equally well.
    pub not_separable_from: Vec<&'static str>,
    /// Gain in standard errors of the gain.
    pub evidence_sigmas: f64,
    /// The best alternative, and by how many standard errors it is worse.
    pub runner_up: Option<RunnerUp>,
}

impl Cause {
    /// Whether it is a nominal value that is wrong.
    pub fn is_value(&self) -> bool {
        self.effect.starts_with("parameter:")
    }
}

/// Confidence that corresponds to this many standard errors.
pub fn confidence(sigmas: f64) -> f64 {
    1.0 - (-sigmas / 3.0).exp()
}

/// The best alternative to a cause.
#[derive(Clone, Debug, Serialize)]
pub struct RunnerUp {
    /// Identifier of the catalogue.
    pub effect: &'static str,
    /// By how much it is worse, in standard errors.
    pub worse_by_sigmas: f64,
    /// Its additional mean square error as a share of what the cause leaves, for the channel that differs most.
    pub worse_by_share: f64,
}

/// A value and its interval.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Estimate {
    /// Most plausible value.
    pub value: f64,
    /// Interval that contains the true value in 95 of 100 recordings. `null` for what was not fitted: whole numbers,
    /// laws that were tried, constants that were held.
    pub ci95: Option<[f64; 2]>,
}

/// Errors before and after.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct RmseGain {
    pub rmse_before: f64,
    pub rmse_after: f64,
}

/// The rest that no effect explains.
#[derive(Clone, Debug, Serialize)]
pub struct Unexplained {
    /// Where it acts.
    pub acts_on: ActsOn,
    /// What it depends on most; `nothing seen` if no curve explains a tenth of it (for a table, half).
    pub depends_on: String,
    /// Share of the mean square error that remains without the noise, for the channel where it is greatest.
    pub share: f64,
}

impl Unexplained {
    /// In words: where it acts and what it depends on.
    pub fn place(&self) -> String {
        format!("it acts on {} and depends on {}", acts_on_words(self.acts_on), self.depends_on)
    }
}

/// Where the scale of a constant comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleOrigin {
    /// The data have it.
    Measured,
    /// Nominal values of the rig file.
    Nominal,
    /// Only a usual size was assumed.
    Unknown,
}

/// A constant of the linear motor.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Parameter {
    /// From the rig file.
    pub nominal: Option<f64>,
    /// Found.
    pub value: f64,
    /// Interval that contains the true value in 95 of 100 recordings; of zero width for a value that was held fixed.
    #[serde(serialize_with = "interval_or_null")]
    pub ci95: [f64; 2],
    /// Where its scale comes from.
    pub scale: ScaleOrigin,
}

impl Parameter {
    /// None where the value was held fixed.
    pub fn interval(&self) -> Option<[f64; 2]> {
        with_width(self.ci95)
    }

    /// Whether its interval spans less than an order of magnitude.
    pub fn is_determined(&self) -> bool {
        self.ci95[1] <= WIDEST * self.ci95[0]
    }
}

fn with_width(ci95: [f64; 2]) -> Option<[f64; 2]> {
    (ci95[0] != ci95[1]).then_some(ci95)
}

fn interval_or_null<S: Serializer>(ci95: &[f64; 2], serializer: S) -> Result<S::Ok, S::Error> {
    with_width(*ci95).serialize(serializer)
}

/// Quality of a model on one channel.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Quality {
    /// Root mean square error.
    pub rmse: f64,
    /// 95 % interval of it (block bootstrap); `null` for the noise floor.
    pub ci95: Option<[f64; 2]>,
    /// Its unit.
    pub unit: &'static str,
    /// 100 (1 - |y - prediction| / |y - mean y|).
    pub fit_percent: f64,
}

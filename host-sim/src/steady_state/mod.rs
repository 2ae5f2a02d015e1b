//! Tables of steady states: voltage, current and speed without time.
//!
//! At rest from all change the two equations are `u = R i + k w + drop` and `k i = b w + friction + load`. A table says which
//! of their terms are needed, how large they are, and which it cannot tell apart: without load the current hardly changes,
//! so that a resistance and a constant drop are one and the same, and so are a larger back-EMF constant and a resistance
//! that grows with the speed. A brake whose torque is known tells them apart.

mod report;

use crate::diagnose::outcome::{Cause, Estimate, Outcome, Parameter, Quality, RmseGain, RunnerUp, Verdict};
use crate::recording::{Channel, Recording};
use crate::rig::Rig;
use crate::terminal_text::short;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Readings whose voltages differ by less than this share of the greatest are one level.
const SAME_LEVEL: f64 = 0.005;
/// Fewer levels say nothing of a line.
pub const FEWEST_LEVELS: usize = 3;
/// A term is needed when it is this many standard errors from nothing.
const NEEDED_SIGMAS: f64 = 4.0;
/// Two explanations whose errors at a level left out differ by less than this share cannot be told apart.
const SAME_SHARE: f64 = 0.5;
/// What the published study of the PIVT-6 takes for its cause.
const GROWING: &str = "resistance_growing_with_speed";

/// Means of the readings at one voltage under one load, and what follows from them.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct Level {
    /// Voltage.
    pub u_V: f64,
    /// Torque of the brake, as it was stated; none without one.
    pub load_Nm: f64,
    /// Number of readings.
    pub readings: usize,
    /// Mean current.
    pub i_A: f64,
    /// Mean speed.
    pub omega_rad_per_s: f64,
    /// The same in revolutions per minute.
    pub rpm: f64,
    /// Back-EMF by the nominal constant, E = k w.
    pub emf_V: f64,
    /// Electrical power taken, U I.
    pub p_in_W: f64,
    /// Electromechanical power, E I.
    pub p_out_W: f64,
    /// P_out / P_in.
    pub efficiency: f64,
    /// Torque by the nominal constant, k I.
    pub torque_Nm: f64,
    /// Speed over voltage.
    pub k_mot_rad_per_s_per_V: f64,
    /// (P_in - P_out) / I^2, which has been called the dynamic resistance.
    pub dynamic_resistance_ohm: f64,
    /// What the nominal resistance and back-EMF leave of the voltage.
    pub missing_V: f64,
    #[serde(skip)]
    pub(crate) current_error: f64,
    #[serde(skip)]
    speed_error: f64,
}

impl Level {
    /// Standard error of the voltage that resistance and back-EMF leave.
    pub(crate) fn voltage_error(&self, r: f64, k: f64) -> f64 {
        (r * self.current_error).hypot(k * self.speed_error)
    }
}

/// An explanation of the missing voltage.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// What it takes, in the words of the catalogue and of `parameter:`.
    pub terms: Vec<&'static str>,
    /// Its constants.
    pub constants: BTreeMap<&'static str, Estimate>,
    /// Weighted sum of squares over degrees of freedom; near 1 when it is enough.
    pub chi2_per_dof: f64,
    /// Error of the voltage at a level that the fit has not seen.
    pub left_out_rmse_v: f64,
}

/// What a table says.
#[derive(Clone, Debug, Serialize)]
pub struct Study {
    /// The contract of every diagnosis.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// The derived table.
    pub levels: Vec<Level>,
    /// Everything that was tried for the missing voltage, best first.
    pub explanations: Vec<Explanation>,
}

/// Why a table cannot be studied.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// A column is missing.
    #[error(
        "{name}: a table of steady states needs the columns u_V, i_A and omega_rad_per_s or rpm (and a recording over time needs t_s); {}",
        unknown(.ignored)
    )]
    Columns {
        /// Which table.
        name: String,
        /// Columns without a meaning here.
        ignored: Vec<String>,
    },
    /// Too few voltages.
    #[error("{name}: {levels} voltages or loads; {FEWEST_LEVELS} or more are needed to tell a line from an offset")]
    TooFew {
        /// Which table.
        name: String,
        /// How many there are.
        levels: usize,
    },
    /// Nominal values are missing.
    #[error("a table of steady states needs [motor] resistance_ohm and torque_constant_Nm_per_A in the rig file")]
    NoNominal,
}

/// What may be what is missing.
fn unknown(ignored: &[String]) -> String {
    match ignored.first() {
        None => "it has no other columns than those that are known here".into(),
        Some(first) => format!("which of {} is which? For instance --column {first}=t_s", ignored.join(", ")),
    }
}

/// Studies a table.
///
/// # Errors
/// [`StudyError`].
pub fn study(table: &Recording, rig: &Rig) -> Result<Study, StudyError> {
    columns(table)?;
    let (Some(r), Some(k)) = (rig.motor.resistance_ohm, rig.motor.torque_constant_nm_per_a) else {
        return Err(StudyError::NoNominal);
    };
    let levels = levels(table, r, k)?;
    let explanations = explanations(&levels, r, k);
    let friction = friction(&levels, torque_constant(&levels, &explanations[0], k));
    let outcome = outcome(&levels, &explanations, &friction, rig);
    Ok(Study { outcome, levels, explanations })
}

/// What turns the current into torque: the nominal constant, unless loads show how far that is off.
fn torque_constant(levels: &[Level], best: &Explanation, nominal: f64) -> f64 {
    let found = best.constants.get("back_emf_constant_V_s").filter(|_| is_loaded(levels));
    found.map_or(nominal, |constant| constant.value)
}

/// Whether a brake was at the shaft.
pub(crate) fn is_loaded(levels: &[Level]) -> bool {
    levels.iter().any(|level| level.load_Nm > 0.0)
}

/// Means of the readings at each voltage and load, with what follows from the nominal constants. Both directions count as one:
/// what differs between them, an offset of the current or friction, is scatter of their mean.
pub(crate) fn levels(table: &Recording, r: f64, k: f64) -> Result<Vec<Level>, StudyError> {
    let (voltage, current, speed) = columns(table)?;
    let greatest = crate::dataset::greatest(voltage);
    let load = table.get(Channel::LoadTorque).map_or_else(|| vec![0.0; voltage.len()], <[f64]>::to_vec);
    let mut groups: Vec<([f64; 2], Readings)> = Vec::new();
    for row in 0..voltage.len() {
        let (u, i, w, load) = (voltage[row], current[row], speed[row], load[row]);
        if u.is_nan() || i.is_nan() || w.is_nan() || load.is_nan() {
            continue;
        }
        let (u, i, w, load) = (u.abs(), i * u.signum(), w * u.signum(), load * u.signum());
        let u = groups.iter().map(|(of, _)| of[0]).find(|other| same_level(*other, u, greatest)).unwrap_or(u);
        match groups.iter_mut().find(|(of, _)| *of == [u, load]) {
            Some((_, readings)) => readings.push((i, w)),
            None => groups.push(([u, load], vec![(i, w)])),
        }
    }
    if groups.len() < FEWEST_LEVELS {
        return Err(StudyError::TooFew { name: table.name.clone(), levels: groups.len() });
    }
    groups.sort_by(|a, b| a.0.partial_cmp(&b.0).expect("numbers"));
    Ok(groups.iter().map(|([u, load], readings)| level(*u, *load, readings, r, k)).collect())
}

/// Current and speed of each.
type Readings = Vec<(f64, f64)>;

/// Voltage, current and speed.
type Columns<'a> = (&'a [f64], &'a [f64], Vec<f64>);

fn columns(table: &Recording) -> Result<Columns<'_>, StudyError> {
    let missing = || StudyError::Columns { name: table.name.clone(), ignored: table.ignored.clone() };
    let voltage = table.get(Channel::Voltage).ok_or_else(missing)?;
    let current = table.get(Channel::Current).ok_or_else(missing)?;
    let rpm = table.get(Channel::Rpm).map(|rpm| rpm.iter().map(|rpm| rpm * TAU / 60.0).collect::<Vec<_>>());
    let speed = table.get(Channel::Speed).map(<[f64]>::to_vec).or(rpm).ok_or_else(missing)?;
    Ok((voltage, current, speed))
}

/// Whether two voltages are one level of a table.
pub(crate) fn same_level(a_v: f64, b_v: f64, greatest_v: f64) -> bool {
    (a_v - b_v).abs() < SAME_LEVEL * greatest_v
}

fn level(u: f64, load: f64, readings: &[(f64, f64)], r: f64, k: f64) -> Level {
    let (i, current_error) = mean(readings.iter().map(|reading| reading.0));
    let (w, speed_error) = mean(readings.iter().map(|reading| reading.1));
    let emf = k * w;
    Level {
        u_V: u,
        load_Nm: load,
        readings: readings.len(),
        i_A: i,
        omega_rad_per_s: w,
        rpm: w * 60.0 / TAU,
        emf_V: emf,
        p_in_W: u * i,
        p_out_W: emf * i,
        efficiency: emf / u,
        torque_Nm: k * i,
        k_mot_rad_per_s_per_V: w / u,
        dynamic_resistance_ohm: (u - emf) / i,
        missing_V: u - r * i - emf,
        current_error,
        speed_error,
    }
}

/// Mean and its standard error; of a single reading a hundredth of it.
fn mean(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let spread = values.map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let error = if count > 1.0 { (spread / count).sqrt() } else { 0.01 * mean.abs() };
    (mean, error.max(1e-6 * mean.abs()))
}

/// A straight fit of few terms by weighted least squares.
pub(crate) struct Line {
    values: DVector<f64>,
    covariance: DMatrix<f64>,
    chi2: f64,
    left_out_rmse: f64,
}

pub(crate) fn line(columns: &[Vec<f64>], target: &[f64], errors: &[f64]) -> Option<Line> {
    let solve = |kept: &dyn Fn(usize) -> bool| -> Option<(DVector<f64>, DMatrix<f64>)> {
        let size = columns.len();
        let (mut normal, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        for row in (0..target.len()).filter(|row| kept(*row)) {
            let weight = errors[row].powi(-2);
            for a in 0..size {
                right[a] += weight * columns[a][row] * target[row];
                for b in 0..size {
                    normal[(a, b)] += weight * columns[a][row] * columns[b][row];
                }
            }
        }
        let covariance = normal.try_inverse()?;
        Some((&covariance * right, covariance))
    };
    let predict =
        |values: &DVector<f64>, row: usize| -> f64 { columns.iter().zip(values).map(|(c, v)| c[row] * v).sum() };
    let (values, covariance) = solve(&|_| true)?;
    let chi2 = (0..target.len()).map(|row| ((target[row] - predict(&values, row)) / errors[row]).powi(2)).sum();
    let mut left_out = 0.0;
    for (out, seen) in target.iter().enumerate() {
        let (values, _) = solve(&|row| row != out)?;
        left_out += (seen - predict(&values, out)).powi(2);
    }
    Some(Line { values, covariance, chi2, left_out_rmse: (left_out / target.len() as f64).sqrt() })
}

/// Interval of Student's distribution around a fitted value; errors are scaled up when the scatter is greater than they say.
pub(crate) fn interval(line: &Line, index: usize, dof: usize) -> Estimate {
    let value = line.values[index];
    let scale = (line.chi2 / dof.max(1) as f64).max(1.0).sqrt();
    let error = line.covariance[(index, index)].sqrt() * scale;
    let quantile = StudentsT::new(0.0, 1.0, dof.max(1) as f64).map_or(2.0, |student| student.inverse_cdf(0.975));
    Estimate { value, ci95: Some([value - quantile * error, value + quantile * error]) }
}

/// Terms for the missing voltage: identifier, constant, the constant's nominal value, and the column.
fn voltage_terms(levels: &[Level], r: f64, k: f64) -> [(&'static str, &'static str, f64, Vec<f64>); 4] {
    let column = |of: &dyn Fn(&Level) -> f64| levels.iter().map(of).collect::<Vec<_>>();
    [
        ("voltage_drop", "drop_V", 0.0, column(&|_| 1.0)),
        ("parameter:torque_constant", "back_emf_constant_V_s", k, column(&|level| level.omega_rad_per_s)),
        ("parameter:resistance", "resistance_ohm", r, column(&|level| level.i_A)),
        (GROWING, "growth_ohm_s", 0.0, column(&|level| level.i_A * level.omega_rad_per_s)),
    ]
}

fn explanations(levels: &[Level], r: f64, k: f64) -> Vec<Explanation> {
    let terms = voltage_terms(levels, r, k);
    let target: Vec<f64> = levels.iter().map(|level| level.missing_V).collect();
    let errors: Vec<f64> = levels.iter().map(|level| level.voltage_error(r, k)).collect();
    let mut found = vec![Explanation {
        terms: Vec::new(),
        constants: BTreeMap::new(),
        chi2_per_dof: target.iter().zip(&errors).map(|(v, e)| (v / e).powi(2)).sum::<f64>() / target.len() as f64,
        left_out_rmse_v: (target.iter().map(|v| v * v).sum::<f64>() / target.len() as f64).sqrt(),
    }];
    for first in 0..terms.len() {
        for second in first..terms.len() {
            let chosen: Vec<usize> = if first == second { vec![first] } else { vec![first, second] };
            let columns: Vec<Vec<f64>> = chosen.iter().map(|term| terms[*term].3.clone()).collect();
            let dof = target.len().saturating_sub(chosen.len());
            let Some(line) = line(&columns, &target, &errors).filter(|_| dof > 0) else { continue };
            let constants = chosen.iter().enumerate().map(|(index, term)| {
                let (_, name, nominal, _) = terms[*term];
                let Estimate { value, ci95 } = interval(&line, index, dof);
                (name, Estimate { value: nominal + value, ci95: ci95.map(|ci95| ci95.map(|end| nominal + end)) })
            });
            // A resistance or a drop below zero is no explanation.
            let constants: BTreeMap<_, _> = constants.collect();
            if constants.values().all(|constant| constant.value > 0.0) {
                found.push(Explanation {
                    terms: chosen.iter().map(|term| terms[*term].0).collect(),
                    constants,
                    chi2_per_dof: line.chi2 / dof as f64,
                    left_out_rmse_v: line.left_out_rmse,
                });
            }
        }
    }
    found.sort_by(|a, b| a.left_out_rmse_v.total_cmp(&b.left_out_rmse_v));
    prefer_constants(&mut found);
    found
}

/// A resistance that grows with the speed is no law of a motor: it is named only where nothing else does as well.
fn prefer_constants(found: &mut [Explanation]) {
    let best = &found[0];
    let usual = found.iter().position(|other| !other.terms.contains(&GROWING) && best.is_like(other));
    if let Some(place) = usual {
        found[..=place].rotate_right(1);
    }
}

impl Explanation {
    /// Whether the table cannot tell this, the best, from another.
    fn is_like(&self, other: &Self) -> bool {
        other.terms.len() == self.terms.len() && other.left_out_rmse_v < (1.0 + SAME_SHARE) * self.left_out_rmse_v
    }
}

/// Torque balance beside the load: Coulomb and viscous friction, with how many standard errors the former is from nothing.
struct Friction {
    coulomb: Estimate,
    viscous: Estimate,
    sigmas: f64,
    before: f64,
    after: f64,
}

fn friction(levels: &[Level], k: f64) -> Option<Friction> {
    let speed: Vec<f64> = levels.iter().map(|level| level.omega_rad_per_s).collect();
    let target: Vec<f64> = levels.iter().map(|level| k * level.i_A - level.load_Nm).collect();
    let errors: Vec<f64> = levels.iter().map(|level| k * level.current_error).collect();
    let both = line(&[vec![1.0; speed.len()], speed.clone()], &target, &errors)?;
    let viscous_alone = line(&[speed], &target, &errors)?;
    let dof = levels.len() - 2;
    let scale = (both.chi2 / dof.max(1) as f64).max(1.0).sqrt();
    Some(Friction {
        coulomb: interval(&both, 0, dof),
        viscous: interval(&both, 1, dof),
        sigmas: both.values[0] / (both.covariance[(0, 0)].sqrt() * scale),
        before: viscous_alone.left_out_rmse / k,
        after: both.left_out_rmse / k,
    })
}

fn outcome(levels: &[Level], explanations: &[Explanation], friction: &Option<Friction>, rig: &Rig) -> Outcome {
    let nominal = explanations.iter().find(|explanation| explanation.terms.is_empty()).expect("it is always tried");
    let best = &explanations[0];
    let mut causes: Vec<Cause> = Vec::new();
    let same: Vec<&Explanation> = explanations[1..].iter().filter(|other| best.is_like(other)).collect();
    for term in &best.terms {
        causes.push(voltage_cause(term, best, nominal, &same, explanations.get(1)));
    }
    if let Some(friction) = friction.as_ref().filter(|friction| friction.sigmas > NEEDED_SIGMAS) {
        causes.push(Cause {
            effect: "coulomb_friction".into(),
            confidence: 1.0 - (-friction.sigmas / 3.0).exp(),
            parameters: BTreeMap::from([("torque_Nm".into(), friction.coulomb)]),
            gain: BTreeMap::from([("i_A", RmseGain { rmse_before: friction.before, rmse_after: friction.after })]),
            not_separable_from: vec!["current_offset"],
            evidence_sigmas: friction.sigmas,
            runner_up: None,
        });
    }
    let verdict = match (causes.is_empty(), best.chi2_per_dof < 3.0) {
        (true, true) => Verdict::Sufficient,
        (true, false) => Verdict::Unexplained,
        (false, true) => Verdict::Explained,
        (false, false) => Verdict::PartlyExplained,
    };
    Outcome {
        verdict,
        causes,
        unexplained: None,
        parameters: parameters(rig, best, friction),
        fit: fit(levels, nominal, best, friction),
        advice: advice(levels),
    }
}

fn voltage_cause(
    term: &&'static str,
    best: &Explanation,
    nominal: &Explanation,
    same: &[&Explanation],
    next: Option<&Explanation>,
) -> Cause {
    let mut others: Vec<&'static str> =
        same.iter().flat_map(|other| other.terms.iter().copied()).filter(|other| !best.terms.contains(other)).collect();
    others.sort_unstable();
    others.dedup();
    let own = best.terms.iter().position(|other| other == term).unwrap_or(0);
    let names = ["drop_V", "back_emf_constant_V_s", "resistance_ohm", "growth_ohm_s"];
    let ids = ["voltage_drop", "parameter:torque_constant", "parameter:resistance", GROWING];
    let name = names[ids.iter().position(|id| id == term).unwrap_or(own)];
    let estimate = best.constants[name];
    Cause {
        effect: (*term).into(),
        confidence: 1.0 / (1.0 + others.len() as f64),
        parameters: BTreeMap::from([(name.to_string(), estimate)]),
        gain: BTreeMap::from([(
            "u_V",
            RmseGain { rmse_before: nominal.left_out_rmse_v, rmse_after: best.left_out_rmse_v },
        )]),
        not_separable_from: others,
        evidence_sigmas: nominal.left_out_rmse_v / best.left_out_rmse_v.max(f64::MIN_POSITIVE),
        runner_up: next.and_then(|next| {
            let effect = *next.terms.first()?;
            let share = (next.left_out_rmse_v / best.left_out_rmse_v).powi(2) - 1.0;
            Some(RunnerUp { effect, worse_by_sigmas: next.chi2_per_dof.sqrt(), worse_by_share: share })
        }),
    }
}

fn parameters(rig: &Rig, best: &Explanation, friction: &Option<Friction>) -> BTreeMap<&'static str, Parameter> {
    let mut found = BTreeMap::new();
    let mut add = |name, nominal: Option<f64>, estimate: Option<&Estimate>| {
        let value = estimate.map(|estimate| estimate.value).or(nominal);
        if let Some(value) = value {
            let ci95 = estimate.and_then(|estimate| estimate.ci95).unwrap_or([value, value]);
            found.insert(name, Parameter { nominal, value, ci95 });
        }
    };
    add("resistance_ohm", rig.motor.resistance_ohm, best.constants.get("resistance_ohm"));
    add("torque_constant_Nm_per_A", rig.motor.torque_constant_nm_per_a, best.constants.get("back_emf_constant_V_s"));
    let viscous = friction.as_ref().map(|friction| &friction.viscous);
    add("viscous_friction_Nm_s", rig.motor.viscous_friction_nm_s, viscous);
    found
}

fn fit(
    levels: &[Level],
    nominal: &Explanation,
    best: &Explanation,
    friction: &Option<Friction>,
) -> BTreeMap<&'static str, BTreeMap<&'static str, Quality>> {
    let spread = |of: &dyn Fn(&Level) -> f64| {
        let (mean, _) = mean(levels.iter().map(of).collect::<Vec<_>>().into_iter());
        (levels.iter().map(|level| (of(level) - mean).powi(2)).sum::<f64>() / levels.len() as f64).sqrt()
    };
    let quality =
        |rmse: f64, unit, spread: f64| Quality { rmse, ci95: None, unit, fit_percent: 100.0 * (1.0 - rmse / spread) };
    let volts = spread(&|level| level.u_V);
    let amperes = spread(&|level| level.i_A);
    let rms = |of: &dyn Fn(&Level) -> f64| {
        (levels.iter().map(|level| of(level).powi(2)).sum::<f64>() / levels.len() as f64).sqrt()
    };
    let current_floor = rms(&|level| level.current_error);
    let voltage_floor = rms(&|level| {
        (level.missing_V / level.i_A.max(1e-9) * level.current_error)
            .hypot(level.emf_V / level.omega_rad_per_s.max(1e-9) * level.speed_error)
    });
    let of = |u: f64, i: f64| BTreeMap::from([("u_V", quality(u, "V", volts)), ("i_A", quality(i, "A", amperes))]);
    let current = friction.as_ref().map_or((f64::NAN, f64::NAN), |friction| (friction.before, friction.after));
    BTreeMap::from([
        ("base", of(nominal.left_out_rmse_v, current.0)),
        ("extended", of(best.left_out_rmse_v, current.1)),
        ("noise_floor", of(voltage_floor, current_floor)),
    ])
}

fn advice(levels: &[Level]) -> Vec<String> {
    let least_a = levels.iter().map(|level| level.i_A).fold(f64::INFINITY, f64::min);
    let most_a = levels.iter().map(|level| level.i_A).fold(0.0, f64::max);
    let mut advice = Vec::new();
    if most_a < 2.0 * least_a {
        advice.push(format!(
            "The current only goes from {} to {} A: a resistance and a constant voltage drop cannot be told apart, nor a back-EMF constant and a resistance that grows with speed. Hold the rotor and step the voltage (resistance, drop), or brake the shaft at one speed (what grows with the current is resistance).",
            short(least_a), short(most_a)
        ));
    }
    advice.push(
        "Turn the shaft from outside and measure the open terminals: that is the back-EMF constant, and with a known speed the scale of the tachogenerator, which these points cannot tell from each other.".into(),
    );
    advice.push(
        "(P_in - P_out) / I^2 is a resistance only if nothing but a resistance takes the voltage: it contains the drop divided by the current and every error of the back-EMF constant times the speed.".into(),
    );
    advice
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_growing_resistance_is_named_only_where_nothing_else_does_as_well() {
        let explanation = |terms: &[&'static str], left_out_rmse_v| Explanation {
            terms: terms.into(),
            constants: BTreeMap::new(),
            chi2_per_dof: 1.0,
            left_out_rmse_v,
        };
        let drop = "voltage_drop";
        let best = |constant_rmse_v| {
            let constant = explanation(&[drop, "parameter:torque_constant"], constant_rmse_v);
            let mut found = [explanation(&[drop, GROWING], 0.1), explanation(&[drop], 0.12), constant];
            prefer_constants(&mut found);
            found.map(|explanation| explanation.terms.last().copied())
        };
        assert_eq!(best(0.14), [Some("parameter:torque_constant"), Some(GROWING), Some(drop)]);
        assert_eq!(best(0.2), [Some(GROWING), Some(drop), Some("parameter:torque_constant")]);
    }
}

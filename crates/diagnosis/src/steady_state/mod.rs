//! Tables of steady states: voltage, current and speed without time.
//!
//! In steady state the two equations are `u = R i + k w + drop` and `k i = b w + friction + load`. A table shows which
//! of their terms are needed, how large they are, and which cannot be told apart. Without load the current hardly
//! changes. Then a resistance cannot be told from a constant drop, nor a larger back-EMF constant from a resistance
//! that grows with the speed. A brake of known torque separates them.

mod explanation;
mod line;
mod rest;
mod signs;
mod winding;

pub use crate::configuration::steady_state::FEWEST_LEVELS;
use crate::configuration::steady_state::{
    ALIKE_SHARE, NEARLY_AT_REST, NEEDED_SIGMAS, ONE_READING, ROUNDED, SAME_LEVEL, UNDRIVEN,
};
pub use explanation::Explanation;
use explanation::{TERMS, explanations};
pub use line::{Errors, Line};
use line::{left_out, rms};
use rest::{Rest, curve_sigmas};

use crate::dataset::DatasetError;
use crate::diagnose::determined::AllDetermined;
use crate::diagnose::outcome::{
    Cause, Estimate, Outcome, Parameter, Quality, RmseGain, RunnerUp, ScaleOrigin, Unexplained, Verdict, confidence,
};
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::Rig;
use motorbench_model::Axis;
use motorbench_text::terminal_text::short;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
pub use winding::Winding;

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
    /// The voltage that nominal resistance and back-EMF leave.
    pub missing_V: f64,
    /// Standard error of the current.
    #[serde(skip)]
    pub current_error: f64,
    /// Standard error of the missing voltage: variations of the shaft change current and speed, and cancel in it.
    #[serde(skip)]
    pub voltage_error: f64,
}

/// Result of a table.
#[derive(Clone, Debug, Serialize)]
pub struct Study {
    /// The diagnosis, in the same form as for recordings.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// The derived table.
    pub levels: Vec<Level>,
    /// All explanations of the missing voltage, best first.
    pub explanations: Vec<Explanation>,
    /// Index of the named one among them.
    #[serde(skip)]
    named: usize,
    /// The rows whose means the levels are.
    #[serde(skip)]
    pub rows: Rows,
    /// Resistance and torque constant of the rig file.
    #[serde(skip)]
    pub nominal: (f64, f64),
    /// The current at each level by viscous friction alone, and with dry friction.
    #[serde(skip)]
    pub friction_a: Option<[Vec<f64>; 2]>,
    /// Coulomb friction as fitted, even if it is not named.
    #[serde(skip)]
    pub coulomb_nm: f64,
}

impl Study {
    /// The explanation from which the causes are taken.
    pub fn named(&self) -> &Explanation {
        &self.explanations[self.named]
    }

    /// Another explanation that holds with as many terms.
    pub fn as_good(&self) -> Option<&Explanation> {
        let named = self.named();
        let is_as_good = |other: &&Explanation| other.holds() && other.terms.len() == named.terms.len();
        self.explanations.iter().filter(|other| other.terms != named.terms).find(is_as_good)
    }
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
    /// Voltage and speed alone.
    #[error(
        "{0}: the table has no i_A. Voltage and speed in steady state cannot tell a drop, the resistance and the back-EMF constant apart. Measure the current at each voltage, or record over time (t_s)"
    )]
    NoCurrent(String),
    /// Too few voltages.
    #[error(
        "{name}: only {levels} voltages or loads; give at least {FEWEST_LEVELS}, so that a slope and an offset can be separated"
    )]
    TooFew {
        /// Which table.
        name: String,
        /// How many there are.
        levels: usize,
    },
    /// Nominal values are missing.
    #[error(
        "a table of steady states needs [motor] resistance_ohm and torque_constant_Nm_per_A in the rig file: write them there from a data sheet, or as `motorbench identify` finds them in a recording"
    )]
    NoNominal,
    /// A motion or a current that goes against its drive.
    #[error(transparent)]
    Sign(#[from] DatasetError),
}

/// Candidates for the missing columns.
fn unknown(ignored: &[String]) -> String {
    match ignored.first() {
        None => "it has no other columns than those that are known here".into(),
        Some(first) => format!("which of {} is which? For instance --column {first}=t_s", ignored.join(", ")),
    }
}

/// Studies a table. `winding`: its resistance, if it was measured separately, for instance with the rotor held. Rows of
/// the table with the rotor held are recognised here.
///
/// # Errors
/// [`StudyError`].
pub fn study(table: &Recording, rig: &Rig, winding: Option<&Winding>) -> Result<Study, StudyError> {
    // First the mistakes that no key of the rig file corrects.
    columns(table)?;
    let (r, k) = nominal(rig)?;
    let rows = rows(table, k)?;
    let levels = levels(&table.name, &rows, r, k)?;
    let held: Vec<Level> = rows.held.iter().map(|row| level(&[row.forwards()], r, k)).collect();
    let explanations = explanations(&levels, &held, winding, (r, k));
    let named = trusted(&levels, &explanations);
    let friction = friction(&levels, torque_constant(&levels, &explanations[0], k));
    let outcome = outcome(&levels, &explanations, named, friction.as_ref(), rig);
    let coulomb_nm =
        friction.as_ref().filter(|friction| friction.is_needed()).map_or(0.0, |friction| friction.coulomb.value);
    let friction_a = friction.map(|friction| friction.currents_a);
    Ok(Study { outcome, levels, explanations, named, rows, nominal: (r, k), friction_a, coulomb_nm })
}

/// Resistance and torque constant.
pub fn nominal(rig: &Rig) -> Result<(f64, f64), StudyError> {
    rig.motor.resistance_ohm.zip(rig.motor.torque_constant_nm_per_a).ok_or(StudyError::NoNominal)
}

/// The constant from current to torque: the nominal one, unless loads show how far that is off.
fn torque_constant(levels: &[Level], best: &Explanation, nominal: f64) -> f64 {
    let found = best.constants.get("back_emf_constant_V_s").filter(|_| is_loaded(levels));
    found.map_or(nominal, |constant| constant.value)
}

/// Whether a brake was at the shaft.
pub fn is_loaded(levels: &[Level]) -> bool {
    levels.iter().any(|level| level.load_Nm > 0.0)
}

/// A row of a table.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Voltage at the bridge.
    pub u_v: f64,
    /// Armature current.
    pub i_a: f64,
    /// Speed of the shaft.
    pub omega_rad_per_s: f64,
    /// Torque of a brake.
    pub load_nm: f64,
}

impl Row {
    /// The same with a voltage above zero.
    fn forwards(self) -> Self {
        let sign = self.u_v.signum();
        let Self { u_v, i_a, omega_rad_per_s, load_nm } = self;
        Self { u_v: u_v * sign, i_a: i_a * sign, omega_rad_per_s: omega_rad_per_s * sign, load_nm: load_nm * sign }
    }
}

/// The usable rows of a table.
#[derive(Clone, Debug)]
pub struct Rows {
    /// The rotor turns.
    pub turning: Vec<Row>,
    /// The rotor is held or hardly turns, and a voltage drives a current.
    pub held: Vec<Row>,
}

impl Rows {
    /// Of a turning motor, either way.
    pub fn greatest_v(&self) -> f64 {
        self.turning.iter().map(|row| row.u_v.abs()).fold(0.0, f64::max)
    }
}

/// Whether a back-EMF says that the rotor is held or hardly turns.
pub fn hardly_turns(u_v: f64, emf_v: f64) -> bool {
    emf_v.abs() <= NEARLY_AT_REST * u_v.abs()
}

/// The usable rows of a table. `k`: the back-EMF constant that decides which rows turn.
///
/// # Errors
/// [`StudyError`], when a column is missing or has the wrong sign.
pub fn rows(table: &Recording, k: f64) -> Result<Rows, StudyError> {
    let (voltage, current, speed) = columns(table)?;
    signs::check(table, voltage, current, &speed)?;
    let load = table.get(Channel::LoadTorque).map_or_else(|| vec![0.0; voltage.len()], <[f64]>::to_vec);
    let row =
        |row: usize| Row { u_v: voltage[row], i_a: current[row], omega_rad_per_s: speed[row], load_nm: load[row] };
    let is_whole = |row: &Row| !(row.u_v + row.i_a + row.omega_rad_per_s + row.load_nm).is_nan();
    let (mut held, turning): (Vec<Row>, Vec<Row>) =
        (0..voltage.len()).map(row).filter(is_whole).partition(|row| hardly_turns(row.u_v, k * row.omega_rad_per_s));
    let greatest_v = held.iter().chain(&turning).map(|row| row.u_v.abs()).fold(0.0, f64::max);
    held.retain(|row| row.i_a != 0.0 && row.u_v.abs() > UNDRIVEN * greatest_v);
    Ok(Rows { turning, held })
}

/// Means of the readings at each voltage and load, with the quantities from the nominal constants. Both directions
/// count as one: their difference, from an offset of the current or from friction, is scatter of the mean.
pub fn levels(name: &str, rows: &Rows, r: f64, k: f64) -> Result<Vec<Level>, StudyError> {
    let greatest_v = rows.greatest_v();
    let mut groups: Vec<Vec<Row>> = Vec::new();
    for row in rows.turning.iter().map(|row| row.forwards()) {
        let of = |group: &Vec<Row>| same_level(group[0].u_v, row.u_v, greatest_v) && group[0].load_nm == row.load_nm;
        match groups.iter().position(of) {
            Some(group) => groups[group].push(row),
            None => groups.push(vec![row]),
        }
    }
    if groups.len() < FEWEST_LEVELS {
        return Err(StudyError::TooFew { name: name.into(), levels: groups.len() });
    }
    let mut levels: Vec<Level> = groups.iter().map(|group| level(group, r, k)).collect();
    levels.sort_by(|a, b| [a.u_V, a.load_Nm].partial_cmp(&[b.u_V, b.load_Nm]).expect("numbers"));
    set_errors(&mut levels, &groups, r, k);
    Ok(levels)
}

/// The scatter of the readings at all levels together: at a level of few readings it is mostly chance.
fn set_errors(levels: &mut [Level], groups: &[Vec<Row>], r: f64, k: f64) {
    let dof = groups.iter().map(|group| group.len() - 1).sum::<usize>();
    let scatter = |of: &dyn Fn(&Row) -> f64| {
        let squares = |group: &Vec<Row>| {
            let mean = mean(group, of);
            group.iter().map(|row| (of(row) - mean).powi(2)).sum::<f64>()
        };
        (groups.iter().map(squares).sum::<f64>() / dof as f64).sqrt()
    };
    let (current_a, missing_v) =
        (scatter(&|row| row.i_a), scatter(&|row| row.u_v - r * row.i_a - k * row.omega_rad_per_s));
    for level in levels {
        let share = if dof > 0 { ROUNDED } else { ONE_READING };
        let of_mean = |scatter: f64| if dof > 0 { scatter / (level.readings as f64).sqrt() } else { 0.0 };
        level.current_error = of_mean(current_a).max(share * level.i_A.abs());
        level.voltage_error = of_mean(missing_v).max(share * level.u_V);
    }
}

/// Voltage, current and speed.
type Columns<'a> = (&'a [f64], &'a [f64], Vec<f64>);

fn columns(table: &Recording) -> Result<Columns<'_>, StudyError> {
    let missing = || StudyError::Columns { name: table.name.clone(), ignored: table.ignored.clone() };
    let has = |channels: &[Channel]| channels.iter().any(|channel| table.get(*channel).is_some());
    let drive_and_speed = has(&[Channel::Voltage, Channel::Duty]) && has(&[Channel::Speed, Channel::Rpm]);
    if drive_and_speed && !has(&[Channel::Current]) {
        return Err(StudyError::NoCurrent(table.name.clone()));
    }
    let voltage = table.get(Channel::Voltage).ok_or_else(missing)?;
    let current = table.get(Channel::Current).ok_or_else(missing)?;
    let rpm = table.get(Channel::Rpm).map(|rpm| rpm.iter().map(|rpm| rpm * TAU / 60.0).collect::<Vec<_>>());
    let speed = table.get(Channel::Speed).map(<[f64]>::to_vec).or(rpm).ok_or_else(missing)?;
    Ok((voltage, current, speed))
}

/// Whether two voltages are one level of a table.
pub fn same_level(a_v: f64, b_v: f64, greatest_v: f64) -> bool {
    (a_v - b_v).abs() < SAME_LEVEL * greatest_v
}

fn mean(rows: &[Row], of: impl Fn(&Row) -> f64) -> f64 {
    rows.iter().map(of).sum::<f64>() / rows.len() as f64
}

/// Means of readings in one direction, without errors so far.
fn level(readings: &[Row], r: f64, k: f64) -> Level {
    let of = |of: fn(&Row) -> f64| mean(readings, of);
    let (u, i, w) = (of(|row| row.u_v), of(|row| row.i_a), of(|row| row.omega_rad_per_s));
    let emf = k * w;
    Level {
        u_V: u,
        load_Nm: readings[0].load_nm,
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
        current_error: 0.0,
        voltage_error: 0.0,
    }
}

/// Standard errors of a quantity at each level.
pub fn errors(levels: &[Level], of: impl Fn(&Level) -> f64) -> Errors {
    let each = levels.iter().map(of).collect();
    match levels.iter().any(|level| level.readings > 1) {
        true => Errors::AtLeast(each),
        false => Errors::InProportion(each),
    }
}

/// Torque balance beside the load: Coulomb and viscous friction, and the distance of the former from zero in standard
/// errors.
struct Friction {
    coulomb: Estimate,
    viscous: Estimate,
    sigmas: f64,
    gain: RmseGain,
    /// Residual of the torque at each level with both, and the distance of a curve in it from zero.
    left_nm: Vec<f64>,
    lacks_sigmas: f64,
    /// Current at each level with viscous friction alone, and with both.
    currents_a: [Vec<f64>; 2],
}

impl Friction {
    fn is_needed(&self) -> bool {
        self.sigmas > NEEDED_SIGMAS && self.coulomb.value > 0.0
    }

    fn cause(&self) -> Cause {
        Cause {
            effect: "coulomb_friction".into(),
            confidence: confidence(self.sigmas),
            parameters: BTreeMap::from([("torque_Nm".into(), self.coulomb)]),
            gain: BTreeMap::from([("i_A", self.gain)]),
            not_separable_from: vec!["current_offset"],
            evidence_sigmas: self.sigmas,
            runner_up: None,
        }
    }
}

fn friction(levels: &[Level], k: f64) -> Option<Friction> {
    let speed: Vec<f64> = levels.iter().map(|level| level.omega_rad_per_s).collect();
    let target: Vec<f64> = levels.iter().map(|level| k * level.i_A - level.load_Nm).collect();
    let errors = errors(levels, |level| k * level.current_error);
    let constant = vec![1.0; speed.len()];
    let both: [&[f64]; 2] = [&constant, &speed];
    let line = Line::new(&both, &target, &errors)?;
    let viscous = Line::new(&both[1..], &target, &errors)?;
    let current = |torque_nm: &dyn Fn(f64) -> f64| {
        levels.iter().map(|level| (torque_nm(level.omega_rad_per_s) + level.load_Nm) / k).collect()
    };
    Some(Friction {
        currents_a: [
            current(&|omega| viscous.values[0] * omega),
            current(&|omega| line.values[0] + line.values[1] * omega),
        ],
        coulomb: line.estimate(0),
        viscous: line.estimate(1),
        sigmas: line.sigmas(0, line.noise()),
        gain: RmseGain {
            rmse_before: rms(&left_out(&both[1..], &target, &errors)?) / k,
            rmse_after: rms(&left_out(&both, &target, &errors)?) / k,
        },
        left_nm: line.left(&both, &target),
        lacks_sigmas: curve_sigmas(levels, both, &target, &errors),
    })
}

/// The named explanation: the best, without terms that explain too little beside its unexplained rest.
fn trusted(levels: &[Level], explanations: &[Explanation]) -> usize {
    let best = &explanations[0];
    let mut named = best;
    while let Some(rest) = Rest::of_voltage(levels, named, best) {
        let less = named.terms.iter().map(|term| named.without(term, explanations));
        let weak = less.filter(|less| rest.outweighs(&gain(less, named)));
        let Some(less) = weak.min_by(|a, b| a.left_out_rmse_v.total_cmp(&b.left_out_rmse_v)) else { break };
        named = less;
    }
    explanations.iter().position(|one| one.terms == named.terms).expect("it is one of them")
}

/// Errors at a voltage left out, of one explanation and of a better one.
fn gain(before: &Explanation, after: &Explanation) -> RmseGain {
    RmseGain { rmse_before: before.left_out_rmse_v, rmse_after: after.left_out_rmse_v }
}

fn outcome(
    levels: &[Level],
    explanations: &[Explanation],
    named: usize,
    friction: Option<&Friction>,
    rig: &Rig,
) -> Outcome {
    let nominal = explanations.iter().find(|explanation| explanation.terms.is_empty()).expect("it is always tried");
    let (best, named) = (&explanations[0], &explanations[named]);
    let torque_rest = friction.and_then(|friction| Rest::of_torque(levels, friction));
    let mut causes: Vec<Cause> =
        (0..named.terms.len()).map(|index| voltage_cause(named, index, explanations)).collect();
    let is_trusted = |friction: &Friction| torque_rest.as_ref().is_none_or(|rest| !rest.outweighs(&friction.gain));
    causes.extend(friction.filter(|friction| friction.is_needed() && is_trusted(friction)).map(Friction::cause));
    let rests = Rest::of_voltage(levels, named, best).into_iter().chain(torque_rest);
    let unexplained = rests.reduce(Rest::greater).map(Rest::told);
    let verdict = match (causes.is_empty(), unexplained.is_some()) {
        (true, false) => Verdict::Sufficient,
        (true, true) => Verdict::Unexplained,
        (false, false) => Verdict::Explained,
        (false, true) => Verdict::PartlyExplained,
    };
    let advice = advice(levels, unexplained.as_ref());
    Outcome {
        axis: Axis::default(),
        verdict,
        causes,
        unexplained,
        determined: AllDetermined::new(),
        parameters: parameters(rig, named, friction),
        fit: fit(levels, nominal, named, friction),
        advice,
    }
}

fn voltage_cause(named: &Explanation, index: usize, explanations: &[Explanation]) -> Cause {
    let effect = named.terms[index];
    let not_separable_from = named.instead_of(effect, explanations);
    let term = TERMS.iter().find(|term| term.effect == effect).expect("one of them");
    Cause {
        effect: effect.into(),
        confidence: 1.0 / (1.0 + not_separable_from.len() as f64),
        parameters: BTreeMap::from([(term.constant.to_string(), named.constants[term.constant])]),
        gain: BTreeMap::from([("u_V", gain(named.without(effect, explanations), named))]),
        not_separable_from,
        evidence_sigmas: named.sigmas[index],
        runner_up: named.next_best(effect, explanations).map(|(effect, other)| RunnerUp {
            effect,
            worse_by_sigmas: other.lacks_sigmas,
            worse_by_share: (other.left_out_rmse_v / named.left_out_rmse_v).powi(2) - 1.0,
        }),
    }
}

fn parameters(rig: &Rig, best: &Explanation, friction: Option<&Friction>) -> BTreeMap<&'static str, Parameter> {
    let mut found = BTreeMap::new();
    let mut add = |name, nominal: Option<f64>, estimate: Option<&Estimate>| {
        let value = estimate.map(|estimate| estimate.value).or(nominal);
        if let Some(value) = value {
            let interval = estimate.and_then(|estimate| estimate.ci95);
            let scale = if interval.is_some() { ScaleOrigin::Measured } else { ScaleOrigin::Nominal };
            found.insert(name, Parameter { nominal, value, ci95: interval.unwrap_or([value, value]), scale });
        }
    };
    add("resistance_ohm", rig.motor.resistance_ohm, best.constants.get("resistance_ohm"));
    add("torque_constant_Nm_per_A", rig.motor.torque_constant_nm_per_a, best.constants.get("back_emf_constant_V_s"));
    let viscous = friction.map(|friction| &friction.viscous);
    add("viscous_friction_Nm_s", rig.motor.viscous_friction_nm_s, viscous);
    found
}

fn fit(
    levels: &[Level],
    nominal: &Explanation,
    best: &Explanation,
    friction: Option<&Friction>,
) -> BTreeMap<&'static str, BTreeMap<&'static str, Quality>> {
    let spread = |of: &dyn Fn(&Level) -> f64| {
        let mean = levels.iter().map(of).sum::<f64>() / levels.len() as f64;
        (levels.iter().map(|level| (of(level) - mean).powi(2)).sum::<f64>() / levels.len() as f64).sqrt()
    };
    let quality =
        |rmse: f64, unit, spread: f64| Quality { rmse, ci95: None, unit, fit_percent: 100.0 * (1.0 - rmse / spread) };
    let volts = spread(&|level| level.u_V);
    let amperes = spread(&|level| level.i_A);
    let rms = |of: fn(&Level) -> f64| rms(&levels.iter().map(of).collect::<Vec<_>>());
    let current_floor = rms(|level| level.current_error);
    let voltage_floor = rms(|level| level.voltage_error);
    let of = |u: f64, i: f64| BTreeMap::from([("u_V", quality(u, "V", volts)), ("i_A", quality(i, "A", amperes))]);
    let none = RmseGain { rmse_before: f64::NAN, rmse_after: f64::NAN };
    let current = friction.map_or(none, |friction| friction.gain);
    BTreeMap::from([
        ("base", of(nominal.left_out_rmse_v, current.rmse_before)),
        ("extended", of(best.left_out_rmse_v, current.rmse_after)),
        ("noise_floor", of(voltage_floor, current_floor)),
    ])
}

fn advice(levels: &[Level], unexplained: Option<&Unexplained>) -> Vec<String> {
    let least_a = levels.iter().map(|level| level.i_A).fold(f64::INFINITY, f64::min);
    let most_a = levels.iter().map(|level| level.i_A).fold(0.0, f64::max);
    let mut advice: Vec<String> = unexplained
        .map(|rest| {
            format!(
                "An effect outside the catalogue is missing: {}. Until it is explained, the constants are approximate.",
                rest.place()
            )
        })
        .into_iter()
        .collect();
    if most_a < 2.0 * least_a {
        advice.push(format!(
            "The current only goes from {} to {} A. That cannot separate a resistance from a constant voltage drop, nor a back-EMF constant from a resistance that grows with speed. Hold the rotor and step the voltage to measure resistance and drop. Or brake the shaft at one speed: the slope of the voltage over the current is the resistance.",
            short(least_a), short(most_a)
        ));
    }
    advice.push(
        "Turn the shaft from outside and measure the voltage of the open terminals. It gives the back-EMF constant, and at a known speed the scale of the tachogenerator. These points cannot separate the two.".into(),
    );
    advice.push(
        "(P_in - P_out) / I^2 is the resistance only if nothing else takes voltage. It also contains the drop divided by the current, and the back-EMF constant's error times the speed, divided by the current.".into(),
    );
    advice
}

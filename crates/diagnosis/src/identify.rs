//! Identification by output error: finds the constants with which the free-running model comes closest to the
//! measurement.
//!
//! Every measured quantity is weighted by its noise. Held-out data ([`Dataset::held_out`]) are not used, but the time
//! of a load step is read from all data. Nominal values are priors with the spread of a data sheet
//! ([`NOMINAL_SPREAD`]); they matter only where the data contain little. The method is that of Levenberg and Marquardt
//! on finite differences. Intervals come from the covariance that holds for residuals correlated within a block
//! (sandwich; White, Econometrica 50 (1982)).

use crate::dataset::{Dataset, greatest};
use crate::free_run::{Motion, Prediction, Replay, Steps, drive, nudged, read};
pub use fits::Fits;
use maybe_rayon::prelude::*;
use motorbench_data::rig::{Bridge, NominalMotor};
use motorbench_model::catalogue::{Alone, Balance, CATALOGUE, Effect, Parameter, Scales, VOLTAGE_DROP};
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Drive, Model, Term};
use nalgebra::{DMatrix, DVector};
use search::Search;
use sensitivities::Sensitivities;
pub use speed_window::with_window_settled;
use std::sync::OnceLock;
pub use torque_scale::{is_unknown as has_unknown_torque_scale, scales_all as scales_all_torques};
pub use uncertainty::{Derived, Uncertainty};

mod fits;
mod search;
mod sensitivities;
mod speed_window;
mod torque_scale;
mod uncertainty;

/// Standard deviation of the logarithm of a nominal value.
pub const NOMINAL_SPREAD: f64 = 0.2;
/// The same for a value estimated from the data's extremes alone.
const GUESS_SPREAD: f64 = 1.5;
/// The same for the scale of all resistances, if no current was measured and no nominal value is given.
const SCALE_SPREAD: f64 = 2.5;
/// A nominal viscous friction is little more than an order of magnitude.
const FRICTION_SPREAD: f64 = 1.0;
/// Standard deviation of a bridge's drop that the rig file gives.
pub const GIVEN_DROP_SPREAD_V: f64 = 0.3;
/// Residuals further apart than this count as independent. Of several block lengths the one with the widest interval
/// counts. Longer blocks include model errors that belong to one manner of driving.
const BLOCKS_S: [f64; 2] = [0.2, 2.0];
/// Relative error (one standard deviation) of the motor's constants from the model's simplifications other than its
/// steps, such as readings at an instant. It was measured on benches with known constants. Effects add theirs, see
/// [`motorbench_model::catalogue::Simplification`].
const SYSTEMATIC: f64 = 7e-4;
/// The same for an effect's constants if the PWM frequency was assumed: it comes from a list, and the shaft is assumed
/// to turn evenly within its period.
const GUESSED_PWM: f64 = 3e-3;
/// An expected gain below this, in units of noise, is not worth a fit.
pub const LEAST_PROMISE: f64 = 20.0;
/// The starts of this many most promising effects are refined, by this many halvings.
const REFINED: usize = 8;
const REFINEMENTS: u8 = 6;
/// ... or, with this share of the best expected gain, moved to a better neighbour at most this often.
const WORTH_A_WALK: f64 = 0.1;
const MOST_NEIGHBOURS: usize = 8;
/// Of many starts of an effect that responds linearly, so many are simulated whole: the best by its linear response.
const SCREENED: usize = 3;
/// A constant that selects another law at zero is limited to this share of its start.
const LEAST_OF_START: f64 = 0.01;
/// A process longer than this many recordings cannot be told from a constant contribution.
const SLOWEST: f64 = 5.0;
/// Steps that locate the time of an event.
const LOCATING: usize = 16;
/// Electromechanical and electromagnetic time constant of a small motor, for a start without nominal values.
const USUAL_TIME_CONSTANTS_S: (f64, f64) = (0.05, 0.001);

/// The prior of the motor.
#[derive(Clone, Debug)]
pub struct Prior {
    /// Most plausible values.
    pub motor: MotorParameters,
    /// Standard deviations: of the logarithms of R, L, k and J, and of b in its own unit.
    pub spread: [f64; 5],
    /// What the rig file gave.
    pub nominal: NominalMotor,
    /// The bridge's drop by the rig file, where the data can show one.
    pub bridge_drop_v: Option<f64>,
}

impl Prior {
    /// From nominal values, and from the extremes of the data where there are none.
    pub fn new(nominal: &NominalMotor, data: &Dataset) -> Self {
        match data.axis.drive {
            Drive::Voltage => Self::behind_a_voltage(nominal, data),
            Drive::Current | Drive::Torque => Self::behind_an_imposed_current(nominal, data),
        }
    }

    fn behind_a_voltage(nominal: &NominalMotor, data: &Dataset) -> Self {
        let voltage_v = greatest(&data.command);
        let speed = greatest(&data.motion().values).max(1e-9);
        let k = nominal.torque_constant_nm_per_a.unwrap_or(0.9 * voltage_v / speed);
        let peak_a = data.current().map(|current| greatest(&current.values));
        let r = nominal.resistance_ohm.unwrap_or_else(|| voltage_v / peak_a.unwrap_or(1.0).max(1e-6));
        let (mechanical_s, electrical_s) = USUAL_TIME_CONSTANTS_S;
        let motor = MotorParameters {
            resistance_ohm: r,
            inductance_h: nominal.inductance_h.unwrap_or(electrical_s * r),
            torque_constant_nm_per_a: k,
            inertia_kg_m2: nominal.inertia_kg_m2.unwrap_or(mechanical_s * k * k / r),
            viscous_friction_nm_s: nominal.viscous_friction_nm_s.unwrap_or(0.02 * k * k / r),
        };
        let spread = |given: Option<f64>| if given.is_some() { NOMINAL_SPREAD } else { GUESS_SPREAD };
        // Derived from the resistance, which without a current is an estimate itself.
        let is_scale_known = peak_a.is_some() || nominal.resistance_ohm.is_some();
        let of_scale = if is_scale_known { 0.0 } else { SCALE_SPREAD };
        let scaled = |given: Option<f64>| spread(given).hypot(if given.is_some() { 0.0 } else { of_scale });
        let friction = if nominal.viscous_friction_nm_s.is_some() { FRICTION_SPREAD } else { 10.0 };
        Self {
            motor,
            spread: [
                scaled(nominal.resistance_ohm),
                scaled(nominal.inductance_h),
                spread(nominal.torque_constant_nm_per_a),
                scaled(nominal.inertia_kg_m2),
                friction * motor.viscous_friction_nm_s.max(0.005 * k * k / r),
            ],
            nominal: *nominal,
            bridge_drop_v: None,
        }
    }

    /// Without a winding: the constants of one are there for the form's sake, and no fit moves them. Without a torque constant
    /// all torques are in amperes, and nominal values in newton metres say nothing.
    fn behind_an_imposed_current(nominal: &NominalMotor, data: &Dataset) -> Self {
        let k = nominal.torque_constant_nm_per_a.filter(|_| data.axis.drive.has_constant(TORQUE_CONSTANT));
        let is_in_amperes = data.axis.drive == Drive::Current && k.is_none();
        let nominal = if is_in_amperes { &NominalMotor::default() } else { nominal };
        let torque_nm = k.unwrap_or(1.0) * greatest(&data.command).max(f64::MIN_POSITIVE);
        let speed = greatest(&data.motion().values).max(1e-9);
        let motor = MotorParameters {
            resistance_ohm: 1.0,
            inductance_h: 1.0,
            torque_constant_nm_per_a: k.unwrap_or(1.0),
            inertia_kg_m2: nominal.inertia_kg_m2.unwrap_or(USUAL_TIME_CONSTANTS_S.0 * torque_nm / speed),
            viscous_friction_nm_s: nominal.viscous_friction_nm_s.unwrap_or(0.02 * torque_nm / speed),
        };
        let inertia = if nominal.inertia_kg_m2.is_some() { NOMINAL_SPREAD } else { GUESS_SPREAD };
        let friction = if nominal.viscous_friction_nm_s.is_some() { FRICTION_SPREAD } else { 10.0 };
        let least = 0.005 * torque_nm / speed;
        Self {
            motor,
            spread: [
                NOMINAL_SPREAD,
                NOMINAL_SPREAD,
                NOMINAL_SPREAD,
                inertia,
                friction * motor.viscous_friction_nm_s.max(least),
            ],
            nominal: NominalMotor {
                torque_constant_nm_per_a: k,
                inertia_kg_m2: nominal.inertia_kg_m2,
                viscous_friction_nm_s: nominal.viscous_friction_nm_s,
                ..NominalMotor::default()
            },
            bridge_drop_v: None,
        }
    }

    /// The same with a bridge by its data sheet.
    pub fn with_bridge(self, bridge: &Bridge, data: &Dataset) -> Self {
        let can_show_one = data.axis.drive.is_voltage() && !data.has_one_magnitude();
        Self { bridge_drop_v: bridge.drop_v.filter(|_| can_show_one), ..self }
    }
}

/// Sizes for the starting values of effects.
pub fn scales(motor: &MotorParameters, data: &Dataset) -> Scales {
    let (drive, command) = (data.axis.drive, greatest(&data.command));
    let voltage_v = if drive.is_voltage() { command } else { 0.0 };
    let speed_rad_per_s = greatest(&data.motion().values);
    let computed_a = if drive.is_voltage() { voltage_v / motor.resistance_ohm } else { command };
    Scales {
        drive,
        motor: *motor,
        voltage_v,
        speed_rad_per_s,
        supply_v: greatest(&data.supply_v),
        current_a: data.current().map_or(computed_a, |current| greatest(&current.values)),
        // From the longest recording: each has its own time.
        duration_s: greatest(&data.time_s),
        interval_s: data.interval_s,
        pwm_hz: data.origin.pwm_hz,
    }
}

/// Half an interval of 95 % in standard errors.
pub const Z95: f64 = 1.96;

/// Places of [`motor_values`].
const TORQUE_CONSTANT: usize = 2;
const INERTIA: usize = 3;
const VISCOUS_FRICTION: usize = 4;

/// The place of a fitted number in the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Constant of the linear motor: R, L, k, J, b.
    Motor(usize),
    /// Constant of an effect: term and position.
    Term(usize, usize),
}

impl Place {
    /// Whether it changes the motion of the motor, and not only its readings.
    fn changes_motion(self, model: &Model) -> bool {
        match self {
            Self::Motor(_) => true,
            Self::Term(term, _) => model.terms[term].effect.changes_motion(),
        }
    }
}

/// A simulation that others are compared with.
struct Base<'a> {
    replay: &'a Replay<'a>,
    steps: Steps,
    motion: Motion,
    residual: Vec<f64>,
}

impl<'a> Base<'a> {
    fn new(model: &Model, replay: &'a Replay<'a>, steps: Steps) -> Self {
        let motion = replay.drive(model, steps);
        let residual = weighted_residual(replay.data, &read(model, replay.data, motion.clone()));
        Self { replay, steps, motion, residual }
    }

    /// Difference of the weighted residual of another model; `motion`: whether its motor moves differently.
    fn change(&self, other: &Model, motion: bool) -> Vec<f64> {
        let prediction = match motion {
            true => read(other, self.replay.data, self.replay.drive(other, self.steps)),
            false => read(other, self.replay.data, self.motion.clone()),
        };
        self.change_to(&prediction)
    }

    /// The same by the linear motor's response to the torque and the voltage that an effect adds, to the first order.
    fn change_by_linear_response(&self, model: &Model, effect: &dyn Effect, values: &[f64]) -> Vec<f64> {
        let data = self.replay.data;
        let motion = nudged(model, data, &self.motion, |at| {
            let mut terms = Balance::default();
            effect.contribute(values, &model.motor, at, &mut [], &mut terms);
            terms
        });
        self.change_to(&read(model, data, motion))
    }

    fn change_to(&self, prediction: &Prediction) -> Vec<f64> {
        let mut change = weighted_residual(self.replay.data, prediction);
        change.iter_mut().zip(&self.residual).for_each(|(there, here)| *there -= here);
        change
    }
}

/// A number that a fit can change.
#[derive(Clone, Debug)]
struct Unknown {
    place: Place,
    /// Changed as its logarithm.
    logarithmic: bool,
    /// Size in which steps are measured (1 for logarithms).
    size: f64,
    min: f64,
    max: f64,
    /// Mean and standard deviation of the prior of its coordinate, if there is one.
    prior: Option<(f64, f64)>,
}

impl Unknown {
    fn get(&self, model: &Model) -> f64 {
        let value = match self.place {
            Place::Motor(index) => motor_values(&model.motor)[index],
            Place::Term(term, index) => model.terms[term].values[index],
        };
        if self.logarithmic { value.ln() } else { value / self.size }
    }

    fn set(&self, model: &mut Model, coordinate: f64) {
        let value = if self.logarithmic { coordinate.exp() } else { coordinate * self.size };
        let value = value.clamp(self.min, self.max);
        match self.place {
            Place::Motor(index) => *motor_value(&mut model.motor, index) = value,
            Place::Term(term, index) => model.terms[term].values[index] = value,
        }
    }
}

fn motor_values(motor: &MotorParameters) -> [f64; 5] {
    motor.named().map(|(_, value)| value)
}

fn motor_value(motor: &mut MotorParameters, index: usize) -> &mut f64 {
    match index {
        0 => &mut motor.resistance_ohm,
        1 => &mut motor.inductance_h,
        2 => &mut motor.torque_constant_nm_per_a,
        3 => &mut motor.inertia_kg_m2,
        _ => &mut motor.viscous_friction_nm_s,
    }
}

/// A fitted constant and its interval.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    /// Which.
    pub place: Place,
    /// Most plausible value.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// Limits of a fit's duration.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Largest number of steps.
    pub steps: usize,
    /// It ends when a step gains less than this share of the cost.
    pub least_gain: f64,
    /// Step size of the simulations for the sensitivities.
    pub sensitivities: Steps,
    /// Whether it may end on sensitivities that were corrected after a step instead of simulated: much faster, but it
    /// sometimes stops early.
    pub is_a_look: bool,
    /// The fit is given up if the remaining steps, each with the better gain of the last two, would not reach this
    /// cost.
    pub useless_above: f64,
}

impl Effort {
    /// Its starting point, with its sensitivities.
    pub const NONE: Self = Self {
        steps: 0,
        least_gain: 0.0,
        sensitivities: Steps::Coarse,
        is_a_look: false,
        useless_above: f64::INFINITY,
    };
    /// For a first look at an effect.
    pub const TRIAL: Self = Self { steps: 12, least_gain: 5e-3, is_a_look: true, ..Self::NONE };
    /// For judging another model by its rest.
    pub const CHECK: Self = Self { steps: 8, is_a_look: false, ..Self::TRIAL };
    /// For a model that was fitted to other parts of the same data.
    pub const AGAIN: Self = Self { steps: 30, least_gain: 5e-4, ..Self::NONE };
    /// Until convergence.
    pub const FULL: Self = Self { steps: 30, least_gain: 1e-5, sensitivities: Steps::Fine, ..Self::NONE };

    /// The same for a fit that is useless above a cost.
    pub fn useless_above(self, cost: f64) -> Self {
        Self { useless_above: cost, ..self }
    }
}

/// A fitted model.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model.
    pub model: Model,
    /// Its prediction of the data.
    pub prediction: Prediction,
    /// Sum of squares of the weighted residuals that were used, and of the prior.
    pub cost: f64,
    unknowns: Vec<Unknown>,
    /// Weighted residuals, zero for held-out data.
    residual: Vec<f64>,
    /// Step size of the simulations for the sensitivities.
    steps: Steps,
    /// Whether it ended because it could not reach [`Effort::useless_above`].
    is_given_up: bool,
    /// The sensitivities and the inverse of their normal matrix, computed when needed.
    sensitivities: OnceLock<(Sensitivities, DMatrix<f64>)>,
}

/// Fits a model from its present constants.
///
/// The time of an event (the only constants with a [`spacing`](motorbench_model::catalogue::Search::spacing)) is read
/// from all the data: if it lies in a held-out stretch, the other data do not contain it.
pub fn fit(start: &Model, data: &Dataset, prior: &Prior, effort: Effort) -> Fit {
    fit_in(&Replay::new(data), start, prior, effort)
}

/// The same where the command has been cut into steps already.
fn fit_in(replay: &Replay, start: &Model, prior: &Prior, effort: Effort) -> Fit {
    let scales = scales(&start.motor, replay.data);
    let located = start.terms.iter().enumerate().find_map(|(term, Term { effect, .. })| {
        let (index, spacing) = effect.spacing(&scales)?;
        Some(located(start, replay, term, index, spacing))
    });
    Search::new(located.as_ref().unwrap_or(start), replay, prior).run(effort)
}

/// The model with the constant, within half a spacing, at which the sum of all squares is least, held-out data
/// included.
fn located(model: &Model, replay: &Replay, term: usize, index: usize, spacing: f64) -> Model {
    let cost = |value: f64| {
        let mut moved = model.clone();
        moved.terms[term].values[index] = value;
        let prediction = replay.free_run(&moved);
        let squares = replay.data.measured.iter().zip(&prediction).flat_map(|(measured, predicted)| {
            measured
                .values
                .iter()
                .zip(predicted)
                .map(move |(value, predicted)| ((value - predicted) / measured.least_error(measured.noise)).powi(2))
        });
        squares.filter(|square| square.is_finite()).sum::<f64>()
    };
    let mut best = model.terms[term].values[index];
    let mut least = cost(best);
    let mut distance = 0.5 * spacing;
    for _ in 0..LOCATING {
        for value in [best - distance, best + distance].into_iter().filter(|value| *value > 0.6 * spacing) {
            let here = cost(value);
            if here < least {
                (best, least) = (value, here);
            }
        }
        distance *= 0.6;
    }
    let mut found = model.clone();
    found.terms[term].values[index] = best;
    found
}

/// Distance of the starts of an event's time; `None` if the constant is no such time.
fn spacing_of(effect: &dyn Effect, index: usize, scales: &Scales) -> Option<f64> {
    effect.spacing(scales).filter(|(place, _)| *place == index).map(|(_, spacing)| spacing)
}

/// An event lies within the recording, not at its ends.
fn event_bounds(effect: &dyn Effect, index: usize, scales: &Scales) -> Option<(f64, f64)> {
    let spacing = spacing_of(effect, index, scales)?;
    Some((0.6 * spacing, scales.duration_s - 0.6 * spacing))
}

/// Limits of a constant in a fit: those of a recording of this length, and those within which its law stays the same. A
/// recording shorter than the lower limit cannot determine it.
fn bounds(term: &Term, index: usize, scales: &Scales) -> (f64, f64) {
    let Parameter { min, max, slow, default, most_of_speed, .. } = term.effect.about().parameters[index];
    let longest = if slow { SLOWEST * scales.duration_s } else { f64::INFINITY };
    // 0 would be another law.
    let nearest = LEAST_OF_START * term.values[index];
    let (min, max) = match default {
        // One with a sign passes zero.
        Some(0.0) if min == 0.0 => (nearest, max),
        _ => (min, max),
    };
    let fastest = most_of_speed * scales.no_load_rad_per_s();
    event_bounds(term.effect, index, scales).unwrap_or((min, max.min(longest).min(fastest).max(min)))
}

fn unknowns(model: &Model, data: &Dataset, prior: &Prior) -> Vec<Unknown> {
    let expected = motor_values(&prior.motor);
    let motor = (0..5).filter(|index| is_fitted(*index, data)).map(|index| {
        let logarithmic = index < 4;
        let mean = if logarithmic { expected[index].ln() } else { expected[index] / prior.spread[index] };
        Unknown {
            place: Place::Motor(index),
            logarithmic,
            size: if logarithmic { 1.0 } else { prior.spread[index] },
            min: if logarithmic { f64::MIN_POSITIVE } else { 0.0 },
            max: f64::INFINITY,
            prior: Some((mean, if logarithmic { prior.spread[index] } else { 1.0 })),
        }
    });
    motor.chain(unknowns_of_terms(model, data, prior.bridge_drop_v, |term| !model.holds(term))).collect()
}

/// Whether the data can say anything of a constant of the motor. Without a known load, the torque constant only scales all
/// torques of an imposed current.
fn is_fitted(index: usize, data: &Dataset) -> bool {
    data.axis.drive.has_constant(index) && !(index == TORQUE_CONSTANT && scales_all_torques(data))
}

/// The constants of the chosen terms that a fit can move. A drop that the rig file gives is known to its tolerance.
fn unknowns_of_terms(
    model: &Model,
    data: &Dataset,
    bridge_drop_v: Option<f64>,
    chosen: impl Fn(&Term) -> bool,
) -> Vec<Unknown> {
    let scales = scales(&model.motor, data);
    let chosen = model.terms.iter().enumerate().filter(|(_, term)| chosen(term));
    let unknowns = chosen.flat_map(|(term_index, term)| {
        let typical = term.effect.starts(&scales).into_iter().next().unwrap_or_default();
        let parameters = term.effect.about().parameters.iter().enumerate();
        let parameters = parameters.filter(|(index, parameter)| parameter.moves(term.values[*index]));
        parameters
            .map(|(index, parameter)| {
                let (min, max) = bounds(term, index, &scales);
                // A time was located on all data; the data that the fit uses may not contain it.
                let spacing = spacing_of(term.effect, index, &scales);
                let known_to = parameter.known.map_or(0.0, |(_, spread)| spread);
                let magnitude = term.values[index].abs().max(0.3 * typical[index].abs()).max(known_to).max(1e-12);
                let size = spacing.unwrap_or(magnitude);
                let given = bridge_drop_v.filter(|_| term.id() == VOLTAGE_DROP && index == 0);
                let given = given.map(|drop_v| (drop_v, GIVEN_DROP_SPREAD_V));
                let known = spacing.map(|_| (term.values[index], data.interval_s)).or(given).or(parameter.known);
                Unknown {
                    place: Place::Term(term_index, index),
                    logarithmic: false,
                    size,
                    min,
                    max,
                    prior: known.map(|(mean, spread)| (mean / size, spread / size)),
                }
            })
            .collect::<Vec<_>>()
    });
    unknowns.collect()
}

fn prior_cost(model: &Model, unknowns: &[Unknown]) -> f64 {
    let deviation = |unknown: &Unknown| unknown.prior.map(|(mean, spread)| (unknown.get(model) - mean) / spread);
    unknowns.iter().filter_map(deviation).map(|deviation| deviation * deviation).sum()
}

/// Residuals over noise, with the sign such that their derivative is that of the prediction; zero for missing and
/// held-out data.
fn weighted_residual(data: &Dataset, prediction: &Prediction) -> Vec<f64> {
    let mut residual = Vec::with_capacity(data.len() * data.measured.len());
    for (measured, predicted) in data.measured.iter().zip(prediction) {
        let weight = 1.0 / measured.least_error(measured.noise);
        for ((value, predicted), held_out) in measured.values.iter().zip(predicted).zip(&data.held_out) {
            let difference = (predicted - value) * weight;
            residual.push(if *held_out || difference.is_nan() { 0.0 } else { difference });
        }
    }
    residual
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four sums, so that the additions need not wait for each other.
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a4.zip(b4) {
        for index in 0..4 {
            sums[index] += a[index] * b[index];
        }
    }
    sums.iter().sum::<f64>() + rest
}

fn square(values: &[f64]) -> f64 {
    dot(values, values)
}

/// Expected gain of adding an effect, from the first derivatives alone.
#[derive(Clone, Debug)]
pub struct Promise {
    /// Index in [`CATALOGUE`].
    pub effect: usize,
    /// Starting values of the fit.
    pub start: Vec<f64>,
    /// The next best start, since the best by expected gain may not be the nearest.
    pub other_starts: Vec<Vec<f64>>,
    /// Expected fall of the cost.
    pub gain: f64,
}

impl Promise {
    /// Its best start belongs to another effect.
    fn improve(&mut self, better: Self) {
        (self.start, self.gain) = (better.start, better.gain);
    }
}

/// The change of the residual in each direction of an effect's constants from `start`.
fn lines(effect: &dyn Effect, start: &[f64], change: impl Fn(Vec<f64>) -> Vec<f64>) -> Vec<Vec<f64>> {
    let without = |constant: usize| {
        let mut values = start.to_vec();
        values[constant] = 0.0;
        values
    };
    match effect.about().linear_in {
        2 => vec![change(without(1)), change(without(0))],
        _ => vec![change(start.to_vec())],
    }
}

impl Fit {
    /// Weighted sensitivities of the seen residuals and the inverse of their normal matrix.
    fn sensitivities(&self, data: &Dataset) -> &(Sensitivities, DMatrix<f64>) {
        self.sensitivities.get_or_init(|| {
            let found = Sensitivities::simulated(&self.model, &Replay::new(data), &self.unknowns, self.steps);
            let inverse = found.inverse();
            (found, inverse)
        })
    }

    /// Expected gain of each effect outside the model (score test; Rao 1948), with its best start, best first.
    pub fn promises(&self, replay: &Replay, scales: &Scales, excluded: &[&str]) -> Vec<Promise> {
        let base = Base::new(&self.model, replay, Steps::Coarse);
        // Computed before the threads start: otherwise they would wait for each other.
        self.sensitivities(replay.data);
        let candidates: Vec<(usize, Vec<f64>)> = CATALOGUE
            .iter()
            .enumerate()
            .filter(|(_, effect)| !self.model.has(effect.about().id) && !excluded.contains(&effect.about().id))
            .filter(|(_, effect)| self.model.alone(**effect) != Some(Alone::Never))
            .flat_map(|(index, effect)| {
                let starts = self.screened(&base, *effect, effect.starts(scales));
                starts.into_iter().map(move |start| (index, start))
            })
            .collect();
        let mut all: Vec<Promise> =
            candidates.into_par_iter().map(|(effect, start)| self.promise(&base, effect, start)).collect();
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut best: Vec<Promise> = Vec::new();
        for promise in all {
            match best.iter_mut().find(|other| other.effect == promise.effect) {
                None => best.push(promise),
                Some(other) => {
                    if 1 + other.other_starts.len() < CATALOGUE[other.effect].starts_fitted(scales) {
                        other.other_starts.push(promise.start);
                    }
                }
            }
        }
        best.truncate(REFINED);
        let least = LEAST_PROMISE.max(WORTH_A_WALK * best.first().map_or(0.0, |promise| promise.gain));
        let mut best: Vec<Promise> =
            best.into_par_iter().map(|promise| self.refined(&base, scales, promise, least)).collect();
        best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        best
    }

    /// The starts of an effect that are worth a simulation.
    fn screened(&self, base: &Base, effect: &dyn Effect, starts: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if !effect.about().responds_linearly || starts.len() <= SCREENED {
            return starts;
        }
        let promised = starts.into_par_iter().map(|start| {
            let change = |values: Vec<f64>| base.change_by_linear_response(&self.model, effect, &values);
            let (gain, _) = self.least_squares(base.replay.data, &lines(effect, &start, change));
            (gain, start)
        });
        let mut promised: Vec<(f64, Vec<f64>)> = promised.collect();
        promised.sort_by(|a, b| b.0.total_cmp(&a.0));
        promised.into_iter().take(SCREENED).map(|(_, start)| start).collect()
    }

    /// A better start near the best of the catalogue's.
    fn refined(&self, base: &Base, scales: &Scales, promise: Promise, worth_a_walk: f64) -> Promise {
        match CATALOGUE[promise.effect].spacing(scales) {
            Some((index, spacing)) => self.between(base, promise, index, spacing),
            None if promise.gain > worth_a_walk => self.uphill(base, promise),
            None => promise,
        }
    }

    /// Halves the distance between the alternatives of a nonlinear constant repeatedly around the best.
    fn between(&self, base: &Base, mut promise: Promise, index: usize, spacing: f64) -> Promise {
        for round in 1..=REFINEMENTS {
            let distance = spacing / f64::from(1 << round);
            for side in [-distance, distance] {
                let mut start = promise.start.clone();
                start[index] += side;
                let other = self.promise(base, promise.effect, start);
                if other.gain > promise.gain {
                    promise.improve(other);
                }
            }
        }
        promise
    }

    /// Moves to a neighbour while it promises more.
    fn uphill(&self, base: &Base, mut promise: Promise) -> Promise {
        for _ in 0..MOST_NEIGHBOURS {
            let neighbours = CATALOGUE[promise.effect].neighbours(&promise.start).into_par_iter();
            let others = neighbours.map(|start| self.promise(base, promise.effect, start));
            match others.max_by(|a, b| a.gain.total_cmp(&b.gain)) {
                Some(better) if better.gain > promise.gain => promise.improve(better),
                _ => break,
            }
        }
        promise
    }

    fn promise(&self, base: &Base, index: usize, start: Vec<f64>) -> Promise {
        let effect = CATALOGUE[index];
        let about = effect.about();
        let change = |values| base.change(&self.model.with(effect, values), effect.changes_motion());
        let lines = lines(effect, &start, change);
        let (gain, factors) = self.least_squares(base.replay.data, &lines);
        // The derivative at zero of an effect without a sign does not hold for negative values.
        let signed = about.parameters[0].min < 0.0;
        let possible = about.linear_in == 2 || factors[0] > 0.0 || signed && about.linear_in == 1;
        let mut start = start;
        for (value, factor) in start.iter_mut().zip(&factors).take(about.linear_in) {
            let magnitude = factor.abs().clamp(0.05, 10.0);
            *value *= magnitude * if signed { factor.signum() } else { 1.0 };
        }
        // If the effect is not linear, the whole step is evaluated, not the best multiple of it.
        let gain = match about.linear_in {
            0 => gain.min(self.gain_of_whole(&lines[0]).max(0.25 * gain)),
            _ => gain,
        };
        Promise { effect: index, start, other_starts: Vec::new(), gain: if possible { gain } else { 0.0 } }
    }

    fn gain_of_whole(&self, line: &[f64]) -> f64 {
        -2.0 * dot(line, &self.residual) - square(line)
    }

    /// Best combination of new columns beside the model's own: gain and factors.
    fn least_squares(&self, data: &Dataset, lines: &[Vec<f64>]) -> (f64, Vec<f64>) {
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        let along =
            |line: &[f64]| DVector::from_iterator(columns.len(), columns.iter().map(|column| dot(column, line)));
        let own: Vec<DVector<f64>> = lines.iter().map(|line| along(line)).collect();
        let pull = along(&self.residual);
        let size = lines.len();
        let mut normal = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        for row in 0..size {
            for column in 0..size {
                normal[(row, column)] =
                    dot(&lines[row], &lines[column]) - (own[row].transpose() * inverse * &own[column])[0];
            }
            normal[(row, row)] += 1e-9 * square(&lines[row]) + f64::MIN_POSITIVE;
            gradient[row] = dot(&lines[row], &self.residual) - (own[row].transpose() * inverse * &pull)[0];
        }
        let Some(factors) = normal.clone().cholesky().map(|cholesky| -cholesky.solve(&gradient)) else {
            return (0.0, vec![0.0; size]);
        };
        (-gradient.dot(&factors), factors.iter().copied().collect())
    }

    /// By how much the cost would fall if an effect with these constants were in the data: what the model's own constants
    /// and their priors cannot take of it.
    pub fn would_gain(&self, data: &Dataset, effect: &'static dyn Effect, values: Vec<f64>) -> f64 {
        let replay = Replay::new(data);
        let base = Base::new(&self.model, &replay, Steps::Coarse);
        let line = base.change(&self.model.with(effect, values), effect.changes_motion());
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        let along = DVector::from_iterator(columns.len(), columns.iter().map(|column| dot(column, &line)));
        square(&line) - (along.transpose() * inverse * &along)[0]
    }

    /// Residuals of one measured quantity, measured minus simulated, missing ones as NaN.
    pub fn residual_of(&self, data: &Dataset, output: usize) -> Vec<f64> {
        data.measured[output].values.iter().zip(&self.prediction[output]).map(|(y, p)| y - p).collect()
    }

    /// Number of residuals, less what their correlation within the shorter blocks takes.
    pub fn independent_residuals(&self, data: &Dataset) -> f64 {
        let block = (BLOCKS_S[0] / data.interval_s).max(1.0) as usize;
        let blocks = self.residual.chunks(data.len()).flat_map(|output| output.chunks(block));
        let of_sums: f64 = blocks.map(|block| block.iter().sum::<f64>().powi(2)).sum();
        let correlation = of_sums / square(&self.residual).max(f64::MIN_POSITIVE);
        self.used() as f64 / correlation.max(1.0)
    }

    /// Number of residuals that it used.
    pub fn used(&self) -> usize {
        self.residual.iter().filter(|residual| **residual != 0.0).count()
    }

    /// Whether a fitted constant of a term is at the end of its range, where its law becomes another one or makes no
    /// sense.
    pub fn is_at_a_bound(&self, term: usize) -> bool {
        let at_a_bound = |unknown: &Unknown| {
            let value = unknown.get(&self.model) * unknown.size;
            matches!(unknown.place, Place::Term(of, _) if of == term) && (value <= unknown.min || value >= unknown.max)
        };
        self.unknowns.iter().any(at_a_bound)
    }

    /// Covariance of the coordinates that holds for residuals correlated within a block.
    fn covariance(&self, data: &Dataset, block_s: f64) -> DMatrix<f64> {
        let block = (block_s / data.interval_s).max(1.0) as usize;
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        let size = columns.len();
        let mut middle = DMatrix::zeros(size, size);
        let samples = data.len();
        for start in (0..samples).step_by(block) {
            let gradient = DVector::from_iterator(
                size,
                columns.iter().map(|column| {
                    (0..data.measured.len())
                        .map(|output| {
                            let range = output * samples + start..output * samples + (start + block).min(samples);
                            dot(&column[range.clone()], &self.residual[range])
                        })
                        .sum::<f64>()
                }),
            );
            middle += &gradient * gradient.transpose();
        }
        for (index, unknown) in self.unknowns.iter().enumerate() {
            middle[(index, index)] += unknown.prior.map_or(0.0, |(_, spread)| 1.0 / (spread * spread));
        }
        inverse * middle * inverse
    }

    /// Shift of each coordinate with steps twice as long: the order of the error from the steps.
    fn shift_of_coarse_steps(&self, data: &Dataset) -> DVector<f64> {
        let coarse = weighted_residual(data, &read(&self.model, data, drive(&self.model, data, Steps::Coarse)));
        let change: Vec<f64> = coarse.iter().zip(&self.residual).map(|(coarse, fine)| coarse - fine).collect();
        let (Sensitivities { columns, .. }, inverse) = self.sensitivities(data);
        inverse * DVector::from_iterator(columns.len(), columns.iter().map(|column| dot(column, &change)))
    }

    /// Relative error of a constant from the model's simplifications.
    fn simplified(&self, place: Place, data: &Dataset) -> f64 {
        let of_the_pwm = if data.origin.pwm_is_known { 0.0 } else { GUESSED_PWM };
        let terms = self.model.terms.iter().map(|term| term.effect.simplification());
        match place {
            Place::Motor(INERTIA) => terms.map(|law| law.inertia).fold(SYSTEMATIC, f64::hypot),
            Place::Motor(VISCOUS_FRICTION) => terms.map(|law| law.viscous_friction).fold(SYSTEMATIC, f64::hypot),
            Place::Motor(_) => SYSTEMATIC,
            Place::Term(term, _) => self.model.terms[term].effect.simplification().own.hypot(of_the_pwm),
        }
    }

    /// How many constants it has moved.
    pub fn moved(&self) -> usize {
        self.unknowns.len()
    }

    /// The same with the constants that the model holds at their prior means among the unknown ones: then the uncertainty
    /// contains what they leave open. They come last.
    pub fn with_held_open(&self, data: &Dataset) -> Self {
        let held = unknowns_of_terms(&self.model, data, None, |term| self.model.holds(term));
        if held.is_empty() {
            return self.clone();
        }
        Self { unknowns: [&self.unknowns[..], &held].concat(), sensitivities: OnceLock::new(), ..self.clone() }
    }
}

//! The numbers that a fit moves: where they stand in the model, their scale, their limits and their priors.

use super::{GIVEN_DROP_SPREAD_V, Prior, scales, scales_all_torques};
use crate::configuration::identify::unknowns::{LEAST_OF_START, SLOWEST};
use crate::dataset::Dataset;
use motorbench_model::catalogue::{Effect, Parameter, Scales, VOLTAGE_DROP};
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Model, Term};

/// Places of [`motor_values`].
pub(super) const TORQUE_CONSTANT: usize = 2;
pub(super) const INERTIA: usize = 3;
pub(super) const VISCOUS_FRICTION: usize = 4;

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
    pub(super) fn changes_motion(self, model: &Model) -> bool {
        match self {
            Self::Motor(_) => true,
            Self::Term(term, _) => model.terms[term].effect.changes_motion(),
        }
    }

    /// The same place in another model, if that has the same term.
    pub(super) fn in_another(self, model: &Model, other: &Model) -> Option<Self> {
        let Self::Term(term, index) = self else { return Some(self) };
        let Term { effect, values } = &model.terms[term];
        let id = effect.about().id;
        let term = other.terms.iter().position(|other| other.id() == id && other.values == *values)?;
        Some(Self::Term(term, index))
    }
}

/// A number that a fit can change.
#[derive(Clone, Debug)]
pub(super) struct Unknown {
    pub place: Place,
    /// Changed as its logarithm.
    pub logarithmic: bool,
    /// Size in which steps are measured (1 for logarithms).
    pub size: f64,
    pub min: f64,
    pub max: f64,
    /// Mean and standard deviation of the prior of its coordinate, if there is one.
    pub prior: Option<(f64, f64)>,
    /// What the prior weighs beside the squares of the residuals, see [`Prior::weight`].
    pub weight: f64,
}

impl Unknown {
    pub fn get(&self, model: &Model) -> f64 {
        let value = match self.place {
            Place::Motor(index) => motor_values(&model.motor)[index],
            Place::Term(term, index) => model.terms[term].values[index],
        };
        if self.logarithmic { value.ln() } else { value / self.size }
    }

    /// Distance from the prior's mean.
    fn deviation(&self, model: &Model) -> f64 {
        self.prior.map_or(0.0, |(mean, _)| self.get(model) - mean)
    }

    /// Half the second derivative of the prior's cost.
    pub fn stiffness(&self) -> f64 {
        self.prior.map_or(0.0, |(_, spread)| self.weight / (spread * spread))
    }

    /// Half the first derivative of the prior's cost.
    pub fn pull(&self, model: &Model) -> f64 {
        self.stiffness() * self.deviation(model)
    }

    pub fn set(&self, model: &mut Model, coordinate: f64) {
        let value = if self.logarithmic { coordinate.exp() } else { coordinate * self.size };
        let value = value.clamp(self.min, self.max);
        match self.place {
            Place::Motor(index) => *motor_value(&mut model.motor, index) = value,
            Place::Term(term, index) => model.terms[term].values[index] = value,
        }
    }
}

pub(super) fn motor_values(motor: &MotorParameters) -> [f64; 5] {
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

/// Distance of the starts of an event's time; `None` if the constant is no such time.
pub(super) fn spacing_of(effect: &dyn Effect, index: usize, scales: &Scales) -> Option<f64> {
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

pub(super) fn unknowns(model: &Model, data: &Dataset, prior: &Prior) -> Vec<Unknown> {
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
            weight: prior.weight,
        }
    });
    let chosen = |term: &Term| !model.holds(term);
    motor.chain(unknowns_of_terms(model, data, prior.bridge_drop_v, prior.weight, chosen)).collect()
}

/// Whether the data can say anything of a constant of the motor. Without a known load, the torque constant only scales all
/// torques of an imposed current.
fn is_fitted(index: usize, data: &Dataset) -> bool {
    data.axis.drive.has_constant(index) && !(index == TORQUE_CONSTANT && scales_all_torques(data))
}

/// The constants of the chosen terms that a fit can move. A drop that the rig file gives is known to its tolerance.
pub(super) fn unknowns_of_terms(
    model: &Model,
    data: &Dataset,
    bridge_drop_v: Option<f64>,
    weight: f64,
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
                    weight,
                }
            })
            .collect::<Vec<_>>()
    });
    unknowns.collect()
}

pub(super) fn prior_cost(model: &Model, unknowns: &[Unknown]) -> f64 {
    unknowns.iter().map(|unknown| unknown.pull(model) * unknown.deviation(model)).sum()
}

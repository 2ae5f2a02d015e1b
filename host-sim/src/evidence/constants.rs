//! The constants of a candidate: how a fit moves them and what is known of them before.

use super::settings::Settings;
use crate::catalogue::{Scales, USUAL};
use crate::identify::{Place, Prior};
use crate::model::Model;
use crate::motor::MotorParameters;

/// A process that takes longer than so many recordings cannot be told from what is always there.
const SLOWEST: f64 = 5.0;

/// A number that a fit moves.
#[derive(Clone, Debug)]
pub struct Constant {
    /// Which.
    pub place: Place,
    /// Moved as its logarithm, or in this unit.
    pub unit: Option<f64>,
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
    /// Mean and standard deviation of its coordinate before the recording.
    pub prior: (f64, f64),
}

impl Constant {
    /// Coordinate of a value.
    pub fn coordinate(&self, value: f64) -> f64 {
        self.unit.map_or_else(|| value.max(f64::MIN_POSITIVE).ln(), |unit| value / unit)
    }

    /// Value at a coordinate, within its bounds.
    pub fn value(&self, coordinate: f64) -> f64 {
        let value = self.unit.map_or_else(|| coordinate.exp(), |unit| coordinate * unit);
        value.clamp(self.min, self.max)
    }

    /// Its coordinate in a model.
    pub fn get(&self, model: &Model) -> f64 {
        self.coordinate(match self.place {
            Place::Motor(index) => motor_values(&model.motor)[index],
            Place::Term(term, index) => model.terms[term].values[index],
        })
    }

    /// Sets it in a model.
    pub fn set(&self, model: &mut Model, coordinate: f64) {
        let value = self.value(coordinate);
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

/// All that a fit of a model moves.
pub fn constants(model: &Model, prior: &Prior, scales: &Scales, set: &Settings) -> Vec<Constant> {
    let expected = motor_values(&prior.motor);
    let nominal = prior.nominal.values();
    let [r, _, k, ..] = expected;
    let viscous_spread = set.viscous_share * k * k / r;
    let spread = |index: usize| match nominal[index] {
        Some(_) => set.nominal_spread[index],
        None if index == 2 => set.back_emf_spread,
        None => prior.spread[index],
    };
    let motor = (0..5).map(|index| {
        let is_friction = index == 4;
        Constant {
            place: Place::Motor(index),
            unit: is_friction.then_some(viscous_spread),
            min: if is_friction { 0.0 } else { f64::MIN_POSITIVE },
            max: f64::INFINITY,
            prior: match is_friction {
                true => (nominal[index].unwrap_or(0.0) / viscous_spread, 1.0),
                false => (expected[index].ln(), spread(index)),
            },
        }
    });
    let mut all: Vec<Constant> = motor.collect();
    for (term_index, term) in model.terms.iter().enumerate().filter(|(_, term)| !model.holds(term)) {
        let about = term.effect.about();
        let start = term.effect.starts(scales).into_iter().next().unwrap_or_default();
        for (index, parameter) in about.parameters.iter().enumerate() {
            if !parameter.moves(term.values[index]) {
                continue;
            }
            let spacing = term.effect.spacing(scales).filter(|(place, _)| *place == index).map(|(_, spacing)| spacing);
            let longest = if parameter.slow { SLOWEST * scales.duration_s } else { f64::INFINITY };
            let fastest = parameter.most_of_speed * scales.no_load_rad_per_s();
            let (mut min, mut max) = (parameter.min, parameter.max.min(longest).min(fastest).max(parameter.min));
            let place = Place::Term(term_index, index);
            let usual = start.get(index).copied().unwrap_or(0.0).abs().max(0.3 * term.values[index].abs()).max(1e-12);
            let is_strength = index < about.linear_in;
            let is_delay = term.effect.delay_s(&term.values) > 0.0;
            let (unit, prior) = if term.effect.is_observation() {
                // Any share of a period is as probable as another.
                let spread = 1.0 / 12_f64.sqrt();
                let period = if is_delay { 1.0 / scales.pwm_hz } else { 1.0 };
                (Some(period), (if is_delay { 0.5 } else { term.values[index] }, spread))
            } else if is_delay {
                (Some(scales.interval_s), (0.0, set.delay_spread_s / scales.interval_s))
            } else if let Some(spacing) = spacing {
                (min, max) = (0.6 * spacing, scales.duration_s - 0.6 * spacing);
                (Some(spacing), (0.5 * scales.duration_s / spacing, scales.duration_s / 12_f64.sqrt() / spacing))
            } else if let Some((mean, spread)) = parameter.known {
                (Some(spread), (mean / spread, 1.0))
            } else if is_strength || parameter.min < 0.0 {
                (Some(usual), (0.0, set.strength_spread))
            } else {
                min = min.max(1e-3 * usual);
                (None, (term.values[index].max(1e-3 * usual).ln(), set.constant_spread))
            };
            all.push(Constant { place, unit, min, max, prior });
        }
    }
    all
}

/// Logarithm of the prior odds of a model's effects.
pub fn log_odds(model: &Model, set: &Settings) -> f64 {
    let is_usual = |id: &str| USUAL.contains(&id) || id == "actuation_delay";
    let odds = model.terms.iter().filter(|term| !term.effect.is_observation()).map(|term| {
        let alternatives = if term.effect.about().parameters.iter().any(|parameter| parameter.is_number()) {
            set.numbers_tried.ln()
        } else {
            0.0
        };
        (if is_usual(term.id()) { set.usual_odds } else { set.other_odds }) - alternatives
    });
    odds.sum()
}

//! The lack of a torque or a voltage in the motor.

use super::axis::{Axis, coordinate, rows};
use super::{Bin, Case};
use crate::configuration::evidence::FINER;
use crate::configuration::evidence::forces::{MOST_ROWS, NUDGE, PRIOR, SMALL_CURRENT};
use crate::free_run::{nudged, read};
use motorbench_model::catalogue::{Balance, Coordinate, Instant, Strength};
use motorbench_model::motor::MotorParameters;
use motorbench_model::pwm_period::{Ripple, against};
use motorbench_model::{Model, Term};
use nalgebra::{DMatrix, DVector};

/// A torque and a voltage.
#[derive(Clone, Copy, Debug, Default)]
struct Force {
    torque_nm: f64,
    voltage_v: f64,
}

/// A row with what the law adds there, and what a unit of the strength would add.
struct Place {
    coordinate: f64,
    law: Force,
    unit: Force,
}

pub(super) fn binned(case: &Case) -> Option<(Vec<Bin>, Vec<[f64; 2]>)> {
    let places = places(case);
    let at = || places.iter().flatten();
    let axis = Axis::of(case.term, at().map(|place| place.coordinate))?;
    let law = means(&places, &axis);
    let strength = law.iter().flatten().map(|(_, law)| law.abs()).fold(0.0, f64::max);
    if strength == 0.0 {
        return None;
    }
    let off = differences(case, &axis, strength)?;
    let bins = law.iter().zip(off).filter_map(|(law, (off, deviation))| {
        let (at, law) = (*law)?;
        Some(Bin { at, lack: law + off, deviation, law })
    });
    let drawn = means(&places, &axis.finer(FINER));
    let drawn = drawn.into_iter().flatten().map(|(at, value)| [at, value]).collect();
    Some((bins.collect(), drawn))
}

/// Of each row; nothing for one that says nothing of the law.
fn places(case: &Case) -> Vec<Option<Place>> {
    let Case { model, data, motion, term, .. } = case;
    let over = term.effect.about().shown.over;
    let (mut with, mut without) = (Losses::of(model, None), Losses::of(model, Some(term.id())));
    let ripple = Ripple::new(model.motor.inductance_h, model.motor.resistance_ohm, data.origin.pwm_hz);
    let mut places: Vec<Option<Place>> = std::iter::repeat_with(|| None).take(data.len()).collect();
    let mut next = 0;
    for row in rows(data) {
        let at = motion.instant(data, row);
        if row != next {
            (with, without) = (Losses::of(model, None), Losses::of(model, Some(term.id())));
        }
        next = row + 1;
        let middle = Instant { turned_rad: 0.0, ..at };
        let [all, others] = [&mut with, &mut without].map(|losses| losses.force(&model.motor, &middle, ripple));
        if counts(case, &at) {
            let law =
                Force { torque_nm: all.torque_nm - others.torque_nm, voltage_v: all.voltage_v - others.voltage_v };
            let unit = unit(term.effect.about().shown.as_a, &model.motor, &at);
            places[row] = Some(Place { coordinate: coordinate(over, &at), law, unit });
        }
    }
    places
}

/// Whether a row says anything of the law: friction at rest takes what comes, and a drop in pulses depends on the pulses.
fn counts(case: &Case, at: &Instant) -> bool {
    let shown = case.term.effect.about().shown;
    let is_of_torque = matches!(shown.as_a, Strength::Torque | Strength::Friction);
    let turns = !is_of_torque || at.speed_rad_per_s != 0.0;
    let flows = is_of_torque || !at.open && at.current_a.abs() > SMALL_CURRENT * greatest_a(case);
    turns && flows
}

fn greatest_a(case: &Case) -> f64 {
    case.data.supply_v.first().map_or(0.0, |supply_v| supply_v / case.model.motor.resistance_ohm)
}

/// What one unit of a strength adds.
fn unit(strength: Strength, motor: &MotorParameters, at: &Instant) -> Force {
    let (torque, voltage) =
        (|torque_nm| Force { torque_nm, voltage_v: 0.0 }, |voltage_v| Force { torque_nm: 0.0, voltage_v });
    let percent = 0.01 * motor.torque_constant_nm_per_a;
    match strength {
        Strength::Friction => torque(-at.speed_rad_per_s.signum()),
        Strength::TorqueConstant => {
            Force { torque_nm: percent * at.current_a, voltage_v: -percent * at.speed_rad_per_s }
        }
        Strength::Voltage => voltage(1.0),
        Strength::SupplyVoltage => voltage(-at.duty.abs()),
        Strength::Resistance => voltage(-at.current_a),
        _ => torque(1.0),
    }
}

/// Mean of coordinate and law in each bin; the law in units of its strength.
fn means(places: &[Option<Place>], axis: &Axis) -> Vec<Option<(f64, f64)>> {
    let mut sums = vec![[0.0; 4]; axis.len()];
    for place in places.iter().flatten() {
        let Some(bin) = axis.bin(place.coordinate) else { continue };
        let (unit, law) = match place.unit.torque_nm {
            0.0 => (place.unit.voltage_v, place.law.voltage_v),
            torque_nm => (torque_nm, place.law.torque_nm),
        };
        for (sum, value) in sums[bin].iter_mut().zip([1.0, place.coordinate, unit * law, unit * unit]) {
            *sum += value;
        }
    }
    let mean = |[count, at, law, units]: [f64; 4]| (units > 0.0).then(|| (at / count, law / units));
    sums.into_iter().map(mean).collect()
}

/// By how much the strength differs from the law in each bin, with standard deviations: a fit of the motor's responses to
/// the residual.
fn differences(case: &Case, axis: &Axis, strength: f64) -> Option<Vec<(f64, f64)>> {
    let Case { model, data, motion, predicted, term } = case;
    let shown = term.effect.about().shown;
    let is_angle = shown.over == Coordinate::Angle;
    let nudge = NUDGE * strength;
    let response = |bin: usize| {
        let added = |at: &Instant| {
            // Within such a row the shaft passes through several bins.
            let passes = is_angle && at.turned_rad.abs() > axis.first_width();
            let is_within = !passes && counts(case, at) && axis.bin(coordinate(shown.over, at)) == Some(bin);
            let unit = if is_within { unit(shown.as_a, &model.motor, at) } else { Force::default() };
            Balance { torque_nm: nudge * unit.torque_nm, voltage_v: nudge * unit.voltage_v, ..Balance::default() }
        };
        read(model, data, nudged(model, data, motion, added))
    };
    let residuals = crate::diagnose::residuals(data, &predicted.to_vec());
    let stride = data.len().div_ceil(MOST_ROWS);
    let weights: Vec<f64> = residuals.iter().map(|values| 1.0 / rms(values).max(f64::MIN_POSITIVE)).collect();
    let kept: Vec<(usize, usize)> = (0..residuals.len())
        .flat_map(|output| (0..data.len()).step_by(stride).map(move |row| (output, row)))
        .filter(|(output, row)| residuals[*output][*row].is_finite())
        .collect();
    let mut responses = DMatrix::<f64>::zeros(kept.len(), axis.len());
    for bin in 0..axis.len() {
        let nudged = response(bin);
        for (place, (output, row)) in kept.iter().enumerate() {
            let by = (nudged[*output][*row] - predicted[*output][*row]) / nudge;
            responses[(place, bin)] = if by.is_finite() { weights[*output] * by } else { 0.0 };
        }
    }
    let left = DVector::from_iterator(
        kept.len(),
        kept.iter().map(|(output, row)| weights[*output] * residuals[*output][*row]),
    );
    let mut normal = responses.tr_mul(&responses);
    for bin in 0..axis.len() {
        normal[(bin, bin)] += (PRIOR * strength).powi(-2);
    }
    let factors = normal.cholesky()?;
    let off = factors.solve(&responses.tr_mul(&left));
    let covariance = factors.inverse();
    Some((0..axis.len()).map(|bin| (off[bin], covariance[(bin, bin)].sqrt())).collect())
}

fn rms(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|value| value.is_finite());
    (finite().map(|value| value * value).sum::<f64>() / finite().count().max(1) as f64).sqrt()
}

/// The terms of a model with their memories.
struct Losses<'a> {
    terms: Vec<(&'a Term, Vec<f64>)>,
}

impl<'a> Losses<'a> {
    /// Without one of them. What hits or swings within a row adds nothing to the difference.
    fn of(model: &'a Model, left_out: Option<&str>) -> Self {
        let is_smooth = |term: &Term| term.effect.longest_step_s() == f64::INFINITY && Some(term.id()) != left_out;
        let terms = model.in_turn(|effect| effect.acts_on_motor()).into_iter().filter(|term| is_smooth(term));
        Self { terms: terms.map(|term| (term, term.effect.begins(0.0))).collect() }
    }

    /// What they add at an instant; their memories go on over its step.
    fn force(&mut self, motor: &MotorParameters, at: &Instant, ripple: Ripple) -> Force {
        let ripple = ripple.with_duty(at.duty);
        let mut sum = Balance { ripple: &ripple, ..Balance::default() };
        for (term, memory) in &mut self.terms {
            term.effect.contribute(&term.values, motor, at, memory, &mut sum);
        }
        for (term, memory) in &mut self.terms {
            if !memory.is_empty() {
                term.effect.advance(&term.values, motor, at, memory);
            }
        }
        let (speed, current_a) = (at.speed_rad_per_s, at.current_a);
        let dry_nm = if speed > 0.0 { -sum.dry_forward_nm } else { sum.dry_backward_nm };
        let share = if sum.drops_with_the_mean() { (current_a.abs() / sum.knee_a).tanh() } else { 1.0 };
        let drop_v = share * against(current_a, sum.ripple.mean_drops_v(sum.drops()));
        Force {
            torque_nm: sum.torque_nm - sum.viscous_nm_s * speed + dry_nm,
            voltage_v: sum.voltage_v - sum.resistance_ohm * current_a - drop_v,
        }
    }
}

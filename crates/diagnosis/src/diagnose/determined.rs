//! What a recording determines by itself: gain, time constants, dead band and delay of the motor as the voltage sees it.
//!
//! Ohms, newton metres and kilogram square metres need a scale besides, which a measured current gives, or the rig file.
//! These quantities do not. A quantity is determined if the data narrow it to less than half of what was known before.

use super::outcome::ScaleOrigin;
use crate::configuration::diagnose::determined::{MOST_OF_PRIOR, MOVED_BY_A_CONSTANT, PWM_FULL};
use crate::dataset::{Dataset, greatest};
use crate::identify::{Derived, Uncertainty, Z95, has_unknown_torque_scale, scales_all_torques};
use motorbench_data::rig::NominalMotor;
use motorbench_model::linear::motor_model::{TimeConstants, speed};
use motorbench_model::motor::MotorParameters;
use motorbench_model::unit::{Quantity::Current as CurrentScale, Unit};
use motorbench_model::{Direction, Drive, Model};
use serde::Serialize;
use std::collections::BTreeMap;

/// A quantity that the data determine.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Determined {
    /// Most plausible value.
    pub value: f64,
    /// Interval that contains the true value in 95 of 100 recordings.
    pub ci95: [f64; 2],
    /// Unit of both.
    pub unit: &'static str,
}

/// Quantities by their names in the JSON.
pub type AllDetermined = BTreeMap<&'static str, Determined>;

/// A quantity that may be determined.
struct Quantity {
    name: &'static str,
    unit: &'static str,
    /// A constant of this unit is as uncertain besides the fit.
    scale: Unit,
    /// Its error is a share of its value.
    is_relative: bool,
    of: Of,
}

type Of = fn(&Model, &Dataset) -> f64;

const fn relative(name: &'static str, unit: &'static str, scale: Unit, of: Of) -> Quantity {
    Quantity { name, unit, scale, is_relative: true, of }
}

const fn voltage(name: &'static str, of: Of) -> Quantity {
    Quantity { name, unit: "V", scale: Unit::Volt, is_relative: false, of }
}

/// No bridge and no scale makes it more uncertain than the fit says.
const fn dry(name: &'static str, unit: &'static str, of: Of) -> Quantity {
    Quantity { name, unit, scale: Unit::One, is_relative: false, of }
}

const QUANTITIES: [Quantity; 11] = [
    relative("gain_rad_per_s_per_V", "rad/s/V", Unit::RadianPerSecondPerVolt, |model, _| gain(&model.motor)),
    relative("time_constant_s", "s", Unit::Second, |model, _| time_constant_s(&model.motor)),
    // What makes the inductance uncertain makes this.
    relative("electrical_time_constant_s", "s", Unit::Henry, |model, _| {
        TimeConstants::of(&model.motor).electromagnetic_s
    }),
    voltage("dead_band_forward_V", |model, data| model.dead_band_v(Direction::Forward, supply_v(data))),
    voltage("dead_band_reverse_V", |model, data| model.dead_band_v(Direction::Reverse, supply_v(data))),
    voltage("breakaway_V", |model, data| either_way(|way| model.breakaway_v(way, supply_v(data)))),
    voltage("turning_V", |model, data| either_way(|way| model.turning_v(way, supply_v(data)))),
    DELAY,
    voltage("kS", |model, data| {
        0.5 * Direction::BOTH.map(|way| model.dead_band_v(way, supply_v(data))).into_iter().sum::<f64>()
    }),
    relative("kV", "V s/rad", Unit::VoltSecondPerRadian, |model, _| 1.0 / gain(&model.motor)),
    relative("kA", "V s^2/rad", Unit::VoltSecond2PerRadian, |model, _| {
        time_constant_s(&model.motor) / gain(&model.motor)
    }),
];

/// What an imposed current determines: torques over the torque constant.
const OF_A_CURRENT: [Quantity; 6] = [
    relative("time_constant_s", "s", Unit::Second, |model, _| shaft_time_constant_s(&model.motor)),
    dry("friction_forward_A", "A", |model, _| {
        model.dry_losses().friction_forward_nm / model.motor.torque_constant_nm_per_a
    }),
    dry("friction_reverse_A", "A", |model, _| {
        model.dry_losses().friction_reverse_nm / model.motor.torque_constant_nm_per_a
    }),
    relative("viscous_A_s_per_rad", "A s/rad", Unit::One, |model, _| {
        model.motor.viscous_friction_nm_s / model.motor.torque_constant_nm_per_a
    }),
    relative("acceleration_A_s2_per_rad", "A s^2/rad", Unit::One, |model, _| {
        model.motor.inertia_kg_m2 / model.motor.torque_constant_nm_per_a
    }),
    DELAY,
];

/// What an imposed torque determines besides the constants themselves.
const OF_A_TORQUE: [Quantity; 4] = [
    relative("time_constant_s", "s", Unit::Second, |model, _| shaft_time_constant_s(&model.motor)),
    dry("friction_forward_Nm", "Nm", |model, _| model.dry_losses().friction_forward_nm),
    dry("friction_reverse_Nm", "Nm", |model, _| model.dry_losses().friction_reverse_nm),
    DELAY,
];

const DELAY: Quantity =
    Quantity { name: "delay_s", unit: "s", scale: Unit::Second, is_relative: false, of: |model, _| model.delay_s() };

/// Of the speed, where no winding brakes it.
fn shaft_time_constant_s(motor: &MotorParameters) -> f64 {
    motor.inertia_kg_m2 / motor.viscous_friction_nm_s.max(f64::MIN_POSITIVE)
}

/// Steady speed per volt beyond the dead band.
fn gain(motor: &MotorParameters) -> f64 {
    speed(motor).dc_gain()
}

/// Of the speed, with the viscous friction, without the inductance.
fn time_constant_s(motor: &MotorParameters) -> f64 {
    motor.inertia_kg_m2 * motor.resistance_ohm / motor.torque_constant_nm_per_a * gain(motor)
}

fn supply_v(data: &Dataset) -> f64 {
    greatest(&data.supply_v)
}

/// The larger one of both directions.
fn either_way(volts: impl Fn(Direction) -> f64) -> f64 {
    Direction::BOTH.map(volts).into_iter().fold(0.0, f64::max)
}

impl Quantity {
    fn interval(&self, derived: &Derived) -> [f64; 2] {
        let half = Z95 * derived.deviation;
        if self.is_relative {
            [-half, half].map(|off| derived.value * (off / derived.value).exp())
        } else {
            // A load that drives makes a dead band negative; nothing else does.
            let least = if derived.value < 0.0 { f64::NEG_INFINITY } else { 0.0 };
            [(derived.value - half).max(least), derived.value + half]
        }
    }
}

/// Whether the data say more of it than was known before.
fn is_determined(derived: &Derived) -> bool {
    derived.deviation < MOST_OF_PRIOR * derived.prior_deviation
}

/// Where the scales of R, L, k, J and b come from: without a measured current or a known load the data only know their
/// ratios.
pub fn scales(uncertainty: &Uncertainty, data: &Dataset, nominal: &NominalMotor) -> [ScaleOrigin; 5] {
    let given = nominal.values();
    let of_current = |index: usize| CurrentScale.power(MotorParameters::UNITS[index]) != 0.0;
    let is_any_given = (0..5).any(|index| of_current(index) && given[index].is_some());
    std::array::from_fn(|index| {
        if scales_all_torques(data) {
            let is_given = nominal.torque_constant_nm_per_a.is_some();
            return if is_given { ScaleOrigin::Nominal } else { ScaleOrigin::Unknown };
        }
        let is_unknown = has_unknown_torque_scale(data) && of_current(index);
        let is_narrowed = is_determined(&uncertainty.of(|model| model.motor.named()[index].1));
        match (is_unknown, is_narrowed) {
            (false, true) => ScaleOrigin::Measured,
            (true, _) if is_any_given => ScaleOrigin::Nominal,
            (false, false) if given[index].is_some() => ScaleOrigin::Nominal,
            _ => ScaleOrigin::Unknown,
        }
    })
}

/// What the data of a fit determine. `widened` adds what is uncertain besides the fit: to the interval of a value of this
/// unit.
pub fn determined(
    uncertainty: &Uncertainty,
    data: &Dataset,
    widened: impl Fn(Unit, f64, [f64; 2]) -> [f64; 2],
) -> AllDetermined {
    let found = |quantity: &Quantity| {
        let derived = uncertainty.of(|model| (quantity.of)(model, data));
        let ci95 = widened(quantity.scale, derived.value, quantity.interval(&derived));
        let is_moved = quantity.is_relative || derived.deviation > MOVED_BY_A_CONSTANT;
        (is_moved && is_determined(&derived))
            .then_some((quantity.name, Determined { value: derived.value, ci95, unit: quantity.unit }))
    };
    let quantities: &[Quantity] = match data.axis.drive {
        Drive::Voltage => &QUANTITIES,
        Drive::Current => &OF_A_CURRENT,
        Drive::Torque => &OF_A_TORQUE,
    };
    quantities.iter().filter_map(found).collect()
}

/// What a person needs to know to drive it: the least voltages, also as a PWM value of 8 bits.
pub fn to_start(all: &AllDetermined, data: &Dataset) -> Option<String> {
    let [least, turning_v] = [all.get("breakaway_V")?.value, all.get("turning_V")?.value];
    (turning_v > 0.0).then(|| {
        format!(
            "It needs {least:.1} V (PWM {:.0} of 255) to start, {turning_v:.1} V to keep turning.",
            (PWM_FULL * least / supply_v(data)).ceil()
        )
    })
}

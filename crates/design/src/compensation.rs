//! The core's compensation of friction and bridge drop, and its gain near standstill.

use super::law::{ControlLaw, setting_name};
use super::tachogenerator::Tachogenerator;
use host_sim::trial::Trial;
use motorbench_core::message::Trip;
use motorbench_core::settings::{BuildError, Param, Settings};
use motorbench_model::Model;
use motorbench_model::catalogue::{DryLosses, effect};
use motorbench_model::linear::motor_model;
use motorbench_model::motor::MotorParameters;
use serde::Serialize;

/// The linear motor with these losses.
pub fn model_of(losses: &DryLosses, motor: &MotorParameters) -> Model {
    let mean_nm = 0.5 * (losses.friction_forward_nm + losses.friction_reverse_nm);
    let terms = [
        ("coulomb_friction", mean_nm),
        ("friction_asymmetry", losses.friction_forward_nm - losses.friction_reverse_nm),
        ("voltage_drop", losses.bridge_drop_v),
    ];
    let known = |id| effect(id).expect("an effect of the catalogue");
    let there = terms.into_iter().filter(|(_, value)| *value != 0.0);
    there.fold(Model::linear(*motor), |model, (id, value)| model.with(known(id), vec![value]))
}

/// Slow motion about standstill: part of the no-load speed (or a revolution), time of the profile, time in each
/// direction, repetitions.
const SLOW_SPEED_PART: f64 = 0.03;
const SLOW_TURN_RAD: f64 = 0.6;
const SLOW_S: f64 = 0.25;
const SLOW_WAY_S: f64 = 0.6;
const SLOW_WAYS: usize = 4;

/// Simulated tracking error near standstill, which the compensation reduces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Standstill {
    /// Which law.
    pub law: ControlLaw,
    /// Amplitude of the reference, in rad/s or rad.
    pub reference: f64,
    /// Root mean square error in rad/s or rad without the compensation; `null`: a trip came.
    pub without: Option<f64>,
    /// The same with compensation.
    pub with: Option<f64>,
}

impl Standstill {
    /// The comparison as text.
    pub fn text(&self) -> String {
        let unit = if self.law.is_position() { "rad" } else { "rad/s" };
        let number = |value: Option<f64>| value.map_or("a trip".into(), |value| format!("{value:.3} {unit}"));
        format!(
            "tracking error of the {} between +-{:.3} {unit}:\n    {} without compensation, {} with it\n",
            self.law.title(),
            self.reference,
            number(self.without),
            number(self.with)
        )
    }
}

/// Simulates the core with a model whose losses are compensated, while it follows a slow reference about standstill. It
/// compares the settings as they are with the same settings without compensation. If a tachogenerator measures the
/// speed, its ripple is included.
///
/// # Errors
/// A setting the core cannot hold.
pub fn near_standstill(
    model: &Model,
    settings: &Settings,
    law: ControlLaw,
    tachogenerator: Option<&Tachogenerator>,
) -> Result<Standstill, BuildError> {
    let no_load = f64::from(settings.get(Param::SupplyVoltage)) * motor_model::speed(&model.motor).dc_gain();
    let (reference, acceleration) = if law.is_position() {
        (SLOW_TURN_RAD, SLOW_TURN_RAD / SLOW_S.powi(2))
    } else {
        (SLOW_SPEED_PART * no_load, SLOW_SPEED_PART * no_load / SLOW_S)
    };
    let error = |compensated: bool| {
        let mut settings = *settings;
        // At low speed friction and drop dominate.
        settings.set(Param::Acceleration, acceleration as f32).map_err(|rule| rule.of(Param::Acceleration))?;
        if !compensated {
            for param in [Param::CompFrictionForward, Param::CompFrictionReverse, Param::CompDrop] {
                settings.set(param, 0.0).map_err(|rule| rule.of(param))?;
            }
        }
        let mut trial = Trial::of_model(model, settings)?;
        if let Some(tachogenerator) = tachogenerator {
            tachogenerator.set_ripple(&mut trial);
        }
        trial.enter(law.mode());
        let ways = [reference, -reference].into_iter().cycle().take(SLOW_WAYS);
        let points: Vec<_> = ways.flat_map(|reference| trial.follow(reference, SLOW_WAY_S)).collect();
        let of = |point: &super::Point| if law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
        let squares = points.iter().map(|point| (of(point) - point.reference).powi(2)).sum::<f64>();
        Ok((trial.sample().trip == Trip::None).then(|| (squares / points.len() as f64).sqrt()))
    };
    Ok(Standstill { law, reference, without: error(false)?, with: error(true)? })
}

/// A setting of the compensation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompensationSetting {
    /// Which.
    #[serde(skip)]
    pub param: Param,
    /// Its name on the console.
    pub name: String,
    /// Its value, in its unit.
    pub value: f64,
}

/// A loss that exceeds the core's compensation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} would be {value:.2} V, but the core adds 0 to 8 V: check friction and bridge drop of the model")]
pub struct OutOfRange {
    /// The setting.
    pub name: String,
    /// Its value.
    pub value: f64,
}

/// Part of the known losses that is compensated. Full compensation would cause a limit cycle: the friction of a motor
/// varies by about this much over a revolution and with temperature.
pub const PART: f64 = 0.8;

/// Settings of the compensation. Friction torque is given as the voltage at rest that balances it, `c R / k`. The drop
/// follows.
///
/// # Errors
/// [`OutOfRange`].
pub fn compensation(
    losses: &DryLosses,
    resistance_ohm: f64,
    torque_constant_nm_per_a: f64,
) -> Result<Vec<CompensationSetting>, OutOfRange> {
    let volts_per_nm = resistance_ohm / torque_constant_nm_per_a;
    let values = [
        (Param::CompFrictionForward, PART * losses.friction_forward_nm.max(0.0) * volts_per_nm),
        (Param::CompFrictionReverse, PART * losses.friction_reverse_nm.max(0.0) * volts_per_nm),
        (Param::CompDrop, PART * losses.bridge_drop_v),
    ];
    let setting = |(param, value): (Param, f64)| {
        let name = setting_name(param);
        let (min, max) = param.range();
        let value = super::fixed_point::rounded(value);
        match (f64::from(min)..=f64::from(max)).contains(&value) {
            true => Ok(CompensationSetting { param, name, value }),
            false => Err(OutOfRange { name, value }),
        }
    };
    values.into_iter().map(setting).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specification::{Specification, Speed};
    use crate::{Bench, design};

    /// Improvement by the compensation on the paper's motor with friction behind the L293D, for every law.
    #[test]
    fn tracking_near_standstill_gains_by_a_factor() {
        let motor = MotorParameters::PIVT6;
        let losses = DryLosses { friction_forward_nm: 0.01, friction_reverse_nm: 0.01, bridge_drop_v: 2.5 };
        for law in ControlLaw::ALL {
            let hz = if law.is_position() { 5.0 } else { 10.0 };
            let specification =
                Specification { speed: Speed::BandwidthHz(hz), overshoot_percent: 10.0, current_limit_a: 1.0 };
            let mut settings = design(&motor, &Bench::default(), law, &specification).unwrap().settings.all;
            for setting in compensation(&losses, motor.resistance_ohm, motor.torque_constant_nm_per_a).unwrap() {
                settings.set(setting.param, setting.value as f32).unwrap();
            }
            let found = near_standstill(&model_of(&losses, &motor), &settings, law, None).unwrap();
            print!("{}", found.text());
            // Without compensation a loop can stick so long that it trips.
            let with = found.with.unwrap();
            assert!(found.without.is_none_or(|without| with < 0.6 * without), "{found:?}");
        }
    }

    #[test]
    fn a_loss_beyond_the_core_is_refused_by_name() {
        let losses = DryLosses { friction_forward_nm: 1.0, ..DryLosses::default() };
        let error = compensation(&losses, 5.84, 0.072).unwrap_err().to_string();
        assert!(error.starts_with("comp_friction_fwd would be 64.89 V"), "{error}");
    }
}

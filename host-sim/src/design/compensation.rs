//! The core's compensation from what is known of friction and bridge.

use super::law::setting_name;
use crate::model::Model;
use motorbench_core::settings::Param;
use serde::Serialize;

/// What an extended model says beyond the linear motor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Torque of Coulomb friction turning forward, not negative.
    pub coulomb_forward_nm: f64,
    /// Turning in reverse, as a positive number.
    pub coulomb_reverse_nm: f64,
    /// Voltage the bridge loses, averaged over a PWM period; not negative.
    pub bridge_drop_v: f64,
}

impl Losses {
    /// What a model says.
    pub fn of(model: &Model) -> Self {
        let first = |id: &str| model.terms.iter().find(|term| term.id() == id).map_or(0.0, |term| term.values[0]);
        let (coulomb_nm, difference_nm) = (first("coulomb_friction"), first("friction_asymmetry"));
        Self {
            coulomb_forward_nm: (coulomb_nm + 0.5 * difference_nm).max(0.0),
            coulomb_reverse_nm: (coulomb_nm - 0.5 * difference_nm).max(0.0),
            bridge_drop_v: first("voltage_drop"),
        }
    }
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

/// A loss that the core cannot make up for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} would be {value:.2} V, the core adds between 0 and 8 V: check the model's friction and bridge drop")]
pub struct OutOfRange {
    /// Which setting.
    pub name: String,
    /// What it would be.
    pub value: f64,
}

/// Part of what is known that is made up for. More than all of it drives a limit cycle; friction of a motor varies by
/// about this much over a turn and with its temperature.
pub const PART: f64 = 0.8;

/// Settings of the compensation: friction torque as the voltage at rest that balances it, `c R / k`, and the drop.
///
/// # Errors
/// [`OutOfRange`].
pub fn compensation(
    losses: &Losses,
    resistance_ohm: f64,
    torque_constant_nm_per_a: f64,
) -> Result<Vec<CompensationSetting>, OutOfRange> {
    let volts_per_nm = resistance_ohm / torque_constant_nm_per_a;
    let values = [
        (Param::CompFrictionForward, PART * losses.coulomb_forward_nm * volts_per_nm),
        (Param::CompFrictionReverse, PART * losses.coulomb_reverse_nm * volts_per_nm),
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
    use crate::design::law::ControlLaw;
    use crate::design::specification::{Specification, Speed};
    use crate::design::trial::Trial;
    use crate::design::{Bench, design, ideal};
    use crate::motor::MotorParameters;
    use crate::plant::{BridgeLosses, DcMotor, DcMotorParameters};

    /// Root mean square of the tracking error in rad/s of a slow to and fro about standstill.
    fn tracking_error(compensated: bool) -> f64 {
        let motor = MotorParameters::PIVT6;
        let specification =
            Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
        let design = design(&motor, &Bench::default(), ControlLaw::SpeedPid, &specification).unwrap();
        let losses = Losses { coulomb_forward_nm: 0.01, coulomb_reverse_nm: 0.01, bridge_drop_v: 2.5 };
        let mut settings = design.settings.all;
        if compensated {
            for setting in compensation(&losses, motor.resistance_ohm, motor.torque_constant_nm_per_a).unwrap() {
                settings.set(setting.param, setting.value as f32).unwrap();
            }
        }
        // So slow that friction and drop are nearly all there is.
        settings.set(Param::Acceleration, 20.0).unwrap();
        let plant = DcMotorParameters {
            coulomb_friction_nm: losses.coulomb_forward_nm,
            bridge: BridgeLosses::L293D,
            ..ideal(&motor)
        };
        let mut trial = Trial::new(DcMotor::new(plant), settings).unwrap();
        trial.enter(ControlLaw::SpeedPid.mode());
        let points: Vec<_> = [5.0, -5.0, 5.0, -5.0].iter().flat_map(|&speed| trial.follow(speed, 0.6)).collect();
        let squares = points.iter().map(|point| (point.omega_rad_per_s - point.reference).powi(2));
        (squares.sum::<f64>() / points.len() as f64).sqrt()
    }

    #[test]
    fn tracking_near_standstill_gains_by_a_factor() {
        let (without, with) = (tracking_error(false), tracking_error(true));
        println!("tracking error about standstill: {without:.2} rad/s, compensated {with:.2} rad/s");
        assert!(with < 0.5 * without, "{with} {without}");
    }

    #[test]
    fn losses_of_an_extended_model() {
        let file = Model::linear(MotorParameters::PIVT6).to_toml()
            + "[effects.coulomb_friction]\ntorque_Nm = 0.5\n[effects.friction_asymmetry]\ndifference_Nm = 0.25\n\
               [effects.voltage_drop]\ndrop_V = 2.0\n";
        let losses = Losses::of(&Model::parse(&file).unwrap());
        assert_eq!((losses.coulomb_forward_nm, losses.coulomb_reverse_nm), (0.625, 0.375));
        assert_eq!(losses.bridge_drop_v, 2.0);
    }

    #[test]
    fn a_loss_beyond_the_core_is_refused_by_name() {
        let losses = Losses { coulomb_forward_nm: 1.0, ..Losses::default() };
        let error = compensation(&losses, 5.84, 0.072).unwrap_err().to_string();
        assert!(error.starts_with("comp_friction_fwd would be 64.89 V"), "{error}");
    }
}

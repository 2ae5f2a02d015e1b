//! Friction that drifts: a law to compare with, not in the catalogue. An effect that changes with time is not named where
//! such a drift fits better.

use super::{
    About, ActsOn, Balance, Coordinate, Effect, Instant, Law, Parameter, Scales, Search, Shown, Strength, Unit,
};
use crate::motor::MotorParameters;
use std::f64::consts::PI;

/// Half waves over the recording: one to so many. Two effects that change with time have as many constants.
const WAVES: usize = 4;

/// See the module.
struct SlowDrift;

static ABOUT: About = About {
    id: "slow_drift",
    title: "friction that drifts",
    acts_on: &[ActsOn::Torque],
    parameters: &[
        Parameter::signed("first_Nm", Unit::NewtonMetre),
        Parameter::signed("second_Nm", Unit::NewtonMetre),
        Parameter::signed("third_Nm", Unit::NewtonMetre),
        Parameter::signed("fourth_Nm", Unit::NewtonMetre),
        Parameter { fitted: false, ..Parameter::positive("duration_s", Unit::Second) },
    ],
    law: "T = (first_Nm cos(pi t / duration_s) + second_Nm cos(2 pi t / duration_s) + ...) sign(w)",
    shown: Shown::new(Strength::Torque, Coordinate::Time),
    ..About::DEFAULT
};

/// It, with no strength yet.
pub(super) fn none_yet(scales: &Scales) -> (&'static dyn Effect, Vec<f64>) {
    let mut values = vec![0.0; WAVES];
    values.push(scales.duration_s);
    (&SlowDrift, values)
}

impl Law for SlowDrift {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        if at.speed_rad_per_s == 0.0 {
            return;
        }
        let half_wave = PI * at.time_s / values[WAVES];
        let waves = values[..WAVES].iter().zip(1..);
        let torque_nm: f64 = waves.map(|(wave_nm, number)| wave_nm * (f64::from(number) * half_wave).cos()).sum();
        balance.torque_nm -= torque_nm * at.speed_rad_per_s.signum();
    }
}

impl Search for SlowDrift {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let mut values = vec![0.01 * scales.stall_torque_nm(); WAVES];
        values.push(scales.duration_s);
        vec![values]
    }
}

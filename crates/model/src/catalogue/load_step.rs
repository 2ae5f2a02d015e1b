//! Load step: a load comes or goes during the recording.

use super::{
    About, ActsOn, Balance, Coordinate, Effect, Instant, Law, Parameter, Scales, Search, Shown, Strength, Unit,
    slow_drift,
};
use crate::Term;
use crate::motor::MotorParameters;

/// See the module.
pub struct LoadStep;

static ABOUT: About = About {
    id: "load_step",
    title: "a load that came or went during the recording",
    acts_on: &[ActsOn::Torque],
    parameters: &[Parameter::signed("torque_Nm", Unit::NewtonMetre), Parameter::positive("time_s", Unit::Second)],
    linear_in: 1,
    law: "T = torque_Nm from time_s on, a moment that is found in all data, those kept back included",
    looks_like: "The missing torque jumps at one moment and stays",
    confused_with: &["friction_warmup", "load_torque"],
    experiment: "Repeat the recording: a load that was applied comes at another time or not at all",
    remedy: "Integral action; the observer's estimate of the load as feed-forward",
    source: "Leonhard, Control of Electrical Drives (2001)",
    // A load that comes and goes has a first time at which it comes.
    fits_any_course: true,
    responds_linearly: true,
    shown: Shown::new(Strength::Torque, Coordinate::Time),
    ..About::DEFAULT
};

impl Law for LoadStep {
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
        // Within its step it acts in proportion, so that a fit can move the time.
        let share = ((at.time_s + at.step_s - values[1]) / at.step_s).clamp(0.0, 1.0);
        balance.torque_nm -= share * values[0];
    }
}

impl Search for LoadStep {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let torque_nm = 0.02 * scales.stall_torque_nm();
        (1..30).map(|part| vec![torque_nm, f64::from(part) / 30.0 * scales.duration_s]).collect()
    }

    fn spacing(&self, scales: &Scales) -> Option<(usize, f64)> {
        Some((1, scales.duration_s / 30.0))
    }

    /// A shaft breaks loose at some moment. A load that goes at that very moment would be a coincidence.
    fn yields_to(&self, _values: &[f64], rival: &str, _others: &[Term]) -> bool {
        rival == "stribeck_friction"
    }

    /// A drift is often slower or faster than this law has it.
    fn similar_laws(&self, _values: &[f64], scales: &Scales) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        vec![slow_drift::none_yet(scales)]
    }
}

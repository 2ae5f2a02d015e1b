//! Robustness that a design must have.

use super::law::ControlLaw;
use super::sampled_loop::{Gains, SampledLoop, Sampling};
use motorbench_model::linear::frequency_response::Margins;
use motorbench_model::motor::MotorParameters;
use serde::Serialize;

/// Smallest distance of the loop's frequency response from -1. It implies a gain margin of 2 and a phase margin of 29
/// degrees (Astrom and Hagglund, Advanced PID Control, 4.6: peak sensitivity 2).
pub const SMALLEST_MODULUS: f64 = 0.5;
/// Additional delay that the loop must tolerate, in ticks: for a late tick, or a speed measured over two ticks.
pub const SMALLEST_DELAY_TICKS: f64 = 1.0;
/// The smallest distance with parameters that are off. If it is smaller, the lag of the speed near standstill can cause
/// a limit cycle of several counts.
pub const SMALLEST_MODULUS_OFF: f64 = 0.3;
/// Relative error of every parameter that the loop must tolerate, in all combinations at once.
pub const PARAMETER_ERROR: f64 = 0.3;

/// How robust a loop is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Robustness {
    /// Margins with the model's own parameters.
    pub margins: Margins,
    /// Largest eigenvalue with the model's own parameters.
    pub spectral_radius: f64,
    /// Largest eigenvalue over all combinations of parameters +-30 %.
    pub worst_spectral_radius: f64,
    /// Smallest modulus margin over the same.
    pub worst_modulus: f64,
}

/// A margin that a loop lacks.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Weakness {
    /// It is unstable with the parameters as they are.
    #[error("the sampled loop is unstable: its largest eigenvalue is {radius:.4}")]
    Unstable {
        /// Largest eigenvalue.
        radius: f64,
    },
    /// Too close to -1.
    #[error(
        "its modulus margin is {found:.2} (gain margin {gain:.1}, phase margin {phase_deg:.0} degrees), but at least {SMALLEST_MODULUS} is needed"
    )]
    Modulus {
        /// Modulus margin.
        found: f64,
        /// Gain margin.
        gain: f64,
        /// Phase margin.
        phase_deg: f64,
    },
    /// A small additional delay makes it unstable.
    #[error("an additional delay of {:.2} ms makes it unstable, but it must tolerate {:.2} ms", .found_s * 1e3, .needed_s * 1e3)]
    Delay {
        /// Delay margin.
        found_s: f64,
        /// Delay margin that is needed.
        needed_s: f64,
    },
    /// Other parameters make it unstable.
    #[error("with parameters 30 % off the model it is unstable: its largest eigenvalue is {radius:.4}")]
    Parameters {
        /// Largest eigenvalue.
        radius: f64,
    },
    /// Other parameters bring it too close to -1.
    #[error(
        "with parameters 30 % off the model its modulus margin is {found:.2}, but at least {SMALLEST_MODULUS_OFF} is needed"
    )]
    ParametersModulus {
        /// Modulus margin.
        found: f64,
    },
}

/// Checks a loop with the gains in the core's formats.
///
/// # Errors
/// The first [`Weakness`].
pub fn check(
    motor: &MotorParameters,
    law: ControlLaw,
    sampling: &Sampling,
    gains: &Gains,
) -> Result<Robustness, Weakness> {
    let sampled = SampledLoop::new(motor, law, sampling);
    let spectral_radius = sampled.spectral_radius(gains);
    if spectral_radius >= 1.0 {
        return Err(Weakness::Unstable { radius: spectral_radius });
    }
    let margins = sampled.margins(gains);
    if margins.modulus < SMALLEST_MODULUS {
        return Err(Weakness::Modulus { found: margins.modulus, gain: margins.gain, phase_deg: margins.phase_deg });
    }
    let needed_s = SMALLEST_DELAY_TICKS * sampling.period_s;
    if margins.delay_s < needed_s {
        return Err(Weakness::Delay { found_s: margins.delay_s, needed_s });
    }
    let others: Vec<SampledLoop> = corners(motor).map(|motor| SampledLoop::new(&motor, law, sampling)).collect();
    let worst_spectral_radius =
        others.iter().map(|sampled| sampled.spectral_radius(gains)).fold(spectral_radius, f64::max);
    if worst_spectral_radius >= 1.0 {
        return Err(Weakness::Parameters { radius: worst_spectral_radius });
    }
    let worst_modulus = others.iter().map(|sampled| sampled.margins(gains).modulus).fold(margins.modulus, f64::min);
    if worst_modulus < SMALLEST_MODULUS_OFF {
        return Err(Weakness::ParametersModulus { found: worst_modulus });
    }
    Ok(Robustness { margins, spectral_radius, worst_spectral_radius, worst_modulus })
}

/// All combinations of parameters 30 % too large and too small.
pub fn corners(motor: &MotorParameters) -> impl Iterator<Item = MotorParameters> {
    let motor = *motor;
    (0..32).map(move |corner: u32| {
        let factor = |bit: u32| 1.0 + if corner >> bit & 1 == 0 { PARAMETER_ERROR } else { -PARAMETER_ERROR };
        MotorParameters {
            resistance_ohm: motor.resistance_ohm * factor(0),
            inductance_h: motor.inductance_h * factor(1),
            torque_constant_nm_per_a: motor.torque_constant_nm_per_a * factor(2),
            inertia_kg_m2: motor.inertia_kg_m2 * factor(3),
            viscous_friction_nm_s: motor.viscous_friction_nm_s * factor(4),
        }
    })
}

//! Actuation delay: the voltage comes later than the recording says.

use super::{About, ActsOn, Channels, Effect, INDUCTANCE, Parameter, Scales, Simplification};

/// See the module.
pub struct ActuationDelay;

static ABOUT: About = About {
    id: "actuation_delay",
    title: "a delay between command and voltage",
    acts_on: ActsOn::Voltage,
    parameters: &[Parameter::within("delay_s", 0.0, 0.2)],
    linear_in: 0,
    law: "u(t - delay_s)",
    looks_like: "After each step of the command both current and speed wait",
    confused_with: &["current_lag", "speed_lag"],
    experiment: "Steps with the current measured: a delay shifts the response, an inductance or a filter rounds it",
    remedy: "Bandwidth below 0.3 / delay; a Smith predictor or the delay's states in the LQR",
    source: "Astrom and Hagglund, Advanced PID Control (2006)",
};

impl Effect for ActuationDelay {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![2.0 * scales.interval_s.min(0.005)]]
    }

    /// By a speed a winding, a lag and a wait can hardly be told apart.
    fn instead_of(&self, rival: &str, values: &[f64]) -> Option<Vec<f64>> {
        // Of a lag, its time constant.
        [INDUCTANCE, "current_lag", "speed_lag"].contains(&rival).then(|| vec![values[0]])
    }

    /// Moments that are sought are as late as a delay would make them.
    fn shows_in(&self, channels: &Channels) -> bool {
        !channels.moments
    }

    /// A duty is taken over when the next period of the PWM begins.
    fn simplification(&self) -> Simplification {
        Simplification { own: 5e-3, inertia: 0.0, viscous_friction: 0.0 }
    }

    fn delay_s(&self, values: &[f64]) -> f64 {
        values[0]
    }

    fn acts_on_motor(&self) -> bool {
        false
    }

    fn changes_motion(&self) -> bool {
        true
    }
}

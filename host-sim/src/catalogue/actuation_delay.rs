//! Actuation delay: the voltage comes later than the recording says.

use super::{About, ActsOn, Channels, Effect, INDUCTANCE, Parameter, Scales, Simplification};

/// A host program over a slow link may take this long.
const LONGEST_S: f64 = 2.0;
/// Delays that are tried: of a program, of a link, of a slow host, and of a process behind a pipe or a belt.
const USUAL_S: [f64; 3] = [0.03, 0.12, 0.35];

/// See the module.
pub struct ActuationDelay;

static ABOUT: About = About {
    id: "actuation_delay",
    title: "a delay between command and voltage",
    acts_on: ActsOn::Voltage,
    parameters: &[Parameter::within("delay_s", 0.0, LONGEST_S)],
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
        let least_s = 2.0 * scales.interval_s.min(0.005);
        // A recording shows no delay that is a good part of it.
        let longer = USUAL_S.into_iter().filter(|delay_s| (2.0 * least_s..0.2 * scales.duration_s).contains(delay_s));
        std::iter::once(least_s).chain(longer).map(|delay_s| vec![delay_s]).collect()
    }

    /// By a speed a winding, a lag and a wait can hardly be told apart.
    fn instead_of(&self, rival: &str, values: &[f64]) -> Option<Vec<f64>> {
        // A step that waits for a third of a second is a load at a standstill until then.
        if rival == "load_step" {
            return Some(vec![USUAL_S[USUAL_S.len() - 1]]);
        }
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

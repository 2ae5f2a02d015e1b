//! Actuation delay: the voltage comes later than the recorded command.

use super::{About, ActsOn, Channels, INDUCTANCE, Law, Parameter, Scales, Search, Simplification, Unit};

/// A host program over a slow link may take this long.
const LONGEST_S: f64 = 2.0;
/// Delays that are tried: of a program, of a link, of a slow host, and of a process behind a pipe or a belt.
const USUAL_S: [f64; 3] = [0.03, 0.12, 0.35];
/// A recording shows no delay that is a greater share of it.
const MOST_OF_DURATION: f64 = 0.2;

/// See the module.
pub struct ActuationDelay;

static ABOUT: About = About {
    id: "actuation_delay",
    title: "a delay between command and voltage",
    acts_on: &[ActsOn::Voltage],
    parameters: &[Parameter::within("delay_s", Unit::Second, 0.0, LONGEST_S)],
    linear_in: 0,
    law: "u(t - delay_s)",
    looks_like: "After each step of the command both current and speed wait",
    confused_with: &["current_lag", "speed_lag"],
    experiment: "Steps with the current measured: a delay shifts the response, an inductance or a filter rounds it",
    remedy: "Bandwidth below 0.3 / delay; a Smith predictor or the delay's states in the LQR",
    source: "Astrom and Hagglund, Advanced PID Control (2006)",
    // A new duty takes effect when the next period of the PWM begins.
    simplification: Simplification::of_own(5e-3),
    is_delay: true,
    ..About::DEFAULT
};

impl Law for ActuationDelay {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn delay_s(&self, values: &[f64]) -> f64 {
        values[0]
    }
}

impl Search for ActuationDelay {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let least_s = 2.0 * scales.interval_s.min(0.005);
        let worth_trying = 2.0 * least_s..MOST_OF_DURATION * scales.duration_s;
        let longer = USUAL_S.into_iter().filter(|delay_s| worth_trying.contains(delay_s));
        std::iter::once(least_s).chain(longer).map(|delay_s| vec![delay_s]).collect()
    }

    /// The speed alone can hardly tell an inductance, a lag and a delay apart.
    fn instead_of(&self, rival: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        // A step that waits for a third of a second looks like a load that holds the shaft until then.
        if rival == "load_step" {
            return Some(vec![USUAL_S[USUAL_S.len() - 1]]);
        }
        // The value of a rival lag is its time constant.
        [INDUCTANCE, "current_lag", "speed_lag"].contains(&rival).then(|| vec![values[0]])
    }

    /// A lateness that is followed from reading to reading includes any delay.
    fn can_show_in(&self, channels: &Channels) -> bool {
        !channels.lateness
    }
}

//! Bridge asymmetry: the bridge gives less voltage in one direction than in the other. Causes are a transistor that no longer
//! saturates, a bad joint, or pulses whose length differs between the directions.

use super::{About, ActsOn, Balance, Coordinate, Instant, Law, Parameter, Scales, Search, Shown, Strength, Unit};
use crate::motor::MotorParameters;

/// See the module.
pub struct BridgeAsymmetry;

static ABOUT: About = About {
    id: "bridge_asymmetry",
    title: "a bridge that gives less one way",
    acts_on: &[ActsOn::Voltage],
    parameters: &[Parameter::signed("backward_share", Unit::One)],
    linear_in: 1,
    law: "Backwards (1 + backward_share) times as much as forwards; the way that gives more gives u",
    looks_like: "The missing voltage is in proportion to the voltage one way, and nothing the other; the motor is faster one way than the other, most at full duty",
    confused_with: &["load_torque", "friction_asymmetry", "current_offset"],
    experiment: "Measure the bridge's output with a meter at the same duty both ways, the motor unplugged and plugged in",
    remedy: "The bridge's other channel, or another bridge; until then a command scaled up the weaker way",
    source: "Texas Instruments, L293D data sheet (saturation voltages and propagation delays that differ between the two ways)",
    shown: Shown::new(Strength::Voltage, Coordinate::Voltage),
    tells_scale_of_voltages: true,
    ..About::DEFAULT
};

impl Law for BridgeAsymmetry {
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
        // The bridge gives no more than the command in either direction.
        balance.voltage_v += match values[0] {
            share if share < 0.0 => share * at.voltage_v.min(0.0),
            share => -share / (1.0 + share) * at.voltage_v.max(0.0),
        };
    }
}

impl Search for BridgeAsymmetry {
    fn starts(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        [-0.1, 0.1].map(|share| vec![share]).to_vec()
    }

    /// Counts that are lost one way make it slower that way as well.
    fn instead_of(&self, id: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        let &[lost_share, .., one_way] = values else { return None };
        (id == "missed_counts" && one_way != 0.0).then(|| vec![if one_way < 0.0 { -lost_share } else { lost_share }])
    }
}

//! Voltage drop: bridge transistors and brush contacts take a nearly constant voltage while current flows.
//!
//! In a switched bridge the drop acts at every moment. A current that swings through zero within a PWM period loses it in both
//! directions. Behind a filter, in a linear amplifier or in a program's averages, the drop follows the mean current and comes
//! up over a knee. In the off phase a bridge may drop more than in the pulse, or less, and have another slope. A current that
//! flows back into the supply takes its diodes, with a drop of their own. Junctions drop more with the logarithm of their
//! current: that is steep where the current is small.

use super::{
    About, ActsOn, Balance, Channels, Coordinate, DryLosses, Instant, Law, Parameter, Scales, Search, Shown, Strength,
    Unit,
};
use crate::Term;
use crate::motor::MotorParameters;

/// Knees that are tried, as shares of the greatest current; 0: the drop acts at every moment.
const KNEES: [f64; 3] = [0.0, 5e-4, 1e-2];

/// The widest knee of a drop, as a share of the greatest current.
const WIDEST_KNEE: f64 = 0.3;

/// Two transistors conduct in the pulse, a transistor and a diode in the off phase. That drops 0 to 0.6 V less (ST L293D and
/// L298 data sheets), and differs at most by two junctions.
const OFF_PHASE_V: (f64, f64) = (-0.3, 0.3);
const MOST_OFF_PHASE_V: f64 = 1.2;
/// Two diodes conduct back into the supply. Such a current is short and small, where a junction drops anything: little is
/// known beforehand. With a drop as in the pulse, the way back would decide on the scale of the whole supply.
const RETURN_V: (f64, f64) = (0.0, 2.0);
const MOST_RETURN_V: f64 = 6.0;
/// A saturated transistor of such bridges adds about half an ohm, a diode a tenth (ST L293D and L298 data sheets).
const OFF_PHASE_SPREAD_OHM: f64 = 0.5;
const MOST_OFF_PHASE_OHM: f64 = 1.5;
/// The junctions on the way of the current: kT/q for each of three, from one to five (Sze, Physics of Semiconductor Devices).
const JUNCTIONS_V: (f64, f64) = (0.078, 0.026);
const MOST_JUNCTIONS_V: f64 = 0.2;
/// Below this current a junction is taken as straight: little else flows there, and a sensor hardly shows it.
const STRAIGHT_A: f64 = 0.02;
/// Starts: how much more the off phase drops, as a share of the drop, how many ohms it adds, how much more is lost on the way
/// back, as a share of the drop, and the junctions. One is so small that the other constants still fit, the others are those
/// of a bipolar bridge.
const OTHER_PATHS: [[f64; 4]; 3] =
    [[-0.01, 0.01, -0.01, 0.0], [-0.2, 0.5, -0.1, 0.0], [-0.2, 0.5, -0.1, JUNCTIONS_V.0]];

/// See the module.
pub struct VoltageDrop;

static ABOUT: About = About {
    id: "voltage_drop",
    title: "a voltage drop in bridge or brushes",
    acts_on: &[ActsOn::Voltage],
    parameters: &[
        Parameter::positive("drop_V", Unit::Volt),
        Parameter::of_another_law("knee_A", Unit::Ampere, f64::INFINITY),
        Parameter {
            known: Some(OFF_PHASE_V),
            min: -MOST_OFF_PHASE_V,
            ..Parameter::of_another_law("off_phase_V", Unit::Volt, MOST_OFF_PHASE_V)
        },
        Parameter {
            known: Some((0.0, OFF_PHASE_SPREAD_OHM)),
            min: -MOST_OFF_PHASE_OHM,
            ..Parameter::of_another_law("off_phase_ohm", Unit::Ohm, MOST_OFF_PHASE_OHM)
        },
        Parameter {
            known: Some(RETURN_V),
            min: -MOST_RETURN_V,
            ..Parameter::of_another_law("return_V", Unit::Volt, MOST_RETURN_V)
        },
        Parameter {
            known: Some(JUNCTIONS_V),
            ..Parameter::of_another_law("junctions_V", Unit::Volt, MOST_JUNCTIONS_V)
        },
    ],
    linear_in: 1,
    law: "U = drop_V sign(i), or drop_V tanh(i / knee_A) of the mean current",
    looks_like: "The missing voltage is a step at zero current; no current at all below a command voltage",
    confused_with: &["coulomb_friction", "supply_sag"],
    experiment: "Hold the rotor and step the voltage: the line of current over voltage misses zero by the drop",
    remedy: "Feed-forward of the drop in the direction of the current; a MOSFET bridge",
    source: "ST L293D data sheet (saturation voltages); Mohan, Electric Machines and Drives (2012)",
    shown: Shown::new(Strength::Voltage, Coordinate::Current),
    ..About::DEFAULT
};

impl Law for VoltageDrop {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn dry_losses(&self, values: &[f64]) -> DryLosses {
        DryLosses { bridge_drop_v: values[0], ..DryLosses::default() }
    }

    /// Three drops, one on each way of the current, can leave any multiple of the supply.
    fn with_scaled_voltages(&self, values: &[f64], supply_v: f64, factor: f64) -> Option<Vec<f64>> {
        let &[pulse_v, knee_a, off_excess_v, off_ohm, return_excess_v, junctions_v] = values else { return None };
        if knee_a != 0.0 || off_excess_v == 0.0 || return_excess_v == 0.0 {
            return None;
        }
        let scaled_v = supply_v - factor * (supply_v - pulse_v);
        let off_v = factor * (pulse_v + off_excess_v);
        let return_v = factor * (supply_v + pulse_v + return_excess_v) - supply_v;
        let off_ohm = factor * off_ohm;
        Some(vec![scaled_v, 0.0, off_v - scaled_v, off_ohm, return_v - scaled_v, factor * junctions_v])
    }

    /// A drop that follows the mean current is not that of a switched bridge.
    fn is_dry_losses_alone(&self, values: &[f64]) -> bool {
        values[1..] == [0.0; 5]
    }

    fn is_steady(&self, values: &[f64]) -> bool {
        values[3] == 0.0 && values[5] == 0.0
    }

    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        balance.dry_drop_v += values[0];
        if values[5] != 0.0 {
            balance.dry_drop_v += values[5] * (at.current_a / STRAIGHT_A).abs().ln_1p();
        }
        balance.knee_a = balance.knee_a.max(values[1]);
        balance.off_excess_v += values[2];
        balance.return_excess_v += values[4];
        balance.resistance_ohm += values[3] * (1.0 - at.duty.abs());
    }
}

impl Search for VoltageDrop {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        laws(0.05 * scales.voltage_v, scales)
    }

    /// What follows the current over most of its range is a resistance.
    fn is_a_scale(&self, values: &[f64], scales: &Scales) -> bool {
        values[1] > WIDEST_KNEE * scales.current_a
    }

    /// A friction takes the voltage that its torque needs.
    fn takes_over(&self, rival: &str, values: &[f64], Scales { motor, .. }: &Scales) -> Option<Vec<f64>> {
        let drop_v = values[0] * motor.resistance_ohm / motor.torque_constant_nm_per_a;
        (rival == "coulomb_friction").then(|| vec![drop_v, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    /// Every motor has friction, and not every command goes through a bridge.
    fn yields_to(&self, _values: &[f64], rival: &str, _others: &[Term]) -> bool {
        rival == "coulomb_friction"
    }

    fn other_laws(&self, values: &[f64], scales: &Scales) -> Vec<Vec<f64>> {
        let mut laws = laws(values[0], scales);
        // A fit moves the knee: the law with a moved knee stays in the list.
        laws.retain(|law| law[1..] != values[1..]);
        laws
    }

    /// A drop at every moment, another one with another slope in the off phase, and another one on the way back. A knee is
    /// another law and no step towards these: a fit may have taken it for what they explain.
    fn refined_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        let with = |[off_share, off_ohm, return_share, junctions_v]: [f64; 4]| {
            vec![values[0], 0.0, off_share * values[0], off_ohm, return_share * values[0], junctions_v]
        };
        match values[2..] == [0.0; 4] {
            true => OTHER_PATHS.map(with).to_vec(),
            false => Vec::new(),
        }
    }

    /// At a single voltage the drop only scales it.
    fn can_show_in(&self, channels: &Channels) -> bool {
        !channels.one_magnitude
    }
}

fn laws(drop_v: f64, scales: &Scales) -> Vec<Vec<f64>> {
    KNEES.map(|share| vec![drop_v, share * scales.current_a, 0.0, 0.0, 0.0, 0.0]).to_vec()
}

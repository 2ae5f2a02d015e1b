//! What is known of an effect, as data.

use super::Parameter;
use std::ops::Range;

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ActsOn {
    /// Balance of torques at the shaft.
    Torque,
    /// Balance of voltages in the armature.
    Voltage,
    /// Reading of the current.
    CurrentSensor,
    /// Reading of angle and speed.
    AngleSensor,
}

impl ActsOn {
    /// Whether it falsifies a reading and leaves the motor alone.
    pub fn is_of_a_sensor(self) -> bool {
        matches!(self, Self::CurrentSensor | Self::AngleSensor)
    }
}

/// The sensor that an effect belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// Of the current.
    Current,
    /// Of the angle, by counts.
    Encoder,
    /// Of the speed, by a voltage.
    Tachogenerator,
}

/// An effect without the effect that it requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alone {
    /// It makes no sense.
    Never,
    /// It is rare: the evidence has to be beyond doubt.
    Rarely,
}

/// What a law leaves out of the physics, as relative errors of the constants that are found with it: one standard
/// deviation. They were measured on benches with known constants, whose physics has another formulation.
#[derive(Clone, Copy, Debug)]
pub struct Simplification {
    /// Of its own constants.
    pub own: f64,
    /// Of the motor's moment of inertia.
    pub inertia: f64,
    /// Of the motor's viscous friction.
    pub viscous_friction: f64,
}

impl Simplification {
    /// An error of its own constants alone.
    pub(super) const fn of_own(own: f64) -> Self {
        Self { own, inertia: 0.0, viscous_friction: 0.0 }
    }
}

/// In what form an effect shows: the vertical axis of its plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strength {
    /// A torque on the shaft.
    Torque,
    /// A torque against the motion, whichever way it goes.
    Friction,
    /// A change of the torque constant and of the back-EMF constant, in percent.
    TorqueConstant,
    /// A voltage in the armature.
    Voltage,
    /// A voltage of the supply, of which the motor gets the duty.
    SupplyVoltage,
    /// A resistance in the armature.
    Resistance,
    /// A change of a reading.
    Reading,
    /// A change of a reading in percent of it.
    ShareOfReading,
    /// A delay of a reading, in milliseconds.
    Delay,
}

impl Strength {
    /// Whether it is read off a sensor and not a force in the motor.
    pub fn is_of_a_reading(self) -> bool {
        matches!(self, Self::Reading | Self::ShareOfReading | Self::Delay)
    }
}

/// What an effect depends on: the horizontal axis of its plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinate {
    /// Speed of the shaft.
    Speed,
    /// Speed of the shaft without its sign.
    SpeedSize,
    /// Angle of the shaft within a turn.
    Angle,
    /// Current of the armature.
    Current,
    /// Current that the supply delivers.
    SupplyCurrent,
    /// Voltage that the bridge was asked for.
    Voltage,
    /// Duty of the bridge.
    Duty,
    /// Time since the start of the recording.
    Time,
    /// Time since the last step of the command.
    SinceStep,
}

/// The plot that shows an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Vertical axis.
    pub as_a: Strength,
    /// Horizontal axis.
    pub over: Coordinate,
}

impl Shown {
    pub(super) const fn new(as_a: Strength, over: Coordinate) -> Self {
        Self { as_a, over }
    }
}

/// What is known of an effect, for people and for the diagnosis.
#[derive(Debug)]
pub struct About {
    /// Its name in results.
    pub id: &'static str,
    /// Its name in sentences.
    pub title: &'static str,
    /// Where it acts; several places where it enters several equations.
    pub acts_on: &'static [ActsOn],
    /// Its constants.
    pub parameters: &'static [Parameter],
    /// The readings are linear in so many of its constants, from the first, while these are small.
    pub linear_in: usize,
    /// Its law in one line.
    pub law: &'static str,
    /// What a person sees of it.
    pub looks_like: &'static str,
    /// What can look the same, by identifier.
    pub confused_with: &'static [&'static str],
    /// The experiment that tells it from those.
    pub experiment: &'static str,
    /// What the controller or the owner can do about it.
    pub remedy: &'static str,
    /// Where the law is described.
    pub source: &'static str,
    /// Groups of its constants that say how strong it is. With all constants of one group at their least the effect is
    /// absent. Empty: the constants that it is linear in are the only group.
    pub strengths: &'static [Range<usize>],
    /// An effect that it comes with, and what it is without that one.
    pub requires: Option<(&'static str, Alone)>,
    /// Beside this effect its constants are held at their prior means: the data cannot tell the two apart.
    pub held_beside: Option<&'static str>,
    /// What its law leaves out.
    pub simplification: Simplification,
    /// The sensor that it belongs to, if it does not act on the motor.
    pub sensor: Option<Sensor>,
    /// The plot that shows it. What has a memory of its own shows after each step of the command.
    pub shown: Shown,
    /// Whether it only delays the command and adds no term to a balance.
    pub is_delay: bool,
    /// Whether it falsifies the measured angle. What depends on the angle then acts elsewhere than the reading says.
    pub falsifies_angle: bool,
    /// Whether a given motion determines the torque and the voltage that it adds. Many starts are then screened by the linear
    /// motor's response to them.
    pub responds_linearly: bool,
    /// Whether it can follow a part of any course over time. Beside something unknown it may be no more than such a part.
    pub fits_any_course: bool,
    /// Whether it has events, such as blows. Other constants move them in time, so that readings change by leaps.
    pub has_events: bool,
    /// Whether it acts where a resting shaft breaks loose. It moves the begin of the motion, which a linear response does not
    /// show.
    pub acts_at_breakaway: bool,
    /// Whether the linear motor fitted without it is useless as a start. The fit then starts from the nominal motor as well.
    pub changes_everything: bool,
    /// Whether it describes how the bridge is switched. A plant whose bridge is switched does not need it.
    pub is_of_switching: bool,
    /// Whether all it does to the voltage is to change the resistance within seconds.
    pub is_slow_resistance: bool,
    /// Whether it compares the supply with other voltages. Then it tells their scale.
    pub tells_scale_of_voltages: bool,
}

impl About {
    /// What holds where an effect says nothing else. The fields up to `source` have to be given.
    pub(super) const DEFAULT: Self = Self {
        id: "",
        title: "",
        acts_on: &[],
        parameters: &[],
        linear_in: 0,
        law: "",
        looks_like: "",
        confused_with: &[],
        experiment: "",
        remedy: "",
        source: "",
        strengths: &[],
        requires: None,
        held_beside: None,
        simplification: Simplification::of_own(1e-3),
        sensor: None,
        shown: Shown::new(Strength::Reading, Coordinate::SinceStep),
        is_delay: false,
        falsifies_angle: false,
        responds_linearly: false,
        fits_any_course: false,
        has_events: false,
        acts_at_breakaway: false,
        changes_everything: false,
        is_of_switching: false,
        is_slow_resistance: false,
        tells_scale_of_voltages: false,
    };

    /// The groups of its constants that say how strong it is; see the field.
    pub fn strengths(&self) -> Vec<Range<usize>> {
        let linear = Range { start: 0, end: self.linear_in };
        if self.strengths.is_empty() && !linear.is_empty() { vec![linear] } else { self.strengths.to_vec() }
    }

    /// The place of its number of periods among its constants, if it has one.
    pub fn number(&self) -> Option<usize> {
        self.parameters.iter().position(Parameter::is_number)
    }

    /// Whether it adds terms to the balances of the motor.
    pub fn acts_on_motor(&self) -> bool {
        self.sensor.is_none() && !self.is_delay
    }

    /// Whether other values move the motor of the model differently, and not only its readings.
    pub fn changes_motion(&self) -> bool {
        self.sensor.is_none() || self.falsifies_angle
    }
}

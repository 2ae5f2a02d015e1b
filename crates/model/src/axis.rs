//! What a drive imposes on a motor, and along what the motor moves.
//!
//! A bridge imposes a voltage: current and speed follow by two balances. A current-controlled drive imposes the
//! current, and some take a torque or a force as their command. The balance of torques alone is left, and speed and
//! angle are the only states. In a linear axis metres take the place of radians, newtons that of newton metres and
//! kilograms that of kilogram square metres. The equations are the same, so only names and units differ
//! ([`Motion::words`]).

use crate::catalogue::{About, ActsOn, Coordinate};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// What a drive imposes on the motor: the input of the plant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// The voltage of the armature.
    #[default]
    Voltage,
    /// The current: its torque follows by the torque constant.
    Current,
    /// The torque, or the force of a linear axis, whose files say `force`.
    #[serde(alias = "force")]
    Torque,
}

/// Along what the motor moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// It turns: rad, Nm, kg m2.
    #[default]
    Rotary,
    /// It goes along a line: m, N, kg.
    Linear,
}

/// What acts on the motor over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Input {
    /// A voltage at the armature, in volts.
    Voltage(f64),
    /// A current that the winding cannot change, in amperes; zero while a bridge is off.
    Current(f64),
}

/// An axis as its recordings see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Axis {
    /// What is imposed.
    #[serde(default)]
    pub drive: Drive,
    /// How it moves.
    #[serde(default)]
    pub motion: Motion,
}

/// Places in [`named`](crate::motor::MotorParameters::named).
const RESISTANCE: usize = 0;
const INDUCTANCE: usize = 1;
const TORQUE_CONSTANT: usize = 2;

impl Drive {
    /// Whether the voltage is imposed, so that there is a balance of voltages.
    pub fn is_voltage(self) -> bool {
        self == Self::Voltage
    }

    /// Whether something at this place of the motor can be seen behind such a drive. An imposed current shows neither
    /// the voltages nor its own sensor.
    pub fn shows(self, place: ActsOn) -> bool {
        match place {
            ActsOn::Torque | ActsOn::AngleSensor => true,
            ActsOn::Voltage | ActsOn::CurrentSensor => self.is_voltage(),
        }
    }

    /// Whether a constant of the motor, by its place in [`named`](crate::motor::MotorParameters::named), exists for it.
    pub fn has_constant(self, place: usize) -> bool {
        match place {
            RESISTANCE | INDUCTANCE => self.is_voltage(),
            TORQUE_CONSTANT => self != Self::Torque,
            _ => true,
        }
    }

    /// The input by a command in volts, amperes or newton metres. A torque is the current of a motor whose torque constant
    /// is one.
    pub fn input(self, command: f64, is_off: bool) -> Input {
        match self {
            _ if is_off => Input::Current(0.0),
            Self::Voltage => Input::Voltage(command),
            Self::Current | Self::Torque => Input::Current(command),
        }
    }
}

impl Axis {
    /// Whether it is a motor behind a bridge, as a rig has it that says nothing else.
    pub fn is_usual(&self) -> bool {
        *self == Self::default()
    }

    /// In words: what is imposed on what.
    pub fn words(self) -> String {
        let moves = if self.motion == Motion::Rotary { "rotary" } else { "linear" };
        format!("the {} of a {moves} axis", self.drive_words())
    }

    /// What is imposed, in a word.
    pub fn drive_words(self) -> &'static str {
        match (self.drive, self.motion) {
            (Drive::Voltage, _) => "voltage",
            (Drive::Current, _) => "current",
            (Drive::Torque, Motion::Rotary) => "torque",
            (Drive::Torque, Motion::Linear) => "force",
        }
    }

    /// Whether an effect is possible: by where it acts, and by what it depends on. A delay is one of the command, whatever
    /// that is. A slide has no turn in which something could come again.
    pub fn allows(self, about: &About) -> bool {
        let acts = about.is_delay || about.acts_on.iter().any(|place| self.drive.shows(*place));
        acts && (self.motion == Motion::Rotary || about.shown.over != Coordinate::Angle)
    }
}

/// Names and units of rotary motion, and those in their place; the longer ones first.
const LINEAR: [(&str, &str); 28] = [
    ("omega_from_angle_rad_per_s", "v_from_x_m_per_s"),
    ("omega_rad_per_s", "v_m_per_s"),
    ("theta_rad", "x_m"),
    ("torque_constant_Nm_per_A", "force_constant_N_per_A"),
    ("torque_constant", "force_constant"),
    ("inertia_kg_m2", "mass_kg"),
    ("load_inertia_share", "load_mass_share"),
    ("parameter:inertia", "parameter:mass"),
    ("torque_Nm", "force_N"),
    ("_Nm_s3", "_N_s3_per_m3"),
    ("_Nm_s2", "_N_s2_per_m2"),
    ("_Nm_s", "_N_s_per_m"),
    ("_Nm", "_N"),
    ("_rad_per_s", "_m_per_s"),
    ("_rad", "_m"),
    ("rad/s2", "m/s2"),
    ("rad/s", "m/s"),
    (", Nm", ", N"),
    (", rad", ", m"),
    ("A s^2/rad", "A s^2/m"),
    ("A s/rad", "A s/m"),
    ("_per_rad", "_per_m"),
    (" rad rms", " m rms"),
    ("torques", "forces"),
    ("torque", "force"),
    ("Torque", "Force"),
    ("the shaft", "the slide"),
    ("turning", "moving"),
];
/// Effects keep their identifiers.
const IDENTIFIERS: [&str; 1] = ["load_torque"];

impl Motion {
    /// A text with the names and units of this motion: inside, everything has those of rotary motion.
    pub fn words(self, text: &str) -> Cow<'_, str> {
        if self == Self::Rotary {
            return Cow::Borrowed(text);
        }
        let mut written = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(letter) = rest.chars().next() {
            let kept = IDENTIFIERS.iter().find(|name| rest.starts_with(**name)).map(|name| (*name, *name));
            let (old, new) = kept
                .or_else(|| LINEAR.into_iter().find(|(old, _)| rest.starts_with(old)))
                .unwrap_or_else(|| (&rest[..letter.len_utf8()], &rest[..letter.len_utf8()]));
            written.push_str(new);
            rest = &rest[old.len()..];
        }
        Cow::Owned(written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::CATALOGUE;

    fn allowed(axis: Axis) -> Vec<&'static str> {
        CATALOGUE.iter().map(|effect| effect.about()).filter(|about| axis.allows(about)).map(|about| about.id).collect()
    }

    #[test]
    fn what_is_imposed_has_no_faults_behind_it() {
        assert_eq!(allowed(Axis::default()).len(), CATALOGUE.len());
        let of_current = allowed(Axis { drive: Drive::Current, motion: Motion::Rotary });
        for id in ["coulomb_friction", "friction_asymmetry", "load_torque", "cogging", "backlash", "actuation_delay"] {
            assert!(of_current.contains(&id), "{id}");
        }
        for id in ["voltage_drop", "supply_sag", "winding_heating", "current_offset", "coast_decay"] {
            assert!(!of_current.contains(&id), "{id}");
        }
        let linear = allowed(Axis { drive: Drive::Torque, motion: Motion::Linear });
        assert!(linear.contains(&"stribeck_friction") && !linear.contains(&"cogging"), "{linear:?}");
    }

    #[test]
    fn a_slide_is_told_in_metres() {
        let words = |text: &str| Motion::Linear.words(text).into_owned();
        assert_eq!(words("torque_Nm = 20.4, viscous_friction_Nm_s"), "force_N = 20.4, viscous_friction_N_s_per_m");
        assert_eq!(words("load_torque: error of omega_from_angle_rad_per_s"), "load_torque: error of v_from_x_m_per_s");
        assert_eq!(words("inertia_kg_m2 within 0.1 rad/s"), "mass_kg within 0.1 m/s");
        assert_eq!(Motion::Rotary.words("torque_Nm"), "torque_Nm");
    }
}

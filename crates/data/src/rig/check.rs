//! Reads a rig file, and refuses what no rig has.

use super::Rig;
use motorbench_model::Motion;
use motorbench_model::motor::{self, NonPhysical};
use motorbench_text::keys;

/// Why a rig file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// It cannot be read.
    #[error("{path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The message of the operating system.
        source: std::io::Error,
    },
    /// It is not TOML, or a value has the wrong type.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: String,
        /// Place and reason.
        message: String,
    },
    /// A key that is unknown, but resembles a known one.
    #[error("{path}: line {line}: unknown key {key}; did you mean {meant}?")]
    UnknownKey {
        /// The file.
        path: String,
        /// The line.
        line: usize,
        /// The key with its table.
        key: String,
        /// The most similar key of this table.
        meant: &'static str,
    },
    /// An impossible constant of the motor.
    #[error("{path}: motor.{source}")]
    Motor {
        /// The file.
        path: String,
        /// The constant, and its rule.
        source: NonPhysical,
    },
    /// An impossible value.
    #[error("{path}: {key} = {value}: it must be a positive number{unless_zero}")]
    Value {
        /// The file.
        path: String,
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
        /// `" or zero"` if zero is allowed.
        unless_zero: &'static str,
    },
    /// A constant of the other kind of motion.
    #[error("{path}: {key} is of a {of} axis, and the file says that this one is {is}. {instead}")]
    Axis {
        /// The file.
        path: String,
        /// The key.
        key: &'static str,
        /// Where it belongs.
        of: &'static str,
        /// What the file says.
        is: &'static str,
        /// What to write.
        instead: &'static str,
    },
    /// A share outside 0 to 1.
    #[error("{path}: {key} = {value}: it must be a share of the PWM period, 0 to 1")]
    Share {
        /// The file.
        path: String,
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
    },
}

impl Rig {
    /// Reads the text of a rig file; `name` is for its errors.
    ///
    /// # Errors
    /// [`RigError`] with the line or the key.
    pub fn parse(name: &str, text: &str) -> Result<Self, RigError> {
        let syntax = |error: toml::de::Error| RigError::Syntax { path: name.into(), message: keys::explained(&error) };
        let mut ignored = Vec::new();
        let mut rig: Self = serde_ignored::deserialize(toml::Deserializer::parse(text).map_err(syntax)?, |key| {
            ignored.push(key.to_string())
        })
        .map_err(syntax)?;
        rig.is_model = ignored.iter().any(|key| key == "effects");
        rig.ignored = ignored.into_iter().filter(|key| key != "effects").collect();
        rig.check_ignored(name, text)?;
        rig.check(name)?;
        Ok(rig)
    }

    /// Refuses keys that are probably mistyped.
    fn check_ignored(&self, path: &str, text: &str) -> Result<(), RigError> {
        for ignored in &self.ignored {
            let (table, key) = ignored.rsplit_once('.').unwrap_or(("", ignored));
            let known: Vec<&'static str> = if table.is_empty() {
                self.keys().map(|(table, _)| table).chain(["effects"]).collect()
            } else {
                self.keys().filter(|(of, _)| *of == table).map(|(_, key)| key).collect()
            };
            if let Some(meant) = keys::nearest(key, known) {
                let line = keys::line(text, &ignored.split('.').collect::<Vec<_>>()).unwrap_or(1);
                return Err(RigError::UnknownKey { path: path.into(), line, key: ignored.clone(), meant });
            }
        }
        Ok(())
    }

    /// Table and name of every key.
    pub(super) fn keys(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let numbers = self.numbers().map(|(key, _)| key);
        numbers.into_iter().chain(OTHER_KEYS).filter_map(|key| key.split_once('.'))
    }

    fn check(&self, path: &str) -> Result<(), RigError> {
        let may_be_zero = [
            "motor.viscous_friction_Nm_s",
            "axis.viscous_friction_N_s_per_m",
            "bridge.drop_V",
            "current_sensor.resolution_A",
            "tachogenerator.ripple",
            "recording.command_delay_s",
            "recording.current_late_s",
            "recording.speed_ahead_s",
            "recording.current_window_s",
            "recording.speed_window_s",
        ];
        for (key, value) in self.numbers() {
            let Some(value) = value else { continue };
            if let Some(name) = key.strip_prefix("motor.") {
                motor::check_constant(name, value).map_err(|source| RigError::Motor { path: path.into(), source })?;
            }
            let zero_allowed = may_be_zero.contains(&key);
            if !value.is_finite() || value < 0.0 || value == 0.0 && !zero_allowed {
                let unless_zero = if zero_allowed { " or zero" } else { "" };
                return Err(RigError::Value { path: path.into(), key, value, unless_zero });
            }
        }
        self.check_axis(path)?;
        self.check_current_sampled_at(path)
    }

    /// One kind of motion in one file.
    fn check_axis(&self, path: &str) -> Result<(), RigError> {
        let Some(motion) = self.axis.stated() else { return Ok(()) };
        let given = |key: &&(&'static str, Option<f64>, &'static str)| key.1.is_some();
        let (of, is, keys) = match motion {
            Motion::Linear => (
                "rotary",
                "linear",
                [
                    ("motor.inertia_kg_m2", self.motor.inertia_kg_m2, "Give axis.mass_kg"),
                    (
                        "motor.torque_constant_Nm_per_A",
                        self.motor.torque_constant_nm_per_a,
                        "Give axis.force_constant_N_per_A",
                    ),
                    (
                        "motor.viscous_friction_Nm_s",
                        self.motor.viscous_friction_nm_s,
                        "Give axis.viscous_friction_N_s_per_m",
                    ),
                ],
            ),
            Motion::Rotary => (
                "linear",
                "rotary",
                [
                    ("axis.mass_kg", self.axis.mass_kg, "Give motor.inertia_kg_m2"),
                    (
                        "axis.force_constant_N_per_A",
                        self.axis.force_constant_n_per_a,
                        "Give motor.torque_constant_Nm_per_A",
                    ),
                    (
                        "axis.viscous_friction_N_s_per_m",
                        self.axis.viscous_friction_n_s_per_m,
                        "Give motor.viscous_friction_Nm_s",
                    ),
                ],
            ),
        };
        match keys.iter().find(given) {
            Some((key, _, instead)) => Err(RigError::Axis { path: path.into(), key, of, is, instead }),
            None => Ok(()),
        }
    }

    fn check_current_sampled_at(&self, path: &str) -> Result<(), RigError> {
        match self.recording.current_sampled_at {
            Some(value) if !(0.0..=1.0).contains(&value) => {
                Err(RigError::Share { path: path.into(), key: CURRENT_SAMPLED_AT, value })
            }
            _ => Ok(()),
        }
    }

    fn numbers(&self) -> [(&'static str, Option<f64>); 21] {
        [
            ("supply.voltage_V", self.supply.voltage_v),
            ("bridge.drop_V", self.bridge.drop_v),
            ("bridge.pwm_Hz", self.bridge.pwm_hz),
            ("encoder.counts_per_rev", self.encoder.counts_per_rev),
            ("current_sensor.resolution_A", self.current_sensor.resolution_a),
            ("tachogenerator.gain_V_per_krpm", self.tachogenerator.gain_v_per_krpm),
            ("tachogenerator.ripple", self.tachogenerator.ripple),
            ("tachogenerator.ripples_per_rev", self.tachogenerator.ripples_per_rev),
            ("recording.command_delay_s", self.recording.command_delay_s),
            ("recording.current_late_s", self.recording.current_late_s),
            ("recording.current_window_s", self.recording.current_window_s),
            ("recording.speed_window_s", self.recording.speed_window_s),
            ("recording.speed_ahead_s", self.recording.speed_ahead_s),
            ("motor.resistance_ohm", self.motor.resistance_ohm),
            ("motor.inductance_H", self.motor.inductance_h),
            ("motor.torque_constant_Nm_per_A", self.motor.torque_constant_nm_per_a),
            ("motor.inertia_kg_m2", self.motor.inertia_kg_m2),
            ("motor.viscous_friction_Nm_s", self.motor.viscous_friction_nm_s),
            ("axis.force_constant_N_per_A", self.axis.force_constant_n_per_a),
            ("axis.mass_kg", self.axis.mass_kg),
            ("axis.viscous_friction_N_s_per_m", self.axis.viscous_friction_n_s_per_m),
        ]
    }
}

/// Zero is a valid place in the period.
const CURRENT_SAMPLED_AT: &str = "recording.current_sampled_at";

/// Keys besides those of [`Rig::numbers`].
const OTHER_KEYS: [&str; 7] = [
    "axis.motion",
    "bridge.kind",
    "bridge.decay",
    "current_sensor.present",
    "tachogenerator.feedback",
    "recording.readings",
    CURRENT_SAMPLED_AT,
];

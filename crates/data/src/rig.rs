//! The rig file: the known values of motor, bridge and sensors.
//!
//! ```toml
//! [supply]
//! voltage_V = 12.0
//! [bridge]
//! drop_V = 2.6              # what the data sheet says it loses; left out: unknown
//! decay = "slow"            # "slow" (off phase brakes) or "coast"
//! [encoder]
//! counts_per_rev = 1024     # after x4 decoding
//! [current_sensor]
//! resolution_A = 0.0265
//! present = true            # false: there is none, a design observes the current
//! [tachogenerator]          # on the motor's shaft
//! gain_V_per_krpm = 3.0     # at 1000 rpm, before the divider by two
//! ripple = 0.05             # amplitude over the mean
//! ripples_per_rev = 22
//! feedback = true           # a loop has its speed from it even where there is an encoder
//! [recording]               # how the program that recorded works; left out: readings of the very moment
//! command_delay_s = 0.00012 # from a sample to the voltage it records
//! readings = "mean"         # speed and current are means since the sample before
//! current_late_s = 0.000033 # that of the current is of so long before
//! current_window_s = 0.001  # current is a mean over so long before the row; left out: found where it shows
//! speed_window_s = 0.008    # the speed is a difference of counts over so long; 0: of the moment; left out: found
//! speed_ahead_s = 0.004     # so much of that after the row; left out: none or half, as fits
//! [axis]                    # a linear axis: m, N, kg in place of rad, Nm, kg m2
//! motion = "linear"
//! mass_kg = 95.0            # in place of motor.inertia_kg_m2
//! [motor]                   # nominal values, each optional
//! resistance_ohm = 5.84
//! inductance_H = 11.7e-3
//! torque_constant_Nm_per_A = 0.072
//! inertia_kg_m2 = 2.2e-5
//! viscous_friction_Nm_s = 5e-6
//! ```

use motorbench_core::HARDWARE;
use motorbench_model::Motion;
use motorbench_model::motor::{self, MotorParameters, NonPhysical};
use motorbench_text::keys;
use serde::{Deserialize, Serialize};

/// A rig file. Every key is optional; a missing one is reported by the command that needs it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Rig {
    /// Motor supply.
    #[serde(skip_serializing_if = "is_default")]
    pub supply: Supply,
    /// Power stage.
    #[serde(skip_serializing_if = "is_default")]
    pub bridge: Bridge,
    /// Quadrature encoder.
    #[serde(skip_serializing_if = "is_default")]
    pub encoder: Encoder,
    /// Current sensor.
    #[serde(skip_serializing_if = "is_default")]
    pub current_sensor: CurrentSensor,
    /// Tachogenerator.
    #[serde(skip_serializing_if = "is_default")]
    pub tachogenerator: Tachogenerator,
    /// Timing of the recording program.
    #[serde(skip_serializing_if = "is_default")]
    pub recording: Timing,
    /// Nominal constants of the motor.
    #[serde(skip_serializing_if = "is_default")]
    pub motor: NominalMotor,
    /// How it moves, and the nominal constants of a linear axis.
    #[serde(skip_serializing_if = "is_default")]
    pub axis: AxisKeys,
    /// Keys of the file without a meaning here.
    #[serde(skip)]
    pub ignored: Vec<String>,
    /// Whether the file has the effects of a model, which are not used either.
    #[serde(skip)]
    pub is_model: bool,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Motor supply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Supply {
    /// Open-circuit voltage at the bridge, in volts.
    #[serde(rename = "voltage_V", skip_serializing_if = "Option::is_none")]
    pub voltage_v: Option<f64>,
}

/// Power stage.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Bridge {
    /// Its name, for a person.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// Voltage drop while driving, from its data sheet.
    #[serde(rename = "drop_V", skip_serializing_if = "Option::is_none")]
    pub drop_v: Option<f64>,
    /// State of the bridge in the off phase of the PWM.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decay: Option<Decay>,
    /// PWM frequency.
    #[serde(rename = "pwm_Hz", skip_serializing_if = "Option::is_none")]
    pub pwm_hz: Option<f64>,
}

/// State of the bridge in the off phase of the PWM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Decay {
    /// The motor is short-circuited: sign-magnitude drive with slow decay.
    Slow,
    /// All switches are open: PWM on the enable pin.
    Coast,
}

/// Quadrature encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Encoder {
    /// Counts per revolution of the motor's shaft after x4 decoding.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub counts_per_rev: Option<f64>,
}

/// Current sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CurrentSensor {
    /// Step of its reading, in amperes.
    #[serde(rename = "resolution_A", skip_serializing_if = "Option::is_none")]
    pub resolution_a: Option<f64>,
    /// `false` if there is no sensor. A design then observes the current.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present: Option<bool>,
}

/// Tachogenerator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Tachogenerator {
    /// Volts at 1000 revolutions a minute, before the firmware's divider by two.
    #[serde(rename = "gain_V_per_krpm", skip_serializing_if = "Option::is_none")]
    pub gain_v_per_krpm: Option<f64>,
    /// Amplitude of its ripple relative to the mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ripple: Option<f64>,
    /// `true` if a loop uses it for the speed although there is an encoder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub feedback: Option<bool>,
    /// Commutator ripples per revolution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ripples_per_rev: Option<f64>,
}

/// Timing of the recording program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Timing {
    /// Time from a sample to the voltage that it records.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub command_delay_s: Option<f64>,
    /// Meaning of speed and current of a sample.
    #[serde(skip_serializing_if = "is_default")]
    pub readings: Readings,
    /// Where in the PWM period the current is sampled, from 0 (start of a pulse) to 1. Without this key the reading is
    /// the mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current_sampled_at: Option<f64>,
    /// The mean of the current ends this much before its sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current_late_s: Option<f64>,
    /// Length of the average of the current before its row; 0: no average.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current_window_s: Option<f64>,
    /// Length of the window over which a speed is a difference of counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_window_s: Option<f64>,
    /// Part of that window after the row.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_ahead_s: Option<f64>,
}

impl Timing {
    /// Timing of this project's firmware on its board, as the simulated chip shows it. The bridge follows with the
    /// third PWM period after the sample. Speed and current are means over the last tick. The current is the mean of
    /// eight of ten conversions, at the end of the off phase.
    pub const FIRMWARE: Self = Self {
        command_delay_s: Some(0.12e-3),
        current_late_s: Some(0.033e-3),
        readings: Readings::Mean,
        current_sampled_at: Some(HARDWARE.current_sampling_step as f64 / HARDWARE.pwm_steps as f64),
        current_window_s: None,
        speed_window_s: None,
        speed_ahead_s: None,
    };

    /// Timing of its control core on the host: a tick's longest delay, and conversions throughout the tick.
    pub const CORE_ON_HOST: Self = Self { command_delay_s: Some(0.2e-3), current_late_s: None, ..Self::FIRMWARE };
}

/// Meaning of a reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Readings {
    /// The value at the time of the sample.
    #[default]
    Instant,
    /// The mean since the previous sample.
    Mean,
}

/// Nominal constants of the motor; see [`MotorParameters`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[allow(missing_docs)]
pub struct NominalMotor {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resistance_ohm: Option<f64>,
    #[serde(rename = "inductance_H", skip_serializing_if = "Option::is_none")]
    pub inductance_h: Option<f64>,
    #[serde(rename = "torque_constant_Nm_per_A", skip_serializing_if = "Option::is_none")]
    pub torque_constant_nm_per_a: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inertia_kg_m2: Option<f64>,
    #[serde(rename = "viscous_friction_Nm_s", skip_serializing_if = "Option::is_none")]
    pub viscous_friction_nm_s: Option<f64>,
}

/// How the axis moves. The constants are those of a linear one, in place of the motor's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AxisKeys {
    /// Rotary or linear; left out: by the columns of a recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<Motion>,
    /// Force over current.
    #[serde(rename = "force_constant_N_per_A", skip_serializing_if = "Option::is_none")]
    pub force_constant_n_per_a: Option<f64>,
    /// Everything that moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// Viscous friction.
    #[serde(rename = "viscous_friction_N_s_per_m", skip_serializing_if = "Option::is_none")]
    pub viscous_friction_n_s_per_m: Option<f64>,
}

impl AxisKeys {
    /// Rotary or linear, where the file says it.
    pub fn stated(&self) -> Option<Motion> {
        let constants = [self.force_constant_n_per_a, self.mass_kg, self.viscous_friction_n_s_per_m];
        self.motion.or(constants.iter().any(Option::is_some).then_some(Motion::Linear))
    }
}

impl NominalMotor {
    /// In the order of [`MotorParameters::named`](motorbench_model::motor::MotorParameters::named).
    pub fn values(&self) -> [Option<f64>; 5] {
        [
            self.resistance_ohm,
            self.inductance_h,
            self.torque_constant_nm_per_a,
            self.inertia_kg_m2,
            self.viscous_friction_nm_s,
        ]
    }
}

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
    fn keys(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
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

    /// The nominal constants, those of a linear axis in the places of a motor's.
    pub fn nominal(&self) -> NominalMotor {
        match self.axis.stated() {
            Some(Motion::Linear) => NominalMotor {
                torque_constant_nm_per_a: self.axis.force_constant_n_per_a,
                inertia_kg_m2: self.axis.mass_kg,
                viscous_friction_nm_s: self.axis.viscous_friction_n_s_per_m,
                ..self.motor
            },
            _ => self.motor,
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

/// A constant of the motor that the file does not give.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("motor.{0} is missing: add it, or identify the motor from a recording")]
pub struct MissingConstant(pub &'static str);

impl NominalMotor {
    /// All five constants.
    ///
    /// # Errors
    /// The first missing constant, by its name in the file.
    pub fn parameters(&self) -> Result<MotorParameters, MissingConstant> {
        let given = |name, value: Option<f64>| value.ok_or(MissingConstant(name));
        Ok(MotorParameters {
            resistance_ohm: given("resistance_ohm", self.resistance_ohm)?,
            inductance_h: given("inductance_H", self.inductance_h)?,
            torque_constant_nm_per_a: given("torque_constant_Nm_per_A", self.torque_constant_nm_per_a)?,
            inertia_kg_m2: given("inertia_kg_m2", self.inertia_kg_m2)?,
            viscous_friction_nm_s: given("viscous_friction_Nm_s", self.viscous_friction_nm_s)?,
        })
    }
}

impl From<MotorParameters> for NominalMotor {
    fn from(motor: MotorParameters) -> Self {
        Self {
            resistance_ohm: Some(motor.resistance_ohm),
            inductance_h: Some(motor.inductance_h),
            torque_constant_nm_per_a: Some(motor.torque_constant_nm_per_a),
            inertia_kg_m2: Some(motor.inertia_kg_m2),
            viscous_friction_nm_s: Some(motor.viscous_friction_nm_s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_example_and_names_what_it_does_not_know() {
        let rig =
            Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n[motor]\nresistance_ohm = 5.84\ncolour = 'red'").unwrap();
        assert_eq!(rig.supply.voltage_v, Some(12.0));
        assert_eq!(rig.motor.resistance_ohm, Some(5.84));
        assert_eq!(rig.ignored, ["motor.colour"]);
    }

    #[test]
    fn values_that_nothing_has_are_refused() {
        let message = |text: &str| Rig::parse("rig.toml", text).unwrap_err().to_string();
        let inertia = message("[motor]\ninertia_kg_m2 = 1e-300");
        assert!(inertia.contains("rig.toml: motor.inertia_kg_m2 = 1e-300: no motor has that"), "{inertia}");
        for text in ["[motor]\nresistance_ohm = \"5.84 ohm\"", "[motor]\nresistance_ohm = '5,84'"] {
            let unit = message(text);
            assert!(unit.contains("line 2") && unit.contains("a number without its unit"), "{unit}");
        }
        let sampled_at = |value: &str| format!("[recording]\ncurrent_sampled_at = {value}");
        for value in ["7", "-1", "1.001", "nan", "inf"] {
            let share = message(&sampled_at(value));
            assert!(
                share.contains("recording.current_sampled_at") && share.contains("a share of the PWM period"),
                "{share}"
            );
        }
        for value in ["0", "0.965", "1"] {
            assert!(Rig::parse("rig.toml", &sampled_at(value)).is_ok(), "{value}");
        }
    }

    /// The notes on a recording advise this value for a speed of the moment.
    #[test]
    fn a_window_of_no_length_is_none() {
        let rig = Rig::parse("rig.toml", "[recording]\nspeed_window_s = 0").unwrap();
        assert_eq!(rig.recording.speed_window_s, Some(0.0));
    }

    /// A mistyped key that would read as a missing constant is reported with its line. Every key of the example is
    /// known.
    #[test]
    fn a_mistyped_key_is_named_with_its_line_and_the_one_that_was_meant() {
        let message = |text: &str| Rig::parse("rig.toml", text).unwrap_err().to_string();
        assert_eq!(
            message("# a rig\n[supply]\nvoltage_v = 12\n"),
            "rig.toml: line 3: unknown key supply.voltage_v; did you mean voltage_V?"
        );
        assert_eq!(message("[encodr]\n"), "rig.toml: line 1: unknown key encodr; did you mean encoder?");
        assert!(message("[motor]\n\nresistence_ohm = 1").contains("line 3: unknown key motor.resistence_ohm"));
        let every: String = Rig::default()
            .keys()
            .map(|(table, key)| match key {
                "kind" => "bridge.kind = 'L293D'\n".into(),
                "decay" => "bridge.decay = 'slow'\n".into(),
                "present" => "current_sensor.present = false\n".into(),
                "feedback" => "tachogenerator.feedback = true\n".into(),
                "counts_per_rev" => "encoder.counts_per_rev = 2000\n".into(),
                "readings" => "recording.readings = 'mean'\n".into(),
                "motion" => "axis.motion = 'linear'\n".into(),
                _ => format!("{table}.{key} = 0.5\n"),
            })
            .collect();
        // No axis has all of them.
        let refused = Rig::parse("rig.toml", &every).unwrap_err().to_string();
        assert!(refused.contains("Give axis.mass_kg"), "{refused}");
        let rig: Rig = toml::from_str(&every).unwrap();
        // After writing, all of them are there: the list misses no key.
        let written: toml::Table = toml::to_string(&rig).unwrap().parse().unwrap();
        let count: usize = written.values().map(|table| table.as_table().unwrap().len()).sum();
        assert_eq!(count, rig.keys().count());
    }

    #[test]
    fn a_linear_axis_has_a_mass_in_the_place_of_an_inertia() {
        let rig = Rig::parse("rig.toml", "[axis]\nmass_kg = 95\nforce_constant_N_per_A = 20\n").unwrap();
        assert_eq!(rig.axis.stated(), Some(Motion::Linear));
        let nominal = rig.nominal();
        assert_eq!((nominal.inertia_kg_m2, nominal.torque_constant_nm_per_a), (Some(95.0), Some(20.0)));
        let message = |text: &str| Rig::parse("rig.toml", text).unwrap_err().to_string();
        let both = message("[axis]\nmotion = 'linear'\n[motor]\ninertia_kg_m2 = 1e-5\n");
        assert!(
            both.contains("motor.inertia_kg_m2 is of a rotary axis") && both.contains("Give axis.mass_kg"),
            "{both}"
        );
        let other = message("[axis]\nmotion = 'rotary'\nmass_kg = 3\n");
        assert!(other.contains("Give motor.inertia_kg_m2"), "{other}");
        assert!(message("[axis]\nmotion = 'linea'\n").contains("line 2"));
        assert!(message("[axis]\nmas_kg = 3\n").contains("did you mean mass_kg?"));
    }

    #[test]
    fn a_missing_constant_is_named() {
        let whole = NominalMotor::from(MotorParameters::PIVT6);
        assert_eq!(whole.parameters(), Ok(MotorParameters::PIVT6));
        let without = NominalMotor { inductance_h: None, ..whole };
        assert!(without.parameters().unwrap_err().to_string().starts_with("motor.inductance_H is missing"));
    }

    #[test]
    fn errors_say_where() {
        let message = |text| Rig::parse("rig.toml", text).unwrap_err().to_string();
        assert!(
            message("[motor]\nresistance_ohm = -1").contains("motor.resistance_ohm = -1: it must be a positive number")
        );
        assert!(message("[motor]\nresistance_ohm = 'x'").contains("line 2"));
        assert!(message("[motor\n").contains("line 1"));
    }
}

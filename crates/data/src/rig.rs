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
//! [recording]               # how the recording program works; default: readings of the moment
//! command_delay_s = 0.00012 # from a sample to the voltage it records
//! readings = "mean"         # speed and current are means since the sample before
//! current_late_s = 0.000033 # the mean of the current ends this much before its sample
//! current_window_s = 0.001  # the current is a mean over this time before the row; default: found where it shows
//! speed_window_s = 0.008    # the speed is a difference of counts over this time; 0: of the moment; default: found
//! speed_ahead_s = 0.004     # the part of that time after the row; default: none or half, as fits
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

mod check;
mod nominal;
#[cfg(test)]
mod tests;

pub use check::RigError;
pub use nominal::{AxisKeys, MissingConstant, NominalMotor};

use motorbench_core::HARDWARE;
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

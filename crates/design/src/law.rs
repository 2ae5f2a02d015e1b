//! The four control laws of the core, and the settings their gains go to.

use motorbench_core::message::Mode;
use motorbench_core::settings::{Param, Text, text};
pub use motorbench_data::names::setting_name;
use serde::Serialize;

/// A control law of the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlLaw {
    /// `motorbench_core::pid`, speed.
    SpeedPid,
    /// `motorbench_core::lqr`, speed.
    SpeedLqr,
    /// `motorbench_core::pid`, position.
    PositionPid,
    /// `motorbench_core::lqr`, position.
    PositionLqr,
}

/// The signal of a feedback gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// Position: the encoder's count at the tick.
    Position,
    /// Speed, as the encoder measures it: the mean over the tick.
    Speed,
    /// The PID's derivative of the measured speed.
    Derivative,
    /// Measured speed behind the PID's derivative filter.
    FilteredSpeed,
    /// Current, mean over the tick.
    Current,
    /// Integral of the control error.
    Integral,
}

impl ControlLaw {
    /// All four laws.
    pub const ALL: [Self; 4] = [Self::SpeedPid, Self::SpeedLqr, Self::PositionPid, Self::PositionLqr];

    /// Its feedback gains in `u = kr r - sum(gain * signal)`. The controlled quantity comes first, the integral last.
    pub fn feedback(self) -> &'static [(Param, Signal)] {
        match self {
            Self::SpeedPid => &[
                (Param::SpeedKp, Signal::Speed),
                (Param::SpeedKd, Signal::Derivative),
                (Param::SpeedKi, Signal::Integral),
            ],
            Self::SpeedLqr => &[
                (Param::LqrSpeedKw, Signal::Speed),
                (Param::LqrSpeedKc, Signal::Current),
                (Param::LqrSpeedKi, Signal::Integral),
            ],
            Self::PositionPid => &[
                (Param::PositionKp, Signal::Position),
                (Param::PositionKd, Signal::FilteredSpeed),
                (Param::PositionKi, Signal::Integral),
            ],
            Self::PositionLqr => &[
                (Param::LqrPositionKp, Signal::Position),
                (Param::LqrPositionKw, Signal::Speed),
                (Param::LqrPositionKc, Signal::Current),
                (Param::LqrPositionKi, Signal::Integral),
            ],
        }
    }

    /// Whether it can have a gain on the current.
    pub fn uses_current(self) -> bool {
        self.feedback().iter().any(|(_, signal)| *signal == Signal::Current)
    }

    /// Whether it controls the position.
    pub fn is_position(self) -> bool {
        self.mode().is_position()
    }

    /// The setting of its derivative filter; an LQR has none.
    pub fn filter(self) -> Option<Param> {
        match self {
            Self::SpeedPid => Some(Param::SpeedTf),
            Self::PositionPid => Some(Param::PositionTf),
            Self::SpeedLqr | Self::PositionLqr => None,
        }
    }

    /// The setting of its anti-windup tracking time.
    pub fn tracking(self) -> Param {
        match self {
            Self::SpeedPid => Param::SpeedTt,
            Self::PositionPid => Param::PositionTt,
            Self::SpeedLqr | Self::PositionLqr => Param::LqrTt,
        }
    }

    /// The mode in which the core runs it.
    pub fn mode(self) -> Mode {
        match self {
            Self::SpeedPid => Mode::SpeedPid,
            Self::SpeedLqr => Mode::SpeedLqr,
            Self::PositionPid => Mode::PositionPid,
            Self::PositionLqr => Mode::PositionLqr,
        }
    }

    /// Name for a person.
    pub fn title(self) -> &'static str {
        match self {
            Self::SpeedPid => "speed PID",
            Self::SpeedLqr => "speed LQR",
            Self::PositionPid => "position PID",
            Self::PositionLqr => "position LQR",
        }
    }
}

/// Unit of a setting.
pub fn setting_unit(param: Param) -> String {
    text(param, Text::Unit).map(char::from).collect()
}

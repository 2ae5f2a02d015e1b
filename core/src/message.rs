//! What the main loop and the control tick say to each other: modes, trips, requests, samples.
//!
//! The console turns a person's line into a [`Request`]; the tick takes it whole at one tick boundary. The tick leaves a
//! [`Sample`] of every tick; telemetry, console and recordings are made of samples and of nothing else.

use crate::excitation::Sequence;

/// Who determines the voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Mode {
    /// Nobody: the bridge coasts.
    #[default]
    Off = 0,
    /// The reference is the voltage.
    OpenLoop = 1,
    /// PID on speed.
    SpeedPid = 2,
    /// PID on position.
    PositionPid = 3,
    /// LQR with integral action on speed.
    SpeedLqr = 4,
    /// LQR with integral action on position.
    PositionLqr = 5,
}

impl Mode {
    /// All modes, by their number.
    pub const fn from_number(number: u8) -> Option<Self> {
        Some(match number {
            0 => Self::Off,
            1 => Self::OpenLoop,
            2 => Self::SpeedPid,
            3 => Self::PositionPid,
            4 => Self::SpeedLqr,
            5 => Self::PositionLqr,
            _ => return None,
        })
    }

    /// Whether the reference is a position, in counts.
    pub const fn is_position(self) -> bool {
        matches!(self, Self::PositionPid | Self::PositionLqr)
    }

    /// Whether the reference is a speed.
    pub const fn is_speed(self) -> bool {
        matches!(self, Self::SpeedPid | Self::SpeedLqr)
    }
}

/// Why the drive was switched off and stays off until cleared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Trip {
    /// Nothing is wrong.
    #[default]
    None = 0,
    /// Current above `trip_peak` for 5 ms.
    OverCurrentPeak = 1,
    /// Heating current above `trip_continuous`.
    OverCurrentThermal = 2,
    /// Driven, drawing stall current and not turning.
    Stall = 3,
    /// The voltage implies a speed, and the encoder shows none.
    EncoderSilent = 4,
    /// Turning against the drive without slowing down: wrong feedback sign.
    Runaway = 5,
    /// The current sensor's signal is at a rail, or it shows a current with the drive disarmed.
    SensorRange = 6,
    /// The motor supply is outside its limits.
    SupplyRange = 7,
    /// The emergency stop is pressed.
    EmergencyStop = 8,
    /// No word from the host for longer than it asked for.
    HostLost = 9,
    /// The main loop stopped responding.
    MainLoopHung = 10,
    /// The voltage implies a speed, and the encoder shows much less.
    EncoderTooFew = 11,
    /// The encoder's lines go to and fro without motion, or change both at once.
    EncoderLines = 12,
    /// The analogue-to-digital converter gives no values.
    ConverterSilent = 13,
    /// The stack has grown into the variables.
    StackOverflow = 14,
}

impl Trip {
    /// The trip with this number.
    pub const fn from_number(number: u8) -> Option<Self> {
        Some(match number {
            0 => Self::None,
            1 => Self::OverCurrentPeak,
            2 => Self::OverCurrentThermal,
            3 => Self::Stall,
            4 => Self::EncoderSilent,
            5 => Self::Runaway,
            6 => Self::SensorRange,
            7 => Self::SupplyRange,
            8 => Self::EmergencyStop,
            9 => Self::HostLost,
            10 => Self::MainLoopHung,
            11 => Self::EncoderTooFew,
            12 => Self::EncoderLines,
            13 => Self::ConverterSilent,
            14 => Self::StackOverflow,
            _ => return None,
        })
    }
}

/// What the main loop asks of the tick, taken whole at one tick boundary. A simulation reads it from the chip's memory, so
/// its layout is fixed: one byte of number, in the order below, then the content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Request {
    /// Drive allowed, in mode off. Refused while a trip is latched or the emergency stop is pressed.
    Arm,
    /// Bridge off at once, coasting.
    Disarm,
    /// Mode off, the bridge brakes, stays armed.
    Stop,
    /// Another mode; bumpless, with the reference at the present value (voltage 0 in open loop).
    Mode(Mode),
    /// A new reference: bits of [`crate::units::Voltage`] in open loop, of [`crate::units::Speed`] in speed modes,
    /// counts in position modes.
    Reference(i32),
    /// Plays a sequence as the reference of the present mode.
    Play(Sequence),
    /// Forgets a latched trip; the drive stays disarmed.
    ClearTrip,
    /// Takes the present mean current as zero; only at rest with the bridge off.
    ZeroCurrent,
    /// Takes the present position as zero counts.
    ZeroPosition,
}

/// Samples that may wait for the main loop: a power of two.
pub const WAITING: u8 = 4;

/// What happened in one tick. Its layout is that of the telemetry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(C)]
pub struct Sample {
    /// Ticks since reset.
    pub tick: u32,
    /// Reference in the unit of the mode, see [`Request::Reference`].
    pub reference: i32,
    /// Position in encoder counts.
    pub counts: i32,
    /// Measured speed, bits of [`crate::units::Speed`].
    pub speed: i16,
    /// Measured current, bits of [`crate::units::Current`].
    pub current: i16,
    /// Duty applied from this tick on, -800..=800 PWM steps.
    pub duty: i16,
    /// Motor supply, bits of [`crate::units::Voltage`]; the setting where it is not measured.
    pub supply: i16,
    /// Mode, armed, bridge, sequence.
    pub state: State,
    /// The latched trip.
    pub trip: Trip,
}

/// The state of the drive in one byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(transparent)]
pub struct State(pub u8);

impl State {
    /// Bits 0..=2 are the mode.
    pub const MODE: u8 = 0x07;
    /// The drive is armed.
    pub const ARMED: u8 = 0x08;
    /// The bridge is enabled (drives or brakes); clear, it coasts.
    pub const ENABLED: u8 = 0x10;
    /// A sequence is playing.
    pub const PLAYING: u8 = 0x20;
    /// The voltage is at a limit (saturation, slew or current).
    pub const LIMITED: u8 = 0x40;
    /// A motion profile is still under way.
    pub const MOVING: u8 = 0x80;

    /// The mode.
    pub const fn mode(self) -> Mode {
        match Mode::from_number(self.0 & Self::MODE) {
            Some(mode) => mode,
            None => Mode::Off,
        }
    }

    /// Whether all bits of `mask` are set.
    pub const fn has(self, mask: u8) -> bool {
        self.0 & mask == mask
    }
}

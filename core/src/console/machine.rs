//! The machine as the console knows it.

use crate::message::{Request, Sample};
use crate::settings::{BuildError, Settings};
use crate::storage::Eeprom;

/// What the console can do to the machine: over interrupts on the Uno, over a plain control loop on the host.
pub trait Machine {
    /// Where the settings are kept.
    type Memory: Eeprom;
    /// Hands a request to the next tick.
    fn request(&mut self, request: Request);
    /// Waits for the next tick and notes its sample, and the counters and states that are not part of one.
    fn look(&mut self, sample: &mut Sample, counters: &mut Counters);
    /// Builds the configuration and lets it take effect at one tick boundary.
    ///
    /// # Errors
    /// The setting that does not fit its fixed-point format; nothing has changed then.
    fn configure(&mut self, settings: &Settings) -> Result<(), BuildError>;
    /// The memory of the settings.
    fn memory(&mut self) -> &mut Self::Memory;
    /// Sends a byte; waits until it is on its way.
    fn send(&mut self, byte: u8);
    /// The host has said something valid.
    fn host_spoke(&mut self);
    /// Notes whether the host goes on talking, without reading it. The console asks for it between the lines of a reply,
    /// which may last longer than the host may be silent.
    fn listen(&mut self);
}

/// What `status` shows beside the sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Illegal transitions of the encoder.
    pub illegal_transitions: u16,
    /// Received bytes that were lost.
    pub overruns: u8,
    /// Bytes that could not be sent.
    pub unsent: u8,
    /// Samples the main loop could not take in time.
    pub dropped: u16,
    /// Bytes of the stack that were never used.
    pub stack_free: u16,
    /// Ticks since the latched trip.
    pub since_trip: u32,
    /// Why the chip was reset.
    pub reset_cause: ResetCause,
    /// A zero calibration of the current is running.
    pub zeroing: bool,
    /// The last zero calibration succeeded.
    pub zero_ok: bool,
}

/// Why the chip was reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum ResetCause {
    /// The bootloader has taken the flags with it.
    #[default]
    Unknown = 0,
    /// Power came on.
    PowerOn = 1,
    /// The reset button, or the host opened the port.
    External = 2,
    /// The supply of the board broke down.
    BrownOut = 3,
    /// The watchdog.
    Watchdog = 4,
    /// The main loop hung; the tick switched the drive off.
    MainLoopHung = 5,
    /// The program panicked; it switched the drive off.
    Panic = 6,
    /// The stack grew into the variables; the tick switched the drive off.
    StackOverflow = 7,
}

//! Excitation signals, played at the control rate.

/// A sequence to play.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Sequence {
    /// Which signal.
    pub kind: Kind,
    /// Largest deviation from the offset, in bits of the reference.
    pub amplitude: i16,
    /// Centre of the signal, in bits of the reference.
    pub offset: i16,
    /// Length of one hold, step or bit, or of one sweep, in ticks.
    pub period: u16,
    /// How many of them.
    pub count: u16,
    /// Seed of the random signals; the same seed plays the same signal. Zero is taken as one.
    pub seed: u16,
}

/// The signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Kind {
    /// Placeholder of the full list.
    #[default]
    Steps = 0,
}

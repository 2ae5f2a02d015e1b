//! The keys of the tuning console.

/// The requests of a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Select the gain above.
    Up,
    /// Select the gain below.
    Down,
    /// Decrease it.
    Less,
    /// Increase it.
    More,
    /// Lower the reference.
    Lower,
    /// Raise the reference.
    Higher,
    /// Arm the drive.
    Arm,
    /// Switch the drive off at once.
    Stop,
    /// Step test: a step to the reference, and back to rest.
    Step,
    /// Select the other loop.
    Switch,
    /// Undo the last change.
    Undo,
    /// Save the gains on the board.
    Save,
    /// Start a recording, or end it.
    Record,
}

//! The simulation in free run.

/// [`crate::free_run::replay`].
pub(crate) mod replay {
    /// Longest step for a recording of many rows; one with fewer takes a tenth of its interval, at most
    /// [`LONGEST_OF_SLOW_S`]. A step is exact but for terms that change within it.
    pub const LONGEST_S: f64 = 1e-3;
    pub const LONGEST_OF_SLOW_S: f64 = 2e-3;
    /// A voltage change is a jump from this share of the supply on.
    pub const LEAP: f64 = 0.1;
    /// A row with a jump takes steps of this share of the longest: the current may turn round, and with it a drop.
    pub const OF_LEAP: f64 = 0.25;
    /// Less than this many times as many steps are hardly more: they cost less than another simulation.
    pub const HARDLY_MORE: f64 = 1.15;
    /// From this many standard deviations of the noise on, a first reading differs from zero.
    pub const NOT_ZERO: f64 = 5.0;
    /// So many ways of cutting are kept: coarse and fine, with and without a shift of the delay.
    pub const MOST_KEPT: usize = 4;
}

/// [`crate::free_run::run`].
pub(crate) mod run {
    /// A held rotor is simulated with this inertia, so that no torque moves it.
    pub const HELD_KG_M2: f64 = 1e9;
}

//! The measured lack beside each cause.

/// A bin that is known no better than this share of the greatest value of the law shows nothing.
pub const LEAST_KNOWN: f64 = 0.5;
/// Bins of the drawn law in each bin of the lack.
pub const FINER: usize = 4;

/// [`crate::evidence::axis`].
pub(crate) mod axis {
    /// Bins of a quantity with a sign, to either side of zero. They are narrow near zero, where friction and drops change.
    pub const EACH_SIDE: usize = 14;
    /// Bins of a quantity without a sign.
    pub const BINS: usize = 28;
    /// Fewest bins of a period of a wave.
    pub const EACH_PERIOD: usize = 8;
    /// Fewest bins of a turn.
    pub const EACH_TURN: usize = 24;
}

/// [`crate::evidence::forces`].
pub(crate) mod forces {
    /// Rows that the responses are compared in: a recording has many more than bins.
    pub const MOST_ROWS: usize = 8000;
    /// Size of a nudge as a share of the law: so small that the motor answers linearly.
    pub const NUDGE: f64 = 1e-3;
    /// The strength before any data: so many times the law's own.
    pub const PRIOR: f64 = 10.0;
    /// Share of the greatest current below which pulses of the PWM decide on the drop.
    pub const SMALL_CURRENT: f64 = 0.02;
}

/// [`crate::evidence::readings`].
pub(crate) mod readings {
    /// A voltage that changes by this share of the supply is a step.
    pub const STEP: f64 = 0.1;
    /// After a step nearly all of what the law does is shown: this share of its square.
    pub const NEARLY_ALL: f64 = 0.98;
}

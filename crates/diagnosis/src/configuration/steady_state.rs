//! Operating points at rest.

/// Readings whose voltages differ by less than this share of the greatest are one level.
pub const SAME_LEVEL: f64 = 0.005;
/// Fewer levels cannot determine a line.
pub const FEWEST_LEVELS: usize = 3;
/// A term is needed if it is this many standard errors from zero.
pub const NEEDED_SIGMAS: f64 = 3.0;
/// Levels of one test agree to this share of the voltage: winding and grease warm from one to the next. A smaller rest
/// is not named.
pub const ALIKE_SHARE: f64 = 0.01;
/// Rows whose back-EMF is less than this share of the voltage: the rotor is held or hardly turns.
pub const NEARLY_AT_REST: f64 = 0.05;
/// Rows at less than this share of the greatest voltage: nothing drives the motor, and the current is the offset of its
/// sensor.
pub const UNDRIVEN: f64 = SAME_LEVEL;
/// A single reading may be off by this share; only the ratios of such errors matter.
pub const ONE_READING: f64 = 0.01;
/// Readings that agree to more digits than this are rounded.
pub const ROUNDED: f64 = 1e-6;

/// [`crate::steady_state::explanation`].
pub(crate) mod explanation {
    /// A resistance that grows with speed is rare in a motor. It is named only if constant parameters do not hold.
    pub const RARE: usize = 3;
    /// A table cannot determine more terms than this.
    pub const MOST_TERMS: usize = 3;
    /// An explanation that lacks a term at this many standard errors ranks behind one of the same size that lacks none.
    /// That is too little to name the term, but enough to prefer the other.
    pub const DOUBTED_SIGMAS: f64 = 2.0;
    /// Spread of the resistance over rotor positions: the brushes touch other segments.
    pub const OTHER_POSITION: f64 = 0.1;
    /// A held and a turning winding agree to this share: one is warmer, and its brushes slide.
    pub const HELD_AS_TURNING: f64 = 0.02;
}

/// [`crate::steady_state::line`].
pub(crate) mod line {
    /// Columns whose smallest singular value is below this share of the largest are linearly dependent.
    pub const SAME_COLUMNS: f64 = 1e-9;
    /// Largest number of standard errors that double precision can represent as a probability.
    pub const MOST_SIGMAS: f64 = 37.0;
}

/// [`crate::steady_state::rest`].
pub(crate) mod rest {
    /// Powers of the curve through it, and the levels needed beyond its constants: few levels allow no more than a
    /// parabola.
    pub const MOST_POWERS: usize = 4;
    pub const LEVELS_TOO_MANY: usize = 3;
    /// With few levels any curve explains something. A rest depends on a column if a curve explains half of it...
    pub const LEAST_SHARE: f64 = 0.5;
    /// ... and on another as well that explains all but this share: without a load voltage, speed and current change
    /// together.
    pub const AS_WELL: f64 = 0.05;
}

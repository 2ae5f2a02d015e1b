//! The comparison of models with a recording.

/// By so much the second may be early or late, as a share of the first.
pub const LARGEST_DELAY: f64 = 0.25;
/// Shifts that are tried on either side at most, before the best is refined.
pub const SHIFTS: usize = 400;
/// Samples that a shift is judged by at most.
pub const JUDGED: usize = 2000;
/// Fewer common samples say nothing.
pub const FEWEST: usize = 10;
/// A channel whose spread is less than this share of its values is constant: files have nine digits.
pub const ROUNDING: f64 = 1e-8;

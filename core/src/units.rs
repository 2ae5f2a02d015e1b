//! THE fixed-point formats: what one bit of every signal and gain is worth.
//!
//! | quantity | type | one bit | range |
//! |---|---|---|---|
//! | voltage | [`Voltage`] | 2^-10 V = 0.98 mV | +-32 V |
//! | current | [`Current`] | 2^-12 A = 0.24 mA | +-8 A |
//! | speed | [`Speed`] | 2^-15 of `speed_range` (512 rad/s: 0.0156 rad/s = 0.15 rpm) | +-`speed_range` |
//! | position error | [`PositionError`] | 2^-15 of `position_range` (32 rad: 0.98 mrad) | +-`position_range` |
//! | angle | `i32` | one encoder count (x4) | +-2^31 counts |
//! | duty | `i16` | one PWM step of 1/800 | +-800 |
//! | proportional gains | [`Gain`] | 2^-10 output bits per input bit | +-16 |
//! | integral gains | [`IntegralGain`] | 2^-16 output bits per input bit and tick | +-0.25 |
//! | filter and tracking fractions | [`Fraction`] | 2^-16 per tick | 0..1 |
//!
//! Speed and position are in per unit of a range that belongs to the rig, because motors differ by decades. So a geared
//! motor at 10 rad/s has as many bits as a bare one at 1000 rad/s. The ranges are powers of two, so converting them costs
//! no accuracy. Everything saturates at the ends of its range and never wraps.

use fixed::types::extra::{U10, U12, U15, U16};
use fixed::{FixedI16, FixedU16};

/// Volts at the motor, 2^-10 V a bit.
pub type Voltage = FixedI16<U10>;
/// Amperes through the armature, 2^-12 A a bit.
pub type Current = FixedI16<U12>;
/// Shaft speed in per unit of the rig's `speed_range`.
pub type Speed = FixedI16<U15>;
/// Position error in per unit of the rig's `position_range`.
pub type PositionError = FixedI16<U15>;
/// Output bits per input bit, times 2^-10; [`GAIN_LIMIT`] holds it within +-16.
pub type Gain = FixedI16<U10>;
/// Output bits per input bit and tick, times 2^-16; [`GAIN_LIMIT`] holds it within +-0.25.
pub type IntegralGain = FixedI16<U16>;
/// A part of one, per tick: filters, anti-windup tracking.
pub type Fraction = FixedU16<U16>;

/// Largest magnitude of the bits of a [`Gain`] or [`IntegralGain`]. Three products of such a gain with any signal still
/// fit 32 bits, so the sums of the controllers need no overflow checks.
pub const GAIN_LIMIT: i16 = 1 << 14;

/// Bits of one volt.
pub const VOLT: f32 = 1024.0;
/// Bits of one ampere.
pub const AMPERE: f32 = 4096.0;
/// Bits of a per-unit signal's full range.
pub const FULL_RANGE: f32 = 32768.0;

/// What is wrong with a setting: which rule it breaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Rule {
    /// The fixed-point format cannot hold a value this large.
    #[default]
    TooLarge,
    /// The value is below the setting's range.
    TooSmall,
    /// The value is not zero but would become zero in the fixed-point format.
    RoundsToZero,
    /// The value must be a power of two.
    NotPowerOfTwo,
    /// The value is not one of those allowed.
    NotAllowed,
    /// The value is not a number, or infinite.
    NotFinite,
}

/// `value / bit`, rounded to the nearest whole number and checked against `limit`.
///
/// # Errors
/// [`Rule::NotFinite`]; [`Rule::TooLarge`] beyond `limit` bits; [`Rule::RoundsToZero`] where something becomes nothing.
pub fn quantise(value: f32, bits_per_unit: f32, limit: u16) -> Result<i32, Rule> {
    let bits = value * bits_per_unit;
    let magnitude = bits.abs();
    if !magnitude.is_finite() {
        return Err(Rule::NotFinite);
    }
    if magnitude > limit as f32 + 0.5 {
        return Err(Rule::TooLarge);
    }
    let rounded = crate::arith::whole(magnitude + 0.5);
    if rounded > limit as i32 {
        Err(Rule::TooLarge)
    } else if rounded == 0 && magnitude != 0.0 {
        Err(Rule::RoundsToZero)
    } else {
        Ok(if bits.is_sign_negative() { -rounded } else { rounded })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantise_rounds_and_names_the_broken_rule() {
        assert_eq!(quantise(1.0, VOLT, 32767), Ok(1024));
        assert_eq!(quantise(-0.0009, VOLT, 32767), Ok(-1));
        assert_eq!(quantise(0.0001, VOLT, 32767), Err(Rule::RoundsToZero));
        assert_eq!(quantise(0.0, VOLT, 32767), Ok(0));
        assert_eq!(quantise(33.0, VOLT, 32767), Err(Rule::TooLarge));
        assert_eq!(quantise(1e30, VOLT, 32767), Err(Rule::TooLarge));
        assert_eq!(quantise(f32::NAN, VOLT, 32767), Err(Rule::NotFinite));
        assert_eq!(quantise(f32::INFINITY, VOLT, 32767), Err(Rule::NotFinite));
    }
}

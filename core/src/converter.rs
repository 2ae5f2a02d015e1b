//! THE converter: what a step of the ADC is worth, and how often each of its channels is read.
//!
//! A conversion every second PWM period; ten slots make a round of one millisecond: four of the current, one of the
//! tachogenerator, four of the current, one of the supply.

use crate::HARDWARE;

/// Full scale, in volts: AVcc.
pub const FULL_SCALE_V: f32 = HARDWARE.converter.full_scale_v;
/// Steps of the full scale; a conversion is 0..=1023.
pub const STEPS: u16 = HARDWARE.converter.steps;
/// A step, in volts; no bit of it is rounded.
pub const STEP_V: f32 = HARDWARE.converter.step_v();
/// PWM periods from one conversion to the next.
pub const PERIODS_PER_CONVERSION: u8 = HARDWARE.converter.periods_per_conversion;
/// Conversions of the current in a row.
pub const BLOCK: u8 = HARDWARE.converter.block;
/// Slots of a round: two blocks, and one of another channel after each.
pub const SLOTS: u8 = 2 * (BLOCK + 1);
/// Rounds a second: so often are tachogenerator and supply converted.
pub const ROUNDS_HZ: u32 = HARDWARE.pwm_hz / (PERIODS_PER_CONVERSION as u32 * SLOTS as u32);

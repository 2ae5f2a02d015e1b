//! THE converter: what a step of the ADC is worth, and how often each of its channels is read.
//!
//! A conversion every second PWM period; ten slots make a round of one millisecond: four of the current, one of the
//! tachogenerator, four of the current, one of the supply.

use crate::pins::PWM_HZ;

/// Full scale, in volts: AVcc.
pub const FULL_SCALE_V: f32 = 5.0;
/// Steps of the full scale; a conversion is 0..=1023.
pub const STEPS: u16 = 1024;
/// A step, in volts; no bit of it is rounded.
pub const STEP_V: f32 = FULL_SCALE_V / STEPS as f32;
/// PWM periods from one conversion to the next.
pub const PERIODS_PER_CONVERSION: u8 = 2;
/// Conversions of the current in a row.
pub const BLOCK: u8 = 4;
/// Slots of a round: two blocks, and one of another channel after each.
pub const SLOTS: u8 = 2 * (BLOCK + 1);
/// Rounds a second: so often are tachogenerator and supply converted.
pub const ROUNDS_HZ: u32 = PWM_HZ / (PERIODS_PER_CONVERSION as u32 * SLOTS as u32);

//! Tachogenerator on the ADC: `tacho_gain` V per 1000 rpm, halved by a divider, 5 % ripple at commutation frequency.
//!
//! The ADC sees a magnitude; the sign is the drive's. A motor driven the other way still turns the old way until it
//! has come through standstill. So the sign follows the voltage only while the magnitude is below [`NEAR_ZERO`] ADC
//! steps. Otherwise it keeps its value. Resolution: one ADC step (3.3 rpm at 3 V per 1000 rpm) before the filter. The
//! ripple is the filter's business: `speed_filter`.

use crate::arith::{call_saturate_i16, mul_u16};
use crate::converter::STEP_V;
use crate::quantiser::Quantiser;
use crate::settings::{BuildError, Param, Settings};
use crate::units::{FULL_RANGE, VOLT};

/// ADC steps (24 mV before the divider: 8 rpm at 3 V per 1000 rpm) below which the direction may turn. Fewer are no
/// motion either, since a converter's offset must not hide a stall.
pub const NEAR_ZERO: u16 = 5;
/// Least voltage whose sign counts, in volts.
pub const LEAST_VOLTAGE_V: f32 = 0.25;
/// The same in bits.
const LEAST_VOLTAGE: i16 = (LEAST_VOLTAGE_V * VOLT) as i16;
/// What the divider leaves of its voltage.
pub const DIVIDER: f32 = 0.5;

/// The scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct TachoConfig {
    /// Bits of speed an ADC step, times 2^8.
    scale: u16,
}

impl TachoConfig {
    /// From `tacho_gain` and `speed_range`. A scale outside the format is blamed on `tacho_gain`.
    #[inline(always)]
    pub fn quantised(q: &mut Quantiser) -> Self {
        // V per rad/s after the divider, and rad/s an ADC step.
        const GAIN: f32 = 60.0 / core::f32::consts::TAU / 1000.0 * DIVIDER;
        q.of(STEP_V / GAIN * 256.0 * FULL_RANGE).over(Param::SpeedRange).over(Param::TachoGain);
        Self { scale: q.round(Param::TachoGain, u16::MAX) }
    }

    /// The same, on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn build(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build(settings, Self::quantised)
    }
}

/// The direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct TachoState {
    backward: bool,
}

impl TachoState {
    /// One tick: conversion 0..=1023 and the voltage of the tick before; speed in bits, not filtered yet.
    #[inline(never)]
    pub fn step(&mut self, config: &TachoConfig, sample: u16, voltage: i16) -> i16 {
        if sample < NEAR_ZERO && voltage.saturating_abs() >= LEAST_VOLTAGE {
            self.backward = voltage < 0;
        }
        let magnitude = call_saturate_i16((mul_u16(sample, config.scale) >> 8) as i32);
        if self.backward { -magnitude } else { magnitude }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Within one bit and the scale's rounding of the exact speed.
        #[test]
        fn scale(gain in 0.5f32..30.0, sample in 0u16..1024) {
            let mut settings = Settings::defaults();
            settings.set(Param::TachoGain, gain).unwrap();
            let Ok(config) = TachoConfig::build(&settings) else { return Ok(()) };
            let exact = sample as f64 * 5.0 / 1024.0 * 2.0 / gain as f64 * 1000.0 / 60.0 * std::f64::consts::TAU * 64.0;
            let speed = TachoState::default().step(&config, sample, 5000) as f64;
            let tolerance = 1.0 + exact * 0.5 / config.scale as f64;
            prop_assert!((speed - exact.min(32767.0)).abs() <= tolerance, "{speed} for {exact}");
        }
    }

    #[test]
    fn the_sign_turns_at_standstill_not_with_the_voltage() {
        let config = TachoConfig::build(&Settings::defaults()).unwrap();
        let mut state = TachoState::default();
        assert!(state.step(&config, 300, 8000) > 0);
        // Reversed voltage: the motor still turns forward while it slows down.
        for sample in (NEAR_ZERO..300).rev() {
            assert!(state.step(&config, sample, -8000) > 0, "{sample}");
        }
        state.step(&config, 2, -8000);
        for sample in 3..300 {
            assert!(state.step(&config, sample, -8000) < 0, "{sample}");
        }
        // Coasting: without a voltage the direction stays.
        assert!(state.step(&config, 1, 0) <= 0);
    }
}

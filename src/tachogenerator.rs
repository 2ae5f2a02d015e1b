//! Tachogenerator on the ADC: `tacho_gain` V per 1000 rpm, halved by a divider, 5 % ripple at commutation frequency.
//!
//! The ADC sees a magnitude; the sign is the drive's. A motor driven the other way still turns the old way until it
//! has come through standstill, so the sign follows the voltage only while the magnitude is below [`NEAR_ZERO`] ADC
//! steps, and keeps its value otherwise. Resolution: one ADC step (3.3 rpm at 3 V per 1000 rpm) before the filter. The
//! ripple is the filter's business: `speed_filter`.

use crate::arith::{mul_u16, saturate_i16};
use crate::low_pass::{LowPassConfig, LowPassState};
use crate::quantiser::Quantiser;
use crate::settings::Param;

/// ADC steps (24 mV before the divider: 8 rpm at 3 V per 1000 rpm) below which the direction may turn.
pub const NEAR_ZERO: u16 = 5;
/// Least voltage, in bits, whose sign counts: a quarter of a volt.
const LEAST_VOLTAGE: i16 = 256;

/// Scale and filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct TachoConfig {
    /// Bits of speed an ADC step, times 2^8.
    scale: u16,
    filter: LowPassConfig,
}

impl TachoConfig {
    /// From `tacho_gain`, `speed_range` and `speed_filter`.
    #[inline(never)]
    pub fn quantised(q: &mut Quantiser) -> Self {
        // V per rad/s after the divider.
        let gain = q.get(Param::TachoGain) * (60.0 / core::f32::consts::TAU / 1000.0 * 0.5);
        let speed_per_step = 5.0 / 1024.0 / gain;
        let unit = q.bits_per_unit(Param::SpeedRange) * 256.0;
        Self {
            scale: q.value(Param::TachoGain, speed_per_step, unit, u16::MAX),
            filter: LowPassConfig::quantised(q, Param::SpeedFilter),
        }
    }
}

/// Direction and filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct TachoState {
    backward: bool,
    filter: LowPassState,
}

impl TachoState {
    /// One tick: conversion 0..=1023 and the voltage of the tick before; speed in bits.
    #[inline]
    pub fn step(&mut self, config: &TachoConfig, sample: u16, voltage: i16) -> i16 {
        if sample < NEAR_ZERO && voltage.saturating_abs() >= LEAST_VOLTAGE {
            self.backward = voltage < 0;
        }
        let magnitude = saturate_i16((mul_u16(sample, config.scale) >> 8) as i32);
        self.filter.step(&config.filter, if self.backward { -magnitude } else { magnitude })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use proptest::prelude::*;

    proptest! {
        /// Within one bit and the scale's rounding of the exact speed.
        #[test]
        fn scale(gain in 0.5f32..30.0, sample in 0u16..1024) {
            let mut settings = Settings::defaults();
            settings.set(Param::TachoGain, gain).unwrap();
            let Ok(config) = Quantiser::checked(&settings, TachoConfig::quantised) else { return Ok(()) };
            let exact = sample as f64 * 5.0 / 1024.0 * 2.0 / gain as f64 * 1000.0 / 60.0 * std::f64::consts::TAU * 64.0;
            let speed = TachoState::default().step(&config, sample, 5000) as f64;
            let tolerance = 1.0 + exact * 0.5 / config.scale as f64;
            prop_assert!((speed - exact.min(32767.0)).abs() <= tolerance, "{speed} for {exact}");
        }
    }

    #[test]
    fn the_sign_turns_at_standstill_not_with_the_voltage() {
        let config = Quantiser::checked(&Settings::defaults(), TachoConfig::quantised).unwrap();
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

//! ACS712 current sensor on the 10-bit ADC: 2.5 V at rest, `current_gain` mV/A, eight conversions summed for each tick.
//!
//! One step of the sum is an eighth of an ADC step: 3.3 mA at 185 mV/A, where one conversion resolves 26 mA. The
//! sensor's own noise (about one ADC step) dithers the conversions, so the eighths are real. Conversion:
//! `current = (sum - zero) gain`, exact to one bit (0.24 mA) and the rounding of the gain (0.02 %).
//!
//! The zero is the mean of 256 sums at rest, kept to a quarter of a step of the sum (0.8 mA). A zero farther than 0.25 V
//! from the middle of the range is refused, and so is one whose sums spread over more than 0.1 V. Then something drives a
//! current, or the sensor is not there; the old zero stays.

use crate::arith::{mul_i16, saturate_i16};
use crate::converter::{self, BLOCK};
use crate::quantiser::Quantiser;
use crate::settings::{BuildError, Param, Settings};
use crate::units::AMPERE;

/// Conversions in a sum.
const SUMMED: u16 = 2 * BLOCK as u16;
/// The sum in the middle of the range.
const MIDDLE: u16 = SUMMED * converter::STEPS / 2;
/// The largest sum.
const LARGEST: u16 = SUMMED * (converter::STEPS - 1);
/// Steps of the sum in a volt.
const STEPS_PER_VOLT: f32 = SUMMED as f32 / converter::STEP_V;
/// Farthest zero: 0.25 V.
const FARTHEST: u16 = (STEPS_PER_VOLT / 4.0) as u16;
/// Widest spread while zeroing: 0.1 V.
const WIDEST: u16 = (STEPS_PER_VOLT / 10.0) as u16;
/// A mean closer to a rail than this many steps of the sum means that conversions have hit it.
const RAIL_MARGIN: u16 = 16;

/// Bits of current a step of the sum, times 2^8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct CurrentConfig(i16);

impl CurrentConfig {
    /// From `current_gain`.
    #[inline(always)]
    pub fn quantised(q: &mut Quantiser) -> Self {
        q.of(AMPERE * 256.0 * 1000.0 / STEPS_PER_VOLT).over(Param::CurrentGain);
        Self(q.round(Param::CurrentGain, i16::MAX as u16) as i16)
    }

    /// The same, on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn build(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build(settings, Self::quantised)
    }
}

/// One tick's current.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Bits of [`crate::units::Current`].
    pub current: i16,
    /// The signal is at a rail: the current is at least this large, or the sensor is not connected.
    pub saturated: bool,
}

/// The zero, and its calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CurrentState {
    /// Zero of the sum, times 4.
    zero: u16,
    /// Sum of the sums while zeroing.
    total: u32,
    lowest: u16,
    highest: u16,
    /// Ticks of zeroing left; zero when idle.
    left: u16,
    ok: bool,
}

/// Ticks of one calibration.
const ZERO_TICKS: u16 = 256;

impl Default for CurrentState {
    fn default() -> Self {
        Self { zero: MIDDLE << 2, total: 0, lowest: 0, highest: 0, left: 0, ok: false }
    }
}

impl CurrentState {
    /// One tick: `sum` of eight conversions, 0..=8184.
    #[inline]
    pub fn step(&mut self, config: &CurrentConfig, sum: u16) -> Reading {
        if self.left != 0 {
            self.calibrate(sum);
        }
        // In quarters of a step: within 16 bits, because the zero is near the middle.
        let quarters = (sum << 2).wrapping_sub(self.zero) as i16;
        let current = saturate_i16(mul_i16(quarters, config.0) >> 10);
        Reading { current, saturated: !(RAIL_MARGIN..=LARGEST - RAIL_MARGIN).contains(&sum) }
    }

    /// Begins a calibration; the current must be zero for the next 256 ticks.
    pub fn start_zero(&mut self) {
        *self = Self { zero: self.zero, total: 0, lowest: u16::MAX, highest: 0, left: ZERO_TICKS, ok: false };
    }

    /// Whether a calibration is under way.
    pub fn zeroing(&self) -> bool {
        self.left != 0
    }

    /// Whether the last calibration was accepted.
    pub fn zero_ok(&self) -> bool {
        self.ok
    }

    #[inline(never)]
    fn calibrate(&mut self, sum: u16) {
        self.total += sum as u32;
        self.lowest = self.lowest.min(sum);
        self.highest = self.highest.max(sum);
        self.left -= 1;
        if self.left == 0 {
            // 256 sums: the mean is the upper bytes; two fractional bits are kept.
            let mean_quarters = ((self.total + 32) >> 6) as u16;
            let mean = mean_quarters >> 2;
            self.ok = mean.abs_diff(MIDDLE) <= FARTHEST && self.highest - self.lowest <= WIDEST;
            if self.ok {
                self.zero = mean_quarters;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn config(gain: f32) -> CurrentConfig {
        let mut settings = Settings::defaults();
        settings.set(Param::CurrentGain, gain).unwrap();
        CurrentConfig::build(&settings).unwrap()
    }

    proptest! {
        /// Within 2 bits (0.5 mA) and the gain's rounding of the exact conversion.
        #[test]
        fn conversion_is_exact(gain in 60f32..400.0, sum in 0u16..=8184, zero in 3900u16..4300) {
            let config = config(gain);
            let mut state = CurrentState::default();
            state.start_zero();
            for _ in 0..256 {
                state.step(&config, zero);
            }
            prop_assert!(state.zero_ok() && !state.zeroing());
            let exact = (sum as f64 - zero as f64) * 5.0 / 8192.0 / (gain as f64 / 1000.0) * 4096.0;
            let reading = state.step(&config, sum);
            let tolerance = 2.0 + exact.abs() * 0.5 / config.0 as f64;
            let exact = exact.clamp(-32768.0, 32767.0);
            prop_assert!((reading.current as f64 - exact).abs() <= tolerance, "{} for {exact}", reading.current);
        }
    }

    #[test]
    fn the_zero_has_a_finer_grain_than_the_sum() {
        let config = config(185.0);
        let mut state = CurrentState::default();
        state.start_zero();
        for tick in 0..256 {
            state.step(&config, 4100 + (tick % 4 == 0) as u16);
        }
        // Zero at 4100.25: both neighbours read a quarter and three quarters of 3.3 mA away.
        assert_eq!(state.step(&config, 4100).current, -4);
        assert_eq!(state.step(&config, 4101).current, 10);
    }

    #[test]
    fn a_bad_zero_is_refused_and_the_old_one_kept() {
        let config = config(185.0);
        for sums in [[5000, 5000], [4096, 4296], [0, 0], [8184, 8184]] {
            let mut state = CurrentState::default();
            state.start_zero();
            for tick in 0..256 {
                state.step(&config, sums[tick % 2]);
            }
            assert!(!state.zero_ok(), "{sums:?}");
            assert_eq!(state.step(&config, 4096).current, 0);
        }
    }

    #[test]
    fn rails_are_seen() {
        let mut state = CurrentState::default();
        let config = config(185.0);
        for (sum, saturated) in [(0, true), (8, true), (8184, true), (8170, true), (20, false), (8160, false)] {
            assert_eq!(state.step(&config, sum).saturated, saturated, "{sum}");
        }
    }
}

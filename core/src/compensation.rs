//! Compensation from an extended model: voltage that the bridge's drop and friction would take, added beforehand. Off
//! (all zero) by default.
//!
//! * Friction: `comp_friction_fwd`/`_rev` by the sign of the reference's speed. The reference and not the measurement,
//!   because a measured sign would feed noise back with the full friction voltage.
//! * Drop: `comp_drop` by the sign of the controller's voltage.
//!
//! Both are smooth around zero: `s(z) = z (2 - |z|)` for `|z| < 1`, else the sign, with `z` = signal / width. It has a
//! continuous slope, 2 at zero and 0 at the edges, and never falls, so voltage plus drop stays monotone. Within 2 bits
//! (2 mV), and 0.1 % of the amplitude, of the formula.

use crate::arith::{call_mul_i16, call_mul_i16_u16, call_saturate_i16};
use crate::quantiser::Quantiser;
use crate::settings::{BuildError, Param, Settings};
use crate::units::{FULL_RANGE, Rule, VOLT};

/// One smooth step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
struct SmoothSign {
    /// 2^14 over the width in bits, times 2^8.
    slope: u16,
}

impl SmoothSign {
    /// From a width, of which the formula so far gives the bits of one unit over 64.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    fn quantised(q: &mut Quantiser, width: Param) -> Self {
        q.times(width);
        // The narrowest is 64 bits (63 mV, 1 rad/s at a range of 512): below, the slope has no place in the format.
        if q.value() < 1.0 {
            q.refuse(width, Rule::TooSmall);
        }
        Self { slope: q.one_over(width, 0.0) }
    }

    /// The smooth sign of `signal`, times `amplitude`.
    #[inline(never)]
    fn scaled(&self, amplitude: i16, signal: i16) -> i16 {
        let z = call_mul_i16_u16(signal, self.slope) >> 8;
        let z = z.clamp(-16384, 16384) as i16;
        // 2^14 is one.
        let sign = (call_mul_i16(z, 32767 - z.abs()) >> 14) as i16;
        call_saturate_i16((call_mul_i16(amplitude, sign) + 0x2000) >> 14)
    }
}

/// Amplitudes in bits of voltage, and the smooth signs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct CompensationConfig {
    drop: i16,
    forward: i16,
    reverse: i16,
    drop_sign: SmoothSign,
    friction_sign: SmoothSign,
}

impl CompensationConfig {
    /// From the settings `comp_*`.
    #[inline(always)]
    pub fn quantise(&mut self, q: &mut Quantiser) {
        self.drop = q.bits(Param::CompDrop);
        self.forward = q.bits(Param::CompFrictionForward);
        self.reverse = q.bits(Param::CompFrictionReverse);
        self.drop_sign = SmoothSign::quantised(q.of(VOLT / 64.0), Param::CompDropWidth);
        q.of(FULL_RANGE / 64.0).over(Param::SpeedRange);
        self.friction_sign = SmoothSign::quantised(q, Param::CompFrictionWidth);
    }

    /// The same, on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn build(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build_in_place(settings, Self::quantise)
    }

    /// Largest voltage [`CompensationConfig::drop`] can add.
    #[inline(always)]
    pub fn drop_voltage(&self) -> i16 {
        self.drop
    }

    /// Voltage against the bridge's drop, for the controller's voltage.
    #[inline(always)]
    pub fn drop(&self, voltage: i16) -> i16 {
        if self.drop == 0 { 0 } else { self.drop_sign.scaled(self.drop, voltage) }
    }

    /// Voltage against friction, for the reference's speed.
    #[inline(always)]
    pub fn friction(&self, speed: i16) -> i16 {
        let amplitude = if speed < 0 { self.reverse } else { self.forward };
        if amplitude == 0 { 0 } else { self.friction_sign.scaled(amplitude, speed) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn settings() -> impl Strategy<Value = Settings> {
        (0f32..8.0, 0.1f32..8.0, 0f32..8.0, 0f32..8.0, 1.1f32..500.0).prop_map(
            |(drop, width, forward, reverse, speed)| {
                let mut settings = Settings::defaults();
                let values = [
                    (Param::CompDrop, if drop < 0.1 { 0.0 } else { drop }),
                    (Param::CompDropWidth, width),
                    (Param::CompFrictionForward, if forward < 0.1 { 0.0 } else { forward }),
                    (Param::CompFrictionReverse, if reverse < 0.1 { 0.0 } else { reverse }),
                    (Param::CompFrictionWidth, speed),
                ];
                for (param, value) in values {
                    settings.set(param, value).unwrap();
                }
                settings
            },
        )
    }

    fn exact(amplitude: f64, z: f64) -> f64 {
        let z = z.clamp(-1.0, 1.0);
        amplitude * z * (2.0 - z.abs())
    }

    proptest! {
        #[test]
        fn follows_the_formula(settings in settings(), signal: i16) {
            let config = CompensationConfig::build(&settings).unwrap();
            let get = |param| settings.get(param) as f64;
            let drop = get(Param::CompDrop) * 1024.0;
            let expected = exact(drop, signal as f64 / 1024.0 / get(Param::CompDropWidth));
            // The slope is rounded by up to half a bit, which moves z by that part.
            let slope = 0.5 / config.drop_sign.slope as f64 * 2.0;
            prop_assert!((config.drop(signal) as f64 - expected).abs() <= 2.0 + drop * (0.001 + slope));
            let side = if signal < 0 { Param::CompFrictionReverse } else { Param::CompFrictionForward };
            let friction = get(side) * 1024.0;
            let expected = exact(friction, signal as f64 / 64.0 / get(Param::CompFrictionWidth));
            let slope = 0.5 / config.friction_sign.slope as f64 * 2.0;
            prop_assert!((config.friction(signal) as f64 - expected).abs() <= 2.0 + friction * (0.001 + slope));
        }

        #[test]
        fn voltage_plus_drop_is_monotone_and_odd(settings in settings(), voltage in -16000i16..16000) {
            let config = CompensationConfig::build(&settings).unwrap();
            let total = |voltage: i16| voltage + config.drop(voltage);
            prop_assert!(total(voltage + 1) >= total(voltage));
            prop_assert!((config.drop(-voltage) + config.drop(voltage)).abs() <= 3);
            prop_assert!(config.drop(voltage).abs() <= config.drop_voltage() + 1);
        }
    }

    #[test]
    fn off_by_default_and_narrow_widths_refused() {
        let mut settings = Settings::defaults();
        let config = CompensationConfig::build(&settings).unwrap();
        assert!([i16::MIN, -1, 0, 1, i16::MAX].iter().all(|&x| config.drop(x) == 0 && config.friction(x) == 0));
        settings.set(Param::CompFrictionWidth, 0.5).unwrap();
        assert_eq!(CompensationConfig::build(&settings), Err(Rule::TooSmall.of(Param::CompFrictionWidth)));
    }
}

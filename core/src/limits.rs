//! What the voltage may be in this tick, and the integral that knows it.
//!
//! Every limit (saturation, slew, folding back on over-current, room for the compensation) is an interval of voltage
//! made before the controller runs. The controller closes its law in `Integral::close`. That clamps to the interval and
//! feeds back what was cut off, so one anti-windup works with every limit:
//!
//! ```text
//! v(k) = rest(k) + I(k)            u(k) = clamp(v(k), low, high)
//! I(k+1) = I(k) + Ki T e(k) + T/Tt (u(k) - v(k))
//! ```
//! `Tt` is the tracking time (Astrom and Hagglund, Advanced PID Control, 3.5). With `Ki` zero there is no integral.
//! When gains or mode change, the integral takes the value that leaves the voltage where it was (bumpless transfer).

use crate::arith::{
    call_saturate_i16, dot, mul_i16, multiply_add_u16, saturate_shift_8, saturating_add_i16, saturating_add_i32,
    saturating_sub_i16,
};
use crate::quantiser::{Format, Quantiser};
use crate::settings::{Param, Settings};
use crate::units::{FULL_RANGE, GAIN_LIMIT, Rule, VOLT, quantise};

/// The interval of voltage for one tick, bits of [`crate::units::Voltage`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Lowest voltage; never above `high`.
    pub low: i16,
    /// Highest voltage.
    pub high: i16,
    /// Voltage of the tick before, which bumpless transfer keeps.
    pub previous: i16,
    /// Gains or mode have changed: the integral must take up the difference.
    pub align: bool,
}

/// Saturation, slew and current limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LimitsConfig {
    /// Largest voltage, with the compensation.
    pub voltage: i16,
    /// Largest change a tick, of the controller's part.
    slew: i16,
    /// Current above which the voltage folds back; the largest number switches it off.
    current: i16,
}

impl LimitsConfig {
    /// From `voltage_limit`, `slew_limit`, `current_limit` and `tick_rate`.
    #[inline(always)]
    pub fn quantised(q: &mut Quantiser) -> Self {
        let current = q.bits(Param::CurrentLimit);
        Self {
            voltage: q.bits(Param::VoltageLimit),
            slew: q.bits(Param::SlewLimit),
            current: if current == 0 { i16::MAX } else { current },
        }
    }

    /// The interval around `previous`, within `low..=high` of the saturation, at the measured `current`.
    ///
    /// Above the current limit the end that drives the current moves back, each tick by 1 V for each ampere too much. The
    /// slew limit does not hold it.
    #[inline(always)]
    pub fn around(&self, previous: i16, current: i16, low: i16, high: i16) -> (i16, i16) {
        let (lowest, highest) = (low, high);
        let mut low = low.max(saturating_sub_i16(previous, self.slew));
        let mut high = high.min(saturating_add_i16(previous, self.slew));
        if current > self.current {
            high = high.min(saturating_sub_i16(previous, fold_back(current, self.current))).max(lowest);
        } else if current < -self.current {
            low = low
                .max(saturating_add_i16(previous, fold_back(saturating_sub_i16(0, current), self.current)))
                .min(highest);
        }
        // Where the limits contradict each other, the one that moves to the smaller voltage holds.
        if low > high {
            if previous > 0 { low = high } else { high = low }
        }
        (low, high)
    }
}

/// 1 V for each ampere above the limit, and at least one bit.
#[inline(always)]
fn fold_back(current: i16, limit: i16) -> i16 {
    (saturating_sub_i16(current, limit) >> 2) + 1
}

/// Bits of the [`crate::units::Gain`] `value` volts per unit on a signal with `bits_per_unit`.
///
/// # Errors
/// The gain is too large for the format, or would vanish in it.
pub fn quantise_gain(value: f32, bits_per_unit: f32) -> Result<i16, Rule> {
    quantise(value, VOLT * 1024.0 / bits_per_unit, GAIN_LIMIT as u16).map(|v| v as i16)
}

/// Bits a unit of a per-unit signal with the given full range.
pub fn bits_per_unit(settings: &Settings, range: Param) -> f32 {
    FULL_RANGE / settings.get(range)
}

/// Integral gain and tracking.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct IntegralConfig {
    /// Bits of [`crate::units::IntegralGain`].
    ki: i16,
    /// Bits of [`crate::units::Fraction`]: tick over tracking time, at most a half; zero without an integral.
    tracking: u16,
}

impl IntegralConfig {
    /// From a gain and a tracking time, of at least two ticks.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn quantised(q: &mut Quantiser, gain: Param, time: Param) -> Self {
        let ki = q.bits(gain);
        q.scale(Format::Ticks).times(time);
        let least = if q.value() > 2.0 { 0.0 } else { 2.0 - q.value() };
        let tracking = q.one_over(time, least);
        // Without an integral there is nothing to track with.
        Self { ki, tracking: if ki == 0 { 0 } else { tracking } }
    }
}

/// The form of every control law: three gains on three signals, and the integral of the error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Law {
    /// Bits of [`crate::units::Gain`]; negative feedback has its sign in the gain, so that every term is added.
    pub gains: [i16; 3],
    /// The integral of the error.
    pub integral: IntegralConfig,
}

/// What a law acts on in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terms {
    /// The signals of [`Law::gains`], in bits.
    pub signals: [i16; 3],
    /// The error that the integral sums up, in bits.
    pub error: i16,
}

/// The integral of a controller, and the end of its law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Integral {
    /// Bits of voltage times 2^16: the whole range of 32 bits is +-32 V.
    bits: i32,
}

impl Integral {
    /// One tick of a law. Returns the voltage; within 2 bits of exact arithmetic.
    #[inline(always)]
    pub fn step(&mut self, law: &Law, terms: &Terms, limits: &Limits) -> i16 {
        // Gains are below 2^14: three products stay within 32 bits.
        self.close(&law.integral, dot(&law.gains, terms.signals), terms.error, limits)
    }

    /// Closes the law: adds the integral to `rest` (three products of a [`crate::units::Gain`] and a signal), clamps,
    /// and moves the integral on.
    #[inline(always)]
    fn close(&mut self, config: &IntegralConfig, rest: i32, error: i16, limits: &Limits) -> i16 {
        if limits.align {
            self.align(config, rest, limits);
        }
        // Gain products carry 10 fractional bits, the integral 16; 8 are kept of both.
        let wanted = saturate_shift_8((rest >> 2) + (self.bits >> 8));
        let mut change = mul_i16(config.ki, error);
        let mut voltage = wanted;
        if wanted < limits.low || wanted > limits.high {
            voltage = if wanted < limits.low { limits.low } else { limits.high };
            // At most 2^29 of the error and 2^30 of the excess.
            change = multiply_add_u16(change, saturating_sub_i16(voltage, wanted), config.tracking);
        }
        self.bits = saturating_add_i32(change, self.bits);
        voltage
    }

    /// Takes the value with which the voltage stays at `limits.previous`; none without an integral gain.
    #[inline(never)]
    fn align(&mut self, config: &IntegralConfig, rest: i32, limits: &Limits) {
        let missing = call_saturate_i16(limits.previous as i32 - (rest >> 10));
        self.bits = if config.ki == 0 { 0 } else { (missing as i32) << 16 };
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The closing of a control law in real numbers: what [`Integral::close`] is held against.
    pub(crate) struct Exact {
        pub ki: f64,
        pub tracking: f64,
        pub integral: f64,
    }

    impl Exact {
        pub fn new(config: &IntegralConfig) -> Self {
            Self { ki: config.ki as f64 / 65536.0, tracking: config.tracking as f64 / 65536.0, integral: 0.0 }
        }

        /// `rest` in bits of voltage.
        pub fn close(&mut self, rest: f64, error: f64, limits: &Limits) -> f64 {
            if limits.align {
                self.integral = if self.ki == 0.0 { 0.0 } else { limits.previous as f64 - rest };
                self.integral = self.integral.clamp(-32768.0, 32767.0);
            }
            let wanted = (rest + self.integral).clamp(-32768.0, 32767.0);
            let voltage = wanted.clamp(limits.low as f64, limits.high as f64);
            if self.ki != 0.0 {
                let excess = (voltage - wanted).clamp(-32768.0, 32767.0);
                self.integral += self.ki * error + self.tracking * excess;
                self.integral = self.integral.clamp(-32768.0, 32768.0);
            }
            voltage
        }
    }

    /// Intervals as the loop makes them: around a previous voltage, of any width.
    pub(crate) fn any_limits() -> impl Strategy<Value = Limits> {
        (-20000i16..20000, 0i16..12000, 0i16..12000).prop_map(|(previous, below, above)| Limits {
            low: previous.saturating_sub(below),
            high: previous.saturating_add(above),
            previous,
            align: false,
        })
    }

    proptest! {
        #[test]
        fn the_interval_holds_every_limit(
            previous in -32000i16..32000, current: i16, limit in 1i16.., slew in 1i16.., voltage in 0i16..,
        ) {
            let config = LimitsConfig { voltage, slew, current: limit };
            let previous = previous.clamp(-voltage, voltage);
            let (low, high) = config.around(previous, current, -voltage, voltage);
            prop_assert!(low <= high);
            prop_assert!(low >= -voltage && high <= voltage);
            if current > limit {
                prop_assert!(high < previous || previous == -voltage, "{high}");
            } else if current >= -limit {
                prop_assert!(low >= previous.saturating_sub(slew) && high <= previous.saturating_add(slew));
            }
        }
    }

    #[test]
    fn a_gain_beyond_the_format_is_refused_by_name() {
        let mut settings = Settings::defaults();
        settings.set(Param::SpeedKp, 500.0).unwrap();
        let gain = |settings: &Settings| Quantiser::build(settings, |q| q.bits(Param::SpeedKp));
        assert_eq!(gain(&settings), Err(Rule::TooLarge.of(Param::SpeedKp)));
        settings.set(Param::SpeedKp, 1e-6).unwrap();
        assert_eq!(gain(&settings), Err(Rule::RoundsToZero.of(Param::SpeedKp)));
        settings.set(Param::SpeedKi, 1e-5).unwrap();
        settings.set(Param::SpeedKp, 0.0).unwrap();
        let built = Quantiser::build(&settings, |q| IntegralConfig::quantised(q, Param::SpeedKi, Param::SpeedTt));
        assert_eq!(built, Err(Rule::RoundsToZero.of(Param::SpeedKi)));
    }
}

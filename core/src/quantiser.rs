//! From settings to bits: the one place where floating point becomes fixed point.
//!
//! A [`Quantiser`] goes on after a value that does not fit, and keeps the first error. So sixty conversions are sixty
//! short calls and not sixty branches. On the chip that takes a third of the flash. How a setting becomes bits stands
//! beside it in the list of settings, as its [`Format`].
//!
//! On the chip these functions lie beside their callers and the floating-point routines (`.lowtext` comes before all
//! else). Then a call among them takes two bytes instead of four, which saves 300 bytes.

use crate::settings::{BuildError, Param, Settings};
use crate::units::{AMPERE, FULL_RANGE, GAIN_LIMIT, Rule, VOLT, quantise};

/// How a setting becomes bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Format {
    /// By a formula of its own, in the block it belongs to.
    Own = 0,
    /// Volts, bits of [`crate::units::Voltage`].
    Volt = 1,
    /// Amperes, bits of [`crate::units::Current`].
    Ampere = 2,
    /// Volts per second, bits of voltage a tick.
    Slew = 3,
    /// Milliseconds, ticks.
    Ticks = 4,
    /// Volts per rad/s, bits of [`crate::units::Gain`].
    SpeedGain = 5,
    /// Volts per rad, bits of [`crate::units::Gain`].
    PositionGain = 6,
    /// Volts per ampere, bits of [`crate::units::Gain`].
    CurrentGain = 7,
    /// Volts per rad/s and second, bits of [`crate::units::IntegralGain`].
    SpeedIntegral = 8,
    /// Volts per rad and second, bits of [`crate::units::IntegralGain`].
    PositionIntegral = 9,
}

impl Format {
    /// Largest magnitude of the bits.
    fn limit(self) -> u16 {
        // Not as one `match`: of that a table in RAM is made.
        if matches!(self, Self::Own | Self::Ticks) {
            u16::MAX
        } else if self as u8 <= Self::Slew as u8 {
            i16::MAX as u16
        } else {
            GAIN_LIMIT as u16
        }
    }
}

/// Turns settings into bits and keeps the first error. Every formula is a constant times some settings over others,
/// worked out step by step: `q.of(VOLT).times(Param::SupplyVoltage)`.
pub struct Quantiser<'a> {
    settings: &'a Settings,
    first_error: Option<BuildError>,
    /// What the formula has come to.
    value: f32,
}

impl<'a> Quantiser<'a> {
    /// Of these settings.
    #[inline(always)]
    pub fn new(settings: &'a Settings) -> Self {
        Self { settings, first_error: None, value: 0.0 }
    }

    /// Builds one block on its own.
    ///
    /// # Errors
    /// The first setting that does not fit, with the rule it breaks.
    pub fn build<T>(settings: &'a Settings, block: impl FnOnce(&mut Self) -> T) -> Result<T, BuildError> {
        let mut quantiser = Self::new(settings);
        let built = block(&mut quantiser);
        quantiser.finish().map(|()| built)
    }

    /// The same of a block that is filled in where it is: on the chip there is no room for a copy.
    ///
    /// # Errors
    /// As [`Quantiser::build`].
    pub fn build_in_place<T: Default>(
        settings: &'a Settings,
        block: impl FnOnce(&mut T, &mut Self),
    ) -> Result<T, BuildError> {
        Self::build(settings, |quantiser| {
            let mut built = T::default();
            block(&mut built, quantiser);
            built
        })
    }

    /// Whether everything has fitted.
    ///
    /// # Errors
    /// The first setting that has not, with the rule it breaks.
    pub fn finish(self) -> Result<(), BuildError> {
        self.first_error.map_or(Ok(()), Err)
    }

    /// Begins a formula.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn of(&mut self, value: f32) -> &mut Self {
        self.value = value;
        self
    }

    /// Times a setting in its unit.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn times(&mut self, param: Param) -> &mut Self {
        self.value *= self.settings.get(param);
        self
    }

    /// Over a setting in its unit.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn over(&mut self, param: Param) -> &mut Self {
        self.value /= self.settings.get(param);
        self
    }

    /// What the formula has come to.
    #[inline(always)]
    pub fn value(&self) -> f32 {
        self.value
    }

    /// Whether a setting that is a switch is on.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn is_on(&self, param: Param) -> bool {
        self.settings.get(param) != 0.0
    }

    /// Whether a setting is this number.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn is(&self, param: Param, number: f32) -> bool {
        self.settings.get(param) == number
    }

    /// Whether the tick is the fast one.
    #[inline(always)]
    pub fn is_fast(&self) -> bool {
        self.settings.is_fast()
    }

    /// `param` breaks `rule`.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn refuse(&mut self, param: Param, rule: Rule) {
        if self.first_error.is_none() {
            self.first_error = Some(rule.of(param));
        }
    }

    /// A setting in the bits of its format.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn bits(&mut self, param: Param) -> i16 {
        let format = param.format();
        self.scale(format);
        self.times(param);
        self.round(param, format.limit()) as i16
    }

    /// Begins a formula with the bits of one unit.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn scale(&mut self, format: Format) -> &mut Self {
        self.of(match format {
            Format::Own => 1.0,
            Format::Volt | Format::Slew => VOLT,
            Format::Ampere => AMPERE,
            Format::Ticks => 0.001,
            Format::SpeedGain | Format::PositionGain => VOLT * 1024.0 / FULL_RANGE,
            Format::CurrentGain => VOLT * 1024.0 / AMPERE,
            Format::SpeedIntegral | Format::PositionIntegral => VOLT * 65536.0 / FULL_RANGE,
        });
        match format {
            Format::SpeedGain | Format::SpeedIntegral => self.times(Param::SpeedRange),
            Format::PositionGain | Format::PositionIntegral => self.times(Param::PositionRange),
            Format::Ticks => self.times(Param::TickRate),
            _ => self,
        };
        match format {
            Format::Slew | Format::SpeedIntegral | Format::PositionIntegral => self.over(Param::TickRate),
            _ => self,
        }
    }

    /// The formula's value, rounded to the nearest whole number of at most `limit` either way; negative ones in two's
    /// complement.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn round(&mut self, param: Param, limit: u16) -> u16 {
        match quantise(self.value, 1.0, limit) {
            Ok(bits) => bits as u16,
            Err(rule) => {
                self.refuse(param, rule);
                0
            }
        }
    }

    /// The same; what is above the limit is the limit.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn saturate(&mut self, param: Param, limit: u16) -> u16 {
        if self.value > limit as f32 {
            return limit;
        }
        self.round(param, limit)
    }

    /// The same; what is below half a bit is zero.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn saturate_or_zero(&mut self, param: Param, limit: u16) -> u16 {
        if self.value < 0.5 { 0 } else { self.saturate(param, limit) }
    }

    /// One over the formula's value and `more`, bits of [`crate::units::Fraction`].
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn one_over(&mut self, param: Param, more: f32) -> u16 {
        self.value = 65536.0 / (self.value + more);
        self.saturate(param, u16::MAX)
    }

    /// Refuses a range that is not a power of two.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn power_of_two(&mut self, param: Param) {
        // A power of two is a number without mantissa bits.
        if self.settings.get(param).to_bits() & 0x007f_ffff != 0 {
            self.refuse(param, Rule::NotPowerOfTwo);
        }
    }
}

//! Turns settings into fixed-point numbers and remembers the first that does not fit.
//!
//! A configuration is some sixty conversions; reporting each by itself would cost the chip a quarter of its flash.

use crate::limits;
use crate::settings::{BuildError, Param, Settings};
use crate::units::{Rule, quantise};

/// Settings under conversion.
pub struct Quantiser<'a> {
    settings: &'a Settings,
    error: Option<BuildError>,
}

impl<'a> Quantiser<'a> {
    /// Nothing has failed yet.
    pub fn new(settings: &'a Settings) -> Self {
        Self { settings, error: None }
    }

    /// What `convert` makes of the settings.
    ///
    /// # Errors
    /// The first setting that a format cannot hold.
    pub fn checked<T>(settings: &Settings, convert: impl FnOnce(&mut Quantiser) -> T) -> Result<T, BuildError> {
        let mut quantiser = Quantiser::new(settings);
        let converted = convert(&mut quantiser);
        quantiser.finish().map(|()| converted)
    }

    /// Whether everything fitted.
    ///
    /// # Errors
    /// The first setting that did not.
    pub fn finish(self) -> Result<(), BuildError> {
        match self.error {
            None => Ok(()),
            Some(error) => Err(error),
        }
    }

    /// A setting in its own unit.
    #[inline(never)]
    pub fn get(&self, param: Param) -> f32 {
        self.settings.get(param)
    }

    /// Blames a setting, unless another was blamed before.
    #[inline(never)]
    pub fn refuse(&mut self, param: Param, rule: Rule) {
        if self.error.is_none() {
            self.error = Some(rule.of(param));
        }
    }

    /// `value` in bits, on the account of `param`; 0 where it does not fit.
    #[inline(never)]
    pub fn value(&mut self, param: Param, value: f32, bits_per_unit: f32, limit: u16) -> u16 {
        match quantise(value, bits_per_unit, limit) {
            // Negative numbers in two's complement.
            Ok(bits) => bits as u16,
            Err(rule) => {
                self.refuse(param, rule);
                0
            }
        }
    }

    /// A setting in bits of 16 bits with a sign.
    #[inline(never)]
    pub fn bits(&mut self, param: Param, bits_per_unit: f32) -> i16 {
        let value = self.get(param);
        self.value(param, value, bits_per_unit, i16::MAX as u16) as i16
    }

    /// A setting in ms, in ticks.
    #[inline(never)]
    pub fn ticks(&mut self, param: Param) -> u16 {
        let (value, rate) = (self.get(param), self.get(Param::TickRate));
        self.value(param, value, rate * 0.001, u16::MAX)
    }

    /// [`limits::quantise_gain`], remembered.
    #[inline(never)]
    pub fn gain_value(&mut self, param: Param, value: f32, bits_per_unit: f32) -> i16 {
        match limits::quantise_gain(value, bits_per_unit) {
            Ok(bits) => bits,
            Err(rule) => {
                self.refuse(param, rule);
                0
            }
        }
    }

    /// The same of a setting.
    #[inline(never)]
    pub fn gain(&mut self, param: Param, bits_per_unit: f32) -> i16 {
        let value = self.get(param);
        self.gain_value(param, value, bits_per_unit)
    }

    /// Bits a unit of a per-unit signal with the given full range.
    #[inline(never)]
    pub fn bits_per_unit(&self, range: Param) -> f32 {
        limits::bits_per_unit(self.settings, range)
    }

    /// A range setting, which has to be a power of two.
    #[inline(never)]
    pub fn power_of_two(&mut self, param: Param) -> f32 {
        let value = self.get(param);
        // A power of two is a number without mantissa bits.
        if value.to_bits() & 0x007f_ffff != 0 {
            self.refuse(param, Rule::NotPowerOfTwo);
        }
        value
    }
}

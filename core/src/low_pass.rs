//! First-order low-pass: `f(k) = f(k-1) + a (x(k) - f(k-1))`, `a = T/(tau + T)` (backward Euler).
//!
//! The state has 16 bits below the signal's, so a slow filter does not stick short of its input: it settles within one
//! bit. Against the recurrence in real numbers the output is within 2 bits.

use crate::arith::{multiply_add_u16, saturating_sub_i16};
use crate::quantiser::{Format, Quantiser};
use crate::settings::Param;

/// `a`, bits of [`crate::units::Fraction`]; zero passes the signal through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LowPassConfig(u16);

impl LowPassConfig {
    /// From the setting `time`, a time constant in ms; zero is no filter.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn quantised(q: &mut Quantiser, time: Param) -> Self {
        if q.is_on(time) { Self::always(q, time) } else { Self(0) }
    }

    /// The same, but a time constant of zero is the fastest filter instead of none: for who needs the difference to it.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn always(q: &mut Quantiser, time: Param) -> Self {
        q.scale(Format::Ticks).times(time);
        Self(q.one_over(time, 1.0))
    }

    /// Whether it filters at all.
    #[inline(always)]
    pub fn is_on(&self) -> bool {
        self.0 != 0
    }

    /// The part, for the tests of who uses the filter.
    #[cfg(test)]
    pub(crate) fn part(&self) -> f64 {
        self.0 as f64 / 65536.0
    }
}

/// The filter's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LowPassState(i32);

impl LowPassState {
    /// One tick: input and output in the same bits.
    #[inline(always)]
    pub fn step(&mut self, config: &LowPassConfig, input: i16) -> i16 {
        if config.is_on() { self.filter(config, input) } else { input }
    }

    #[inline(never)]
    fn filter(&mut self, config: &LowPassConfig, input: i16) -> i16 {
        self.advance(config, input);
        self.output()
    }

    /// Moves on toward the input; returns how far the input was ahead.
    #[inline(always)]
    pub fn advance(&mut self, config: &LowPassConfig, input: i16) -> i16 {
        let change = saturating_sub_i16(input, self.output());
        // Toward the input by less than the distance: stays within 16 bits.
        self.0 = multiply_add_u16(self.0, change, config.0);
        change
    }

    /// The filtered signal.
    #[inline(always)]
    pub fn output(&self) -> i16 {
        (self.0 >> 16) as i16
    }

    /// Forgets the past: as if the input had always been this one.
    #[inline(always)]
    pub fn settle(&mut self, input: i16) {
        self.0 = (input as i32) << 16;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn follows_the_recurrence(part in 1u16.., inputs in proptest::collection::vec((any::<i16>(), 1u16..300), 1..30)) {
            let mut state = LowPassState::default();
            let mut exact = 0.0f64;
            for (input, repeat) in inputs {
                for _ in 0..repeat {
                    exact += part as f64 / 65536.0 * (input as f64 - exact).clamp(-32768.0, 32767.0);
                    let output = state.step(&LowPassConfig(part), input);
                    prop_assert!((output as f64 - exact).abs() <= 2.0, "{output} for {exact}");
                }
            }
        }
    }

    #[test]
    fn time_constant_and_no_filter() {
        let mut settings = Settings::defaults();
        let build = |settings: &Settings| {
            Quantiser::build(settings, |q| LowPassConfig::quantised(q, Param::SpeedFilter)).unwrap()
        };
        assert_eq!(LowPassState::default().step(&build(&settings), 99), 99);
        settings.set(Param::SpeedFilter, 20.0).unwrap();
        let config = build(&settings);
        let mut state = LowPassState::default();
        let after_tau = (0..20).map(|_| state.step(&config, 10_000)).last().unwrap();
        // Backward Euler: 1 - (tau/(tau+T))^20 = 0.6231.
        assert!((after_tau - 6231).abs() <= 12, "{after_tau}");
    }
}

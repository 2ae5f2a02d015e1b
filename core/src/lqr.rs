//! LQR with integral action (LQI) for speed and for position: constant gains, designed on the host.
//!
//! ```text
//! speed:     u = Kr r - Kw w - Kc i + I            I' = Ki (r - w)
//! position:  u = Kp (x_r - x) + Kw (w_r - w) - Kc i + I     I' = Ki (x_r - x)
//! ```
//! `w` speed, `i` current, `x` position, `w_r` the speed of the reference's profile (zero for a step). Gains positive,
//! feedback negative. Against the same law in real numbers with the same gains the voltage is within 3 bits (3 mV).

use crate::arith::saturating_sub_i16;
use crate::limits::{Integral, IntegralConfig, Law, Limits, Terms};
use crate::quantiser::Quantiser;
use crate::settings::{BuildError, Param, Settings};

/// State feedback, quantised: gains on the reference speed or the position error, on the speed or its error, and on the
/// current.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LqrConfig {
    law: Law,
}

impl LqrConfig {
    /// The speed LQR, from the settings `lqr_speed_*`.
    #[inline(always)]
    pub fn quantised_speed(q: &mut Quantiser) -> Self {
        let gains = [q.bits(Param::LqrSpeedKr), -q.bits(Param::LqrSpeedKw), -q.bits(Param::LqrSpeedKc)];
        Self { law: Law { gains, integral: IntegralConfig::quantised(q, Param::LqrSpeedKi, Param::LqrTt) } }
    }

    /// The position LQR, from the settings `lqr_position_*`.
    #[inline(always)]
    pub fn quantised_position(q: &mut Quantiser) -> Self {
        let gains = [q.bits(Param::LqrPositionKp), q.bits(Param::LqrPositionKw), -q.bits(Param::LqrPositionKc)];
        Self { law: Law { gains, integral: IntegralConfig::quantised(q, Param::LqrPositionKi, Param::LqrTt) } }
    }

    /// The speed LQR on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn speed(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build(settings, Self::quantised_speed)
    }

    /// The position LQR on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn position(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build(settings, Self::quantised_position)
    }
}

impl LqrConfig {
    /// The law.
    #[inline(always)]
    pub fn law(&self) -> &Law {
        &self.law
    }

    /// What the speed LQI acts on; everything in bits.
    #[inline(always)]
    pub fn speed_terms(reference: i16, speed: i16, current: i16) -> Terms {
        Terms { signals: [reference, speed, current], error: saturating_sub_i16(reference, speed) }
    }

    /// What the position LQI acts on; everything in bits, `speed_error` reference minus measured.
    #[inline(always)]
    pub fn position_terms(error: i16, speed_error: i16, current: i16) -> Terms {
        Terms { signals: [error, speed_error, current], error }
    }
}

/// What an LQI remembers: its integral.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LqrState {
    /// The integral.
    pub integral: Integral,
}

impl LqrState {
    /// One tick of the speed LQI; everything in bits.
    #[inline(always)]
    pub fn step_speed(&mut self, config: &LqrConfig, reference: i16, speed: i16, current: i16, limits: &Limits) -> i16 {
        self.integral.step(&config.law, &LqrConfig::speed_terms(reference, speed, current), limits)
    }

    /// One tick of the position LQI; everything in bits, `speed_error` reference minus measured.
    #[inline(always)]
    pub fn step_position(
        &mut self,
        config: &LqrConfig,
        error: i16,
        speed_error: i16,
        current: i16,
        limits: &Limits,
    ) -> i16 {
        self.integral.step(&config.law, &LqrConfig::position_terms(error, speed_error, current), limits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::tests::{Exact, any_limits};
    use proptest::collection::vec;
    use proptest::prelude::*;

    fn settings() -> impl Strategy<Value = Settings> {
        let part = -1f32..1.0;
        [part.clone(), part.clone(), part.clone(), part].prop_map(|[kr, kw, kc, ki]| {
            let mut settings = Settings::defaults();
            let values = [
                (Param::LqrSpeedKr, kr),
                (Param::LqrSpeedKw, kw),
                (Param::LqrSpeedKc, kc * 20.0),
                (Param::LqrSpeedKi, ki * 30.0),
                (Param::LqrPositionKp, kr * 15.0),
                (Param::LqrPositionKw, kw),
                (Param::LqrPositionKc, kc * 20.0),
                (Param::LqrPositionKi, ki * 400.0),
            ];
            for (param, value) in values {
                settings.set(param, value).unwrap();
            }
            settings
        })
    }

    proptest! {
        /// Both LQIs: within 3 bits of real arithmetic.
        #[test]
        fn lqi_is_its_law(
            settings in settings(), position: bool,
            ticks in vec((any::<i16>(), any::<i16>(), any::<i16>(), any_limits(), 1u8..60), 1..40),
        ) {
            let build = if position { LqrConfig::position } else { LqrConfig::speed };
            let Ok(config) = build(&settings) else { return Ok(()) };
            let (mut state, mut integral) = (LqrState::default(), Exact::new(&config.law.integral));
            for (first, second, current, limits, repeat) in ticks {
                for _ in 0..repeat {
                    let rest = config.law.gains[0] as f64 * first as f64 + config.law.gains[1] as f64 * second as f64
                        + config.law.gains[2] as f64 * current as f64;
                    let (error, voltage) = if position {
                        (first, state.step_position(&config, first, second, current, &limits))
                    } else {
                        (first.saturating_sub(second), state.step_speed(&config, first, second, current, &limits))
                    };
                    let exact = integral.close(rest / 1024.0, error as f64, &limits);
                    prop_assert!((voltage as f64 - exact).abs() <= 3.0, "{voltage} for {exact}");
                }
            }
        }
    }

    #[test]
    fn a_gain_the_format_cannot_hold_is_named() {
        let mut settings = Settings::defaults();
        settings.set(Param::LqrPositionKc, 900.0).unwrap();
        assert_eq!(LqrConfig::position(&settings), Err(crate::units::Rule::TooLarge.of(Param::LqrPositionKc)));
    }
}

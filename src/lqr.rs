//! LQR with integral action (LQI) for speed and for position: constant gains, designed on the host.
//!
//! ```text
//! speed:     u = Kr r - Kw w - Kc i + I            I' = Ki (r - w)
//! position:  u = Kp (x_r - x) + Kw (w_r - w) - Kc i + I     I' = Ki (x_r - x)
//! ```
//! `w` speed, `i` current, `x` position, `w_r` the speed of the reference's profile (zero for a step). Gains positive,
//! feedback negative. Against the same law in real numbers with the same gains the voltage is within 3 bits (3 mV).

use crate::arith::{mul_i16, multiply_add, saturating_sub_i16};
use crate::limits::{Integral, IntegralConfig, Limits};
use crate::quantiser::Quantiser;
use crate::settings::Param;
use crate::units::AMPERE;

/// State feedback, quantised. One type serves both uses; they differ in what the first gain acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LqrConfig {
    /// On the reference speed, or on the position error.
    kr: i16,
    /// On the speed; negative feedback has its sign in the gain, so that every term is added.
    kw: i16,
    /// On the current; the same.
    kc: i16,
    integral: IntegralConfig,
}

impl LqrConfig {
    /// The speed LQR, from the settings `lqr_speed_*`.
    #[inline(never)]
    pub fn speed(q: &mut Quantiser) -> Self {
        let scale = q.bits_per_unit(Param::SpeedRange);
        Self {
            kr: q.gain(Param::LqrSpeedKr, scale),
            kw: -q.gain(Param::LqrSpeedKw, scale),
            kc: -q.gain(Param::LqrSpeedKc, AMPERE),
            integral: IntegralConfig::quantised(q, Param::LqrSpeedKi, scale, Param::LqrTt),
        }
    }

    /// The position LQR, from the settings `lqr_position_*`.
    #[inline(never)]
    pub fn position(q: &mut Quantiser) -> Self {
        let scale = q.bits_per_unit(Param::PositionRange);
        let speed_scale = q.bits_per_unit(Param::SpeedRange);
        Self {
            kr: q.gain(Param::LqrPositionKp, scale),
            kw: q.gain(Param::LqrPositionKw, speed_scale),
            kc: -q.gain(Param::LqrPositionKc, AMPERE),
            integral: IntegralConfig::quantised(q, Param::LqrPositionKi, scale, Param::LqrTt),
        }
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
        let rest = mul_i16(config.kr, reference);
        let rest = multiply_add(rest, config.kw, speed);
        let rest = multiply_add(rest, config.kc, current);
        self.integral.close(&config.integral, rest, saturating_sub_i16(reference, speed), limits)
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
        let rest = mul_i16(config.kr, error);
        let rest = multiply_add(rest, config.kw, speed_error);
        let rest = multiply_add(rest, config.kc, current);
        self.integral.close(&config.integral, rest, error, limits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::tests::{Exact, any_limits};
    use crate::settings::Settings;
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
            let build: fn(&mut Quantiser) -> LqrConfig = if position { LqrConfig::position } else { LqrConfig::speed };
            let Ok(config) = Quantiser::checked(&settings, build) else { return Ok(()) };
            let (mut state, mut integral) = (LqrState::default(), Exact::new(&config.integral));
            for (first, second, current, limits, repeat) in ticks {
                for _ in 0..repeat {
                    let rest = config.kr as f64 * first as f64 + config.kw as f64 * second as f64
                        + config.kc as f64 * current as f64;
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
        assert_eq!(
            Quantiser::checked(&settings, LqrConfig::position),
            Err(crate::units::Rule::TooLarge.of(Param::LqrPositionKc))
        );
    }
}

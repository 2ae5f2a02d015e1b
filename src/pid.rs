//! PID for speed and for position.
//!
//! Two degrees of freedom: the setpoint weight (speed) and the feed-forward shape the answer to the reference, the
//! gains alone the answer to disturbances. The derivative acts on the measurement through a first-order filter.
//!
//! ```text
//! speed:     u = Kp (b r - w) + Kff r + I - Kd s/(1 + s Tf) w      I' = Ki (r - w)
//! position:  u = Kp (x_r - x) + Kff w_r + I - Kd 1/(1 + s Tf) w     I' = Ki (x_r - x)
//! ```
//! `w` is the measured speed, `w_r` the speed of the reference's profile. The filter is discretised by backward Euler:
//! `f(k) = f(k-1) + a (w(k) - f(k-1))`, `a = T/(Tf + T)`; its derivative is then `(w(k) - f(k-1))/(Tf + T)`.
//! Gains positive, feedback negative. Against the same law in real numbers with the same gains the voltage is within
//! 3 bits (3 mV).

use crate::arith::{mul_i16, multiply_add, saturating_sub_i16};
use crate::limits::{Integral, IntegralConfig, Limits};
use crate::low_pass::{LowPassConfig, LowPassState};
use crate::quantiser::Quantiser;
use crate::settings::Param;

/// A PID, quantised. One type serves both uses; they differ in what the terms act on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PidConfig {
    /// On the reference: `Kp b + Kff` for speed, `Kff` for position.
    kr: i16,
    /// On the measured speed, or on the position error. Negative feedback has its sign in the gain, so that every term
    /// is added.
    kp: i16,
    /// On the difference to the filter (speed) or on the filter (position); the same.
    kd: i16,
    filter: LowPassConfig,
    integral: IntegralConfig,
}

impl PidConfig {
    /// The speed PID, from the settings `speed_*`.
    #[inline(never)]
    pub fn speed(q: &mut Quantiser) -> Self {
        let scale = q.bits_per_unit(Param::SpeedRange);
        // First, so that a gain that is too large is blamed and not the sum it is part of.
        let kp = -q.gain(Param::SpeedKp, scale);
        let kr = q.get(Param::SpeedKp) * q.get(Param::SpeedB) + q.get(Param::SpeedKff);
        let kr = q.gain_value(Param::SpeedKff, kr, scale);
        let (tf, period) = (q.get(Param::SpeedTf) * 0.001, 1.0 / q.get(Param::TickRate));
        let kd = q.get(Param::SpeedKd) / (tf + period);
        let kd = -q.gain_value(Param::SpeedKd, kd, scale);
        Self {
            kr,
            kp,
            kd,
            filter: LowPassConfig::always(q, Param::SpeedTf),
            integral: IntegralConfig::quantised(q, Param::SpeedKi, scale, Param::SpeedTt),
        }
    }

    /// The position PID, from the settings `position_*`.
    #[inline(never)]
    pub fn position(q: &mut Quantiser) -> Self {
        let speed_scale = q.bits_per_unit(Param::SpeedRange);
        let scale = q.bits_per_unit(Param::PositionRange);
        Self {
            kr: q.gain(Param::PositionKff, speed_scale),
            kp: q.gain(Param::PositionKp, scale),
            kd: -q.gain(Param::PositionKd, speed_scale),
            filter: LowPassConfig::always(q, Param::PositionTf),
            integral: IntegralConfig::quantised(q, Param::PositionKi, scale, Param::PositionTt),
        }
    }
}

/// What a PID remembers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PidState {
    /// The integral.
    pub integral: Integral,
    /// The derivative filter.
    filtered: LowPassState,
}

impl PidState {
    /// One tick of the speed PID: reference and measured speed in bits, voltage in bits.
    #[inline(always)]
    pub fn step_speed(&mut self, config: &PidConfig, reference: i16, speed: i16, limits: &Limits) -> i16 {
        let change = self.filter(config, speed, limits.align);
        let rest = mul_i16(config.kr, reference);
        let rest = multiply_add(rest, config.kp, speed);
        let rest = multiply_add(rest, config.kd, change);
        self.integral.close(&config.integral, rest, saturating_sub_i16(reference, speed), limits)
    }

    /// One tick of the position PID: position error and speeds in bits, voltage in bits.
    #[inline(always)]
    pub fn step_position(
        &mut self,
        config: &PidConfig,
        error: i16,
        reference_speed: i16,
        speed: i16,
        limits: &Limits,
    ) -> i16 {
        self.filter(config, speed, limits.align);
        let rest = mul_i16(config.kp, error);
        let rest = multiply_add(rest, config.kr, reference_speed);
        let rest = multiply_add(rest, config.kd, self.filtered.output());
        self.integral.close(&config.integral, rest, error, limits)
    }

    /// Moves the filter on; returns how far the speed was ahead of it.
    #[inline(always)]
    fn filter(&mut self, config: &PidConfig, speed: i16, align: bool) -> i16 {
        if align {
            self.filtered.settle(speed);
        }
        self.filtered.advance(&config.filter, speed)
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
        let gain = -0.9f32..0.9;
        (gain.clone(), -20f32..20.0, -0.003f32..0.003, 1f32..100.0, 0f32..2.0, gain, 1f32..1000.0).prop_map(
            |(kp, ki, kd, tf, b, kff, tt)| {
                let mut settings = Settings::defaults();
                let values = [
                    (Param::SpeedKp, kp * 0.3),
                    (Param::SpeedKi, if ki.abs() < 1.0 { 0.0 } else { ki * 0.05 }),
                    (Param::SpeedKd, kd * 0.1),
                    (Param::SpeedTf, tf),
                    (Param::SpeedB, b),
                    (Param::SpeedKff, kff * 0.3),
                    (Param::SpeedTt, tt),
                    (Param::PositionKp, kp * 5.0),
                    (Param::PositionKi, if ki.abs() < 1.0 { 0.0 } else { ki }),
                    (Param::PositionKd, kd * 100.0),
                    (Param::PositionTf, tf),
                    (Param::PositionKff, kff * 0.3),
                    (Param::PositionTt, tt),
                ];
                for (param, value) in values {
                    settings.set(param, value).unwrap();
                }
                settings
            },
        )
    }

    /// The filter in real numbers.
    struct ExactFilter(f64);

    impl ExactFilter {
        fn step(&mut self, config: &PidConfig, speed: f64) -> f64 {
            let change = (speed - self.0).clamp(-32768.0, 32767.0);
            self.0 += change * config.filter.part();
            change
        }
    }

    proptest! {
        /// Speed PID: within 3 bits of real arithmetic, and the difference through the filter within that of one bit
        /// of its input.
        #[test]
        fn speed_pid_is_its_law(
            settings in settings(), ticks in vec((any::<i16>(), any::<i16>(), any_limits(), 1u8..60), 1..40),
        ) {
            let Ok(config) = Quantiser::checked(&settings, PidConfig::speed) else { return Ok(()) };
            let (mut state, mut integral) = (PidState::default(), Exact::new(&config.integral));
            let mut filter = ExactFilter(0.0);
            let tolerance = 3.0 + (config.kd as f64 / 1024.0).abs();
            for (reference, speed, limits, repeat) in ticks {
                for _ in 0..repeat {
                    let change = filter.step(&config, speed as f64);
                    let rest = config.kr as f64 * reference as f64 + config.kp as f64 * speed as f64
                        + config.kd as f64 * change;
                    let exact = integral.close(rest / 1024.0, reference.saturating_sub(speed) as f64, &limits);
                    let voltage = state.step_speed(&config, reference, speed, &limits);
                    prop_assert!((voltage as f64 - exact).abs() <= tolerance, "{voltage} for {exact}");
                    prop_assert!(voltage >= limits.low && voltage <= limits.high);
                }
            }
        }

        /// Position PID: the same.
        #[test]
        fn position_pid_is_its_law(
            settings in settings(),
            ticks in vec((any::<i16>(), any::<i16>(), any::<i16>(), any_limits(), 1u8..60), 1..40),
        ) {
            let Ok(config) = Quantiser::checked(&settings, PidConfig::position) else { return Ok(()) };
            let (mut state, mut integral) = (PidState::default(), Exact::new(&config.integral));
            let mut filter = ExactFilter(0.0);
            let tolerance = 3.0 + (config.kd as f64 / 1024.0).abs();
            for (error, reference_speed, speed, limits, repeat) in ticks {
                for _ in 0..repeat {
                    filter.step(&config, speed as f64);
                    let rest = config.kp as f64 * error as f64 + config.kr as f64 * reference_speed as f64
                        + config.kd as f64 * filter.0;
                    let exact = integral.close(rest / 1024.0, error as f64, &limits);
                    let voltage = state.step_position(&config, error, reference_speed, speed, &limits);
                    prop_assert!((voltage as f64 - exact).abs() <= tolerance, "{voltage} for {exact}");
                }
            }
        }

        /// Bumpless: new gains leave the voltage where it was, within 2 bits, whatever they are.
        #[test]
        fn a_change_of_gains_moves_nothing(
            settings in settings(), reference in -6000i16..6000, speed in -6000i16..6000, previous in -9000i16..9000,
        ) {
            let Ok(config) = Quantiser::checked(&settings, PidConfig::speed) else { return Ok(()) };
            prop_assume!(settings.get(Param::SpeedKi) != 0.0);
            // An integral of more than 32 V does not exist.
            let rest = (config.kr as f64 * reference as f64 + config.kp as f64 * speed as f64) / 1024.0;
            prop_assume!((previous as f64 - rest).abs() < 32767.0);
            let limits = Limits { low: -12000, high: 12000, previous, align: true };
            let mut state = PidState::default();
            let voltage = state.step_speed(&config, reference, speed, &limits);
            prop_assert!((voltage - previous).abs() <= 2, "{voltage} for {previous}");
        }
    }

    #[test]
    fn after_a_long_saturation_the_voltage_leaves_the_limit_with_the_error() {
        let mut settings = Settings::defaults();
        settings.set(Param::SpeedKi, 5.0).unwrap();
        settings.set(Param::SpeedTt, 20.0).unwrap();
        let config = Quantiser::checked(&settings, PidConfig::speed).unwrap();
        let limits = Limits { low: -5000, high: 5000, previous: 0, align: false };
        let mut state = PidState::default();
        for _ in 0..5000 {
            assert!(state.step_speed(&config, 20000, 0, &limits) <= 5000);
        }
        assert_eq!(state.step_speed(&config, 20000, 0, &limits), 5000);
        // The error turns: the voltage is off the limit within three tracking times (60 ticks), not after 5000.
        let leaves = (0..100).position(|_| state.step_speed(&config, 15000, 20000, &limits) < 5000);
        assert!(leaves.is_some_and(|tick| tick < 60), "{leaves:?}");
    }
}

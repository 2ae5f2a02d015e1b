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

use crate::arith::saturating_sub_i16;
use crate::limits::{Integral, IntegralConfig, Law, Limits, Terms};
use crate::low_pass::{LowPassConfig, LowPassState};
use crate::quantiser::{Format, Quantiser};
use crate::settings::{BuildError, Param, Settings};
use crate::units::GAIN_LIMIT;

/// A PID, quantised. One type serves both uses; they differ in what the terms act on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PidConfig {
    /// For speed: gains on the reference (`Kp b + Kff`), on the measured speed, on its difference to the filter. For
    /// position: on the position error, on the reference's speed, on the filter.
    law: Law,
    filter: LowPassConfig,
}

impl PidConfig {
    /// The speed PID, from the settings `speed_*`.
    #[inline(always)]
    pub fn quantised_speed(q: &mut Quantiser) -> Self {
        // First, so that a gain that is too large is blamed and not the sum it is part of.
        let kp = q.bits(Param::SpeedKp);
        // Setpoint weight and feed-forward both act on the reference.
        let weighted = q.scale(Format::SpeedGain).times(Param::SpeedKp).times(Param::SpeedB).value();
        let forward = q.scale(Format::SpeedGain).times(Param::SpeedKff).value();
        let kr = q.of(weighted + forward).round(Param::SpeedKff, GAIN_LIMIT as u16) as i16;
        let filter_ticks = q.scale(Format::Ticks).times(Param::SpeedTf).value() + 1.0;
        q.scale(Format::SpeedGain).times(Param::SpeedKd).times(Param::TickRate);
        let kd = q.of(q.value() / filter_ticks).round(Param::SpeedKd, GAIN_LIMIT as u16) as i16;
        let integral = IntegralConfig::quantised(q, Param::SpeedKi, Param::SpeedTt);
        Self { law: Law { gains: [kr, -kp, -kd], integral }, filter: LowPassConfig::always(q, Param::SpeedTf) }
    }

    /// The position PID, from the settings `position_*`.
    #[inline(always)]
    pub fn quantised_position(q: &mut Quantiser) -> Self {
        let gains = [q.bits(Param::PositionKp), q.bits(Param::PositionKff), -q.bits(Param::PositionKd)];
        let integral = IntegralConfig::quantised(q, Param::PositionKi, Param::PositionTt);
        Self { law: Law { gains, integral }, filter: LowPassConfig::always(q, Param::PositionTf) }
    }

    /// The speed PID on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn speed(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build(settings, Self::quantised_speed)
    }

    /// The position PID on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn position(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build(settings, Self::quantised_position)
    }
}

impl PidConfig {
    /// The law.
    #[inline(always)]
    pub fn law(&self) -> &Law {
        &self.law
    }

    /// Moves the derivative's filter on; returns how far the speed was ahead of it.
    #[inline(always)]
    pub fn filter(&self, filtered: &mut LowPassState, speed: i16) -> i16 {
        filtered.advance(&self.filter, speed)
    }

    /// What the speed PID acts on, everything in bits; `change` is what the filter's step returned.
    #[inline(always)]
    pub fn speed_terms(change: i16, reference: i16, speed: i16) -> Terms {
        Terms { signals: [reference, speed, change], error: saturating_sub_i16(reference, speed) }
    }

    /// The same for the position PID, after the filter's step.
    #[inline(always)]
    pub fn position_terms(filtered: &LowPassState, error: i16, reference_speed: i16) -> Terms {
        Terms { signals: [error, reference_speed, filtered.output()], error }
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
        if limits.align {
            self.filtered.settle(speed);
        }
        let change = config.filter(&mut self.filtered, speed);
        let terms = PidConfig::speed_terms(change, reference, speed);
        self.integral.step(&config.law, &terms, limits)
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
        if limits.align {
            self.filtered.settle(speed);
        }
        config.filter(&mut self.filtered, speed);
        let terms = PidConfig::position_terms(&self.filtered, error, reference_speed);
        self.integral.step(&config.law, &terms, limits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::tests::{Exact, any_limits};
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
            let Ok(config) = PidConfig::speed(&settings) else { return Ok(()) };
            let (mut state, mut integral) = (PidState::default(), Exact::new(&config.law.integral));
            let mut filter = ExactFilter(0.0);
            let tolerance = 3.0 + (config.law.gains[2] as f64 / 1024.0).abs();
            for (reference, speed, limits, repeat) in ticks {
                for _ in 0..repeat {
                    let change = filter.step(&config, speed as f64);
                    let rest = config.law.gains[0] as f64 * reference as f64 + config.law.gains[1] as f64 * speed as f64
                        + config.law.gains[2] as f64 * change;
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
            let Ok(config) = PidConfig::position(&settings) else { return Ok(()) };
            let (mut state, mut integral) = (PidState::default(), Exact::new(&config.law.integral));
            let mut filter = ExactFilter(0.0);
            let tolerance = 3.0 + (config.law.gains[2] as f64 / 1024.0).abs();
            for (error, reference_speed, speed, limits, repeat) in ticks {
                for _ in 0..repeat {
                    filter.step(&config, speed as f64);
                    let rest = config.law.gains[0] as f64 * error as f64 + config.law.gains[1] as f64 * reference_speed as f64
                        + config.law.gains[2] as f64 * filter.0;
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
            let Ok(config) = PidConfig::speed(&settings) else { return Ok(()) };
            prop_assume!(settings.get(Param::SpeedKi) != 0.0);
            // An integral of more than 32 V does not exist.
            let rest = (config.law.gains[0] as f64 * reference as f64 + config.law.gains[1] as f64 * speed as f64) / 1024.0;
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
        let config = PidConfig::speed(&settings).unwrap();
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

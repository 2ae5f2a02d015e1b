//! The current of a rig that has no sensor: an observer of the armature, from voltage and speed.
//!
//! ```text
//! e(k) = (u(k-1) - k w(k)) / R            what the current is on the way to
//! i(k) = i(k-1) + a (e(k) - i(k-1))       a = T / (winding_time + T)
//! ```
//! `u` is the voltage of the tick before, `w` the mean speed since. This is the Kalman filter of a motor whose load is not
//! known: the speed then tells the back-EMF and nothing else of the current, so the correction vanishes. A bridge's drop
//! without its compensation is an error of drop over resistance. With `winding_time = T / (exp(T R / L) - 1)` the filter is
//! the winding's own. Against the recurrence in real numbers the current is within 3 bits (0.7 mA) and the rounding of
//! `torque_constant` and `resistance`.

use crate::arith::{call_mul_i16, saturate_shift_8};
use crate::low_pass::{LowPassConfig, LowPassState};
use crate::quantiser::Quantiser;
use crate::settings::Param;
use crate::units::{AMPERE, FULL_RANGE, VOLT};

/// The armature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct ObserverConfig {
    /// Bits of current a bit of voltage, times 2^8.
    of_voltage: i16,
    /// Bits of current a bit of speed, times 2^8.
    of_speed: i16,
    winding: LowPassConfig,
}

impl ObserverConfig {
    /// From `winding_time`, `torque_constant` and `resistance`.
    #[inline(always)]
    pub fn quantised(q: &mut Quantiser) -> Self {
        q.of(256.0 * AMPERE / VOLT).over(Param::Resistance);
        let of_voltage = q.round(Param::Resistance, i16::MAX as u16) as i16;
        q.of(256.0 * AMPERE / FULL_RANGE).times(Param::SpeedRange).times(Param::TorqueConstant).over(Param::Resistance);
        // A back-EMF of less than half a bit is none; one that is not used may be of any size.
        let of_speed = q.saturate_or_zero(Param::TorqueConstant, i16::MAX as u16) as i16;
        Self { of_voltage, of_speed, winding: LowPassConfig::quantised(q, Param::WindingTime) }
    }
}

/// The current, as estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct ObserverState(LowPassState);

impl ObserverState {
    /// One tick: the voltage since the last tick, the mean speed since then, and the reading of the sensor, in bits. Where
    /// the observer is not used, the answer is that reading.
    #[inline(never)]
    pub fn step(&mut self, config: &ObserverConfig, voltage: i16, speed: i16, measured: i16) -> i16 {
        if !config.winding.is_on() {
            return measured;
        }
        // Each product is below 2^30.
        let toward = call_mul_i16(voltage, config.of_voltage) - call_mul_i16(speed, config.of_speed);
        self.0.step(&config.winding, saturate_shift_8(toward))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use crate::units::FULL_RANGE;
    use proptest::prelude::*;

    fn settings(resistance_ohm: f32, constant_v_s: f32, winding_ms: f32) -> Settings {
        let mut settings = Settings::defaults();
        for (param, value) in [
            (Param::Resistance, resistance_ohm),
            (Param::TorqueConstant, constant_v_s),
            (Param::WindingTime, winding_ms),
        ] {
            settings.set(param, value).unwrap();
        }
        settings
    }

    proptest! {
        #[test]
        fn follows_the_armature(
            resistance_ohm in 1f32..50.0, constant_v_s in 0.01f32..0.5, winding_ms in 0.1f32..50.0,
            inputs in proptest::collection::vec((any::<i16>(), any::<i16>(), 1u8..60), 1..20),
        ) {
            let settings = settings(resistance_ohm, constant_v_s, winding_ms);
            let config = Quantiser::build(&settings, ObserverConfig::quantised).unwrap();
            let part = config.winding.part();
            prop_assert!((part * (f64::from(winding_ms) + 1.0) - 1.0).abs() < 1e-3);
            let mut state = ObserverState::default();
            let mut exact = 0.0f64;
            for (voltage, speed, repeat) in inputs {
                for _ in 0..repeat {
                    let [of_voltage, of_speed] = [config.of_voltage, config.of_speed].map(f64::from);
                    let toward = (f64::from(voltage) * of_voltage - f64::from(speed) * of_speed) / 256.0;
                    let toward = toward.clamp(-32768.0, 32767.0);
                    exact += part * (toward - exact).clamp(-32768.0, 32767.0);
                    let current = state.step(&config, voltage, speed, 0);
                    prop_assert!((f64::from(current) - exact).abs() <= 3.0, "{current} for {exact}");
                }
            }
        }

        /// The quantised constants are those that were set, to what their format resolves.
        #[test]
        fn constants_are_those_of_the_settings(resistance_ohm in 1f32..50.0, constant_v_s in 0.01f32..0.5) {
            let settings = settings(resistance_ohm, constant_v_s, 5.0);
            let config = Quantiser::build(&settings, ObserverConfig::quantised).unwrap();
            // Half a bit of each.
            let amperes_per_volt = f32::from(config.of_voltage) / 256.0 * VOLT / AMPERE;
            prop_assert!((amperes_per_volt - 1.0 / resistance_ohm).abs() <= 0.501 / 256.0 * VOLT / AMPERE);
            let range = settings.get(Param::SpeedRange);
            let amperes_per_speed = f32::from(config.of_speed) / 256.0 * FULL_RANGE / range / AMPERE;
            let half = 0.501 / 256.0 * FULL_RANGE / range / AMPERE;
            prop_assert!((amperes_per_speed - constant_v_s / resistance_ohm).abs() <= half);
        }
    }

    #[test]
    fn a_held_rotor_draws_voltage_over_resistance_with_the_windings_time() {
        let config = Quantiser::build(&settings(5.0, 0.07, 10.0), ObserverConfig::quantised).unwrap();
        let mut state = ObserverState::default();
        let ten_v = (10.0 * VOLT) as i16;
        let mut next = || f32::from(state.step(&config, ten_v, 0, -7)) / AMPERE;
        let currents: Vec<f32> = (0..200).map(|_| next()).collect();
        assert!((currents[199] - 2.0).abs() < 0.01, "{}", currents[199]);
        assert!((currents[9] / 2.0 - (1.0 - (10.0f32 / 11.0).powi(10))).abs() < 0.01, "{}", currents[9]);
    }

    #[test]
    fn without_a_winding_time_the_sensor_is_believed() {
        let config = Quantiser::build(&Settings::defaults(), ObserverConfig::quantised).unwrap();
        assert_eq!(ObserverState::default().step(&config, 9999, 99, 123), 123);
    }
}

//! The analogue sensors: true quantity in, voltage at the pin out, limited to the chip's supply.

use std::f64::consts::TAU;

use super::AVCC_V;
use host_sim::trial::USUAL_RIPPLE;
use host_sim::trial::{TACHO_DIVIDER, TACHO_RIPPLES_PER_TURN};

/// Current sensor: half the supply at no current.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acs712 {
    /// Output at no current, in volts.
    pub zero_v: f64,
    /// Sensitivity; negative if the motor's leads are exchanged.
    pub v_per_a: f64,
    /// Standard deviation of its noise, in volts.
    pub noise_v: f64,
}

impl Default for Acs712 {
    /// ACS712-05B with 47 nF at its FILTER pin: about 21 mV peak to peak.
    fn default() -> Self {
        Self { zero_v: AVCC_V / 2.0, v_per_a: 0.185, noise_v: 3.5e-3 }
    }
}

impl Acs712 {
    /// Voltage for a current; `noise` is a sample of the unit normal distribution.
    pub fn output_v(&self, current_a: f64, noise: f64) -> f64 {
        (self.zero_v + self.v_per_a * current_a + self.noise_v * noise).clamp(0.0, AVCC_V)
    }
}

/// Tachogenerator behind a rectifier and a divider.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tachogenerator {
    /// Voltage per 1000 revolutions per minute, before the divider.
    pub v_per_1000_rpm: f64,
    /// Part of it that reaches the pin.
    pub divider: f64,
    /// Amplitude of the ripple relative to the mean.
    pub ripple: f64,
    /// Periods of the ripple per turn of the motor.
    pub ripples_per_turn: f64,
}

impl Default for Tachogenerator {
    fn default() -> Self {
        Self {
            v_per_1000_rpm: 3.0,
            divider: TACHO_DIVIDER,
            ripple: USUAL_RIPPLE,
            ripples_per_turn: TACHO_RIPPLES_PER_TURN,
        }
    }
}

impl Tachogenerator {
    /// Voltage at the pin; the converter sees the magnitude only.
    pub fn output_v(&self, speed_rad_per_s: f64, angle_rad: f64) -> f64 {
        let rpm = speed_rad_per_s.abs() * 60.0 / TAU;
        let ripple = 1.0 + self.ripple * (self.ripples_per_turn * angle_rad).sin();
        (rpm / 1000.0 * self.v_per_1000_rpm * self.divider * ripple).clamp(0.0, AVCC_V)
    }
}

/// Divider from the motor supply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupplyDivider {
    /// Part of the supply voltage that reaches the pin.
    pub ratio: f64,
}

impl Default for SupplyDivider {
    /// 30 kohm and 10 kohm.
    fn default() -> Self {
        Self { ratio: 0.25 }
    }
}

impl SupplyDivider {
    /// Voltage at the pin.
    pub fn output_v(&self, supply_v: f64) -> f64 {
        (self.ratio * supply_v).clamp(0.0, AVCC_V)
    }
}

/// What is wrong with an analogue sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorFault {
    /// The pin stays at this voltage: 0 and 5 V are the rails.
    PinnedV(f64),
    /// The wire is off: the sample-and-hold keeps the charge of the input sampled before.
    Open,
}

/// Normally distributed noise that a seed determines.
pub(super) struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Evenly distributed in (0, 1]: a counter, scrambled (SplitMix64).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (((z ^ (z >> 31)) >> 11) + 1) as f64 / (1_u64 << 53) as f64
    }

    /// A sample with mean 0 and standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn current_sensor_clips_at_both_rails() {
        let sensor = Acs712::default();
        assert!((sensor.output_v(-1.0, 0.0) - 2.315).abs() < 1e-12);
        assert_eq!(sensor.output_v(20.0, 0.0), 5.0);
        assert_eq!(sensor.output_v(-20.0, 0.0), 0.0);
    }

    #[test]
    fn tachogenerator_shows_the_magnitude_with_its_ripple() {
        let tacho = Tachogenerator::default();
        let speed = 1000.0 * TAU / 60.0;
        let over_a_turn = (0..1000).map(|i| tacho.output_v(-speed, TAU * f64::from(i) / 1000.0));
        let (low, high) = over_a_turn.fold((9.0, 0.0), |(l, h): (f64, f64), v| (l.min(v), h.max(v)));
        assert!((low - 1.5 * 0.95).abs() < 1e-3 && (high - 1.5 * 1.05).abs() < 1e-3, "{low} {high}");
    }

    #[test]
    fn noise_has_unit_variance_and_repeats() {
        let draw = |seed| {
            let mut noise = Noise::new(seed);
            (0..20_000).map(|_| noise.normal()).collect::<Vec<f64>>()
        };
        let values = draw(7);
        let mean = values.iter().sum::<f64>() / 2e4;
        let variance = values.iter().map(|v| v * v).sum::<f64>() / 2e4;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04, "{mean} {variance}");
        assert_eq!(values, draw(7));
        assert_ne!(values, draw(8));
    }
}

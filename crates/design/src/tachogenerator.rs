//! A tachogenerator as the speed sensor of a loop: its resolution and its limits.
//!
//! The firmware converts half of its voltage once a millisecond (`speed_sensor` 1) and sees the magnitude only. It
//! takes the sign from the drive, and changes it only near standstill. A tachogenerator gives no position.

use super::DesignError;
use super::specification::Specification;
use host_sim::plant::Plant;
use host_sim::trial::{TACHO_DIVIDER, TACHO_RIPPLES_PER_TURN, Trial, USUAL_RIPPLE};
use motorbench_core::converter;
use motorbench_core::settings::{Param, Settings};
use motorbench_core::tachogenerator::{LEAST_VOLTAGE_V, NEAR_ZERO};
use motorbench_data::rig::Rig;
use motorbench_model::motor::MotorParameters;
use serde::Serialize;
use std::f64::consts::TAU;

/// One step of the converter in volts, and the number of steps.
const STEP_V: f64 = converter::STEP_V as f64;
const STEPS: f64 = converter::STEPS as f64;
/// Conversions a second in the firmware.
pub const CONVERSIONS_HZ: f64 = converter::ROUNDS_HZ as f64;
/// Change of the reference between two conversions, in converter steps. The firmware changes the sign only at a
/// conversion that is less than [`NEAR_ZERO`] from standstill. At the first value a reversal has four such conversions,
/// at the second two and a half.
const STEPS_A_CONVERSION: f64 = 0.5 * NEAR_ZERO as f64;
const MOST_STEPS_A_CONVERSION: f64 = 0.8 * NEAR_ZERO as f64;
/// Voltage against the motion at standstill that a change of sign needs. It is the firmware's threshold with inertia,
/// resistance and torque constant 30 % off.
const REVERSAL_V: f64 = LEAST_VOLTAGE_V as f64 * 1.3 / (0.7 * 0.7);
/// Smallest no-load speed, in converter steps.
const FEWEST_STEPS: f64 = 100.0;
/// Time constant of the low-pass relative to the loop's `1/(2 pi bandwidth)`. It costs 11 degrees of phase at the
/// bandwidth.
const FILTER_PART: f64 = 0.2;
/// Longest low-pass: slower loops do not need more.
const LONGEST_FILTER_S: f64 = 50e-3;
/// Shortest low-pass in ticks: a shorter one has no effect.
const SHORTEST_FILTER_TICKS: f64 = 0.1;

/// A tachogenerator on the motor's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tachogenerator {
    /// Volts at 1000 revolutions a minute, before the divider by two.
    #[serde(rename = "gain_V_per_krpm")]
    pub gain_v_per_krpm: f64,
    /// Amplitude of its ripple relative to the mean.
    pub ripple: f64,
    /// Periods of the ripple in a revolution.
    pub ripples_per_rev: f64,
}

impl Tachogenerator {
    /// A tachogenerator with this gain, and with the ripple of the studies' stand.
    pub fn new(gain_v_per_krpm: f64) -> Self {
        Self { gain_v_per_krpm, ripple: USUAL_RIPPLE, ripples_per_rev: TACHO_RIPPLES_PER_TURN }
    }

    /// Speed of one converter step.
    pub fn resolution_rad_per_s(&self) -> f64 {
        let v_s_per_rad = TACHO_DIVIDER * 1e-3 * 60.0 / TAU * self.gain_v_per_krpm;
        STEP_V / v_s_per_rad
    }

    /// Largest speed that the converter can read, at the crest of the ripple.
    pub fn largest_rad_per_s(&self) -> f64 {
        (STEPS - 1.0) * self.resolution_rad_per_s() / (1.0 + self.ripple)
    }

    /// Speed at which the ripple has the frequency of the conversions and reads as a constant error.
    pub fn aliased_rad_per_s(&self) -> f64 {
        TAU * CONVERSIONS_HZ / self.ripples_per_rev
    }

    /// Largest acceleration of the reference, in rad/s^2, at which the firmware detects a reversal. It is slow enough
    /// for the conversions. If the motor allows both, it is also fast enough to need a voltage.
    pub fn largest_acceleration(&self, motor: &MotorParameters) -> f64 {
        let steps = |number: f64| number * self.resolution_rad_per_s() * CONVERSIONS_HZ;
        (REVERSAL_V / volts_per_acceleration(motor)).clamp(steps(STEPS_A_CONVERSION), steps(MOST_STEPS_A_CONVERSION))
    }

    /// Refuses a profile whose reversal the firmware may miss. The speed would keep the wrong sign, and the drive would
    /// run away.
    ///
    /// # Errors
    /// [`DesignError::Tachogenerator`] with what to do.
    pub fn check_reversal(&self, motor: &MotorParameters, acceleration: f64) -> Result<(), DesignError> {
        let voltage_v = acceleration * volts_per_acceleration(motor);
        if voltage_v >= REVERSAL_V {
            return Ok(());
        }
        let what = format!(
            "a reversal at {acceleration:.0} rad/s2 takes {voltage_v:.2} V at standstill, but the firmware needs {REVERSAL_V:.2} V to detect it ({LEAST_VOLTAGE_V} V with parameters 30 % off). A faster reversal may pass between two conversions or exceed the limits. Raise current-limit-A, amplify the voltage of the tachogenerator less, or use an encoder"
        );
        Err(DesignError::Tachogenerator { what })
    }

    /// Time constant of the low-pass for a specification; all laws share it.
    pub fn filter_s(&self, motor: &MotorParameters, specification: &Specification, period_s: f64) -> f64 {
        let filter_s = (FILTER_PART / specification.speed.rad_per_s(motor, period_s)).min(LONGEST_FILTER_S);
        if filter_s < SHORTEST_FILTER_TICKS * period_s { 0.0 } else { super::fixed_point::rounded(filter_s) }
    }

    /// Refuses a tachogenerator that the firmware cannot measure.
    ///
    /// # Errors
    /// [`DesignError::Tachogenerator`] with what to do.
    pub fn check(&self, no_load_rad_per_s: f64, tick_rate_hz: f64) -> Result<(), DesignError> {
        let refuse = |what: String| Err(DesignError::Tachogenerator { what });
        let (largest, resolution) = (self.largest_rad_per_s(), self.resolution_rad_per_s());
        if tick_rate_hz > CONVERSIONS_HZ {
            return refuse(format!(
                "the firmware converts its voltage {CONVERSIONS_HZ} times a second, so a tick rate of {tick_rate_hz} Hz has no use: set 1000 Hz"
            ));
        }
        if no_load_rad_per_s > largest {
            return refuse(format!(
                "behind the divider by two the converter ends at {largest:.0} rad/s, the motor's no-load speed is {no_load_rad_per_s:.0}: lower supply.voltage_V. Or divide the voltage once more and give the remaining gain_V_per_krpm"
            ));
        }
        if no_load_rad_per_s < FEWEST_STEPS * resolution {
            return refuse(format!(
                "one step of the converter is {resolution:.3} rad/s, the motor's no-load speed is {no_load_rad_per_s:.1}. At least {FEWEST_STEPS} steps are needed: amplify the voltage or use an encoder"
            ));
        }
        Ok(())
    }

    /// Sets the ripple of a trial; its settings contain the rest.
    pub fn set_ripple<P: Plant>(&self, trial: &mut Trial<P>) {
        trial.surroundings.tacho_ripple = self.ripple;
        trial.surroundings.tacho_ripples_per_turn = self.ripples_per_rev;
    }
}

/// Voltage that accelerates the motor at standstill, in V s^2/rad.
fn volts_per_acceleration(motor: &MotorParameters) -> f64 {
    motor.inertia_kg_m2 * motor.resistance_ohm / motor.torque_constant_nm_per_a
}

/// Whether settings take the speed from the tachogenerator.
pub fn is_speed_sensor(settings: &Settings) -> bool {
    settings.get(Param::SpeedSensor) != 0.0
}

/// The tachogenerator, if the rig uses it for the speed or has no encoder. The inner value is `None` without a gain.
pub fn of_rig(rig: &Rig) -> Option<Option<Tachogenerator>> {
    let given = &rig.tachogenerator;
    let takes_its_place = rig.encoder.counts_per_rev.is_none() && given.gain_v_per_krpm.is_some();
    if !given.feedback.unwrap_or(takes_its_place) {
        return None;
    }
    Some(given.gain_v_per_krpm.map(|gain_v_per_krpm| {
        let usual = Tachogenerator::new(gain_v_per_krpm);
        Tachogenerator {
            ripple: given.ripple.unwrap_or(usual.ripple),
            ripples_per_rev: given.ripples_per_rev.unwrap_or(usual.ripples_per_rev),
            ..usual
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The studies' tachogenerator: 3 V at 1000 rpm, halved, in steps of 4.9 mV.
    #[test]
    fn what_the_converter_sees_of_the_stand() {
        let tacho = Tachogenerator::new(3.0);
        assert!((tacho.resolution_rad_per_s() * 60.0 / TAU - 3.255).abs() < 0.001);
        assert!((tacho.largest_rad_per_s() * 60.0 / TAU - 3333.3 / 1.05 * 1023.0 / 1024.0).abs() < 0.2);
        assert!((tacho.aliased_rad_per_s() - 285.6).abs() < 0.1);
    }

    /// The stand reverses with enough voltage; a motor with a tenth of the inertia does not.
    #[test]
    fn a_reversal_that_would_not_be_seen_is_refused() {
        let (tacho, stand) = (Tachogenerator::new(3.0), MotorParameters::PIVT6);
        assert!((tacho.largest_acceleration(&stand) - 2500.0 * tacho.resolution_rad_per_s()).abs() < 1e-6);
        assert!(tacho.check_reversal(&stand, tacho.largest_acceleration(&stand)).is_ok());
        let light = MotorParameters { inertia_kg_m2: 0.1 * stand.inertia_kg_m2, ..stand };
        let message = tacho.check_reversal(&light, tacho.largest_acceleration(&light)).unwrap_err().to_string();
        println!("{message}");
        assert!(message.contains("a reversal at 1364 rad/s2 takes 0.25 V at standstill"), "{message}");
    }

    #[test]
    fn what_the_firmware_cannot_measure_is_refused_with_what_to_do() {
        let refused = |gain, no_load, rate| Tachogenerator::new(gain).check(no_load, rate).unwrap_err().to_string();
        assert!(Tachogenerator::new(3.0).check(166.0, 1000.0).is_ok());
        for (message, expected) in [
            (refused(3.0, 415.0, 1000.0), "ends at 332 rad/s, the motor's no-load speed is 415: lower supply"),
            (refused(0.05, 166.0, 1000.0), "At least 100 steps are needed: amplify"),
            (refused(3.0, 166.0, 2000.0), "set 1000 Hz"),
        ] {
            println!("{message}");
            assert!(message.starts_with("the tachogenerator: ") && message.contains(expected), "{message}");
        }
    }
}

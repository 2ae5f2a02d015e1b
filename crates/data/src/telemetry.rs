//! Converts the firmware's samples to a recording in SI units.

use crate::recording::{Channel, Recording};
use crate::rig::{CurrentSensor, Encoder, NominalMotor, Rig, Supply, Tachogenerator, Timing};
use motorbench_core::HARDWARE;
use motorbench_core::converter;
use motorbench_core::message::{Mode, Sample, State};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::{AMPERE, FULL_RANGE, VOLT};
use std::f64::consts::TAU;

/// Step of the firmware's current reading at 185 mV/A: one converter step divided by the conversions in a sum.
const CURRENT_STEP_A: f64 = converter::STEP_V as f64 / (2.0 * converter::BLOCK as f64) / 0.185;

/// The drive stops by itself if the program is silent for longer. The number is unusual on purpose: a board with it was
/// left by a program that was killed.
pub const LOST_AFTER_MS: f32 = 501.0;

/// Settings of a recording for an identification: nothing limits the excitation, and only the current trips remain.
pub const IDENTIFICATION_SETTINGS: [(Param, f32); 6] = [
    (Param::CurrentLimit, 0.0),
    (Param::TripPeak, 5.0),
    (Param::TripContinuous, 3.0),
    (Param::TripEncoder, 0.0),
    (Param::TripStall, 0.0),
    (Param::SlewLimit, 30_000.0),
];

/// One bit of the measured or commanded speed, in rad/s.
pub fn speed_bit_rad_per_s(settings: &Settings) -> f64 {
    f64::from(settings.get(Param::SpeedRange)) / f64::from(FULL_RANGE)
}

/// One bit of a reference in a mode: V, rad/s or rad.
pub fn reference_bit(mode: Mode, settings: &Settings) -> f64 {
    match mode {
        mode if mode.is_position() => TAU / f64::from(settings.get(Param::CountsPerRev)),
        mode if mode.is_speed() => speed_bit_rad_per_s(settings),
        _ => 1.0 / f64::from(VOLT),
    }
}

/// The last mode in which samples were driven. A trip or a stop at the end has no mode, but the reference stays.
pub fn driven_mode(samples: &[Sample]) -> Mode {
    let mut modes = samples.iter().rev().map(|sample| sample.state.mode());
    modes.find(|mode| *mode != Mode::Off).unwrap_or(Mode::Off)
}

/// The samples as a recording, with the reference of their mode.
pub fn recording(name: &str, samples: &[Sample], settings: &Settings) -> Recording {
    recording_of(name, samples, settings, driven_mode(samples))
}

/// The samples as a recording with the reference of `mode`. While the bridge is off, duty and voltage are missing,
/// since nothing drives the motor.
pub fn recording_of(name: &str, samples: &[Sample], settings: &Settings, mode: Mode) -> Recording {
    let get = |param| f64::from(settings.get(param));
    let rate_hz = get(Param::TickRate);
    let first = samples.first().map_or(0, |sample| sample.tick);
    let column = |of: &dyn Fn(&Sample) -> f64| samples.iter().map(of).collect::<Vec<f64>>();
    let driven = |sample: &Sample, value: f64| if sample.state.has(State::ENABLED) { value } else { f64::NAN };
    let duty = |sample: &Sample| f64::from(sample.duty) / f64::from(HARDWARE.pwm_steps);
    let supply_v = |sample: &Sample| f64::from(sample.supply) / f64::from(VOLT);
    let mut recording = Recording::new(name);
    recording.set(Channel::Time, column(&|sample| f64::from(sample.tick.wrapping_sub(first)) / rate_hz));
    recording.set(Channel::Duty, column(&|sample| driven(sample, duty(sample))));
    recording.set(Channel::Voltage, column(&|sample| driven(sample, duty(sample) * supply_v(sample))));
    recording.set(Channel::Counts, column(&|sample| f64::from(sample.counts)));
    let speed_bit = speed_bit_rad_per_s(settings);
    recording.set(Channel::Speed, column(&|sample| f64::from(sample.speed) * speed_bit));
    recording.set(Channel::Current, column(&|sample| f64::from(sample.current) / f64::from(AMPERE)));
    let unit = reference_bit(mode, settings);
    let reference = || column(&|sample| f64::from(sample.reference) * unit);
    if mode.is_speed() {
        recording.set(Channel::SpeedReference, reference());
    } else if mode.is_position() {
        recording.set(Channel::AngleReference, reference());
    }
    recording
}

/// The same for a rig whose control core ran on the host.
pub fn rig_of_core(settings: &Settings, motor: NominalMotor) -> Rig {
    Rig { recording: Timing::CORE_ON_HOST, ..rig(settings, motor) }
}

/// The rig of a board by its settings, with nominal constants of the motor.
pub fn rig(settings: &Settings, motor: NominalMotor) -> Rig {
    let tachogenerator = match settings.get(Param::SpeedSensor) {
        0.0 => Tachogenerator::default(),
        _ => Tachogenerator {
            gain_v_per_krpm: Some(settings.get(Param::TachoGain).into()),
            feedback: Some(true),
            ..Tachogenerator::default()
        },
    };
    Rig {
        tachogenerator,
        supply: Supply { voltage_v: Some(settings.get(Param::SupplyVoltage).into()) },
        encoder: Encoder { counts_per_rev: Some(settings.get(Param::CountsPerRev).into()) },
        current_sensor: CurrentSensor { resolution_a: Some(CURRENT_STEP_A), ..CurrentSensor::default() },
        recording: Timing::FIRMWARE,
        motor,
        ..Rig::default()
    }
}

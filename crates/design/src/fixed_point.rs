//! Settings of a design, and its gains in the core's fixed-point formats.

use super::law::{ControlLaw, Signal, setting_name, setting_unit};
use super::observer::winding_time_ms;
use super::sampled_loop::{Gains, Sampling, SpeedPath};
use super::specification::Specification;
use super::tachogenerator::is_speed_sensor;
use super::{Bench, DesignError, observes_current};
use motorbench_core::control_loop::LoopConfig;
use motorbench_core::limits::{bits_per_unit, quantise_gain};
use motorbench_core::settings::{BuildError, Param, Settings};
use motorbench_core::units::{AMPERE, FULL_RANGE, Fraction, GAIN_LIMIT, Gain, IntegralGain, Rule, VOLT, quantise};
use motorbench_model::linear::motor_model;
use motorbench_model::motor::MotorParameters;
use nalgebra::Complex;

/// Range of the speed format, relative to the no-load speed.
const SPEED_HEADROOM: f64 = 1.25;
/// Edge rate that the encoder's interrupt handler can take.
const MAX_EDGES_PER_S: f64 = 100_000.0;
/// Largest part of the current limit that a change of the reference uses. With inertia and torque constant 30 % off it
/// becomes 0.6, which the thermal trip allows without end.
pub const ACCELERATION_PART: f64 = 0.32;
/// Current of the thermal trip and of the peak trip relative to the current limit, as in the core's defaults.
const TRIP_CONTINUOUS: f64 = 0.6;
const TRIP_PEAK: f64 = 1.2;
/// Range of the position error, as voltage in supplies. Beyond it the voltage is at its limit.
const POSITION_SUPPLIES: f64 = 4.0;
/// Ticks in which the voltage may rise to the supply. That limits jumps, but not the loop's own motion.
const SLEW_TICKS: f64 = 4.0;
/// Number of widths of the friction compensation's transition in the speed range: twice the narrowest that the core
/// holds.
const WIDTHS_A_RANGE: f64 = 256.0;
/// Tachogenerator gain that fits every range, for rigs that take the speed from the encoder.
const UNUSED_TACHO_GAIN: f32 = 100.0;
/// Speed of the position profile on a rig without an encoder. It fits every acceleration.
const UNUSED_CRUISE_RAD_PER_S: f64 = 1.0;
/// Number of settings in one console line.
const SETTINGS_A_LINE: usize = 3;
/// Significant digits of settings on the console.
const DIGITS: i32 = 5;

/// A number rounded as the console gives it.
pub fn rounded(value: f64) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    let unit = 10_f64.powi(DIGITS - 1 - value.abs().log10().floor() as i32);
    (value * unit).round() / unit
}

/// Settings, in the order in which they are sent.
#[derive(Clone, Debug, PartialEq)]
pub struct SettingList {
    /// All settings. Those that differ from the defaults are in `changed`.
    pub all: Settings,
    /// Settings that the design sets.
    pub changed: Vec<Param>,
}

impl Default for SettingList {
    fn default() -> Self {
        Self { all: Settings::defaults(), changed: Vec::new() }
    }
}

impl SettingList {
    /// Sets a value, rounded to the console's digits.
    ///
    /// # Errors
    /// [`DesignError::Setting`] outside the setting's range.
    pub fn set(&mut self, param: Param, value: f64) -> Result<(), DesignError> {
        let value = rounded(value);
        self.all.set(param, value as f32).map_err(|rule| refusal(rule.of(param), value))?;
        if !self.changed.contains(&param) {
            self.changed.push(param);
        }
        Ok(())
    }

    /// Multiplies the position PID's feed-forward by `part`. Returns whether it was large enough to matter.
    ///
    /// # Errors
    /// [`DesignError::Setting`] below the setting's range.
    pub fn reduce_feed_forward(&mut self, law: ControlLaw, part: f64) -> Result<bool, DesignError> {
        let (feed_forward, derivative) = (self.all.get(Param::PositionKff), self.all.get(Param::PositionKd));
        // A smaller one does not even cancel the derivative and cannot cause overshoot.
        if law != ControlLaw::PositionPid || feed_forward <= 0.5 * derivative {
            return Ok(false);
        }
        self.set(Param::PositionKff, part * f64::from(feed_forward))?;
        Ok(true)
    }

    /// Multiplies the acceleration of the reference's profile by `part`.
    ///
    /// # Errors
    /// [`DesignError::Setting`] below the setting's range.
    pub fn slow_down(&mut self, part: f64) -> Result<(), DesignError> {
        self.set(Param::Acceleration, part * f64::from(self.all.get(Param::Acceleration)))
    }

    /// Adds the settings of another design on the same rig. A gain that one of them switches off is taken from the
    /// other. Of two accelerations the smaller is kept.
    pub fn merge(&mut self, other: &Self) {
        for &param in &other.changed {
            let (own, others) = (self.all.get(param), other.all.get(param));
            let gentler = param == Param::Acceleration && own < others;
            if self.changed.contains(&param) && (others == 0.0 || gentler) {
                continue;
            }
            self.all.values[param as usize] = others;
            if !self.changed.contains(&param) {
                self.changed.push(param);
            }
        }
    }

    /// Console lines in an order that a board with its defaults accepts. The console takes a line as a whole and
    /// refuses one that does not fit its other settings.
    pub fn commands(&self) -> Vec<String> {
        let (mut lines, mut taken) = (Vec::new(), Settings::defaults());
        let mut waiting = self.changed.clone();
        while !waiting.is_empty() {
            let line = self.next_line(&taken, &waiting);
            line.iter().for_each(|&param| taken.values[param as usize] = self.all.get(param));
            waiting.retain(|param| !line.contains(param));
            lines.push(self.line(&line));
        }
        lines
    }

    fn line(&self, params: &[Param]) -> String {
        let pair = |param: &Param| format!("{} {}", setting_name(*param), self.all.get(*param));
        format!("set {}", params.iter().map(pair).collect::<Vec<_>>().join(" "))
    }

    /// The next line of settings. If other settings must change first, they come before it, or in the same line.
    fn next_line(&self, taken: &Settings, waiting: &[Param]) -> Vec<Param> {
        let refused = |params: &[Param]| {
            let mut settings = *taken;
            params.iter().for_each(|&param| settings.values[param as usize] = self.all.get(param));
            LoopConfig::build(&settings).err().map(|error| error.param)
        };
        let mut line = waiting[..waiting.len().min(SETTINGS_A_LINE)].to_vec();
        while let Some(clashing) = refused(&line) {
            let others = |param: &Param| !line.contains(param);
            let Some(other) = Some(clashing)
                .filter(|param| others(param) && waiting.contains(param))
                .or_else(|| waiting.iter().copied().find(others))
            else {
                break;
            };
            if refused(&[other]).is_none() {
                return vec![other];
            }
            line.push(other);
        }
        line
    }
}

/// The refusal of the core as an error with advice.
pub(super) fn refusal(error: BuildError, value: f64) -> DesignError {
    let why = match error.rule {
        Rule::TooLarge => "is larger than its format holds",
        Rule::TooSmall => "is below its range",
        Rule::RoundsToZero => "would become zero in its format",
        Rule::NotPowerOfTwo => "is not a power of two",
        Rule::NotAllowed => "is not allowed",
        Rule::NotFinite => "is not a number",
    };
    DesignError::Setting {
        name: setting_name(error.param),
        value: rounded(value),
        unit: setting_unit(error.param),
        why,
        advice: advice(error),
    }
}

/// Advice on a setting that the core cannot hold. It names the quantity that the setting follows from.
fn advice(error: BuildError) -> &'static str {
    use Rule::{NotAllowed, NotFinite, NotPowerOfTwo, RoundsToZero, TooLarge, TooSmall};
    match (error.param, error.rule) {
        (_, NotPowerOfTwo | NotAllowed | NotFinite) => "check the model and the rig",
        (Param::CurrentLimit | Param::TripPeak | Param::TripContinuous, TooLarge) => "lower current-limit-A",
        (Param::CurrentLimit | Param::TripPeak | Param::TripContinuous, _) => "raise current-limit-A",
        (Param::Acceleration, TooLarge) => "check inertia and torque constant of the model, or lower current-limit-A",
        (Param::Acceleration, _) => {
            "raise --current-limit-A (the profile uses a third of it), or correct inertia and torque constant of the model"
        }
        (Param::TachoGain | Param::SpeedFilter, _) => "check the tachogenerator's gain",
        (
            Param::SupplyVoltage
            | Param::VoltageLimit
            | Param::SlewLimit
            | Param::Resistance
            | Param::TorqueConstant
            | Param::CountsPerRev
            | Param::SpeedRange
            | Param::CompFrictionWidth
            | Param::CruiseSpeed,
            _,
        ) => "check supply and encoder of the rig, and resistance and torque constant of the model",
        (_, TooLarge) => "ask for a slower loop",
        (_, TooSmall | RoundsToZero) => "ask for a faster loop",
    }
}

/// Settings of the rig: ranges, limits, trips, reference profile.
///
/// # Errors
/// [`DesignError::Setting`] if the core cannot hold a setting of the rig, [`DesignError::TooFast`] for the encoder,
/// [`DesignError::Tachogenerator`] for the tachogenerator.
pub fn rig_settings(
    motor: &MotorParameters,
    bench: &Bench,
    specification: &Specification,
) -> Result<SettingList, DesignError> {
    let current_limit_a = specification.current_limit_a;
    let no_load_rad_per_s = bench.supply_v * motor_model::speed(motor).dc_gain();
    let edges_per_s = no_load_rad_per_s * bench.counts_per_rev.unwrap_or(0.0) / std::f64::consts::TAU;
    if edges_per_s > MAX_EDGES_PER_S {
        return Err(DesignError::TooFast { edges_per_s, limit_per_s: MAX_EDGES_PER_S });
    }
    let speed_range = speed_range(no_load_rad_per_s);
    let mut list = SettingList::default();
    let drive_a = ACCELERATION_PART * current_limit_a.min(bench.supply_v / motor.resistance_ohm);
    list.set(Param::TickRate, bench.tick_rate_hz)?;
    if let Some(counts_per_rev) = bench.counts_per_rev {
        list.set(Param::CountsPerRev, counts_per_rev)?;
        list.set(Param::PositionRange, position_range(motor, bench, specification, counts_per_rev))?;
    }
    for (param, value) in [
        (Param::SpeedRange, speed_range),
        (Param::CompFrictionWidth, friction_width(speed_range)),
        (Param::SupplyVoltage, bench.supply_v),
        (Param::VoltageLimit, bench.supply_v),
        (Param::Resistance, motor.resistance_ohm),
        (Param::TorqueConstant, motor.torque_constant_nm_per_a),
        (Param::CurrentLimit, current_limit_a),
        (Param::TripPeak, TRIP_PEAK * current_limit_a),
        (Param::TripContinuous, TRIP_CONTINUOUS * current_limit_a),
        (Param::SlewLimit, bench.supply_v * bench.tick_rate_hz / SLEW_TICKS),
        (Param::Acceleration, drive_a * motor.torque_constant_nm_per_a / motor.inertia_kg_m2),
        (Param::CruiseSpeed, bench.counts_per_rev.map_or(UNUSED_CRUISE_RAD_PER_S, |_| cruise_speed(no_load_rad_per_s))),
    ] {
        list.set(param, value)?;
    }
    set_speed_sensor(&mut list, motor, bench, specification)?;
    let observed = observes_current(bench);
    list.set(Param::WindingTime, if observed { winding_time_ms(motor, 1.0 / bench.tick_rate_hz) } else { 0.0 })?;
    Ok(list)
}

/// Sets the source of the speed. It is always set, since the board may have used another one.
fn set_speed_sensor(
    list: &mut SettingList,
    motor: &MotorParameters,
    bench: &Bench,
    specification: &Specification,
) -> Result<(), DesignError> {
    let Some(tachogenerator) = bench.tachogenerator else {
        list.set(Param::SpeedSensor, 0.0)?;
        return list.set(Param::SpeedFilter, 0.0);
    };
    tachogenerator.check(bench.supply_v * motor_model::speed(motor).dc_gain(), bench.tick_rate_hz)?;
    let acceleration = f64::from(list.all.get(Param::Acceleration)).min(tachogenerator.largest_acceleration(motor));
    list.set(Param::Acceleration, acceleration)?;
    list.set(Param::SpeedSensor, 1.0)?;
    list.set(Param::TachoGain, tachogenerator.gain_v_per_krpm)?;
    list.set(Param::SpeedFilter, 1e3 * tachogenerator.filter_s(motor, specification, 1.0 / bench.tick_rate_hz))
}

/// Full scale of the speed for a motor with this greatest speed.
pub fn speed_range(no_load_rad_per_s: f64) -> f64 {
    power_of_two(SPEED_HEADROOM * no_load_rad_per_s).clamp(8.0, 4096.0)
}

/// Speed of a move for a motor with this greatest speed, in rad/s: half of its voltage is left to correct errors.
pub fn cruise_speed(no_load_rad_per_s: f64) -> f64 {
    0.5 * no_load_rad_per_s
}

/// Acceleration of a move for a motor with this greatest one, in rad/s2: the rest is left to correct errors.
pub fn move_acceleration(greatest_rad_per_s2: f64) -> f64 {
    ACCELERATION_PART * greatest_rad_per_s2
}

/// Width of the friction compensation's transition for a full scale of the speed.
pub fn friction_width(speed_range: f64) -> f64 {
    speed_range / WIDTHS_A_RANGE
}

/// Smallest power of two that is not below `value`.
fn power_of_two(value: f64) -> f64 {
    2_f64.powi(value.log2().ceil() as i32)
}

/// The settings of one law.
///
/// # Errors
/// [`DesignError::Setting`] for a gain the core cannot hold.
pub fn law_settings(
    rig: &SettingList,
    motor: &MotorParameters,
    law: ControlLaw,
    sampling: &Sampling,
    gains: &Gains,
) -> Result<SettingList, DesignError> {
    let mut list = rig.clone();
    for (&(param, _), &gain) in law.feedback().iter().zip(&gains.feedback) {
        list.set(param, gain)?;
    }
    let (proportional, integral) = (gains.feedback[0], gains.feedback[gains.feedback.len() - 1]);
    match law {
        ControlLaw::SpeedPid => list.set(Param::SpeedB, gains.reference / proportional)?,
        ControlLaw::SpeedLqr => list.set(Param::LqrSpeedKr, gains.reference)?,
        // The derivative's part at a constant speed, and the back-EMF.
        ControlLaw::PositionPid => {
            list.set(Param::PositionKff, gains.feedback[1] + 1.0 / motor_model::speed(motor).dc_gain())?;
        }
        ControlLaw::PositionLqr => {}
    }
    if let Some(filter) = law.filter() {
        list.set(filter, 1e3 * sampling.filter_s)?;
    }
    // The integral time: the anti-windup discharges the integral as fast as it charges.
    let tracking_ms = (1e3 * proportional / integral).clamp(5e3 * sampling.period_s, 5e3);
    list.set(law.tracking(), tracking_ms)?;
    fit(&mut list, law)?;
    Ok(list)
}

/// Range of the position: large enough for the errors that matter to the loop, and fine enough for one count. All laws
/// share it, so that they can be switched while the motor turns.
fn position_range(motor: &MotorParameters, bench: &Bench, specification: &Specification, counts_per_rev: f64) -> f64 {
    let asked_rad_per_s = specification.speed.rad_per_s(motor, 1.0 / bench.tick_rate_hz);
    let at = Complex::new(0.0, asked_rad_per_s);
    let supply_rad = bench.supply_v * motor_model::angle(motor).at(at).norm();
    let sees_a_count = f64::from(FULL_RANGE) * std::f64::consts::TAU / counts_per_rev;
    let finest = power_of_two(sees_a_count) / 2.0;
    power_of_two(POSITION_SUPPLIES * supply_rad).min(finest).clamp(1.0, 4096.0)
}

/// Whether a range is too fine for an encoder of few counts. The core scales counts by a 16-bit factor that grows as
/// the range shrinks, so the error "too large" is about the factor.
fn is_too_fine(error: BuildError) -> bool {
    error.rule == Rule::TooLarge && matches!(error.param, Param::SpeedRange | Param::PositionRange)
}

fn double_range(list: &mut SettingList, range: Param) -> Result<(), DesignError> {
    let doubled = 2.0 * f64::from(list.all.get(range));
    if range == Param::SpeedRange {
        list.set(Param::CompFrictionWidth, friction_width(doubled))?;
    }
    list.set(range, doubled)
}

/// Adjusts settings until the core can hold all of them. It doubles ranges that are too fine for the encoder, switches
/// off gains of other laws, and limits the unused tachogenerator gain.
fn fit(list: &mut SettingList, law: ControlLaw) -> Result<(), DesignError> {
    let others = |param: Param| {
        let laws = ControlLaw::ALL.into_iter().filter(|other| *other != law);
        laws.flat_map(ControlLaw::feedback).any(|(gain, _)| *gain == param)
    };
    loop {
        match LoopConfig::build(&list.all) {
            Ok(_) => return Ok(()),
            Err(error) if is_too_fine(error) => double_range(list, error.param)?,
            Err(error) if others(error.param) && list.all.get(error.param) != 0.0 => list.set(error.param, 0.0)?,
            Err(error)
                if error.param == Param::TachoGain
                    && !is_speed_sensor(&list.all)
                    && list.all.get(error.param) < UNUSED_TACHO_GAIN =>
            {
                list.set(error.param, UNUSED_TACHO_GAIN.into())?;
            }
            Err(error) => return Err(refusal(error, list.all.get(error.param).into())),
        }
    }
}

/// Gains in engineering units and the sampling, with the core's rounding.
///
/// # Errors
/// [`DesignError::Setting`] for a gain the core cannot hold.
pub fn read_back(list: &SettingList, law: ControlLaw) -> Result<(Gains, Sampling), DesignError> {
    let get = |param: Param| f64::from(list.all.get(param));
    let period_s = 1.0 / get(Param::TickRate);
    let filter_s = law.filter().map_or(0.0, |param| 1e-3 * get(param));
    let mut sampling = Sampling { speed: speed_path(list)?, ..Sampling::new(period_s, filter_s) };
    if let Some(param) = law.filter() {
        sampling.filter_part = held_part(sampling.filter_part, param, filter_s)?;
    }
    let mut feedback = Vec::new();
    for &(param, signal) in law.feedback() {
        let held = held(list, law, param, signal, &sampling);
        feedback.push(held.map_err(|rule| refusal(rule.of(param), get(param)))?);
    }
    let speed_scale = bits_per_unit(&list.all, Param::SpeedRange);
    let (reference, param) = match law {
        ControlLaw::SpeedPid => (get(Param::SpeedKp) * get(Param::SpeedB), Param::SpeedB),
        ControlLaw::SpeedLqr => (get(Param::LqrSpeedKr), Param::LqrSpeedKr),
        ControlLaw::PositionPid | ControlLaw::PositionLqr => {
            let reference = feedback[0];
            return Ok((Gains { feedback, reference }, sampling));
        }
    };
    let reference = held_gain(reference, speed_scale).map_err(|rule| refusal(rule.of(param), reference))?;
    Ok((Gains { feedback, reference }, sampling))
}

/// Speed measurement of the laws with these settings.
///
/// # Errors
/// [`DesignError::Setting`] for a low-pass the core cannot hold.
pub fn speed_path(list: &SettingList) -> Result<SpeedPath, DesignError> {
    if !is_speed_sensor(&list.all) {
        return Ok(SpeedPath::Mean);
    }
    let filter_s = 1e-3 * f64::from(list.all.get(Param::SpeedFilter));
    if filter_s == 0.0 {
        return Ok(SpeedPath::Converted { filter_s, filter_part: 1.0 });
    }
    let part = 1.0 / (filter_s * f64::from(list.all.get(Param::TickRate)) + 1.0);
    Ok(SpeedPath::Converted { filter_s, filter_part: held_part(part, Param::SpeedFilter, filter_s)? })
}

/// Coefficient of the core's low-pass for one tick.
fn held_part(part: f64, param: Param, filter_s: f64) -> Result<f64, DesignError> {
    let one = scale(Fraction::FRAC_NBITS);
    let bits = quantise(part as f32, one, u16::MAX).map_err(|rule| refusal(rule.of(param), filter_s))?;
    Ok(f64::from(bits) / f64::from(one))
}

/// The number 1 in a format with so many fractional bits.
fn scale(fractional_bits: u32) -> f32 {
    (1u32 << fractional_bits) as f32
}

fn held(list: &SettingList, law: ControlLaw, param: Param, signal: Signal, sampling: &Sampling) -> Result<f64, Rule> {
    let value = f64::from(list.all.get(param));
    let speed_scale = bits_per_unit(&list.all, Param::SpeedRange);
    let position_scale = bits_per_unit(&list.all, Param::PositionRange);
    match signal {
        Signal::Position => held_gain(value, position_scale),
        Signal::Speed | Signal::FilteredSpeed => held_gain(value, speed_scale),
        Signal::Current => held_gain(value, AMPERE),
        Signal::Derivative => {
            let time_s = sampling.filter_s + sampling.period_s;
            Ok(held_gain(value / time_s, speed_scale)? * time_s)
        }
        Signal::Integral => {
            let input_scale = if law.is_position() { position_scale } else { speed_scale };
            let one = scale(IntegralGain::FRAC_NBITS);
            let bits_per_gain = VOLT * one / input_scale * sampling.period_s as f32;
            Ok(f64::from(quantise(value as f32, bits_per_gain, GAIN_LIMIT as u16)?) / f64::from(bits_per_gain))
        }
    }
}

fn held_gain(value: f64, input_scale: f32) -> Result<f64, Rule> {
    let bits_per_gain = VOLT * scale(Gain::FRAC_NBITS) / input_scale;
    Ok(f64::from(quantise_gain(value as f32, input_scale)?) / f64::from(bits_per_gain))
}

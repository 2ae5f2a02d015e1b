//! The trial of a design: the core itself follows a step in closed loop with the motor of the model.

use super::Design;
use super::error::DesignError;
use super::fixed_point::{self, SettingList};
use super::law::ControlLaw;
use super::specification::Specification;
use super::tachogenerator::Tachogenerator;
use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters, Plant};
use host_sim::trial::{Point, Trial};
use motorbench_core::message::Trip;
use motorbench_core::settings::{BuildError, Param, Settings};
use motorbench_data::names::trip_words;
use motorbench_data::telemetry::speed_bit_rad_per_s;
use motorbench_model::Model;
use motorbench_model::linear::motor_model;
use motorbench_model::motor::MotorParameters;
use serde::Serialize;

/// The core in closed loop with the motor of the model, behind an ideal bridge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialFigures {
    /// Step of the reference, in rad/s or rad.
    pub step: f64,
    /// Largest deviation from the reference in the last fifth, in rad/s or rad.
    pub last_deviation: f64,
    /// Largest excess over the step, in percent of it.
    pub overshoot_percent: f64,
    /// Largest voltage.
    #[serde(rename = "peak_V")]
    pub peak_v: f64,
    /// Largest current.
    #[serde(rename = "peak_A")]
    pub peak_a: f64,
    /// Part of the time at a limit of voltage, slew or current.
    pub limited_part: f64,
    /// Range of the voltage in the last fifth: the resolution and the ripple of the sensors keep it moving.
    #[serde(rename = "swing_V")]
    pub swing_v: f64,
}

/// Number of profiles that are tried, each gentler than the one before, and the default factor from one to the next.
const MOST_PROFILES: usize = 12;
const PROFILE_FACTOR: f64 = 0.6;

/// Overshoot of the core that every specification allows: the resolution of sensors and duty causes it.
const LEAST_OVERSHOOT_PERCENT: f64 = 0.5;

/// Size of the trial's speed step, relative to the no-load speed.
const TRIAL_SPEED_PART: f64 = 0.4;

/// Size of the trial's position step.
const TRIAL_ANGLE_RAD: f64 = std::f64::consts::TAU;

/// The trial must have settled in its last part; this is one over the share of that part.
const SETTLED_PART: usize = 5;

/// Allowed deviation at the end: counts of a position, bits of a speed.
const SETTLED_COUNTS: f64 = 2.0;
pub(super) const SETTLED_SPEED_BITS: f64 = 8.0;

/// Allowed deviation of a speed from a tachogenerator, in converter steps: one step is cut off, and the loop hunts
/// across one.
pub(super) const SETTLED_TACHO_STEPS: f64 = 2.0;

/// Allowed deviation at the end, relative to the step, where that is more.
const SETTLED_STEP_PART: f64 = 0.02;

/// The trial of a law on the core with the motor of the model.
pub(super) struct StepTrial<'a> {
    pub(super) motor: &'a MotorParameters,
    pub(super) law: ControlLaw,
    pub(super) tachogenerator: Option<Tachogenerator>,
    /// Delay of the voltage.
    pub(super) delay_s: f64,
    /// Settling time of the linear loop.
    pub(super) settling_s: f64,
}

impl StepTrial<'_> {
    /// Repeats the trial until overshoot and current are within their limits. Each repetition lowers the feed-forward
    /// or slows the profile.
    pub(super) fn within_limits(
        &self,
        settings: &mut SettingList,
        specification: &Specification,
    ) -> Result<(TrialFigures, Vec<Point>), DesignError> {
        let law = self.law;
        let most_a = fixed_point::ACCELERATION_PART * specification.current_limit_a;
        let most_percent = specification.overshoot_percent.max(self.least_overshoot_percent(settings));
        for _ in 0..MOST_PROFILES {
            match self.run(settings) {
                Ok((figures, _)) if figures.peak_a > most_a => settings.slow_down(0.95 * most_a / figures.peak_a)?,
                Ok((figures, _)) if figures.overshoot_percent > most_percent => {
                    if !settings.reduce_feed_forward(law, PROFILE_FACTOR)? {
                        settings.slow_down(PROFILE_FACTOR)?;
                    }
                }
                Ok(done) => return Ok(done),
                Err(_) => settings.slow_down(PROFILE_FACTOR)?,
            }
        }
        let (figures, points) = self.run(settings)?;
        let what = if figures.peak_a > specification.current_limit_a {
            format!("the current reaches {:.2} A", figures.peak_a)
        } else if figures.overshoot_percent > most_percent {
            format!("through the profile it overshoots by {:.1} %", figures.overshoot_percent)
        } else {
            return Ok((figures, points));
        };
        Err(DesignError::Trial { law: law.title(), what })
    }

    /// The core follows a step through its profile and settles. With a tachogenerator it also goes back through
    /// standstill, since the firmware takes the sign of its speed from the drive.
    fn run(&self, settings: &SettingList) -> Result<(TrialFigures, Vec<Point>), DesignError> {
        let (step, ramp_s) = trial_step(self.motor, self.law, settings);
        let duration_s = ramp_s + (8.0 * self.settling_s).max(0.5);
        let mut trial = self.armed(&settings.all)?;
        let (figures, points) = follow_step(&mut trial, self.law, step, duration_s)?;
        self.check_settled(settings, step, figures.last_deviation)?;
        if self.tachogenerator.is_some() {
            // The way back is twice as long.
            let (back, _) = follow_step(&mut trial, self.law, -step, duration_s + ramp_s)?;
            self.check_settled(settings, step, back.last_deviation)?;
        }
        Ok((figures, points))
    }

    fn armed(&self, settings: &Settings) -> Result<Trial<DcMotor>, DesignError> {
        let mut trial =
            Trial::new(DcMotor::new(ideal(self.motor)), *settings).map_err(|error| setting_error(error, settings))?;
        trial.delay_by(self.delay_s);
        arm_in_mode(&mut trial, self.law, self.tachogenerator.as_ref());
        Ok(trial)
    }

    fn check_settled(&self, settings: &SettingList, step: f64, last_deviation: f64) -> Result<(), DesignError> {
        if last_deviation > self.resolution(settings).max(SETTLED_STEP_PART * step) {
            let what = format!("at the end it is off by {last_deviation:.3} of {step:.3}");
            return Err(DesignError::Trial { law: self.law.title(), what });
        }
        Ok(())
    }

    /// Deviation that the resolution of the sensor causes, in rad or rad/s.
    fn resolution(&self, settings: &SettingList) -> f64 {
        let get = |param| f64::from(settings.all.get(param));
        if self.law.is_position() {
            return SETTLED_COUNTS * std::f64::consts::TAU / get(Param::CountsPerRev);
        }
        let bits = SETTLED_SPEED_BITS * speed_bit_rad_per_s(&settings.all);
        let steps = |tachogenerator: Tachogenerator| SETTLED_TACHO_STEPS * tachogenerator.resolution_rad_per_s();
        self.tachogenerator.map_or(bits, steps).max(bits)
    }

    /// Overshoot that every specification allows.
    fn least_overshoot_percent(&self, settings: &SettingList) -> f64 {
        let (step, _) = trial_step(self.motor, self.law, settings);
        let resolution = if self.tachogenerator.is_some() { 100.0 * self.resolution(settings) / step } else { 0.0 };
        LEAST_OVERSHOOT_PERCENT.max(resolution)
    }
}

/// Trial of a law with the effects of the model: its figures and its samples.
pub type TrialWithEffects = (ControlLaw, TrialFigures, Vec<Point>);

/// Repeats the trial of a design with the settings of the board, which may compensate, and with a motor that has
/// effects. The figures are reported but not judged: compensation, slower profiles and other motors are the user's
/// choice.
///
/// # Errors
/// [`DesignError::WithEffects`] if a trip comes: such a loop is of no use.
pub fn trial_with_effects(
    model: &Model,
    design: &Design,
    settings: &Settings,
) -> Result<TrialWithEffects, DesignError> {
    let duration_s = design.points.last().map_or(0.0, |point| point.t_s);
    let mut trial = Trial::of_model(model, *settings).map_err(|error| setting_error(error, settings))?;
    arm_in_mode(&mut trial, design.law, design.tachogenerator.as_ref());
    match follow_step(&mut trial, design.law, design.trial.step, duration_s) {
        Ok((figures, points)) => Ok((design.law, figures, points)),
        Err(DesignError::Trial { law, what }) => Err(DesignError::WithEffects { law, what }),
        Err(other) => Err(other),
    }
}

fn setting_error(error: BuildError, settings: &Settings) -> DesignError {
    fixed_point::refusal(error, settings.get(error.param).into())
}

/// Arms the core in the mode of a law.
pub(super) fn arm_in_mode(trial: &mut Trial<impl Plant>, law: ControlLaw, tachogenerator: Option<&Tachogenerator>) {
    if let Some(tachogenerator) = tachogenerator {
        tachogenerator.set_ripple(trial);
    }
    trial.enter(law.mode());
}

/// The core follows a step through its profile.
fn follow_step(
    trial: &mut Trial<impl Plant>,
    law: ControlLaw,
    step: f64,
    duration_s: f64,
) -> Result<(TrialFigures, Vec<Point>), DesignError> {
    let points = trial.follow(step, duration_s);
    if trial.sample().trip != Trip::None {
        return Err(DesignError::Trial {
            law: law.title(),
            what: format!("the trip `{}` comes", trip_words(trial.sample().trip)),
        });
    }
    let tail = &points[points.len() - points.len() / SETTLED_PART..];
    let output = |point: &Point| if law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
    let last_deviation = tail.iter().map(|point| (output(point) - step).abs()).fold(0.0, f64::max);
    let most = |of: fn(&Point) -> f64| points.iter().map(|point| of(point).abs()).fold(0.0, f64::max);
    let limited = points.iter().filter(|point| point.limited).count();
    let figures = TrialFigures {
        step,
        last_deviation,
        overshoot_percent: 100.0 * points.iter().map(|point| output(point) / step - 1.0).fold(0.0, f64::max),
        peak_v: most(|point| point.u_v),
        peak_a: most(|point| point.i_a),
        limited_part: limited as f64 / points.len() as f64,
        swing_v: tail.iter().map(|point| point.u_v).fold(f64::MIN, f64::max)
            - tail.iter().map(|point| point.u_v).fold(f64::MAX, f64::min),
    };
    Ok((figures, points))
}

/// Size of the trial's step, and the time that the profile takes for it.
fn trial_step(motor: &MotorParameters, law: ControlLaw, settings: &SettingList) -> (f64, f64) {
    let get = |param| f64::from(settings.all.get(param));
    let (acceleration, cruise) = (get(Param::Acceleration), get(Param::CruiseSpeed));
    if law.is_position() {
        let ramp_s = TRIAL_ANGLE_RAD / cruise + 2.0 * (TRIAL_ANGLE_RAD / acceleration).sqrt();
        return (TRIAL_ANGLE_RAD, ramp_s);
    }
    let no_load = get(Param::SupplyVoltage) * motor_model::speed(motor).dc_gain();
    // Viscous friction at this speed must leave current to accelerate.
    let friction = motor.viscous_friction_nm_s / motor.torque_constant_nm_per_a;
    let by_current = 0.5 * get(Param::TripContinuous) / friction.max(f64::MIN_POSITIVE);
    let step = (TRIAL_SPEED_PART * no_load).min(by_current);
    (step, step / acceleration)
}

/// The motor of the model behind a bridge without losses.
pub fn ideal(motor: &MotorParameters) -> DcMotorParameters {
    DcMotorParameters {
        resistance_ohm: motor.resistance_ohm,
        inductance_h: motor.inductance_h,
        torque_constant_nm_per_a: motor.torque_constant_nm_per_a,
        inertia_kg_m2: motor.inertia_kg_m2,
        viscous_friction_nms_per_rad: motor.viscous_friction_nm_s,
        coulomb_friction_nm: 0.0,
        bridge: BridgeLosses::IDEAL,
    }
}

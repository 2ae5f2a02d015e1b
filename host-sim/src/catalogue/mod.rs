//! The catalogue of effects: what a real bench does that the linear motor does not. One file each.
//!
//! An effect's file holds its physics, its parameters, its term in the model, what it looks like in data, what it can be
//! confused with and what a controller can do about it. Adding an effect is writing its file, its lines here (`mod`,
//! [`CATALOGUE`]) and its name in `docs/diagnosis.schema.json`.
//!
//! The model that the terms extend, in SI units and in the motor's own sense:
//! ```text
//! L di/dt = u + voltage - (R + resistance) i - k w - dry drop against the current
//! J dw/dt = k i + torque - (b + viscous) w - dry friction against the motion
//! ```
//! Terms that are proportional to the state they act on (`resistance`, `viscous`) and the dry ones are solved implicitly,
//! so that an effect is stable and really sticks at any step.

mod actuation_delay;
mod backlash;
mod bridge_asymmetry;
mod clock_drift;
mod coast_decay;
mod cogging;
mod coulomb_friction;
mod current_clipping;
mod current_lag;
mod current_offset;
mod drop_asymmetry;
mod encoder_eccentricity;
mod friction_asymmetry;
mod friction_warmup;
mod gravity_unbalance;
mod load_step;
mod load_torque;
mod low_pass;
mod missed_counts;
pub mod observation;
mod quadratic_drag;
mod resistance_growing_with_speed;
mod shaft_compliance;
mod speed_lag;
mod stribeck_friction;
mod supply_sag;
mod tacho_ripple;
mod voltage_drop;
mod winding_heating;

use crate::free_run::between_rows::Bulge;
use crate::free_run::pwm_period::Ripple;
use crate::model::Term;
use crate::motor::MotorParameters;
use std::ops::Range;

/// Every effect the diagnosis knows. In which order they act says [`Effect::turn`].
pub static CATALOGUE: [&dyn Effect; 27] = [
    &coulomb_friction::CoulombFriction,
    &stribeck_friction::StribeckFriction,
    &friction_asymmetry::FrictionAsymmetry,
    &quadratic_drag::QuadraticDrag,
    &load_torque::LoadTorque,
    &load_step::LoadStep,
    &friction_warmup::FrictionWarmup,
    &cogging::Cogging,
    &gravity_unbalance::GravityUnbalance,
    &backlash::Backlash,
    &shaft_compliance::ShaftCompliance,
    &voltage_drop::VoltageDrop,
    &drop_asymmetry::DropAsymmetry,
    &bridge_asymmetry::BridgeAsymmetry,
    &supply_sag::SupplySag,
    &resistance_growing_with_speed::ResistanceGrowingWithSpeed,
    &winding_heating::WindingHeating,
    &coast_decay::CoastDecay,
    &actuation_delay::ActuationDelay,
    &clock_drift::ClockDrift,
    &current_lag::CurrentLag,
    &current_offset::CurrentOffset,
    &current_clipping::CurrentClipping,
    &missed_counts::MissedCounts,
    &encoder_eccentricity::EncoderEccentricity,
    &tacho_ripple::TachoRipple,
    &speed_lag::SpeedLag,
];

/// Effects that hardly any bench is without.
pub const USUAL: [&str; 2] = ["coulomb_friction", "voltage_drop"];

/// A rival that is no effect: more inductance than the winding has. Its one value is by how many seconds that lengthens the
/// winding's time constant.
pub const INDUCTANCE: &str = "parameter:inductance";

/// The effect with this identifier.
pub fn effect(id: &str) -> Option<&'static dyn Effect> {
    CATALOGUE.iter().copied().find(|effect| effect.about().id == id)
}

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ActsOn {
    /// Balance of torques at the shaft.
    Torque,
    /// Balance of voltages in the armature.
    Voltage,
    /// Reading of the current.
    CurrentSensor,
    /// Reading of angle and speed.
    AngleSensor,
}

impl ActsOn {
    /// Whether it is a reading that is falsified, and not the bench.
    pub fn is_of_a_sensor(self) -> bool {
        matches!(self, Self::CurrentSensor | Self::AngleSensor)
    }
}

/// A sensor that an effect may be of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// Of the current.
    Current,
    /// Of the angle, by counts.
    Encoder,
    /// Of the speed, by a voltage.
    Tachogenerator,
}

/// What a recording has, for the effects that need it to be seen.
#[derive(Clone, Copy, Debug)]
pub struct Channels {
    /// A current.
    pub current: bool,
    /// A speed, not an angle.
    pub speed: bool,
    /// An angle or a speed from counts.
    pub counts: bool,
    /// Moments of commands between its rows, which are sought in its readings.
    pub moments: bool,
    /// One voltage, this way and that, and nothing else that happens.
    pub one_magnitude: bool,
}

/// How a bridge leaves the motor between pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OffPhase {
    /// Short-circuited.
    Brakes,
    /// Open: the current flows on through the diodes and stops.
    Coasts,
    /// Open where nothing is asked for, short-circuited between pulses.
    CoastsAtZeroDuty,
}

/// What is lost at any speed and current: the core has a compensation for it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DryLosses {
    /// Torque of friction turning forward.
    pub friction_forward_nm: f64,
    /// Turning in reverse, as a positive number.
    pub friction_reverse_nm: f64,
    /// Voltage the bridge loses, averaged over a PWM period.
    pub bridge_drop_v: f64,
}

impl std::iter::Sum for DryLosses {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |sum, one| Self {
            friction_forward_nm: sum.friction_forward_nm + one.friction_forward_nm,
            friction_reverse_nm: sum.friction_reverse_nm + one.friction_reverse_nm,
            bridge_drop_v: sum.bridge_drop_v + one.bridge_drop_v,
        })
    }
}

/// A constant of an effect.
#[derive(Debug)]
pub struct Parameter {
    /// Name with unit, as in model files and results.
    pub name: &'static str,
    /// Whether a fit may move it; the others are whole numbers or alternatives, tried one by one.
    pub fitted: bool,
    /// The value that goes without saying, in model files and in results.
    pub unsaid: Option<f64>,
    /// Least value that makes sense.
    pub min: f64,
    /// Greatest value that makes sense.
    pub max: f64,
    /// Mean and standard deviation, where something is known of it before any recording.
    pub known: Option<(f64, f64)>,
    /// Whether it is how long a process takes: one much longer than the recording cannot be told from what is always there.
    pub slow: bool,
    /// Of the no-load speed, the share that it may reach: beyond it would be another effect's law.
    pub most_of_speed: f64,
}

impl Parameter {
    /// A constant without a sign.
    const fn positive(name: &'static str) -> Self {
        Self::within(name, 0.0, f64::INFINITY)
    }

    /// A constant that may have either sign.
    const fn signed(name: &'static str) -> Self {
        Self::within(name, f64::NEG_INFINITY, f64::INFINITY)
    }

    /// A constant within bounds.
    const fn within(name: &'static str, min: f64, max: f64) -> Self {
        Self { name, fitted: true, unsaid: None, min, max, known: None, slow: false, most_of_speed: f64::INFINITY }
    }

    /// The time constant of a process that goes on while the motor runs.
    const fn slow(name: &'static str, min: f64, max: f64) -> Self {
        Self { slow: true, ..Self::within(name, min, max) }
    }

    /// A speed up to a share of the no-load speed.
    const fn of_speed(name: &'static str, most_of_speed: f64) -> Self {
        Self { most_of_speed, ..Self::positive(name) }
    }

    /// A whole number, tried and not fitted.
    const fn tried(name: &'static str) -> Self {
        Self { fitted: false, ..Self::within(name, 1.0, f64::INFINITY) }
    }

    /// A choice between two laws, 0 or 1, tried and not fitted; the usual one goes without saying.
    const fn choice(name: &'static str) -> Self {
        Self { fitted: false, ..Self::of_another_law(name, 1.0) }
    }

    /// A constant of another law than the usual one, which has none: 0 goes without saying.
    const fn of_another_law(name: &'static str, max: f64) -> Self {
        Self { unsaid: Some(0.0), ..Self::within(name, 0.0, max) }
    }

    /// Where it says that there is nothing, of a strength.
    pub fn nothing(&self) -> f64 {
        if self.min.is_finite() { self.min } else { 0.0 }
    }

    /// Whether it is a whole number of something.
    pub fn is_number(&self) -> bool {
        !self.fitted && self.unsaid.is_none()
    }

    /// Whether it is a choice between two laws.
    pub fn is_choice(&self) -> bool {
        !self.fitted && self.unsaid.is_some()
    }

    /// Whether a fit moves it from this value: none changes the law.
    pub fn moves(&self, value: f64) -> bool {
        self.fitted && self.unsaid != Some(value)
    }
}

/// What is known of an effect, for people and for the diagnosis.
#[derive(Debug)]
pub struct About {
    /// Its name in results.
    pub id: &'static str,
    /// Its name in sentences.
    pub title: &'static str,
    /// Where it acts.
    pub acts_on: ActsOn,
    /// Its constants.
    pub parameters: &'static [Parameter],
    /// How many of them, from the first, the readings are linear in while they are small.
    pub linear_in: usize,
    /// Its law in one line.
    pub law: &'static str,
    /// What a person sees of it.
    pub looks_like: &'static str,
    /// What can look the same, by identifier.
    pub confused_with: &'static [&'static str],
    /// The experiment that tells it from those.
    pub experiment: &'static str,
    /// What the controller or the owner can do about it.
    pub remedy: &'static str,
    /// Where the law is described.
    pub source: &'static str,
}

/// Sizes of a recording and of the motor as far as it is known, from which an effect takes plausible values.
#[derive(Clone, Copy, Debug)]
pub struct Scales {
    /// The linear motor found so far.
    pub motor: MotorParameters,
    /// Greatest voltage.
    pub voltage_v: f64,
    /// Greatest speed.
    pub speed_rad_per_s: f64,
    /// Greatest voltage of the supply.
    pub supply_v: f64,
    /// Greatest current, measured or computed.
    pub current_a: f64,
    /// Length.
    pub duration_s: f64,
    /// Time between samples.
    pub interval_s: f64,
    /// Frequency of the PWM.
    pub pwm_hz: f64,
}

impl Scales {
    /// Torque at standstill and full voltage.
    pub fn stall_torque_nm(&self) -> f64 {
        self.motor.torque_constant_nm_per_a * self.voltage_v / self.motor.resistance_ohm
    }

    /// Speed at which the supply's whole voltage is back-EMF.
    pub fn no_load_rad_per_s(&self) -> f64 {
        self.supply_v / self.motor.torque_constant_nm_per_a
    }
}

/// The bench at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant {
    /// When the step about to be taken begins, since the start of the recording.
    pub time_s: f64,
    /// Mean voltage that the bridge was asked for.
    pub voltage_v: f64,
    /// The same as a share of the supply, -1 to 1.
    pub duty: f64,
    /// Its mean over several periods of the PWM, where `duty` is that of single pulses.
    pub mean_duty: f64,
    /// Supply voltage.
    pub supply_v: f64,
    /// Whether the bridge is off, so that no current flows.
    pub open: bool,
    /// Armature current.
    pub current_a: f64,
    /// Speed of the motor's shaft.
    pub speed_rad_per_s: f64,
    /// Angle of the motor's shaft, from an unknown zero: as measured, less what the model says is wrong with it.
    pub angle_rad: f64,
    /// How far it turns in the step about to be taken, `angle_rad` being the middle; 0 where the step begins there.
    pub turned_rad: f64,
    /// Length of the step about to be taken.
    pub step_s: f64,
}

/// Terms of the two equations; see the module.
#[derive(Clone, Copy, Debug, Default)]
pub struct Balance {
    /// Voltage that drives the current, in volts.
    pub voltage_v: f64,
    /// Resistance in series, in ohms.
    pub resistance_ohm: f64,
    /// The PWM: while the current touches zero in each period, a drop does not act one way alone.
    pub ripple: Ripple,
    /// Voltage that works against the current, whichever way it flows, and lets none start below it.
    pub dry_drop_v: f64,
    /// Current over which the drop comes up, where it acts on the mean over a period of the PWM; 0: it acts at every moment
    /// within.
    pub knee_a: f64,
    /// By how much it is greater in the off phase of the PWM.
    pub off_excess_v: f64,
    /// Torque that drives the shaft, in newton metres.
    pub torque_nm: f64,
    /// Friction proportional to speed.
    pub viscous_nm_s: f64,
    /// Friction against positive motion, not negative in sum.
    pub dry_forward_nm: f64,
    /// Friction against negative motion, not negative in sum.
    pub dry_backward_nm: f64,
}

impl Balance {
    /// What is lost in a pulse of the PWM and in its off phase, in volts.
    #[inline]
    pub fn drops_v(&self) -> [f64; 2] {
        let pulse_v = self.dry_drop_v.max(0.0);
        [pulse_v, (pulse_v + self.off_excess_v).max(0.0)]
    }

    /// Whether the drop acts on the mean current. A coasting off phase is one within each period.
    #[inline]
    pub fn drops_with_the_mean(&self) -> bool {
        self.knee_a > 0.0 && self.off_excess_v == 0.0
    }
}

/// Over less of a wave to either side its mean is its middle, to a thousandth.
const SLIGHTLY_RAD: f64 = 0.08;

/// A torque that is a wave over the angle of the motor's shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Amplitudes of cosine and sine, against positive motion, in newton metres.
    pub against_nm: [f64; 2],
    /// Periods in a turn.
    pub periods_per_rev: f64,
}

impl Wave {
    /// The mean of the torque over a step in which the shaft turns `turned_rad` around `angle_rad`. In the rows of a slow
    /// recording that may be several periods.
    fn mean_torque_nm(&self, angle_rad: f64, turned_rad: f64) -> f64 {
        let half = 0.5 * self.periods_per_rev * turned_rad;
        let mean_over_middle = if half.abs() < SLIGHTLY_RAD { 1.0 } else { half.sin() / half };
        mean_over_middle * self.torque_nm(angle_rad)
    }

    /// The torque that drives the shaft at an angle.
    #[inline]
    pub fn torque_nm(&self, angle_rad: f64) -> f64 {
        let (sine, cosine) = (self.periods_per_rev * angle_rad).sin_cos();
        -(self.against_nm[0] * cosine + self.against_nm[1] * sine)
    }
}

/// What a sensor's effect may know of the bench when it acts on a reading.
#[derive(Clone, Copy, Debug)]
pub struct Sampling {
    /// Angle of the motor's shaft, from an unknown zero, as [`Instant::angle_rad`].
    pub angle_rad: f64,
    /// Time since the last reading, 0 at the first.
    pub step_s: f64,
    /// The current since the last reading.
    pub bulge: Bulge,
    /// The shaft's speed since then.
    pub speed_bulge: Bulge,
}

/// Readings of the sensors.
#[derive(Clone, Copy, Debug)]
pub struct Readings {
    /// Current.
    pub current_a: f64,
    /// Speed.
    pub speed_rad_per_s: f64,
    /// Angle.
    pub angle_rad: f64,
}

/// An effect without the one that it stands on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alone {
    /// It makes no sense.
    Never,
    /// It hardly ever is: it has to be beyond doubt.
    Rarely,
}

/// What a law leaves out of the physics, as relative errors of the constants that are found with it: one standard
/// deviation, measured on benches with known constants, whose physics is another formulation.
#[derive(Clone, Copy, Debug)]
pub struct Simplification {
    /// Of its own constants.
    pub own: f64,
    /// Of the motor's moment of inertia.
    pub inertia: f64,
    /// Of the motor's viscous friction.
    pub viscous_friction: f64,
}

/// One effect. `values` are its parameters in the order of [`About::parameters`], `state` its own memory.
pub trait Effect: Sync {
    /// What is known of it.
    fn about(&self) -> &'static About;

    /// Plausible values to begin a fit from: one for each alternative of its nonlinear constants.
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>>;

    /// A constant that needs a close start, and how far apart the [`starts`](Self::starts) have it.
    fn spacing(&self, _scales: &Scales) -> Option<(usize, f64)> {
        None
    }

    /// Starts around one, for an effect with too many for all of them to be tried: a way to the best of them.
    fn neighbours(&self, _start: &[f64]) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// From so many of its starts a fit is tried, the best ones by what they promise.
    fn starts_fitted(&self, _scales: &Scales) -> usize {
        1
    }

    /// Values from which a fit may come to another and better end than the one it has come to.
    fn elsewhere(&self, _values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// The same with its other laws, where it has a choice.
    fn other_laws(&self, _values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Laws that look like its own and are none of the catalogue's, where they look most like it with these values: it is named
    /// only where none of them explains more.
    fn not_its_own(&self, _values: &[f64], _scales: &Scales) -> Vec<(&'static dyn Effect, Vec<f64>)> {
        Vec::new()
    }

    /// Values with which it looks most like a rival that has `values`: another effect, or [`INDUCTANCE`].
    fn instead_of(&self, _rival: &str, _values: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// Whether any course over time has it in it: beside something unknown it may then be no more than a part of that.
    fn is_of_any_course(&self) -> bool {
        false
    }

    /// Which of its constants say how strong it is: with all of one group at their least it does nothing that would be its own.
    fn strengths(&self) -> Vec<Range<usize>> {
        let linear_in = self.about().linear_in;
        if linear_in > 0 { vec![Range { start: 0, end: linear_in }] } else { Vec::new() }
    }

    /// An effect that it comes with, and what it is without.
    fn stands_on(&self) -> Option<(&'static str, Alone)> {
        None
    }

    /// An effect beside which its constants are held at what is known of them: the data say nothing of both.
    fn known_beside(&self) -> Option<&'static str> {
        None
    }

    /// Whether a rival that explains the data as well is the more plausible name. `others`: the rest of the model.
    fn yields_to(&self, _values: &[f64], _rival: &str, _others: &[Term]) -> bool {
        false
    }

    /// What its law leaves out.
    fn simplification(&self) -> Simplification {
        Simplification { own: 1e-3, inertia: 0.0, viscous_friction: 0.0 }
    }

    /// Its turn among the others: those of a lower one have contributed, or acted on the reading, before it.
    fn turn(&self, _values: &[f64]) -> i8 {
        0
    }

    /// Whether with such values it is no more than another scale of a quantity, which other constants of the motor say as well.
    fn is_a_scale(&self, _values: &[f64], _scales: &Scales) -> bool {
        false
    }

    /// Whether its events, such as blows, come at other moments with other constants, so that readings change by leaps.
    fn has_events(&self) -> bool {
        false
    }

    /// Whether the linear motor fitted without it is useless as a start: then it is also tried from the nominal one.
    fn changes_everything(&self) -> bool {
        false
    }

    /// Numbers of its own that it keeps from step to step.
    fn states(&self) -> usize {
        0
    }

    /// These at the beginning, when the shaft turns so fast.
    fn begins(&self, _speed_rad_per_s: f64) -> Vec<f64> {
        vec![0.0; self.states()]
    }

    /// Longest step that its own memory bears.
    fn longest_step_s(&self) -> f64 {
        f64::INFINITY
    }

    /// The sensor that it is of; most of those on the angle are of an encoder.
    fn sensor(&self) -> Option<Sensor> {
        match self.about().acts_on {
            ActsOn::Torque | ActsOn::Voltage => None,
            ActsOn::CurrentSensor => Some(Sensor::Current),
            ActsOn::AngleSensor => Some(Sensor::Encoder),
        }
    }

    /// Whether a recording of these says anything of it.
    fn shows_in(&self, channels: &Channels) -> bool {
        match self.sensor() {
            None => true,
            Some(Sensor::Current) => channels.current,
            Some(Sensor::Encoder) => channels.counts,
            Some(Sensor::Tachogenerator) => channels.speed,
        }
    }

    /// Share of the inertia that turns with the motor's own shaft.
    fn motor_share(&self, _values: &[f64]) -> f64 {
        1.0
    }

    /// Time by which the bridge carries out a command late.
    fn delay_s(&self, _values: &[f64]) -> f64 {
        0.0
    }

    /// Whether it is of how a recording was made, and no cause.
    fn is_observation(&self) -> bool {
        false
    }

    /// In which phase of the PWM the rows are, where it is of that.
    fn pwm_phase(&self, _values: &[f64]) -> Option<f64> {
        None
    }

    /// By how much that time grows in each second.
    fn delay_growth(&self, _values: &[f64]) -> f64 {
        0.0
    }

    /// Time by which the current is read late.
    fn current_late_s(&self, values: &[f64]) -> f64 {
        self.delay_s(values)
    }

    /// Time by which the speed is read late.
    fn speed_late_s(&self, values: &[f64]) -> f64 {
        self.delay_s(values)
    }

    /// Time constant with which its sensor, and no program, lets the speed lag.
    fn tachogenerator_lag_s(&self, _values: &[f64]) -> f64 {
        0.0
    }

    /// Whether it is of how the bridge is switched: a motor that is switched does not have it, who switches takes it from
    /// the model.
    fn is_of_switching(&self) -> bool {
        false
    }

    /// What the bridge does between pulses, where it is of that.
    fn off_phase(&self, _values: &[f64]) -> Option<OffPhase> {
        None
    }

    /// What it takes at any speed and current.
    fn dry_losses(&self, _values: &[f64]) -> DryLosses {
        DryLosses::default()
    }

    /// Whether its [`dry_losses`](Self::dry_losses) are all that it is, and the same both ways: a motor that is solved from event to
    /// event has them.
    fn is_dry_losses_alone(&self, _values: &[f64]) -> bool {
        false
    }

    /// Whether all it does to the voltage is to change the resistance, and that over seconds.
    fn is_slow_resistance(&self) -> bool {
        false
    }

    /// The torque it adds, where that is a wave over the angle and nothing else.
    fn wave(&self, _values: &[f64]) -> Option<Wave> {
        None
    }

    /// Whether it is a torque from outside that knows of angle and time alone.
    fn is_outer_torque(&self) -> bool {
        self.wave(&[0.0; 3]).is_some()
    }

    /// Adds its terms. `motor` are the constants of the linear motor. What it remembers may go on here already, where a
    /// step needs that.
    fn contribute(
        &self,
        values: &[f64],
        _motor: &MotorParameters,
        at: &Instant,
        _state: &mut [f64],
        balance: &mut Balance,
    ) {
        if let Some(wave) = self.wave(values) {
            balance.torque_nm += wave.mean_torque_nm(at.angle_rad, at.turned_rad);
        }
    }

    /// Takes its own memory over the step that ended at `at`.
    fn advance(&self, _values: &[f64], _motor: &MotorParameters, _at: &Instant, _state: &mut [f64]) {}

    /// Whether [`contribute`](Self::contribute) or [`advance`](Self::advance) do anything.
    fn acts_on_motor(&self) -> bool {
        matches!(self.about().acts_on, ActsOn::Torque | ActsOn::Voltage)
    }

    /// Whether the motor of the model moves differently with other values, and not only its readings.
    fn changes_motion(&self) -> bool {
        self.acts_on_motor()
    }

    /// Speed at which the measured angle falls behind the shaft's for good.
    fn lost_rad_per_s(&self, _values: &[f64], _speed_rad_per_s: f64) -> f64 {
        0.0
    }

    /// By how much the reading `angle_rad` of the angle is ahead of the shaft.
    fn ahead_rad(&self, _values: &[f64], _angle_rad: f64) -> f64 {
        0.0
    }

    /// Falsifies the readings. Only for effects that do not act on the motor.
    fn sense(&self, _values: &[f64], _at: &Sampling, _state: &mut [f64], _readings: &mut Readings) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_unique_and_references_exist() {
        for (index, entry) in CATALOGUE.iter().enumerate() {
            let about = entry.about();
            assert!(CATALOGUE[..index].iter().all(|other| other.about().id != about.id), "{}", about.id);
            for other in about.confused_with {
                assert!(effect(other).is_some(), "{}: confused with {other}, which is not in the catalogue", about.id);
            }
        }
    }
}

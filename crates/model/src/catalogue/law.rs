//! The law of an effect: its terms in the two equations of the motor, or in a reading.
//!
//! The model that the terms extend, in SI units and in the motor's own sense:
//! ```text
//! L di/dt = u + voltage - (R + resistance) i - k w - dry drop against the current
//! J dw/dt = k i + torque - (b + viscous) w - dry friction against the motion
//! ```
//! Terms that are proportional to the state they act on (`resistance`, `viscous`) and the dry ones are solved implicitly.
//! An effect is therefore stable and really sticks at any step.

use super::About;
use crate::between_rows::Bulge;
use crate::motor::MotorParameters;
use crate::pwm_period::{Drops, Ripple};

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

/// The bench at one instant.
#[derive(Clone, Copy, Debug, Default)]
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
    /// Whether the current is what it is, whatever the voltages: zero while the bridge is off, or that of a drive.
    pub open: bool,
    /// Armature current.
    pub current_a: f64,
    /// Speed of the motor's shaft.
    pub speed_rad_per_s: f64,
    /// The same in the middle of the step about to be taken, as the step before lets expect.
    pub middle_rad_per_s: f64,
    /// Angle of the motor's shaft, from an unknown zero: as measured, less what the model says is wrong with it.
    pub angle_rad: f64,
    /// How far it turns in the step about to be taken, `angle_rad` being the middle; 0 where the step begins there.
    pub turned_rad: f64,
    /// Length of the step about to be taken.
    pub step_s: f64,
}

/// Terms of the two equations; see the module.
#[derive(Clone, Copy, Debug)]
pub struct Balance<'a> {
    /// Voltage that drives the current, in volts.
    pub voltage_v: f64,
    /// Resistance in series, in ohms.
    pub resistance_ohm: f64,
    /// The PWM: while the current touches zero in each period, a drop does not act one way alone.
    pub ripple: &'a Ripple,
    /// Voltage that works against the current, whichever way it flows, and lets none start below it.
    pub dry_drop_v: f64,
    /// Current over which the drop comes up, where it acts on the mean over a period of the PWM. 0: it acts at every
    /// moment.
    pub knee_a: f64,
    /// By how much it is greater in the off phase of the PWM.
    pub off_excess_v: f64,
    /// By how much it is greater for a current that flows back into the supply in a pulse.
    pub return_excess_v: f64,
    /// Torque that drives the shaft, in newton metres.
    pub torque_nm: f64,
    // At an even place: the compiler adds to both at once, and would else wait for two writes before.
    /// Friction against positive motion, not negative in sum.
    pub dry_forward_nm: f64,
    /// Friction against negative motion, not negative in sum.
    pub dry_backward_nm: f64,
    /// Friction proportional to speed.
    pub viscous_nm_s: f64,
}

impl Default for Balance<'_> {
    #[inline]
    fn default() -> Self {
        Self {
            voltage_v: 0.0,
            resistance_ohm: 0.0,
            ripple: &Ripple::NONE,
            dry_drop_v: 0.0,
            knee_a: 0.0,
            off_excess_v: 0.0,
            return_excess_v: 0.0,
            torque_nm: 0.0,
            dry_forward_nm: 0.0,
            dry_backward_nm: 0.0,
            viscous_nm_s: 0.0,
        }
    }
}

impl Balance<'_> {
    /// What is lost in the parts of a period of the PWM.
    #[inline]
    pub fn drops(&self) -> Drops {
        let pulse_v = self.dry_drop_v.max(0.0);
        let more = |excess_v: f64| (pulse_v + excess_v).max(0.0);
        Drops { pulse_v, return_v: more(self.return_excess_v), off_v: more(self.off_excess_v) }
    }

    /// Whether the drop acts on the mean current. A coasting off phase is one within each period.
    #[inline]
    pub fn drops_with_the_mean(&self) -> bool {
        self.knee_a > 0.0 && self.off_excess_v == 0.0
    }
}

/// Over less of a wave to either side its mean is its middle, to a thousandth.
const SLIGHTLY_RAD: f64 = 0.08;

/// Mean of a wave over the angle, while the shaft turns `turned_rad`, over its value in the middle.
pub(super) fn mean_over_middle(periods_per_rev: f64, turned_rad: f64) -> f64 {
    let half = 0.5 * periods_per_rev * turned_rad;
    if half.abs() < SLIGHTLY_RAD { 1.0 } else { half.sin() / half }
}

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
        mean_over_middle(self.periods_per_rev, turned_rad) * self.torque_nm(angle_rad)
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

/// The law of an effect. `values` are its constants in the order of [`About::parameters`], `state` is its own memory.
///
/// An effect that acts on the motor implements [`contribute`](Self::contribute), or [`wave`](Self::wave), and with a memory
/// [`advance`](Self::advance) as well. An effect of a sensor implements [`sense`](Self::sense). Everything else has a default.
pub trait Law: Sync {
    /// What is known of it.
    fn about(&self) -> &'static About;

    /// How many numbers it keeps from step to step.
    fn states(&self) -> usize {
        0
    }

    /// These numbers at the beginning, at a speed of the shaft.
    fn begins(&self, _speed_rad_per_s: f64) -> Vec<f64> {
        vec![0.0; self.states()]
    }

    /// Longest step at which its memory is stable and accurate.
    fn longest_step_s(&self) -> f64 {
        f64::INFINITY
    }

    /// Its turn among the effects: those of a lower turn contribute to the balance, or act on the reading, before it.
    fn turn(&self, _values: &[f64]) -> i8 {
        0
    }

    /// Adds its terms. `motor` are the constants of the linear motor. Its memory may go on here already where a step needs
    /// that.
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

    /// Whether the terms that it adds are the same at every instant: a simulation computes them once.
    fn is_steady(&self, _values: &[f64]) -> bool {
        false
    }

    /// Takes its memory over the step that ended at `at`.
    fn advance(&self, _values: &[f64], _motor: &MotorParameters, _at: &Instant, _state: &mut [f64]) {}

    /// Falsifies the readings. Only effects of a sensor do that.
    fn sense(&self, _values: &[f64], _at: &Sampling, _state: &mut [f64], _readings: &mut Readings) {}

    /// The torque it adds, where that is a wave over the angle and nothing else.
    fn wave(&self, _values: &[f64]) -> Option<Wave> {
        None
    }

    /// Share of the inertia that turns with the motor's own shaft.
    fn motor_share(&self, _values: &[f64]) -> f64 {
        1.0
    }

    /// Time by which the bridge carries out a command late.
    fn delay_s(&self, _values: &[f64]) -> f64 {
        0.0
    }

    /// By how much that time grows in each second of the recording.
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

    /// Time constant with which the tachogenerator itself lags; a filter in a program does not count.
    fn tachogenerator_lag_s(&self, _values: &[f64]) -> f64 {
        0.0
    }

    /// What the bridge does between pulses, where the effect decides on it.
    fn off_phase(&self, _values: &[f64]) -> Option<OffPhase> {
        None
    }

    /// What is lost in it at any speed and current.
    fn dry_losses(&self, _values: &[f64]) -> DryLosses {
        DryLosses::default()
    }

    /// Whether it consists of its [`dry_losses`](Self::dry_losses) alone, the same both ways. A plant that is solved from
    /// event to event includes these.
    fn is_dry_losses_alone(&self, _values: &[f64]) -> bool {
        false
    }

    /// Its constants with every voltage but the supply's `factor` times as great, where they can make up for that. The
    /// constants of other effects that act on the voltage go with the powers of their units.
    fn with_scaled_voltages(&self, _values: &[f64], _supply_v: f64, _factor: f64) -> Option<Vec<f64>> {
        None
    }

    /// Rate at which the measured angle falls behind the shaft's for good.
    fn lost_rad_per_s(&self, _values: &[f64], _speed_rad_per_s: f64) -> f64 {
        0.0
    }

    /// By how much the reading `angle_rad` of the angle is ahead of the shaft.
    fn ahead_rad(&self, _values: &[f64], _angle_rad: f64) -> f64 {
        0.0
    }
}

//! The simulated motor with its load: the true state, which the firmware can see only through its sensors.
//!
//! A [`Plant`] is advanced under constant [`Inputs`], and then gives its true state in SI units. A positive voltage
//! between IN1 and IN2 causes a positive speed, and a positive current drives the motor in that direction.

mod dc_motor;
mod model_plant;

pub use dc_motor::{BridgeLosses, DcMotor, DcMotorParameters};
pub use model_plant::ModelPlant;

/// Connections of the L293D.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bridge {
    /// Enable low: every switch open, the current flows on through the diodes against the supply until it is zero.
    #[default]
    Coast,
    /// Both sides at the same rail: the motor is short-circuited.
    Brake,
    /// IN1 high, IN2 low.
    Forward,
    /// IN1 low, IN2 high.
    Reverse,
}

/// Inputs of a plant, constant during one [`Plant::advance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// State of the bridge.
    pub bridge: Bridge,
    /// Motor supply at the bridge, in volts, not negative.
    pub supply_v: f64,
    /// Torque at the motor's shaft that works against positive rotation, in newton metres. It does not change its sign
    /// with the rotation, like a weight on a drum.
    pub load_torque_nm: f64,
    /// The rotor is held fast.
    pub blocked: bool,
}

impl Default for Inputs {
    /// 12 V, bridge off, free shaft.
    fn default() -> Self {
        Self { bridge: Bridge::Coast, supply_v: 12.0, load_torque_nm: 0.0, blocked: false }
    }
}

/// Motion of a motor at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Angle of the shaft since the start.
    pub angle_rad: f64,
    /// Speed of the shaft.
    pub speed_rad_per_s: f64,
    /// Armature current.
    pub current_a: f64,
}

/// PWM periods switched alike: a pulse, and the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pwm {
    /// State of the bridge during the pulse.
    pub pulse: Bridge,
    /// State of the bridge after it.
    pub rest: Bridge,
    /// Length of the pulse, from 0 to that of the period.
    pub pulse_s: f64,
    /// Length of a period.
    pub period_s: f64,
    /// From the start of a period to the sample of the current.
    pub sampled_s: f64,
}

impl Pwm {
    /// The states of the bridge from one time of the period to another, and how long they last.
    fn parts(&self, from_s: f64, to_s: f64) -> [(Bridge, f64); 2] {
        let switched_s = self.pulse_s.clamp(from_s, to_s);
        [(self.pulse, switched_s - from_s), (self.rest, to_s - switched_s)]
    }
}

/// Readings of a PWM period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PeriodEnd {
    /// Angle at its end.
    pub angle_rad: f64,
    /// Current at its [`Pwm::sampled_s`].
    pub sampled_a: f64,
}

/// A motor with its load and its supply.
///
/// The chip harness calls [`advance`](Plant::advance) with steps between one processor cycle and one PWM period, some
/// hundred thousand times per simulated second.
pub trait Plant {
    /// Lets `dt_s` seconds (not negative) pass under constant inputs.
    fn advance(&mut self, dt_s: f64, inputs: &Inputs);
    /// Lets a PWM period pass. Its `pwm` takes the place of the inputs' bridge.
    fn advance_period(&mut self, pwm: &Pwm, inputs: &Inputs) -> PeriodEnd {
        let mut pass = |parts: [(Bridge, f64); 2]| {
            for (bridge, dt_s) in parts.into_iter().filter(|(_, dt_s)| *dt_s > 0.0) {
                self.advance(dt_s, &Inputs { bridge, ..*inputs });
            }
            self.current_a()
        };
        let sampled_a = pass(pwm.parts(0.0, pwm.sampled_s));
        pass(pwm.parts(pwm.sampled_s, pwm.period_s));
        PeriodEnd { angle_rad: self.angle_rad(), sampled_a }
    }
    /// Lets a PWM period pass for each of the `ends`, which it fills in.
    fn advance_pwm(&mut self, pwm: &Pwm, inputs: &Inputs, ends: &mut [PeriodEnd]) {
        for end in ends {
            *end = self.advance_period(pwm, inputs);
        }
    }
    /// Angle of the motor's shaft since the start, in radians, unlimited.
    fn angle_rad(&self) -> f64;
    /// Speed of the motor's shaft.
    fn speed_rad_per_s(&self) -> f64;
    /// Armature current.
    fn current_a(&self) -> f64;
    /// Supply voltage as the bridge sees it; it may sag below [`Inputs::supply_v`].
    fn supply_v(&self) -> f64;
}

//! One tick of the control loop: measure, watch, follow the reference, control, compensate, drive.
//!
//! The same [`ControlLoop::tick`] runs in the Uno's timer interrupt and in every simulation on the host. It sees the
//! hardware only as [`Inputs`] and acts on it only through [`Drive`]. So the same inputs give the same outputs everywhere,
//! bit for bit.

use crate::HARDWARE;
use crate::arith::{call_saturate_i16, mul_i16_u16, mul_u16, saturate_i16, saturating_add_i16, saturating_sub_i16};
use crate::compensation::CompensationConfig;
use crate::converter::STEP_V;
use crate::current::{CurrentConfig, CurrentState};
use crate::encoder::{Edges, Proof, SpeedConfig, SpeedState};
use crate::excitation::{Bridge, Player};
use crate::limits::{Integral, Limits, LimitsConfig};
use crate::low_pass::{LowPassConfig, LowPassState};
use crate::lqr::LqrConfig;
use crate::message::{Mode, Request, Sample, State, Trip};
use crate::observer::{ObserverConfig, ObserverState};
use crate::pid::PidConfig;
use crate::quantiser::Quantiser;
use crate::settings::{BuildError, Param, Settings};
use crate::tachogenerator::{NEAR_ZERO, TachoConfig, TachoState};
use crate::trajectory::{PositionProfile, SpeedProfile, TrajectoryConfig};
use crate::trips::{Observation, TripsConfig, TripsState};
use crate::units::{FULL_RANGE, VOLT};

/// What the hardware has measured when a tick begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(C)]
pub struct Inputs {
    /// What the encoder's interrupt handler keeps.
    pub edges: Edges,
    /// Timer0 at the tick's instant, 64 cycles a count.
    pub tick_coarse: u8,
    /// Sum of the last eight conversions of the current sensor, 0..=8184.
    pub current_sum: u16,
    /// Last conversion of the tachogenerator, 0..=1023.
    pub tacho: u16,
    /// Last conversion of the supply divider, 0..=1023.
    pub supply: u16,
    /// [`duty_scale`] of the supply, kept by the main loop.
    pub duty_scale: u16,
    /// [`Inputs::STOP_CLOSED`] and the other bits.
    pub flags: u8,
}

impl Inputs {
    /// The emergency stop's contact is closed.
    pub const STOP_CLOSED: u8 = 1;
    /// The host has said something valid since the last tick.
    pub const HOST_SPOKE: u8 = 2;
    /// The main loop has gone round since the last tick.
    pub const MAIN_LOOP_ALIVE: u8 = 4;
    /// No block of conversions has been completed since the last tick.
    pub const NOT_CONVERTED: u8 = 8;
    /// The stack has grown into the variables.
    pub const STACK_OVERFLOW: u8 = 16;
}

/// What the bridge does until the next tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Drive {
    /// -800..=800 PWM steps.
    pub duty: i16,
    /// Whether the bridge drives, brakes or coasts.
    pub bridge: Bridge,
}

/// PWM steps per bit of voltage, times 2^16, at a supply in bits of voltage: division, so not for the tick.
pub fn duty_scale(supply: i16) -> u16 {
    ((HARDWARE.pwm_steps as u32) << 16)
        .checked_div(supply.max(1) as u32)
        .map_or(u16::MAX, |scale| scale.min(65535) as u16)
}

/// Everything the tick needs to know, quantised.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct LoopConfig {
    speed: SpeedConfig,
    filter: LowPassConfig,
    tacho: TachoConfig,
    tacho_used: bool,
    current: CurrentConfig,
    observer: ObserverConfig,
    limits: LimitsConfig,
    trips: TripsConfig,
    speed_pid: PidConfig,
    position_pid: PidConfig,
    speed_lqr: LqrConfig,
    position_lqr: LqrConfig,
    compensation: CompensationConfig,
    trajectory: TrajectoryConfig,
    /// Bits of position error a count, times 2^8.
    position_scale: u16,
    /// Bits of voltage a step of the supply's conversion, times 2^8; zero where the divider is not wired.
    supply_scale: u16,
    /// The supply setting.
    supply: i16,
}

impl LoopConfig {
    /// Quantises all settings.
    ///
    /// # Errors
    /// The first setting the fixed-point formats cannot hold, with the rule it breaks.
    pub fn build(settings: &Settings) -> Result<Self, BuildError> {
        let mut config = Self::default();
        config.rebuild(settings)?;
        Ok(config)
    }

    /// Quantises all settings in place: the chip's stack has no room for another copy. After an error the content is
    /// of no use.
    ///
    /// # Errors
    /// As [`LoopConfig::build`].
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    pub fn rebuild(&mut self, settings: &Settings) -> Result<(), BuildError> {
        let mut quantiser = Quantiser::new(settings);
        let q = &mut quantiser;
        self.speed = SpeedConfig::quantised(q);
        self.filter = LowPassConfig::quantised(q, Param::SpeedFilter);
        self.tacho = TachoConfig::quantised(q);
        self.tacho_used = q.is_on(Param::SpeedSensor);
        self.current = CurrentConfig::quantised(q);
        self.observer = ObserverConfig::quantised(q);
        self.limits = LimitsConfig::quantised(q);
        self.trips.quantise(q);
        self.speed_pid = PidConfig::quantised_speed(q);
        self.position_pid = PidConfig::quantised_position(q);
        self.speed_lqr = LqrConfig::quantised_speed(q);
        self.position_lqr = LqrConfig::quantised_position(q);
        self.compensation.quantise(q);
        self.trajectory.quantise(q);
        q.power_of_two(Param::PositionRange);
        q.of(core::f32::consts::TAU * 256.0 * FULL_RANGE).over(Param::PositionRange).over(Param::CountsPerRev);
        self.position_scale = q.round(Param::PositionRange, u16::MAX);
        q.of(STEP_V * VOLT * 256.0).times(Param::SupplyDivider);
        self.supply_scale = q.round(Param::SupplyDivider, u16::MAX);
        self.supply = q.bits(Param::SupplyVoltage);
        quantiser.finish()
    }
}

/// What a tick leaves for the next. All bits of the default are zero, so that memory cleared at the start is one.
#[derive(Clone, Debug)]
pub struct ControlLoop {
    /// The configuration; changed only between two ticks, by [`ControlLoop::configure`].
    config: LoopConfig,
    /// What happened in the last tick.
    sample: Sample,
    motion: SpeedState,
    filter: LowPassState,
    tacho: TachoState,
    current: CurrentState,
    observer: ObserverState,
    trips: TripsState,
    /// The derivative's filter of both PIDs.
    filtered: LowPassState,
    /// The integral of every controller; it is aligned when the mode changes.
    integral: Integral,
    profile: Profile,
    player: Player,
    /// Tick of the latched trip.
    tripped_at: u32,
    /// Counts that are called zero.
    origin: i32,
    /// Reference asked for, in the unit of the mode.
    target: i32,
    /// Voltage of the controller in the tick before.
    voltage: i16,
    mode: Mode,
    armed: bool,
    playing: bool,
    braking: bool,
    align: bool,
    limited: bool,
    /// From [`Inputs::duty_scale`].
    duty_scale: u16,
    /// Reference at the start of the sequence.
    origin_of_play: i32,
}

/// The reference generator of the present mode. The speed's tag is zero.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
enum Profile {
    Speed(SpeedProfile),
    Position(PositionProfile),
}

impl Profile {
    #[inline(always)]
    fn moving(&self) -> bool {
        match self {
            Self::Speed(profile) => profile.moving(),
            Self::Position(profile) => profile.moving(),
        }
    }
}

/// What the controllers follow in this tick.
struct Reference {
    /// In the unit of the mode, as it is recorded.
    value: i32,
    /// Its speed, in bits; for the friction compensation and the feed-forward.
    speed: i16,
    /// Error of position, in bits; zero outside position modes.
    error: i16,
}

impl Default for ControlLoop {
    fn default() -> Self {
        // SAFETY: all zeros are valid: numbers, flags, and enums whose first variant has the number zero.
        unsafe { core::mem::zeroed() }
    }
}

impl ControlLoop {
    /// At rest, disarmed, with the encoder's lines as found.
    pub fn new(config: LoopConfig, edges: Edges) -> Self {
        let mut control = Self { config, ..Self::default() };
        control.begin(edges);
        control
    }

    /// Makes one of [`ControlLoop::default`] ready: the encoder's lines as found.
    pub fn begin(&mut self, edges: Edges) {
        self.motion.begin(edges);
        self.current = CurrentState::default();
        self.align = true;
    }

    /// What happened in the last tick.
    pub fn sample(&self) -> &Sample {
        &self.sample
    }

    /// Whether the main loop hangs as of the last tick: also while another trip is the one that is latched.
    #[inline(always)]
    pub fn main_loop_hung(&self) -> bool {
        self.trips.main_loop_hung(&self.config.trips)
    }

    /// Ticks since the latched trip.
    pub fn since_trip(&self) -> u32 {
        self.sample.tick.wrapping_sub(self.tripped_at)
    }

    /// Illegal transitions of the encoder since reset.
    pub fn illegal_transitions(&self) -> u16 {
        self.motion.illegal
    }

    /// Whether a zero calibration of the current is running, and whether the last one succeeded.
    pub fn current_zero(&self) -> (bool, bool) {
        (self.current.zeroing(), self.current.zero_ok())
    }

    /// Takes a new configuration, as a whole, between two ticks; bumpless. A move under way whose profile changes begins
    /// anew where its reference stands, from rest.
    pub fn configure(&mut self, config: &LoopConfig) {
        let goes_on = config.trajectory.moves_like(&self.config.trajectory);
        self.config = *config;
        self.align = true;
        if !goes_on && !self.playing && self.mode != Mode::OpenLoop {
            self.restart();
            self.retarget();
        }
    }

    /// One tick.
    #[inline]
    pub fn tick(&mut self, request: Option<Request>, inputs: &Inputs) -> Drive {
        self.tick_with(request.as_ref(), inputs)
    }

    /// One tick, with a request that stays where it is.
    #[inline(always)]
    pub fn tick_with(&mut self, request: Option<&Request>, inputs: &Inputs) -> Drive {
        let observation = self.measure(inputs);
        self.watch(&observation);
        if let Some(request) = request {
            self.take(request);
        }
        let drive = self.act();
        self.record(&drive);
        drive
    }

    /// Position, speed, current and supply.
    #[inline(always)]
    fn measure(&mut self, inputs: &Inputs) -> Observation {
        let came = self.motion.step(&self.config.speed, &inputs.edges, inputs.tick_coarse);
        let reading = self.current.step(&self.config.current, inputs.current_sum);
        let sample = &mut self.sample;
        sample.tick = sample.tick.wrapping_add(1);
        sample.counts = self.motion.counts.wrapping_sub(self.origin);
        sample.current = reading.current;
        let by_tacho = self.config.tacho_used;
        let speed = match by_tacho {
            true => self.tacho.step(&self.config.tacho, inputs.tacho, self.voltage),
            false => self.motion.speed,
        };
        sample.speed = self.filter.step(&self.config.filter, speed);
        let edges = match by_tacho {
            // Its signal is a motion in each tick; its absence is none.
            true => Proof { place: if inputs.tacho >= NEAR_ZERO { sample.tick as u8 } else { 0 }, ..Proof::default() },
            false => self.motion.proof(came),
        };
        let supply = self.config.supply_scale != 0;
        sample.supply = if supply {
            call_saturate_i16((mul_u16(inputs.supply, self.config.supply_scale) >> 8) as i32)
        } else {
            self.config.supply
        };
        self.duty_scale = inputs.duty_scale;
        Observation {
            voltage: self.voltage,
            current: sample.current,
            speed,
            supply: supply.then_some(sample.supply),
            edges,
            turn: sample.tick as u8,
            sensor_at_rail: reading.saturated,
            flags: inputs.flags,
        }
    }

    /// Trips: the first is latched and disarms.
    #[inline(always)]
    fn watch(&mut self, observation: &Observation) {
        let trip = self.trips.step(&self.config.trips, observation, self.armed);
        if trip != Trip::None {
            if self.sample.trip == Trip::None {
                self.sample.trip = trip;
                self.tripped_at = self.sample.tick;
            }
            self.disarm();
        }
    }

    /// Bridge off, coasting.
    fn disarm(&mut self) {
        self.armed = false;
        self.off(false);
    }

    /// Mode off; the bridge brakes or coasts.
    fn off(&mut self, braking: bool) {
        self.mode = Mode::Off;
        self.playing = false;
        self.braking = braking;
        self.voltage = 0;
        self.align = true;
    }

    /// Obeys the main loop. Not on the path of an ordinary tick.
    #[inline(never)]
    fn take(&mut self, request: &Request) {
        match *request {
            Request::Arm => self.armed = self.sample.trip == Trip::None,
            Request::Disarm => self.disarm(),
            Request::Stop => self.off(self.armed),
            Request::Mode(mode) => self.enter(mode),
            Request::Reference(target) => {
                if self.playing {
                    // The profile stands where it was before the sequence.
                    self.playing = false;
                    self.restart();
                }
                self.target = target;
                self.retarget();
            }
            Request::Play(sequence) => {
                self.player.start(&sequence);
                self.origin_of_play = self.sample.reference;
                self.playing = self.armed && self.mode != Mode::Off;
            }
            Request::ClearTrip => self.sample.trip = Trip::None,
            Request::ZeroCurrent => {
                if !self.armed {
                    self.current.start_zero();
                }
            }
            Request::ZeroPosition => {
                if !self.mode.is_position() {
                    self.origin = self.motion.counts;
                }
            }
        }
    }

    /// Another mode, with the reference at the present value.
    fn enter(&mut self, mode: Mode) {
        if !self.armed || mode == Mode::Off {
            return self.off(false);
        }
        if self.mode == Mode::Off || mode == Mode::OpenLoop {
            // Nothing was driven, or the voltage is about to be given by hand.
            self.voltage = 0;
            self.observer = ObserverState::default();
        }
        self.mode = mode;
        self.playing = false;
        self.align = true;
        self.sample.reference = if mode.is_position() {
            self.sample.counts
        } else if mode.is_speed() {
            self.sample.speed as i32
        } else {
            0
        };
        self.target = self.sample.reference;
        self.restart();
    }

    /// Begins the profile of the mode at the present reference, at rest.
    #[inline(never)]
    fn restart(&mut self) {
        let reference = self.sample.reference;
        self.profile = Profile::Speed(SpeedProfile::default());
        if self.mode.is_position() {
            self.profile = Profile::Position(PositionProfile::default());
        }
        match &mut self.profile {
            Profile::Speed(profile) => profile.begin(call_saturate_i16(reference)),
            Profile::Position(profile) => profile.begin(reference),
        }
    }

    /// Hands the target to the profile.
    fn retarget(&mut self) {
        match &mut self.profile {
            Profile::Speed(profile) => profile.retarget(call_saturate_i16(self.target)),
            Profile::Position(profile) => profile.retarget(self.target),
        }
    }

    /// What the bridge does in this tick.
    #[inline(always)]
    fn act(&mut self) -> Drive {
        if self.mode == Mode::Off {
            self.sample.reference = 0;
            let bridge = if self.braking { Bridge::Brake } else { Bridge::Coast };
            return Drive { duty: 0, bridge };
        }
        let (mut reference, bridge) = self.reference();
        if self.mode == Mode::Off {
            // The sequence has ended.
            return Drive { duty: 0, bridge: Bridge::Brake };
        }
        self.sample.reference = reference.value;
        reference.error = self.position_error(reference.value);
        if bridge != Bridge::Drive {
            self.voltage = 0;
            self.align = true;
            return Drive { duty: 0, bridge };
        }
        let voltage = self.control(&reference);
        Drive { duty: self.duty(voltage), bridge }
    }

    /// The reference of this tick: of the sequence, or of the profile toward the target.
    #[inline(always)]
    fn reference(&mut self) -> (Reference, Bridge) {
        if self.playing {
            return self.play();
        }
        if self.mode == Mode::OpenLoop {
            return (Reference { value: self.target, speed: 0, error: 0 }, Bridge::Drive);
        }
        let config = &self.config.trajectory;
        let (value, speed) = match &mut self.profile {
            Profile::Speed(profile) => {
                let speed = profile.step(config);
                (speed as i32, speed)
            }
            Profile::Position(profile) => profile.step(config),
        };
        (Reference { value, speed, error: 0 }, Bridge::Drive)
    }

    /// The reference of the sequence; positions are relative to where it began.
    #[inline(always)]
    fn play(&mut self) -> (Reference, Bridge) {
        let play = self.player.step();
        if play.done {
            self.off(true);
        }
        let mut reference = Reference { value: play.value as i32, speed: 0, error: 0 };
        if self.mode.is_position() {
            reference.value = reference.value.wrapping_add(self.origin_of_play);
        } else if self.mode.is_speed() {
            reference.speed = play.value;
        }
        (reference, play.bridge)
    }

    /// Reference minus position, in bits, saturating.
    #[inline(always)]
    fn position_error(&self, reference: i32) -> i16 {
        if !self.mode.is_position() {
            return 0;
        }
        let counts = call_saturate_i16(reference.wrapping_sub(self.sample.counts));
        saturate_i16(mul_i16_u16(counts, self.config.position_scale) >> 8)
    }

    /// The controller of the mode, within its limits, and the compensation on top. Returns the voltage.
    #[inline(always)]
    fn control(&mut self, reference: &Reference) -> i16 {
        let config = &self.config;
        let (speed, current) = (self.sample.speed, self.sample.current);
        let closed = self.mode != Mode::OpenLoop;
        let friction = if closed { config.compensation.friction(reference.speed) } else { 0 };
        // Without room the controller's voltage is zero: limits the wrong way round would throw it to and fro each tick.
        let room = (config.limits.voltage - if closed { config.compensation.drop_voltage() } else { 0 }).max(0);
        let (low, high) = config.limits.around(
            self.voltage,
            current,
            saturating_sub_i16(-room, friction),
            saturating_sub_i16(room, friction),
        );
        let limits = Limits { low, high, previous: self.voltage, align: self.align };
        self.align = false;
        if limits.align {
            self.filtered.settle(speed);
        }
        let current = self.observer.step(&config.observer, self.voltage, speed, current);
        let value = saturate_i16(reference.value);
        let (law, terms) = match self.mode {
            Mode::SpeedPid | Mode::PositionPid => {
                let position = self.mode == Mode::PositionPid;
                let pid = if position { &config.position_pid } else { &config.speed_pid };
                let change = pid.filter(&mut self.filtered, speed);
                let terms = if position {
                    PidConfig::position_terms(&self.filtered, reference.error, reference.speed)
                } else {
                    PidConfig::speed_terms(change, value, speed)
                };
                (pid.law(), terms)
            }
            Mode::SpeedLqr => (config.speed_lqr.law(), LqrConfig::speed_terms(value, speed, current)),
            Mode::PositionLqr => {
                let speed_error = saturating_sub_i16(reference.speed, speed);
                (config.position_lqr.law(), LqrConfig::position_terms(reference.error, speed_error, current))
            }
            Mode::OpenLoop | Mode::Off => {
                self.voltage = value.min(high).max(low);
                self.limited = self.voltage == low || self.voltage == high;
                return self.voltage;
            }
        };
        let voltage = self.integral.step(law, &terms, &limits);
        self.voltage = voltage;
        self.limited = voltage == low || voltage == high;
        let driven = saturating_add_i16(saturating_add_i16(voltage, config.compensation.drop(voltage)), friction);
        // Not `clamp`, which becomes a call.
        driven.min(config.limits.voltage).max(-config.limits.voltage)
    }

    /// PWM steps for a voltage, rounded to the nearest.
    #[inline(always)]
    fn duty(&self, voltage: i16) -> i16 {
        let steps = ((mul_u16(voltage.unsigned_abs(), self.duty_scale) + 0x8000) >> 16) as u16;
        let steps = steps.min(HARDWARE.pwm_steps) as i16;
        if voltage < 0 { -steps } else { steps }
    }

    /// Completes the sample.
    #[inline(always)]
    fn record(&mut self, drive: &Drive) {
        let mut state = self.mode as u8;
        let mut add = |set: bool, bit: u8| {
            if set {
                state |= bit;
            }
        };
        add(self.armed, State::ARMED);
        add(drive.bridge != Bridge::Coast, State::ENABLED);
        if self.mode != Mode::Off {
            add(self.playing, State::PLAYING);
            add(self.limited, State::LIMITED);
            add(self.mode != Mode::OpenLoop && self.profile.moving(), State::MOVING);
        }
        self.sample.state = State(state);
        self.sample.duty = drive.duty;
    }
}

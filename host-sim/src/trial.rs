//! The core in closed loop with a simulated motor, in fixed point as on the chip.
//!
//! The tick gets the same inputs as on the chip. These are encoder edges with their time stamps and sums of current
//! conversions, sampled at `HARDWARE.current_sampling_step` of PWM periods. There is also one conversion of the
//! tachogenerator each millisecond. The bridge is switched as the PWM does, and takes a new duty [`DRIVE_DELAY_S`]
//! after the tick.

use crate::plant::{Bridge, Inputs as PlantInputs, ModelPlant, PeriodEnd, Plant, Pwm};
use crate::sensor_effects::SensorEffects;
use motorbench_core::HARDWARE;
use motorbench_core::control_loop::{ControlLoop, Drive, Inputs, LoopConfig, duty_scale};
use motorbench_core::converter;
use motorbench_core::encoder::Edges;
use motorbench_core::excitation;
use motorbench_core::message::{Mode, Request, Sample, State};
use motorbench_core::settings::{BuildError, Param, Settings};
use motorbench_core::tachogenerator;
use motorbench_core::units::VOLT;
use motorbench_data::telemetry::{reference_bit, speed_bit_rad_per_s};
use motorbench_model::Model;
use motorbench_model::catalogue::OffPhase;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::Serialize;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// From the tick's instant to the voltage at the motor. The tick takes about 3,000 cycles (190 us), and the PWM takes a
/// new duty at the start of its next period.
pub const DRIVE_DELAY_S: f64 = 0.2e-3;
/// Default ripple of a tachogenerator without a data sheet.
pub const USUAL_RIPPLE: f64 = 0.05;
/// PWM periods from the tick to the first one with the new duty.
const LATE_PERIODS: usize = (DRIVE_DELAY_S * HARDWARE.pwm_hz as f64) as usize;
/// PWM periods of a tick at the slower control rate.
const MOST_PERIODS: usize = HARDWARE.pwm_hz as usize / 1000;
/// Conversions of the ADC: one every second PWM period; each half of a round has a block of the current and another
/// channel.
const PERIODS_PER_CONVERSION: u32 = converter::PERIODS_PER_CONVERSION as u32;
const BLOCK: u32 = converter::BLOCK as u32;
const SLOTS_PER_BLOCK: u32 = converter::SLOTS as u32 / 2;
const PERIOD_S: f64 = 1.0 / HARDWARE.pwm_hz as f64;
/// From one conversion of the tachogenerator to the next.
const TACHO_PERIOD_S: f64 = PERIOD_S * (PERIODS_PER_CONVERSION * 2 * SLOTS_PER_BLOCK) as f64;
/// From the start of a PWM period to the sample of its conversion.
const SAMPLED_S: f64 = PERIOD_S * HARDWARE.current_sampling_step as f64 / HARDWARE.pwm_steps as f64;
/// Periods of the tachogenerator's ripple in a turn: its commutator has 22 segments.
pub const TACHO_RIPPLES_PER_TURN: f64 = 22.0;
/// Share of the tachogenerator's voltage after the divider.
pub const TACHO_DIVIDER: f64 = tachogenerator::DIVIDER as f64;
/// Steps of a conversion in a volt, the highest, the middle one, and the sensor's output at zero current.
const STEPS_PER_VOLT: f64 = 1.0 / converter::STEP_V as f64;
const HIGHEST: f64 = converter::STEPS as f64 - 1.0;
const MIDDLE: u16 = converter::STEPS / 2;
const ZERO_V: f64 = converter::FULL_SCALE_V as f64 / 2.0;

/// One tick in SI units: the core's measurements and the true values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Since the start of the trial.
    pub t_s: f64,
    /// Reference in rad/s, rad or V, after the profile.
    pub reference: f64,
    /// Mean voltage asked of the bridge.
    #[serde(rename = "u_V")]
    pub u_v: f64,
    /// Speed as measured by the core.
    pub measured_rad_per_s: f64,
    /// True speed.
    pub omega_rad_per_s: f64,
    /// True angle.
    pub theta_rad: f64,
    /// True current.
    #[serde(rename = "i_A")]
    pub i_a: f64,
    /// The voltage was at a limit: saturation, slew or current.
    pub limited: bool,
}

/// Sensors and timing by the settings.
struct Scales {
    counts_per_rad: f64,
    current_v_per_a: f64,
    tacho_v_s_per_rad: f64,
    /// PWM periods of a tick.
    periods: usize,
}

/// Outside conditions of motor and sensors; they may change between two ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Motor supply; the core measures it only if `supply_divider` says that the divider is wired.
    pub supply_v: f64,
    /// Torque against positive rotation.
    pub load_torque_nm: f64,
    /// The rotor is held fast.
    pub rotor_blocked: bool,
    /// The encoder's edges do not arrive.
    pub encoder_unplugged: bool,
    /// The current sensor's output stays here, in volts from 0 to 5.
    pub current_pinned_v: Option<f64>,
    /// Standard deviation of the current sensor's output, in volts.
    pub current_noise_v: f64,
    /// Amplitude of the tachogenerator's ripple relative to the mean.
    pub tacho_ripple: f64,
    /// Periods of that ripple in a turn.
    pub tacho_ripples_per_turn: f64,
    /// The contact of the emergency stop is closed.
    pub stop_closed: bool,
}

impl Surroundings {
    /// No fault, and the supply voltage of the settings.
    pub fn new(settings: &Settings) -> Self {
        Self {
            supply_v: settings.get(Param::SupplyVoltage).into(),
            load_torque_nm: 0.0,
            rotor_blocked: false,
            encoder_unplugged: false,
            current_pinned_v: None,
            current_noise_v: 0.0,
            tacho_ripple: 0.0,
            tacho_ripples_per_turn: TACHO_RIPPLES_PER_TURN,
            stop_closed: false,
        }
    }
}

/// A motor under the core.
pub struct Trial<P> {
    /// The motor.
    pub plant: P,
    /// Its outside conditions.
    pub surroundings: Surroundings,
    noise: ChaCha8Rng,
    control: ControlLoop,
    settings: Settings,
    edges: Edges,
    scales: Scales,
    /// Angle in encoder counts, and the whole counts that the encoder has reported.
    position: f64,
    count: f64,
    /// PWM periods since the start.
    periods: u32,
    /// Drives on their way to the bridge, the oldest first. Each takes effect at a tick, for this many PWM periods.
    drives: VecDeque<Drive>,
    late_periods: usize,
    /// The host has said something valid since the last tick.
    host_spoke: bool,
    off_phase: OffPhase,
    sensors: SensorEffects,
    /// Sum of the block of conversions under way, of the last complete block, and of the last two.
    sums: [u16; 3],
    /// Last conversion of the tachogenerator.
    tacho: u16,
}

impl<P: Plant> Trial<P> {
    /// At rest and disarmed.
    ///
    /// # Errors
    /// A setting the core cannot hold.
    pub fn new(plant: P, settings: Settings) -> Result<Self, BuildError> {
        let edges = Edges::at_rest(0);
        let get = |param| f64::from(settings.get(param));
        let scales = Scales {
            counts_per_rad: get(Param::CountsPerRev) / TAU,
            current_v_per_a: 1e-3 * get(Param::CurrentGain),
            tacho_v_s_per_rad: TACHO_DIVIDER * 1e-3 * 60.0 / TAU * get(Param::TachoGain),
            periods: periods_of(&settings),
        };
        Ok(Self {
            position: plant.angle_rad() * scales.counts_per_rad + 0.5,
            scales,
            plant,
            surroundings: Surroundings::new(&settings),
            noise: ChaCha8Rng::seed_from_u64(0),
            control: ControlLoop::new(LoopConfig::build(&settings)?, edges),
            settings,
            edges,
            count: 0.0,
            periods: 0,
            drives: VecDeque::from([Drive::default()]),
            late_periods: LATE_PERIODS,
            host_spoke: false,
            off_phase: OffPhase::Brakes,
            sensors: SensorEffects::default(),
            sums: [0, BLOCK as u16 * MIDDLE, 2 * BLOCK as u16 * MIDDLE],
            tacho: 0,
        })
    }

    /// Delays the bridge by a number of PWM periods, for a motor at rest.
    pub fn delay_by(&mut self, delay_s: f64) {
        let late_periods = LATE_PERIODS + (delay_s * f64::from(HARDWARE.pwm_hz)).round() as usize;
        self.late_periods = late_periods % self.scales.periods;
        self.drives = vec![Drive::default(); late_periods / self.scales.periods + 1].into();
    }

    /// Restarts the noise of the sensors: the same seed gives the same run.
    pub fn seed(&mut self, seed: u64) {
        self.noise = ChaCha8Rng::seed_from_u64(seed);
    }

    /// Arms, and enters a mode.
    pub fn enter(&mut self, mode: Mode) {
        self.tick(Some(Request::Arm));
        self.tick(Some(Request::Mode(mode)));
    }

    /// The request for a reference (rad/s, rad or V) in the present mode.
    pub fn reference(&self, reference: f64) -> Request {
        Request::Reference(self.bits(self.sample().state.mode(), reference))
    }

    /// Follows a reference (rad/s, rad or V) for some time.
    pub fn follow(&mut self, reference: f64, duration_s: f64) -> Vec<Point> {
        let request = self.reference(reference);
        let ticks = (duration_s * f64::from(self.settings.get(Param::TickRate))) as usize;
        (0..ticks).map(|at| self.tick((at == 0).then_some(request))).collect()
    }

    /// Takes other settings between two ticks, as a whole. Encoder and sensors stay the rig's, those that the trial
    /// began with: only the program's idea of them changes.
    ///
    /// # Errors
    /// A setting the core cannot hold; nothing has changed then.
    pub fn configure(&mut self, settings: &Settings) -> Result<(), BuildError> {
        self.control.configure(&LoopConfig::build(settings)?);
        self.settings = *settings;
        self.scales.periods = periods_of(settings);
        Ok(())
    }

    /// The next tick counts as one with a word of the host.
    pub fn host_speaks(&mut self) {
        self.host_spoke = true;
    }

    /// The control core.
    pub fn control(&self) -> &ControlLoop {
        &self.control
    }

    /// The last sample.
    pub fn sample(&self) -> &Sample {
        self.control.sample()
    }

    /// Time between two ticks.
    pub fn period_s(&self) -> f64 {
        1.0 / f64::from(self.settings.get(Param::TickRate))
    }

    /// One tick, and the time until the next.
    pub fn tick(&mut self, request: Option<Request>) -> Point {
        let before = pwm(&self.drives[0], self.off_phase);
        self.drives.push_back(self.control.tick(request, &self.inputs()));
        self.host_spoke = false;
        self.drives.pop_front();
        let now = pwm(&self.drives[0], self.off_phase);
        let point = self.point();
        let inputs = PlantInputs {
            bridge: Bridge::default(),
            supply_v: self.surroundings.supply_v,
            load_torque_nm: self.surroundings.load_torque_nm,
            blocked: self.surroundings.rotor_blocked,
        };
        let mut ends = [PeriodEnd::default(); MOST_PERIODS];
        let ends = &mut ends[..self.scales.periods];
        let (late, prompt) = ends.split_at_mut(self.late_periods);
        self.plant.advance_pwm(&before, &inputs, late);
        self.plant.advance_pwm(&now, &inputs, prompt);
        let shown = self.sensors.read(PERIOD_S, ends);
        let shown = shown.as_deref().unwrap_or(ends);
        self.convert_sampled(ends, shown);
        self.count_edges(shown);
        self.periods += ends.len() as u32;
        point
    }

    fn inputs(&self) -> Inputs {
        // The main loop keeps the scale of the last sample's supply.
        let supply_bits = match self.sample().supply {
            0 => (self.settings.get(Param::SupplyVoltage) * VOLT) as i16,
            measured => measured,
        };
        let divider = f64::from(self.settings.get(Param::SupplyDivider));
        let supply = if divider > 0.0 { self.surroundings.supply_v / divider * STEPS_PER_VOLT } else { 0.0 };
        Inputs {
            edges: self.edges,
            tick_coarse: (self.cycles() >> 6) as u8,
            current_sum: self.sums[2],
            tacho: self.tacho,
            supply: supply.clamp(0.0, HIGHEST) as u16,
            duty_scale: duty_scale(supply_bits),
            flags: Inputs::MAIN_LOOP_ALIVE
                | if self.host_spoke { Inputs::HOST_SPOKE } else { 0 }
                | if self.surroundings.stop_closed { Inputs::STOP_CLOSED } else { 0 },
        }
    }

    /// Processor cycles since the start, modulo 2^32: the timers keep the low 14 bits.
    fn cycles(&self) -> u32 {
        self.periods.wrapping_mul(HARDWARE.clock_hz / HARDWARE.pwm_hz)
    }

    fn point(&self) -> Point {
        let sample = self.sample();
        let get = |param| f64::from(self.settings.get(param));
        let speed = speed_bit_rad_per_s(&self.settings);
        let unit = reference_bit(sample.state.mode(), &self.settings);
        Point {
            t_s: f64::from(self.periods) / f64::from(HARDWARE.pwm_hz),
            reference: f64::from(sample.reference) * unit,
            u_v: f64::from(sample.duty) / f64::from(HARDWARE.pwm_steps) * get(Param::SupplyVoltage),
            measured_rad_per_s: f64::from(sample.speed) * speed,
            omega_rad_per_s: self.plant.speed_rad_per_s(),
            theta_rad: self.plant.angle_rad(),
            i_a: self.plant.current_a(),
            limited: sample.state.has(State::LIMITED),
        }
    }

    /// A reference in the bits of the mode.
    fn bits(&self, mode: Mode, reference: f64) -> i32 {
        (reference / reference_bit(mode, &self.settings)).round() as i32
    }

    /// The conversions of the tick that has just passed, from true values and sensor effects. Its first period has
    /// none.
    fn convert_sampled(&mut self, ends: &[PeriodEnd], shown: &[PeriodEnd]) {
        for (period, (pair, shown)) in (self.periods + 2..).zip(ends.windows(2).zip(&shown[1..])) {
            let conversion = period / PERIODS_PER_CONVERSION;
            match (period % PERIODS_PER_CONVERSION, conversion % (2 * SLOTS_PER_BLOCK)) {
                (0, SLOTS_PER_BLOCK) => self.convert_tacho(pair),
                // The supply is read with every tick.
                (0, 0) | (1.., _) => (),
                (0, _) => self.convert(conversion, shown.sampled_a),
            }
        }
    }

    /// A conversion of the tachogenerator, of which the converter sees the magnitude.
    fn convert_tacho(&mut self, ends: &[PeriodEnd]) {
        let [before_rad, angle_rad] = [ends[0].angle_rad, ends[1].angle_rad];
        let Surroundings { tacho_ripple, tacho_ripples_per_turn, .. } = self.surroundings;
        let ripple = 1.0 + tacho_ripple * (tacho_ripples_per_turn * angle_rad).sin();
        let speed_rad_per_s = (angle_rad - before_rad) / PERIOD_S;
        let shown_rad_per_s = self.sensors.tachogenerator_rad_per_s(TACHO_PERIOD_S, speed_rad_per_s, angle_rad);
        let output_v = self.scales.tacho_v_s_per_rad * shown_rad_per_s.abs() * ripple;
        self.tacho = (output_v * STEPS_PER_VOLT).clamp(0.0, HIGHEST) as u16;
    }

    /// Encoder edges of the tick that has just passed. Within a period the speed is as good as constant.
    fn count_edges(&mut self, ends: &[PeriodEnd]) {
        let mut positions = [self.position; MOST_PERIODS + 1];
        for (position, end) in positions[1..].iter_mut().zip(ends) {
            *position = end.angle_rad * self.scales.counts_per_rad + 0.5;
        }
        let positions = &positions[..=ends.len()];
        let to = positions[ends.len()];
        self.position = to;
        // A count n covers the range from n to n + 1.
        let end = to.floor();
        let moved = (end - self.count) as i32;
        self.count = end;
        // The last edge is where the count's range was entered for good.
        let last = positions.iter().rposition(|position| !(0.0..1.0).contains(&(position - end)));
        let Some(period) = last.filter(|_| !self.surroundings.encoder_unplugged) else { return };
        let (from, to) = (positions[period], positions[period + 1]);
        let forward = from < end;
        // At the lower end of the count when going up, at the upper when going down.
        let edge = if forward { end } else { end + 1.0 };
        let part = ((edge - from) / (to - from)).clamp(0.0, 1.0);
        let cycles_a_period = HARDWARE.clock_hz / HARDWARE.pwm_hz;
        // Modulo 2^32: the timers keep the low 14 bits.
        let start = (self.periods + period as u32).wrapping_mul(cycles_a_period);
        let cycles = start.wrapping_add((part * f64::from(cycles_a_period)) as u32);
        self.edges.count = self.edges.count.wrapping_add(moved as u8);
        self.edges.step = if forward { 1 } else { 3 };
        self.edges.coarse = (cycles >> 6) as u8;
        self.edges.fine = cycles as u8;
    }

    /// A conversion of the current. The eighths of a step that noise makes real on the chip are dithered evenly here.
    fn convert(&mut self, conversion: u32, sampled_a: f64) {
        let slot = conversion % SLOTS_PER_BLOCK;
        let block = conversion / SLOTS_PER_BLOCK;
        // In the middle of each eighth, so that on average nothing is cut off.
        let dither = (f64::from(2 * (slot - 1) + block % 2) + 0.5) / f64::from(2 * BLOCK);
        let mut output_v = ZERO_V + self.scales.current_v_per_a * sampled_a;
        if self.surroundings.current_noise_v > 0.0 {
            let noise: f64 = self.noise.sample(StandardNormal);
            output_v += self.surroundings.current_noise_v * noise;
        }
        let steps = self.surroundings.current_pinned_v.unwrap_or(output_v) * STEPS_PER_VOLT + dither;
        self.sums[0] += steps.clamp(0.0, HIGHEST) as i32 as u16;
        if slot == BLOCK {
            self.sums = [0, self.sums[0], self.sums[0] + self.sums[1]];
        }
    }
}

impl Trial<ModelPlant> {
    /// A motor at rest and disarmed, with all effects of a model: those of the motor, the sensors, and the bridge.
    ///
    /// # Errors
    /// A setting the core cannot hold.
    pub fn of_model(model: &Model, settings: Settings) -> Result<Self, BuildError> {
        let mut trial = Self::new(ModelPlant::new(model.clone()), settings)?;
        trial.delay_by(model.delay_s());
        trial.off_phase = model.off_phase();
        trial.sensors = SensorEffects::of(model);
        Ok(trial)
    }
}

/// PWM periods of a tick.
fn periods_of(settings: &Settings) -> usize {
    (f64::from(HARDWARE.pwm_hz) / f64::from(settings.get(Param::TickRate))) as usize
}

/// Whether the bridge is open for the rest of a period.
fn coasts(off_phase: OffPhase, duty: i16) -> bool {
    match off_phase {
        OffPhase::Brakes => false,
        OffPhase::Coasts => true,
        OffPhase::CoastsAtZeroDuty => duty == 0,
    }
}

/// How a drive switches the bridge: on for the duty, braking or coasting for the rest.
fn pwm(drive: &Drive, off_phase: OffPhase) -> Pwm {
    let rest = match drive.bridge {
        excitation::Bridge::Drive if coasts(off_phase, drive.duty) => Bridge::Coast,
        excitation::Bridge::Coast => Bridge::Coast,
        excitation::Bridge::Drive | excitation::Bridge::Brake => Bridge::Brake,
    };
    Pwm {
        pulse: if drive.duty < 0 { Bridge::Reverse } else { Bridge::Forward },
        rest,
        pulse_s: PERIOD_S * f64::from(drive.duty.unsigned_abs()) / f64::from(HARDWARE.pwm_steps),
        period_s: PERIOD_S,
        sampled_s: SAMPLED_S,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::{BridgeLosses, DcMotor, DcMotorParameters};
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;

    /// In open loop the core measures the true speed and current, to the resolution of its sensors.
    #[test]
    fn the_core_sees_what_the_motor_does() {
        let motor = DcMotor::new(DcMotorParameters { bridge: BridgeLosses::IDEAL, ..DcMotorParameters::PIVT6 });
        let mut trial = Trial::new(motor, Settings::defaults()).unwrap();
        trial.enter(Mode::OpenLoop);
        for voltage_v in [3.0, -5.0] {
            let points = trial.follow(voltage_v, 0.5);
            for point in &points[400..] {
                // The mean of a tick in which nothing changes is the speed itself, to a bit and a cycle in time.
                assert!((point.measured_rad_per_s - point.omega_rad_per_s).abs() < 0.03, "{point:?}");
            }
            let seen_a = f64::from(trial.sample().current) / f64::from(motorbench_core::units::AMPERE);
            assert!((seen_a - points[499].i_a).abs() < 0.04, "{seen_a} {:?}", points[499]);
            assert_eq!(trial.sample().counts, (points[499].theta_rad * 2000.0 / TAU + 0.5).floor() as i32);
        }
    }

    /// Both directions, to a step of the converter; the ripple comes through the filter as far as it is slow enough.
    #[test]
    fn the_tachogenerator_tells_the_speed() {
        for (ripple, within) in [(0.0, 0.01), (0.05, 0.06)] {
            let mut settings = Settings::defaults();
            settings.set(Param::SpeedSensor, 1.0).unwrap();
            let mut trial = Trial::new(DcMotor::default(), settings).unwrap();
            trial.surroundings.tacho_ripple = ripple;
            trial.enter(Mode::OpenLoop);
            for voltage_v in [9.0, -7.0] {
                let points = trial.follow(voltage_v, 0.8);
                let off = points[600..].iter().map(|point| point.measured_rad_per_s / point.omega_rad_per_s - 1.0);
                let [least, most] = off.fold([0.0, 0.0], |[low, high]: [f64; 2], off| [low.min(off), high.max(off)]);
                assert!(-within < least && most < within && most - least >= 0.2 * ripple, "{least} {most}");
            }
        }
    }

    /// With the PWM on the enable pin the current ends within each off phase. At half duty the motor then hardly turns,
    /// while it turns well if the off phase brakes. A bridge that coasts only at zero duty also turns it, and lets it
    /// run on.
    #[test]
    fn the_off_phase_is_the_models() {
        let motor = Model::linear(MotorParameters { inertia_kg_m2: 2e-5, ..MotorParameters::PIVT6 });
        let motor = motor.with(effect("coulomb_friction").unwrap(), vec![0.012]);
        let coasting = |at_zero_duty| motor.with(effect("coast_decay").unwrap(), vec![1.0, at_zero_duty]);
        let speeds = |model: &Model| {
            let mut trial = Trial::of_model(model, Settings::defaults()).unwrap();
            trial.enter(Mode::OpenLoop);
            let speed = |points: Vec<Point>| points.last().unwrap().omega_rad_per_s;
            [(6.0, 0.5), (0.0, 0.02)].map(|(voltage_v, duration_s)| speed(trial.follow(voltage_v, duration_s)))
        };
        let [brakes, coasts, at_zero] = [&motor, &coasting(0.0), &coasting(1.0)].map(speeds);
        assert!(brakes[0] > 50.0 && coasts[0] < 0.8 * brakes[0], "{brakes:?} {coasts:?}");
        assert!((at_zero[0] - brakes[0]).abs() < 0.01 && at_zero[1] > brakes[1] + 5.0, "{brakes:?} {at_zero:?}");
    }

    /// A plant whose current is the share of the PWM period that has passed.
    struct Clock(f64);

    impl Plant for Clock {
        fn advance(&mut self, dt_s: f64, _: &PlantInputs) {
            self.0 += dt_s;
        }
        fn angle_rad(&self) -> f64 {
            0.0
        }
        fn speed_rad_per_s(&self) -> f64 {
            0.0
        }
        fn current_a(&self) -> f64 {
            (self.0 / PERIOD_S).fract()
        }
        fn supply_v(&self) -> f64 {
            12.0
        }
    }

    /// At any duty, also where the pulse is longer than that.
    #[test]
    fn the_current_is_sampled_where_the_firmware_samples_it() {
        for voltage_v in [0.0, 3.0, 11.9] {
            let mut trial = Trial::new(Clock(0.0), Settings::defaults()).unwrap();
            trial.enter(Mode::OpenLoop);
            trial.follow(voltage_v, 0.1);
            let seen_a = f64::from(trial.sample().current) / f64::from(motorbench_core::units::AMPERE);
            let sampled_a = f64::from(HARDWARE.current_sampling_step) / f64::from(HARDWARE.pwm_steps);
            // An eighth of a step of the converter.
            assert!((seen_a - sampled_a).abs() < 0.004, "{voltage_v} V: {seen_a} A");
        }
    }
}

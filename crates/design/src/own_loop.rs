//! Gains for a loop of one's own: the Arduino PID library, QuickPID, or a plain sketch. Speed in rpm, output in PWM values
//! from -255 to 255, a sample time of some 10 ms.
//!
//! The gains follow from the motor as a first-order lag with the dead time of the sampling (Skogestad, Journal of
//! Process Control 13 (2003)). Half a sample time comes from the mean of the speed, half from the output that is held.
//! The reference passes a filter with the time constant of the loop, and the feed-forward is that of the filtered
//! course. With a feed-forward of the step itself the integral would overshoot. The gains are tried on the model with
//! everything in it, at that sample time and with the counts of the encoder. They are tried again with all constants of
//! the motor 30 % off.

use crate::Bench;
use host_sim::plant::{Bridge, Inputs, ModelPlant, Plant};
use motorbench_model::linear::motor_model::speed;
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Direction, Model};
use serde::Serialize;
use std::f64::consts::TAU;

/// Full scale of `analogWrite`.
pub const PWM_FULL: f64 = 255.0;
/// Sample times that a sketch keeps.
pub const SAMPLE_TIMES_S: [f64; 2] = [0.01, 0.1];
/// Sampling intervals that the loop's time constant has at least: a shorter one has no margin.
const LEAST_SAMPLES: f64 = 1.0;
/// A loop whose trial fails is made slower by this, so often at most.
pub(crate) const SLOWER: f64 = 1.25;
pub(crate) const MOST_TRIALS: usize = 12;
/// Shares of the greatest speed that the trial asks for, and how long each lasts: so many time constants of loop and motor.
const REFERENCES: [f64; 4] = [0.5, 0.25, -0.5, 0.0];
const LASTS: f64 = 12.0;
/// How far off the constants of the motor may be.
const OFF: [f64; 2] = [0.7, 1.3];
/// What the motor may overshoot then beyond what is asked for, in percent of the step: by so much its feed-forward is wrong.
const MORE_WHEN_OFF: f64 = 100.0 * (1.0 / OFF[0] - 1.0);
/// Error at the end of a step that a loop has settled with, in percent of it.
const SETTLED_PERCENT: f64 = 5.0;
const RPM: f64 = 60.0 / TAU;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// Bandwidth from reference to speed.
    pub bandwidth_hz: f64,
    /// Largest overshoot.
    pub overshoot_percent: f64,
    /// Sample time of the sketch.
    pub sample_s: f64,
}

/// Why there are no gains.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OwnLoopError {
    /// A sketch cannot keep this sample time, or a motor cannot be controlled with it.
    #[error("a sample time of {0} ms: expected 10 to 100 ms")]
    SampleTime(f64),
    /// The bandwidth is no positive number.
    #[error("a bandwidth of {0} Hz: expected a positive number")]
    Bandwidth(f64),
    /// Without counts there is no speed.
    #[error("a sketch counts the speed: add encoder.counts_per_rev to the rig file")]
    NoEncoder,
    /// Even slow loops did not follow.
    #[error(
        "no loop of a sketch followed the reference at a sample time of {sample_ms} ms, down to a bandwidth of {slowest_hz:.2} Hz: {why}"
    )]
    NoneFollows {
        /// Sample time.
        sample_ms: f64,
        /// The slowest one tried.
        slowest_hz: f64,
        /// What went wrong with it.
        why: String,
    },
}

/// The two ways of computing a PI that sketches use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sketch {
    /// The Arduino PID library, and QuickPID with proportional on error and clamped integral: the integral ends at the limits.
    Library,
    /// The plain sketch: while the output is at a limit the integral waits.
    Plain,
}

impl Sketch {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Library, Self::Plain];

    /// The PWM value of the integral and what is `without` it, after the integral has taken `more`.
    pub(crate) fn output(self, integral: &mut f64, more: f64, without: f64) -> f64 {
        let wanted = without + *integral + more;
        match self {
            Self::Library => *integral = (*integral + more).clamp(-PWM_FULL, PWM_FULL),
            Self::Plain if wanted.abs() <= PWM_FULL || wanted * more < 0.0 => *integral += more,
            Self::Plain => {}
        }
        (without + *integral).clamp(-PWM_FULL, PWM_FULL).round()
    }
}

/// Gains, and how they did in the trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OwnLoop {
    /// Sample time.
    pub sample_s: f64,
    /// PWM per rpm.
    #[serde(rename = "kp_PWM_per_rpm")]
    pub kp: f64,
    /// PWM per rpm and second.
    #[serde(rename = "ki_PWM_per_rpm_s")]
    pub ki: f64,
    /// Feed-forward, PWM per rpm.
    #[serde(rename = "kff_PWM_per_rpm")]
    pub kff: f64,
    /// Feed-forward of the acceleration, PWM per rpm/s.
    #[serde(rename = "kaff_PWM_s_per_rpm")]
    pub kaff: f64,
    /// Time constant of the loop, and of the filter of its reference.
    pub loop_s: f64,
    /// PWM that friction and drop take, forward and in reverse.
    #[serde(rename = "dead_band_PWM")]
    pub dead_band: [f64; 2],
    /// Step of the speed by one count.
    pub count_rpm: f64,
    /// The bandwidth of these gains, at most the one asked for.
    #[serde(rename = "bandwidth_Hz")]
    pub bandwidth_hz: f64,
    /// By each way of computing it.
    pub tried: Vec<Tried>,
}

/// A trial in simulation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tried {
    /// How the output was computed.
    pub sketch: Sketch,
    /// Greatest overshoot of all steps, in percent of the step.
    pub overshoot_percent: f64,
    /// Greatest error at the end of a step.
    pub error_rpm: f64,
    /// Greatest overshoot with the constants of the motor 30 % off.
    pub overshoot_when_off_percent: f64,
}

/// Gains for a speed loop of a motor.
///
/// # Errors
/// [`OwnLoopError`] with what to do.
pub fn own_loop(model: &Model, bench: &Bench, asked: &Asked) -> Result<OwnLoop, OwnLoopError> {
    let circuit = checked(bench, asked)?;
    let Asked { bandwidth_hz, sample_s, .. } = *asked;
    let mut loop_s = (1.0 / (TAU * bandwidth_hz)).max(LEAST_SAMPLES * sample_s);
    let mut why = String::new();
    for _ in 0..MOST_TRIALS {
        let gains = gains(model, &circuit, sample_s, loop_s);
        match tried(model, &circuit, &gains, asked, loop_s) {
            Ok(tried) => return Ok(OwnLoop { tried, ..gains }),
            Err(failed) => why = failed,
        }
        loop_s *= SLOWER;
    }
    Err(OwnLoopError::NoneFollows { sample_ms: 1e3 * sample_s, slowest_hz: SLOWER / (TAU * loop_s), why })
}

/// What is around the motor, if a sketch can do what is asked for there.
pub(crate) fn checked(bench: &Bench, asked: &Asked) -> Result<Circuit, OwnLoopError> {
    let Asked { bandwidth_hz, sample_s, .. } = *asked;
    if !(SAMPLE_TIMES_S[0]..=SAMPLE_TIMES_S[1]).contains(&sample_s) {
        return Err(OwnLoopError::SampleTime(1e3 * sample_s));
    }
    if !(bandwidth_hz > 0.0 && bandwidth_hz.is_finite()) {
        return Err(OwnLoopError::Bandwidth(bandwidth_hz));
    }
    let counts_per_rev = bench.counts_per_rev.ok_or(OwnLoopError::NoEncoder)?;
    Ok(Circuit { supply_v: bench.supply_v, counts_per_rev, delay_s: bench.delay_s })
}

/// What is around the motor.
#[derive(Clone, Copy)]
pub(crate) struct Circuit {
    pub(crate) supply_v: f64,
    pub(crate) counts_per_rev: f64,
    pub(crate) delay_s: f64,
}

/// By the rules of Skogestad, for a lag with a dead time.
fn gains(model: &Model, circuit: &Circuit, sample_s: f64, loop_s: f64) -> OwnLoop {
    let Circuit { supply_v, counts_per_rev, delay_s } = *circuit;
    let per_pwm = speed(&model.motor).dc_gain() * RPM * supply_v / PWM_FULL;
    let lag_s = lag_s(&model.motor);
    let slow_s = loop_s + sample_s + delay_s;
    let kp = lag_s / (per_pwm * slow_s);
    let dead_band = Direction::BOTH.map(|way| model.dead_band_v(way, supply_v) / supply_v * PWM_FULL);
    OwnLoop {
        sample_s,
        kp,
        ki: kp / lag_s.min(4.0 * slow_s),
        kff: 1.0 / per_pwm,
        kaff: lag_s / per_pwm,
        loop_s,
        dead_band,
        count_rpm: 60.0 / (counts_per_rev * sample_s),
        bandwidth_hz: 1.0 / (TAU * loop_s),
        tried: Vec::new(),
    }
}

/// Time constant of the speed, with the viscous friction.
pub(crate) fn lag_s(motor: &MotorParameters) -> f64 {
    motor.inertia_kg_m2 * motor.resistance_ohm / motor.torque_constant_nm_per_a * speed(motor).dc_gain()
}

/// Tries the gains in each sketch; the error says what went wrong.
fn tried(model: &Model, circuit: &Circuit, gains: &OwnLoop, asked: &Asked, loop_s: f64) -> Result<Vec<Tried>, String> {
    let of_sketch = |sketch: Sketch| {
        let nominal = trial(model, circuit, gains, sketch, loop_s);
        let off = corners(model).map(|model| trial(&model, circuit, gains, sketch, loop_s));
        let overshoot_when_off_percent = off.iter().map(|off| off.overshoot_percent).fold(0.0, f64::max);
        let error_when_off_rpm = off.iter().map(|off| off.error_rpm).fold(0.0, f64::max);
        let tried = Tried { overshoot_when_off_percent, ..nominal };
        let least_step_rpm = 0.25 * greatest_rpm(model, circuit);
        let allowed_rpm = (SETTLED_PERCENT / 100.0 * least_step_rpm).max(2.0 * gains.count_rpm);
        // One count more or less is no overshoot.
        let of_a_count = 100.0 * gains.count_rpm / least_step_rpm;
        match &tried {
            Tried { overshoot_percent, .. } if *overshoot_percent > asked.overshoot_percent + of_a_count => {
                Err(format!("it overshoots by {overshoot_percent:.0} %"))
            }
            Tried { error_rpm, .. } if *error_rpm > allowed_rpm => {
                Err(format!("it is off by {error_rpm:.0} rpm at the end"))
            }
            _ if error_when_off_rpm > 2.0 * allowed_rpm => {
                Err(format!("with the motor's constants 30 % off it is off by {error_when_off_rpm:.0} rpm at the end"))
            }
            Tried { overshoot_when_off_percent: off, .. }
                if *off > asked.overshoot_percent + MORE_WHEN_OFF + of_a_count =>
            {
                Err(format!("with the motor's constants 30 % off it overshoots by {off:.0} %"))
            }
            _ => Ok(tried),
        }
    };
    Sketch::ALL.into_iter().map(of_sketch).collect()
}

/// The motor with more and with less gain, quicker and slower.
pub(crate) fn corners(model: &Model) -> [Model; 4] {
    let with = |constant: f64, inertia: f64| {
        let mut model = model.clone();
        model.motor.torque_constant_nm_per_a *= constant;
        model.motor.inertia_kg_m2 *= inertia;
        model
    };
    let [low, high] = OFF;
    [with(low, low), with(low, high), with(high, low), with(high, high)]
}

/// Speed without a load at the whole supply, less what friction and drop take.
pub(crate) fn greatest_rpm(model: &Model, circuit: &Circuit) -> f64 {
    let lost_v = model.dead_band_v(Direction::Forward, circuit.supply_v);
    speed(&model.motor).dc_gain() * (circuit.supply_v - lost_v).max(0.0) * RPM
}

/// The sketch in closed loop with the motor, through all references.
fn trial(model: &Model, circuit: &Circuit, gains: &OwnLoop, sketch: Sketch, loop_s: f64) -> Tried {
    let mut plant = ModelPlant::new(model.clone());
    let mut state = State::default();
    let lasts_s = LASTS * (loop_s + gains.sample_s).max(lag_s(&model.motor));
    let samples = (lasts_s / gains.sample_s).ceil() as usize;
    let greatest_rpm = greatest_rpm(model, circuit);
    let (mut overshoot_percent, mut error_rpm, mut from_rpm) = (0.0_f64, 0.0_f64, 0.0);
    for share in REFERENCES {
        let to_rpm = share * greatest_rpm;
        let sense = (to_rpm - from_rpm).signum();
        let mut last_rpm = 0.0;
        for sample in 0..samples {
            let counts = (plant.angle_rad() / TAU * circuit.counts_per_rev).floor();
            let pwm = state.output(gains, sketch, to_rpm, counts);
            hold(&mut plant, circuit, pwm, gains.sample_s);
            let rpm = plant.speed_rad_per_s() * RPM;
            // What is left of the step before is no overshoot of this one.
            let beyond = if sample > 0 { sense * (rpm - to_rpm) / (to_rpm - from_rpm).abs() } else { 0.0 };
            overshoot_percent = overshoot_percent.max(100.0 * beyond);
            last_rpm = if 4 * sample > 3 * samples { last_rpm + 4.0 * (rpm - to_rpm) / samples as f64 } else { 0.0 };
        }
        error_rpm = error_rpm.max(last_rpm.abs());
        from_rpm = to_rpm;
    }
    Tried { sketch, overshoot_percent, error_rpm, overshoot_when_off_percent: 0.0 }
}

/// The output is held for a sample time.
pub(crate) fn hold(plant: &mut ModelPlant, circuit: &Circuit, pwm: f64, sample_s: f64) {
    let bridge = match pwm {
        0.0 => Bridge::Brake,
        pwm if pwm > 0.0 => Bridge::Forward,
        _ => Bridge::Reverse,
    };
    let supply_v = circuit.supply_v * pwm.abs() / PWM_FULL;
    plant.advance(sample_s, &Inputs { bridge, supply_v, ..Inputs::default() });
}

/// Memory of a sketch.
#[derive(Default)]
struct State {
    counts: f64,
    integral: f64,
    target_rpm: f64,
}

impl State {
    /// The PWM value, as the sketch computes it from the counts.
    fn output(&mut self, gains: &OwnLoop, sketch: Sketch, reference_rpm: f64, counts: f64) -> f64 {
        let rpm = (counts - std::mem::replace(&mut self.counts, counts)) * gains.count_rpm;
        let before_rpm = self.target_rpm;
        self.target_rpm += (reference_rpm - before_rpm) * (gains.sample_s / gains.loop_s).min(1.0);
        let (error, change) = (self.target_rpm - rpm, (self.target_rpm - before_rpm) / gains.sample_s);
        let [forward, reverse] = gains.dead_band;
        let dead_band = match self.target_rpm {
            target if target > gains.count_rpm => forward,
            target if target < -gains.count_rpm => -reverse,
            _ => 0.0,
        };
        let ahead = gains.kff * self.target_rpm + gains.kaff * change + dead_band;
        let more = gains.ki * gains.sample_s * error;
        sketch.output(&mut self.integral, more, ahead + gains.kp * error)
    }
}

impl OwnLoop {
    /// The lines of a sketch, for a person to copy.
    pub fn code(&self) -> String {
        let Self { sample_s, kp, ki, kff, kaff, loop_s, dead_band: [forward, reverse], count_rpm, .. } = self;
        let follow = (sample_s / loop_s).min(1.0);
        format!(
            "const float SAMPLE_S = {sample_s:.3};  // call pwm() every {:.0} ms
const float KP = {kp:.5}, KI = {ki:.5};  // PWM per rpm, PWM per rpm and s
const float KFF = {kff:.5}, KAFF = {kaff:.6};  // PWM per rpm, per rpm/s
const float DEAD_FWD = {forward:.1}, DEAD_REV = {reverse:.1};  // PWM
const float RPM_PER_COUNT = {count_rpm:.4}, FOLLOW = {follow:.4};

float target = 0, integral = 0;
// counts: since the last call. Returns -255 to 255.
int pwm(float reference_rpm, long counts) {{
  float change = (reference_rpm - target) * FOLLOW;
  target += change;
  float ahead = KFF * target + KAFF * change / SAMPLE_S;
  if (target > RPM_PER_COUNT) ahead += DEAD_FWD;
  if (target < -RPM_PER_COUNT) ahead -= DEAD_REV;
  float error = target - counts * RPM_PER_COUNT;
  float more = KI * SAMPLE_S * error;
  float out = ahead + KP * error + integral + more;
  if (fabs(out) <= 255 || out * more < 0) integral += more;
  return round(constrain(ahead + KP * error + integral, -255, 255));
}}
",
            1e3 * sample_s
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_model::catalogue::effect;

    fn model() -> Model {
        Model::linear(MotorParameters::PIVT6)
            .with(effect("coulomb_friction").unwrap(), vec![0.006])
            .with(effect("voltage_drop").unwrap(), vec![1.5])
    }

    fn asked(bandwidth_hz: f64, sample_s: f64) -> Asked {
        Asked { bandwidth_hz, overshoot_percent: 10.0, sample_s }
    }

    /// At every sample time that a sketch may have, by both ways of computing it.
    #[test]
    fn a_sketch_follows_at_its_sample_time() {
        for sample_s in [0.01, 0.02, 0.05, 0.1] {
            let found = own_loop(&model(), &Bench::default(), &asked(1.0, sample_s)).unwrap();
            assert_eq!(found.tried.len(), 2);
            for tried in &found.tried {
                assert!(tried.overshoot_percent < 15.0 && tried.error_rpm < 40.0, "{sample_s}: {tried:?}");
            }
            assert!(found.code().contains(&format!("KP = {:.5}", found.kp)));
        }
    }

    /// With ten times the gains the trial fails: it would not let a bad loop pass.
    #[test]
    fn a_trial_sees_a_loop_that_swings() {
        let circuit = Circuit { supply_v: 12.0, counts_per_rev: 2000.0, delay_s: 0.0 };
        let good = gains(&model(), &circuit, 0.05, 0.15);
        let swinging = OwnLoop { kp: 10.0 * good.kp, ki: 10.0 * good.ki, ..good.clone() };
        let asked = asked(1.0, 0.05);
        assert!(tried(&model(), &circuit, &good, &asked, 0.15).is_ok());
        let why = tried(&model(), &circuit, &swinging, &asked, 0.15).unwrap_err();
        assert!(why.contains("overshoots") || why.contains("off by"), "{why}");
    }

    /// A faster loop than the sample time allows is made slower, and says so by its bandwidth.
    #[test]
    fn a_loop_is_no_faster_than_its_samples() {
        let found = own_loop(&model(), &Bench::default(), &asked(20.0, 0.05)).unwrap();
        assert!(found.bandwidth_hz < 3.2, "{}", found.bandwidth_hz);
        for (wrong, part) in [(asked(1.0, 0.002), "10 to 100 ms"), (asked(0.0, 0.02), "positive")] {
            let error = own_loop(&model(), &Bench::default(), &wrong).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        let without = Bench { counts_per_rev: None, ..Bench::default() };
        assert_eq!(own_loop(&model(), &without, &asked(1.0, 0.02)).unwrap_err(), OwnLoopError::NoEncoder);
    }

    /// A PI or a PID on the measured speed, at a steady reference, until a load comes on.
    #[derive(Clone, Copy, Debug)]
    struct OnLoad {
        kp: f64,
        ki: f64,
        kd: f64,
        filter_s: f64,
    }

    impl OnLoad {
        /// Mean error after the load has come on, in rpm.
        fn error_rpm(self, model: &Model, counts_per_rev: f64, sample_s: f64) -> f64 {
            let (supply_v, target_rpm) = (12.0, 600.0);
            let load_nm = 0.15 * supply_v / model.motor.resistance_ohm * model.motor.torque_constant_nm_per_a;
            let mut plant = ModelPlant::new(model.clone());
            let (mut counts, mut rpm, mut rate, mut integral) = (0.0, 0.0, 0.0, 0.0_f64);
            let lasts = (1.5 / sample_s) as usize + 10;
            let mut error_sum = 0.0;
            for sample in 0..2 * lasts {
                let now = (plant.angle_rad() / TAU * counts_per_rev).floor();
                let new_rpm = (now - std::mem::replace(&mut counts, now)) * 60.0 / (counts_per_rev * sample_s);
                let raw = (new_rpm - std::mem::replace(&mut rpm, new_rpm)) / sample_s;
                rate += (raw - rate) * sample_s / (self.filter_s + sample_s);
                let error = target_rpm - rpm;
                let more = self.ki * sample_s * error;
                let out = Sketch::Plain.output(&mut integral, more, self.kp * error - self.kd * rate);
                let is_loaded = sample >= lasts;
                let bridge = if out < 0.0 { Bridge::Reverse } else { Bridge::Forward };
                let supply_v = supply_v * out.abs() / PWM_FULL;
                let load_torque_nm = if is_loaded { load_nm } else { 0.0 };
                // What happens between the samples counts as well.
                for _ in 0..4 {
                    plant.advance(sample_s / 4.0, &Inputs { bridge, supply_v, load_torque_nm, ..Inputs::default() });
                    let error_rpm = (plant.speed_rad_per_s() * RPM - target_rpm).abs();
                    error_sum += if is_loaded { error_rpm / 4.0 } else { 0.0 };
                }
            }
            error_sum / lasts as f64
        }

        /// The worst error of all motors.
        fn worst(self, model: &Model, counts_per_rev: f64, sample_s: f64) -> f64 {
            let off = corners(model).map(|model| self.error_rpm(&model, counts_per_rev, sample_s));
            off.into_iter().fold(self.error_rpm(model, counts_per_rev, sample_s), f64::max)
        }
    }

    /// The least of the worst errors, by a PI and by a PID, over their gains.
    fn best(counts_per_rev: f64, sample_s: f64) -> [f64; 2] {
        let circuit = Circuit { supply_v: 12.0, counts_per_rev, delay_s: 0.0 };
        let usual = gains(&model(), &circuit, sample_s, 1.5 * sample_s);
        let [mut pi, mut pid] = [f64::INFINITY; 2];
        for (kp, ki) in [1.0, 1.4, 1.8].into_iter().flat_map(|kp| [1.5, 3.0].map(|ki| (kp * usual.kp, ki * usual.ki))) {
            let worst = |derivative: f64, filter: f64| {
                let kd = derivative * sample_s * kp;
                OnLoad { kp, ki, kd, filter_s: filter * sample_s }.worst(&model(), counts_per_rev, sample_s)
            };
            pi = pi.min(worst(0.0, 0.0));
            for (derivative, filter) in [(0.1, 0.0), (0.25, 0.0), (0.5, 0.0), (0.25, 3.0), (0.5, 3.0)] {
                pid = pid.min(worst(derivative, filter));
            }
        }
        [pi, pid]
    }

    /// A load comes on, and the constants of the motor are up to 30 % off: the best PID is little better than the best PI.
    #[test]
    fn a_derivative_of_the_speed_gains_little() {
        for (counts_per_rev, sample_s) in [(2000.0, 0.02), (400.0, 0.02), (2000.0, 0.1)] {
            let [pi, pid] = best(counts_per_rev, sample_s);
            println!("{counts_per_rev} counts, {sample_s} s: {pi:.2} rpm by a PI, {pid:.2} rpm by a PID");
            assert!(pid > 0.8 * pi, "{counts_per_rev} counts, {sample_s} s: {pi} rpm, {pid} rpm with a derivative");
        }
    }
}

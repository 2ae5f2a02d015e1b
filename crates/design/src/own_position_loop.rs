//! Gains for a position loop in a sketch: a PID with a filter on its derivative. It is for the Arduino PID library,
//! QuickPID or a plain sketch. Position in degrees, output in PWM values from -255 to 255, a sample time of some 10 ms.
//!
//! The gains follow from the motor as an integrator with a lag and a dead time (Skogestad, Journal of Process Control 13
//! (2003)). The derivative cancels the lag. It is filtered so much that one count moves the output by no more than 10 of
//! 255. The target passes a filter with two time constants of the loop, with limits of speed and acceleration that the
//! motor can keep. Friction is compensated with the sign of the speed. The drop of the bridge is compensated with the sign
//! of the current, which changes when the motor brakes. At rest, within the counts, the output is 0, so that integral and
//! friction do not swing about the target.

use crate::Bench;
use crate::own_loop::{Asked, Circuit, OwnLoopError, PWM_FULL, Sketch, checked, corners, greatest_rpm, hold, lag_s};
use crate::own_loop::{MOST_TRIALS, SLOWER};
use host_sim::plant::{ModelPlant, Plant};
use motorbench_model::linear::motor_model::speed;
use motorbench_model::{Direction, Model};
use serde::Serialize;
use std::f64::consts::TAU;

const DEGREES: f64 = 360.0 / TAU;
/// The bandwidth of two equal lags, times one of them and 2 pi: there the gain is down to the half power.
const OF_TWO_LAGS: f64 = 0.6436;
/// What one count may move the output by.
const MOST_JITTER_PWM: f64 = 10.0;
/// Share of the greatest speed that the target moves with: what is left accelerates.
const SPEED_SHARE: f64 = 0.5;
/// From a steady speed the filter of the target brakes with this share of speed over time constant: 1/e.
const BRAKES: f64 = 0.37;
/// Positions that the trial asks for.
const REFERENCES_DEG: [f64; 4] = [180.0, 200.0, -90.0, 0.0];
/// How long each lasts beyond the way: so many time constants of loop and motor.
const LASTS: f64 = 15.0;
/// The motor rests within so many counts of its target.
const REST_COUNTS: f64 = 1.5;
/// An error that counts as none: so many counts, and at least so many degrees.
const ERROR_COUNTS: f64 = 3.0;
const LEAST_ERROR_DEG: f64 = 0.5;
/// Filter of the target: two lags of fewer samples would swing by themselves.
const LEAST_SAMPLES: f64 = 2.0;
/// With the constants off the loop has settled within this share of the greatest way, or so many smallest moves.
const SETTLED_WHEN_OFF: f64 = 0.03;
const MOVES_WHEN_OFF: f64 = 3.0;

/// Gains, and how they did in the trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OwnPositionLoop {
    /// Sample time.
    pub sample_s: f64,
    /// PWM per degree.
    #[serde(rename = "kp_PWM_per_deg")]
    pub kp: f64,
    /// PWM per degree and second.
    #[serde(rename = "ki_PWM_per_deg_s")]
    pub ki: f64,
    /// PWM per degree/s.
    #[serde(rename = "kd_PWM_s_per_deg")]
    pub kd: f64,
    /// Time constant of the derivative's filter.
    pub derivative_filter_s: f64,
    /// Feed-forward, PWM per degree/s.
    #[serde(rename = "kff_PWM_s_per_deg")]
    pub kff: f64,
    /// Feed-forward of the acceleration, PWM per degree/s^2.
    #[serde(rename = "kaff_PWM_s2_per_deg")]
    pub kaff: f64,
    /// Time constant of the loop, and twice that of the filter of its target.
    pub loop_s: f64,
    /// Greatest speed of the target.
    pub most_deg_per_s: f64,
    /// Greatest acceleration of the target.
    pub most_deg_per_s2: f64,
    /// PWM that friction takes, forward and in reverse.
    #[serde(rename = "friction_PWM")]
    pub friction: [f64; 2],
    /// PWM that the bridge takes.
    #[serde(rename = "drop_PWM")]
    pub drop: f64,
    /// One count.
    pub count_deg: f64,
    /// The bandwidth of these gains, at most the one asked for.
    #[serde(rename = "bandwidth_Hz")]
    pub bandwidth_hz: f64,
    /// By each way of computing it.
    pub tried: Vec<PositionTried>,
}

/// A trial in simulation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PositionTried {
    /// How the output was computed.
    pub sketch: Sketch,
    /// Greatest overshoot of all steps.
    pub overshoot_deg: f64,
    /// Greatest error at the end of a step.
    pub error_deg: f64,
    /// Greatest motion in the last quarter of a step.
    pub swing_deg: f64,
    /// Greatest overshoot with the constants of the motor 30 % off.
    pub overshoot_when_off_deg: f64,
    /// Greatest error and swing at the end of a step then.
    pub error_when_off_deg: f64,
}

/// Gains for a position loop of a motor.
///
/// # Errors
/// [`OwnLoopError`] with what to do.
pub fn own_position_loop(model: &Model, bench: &Bench, asked: &Asked) -> Result<OwnPositionLoop, OwnLoopError> {
    let circuit = checked(bench, asked)?;
    let mut loop_s = (OF_TWO_LAGS / (TAU * asked.bandwidth_hz)).max(LEAST_SAMPLES * asked.sample_s);
    let mut why = String::new();
    for _ in 0..MOST_TRIALS {
        let gains = gains(model, &circuit, asked.sample_s, loop_s);
        match tried(model, &circuit, &gains, asked) {
            Ok(tried) => return Ok(OwnPositionLoop { tried, ..gains }),
            Err(failed) => why = failed,
        }
        loop_s *= SLOWER;
    }
    let slowest_hz = SLOWER * OF_TWO_LAGS / (TAU * loop_s);
    Err(OwnLoopError::NoneFollows { sample_ms: 1e3 * asked.sample_s, slowest_hz, why })
}

fn gains(model: &Model, circuit: &Circuit, sample_s: f64, loop_s: f64) -> OwnPositionLoop {
    let Circuit { supply_v, counts_per_rev, delay_s } = *circuit;
    let per_pwm = speed(&model.motor).dc_gain() * DEGREES * supply_v / PWM_FULL;
    let (lag_s, count_deg) = (lag_s(&model.motor), 360.0 / counts_per_rev);
    // Half a sample time from the output that is held, half from the difference of counts, and the filter.
    let of_filter = |filter_s: f64| {
        let slow_s = loop_s + sample_s + delay_s + filter_s;
        (slow_s, 1.0 / (per_pwm * slow_s))
    };
    let filter_of = |gain: f64| (gain * lag_s * count_deg / MOST_JITTER_PWM - sample_s).max(0.0);
    let (mut slow_s, mut gain) = of_filter(0.0);
    // The filter makes the loop slower and with it the derivative smaller: this ends after a few rounds.
    for _ in 0..8 {
        (slow_s, gain) = of_filter(filter_of(gain));
    }
    let derivative_filter_s = filter_of(gain);
    let integral_s = 4.0 * slow_s;
    let drop_v = model.dry_losses().bridge_drop_v;
    let greatest_deg_per_s = 6.0 * greatest_rpm(model, circuit);
    let most_deg_per_s2 = (1.0 - SPEED_SHARE) * greatest_deg_per_s / lag_s;
    OwnPositionLoop {
        sample_s,
        kp: gain * (1.0 + lag_s / integral_s),
        ki: gain / integral_s,
        kd: gain * lag_s,
        derivative_filter_s,
        kff: 1.0 / per_pwm,
        kaff: lag_s / per_pwm,
        loop_s,
        most_deg_per_s: (SPEED_SHARE * greatest_deg_per_s).min(most_deg_per_s2 * loop_s / BRAKES),
        most_deg_per_s2,
        friction: Direction::BOTH.map(|way| (model.dead_band_v(way, supply_v) - drop_v).max(0.0) / supply_v * PWM_FULL),
        drop: drop_v / supply_v * PWM_FULL,
        count_deg,
        bandwidth_hz: OF_TWO_LAGS / (TAU * loop_s),
        tried: Vec::new(),
    }
}

/// Tries the gains in each sketch; the error says what went wrong.
fn tried(
    model: &Model,
    circuit: &Circuit,
    gains: &OwnPositionLoop,
    asked: &Asked,
) -> Result<Vec<PositionTried>, String> {
    // One PWM value more moves the shaft by so much in a sample time.
    let least_move_deg = gains.sample_s / gains.kff;
    let error_deg = (ERROR_COUNTS * gains.count_deg).max(LEAST_ERROR_DEG).max(least_move_deg);
    let [smallest_deg, greatest_deg] = steps_deg();
    let overshoot_deg = (asked.overshoot_percent / 100.0 * smallest_deg).max(error_deg);
    let when_off_deg = (SETTLED_WHEN_OFF * greatest_deg).max(MOVES_WHEN_OFF * error_deg);
    let of_sketch = |sketch: Sketch| {
        let nominal = trial(model, circuit, gains, sketch);
        let off = corners(model).map(|model| trial(&model, circuit, gains, sketch));
        let worst = |of: &dyn Fn(&PositionTried) -> f64| off.iter().map(of).fold(0.0, f64::max);
        let overshoot_when_off_deg = worst(&|off| off.overshoot_deg);
        let error_when_off_deg = worst(&|off| off.error_deg.max(off.swing_deg));
        let tried = PositionTried { overshoot_when_off_deg, error_when_off_deg, ..nominal };
        let refused = |what: &str, value: f64| Err(format!("{what} {value:.1} degrees"));
        match &tried {
            PositionTried { overshoot_deg: over, .. } if *over > overshoot_deg => refused("it overshoots by", *over),
            PositionTried { error_deg: error, .. } if *error > error_deg => refused("at the end it is off by", *error),
            PositionTried { swing_deg: swing, .. } if *swing > 2.0 * error_deg => {
                refused("at the end it swings by", *swing)
            }
            PositionTried { error_when_off_deg: off, .. } if *off > when_off_deg => {
                refused("with the motor's constants 30 % off it is off, or swings, at the end by", *off)
            }
            _ => Ok(tried),
        }
    };
    Sketch::ALL.into_iter().map(of_sketch).collect()
}

/// The smallest and the greatest way of the trial.
fn steps_deg() -> [f64; 2] {
    let from = [0.0].into_iter().chain(REFERENCES_DEG);
    let ways = from.zip(REFERENCES_DEG).map(|(from, to): (f64, f64)| (to - from).abs());
    ways.fold([f64::INFINITY, 0.0], |[least, most], way| [least.min(way), most.max(way)])
}

/// The sketch in closed loop with the motor, through all positions.
fn trial(model: &Model, circuit: &Circuit, gains: &OwnPositionLoop, sketch: Sketch) -> PositionTried {
    let mut plant = ModelPlant::new(model.clone());
    let mut state = State::default();
    let rest_s = LASTS * (gains.loop_s + gains.sample_s).max(lag_s(&model.motor));
    let mut found = PositionTried {
        sketch,
        overshoot_deg: 0.0,
        error_deg: 0.0,
        swing_deg: 0.0,
        overshoot_when_off_deg: 0.0,
        error_when_off_deg: 0.0,
    };
    let mut from_deg = 0.0;
    for to_deg in REFERENCES_DEG {
        let way_deg: f64 = to_deg - from_deg;
        let samples = ((way_deg.abs() / gains.most_deg_per_s + rest_s) / gains.sample_s).ceil() as usize;
        let (mut least_deg, mut most_deg) = (f64::INFINITY, f64::NEG_INFINITY);
        for sample in 0..samples {
            let counts = (plant.angle_rad() / TAU * circuit.counts_per_rev).floor();
            hold(&mut plant, circuit, state.output(gains, sketch, to_deg, counts), gains.sample_s);
            let angle_deg = plant.angle_rad() * DEGREES;
            found.overshoot_deg = found.overshoot_deg.max(way_deg.signum() * (angle_deg - to_deg));
            if 4 * sample > 3 * samples {
                (least_deg, most_deg) = (least_deg.min(angle_deg), most_deg.max(angle_deg));
            }
        }
        found.error_deg = found.error_deg.max((plant.angle_rad() * DEGREES - to_deg).abs());
        found.swing_deg = found.swing_deg.max(most_deg - least_deg);
        from_deg = to_deg;
    }
    found
}

/// Memory of a sketch.
#[derive(Default)]
struct State {
    at_deg: f64,
    speed: f64,
    integral: f64,
    target_deg: f64,
    target_speed: f64,
}

impl State {
    /// The PWM value, as the sketch computes it from the counts.
    fn output(&mut self, gains: &OwnPositionLoop, sketch: Sketch, reference_deg: f64, counts: f64) -> f64 {
        let OwnPositionLoop { sample_s, kp, ki, kd, kff, kaff, loop_s, count_deg, .. } = *gains;
        let at_deg = counts * count_deg;
        let raw = (at_deg - std::mem::replace(&mut self.at_deg, at_deg)) / sample_s;
        // The library has no filter of its derivative.
        let filter_s = if sketch == Sketch::Library { 0.0 } else { gains.derivative_filter_s };
        self.speed += (raw - self.speed) * sample_s / (filter_s + sample_s);
        let follow = 1.0 / loop_s.max(sample_s);
        let wanted = ((reference_deg - self.target_deg) * follow - 2.0 * self.target_speed) * follow;
        let before = self.target_speed;
        let change = wanted.clamp(-gains.most_deg_per_s2, gains.most_deg_per_s2) * sample_s;
        self.target_speed = (before + change).clamp(-gains.most_deg_per_s, gains.most_deg_per_s);
        self.target_deg += self.target_speed * sample_s;
        let error = self.target_deg - at_deg;
        let count_speed = count_deg / sample_s;
        let moves = self.target_speed.abs() > count_speed.min(gains.most_deg_per_s / 10.0);
        if !moves && (reference_deg - at_deg).abs() <= REST_COUNTS * count_deg {
            return 0.0;
        }
        let [forward, reverse] = gains.friction;
        let way = if moves { self.target_speed } else { error };
        // The drop of the bridge has the sense of the current: what accelerates, and what friction takes.
        let accelerates = kaff * (self.target_speed - before) / sample_s;
        let torque = accelerates + if way > 0.0 { forward } else { -reverse };
        let drop = if moves { gains.drop.copysign(torque) } else { gains.drop.copysign(error) };
        let ahead = kff * self.target_speed + torque + drop;
        let more = ki * sample_s * error;
        let without = ahead + kp * error + kd * (self.target_speed - self.speed);
        sketch.output(&mut self.integral, more, without)
    }
}

impl OwnPositionLoop {
    /// The lines of a sketch, for a person to copy.
    pub fn code(&self) -> String {
        let Self { sample_s, kp, ki, kd, kff, kaff, loop_s, friction: [forward, reverse], drop, count_deg, .. } = self;
        let follow = 1.0 / loop_s.max(*sample_s);
        let smooth = sample_s / (self.derivative_filter_s + sample_s);
        let moving = (count_deg / sample_s).min(self.most_deg_per_s / 10.0);
        format!(
            "const float SAMPLE_S = {sample_s:.3};  // call pwm() every {:.0} ms
const float KP = {kp:.5}, KI = {ki:.5}, KD = {kd:.6};  // per deg, deg s, deg/s
const float SMOOTH = {smooth:.4};  // filter of the derivative
const float KFF = {kff:.6}, KAFF = {kaff:.7};  // PWM per deg/s, per deg/s^2
const float FRICTION_FWD = {forward:.1}, FRICTION_REV = {reverse:.1}, DROP = {drop:.1};  // PWM
const float DEG_PER_COUNT = {count_deg:.5}, FOLLOW = {follow:.4};
const float MOST_SPEED = {:.1}, MOST_ACCEL = {:.0};  // deg/s, deg/s^2
const float MOVING = {moving:.3};  // deg/s

float at = 0, speed = 0, target = 0, targetSpeed = 0, integral = 0;
// counts: since the start. Returns -255 to 255; at 0 brake.
int pwm(float reference_deg, long counts) {{
  float now = counts * DEG_PER_COUNT;
  speed += ((now - at) / SAMPLE_S - speed) * SMOOTH;
  at = now;
  float accel = ((reference_deg - target) * FOLLOW - 2 * targetSpeed) * FOLLOW;
  float before = targetSpeed;
  targetSpeed += constrain(accel, -MOST_ACCEL, MOST_ACCEL) * SAMPLE_S;
  targetSpeed = constrain(targetSpeed, -MOST_SPEED, MOST_SPEED);
  target += targetSpeed * SAMPLE_S;
  float error = target - at;
  bool moves = fabs(targetSpeed) > MOVING;
  if (!moves && fabs(reference_deg - at) <= {REST_COUNTS} * DEG_PER_COUNT) return 0;
  float torque = KAFF * (targetSpeed - before) / SAMPLE_S;
  torque += (moves ? targetSpeed : error) > 0 ? FRICTION_FWD : -FRICTION_REV;
  float ahead = KFF * targetSpeed + torque;
  ahead += (moves ? torque : error) > 0 ? DROP : -DROP;
  float more = KI * SAMPLE_S * error;
  float without = ahead + KP * error + KD * (targetSpeed - speed);
  float out = without + integral + more;
  if (fabs(out) <= 255 || out * more < 0) integral += more;
  return round(constrain(without + integral, -255, 255));
}}
",
            1e3 * sample_s,
            self.most_deg_per_s,
            self.most_deg_per_s2,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;

    fn model() -> Model {
        Model::linear(MotorParameters::PIVT6)
            .with(effect("coulomb_friction").unwrap(), vec![0.006])
            .with(effect("voltage_drop").unwrap(), vec![1.5])
    }

    fn asked(bandwidth_hz: f64, sample_s: f64) -> Asked {
        Asked { bandwidth_hz, overshoot_percent: 10.0, sample_s }
    }

    /// It arrives, and rests there, at every sample time that a sketch may have.
    #[test]
    fn a_sketch_positions_at_its_sample_time() {
        for sample_s in [0.01, 0.02, 0.05, 0.1] {
            let found = own_position_loop(&model(), &Bench::default(), &asked(1.0, sample_s)).unwrap();
            assert!(found.kd > 0.0 && found.bandwidth_hz > 0.3, "{sample_s}: {found:?}");
            // The smallest move is one PWM value for one sample time.
            let least_deg = (sample_s / found.kff).max(0.55);
            for tried in &found.tried {
                assert!(tried.error_deg < 1.01 * least_deg && tried.overshoot_deg < 4.0, "{sample_s}: {tried:?}");
            }
            assert!(found.code().contains(&format!("KD = {:.6}", found.kd)));
        }
    }

    /// With few counts the derivative is filtered, so that one count does not shake the output.
    #[test]
    fn few_counts_need_a_filter() {
        let mut heavy = model();
        heavy.motor.inertia_kg_m2 *= 10.0;
        let circuit = |counts_per_rev: f64| Circuit { supply_v: 12.0, counts_per_rev, delay_s: 0.0 };
        let of_counts = |counts: f64| gains(&heavy, &circuit(counts), 0.01, 0.05);
        let (few, many) = (of_counts(24.0), of_counts(8192.0));
        assert!(many.derivative_filter_s == 0.0 && few.derivative_filter_s > 0.01, "{few:?}");
        let jitter = few.kd * few.count_deg / (few.sample_s + few.derivative_filter_s);
        assert!(jitter < 1.01 * MOST_JITTER_PWM, "{jitter}");
    }

    /// With forty times the gains the trial fails: it would not let a bad loop pass.
    #[test]
    fn a_trial_sees_a_position_that_swings() {
        let circuit = Circuit { supply_v: 12.0, counts_per_rev: 2000.0, delay_s: 0.0 };
        let good = gains(&model(), &circuit, 0.02, 0.15);
        let swinging = OwnPositionLoop { kp: 40.0 * good.kp, kd: 40.0 * good.kd, ..good.clone() };
        assert!(tried(&model(), &circuit, &good, &asked(1.0, 0.02)).is_ok());
        let why = tried(&model(), &circuit, &swinging, &asked(1.0, 0.02)).unwrap_err();
        assert!(why.contains("overshoots") || why.contains("swings") || why.contains("off by"), "{why}");
    }
}

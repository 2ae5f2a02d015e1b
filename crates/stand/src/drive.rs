//! Drives a board as a test stand. It goes through voltages under each load, waits for each steady state, and averages.
//! It also measures the winding, with the rotor held at several positions or turned slowly.
//!
//! The data decide when a state is steady. Two windows of whole revolutions are compared: the last one, and the one
//! half as long after the change. They must agree in speed and current within their scatter and a small share.
//!
//! Two successive windows would agree in the end however slowly a motor settles. An exponential that does not change
//! while the time doubles has settled.
//!
//! The resistance of a held winding is the slope of the voltage over the current. The offset of that line is the
//! voltage drop of bridge and brushes.

mod creep;

use motorbench_core::HARDWARE;
use motorbench_core::message::{Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::names::setting_name;
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::{NominalMotor, Timing};
use motorbench_data::telemetry;
use motorbench_diagnosis::diagnose::outcome::Estimate;
use motorbench_diagnosis::steady_state::{Errors, Line, hardly_turns};
use motorbench_link::board::{Board, BoardError, arm, leave_host, untripped, watch_host};
use motorbench_link::record::Ended;
use motorbench_model::pwm_period::{Ripple, Volts};
use motorbench_report::diagnosis_text::estimate;
use serde::Serialize;
use std::f64::consts::TAU;

/// Interval at which the telemetry is fetched.
const SLICE_S: f64 = 0.02;
/// If so many intervals (five seconds) have no sample, the board is gone. A busy computer may delay a simulated board
/// for some of them.
const SILENT_SLICES: u32 = 250;
/// Slew limit while the stand drives: gentle steps.
const SLEW_V_PER_S: f32 = 50.0;

/// Shortest window, and the longest time to complete a revolution.
const WINDOW_S: f64 = 0.2;
const LONGEST_WINDOW_S: f64 = 1.0;
/// Windows of a held rotor: only the current has to settle.
const HELD_WINDOW_S: f64 = 0.05;
/// Two windows agree if they differ by less than this share, besides their scatter.
const STEADY_SHARE: f64 = 2e-3;
const STEADY_SIGMAS: f64 = 3.0;
/// A level that is not steady after this long is left out.
const PATIENCE_S: f64 = 20.0;

/// Largest current of the winding test as a share of the smallest current limit, and number of its voltage steps.
const HELD_SHARE: f64 = 0.8;
const HELD_STEPS: f64 = 8.0;
/// Smallest current of the line as a share of the largest. Below it friction of the hand and the kink of the drop
/// disturb.
const HELD_LEAST_SHARE: f64 = 0.3;
/// A held rotor may turn by this angle.
const HELD_YIELDS_REV: f64 = 0.01;
/// Smallest error of a mean current. The steps of the converter make means that scatter less than their error.
const LEAST_CURRENT_ERROR_A: f64 = 1e-4;
/// Fewest points of a line with an error.
const FEWEST_POINTS: usize = 4;

/// The plan of a test.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Voltages in the order of measurement.
    pub voltages_v: Vec<f64>,
    /// Torques of a brake, each for all voltages. If empty, the brake is not used.
    pub loads_nm: Vec<f64>,
    /// Averages at each.
    pub readings: usize,
    /// Rotor positions of the winding test.
    pub positions: usize,
    /// Sectors in which the winding is measured while the rotor turns slowly.
    pub sectors: usize,
}

/// The operator at the motor.
pub trait Operator {
    /// Whether the operator wants the motor stopped.
    fn stops(&mut self) -> bool;

    /// Shows the progress.
    fn hears(&mut self, line: &str);

    /// Asks for an action.
    fn is_asked(&mut self, request: &str);

    /// Whether the operator has done it (true) or refused (false); `None` while there is no answer.
    fn answers(&mut self) -> Option<bool>;

    /// Sets the brake automatically if there is such a device. Otherwise the operator is asked.
    ///
    /// # Errors
    /// Why it cannot, with what to do.
    fn brakes(&mut self, _torque_nm: f64) -> Result<bool, String> {
        Ok(false)
    }
}

/// ResultSink each result as soon as it is measured. An error says why it could not, and ends the test.
pub type ResultSink<'a> = &'a mut dyn FnMut(Found) -> Result<(), String>;

/// A new result.
#[derive(Clone, Copy, Debug)]
pub enum Found<'a> {
    /// Rows of the table.
    Readings(&'a [Reading]),
    /// The winding at some positions.
    Positions(&'a [HeldPosition]),
}

/// Averages of one window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct Reading {
    /// Mean voltage of the bridge.
    pub u_V: f64,
    /// Mean current.
    pub i_A: f64,
    /// Mean speed, by the counts where there is an encoder.
    pub omega_rad_per_s: f64,
    /// Torque of the brake against positive rotation, as it was stated.
    pub load_Nm: f64,
}

/// The winding at one position of the rotor.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct HeldPosition {
    /// Where the rotor was, 0 to 360.
    pub angle_deg: f64,
    /// Slope of the voltage over the current.
    pub resistance_ohm: Estimate,
    /// Voltage at no current: the drop of bridge and brushes.
    pub drop_V: f64,
}

/// The results, however the test ended.
#[derive(Clone, Debug)]
pub struct Findings {
    /// Rows of the table.
    pub readings: Vec<Reading>,
    /// The winding test.
    pub positions: Vec<HeldPosition>,
    /// Parts that were left out because nobody answered.
    pub left_out: Vec<&'static str>,
    /// How it ended.
    pub ended: Ended,
}

/// Rows as a table of steady states; `loaded`: with the load as a column.
pub fn table(name: &str, readings: &[Reading], loaded: bool) -> Recording {
    let column = |of: &dyn Fn(&Reading) -> f64| readings.iter().map(of).collect::<Vec<f64>>();
    let mut table = Recording::new(name);
    table.set(Channel::Voltage, column(&|reading| reading.u_V));
    table.set(Channel::Speed, column(&|reading| reading.omega_rad_per_s));
    table.set(Channel::Current, column(&|reading| reading.i_A));
    if loaded {
        table.set(Channel::LoadTorque, column(&|reading| reading.load_Nm));
    }
    table
}

/// Carries out a plan on a board. `settings`: those of the board. They are restored afterwards, with the drive
/// disarmed. With a nominal inductance the mean current is computed from its sampling time in the PWM period.
pub fn drive(
    board: &mut impl Board,
    settings: &Settings,
    motor: &NominalMotor,
    plan: &Plan,
    person: &mut impl Operator,
    keeps: ResultSink,
) -> Findings {
    let mut findings =
        Findings { readings: Vec::new(), positions: Vec::new(), left_out: Vec::new(), ended: Ended::Complete };
    let mut driver = Driver { board, settings, motor, person, keeps, load_nm: 0.0, waiting: Vec::new(), silent: 0 };
    let done = driver.prepare().and_then(|()| driver.run(plan, &mut findings));
    let off = driver.restore();
    findings.ended = match done.and(off.map_err(Ended::from)) {
        Ok(()) => Ended::Complete,
        Err(ended) => ended,
    };
    findings
}

/// Mean values of a stretch of telemetry.
struct Window {
    reading: Reading,
    /// Standard error of the current.
    current_error_a: f64,
    /// One count over the window.
    speed_step: f64,
    /// Position at its end.
    counts: i32,
}

/// Result of waiting for a steady state.
enum Settled {
    Steady(Window),
    /// Still changing at the end of the waiting time: the window at half the time, and the last.
    Drifting(Window, Window),
}

struct Driver<'a, B: Board, P: Operator> {
    board: &'a mut B,
    settings: &'a Settings,
    motor: &'a NominalMotor,
    person: &'a mut P,
    keeps: ResultSink<'a>,
    /// Torque of the brake.
    load_nm: f64,
    /// Samples of the next window that have come already.
    waiting: Vec<Sample>,
    silent: u32,
}

impl<B: Board, P: Operator> Driver<'_, B, P> {
    fn set(&mut self, param: Param, value: f32) -> Result<(), Ended> {
        Ok(self.board.command(&format!("set {} {value}", setting_name(param)))?)
    }

    fn prepare(&mut self) -> Result<(), Ended> {
        self.board.command("disarm")?;
        // The current sensor's offset drifts with its temperature.
        self.board.command("zero current")?;
        // A motor that sticks behind a bridge with a voltage drop resembles a silent encoder.
        self.set(Param::TripEncoder, 0.0)?;
        self.set(Param::SlewLimit, SLEW_V_PER_S)?;
        Ok(watch_host(self.board, self.settings)?)
    }

    /// Opens the brake, switches the drive off and restores the board's settings.
    fn restore(&mut self) -> Result<(), BoardError> {
        if self.load_nm > 0.0
            && let Err(why) = self.person.brakes(0.0)
        {
            self.person.hears(&why);
        }
        leave_host(self.board, self.settings)?;
        for param in [Param::SlewLimit, Param::TripStall, Param::TripEncoder] {
            self.board.command(&format!("set {} {}", setting_name(param), self.settings.get(param)))?;
        }
        Ok(())
    }

    fn run(&mut self, plan: &Plan, findings: &mut Findings) -> Result<(), Ended> {
        if plan.loads_nm.is_empty() {
            self.levels(plan, findings)?;
        }
        for &load_nm in &plan.loads_nm {
            if !self.is_braked(load_nm)? {
                self.leaves_out("the other loads", findings);
                break;
            }
            self.levels(plan, findings)?;
        }
        for index in 0..plan.positions {
            let request =
                format!("position {} of {}: turn the rotor on, hold it, press Enter", index + 1, plan.positions);
            let Some(position) = self.position(&request)? else {
                self.leaves_out("the other positions", findings);
                break;
            };
            self.keep_positions(vec![position], findings)?;
        }
        if plan.sectors > 0 {
            self.creep(plan.sectors, findings)?;
        }
        Ok(())
    }

    fn leaves_out(&mut self, what: &'static str, findings: &mut Findings) {
        self.person.hears(&format!("nobody answers: {what} are left out"));
        findings.left_out.push(what);
    }

    /// Sets a load for all that follows; false if nobody sets it.
    fn is_braked(&mut self, load_nm: f64) -> Result<bool, Ended> {
        self.load_nm = load_nm;
        let braked = self.person.brakes(load_nm).map_err(Ended::Failed)?;
        if braked {
            self.person.hears(&format!("the brake is set to {load_nm} Nm"));
        }
        Ok(braked || self.is_done(&format!("set the brake to {load_nm} Nm, press Enter"))?)
    }

    /// All voltages, one after another.
    fn levels(&mut self, plan: &Plan, findings: &mut Findings) -> Result<(), Ended> {
        if !plan.voltages_v.is_empty() {
            self.arm()?;
        }
        for (index, &voltage_v) in plan.voltages_v.iter().enumerate() {
            if index > 0 && (voltage_v < 0.0) != (plan.voltages_v[index - 1] < 0.0) {
                // A reversal at speed would draw more than the stall current.
                self.board.command("ref 0")?;
                self.settle(WINDOW_S, LONGEST_WINDOW_S)?;
            }
            match self.level(voltage_v, plan.readings, findings) {
                Err(Ended::Tripped(Trip::Stall)) if self.load_nm > 0.0 => {
                    self.person.hears(&format!("{voltage_v:6.2} V: left out, the load stalls the motor"));
                    self.board.command("disarm")?;
                    self.board.command("clear")?;
                    self.arm()?;
                }
                done => done?,
            }
        }
        Ok(self.board.command("disarm")?)
    }

    fn keep_positions(&mut self, positions: Vec<HeldPosition>, findings: &mut Findings) -> Result<(), Ended> {
        let kept = (self.keeps)(Found::Positions(&positions));
        findings.positions.extend(positions);
        kept.map_err(Ended::Failed)
    }

    fn arm(&mut self) -> Result<(), Ended> {
        arm(self.board)?;
        self.board.command("mode open")?;
        self.waiting.clear();
        Ok(self.board.samples(0.0).map(|_| ())?)
    }

    fn level(&mut self, voltage_v: f64, readings: usize, findings: &mut Findings) -> Result<(), Ended> {
        self.board.command(&format!("ref {voltage_v}"))?;
        let line = match self.settle(WINDOW_S, LONGEST_WINDOW_S)? {
            Settled::Drifting(before, now) => {
                format!("{voltage_v:6.2} V: left out, not steady after {PATIENCE_S} s: {}", now.change_since(&before))
            }
            Settled::Steady(Window { reading, .. }) if self.stands(&reading) => {
                if let Some(slower) =
                    findings.readings.iter().find(|slower| slower.turned_below(voltage_v, self.load_nm))
                {
                    return Err(Ended::Failed(format!(
                        "no motion at {voltage_v} V, though the motor turned at {:.2} V: check the cable of the encoder and the shaft",
                        slower.u_V
                    )));
                }
                format!("{voltage_v:6.2} V: left out, the motor does not turn")
            }
            Settled::Steady(settled) => self.averages(voltage_v, readings, &settled, findings)?,
        };
        self.person.hears(&line);
        Ok(())
    }

    /// Averages that agree with the settled state; otherwise the level is left out. By chance a few levels of a
    /// thousand disagree, so they are measured again. A drifting level disagrees twice.
    fn averages(
        &mut self,
        voltage_v: f64,
        readings: usize,
        settled: &Window,
        findings: &mut Findings,
    ) -> Result<String, Ended> {
        let mut taken = self.windows(readings)?;
        if !taken.iter().all(|window| window.agrees(settled)) {
            taken = self.windows(readings)?;
        }
        if let Some(other) = taken.iter().find(|window| !window.agrees(settled)) {
            let change = other.change_since(settled);
            return Ok(format!("{voltage_v:6.2} V: left out, it did not stay steady: {change}"));
        }
        let readings: Vec<Reading> = taken.iter().map(|window| window.reading).collect();
        findings.readings.extend(&readings);
        (self.keeps)(Found::Readings(&readings)).map_err(Ended::Failed)?;
        let Reading { i_A, omega_rad_per_s, .. } = settled.reading;
        Ok(format!("{voltage_v:6.2} V: {i_A:8.4} A {omega_rad_per_s:8.2} rad/s"))
    }

    fn windows(&mut self, count: usize) -> Result<Vec<Window>, Ended> {
        (0..count).map(|_| self.window(WINDOW_S, LONGEST_WINDOW_S)).collect()
    }

    fn stands(&self, reading: &Reading) -> bool {
        let k = self.motor.torque_constant_nm_per_a.unwrap_or(0.0);
        hardly_turns(reading.u_V, k * reading.omega_rad_per_s)
    }

    /// Asks until the rotor is held; `None` if the operator refuses.
    fn position(&mut self, request: &str) -> Result<Option<HeldPosition>, Ended> {
        let mut request = request.to_owned();
        loop {
            if !self.is_done(&request)? {
                return Ok(None);
            }
            match self.held_points()? {
                Held::Line(points, counts) => match self.fitted(&points, counts) {
                    Some(position) => {
                        self.person.hears(&format!(
                            "{:6.1} deg: {} ohm, {:.2} V at no current; let go",
                            position.angle_deg,
                            estimate(&position.resistance_ohm),
                            position.drop_V
                        ));
                        return Ok(Some(position));
                    }
                    None => request = "too little current flowed for a line: check the leads, then press Enter".into(),
                },
                Held::Turned => request = "the rotor turned: hold it tighter, then press Enter".into(),
            }
        }
    }

    /// Waits for the operator, without drive.
    fn is_done(&mut self, request: &str) -> Result<bool, Ended> {
        self.person.is_asked(request);
        loop {
            if let Some(answer) = self.person.answers() {
                return Ok(answer);
            }
            self.slice()?;
        }
    }

    /// Raises the voltage step by step until enough current flows; one point a step.
    fn held_points(&mut self) -> Result<Held, Ended> {
        // A held motor is expected here.
        self.set(Param::TripStall, 0.0)?;
        self.arm()?;
        let most_a = self.held_current_a();
        let resistance = self.motor.resistance_ohm.unwrap_or(f64::from(self.settings.get(Param::Resistance)));
        let step_v = most_a * resistance / HELD_STEPS;
        let limit_v = f64::from(self.settings.get(Param::VoltageLimit));
        let yields = HELD_YIELDS_REV * f64::from(self.settings.get(Param::CountsPerRev));
        let (mut points, mut start, mut turned) = (Vec::new(), None, false);
        let mut voltage_v = step_v;
        while voltage_v <= limit_v && !turned {
            self.board.command(&format!("ref {voltage_v:.3}"))?;
            let (Settled::Steady(window) | Settled::Drifting(_, window)) = self.settle(HELD_WINDOW_S, HELD_WINDOW_S)?;
            let start = *start.get_or_insert(window.counts);
            turned = f64::from(window.counts.wrapping_sub(start).unsigned_abs()) > yields;
            let enough = window.reading.i_A >= most_a;
            points.push(window);
            if enough {
                break;
            }
            voltage_v += step_v;
        }
        self.board.command("disarm")?;
        self.set(Param::TripStall, self.settings.get(Param::TripStall))?;
        let counts = start.unwrap_or(0);
        Ok(if turned { Held::Turned } else { Held::Line(points, counts) })
    }

    /// Limits that neither reduce the voltage nor trip.
    fn held_current_a(&self) -> f64 {
        let limits =
            [Param::TripContinuous, Param::TripPeak, Param::CurrentLimit].map(|param| self.settings.get(param));
        HELD_SHARE * f64::from(limits.into_iter().filter(|limit| *limit > 0.0).fold(f32::INFINITY, f32::min))
    }

    /// The line through the points of one position.
    fn fitted(&self, points: &[Window], counts: i32) -> Option<HeldPosition> {
        let most_a = points.iter().map(|point| point.reading.i_A).fold(0.0, f64::max);
        let points: Vec<&Window> =
            points.iter().filter(|point| point.reading.i_A > HELD_LEAST_SHARE * most_a).collect();
        if points.len() < FEWEST_POINTS {
            return None;
        }
        let column = |of: &dyn Fn(&Window) -> f64| points.iter().map(|point| of(point)).collect::<Vec<f64>>();
        let resistance = self.motor.resistance_ohm.unwrap_or(f64::from(self.settings.get(Param::Resistance)));
        let errors = column(&|point| resistance * point.current_error_a.max(LEAST_CURRENT_ERROR_A));
        let (constant, current) = (vec![1.0; points.len()], column(&|point| point.reading.i_A));
        let line = Line::new(&[&constant, &current], &column(&|point| point.reading.u_V), &Errors::AtLeast(errors))?;
        let rev = f64::from(self.settings.get(Param::CountsPerRev));
        Some(HeldPosition {
            angle_deg: 360.0 * (f64::from(counts) / rev).rem_euclid(1.0),
            resistance_ohm: line.estimate(1),
            drop_V: line.values[0],
        })
    }

    /// Waits until a window agrees with the one half as long after the change.
    fn settle(&mut self, shortest_s: f64, longest_s: f64) -> Result<Settled, Ended> {
        let mut windows = vec![self.window(shortest_s, longest_s)?];
        loop {
            let now = self.window(shortest_s, longest_s)?;
            let half = (windows.len() - 1) / 2;
            if now.agrees(&windows[half]) {
                return Ok(Settled::Steady(now));
            }
            if windows.len() as f64 * shortest_s > PATIENCE_S {
                return Ok(Settled::Drifting(windows.swap_remove(half), now));
            }
            windows.push(now);
        }
    }

    /// The next samples until a revolution is complete: variations over the angle cancel.
    fn window(&mut self, shortest_s: f64, longest_s: f64) -> Result<Window, Ended> {
        let rate_hz = f64::from(self.settings.get(Param::TickRate));
        let rev = self.settings.get(Param::CountsPerRev) as i32;
        let mut samples = std::mem::take(&mut self.waiting);
        let mut seen = 1;
        loop {
            while seen < samples.len() {
                let (first, last) = (samples[0], samples[seen]);
                let turns = |sample: Sample| sample.counts.wrapping_sub(first.counts) / rev.max(1);
                let lasted_s = f64::from(last.tick.wrapping_sub(first.tick)) / rate_hz;
                let whole = turns(last) != turns(samples[seen - 1]);
                seen += 1;
                if lasted_s >= longest_s || lasted_s >= shortest_s && whole {
                    // The last sample of a window is the first of the next.
                    self.waiting = samples[seen - 1..].to_vec();
                    samples.truncate(seen);
                    return Ok(self.averaged(&samples));
                }
            }
            samples.extend(self.slice()?);
        }
    }

    /// Waits and reads samples, and keeps the board alive.
    fn slice(&mut self) -> Result<Vec<Sample>, Ended> {
        if self.person.stops() {
            return Err(Ended::Interrupted);
        }
        self.board.stay_alive()?;
        let samples = untripped(self.board.samples(SLICE_S)?)?;
        self.silent = if samples.is_empty() { self.silent + 1 } else { 0 };
        if self.silent > SILENT_SLICES {
            return Err(BoardError::NoTelemetry.into());
        }
        Ok(samples)
    }

    fn averaged(&self, samples: &[Sample]) -> Window {
        let recording = telemetry::recording("stand", samples, self.settings);
        let values = |channel| recording.get(channel).unwrap_or_default();
        // Readings of one tick are means since the previous tick. The first one belongs to the previous window.
        let mean = |values: &[f64]| values[1..].iter().sum::<f64>() / (values.len() - 1) as f64;
        let (currents, time_s) = (values(Channel::Current), values(Channel::Time));
        let (duty, u_v, i_a) = (mean(values(Channel::Duty)), mean(values(Channel::Voltage)), mean(currents));
        let (first, last) = (samples[0], samples[samples.len() - 1]);
        let lasted_s = time_s[time_s.len() - 1];
        let speed_step = TAU / f64::from(self.settings.get(Param::CountsPerRev)) / lasted_s;
        let omega = if self.settings.get(Param::SpeedSensor) == 0.0 {
            speed_step * f64::from(last.counts.wrapping_sub(first.counts))
        } else {
            mean(values(Channel::Speed))
        };
        let scatter = currents[1..].iter().map(|value| (value - i_a).powi(2)).sum::<f64>();
        let count = (currents.len() - 1) as f64;
        Window {
            reading: Reading {
                // Rounded to the microvolt as in the table, so that both print the same.
                u_V: (u_v * 1e6).round() / 1e6,
                i_A: i_a - self.sampled_above_mean_a(duty, u_v),
                omega_rad_per_s: omega,
                // A brake acts against the motion.
                load_Nm: if duty < 0.0 { 0.0 - self.load_nm } else { self.load_nm },
            },
            current_error_a: (scatter / count).sqrt() / count.sqrt(),
            speed_step,
            counts: last.counts,
        }
    }

    /// Current at its sampling time in the PWM period, less its mean. If the off phase coasts, it is unknown.
    fn sampled_above_mean_a(&self, duty: f64, voltage_v: f64) -> f64 {
        let resistance_ohm = self.motor.resistance_ohm.unwrap_or(0.0);
        match (self.motor.inductance_h, Timing::FIRMWARE.current_sampled_at) {
            (Some(inductance_h), Some(at)) if self.settings.get(Param::Wiring) == 0.0 && duty != 0.0 => {
                let volts = Volts { mean_v: voltage_v, emf_v: 0.0, lost_v: 0.0, drops_v: [0.0, 0.0] };
                Ripple::new(inductance_h, resistance_ohm, f64::from(HARDWARE.pwm_hz))
                    .with_duty(duty)
                    .sampled_a(0.0, at, &volts)
            }
            _ => 0.0,
        }
    }
}

/// Result of a voltage staircase with a held rotor.
enum Held {
    /// Points, and the counts of the rotor's position.
    Line(Vec<Window>, i32),
    Turned,
}

impl Reading {
    /// Whether it was measured in the same direction at a lower voltage, under at least this load.
    fn turned_below(&self, voltage_v: f64, load_nm: f64) -> bool {
        self.u_V * voltage_v > 0.0 && self.u_V.abs() < voltage_v.abs() && self.load_Nm.abs() >= load_nm
    }
}

impl Window {
    /// The change as text.
    fn change_since(&self, before: &Self) -> String {
        let (now, then) = (&self.reading, &before.reading);
        format!(
            "speed went from {:.2} to {:.2} rad/s, current from {:.4} to {:.4} A",
            then.omega_rad_per_s, now.omega_rad_per_s, then.i_A, now.i_A
        )
    }

    fn agrees(&self, before: &Self) -> bool {
        let (now, then) = (&self.reading, &before.reading);
        let current_error = self.current_error_a.hypot(before.current_error_a);
        let speed = STEADY_SHARE * now.omega_rad_per_s.abs() + self.speed_step + before.speed_step;
        let current = STEADY_SHARE * now.i_A.abs() + STEADY_SIGMAS * current_error;
        (now.omega_rad_per_s - then.omega_rad_per_s).abs() <= speed && (now.i_A - then.i_A).abs() <= current
    }
}

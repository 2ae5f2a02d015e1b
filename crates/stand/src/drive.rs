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
mod winding;
mod window;

use motorbench_core::message::{Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_data::names::setting_name;
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::rig::NominalMotor;
use motorbench_diagnosis::diagnose::outcome::Estimate;
use motorbench_diagnosis::steady_state::hardly_turns;
use motorbench_link::board::{Board, BoardError, arm, leave_host, untripped, watch_host};
use motorbench_link::record::Ended;
use serde::Serialize;
use window::{Settled, Window};

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
/// A level that is not steady after this long is left out.
const PATIENCE_S: f64 = 20.0;

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
}

impl Reading {
    /// Whether it was measured in the same direction at a lower voltage, under at least this load.
    fn turned_below(&self, voltage_v: f64, load_nm: f64) -> bool {
        self.u_V * voltage_v > 0.0 && self.u_V.abs() < voltage_v.abs() && self.load_Nm.abs() >= load_nm
    }
}

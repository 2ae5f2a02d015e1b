//! The stand on the real firmware. Given an Uno with a motor of known constants, the measurements obey these constants.
//! A slow motor is waited for. A trip, Ctrl-C and a loose grip lose nothing.

use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters};
use motorbench_chip::{Bench, ChipBoard, Rig, firmware_elf};
use motorbench_core::message::{Sample, Trip};
use motorbench_core::settings::Settings;
use motorbench_core::units::AMPERE;
use motorbench_data::rig::NominalMotor;
use motorbench_link::board::{Board, BoardError};
use motorbench_link::record::Ended;
use motorbench_stand::drive::{Findings, Found, Operator, Plan, drive};
use std::cell::Cell;
use std::ops::Range;
use std::rc::Rc;

const MOTOR: DcMotorParameters = DcMotorParameters { coulomb_friction_nm: 0.012, ..DcMotorParameters::PIVT6 };
const BRIDGE: BridgeLosses = BridgeLosses::L293D;
/// Torque of the hands that turn the rotor.
const HAND_NM: f64 = 0.03;
/// Amount by which a disturbed current reads too high.
const DISTURBANCE: i16 = (0.05 * AMPERE) as i16;

/// Action of the hands at the shaft.
#[derive(Clone, Copy, Default, PartialEq)]
enum Hands {
    #[default]
    Off,
    Turn,
    Hold,
}

/// A board with an operator.
struct Attended<'a> {
    chip: ChipBoard<DcMotor>,
    hands: &'a Cell<Hands>,
    /// Action at the shaft while it turns forwards.
    brake_nm: Rc<Cell<f64>>,
    /// Ticks in which the current reads too high.
    disturbed: Range<u32>,
    last_tick: u32,
}

impl<'a> Attended<'a> {
    fn new(motor: DcMotorParameters, hands: &'a Cell<Hands>) -> Self {
        let elf = firmware_elf().expect("firmware");
        let bench = Bench::new(elf, Rig::default(), DcMotor::new(motor)).expect("bench");
        Self {
            chip: ChipBoard::start(bench).expect("the firmware starts"),
            hands,
            brake_nm: Rc::default(),
            disturbed: 0..0,
            last_tick: 0,
        }
    }

    fn drive(&mut self, plan: &Plan, person: &mut Fellow) -> Findings {
        let nominal = NominalMotor {
            resistance_ohm: Some(MOTOR.resistance_ohm),
            inductance_h: Some(MOTOR.inductance_h),
            torque_constant_nm_per_a: Some(MOTOR.torque_constant_nm_per_a),
            ..NominalMotor::default()
        };
        let (mut readings, mut positions) = (Vec::new(), 0);
        let findings = drive(self, &Settings::defaults(), &nominal, plan, person, &mut |found| {
            match found {
                Found::Readings(new) => readings.extend_from_slice(new),
                Found::Positions(new) => positions += new.len(),
            }
            Ok(())
        });
        assert_eq!((&readings, positions), (&findings.readings, findings.positions.len()), "kept as it came");
        let status = self.chip.bench.now();
        assert_eq!(status.duty, 0.0, "the drive is off, however it ended");
        findings
    }
}

impl Board for Attended<'_> {
    fn command(&mut self, line: &str) -> Result<(), BoardError> {
        self.chip.command(line)
    }

    fn samples(&mut self, duration_s: f64) -> Result<Vec<Sample>, BoardError> {
        self.chip.bench.block_rotor(self.hands.get() == Hands::Hold);
        let braked_nm = if self.chip.bench.now().speed_rad_per_s > 0.0 { self.brake_nm.get() } else { 0.0 };
        self.chip.bench.set_load_torque_nm(if self.hands.get() == Hands::Turn { -HAND_NM } else { braked_nm });
        let mut samples = self.chip.samples(duration_s)?;
        for sample in &mut samples {
            sample.current += if self.disturbed.contains(&sample.tick) { DISTURBANCE } else { 0 };
        }
        self.last_tick = samples.last().map_or(self.last_tick, |sample| sample.tick);
        Ok(samples)
    }

    fn stay_alive(&mut self) -> Result<(), BoardError> {
        self.chip.stay_alive()
    }
}

/// Does what is asked, after so many looks. The first grip can be loose.
struct Fellow<'a> {
    hands: &'a Cell<Hands>,
    looks: u32,
    loose: bool,
    heard: Vec<String>,
    /// Stops the motor after so many levels.
    stops_after: usize,
    blocks_after: usize,
    brake_nm: Option<Rc<Cell<f64>>>,
    /// Does not answer.
    absent: bool,
}

impl<'a> Fellow<'a> {
    fn new(hands: &'a Cell<Hands>) -> Self {
        Self {
            hands,
            looks: 0,
            loose: false,
            heard: Vec::new(),
            stops_after: usize::MAX,
            blocks_after: usize::MAX,
            brake_nm: None,
            absent: false,
        }
    }
}

impl Operator for Fellow<'_> {
    fn stops(&mut self) -> bool {
        self.heard.len() >= self.stops_after
    }

    fn hears(&mut self, line: &str) {
        self.heard.push(line.into());
        if self.heard.len() >= self.blocks_after {
            self.hands.set(Hands::Hold);
        }
    }

    fn is_asked(&mut self, request: &str) {
        self.heard.push(request.into());
        (self.looks, self.loose) = (3, self.loose && !request.contains("tighter"));
        self.hands.set(Hands::Turn);
    }

    fn answers(&mut self) -> Option<bool> {
        if self.absent {
            return Some(false);
        }
        self.looks -= 1;
        if self.looks > 0 {
            return None;
        }
        self.hands.set(if self.loose { Hands::Off } else { Hands::Hold });
        Some(true)
    }

    fn brakes(&mut self, torque_nm: f64) -> Result<bool, String> {
        Ok(self.brake_nm.as_ref().map(|brake| brake.set(torque_nm)).is_some())
    }
}

fn plan(voltages_v: &[f64], positions: usize) -> Plan {
    Plan { voltages_v: voltages_v.into(), loads_nm: Vec::new(), readings: 3, positions, sectors: 0 }
}

/// Both equations of the motor in steady state, with the bridge's drop in pulse and off phase.
#[test]
fn readings_obey_the_motors_equations() {
    let hands = Cell::default();
    let (mut board, mut fellow) = (Attended::new(MOTOR, &hands), Fellow::new(&hands));
    let findings = board.drive(&plan(&[3.0, 6.0, 12.0, -6.0, -12.0], 0), &mut fellow);
    assert_eq!(findings.ended, Ended::Complete);
    assert!(fellow.heard[0].contains("3.00 V: left out, the motor does not turn"), "{:?}", fellow.heard);
    assert_eq!(findings.readings.len(), 12);
    for reading in &findings.readings {
        let (sign, duty) = (reading.u_V.signum(), (reading.u_V / 12.0).abs());
        let drop_v = duty * BRIDGE.drive_v + (1.0 - duty) * BRIDGE.brake_v;
        let (i, w) = (reading.i_A, reading.omega_rad_per_s);
        let voltage_v = MOTOR.resistance_ohm * i + MOTOR.torque_constant_nm_per_a * w + sign * drop_v;
        assert!((voltage_v - reading.u_V).abs() < 0.03, "{reading:?}: {voltage_v} V");
        let friction_nm = sign * MOTOR.coulomb_friction_nm + MOTOR.viscous_friction_nms_per_rad * w;
        let torque_nm = MOTOR.torque_constant_nm_per_a * i;
        // The sensor's zero is known to 0.8 mA, half a percent of the current.
        assert!((torque_nm / friction_nm - 1.0).abs() < 0.015, "{reading:?}: {torque_nm} Nm");
    }
    println!("{:?}", findings.readings);
}

/// The additional current under a load drives that load. At the end the brake is open.
#[test]
fn readings_under_load_obey_the_motors_equations() {
    let hands = Cell::default();
    let (mut board, mut fellow) = (Attended::new(MOTOR, &hands), Fellow::new(&hands));
    fellow.brake_nm = Some(Rc::clone(&board.brake_nm));
    let findings = board.drive(&Plan { loads_nm: vec![0.0, 0.01], ..plan(&[9.0, 12.0], 0) }, &mut fellow);
    assert_eq!((&findings.ended, findings.readings.len()), (&Ended::Complete, 12), "{:?}", fellow.heard);
    assert_eq!((board.brake_nm.get(), fellow.heard[0].as_str()), (0.0, "the brake is set to 0 Nm"));
    for reading in &findings.readings {
        let friction_nm = MOTOR.coulomb_friction_nm + MOTOR.viscous_friction_nms_per_rad * reading.omega_rad_per_s;
        let torque_nm = MOTOR.torque_constant_nm_per_a * reading.i_A;
        assert!((torque_nm / (friction_nm + reading.load_Nm) - 1.0).abs() < 0.015, "{reading:?}: {torque_nm} Nm");
    }
    assert_eq!(findings.readings[6].load_Nm, 0.01);
}

/// If nobody sets the brake, nothing is measured under a load that is not there.
#[test]
fn a_brake_that_nobody_sets_leaves_its_load_out() {
    let hands = Cell::default();
    let (mut board, mut fellow) = (Attended::new(MOTOR, &hands), Fellow::new(&hands));
    fellow.absent = true;
    let findings = board.drive(&Plan { loads_nm: vec![0.01], ..plan(&[9.0], 0) }, &mut fellow);
    assert_eq!((&findings.ended, findings.readings.len()), (&Ended::Complete, 0));
    assert_eq!(findings.left_out, ["the other loads"]);
    assert_eq!(fellow.heard, ["set the brake to 0.01 Nm, press Enter", "nobody answers: the other loads are left out"]);
}

#[test]
fn a_held_winding_is_told_from_the_bridges_drop() {
    let hands = Cell::default();
    let (mut board, mut fellow) = (Attended::new(MOTOR, &hands), Fellow::new(&hands));
    fellow.loose = true;
    let findings = board.drive(&plan(&[], 2), &mut fellow);
    assert_eq!(findings.ended, Ended::Complete, "{:?}", fellow.heard);
    assert!(fellow.heard[1].contains("hold it tighter"), "{:?}", fellow.heard);
    let [first, second] = &findings.positions[..] else { panic!("{:?}", findings.positions) };
    assert!((first.angle_deg - second.angle_deg).abs() > 1.0, "the rotor was turned on");
    for position in [first, second] {
        // The drop grows by 0.1 V from no duty to full, which is 0.8 % of the resistance.
        assert!((position.resistance_ohm.value / MOTOR.resistance_ohm - 1.0).abs() < 0.03, "{position:?}");
        assert!((position.drop_V - BRIDGE.brake_v).abs() < 0.1, "{position:?}");
    }
}

/// A hand that lets the rotor creep acts as viscous friction. Resistance and drop are right in every sector of a
/// revolution, though the back-EMF is a tenth of a volt.
#[test]
fn a_winding_is_measured_while_the_rotor_creeps() {
    let hands = Cell::default();
    let braked = DcMotorParameters { viscous_friction_nms_per_rad: 0.015, ..MOTOR };
    let (mut board, mut fellow) = (Attended::new(braked, &hands), Fellow::new(&hands));
    fellow.loose = true;
    let findings = board.drive(&Plan { sectors: 6, ..plan(&[], 0) }, &mut fellow);
    assert_eq!(findings.ended, Ended::Complete, "{:?}", fellow.heard);
    assert_eq!(findings.positions.len(), 6, "{:?}", fellow.heard);
    for position in &findings.positions {
        assert!((position.resistance_ohm.value / MOTOR.resistance_ohm - 1.0).abs() < 0.03, "{position:?}");
        assert!((position.drop_V - BRIDGE.brake_v).abs() < 0.1, "{position:?}");
    }
    let mut free = Attended::new(MOTOR, &hands);
    let findings = free.drive(&Plan { sectors: 6, ..plan(&[], 0) }, &mut fellow);
    assert!(findings.positions.is_empty(), "it was not held back: {:?}", fellow.heard);
}

/// With a time constant of two seconds any fixed short wait would be wrong by more than this.
#[test]
fn a_slow_motor_is_waited_for() {
    let hands = Cell::default();
    let heavy = DcMotorParameters { inertia_kg_m2: 80.0 * MOTOR.inertia_kg_m2, ..MOTOR };
    let (mut board, mut fellow) = (Attended::new(heavy, &hands), Fellow::new(&hands));
    let findings = board.drive(&plan(&[9.0], 0), &mut fellow);
    let drop_v = 0.75 * BRIDGE.drive_v + 0.25 * BRIDGE.brake_v;
    let (r, k) = (MOTOR.resistance_ohm, MOTOR.torque_constant_nm_per_a);
    let last = (9.0 - drop_v - r * MOTOR.coulomb_friction_nm / k) / (k + r * MOTOR.viscous_friction_nms_per_rad / k);
    assert!((findings.readings[0].omega_rad_per_s / last - 1.0).abs() < 5e-3, "{last} {:?}", findings.readings);
}

/// A single disagreement is measured again. A level that disagrees again is left out, and the output says so.
#[test]
fn readings_that_disagree_once_are_taken_again() {
    let hands = Cell::default();
    let (mut board, mut fellow) = (Attended::new(MOTOR, &hands), Fellow::new(&hands));
    board.drive(&plan(&[6.0], 0), &mut fellow);
    let within_last_reading = board.last_tick - 200;
    for (until, readings) in [(within_last_reading + 100, 3), (u32::MAX, 0)] {
        let (mut board, mut fellow) = (Attended::new(MOTOR, &hands), Fellow::new(&hands));
        board.disturbed = within_last_reading..until;
        let findings = board.drive(&plan(&[6.0], 0), &mut fellow);
        assert_eq!(findings.readings.len(), readings, "{:?}", fellow.heard);
        let said = fellow.heard[0].contains("6.00 V: left out, it did not stay steady: speed went from");
        assert_eq!(said, readings == 0, "{:?}", fellow.heard);
        assert!(board.last_tick > within_last_reading + 1000, "{} {within_last_reading}", board.last_tick);
    }
}

#[test]
fn what_had_come_is_kept() {
    let hands = Cell::default();
    let (mut board, mut fellow) = (Attended::new(MOTOR, &hands), Fellow::new(&hands));
    fellow.stops_after = 1;
    let findings = board.drive(&plan(&[6.0, 9.0], 0), &mut fellow);
    assert_eq!((findings.ended, findings.readings.len()), (Ended::Interrupted, 3));

    // The rotor is held after the first level, so it draws its stall current.
    let mut fellow = Fellow::new(&hands);
    fellow.blocks_after = 1;
    let findings = board.drive(&plan(&[6.0, 9.0], 0), &mut fellow);
    assert_eq!(findings.ended, Ended::Tripped(Trip::Stall));
    assert_eq!(findings.readings.len(), 3);
}

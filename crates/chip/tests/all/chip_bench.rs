//! Chip and motor together: what the bench does between them.
use std::f64::consts::TAU;

use crate::common::execute;
use host_sim::plant::{Bridge, DcMotor, Plant};
use motorbench_board::pins::{CURRENT_SENSE, EMERGENCY_STOP, SUPPLY_SENSE, TACHOGENERATOR};
use motorbench_chip::registers::*;
use motorbench_chip::{Acs712, Bench, EncoderFault, Rig, SensorFault, Wiring};

/// `drive`: half duty forward, one counter per encoder line.
fn driving(rig: Rig) -> Bench<DcMotor> {
    Bench::new(crate::common::elf("drive"), rig, DcMotor::default()).unwrap()
}

/// `agent`: the motor stands, the registers are ours.
fn standing() -> Bench<DcMotor> {
    let rig = Rig { current_sensor: Acs712 { noise_v: 0.0, ..Acs712::default() }, ..Rig::default() };
    let mut bench = Bench::new(crate::common::elf("agent"), rig, DcMotor::default()).unwrap();
    bench.run_s(1e-3).unwrap();
    bench
}

/// Edges that the program `drive` has counted on A and on B.
fn edges(bench: &Bench<DcMotor>) -> (u16, u16) {
    (bench.chip().read_u16(24), bench.chip().read_u16(26))
}

/// Edges on A and B during some time.
fn edges_during(bench: &mut Bench<DcMotor>, duration_s: f64) -> (u16, u16) {
    let before = edges(bench);
    bench.run_s(duration_s).unwrap();
    let after = edges(bench);
    (after.0.wrapping_sub(before.0), after.1.wrapping_sub(before.1))
}

/// Code of a channel.
fn convert(bench: &mut Bench<DcMotor>, channel: u8) -> u16 {
    execute(bench.chip_mut(), &[(ADMUX, 0b0100_0000 | channel), (ADCSRA, 0b1100_1110)]);
    bench.run_s(2e-4).unwrap();
    bench.chip().read_u16(0x320)
}

#[test]
fn every_count_of_the_turning_motor_is_an_interrupt() {
    let mut bench = driving(Rig::default());
    bench.run_s(0.2).unwrap();
    let truth = bench.now();
    let (a, b) = edges(&bench);
    assert!(truth.speed_rad_per_s > 20.0 && truth.encoder_count > 1000, "{truth:?}");
    assert_eq!(i64::from(a) + i64::from(b), truth.encoder_count);
    assert!(a.abs_diff(b) <= 1);
}

#[test]
fn encoder_edges_come_when_the_angle_crosses_the_count() {
    let mut bench = driving(Rig::default());
    bench.run_s(0.2).unwrap();
    bench.chip_mut().measure(None);
    bench.record(1);
    bench.run_s(0.004).unwrap();
    // The angle, looked at in every single cycle.
    let position = |angle_rad: f64| (angle_rad / TAU * Rig::default().counts_per_turn + 0.5).floor();
    let rows = bench.take_recording();
    let crossings: Vec<u64> = rows
        .windows(2)
        .filter(|pair| position(pair[0].angle_rad) != position(pair[1].angle_rad))
        .map(|pair| pair[1].cycle)
        .collect();
    let meter = bench.chip().meter();
    let mut entries: Vec<u64> = [vector::INT0, vector::INT1]
        .iter()
        .flat_map(|v| meter.handler_runs(*v).iter().map(|run| run.entry_cycle))
        .collect();
    entries.sort_unstable();
    assert!(crossings.len() > 20, "{}", crossings.len());
    assert!(crossings.len().abs_diff(entries.len()) <= 1);
    for (crossing, entry) in crossings.iter().zip(&entries) {
        // The instruction or the handler then running comes to its end first.
        assert!((0..=20).contains(&(*entry as i64 - *crossing as i64)), "{crossing} {entry}");
    }
    let at_once = crossings.iter().zip(&entries).filter(|(crossing, entry)| crossing == entry).count();
    assert!(at_once * 10 > crossings.len() * 9, "{at_once} of {}", crossings.len());
}

#[test]
fn a_hundred_thousand_edges_per_second_all_arrive() {
    let mut bench = driving(Rig::default());
    bench.run_s(1e-3).unwrap();
    bench.set_edge_train_per_s(Some(100_000.0));
    let (a, b) = edges_during(&mut bench, 0.1);
    assert!((9_999..=10_001).contains(&(a + b)), "{a} {b}");
}

#[test]
fn encoder_faults_change_the_lines_only() {
    let mut bench = driving(Rig::default());
    bench.run_s(0.2).unwrap();
    bench.set_encoder_fault(Some(EncoderFault::AStuck(false)));
    bench.run_s(1e-4).unwrap();
    let (a, b) = edges_during(&mut bench, 0.05);
    assert!(a == 0 && b > 100, "{a} {b}");
    bench.set_encoder_fault(Some(EncoderFault::Unplugged));
    bench.run_s(1e-4).unwrap();
    let before = bench.now();
    assert_eq!(edges_during(&mut bench, 0.05), (0, 0));
    assert_eq!(before.port_d_inputs & 0b1100, 0b1100);
    assert!(bench.now().encoder_count > before.encoder_count + 100, "the motor goes on");
}

#[test]
fn glitches_and_illegal_transitions() {
    let mut bench = standing();
    execute(bench.chip_mut(), &[(EICRA, 0b0101), (EIFR, 0b11), (EIMSK, 0b11)]);
    let counts = |bench: &Bench<DcMotor>| (bench.chip().read(0x301), bench.chip().read(0x302));
    bench.encoder_glitch(100, 64, true, false);
    bench.run_s(1e-4).unwrap();
    assert_eq!(counts(&bench), (2, 0));
    bench.encoder_glitch(100, 64, true, true);
    bench.run_s(1e-4).unwrap();
    assert_eq!(counts(&bench), (4, 2));
    bench.encoder_illegal_transition(100);
    bench.run_s(1e-4).unwrap();
    assert_eq!(counts(&bench), (5, 3));
    assert_eq!(bench.now().port_d_inputs & 0b1100, 0b1100);
}

#[test]
fn swapped_lines_turn_the_direction_round() {
    let phase_after_a_rises = |fault| {
        let mut bench = standing();
        bench.set_encoder_fault(fault);
        bench.set_edge_train_per_s(Some(1000.0));
        bench.run_s(0.0015).unwrap();
        bench.now().port_d_inputs & 0b1100
    };
    assert_eq!(phase_after_a_rises(None), 0b0100);
    assert_eq!(phase_after_a_rises(Some(EncoderFault::Swapped)), 0b1000);
}

#[test]
fn emergency_stop_pulls_its_pin_low() {
    let mut bench = standing();
    assert_ne!(bench.chip().read(PIND) & EMERGENCY_STOP.mask(), 0);
    bench.press_emergency_stop(true);
    assert_eq!(bench.chip().read(PIND) & EMERGENCY_STOP.mask(), 0);
    bench.press_emergency_stop(false);
    assert_ne!(bench.chip().read(PIND) & EMERGENCY_STOP.mask(), 0);
}

#[test]
fn sensors_and_their_faults_reach_the_converter() {
    let mut bench = standing();
    // 12 V / 4 of 5 V
    assert_eq!(convert(&mut bench, SUPPLY_SENSE.bit), 614);
    bench.set_supply_v(10.0);
    assert_eq!(convert(&mut bench, SUPPLY_SENSE.bit), 512);
    assert_eq!(convert(&mut bench, CURRENT_SENSE.bit), 512);
    bench.set_current_sensor_fault(Some(SensorFault::PinnedV(5.0)));
    assert_eq!(convert(&mut bench, CURRENT_SENSE.bit), 1023);
    bench.set_current_sensor_fault(Some(SensorFault::PinnedV(0.0)));
    assert_eq!(convert(&mut bench, CURRENT_SENSE.bit), 0);
    bench.set_current_sensor_fault(Some(SensorFault::Open));
    convert(&mut bench, SUPPLY_SENSE.bit);
    assert_eq!(convert(&mut bench, CURRENT_SENSE.bit), 512, "what the supply's input has left");
    bench.set_tachogenerator_fault(Some(SensorFault::PinnedV(2.5)));
    assert_eq!(convert(&mut bench, TACHOGENERATOR.bit), 512);
}

#[test]
fn tachogenerator_shows_speed_without_sign() {
    for speed_rad_per_s in [104.72, -104.72] {
        let mut bench = standing();
        bench.change_plant(|motor| motor.set_speed_rad_per_s(speed_rad_per_s));
        // 1000 rpm: 1.5 V of 5 V, 5 % of ripple, a little friction
        let code = convert(&mut bench, TACHOGENERATOR.bit);
        assert!((285..=323).contains(&code), "{code}");
    }
}

#[test]
fn wirings_differ_between_the_pulses() {
    for (wiring, between) in [(Wiring::Braking, Bridge::Brake), (Wiring::Coasting, Bridge::Coast)] {
        let mut bench = driving(Rig { wiring, ..Rig::default() });
        bench.run_s(0.01).unwrap();
        bench.record(100);
        bench.run_s(0.001).unwrap();
        let rows = bench.take_recording();
        let forward = rows.iter().filter(|row| row.bridge == Bridge::Forward).count();
        assert!(rows.iter().all(|row| [Bridge::Forward, between].contains(&row.bridge)));
        assert!(forward.abs_diff(rows.len() / 2) <= 1, "half duty: {forward} of {}", rows.len());
    }
}

#[test]
fn blocked_rotor_and_load() {
    let mut bench = driving(Rig::default());
    bench.run_s(0.3).unwrap();
    let free = bench.now();
    bench.set_load_torque_nm(0.01);
    bench.run_s(0.2).unwrap();
    let loaded = bench.now();
    assert!(loaded.speed_rad_per_s < free.speed_rad_per_s - 5.0);
    bench.block_rotor(true);
    bench.run_s(0.1).unwrap();
    let blocked = bench.now();
    assert_eq!(blocked.speed_rad_per_s, 0.0);
    assert!(blocked.current_a > loaded.current_a);
    bench.block_rotor(false);
    bench.set_load_torque_nm(0.0);
    bench.run_s(0.3).unwrap();
    assert!((bench.now().speed_rad_per_s - free.speed_rad_per_s).abs() < 1.0);
}

#[test]
fn recording_has_a_row_per_interval() {
    let mut bench = driving(Rig::default());
    bench.run_s(0.01).unwrap();
    bench.record(800);
    bench.run_s(0.02).unwrap();
    let rows = bench.take_recording();
    assert!((400..=401).contains(&rows.len()), "{}", rows.len());
    assert!(rows.windows(2).all(|pair| pair[1].cycle - pair[0].cycle == 800));
    assert!(rows.iter().all(|row| row.duty == 0.5 && row.supply_v == 12.0));
    assert!((rows[10].t_s - rows[10].cycle as f64 / 16e6).abs() < 1e-12);
    bench.record(0);
    bench.run_s(0.01).unwrap();
    assert!(bench.take_recording().is_empty());
}

#[test]
fn same_seed_same_run() {
    let codes = |seed| {
        let mut bench =
            Bench::new(crate::common::elf("agent"), Rig { seed, ..Rig::default() }, DcMotor::default()).unwrap();
        bench.run_s(1e-3).unwrap();
        (0..40).map(|_| convert(&mut bench, CURRENT_SENSE.bit)).collect::<Vec<u16>>()
    };
    assert_eq!(codes(1), codes(1));
    assert_ne!(codes(1), codes(2));
}

#[test]
fn power_cut_in_the_middle_of_a_write() {
    for (completed, left) in [(false, 0xFF), (true, 0x42)] {
        let mut bench = standing();
        execute(bench.chip_mut(), &[(0x4000, 0x42)]);
        let image = match completed {
            true => bench.run_until_eeprom_write(1, true, 0.01).unwrap().unwrap(),
            false => bench.chip().eeprom(),
        };
        assert_eq!(image[0], left);
        let mut next = standing();
        next.chip_mut().set_eeprom(&image);
        assert_eq!(next.chip().eeprom()[0], left);
        assert_eq!(next.run_until_eeprom_write(1, false, 0.001).unwrap(), None);
    }
}

#[test]
fn plant_and_chip_share_one_time() {
    let mut bench = driving(Rig::default());
    bench.run_s(0.05).unwrap();
    let row = bench.now();
    assert_eq!(row.cycle, bench.cycle());
    assert_eq!(row.angle_rad, bench.plant().angle_rad());
}

#[test]
fn a_load_like_the_firmwares_keeps_its_times() {
    let mut bench = Bench::new(crate::common::elf("load"), Rig::default(), DcMotor::default()).unwrap();
    bench.run_s(0.01).unwrap();
    bench.chip_mut().measure(None);
    bench.set_edge_train_per_s(Some(20_000.0));
    bench.serial().read();
    bench.run_s(0.1).unwrap();
    assert!(bench.serial().read().len().abs_diff(5000) <= 5, "500 kBd are 50 bytes per millisecond");
    let meter = bench.chip().meter();
    let runs = |vector| meter.handler_runs(vector).len();
    assert!(runs(vector::TIMER0_COMPA).abs_diff(100) <= 1);
    assert!(runs(vector::ADC).abs_diff(1000) <= 1);
    assert!((runs(vector::INT0) + runs(vector::INT1)).abs_diff(2000) <= 1);
    assert_eq!(meter.sample_jitter_cycles(0, 1600), Some(0));
    // No handler is longer than 40 cycles with interrupts off, but several may stand in line.
    assert!(meter.entry_jitter_cycles(vector::TIMER0_COMPA, 16_000).unwrap() < 120);
}

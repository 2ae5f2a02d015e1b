//! The EEPROM's times, its lock and what a power cut leaves (data sheet section 8.6).
use crate::common::Agent;
use motorbench_chip::ResetCause;
use motorbench_chip::registers::*;

const EERE: u8 = 1;
const EEPE: u8 = 1 << 1;
const EEMPE: u8 = 1 << 2;
const EERIE: u8 = 1 << 3;
/// 3.4 ms
const WRITE_CYCLES: u64 = 54_400;

#[test]
fn a_write_takes_3_4_ms() {
    let mut agent = Agent::new();
    agent.program(5, 0x42);
    let begun = agent.chip.cycle();
    assert_eq!(agent.chip.eeprom_writes(), (1, 0));
    assert_eq!(agent.read(EECR) & (EEPE | EEMPE), EEPE);
    agent.chip.run_until(begun + WRITE_CYCLES - 200).unwrap();
    assert_eq!(agent.read(EECR) & EEPE, EEPE);
    agent.chip.run_until(begun + WRITE_CYCLES + 200).unwrap();
    assert_eq!(agent.read(EECR) & EEPE, 0);
    assert_eq!(agent.chip.eeprom()[5], 0x42);
    agent.write(&[(EEARL, 5), (EEDR, 0), (EECR, EERE)]);
    assert_eq!(agent.read(EEDR), 0x42);
}

#[test]
fn a_second_write_is_ignored_while_the_first_goes_on() {
    let mut agent = Agent::new();
    agent.program(5, 1);
    agent.program(6, 2);
    agent.run(2 * WRITE_CYCLES);
    assert_eq!(agent.chip.eeprom()[5..7], [1, 0xFF]);
}

#[test]
fn writing_is_locked_four_cycles_after_the_master_enable() {
    // The agent needs 17 cycles from one register to the next.
    let mut agent = Agent::new();
    agent.write(&[(EEARL, 5), (EEDR, 1), (EECR, EEMPE), (EECR, EEPE)]);
    assert_eq!(agent.chip.eeprom_writes(), (0, 0));
    assert_eq!(agent.read(EECR), 0);
}

#[test]
fn ready_interrupts_at_once_when_nothing_is_written_and_later_otherwise() {
    let mut agent = Agent::new();
    agent.write(&[(EECR, EERIE)]);
    agent.run(100);
    assert_eq!(agent.count(vector::EE_READY), 1, "its handler switches it off");
    agent.program(5, 1);
    let begun = agent.chip.cycle();
    agent.write(&[(EECR, EERIE)]);
    agent.chip.run_until(begun + WRITE_CYCLES - 200).unwrap();
    assert_eq!(agent.count(vector::EE_READY), 1);
    agent.chip.run_until(begun + WRITE_CYCLES + 200).unwrap();
    assert_eq!(agent.count(vector::EE_READY), 2);
}

#[test]
fn a_power_cut_leaves_an_erased_cell_and_a_reset_does_not_disturb() {
    for (cause, left) in [(ResetCause::PowerOn, 0xFF), (ResetCause::External, 0x42)] {
        let mut agent = Agent::new();
        let mut image = agent.chip.eeprom();
        image[5] = 0x11;
        agent.chip.set_eeprom(&image);
        agent.program(5, 0x42);
        agent.chip.reset(cause);
        agent.run(2 * WRITE_CYCLES);
        assert_eq!(agent.chip.eeprom()[5], left, "{cause:?}");
    }
}

//! Interrupt response, sleep, resets and crashes.
use crate::common::Agent;
use motorbench_chip::registers::*;
use motorbench_chip::{Crash, ResetCause, Spread};

const WDTCSR: u16 = 0x60;
const WDE: u8 = 1 << 3;
const WDIE: u8 = 1 << 6;
/// 2048 periods of 128 kHz
const WATCHDOG_CYCLES: u64 = 256_000;
/// Somewhere in the SRAM that the agent does not use.
const VARIABLE: u16 = 0x500;

#[test]
fn a_handler_costs_response_jump_and_its_instructions() {
    // Section 7.7.1: four cycles of response; JMP 3; the agent's handler 17, RETI included.
    let mut agent = Agent::new();
    agent.chip.measure(None);
    agent.write(&[(TIMSK0, 1), (0x45, 1)]);
    agent.run(10_000);
    let spread = agent.chip.meter().handler_cycles(vector::TIMER0_OVF).unwrap();
    let Spread { count, min, median, max } = spread;
    assert!((37..=40).contains(&count), "{count}");
    assert_eq!((min, median, max), (26, 26, 26));
}

#[test]
fn sleep_ends_in_the_cycle_of_the_event_and_costs_four_more() {
    let mut chip = crate::common::chip("sleep");
    chip.run_until(3000).unwrap();
    chip.measure(Some(GPIOR0));
    chip.world_mut().changes.clear();
    chip.run_until(83_000).unwrap();
    let meter = chip.meter();
    let rises: Vec<u64> = chip.world().changes.iter().filter(|c| c.1.oc1a == Some(true)).map(|c| c.0).collect();
    let entries: Vec<u64> = meter.handler_runs(vector::TIMER1_OVF).iter().map(|run| run.entry_cycle).collect();
    assert_eq!(entries.len(), 100);
    assert_eq!(entries, rises);
    // 8 + JMP 3 + OUT 1 + NOP 2 + SBI 2 + RETI 4
    assert_eq!(meter.handler_cycles(vector::TIMER1_OVF), Some(Spread { count: 100, min: 20, median: 20, max: 20 }));
    assert_eq!(meter.entry_jitter_cycles(vector::TIMER1_OVF, 800), Some(0));
    assert!(meter.between_markers(1, 0x81, 1).iter().all(|cycles| *cycles == 2), "two NOPs");
}

#[test]
fn running_in_pieces_or_step_by_step_changes_nothing() {
    let runs = |advance: fn(&mut motorbench_chip::Chip<crate::common::Probe>)| {
        let mut chip = crate::common::chip("sleep");
        chip.measure(None);
        while chip.cycle() < 20_000 {
            advance(&mut chip);
        }
        chip.meter().handler_runs(vector::TIMER1_OVF)[..20].to_vec()
    };
    let at_once = runs(|chip| chip.run_until(20_000).unwrap());
    assert_eq!(at_once, runs(|chip| chip.run_until(chip.cycle() + 37).unwrap()));
    assert_eq!(at_once, runs(|chip| chip.step().unwrap()));
}

#[test]
fn mcusr_tells_the_cause_and_collects_until_power_on() {
    let mut agent = Agent::new();
    assert_eq!(agent.read(MCUSR), ResetCause::PowerOn.flag());
    agent.write(&[(MCUSR, 0)]);
    for (cause, flags) in [
        (ResetCause::External, 0b0010),
        (ResetCause::BrownOut, 0b0110),
        (ResetCause::Watchdog, 0b1110),
        (ResetCause::PowerOn, 0b0001),
    ] {
        agent.chip.reset(cause);
        agent.run(2000);
        assert_eq!(agent.read(MCUSR), flags, "{cause:?}");
    }
}

#[test]
fn sram_survives_all_but_a_power_cut() {
    for (cause, kept) in [(ResetCause::External, true), (ResetCause::Watchdog, true), (ResetCause::PowerOn, false)] {
        let mut agent = Agent::new();
        (0..16).for_each(|offset| agent.chip.write(VARIABLE + offset, 0x5A));
        agent.chip.reset(cause);
        assert_eq!(agent.chip.read_bytes::<16>(VARIABLE) == [0x5A; 16], kept, "{cause:?}");
    }
}

#[test]
fn watchdog_resets_the_chip_and_time_goes_on() {
    let mut agent = Agent::new();
    agent.write(&[(MCUSR, 0), (0x25, 0xFF), (WDTCSR, WDE)]);
    let begun = agent.chip.cycle();
    agent.chip.run_until(begun + WATCHDOG_CYCLES - 100).unwrap();
    assert_eq!((agent.chip.read(MCUSR), agent.chip.outputs().port_b), (0, 0xFF));
    agent.chip.run_until(begun + WATCHDOG_CYCLES + 100).unwrap();
    assert_eq!((agent.chip.read(MCUSR), agent.chip.outputs().port_b), (ResetCause::Watchdog.flag(), 0));
    let late = agent.chip.cycle() - (begun + WATCHDOG_CYCLES + 100);
    assert!(late < 4, "{late}");
}

#[test]
fn watchdog_interrupts_before_it_resets() {
    let mut agent = Agent::new();
    agent.write(&[(MCUSR, 0), (WDTCSR, WDE | WDIE)]);
    agent.run(WATCHDOG_CYCLES + 1000);
    assert_eq!((agent.count(vector::WDT), agent.chip.read(MCUSR)), (1, 0));
    agent.run(WATCHDOG_CYCLES);
    assert_eq!(agent.chip.read(MCUSR), ResetCause::Watchdog.flag());
}

#[test]
fn inputs_keep_their_levels_through_a_reset() {
    let mut agent = Agent::new();
    agent.set_port_d(0b0001_1000);
    agent.chip.reset(ResetCause::External);
    agent.run(2000);
    assert_eq!(agent.read(PIND), 0b0001_1000);
}

#[test]
fn sleeping_with_interrupts_off_is_reported() {
    let mut chip = crate::common::chip("dead");
    assert!(matches!(chip.run_until(10_000), Err(Crash::AsleepForEver { cycle }) if cycle < 1000));
}

#[test]
fn invalid_instruction_is_reported_with_its_address() {
    let mut chip = crate::common::chip("invalid");
    let crash = chip.run_until(10_000).unwrap_err();
    assert!(matches!(crash, Crash::InvalidOpcode { address: 0x6A, opcode: 0x940B, .. }), "{crash}");
}

#[test]
fn stack_depth_is_what_the_handlers_push() {
    let mut agent = Agent::new();
    agent.chip.paint_stack(VARIABLE);
    let before = agent.chip.stack_free_bytes(VARIABLE);
    agent.write(&[(TIMSK0, 1), (0x45, 1)]);
    agent.run(1000);
    // Return address, two registers.
    assert_eq!(before - agent.chip.stack_free_bytes(VARIABLE), 4);
}

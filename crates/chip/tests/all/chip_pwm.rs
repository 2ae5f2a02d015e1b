//! OC1A in mode 14 (data sheet section 16.9.3), where simavr differs from the chip.
use crate::common::Agent;
use motorbench_board::pins::BRIDGE_PWM;
use motorbench_chip::Outputs;
use motorbench_chip::registers::*;
use motorbench_core::HARDWARE;

const DDRB: u16 = 0x24;
const PORTB: u16 = 0x25;
const ICR1L: u16 = 0x86;
const ICR1H: u16 = 0x87;
const NON_INVERTING: u8 = 0b1000_0010;
const INVERTING: u8 = 0b1100_0010;
const DISCONNECTED: u8 = 0b0000_0010;

fn compare(value: u16) -> [(u16, u8); 2] {
    let [low, high] = value.to_le_bytes();
    [(OCR1AH, high), (OCR1AL, low)]
}

/// Timer1 in mode 14 with 800 steps and D9 as output.
fn running(tccr1a: u8, value: u16) -> Agent {
    let mut agent = Agent::new();
    let [low, high] = (HARDWARE.pwm_steps - 1).to_le_bytes();
    let mut setup = vec![(DDRB, BRIDGE_PWM.mask()), (ICR1H, high), (ICR1L, low)];
    setup.extend(compare(value));
    setup.extend([(TCCR1A, tccr1a), (TCCR1B, 0b0001_1001)]);
    agent.write(&setup);
    agent.run(2000);
    agent.changes();
    agent
}

fn levels(changes: &[(u64, Outputs)]) -> Vec<(u64, bool)> {
    let mut levels: Vec<(u64, bool)> = changes.iter().map(|(at, o)| (*at, o.level(&BRIDGE_PWM).unwrap())).collect();
    levels.dedup_by_key(|(_, level)| *level);
    levels
}

/// Lengths of the high and low phases that lie completely inside `changes`.
fn phases(changes: &[(u64, Outputs)]) -> Vec<(bool, u64)> {
    levels(changes).windows(2).map(|w| (w[0].1, w[1].0 - w[0].0)).collect()
}

#[test]
fn non_inverting_pin_is_high_for_one_step_more_than_the_compare_value() {
    let mut agent = running(NON_INVERTING, 199);
    agent.run(800 * 50);
    let phases = phases(&agent.changes());
    assert!(phases.len() >= 98);
    assert!(phases.iter().all(|phase| [(true, 200), (false, 600)].contains(phase)), "{phases:?}");
}

#[test]
fn inverting_pin_is_low_first() {
    let mut agent = running(INVERTING, 199);
    agent.run(800 * 5);
    let phases = phases(&agent.changes());
    assert!(phases.iter().all(|phase| [(false, 200), (true, 600)].contains(phase)), "{phases:?}");
}

#[test]
fn compare_value_at_top_gives_a_constant_level() {
    for (tccr1a, level) in [(NON_INVERTING, true), (INVERTING, false)] {
        let mut agent = running(tccr1a, 799);
        assert_eq!(agent.chip.outputs().level(&BRIDGE_PWM), Some(level));
        agent.run(800 * 5);
        assert_eq!(levels(&agent.changes()), []);
    }
}

#[test]
fn new_compare_value_waits_for_bottom() {
    let mut agent = running(NON_INVERTING, 99);
    agent.run(800);
    let bottom = agent.changes().iter().rfind(|(_, o)| o.oc1a == Some(true)).unwrap().0;
    // To a point shortly after BOTTOM, where a shorter and a longer pulse would both begin at once.
    agent.chip.run_until(bottom + 1600 + 20).unwrap();
    agent.write(&compare(599));
    let written = agent.chip.cycle();
    assert!(written < bottom + 1600 + 599, "written too late to tell");
    agent.run(2400);
    let highs: Vec<u64> =
        phases(&agent.changes()).iter().filter(|(level, _)| *level).map(|(_, cycles)| *cycles).collect();
    assert_eq!(highs, [100, 100, 600, 600]);
}

#[test]
fn new_high_byte_alone_counts() {
    let mut agent = running(NON_INVERTING, 0x0040);
    agent.write(&compare(0x0240));
    agent.run(2000);
    agent.changes();
    agent.run(1700);
    assert!(phases(&agent.changes()).contains(&(true, 0x241)));
}

#[test]
fn disconnected_pin_shows_the_port_which_the_waveform_has_not_touched() {
    let mut agent = running(NON_INVERTING, 399);
    assert_eq!(agent.read(PORTB), 0);
    for phase in 0..8 {
        agent.write(&[(TCCR1A, NON_INVERTING)]);
        agent.run(800 + 100 * phase);
        agent.write(&[(TCCR1A, DISCONNECTED)]);
        assert_eq!(agent.chip.outputs().level(&BRIDGE_PWM), Some(false));
    }
    agent.write(&[(PORTB, BRIDGE_PWM.mask())]);
    assert_eq!(agent.chip.outputs().level(&BRIDGE_PWM), Some(true));
}

#[test]
fn duty_is_shown_to_the_world() {
    let mut agent = running(NON_INVERTING, 199);
    assert_eq!(agent.chip.outputs().pwm.duty(), 0.25);
    agent.write(&[(TCCR1A, DISCONNECTED)]);
    assert_eq!(agent.chip.outputs().pwm.duty(), 0.0);
}

//! Interrupt flags: remembered while disabled, cleared one by one (data sheet sections 7.7, 13.2.3 and 16.11.9).
use crate::common::Agent;
use motorbench_chip::registers::*;

const PORTD: u16 = 0x2B;
const TCCR0B: u16 = 0x45;
const ANY_EDGES: u8 = 0b0101;
const STOP_FREE: u8 = 1 << 4;

#[test]
fn timer_flag_raised_while_disabled_fires_when_enabled() {
    let mut agent = Agent::new();
    agent.write(&[(TCCR0B, 1)]);
    agent.run(1000);
    assert_ne!(agent.read(TIFR0) & 1, 0, "Timer0 has overflowed");
    agent.write(&[(TCCR0B, 0)]);
    assert_eq!(agent.count(vector::TIMER0_OVF), 0);
    agent.write(&[(TIMSK0, 1)]);
    agent.run(50);
    assert_eq!(agent.count(vector::TIMER0_OVF), 1);
    assert_eq!(agent.read(TIFR0) & 1, 0, "serving it has cleared the flag");
}

#[test]
fn edge_while_disabled_fires_when_enabled_unless_cleared() {
    for cleared in [false, true] {
        let mut agent = Agent::new();
        agent.write(&[(EICRA, ANY_EDGES)]);
        agent.set_port_d(STOP_FREE | 1 << 2);
        agent.run(10);
        assert_eq!(agent.read(EIFR), 1);
        if cleared {
            agent.write(&[(EIFR, 0b11)]);
            assert_eq!(agent.read(EIFR), 0, "written ones clear");
        }
        agent.write(&[(EIMSK, 0b11)]);
        agent.run(50);
        assert_eq!(agent.count(vector::INT0), u8::from(!cleared));
        assert_eq!(agent.count(vector::INT1), 0);
    }
}

#[test]
fn low_level_sense_leaves_no_flag_behind() {
    let mut agent = Agent::new();
    agent.set_port_d(STOP_FREE | 0b1100);
    agent.set_port_d(STOP_FREE);
    agent.write(&[(EICRA, ANY_EDGES), (EIMSK, 0b11)]);
    agent.run(50);
    assert_eq!((agent.count(vector::INT0), agent.count(vector::INT1)), (0, 0));
}

#[test]
fn each_edge_fires_once_and_writing_the_port_makes_none() {
    let mut agent = Agent::new();
    agent.set_port_d(STOP_FREE | 0b1100);
    agent.write(&[(EICRA, ANY_EDGES), (EIFR, 0b11), (EIMSK, 0b11)]);
    for port in [0xFF, 0x00, 0x1C, 0x10] {
        agent.write(&[(PORTD, port)]);
    }
    agent.run(50);
    assert_eq!((agent.count(vector::INT0), agent.count(vector::INT1)), (0, 0));
    for levels in [0b0100, 0b0000, 0b1000, 0b1100] {
        agent.set_port_d(STOP_FREE | levels);
        agent.run(100);
    }
    assert_eq!((agent.count(vector::INT0), agent.count(vector::INT1)), (2, 2));
}

#[test]
fn sbi_clears_one_timer_flag_only() {
    // Timer1 in mode 14 raises TOV1 and both compare flags; the converter's handler of the agent clears OCF1B by SBI.
    let mut agent = Agent::new();
    agent.write(&[(0x87, 3), (0x86, 0x1F), (TCCR1A, 2), (TCCR1B, 0b0001_1001)]);
    agent.run(2000);
    agent.write(&[(TCCR1B, 0b0001_1000)]);
    assert_eq!(agent.read(TIFR1) & 0b111, 0b111);
    agent.write(&[(ADCSRA, 0b1100_1001)]);
    agent.run(500);
    assert_eq!(agent.count(vector::ADC), 1);
    assert_eq!(agent.read(TIFR1) & 0b111, 0b011);
}

#[test]
fn timers_released_together_count_together() {
    // Section 17.4.1: both stand while TSM is set, whatever the time between the writes.
    let mut agent = Agent::new();
    agent.write(&[(TIMSK0, 1), (TIMSK2, 1), (TCCR0B, 1), (0xB1, 1)]);
    agent.write(&[(GTCCR, 0b1000_0011), (TCNT0, 0), (TCNT2, 0), (GTCCR, 0)]);
    agent.chip.measure(None);
    agent.run(2000);
    let meter = agent.chip.meter();
    let entries = |vector| meter.handler_runs(vector).iter().map(|run| run.entry_cycle).collect::<Vec<u64>>();
    let (timer0, timer2) = (entries(vector::TIMER0_OVF), entries(vector::TIMER2_OVF));
    // Timer2 has the lower vector and is served first; Timer0 follows right behind its handler of 26 cycles.
    assert!(timer0.len() >= 7);
    for (first, second) in timer2.iter().zip(&timer0) {
        assert!((26..=29).contains(&(second - first)), "{timer2:?} {timer0:?}");
    }
}

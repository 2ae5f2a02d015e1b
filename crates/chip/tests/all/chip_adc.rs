//! The converter's times, triggers and codes (data sheet sections 24.4, 24.7 and table 24-1).
use crate::common::Agent;
use motorbench_board::pins::BRIDGE_PWM;
use motorbench_chip::registers::*;

const AVCC_REFERENCE: u8 = 0b0100_0000;
/// Switched on, started, interrupt on, clock / 64.
const START: u8 = 0b1100_1110;
/// The same, but started by triggers.
const TRIGGERED: u8 = 0b1010_1110;
const CLOCK: u64 = 64;
const COMPARE_B: u64 = 100;

/// Timer1 at 20 kHz with compare match B after 101 cycles, D9 rising at BOTTOM.
fn with_timer1() -> Agent {
    let mut agent = Agent::new();
    agent.write(&[
        (0x24, BRIDGE_PWM.mask()),
        (0x87, 3),
        (0x86, 0x1F),
        (0x89, 1),
        (OCR1AL, 0),
        (0x8B, 0),
        (OCR1BL, COMPARE_B as u8),
        (TCCR1A, 0b1000_0010),
        (TCCR1B, 0b0001_1001),
    ]);
    agent
}

fn sample_cycles(agent: &Agent) -> Vec<u64> {
    agent.chip.meter().samples().iter().map(|sample| sample.cycle).collect()
}

#[test]
fn codes_are_the_floor_of_1024_times_the_ratio() {
    let mut agent = Agent::new();
    for (input_v, code) in [(0.0, 0), (2.5, 512), (1.0, 204), (4.9999, 1023), (5.0, 1023), (-0.3, 0)] {
        agent.chip.world_mut().analog_v[3] = input_v;
        agent.write(&[(ADMUX, AVCC_REFERENCE | 3), (ADCSRA, START)]);
        agent.run(25 * CLOCK + 100);
        assert_eq!(agent.result(), code, "{input_v} V");
    }
}

#[test]
fn bandgap_and_ground_channels() {
    let mut agent = Agent::new();
    for (channel, code) in [(14, 225), (15, 0)] {
        agent.write(&[(ADMUX, AVCC_REFERENCE | channel), (ADCSRA, START)]);
        agent.run(25 * CLOCK + 100);
        assert_eq!(agent.result(), code, "channel {channel}");
    }
}

#[test]
fn first_conversion_takes_25_clocks_and_the_next_13() {
    let mut agent = Agent::new();
    agent.chip.measure(Some(ADCSRA));
    agent.write(&[(ADMUX, AVCC_REFERENCE), (ADCSRA, START)]);
    agent.run(3000);
    agent.write(&[(ADCSRA, START)]);
    agent.run(3000);
    let meter = agent.chip.meter();
    let starts: Vec<u64> = meter.markers().iter().map(|marker| marker.cycle).collect();
    let ends: Vec<u64> = meter.handler_runs(vector::ADC).iter().map(|run| run.entry_cycle).collect();
    let samples = sample_cycles(&agent);
    assert_eq!(samples[0] - starts[0], 27 * CLOCK / 2);
    assert!((25 * CLOCK..25 * CLOCK + 4).contains(&(ends[0] - starts[0])));
    // A later one waits for the next clock of the prescaler.
    let waited = (starts[1] - starts[0]).next_multiple_of(CLOCK) - (starts[1] - starts[0]);
    assert_eq!(samples[1] - starts[1], waited + 3 * CLOCK / 2);
    assert!((waited + 13 * CLOCK..waited + 13 * CLOCK + 4).contains(&(ends[1] - starts[1])));
}

#[test]
fn free_running_samples_every_13_clocks() {
    let mut agent = Agent::new();
    agent.chip.measure(None);
    agent.write(&[(ADMUX, AVCC_REFERENCE), (ADCSRB, 0), (ADCSRA, START | 1 << 5)]);
    agent.run(20_000);
    let samples = sample_cycles(&agent);
    assert!(samples.len() > 20);
    assert!(samples.windows(2).skip(1).all(|pair| pair[1] - pair[0] == 13 * CLOCK));
}

#[test]
fn compare_match_b_triggers_at_a_fixed_point_of_the_period() {
    let mut agent = with_timer1();
    agent.write(&[(ADMUX, AVCC_REFERENCE), (ADCSRB, 5), (TIFR1, 4), (ADCSRA, TRIGGERED)]);
    agent.run(4000);
    agent.changes();
    agent.chip.measure(None);
    agent.run(100_000);
    let bottom = agent.changes().iter().find(|(_, o)| o.oc1a == Some(true)).unwrap().0;
    let samples = sample_cycles(&agent);
    assert!((samples.len() as i64 - 62).abs() <= 1, "10 kHz: the conversion outlasts the period of 800 cycles");
    for sample in samples {
        assert_eq!((sample + 1600 - bottom) % 800, COMPARE_B + 1 + 3 + 2 * CLOCK);
    }
    assert_eq!(agent.chip.meter().sample_jitter_cycles(0, 1600), Some(0));
    // Table 24-1: 13.5 clocks from the trigger, of which 2 lie before the sample.
    let meter = agent.chip.meter();
    for run in &meter.handler_runs(vector::ADC)[1..] {
        let sample = meter.samples().iter().rfind(|sample| sample.cycle < run.entry_cycle).unwrap();
        let delay = run.entry_cycle - sample.cycle;
        assert!((23 * CLOCK / 2..23 * CLOCK / 2 + 8).contains(&delay), "{delay}");
    }
}

#[test]
fn a_flag_that_stays_up_triggers_once() {
    let mut agent = with_timer1();
    let without_interrupt = TRIGGERED & !(1 << 3);
    agent.write(&[(ADMUX, AVCC_REFERENCE), (ADCSRB, 5), (TIFR1, 4)]);
    agent.chip.measure(None);
    agent.write(&[(ADCSRA, without_interrupt)]);
    agent.run(20_000);
    assert_eq!(sample_cycles(&agent).len(), 1);
    agent.write(&[(TIFR1, 4)]);
    agent.run(20_000);
    assert_eq!(sample_cycles(&agent).len(), 2);
}

#[test]
fn new_trigger_instant_waits_for_bottom() {
    let mut agent = with_timer1();
    agent.write(&[(ADMUX, AVCC_REFERENCE), (ADCSRB, 5), (TIFR1, 4), (ADCSRA, TRIGGERED)]);
    agent.run(4000);
    agent.chip.measure(None);
    agent.write(&[(0x8B, 2), (OCR1BL, 0)]);
    agent.run(8000);
    let phases: Vec<u64> = sample_cycles(&agent).windows(2).map(|pair| (pair[1] - pair[0]) % 800).collect();
    assert_eq!(phases.iter().filter(|phase| **phase != 0).collect::<Vec<_>>(), [&(512 - COMPARE_B)]);
}

#[test]
fn switching_off_drops_the_conversion() {
    let mut agent = Agent::new();
    agent.write(&[(ADMUX, AVCC_REFERENCE), (ADCSRA, START), (ADCSRA, 0)]);
    agent.run(3000);
    assert_eq!(agent.count(vector::ADC), 0);
    assert_eq!(agent.read(ADCSRA) & (1 << 6), 0);
}

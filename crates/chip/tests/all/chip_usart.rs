//! The serial line: byte times, buffers and overruns (data sheet sections 20.6 to 20.8).
use crate::common::Agent;
use motorbench_chip::SerialErrors;
use motorbench_chip::registers::*;

const TXEN: u8 = 1 << 3;
const RXEN: u8 = 1 << 4;
const UDRIE: u8 = 1 << 5;
const RXCIE: u8 = 1 << 7;
const BYTE_CYCLES: u64 = 320;
/// 500 kBd with U2X.
const SETUP: [(u16, u8); 3] = [(UCSR0A, 1 << 1), (UBRR0H, 0), (UBRR0L, 3)];

fn with_control(control: u8) -> Agent {
    let mut agent = Agent::new();
    agent.write(&SETUP);
    agent.write(&[(UCSR0B, control)]);
    agent
}

#[test]
fn bytes_in_a_row_take_ten_bits_each() {
    let mut agent = with_control(TXEN);
    agent.chip.measure(Some(UDR0));
    agent.write(&[(UDR0, b'a'), (UDR0, b'b')]);
    agent.run(1000);
    let sent = agent.chip.serial().read_timed();
    let begun = agent.chip.meter().markers()[0].cycle;
    assert_eq!(sent.iter().map(|timed| timed.byte).collect::<Vec<_>>(), b"ab");
    assert_eq!(sent[0].cycle - begun, BYTE_CYCLES);
    assert_eq!(sent[1].cycle - sent[0].cycle, BYTE_CYCLES);
}

#[test]
fn transmitter_holds_one_byte_behind_the_one_being_sent() {
    let mut agent = with_control(TXEN);
    agent.write(&[(UDR0, 1), (UDR0, 2), (UDR0, 3)]);
    assert_eq!(agent.read(UCSR0A) & (1 << 5), 0, "buffer full");
    agent.run(1000);
    assert_eq!(agent.chip.serial().read(), [1, 2]);
    assert_eq!(agent.chip.serial().errors().transmit_overwrites, 1);
    assert_eq!(agent.read(UCSR0A) & 0b0110_0000, 0b0110_0000, "buffer empty, transmission complete");
}

#[test]
fn empty_buffer_interrupts_as_soon_as_enabled() {
    let mut agent = with_control(TXEN);
    agent.write(&[(UCSR0B, TXEN | UDRIE)]);
    agent.run(100);
    assert_eq!(agent.count(vector::USART_UDRE), 1, "its handler switches it off");
    agent.write(&[(UDR0, 1), (UDR0, 2), (UCSR0B, TXEN | UDRIE)]);
    agent.run(20);
    assert_eq!(agent.count(vector::USART_UDRE), 1, "not while the buffer is full");
    agent.run(BYTE_CYCLES);
    assert_eq!(agent.count(vector::USART_UDRE), 2);
}

#[test]
fn received_bytes_arrive_one_after_the_other() {
    let mut agent = with_control(RXEN | RXCIE);
    agent.chip.measure(None);
    let begun = agent.chip.cycle();
    agent.chip.serial().write(b"motor");
    agent.run(2000);
    assert_eq!(agent.received(), *b"motor");
    let runs = agent.chip.meter().handler_runs(vector::USART_RX).to_vec();
    for (run, byte) in runs.iter().zip(1..) {
        let late = run.entry_cycle - begun - byte * BYTE_CYCLES;
        assert!(late < 4, "byte {byte} is {late} cycles late");
    }
    assert_eq!(agent.chip.serial().errors(), SerialErrors { deepest_backlog: 1, ..SerialErrors::default() });
}

#[test]
fn waiting_bytes_interrupt_until_all_are_fetched() {
    let mut agent = with_control(RXEN);
    agent.chip.serial().write([7, 8]);
    agent.run(1000);
    agent.write(&[(UCSR0B, RXEN | RXCIE)]);
    agent.run(300);
    assert_eq!(agent.count(vector::USART_RX), 2);
    assert_eq!(agent.received(), [7, 8]);
}

#[test]
fn three_bytes_wait_and_the_fourth_overruns() {
    let mut agent = with_control(RXEN);
    agent.chip.serial().write([1, 2, 3]);
    agent.run(2000);
    assert_eq!(agent.chip.serial().errors().overruns, 0);
    assert_eq!(agent.chip.serial().errors().deepest_backlog, 3);
    agent.chip.serial().write([4]);
    agent.run(1000);
    assert_eq!(agent.chip.serial().errors().overruns, 1);
    assert_ne!(agent.read(UCSR0A) & (1 << 3), 0, "DOR");
    assert_eq!([(); 3].map(|()| agent.read(UDR0)), [1, 2, 4]);
    assert_eq!(agent.read(UCSR0A) & (1 << 3 | 1 << 7), 0);
}

#[test]
fn wrong_speed_loses_the_bytes_of_both_directions() {
    let mut agent = with_control(RXEN | TXEN);
    agent.write(&[(UBRR0L, 16), (UDR0, 1)]);
    agent.chip.serial().write([2]);
    agent.run(5000);
    assert_eq!(agent.chip.serial().errors().baud_mismatches, 2);
    assert!(agent.chip.serial().read().is_empty());
    assert_eq!(agent.read(UCSR0A) & (1 << 7), 0);
}

#[test]
fn lines_come_whole() {
    let mut agent = with_control(TXEN);
    for byte in *b"ok\r\nno" {
        agent.write(&[(UDR0, byte)]);
        agent.run(BYTE_CYCLES);
    }
    agent.run(1000);
    assert_eq!(agent.chip.serial().read_line().as_deref(), Some("ok"));
    assert_eq!(agent.chip.serial().read_line(), None);
}

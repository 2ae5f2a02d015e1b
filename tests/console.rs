//! Console sessions on the host, over the same control loop as on the chip, with a motor that does not move.

use motorbench_core::console::{Console, Counters, Machine};
use motorbench_core::control_loop::{ControlLoop, Inputs, LoopConfig, duty_scale};
use motorbench_core::encoder::Edges;
use motorbench_core::message::{Request, Sample, State, Trip, WAITING};
use motorbench_core::settings::{BuildError, Param, Settings};
use motorbench_core::storage::Eeprom;
use proptest::prelude::*;

struct Memory([u8; 1024]);

impl Eeprom for Memory {
    fn read(&mut self, address: u16) -> u8 {
        self.0[address as usize]
    }

    fn ready(&mut self) -> bool {
        true
    }

    fn write(&mut self, address: u16, byte: u8) {
        self.0[address as usize] = byte;
    }
}

struct Host {
    control: ControlLoop,
    memory: Memory,
    sent: Vec<u8>,
    requests: Vec<Request>,
    emergency_stop: bool,
    listened: usize,
}

impl Host {
    fn tick(&mut self, request: Option<Request>) {
        let stop = if self.emergency_stop { Inputs::STOP_CLOSED } else { 0 };
        let inputs = Inputs {
            current_sum: 4096,
            duty_scale: duty_scale(12_288),
            flags: Inputs::MAIN_LOOP_ALIVE | stop,
            ..Inputs::default()
        };
        self.control.tick(request, &inputs);
    }
}

impl Machine for Host {
    type Memory = Memory;

    fn request(&mut self, request: Request) {
        self.requests.push(request);
        self.tick(Some(request));
    }

    fn look(&mut self, sample: &mut Sample, counters: &mut Counters) {
        self.tick(None);
        *sample = *self.control.sample();
        let (zeroing, zero_ok) = self.control.current_zero();
        *counters = Counters { zeroing, zero_ok, ..Counters::default() };
    }

    fn configure(&mut self, settings: &Settings) -> Result<(), BuildError> {
        self.control.configure(&LoopConfig::build(settings)?);
        Ok(())
    }

    fn memory(&mut self) -> &mut Memory {
        &mut self.memory
    }

    fn send(&mut self, byte: u8) {
        self.sent.push(byte);
    }

    fn host_spoke(&mut self) {}

    fn listen(&mut self) {
        self.listened += 1;
    }
}

/// A console on a board just switched on.
fn board() -> (Console, Host) {
    let settings = Settings::defaults();
    let control = ControlLoop::new(LoopConfig::build(&settings).expect("defaults"), Edges::default());
    let memory = Memory([0xff; 1024]);
    let mut host = Host { control, memory, sent: Vec::new(), requests: Vec::new(), emergency_stop: false, listened: 0 };
    let mut console = Console::default();
    console.start(&mut host).expect("defaults");
    say(&mut console, &mut host, "echo off");
    (console, host)
}

/// Sends a line; the reply, without carriage returns.
fn say(console: &mut Console, host: &mut Host, line: &str) -> String {
    host.sent.clear();
    line.bytes().chain(*b"\n").for_each(|byte| console.receive(byte, host));
    String::from_utf8(host.sent.clone()).expect("text").replace('\r', "")
}

/// At the tick of 2 kHz, and where a kind makes much of its numbers, less fits than 16 bits of milliseconds or counts.
#[test]
fn a_sequence_that_cannot_be_counted_is_refused() {
    let (mut console, mut host) = board();
    for line in ["set tick_rate 2000", "arm", "mode open", "sequence steps 1 0 32767"] {
        assert_eq!(say(&mut console, &mut host, line), "ok\n", "{line}");
    }
    let requests = host.requests.len();
    for (line, reply) in [
        ("sequence steps 1 0 32768", "error: expected PERIOD 0..32767\n"),
        ("record steps 1 0 65535", "error: expected PERIOD 0..32767\n"),
        ("sequence identify 1 0 16384", "error: expected PERIOD 0..16383\n"),
        ("sequence stairs 1 0 1 16384", "error: expected COUNT 0..16383\n"),
        ("sequence coast 1 0 1 65535", "error: expected COUNT 0..8191\n"),
        // 200 ticks.
        ("sequence chirp 1 0 100 51", "error: expected COUNT 0..50\n"),
    ] {
        assert_eq!(say(&mut console, &mut host, line), reply, "{line}");
    }
    assert_eq!(host.requests.len(), requests);
}

/// To the last one, of which six digits would say 1234570.
#[test]
fn a_recording_says_how_many_samples_it_has() {
    let (mut console, mut host) = board();
    for line in ["arm", "mode open", "record steps 1 0 5 6"] {
        line.bytes().chain(*b"\n").for_each(|byte| console.receive(byte, &mut host));
    }
    let plays = Sample { state: State(State::ARMED | State::PLAYING | 1), ..Sample::default() };
    for _ in 0..1_234_567 {
        console.telemetry(&plays, &mut host);
        host.sent.clear();
    }
    let still = Sample { state: State(State::ARMED | 1), ..Sample::default() };
    console.telemetry(&still, &mut host);
    let sent = String::from_utf8_lossy(&host.sent).into_owned();
    assert!(sent.contains("done: 1234567 samples"), "{sent}");
}

/// As many samples as may wait are from before the sequence; they are left out, and none of the sequence is. Where none
/// comes, the recording ends all the same.
#[test]
fn a_recording_leaves_out_what_was_before_the_sequence() {
    for (before, playing) in (0..=WAITING).flat_map(|before| [(before, 5), (before, 0)]) {
        let (mut console, mut host) = board();
        say(&mut console, &mut host, "arm");
        say(&mut console, &mut host, "mode open");
        b"record steps 1 0 5 6\n".iter().for_each(|&byte| console.receive(byte, &mut host));
        host.sent.clear();
        let still = Sample { state: State(State::ARMED | 1), ..Sample::default() };
        let plays = Sample { state: State(State::ARMED | State::PLAYING | 1), ..Sample::default() };
        (0..before).for_each(|_| console.telemetry(&still, &mut host));
        (0..playing).for_each(|_| console.telemetry(&plays, &mut host));
        assert!(!host.sent.windows(5).any(|bytes| bytes == b"done:"), "{before} {playing}");
        (0..=WAITING).for_each(|_| console.telemetry(&still, &mut host));
        let sent = String::from_utf8_lossy(&host.sent).into_owned();
        assert!(sent.contains(&format!("done: {playing} samples")), "{before} {playing}: {sent}");
    }
}

#[test]
fn a_session() {
    let (mut console, mut host) = board();
    for (line, reply) in [
        ("arm", "ok\n"),
        ("mode speed", "ok\n"),
        ("ref 10", "ok\n"),
        ("ref", "error: expected ref VALUE\n"),
        ("ref 9999", "error: expected a number in -511.984..511.984\n"),
        ("mode fast", "error: expected mode off|open|speed|position|lqr_speed|lqr_position\n"),
        ("set speed_kp 0.5 speed_ki 2", "ok\n"),
        ("show speed_kp", "# speed_kp 0.5 V s/rad -1000..1000\nok\n"),
        ("set speed_kp 0.7 nonsense 1", "error: no such setting\n"),
        ("set speed_kp 0.7 speed_b 9", "error: speed_b expected a number in 1 0..2\n"),
        ("show speed_kp", "# speed_kp 0.5 V s/rad -1000..1000\nok\n"),
        ("set speed_kp 900", "error: speed_kp is too large for fixed point\n"),
        ("set wiring 1", "error: disarm first\n"),
        ("stop", "ok\n"),
        ("disarm", "ok\n"),
        ("mode speed", "error: arm first\n"),
        ("zero current", "ok\n"),
        ("zero", "error: expected zero current|position\n"),
        ("arm now", "error: expected arm \n"),
        ("Arm", "error: unknown command, see help\n"),
        ("stream text 0", "error: expected stream off|text|binary [DIVIDER]\n"),
        ("alive", "ok\n"),
    ] {
        assert_eq!(say(&mut console, &mut host, line), reply, "{line}");
    }
    assert!(!host.control.sample().state.has(State::ARMED));
}

#[test]
fn a_trip_is_named_and_must_be_cleared() {
    let (mut console, mut host) = board();
    host.emergency_stop = true;
    assert_eq!(say(&mut console, &mut host, "arm"), "error: trip 8 emergency stop, 0 s ago; clear it\n");
    host.emergency_stop = false;
    assert!(say(&mut console, &mut host, "status").contains("trip 8 emergency stop"));
    assert_eq!(say(&mut console, &mut host, "clear"), "ok\n");
    assert_eq!(say(&mut console, &mut host, "arm"), "ok\n");
    assert_eq!(host.control.sample().trip, Trip::None);
}

#[test]
fn settings_survive_a_save_and_a_load() {
    let (mut console, mut host) = board();
    assert_eq!(say(&mut console, &mut host, "load"), "error: nothing saved by this version\n");
    say(&mut console, &mut host, "set speed_ki 7.5");
    assert_eq!(say(&mut console, &mut host, "save"), "ok\n");
    (0..2000).for_each(|_| console.poll(&mut host));
    assert_eq!(say(&mut console, &mut host, "defaults"), "ok\n");
    assert_eq!(console.settings().get(Param::SpeedKi), 1.0);
    assert_eq!(say(&mut console, &mut host, "load"), "ok\n");
    assert_eq!(console.settings().get(Param::SpeedKi), 7.5);
}

/// What is saved by another version is not taken for settings; the board says so until a person has answered.
#[test]
fn settings_of_another_version_must_be_answered() {
    for (answer, answered) in
        [("defaults", true), ("set trip_peak 1", true), ("save", true), ("load", false), ("show", false)]
    {
        let (_, mut host) = board();
        host.memory.0[..300].fill(0x5a);
        let mut console = Console::default();
        console.start(&mut host).expect("defaults");
        say(&mut console, &mut host, "echo off");
        let unloaded = "saved settings are of another version: not loaded, defaults in force";
        assert!(say(&mut console, &mut host, "status").contains(unloaded));
        assert!(say(&mut console, &mut host, "arm").starts_with(&format!("error: {unloaded}")));
        say(&mut console, &mut host, answer);
        assert_eq!(say(&mut console, &mut host, "arm") == "ok\n", answered, "{answer}");
    }
}

#[test]
fn help_and_show_list_everything_and_end_with_ok() {
    let (mut console, mut host) = board();
    for (line, least) in [("help", 20), ("show", Param::COUNT), ("status", 3), ("version", 2)] {
        let reply = say(&mut console, &mut host, line);
        let (last, information) = reply.trim_end().rsplit_once('\n').map(|(a, b)| (b, a)).expect("lines");
        assert_eq!(last, "ok", "{line}");
        // Between the lines the host may show that it is there.
        assert_eq!(std::mem::take(&mut host.listened), information.lines().count(), "{line}");
        assert!(information.lines().count() >= least && information.lines().all(|l| l.starts_with("# ")), "{reply}");
    }
}

#[test]
fn the_plotter_line() {
    let (mut console, mut host) = board();
    say(&mut console, &mut host, "stream text 1");
    host.sent.clear();
    let mut sample = Sample::default();
    host.look(&mut sample, &mut Counters::default());
    console.telemetry(&sample, &mut host);
    let line = String::from_utf8(host.sent.clone()).expect("text");
    assert_eq!(line, "reference:0,position:0,speed:0,current:0,duty:0\r\n");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Random bytes: no request, no setting, unless the line is a valid command to the letter.
    #[test]
    fn random_bytes_do_nothing(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        let (mut console, mut host) = board();
        bytes.iter().for_each(|&byte| console.receive(byte, &mut host));
        prop_assert!(host.requests.is_empty());
        prop_assert_eq!(console.settings(), &Settings::defaults());
    }

    /// Commands with one character changed never arm.
    #[test]
    fn nearly_arm(position in 0usize..3, byte in any::<u8>()) {
        let mut line = *b"arm";
        line[position] = byte;
        prop_assume!(&line != b"arm" && !line.iter().any(|byte| b"\r\n\x08\x7f\x15".contains(byte)));
        let (mut console, mut host) = board();
        line.iter().chain(b"\n").for_each(|&byte| console.receive(byte, &mut host));
        prop_assert!(host.requests.is_empty());
    }
}

/// A move whose profile changes on the way ends exactly at its target, and the reference never jumps.
#[test]
fn a_profile_may_change_on_its_way() {
    for change in ["jerk_time 64", "jerk_time 0", "acceleration 150", "cruise_speed 7"] {
        let (mut console, mut host) = board();
        for line in ["set trip_encoder 0 jerk_time 20", "arm", "mode position", "ref 30"] {
            assert_eq!(say(&mut console, &mut host, line), "ok\n", "{line}");
        }
        let mut references = Vec::new();
        for tick in 0..20_000 {
            if tick == 100 {
                assert_eq!(say(&mut console, &mut host, &format!("set {change}")), "ok\n");
            }
            host.tick(None);
            references.push(host.control.sample().reference);
        }
        let sample = host.control.sample();
        assert!(sample.trip == Trip::None && !sample.state.has(State::MOVING), "{sample:?}");
        // 30 rad at 2000 counts a turn; 100 rad/s are 32 counts a tick, and the `set` took one of its own.
        assert_eq!(references.last(), Some(&9549));
        assert!(references.windows(2).all(|pair| (0..=64).contains(&(pair[1] - pair[0]))), "{change}");
    }
}

#[test]
fn a_reference_in_a_sequence_goes_on_from_where_the_sequence_stands() {
    let (mut console, mut host) = board();
    for line in ["set trip_encoder 0", "arm", "mode speed", "ref 5", "sequence steps 100 0 1000"] {
        assert_eq!(say(&mut console, &mut host, line), "ok\n", "{line}");
    }
    (0..100).for_each(|_| host.tick(None));
    let before = host.control.sample().reference;
    assert!(before.abs() > 50 * 64, "{before}");
    assert_eq!(say(&mut console, &mut host, "ref 20"), "ok\n");
    // 2000 rad/s2 are 2 rad/s a tick.
    let after = host.control.sample().reference;
    assert!((after - before).abs() <= 4 * 128, "{before} {after}");
    (0..1000).for_each(|_| host.tick(None));
    assert_eq!(host.control.sample().reference, 20 * 64);
}

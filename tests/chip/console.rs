//! The console on the chip: what it refuses, and settings that outlive a power cut.

use crate::common::Uno;
use motorbench_core::message::State;
use motorbench_core::protocol::Frame;

/// All settings as `show` lists them.
fn settings(uno: &mut Uno) -> String {
    let shown = uno.ask("show");
    assert!(shown.ends_with("ok\n") && shown.lines().count() > 50, "{shown}");
    shown
}

fn is_at_rest(uno: &mut Uno) {
    let now = uno.bench.now();
    assert_eq!((now.duty, now.speed_rad_per_s), (0.0, 0.0));
    uno.run_s(0.01);
    assert!(!uno.last().state.has(State::ARMED));
}

#[test]
fn a_million_random_bytes_arm_nothing_and_change_nothing() {
    let mut uno = Uno::start();
    let before = settings(&mut uno);
    let mut random = 0x1234_5678u32;
    for _ in 0..200 {
        let bytes: Vec<u8> = std::iter::repeat_with(|| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 24) as u8
        })
        .take(5000)
        .collect();
        uno.bench.serial().write(&bytes);
        uno.run_s(0.101);
    }
    uno.run_s(0.2);
    uno.ask("");
    uno.ask("alive");
    assert_eq!(settings(&mut uno), before);
    is_at_rest(&mut uno);
}

#[test]
fn malformed_commands_are_refused_and_change_nothing() {
    let mut uno = Uno::start();
    let before = settings(&mut uno);
    for line in [
        "Arm",
        "ARM",
        "arm now",
        "arm\u{1}",
        "armm",
        "ar m",
        "disarm 1",
        "stop it",
        "mode",
        "mode 2",
        "mode Speed",
        "mode speed speed",
        "ref",
        "ref 1 2",
        "ref x",
        "ref 1e",
        "ref 0x10",
        "ref nan",
        "ref 1",
        "set",
        "set speed_kp",
        "set speed_kp x",
        "set speed_kp 1 speed_ki",
        "set speed_kp 1001",
        "set speed_kp 900",
        "set speed_kp 1e-9",
        "set speed_kp 0.1 nonsense 1",
        "set nonsense 1",
        "set speed_range 500",
        "set tick_rate 1500",
        "show speed",
        "zero",
        "zero speed",
        "sequence",
        "sequence steps",
        "sequence steps x",
        "sequence steps 1 2 3 4 5 6",
        "sequence walk 1",
        "record steps 1",
        "stream",
        "stream text 0",
        "stream text 256",
        "stream binary -1",
        "save it",
        "load 1",
        "defaults now",
        "clear x",
        "echo",
        "echo maybe",
        "version 2",
        "helpme",
        "=",
        "set=1",
        "set speed_kp=1",
        "set speed_kp,1",
    ] {
        uno.refused(line);
    }
    uno.refused(&"x".repeat(97));
    assert_eq!(settings(&mut uno), before);
    is_at_rest(&mut uno);
}

/// After a reset the current's zero is taken for 256 ticks: a drive would spoil it. What was sent meanwhile is obeyed afterwards.
#[test]
fn nobody_arms_before_the_zero_of_the_current_is_known() {
    let mut uno = Uno::power_on();
    uno.bench.run_s(0.1).expect("the chip runs");
    uno.bench.serial().write("arm\n");
    uno.bench.run_s(0.15).expect("the chip runs");
    assert!(uno.bench.serial().read().is_empty(), "the greeting waits");
    uno.bench.run_s(0.05).expect("the chip runs");
    let said = String::from_utf8_lossy(&uno.bench.serial().read()).into_owned();
    assert!(said.contains("motorbench") && said.ends_with("ok\r\n"), "{said:?}");
    uno.listen();
    assert!(uno.ask("status").contains("armed 1"), "{}", uno.replies);
}

/// Samples from before the sequence may still wait when it begins; they do not end the recording.
#[test]
fn a_recording_is_of_the_whole_sequence() {
    let mut uno = Uno::start();
    uno.bench.serial().write("stream off\n");
    uno.run_s(0.03);
    uno.samples.clear();
    // One line right after the other, and text again afterwards.
    uno.bench.serial().write("arm\nmode open\nrecord steps 1 0 5 6\n");
    uno.bench.run_s(0.4).expect("the chip runs");
    let mut after = Vec::new();
    for byte in uno.bench.serial().read() {
        after.push(byte);
        if let Some(Frame::Sample(sample)) = uno.decoder.push(byte) {
            uno.samples.push(sample);
        }
    }
    let after = String::from_utf8_lossy(&after);
    assert!(after.contains("done: 120 samples, dropped 0"), "{after}");
    assert_eq!(uno.samples.len(), 120);
    assert!(uno.samples.iter().all(|sample| sample.state.has(State::PLAYING)));
    assert!(uno.samples.windows(2).all(|pair| pair[1].tick == pair[0].tick + 1));
}

#[test]
fn a_power_cut_at_any_byte_of_a_save_leaves_the_old_or_the_new() {
    let mut uno = Uno::start();
    uno.order("set speed_ki 2");
    uno.order("save");
    uno.run_s(2.0);
    assert!(uno.replies.contains("# saved"), "{}", uno.replies);
    uno.order("set speed_ki 3 cruise_speed 55");
    uno.bench.serial().write("save\n");
    let mut images = Vec::new();
    while let Some(image) = uno.bench.run_until_eeprom_write(1, false, 0.3).expect("the chip runs") {
        images.push(image);
    }
    images.push(uno.bench.chip().eeprom());
    let (mut old, mut new) = (0, 0);
    for (at, image) in images.iter().enumerate() {
        let mut uno = Uno::power_on();
        uno.bench.chip_mut().set_eeprom(image);
        uno.listen();
        let (ki, cruise) = (uno.ask("show speed_ki"), uno.ask("show cruise_speed"));
        match (ki.starts_with("# speed_ki 2 "), cruise.starts_with("# cruise_speed 100 ")) {
            (true, true) => old += 1,
            (false, false) => {
                assert!(ki.starts_with("# speed_ki 3 ") && cruise.starts_with("# cruise_speed 55 "), "{at}: {ki}");
                new += 1;
            }
            _ => panic!("a mixture after {at} bytes: {ki}{cruise}"),
        }
    }
    println!("power cut at each of {} writes: {old} times the old settings, {new} times the new", images.len());
    assert!(images.len() > 200 && old > 200 && new >= 1);
}

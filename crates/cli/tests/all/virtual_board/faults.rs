//! Faults during a recording, and what is said about each.

use super::STEPS;
use super::console::console;
use crate::board::{Board, MOTORBENCH, rows, text};
use crate::motor::PIVT6_TOML;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::Duration;

#[test]
fn a_blocked_rotor_trips_and_what_had_come_is_kept() {
    let mut board = Board::new("trip");
    let recording = board.command("record", &["--amplitude", "8"]).spawn().unwrap();
    board.has_recorded(600);
    board.change("block on");
    let done = recording.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("tripped"), "{}", text(&done.stderr));
    assert!(rows(&board.folder.join("run.csv")) > 500);
    board.motor_is_off();
    // The trip is latched: what to do about it is said, at this board and no other.
    let again = board.run("record", &STEPS);
    assert_eq!(again.status.code(), Some(1));
    let clear = format!("then `motorbench connect --port {} clear`", board.port().display());
    assert!(text(&again.stderr).contains(&clear), "{}", text(&again.stderr));
}

/// Whatever is asked of the board then, it says what to do: a trip whose cause stays comes again.
#[test]
fn an_emergency_stop_that_is_pressed_is_named() {
    let board = Board::new("stop");
    board.order("stop on");
    std::fs::write(board.folder.join("rig.toml"), PIVT6_TOML).unwrap();
    let stand = ["--rig", "rig.toml", "--voltages", "6,7,8"];
    for (command, arguments) in [
        ("connect", &["clear"][..]),
        ("record", &STEPS),
        ("autotune", &[]),
        ("tune", &["--keys", "a"]),
        ("stand", &stand),
    ] {
        let done = board.run(command, arguments);
        assert_eq!(done.status.code(), Some(1), "{command}: {}", text(&done.stderr));
        assert!(text(&done.stderr).contains("release the emergency stop; then"), "{command}: {}", text(&done.stderr));
    }
    let (mut talk, mut fingers, mut answers) = console(&board);
    writeln!(fingers, "clear").unwrap();
    assert!(answers.next().unwrap().contains("release the emergency stop; then"));
    board.order("stop off");
    drop(fingers);
    assert_eq!(talk.wait().unwrap().code(), Some(1));
    assert_eq!(board.run("connect", &["clear"]).status.code(), Some(0));
    assert_eq!(board.run("record", &STEPS).status.code(), Some(0));
}

/// What a class may break, and what is said to it; repaired, the board runs again.
#[test]
fn each_fault_of_the_board_is_named() {
    let board = Board::new("faults");
    let speed = ["--mode", "speed", "--sequence", "steps", "--amplitude", "60", "--period", "1000", "--count", "2"];
    // The back-EMF shows that a coupling slips.
    assert_eq!(board.run("connect", &["set torque_constant 0.072"]).status.code(), Some(0));
    for (fault, repaired, said) in [
        ("encoder a-open", "encoder ok", "encoder"),
        ("encoder b-open", "encoder ok", "encoder"),
        ("encoder a-high", "encoder ok", "encoder"),
        ("encoder b-low", "encoder ok", "encoder"),
        ("encoder shorted", "encoder ok", "encoder"),
        ("encoder noisy", "encoder ok", "encoder"),
        ("encoder slipping", "encoder ok", "counts too few"),
        ("adc dead", "adc ok", "converter silent"),
    ] {
        board.order(fault);
        let done = board.run("record", &speed);
        assert_eq!(done.status.code(), Some(1), "{fault}: {}", text(&done.stderr));
        assert!(text(&done.stderr).contains(said), "{fault}: {}", text(&done.stderr));
        board.motor_is_off();
        board.order(repaired);
        assert_eq!(board.run("connect", &["clear"]).status.code(), Some(0), "{fault}");
    }
    // A dip is seen where the supply is measured.
    board.order("supply dip");
    assert_eq!(board.run("connect", &["status"]).status.code(), Some(0));
    assert!(text(&board.run("connect", &["status"]).stdout).contains("trip 0"));
    assert_eq!(board.run("connect", &["set supply_divider 4"]).status.code(), Some(0));
    board.order("supply dip");
    let status = text(&board.run("connect", &["status"]).stdout);
    assert!(status.contains("trip 7 supply out of range, ") && status.contains(" s ago; clear it"), "{status}");
    assert_eq!(board.run("connect", &["clear"]).status.code(), Some(0));
    // A sensor that shows what it has shown is no fault that anything sees at rest.
    board.order("current frozen");
    board.order("current ok");
    // Nothing comes of a board that cannot send.
    board.order("uart stuck");
    assert_eq!(board.run("connect", &["status"]).status.code(), Some(3));
    board.order("uart ok");
    assert_eq!(board.run("record", &speed).status.code(), Some(0));
}

#[test]
fn an_unplugged_board_ends_the_recording_and_keeps_it() {
    let mut board = Board::new("unplug");
    let recording = board.command("record", &[]).spawn().unwrap();
    board.has_recorded(600);
    board.change("quit");
    let done = recording.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("connection is gone"), "{}", text(&done.stderr));
    assert!(rows(&board.folder.join("run.csv")) > 500);
}

#[test]
fn ctrl_c_stops_the_motor_first() {
    let board = Board::new("interrupt");
    let recording = board.command("record", &[]).spawn().unwrap();
    board.has_recorded(600);
    let interrupted = Command::new("kill").args(["-INT", &recording.id().to_string()]).status().unwrap();
    assert!(interrupted.success());
    let done = recording.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    let (side, said) = (board.side_file(), text(&done.stdout));
    assert_eq!(side["ended"], "interrupted");
    let lacks = side["coverage"]["lacks"].as_array().unwrap();
    assert_eq!((lacks.len(), &lacks[0]["what"]), (1, &"the rest of its sequence".into()), "{side}");
    assert!(said.contains("  lacks the rest of its sequence: play it whole\n"), "{said}");
    assert!(!said.contains("enough to identify"), "{said}");
    board.motor_is_off();
}

#[test]
fn a_reset_in_the_middle_is_named() {
    let mut board = Board::new("reset");
    let recording = board.command("record", &[]).spawn().unwrap();
    board.has_recorded(600);
    board.change("reset");
    let done = recording.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("the board was reset (external)"), "{}", text(&done.stderr));
    assert!(rows(&board.folder.join("run.csv")) > 500);
    assert!(board.side_file()["ended"]["failed"].as_str().unwrap().contains("reset"));
    board.motor_is_off();
}

#[test]
fn busy_and_missing_ports_and_full_disks_are_named() {
    let board = Board::new("busy");
    let recording = board.command("record", &STEPS).spawn().unwrap();
    board.has_recorded(100);
    let second = board.run("connect", &["status"]);
    assert_eq!(second.status.code(), Some(3));
    assert!(text(&second.stderr).contains("in use by another program"), "{}", text(&second.stderr));
    assert_eq!(recording.wait_with_output().unwrap().status.code(), Some(0));
    let side = board.side_file();
    let undisturbed = serde_json::json!({ "lost_frames": 0, "damaged_frames": 0 });
    assert_eq!((side["missing_ticks"].as_u64(), &side["losses"]), (Some(0), &undisturbed), "the first one");
    let missing = Command::new(MOTORBENCH).args(["connect", "--port", "/dev/none", "status"]).output().unwrap();
    assert_eq!(missing.status.code(), Some(3));
    assert!(text(&missing.stderr).contains("motorbench ports"), "{}", text(&missing.stderr));
    for (file, remedy) in [("/proc/none.csv", "choose another folder"), ("none/run.csv", "make its folder first")] {
        let none = board.run("record", &["--out", file]);
        assert_eq!(none.status.code(), Some(3), "{}", text(&none.stderr));
        assert!(text(&none.stderr).contains(remedy), "{}", text(&none.stderr));
    }
}

/// A program that had the port open before, and takes what the board says: no read waits for its turn, and Ctrl-C is heard.
#[test]
fn another_reader_of_the_port_is_named_and_blocks_nothing() {
    let board = Board::new("reader");
    let line = std::fs::File::open(board.port()).unwrap();
    let mut thief = Command::new("cat").stdin(line).stdout(Stdio::null()).spawn().unwrap();
    let talk = board.run("connect", &["status"]);
    let stopped = board.command("record", &STEPS).spawn().unwrap();
    // It calls for eight seconds.
    std::thread::sleep(Duration::from_secs(2));
    let begun = std::time::Instant::now();
    assert!(Command::new("kill").args(["-INT", &stopped.id().to_string()]).status().unwrap().success());
    let stopped = stopped.wait_with_output().unwrap();
    let took = begun.elapsed();
    thief.kill().unwrap();
    thief.wait().unwrap();
    assert_eq!(talk.status.code(), Some(3), "{}", text(&talk.stderr));
    let named = format!("another program may be reading the port (`lsof {}`", board.port().display());
    assert!(text(&talk.stderr).contains(&named), "{}", text(&talk.stderr));
    assert_eq!((stopped.status.code(), text(&stopped.stderr)), (Some(1), "motorbench: stopped by hand\n".into()));
    assert!(took < Duration::from_secs(20), "{took:?}");
}

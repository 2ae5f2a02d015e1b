//! The virtual board as a process: its firmware, its EEPROM, and the lines that change it.

use super::terminal::Terminal;
use crate::board::{Board, MOTORBENCH, text, until};
use crate::motor::PIVT6_TOML;
use motorbench_data::recording::Channel;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

/// Who has neither cargo nor the compiler runs what was built before; where there is nothing, the message says what to
/// give.
#[test]
fn a_virtual_board_needs_no_cargo() {
    let built = motorbench_chip::firmware_elf().expect("firmware");
    let folder = tempfile::tempdir().unwrap();
    let start = |arguments: &[&str], target: Option<&std::path::Path>| {
        let mut command = Command::new(MOTORBENCH);
        command.args(["virtual", "--seconds", "0", "--link", "board"]).args(arguments).current_dir(folder.path());
        command.env("PATH", "").env_remove("CARGO").stdin(Stdio::null());
        if let Some(target) = target {
            command.env("CARGO_TARGET_DIR", target);
        }
        command.output().unwrap()
    };
    let ready = start(&[], None);
    assert_eq!(ready.status.code(), Some(0), "{}", text(&ready.stderr));
    let without = start(&[], Some(folder.path()));
    assert_eq!(without.status.code(), Some(3), "{}", text(&without.stderr));
    assert!(text(&without.stderr).contains("give --firmware ELF: "), "{}", text(&without.stderr));
    let given = start(&["--firmware", built.to_str().unwrap()], Some(folder.path()));
    assert_eq!(given.status.code(), Some(0), "{}", text(&given.stderr));
}

#[test]
fn the_eeprom_is_kept_between_runs() {
    let file = std::env::temp_dir().join(format!("motorbench-eeprom-{}.bin", std::process::id()));
    let arguments = ["--eeprom", file.to_str().unwrap()];
    let mut board = Board::with("eeprom", &arguments);
    assert_eq!(board.run("connect", &["set speed_kp 0.07"]).status.code(), Some(0));
    std::fs::write(board.folder.join("saved.txt"), "set speed_kp 0.08\n").unwrap();
    assert_eq!(board.run("send", &["saved.txt", "--save"]).status.code(), Some(0));
    // What is set and not saved is lost.
    assert_eq!(board.run("connect", &["set speed_ki 9"]).status.code(), Some(0));
    board.change("quit");
    assert!(board.process.wait().unwrap().success());
    drop(board);
    let board = Board::with("eeprom", &arguments);
    let shown = text(&board.run("connect", &["show speed_kp", "show speed_ki"]).stdout);
    assert!(shown.starts_with("speed_kp 0.08 ") && !shown.contains("speed_ki 9"), "{shown}");
    drop(board);
    std::fs::write(&file, "short").unwrap();
    let refused = Command::new(MOTORBENCH).arg("virtual").args(arguments).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("has 5 bytes, an EEPROM 1024"), "{}", text(&refused.stderr));
    std::fs::remove_file(&file).unwrap();
}

/// What the board saves finds no room; and a device without an end is no EEPROM.
#[test]
fn an_eeprom_without_room_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let virtual_board = |eeprom: &std::path::Path| {
        let mut command = Command::new(MOTORBENCH);
        command.args(["virtual", "--seconds", "900", "--link"]).arg(at("board")).arg("--eeprom").arg(eeprom);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let endless = virtual_board("/dev/full".as_ref()).wait_with_output().unwrap();
    assert_eq!(endless.status.code(), Some(1));
    assert!(text(&endless.stderr).contains("/dev/full has more than 1024 bytes"), "{}", text(&endless.stderr));

    let full = virtual_board(&at("board.bin"));
    until("a port", || at("board").exists());
    std::os::unix::fs::symlink("/dev/full", at(&format!("board.bin.{}.part", full.id()))).unwrap();
    Command::new(MOTORBENCH)
        .args(["connect", "--port"])
        .arg(at("board"))
        .args(["set speed_kp 0.06", "save"])
        .output()
        .unwrap();
    let full = full.wait_with_output().unwrap();
    let message = text(&full.stderr);
    assert_eq!(full.status.code(), Some(3), "{message}");
    assert!(message.contains("board.bin: No space left on device") && message.contains("make room"), "{message}");
    assert!(!at("board.bin").exists() && std::fs::read_dir(folder.path()).unwrap().next().is_none(), "nothing is left");
}

/// A script that starts boards learns all it needs from one line. A second board does not take the place of the first.
#[test]
fn a_script_learns_of_the_board_it_has_started() {
    let folder = tempfile::TempDir::new().unwrap();
    let link = folder.path().join("board12");
    let start = || {
        let mut command = Command::new(MOTORBENCH);
        command.args(["virtual", "--seconds", "300", "--json", "--with", "effect coulomb_friction torque_Nm=0.02"]);
        command.arg("--link").arg(&link).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().unwrap()
    };
    let mut process = start();
    let mut lines = BufReader::new(process.stdout.take().unwrap()).lines();
    let mut next = || serde_json::from_str::<serde_json::Value>(&lines.next().unwrap().unwrap()).unwrap();
    let ready = next();
    assert_eq!(ready["port"], link.to_str().unwrap());
    assert_eq!(ready["effects"], serde_json::json!({ "coulomb_friction": { "torque_Nm": 0.02 } }));
    assert_eq!(ready["motor"]["resistance_ohm"], 5.84);
    let said = Command::new(MOTORBENCH).args(["connect", "--port"]).arg(&link).arg("version").output().unwrap().stdout;
    assert_eq!(text(&said).lines().next(), ready["firmware"].as_str());

    let mut hands = process.stdin.take().unwrap();
    writeln!(hands, "brake 0.01\nbrake much").unwrap();
    assert_eq!(next(), serde_json::json!({ "line": "brake 0.01", "error": null }));
    assert!(next()["error"].as_str().unwrap().contains("expected a number"));

    let second = start().wait_with_output().unwrap();
    assert_eq!(second.status.code(), Some(3));
    assert!(text(&second.stderr).contains("a virtual board runs there"), "{}", text(&second.stderr));
    let control = std::os::unix::net::UnixStream::connect(ready["control"].as_str().unwrap());
    writeln!(control.unwrap(), "quit").unwrap();
    assert!(process.wait().unwrap().success());
    assert!(!link.exists());
}

/// A turning motor becomes another; its speed in open loop is what the equations say of each.
#[test]
fn motor_and_effects_change_while_it_runs() {
    let mut board = Board::with("change", &["--with", "effect coulomb_friction torque_Nm=0.01"]);
    // At 9 V the L293D drops 2.575 V in the mean.
    let speed = |k: f64, friction_nm: f64| (9.0 - 2.575 - 5.84 * friction_nm / k) / (k + 5.84 * 5e-6 / k);
    let mut check = |order: &str, expected: f64| {
        board.change(order);
        let done = board.run("record", &["--sequence", "stairs", "--amplitude", "9", "--period", "400"]);
        assert_eq!(done.status.code(), Some(0), "{order}: {}", text(&done.stderr));
        let recording = motorbench_files::recording(&board.folder.join("run.csv"), &[]).unwrap();
        let voltage_v = recording.get(Channel::Voltage).unwrap();
        let settled = voltage_v.iter().rposition(|voltage_v| *voltage_v > 8.9).expect("the highest stair");
        let speed = recording.get(Channel::Speed).unwrap()[settled];
        assert!((speed / expected - 1.0).abs() < 0.01, "{order}: {speed} instead of {expected}");
    };
    check("", speed(0.072, 0.01));
    check("effect coulomb_friction torque_Nm=0.02", speed(0.072, 0.02));
    check("motor torque_constant_Nm_per_A=0.1", speed(0.1, 0.02));
    check("effect voltage_drop drop_V=1", speed(0.1, 0.02) - 1.0 / (0.1 + 5.84 * 5e-6 / 0.1));
    check("effect voltage_drop off", speed(0.1, 0.02));
    // What is refused changes nothing.
    check("effect rust x=1", speed(0.1, 0.02));
}

/// The board does what another process tells it, and answers however fast its motor turns. Where it has not the
/// terminal it does not wait for what is typed there.
#[test]
fn a_board_in_the_background() {
    let folder = std::env::temp_dir().join(format!("motorbench-background-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let board = Board { process: Command::new("true").spawn().unwrap(), folder };
    let name = board.folder.file_name().unwrap().to_string_lossy().into_owned();
    let link = board.port().display().to_string();
    let shell = format!("bash -mc '{MOTORBENCH} virtual --seconds 900 --link {link} & sleep 600'");
    if Command::new("tmux").args(["-L", &name, "new-session", "-d", "-s", &name, &shell]).status().is_err() {
        return;
    }
    let terminal = Terminal(name);
    until("a port", || board.port().exists());
    terminal.press("Enter");
    let tell = |line: &str| board.run_alone(&["virtual", "--link", &link, "--tell", line]);
    // Twice as long as it looks at the terminal.
    assert_eq!(tell("wait 0.4").status.code(), Some(0));
    assert!(text(&board.run("connect", &["version"]).stdout).starts_with("motorbench "));
    assert_eq!(tell("load 0.4").status.code(), Some(0));
    assert_eq!(tell("wait 2").status.code(), Some(0));
    assert!(text(&board.run("connect", &["version"]).stdout).starts_with("motorbench "), "the motor races");
    // A name is that of who says it, wherever the board was begun.
    let elsewhere = board.folder.join("else where");
    std::fs::create_dir(&elsewhere).unwrap();
    std::fs::write(elsewhere.join("own.toml"), PIVT6_TOML).unwrap();
    let mut command = Command::new(MOTORBENCH);
    command.args(["virtual", "--link", &link, "--tell", "model own.toml"]).current_dir(&elsewhere);
    let done = command.output().unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let refused = tell("load 1e30");
    assert_eq!((refused.status.code(), text(&refused.stderr).contains("expected -0.493")), (Some(1), true));
    assert_eq!(tell("quit").status.code(), Some(0));
    until("the end", || !board.port().exists());
    let none = tell("wait 1");
    assert_eq!(none.status.code(), Some(3), "{}", text(&none.stderr));
}

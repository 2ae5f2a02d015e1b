//! Faults between a board and the program, with the real firmware. The line damages, cuts and delays; the computer is
//! busy; the disk is full; the board has other firmware. Nothing is lost silently, the motor stops, and the message
//! says what to do. (Unplugged, reset, tripped, busy: `virtual_board`.)

use crate::board::{Board, MOTORBENCH, rows, text};
use motorbench_data::recording::Channel;
use motorbench_files::recording;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Faults of a cable.
#[derive(Default)]
struct Cable {
    /// Share of the bytes that are changed, in both directions, in thousandths.
    flipped_permille: AtomicU32,
    /// Largest number of bytes at once; 0: no limit.
    piece: AtomicU32,
    cut: AtomicBool,
}

/// A port that is connected to a board by a faulty cable.
struct Port {
    cable: Arc<Cable>,
    name: PathBuf,
    carries: Option<JoinHandle<()>>,
}

impl Port {
    fn new(board: &Board, cable: Cable) -> Self {
        let mut far = open(&board.port());
        let (mut near, program) = TTYPort::pair().unwrap();
        near.set_timeout(Duration::from_millis(1)).unwrap();
        let name = board.folder.join("cable");
        symlink(program.name().unwrap(), &name).unwrap();
        // Kept open so that the line outlives the program. It is not opened as a port, which would be exclusive to this
        // process.
        let open_end = std::fs::File::options().read(true).write(true).open(&name).unwrap();
        drop(program);
        let cable = Arc::new(cable);
        let in_thread = Arc::clone(&cable);
        let carries = std::thread::spawn(move || {
            let _open_end = open_end;
            let mut random = ChaCha8Rng::seed_from_u64(7);
            while !in_thread.cut.load(Ordering::Relaxed) {
                carry(&mut far, &mut near, &in_thread, &mut random);
                carry(&mut near, &mut far, &in_thread, &mut random);
            }
        });
        Self { cable, name, carries: Some(carries) }
    }

    fn flip(&self, permille: u32) {
        self.cable.flipped_permille.store(permille, Ordering::Relaxed);
    }

    fn command(&self, board: &Board, name: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(MOTORBENCH);
        command.arg(name).arg("--port").arg(&self.name).args(arguments).current_dir(&board.folder);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.cable.cut.store(true, Ordering::Relaxed);
        self.carries.take().map(JoinHandle::join);
    }
}

fn open(path: &Path) -> TTYPort {
    let mut port = serialport::new(path.to_str().unwrap(), 500_000).open_native().unwrap();
    port.set_timeout(Duration::from_millis(1)).unwrap();
    port
}

/// Share of the pieces after which the reader gets its turn.
const YIELDS: f64 = 0.1;

fn carry(from: &mut TTYPort, to: &mut TTYPort, cable: &Cable, random: &mut ChaCha8Rng) {
    let mut buffer = [0; 256];
    let Ok(count) = from.read(&mut buffer) else { return };
    let flipped = f64::from(cable.flipped_permille.load(Ordering::Relaxed)) / 1000.0;
    for byte in &mut buffer[..count] {
        if random.random_bool(flipped) {
            *byte ^= random.random_range(1..=255_u8);
        }
    }
    match cable.piece.load(Ordering::Relaxed) as usize {
        0 => deliver(to, &buffer[..count], cable),
        most => buffer[..count].chunks(random.random_range(1..=most)).for_each(|piece| {
            deliver(to, piece, cable);
            // Not after each piece: on a busy computer each time costs milliseconds.
            if random.random_bool(YIELDS) {
                std::thread::yield_now();
            }
        }),
    }
}

/// A cable does not lose bytes while the far end is busy.
fn deliver(to: &mut TTYPort, mut bytes: &[u8], cable: &Cable) {
    while !bytes.is_empty() && !cable.cut.load(Ordering::Relaxed) {
        bytes = &bytes[to.write(bytes).unwrap_or(0)..];
    }
}

/// Turns the motor for some seconds in both directions.
const STEPS: [&str; 8] = ["--sequence", "steps", "--amplitude", "5", "--period", "500", "--count", "2"];
const STEPS_TICKS: u64 = 4000;

fn signal(process: &Child, signal: &str) {
    assert!(Command::new("kill").args([signal, &process.id().to_string()]).status().unwrap().success());
}

/// A running recording whose computer then pauses for seconds of the board's time.
fn paused(board: &Board, recording: Child) -> Output {
    board.has_recorded(300);
    signal(&recording, "-STOP");
    board.order("wait 3");
    signal(&recording, "-CONT");
    recording.wait_with_output().unwrap()
}

/// The samples in the file and the missing ones make up the whole sequence, and every sample in the file is as it was
/// sent.
fn whole_or_counted(board: &Board, done: &Output) {
    let side = board.side_file();
    let [samples, missing] = ["samples", "missing_ticks"].map(|name| side[name].as_u64().unwrap());
    let path = board.folder.join("run.csv");
    let recording = recording(&path, &[]).unwrap();
    let time_s = recording.time_s().unwrap();
    assert_eq!((samples as usize, rows(&path)), (time_s.len(), time_s.len()));
    let ticks = 1 + (1000.0 * time_s.last().unwrap()).round() as u64;
    assert_eq!(ticks, samples + missing, "{side}");
    // The first and the last samples may be lost.
    assert!((STEPS_TICKS - 100..=STEPS_TICKS).contains(&ticks), "{ticks} of {STEPS_TICKS}");
    assert!(text(&done.stdout).contains(&format!("{missing} missing")), "{}", text(&done.stdout));
    let [volts, counts] = [Channel::Voltage, Channel::Counts].map(|channel| recording.get(channel).unwrap());
    assert!(volts.iter().all(|volts| volts.is_nan() || volts.abs() < 5.1), "a voltage that was never there");
    // At 5 V this motor makes less than 20 counts a tick.
    for row in 1..time_s.len() {
        let ticks = (1000.0 * (time_s[row] - time_s[row - 1])).round();
        assert!((counts[row] - counts[row - 1]).abs() < 20.0 * ticks, "row {row}: {} counts", counts[row]);
    }
}

#[test]
fn half_frames_are_put_together() {
    let board = Board::new("halves");
    let port = Port::new(&board, Cable { piece: 7.into(), ..Cable::default() });
    let done = port.command(&board, "record", &STEPS).output().unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    whole_or_counted(&board, &done);
    assert_eq!(board.side_file()["losses"], serde_json::json!({ "lost_frames": 0, "damaged_frames": 0 }));
}

/// One byte in a hundred is damaged in both directions during a recording. Damaged samples are missing and counted. A
/// drive that did not receive the order to stop gets it again.
#[test]
fn flipped_bytes_are_missing_and_counted() {
    let board = Board::new("flips");
    let port = Port::new(&board, Cable::default());
    let recording = port.command(&board, "record", &STEPS).spawn().unwrap();
    board.has_recorded(300);
    port.flip(10);
    let done = recording.wait_with_output().unwrap();
    port.flip(0);
    assert_eq!(done.status.code(), Some(0), "{}{}", text(&done.stdout), text(&done.stderr));
    whole_or_counted(&board, &done);
    let side = board.side_file();
    assert!(side["missing_ticks"].as_u64().unwrap() > 300, "{side}");
    assert!(side["losses"]["damaged_frames"].as_u64().unwrap() > 300, "{side}");
    assert!(text(&done.stdout).contains("damaged"), "{}", text(&done.stdout));
    drop(port);
    board.motor_is_off();
}

/// A line that goes dead: the board keeps the changed settings, and the side file says so.
#[test]
fn settings_that_stay_changed_are_in_the_side_file() {
    let board = Board::new("stays");
    let port = Port::new(&board, Cable::default());
    let changed = ["--set", "trip_peak=1.1"];
    let recording = port.command(&board, "record", &[&STEPS[..], &changed].concat()).spawn().unwrap();
    board.has_recorded(300);
    port.flip(1000);
    let done = recording.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    let side = board.side_file();
    let why = side["not_put_back"].as_str().unwrap_or_default();
    assert!(why.contains("(trip_peak)") && text(&done.stderr).contains(why), "{side}{}", text(&done.stderr));
}

/// From the beginning one frame in fifteen is damaged, and as many answers. The program asks again for what is missing.
/// Of some 10,000 orders one becomes another order that the board takes: that is noticed, and the order is repeated.
#[test]
fn a_line_that_damages_a_little_is_recorded_over() {
    let board = Board::new("little-noise");
    let port = Port::new(&board, Cable { flipped_permille: 2.into(), ..Cable::default() });
    let record = || port.command(&board, "record", &[&STEPS[..], &["--out", "run.csv"]].concat()).output().unwrap();
    let mut done = record();
    if text(&done.stderr).contains("played another sequence") {
        done = record();
    }
    assert_eq!(done.status.code(), Some(0), "{}{}", text(&done.stdout), text(&done.stderr));
    whole_or_counted(&board, &done);
    let side = board.side_file();
    let [lost, damaged] = ["lost_frames", "damaged_frames"].map(|name| side["losses"][name].as_u64().unwrap());
    assert!(lost >= damaged && damaged > 100, "{side}");
    drop(port);
    board.motor_is_off();
}

/// From the beginning no list of settings comes complete. The motor does not turn, and the message names the line, not
/// the firmware.
#[test]
fn a_line_that_damages_from_the_beginning_is_named() {
    let board = Board::new("noise");
    let port = Port::new(&board, Cable { flipped_permille: 60.into(), ..Cable::default() });
    let done = port.command(&board, "record", &STEPS).output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("cable"), "{}", text(&done.stderr));
    assert!(!board.folder.join("run.csv").exists(), "nothing was recorded");
    drop(port);
    board.motor_is_off();
}

/// Samples that the line could not hold are missing and counted.
#[test]
fn a_reader_that_pauses_counts_what_it_missed() {
    let board = Board::with("pause", &["--wait-for-reader", "0.5"]);
    let recording = board.command("record", &[&STEPS[..], &["--set", "trip_host=0"]].concat()).spawn().unwrap();
    let done = paused(&board, recording);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    whole_or_counted(&board, &done);
    let missing = board.side_file()["missing_ticks"].as_u64().unwrap();
    assert!(missing > 500, "the line keeps less than the pause, but {missing} are missing");
    board.motor_is_off();
}

/// Unless the user sets it otherwise, the drive stops if the computer pauses.
#[test]
fn a_reader_that_pauses_for_too_long_is_taken_for_lost() {
    let board = Board::with("lost", &["--wait-for-reader", "0.5"]);
    let recording = board.command("record", &STEPS).spawn().unwrap();
    let done = paused(&board, recording);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("host silent"), "{}", text(&done.stderr));
    // The trip was sent before the line was full. Samples lost after it are not part of the recording.
    let side = board.side_file();
    let undisturbed = serde_json::json!({ "lost_frames": 0, "damaged_frames": 0 });
    assert!(side["missing_ticks"] != 0 || side["losses"] == undisturbed, "{side}");
    assert_eq!(text(&done.stdout).contains("on the line"), side["losses"] != undisturbed, "{}", text(&done.stdout));
    board.motor_is_off();
}

/// The disk becomes full during the recording: the motor stops at once, and the file has whole lines.
#[test]
fn a_full_disk_stops_the_motor_and_keeps_what_was_written() {
    let board = Board::new("full");
    // Files may have 64 blocks of 512 bytes. A write beyond that fails as on a full disk.
    let limited = format!(
        "trap '' XFSZ; ulimit -f 64; exec '{MOTORBENCH}' record --port '{}' {}",
        board.port().display(),
        STEPS.join(" ")
    );
    let done = Command::new("sh").args(["-c", &limited]).current_dir(&board.folder).output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    let message = text(&done.stderr);
    assert!(message.contains("run.csv: ") && message.contains("make room on the disk"), "{message}");
    assert!(message.contains("run.csv holds what had come"), "{message}");
    board.motor_is_off();
    let csv = std::fs::read_to_string(board.folder.join("run.csv")).unwrap();
    assert!(csv.ends_with('\n') && csv.len() > 20_000 && csv.len() <= 64 * 512, "{} bytes", csv.len());
    let recording = recording(&board.folder.join("run.csv"), &[]).unwrap();
    assert!(recording.len() > 300, "{} samples", recording.len());
    assert_eq!(board.side_file()["samples"].as_u64().unwrap() as usize, recording.len());
}

/// The same for a recording by the tuning console: its rows are kept, and the files beside it say that it is
/// incomplete.
#[test]
fn a_full_disk_ends_a_recording_out_of_the_tuning_console() {
    let board = Board::new("tune-full");
    let limited = format!(
        "trap '' XFSZ; ulimit -f 64; exec '{MOTORBENCH}' tune --port '{}' --keys 'a r s s s s' --json session.json",
        board.port().display()
    );
    let done = Command::new("sh").args(["-c", &limited]).current_dir(&board.folder).output().unwrap();
    let message = text(&done.stderr);
    assert_eq!(done.status.code(), Some(3), "{message}");
    let [csv, rig] = ["tune.csv", "tune.rig.toml"].map(|name| board.folder.join(name));
    let recording = recording(&csv, &[]).unwrap();
    let kept = format!("make room on the disk; --out names another file; tune.csv: {} samples", recording.len());
    assert!(recording.len() > 300 && message.contains(&kept), "{message}");
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(board.folder.join(name)).unwrap()).unwrap()
    };
    for file in ["tune.json", "session.json"] {
        assert!(json(file)["ended"]["failed"].as_str().unwrap().contains("make room"), "{file}: {}", json(file));
    }
    assert_eq!(json("tune.json")["samples"].as_u64().unwrap() as usize, recording.len());
    assert!(rig.exists());
    board.motor_is_off();
}

#[test]
fn a_device_without_room_is_named_at_once() {
    let board = Board::new("devfull");
    symlink("/dev/full", board.folder.join("run.csv")).unwrap();
    let done = board.run("record", &STEPS);
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("No space left on device"), "{}", text(&done.stderr));
    board.motor_is_off();
}

/// Every file beside a recording that cannot be written is named, and the recording does not begin.
#[test]
fn side_files_without_room_are_named() {
    let board = Board::new("sidefull");
    for full in ["run.rig.toml", "run.scenario.toml"] {
        symlink("/dev/full", board.folder.join(full)).unwrap();
    }
    let done = board.run("record", &STEPS);
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    let message = text(&done.stderr);
    for what in ["run.scenario.toml, run.rig.toml: No space", "--out names another file", "nothing of it is kept"] {
        assert!(message.contains(what), "{message}");
    }
    assert!(!message.contains("run.json:") && !board.folder.join("run.csv").exists(), "{message}");
    board.motor_is_off();
}

/// A killed program leaves the rows of its recording that had come.
#[test]
fn a_program_that_is_killed_leaves_its_recording() {
    let board = Board::new("killed");
    let mut recording = board.command("record", &[&STEPS[..], &["--set", "trip_host=500"]].concat()).spawn().unwrap();
    board.has_recorded(500);
    recording.kill().unwrap();
    recording.wait().unwrap();
    assert!(rows(&board.folder.join("run.csv")) >= 500);
    board.trips_by_itself();
}

/// A port that answers every line in its own way.
fn something_else(name: &str, answer: &'static str) -> (PathBuf, PathBuf) {
    let folder = std::env::temp_dir().join(format!("motorbench-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (mut board, program) = TTYPort::pair().unwrap();
    board.set_timeout(Duration::from_millis(10)).unwrap();
    let port = folder.join("port");
    let _ = std::fs::remove_file(&port);
    symlink(program.name().unwrap(), &port).unwrap();
    let open_end = std::fs::File::options().read(true).write(true).open(&port).unwrap();
    drop(program);
    std::thread::spawn(move || {
        let _open_end = open_end;
        let mut buffer = [0; 256];
        loop {
            if board.read(&mut buffer).is_ok_and(|count| buffer[..count].contains(&b'\n')) {
                let _ = board.write_all(answer.as_bytes());
            }
        }
    });
    (folder, port)
}

#[test]
fn what_is_no_firmware_of_this_version_is_told_so() {
    let cases = [
        ("older", "# motorbench 0.0.7, settings 90\r\nok\r\n", &["the board runs motorbench 0.0.7", "cargo flash"][..]),
        ("other", "Marlin 2.0 ready\r\n", &["no answer to `version`", "firmware"]),
        ("silent", "", &["no answer to `version`", "baud"]),
    ];
    // Each waits for seconds in vain.
    std::thread::scope(|scope| {
        for (name, answer, expected) in cases {
            scope.spawn(move || is_told_so(name, answer, expected));
        }
    });
}

fn is_told_so(name: &str, answer: &'static str, expected: &[&str]) {
    let (folder, port) = something_else(name, answer);
    for command in [&["record", "--out", "run.csv"][..], &["connect", "status"], &["autotune"]] {
        let done = Command::new(MOTORBENCH)
            .args([&command[..1], &["--port", port.to_str().unwrap()], &command[1..]].concat())
            .current_dir(&folder)
            .output()
            .unwrap();
        assert_eq!(done.status.code(), Some(3), "{name} {command:?}: {}", text(&done.stderr));
        for part in expected {
            assert!(text(&done.stderr).contains(part), "{name} {command:?}: {}", text(&done.stderr));
        }
    }
    assert!(!folder.join("run.csv").exists(), "nothing was recorded");
    std::fs::remove_dir_all(&folder).unwrap();
}

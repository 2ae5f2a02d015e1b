//! The commands for a board, as a person types them, against the real firmware behind `motorbench virtual`.

use crate::board::{Board, MOTORBENCH, rows, text, until};
use crate::motor::PIVT6_TOML;
use motorbench_data::recording::Channel;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

const STEPS: [&str; 8] = ["--sequence", "steps", "--amplitude", "5", "--period", "400", "--count", "2"];

#[test]
fn a_recording_is_whole_and_read_by_the_diagnosis() {
    let board = Board::new("record");
    let done = board.run("record", &STEPS);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let side = board.side_file();
    assert_eq!((&side["ended"], side["missing_ticks"].as_u64()), (&"complete".into(), Some(0)), "{side}");
    assert_eq!(side["samples"].as_u64().unwrap() as usize, rows(&board.folder.join("run.csv")));
    assert_eq!(side["settings"]["counts_per_rev"], 2000.0);
    assert_eq!((&side["settings"]["tick_rate"], &side["rate_Hz"]), (&1000.0.into(), &1000.0.into()));
    assert_eq!(side["settings"]["speed_kp"], 0.05, "as the console has it");
    assert!(side["firmware"].as_str().unwrap().starts_with("motorbench "), "{side}");
    assert_eq!(side["losses"], serde_json::json!({ "lost_frames": 0, "damaged_frames": 0 }));
    assert_eq!(side["coverage"]["lacks"], serde_json::json!([]), "steps go both ways");
    assert!(text(&done.stdout).contains("enough to identify"), "{}", text(&done.stdout));
    let files = [board.folder.join("run.csv"), board.folder.join("run.rig.toml")];
    let rig = motorbench_files::rig(&files[1]).unwrap();
    assert!(rig.ignored.is_empty(), "{:?}", rig.ignored);
    let recording = motorbench_files::recording(&files[0], &[]).unwrap();
    motorbench_diagnosis::dataset::Dataset::new(&[recording], &rig).unwrap();
}

/// A plotter that takes what is sent to it until a recording is over.
struct Plotter {
    place: SocketAddr,
    over: Arc<AtomicBool>,
    /// What came, and how many packets the system has thrown away because the plotter was behind.
    heard: JoinHandle<(Vec<String>, usize)>,
}

impl Plotter {
    fn new() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        let (place, over) = (socket.local_addr().unwrap(), Arc::new(AtomicBool::new(false)));
        let ends = Arc::clone(&over);
        let heard = std::thread::spawn(move || {
            let (mut buffer, mut packets) = ([0; 1024], Vec::new());
            loop {
                let was_over = ends.load(Ordering::Relaxed);
                match socket.recv(&mut buffer) {
                    Ok(length) => packets.push(text(&buffer[..length])),
                    Err(_) if was_over => return (packets, dropped(place.port())),
                    Err(_) => {}
                }
            }
        });
        Self { place, over, heard }
    }

    /// What it got of so many packets.
    fn got(self, sent: usize) -> Vec<String> {
        self.over.store(true, Ordering::Relaxed);
        let (packets, dropped) = self.heard.join().unwrap();
        assert!(!packets.is_empty() && packets.len() <= sent, "{} of {sent}", packets.len());
        if cfg!(target_os = "linux") {
            assert_eq!(packets.len() + dropped, sent, "{dropped} were dropped by the system");
        }
        packets
    }
}

/// Packets that found the buffer of a UDP port full.
fn dropped(port: u16) -> usize {
    let table = std::fs::read_to_string("/proc/net/udp").unwrap_or_default();
    let end = format!(":{port:04X}");
    let own = table.lines().find(|line| line.split_whitespace().nth(1).is_some_and(|local| local.ends_with(&end)));
    own.and_then(|line| line.split_whitespace().last()?.parse().ok()).unwrap_or(0)
}

/// What a plotter gets is the recording, at the board's times.
#[test]
fn plotters_get_the_recording_while_it_is_made() {
    let board = Board::new("live");
    let (plotjuggler, teleplot) = (Plotter::new(), Plotter::new());
    let to = [format!("--live=plotjuggler={}", plotjuggler.place), format!("--live=teleplot={}", teleplot.place)];
    let done = board.run("record", &[&STEPS[..], &[&to[0], &to[1]]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let recording = motorbench_files::recording(&board.folder.join("run.csv"), &[]).unwrap();
    let (time_s, current_a) = (recording.time_s().unwrap(), recording.get(Channel::Current).unwrap());

    let sent: Vec<(f64, f64)> = plotjuggler
        .got(time_s.len())
        .iter()
        .map(|packet| {
            let object: serde_json::Value = serde_json::from_str(packet).unwrap();
            (object["timestamp"].as_f64().unwrap(), object["i_A"].as_f64().unwrap())
        })
        .collect();
    // The recording begins at zero, the board's clock at its start.
    let begun_s = sent[0].0;
    for (at_s, value) in &sent {
        let row = (1000.0 * (at_s - begun_s)).round() as usize;
        assert!((at_s - begun_s - time_s[row]).abs() < 1e-9 && (value - current_a[row]).abs() < 1e-6, "{at_s} {value}");
    }
    let packets = teleplot.got(time_s.len());
    let field = |packet: &String| {
        let line = packet.lines().find(|line| line.starts_with("i_A:")).unwrap().to_owned();
        let words: Vec<f64> =
            line.trim_end_matches("§A").split(':').skip(1).map(|word| word.parse().unwrap()).collect();
        (1e-3 * words[0], words[1])
    };
    for (at_s, value) in packets.iter().map(field) {
        let row = (1000.0 * (at_s - begun_s)).round() as usize;
        assert!((value - current_a[row]).abs() < 1e-6, "{at_s} {value}");
    }
}

/// What the Arduino IDE's Serial Plotter draws: `name:value` pairs without spaces, lines that end with `\r\n`.
#[test]
fn a_serial_plotter_gets_lines() {
    let board = Board::new("plotter");
    let mut line = serialport::new(board.port().to_str().unwrap(), 500_000).open_native().unwrap();
    line.write_all(b"stream text 50\n").unwrap();
    let (mut heard, mut buffer) = (String::new(), [0; 256]);
    until("ten lines for the plotter", || {
        let count = line.read(&mut buffer).unwrap_or(0);
        heard += &text(&buffer[..count]);
        heard.matches("reference:").count() > 10
    });
    line.write_all(b"stream off\n").unwrap();
    let lines: Vec<&str> = heard.split_inclusive('\n').filter(|line| line.starts_with("reference:")).collect();
    for line in &lines[..10] {
        let pairs = line.strip_suffix("\r\n").expect("the end of a line").split(',');
        let names: Vec<&str> = pairs
            .map(|pair| pair.split_once(':').filter(|(_, value)| value.parse::<f64>().is_ok()).expect("name:value").0)
            .collect();
        assert_eq!(names, ["reference", "position", "speed", "current", "duty"], "{line}");
    }
}

/// A loop that was recorded is simulated from the scenario beside it, with the motor and the bridge that it had.
#[test]
fn a_recorded_loop_is_validated_with_the_scenario_beside_it() {
    let board = Board::new("validate");
    let loop_ = ["--mode", "speed", "--sequence", "levels", "--amplitude", "60", "--period", "300", "--count", "4"];
    let done = board.run("record", &[&loop_[..], &["--set", "speed_kp=0.0661", "--json"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let mut side: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    // A file says who wrote it.
    side["written_by"] = "motorbench".into();
    assert_eq!(side, board.side_file());
    let scenario = std::fs::read_to_string(board.folder.join("run.scenario.toml")).unwrap();
    assert!(scenario.contains("speed_kp = 0.0661\n"), "{scenario}");
    let effects = "[effects.coulomb_friction]\ntorque_Nm = 0.012\n[effects.voltage_drop]\ndrop_V = 2.53\n";
    std::fs::write(board.folder.join("model.toml"), format!("{PIVT6_TOML}{effects}")).unwrap();
    let beside = ["validate", "run.csv", "--scenario", "run.scenario.toml", "--rig", "run.rig.toml"];
    let validated = board.run_alone(&[&beside[..], &["--model", "model.toml", "--json", "-"]].concat());
    assert_eq!(validated.status.code(), Some(0), "{}", text(&validated.stderr));
    let found: serde_json::Value = serde_json::from_slice(&validated.stdout).unwrap();
    let channels = found["comparison"]["channels"].as_array().unwrap();
    let speed = channels.iter().find(|channel| channel["channel"] == "omega_rad_per_s").expect("the speed");
    assert!(speed["fit_percent"].as_f64().unwrap() > 95.0, "{found}");
    let without = board.run_alone(&beside);
    assert!(text(&without.stderr).contains("it has no motor"), "{}", text(&without.stderr));
}

#[test]
fn a_recording_that_does_not_suffice_says_what_it_lacks() {
    let board = Board::new("lacks");
    let done = board.run("record", &["--sequence", "stairs", "--amplitude", "2", "--period", "200", "--count", "3"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    // Two volts do not turn a motor behind a bridge that drops two and a half.
    assert!(text(&done.stdout).contains("lacks motion: it mostly stood"), "{}", text(&done.stdout));
}

#[test]
fn what_is_sent_is_read_back_and_what_is_wrong_is_named() {
    let board = Board::new("send");
    let gains = board.folder.join("gains.txt");
    std::fs::write(&gains, "# from a design\nset speed_kp 0.0661 speed_ki 3.96\n\nset speed_tf 2.28\n").unwrap();
    let done = board.run("send", &["gains.txt", "--save"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("3 settings read back, saved"), "{}", text(&done.stdout));
    let sent: serde_json::Value = serde_json::from_slice(&board.run("send", &["gains.txt", "--json"]).stdout).unwrap();
    assert_eq!((&sent["settings_read_back"], &sent["saved"]), (&3.into(), &false.into()));
    let shown = board.run("connect", &["show speed_ki"]);
    assert!(text(&shown.stdout).starts_with("speed_ki 3.96 "), "{}", text(&shown.stdout));
    // A text of several lines is as many lines, each with its answer.
    let both = board.run("connect", &["show speed_ki\r\nnonsense\nversion\n"]);
    assert_eq!((both.status.code(), text(&both.stdout)), (Some(1), text(&shown.stdout)));
    assert!(text(&both.stderr).contains("refuses `nonsense`"), "{}", text(&both.stderr));
    let shown: serde_json::Value =
        serde_json::from_slice(&board.run("connect", &["--json", "show speed_ki"]).stdout).unwrap();
    assert!(shown["reply"][0].as_str().unwrap().starts_with("speed_ki 3.96 "), "{shown}");
    std::fs::write(&gains, "set speed_kp 0.05\nset speed_kp 99999\n").unwrap();
    let refused = board.run("send", &["gains.txt"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("gains.txt, line 2"), "{}", text(&refused.stderr));
    // What of it is on the board is said.
    std::fs::write(&gains, "set speed_kp 0.05\n# so far so good\nset speed_ki 3\nset speed_kp 99999\nset speed_tf 2\n")
        .unwrap();
    let half = board.run("send", &["gains.txt", "--json"]);
    assert_eq!(half.status.code(), Some(1));
    assert!(text(&half.stderr).contains("done: lines 1 to 3; not done: lines 4 to 5;"), "{}", text(&half.stderr));
    let half: serde_json::Value = serde_json::from_slice(&half.stdout).unwrap();
    let (done, not_done) = (["set speed_kp 0.05", "set speed_ki 3"], ["set speed_kp 99999", "set speed_tf 2"]);
    assert_eq!((&half["done"], &half["not_done"]), (&done.as_slice().into(), &not_done.as_slice().into()), "{half}");
    assert!(half["error"].as_str().unwrap().contains("gains.txt, line 4: "), "{half}");
    std::fs::write(&gains, "# nothing yet\n").unwrap();
    let nothing = board.run("send", &["gains.txt"]);
    assert!(text(&nothing.stderr).contains("gains.txt has no console line"), "{}", text(&nothing.stderr));
    // As an editor elsewhere writes it, and without a setting.
    std::fs::write(&gains, "\u{feff}arm\r\nmode speed\r\nref 20\r\n").unwrap();
    let drive = board.run("send", &["gains.txt"]);
    let expected = format!(
        "3 lines sent to {}, each answered by ok; no setting is among them\nthe drive is off again; only `connect`, `tune` and `record` keep it on\n",
        board.port().display()
    );
    assert_eq!((drive.status.code(), text(&drive.stdout)), (Some(0), expected), "{}", text(&drive.stderr));
    board.motor_is_off();
}

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

/// Without a name each recording has its own, with all that stands beside it.
#[test]
fn a_recording_that_nobody_named_replaces_none() {
    let board = Board::new("free-name");
    let port = board.port();
    std::fs::write(board.folder.join("run-2.rig.toml"), "# by hand\n").unwrap();
    let mut first = Vec::new();
    for name in ["run", "run-3"] {
        let done = board.run_alone(&[&["record", "--port", port.to_str().unwrap()], &STEPS[..]].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        let said = text(&done.stdout);
        assert!(said.starts_with(&format!("{name}.csv: ")), "{said}");
        assert!(said.ends_with(&format!("next: motorbench diagnose {name}.csv --rig {name}.rig.toml\n")), "{said}");
        let files =
            ["csv", "rig.toml", "scenario.toml", "json"].map(|ending| board.folder.join(format!("{name}.{ending}")));
        assert!(files.iter().all(|file| file.exists()), "{files:?}");
        let side: serde_json::Value = serde_json::from_slice(&std::fs::read(&files[3]).unwrap()).unwrap();
        assert_eq!(side["file"], format!("{name}.csv"));
        if first.is_empty() {
            first = std::fs::read(&files[0]).unwrap();
        }
    }
    assert_eq!(std::fs::read(board.folder.join("run.csv")).unwrap(), first);
    // What is to be typed next can be, whatever the name.
    let named = board.run("record", &[&STEPS[..], &["--out", "\u{fc} r\u{fc}n.csv"]].concat());
    let next = "\nnext: motorbench diagnose '\u{fc} r\u{fc}n.csv' --rig '\u{fc} r\u{fc}n.rig.toml'\n";
    assert!(text(&named.stdout).ends_with(next), "{}", text(&named.stdout));
    assert!(!board.folder.join("run-2.csv").exists());
}

/// The firmware forgets it as well.
#[test]
fn half_a_line_of_a_program_that_died_is_not_carried_out() {
    // The second program reads nothing of what it asked for.
    let board = Board::with("half-line", &["--wait-for-reader", "0.5"]);
    for prompt in ["", "stream binary\n"] {
        let mut line = serialport::new(board.port().to_str().unwrap(), 500_000).open_native().unwrap();
        line.write_all(format!("{prompt}set trip_peak 7").as_bytes()).unwrap();
        board.order("wait 0.1");
        drop(line);
        let shown = text(&board.run("connect", &["show trip_peak"]).stdout);
        assert!(shown.starts_with("trip_peak 1.2 "), "{shown}");
    }
}

/// What `--set` changes is changed for one recording, also for one that does not begin.
#[test]
fn settings_of_a_recording_are_put_back() {
    let board = Board::new("put_back");
    let shown = || text(&board.run("connect", &["show current_limit", "show trip_peak"]).stdout);
    let before = shown();
    let set = ["--set", "current_limit=0", "--set", "trip_peak=5"];
    let done = board.run("record", &[&STEPS[..], &set].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert_eq!(board.side_file()["settings"]["trip_peak"], 5.0, "those of the recording");
    assert_eq!(shown(), before);
    assert_eq!(text(&board.run("connect", &["status"]).stderr), "");
    let refused = board.run("record", &[&STEPS[..], &set, &["--set", "speed_kp=99999"]].concat());
    assert_eq!(refused.status.code(), Some(1), "{}", text(&refused.stderr));
    assert_eq!(shown(), before);

    // What a program that was killed has left is said; and of the earlier recording nothing stands beside the new one.
    let mut killed = board.command("record", &set).spawn().unwrap();
    until("rows of another recording", || board.side_file()["ended"] == "running");
    killed.kill().unwrap();
    killed.wait().unwrap();
    let side = board.side_file();
    assert_eq!((&side["settings"]["trip_peak"], side.get("samples")), (&5.0.into(), None), "{side}");
    let scenario = std::fs::read_to_string(board.folder.join("run.scenario.toml")).unwrap();
    assert!(scenario.contains("\"identify\""), "{scenario}");
    let lifted = text(&board.run("connect", &["version"]).stderr);
    assert!(
        lifted.contains("protections are lifted: current_limit off, usually 1; trip_peak 5, usually 1.2;"),
        "{lifted}"
    );
    let drives = [
        board.command("record", &STEPS),
        board.command("tune", &["--keys", "down"]),
        board.command("autotune", &["--hold", "0.2"]),
        board.command("stand", &["--rig", "rig.toml", "--voltages", "6,7,8"]),
    ];
    std::fs::write(board.folder.join("rig.toml"), PIVT6_TOML).unwrap();
    for mut command in drives {
        assert_eq!(board.run("connect", &["set current_limit 0 trip_peak 5", "clear"]).status.code(), Some(0));
        let said = text(&command.output().unwrap().stderr);
        let remedy = format!("`motorbench connect --port {} load` restores the saved settings", board.port().display());
        assert!(said.contains("protections are lifted: current_limit off") && said.contains(&remedy), "{said}");
    }
}

/// Gains of a fast loop come with a slew limit of its own, with which a reversal in open loop would trip. The board keeps it.
#[test]
fn a_board_with_a_fast_loop_is_recorded_as_one_without() {
    let board = Board::new("fast_loop");
    std::fs::write(board.folder.join("gains.txt"), "set slew_limit 3000 speed_kp 0.05768 speed_ki 3.1498\n").unwrap();
    assert_eq!(board.run("send", &["gains.txt", "--save"]).status.code(), Some(0));
    let done = board.run("record", &[]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert_eq!(board.side_file()["settings"]["slew_limit"], 500.0);
    assert!(text(&board.run("connect", &["show slew_limit"]).stdout).contains("slew_limit 3000"));
    let done = board.run("record", &["--set", "slew_limit=3000"]);
    let message = text(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{message}");
    assert!(message.contains("exceeded `trip_peak`") && message.contains("`slew_limit`"), "{message}");
}

/// At 2000 ticks a second the line is too slow for all samples: some are missing, and none has the tick of another.
#[test]
fn a_line_that_is_too_slow_mixes_no_samples() {
    let board = Board::new("fast");
    let done = board.run("record", &[&STEPS[..], &["--set", "tick_rate=2000"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let side = board.side_file();
    assert!(side["missing_ticks"].as_u64().unwrap() > 100, "{side}");
}

/// A console at a terminal, its fingers, and what it answers after its greeting.
fn console(board: &Board) -> (Child, ChildStdin, impl Iterator<Item = String> + use<>) {
    let mut console = board.command("connect", &[]).stdin(Stdio::piped()).spawn().unwrap();
    let mut answers = BufReader::new(console.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(answers.next().unwrap().contains("an empty line stops the motor"));
    let fingers = console.stdin.take().unwrap();
    (console, fingers, answers)
}

/// While a person thinks, the board hears of its host; Ctrl-C leaves no drive, and a board that goes is told at once.
#[test]
fn a_person_at_the_console() {
    let mut board = Board::new("console");
    let (talk, mut fingers, mut answers) = console(&board);
    fingers.write_all(b"arm\nmode open\nref 6\n").unwrap();
    board.order("wait 2");
    // Two that would end what connect hears the board by, one to which a board says nothing, and settings as a person has them.
    writeln!(fingers, "stream text 10\nrecord steps 6\nstatus\n  \nshow trip_host\nsave").unwrap();
    assert!(answers.next().unwrap().starts_with("stream is not possible in connect"));
    assert!(answers.next().unwrap().starts_with("record is not possible in connect"));
    assert_eq!(answers.next().unwrap(), "mode open armed 1 trip 0 none");
    assert!(answers.find(|line| line.starts_with("trip_host")).unwrap().starts_with("trip_host 0 "));
    // Until all is saved; then the drive is watched again.
    board.order("wait 3");
    assert!(Command::new("kill").args(["-INT", &talk.id().to_string()]).status().unwrap().success());
    let done = talk.wait_with_output().unwrap();
    let said = "the drive was armed; it is off now\nmotorbench: stopped by hand\n";
    assert_eq!((done.status.code(), text(&done.stderr)), (Some(1), said.into()));
    board.motor_is_off();
    let kept = text(&board.run("connect", &["show trip_host", "load", "show trip_host"]).stdout);
    assert_eq!(kept.matches("trip_host 0 ").count(), 2, "{kept}");

    // Nobody types, and nobody ends it.
    let (talk, _fingers, _answers) = console(&board);
    board.change("quit");
    let done = talk.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("connection is gone"), "{}", text(&done.stderr));
}

/// Through a pipe as in an argument: the exit code says that a line was refused, whatever comes after it.
#[test]
fn a_script_hears_of_a_line_that_was_refused() {
    let board = Board::new("console-pipe");
    let refused = board.run("connect", &["--json", "bogus"]);
    let said: serde_json::Value = serde_json::from_slice(&refused.stdout).unwrap();
    let expected = serde_json::json!({ "line": "bogus", "reply": ["error: unknown command, see help"] });
    assert_eq!((refused.status.code(), said), (Some(1), expected));
    for json in [&[][..], &["--json"]] {
        let mut talk = board.command("connect", json).stdin(Stdio::piped()).spawn().unwrap();
        talk.stdin.take().unwrap().write_all(b"bogus\nshow speed_kp\n").unwrap();
        let done = talk.wait_with_output().unwrap();
        let said = text(&done.stdout);
        assert!(said.contains("error: unknown command") && said.contains("speed_kp 0.05 "), "{said}");
        assert_eq!(done.status.code(), Some(1), "{said}");
        assert!(
            text(&done.stderr).contains("the board refuses `bogus`: error: unknown command"),
            "{}",
            text(&done.stderr)
        );
    }
}

/// A drive that a person has armed ends with the console, whatever ends it.
#[test]
fn a_console_that_ends_leaves_no_drive() {
    let board = Board::new("console-ends");
    let given = board.run("connect", &["arm", "mode open", "ref 6"]);
    assert_eq!((given.status.code(), text(&given.stderr)), (Some(0), "the drive was armed; it is off now\n".into()));
    board.motor_is_off();
    for end in ["-HUP", "-TERM", "-KILL"] {
        let (mut talk, mut fingers, mut answers) = console(&board);
        writeln!(fingers, "arm\nmode open\nref 6\nstatus").unwrap();
        assert_eq!(answers.next().unwrap(), "mode open armed 1 trip 0 none");
        assert!(Command::new("kill").args([end, &talk.id().to_string()]).status().unwrap().success());
        talk.wait().unwrap();
        match end {
            "-KILL" => board.trips_by_itself(),
            _ => board.motor_is_off(),
        }
    }
}

/// The drive of a board whose own `trip_host` is off does not outlive a recording's program either; it is kept alive through the
/// recording, and what a person sets stays.
#[test]
fn a_lost_host_is_not_mistaken_for_a_busy_one() {
    let board = Board::new("alive");
    let shown = || text(&board.run("connect", &["show trip_host"]).stdout);
    let before = shown();
    assert!(before.starts_with("trip_host 0 "), "{before}");
    for set in [&[][..], &["--set", "trip_host=300"], &["--set", "trip_host=0"]] {
        let done = board.run("record", &[&STEPS[..], set].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        assert_eq!(shown(), before);
    }
    std::fs::remove_file(board.folder.join("run.csv")).unwrap();
    let steps = ["--sequence", "steps", "--amplitude", "6", "--period", "60000"];
    let mut killed = board.command("record", &steps).spawn().unwrap();
    board.has_recorded(300);
    killed.kill().unwrap();
    killed.wait().unwrap();
    board.trips_by_itself();
    // What the dead one has left does not pass for the board's own.
    let next = board.run("connect", &["show trip_host"]);
    assert_eq!(text(&next.stdout), before);
    assert!(text(&next.stderr).contains("a program that was killed"), "{}", text(&next.stderr));

    // Who comes before the board has missed the dead one stops the motor: nobody else would.
    std::fs::remove_file(board.folder.join("run.csv")).unwrap();
    board.run("connect", &["clear"]);
    let mut killed = board.command("record", &steps).spawn().unwrap();
    board.has_recorded(300);
    killed.kill().unwrap();
    killed.wait().unwrap();
    let next = board.run("connect", &["status", "show trip_host"]);
    let (said, warned) = (text(&next.stdout), text(&next.stderr));
    assert!(said.contains("armed 0") && said.contains("trip_host 0 "), "{said}{warned}");
    assert!(warned.contains("the drive is off"), "{warned}");
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

/// Who has neither cargo nor the compiler runs what was built before; where there is nothing, the message says what to give.
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

/// One line says all that a script has to know that starts boards for a class, and a board is not pushed from its place by
/// another.
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

/// The motor has friction and a bridge that loses voltage: gains come from where it turns, and not from where it sticks.
/// The board does what another process tells it, and answers however fast its motor turns; where it has not the terminal it does
/// not wait for what is typed there.
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

#[test]
fn gains_without_a_model_pass_their_test_or_are_refused() {
    let board = Board::new("autotune");
    // It is kept alive meanwhile.
    assert_eq!(board.run("connect", &["set trip_host 300"]).status.code(), Some(0));
    let done = board.run("autotune", &["--console", "gains.txt", "--json"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let found: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(found["accepted"], true);
    // 1/k rad/s per volt, and J R / k^2.
    assert!(
        (found["experiment"]["model"]["gain_rad_per_s_per_V"].as_f64().unwrap() / 13.8 - 1.0).abs() < 0.05,
        "{found}"
    );
    let gains = std::fs::read_to_string(board.folder.join("gains.txt")).unwrap();
    assert!(gains.starts_with("set speed_kp 0."), "{gains}");
    let stuck = board.run("autotune", &["--from", "1", "--to", "8", "--hold", "0.3"]);
    assert_eq!(stuck.status.code(), Some(1));
    assert!(text(&stuck.stderr).contains("friction"), "{}", text(&stuck.stderr));
    board.motor_is_off();
    // Without friction the motor still turns after the experiment, and that is no overshoot of the test.
    board.order("effect coulomb_friction off");
    let free = board.run("autotune", &["--json"]);
    assert_eq!(free.status.code(), Some(0), "{}", text(&free.stderr));
    // Ctrl-C does not wait for the end.
    let experiment = board.command("autotune", &["--hold", "20"]).spawn().unwrap();
    board.order("wait 2");
    assert!(Command::new("kill").args(["-INT", &experiment.id().to_string()]).status().unwrap().success());
    let done = experiment.wait_with_output().unwrap();
    assert_eq!((done.status.code(), text(&done.stderr)), (Some(1), "motorbench: stopped by hand\n".into()));
    board.motor_is_off();
    // Nor does one that may not begin leave anything behind.
    let slew_limit = || text(&board.run("connect", &["show slew_limit"]).stdout);
    let before = slew_limit();
    board.order("stop on");
    assert_eq!(board.run("autotune", &[]).status.code(), Some(1));
    assert_eq!(slew_limit(), before);
}

/// As a person with hands runs it: levels, then the rotor held where it is asked for; the figures are those of the
/// simulated motor (0.012 Nm of friction, 2.5 to 2.6 V dropped).
#[test]
fn the_stand_measures_the_simulated_motor() {
    let board = Board::new("stand");
    std::fs::write(board.folder.join("rig.toml"), PIVT6_TOML).unwrap();
    let mut stand = board
        .command("stand", &["--rig", "rig.toml", "--voltages", "6,9,12", "--positions", "2", "--json", "-"])
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let mut fingers = stand.stdin.take().unwrap();
    for line in BufReader::new(stand.stderr.take().unwrap()).lines() {
        if line.unwrap().contains("hold it, press Enter") {
            board.order("turn 25");
            writeln!(fingers).unwrap();
        }
    }
    let done = stand.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stdout));
    let found: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let near = |pointer: &str, truth: f64, share: f64| {
        let value = found.pointer(pointer).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
        assert!((value / truth - 1.0).abs() < share, "{pointer}: {value} instead of {truth}");
    };
    near("/constants/coulomb_Nm", 0.012, 0.03);
    near("/constants/drop_V", 2.55, 0.04);
    near("/winding/mean_ohm", 5.84, 0.03);
    // R i + k w + drop = u at 12 V, and k i = c + b w.
    near("/levels/2/omega_rad_per_s", 116.4, 0.01);
    assert_eq!(found["winding"]["resistances_ohm"].as_array().unwrap().len(), 2);
    std::fs::write(board.folder.join("empty.toml"), "[motor]\n").unwrap();
    let refused = board.run("stand", &["--rig", "empty.toml"]);
    assert!(text(&refused.stderr).contains("needs [motor] resistance_ohm"), "{}", text(&refused.stderr));
    let again = board.run_alone(&["stand", "stand.csv", "--rig", "rig.toml", "--resistance", "stand.positions.csv"]);
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
    assert!(text(&again.stdout).contains("Winding at 2 positions"), "{}", text(&again.stdout));
}

#[test]
fn a_stand_that_is_stopped_or_unplugged_keeps_its_table() {
    let mut board = Board::new("stand-stop");
    std::fs::write(board.folder.join("rig.toml"), PIVT6_TOML).unwrap();
    let levels = ["--rig", "rig.toml", "--voltages", "6,7,8,9,10,11", "--readings", "2"];
    let first_levels = |stand: &mut Child| {
        let lines = BufReader::new(stand.stderr.take().unwrap()).lines();
        lines.map_while(Result::ok).filter(|line| line.contains("rad/s")).nth(3).expect("four levels");
    };
    let mut stand = board.command("stand", &levels).spawn().unwrap();
    first_levels(&mut stand);
    assert!(Command::new("kill").args(["-INT", &stand.id().to_string()]).status().unwrap().success());
    let done = stand.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(1));
    assert!(text(&done.stdout).contains("Where the power goes"), "what had come is evaluated");
    assert!((8..12).contains(&rows(&board.folder.join("stand.csv"))));
    board.motor_is_off();

    let mut stand = board.command("stand", &levels).spawn().unwrap();
    first_levels(&mut stand);
    board.change("quit");
    let done = stand.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(3));
    // The first one is not replaced.
    assert!((8..12).contains(&rows(&board.folder.join("stand-2.csv"))));
    let side: serde_json::Value =
        serde_json::from_slice(&std::fs::read(board.folder.join("stand-2.json")).unwrap()).unwrap();
    assert!(side["ended"]["failed"].as_str().unwrap().contains("connection is gone"), "{side}");
}

/// Before the first readings: no file that tells of a table that is not there.
#[test]
fn a_stand_that_is_stopped_at_once_leaves_nothing() {
    let board = Board::new("stand-at-once");
    std::fs::write(board.folder.join("rig.toml"), PIVT6_TOML).unwrap();
    let names = || std::fs::read_dir(&board.folder).unwrap().map(|entry| entry.unwrap().file_name());
    let before: Vec<_> = names().collect();
    let stand = board.command("stand", &["--rig", "rig.toml", "--positions", "2", "--save", "cc.csv"]).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(1500));
    assert!(Command::new("kill").args(["-INT", &stand.id().to_string()]).status().unwrap().success());
    let done = stand.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("stopped by hand; nothing of it is kept"), "{}", text(&done.stderr));
    let left: Vec<_> = names().filter(|name| !before.contains(name)).collect();
    assert!(left.is_empty(), "{left:?}: {}", text(&done.stderr));
    board.motor_is_off();
}

#[test]
fn a_stand_that_is_killed_keeps_its_table() {
    let board = Board::new("stand-killed");
    std::fs::write(board.folder.join("rig.toml"), PIVT6_TOML).unwrap();
    let levels = ["--rig", "rig.toml", "--voltages", "6,7,8,9,10,11", "--readings", "2"];
    let mut stand = board.command("stand", &levels).spawn().unwrap();
    let table = board.folder.join("stand.csv");
    until("a table of three levels", || table.exists() && rows(&table) >= 6);
    stand.kill().unwrap();
    stand.wait().unwrap();
    let kept = motorbench_files::recording(&table, &[]).unwrap();
    assert!(kept.get(Channel::Speed).unwrap().iter().all(|speed| *speed > 10.0), "{kept:?}");
    board.trips_by_itself();
}

/// The virtual board's brake sets itself; efficiency over load is that of the equations, and a load that stalls the motor is
/// left out.
#[test]
fn the_stand_measures_efficiency_over_load() {
    let board = Board::new("stand-load");
    std::fs::write(board.folder.join("rig.toml"), PIVT6_TOML).unwrap();
    let levels = ["--rig", "rig.toml", "--voltages", "5,8,12", "--load-Nm", "0,0.01,0.02", "--readings", "2"];
    let done = board.run("stand", &[&levels[..], &["--json", "found.json"]].concat());
    let (said, page) = (text(&done.stderr), text(&done.stdout));
    assert_eq!(done.status.code(), Some(0), "{said}");
    assert!(said.contains("the brake is set to 0.02 Nm\n  5.00 V: left out"), "{said}");
    assert!(page.contains("Best measured: "), "{page}");
    let found: serde_json::Value =
        serde_json::from_slice(&std::fs::read(board.folder.join("found.json")).unwrap()).unwrap();
    let points = found["loaded"].as_array().unwrap();
    assert_eq!(points.len(), 8, "{found}");
    for point in points {
        let number = |name: &str| point[name].as_f64().unwrap();
        let (u, load, w) = (number("u_V"), number("load_Nm"), number("omega_rad_per_s"));
        let i = (0.012 + load + 5e-6 * w) / 0.072;
        let truth = load * w / (u * i);
        assert!((number("shaft_efficiency") - truth).abs() < 0.01, "{point}: {truth}");
        assert!((number("model_efficiency") - truth).abs() < 0.01, "{point}: {truth}");
        assert!((number("formula_efficiency") - 0.072 * w / u).abs() < 1e-6, "{point}");
    }
    assert!((found["load_scale"]["value"].as_f64().unwrap() - 1.0).abs() < 0.02, "{}", found["load_scale"]);
    let again = board.run_alone(&["stand", "stand.csv", "--rig", "rig.toml"]);
    assert_eq!(text(&again.stdout), page, "the table has the loads in it");
    board.motor_is_off();
}

/// A terminal of tmux with the tuning console in it, at 80 columns.
struct Terminal(String);

impl Terminal {
    /// Nothing, and why, where there is no tmux.
    fn new(board: &Board) -> Option<Self> {
        if Command::new("tmux").arg("-V").output().is_err() {
            println!("skipped: the tuning console is tested in tmux, which is not installed");
            return None;
        }
        let terminal = Self(board.folder.file_name().unwrap().to_string_lossy().into_owned());
        let console = format!(
            "cd {}; sh -c 'echo $$ > tune.pid; exec {MOTORBENCH} tune --port {} --reference 30'; echo exit $?; sleep 300",
            board.folder.display(),
            board.port().display()
        );
        terminal.tmux(&["new-session", "-d", "-x", "80", "-y", "30", "-s", &terminal.0, &console]);
        Some(terminal)
    }

    fn tmux(&self, arguments: &[&str]) -> String {
        // A server of its own, so that nobody's sessions are touched.
        text(&Command::new("tmux").args(["-L", &self.0]).args(arguments).output().unwrap().stdout)
    }

    fn press(&self, key: &str) {
        self.tmux(&["send-keys", "-t", &self.0, key]);
    }

    fn screen(&self) -> String {
        self.tmux(&["capture-pane", "-p", "-t", &self.0])
    }

    /// Waits until the screen shows a text.
    fn shows(&self, wanted: &str) {
        let mut screen = String::new();
        until(&format!("\"{wanted}\" on the screen"), || {
            screen = self.screen();
            screen.contains(wanted)
        });
    }

    /// Waits until the screen shows all of some texts.
    fn shows_at_once(&self, wanted: &[&str]) {
        until(&format!("{wanted:?} on the screen"), || {
            let screen = self.screen();
            wanted.iter().all(|text| screen.contains(text))
        });
    }

    /// Presses a key and waits for what it does.
    fn does(&self, key: &str, wanted: &str) {
        self.press(key);
        self.shows(wanted);
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.tmux(&["kill-server"]);
    }
}

/// Arms, tests a step, records, changes a gain, takes it back, changes to the LQR, quits.
#[test]
fn the_tuning_console_in_a_terminal() {
    let board = Board::new("tune");
    let Some(terminal) = Terminal::new(&board) else { return };
    terminal.shows("speed off to 30");
    terminal.does("s", "a arms first");
    terminal.does("a", "ARMED");
    terminal.does("s", "step test done");
    terminal.shows("error peak A");
    terminal.shows("│speed       0.");
    // The motor stands after it without being pushed: what is driven and does not turn trips.
    board.order("wait 3");
    terminal.shows_at_once(&["step test done", "duty 0.00 of 1", "speed ARMED"]);
    terminal.does("s", "step test ");
    terminal.shows("  before    0.");
    // In a small terminal a person still sees that the motor is driven, and what stops it.
    for (size, gain) in [(["40", "12"], "> speed_kp"), (["20", "5"], "q quit")] {
        terminal.tmux(&["resize-window", "-t", &terminal.0, "-x", size[0], "-y", size[1]]);
        terminal.shows_at_once(&["speed ARMED to 30", "step test done", "space stop  a arm", gain]);
    }
    terminal.tmux(&["resize-window", "-t", &terminal.0, "-x", "80", "-y", "30"]);
    terminal.does("r", "recording; r ends it");
    terminal.does("Right", "> speed_kp         0.05500");
    terminal.does("u", "> speed_kp         0.05000");
    terminal.does("Tab", "lqr_speed");
    terminal.does("r", "tune.csv: ");
    // A long message is there to its end.
    board.order("stop on");
    terminal.shows("\nand arms");
    board.order("stop off");
    terminal.press("q");
    terminal.shows("exit 0");
    terminal.shows_at_once(&["the drive is off; the gains are as before", "recordings: tune.csv"]);
    let side: serde_json::Value =
        serde_json::from_slice(&std::fs::read(board.folder.join("tune.json")).unwrap()).unwrap();
    assert_eq!(side["samples"].as_u64().unwrap() as usize, rows(&board.folder.join("tune.csv")));
    // While it takes a gain the firmware may drop samples; that is counted, and the times are those of its ticks.
    let recording = motorbench_files::recording(&board.folder.join("tune.csv"), &[]).unwrap();
    let ticks = 1 + (1000.0 * recording.time_s().unwrap().last().unwrap()).round() as u64;
    assert_eq!(ticks, side["samples"].as_u64().unwrap() + side["missing_ticks"].as_u64().unwrap());
    assert!(side["missing_ticks"].as_u64().unwrap() < 60, "some ten for each of three lines: {side}");
    assert!(side["settings_before"]["speed_kp"].as_f64().is_some(), "{side}");
    board.motor_is_off();
}

/// The same without a terminal, for programs: the step tests with their gains, and whether the board keeps the last.
#[test]
fn a_tuning_session_without_a_person() {
    let mut board = Board::new("tune-keys");
    let session = |board: &Board, keys: &str| {
        let done = board.run("tune", &["--reference", "30", "--keys", keys, "--json", "session.json"]);
        let account = std::fs::read(board.folder.join("session.json")).unwrap();
        (done, serde_json::from_slice::<serde_json::Value>(&account).unwrap())
    };
    let (done, account) = session(&board, "a s right s w");
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("\nspeed       0."), "{}", text(&done.stdout));
    assert!(text(&done.stdout).ends_with("the drive is off; the board keeps these gains\n"), "{}", text(&done.stdout));
    assert_eq!((&account["ended"], &account["saved"]), (&"complete".into(), &true.into()), "{account}");
    let tests = account["step_tests"].as_array().unwrap();
    assert_eq!(tests.len(), 2, "{account}");
    for (test, speed_kp) in tests.iter().zip([0.05, 0.055]) {
        let number = |name: &str| test[name].as_f64().unwrap();
        assert_eq!((&test["mode"], &test["gains"]["speed_kp"]), (&"speed".into(), &speed_kp.into()));
        assert!(number("from").abs() < 1.0 && number("to") == 30.0, "from rest: {test}");
        assert!(number("rise_s") > 0.01 && number("settling_s") > number("rise_s"), "{test}");
        assert!(number("steady_error").abs() < 0.5 && number("peak_A") > 0.1, "{test}");
    }
    // Both begin at rest with an integral of zero: the rise from 10 % hangs on it, the way to there on the gain.
    let errors = [0, 1].map(|test: usize| tests[test]["tracking_rms"].as_f64().unwrap());
    assert!(errors[1] < errors[0], "more gain follows closer: {account}");

    let (done, account) = session(&board, "a s + s");
    assert_eq!((done.status.code(), account["step_tests"].as_array().unwrap().len()), (Some(1), 1), "{account}");
    assert!(text(&done.stderr).contains("no step: the reference is 35 rad/s already"), "{}", text(&done.stderr));

    let done = board.run("tune", &["--reference", "0", "--keys", "a s"]);
    assert!(text(&done.stderr).contains("no step: the reference is 0 rad/s already"), "{}", text(&done.stderr));

    let (done, account) = session(&board, "tab right + down");
    for did in ["more       lqr_speed_kw 0.", "higher     reference 35 rad/s", "down       lqr_speed_kc 0."] {
        assert!(text(&done.stdout).contains(did), "{}", text(&done.stdout));
    }
    let said = text(&done.stdout);
    assert!(
        said.ends_with("the drive is off; the changed gains are not saved and last until the next reset\n"),
        "{said}"
    );
    assert_eq!((&account["gains_before"]["speed_kp"], &account["saved"]), (&0.055.into(), &false.into()), "{account}");

    // Begun before the drive is armed: the reference has its column all the same, and nothing is lost while it is.
    let (done, account) = session(&board, "r a s space r");
    assert_eq!((done.status.code(), &account["recordings"]), (Some(0), &serde_json::json!(["tune.csv"])));
    let recording = motorbench_files::recording(&board.folder.join("tune.csv"), &[]).unwrap();
    let asked = recording.get(motorbench_data::recording::Channel::SpeedReference).unwrap();
    assert!(asked[0] == 0.0 && asked.iter().any(|value| (value - 30.0).abs() < 0.1), "{asked:?}");
    let side: serde_json::Value =
        serde_json::from_slice(&std::fs::read(board.folder.join("tune.json")).unwrap()).unwrap();
    assert!(side["missing_ticks"].as_u64().unwrap() < 100, "some ten for each line: {}", side["missing_ticks"]);

    board.change("block on");
    let (done, account) = session(&board, "a s s");
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("the drive tripped"), "{}", text(&done.stderr));
    assert!(account["ended"]["tripped"].is_string() && account["step_tests"] == serde_json::json!([]), "{account}");
    board.motor_is_off();
    // As the board came, not as the session needed it.
    let shown = text(&board.run("connect", &["show trip_host"]).stdout);
    assert!(shown.starts_with("trip_host 0 "), "{shown}");
}

/// What the board answers to who takes leave is not left in the line for the program that opens it next.
#[test]
fn nothing_is_left_in_the_line() {
    let board = Board::new("leave");
    for (name, arguments) in [
        ("connect", &["status"][..]),
        ("connect", &["echo on"]),
        ("record", &["--sequence", "steps", "--period", "100"]),
        ("tune", &["--keys", "a s"]),
    ] {
        let done = board.run(name, arguments);
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        let line = std::fs::File::options().read(true).write(true).open(board.port()).unwrap();
        // What the board had to say is there by then.
        std::thread::sleep(std::time::Duration::from_millis(300));
        assert_eq!(rustix::io::ioctl_fionread(&line).unwrap(), 0, "{name} {arguments:?}");
    }
}

/// A session over a network that breaks off, or a window that is closed: the drive is off, and the board as it came.
#[test]
fn the_tuning_console_takes_leave_without_its_terminal() {
    let board = Board::new("tune-closed");
    let Some(terminal) = Terminal::new(&board) else { return };
    terminal.shows("speed off to 30");
    terminal.does("a", "ARMED");
    terminal.does("r", "recording; r ends it");
    let own = std::fs::read_to_string(board.folder.join("tune.pid")).unwrap();
    terminal.tmux(&["kill-session", "-t", &terminal.0]);
    until("its end", || {
        !Command::new("kill").args(["-0", own.trim()]).stderr(Stdio::null()).status().unwrap().success()
    });
    let left = board.run("connect", &["status", "show trip_host"]);
    let (said, warned) = (text(&left.stdout), text(&left.stderr));
    assert!(said.contains("mode off armed 0 trip 0 none") && said.contains("trip_host 0 "), "{said}{warned}");
    assert_eq!(warned, "");
    let side: serde_json::Value =
        serde_json::from_slice(&std::fs::read(board.folder.join("tune.json")).unwrap()).unwrap();
    assert_eq!(side["samples"].as_u64().unwrap() as usize, rows(&board.folder.join("tune.csv")));
}

/// Killed, it cannot stop the motor; the drive does. The recording under way is kept as far as it had come.
#[test]
fn the_tuning_console_dies_without_leaving_the_motor_driven() {
    let board = Board::new("tune-dies");
    let Some(terminal) = Terminal::new(&board) else { return };
    terminal.shows("speed off to 30");
    terminal.does("a", "ARMED");
    terminal.does("r", "recording; r ends it");
    let recording = board.folder.join("tune.csv");
    until("a recording", || recording.exists() && rows(&recording) >= 300);
    let own = std::fs::read_to_string(board.folder.join("tune.pid")).unwrap();
    assert!(Command::new("kill").args(["-KILL", own.trim()]).status().unwrap().success());
    terminal.shows("exit 137");
    assert!(rows(&recording) >= 300, "what had come is kept");
    let side = std::fs::read(board.folder.join("tune.json")).unwrap();
    let side: serde_json::Value = serde_json::from_slice(&side).unwrap();
    assert!(side["ended"] == "running" && side["settings_before"]["speed_kp"].is_number(), "{side}");
    assert!(std::fs::read_to_string(board.folder.join("tune.rig.toml")).unwrap().contains("counts_per_rev"));
    board.trips_by_itself();
}

//! The console of a board, typed by a person or sent by a script.

use crate::board::{Board, text};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, Command, Stdio};

/// A console at a terminal, its fingers, and what it answers after its greeting.
pub fn console(board: &Board) -> (Child, ChildStdin, impl Iterator<Item = String> + use<>) {
    let mut console = board.command("connect", &[]).stdin(Stdio::piped()).spawn().unwrap();
    let mut answers = BufReader::new(console.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(answers.next().unwrap().contains("an empty line stops the motor"));
    let fingers = console.stdin.take().unwrap();
    (console, fingers, answers)
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
        talk.stdin.take().unwrap().write_all(b"# a note\nbogus\nshow speed_kp\n").unwrap();
        let done = talk.wait_with_output().unwrap();
        let said = text(&done.stdout);
        assert!(said.contains("error: unknown command") && said.contains("speed_kp 0.05 "), "{said}");
        assert_eq!(done.status.code(), Some(1), "{said}");
        assert_eq!(said.matches("unknown command").count(), 1, "a line with # is not sent: {said}");
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

/// Encoder and current sensor are still those of a new board, and the motor does not fit them: a person who drives it hears
/// of it once, and so does a recording. Scales that somebody has set are theirs.
#[test]
fn scales_that_the_samples_contradict_are_told() {
    const CONTRADICTED: &str = "are still those of a new board, and the samples contradict them";
    let board = Board::with("console-scales", &["--with", "motor resistance_ohm=16"]);
    let (mut talk, mut fingers, _answers) = console(&board);
    let told = BufReader::new(talk.stderr.take().unwrap()).lines().map(Result::unwrap);
    fingers.write_all(b"arm\nmode open\nsequence steps 8 0 300 4\n").unwrap();
    board.order("wait 6");
    drop(fingers);
    assert!(talk.wait().unwrap().success());
    let told: Vec<String> = told.filter(|line| line.contains(CONTRADICTED)).collect();
    let remedy =
        format!("connect --port {} 'set counts_per_rev N' 'set current_gain MV_PER_A' save", board.port().display());
    assert!(told.len() == 1 && told[0].contains(&remedy), "{told:?}");

    let steps = ["--sequence", "steps", "--amplitude", "9", "--period", "400", "--count", "2"];
    let recorded = |arguments: &[&str]| text(&board.run("record", &[&steps[..], arguments].concat()).stderr);
    let said = recorded(&[]);
    assert!(said.contains(CONTRADICTED), "{said}");
    let own = recorded(&["--set", "current_gain=66", "--set", "trip_peak=4", "--set", "current_limit=0"]);
    assert!(!own.contains(CONTRADICTED), "{own}");
}

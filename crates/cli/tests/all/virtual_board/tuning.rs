//! Tuning on a board: without a model, in the console, and without a person.

use super::terminal::Terminal;
use crate::board::{Board, rows, text, until};
use std::process::{Command, Stdio};

/// The motor has friction and a bridge that loses voltage: gains come from where it turns, and not from where it sticks.
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
    assert!(gains.starts_with("# Written by motorbench") && gains.contains("\nset speed_kp 0."), "{gains}");
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

/// A gear motor of 10 rad/s asks for more gain of the position than the board's numbers hold: the loop is slower then.
#[test]
fn a_gear_motor_gets_gains_for_speed_and_position() {
    let folder = tempfile::tempdir().unwrap();
    let [rig, model] = ["rig.toml", "model.toml"].map(|name| folder.path().join(name));
    let motor = "[motor]\nresistance_ohm = 9\ninductance_H = 4e-3\ntorque_constant_Nm_per_A = 0.55\ninertia_kg_m2 = 0.005\nviscous_friction_Nm_s = 0.003\n";
    std::fs::write(&rig, format!("[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 1320\n{motor}")).unwrap();
    let effects = "[effects.coulomb_friction]\ntorque_Nm = 0.05\n[effects.voltage_drop]\ndrop_V = 1.5\n";
    std::fs::write(&model, format!("{motor}{effects}")).unwrap();
    let files = [&rig, &model].map(|path| path.to_str().unwrap());
    let board = Board::with("gear", &["--rig", files[0], "--model", files[1]]);
    assert_eq!(board.run("connect", &["set counts_per_rev 1320"]).status.code(), Some(0));
    let tuned = |arguments: &[&str]| -> serde_json::Value {
        let done = board.run("autotune", &[&["--json"], arguments].concat());
        assert_eq!(done.status.code(), Some(0), "{arguments:?}: {}", text(&done.stderr));
        serde_json::from_slice(&done.stdout).unwrap()
    };
    let speed = tuned(&[]);
    // 1/k rad/s per volt.
    let gain = speed["experiment"]["model"]["gain_rad_per_s_per_V"].as_f64().unwrap();
    assert!(speed["accepted"] == true && (gain * 0.55 - 1.0).abs() < 0.1, "{speed}");
    let position = tuned(&["--position"]);
    let loop_ms = position["closed_loop_ms"].as_f64().unwrap();
    assert!(position["accepted"] == true && loop_ms > 30.0 && loop_ms < 130.0, "{position}");
    // Its moves are those that the motor can follow: with a new board's 100 rad/s it would overshoot by 23 %.
    let cruise_rad_per_s = position["ranges"]["cruise_speed"].as_f64().unwrap();
    assert!((4.0..10.0).contains(&cruise_rad_per_s), "{position}");
    assert!(position["test"]["overshoot_percent"].as_f64().unwrap() < 20.0, "{position}");
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
    // By 1.1 %: less than a test that lasts 20 ms longer would change.
    assert!(errors[1] < 0.995 * errors[0], "more gain follows closer: {account}");

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

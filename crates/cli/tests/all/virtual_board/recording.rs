//! Recordings: whole, with what stands beside them, and the board as it was before.

use super::STEPS;
use crate::board::{Board, rows, text, until};
use crate::motor::PIVT6_TOML;

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

/// Gains of a fast loop come with a slew limit of its own, with which a reversal in open loop would trip. The board
/// keeps it.
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

/// The drive of a board whose own `trip_host` is off does not outlive a recording's program either. It is kept alive
/// through the recording, and what a person sets stays.
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

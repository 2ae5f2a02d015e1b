//! The test stand on a virtual board.

use crate::board::{Board, rows, text, until};
use crate::motor::PIVT6_TOML;
use motorbench_data::recording::Channel;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// As a person with hands runs it: levels, then the rotor held where it is asked for. The figures are those of the
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

/// The virtual board's brake sets itself; efficiency over load is that of the equations, and a load that stalls the
/// motor is left out.
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

//! No output of any command replaces a file that motorbench did not write, whatever its name; its own it does.

use crate::motor::PIVT6_TOML;
use crate::stand::stand_table;
use assert_cmd::Command;
use std::path::Path;
use tempfile::TempDir;

/// Files of a person and of other programs.
const FOREIGN: [(&str, &[u8]); 18] = [
    ("notes.txt", b"notes: buy bearings\n"),
    ("hand.toml", b"[supply]\nvoltage_V = 12\n"),
    // A sketch may use the very names of the channels.
    ("sketch.csv", b"t_s,u_V,rpm\n0.000,1.00,2.0\n0.010,1.00,2.0\n"),
    ("german.csv", b"t_s;u_V\n0,000;1,50\n"),
    ("other.csv", b"when,what\n1,2\n"),
    ("other.json", b"{\n \"a\": 1\n}\n"),
    ("other.html", b"<!DOCTYPE html><p>"),
    ("other.svg", b"<svg></svg>"),
    ("other.png", b"\x89PNG\r\n\x1a\nabc"),
    ("without_ending", b"hello"),
    ("lines.txt", b"set speed_kp 0.1\nand a note\n"),
    ("by_hand.txt", b"set speed_kp 0.1 speed_ki 2\nset speed_tf 2.28\n"),
    ("noted.txt", b"# of the afternoon\nset speed_kp 0.1\n"),
    ("book.xlsx", b"PK\x03\x04abc"),
    ("other.mat", b"MATLAB 5.0 MAT-file"),
    ("other.npy", b"\x93NUMPY"),
    ("other.npz", b"PK\x03\x04abc"),
    ("robot.wpilog", b"WPILOG"),
];

/// Commands, and the options with which each writes a file. The file's name follows at once or as the next word.
const COMMANDS: [(&[&str], &[&str]); 9] = [
    (&["simulate", "bench.toml"], &["--csv", "--plot", "--json="]),
    (&["analyse", "--rig", "rig.toml"], &["--bode", "--step", "--json="]),
    (&["identify", "run.csv", "--rig", "rig.toml"], &["--model", "--json="]),
    (&["design", "--rig", "rig.toml", "--speed", "--bandwidth-Hz", "5"], &["--console", "--json=", "--report"]),
    (&["compare", "model.toml", "model.toml"], &["--plot", "--json=", "--report"]),
    (&["stand", "table.csv", "--rig", "rig.toml"], &["--map", "--report", "--json="]),
    (&["convert", "run.csv"], &[""]),
    (&["settings"], &["--json="]),
    (&["diagnose", "run.csv", "--rig", "rig.toml"], &["--model", "--report", "--json="]),
];

fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "bench.toml",
        &format!(
            "duration_s = 1.0\nmode = \"open\"\n{PIVT6_TOML}[[reference]]\ntime_s = 0.1\nkind = \"sequence\"\nsequence = \"prbs\"\namplitude = 8\nperiod_ms = 60\ncount = 40\n"
        ),
    );
    write("model.toml", PIVT6_TOML);
    write("rig.toml", &format!("[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 2000\n{PIVT6_TOML}"));
    write("table.csv", &stand_table(0.5, 0.005));
    assert!(succeeds(folder.path(), &["simulate", "bench.toml", "--csv", "run.csv"]));
    folder
}

fn succeeds(folder: &Path, arguments: &[&str]) -> bool {
    let done = Command::cargo_bin("motorbench").unwrap().args(arguments).current_dir(folder).output().unwrap();
    done.status.success()
}

/// The command line that writes a file of this name.
fn that_writes<'a>(command: &[&'a str], option: &'a str, joined: &'a str, name: &'a str) -> Vec<&'a str> {
    let output = if option.is_empty() || option.ends_with('=') { vec![joined] } else { vec![option, name] };
    [command, &output].concat()
}

/// A name with the ending that the option's help shows.
fn usual_name(option: &str) -> &'static str {
    match option {
        "--plot" | "--map" => "made.svg",
        "--json=" => "made.json",
        "--model" => "made.toml",
        "--console" => "made.txt",
        "--report" => "made.html",
        _ => "made.csv",
    }
}

#[test]
fn files_of_others_are_kept() {
    let folder = folder();
    for (command, options) in COMMANDS {
        for option in options {
            for (name, contents) in FOREIGN {
                let file = folder.path().join(name);
                std::fs::write(&file, contents).unwrap();
                let joined = format!("{option}{name}");
                let is_written = succeeds(folder.path(), &that_writes(command, option, &joined, name));
                assert!(!is_written && std::fs::read(&file).unwrap() == contents, "{command:?} {option} {name}");
                std::fs::remove_file(&file).unwrap();
            }
        }
    }
}

/// What a command wrote it writes again, but no other kind of its own files.
#[test]
fn own_files_are_replaced_by_their_kind() {
    let folder = folder();
    for (command, options) in COMMANDS {
        for option in options {
            let name = usual_name(option);
            let joined = format!("{option}{name}");
            for _ in 0..2 {
                assert!(succeeds(folder.path(), &that_writes(command, option, &joined, name)), "{command:?} {option}");
            }
            std::fs::remove_file(folder.path().join(name)).unwrap();
        }
    }
    let csv = ["simulate", "bench.toml", "--csv"];
    let console = ["design", "--rig", "rig.toml", "--speed", "--bandwidth-Hz", "5", "--console"];
    for (command, name) in [(&csv[..], "made.csv"), (&csv, "made.txt"), (&console, "gains.txt")] {
        for _ in 0..2 {
            assert!(succeeds(folder.path(), &[command, &[name]].concat()), "{command:?} {name}");
        }
    }
    for name in ["made.mat", "made.npy", "made.npz", "made.wpilog", "again.csv"] {
        for _ in 0..2 {
            assert!(succeeds(folder.path(), &["convert", "run.csv", name]), "{name}");
        }
    }
    let lines = std::fs::read_to_string(folder.path().join("gains.txt")).unwrap();
    assert!(lines.starts_with("# Written by motorbench, which writes over it.\nset "), "{lines}");
    for (command, name) in [(&csv[..], "gains.txt"), (&console, "made.txt")] {
        assert!(!succeeds(folder.path(), &[command, &[name]].concat()), "{command:?} {name}");
    }
}

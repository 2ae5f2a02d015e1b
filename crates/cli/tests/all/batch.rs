//! `motorbench diagnose --batch`: many recordings with one line each, one of them damaged.

use hidden_effects::{Effect, Recipe, draw};
use std::process::Command;

#[test]
fn each_file_has_its_line_and_a_bad_one_stops_nothing() {
    let folder = std::env::temp_dir().join(format!("motorbench-batch-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let trial = draw(11, &Recipe::of(&[Effect::VoltageDrop]));
    std::fs::write(folder.join("good.csv"), &trial.csv).unwrap();
    std::fs::write(folder.join("bad.csv"), "t_s,u_V\n0,zero\n").unwrap();
    let rig = folder.join("rig.toml");
    std::fs::write(&rig, &trial.rig_toml).unwrap();
    let done = Command::new(env!("CARGO_BIN_EXE_motorbench"))
        .args(["diagnose", "--batch"])
        .arg(&folder)
        .arg("--rig")
        .arg(&rig)
        .output()
        .unwrap();
    std::fs::copy(&rig, folder.join("good.rig.toml")).unwrap();
    let beside = Command::new(env!("CARGO_BIN_EXE_motorbench"))
        .args(["diagnose", "--batch"])
        .arg(folder.join("good.csv"))
        .output()
        .unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let text = String::from_utf8(done.stdout).unwrap();
    let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |name: &str| lines.iter().find(|line| line["file"].as_str().unwrap().ends_with(name)).unwrap();
    assert_eq!(lines.len(), 2, "{text}");
    assert_eq!(of("good.csv")["outcome"]["causes"][0]["effect"], "voltage_drop");
    let error = of("bad.csv")["error"].as_str().unwrap();
    assert!(error.contains("bad.csv") && error.contains('2'), "{error}");
    assert_eq!(done.status.code(), Some(1));
    // Without --rig each recording uses the rig file beside it, with the same result.
    let alone: serde_json::Value = serde_json::from_slice(&beside.stdout).unwrap();
    assert!(alone["rig"].as_str().unwrap().ends_with("good.rig.toml"), "{alone}");
    assert_eq!((beside.status.code(), &alone["outcome"]), (Some(0), &of("good.csv")["outcome"]));
}

/// On Linux file names are arbitrary bytes; the output is text for all of them.
#[cfg(target_os = "linux")]
#[test]
fn a_name_that_is_no_text_has_its_line_too() {
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempfile::tempdir().unwrap();
    for name in [&b"m\xfcde.csv"[..], b"other.csv"] {
        std::fs::write(folder.path().join(std::ffi::OsStr::from_bytes(name)), "t_s,u_V\n0,zero\n").unwrap();
    }
    std::fs::write(folder.path().join(std::ffi::OsStr::from_bytes(b"m\xfcde.rig.toml")), "").unwrap();
    let done = Command::new(env!("CARGO_BIN_EXE_motorbench"))
        .args(["diagnose", "--batch", "."])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let text = String::from_utf8(done.stdout).unwrap();
    let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let mut files: Vec<&str> = lines.iter().map(|line| line["file"].as_str().unwrap()).collect();
    files.sort_unstable();
    assert_eq!((done.status.code(), &files[..]), (Some(1), &["./m\u{fffd}de.csv", "./other.csv"][..]), "{text}");
}

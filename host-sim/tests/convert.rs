//! Files of other tools, read by `motorbench convert`, and its own files by them. `tests/data/formats/make.py` made them
//! with SciPy and NumPy; the WPILOG and the SysId file follow the published formats.

use assert_cmd::Command;
use host_sim::recording::{Channel, Recording};
use predicates::prelude::*;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/formats").join(name)
}

fn convert(from: &Path, to: &Path, more: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("motorbench").unwrap().arg("convert").arg(from).arg(to).args(more).assert()
}

fn read(name: &str, more: &[&str]) -> Recording {
    let directory = TempDir::new().unwrap();
    let target = directory.path().join("run.csv");
    convert(&data(name), &target, more).success();
    Recording::read(&target, &[]).unwrap()
}

/// The spin-up of make.py.
fn assert_spin_up(recording: &Recording, tolerance: f64) {
    let time_s = recording.time_s().unwrap();
    assert_eq!(time_s.len(), 20);
    let (voltage, speed) = (recording.get(Channel::Voltage).unwrap(), recording.get(Channel::Speed).unwrap());
    for row in 0..20 {
        let t_s = 0.01 * row as f64;
        let x = if row < 5 { 0.0 } else { 1.0 - (-(t_s - 0.05) / 0.025).exp() };
        assert!((time_s[row] - t_s).abs() < tolerance, "{} is {t_s}", time_s[row]);
        assert!((speed[row] - 80.0 * x).abs() < 80.0 * tolerance, "speed {row}");
        assert!((voltage[row] - if row < 5 { 0.0 } else { 6.0 }).abs() < tolerance, "voltage {row}");
    }
}

#[test]
fn files_of_scipy_and_numpy() {
    for name in ["plain.mat", "compressed.mat", "types.mat", "structured.npy", "plain.npz"] {
        assert_spin_up(&read(name, &[]), 1e-6);
    }
    assert_spin_up(&read("compressed.npz", &["--map", "speed=omega_rad_per_s*6.283185307179586"]), 1e-6);
    let types = read("types.mat", &[]);
    assert_eq!(types.get(Channel::Counts).unwrap()[19], 19.0);
}

#[test]
fn a_robots_log() {
    let map = ["--map", "NT:/motor/velocity=omega_rad_per_s*6.283185307179586", "--map", "NT:/motor/volts=u_V"];
    assert_spin_up(&read("robot.wpilog", &map), 1e-6);
}

#[test]
fn the_four_tests_of_sysid() {
    let recording = read("sysid.json", &[]);
    assert_eq!(recording.len(), 2 * 59 + 2 * 29);
    let (voltage, speed) = (recording.get(Channel::Voltage).unwrap(), recording.get(Channel::Speed).unwrap());
    assert!((voltage[58] - 1.18).abs() < 1e-9 && (voltage[59] + 0.02).abs() < 1e-9);
    assert!((speed[130] - 10.0 * std::f64::consts::TAU).abs() < 1e-6);
}

#[test]
fn what_is_not_used_is_said() {
    let directory = TempDir::new().unwrap();
    convert(&data("compressed.mat"), &directory.path().join("a.csv"), &[])
        .success()
        .stdout(predicate::str::contains("run (a structure: save its fields with save(..., '-struct', ...))"));
    convert(&data("plain.mat"), &directory.path().join("a.csv"), &["--json"])
        .success()
        .stdout("{\"channels\":[\"t_s\",\"u_V\",\"omega_rad_per_s\",\"i_A\"],\"ignored\":[\"comment\",\"gains\"],\"samples\":20}\n");
}

#[test]
fn what_cannot_be_read_says_what_to_do() {
    let directory = TempDir::new().unwrap();
    let target = directory.path().join("a.csv");
    let fails = |name: &str, words: &str| {
        convert(&data(name), &target, &[]).code(1).stderr(predicate::str::contains(words));
    };
    fails("complex.mat", "u_V: expected a vector of real numbers");
    fails("matrix.npy", "an array without names");
    fails("robot.wpilog", "no known channel among NT:/motor/velocity, NT:/motor/volts, messages");
    fails("make.py", "its ending says no format");
    convert(&data("plain.mat"), &target, &["--map", "u_V=volts"])
        .code(2)
        .stderr(predicate::str::contains("no channel is called \"volts\""));
    assert!(!target.exists(), "nothing is written when something is wrong");
}

/// Read back by SciPy and NumPy where they are installed.
#[test]
fn scipy_and_numpy_read_what_is_written() {
    let script = "
import sys, numpy
from scipy.io import loadmat
mat, npy, npz = loadmat(sys.argv[1]), numpy.load(sys.argv[2]), numpy.load(sys.argv[3])
for name in ['t_s', 'u_V', 'omega_rad_per_s', 'i_A']:
    assert mat[name].shape == (20, 1) and npy[name].shape == npz[name].shape == (20,), name
    assert (mat[name].ravel() == npy[name]).all() and (npy[name] == npz[name]).all(), name
assert abs(npy['omega_rad_per_s'][19] - 80 * (1 - numpy.exp(-0.14 / 0.025))) < 1e-9
";
    let there = std::process::Command::new("python3").args(["-c", "import scipy.io"]).output();
    if !there.is_ok_and(|output| output.status.success()) {
        println!("SciPy is not installed: what it makes of the files is not checked");
        return;
    }
    let directory = TempDir::new().unwrap();
    let targets = ["a.mat", "a.npy", "a.npz"].map(|name| directory.path().join(name));
    for target in &targets {
        convert(&data("plain.mat"), target, &[]).success();
    }
    Command::new("python3").arg("-c").arg(script).args(&targets).assert().success();
}

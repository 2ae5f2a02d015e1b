//! `motorbench convert` with files of other tools, and its own files in these tools. `tests/data/formats/make.py` made
//! the files with SciPy and NumPy, `make_wpilib.py` one with WPILib's own logger. The others follow the published
//! formats.

use assert_cmd::Command;
use motorbench_data::recording::{Channel, Recording};
use motorbench_files::recording;
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
    recording(&target, &[]).unwrap()
}

/// The run-up of make.py.
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

/// A robot that is switched off while it logs: all complete records are kept.
#[test]
fn a_log_that_ends_within_a_record() {
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    let mut whole = Recording::new("whole");
    let times = || (0..20).map(|row| 0.01 * f64::from(row));
    whole.set(Channel::Time, times().collect());
    whole.set(Channel::Speed, times().map(|t_s| 80.0 * t_s).collect());
    std::fs::write(at("whole.csv"), whole.to_csv()).unwrap();
    convert(&at("whole.csv"), &at("whole.wpilog"), &[]).success();
    let log = std::fs::read(at("whole.wpilog")).unwrap();
    for missing in 1..25 {
        std::fs::write(at("cut.wpilog"), &log[..log.len() - missing]).unwrap();
        let said = predicate::str::contains("is incomplete; the records before it are complete");
        convert(&at("cut.wpilog"), &at("cut.csv"), &[]).success().stdout(said);
        assert_eq!(recording(&at("cut.csv"), &[]).unwrap().len(), 19, "{missing} bytes are missing");
    }
    std::fs::write(at("cut.wpilog"), &log[..10]).unwrap();
    convert(&at("cut.wpilog"), &at("cut.csv"), &[]).code(1);
}

/// The project's tables for a spreadsheet are read back without options.
#[test]
fn a_table_with_decimal_commas_is_read_again() {
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    convert(&data("plain.mat"), &at("run.csv"), &[]).success();
    let to = ["--to-delimiter", ";", "--to-decimal-comma"];
    convert(&at("run.csv"), &at("commas.csv"), &to).success();
    convert(&at("commas.csv"), &at("again.csv"), &[]).success();
    let [run, again] = ["run.csv", "again.csv"].map(|name| recording(&at(name), &[]).unwrap().to_csv());
    assert_eq!(run, again);
}

#[test]
fn the_four_tests_of_sysid() {
    let recording = read("sysid.json", &[]);
    assert_eq!(recording.len(), 2 * 59 + 2 * 29);
    let (voltage, speed) = (recording.get(Channel::Voltage).unwrap(), recording.get(Channel::Speed).unwrap());
    assert!((voltage[58] - 1.18).abs() < 1e-9 && (voltage[59] + 0.02).abs() < 1e-9);
    assert!((speed[130] - 10.0 * std::f64::consts::TAU).abs() < 1e-6);
}

/// A log by WPILib's `SysIdRoutineLog`: the entries of a motor are found by their names and units.
#[test]
fn a_routine_logged_by_wpilib() {
    let recording = read("routine.wpilog", &[]);
    let [time_s, voltage, angle, speed] = [Channel::Time, Channel::Voltage, Channel::Angle, Channel::Speed]
        .map(|channel| recording.get(channel).unwrap());
    assert_eq!(recording.len(), 280);
    // The wheel of make_wpilib.py, with the same arithmetic; 2 s between tests.
    let (mut row, mut t_s, mut turns, mut rate) = (0, 0.0, 0.0, 0.0);
    let step = |turns: &mut f64, rate: &mut f64, volts: f64| {
        *rate += (volts / 0.12 - *rate) * 0.02 / 0.1;
        *turns += *rate * 0.02;
    };
    let tests: [(&dyn Fn(f64) -> f64, usize); 4] =
        [(&|k| 0.02 * (k + 1.0), 100), (&|k| -0.02 * (k + 1.0), 100), (&|_| 7.0, 40), (&|_| -7.0, 40)];
    for (volts, periods) in tests {
        for k in 0..periods {
            let volts = volts(k as f64);
            assert!((time_s[row] - t_s).abs() < 1e-6 && (voltage[row] - volts).abs() < 1e-9, "row {row}");
            let tau = std::f64::consts::TAU;
            assert!((angle[row] - tau * turns).abs() < 1e-6 && (speed[row] - tau * rate).abs() < 1e-6, "row {row}");
            step(&mut turns, &mut rate, volts);
            (row, t_s) = (row + 1, t_s + 0.02);
        }
        (0..100).for_each(|_| step(&mut turns, &mut rate, 0.0));
        t_s += 2.0;
    }
    // The four tests are found, also for SysId's own format.
    let directory = TempDir::new().unwrap();
    let tests = directory.path().join("tests.json");
    convert(&data("routine.wpilog"), &tests, &[]).success();
    // Channels that SysId cannot hold are not listed.
    let mut recording = recording;
    recording.set(Channel::Current, vec![0.1; 280]);
    let more = directory.path().join("more.csv");
    std::fs::write(&more, recording.to_csv()).unwrap();
    let said = predicate::str::ends_with("280 samples of t_s, u_V, theta_rad, omega_rad_per_s\n");
    convert(&more, &tests, &[]).success().stdout(said);
}

/// Positions are rotations, whatever unit SysId shows.
#[test]
fn sysids_unit_is_for_its_display() {
    let directory = TempDir::new().unwrap();
    let text = std::fs::read_to_string(data("sysid.json")).unwrap();
    let degrees = directory.path().join("degrees.json");
    let shown = text
        .replace("\"Rotations\"", "\"Degrees\"")
        .replace("\"unitsPerRotation\": 1.0", "\"unitsPerRotation\": 360.0");
    assert_ne!(shown, text);
    std::fs::write(&degrees, shown).unwrap();
    let target = directory.path().join("run.csv");
    convert(&degrees, &target, &[]).success();
    assert_eq!(recording(&target, &[]).unwrap().get(Channel::Speed), read("sysid.json", &[]).get(Channel::Speed));
    std::fs::write(&degrees, text.replace("\"Simple\"", "\"Drivetrain\"")).unwrap();
    convert(&degrees, &target, &[])
        .code(1)
        .stderr(predicate::str::contains("expected [time, and voltages, positions, velocities left and right"));
}

/// Reads the file back with WPILib, where it is installed.
#[test]
fn wpilib_reads_what_is_written() {
    let script = "
import sys
from wpiutil.log import DataLogReader
reader = DataLogReader(sys.argv[1])
assert reader.isValid() and reader.getVersion() == 0x0100
names, values = {}, {}
for record in reader:
    if record.isStart():
        start = record.getStartData()
        names[start.entry] = (start.name, start.type)
    elif not record.isControl():
        name, kind = names[record.getEntry()]
        assert kind == 'double'
        values.setdefault(name, []).append((record.getTimestamp(), record.getDouble()))
assert set(values) == {'u_V', 'omega_rad_per_s', 'i_A'}, set(values)
assert [stamp for stamp, _ in values['u_V']] == [10000 * k for k in range(20)]
assert [value for _, value in values['u_V']] == [0.0] * 5 + [6.0] * 15
";
    let there = std::process::Command::new("python3").args(["-c", "import wpiutil.log"]).output();
    if !there.is_ok_and(|output| output.status.success()) {
        println!("WPILib (pip install robotpy-wpiutil) is not installed: its reading of the file is not checked");
        return;
    }
    let directory = TempDir::new().unwrap();
    let target = directory.path().join("a.wpilog");
    convert(&data("plain.mat"), &target, &[]).success();
    Command::new("python3").arg("-c").arg(script).arg(&target).assert().success();
}

#[test]
fn what_is_not_used_is_said() {
    let directory = TempDir::new().unwrap();
    convert(&data("compressed.mat"), &directory.path().join("a.csv"), &[])
        .success()
        .stdout(predicate::str::contains("run/t_s"));
    let made = convert(&data("plain.mat"), &directory.path().join("a.csv"), &["--json"]).success();
    let said: serde_json::Value = serde_json::from_slice(&made.get_output().stdout).unwrap();
    let expected = serde_json::json!({
        "channels": ["t_s", "u_V", "omega_rad_per_s", "i_A"], "ignored": ["gains/1", "gains/2", "gains/3", "comment"],
        "samples": 20, "cut": null, "notes": []
    });
    assert_eq!(said, expected);
}

#[test]
fn what_cannot_be_read_says_what_to_do() {
    let directory = TempDir::new().unwrap();
    let target = directory.path().join("a.csv");
    let fails = |name: &str, words: &str| {
        convert(&data(name), &target, &[]).code(1).stderr(predicate::str::contains(words));
    };
    fails("complex.mat", "u_V: expected an array of real numbers");
    fails("matrix.npy", "Name them, for instance --column 1=t_s");
    fails("robot.wpilog", "no known channel among NT:/motor/velocity, NT:/motor/volts. Likely: --column");
    fails("make.py", "no format has this ending");
    convert(&data("plain.mat"), &target, &["--map", "u_V=volts"])
        .code(2)
        .stderr(predicate::str::contains("no channel is called \"volts\""));
    assert!(!target.exists(), "after an error nothing is written");
}

/// Reads the files back with SciPy and NumPy, where they are installed.
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
        println!("SciPy is not installed: its reading of the files is not checked");
        return;
    }
    let directory = TempDir::new().unwrap();
    let targets = ["a.mat", "a.npy", "a.npz"].map(|name| directory.path().join(name));
    for target in &targets {
        convert(&data("plain.mat"), target, &[]).success();
    }
    Command::new("python3").arg("-c").arg(script).args(&targets).assert().success();
}

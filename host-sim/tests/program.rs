//! The program as a person runs it: simulated recordings through its commands.

use assert_cmd::Command;
use host_sim::motor::MotorParameters;
use host_sim::scenario::Scenario;
use host_sim::telemetry;
use predicates::prelude::*;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

const MOTOR: &str = "[motor]
resistance_ohm = 5.84
inductance_H = 11.68e-3
torque_constant_Nm_per_A = 0.072
inertia_kg_m2 = 2.22e-5
viscous_friction_Nm_s = 5e-6
";

fn motorbench(arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("motorbench").unwrap().args(arguments).assert()
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A linear motor with noise, played the core's own sequence for identification, and the rig file that goes with it.
struct Bench {
    _directory: TempDir,
    run: PathBuf,
    rig: PathBuf,
    model: PathBuf,
}

fn bench() -> &'static Bench {
    static BENCH: OnceLock<Bench> = OnceLock::new();
    BENCH.get_or_init(|| {
        let directory = TempDir::new().unwrap();
        let at = |name: &str| directory.path().join(name);
        let scenario = format!(
            "duration_s = 10.0\nmode = \"open\"\n{MOTOR}\n[noise]\ncurrent_A = 0.01\nseed = 3\n
             [[reference]]\ntime_s = 0.1\nkind = \"sequence\"\nsequence = \"prbs\"\namplitude = 8\nperiod_ms = 60\ncount = 400\n"
        );
        std::fs::write(at("scenario.toml"), scenario).unwrap();
        std::fs::write(at("model.toml"), MOTOR).unwrap();
        let scenario = Scenario::read(&at("scenario.toml")).unwrap();
        std::fs::write(at("run.csv"), scenario.run().unwrap().recording.to_csv()).unwrap();
        let rig = telemetry::rig(&scenario.settings, host_sim::rig::NominalMotor::default());
        std::fs::write(at("rig.toml"), toml::to_string(&rig).unwrap()).unwrap();
        Bench { run: at("run.csv"), rig: at("rig.toml"), model: at("model.toml"), _directory: directory }
    })
}

fn json_of(arguments: &[&str]) -> Value {
    let output = motorbench(arguments).success().get_output().stdout.clone();
    serde_json::from_slice(&output).expect("the terminal has JSON and nothing else")
}

#[test]
fn identify_finds_the_constants_that_made_the_recording() {
    let bench = bench();
    let found = json_of(&["identify", path(&bench.run), "--rig", path(&bench.rig), "--json", "-"]);
    let truth = MotorParameters { inertia_kg_m2: 2.22e-5, ..MotorParameters::PIVT6 };
    for (name, value) in truth.named() {
        let (low, high) = (&found["parameters"][name]["ci95"][0], &found["parameters"][name]["ci95"][1]);
        assert!(low.as_f64() < Some(value) && Some(value) < high.as_f64(), "{name} = {value}: [{low}, {high}]");
    }
    for (name, value) in &truth.named()[..4] {
        let off = found["parameters"][name]["value"].as_f64().unwrap() / value - 1.0;
        assert!(off.abs() < 0.03, "{name} is off by {:.1} %", 100.0 * off);
    }
    assert!(found["fit"]["omega_rad_per_s"]["fit_percent"].as_f64() > Some(97.0), "{}", found["fit"]);
}

#[test]
fn identify_writes_a_model_that_others_read() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let model = directory.path().join("found.toml");
    motorbench(&["identify", path(&bench.run), "--rig", path(&bench.rig), "--model", path(&model)])
        .success()
        .stdout(predicate::str::contains("Free-running simulation against data that no fit has seen"))
        .stderr("");
    motorbench(&["analyse", "--model", path(&model)]).success();
    assert!(host_sim::model::Model::parse(&std::fs::read_to_string(&bench.model).unwrap()).is_ok());
}

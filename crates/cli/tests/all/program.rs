//! The program as a person runs it: simulated recordings through its commands.

use crate::motor::PIVT6_TOML;
use assert_cmd::Command;
use motorbench_data::recording::Channel;
use motorbench_data::telemetry;
use motorbench_model::motor::MotorParameters;
use predicates::prelude::*;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

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
            "duration_s = 10.0\nmode = \"open\"\n{PIVT6_TOML}\n[noise]\ncurrent_A = 0.01\nseed = 3\n
             [[reference]]\ntime_s = 0.1\nkind = \"sequence\"\nsequence = \"prbs\"\namplitude = 8\nperiod_ms = 60\ncount = 400\n"
        );
        std::fs::write(at("scenario.toml"), scenario).unwrap();
        std::fs::write(at("model.toml"), PIVT6_TOML).unwrap();
        let scenario = motorbench_files::scenario(&at("scenario.toml"), None).unwrap();
        std::fs::write(at("run.csv"), scenario.run().unwrap().recording.to_csv()).unwrap();
        let rig = telemetry::rig_of_core(&scenario.settings, motorbench_data::rig::NominalMotor::default());
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
    let ends = |name: &str| [0, 1].map(|end| found["parameters"][name]["ci95"][end].as_f64().unwrap());
    // The interval of viscous friction knows nothing of what falsifies it by a fiftieth: eight conversions stand for the
    // mean over a tick, which in the tick of a step is 12 mA more.
    for (name, value) in &truth.named()[..4] {
        let [low, high] = ends(name);
        assert!((low..high).contains(value), "{name} = {value}: [{low}, {high}]");
    }
    for (name, value) in &truth.named() {
        let off = found["parameters"][*name]["value"].as_f64().unwrap() / value - 1.0;
        assert!(off.abs() < 0.03, "{name} is off by {:.1} %", 100.0 * off);
    }
    assert!(found["fit"]["omega_rad_per_s"]["fit_percent"].as_f64() > Some(97.0), "{}", found["fit"]);
}

/// As a shell's `run*.csv` gives it beside a copy.
#[test]
fn one_recording_is_not_taken_for_two() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let copy = directory.path().join("copy.csv");
    std::fs::copy(&bench.run, &copy).unwrap();
    for command in ["identify", "diagnose"] {
        let says = predicate::str::contains("copy.csv has the same rows as")
            .and(predicate::str::contains("leave one of them out"));
        motorbench(&[command, path(&bench.run), path(&copy), "--rig", path(&bench.rig)]).failure().stderr(says);
    }
}

/// Eight milliseconds in a rig file that asks for seconds.
#[test]
fn a_window_that_is_longer_than_the_recording_is_refused() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let rig = directory.path().join("rig.toml");
    std::fs::write(&rig, "[supply]\nvoltage_V = 12\n[recording]\nspeed_window_s = 20\n").unwrap();
    let says =
        predicate::str::contains("[recording] speed_window_s = 20.000 s is longer than any part of the recording");
    motorbench(&["diagnose", path(&bench.run), "--rig", path(&rig)]).failure().stderr(says);
}

/// As `record` writes it; without it the rig is not known.
#[test]
fn the_rig_file_beside_a_recording_is_taken() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let run = directory.path().join("run.csv");
    std::fs::copy(&bench.run, &run).unwrap();
    let identified = |arguments: &[&str]| json_of(&[&["identify", path(&run), "--json", "-"], arguments].concat());
    let (alone, named) = (identified(&[]), identified(&["--rig", path(&bench.rig)]));
    assert_ne!(alone, named);
    std::fs::copy(&bench.rig, directory.path().join("run.rig.toml")).unwrap();
    assert_eq!(identified(&[]), named);
}

/// Counts before x4 decoding, and another supply: the recording's own columns know better.
#[test]
fn a_rig_file_that_contradicts_the_recording_is_told() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let (rig, wrong) = (std::fs::read_to_string(&bench.rig).unwrap(), directory.path().join("wrong.toml"));
    let changed = rig.replace("counts_per_rev = 2000.0", "counts_per_rev = 500.0");
    let changed = changed.replace("voltage_V = 12.0", "voltage_V = 24.0");
    std::fs::write(&wrong, changed).unwrap();
    let notes = |rig: &Path| -> Vec<String> {
        let found = json_of(&["identify", path(&bench.run), "--rig", path(rig), "--json", "-"]);
        serde_json::from_value(found["notes"].clone()).unwrap()
    };
    let told = |rig: &Path| notes(rig).into_iter().filter(|note| note.contains("contradicts")).collect::<Vec<_>>();
    assert_eq!(told(&bench.rig), [""; 0]);
    let told = told(&wrong);
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(told[0].contains("counts_per_rev = 500, but counts and omega_rad_per_s give 2000"), "{told:?}");
    assert!(told[1].contains("voltage_V = 24.0, but duty and u_V give 12.0"), "{told:?}");
}

/// A model in the place of a rig file, and columns that no command knows: neither is left out silently.
#[test]
fn what_is_not_used_of_a_file_is_said() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let [model, odd] = ["found.toml", "odd.csv"].map(|name| directory.path().join(name));
    std::fs::write(&model, format!("{PIVT6_TOML}[effects.coulomb_friction]\ntorque_Nm = 0.01\n")).unwrap();
    let lines = std::fs::read_to_string(&bench.run).unwrap();
    let lines =
        lines.lines().enumerate().map(|(line, text)| format!("{text},{}\n", if line == 0 { "temp_C" } else { "21" }));
    std::fs::write(&odd, lines.collect::<String>()).unwrap();
    let is_model = predicate::str::contains("found.toml is a model file. It is used as a rig file");
    motorbench(&["identify", path(&bench.run), "--rig", path(&model)]).success().stderr(is_model);
    let unknown = || predicate::str::contains("odd.csv: columns without a known name are not used: temp_C.");
    for command in
        [&["identify", path(&odd), "--rig", path(&bench.rig)][..], &["compare", path(&odd), path(&bench.run)]]
    {
        motorbench(command).success().stderr(unknown());
    }
}

#[test]
fn identify_writes_a_model_that_others_read() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let model = directory.path().join("found.toml");
    motorbench(&["identify", path(&bench.run), "--rig", path(&bench.rig), "--model", path(&model)])
        .success()
        .stdout(predicate::str::contains("Free-running simulation against held-out data"))
        .stderr("");
    motorbench(&["analyse", "--model", path(&model)]).success();
    assert!(motorbench_model::Model::parse(&std::fs::read_to_string(&bench.model).unwrap()).is_ok());
}

#[test]
fn compare_finds_the_delay_between_two_recordings() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let (late, plot) = (directory.path().join("late.csv"), directory.path().join("both.svg"));
    // The same course, of which the first 50 samples are missing.
    let text = std::fs::read_to_string(&bench.run).unwrap();
    let lines: Vec<&str> = text.lines().enumerate().filter(|(line, _)| !(1..=50).contains(line)).map(|l| l.1).collect();
    std::fs::write(&late, lines.join("\n")).unwrap();
    let (run, late) = (path(&bench.run), path(&late));
    let compared = json_of(&["compare", run, late, "--plot", path(&plot), "--json", "-"]);
    let interval_s = 10.0 / (text.lines().count() - 1) as f64;
    let delay_s = compared["delay_s"].as_f64().unwrap();
    assert!((delay_s + 50.0 * interval_s).abs() < 0.1 * interval_s, "{delay_s} s");
    for channel in compared["channels"].as_array().unwrap() {
        assert!(channel["fit_percent"].as_f64() > Some(95.0), "{channel}");
    }
    let svg = std::fs::read_to_string(plot).unwrap();
    assert!(svg.contains("speed, rad/s") && svg.contains("second - first, rad/s") && svg.contains("</svg>"));
}

/// Every command that draws; what a PNG shows is tested where it is made.
#[test]
fn plots_are_png_where_the_name_says_so() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (table, scenario) = (at("table.csv"), at("scenario.toml"));
    std::fs::write(&table, stand_table(0.5, 0.005)).unwrap();
    std::fs::write(&scenario, format!("duration_s = 0.2\nmode = \"open\"\n{PIVT6_TOML}")).unwrap();
    let (run, model, rig, plot) = (path(&bench.run), path(&bench.model), path(&bench.rig), at("plot.png"));
    let stand_rig = at("rig.toml");
    std::fs::write(&stand_rig, PIVT6_TOML).unwrap();
    for drawing in [
        &["simulate", path(&scenario), "--plot"][..],
        &["compare", run, run, "--plot"],
        &["compare", model, model, "--plot"],
        &["compare", run, model, "--rig", rig, "--plot"],
        &["stand", path(&table), "--rig", path(&stand_rig), "--map"],
    ] {
        motorbench(&[drawing, &[path(&plot)]].concat()).success();
        let bytes = std::fs::read(&plot).unwrap();
        assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 5_000, "{drawing:?}: {} bytes", bytes.len());
        std::fs::remove_file(&plot).unwrap();
        let other = at("plot.jpg");
        motorbench(&[drawing, &[path(&other)]].concat()).code(2).stderr(predicate::str::contains(".svg or .png"));
    }
}

#[test]
fn compare_tells_models_and_their_constants_apart() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let other = directory.path().join("other.toml");
    std::fs::write(&other, PIVT6_TOML.replace("5.84", "7.3") + "[effects.coulomb_friction]\ntorque_Nm = 0.005\n")
        .unwrap();
    let models = json_of(&["compare", path(&bench.model), path(&other), "--voltage", "12", "--json", "-"]);
    assert!((models["parameters"][0]["change_percent"].as_f64().unwrap() - 25.0).abs() < 1e-9);
    let step = |which: &str| models["step"][which].as_f64().unwrap();
    // At rest from all change: w = (U - R (T + b w) / k) / k.
    let (k, b) = (0.072, 5e-6);
    let speed = |r: f64, torque: f64| (12.0 - r * torque / k) / (k + r * b / k);
    assert!((step("first_rad_per_s") / speed(5.84, 0.0) - 1.0).abs() < 2e-3, "{}", models["step"]);
    assert!((step("second_rad_per_s") / speed(7.3, 0.005) - 1.0).abs() < 2e-3, "{}", models["step"]);
    let plot = directory.path().join("models.svg");
    motorbench(&["compare", path(&bench.model), path(&other), "--plot", path(&plot)]).success();
    let svg = std::fs::read_to_string(&plot).unwrap();
    assert!(["speed after the step", "dB re 1", "phase, degrees"].iter().all(|panel| svg.contains(panel)), "{svg}");
    // Low frequencies: 1 / (k + R b / k).
    let low = 20.0 * (1.0 / (k + 5.84 * b / k)).log10();
    assert!((models["magnitudes"][0]["first_dB"].as_f64().unwrap() - low).abs() < 0.1);

    let good = json_of(&["compare", path(&bench.run), path(&bench.model), "--rig", path(&bench.rig), "--json", "-"]);
    let bad = json_of(&["compare", path(&bench.run), path(&other), "--rig", path(&bench.rig), "--json", "-"]);
    let fit = |result: &Value| {
        let channels = result["channels"].as_array().unwrap();
        channels.iter().find(|channel| channel["channel"] == "omega_rad_per_s").unwrap()["fit_percent"]
            .as_f64()
            .unwrap()
    };
    assert!(fit(&good) > 97.0 && fit(&bad) < 90.0, "{} and {}", fit(&good), fit(&bad));

    let constants = |name: &str, resistance: f64| {
        let file = directory.path().join(name);
        let ci95 = [resistance - 0.196, resistance + 0.196];
        let text = serde_json::json!({ "parameters": { "resistance_ohm": { "value": resistance, "ci95": ci95 } } });
        std::fs::write(&file, text.to_string()).unwrap();
        file
    };
    let (a, b) = (constants("a.json", 5.0), constants("b.json", 5.3));
    let sigmas = json_of(&["compare", path(&a), path(&b), "--json", "-"])["parameters"][0]["sigmas"].as_f64().unwrap();
    motorbench(&["compare", path(&a), path(&b), "--plot", path(&plot)])
        .code(1)
        .stderr(predicate::str::contains("leave --plot out"));
    // Each is known to 0.1, their difference to 0.1 times the root of 2.
    assert!((sigmas - 3.0 / 2.0_f64.sqrt()).abs() < 1e-9, "{sigmas}");
}

/// The motor with friction, `true.toml`, and without, `linear.toml`.
fn with_and_without_friction() -> TempDir {
    let directory = TempDir::new().unwrap();
    let friction = format!("{PIVT6_TOML}[effects.coulomb_friction]\ntorque_Nm = 0.01\n");
    std::fs::write(directory.path().join("true.toml"), friction).unwrap();
    std::fs::write(directory.path().join("linear.toml"), PIVT6_TOML).unwrap();
    directory
}

/// A loop measured on a motor with friction, simulated with one that has it and with one that has not.
#[test]
fn validate_sees_what_the_model_lacks() {
    let bench = bench();
    let directory = with_and_without_friction();
    let at = |name: &str| directory.path().join(name);
    let steps = [60, 20, -50, 40, -20, 70, 10, -60]
        .iter()
        .enumerate()
        .map(|(index, value)| format!("[[reference]]\ntime_s = {}\nvalue = {value}\n", 0.1 + 0.7 * index as f64));
    let scenario = format!(
        "duration_s = 5.7\nmode = \"speed\"\nmodel = \"true.toml\"\n[settings]\nspeed_kp = 0.07\nspeed_ki = 1.5\n[noise]\ncurrent_A = 0.01\n{}",
        steps.collect::<String>()
    );
    std::fs::write(at("loop.toml"), scenario).unwrap();
    motorbench(&["simulate", path(&at("loop.toml")), "--csv", path(&at("measured.csv"))]).success();
    let validate = |model: &str| {
        let (measured, scenario, model) = (at("measured.csv"), at("loop.toml"), at(model));
        let rig = path(&bench.rig);
        json_of(&[
            "validate",
            path(&measured),
            "--scenario",
            path(&scenario),
            "--model",
            path(&model),
            "--rig",
            rig,
            "--json",
            "-",
        ])
    };
    let fit = |result: &Value, channel: &str| {
        let channels = result["comparison"]["channels"].as_array().unwrap();
        channels.iter().find(|entry| entry["channel"] == channel).unwrap()["fit_percent"].as_f64().unwrap()
    };
    let (good, bad) = (validate("true.toml"), validate("linear.toml"));
    assert!(fit(&good, "i_A") > fit(&bad, "i_A") + 20.0, "{} and {}", fit(&good, "i_A"), fit(&bad, "i_A"));
    assert!(bad["remaining"][0].as_str().unwrap().contains("coulomb_friction"), "{}", bad["remaining"]);
    assert!(!good["remaining"][0].as_str().unwrap().contains("coulomb_friction"), "{}", good["remaining"]);
    // The verdict is of the recording, and not of the model that has what it lacks.
    assert!(good["remaining"][1].as_str().unwrap().starts_with("Diagnosis of the measured loop alone"));
    let rise = |which: &str| good["figures"][which][0]["rise_s"].as_f64().unwrap();
    assert!((rise("measured") / rise("simulated") - 1.0).abs() < 0.1, "{} and {}", rise("measured"), rise("simulated"));
}

/// With a lighter motor than the true one the simulated loop swings, and the drive switches itself off.
#[test]
fn validate_compares_up_to_a_trip_of_the_simulation() {
    let bench = bench();
    let directory = with_and_without_friction();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("wrong.toml"), PIVT6_TOML.replace("5.84", "0.584")).unwrap();
    let scenario = |extra: &str| {
        format!(
            "duration_s = 2.0\nmode = \"speed\"\nmodel = \"true.toml\"\n{extra}[settings]\nslew_limit = 30000\ncurrent_limit = 0\n[[reference]]\ntime_s = 0.1\nvalue = 30\n[[reference]]\ntime_s = 0.6\nkind = \"sequence\"\nsequence = \"steps\"\namplitude = 60\nperiod_ms = 300\ncount = 2\n"
        )
    };
    std::fs::write(at("loop.toml"), scenario("")).unwrap();
    motorbench(&["simulate", path(&at("loop.toml")), "--csv", path(&at("loop.csv"))]).success();
    let (measured, course, wrong) = (at("loop.csv"), at("loop.toml"), at("wrong.toml"));
    let validate =
        ["validate", path(&measured), "--scenario", path(&course), "--rig", path(&bench.rig), "--model", path(&wrong)];
    let off = "the drive switched itself off at 0.9";
    let told = motorbench(&validate).code(1).stderr(predicate::str::contains(format!("speed PID, simulated: {off}")));
    let text = String::from_utf8(told.get_output().stdout.clone()).unwrap();
    assert!(text.contains("compared over 0.9") && text.contains(&format!("in the simulation {off}")), "{text}");
    assert!(text.contains("over-current, peak;") && !text.contains("OverCurrent"), "{text}");
    let found = motorbench(&[&validate[..], &["--json", "-"]].concat()).code(1).get_output().stdout.clone();
    let found: Value = serde_json::from_slice(&found).unwrap();
    assert_eq!(found["trip"], "OverCurrentPeak", "{found}");
    let (trip_s, duration_s) = (found["trip_s"].as_f64().unwrap(), found["comparison"]["duration_s"].as_f64().unwrap());
    assert!((trip_s - duration_s).abs() < 0.003 && (0.9..1.0).contains(&trip_s), "{found}");
    assert!(found["notes"][0].as_str().unwrap().contains("the comparison ends there"), "{found}");
    assert_eq!(found["figures"]["measured"][0]["course"], "step", "what was before is told");
    // What the scenario expects is a part of the course.
    std::fs::write(at("loop.toml"), scenario("expected_trip = \"OverCurrentPeak\"\n")).unwrap();
    motorbench(&["simulate", path(&course), "--model", path(&wrong), "--csv", path(&measured)])
        .success()
        .stderr(predicate::str::contains(format!("as expected {off}")));
    motorbench(&validate).success().stdout(predicate::str::contains("compared over 2.00 s"));
}

/// Another mode, another reference, another length.
#[test]
fn validate_refuses_the_recording_of_another_scenario() {
    let bench = bench();
    let directory = with_and_without_friction();
    let at = |name: &str| directory.path().join(name);
    let write = |name: &str, mode: &str, value: f64, duration_s: f64| {
        let scenario = format!(
            "duration_s = {duration_s}\nmode = \"{mode}\"\nmodel = \"true.toml\"\n[[reference]]\ntime_s = 0.1\nvalue = {value}\n"
        );
        std::fs::write(at(&format!("{name}.toml")), scenario).unwrap();
        motorbench(&["simulate", path(&at(&format!("{name}.toml"))), "--csv", path(&at(&format!("{name}.csv")))])
            .success();
    };
    write("open", "open", 6.0, 1.0);
    write("speed", "speed", 40.0, 1.0);
    write("slower", "speed", 20.0, 1.0);
    write("longer", "speed", 40.0, 3.0);
    write("position", "position", 3.0, 1.0);
    let validate = |recording: &str, scenario: &str| {
        let (recording, scenario) = (at(recording), at(scenario));
        motorbench(&["validate", path(&recording), "--scenario", path(&scenario), "--rig", path(&bench.rig)])
    };
    let says = |text: &str| predicate::str::contains(text.to_owned());
    validate("speed.csv", "speed.toml").success();
    validate("speed.csv", "open.toml")
        .code(1)
        .stderr(says("is of the open loop, the recording has a column ref_rad_per_s"));
    validate("position.csv", "speed.toml").code(1).stderr(says("speed PID, the recording has a column ref_rad"));
    validate("slower.csv", "speed.toml").code(1).stderr(says("ref_rad_per_s of the two differ by"));
    validate("speed.csv", "longer.toml")
        .success()
        .stdout(says("the scenario lasts 3.00 s; the recording has 0.999 s of it"));
    // Only what this program has recorded surely has the reference.
    validate("open.csv", "speed.toml").success().stdout(says("cannot check that"));
    std::fs::write(at("open.json"), r#"{"firmware": "motorbench", "settings": {}}"#).unwrap();
    validate("open.csv", "speed.toml").code(1).stderr(says("the recording of an open loop"));
}

/// A position loop is closed wherever the shaft stands, and what it is asked for counts from there.
#[test]
fn validate_takes_a_shaft_that_stood_anywhere() {
    const TURNED_RAD: f64 = 7.3;
    let bench = bench();
    let directory = with_and_without_friction();
    let at = |name: &str| directory.path().join(name);
    let sequence = "kind = \"sequence\"\nsequence = \"steps\"\namplitude = 1\nperiod_ms = 400\ncount = 1\n";
    for mode in ["position", "lqr_position"] {
        let course = format!(
            "duration_s = 1.6\nmode = \"{mode}\"\nmodel = \"true.toml\"\n[[reference]]\ntime_s = 0.0\n{sequence}"
        );
        std::fs::write(at("loop.toml"), course).unwrap();
        motorbench(&["simulate", path(&at("loop.toml")), "--csv", path(&at("loop.csv"))]).success();
        let mut turned = motorbench_files::recording(&at("loop.csv"), &[]).unwrap();
        let counts = (TURNED_RAD / std::f64::consts::TAU * 2000.0).round();
        for (channel, by) in
            [(Channel::AngleReference, counts * std::f64::consts::TAU / 2000.0), (Channel::Counts, counts)]
        {
            let moved = turned.get(channel).unwrap().iter().map(|value| value + by).collect();
            turned.set(channel, moved);
        }
        std::fs::write(at("turned.csv"), turned.to_csv()).unwrap();
        let (measured, scenario) = (at("turned.csv"), at("loop.toml"));
        let rig = path(&bench.rig);
        let found = json_of(&["validate", path(&measured), "--scenario", path(&scenario), "--rig", rig, "--json", "-"]);
        assert!(found["comparison"]["delay_s"].as_f64().unwrap().abs() < 1e-4, "{found}");
        for channel in found["comparison"]["channels"].as_array().unwrap() {
            assert!(channel["fit_percent"].as_f64().is_none_or(|fit| fit > 99.9), "{mode}: {channel}");
        }
        let [simulated, measured] = ["simulated", "measured"].map(|which| &found["figures"][which][0]);
        for figure in ["tracking_rms", "peak_A"] {
            let [simulated, measured] = [simulated, measured].map(|figures| figures[figure].as_f64().unwrap());
            assert!((measured / simulated - 1.0).abs() < 0.01, "{mode}: {figure} {simulated} {measured}");
        }
    }
}

/// PID and LQR recorded on a motor with friction: one table and one plot, against the motor as it is and without friction.
#[test]
fn validate_puts_laws_side_by_side() {
    let bench = bench();
    let directory = with_and_without_friction();
    let at = |name: &str| directory.path().join(name);
    let steps = [60, -50, 40, 10, -60].iter().enumerate();
    let steps: String = steps
        .map(|(index, value)| format!("[[reference]]\ntime_s = {}\nvalue = {value}\n", 0.1 + 0.7 * index as f64))
        .collect();
    for (name, mode, gains, seed) in [
        ("pid", "speed", "speed_kp = 0.07\nspeed_ki = 4\n", 1),
        ("lqr", "lqr_speed", "lqr_speed_kw = 0.02\nlqr_speed_kc = 0.3\nlqr_speed_ki = 1\nlqr_speed_kr = 0.02\n", 2),
    ] {
        // The noise of what is measured is not that of the simulation.
        let scenario = |seed: u8| {
            format!(
                "duration_s = 3.6\nmode = \"{mode}\"\nmodel = \"true.toml\"\n[settings]\n{gains}[noise]\ncurrent_A = 0.01\nseed = {seed}\n{steps}"
            )
        };
        let file = at(&format!("{name}.scenario.toml"));
        std::fs::write(&file, scenario(seed)).unwrap();
        motorbench(&["simulate", path(&file), "--csv", path(&at(&format!("{name}.csv")))]).success();
        std::fs::write(&file, scenario(9)).unwrap();
    }
    let (pid, lqr, rig, plot) = (at("pid.csv"), at("lqr.csv"), path(&bench.rig), at("laws.svg"));
    let both = ["validate", path(&pid), path(&lqr), "--rig", rig];
    // The scenarios are found beside the recordings.
    let found = |model: &str| json_of(&[&both[..], &["--model", path(&at(model)), "--json", "-"]].concat());
    let (good, bad) = (found("true.toml"), found("linear.toml"));
    let names: Vec<&str> = (0..2).map(|index| good["loops"][index]["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["speed PID", "speed LQR"]);
    let fit = |result: &Value, index: usize| {
        let channels = result["loops"][index]["comparison"]["channels"].as_array().unwrap();
        channels.iter().find(|entry| entry["channel"] == "omega_rad_per_s").unwrap()["fit_percent"].as_f64().unwrap()
    };
    let settling = |index: usize, source: &str| good["loops"][index]["figures"][source][0]["rise_s"].as_f64().unwrap();
    for index in 0..2 {
        assert!(fit(&good, index) > 99.0 && fit(&good, index) > fit(&bad, index) + 2.0, "{index}");
        assert!((settling(index, "measured") / settling(index, "simulated") - 1.0).abs() < 0.05, "{index}");
    }
    // The LQR was given a fraction of the integral: it is slower, on both sides.
    for source in ["measured", "simulated"] {
        assert!(settling(1, source) > 1.5 * settling(0, source), "{source}");
    }
    assert!(bad["remaining"][0].as_str().unwrap().contains("coulomb_friction"), "{}", bad["remaining"]);
    assert!(!good["remaining"][0].as_str().unwrap().contains("coulomb_friction"), "{}", good["remaining"]);

    let told = motorbench(&[&both[..], &["--model", path(&at("true.toml")), "--plot", path(&plot)]].concat()).success();
    let told = String::from_utf8(told.get_output().stdout.clone()).unwrap();
    println!("{told}");
    assert!(told.contains("The speed PID has the smallest, as simulated"), "{told}");
    assert_eq!(told.matches("  speed LQR    measured ").count(), 5, "{told}");
    assert!(told.lines().all(|line| line.chars().count() <= 80), "{told}");
    let svg = std::fs::read_to_string(&plot).unwrap();
    for line in ["speed PID, simulated", "speed PID, measured", "speed LQR, simulated", "speed LQR, measured"] {
        assert!(svg.contains(line), "{line}");
    }

    // Of one law each is called by its file.
    let again = at("again.csv");
    std::fs::copy(&pid, &again).unwrap();
    std::fs::copy(at("pid.scenario.toml"), at("again.scenario.toml")).unwrap();
    let twice = json_of(&["validate", path(&pid), path(&again), "--rig", rig, "--json", "-"]);
    assert_eq!((&twice["loops"][0]["name"], &twice["loops"][1]["name"]), (&"pid".into(), &"again".into()));

    let scenario = at("pid.scenario.toml");
    motorbench(&[&both[..], &["--scenario", path(&scenario)]].concat())
        .code(1)
        .stderr(predicate::str::contains("recordings: 2, scenarios: 1: give one --scenario for each recording"));
    std::fs::remove_file(at("lqr.scenario.toml")).unwrap();
    motorbench(&both).code(1).stderr(predicate::str::contains(
        "lqr.scenario.toml does not exist: give the recorded scenario with --scenario",
    ));
}

#[test]
fn live_replays_with_the_times_of_the_recording() {
    let plotter = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    plotter.set_read_timeout(Some(std::time::Duration::from_secs(5))).unwrap();
    let directory = TempDir::new().unwrap();
    let run = directory.path().join("run.csv");
    std::fs::write(&run, "t_s,u_V,omega_rad_per_s\n0,1,2\n0.01,,3\n0.02,4,5\n").unwrap();
    let address = plotter.local_addr().unwrap().to_string();
    motorbench(&["live", path(&run), "--udp", &address, "--speed", "10"])
        .success()
        .stdout(format!("3 samples sent to {address}\n"));
    let mut buffer = [0; 1024];
    let mut next = || {
        let length = plotter.recv(&mut buffer).unwrap();
        serde_json::from_slice::<Value>(&buffer[..length]).unwrap()
    };
    assert_eq!(next(), serde_json::json!({ "timestamp": 0.0, "u_V": 1.0, "omega_rad_per_s": 2.0 }));
    assert_eq!(next(), serde_json::json!({ "timestamp": 0.01, "omega_rad_per_s": 3.0 }));
    assert_eq!(next()["timestamp"], 0.02);
}

/// Every command is in docs/reference/commands.md with an example, and shows examples itself.
#[test]
fn every_command_is_documented() {
    let page = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/commands.md"))
        .unwrap();
    let help = String::from_utf8(motorbench(&["--help"]).success().get_output().stdout.clone()).unwrap();
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|command| *command != "help")
        .collect();
    assert!(commands.len() > 10, "{help}");
    for command in commands {
        assert!(page.contains(&format!("\n## {command}\n")), "docs/reference/commands.md has no section {command}");
        assert!(
            page.contains(&format!("motorbench {command}")),
            "docs/reference/commands.md has no example of {command}"
        );
        let help = String::from_utf8(motorbench(&[command, "--help"]).success().get_output().stdout.clone()).unwrap();
        assert!(help.contains(&format!("motorbench {command}")), "motorbench {command} --help has no example:\n{help}");
    }
}

#[test]
fn the_terminal_is_left_alone_when_piped() {
    let bench = bench();
    let run = [path(&bench.run), "--rig", path(&bench.rig)];
    let identify = [&["identify"], &run[..]].concat();
    for arguments in
        [identify, vec!["compare", run[0], run[0]], vec!["compare", path(&bench.model), path(&bench.model)]]
    {
        let output = motorbench(&arguments).success().stderr("").get_output().stdout.clone();
        let text = String::from_utf8(output).unwrap();
        assert!(!text.is_empty() && !text.contains('\u{1b}'), "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    }
}

#[test]
fn exit_codes_are_those_of_the_page() {
    motorbench(&["compare", "no.csv", "no.csv"]).code(1).stderr(predicate::str::contains("no.csv"));
    motorbench(&["compare", "a.xls", "b.csv"]).code(1).stderr(predicate::str::contains("expected .csv (recording)"));
    motorbench(&["compare"]).code(2);
    let nowhere = ["convert", path(&bench().run), "/nonexistent/a.csv"].map(String::from);
    Command::cargo_bin("motorbench")
        .unwrap()
        .args(nowhere)
        .assert()
        .code(3)
        .stderr(predicate::str::contains("/nonexistent/a.csv"));
}

/// A table of a motor whose constants are known, with readings that scatter.
fn stand_table(brush_drop_v: f64, coulomb_nm: f64) -> String {
    stand_table_of(5.84, brush_drop_v, coulomb_nm)
}

/// The same with a winding that resists so much.
fn stand_table_of(r: f64, brush_drop_v: f64, coulomb_nm: f64) -> String {
    let (k, viscous) = (0.072, 5e-6);
    let mut table = String::from("u_V,i_A,omega_rad_per_s\n");
    for u in [10.0, 15.0, 20.0, 25.0, 30.0] {
        let omega = (u - brush_drop_v - r * coulomb_nm / k) / (k + r * viscous / k);
        let i = (coulomb_nm + viscous * omega) / k;
        for scatter in [-1.0, 0.5, 1.0, -0.5] {
            table += &format!("{u},{},{}\n", i + 0.003 * scatter, omega - 0.4 * scatter);
        }
    }
    table
}

#[test]
fn stand_finds_where_the_power_goes_and_what_has_worn() {
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("rig.toml"), PIVT6_TOML).unwrap();
    std::fs::write(at("new.csv"), stand_table(2.0, 0.015)).unwrap();
    // Held at three positions: 12 V over 4, 6 and 8 ohm.
    let held = "12,3,0\n12,2,0\n12,1.5,0\n";
    std::fs::write(at("worn.csv"), stand_table(3.0, 0.015) + held).unwrap();
    let (rig, new, worn, map) = (at("rig.toml"), at("new.csv"), at("worn.csv"), at("map.svg"));
    let arguments = ["stand", path(&worn), "--earlier", path(&new), "--rig", path(&rig), "--map", path(&map)];
    let stand = json_of(&[&arguments[..], &["--json", "-"]].concat());
    let number = |value: &Value| value.as_f64().unwrap();
    assert!((number(&stand["winding"]["mean_ohm"]) - 6.0).abs() < 1e-9);
    assert_eq!(stand["levels"].as_array().unwrap().len(), 5, "rows at rest are no level");
    for losses in stand["losses"].as_array().unwrap() {
        let (drop, rest) = (number(&losses["drop_W"]), number(&losses["rest_W"]));
        assert!(drop > 0.5 && rest.abs() < 0.1 * drop, "{losses}");
    }
    let condition = |index: usize| &stand["condition"][index];
    assert!((number(&condition(0)["now"]["value"]) - number(&condition(0)["before"]["value"]) - 1.0).abs() < 0.1);
    assert!(condition(0)["verdict"].as_str().unwrap().contains("brushes or commutator worn"), "{}", condition(0));
    for index in 1..4 {
        assert_eq!(condition(index)["verdict"], "unchanged within the errors", "{}", condition(index));
    }
    // The best efficiency lies between no load and stall, and the map shows no better one.
    let best = stand["most_efficient"].as_array().unwrap().last().unwrap();
    assert!(number(&best["efficiency"]) > 0.3 && number(&best["efficiency"]) < 0.9, "{best}");
    assert!(std::fs::read_to_string(&map).unwrap().contains("efficiency at the shaft; best (point)"));
    motorbench(&arguments).success().stderr("").stdout(predicate::function(|text: &str| {
        text.lines().all(|line| line.chars().count() <= 80 || line.contains("->") || line.contains(" = "))
    }));
    std::fs::write(at("bad.csv"), "position,ohm\n1,4\n").unwrap();
    motorbench(&["stand", path(&new), "--rig", path(&rig), "--resistance", path(&at("bad.csv"))])
        .code(1)
        .stderr(predicate::str::contains("a column resistance_ohm is expected"));
}

/// As `record` writes a scenario: each command that runs one takes the model with its own option.
#[test]
fn a_scenario_without_a_motor_says_how_it_gets_one() {
    let directory = TempDir::new().unwrap();
    let scenario = directory.path().join("run.scenario.toml");
    std::fs::write(&scenario, "duration_s = 1.0\nmode = \"open\"\n").unwrap();
    let said = predicate::str::contains("or say --model MODEL.toml beside the scenario");
    motorbench(&["simulate", path(&scenario)]).code(1).stderr(said.and(predicate::str::contains("validate").not()));
}

/// Half an hour later the winding is 40 K warmer, and nothing has worn; beside more friction the brushes may have.
#[test]
fn a_warm_winding_is_no_worn_brush() {
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("rig.toml"), PIVT6_TOML).unwrap();
    std::fs::write(at("cold.csv"), stand_table(2.0, 0.015)).unwrap();
    std::fs::write(at("warm.csv"), stand_table_of(5.84 * (1.0 + 0.0039 * 40.0), 2.0, 0.015)).unwrap();
    std::fs::write(at("rough.csv"), stand_table(2.2, 0.018)).unwrap();
    let voltage = |now: &str, earlier: &str| {
        let [now, earlier, rig] = [now, earlier, "rig.toml"].map(at);
        let stand = json_of(&["stand", path(&now), "--earlier", path(&earlier), "--rig", path(&rig), "--json", "-"]);
        let condition = &stand["condition"][0];
        (condition["verdict"].as_str().unwrap().to_owned(), condition["winding_warmer_K"].as_f64().unwrap())
    };
    for (now, earlier, kelvin, what) in
        [("warm.csv", "cold.csv", 40.0, "warmer"), ("cold.csv", "warm.csv", -40.0, "cooler")]
    {
        let (verdict, warmer_k) = voltage(now, earlier);
        assert!((warmer_k - kelvin).abs() < 4.0, "{warmer_k} K");
        assert!(verdict.contains(&format!("K {what}")) && !verdict.contains("brush"), "{verdict}");
    }
    let (verdict, warmer_k) = voltage("rough.csv", "cold.csv");
    assert!(verdict.contains("brushes or commutator worn") && warmer_k < 100.0, "{verdict} {warmer_k}");
}

/// At rest without a voltage a sensor shows what it is off by: no winding of 0 ohm.
#[test]
fn stand_takes_no_resistance_from_a_motor_at_rest() {
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("rig.toml"), PIVT6_TOML).unwrap();
    let evaluated = |rows: &str| {
        std::fs::write(at("table.csv"), stand_table(2.0, 0.015) + rows).unwrap();
        json_of(&["stand", path(&at("table.csv")), "--rig", path(&at("rig.toml")), "--json", "-"])
    };
    let without = evaluated("");
    assert!(without["winding"].is_null());
    assert_eq!(evaluated("0,0.005,0\n"), without);
    assert_eq!(evaluated("0.01,-0.005,0\n"), without);
    let held = evaluated("0,0.005,0\n6,1,0\n");
    assert_eq!(held["winding"]["resistances_ohm"].as_array().unwrap().len(), 1, "{}", held["winding"]);
}

/// Currents of a motor that could not turn: what the table says comes all the same, and then why there is no map.
#[test]
fn stand_without_a_map_has_its_evaluation() {
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("rig.toml"), PIVT6_TOML).unwrap();
    let rows = "u_V,i_A,omega_rad_per_s\n3,4.63,54\n6,5.08,81.6\n9,5.34,108.7\n12,5.63,131\n";
    std::fs::write(at("table.csv"), rows).unwrap();
    let (table, rig, map, json) = (at("table.csv"), at("rig.toml"), at("map.svg"), at("stand.json"));
    motorbench(&["stand", path(&table), "--rig", path(&rig), "--map", path(&map), "--json", path(&json)])
        .code(1)
        .stdout(predicate::str::contains("Where the power goes"))
        .stderr(
            predicate::str::contains("map.svg: no map")
                .and(predicate::str::contains("does not turn at any voltage up to 12 V")),
        );
    assert!(json.exists() && !map.exists());
}

/// The published table: its dynamic resistances come out, and the constants found account for the power.
#[test]
fn stand_of_the_published_study() {
    let data = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/pivt6").join(name);
    let (table, rig, winding) = (data("table2_no_load.csv"), data("rig.toml"), data("table3_winding_resistance.csv"));
    let derived = data("table4_derived.csv");
    let table = ["stand", path(&table), "--rig", path(&rig), "--resistance", path(&winding), "--derived"];
    let arguments = [&table[..], &[path(&derived)]].concat();
    let stand = json_of(&[&arguments[..], &["--json", "-"]].concat());
    for (level, published) in stand["levels"].as_array().unwrap().iter().zip([16.76, 18.96, 20.41, 21.96, 24.87]) {
        assert!((level["dynamic_resistance_ohm"].as_f64().unwrap() - published).abs() < 0.02, "{level}");
    }
    for (losses, level) in stand["losses"].as_array().unwrap().iter().zip(stand["levels"].as_array().unwrap()) {
        let share = losses["rest_W"].as_f64().unwrap() / level["p_in_W"].as_f64().unwrap();
        assert!(share.abs() < 0.03, "{losses}");
    }
    assert_eq!(stand["winding"]["resistances_ohm"].as_array().unwrap().len(), 18);
    // All of the derived table's slips are in one row: the speed is another than the readings', and than that of its EMF.
    let slips = stand["slips"].as_array().unwrap();
    let columns = slips.iter().map(|slip| (slip["u_V"].as_f64().unwrap(), slip["column"].as_str().unwrap()));
    let wrong = ["rpm", "omega_rad_per_s", "emf_V", "k_mot_rad_per_s_per_V"];
    assert!(columns.eq(wrong.map(|column| (20.0, column))), "{slips:?}");
    let number = |slip: &Value, key: &str| slip[key].as_f64().unwrap();
    assert!((number(&slips[0], "by_readings") - 1759.5).abs() < 0.1 && number(&slips[0], "printed") == 1722.0);
    assert!((number(&slips[2], "by_row") - 12.98).abs() < 0.01 && number(&slips[2], "printed") == 13.27);
    motorbench(&arguments).success().stdout(
        predicate::str::contains("4.00 to 13.3; nominal 5.84,\n  not that mean\n")
            .and(predicate::str::contains("Errors in the derived table"))
            .and(predicate::function(|text: &str| text.lines().all(|line| line.chars().count() <= 80))),
    );
    motorbench(&[&table[..], &[path(&winding)]].concat())
        .code(1)
        .stderr(predicate::str::contains("table3_winding_resistance.csv: a column u_V is expected"));
}

/// A model is refused, with everything else that was asked for written.
#[test]
fn a_table_has_plots_and_no_model() {
    let directory = TempDir::new().unwrap();
    let at = |name: &str| directory.path().join(name);
    let data = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/pivt6").join(name);
    let (report, json, model) = (at("table.html"), at("table.json"), at("model.toml"));
    let files = ["--report", path(&report), "--json", path(&json), "--model", path(&model)];
    motorbench(
        &[&["diagnose", path(&data("table2_no_load.csv")), "--rig", path(&data("rig.toml"))], &files[..]].concat(),
    )
    .code(1)
    .stdout(predicate::str::contains("voltage_drop: drop_V = 2.31"))
    .stderr(predicate::str::contains("a table of steady states shows neither inertia nor inductance"));
    let page = std::fs::read_to_string(&report).unwrap();
    assert_eq!(page.matches("<svg").count(), 2, "speed and current over voltage");
    // Five levels each, and what cannot be told from what is named beside it.
    assert_eq!(page.matches("<circle").count(), 10);
    assert!(page.contains("Green, broad: <code>") && !page.contains("could not be drawn"));
    assert!(std::fs::read_to_string(&json).unwrap().contains("\"explained\""));
    assert!(!model.exists());
}

/// The main job: what was hidden is named, the loop that knows it follows better, and one page shows all of it.
#[test]
fn the_demonstration_names_what_it_hid() {
    let directory = TempDir::new().unwrap();
    let page = directory.path().join("demo.html");
    let shown = json_of(&["demo", "--seed", "7", "--report", path(&page), "--json"]);
    assert_eq!(shown["missing"], 0);
    let named: Vec<&str> = shown["diagnosis"]["causes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|cause| cause["effect"].as_str().unwrap())
        .collect();
    let hidden = shown["hidden"].as_object().unwrap();
    assert_eq!(hidden.len(), 3);
    assert!(hidden.keys().all(|effect| named.contains(&effect.as_str())) && named.len() == 3, "{named:?} {hidden:?}");
    let rms = |index: usize| shown["loops"][index]["standstill_rms_rad_per_s"].as_f64().unwrap();
    assert!(rms(2) < 0.9 * rms(0), "{}", shown["loops"]);
    let page = std::fs::read_to_string(&page).unwrap();
    for heading in [
        "The speed loop before and after",
        "What was hidden, and what was found",
        "For the board's console",
        "What to do",
        "<title>motorbench demo</title>",
        // What is said nowhere in a few lines: who recorded it, and all that `diagnose` says.
        shown["recorded_by"].as_str().unwrap(),
        "next best in its place",
    ] {
        assert!(page.contains(heading), "{heading}");
    }
    assert!(page.matches("<svg").count() >= 4 && page.ends_with("</body></html>\n"));
}

/// A few plain lines, a picture of characters, and a page that nobody had to ask for.
#[test]
fn the_demonstration_fits_a_terminal() {
    const MOST_LINES: usize = 23;
    let directory = TempDir::new().unwrap();
    let demo = |arguments: &[&str]| {
        let mut program = Command::cargo_bin("motorbench").unwrap();
        let done = program.arg("demo").args(["--seed", "7"]).args(arguments).current_dir(&directory).assert().success();
        String::from_utf8(done.get_output().stdout.clone()).unwrap()
    };
    let files = || std::fs::read_dir(&directory).unwrap().count();
    demo(&["--json"]);
    assert_eq!(files(), 0, "a program has not asked for a page");
    let text = demo(&[]);
    assert!(text.lines().count() <= MOST_LINES && text.lines().all(|line| line.chars().count() <= 80), "{text}");
    for what in ["20000 samples in 20 s, 0 missing", "linear   extended", "hidden      found", "load_step torque_Nm"] {
        assert!(text.contains(what), "no {what} in\n{text}");
    }
    let is_line = |character: char| ('\u{2801}'..='\u{28ff}').contains(&character);
    let drawn = text.lines().filter(|line| line.contains(is_line) && line.contains('•')).count();
    assert!(
        drawn > 2 && text.contains("before, by the data sheet: ") && text.contains("after, by what was found: "),
        "{text}"
    );
    let page = directory.path().join("motorbench-demo-7.html");
    assert!(text.ends_with("motorbench-demo-7.html\n") && page.exists(), "{text}");
    std::fs::write(&page, "somebody's").unwrap();
    assert!(demo(&[]).contains("left as it is"));
    assert_eq!((std::fs::read_to_string(&page).unwrap().as_str(), files()), ("somebody's", 1));
}

/// As `motorbench man | head` does it.
#[test]
fn a_reader_that_ends_early_is_no_error() {
    for arguments in [&["man"][..], &["completions", "bash"]] {
        let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_motorbench"))
            .args(arguments)
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        drop(program.stdout.take());
        let done = program.wait_with_output().unwrap();
        assert_eq!((done.status.code(), &done.stderr[..]), (Some(0), &b""[..]), "{arguments:?}");
    }
}

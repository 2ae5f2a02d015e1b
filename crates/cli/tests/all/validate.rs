//! `motorbench validate`: measured loops compared with simulated ones.

use crate::motor::PIVT6_TOML;
use crate::program::{bench, json_of, motorbench, path};
use motorbench_data::recording::Channel;
use predicates::prelude::*;
use serde_json::Value;
use tempfile::TempDir;

/// The motor with friction, `true.toml`, and without it, `linear.toml`.
fn with_and_without_friction() -> TempDir {
    let directory = TempDir::new().unwrap();
    let friction = format!("{PIVT6_TOML}[effects.coulomb_friction]\ntorque_Nm = 0.01\n");
    std::fs::write(directory.path().join("true.toml"), friction).unwrap();
    std::fs::write(directory.path().join("linear.toml"), PIVT6_TOML).unwrap();
    directory
}

/// A loop measured on a motor with friction, simulated with friction and without it.
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
    // The verdict is about the recording, not about the model, which has the effect.
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
    // Only a recording of this program certainly has the reference.
    validate("open.csv", "speed.toml").success().stdout(says("cannot check that"));
    std::fs::write(at("open.json"), r#"{"firmware": "motorbench", "settings": {}}"#).unwrap();
    validate("open.csv", "speed.toml").code(1).stderr(says("the recording of an open loop"));
}

/// A position loop starts at any angle, and its reference is relative to that.
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

/// PID and LQR recorded on a motor with friction: one table and one plot, compared with the same motor with and without
/// friction.
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
        // The measurement and the simulation have different noise.
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
    // The LQR has a smaller integral gain: it is slower in measurement and simulation.
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

    // Loops of one law are named by their files.
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

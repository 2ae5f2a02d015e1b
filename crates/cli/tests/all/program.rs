//! The program as a user runs it: simulated recordings through its commands.

use crate::demonstration::demonstration;
use crate::motor::PIVT6_TOML;
use crate::stand::stand_table;
use assert_cmd::Command;
use motorbench_data::recording::Channel;
use motorbench_data::telemetry;
use motorbench_model::motor::MotorParameters;
use predicates::prelude::*;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

pub fn motorbench(arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("motorbench").unwrap().args(arguments).assert()
}

pub fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A linear motor with noise, recorded with the core's own sequence for identification, and its rig file.
pub struct Bench {
    _directory: TempDir,
    pub run: PathBuf,
    pub rig: PathBuf,
    pub model: PathBuf,
}

pub fn bench() -> &'static Bench {
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

pub fn json_of(arguments: &[&str]) -> Value {
    let output = motorbench(arguments).success().get_output().stdout.clone();
    serde_json::from_slice(&output).expect("the terminal has JSON and nothing else")
}

#[test]
fn identify_finds_the_constants_that_made_the_recording() {
    let bench = bench();
    let found = json_of(&["identify", path(&bench.run), "--rig", path(&bench.rig), "--json", "-"]);
    let truth = MotorParameters { inertia_kg_m2: 2.22e-5, ..MotorParameters::PIVT6 };
    let ends = |name: &str| [0, 1].map(|end| found["parameters"][name]["ci95"][end].as_f64().unwrap());
    // The interval of viscous friction does not contain a bias of 2 %: eight conversions replace the mean over a tick.
    // In the tick of a step they read 12 mA more.
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

/// A shell expands `run*.csv` to a recording and its copy.
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

/// Eight milliseconds in a rig file that expects seconds.
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

/// The rig file beside it, as `record` writes it. Without it the rig is not known.
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

/// Counts before x4 decoding, and a wrong supply: the columns of the recording contradict both.
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

/// A model used as a rig file, and columns without a known name, are reported.
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

/// A file of a serial monitor and a command line that `convert` itself proposes.
#[test]
fn a_file_of_a_serial_monitor_is_read_as_proposed() {
    let directory = TempDir::new().unwrap();
    let [log, table, rig] = ["log.txt", "run.csv", "rig.toml"].map(|name| directory.path().join(name));
    let line = |row: i32| format!("14:59:50.{:03} -> {},{},{},1\n", row, 400 + 10 * row, row % 200, row % 2);
    let text = format!("Ready\nmillis,pwm,dir,rpm\n{}", (0..200).map(line).collect::<String>());
    std::fs::write(&log, text).unwrap();
    let proposed = predicate::str::contains("Likely: --column 'rpm*sign(dir)=rpm' --column 'pwm*sign(dir)=duty/255'");
    motorbench(&["convert", path(&log), path(&table)]).success().stdout(proposed);
    let columns = ["--column", "rpm*sign(dir)=rpm", "--column", "pwm*sign(dir)=duty/255"];
    motorbench(&[&["convert", path(&log), path(&table)][..], &columns].concat()).success();
    let read = motorbench_files::recording(&table, &[]).unwrap();
    assert!((read.get(Channel::Duty).unwrap()[150] + 150.0 / 255.0).abs() < 1e-12);
    // A table is not written as a rig file, and a table by hand is not replaced.
    std::fs::write(&rig, "[supply]\nvoltage_V = 12\n").unwrap();
    let kept = || predicate::str::contains("was not written by motorbench and is not overwritten");
    motorbench(&["convert", path(&log), path(&rig), "--to", "csv"]).code(1).stderr(kept());
    std::fs::write(&table, "when,what\n1,2\n").unwrap();
    motorbench(&["convert", path(&log), path(&table)]).code(1).stderr(kept());
}

#[test]
fn identify_writes_a_model_that_others_read() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let model = directory.path().join("found.toml");
    motorbench(&["identify", path(&bench.run), "--rig", path(&bench.rig), "--model", path(&model)])
        .success()
        .stdout(predicate::str::contains("Free-running simulation against held-out data"))
        .stderr(predicate::str::starts_with("wrote "));
    motorbench(&["analyse", "--model", path(&model)]).success();
    assert!(motorbench_model::Model::parse(&std::fs::read_to_string(&bench.model).unwrap()).is_ok());
}

#[test]
fn compare_finds_the_delay_between_two_recordings() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let (late, plot) = (directory.path().join("late.csv"), directory.path().join("both.svg"));
    // The same run without its first 50 samples.
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
    assert!(svg.contains("speed, rad/s") && svg.contains("late - run, rad/s") && svg.contains("</svg>"));
}

/// A program behind a slow link. That is no fault of the model, but it is told.
#[test]
fn compare_finds_the_delay_of_a_recording_beside_a_model() {
    let bench = bench();
    let directory = TempDir::new().unwrap();
    let late = directory.path().join("late.csv");
    let text = std::fs::read_to_string(&bench.run).unwrap();
    let interval_s = 10.0 / (text.lines().count() - 1) as f64;
    std::fs::write(&late, commands_earlier(&text, 20)).unwrap();
    let against = |model: &Path, more: &[&str]| {
        json_of(&[&["compare", path(&late), path(model), "--rig", path(&bench.rig), "--json", "-"], more].concat())
    };
    let (found, as_it_is) = (against(&bench.model, &[]), against(&bench.model, &["--delay", "0"]));
    let [found_s, kept_s] = [&found, &as_it_is].map(|result| result["delay_s"].as_f64().unwrap());
    assert!((found_s - 20.0 * interval_s).abs() < interval_s && kept_s == 0.0, "{found_s} s and {kept_s} s");
    let speed_error = |result: &Value| of_speed(result, "rms");
    assert!(speed_error(&found) < 0.2 * speed_error(&as_it_is), "{found} and {as_it_is}");
    assert!(found["notes"][0].as_str().unwrap().contains("ms late"), "{found}");
    motorbench(&["compare", path(&late), path(&bench.model), "--rig", path(&bench.rig), "--delay", "-0.1"])
        .code(1)
        .stderr(predicate::str::contains("the delay is 0 or more"));
    // A motor that is too quick is a wrong model, and no delay.
    let quick = directory.path().join("quick.toml");
    let model = std::fs::read_to_string(&bench.model).unwrap();
    let inertia = model.lines().find(|line| line.starts_with("inertia_kg_m2")).unwrap();
    let value: f64 = inertia.split_once('=').unwrap().1.trim().parse().unwrap();
    std::fs::write(&quick, model.replace(inertia, &format!("inertia_kg_m2 = {}", 0.7 * value))).unwrap();
    let on_time = json_of(&["compare", path(&bench.run), path(&quick), "--rig", path(&bench.rig), "--json", "-"]);
    assert_eq!(on_time["delay_s"], 0.0, "{on_time}");
}

/// A figure that a comparison has of the speed.
fn of_speed(compared: &Value, figure: &str) -> f64 {
    let channels = compared["channels"].as_array().unwrap();
    channels.iter().find(|channel| channel["channel"] == "omega_rad_per_s").unwrap()[figure].as_f64().unwrap()
}

/// A recording whose commands stand some rows before they acted.
fn commands_earlier(csv: &str, rows: usize) -> String {
    let (header, body) = csv.split_once('\n').unwrap();
    let command = header.split(',').position(|name| name == "u_V").unwrap();
    let cells: Vec<Vec<&str>> = body.lines().map(|line| line.split(',').collect()).collect();
    let earlier = |row: usize| {
        let mut line = cells[row].clone();
        line[command] = cells[row + rows][command];
        line.join(",") + "\n"
    };
    format!("{header}\n") + &(0..cells.len() - rows).map(earlier).collect::<String>()
}

/// Every command with a plot. The content of a PNG is tested in its own crate.
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
    // Steady state: w = (U - R (T + b w) / k) / k.
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
    let fit = |result: &Value| of_speed(result, "fit_percent");
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
        .stderr(predicate::str::contains("omit --plot"));
    // Each is known to 0.1, so their difference to 0.1 times the root of 2.
    assert!((sigmas - 3.0 / 2.0_f64.sqrt()).abs() < 1e-9, "{sigmas}");
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

/// docs/reference/commands.md describes every command with an example, and its help has examples.
#[test]
fn every_command_is_documented() {
    let page = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/commands.md"))
        .unwrap();
    let help = String::from_utf8(motorbench(&["--help"]).success().get_output().stdout.clone()).unwrap();
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|line| *line != "Start:")
        .take_while(|line| *line != "Options:")
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

/// A scenario from `record`: each command that runs it takes the model with its own option.
#[test]
fn a_scenario_without_a_motor_says_how_it_gets_one() {
    let directory = TempDir::new().unwrap();
    let scenario = directory.path().join("run.scenario.toml");
    std::fs::write(&scenario, "duration_s = 1.0\nmode = \"open\"\n").unwrap();
    let said = predicate::str::contains("or say --model MODEL.toml beside the scenario");
    motorbench(&["simulate", path(&scenario)]).code(1).stderr(said.and(predicate::str::contains("validate").not()));
}

/// The main use: the hidden effect is named, the loop that knows it follows better, and one page shows all of it. The
/// terminal gets a few plain lines and a picture of characters.
#[test]
fn the_demonstration_names_what_it_hid() {
    let done = demonstration();
    assert_eq!(done.output.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.output.stderr));
    let shown: serde_json::Value = serde_json::from_slice(&std::fs::read(done.file("demo.json")).unwrap()).unwrap();
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
    fits_a_terminal(&String::from_utf8(done.output.stdout.clone()).unwrap(), hidden);
    let written = String::from_utf8(done.output.stderr.clone()).unwrap();
    let words: Vec<&str> = written.split_whitespace().collect();
    let expected = "wrote demo.html, team12.csv, team12.rig.toml, demo.json; next: motorbench diagnose team12.csv";
    assert!(words.join(" ").ends_with(expected), "{written}");
    let page = std::fs::read_to_string(done.file("demo.html")).unwrap();
    for heading in [
        "The speed loop before and after",
        "What was hidden, and what was found",
        "For the board's console",
        "What to do",
        "<title>motorbench demo</title>",
        // The few lines omit who recorded it, and the full text of `diagnose`.
        shown["recorded_by"].as_str().unwrap(),
        "next best in its place",
    ] {
        assert!(page.contains(heading), "{heading}");
    }
    assert!(page.matches("<svg").count() >= 4 && page.ends_with("</body></html>\n"));
}

/// What the demonstration prints.
fn fits_a_terminal(text: &str, hidden: &serde_json::Map<String, Value>) {
    const MOST_LINES: usize = 23;
    assert!(text.lines().count() <= MOST_LINES && text.lines().all(|line| line.chars().count() <= 80), "{text}");
    for what in ["20000 samples in 20 s, 0 missing", "linear   extended", "hidden      found"] {
        assert!(text.contains(what), "no {what} in\n{text}");
    }
    for (effect, constants) in hidden {
        let name = constants.as_object().unwrap().keys().next().unwrap();
        assert!(text.contains(&format!("  {effect} {name}  ")), "no {effect} {name} in\n{text}");
    }
    let is_line = |character: char| ('\u{2801}'..='\u{28ff}').contains(&character);
    let drawn = text.lines().filter(|line| line.contains(is_line) && line.contains('•')).count();
    assert!(
        drawn > 2 && text.contains("before, by the data sheet: ") && text.contains("after, by what was found: "),
        "{text}"
    );
}

/// As in `motorbench man | head`.
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

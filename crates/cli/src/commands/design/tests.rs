use super::*;
use motorbench_design::tachogenerator::{Tachogenerator, of_rig};

const RIG: &str = "[supply]\nvoltage_V = 12\n[encoder]\ncounts_per_rev = 1024\n[motor]\nresistance_ohm = 5.84\n\
    inductance_H = 11.68e-3\ntorque_constant_Nm_per_A = 0.072\ninertia_kg_m2 = 2.22e-5\nviscous_friction_Nm_s = 5e-6\n";

fn arguments(rig: &std::path::Path) -> Arguments {
    Arguments {
        rig: Some(rig.into()),
        model: None,
        speed: true,
        position: false,
        pid: true,
        lqr: false,
        bandwidth_hz: Some(10.0),
        settling_s: None,
        q: Vec::new(),
        r: None,
        largest: Vec::new(),
        largest_v: None,
        largest_duty: None,
        overshoot_percent: 10.0,
        current_limit_a: 1.0,
        no_current_sensor: false,
        compensate: false,
        coulomb_nm: 0.0,
        sketch_ms: None,
        json: None,
        console: None,
        report: None,
    }
}

/// The supply cannot turn this motor against its friction. The linear design works, but the loop would not.
#[test]
fn what_trips_with_the_models_effects_is_not_offered() {
    let directory = tempfile::tempdir().unwrap();
    let [rig, model, console] = ["rig.toml", "model.toml", "gains.txt"].map(|name| directory.path().join(name));
    std::fs::write(&rig, RIG).unwrap();
    std::fs::write(&model, format!("{RIG}[effects.coulomb_friction]\ntorque_Nm = 0.5\n")).unwrap();
    let extended = Arguments { model: Some(model), console: Some(console.clone()), ..arguments(&rig) };
    let failure = run(&extended).unwrap_err();
    assert!(failure.message.contains("with the effects of the model the speed PID fails"), "{}", failure.message);
    assert!(failure.code == 1 && !console.exists());
}

#[test]
fn nothing_to_compensate_is_not_compared() {
    let directory = tempfile::tempdir().unwrap();
    let [rig, json] = ["rig.toml", "design.json"].map(|name| directory.path().join(name));
    std::fs::write(&rig, RIG).unwrap();
    let standstill = |coulomb_nm: f64| {
        run(&Arguments { compensate: true, coulomb_nm, json: Some(json.clone()), ..arguments(&rig) }).unwrap();
        let text = std::fs::read_to_string(&json).unwrap();
        let result: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!(text.contains("comp_drop 0"), "{text}");
        result["near_standstill"].as_array().unwrap().len()
    };
    assert_eq!((standstill(0.0), standstill(0.005)), (0, 1));
}

/// The comparison has every effect of the model, also those that are not compensated.
#[test]
fn near_standstill_the_motor_has_all_of_its_effects() {
    let directory = tempfile::tempdir().unwrap();
    let [rig, model, json] = ["rig.toml", "model.toml", "design.json"].map(|name| directory.path().join(name));
    std::fs::write(&rig, RIG).unwrap();
    let motor = &RIG[RIG.find("[motor]").unwrap()..];
    let standstill = |more: &str| {
        let friction = "[effects.coulomb_friction]\ntorque_Nm = 0.005\n";
        std::fs::write(&model, format!("{motor}{friction}{more}")).unwrap();
        let (model, json_file) = (Some(model.clone()), Some(json.clone()));
        run(&Arguments { model, json: json_file, compensate: true, ..arguments(&rig) }).unwrap();
        let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        let found = &result["near_standstill"][0];
        [&found["without"], &found["with"]].map(|error| error.as_f64().unwrap())
    };
    let [friction_without, friction_with] = standstill("");
    let cogging = "[effects.cogging]\ncosine_Nm = 0.003\nsine_Nm = 0\nperiods_per_rev = 8\n";
    let [cogging_without, cogging_with] = standstill(cogging);
    assert!((cogging_without / friction_without - 1.0).abs() > 0.01, "{cogging_without} {friction_without}");
    assert!(cogging_with > 1.1 * friction_with, "{cogging_with} {friction_with}");
}

#[test]
fn from_a_rig_file_to_a_file_and_a_page() {
    let directory = std::env::temp_dir().join(format!("motorbench-design-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let (rig, json, html) = (directory.join("rig.toml"), directory.join("design.json"), directory.join("design.html"));
    std::fs::write(&rig, RIG).unwrap();
    run(&Arguments { json: Some(json.clone()), report: Some(html.clone()), ..arguments(&rig) }).unwrap();
    let text = std::fs::read_to_string(json).unwrap();
    let result: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(result["designs"][0]["law"], "speed_pid");
    assert_eq!(result["designs"][0]["gains"][0]["name"], "speed_kp");
    assert!(result["commands"][0].as_str().unwrap().starts_with("set "));
    let page = std::fs::read_to_string(html).unwrap();
    assert!(page.matches("<svg").count() >= 4 && !page.contains("http://www.w3.org/1999/xlink"));

    for (missing, expected) in [
        ("inertia_kg_m2 = 2.22e-5\n", "motor.inertia_kg_m2 is missing"),
        ("voltage_V = 12\n", "supply.voltage_V is missing"),
        ("counts_per_rev = 1024\n", "encoder.counts_per_rev is missing"),
    ] {
        std::fs::write(&rig, RIG.replace(missing, "")).unwrap();
        let failure = run(&arguments(&rig)).unwrap_err();
        assert!(failure.code == 1 && failure.message.contains(expected), "{}", failure.message);
    }
    std::fs::remove_dir_all(directory).unwrap();
}

/// For a motor with a winding of 10 ms every position PID of 10 Hz overshoots. The LQR can use the current.
#[test]
fn a_law_that_is_refused_takes_none_with_it() {
    let directory = tempfile::tempdir().unwrap();
    let [rig, json, console] = ["rig.toml", "design.json", "gains.txt"].map(|name| directory.path().join(name));
    std::fs::write(&rig, RIG.replace("11.68e-3", "58.4e-3")).unwrap();
    let position = |pid: bool, lqr: bool| Arguments {
        position: true,
        speed: false,
        pid,
        lqr,
        json: Some(json.clone()),
        console: Some(console.clone()),
        ..arguments(&rig)
    };
    run(&position(false, false)).unwrap();
    let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(result["designs"].as_array().unwrap().len(), 1);
    assert_eq!(result["designs"][0]["law"], "position_lqr");
    assert_eq!(result["refused"][0]["law"], "position_pid");
    assert!(result["refused"][0]["why"].as_str().unwrap().contains("the position PID overshoots by"));
    assert!(!std::fs::read_to_string(&console).unwrap().contains(" position_kp"));
    // If the user asked for this law, it is a failure.
    let failure = run(&position(true, false)).unwrap_err();
    assert!(failure.code == 1 && failure.message.contains("the position PID overshoots by"), "{}", failure.message);
}

/// The page has the trials with the model's effects as the terminal does, as text and as lines. Without effects
/// both omit them.
#[test]
fn the_page_shows_the_trial_with_the_effects_of_the_model() {
    let directory = tempfile::tempdir().unwrap();
    let [rig, model, html] = ["rig.toml", "model.toml", "design.html"].map(|name| directory.path().join(name));
    std::fs::write(&rig, RIG).unwrap();
    let motor = &RIG[RIG.find("[motor]").unwrap()..];
    let page = |effects: &str, compensate: bool| {
        std::fs::write(&model, format!("{motor}{effects}")).unwrap();
        let (model, report) = (Some(model.clone()), Some(html.clone()));
        run(&Arguments { model, report, compensate, ..arguments(&rig) }).unwrap();
        std::fs::read_to_string(&html).unwrap()
    };
    let linear = page("", false);
    assert!(!linear.contains("effects of the model") && !linear.contains("\nwith effects\n"));
    let friction = page("[effects.coulomb_friction]\ntorque_Nm = 0.01\n", true);
    for shown in ["The same steps with the effects of the model, simulated.", "without compensation"] {
        assert!(friction.contains(shown), "{shown}");
    }
    // Plots of speed, voltage and current.
    assert!(friction.matches("\nwith effects\n").count() >= 3, "{friction}");
}

#[test]
fn a_tachogenerator_is_the_sensor_where_there_is_no_encoder_or_where_the_rig_says_so() {
    let of = |text: &str| of_rig(&Rig::parse("rig.toml", text).unwrap());
    let (encoder, tacho) = ("[encoder]\ncounts_per_rev = 1024\n", "[tachogenerator]\ngain_V_per_krpm = 3\n");
    assert_eq!(of(encoder), None);
    assert_eq!(of(tacho), Some(Some(Tachogenerator::new(3.0))));
    assert_eq!(of(&format!("{encoder}{tacho}")), None);
    let both = of(&format!("{encoder}{tacho}feedback = true\nripple = 0.01\nripples_per_rev = 11\n"));
    let expected = Tachogenerator { gain_v_per_krpm: 3.0, ripple: 0.01, ripples_per_rev: 11.0 };
    assert_eq!(both, Some(Some(expected)));
    assert_eq!(of("[tachogenerator]\nfeedback = true\n"), Some(None));
}

/// From the stand's rig file to the console lines, and each refusal.
#[test]
fn a_rig_with_a_tachogenerator_alone() {
    let directory = tempfile::tempdir().unwrap();
    let [rig, console, html] = ["rig.toml", "gains.txt", "design.html"].map(|name| directory.path().join(name));
    let stand = RIG.replace("[encoder]\ncounts_per_rev = 1024\n", "[tachogenerator]\ngain_V_per_krpm = 3\n");
    std::fs::write(&rig, &stand).unwrap();
    run(&Arguments { console: Some(console.clone()), report: Some(html.clone()), ..arguments(&rig) }).unwrap();
    let lines = std::fs::read_to_string(console).unwrap();
    assert!(lines.contains("speed_sensor 1 tacho_gain 3") && !lines.contains("counts_per_rev"), "{lines}");
    assert!(std::fs::read_to_string(html).unwrap().contains("steps of 0.341 rad/s, low-pass 3.2 ms"));
    let refused = |text: &str, position: bool| {
        std::fs::write(&rig, text).unwrap();
        let failure = run(&Arguments { position, speed: !position, ..arguments(&rig) }).unwrap_err();
        assert_eq!(failure.code, 1);
        failure.message
    };
    let message = refused(&stand, true);
    assert!(message.contains("the position PID needs an encoder"), "{message}");
    let message = refused(&stand.replace("gain_V_per_krpm = 3", "feedback = true"), false);
    assert!(message.contains("tachogenerator.gain_V_per_krpm is missing"), "{message}");
    let message = refused(&stand.replace("voltage_V = 12", "voltage_V = 30"), false);
    assert!(message.contains("the converter ends at 332 rad/s"), "{message}");
}

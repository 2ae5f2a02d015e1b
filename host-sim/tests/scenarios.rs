//! The scenarios of the repository, and what is wrong with wrong ones.

use host_sim::scenario::reference::{Course, Reference};
use motorbench_core::message::Trip;
use std::path::{Path, PathBuf};

fn repository(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(name)
}

/// Run up, reversal, and a load that takes a twentieth of the stall torque.
#[test]
fn the_speed_loop_runs_up_reverses_and_takes_a_load() {
    let outcome = motorbench_files::scenario(&repository("speed_step.toml"), None).unwrap().run().unwrap();
    assert_eq!(outcome.trip, Trip::None);
    let [up, reversal, load] = &outcome.figures[..] else { panic!("{:?}", outcome.figures) };
    println!("{up:?}\n{reversal:?}\n{load:?}");
    // The profile takes 71 ms for 60 rad/s; the loop adds some 5 Hz of lag.
    assert!((0.07..0.15).contains(&up.rise_s.unwrap()) && up.overshoot_percent.unwrap() < 2.0, "{up:?}");
    assert!(up.steady_error.unwrap().abs() < 0.1 && reversal.steady_error.unwrap().abs() < 0.1);
    // The load is no overshoot of the reversal before it, and is integrated away.
    assert!(reversal.overshoot_percent.unwrap() < 2.0 && reversal.settling_s.unwrap() < 0.4, "{reversal:?}");
    assert_eq!((load.course, load.time_s, load.overshoot_percent), ("load", 2.002, None));
    assert!((5.0..25.0).contains(&load.largest_error.unwrap()) && load.settling_s.unwrap() < 0.4, "{load:?}");
    assert!(load.steady_error.unwrap().abs() < 0.1, "{load:?}");
    // Reported, and true: a sign that is wrong in both would cancel in neither.
    let reported = outcome.recording.get(motorbench_data::recording::Channel::Speed).unwrap();
    let last = outcome.points.last().unwrap();
    assert!((reported[reported.len() - 1] - last.omega_rad_per_s).abs() < 0.5 && last.omega_rad_per_s < -59.0);
}

#[test]
fn the_position_loop_moves_and_returns() {
    let outcome = motorbench_files::scenario(&repository("position_lqr.toml"), None).unwrap().run().unwrap();
    assert_eq!(outcome.trip, Trip::None);
    for figures in &outcome.figures {
        println!("{figures:?}");
        assert!(
            (0.03..0.15).contains(&figures.rise_s.unwrap()) && figures.overshoot_percent.unwrap() < 5.0,
            "{figures:?}"
        );
        // Three counts of the encoder.
        assert!(figures.steady_error.unwrap().abs() < 0.012, "{figures:?}");
    }
}

/// Each course is followed, the load and the dip of the supply are taken, and the lost frames are a gap in the recording.
#[test]
fn every_course_is_followed() {
    let outcome = motorbench_files::scenario(&repository("trajectories.toml"), None).unwrap().run().unwrap();
    assert_eq!((outcome.trip, outcome.trip_s), (Trip::None, None));
    for figures in &outcome.figures {
        println!("{figures:?}");
        // Jumps of up to 80 rad/s, whose profile the loop lags by some 15 ms.
        assert!(figures.tracking_rms < if figures.course == "ramp" { 3.0 } else { 10.0 }, "{figures:?}");
    }
    let courses: Vec<_> = outcome.figures.iter().map(|figures| figures.course).collect();
    assert_eq!(courses, ["step", "ramp", "sine", "points", "sequence", "jump"]);
    // The stairs are a third of the amplitude each, and the profile is not theirs.
    let jump = outcome.figures.last().unwrap();
    assert!((jump.to - jump.from).abs() > 15.0 && jump.rise_s.is_some_and(|rise_s| rise_s < 0.1), "{jump:?}");
    let time_s = outcome.recording.time_s().unwrap();
    let gap = time_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    assert!((gap - 0.101).abs() < 1e-6, "{gap}");
    // The course of the sine is its own, not a step's: at its crest 60, at its trough 20.
    let at = |t_s: f64| outcome.points[(1e3 * t_s) as usize].reference;
    assert!((at(2.125) - 60.0).abs() < 3.0 && (at(2.375) - 20.0).abs() < 3.0, "{} {}", at(2.125), at(2.375));
}

/// The same seed gives the same run, another seed another, and none is without noise.
#[test]
fn noise_is_repeatable() {
    let mut scenario = motorbench_files::scenario(&repository("trajectories.toml"), None).unwrap();
    scenario.duration_s = 0.5;
    let mut current = |seed: u64, current_a: f64| {
        scenario.noise.seed = seed;
        scenario.noise.current_a = current_a;
        scenario.run().unwrap().recording.get(motorbench_data::recording::Channel::Current).unwrap().to_vec()
    };
    let (once, again, other, clean) = (current(1, 0.05), current(1, 0.05), current(2, 0.05), current(1, 0.0));
    assert_eq!(once, again);
    assert_ne!(once, other);
    let unrest = |values: &[f64]| values.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>();
    assert!(unrest(&once) > 5.0 * unrest(&clean), "{} {}", unrest(&once), unrest(&clean));
}

/// Every fault does what it says, and the core answers with the trip that is meant for it.
#[test]
fn faults_bring_their_trips() {
    let outcome = motorbench_files::scenario(&repository("encoder_unplugged.toml"), None).unwrap().run().unwrap();
    assert_eq!(outcome.trip, Trip::EncoderSilent);
    assert!((0.8..0.9).contains(&outcome.trip_s.unwrap()), "{:?}", outcome.trip_s);
    let directory = std::env::temp_dir().join(format!("motorbench-faults-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let good = std::fs::read_to_string(repository("encoder_unplugged.toml")).unwrap();
    for (fault, settings, expected) in [
        // The current limit holds the current, and half a second later it is a stall.
        ("kind = \"rotor_blocked\"", "", Trip::Stall),
        ("kind = \"current_pinned\"\nvoltage_V = 0", "", Trip::SensorRange),
        ("kind = \"supply\"\nvoltage_V = 4", "[settings]\nsupply_divider = 3\n", Trip::SupplyRange),
        // Not wired to the divider, the core does not know, and the loop has the voltage to spare.
        ("kind = \"supply\"\nvoltage_V = 9", "", Trip::None),
    ] {
        let path = directory.join("fault.toml");
        std::fs::write(&path, good.replace("kind = \"encoder_unplugged\"", fault) + settings).unwrap();
        let outcome = motorbench_files::scenario(&path, None).unwrap().run().unwrap();
        println!("{fault}: {:?} at {:?} s", outcome.trip, outcome.trip_s);
        assert_eq!(outcome.trip, expected, "{fault}");
        assert!(outcome.trip_s.is_none_or(|trip_s| (0.8..1.4).contains(&trip_s)));
    }
    std::fs::remove_dir_all(directory).unwrap();
}

/// The page names every key that the file has, and its example runs.
#[test]
fn the_page_on_scenarios_is_true() {
    let page = std::fs::read_to_string(repository("../docs/reference/scenarios.md")).unwrap();
    let directory = std::env::temp_dir().join(format!("motorbench-page-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let path = directory.join("scenario.toml");
    let example = page.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    std::fs::write(&path, example).unwrap();
    let outcome = motorbench_files::scenario(&path, None).unwrap().run().unwrap();
    assert!(outcome.trip == Trip::None && outcome.figures.len() == 1, "{:?}", outcome.figures);
    // What the reader of the file says it knows, where it meets what it does not.
    for wrong in [
        "no_such_key = 1\n",
        "[[reference]]\nno = 1\n",
        "[[load]]\nno = 1\n",
        "[[fault]]\nno = 1\n",
        "[noise]\nno = 1\n",
    ] {
        std::fs::write(&path, format!("duration_s = 1.0\n{wrong}")).unwrap();
        let message = motorbench_files::scenario(&path, None).unwrap_err().to_string();
        let known = message.split("expected").nth(1).unwrap_or_else(|| panic!("{message}"));
        let keys: Vec<_> = known.split('`').skip(1).step_by(2).collect();
        assert!(keys.len() >= 2, "{message}");
        for key in keys {
            assert!(page.contains(&format!("`{key}`")), "docs/reference/scenarios.md does not name {key}");
        }
    }
    std::fs::remove_dir_all(directory).unwrap();
}

#[test]
fn a_wrong_scenario_says_where() {
    let directory = std::env::temp_dir().join(format!("motorbench-scenario-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let good = std::fs::read_to_string(repository("position_lqr.toml")).unwrap();
    let message = |text: String| {
        let path = directory.join("wrong.toml");
        std::fs::write(&path, text).unwrap();
        motorbench_files::scenario(&path, None).unwrap_err().to_string()
    };
    for (from, to, expected) in [
        ("mode = \"lqr_position\"", "mode = \"fast\"", "expected open, speed, position"),
        ("mode = \"lqr_position\"", "", "mode is missing: expected open, speed, position"),
        ("time_s = 1.0", "time_s = 0.1", "two [[reference]] at time_s = 0.1"),
        ("acceleration = 500", "speed_kp = 1000", "[settings] speed_kp = 1000: the core's numbers cannot hold that"),
        ("acceleration = 500", "acceleration = -1", "[settings] acceleration = -1: expected 0.1 to 1000000"),
        ("acceleration = 500", "accelaration = 500", "accelaration: no such setting"),
        ("duration_s = 2.0", "duration_s = 0", "duration_s = 0: expected more than 0"),
        ("resistance_ohm = 5.84", "resistance_ohm = -5.84", "it must be a positive number"),
        ("inductance_H = 11.7e-3\n", "", "inductance_H"),
        ("value = 0\n", "valu = 0\n", "valu"),
        ("value = 0\n", "", "[[reference]] 2 (step): value is missing"),
        ("value = 0\n", "value = 1e9\n", "[[reference]] 2 (step): value = 1000000000: expected at most 100000 rad"),
        ("value = 0\n", "value = 0\ncount = 2\n", "[[reference]] 2 (step): count means nothing here; there are value"),
        ("value = 0\n", "kind = \"sin\"\n", "[[reference]] 2 (sin): expected step, ramp, sine, points or sequence"),
        ("value = 0\n", "kind = \"ramp\"\nvalue = 1\nduration_s = 0\n", "(ramp): duration_s = 0: expected a positive"),
        ("value = 0\n", "kind = \"sine\"\namplitude = 1\n", "(sine): frequency_Hz is missing"),
        ("value = 0\n", "kind = \"points\"\npoints = [[1, 0], [1, 2]]\n", "the time goes from 1 to 1"),
        ("value = 0\n", "kind = \"points\"\npoints = []\n", "points is empty"),
        ("value = 0\n", "kind = \"sequence\"\nsequence = \"walk\"\namplitude = 1\n", "expected one of steps, ramp"),
        (
            "value = 0\n",
            "kind = \"sequence\"\nsequence = \"identify\"\namplitude = 1\nperiod_ms = 40000\n",
            "[[reference]] 2 (sequence): a period of 40000 ms: expected at most 32767",
        ),
        ("time_s = 1.0", "time_s = 9.0", "[[reference]] 2: time_s = 9: expected 0 to duration_s = 2"),
        ("[motor]", "[[load]]\ntime_s = 0\ntorque_Nm = nan\n[motor]", "[[load]] 1: torque_Nm = NaN: expected a number"),
        (
            "[motor]",
            "[[fault]]\ntime_s = 0\nkind = \"fire\"\n[motor]",
            "[[fault]] 1: kind = \"fire\": expected encoder_unplugged",
        ),
        (
            "[motor]",
            "[[fault]]\ntime_s = 1\nuntil_s = 1\nkind = \"rotor_blocked\"\n[motor]",
            "until_s = 1: expected more than time_s = 1",
        ),
        ("[motor]", "[[fault]]\ntime_s = 1\nkind = \"supply\"\n[motor]", "voltage_V is missing: supply needs it"),
        (
            "[motor]",
            "[[fault]]\ntime_s = 1\nkind = \"rotor_blocked\"\nvoltage_V = 1\n[motor]",
            "voltage_V means nothing for rotor_blocked",
        ),
        (
            "[motor]",
            "[[fault]]\ntime_s = 1\nkind = \"current_pinned\"\nvoltage_V = 6\n[motor]",
            "voltage_V = 6: expected 0 to 5",
        ),
        ("[motor]", "[noise]\ncurrent_A = -1\n[motor]", "[noise] current_A = -1: expected a standard deviation"),
        ("[motor]", "[noise]\ntacho_ripple = 2\n[motor]", "[noise] tacho_ripple = 2: expected a share of 0 to 1"),
        (
            "duration_s = 2.0",
            "duration_s = 2.0\nexpected_trip = \"Fire\"",
            "expected_trip = \"Fire\": expected one of OverCurrentPeak",
        ),
        ("duration_s = 2.0", "duration_s = 2.0\nmodel = \"m.toml\"", "give the one or the others"),
    ] {
        let found = message(good.replace(from, to));
        assert!(found.contains("wrong.toml") && found.contains(expected), "{found}");
    }
    std::fs::remove_dir_all(directory).unwrap();
}

/// 0.05 + 0.802 is a little more than 0.852.
#[test]
fn what_is_due_at_a_tick_comes_at_that_tick() {
    let mut scenario = motorbench_files::scenario(&repository("speed_step.toml"), None).unwrap();
    (scenario.loads, scenario.duration_s) = (Vec::new(), 0.9);
    for after_s in [0.8, 0.801, 0.802, 0.803, 0.804] {
        scenario.references = vec![Reference { time_s: 0.05 + after_s, course: Course::Step { value: 20.0 } }];
        let samples = scenario.run().unwrap().samples;
        let moved = samples.iter().position(|sample| sample.reference != 0);
        assert_eq!((samples.len(), moved), (900, Some((1e3 * (0.05 + after_s)).round() as usize)), "{after_s}");
    }
}

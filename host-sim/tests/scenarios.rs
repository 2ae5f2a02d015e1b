//! The scenarios of the repository, and what is wrong with wrong ones.

use host_sim::scenario::Scenario;
use motorbench_core::message::Trip;
use std::path::{Path, PathBuf};

fn repository(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(name)
}

/// Run up, reversal, and a load that takes a twentieth of the stall torque.
#[test]
fn the_speed_loop_runs_up_reverses_and_takes_a_load() {
    let outcome = Scenario::read(&repository("speed_step.toml")).unwrap().run().unwrap();
    assert_eq!(outcome.trip, Trip::None);
    let [up, reversal] = &outcome.figures[..] else { panic!("{:?}", outcome.figures) };
    println!("{up:?}\n{reversal:?}");
    // The profile takes 71 ms for 60 rad/s; the loop adds some 5 Hz of lag.
    assert!((0.07..0.15).contains(&up.rise_s.unwrap()) && up.overshoot_percent < 2.0, "{up:?}");
    assert!(up.steady_error.abs() < 0.1 && reversal.steady_error.abs() < 0.1);
    // The load comes within the second stretch and is integrated away.
    assert!((5.0..25.0).contains(&reversal.overshoot_percent), "{reversal:?}");
    // Reported, and true: a sign that is wrong in both would cancel in neither.
    let reported = outcome.recording.get(host_sim::recording::Channel::Speed).unwrap();
    let last = outcome.points.last().unwrap();
    assert!((reported[reported.len() - 1] - last.omega_rad_per_s).abs() < 0.5 && last.omega_rad_per_s < -59.0);
}

#[test]
fn the_position_loop_moves_and_returns() {
    let outcome = Scenario::read(&repository("position_lqr.toml")).unwrap().run().unwrap();
    assert_eq!(outcome.trip, Trip::None);
    for figures in &outcome.figures {
        println!("{figures:?}");
        assert!((0.03..0.15).contains(&figures.rise_s.unwrap()) && figures.overshoot_percent < 5.0, "{figures:?}");
        // Three counts of the encoder.
        assert!(figures.steady_error.abs() < 0.012, "{figures:?}");
    }
}

#[test]
fn a_wrong_scenario_says_where() {
    let directory = std::env::temp_dir().join(format!("motorbench-scenario-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let good = std::fs::read_to_string(repository("position_lqr.toml")).unwrap();
    let message = |text: String| {
        let path = directory.join("wrong.toml");
        std::fs::write(&path, text).unwrap();
        Scenario::read(&path).unwrap_err().to_string()
    };
    for (from, to, expected) in [
        ("mode = \"lqr_position\"", "mode = \"fast\"", "expected open, speed, position"),
        ("acceleration = 500", "acceleration = -1", "[settings] acceleration = -1: expected 0.1 to 1000000"),
        ("acceleration = 500", "accelaration = 500", "accelaration: no such setting"),
        ("duration_s = 2.0", "duration_s = 0", "duration_s = 0: expected more than 0"),
        ("resistance_ohm = 5.84", "resistance_ohm = -5.84", "it must be a positive number"),
        ("inductance_H = 11.7e-3\n", "", "inductance_H"),
        ("value = 0\n", "valu = 0\n", "valu"),
    ] {
        let found = message(good.replace(from, to));
        assert!(found.contains("wrong.toml") && found.contains(expected), "{found}");
    }
    std::fs::remove_dir_all(directory).unwrap();
}

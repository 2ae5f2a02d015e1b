//! The result for a person: the page of the terminal and the plots of the report.

use hidden_effects::{Effect, Recipe, draw};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_design::law::ControlLaw;
use motorbench_design::specification::{Specification, Speed};
use motorbench_design::tachogenerator::Tachogenerator;
use motorbench_design::{Bench, design};
use motorbench_diagnosis::diagnose::outcome::Verdict;
use motorbench_diagnosis::diagnose::{Diagnosis, diagnose};
use motorbench_model::motor::MotorParameters;
use motorbench_report::design::summary;
use motorbench_report::web_page::Provenance;
use motorbench_report::{diagnosis_page as report, diagnosis_text as page};

fn diagnosis(recipe: &Recipe, verdict: Verdict) -> Diagnosis {
    let trial = draw(3, recipe);
    let recording = Recording::parse("recording.csv", trial.csv.as_bytes(), &[]).unwrap();
    let diagnosis = diagnose(&[recording], &Rig::parse("rig.toml", &trial.rig_toml).unwrap(), &|_| ()).unwrap();
    assert_eq!(diagnosis.outcome.verdict, verdict, "{:?}", diagnosis.outcome);
    diagnosis
}

/// Without a named cause the fault may be in a sensor, which no missing torque or voltage shows. So the page shows the
/// residual of each sensor.
#[test]
fn what_has_no_name_is_shown_as_the_residual_of_each_sensor() {
    let plots = |diagnosis: &Diagnosis| {
        let html = report::report(diagnosis, Provenance::default());
        (html.matches("<figure").count(), html)
    };
    let (named, html) = plots(&diagnosis(&Recipe::of(&[]), Verdict::Sufficient));
    assert!(!html.contains("residual of"));
    let diagnosis = diagnosis(&Recipe::of(&[Effect::OutsideShaker]), Verdict::Unexplained);
    let (unnamed, html) = plots(&diagnosis);
    for measured in &diagnosis.data.measured {
        for over in ["time", "speed", "angle", "current", "direction"] {
            let caption = format!("residual of {} over {over}", measured.output.title().split(',').next().unwrap());
            assert!(html.contains(&caption), "{caption}");
        }
    }
    assert!(unnamed > named + diagnosis.data.measured.len() * 8, "{unnamed} {named}");
}

/// The same recording with the angle instead of the speed.
fn with_angle(csv: &str) -> String {
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let (time, speed) = (place("t_s"), place("omega_rad_per_s"));
    let mut text = header.join(",").replace("omega_rad_per_s", "theta_rad") + "\n";
    let (mut angle_rad, mut last_s) = (0.0, 0.0);
    for line in lines {
        let mut cells: Vec<String> = line.split(',').map(String::from).collect();
        let (t_s, omega): (f64, f64) = (cells[time].parse().unwrap(), cells[speed].parse().unwrap());
        angle_rad += (t_s - last_s) * omega;
        last_s = t_s;
        cells[speed] = angle_rad.to_string();
        text += &(cells.join(",") + "\n");
    }
    text
}

/// It does not depend on the names of the channels.
#[test]
fn the_errors_stand_below_their_heads() {
    let trial = draw(3, &Recipe::of(&[]));
    let recording = Recording::parse("recording.csv", with_angle(&trial.csv).as_bytes(), &[]).unwrap();
    let diagnosis = diagnose(&[recording], &Rig::parse("rig.toml", &trial.rig_toml).unwrap(), &|_| ()).unwrap();
    let page = page::page(&diagnosis);
    assert!(page.contains("omega_from_angle_rad_per_s"), "{page}");
    let (_, errors) = page.split_once("Error on held-out data").unwrap();
    let mut lines = errors.lines().skip(1);
    let head = lines.next().unwrap();
    let rows: Vec<&str> = lines.take_while(|line| line.contains(" -> ")).collect();
    assert_eq!(rows.len(), 2, "{page}");
    for column in ["linear", "extended", "noise"] {
        let end = head.find(column).unwrap() + column.len();
        for row in &rows {
            assert!(row[..end].ends_with(|sign: char| sign.is_ascii_digit()) && row[end..].starts_with(' '), "{page}");
        }
    }
    assert!(page.lines().all(|line| line.chars().count() <= 80), "{page}");
}

/// The summary of a design says why it omits the current, and gives the resolution of a tachogenerator.
#[test]
fn a_design_says_what_it_leaves_out_and_what_its_sensor_shows() {
    let specification =
        |hz, current_limit_a| Specification { speed: Speed::BandwidthHz(hz), overshoot_percent: 10.0, current_limit_a };
    // A gain on the current that exceeds the core's format.
    let high_voltage = MotorParameters {
        resistance_ohm: 200.0,
        inductance_h: 2.0,
        torque_constant_nm_per_a: 1.0,
        inertia_kg_m2: 4e-4,
        viscous_friction_nm_s: 5e-5,
    };
    let bench = Bench { supply_v: 24.0, ..Bench::default() };
    let said = |hz| {
        let design = design(&high_voltage, &bench, ControlLaw::SpeedLqr, &specification(hz, 0.2)).unwrap();
        summary(&design)
    };
    let refused = said(8.0);
    assert!(refused.contains("  without current  the loop with a gain on it is refused: lqr_speed_kc = "), "{refused}");
    assert!(!said(5.0).contains("without c"));
    let stand = Bench { counts_per_rev: None, tachogenerator: Some(Tachogenerator::new(3.0)), ..Bench::default() };
    for law in [ControlLaw::SpeedPid, ControlLaw::SpeedLqr] {
        let design = design(&MotorParameters::PIVT6, &stand, law, &specification(10.0, 1.0)).unwrap();
        assert!(summary(&design).contains("3 V at 1000 rpm: steps of 0.341 rad/s"));
    }
}

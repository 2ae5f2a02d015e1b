//! What a person is shown of a result: the page of the terminal and the plots of the report.

use hidden_effects::{Effect, Recipe, draw};
use host_sim::diagnose::outcome::Verdict;
use host_sim::diagnose::{Diagnosis, diagnose, page, report};
use host_sim::recording::Recording;
use host_sim::rig::Rig;

fn diagnosis(recipe: &Recipe, verdict: Verdict) -> Diagnosis {
    let trial = draw(3, recipe);
    let recording = Recording::parse("recording.csv", trial.csv.as_bytes(), &[]).unwrap();
    let diagnosis = diagnose(&[recording], &Rig::parse("rig.toml", &trial.rig_toml).unwrap(), &|_| ()).unwrap();
    assert_eq!(diagnosis.outcome.verdict, verdict, "{:?}", diagnosis.outcome);
    diagnosis
}

/// Without a name the fault may be a sensor's, which no missing torque or voltage shows: the residual of each is there.
#[test]
fn what_has_no_name_is_shown_as_the_residual_of_each_sensor() {
    let plots = |diagnosis: &Diagnosis| {
        let html = report::report(diagnosis, &["recording.csv".into()]);
        (html.matches("<svg").count(), html)
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

/// The same recording with the angle in place of the speed.
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

/// Whatever the channels are called.
#[test]
fn the_errors_stand_below_their_heads() {
    let trial = draw(3, &Recipe::of(&[]));
    let recording = Recording::parse("recording.csv", with_angle(&trial.csv).as_bytes(), &[]).unwrap();
    let diagnosis = diagnose(&[recording], &Rig::parse("rig.toml", &trial.rig_toml).unwrap(), &|_| ()).unwrap();
    let page = page::page(&diagnosis);
    assert!(page.contains("omega_from_angle_rad_per_s"), "{page}");
    let (_, errors) = page.split_once("Error on data").unwrap();
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

//! What a person is shown of a result: the plots of the report.

use hidden_effects::{Effect, Recipe, draw};
use host_sim::diagnose::outcome::Verdict;
use host_sim::diagnose::{Diagnosis, diagnose, report};
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
            let caption = format!("residual of {} over {over}", measured.output.channel());
            assert!(html.contains(&caption), "{caption}");
        }
    }
    assert!(unnamed > named + diagnosis.data.measured.len() * 8, "{unnamed} {named}");
}

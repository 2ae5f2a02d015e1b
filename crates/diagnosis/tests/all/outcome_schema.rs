//! Results of every kind match `docs/reference/diagnosis.schema.json`, and the schema refuses invalid ones.

use crate::benches::{clean, rubbing, rubbing_without_current, shaken, shaken_rig};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::outcome::Verdict;
use motorbench_diagnosis::steady_state::study;
use motorbench_model::catalogue::CATALOGUE;
use serde_json::{Value, json};
use std::path::Path;

fn schema() -> Value {
    serde_json::from_str(include_str!("../../../../docs/reference/diagnosis.schema.json")).unwrap()
}

/// The errors of a result.
fn errors(outcome: &Value) -> Vec<String> {
    crate::schema::errors(&schema(), outcome)
}

fn is_valid(outcome: &Value) -> bool {
    errors(outcome).is_empty()
}

/// Nothing missing; all of it named, with a current and without; a part of it; none of it.
#[test]
fn results_of_every_kind_keep_to_it() {
    for (bench, verdict) in [
        (clean(), Verdict::Sufficient),
        (rubbing(), Verdict::Explained),
        (rubbing_without_current(), Verdict::Explained),
        (shaken_rig(), Verdict::PartlyExplained),
        (shaken(), Verdict::Unexplained),
    ] {
        let outcome = &bench.diagnosis.outcome;
        assert_eq!(outcome.verdict, verdict, "{outcome:?}");
        let outcome = serde_json::to_value(outcome).unwrap();
        let errors = errors(&outcome);
        assert!(errors.is_empty(), "{errors:?}\n{outcome:#}");
    }
}

/// A table of steady states at these currents, of a motor with the rig's constants but for a drop and a resistance that
/// grows.
fn table(currents_a: &[f64], drop_v: f64, growth_ohm_s: f64) -> Value {
    bent_table(currents_a, [drop_v, 0.0], growth_ohm_s)
}

/// The same with a drop that is so much greater for each V^2 from 8 V, which no motor has.
fn bent_table(currents_a: &[f64], [drop_v, bend_per_v]: [f64; 2], growth_ohm_s: f64) -> Value {
    let mut text = String::from("u_V,i_A,omega_rad_per_s\n");
    for u_v in [4.0_f64, 6.0, 8.0, 10.0, 12.0] {
        for (index, i_a) in currents_a.iter().enumerate() {
            let scatter = if index % 2 == 0 { 2e-3 } else { -2e-3 };
            let drop_v = drop_v + bend_per_v * (u_v - 8.0).powi(2);
            let omega = (u_v - drop_v - 2.0 * i_a) / (0.04 + growth_ohm_s * i_a) + scatter * u_v;
            text += &format!("{u_v},{i_a},{omega}\n");
        }
    }
    let rig = Rig::parse("rig.toml", "[motor]\nresistance_ohm = 2.0\ntorque_constant_Nm_per_A = 0.04\n").unwrap();
    let study = study(&Recording::parse("table.csv", text.as_bytes(), &[]).unwrap(), &rig, None).unwrap();
    serde_json::to_value(&study).unwrap()
}

/// The published table, one where nothing is missing, one with a drop, and one that asks for a resistance that grows.
#[test]
fn results_of_tables_keep_to_it() {
    let pivt6 = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/pivt6");
    let published = motorbench_files::recording(&pivt6.join("table2_no_load.csv"), &[]).unwrap();
    let published = study(&published, &motorbench_files::rig(&pivt6.join("rig.toml")).unwrap(), None).unwrap();
    let published = serde_json::to_value(&published).unwrap();
    let currents_a = [0.2, 0.201, 0.4, 0.401, 0.8, 0.801];
    let growing = table(&currents_a, 1.0, 0.01);
    let bent = bent_table(&currents_a, [0.0, 0.03], 0.0);
    assert_eq!(bent.pointer("/unexplained/acts_on"), Some(&json!("voltage")), "{bent:#}");
    let mut silent = bent.clone();
    silent["unexplained"] = Value::Null;
    assert!(!is_valid(&silent), "where something remains it is told what");
    assert!(growing["explanations"].to_string().contains("resistance_growing_with_speed"), "{growing:#}");
    for outcome in [&published, &table(&currents_a, 0.0, 0.0), &table(&currents_a, 1.2, 0.0), &growing, &bent] {
        let errors = errors(outcome);
        assert!(errors.is_empty(), "{errors:?}\n{outcome:#}");
    }
    // The winding's resistance was not asked for; the constant was.
    assert_eq!(published.pointer("/parameters/resistance_ohm/ci95"), Some(&Value::Null));
    assert!(published.pointer("/parameters/torque_constant_Nm_per_A/ci95/1").unwrap().is_number());
    // A level has all of its figures, and a table both of its lists.
    for pointer in ["/levels/0/u_V", "/explanations/0/terms", "/levels"] {
        let mut less = published.clone();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        less.pointer_mut(parent).unwrap().as_object_mut().unwrap().remove(key);
        assert!(!is_valid(&less), "{pointer}");
    }
}

#[test]
fn it_refuses_what_is_wrong() {
    let right = serde_json::to_value(&rubbing().diagnosis.outcome).unwrap();
    assert!(is_valid(&right));
    let wrong = |pointer: &str, value: Value| {
        let mut wrong = right.clone();
        *wrong.pointer_mut(pointer).unwrap() = value;
        assert!(!is_valid(&wrong), "{pointer}");
    };
    wrong("/verdict", json!("perfect"));
    wrong("/causes/0/effect", json!("ghost"));
    wrong("/causes/0/confidence", json!(1.5));
    wrong("/causes/0/parameters/torque_Nm/ci95", json!([1.0]));
    wrong("/fit/base", json!(7));
    wrong("/unexplained", json!({ "acts_on": "mind", "depends_on": "time", "share": 1.0 }));
    let mut less = right.clone();
    less.as_object_mut().unwrap().remove("advice");
    assert!(!is_valid(&less));
}

#[test]
fn its_effects_are_those_of_the_catalogue() {
    let known: Vec<&str> = CATALOGUE.iter().map(|effect| effect.about().id).collect();
    let schema = schema();
    let listed = schema.pointer("/$defs/effect/enum").unwrap().as_array().unwrap();
    assert_eq!(listed.len(), known.len());
    assert!(listed.iter().all(|id| known.contains(&id.as_str().unwrap())), "{listed:?}");
}

/// Every effect and each of its constants is on the catalogue's page, and no other effect is.
#[test]
fn the_page_of_effects_is_the_catalogue() {
    let page = include_str!("../../../../docs/reference/effects.md");
    for about in CATALOGUE.iter().map(|effect| effect.about()) {
        let section = page.split("\n### ").find(|section| section.starts_with(&format!("`{}`\n", about.id)));
        let section = section.unwrap_or_else(|| panic!("no section on {}", about.id));
        for parameter in about.parameters {
            assert!(section.contains(parameter.name), "{}: {} is not explained", about.id, parameter.name);
        }
    }
    assert_eq!(page.matches("\n### `").count(), CATALOGUE.len());
}

//! `motorbench stand` and `diagnose` with tables of steady states.

use crate::motor::PIVT6_TOML;
use crate::program::{json_of, motorbench, path};
use predicates::prelude::*;
use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;

/// A table of a motor with known constants, with scattered readings.
pub fn stand_table(brush_drop_v: f64, coulomb_nm: f64) -> String {
    stand_table_of(5.84, brush_drop_v, coulomb_nm)
}

/// The same with this resistance of the winding.
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
    // The best efficiency is between no load and stall, and no point of the map is better.
    let best = stand["most_efficient"].as_array().unwrap().last().unwrap();
    assert!(number(&best["efficiency"]) > 0.3 && number(&best["efficiency"]) < 0.9, "{best}");
    assert!(std::fs::read_to_string(&map).unwrap().contains("efficiency at the shaft; best (point)"));
    motorbench(&arguments).success().stderr(predicate::str::starts_with("wrote ")).stdout(predicate::function(
        |text: &str| text.lines().all(|line| line.chars().count() <= 80 || line.contains("->") || line.contains(" = ")),
    ));
    std::fs::write(at("bad.csv"), "position,ohm\n1,4\n").unwrap();
    motorbench(&["stand", path(&new), "--rig", path(&rig), "--resistance", path(&at("bad.csv"))])
        .code(1)
        .stderr(predicate::str::contains("needs a column resistance_ohm"));
}

/// Half an hour later the winding is 40 K warmer, without wear. Only additional friction points to the brushes.
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

/// The reading at rest without a voltage is the sensor's offset, and no winding of 0 ohm.
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

/// With these currents the motor could not turn. The evaluation is printed anyway, and then why there is no map.
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

/// The published table: its dynamic resistances are reproduced, and the constants found account for the power.
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
    // All errors of the derived table are in one row: its speed differs from the readings, and from that of its EMF.
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
        .stderr(predicate::str::contains("table3_winding_resistance.csv: the table needs a column u_V"));
}

/// A model is refused, but all other requested outputs are written.
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
    assert_eq!(page.matches("<svg").count(), 4, "speed and current over voltage, each for a screen and for a phone");
    // Each table has five levels, and their name a dot. The report names what cannot be distinguished.
    assert_eq!(page.matches("<circle").count(), 4 * (5 + 1));
    assert!(page.contains(" explains the table as well.") && !page.contains("could not be drawn"));
    assert!(std::fs::read_to_string(&json).unwrap().contains("\"explained\""));
    assert!(!model.exists());
}

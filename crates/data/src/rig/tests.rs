use super::*;
use motorbench_model::Motion;
use motorbench_model::motor::MotorParameters;

#[test]
fn reads_the_example_and_names_what_it_does_not_know() {
    let rig =
        Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n[motor]\nresistance_ohm = 5.84\ncolour = 'red'").unwrap();
    assert_eq!(rig.supply.voltage_v, Some(12.0));
    assert_eq!(rig.motor.resistance_ohm, Some(5.84));
    assert_eq!(rig.ignored, ["motor.colour"]);
}

#[test]
fn values_that_nothing_has_are_refused() {
    let message = |text: &str| Rig::parse("rig.toml", text).unwrap_err().to_string();
    let inertia = message("[motor]\ninertia_kg_m2 = 1e-300");
    assert!(inertia.contains("rig.toml: motor.inertia_kg_m2 = 1e-300: no motor has that"), "{inertia}");
    for text in ["[motor]\nresistance_ohm = \"5.84 ohm\"", "[motor]\nresistance_ohm = '5,84'"] {
        let unit = message(text);
        assert!(unit.contains("line 2") && unit.contains("a number without its unit"), "{unit}");
    }
    let sampled_at = |value: &str| format!("[recording]\ncurrent_sampled_at = {value}");
    for value in ["7", "-1", "1.001", "nan", "inf"] {
        let share = message(&sampled_at(value));
        assert!(
            share.contains("recording.current_sampled_at") && share.contains("a share of the PWM period"),
            "{share}"
        );
    }
    for value in ["0", "0.965", "1"] {
        assert!(Rig::parse("rig.toml", &sampled_at(value)).is_ok(), "{value}");
    }
}

/// The notes on a recording advise this value for a speed of the moment.
#[test]
fn a_window_of_no_length_is_none() {
    let rig = Rig::parse("rig.toml", "[recording]\nspeed_window_s = 0").unwrap();
    assert_eq!(rig.recording.speed_window_s, Some(0.0));
}

/// A mistyped key that would read as a missing constant is reported with its line. Every key of the example is
/// known.
#[test]
fn a_mistyped_key_is_named_with_its_line_and_the_one_that_was_meant() {
    let message = |text: &str| Rig::parse("rig.toml", text).unwrap_err().to_string();
    assert_eq!(
        message("# a rig\n[supply]\nvoltage_v = 12\n"),
        "rig.toml: line 3: unknown key supply.voltage_v; did you mean voltage_V?"
    );
    assert_eq!(message("[encodr]\n"), "rig.toml: line 1: unknown key encodr; did you mean encoder?");
    assert!(message("[motor]\n\nresistence_ohm = 1").contains("line 3: unknown key motor.resistence_ohm"));
    let every: String = Rig::default()
        .keys()
        .map(|(table, key)| match key {
            "kind" => "bridge.kind = 'L293D'\n".into(),
            "decay" => "bridge.decay = 'slow'\n".into(),
            "present" => "current_sensor.present = false\n".into(),
            "feedback" => "tachogenerator.feedback = true\n".into(),
            "counts_per_rev" => "encoder.counts_per_rev = 2000\n".into(),
            "readings" => "recording.readings = 'mean'\n".into(),
            "motion" => "axis.motion = 'linear'\n".into(),
            _ => format!("{table}.{key} = 0.5\n"),
        })
        .collect();
    // No axis has all of them.
    let refused = Rig::parse("rig.toml", &every).unwrap_err().to_string();
    assert!(refused.contains("Give axis.mass_kg"), "{refused}");
    let rig: Rig = toml::from_str(&every).unwrap();
    // After writing, all of them are there: the list misses no key.
    let written: toml::Table = toml::to_string(&rig).unwrap().parse().unwrap();
    let count: usize = written.values().map(|table| table.as_table().unwrap().len()).sum();
    assert_eq!(count, rig.keys().count());
}

#[test]
fn a_linear_axis_has_a_mass_in_the_place_of_an_inertia() {
    let rig = Rig::parse("rig.toml", "[axis]\nmass_kg = 95\nforce_constant_N_per_A = 20\n").unwrap();
    assert_eq!(rig.axis.stated(), Some(Motion::Linear));
    let nominal = rig.nominal();
    assert_eq!((nominal.inertia_kg_m2, nominal.torque_constant_nm_per_a), (Some(95.0), Some(20.0)));
    let message = |text: &str| Rig::parse("rig.toml", text).unwrap_err().to_string();
    let both = message("[axis]\nmotion = 'linear'\n[motor]\ninertia_kg_m2 = 1e-5\n");
    assert!(both.contains("motor.inertia_kg_m2 is of a rotary axis") && both.contains("Give axis.mass_kg"), "{both}");
    let other = message("[axis]\nmotion = 'rotary'\nmass_kg = 3\n");
    assert!(other.contains("Give motor.inertia_kg_m2"), "{other}");
    assert!(message("[axis]\nmotion = 'linea'\n").contains("line 2"));
    assert!(message("[axis]\nmas_kg = 3\n").contains("did you mean mass_kg?"));
}

#[test]
fn a_missing_constant_is_named() {
    let whole = NominalMotor::from(MotorParameters::PIVT6);
    assert_eq!(whole.parameters(), Ok(MotorParameters::PIVT6));
    let without = NominalMotor { inductance_h: None, ..whole };
    assert!(without.parameters().unwrap_err().to_string().starts_with("motor.inductance_H is missing"));
}

#[test]
fn errors_say_where() {
    let message = |text| Rig::parse("rig.toml", text).unwrap_err().to_string();
    assert!(
        message("[motor]\nresistance_ohm = -1").contains("motor.resistance_ohm = -1: it must be a positive number")
    );
    assert!(message("[motor]\nresistance_ohm = 'x'").contains("line 2"));
    assert!(message("[motor\n").contains("line 1"));
}

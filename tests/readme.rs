//! The README says what the source says.

use motorbench_core::pins::PIN_MAP;

const README: &str = include_str!("../README.md");

#[test]
fn the_pin_table_is_the_pin_map() {
    for pin in PIN_MAP {
        let row = format!("| {} | P{}{} | {} |", pin.arduino, pin.port, pin.bit, pin.role);
        assert!(README.contains(&row), "missing: {row}");
    }
    let rows = README
        .lines()
        .filter(|line| line.starts_with("| D") || line.starts_with("| A") && line.contains("| PC"))
        .count();
    assert_eq!(rows, PIN_MAP.len());
}

#[test]
fn the_commands_and_scripts_it_names_exist() {
    let aliases = include_str!("../.cargo/config.toml");
    for alias in ["firmware", "flash", "firmware-clippy"] {
        assert!(README.contains(&format!("cargo {alias}")) && aliases.contains(&format!("\n{alias} = ")), "{alias}");
    }
    for script in ["scripts/demo", "scripts/test", "scripts/firmware"] {
        assert!(README.contains(script) && std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(script).exists());
    }
}

//! The README and the pages beside it say what the source says.

use motorbench_core::pins::PIN_MAP;

const README: &str = include_str!("../README.md");
const HARDWARE: &str = include_str!("../docs/how-to/hardware.md");

#[test]
fn the_pin_table_is_the_pin_map() {
    for pin in PIN_MAP {
        let row = format!("| {} | P{}{} | {} |", pin.arduino, pin.port, pin.bit, pin.role);
        assert!(HARDWARE.contains(&row), "missing: {row}");
    }
    let rows = HARDWARE
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

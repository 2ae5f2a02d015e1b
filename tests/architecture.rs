//! `ARCHITECTURE.md` says which crates there are and what each depends on, and no arrow goes up.

use std::collections::BTreeMap;
use std::path::Path;

const PAGE: &str = include_str!("../ARCHITECTURE.md");

/// The lines of the block that begins with this fence.
fn block(kind: &str) -> Vec<&'static str> {
    let rest = PAGE.split(&format!("```text {kind}\n")).nth(1).unwrap_or_else(|| panic!("no block {kind}"));
    rest.split("```").next().unwrap().lines().collect()
}

/// `motorbench-model` is model; the program's package is cli.
fn short(package: &str) -> String {
    match package {
        "motorbench" => "cli".into(),
        _ => package.strip_prefix("motorbench-").unwrap_or(package).into(),
    }
}

/// The crates of the workspace with the crates of the workspace that each depends on, but for tests.
fn manifests() -> BTreeMap<String, Vec<String>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders: Vec<_> =
        ["", "boards/uno", "core", "host-sim", "hidden-effects"].map(|folder| root.join(folder)).into();
    folders.extend(std::fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path()));
    let read = |folder: &std::path::PathBuf| {
        let text = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let mut section = String::new();
        let (mut name, mut dependencies) = (String::new(), Vec::new());
        for line in text.lines() {
            if line.starts_with('[') {
                section = line.into();
            } else if let Some(value) = line.strip_prefix("name = ").filter(|_| section == "[package]") {
                name = short(value.trim_matches('"'));
            } else if section == "[dependencies]" {
                let package = line.split([' ', '.', '=']).next().unwrap_or_default();
                if package.starts_with("motorbench-") || ["host-sim", "hidden-effects"].contains(&package) {
                    dependencies.push(short(package));
                }
            }
        }
        dependencies.sort();
        (name, dependencies)
    };
    folders.iter().map(read).collect()
}

#[test]
fn the_arrows_are_those_of_the_manifests_and_go_down() {
    let mut seen: Vec<&str> = Vec::new();
    let manifests = manifests();
    for line in block("arrows") {
        let (name, dependencies) = line.split_once(':').unwrap_or_else(|| panic!("{line}: no crate"));
        let drawn: Vec<&str> = dependencies.split(',').map(str::trim).filter(|name| !name.is_empty()).collect();
        let real = manifests.get(name).unwrap_or_else(|| panic!("{name} is no crate"));
        assert_eq!(&drawn, real, "{name}: in the page, in its manifest");
        for dependency in drawn {
            assert!(seen.contains(&dependency), "{name} depends on {dependency}, which stands below it");
        }
        seen.push(name);
    }
    for name in manifests.keys() {
        assert!(seen.contains(&name.as_str()), "ARCHITECTURE.md does not name {name}");
    }
}

#[test]
fn the_tree_is_on_the_disk() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let lines = block("tree");
    for line in &lines {
        let folder = line.split_whitespace().next().unwrap();
        assert!(root.join(folder).is_dir(), "{folder}");
    }
    for entry in std::fs::read_dir(root.join("crates")).unwrap() {
        let folder = format!("crates/{}", entry.unwrap().file_name().to_string_lossy());
        assert!(lines.iter().any(|line| line.starts_with(&folder)), "the tree lacks {folder}");
    }
}

/// Crates that also run in a browser, where there are no files, no threads and no terminal.
const IN_A_BROWSER: [&str; 9] = [
    "core",
    "crates/text",
    "crates/model",
    "crates/data",
    "host-sim",
    "crates/diagnosis",
    "crates/design",
    "crates/report",
    "crates/web",
];
/// What they leave to those above them.
const LEFT_TO_OTHERS: [&str; 8] =
    ["std::fs", "File::", "std::thread", "std::net", "println!(", "eprintln!(", "SystemTime", "std::env::"];

/// The sources of a folder, without what stands behind the first `#[cfg(test)]` and without files and folders of tests.
fn sources(folder: &Path, found: &mut Vec<(String, String)>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if !path.ends_with("tests") {
                sources(&path, found);
            }
        } else if path.extension().is_some_and(|ending| ending == "rs") && !path.ends_with("tests.rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]").next().unwrap_or_default().to_owned();
            found.push((path.display().to_string(), code));
        }
    }
}

#[test]
fn what_runs_in_a_browser_opens_no_file_starts_no_thread_and_prints_nothing() {
    for folder in IN_A_BROWSER {
        let mut found = Vec::new();
        sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder).join("src"), &mut found);
        assert!(!found.is_empty(), "{folder}: no sources");
        for (path, code) in found {
            for (line, number) in code.lines().zip(1..).filter(|(line, _)| !line.trim_start().starts_with("//")) {
                let begins_a_word = |at: usize| !line[..at].ends_with(char::is_alphanumeric);
                let is_used = |what: &&&str| line.match_indices(**what).any(|(at, _)| begins_a_word(at));
                let used = LEFT_TO_OTHERS.iter().find(is_used);
                assert_eq!(used, None, "{path}, line {number}: {line}");
            }
        }
    }
}

#[test]
fn only_the_program_knows_the_command_line_and_the_terminal() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for entry in std::fs::read_dir(root.join("crates")).unwrap() {
        let folder = entry.unwrap().path();
        let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let dependencies = manifest.split("[dev-dependencies]").next().unwrap_or_default();
        for package in ["clap", "ratatui", "indicatif", "ctrlc"] {
            let is_there = dependencies.lines().any(|line| line.starts_with(&format!("{package}.")));
            assert_eq!(is_there, folder.ends_with("cli"), "{}: {package}", folder.display());
        }
    }
}

/// The numbers that the diagnosis goes by have one place.
const CONFIGURATION: &str = "diagnosis/src/configuration";
/// Constants that are no choice: places in a table, and a unit.
const NO_CHOICE: [&str; 9] =
    ["AHEAD", "OWN", "LAST_CHANGE", "LEVELS", "COEFFICIENTS", "TORQUE_CONSTANT", "INERTIA", "VISCOUS_FRICTION", "MS"];

/// The name of the constant that a line defines, if it is a number, or several.
fn number(line: &str) -> Option<&str> {
    let (visibility, constant) = line.trim_start().split_once("const ")?;
    if !visibility.is_empty() && !visibility.starts_with("pub") {
        return None;
    }
    let (name, of) = constant.split_once(": ")?;
    let (kind, _) = of.split_once(" = ")?;
    ["f64", "usize", "u8", "u32", "u64", "i32", "i64"].iter().any(|number| kind.contains(number)).then_some(name)
}

#[test]
fn the_numbers_of_the_diagnosis_are_in_its_configuration_with_a_reason() {
    let mut found = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/diagnosis/src"), &mut found);
    let (configuration, others): (Vec<_>, Vec<_>) =
        found.iter().partition(|(path, _)| path.replace('\\', "/").contains(CONFIGURATION));
    let mut count = 0;
    for (path, code) in configuration {
        let lines: Vec<&str> = code.lines().map(str::trim_start).collect();
        for pair in lines.windows(2) {
            if let Some(name) = number(pair[1]) {
                count += 1;
                // Several in a row share a reason.
                assert!(pair[0].starts_with("///") || pair[0].starts_with("pub const"), "{path}: {name} has no reason");
            }
        }
    }
    assert!(count > 100, "{count} numbers in {CONFIGURATION}");
    for (path, code) in others {
        for name in code.lines().filter_map(number) {
            assert!(NO_CHOICE.contains(&name), "{path}: {name} belongs into {CONFIGURATION}");
        }
    }
}

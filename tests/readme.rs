//! The README and the pages beside it say what the source says.

use motorbench_board::pins::PIN_MAP;
use std::path::{Path, PathBuf};

const README: &str = include_str!("../README.md");
const CONTRIBUTING: &str = include_str!("../CONTRIBUTING.md");
const HARDWARE: &str = include_str!("../docs/how-to/hardware.md");
const SETTINGS: &str = include_str!("../docs/reference/settings.md");

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

/// The tables are those that `cargo run --bin firmware` prints.
#[test]
fn the_page_of_settings_is_what_the_firmware_says() {
    for line in motorbench_core::console::reference().to_string().lines() {
        assert!(SETTINGS.contains(line), "docs/reference/settings.md lacks: {line}");
    }
}

#[test]
fn the_commands_and_scripts_that_are_named_exist() {
    let aliases = include_str!("../.cargo/config.toml");
    for alias in ["firmware", "flash", "firmware-clippy"] {
        let named = CONTRIBUTING.contains(&format!("cargo {alias}"));
        assert!(named && aliases.contains(&format!("\n{alias} = ")), "{alias}");
    }
    for (page, script) in [(README, "scripts/demo"), (README, "scripts/test"), (CONTRIBUTING, "scripts/firmware")] {
        assert!(page.contains(script) && root().join(script).exists(), "{script}");
    }
}

/// Each test that the suite leaves out says which trial runs it, and each trial runs something that is there.
#[test]
fn what_the_suite_leaves_out_is_a_trial() {
    let script = std::fs::read_to_string(root().join("scripts/trials")).unwrap();
    let mut left_out = 0;
    for folder in ["crates", "tests", "host-sim", "hidden-effects", "core"] {
        for (path, source) in sources(&root().join(folder)) {
            for line in source.lines().filter(|line| line.trim_start().starts_with("#[ignore")) {
                let named = line.split("`scripts/trials ").nth(1).and_then(|rest| rest.split('`').next());
                let trial = named.unwrap_or_else(|| panic!("{}: {line} names no trial", path.display()));
                assert!(script.contains(&format!("\"${{1:-}}\" = {trial} ]")), "{}: no trial {trial}", path.display());
                left_out += 1;
            }
        }
    }
    assert!(left_out > 10, "{left_out}");
    for command in script.lines().filter(|line| line.contains(" cargo ")) {
        let words: Vec<&str> = command.split_whitespace().collect();
        let after = |option: &str| words.windows(2).find(|pair| pair[0] == option).map(|pair| pair[1]);
        let folder = after("-p").map_or(String::new(), |package| package.replace("motorbench-", "crates/"));
        for (kind, name) in [("examples", after("--example")), ("tests", after("--test"))] {
            let Some(name) = name else { continue };
            let at = root().join(&folder).join(kind);
            assert!(at.join(format!("{name}.rs")).exists() || at.join(name).join("main.rs").exists(), "{command}");
        }
    }
}

/// The sources below a folder, with their text.
fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
    }
    found
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every page: those beside the README, and those in docs.
fn pages() -> Vec<PathBuf> {
    let mut folders = vec![root().join("docs")];
    let mut pages: Vec<PathBuf> =
        ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(|name| root().join(name)).into();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                pages.push(path);
            }
        }
    }
    pages
}

/// A page without what stands in fences.
fn prose(page: &Path) -> String {
    let text = std::fs::read_to_string(page).unwrap();
    text.split("\n```").step_by(2).collect()
}

/// The name that a heading has in a link.
fn anchor(heading: &str) -> String {
    let heading = heading.trim().to_lowercase();
    let kept = heading.chars().filter_map(|character| match character {
        ' ' => Some('-'),
        '-' | '_' => Some(character),
        _ => character.is_alphanumeric().then_some(character),
    });
    kept.collect()
}

/// The targets of the links and pictures in a page.
fn links(prose: &str) -> Vec<&str> {
    prose.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect()
}

#[test]
fn every_link_leads_somewhere() {
    let (mut count, mut wrong) = (0, Vec::new());
    for page in pages() {
        let prose = prose(&page);
        for link in links(&prose).into_iter().filter(|link| !link.contains("://")) {
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let mut found = target.exists();
            if found && !heading.is_empty() {
                let headings = self::prose(&target);
                found = headings.lines().any(|line| line.starts_with('#') && anchor(line.trim_matches('#')) == heading);
            }
            if !found {
                wrong.push(format!("{}: {link}", page.display()));
            }
            count += 1;
        }
    }
    assert!(count > 50 && wrong.is_empty(), "{count} links, of them broken:\n{}", wrong.join("\n"));
}

/// A page that no other page leads to is not found by anybody.
#[test]
fn every_page_is_linked() {
    let pages = pages();
    let linked: Vec<PathBuf> = pages
        .iter()
        .flat_map(|page| {
            let prose = prose(page);
            let targets = links(&prose).into_iter().map(|link| link.split('#').next().unwrap_or(link));
            targets.filter_map(|file| page.parent()?.join(file).canonicalize().ok()).collect::<Vec<_>>()
        })
        .collect();
    let root_page = root().join("README.md");
    for page in pages.iter().filter(|page| **page != root_page) {
        assert!(linked.contains(&page.canonicalize().unwrap()), "no page leads to {}", page.display());
    }
}

/// All folders of the sources, from the root.
fn folders() -> Vec<PathBuf> {
    let mut folders = vec![root().to_path_buf()];
    let mut next = 0;
    while let Some(folder) = folders.get(next).cloned() {
        next += 1;
        let inner = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir());
        folders.extend(inner.filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name != "target" && !name.starts_with('.')
        }));
    }
    folders
}

/// What `cargo` in a page is to take, there is: packages, tests, examples and benches; and so are the files that it
/// names.
#[test]
fn what_the_pages_name_of_the_sources_exists() {
    let folders = folders();
    let lock = include_str!("../Cargo.lock");
    let file = |kind: &str, name: &str| {
        let places = [format!("{kind}/{name}.rs"), format!("{kind}/{name}/main.rs")];
        folders.iter().any(|folder| places.iter().any(|place| folder.join(place).exists()))
    };
    let mut wrong = Vec::new();
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        for line in text.lines().filter(|line| line.contains("cargo ")) {
            let words: Vec<&str> = line.split(['`', ' ']).collect();
            for pair in words.windows(2).filter(|pair| pair[1].chars().all(|c| c.is_alphanumeric() || "-_".contains(c)))
            {
                let [option, name] = [pair[0], pair[1]];
                let exists = match option {
                    "-p" if name != "PACKAGE" => lock.contains(&format!("\nname = \"{name}\"\n")),
                    "--test" => file("tests", name),
                    "--example" => file("examples", name),
                    "--bench" => file("benches", name),
                    _ => true,
                };
                if !exists {
                    wrong.push(format!("{}: {option} {name}", page.display()));
                }
            }
        }
        const PLACES: [&str; 9] =
            ["core/", "src/", "host-sim/", "crates/", "hidden-effects/", "tests/", "scripts/", "scenarios/", "docs/"];
        for path in prose(&page).split('`').skip(1).step_by(2) {
            let plain = path.chars().all(|c| c.is_alphanumeric() || "-_./".contains(c));
            if plain && PLACES.iter().any(|place| path.starts_with(place)) && !root().join(path).exists() {
                wrong.push(format!("{}: {path}", page.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "there is no\n{}", wrong.join("\n"));
}

//! The files of a recording of a board, and the messages about those that cannot be written.

use super::files::beside;
use super::own_files::WRITTEN;
use super::{Failure, cannot_write, write};
use motorbench_core::settings::Settings;
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Parses the name of a measured table (.csv). Its other files have the same name with other endings.
pub(super) fn table_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv")) {
        return Ok(path);
    }
    Err(format!(
        "expected a name that ends in .csv, for instance {}; `motorbench convert` makes other formats of it",
        path.with_extension("csv").display()
    ))
}

/// Advice on a file that cannot be written while the motor turns.
const OTHER_FILE: &str = "--out names another file";

pub(super) fn cannot_grow(path: &Path, error: &std::io::Error) -> String {
    format!("{}; {OTHER_FILE}", cannot_write(path, error).message)
}

fn pretty(side: &serde_json::Value) -> Result<String, Failure> {
    Ok(serde_json::to_string_pretty(side).map_err(Failure::machine)? + "\n")
}

/// Rig and side file of a recording.
pub(super) fn rig_and_side(
    out: &Path,
    settings: &Settings,
    nominal: NominalMotor,
    side: &serde_json::Value,
) -> Result<Vec<(PathBuf, String)>, Failure> {
    let rig = toml::to_string(&telemetry::rig(settings, nominal)).map_err(Failure::machine)?;
    Ok(vec![(beside(out, "rig.toml"), WRITTEN.to_owned() + &rig), (beside(out, "json"), pretty(side)?)])
}

/// Files that could not be written, by reason.
pub(super) struct Unwritten(BTreeMap<String, Vec<String>>);

impl Unwritten {
    /// Each reason with its files. Reasons that `said` contains already are left out.
    fn named(&self, said: &str) -> String {
        let why = |why: &str| if said.contains(why) { String::new() } else { why.to_owned() };
        self.0.iter().map(|(reason, names)| names.join(", ") + &why(reason)).collect::<Vec<_>>().join("; ")
    }

    /// Message about the files beside a complete recording.
    pub(super) fn beside(&self, said: &str) -> String {
        format!("the files beside it have the content of its beginning: {}", self.named(said))
    }
}

/// Writes all files, even if one of them fails.
pub(super) fn write_each(files: &[(PathBuf, String)]) -> Result<(), Unwritten> {
    let mut failed: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (path, text) in files {
        let name = path.display().to_string();
        if let Err(failure) = write(path, text) {
            let why = failure.message.trim_start_matches(&name).to_owned();
            failed.entry(why).or_default().push(name);
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(Unwritten(failed)) }
}

/// Room for the end of a recording in the files beside it. The disk may be full by then.
const ROOM: usize = 2048;

/// Writes the files beside a recording before its first row, since those of an earlier recording would not match its
/// rows. Each file reserves room for its final content.
pub(super) fn write_first(files: &[(PathBuf, String)]) -> Result<(), String> {
    let with_room = files.iter().map(|(path, text)| (path.clone(), format!("{text}{:ROOM$}\n", "")));
    write_each(&with_room.collect::<Vec<_>>()).map_err(|unwritten| format!("{}; {OTHER_FILE}", unwritten.named("")))
}

/// Combines the end of a recording with the files that could not be written.
pub(super) fn with_unwritten(ended: Result<(), Failure>, written: Result<(), Unwritten>) -> Result<(), Failure> {
    let Err(unwritten) = written else { return ended };
    Err(match ended {
        Ok(()) => Failure::machine(unwritten.beside("")),
        Err(failure) => {
            Failure { message: format!("{}; {}", failure.message, unwritten.beside(&failure.message)), ..failure }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_said_once() {
        let why = ": no space: make room on the disk";
        let unwritten = || Unwritten([(why.to_owned(), vec!["run.json".to_owned()])].into());
        let ended = Failure::machine(format!("run.csv{why}; run.csv holds what had come"));
        let told = with_unwritten(Err(ended), Err(unwritten())).unwrap_err().message;
        assert!(told.matches("make room").count() == 1 && told.ends_with("of its beginning: run.json"), "{told}");
        let told = with_unwritten(Ok(()), Err(unwritten())).unwrap_err().message;
        assert!(told.ends_with(&format!("run.json{why}")), "{told}");
    }
}

//! Text files that a user names. If another file was probably meant, the error says so.

use motorbench_data::text_encoding;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Formats of the project's text files, with their endings.
const FORMATS: [&str; 3] = ["CSV", "TOML", "JSON"];

/// Largest number of files that are suggested instead of a missing one.
const MOST_NAMES: usize = 5;

/// The text of a file. `expected` describes it for the message.
///
/// # Errors
/// The message of the operating system. For a folder or a binary file it says what is expected instead.
pub fn read(path: &Path, expected: &str) -> Result<String> {
    if path.is_dir() {
        return Err(Error::new(ErrorKind::IsADirectory, format!("this is a folder, but {expected} is expected")));
    }
    let wrong = |what: &str| Error::new(ErrorKind::InvalidData, format!("this is {what}, but {expected} is expected"));
    let bytes = std::fs::read(path).map_err(|error| explained(path, error))?;
    let text = text_encoding::decoded(bytes).ok_or_else(|| wrong("not text"))?;
    match other_format(path, expected) {
        Some(format) => Err(wrong(format)),
        None => Ok(text),
    }
}

/// Suggestions for a missing file: the files of its folder with the same ending.
pub fn explained(path: &Path, error: Error) -> Error {
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    if error.kind() != ErrorKind::NotFound {
        return error;
    }
    let Ok(entries) = folder.read_dir() else { return Error::new(ErrorKind::NotFound, "there is no such folder") };
    let ending = path.extension();
    let files =
        entries.flatten().map(|entry| entry.path()).filter(|other| other.extension() == ending && other.is_file());
    let mut names: Vec<String> = files.filter_map(|other| Some(other.file_name()?.to_str()?.to_owned())).collect();
    names.sort();
    let there = match (ending, names.len()) {
        (None, _) => String::new(),
        (Some(ending), 0) => format!(", and no other file that ends in .{} in its folder", ending.display()),
        (Some(_), count) => {
            let more = if count > MOST_NAMES { ", ..." } else { "" };
            names.truncate(MOST_NAMES);
            format!("; its folder has {}{more}", names.join(", "))
        }
    };
    Error::new(ErrorKind::NotFound, format!("there is no such file{there}"))
}

/// The format of a file's ending, if it differs from the expected one.
pub fn other_format(path: &Path, expected: &str) -> Option<&'static str> {
    let ending = path.extension()?.to_str()?;
    let format = FORMATS.into_iter().find(|format| format.eq_ignore_ascii_case(ending))?;
    (FORMATS.iter().any(|named| expected.contains(named)) && !expected.contains(format)).then_some(format)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_not_there_may_have_been_another() {
        let folder = tempfile::tempdir().unwrap();
        let message = |name: &str| read(&folder.path().join(name), "a rig file (TOML)").unwrap_err().to_string();
        assert_eq!(message("rig.toml"), "there is no such file, and no other file that ends in .toml in its folder");
        for name in ["run.rig.toml", "bench.toml", "run.csv"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(message("rig.toml"), "there is no such file; its folder has bench.toml, run.rig.toml");
        assert_eq!(message("rig"), "there is no such file");
        assert_eq!(message("none/rig.toml"), "there is no such folder");
    }
}

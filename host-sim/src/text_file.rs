//! Text files that a person names: where another is named than was meant, that is said.

use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Formats of the project's text files; so are their endings.
const FORMATS: [&str; 3] = ["CSV", "TOML", "JSON"];

/// The text of a file. `expected`: what it should be, for the message.
///
/// # Errors
/// What the system says; for a folder and for what is no text, what is expected instead.
pub fn read(path: &Path, expected: &str) -> Result<String> {
    if path.is_dir() {
        return Err(Error::new(ErrorKind::IsADirectory, format!("this is a folder; {expected} is expected")));
    }
    let wrong = |what: &str| Error::new(ErrorKind::InvalidData, format!("this is {what}; {expected} is expected"));
    let text = String::from_utf8(std::fs::read(path)?).map_err(|_| wrong("no text"))?;
    match other_format(path, expected) {
        Some(format) => Err(wrong(format)),
        None => Ok(text),
    }
}

/// The format that a file's ending says, where it is another than that in the words for what is expected.
pub fn other_format(path: &Path, expected: &str) -> Option<&'static str> {
    let ending = path.extension()?.to_str()?;
    let format = FORMATS.into_iter().find(|format| format.eq_ignore_ascii_case(ending))?;
    (FORMATS.iter().any(|named| expected.contains(named)) && !expected.contains(format)).then_some(format)
}

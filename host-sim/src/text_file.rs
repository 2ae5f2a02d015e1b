//! Text files that a person names: where another is named than was meant, that is said.

use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// The text of a file. `expected`: what it should be, for the message.
///
/// # Errors
/// What the system says; for a folder and for what is no text, what is expected instead.
pub fn read(path: &Path, expected: &str) -> Result<String> {
    if path.is_dir() {
        return Err(Error::new(ErrorKind::IsADirectory, format!("this is a folder; {expected} is expected")));
    }
    String::from_utf8(std::fs::read(path)?)
        .map_err(|_| Error::new(ErrorKind::InvalidData, format!("this is no text; {expected} is expected")))
}

//! The control of a virtual board: a socket beside its port that takes the lines that `motorbench virtual` takes from its
//! terminal, and answers each with `ok` or with `error: ` and why.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A board that does not answer for this long does not run.
const ANSWER: Duration = Duration::from_secs(5);

/// Where the control of the board at a port is.
pub fn control_path(port: &Path) -> PathBuf {
    port.with_added_extension("control")
}

/// What a virtual board is told besides what goes over its port.
#[derive(Debug)]
pub struct VirtualControl(UnixStream);

impl VirtualControl {
    /// That of the board at a port; none where no virtual board is.
    pub fn of(port: &Path) -> Option<Self> {
        let stream = UnixStream::connect(control_path(port)).ok()?;
        stream.set_read_timeout(Some(ANSWER)).ok()?;
        Some(Self(stream))
    }

    /// For lines that take their time.
    #[must_use]
    pub fn patient(self) -> Self {
        // Where that is refused it waits as long as for any other.
        let _ = self.0.set_read_timeout(None);
        self
    }

    /// Has it do a line.
    ///
    /// # Errors
    /// Why it does not.
    pub fn order(&mut self, line: &str) -> Result<(), String> {
        let failed = |error: std::io::Error| format!("the virtual board does not answer to `{line}`: {error}");
        writeln!(self.0, "{line}").map_err(failed)?;
        let mut answer = String::new();
        BufReader::new(&self.0).read_line(&mut answer).map_err(failed)?;
        match answer.trim_end() {
            "ok" => Ok(()),
            other => Err(format!("the virtual board: {}", other.trim_start_matches("error: "))),
        }
    }
}

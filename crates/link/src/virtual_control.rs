//! Control of a virtual board: a socket beside its port. It takes the same lines as the terminal of `motorbench
//! virtual`, and answers each with `ok` or with `error: ` and the reason.

use std::fs::{File, TryLockError};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A board that does not answer for this long is not running.
const ANSWER: Duration = Duration::from_secs(5);

/// Path of the control socket of the board at a port.
pub fn control_path(port: &Path) -> PathBuf {
    port.with_added_extension("control")
}

/// A virtual board that is on its way: its firmware may be built first, which takes a minute. The lock on a file beside
/// its port tells others, and goes with the program.
#[derive(Debug)]
pub struct Starting {
    path: PathBuf,
    _lock: File,
}

fn starting_path(port: &Path) -> PathBuf {
    port.with_added_extension("starting")
}

impl Starting {
    /// Tells that a board will be at a port. `None` where no file can say so.
    pub fn at(port: &Path) -> Option<Self> {
        let path = starting_path(port);
        let lock = File::create(&path).ok()?;
        lock.try_lock().ok()?;
        Some(Self { path, _lock: lock })
    }

    /// Whether a board will be at a port.
    pub fn is_at(port: &Path) -> bool {
        let is_locked = |file: File| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock));
        File::open(starting_path(port)).is_ok_and(is_locked)
    }
}

impl Drop for Starting {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Sends lines to a virtual board, besides its port.
#[derive(Debug)]
pub struct VirtualControl(UnixStream);

impl VirtualControl {
    /// The control of the board at a port; `None` if it is no virtual board.
    pub fn of(port: &Path) -> Option<Self> {
        let stream = UnixStream::connect(control_path(port)).ok()?;
        stream.set_read_timeout(Some(ANSWER)).ok()?;
        Some(Self(stream))
    }

    /// For lines that take longer.
    #[must_use]
    pub fn patient(self) -> Self {
        // If this is refused, the usual time limit holds.
        let _ = self.0.set_read_timeout(None);
        self
    }

    /// Carries out a line.
    ///
    /// # Errors
    /// The reason of the virtual board.
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

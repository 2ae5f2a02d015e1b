//! One run of the demonstration for all tests that look at it: it records on the simulated chip and diagnoses.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

/// The run of the class page, with its report and its result besides.
pub const ARGUMENTS: [&str; 5] = ["demo", "--seed", "12", "--csv", "team12.csv"];

pub struct Demonstration {
    folder: TempDir,
    pub output: Output,
}

impl Demonstration {
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Copies the recording and what stands beside it.
    pub fn copy_recording(&self, to: &Path) {
        for name in ["team12.csv", "team12.rig.toml"] {
            std::fs::copy(self.file(name), to.join(name)).unwrap();
        }
    }
}

pub fn demonstration() -> &'static Demonstration {
    static RUN: OnceLock<Demonstration> = OnceLock::new();
    RUN.get_or_init(|| {
        let folder = TempDir::new().unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_motorbench"));
        command.args(ARGUMENTS).args(["--report", "demo.html", "--json", "demo.json"]).current_dir(folder.path());
        Demonstration { output: command.output().unwrap(), folder }
    })
}

//! Opens the files that a user names. An error says what is expected, and which file may have been meant.
//!
//! ```
//! let error = motorbench_files::rig("no-such-rig.toml".as_ref()).unwrap_err().to_string();
//! assert!(error.contains("there is no such file"), "{error}");
//! ```

pub mod text_file;

use host_sim::scenario::{Scenario, ScenarioError};
use motorbench_data::convert::Format;
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::{Recording, RecordingError};
use motorbench_data::rig::{Rig, RigError};
use motorbench_model::Model;
use std::path::Path;

/// Reads a recording of any format. `mappings` maps names of the file to channels.
///
/// # Errors
/// [`RecordingError`] with file and line.
pub fn recording(path: &Path, mappings: &[Mapping]) -> Result<Recording, RecordingError> {
    let name = path.display().to_string();
    if path.is_dir() {
        let message =
            "this is a folder, but a recording (CSV) is expected; `motorbench diagnose --batch` takes all in a folder";
        return Err(RecordingError::Table { name, message: message.into() });
    }
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) && path.exists() {
        return Err(RecordingError::Table { name, message: "this is TOML, but a recording (CSV) is expected".into() });
    }
    let bytes = std::fs::read(path).map_err(|error| {
        let source = text_file::explained(path, error);
        RecordingError::Read { name: name.clone(), source }
    })?;
    Recording::of_bytes(&name, &bytes, Format::of_content(path, &bytes), mappings)
}

/// Reads a rig file.
///
/// # Errors
/// [`RigError`] with file, and line or key.
pub fn rig(path: &Path) -> Result<Rig, RigError> {
    let name = path.display().to_string();
    let text =
        text_file::read(path, "a rig file (TOML)").map_err(|source| RigError::Read { path: name.clone(), source })?;
    Rig::parse(&name, &text)
}

/// Reads a scenario and the model file beside it. With a `model` it runs that one instead.
///
/// # Errors
/// [`ScenarioError`] with file, line or key, and what is expected.
pub fn scenario(path: &Path, model: Option<Model>) -> Result<Scenario, ScenarioError> {
    let text = |path: &Path| {
        text_file::read(path, "a scenario or its model (TOML)")
            .map_err(|source| ScenarioError::Read { path: path.display().to_string(), source })
    };
    Scenario::parse(path, &text(path)?, model, |file| text(&path.with_file_name(file)))
}

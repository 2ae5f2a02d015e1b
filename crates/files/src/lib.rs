//! Opens the files that a user names. An error says what is expected, and which file may have been meant.
//!
//! ```
//! let error = motorbench_files::rig("no-such-rig.toml".as_ref()).unwrap_err().to_string();
//! assert!(error.contains("there is no such file"), "{error}");
//! ```

pub mod text_file;

use host_sim::scenario::{Scenario, ScenarioError};
use motorbench_data::recording::{Recording, RecordingError};
use motorbench_data::rig::{Rig, RigError};
use motorbench_model::Model;
use std::path::Path;

/// Reads a recording, a CSV file. `names` maps column names of the file to those of this project:
/// `("speed", "omega_rad_per_s")`.
///
/// # Errors
/// [`RecordingError`] with file and line.
pub fn recording(path: &Path, names: &[(String, String)]) -> Result<Recording, RecordingError> {
    let name = path.display().to_string();
    if path.is_dir() {
        let message =
            "this is a folder, but a recording (CSV) is expected; `motorbench diagnose --batch` takes all in a folder";
        return Err(RecordingError::Table { name, message: message.into() });
    }
    let file = std::fs::File::open(path).map_err(|error| {
        let source = text_file::explained(path, error);
        RecordingError::Read { name: name.clone(), source }
    })?;
    if let Some(format) = text_file::other_format(path, "CSV") {
        let message =
            format!("this is {format}, but a recording (CSV) is expected; `motorbench convert` converts other formats");
        return Err(RecordingError::Table { name, message });
    }
    Recording::parse(&name, std::io::BufReader::new(file), names)
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

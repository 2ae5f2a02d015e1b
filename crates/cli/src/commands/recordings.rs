//! Input of `diagnose` and `identify`: recordings of one rig.

use super::{Failure, read_recording, rig_file, rig_for};
use clap::Args;
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use std::path::PathBuf;

/// Recordings and their rig.
#[derive(Args)]
pub struct RecordingArguments {
    /// Recordings of one rig: CSV with units in the column names (t_s with duty or u_V and omega_rad_per_s, rpm,
    /// theta_rad or counts, and i_A). For diagnose also one table of steady states without t_s.
    #[arg(required = true)]
    pub recordings: Vec<PathBuf>,
    /// Rig file (TOML); default: the one beside the first recording (run.rig.toml for run.csv), if there is one.
    #[arg(long)]
    pub rig: Option<PathBuf>,
    /// A column of the file that has another name or unit: speed=omega_rad_per_s*6.2832, pwm=duty/255.
    #[arg(long = "column", visible_alias = "map", value_name = "NAME=CHANNEL")]
    pub columns: Vec<Mapping>,
}

impl RecordingArguments {
    /// All recordings.
    pub fn read(&self) -> Result<Vec<Recording>, Failure> {
        let read = |path: &PathBuf| read_recording(path, &self.columns);
        self.recordings.iter().map(read).collect()
    }

    /// All input files.
    pub fn files(&self) -> Vec<PathBuf> {
        let rig = rig_file(self.rig.as_deref(), self.recordings.first().map(PathBuf::as_path));
        self.recordings.iter().cloned().chain(rig).collect()
    }

    /// Their rig.
    pub fn rig(&self) -> Result<Rig, Failure> {
        rig_for(self.rig.as_deref(), self.recordings.first().map(PathBuf::as_path))
    }
}

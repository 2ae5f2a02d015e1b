//! Results of a tuning session: step tests, recordings, gains.

use host_sim::figures::Figures;
use motorbench_core::message::Sample;
use motorbench_core::settings::Settings;
use motorbench_link::Losses;
use motorbench_link::record::{Ended, Record};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A running recording.
pub(super) struct Recorded {
    pub(super) samples: Vec<Sample>,
    /// Losses on the line before it.
    pub(super) losses: Losses,
    /// Gains at its start.
    pub(super) settings: Settings,
}

/// A finished recording.
pub struct StoredRecording {
    /// Message for the user.
    pub text: String,
    /// Its file, if it has any samples.
    pub file: Option<PathBuf>,
    /// Whether all of its files could be written.
    pub is_whole: bool,
}

/// Storage of recordings.
pub trait RecordingStore {
    /// Checks whether a recording with these gains and this firmware can be stored.
    ///
    /// # Errors
    /// The reason, with what to do.
    fn begin(&mut self, settings: &Settings, firmware: &str) -> Result<(), String>;

    /// Stores the samples of the running recording, so that they survive a crash of the program.
    ///
    /// # Errors
    /// The reason, with what to do; the recording then ends.
    fn grow(&mut self, samples: &[Sample], settings: &Settings) -> Result<(), String>;

    /// Finishes a recording that began with the gains `before`.
    fn keep(&mut self, record: &Record, before: &Settings, firmware: &str) -> StoredRecording;
}

/// A step test.
#[derive(Clone, Debug, serde::Serialize)]
pub struct StepTest {
    /// The loop, by the console's name of its mode.
    pub mode: &'static str,
    /// Its gains at the time.
    pub gains: BTreeMap<String, f32>,
    /// Figures of the step.
    #[serde(flatten)]
    pub figures: Figures,
    /// Number of lost ticks.
    pub missing_ticks: u32,
}

/// A whole session, as JSON.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Account {
    /// Version line of the firmware.
    pub firmware: String,
    /// Gains of both loops at the start.
    pub gains_before: BTreeMap<String, f32>,
    /// Gains of both loops at the end.
    pub gains_after: BTreeMap<String, f32>,
    /// Whether the final gains were saved on the board in this session.
    pub saved: bool,
    /// Step tests in their order.
    pub step_tests: Vec<StepTest>,
    /// Recordings in their order.
    pub recordings: Vec<String>,
    /// How it ended.
    pub ended: Ended,
}

impl Account {
    /// The state of the board, and the places of the recordings.
    pub fn left(&self) -> Vec<String> {
        let gains = match (self.saved, self.gains_after == self.gains_before) {
            (true, _) => "the board keeps these gains",
            (false, true) => "the gains are as before",
            (false, false) => "the changed gains are not saved and last until the next reset",
        };
        let recordings = format!("recordings: {}", self.recordings.join(", "));
        [Some(format!("the drive is off; {gains}")), (!self.recordings.is_empty()).then_some(recordings)]
            .into_iter()
            .flatten()
            .collect()
    }
}

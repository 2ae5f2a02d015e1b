//! Files that are written during a measurement. A program that ends early loses no completed rows.

use motorbench_core::message::{Mode, Sample};
use motorbench_core::settings::Settings;
use motorbench_data::telemetry::{driven_mode, recording_of};
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A text file that grows by whole lines.
#[derive(Debug)]
pub struct GrowingFile {
    path: PathBuf,
    file: Option<File>,
    /// Bytes of whole lines.
    length: u64,
}

impl GrowingFile {
    /// Checks that the file can be written; its old content is replaced by the first lines.
    ///
    /// # Errors
    /// The message of the operating system.
    pub fn new(path: &Path) -> io::Result<Self> {
        let new = !path.exists();
        OpenOptions::new().append(true).create(true).open(path)?;
        if new {
            std::fs::remove_file(path)?;
        }
        Ok(Self { path: path.into(), file: None, length: 0 })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether nothing was written yet.
    pub fn is_empty(&self) -> bool {
        self.file.is_none()
    }

    /// Adds lines. On an error the file ends with the last whole line, and is removed if there is none.
    ///
    /// # Errors
    /// The message of the operating system, for instance of a full disk.
    pub fn add(&mut self, lines: &str) -> io::Result<()> {
        if self.file.is_none() {
            self.file = Some(File::create(&self.path)?);
        }
        let Some(file) = &mut self.file else { return Ok(()) };
        if let Err(error) = file.write_all(lines.as_bytes()) {
            // A device has no length, so there is nothing to cut off.
            let _ = file.set_len(self.length);
            if self.length == 0 && self.path.is_file() {
                let _ = std::fs::remove_file(&self.path);
            }
            return Err(error);
        }
        self.length += lines.len() as u64;
        Ok(())
    }
}

/// A recording whose CSV file grows with the samples.
#[derive(Debug)]
pub struct GrowingCsv {
    file: GrowingFile,
    begun: Option<Sample>,
    /// The mode whose reference has a column. The header line is written first, so later samples cannot change it.
    mode: Option<Mode>,
    /// Rows that are in the file.
    rows: usize,
    /// Whether some rows could not be written. Then no more rows follow.
    is_over: bool,
}

impl GrowingCsv {
    /// As [`GrowingFile::new`]. The reference is that of the mode in which the first samples are driven.
    ///
    /// # Errors
    /// The message of the operating system.
    pub fn new(path: &Path) -> io::Result<Self> {
        Ok(Self { file: GrowingFile::new(path)?, begun: None, mode: None, rows: 0, is_over: false })
    }

    /// The reference is that of a mode that may begin later, or never.
    pub fn of_mode(self, mode: Mode) -> Self {
        Self { mode: Some(mode), ..self }
    }

    /// Samples that are in the file.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Adds samples, as [`GrowingFile::add`] does.
    ///
    /// # Errors
    /// The message of the operating system, for instance of a full disk.
    pub fn add(&mut self, samples: &[Sample], settings: &Settings) -> io::Result<()> {
        let Some(first) = samples.first().filter(|_| !self.is_over) else { return Ok(()) };
        let mode = *self.mode.get_or_insert_with(|| driven_mode(samples));
        let text = match self.begun {
            None => recording_of("", samples, settings, mode).to_csv(),
            // Times count from the first sample.
            Some(begun) => recording_of("", &[&[begun], samples].concat(), settings, mode).csv_rows(1),
        };
        self.begun.get_or_insert(*first);
        let added = self.file.add(&text);
        match added {
            Ok(()) => self.rows += samples.len(),
            Err(_) => self.is_over = true,
        }
        added
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_core::message::State;
    use motorbench_data::recording::Channel;
    use motorbench_data::telemetry::recording;

    #[test]
    fn it_grows_to_what_is_written_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let (path, settings) = (folder.path().join("run.csv"), Settings::defaults());
        let state = |tick: u32| if tick < 590 { Mode::SpeedPid as u8 | State::ENABLED } else { 0 };
        let sample = |tick| Sample { tick, speed: (7 * tick) as i16, state: State(state(tick)), ..Sample::default() };
        let samples: Vec<Sample> = (500..600).map(sample).collect();
        let mut growing = GrowingCsv::new(&path).unwrap();
        assert!(!path.exists(), "nothing has come");
        samples.chunks(7).for_each(|some| growing.add(some, &settings).unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), recording("", &samples, &settings).to_csv());
    }

    /// The drive is armed, goes off, and is armed in the other loop. One table has every sample.
    #[test]
    fn its_columns_stay_whatever_the_drive_does() {
        let folder = tempfile::tempdir().unwrap();
        let (path, settings) = (folder.path().join("tune.csv"), Settings::defaults());
        let mode = |tick: u32| [Mode::Off, Mode::SpeedPid, Mode::Off, Mode::SpeedLqr][(tick / 20) as usize];
        let reference = |tick| if mode(tick) == Mode::Off { 0 } else { 100 };
        let sample =
            |tick| Sample { tick, state: State(mode(tick) as u8), reference: reference(tick), ..Sample::default() };
        let samples: Vec<Sample> = (0..80).map(sample).collect();
        let mut growing = GrowingCsv::new(&path).unwrap().of_mode(Mode::SpeedPid);
        samples.chunks(7).for_each(|some| growing.add(some, &settings).unwrap());
        let read = motorbench_files::recording(&path, &[]).unwrap();
        let asked = read.get(Channel::SpeedReference).unwrap();
        assert_eq!((read.len(), asked.iter().filter(|value| **value != 0.0).count()), (80, 40));
    }

    #[test]
    fn an_earlier_recording_stays_until_another_comes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.csv");
        std::fs::write(&path, "earlier").unwrap();
        let mut growing = GrowingCsv::new(&path).unwrap();
        growing.add(&[], &Settings::defaults()).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "earlier");
        assert!(GrowingCsv::new(&folder.path().join("none/run.csv")).is_err());
    }
}

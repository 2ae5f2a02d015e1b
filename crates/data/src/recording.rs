//! Recordings in the project's own format: CSV with units in the column names.
//!
//! A recording has a column `t_s`; a table of steady states has none. An unmeasured quantity has no column. A missing
//! sample is empty or `nan`.

use crate::convert::{self, ConvertError, Converted, Dialect, Format};
use crate::mapping::Mapping;
use crate::statistics::{greatest, median};
use crate::times;
use motorbench_model::Motion;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Read;

/// The quantity of a column. Its name and unit are defined here only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// Time since the start.
    Time,
    /// Duty of the bridge, -1 to 1.
    Duty,
    /// Mean voltage that was commanded to the bridge, or applied.
    Voltage,
    /// Encoder counts.
    Counts,
    /// Angle of the shaft.
    Angle,
    /// Speed of the shaft.
    Speed,
    /// Speed of the shaft, in revolutions per minute.
    Rpm,
    /// Armature current.
    Current,
    /// Supply voltage at the bridge.
    Supply,
    /// Reference of a speed loop.
    SpeedReference,
    /// Reference of a position loop.
    AngleReference,
    /// Known torque of a load against positive rotation.
    LoadTorque,
    /// Torque that a drive was asked for.
    Torque,
    /// Force that a drive was asked for.
    Force,
    /// Position of a linear axis.
    Position,
    /// Speed of a linear axis.
    Velocity,
    /// Known force of a load against positive motion.
    LoadForce,
}

impl Channel {
    /// Every channel, in the order of columns.
    pub const ALL: [Self; 17] = [
        Self::Time,
        Self::Duty,
        Self::Voltage,
        Self::Counts,
        Self::Angle,
        Self::Speed,
        Self::Rpm,
        Self::Current,
        Self::Supply,
        Self::SpeedReference,
        Self::AngleReference,
        Self::LoadTorque,
        Self::Torque,
        Self::Force,
        Self::Position,
        Self::Velocity,
        Self::LoadForce,
    ];

    /// Column name.
    pub fn column(self) -> &'static str {
        match self {
            Self::Time => "t_s",
            Self::Duty => "duty",
            Self::Voltage => "u_V",
            Self::Counts => "counts",
            Self::Angle => "theta_rad",
            Self::Speed => "omega_rad_per_s",
            Self::Rpm => "rpm",
            Self::Current => "i_A",
            Self::Supply => "supply_V",
            Self::SpeedReference => "ref_rad_per_s",
            Self::AngleReference => "ref_rad",
            Self::LoadTorque => "load_Nm",
            Self::Torque => "torque_Nm",
            Self::Force => "force_N",
            Self::Position => "x_m",
            Self::Velocity => "v_m_per_s",
            Self::LoadForce => "load_N",
        }
    }

    /// Description for a person: the title of an axis, with its unit.
    pub fn title(self) -> &'static str {
        match self {
            Self::Time => "time, s",
            Self::Duty => "duty",
            Self::Voltage => "voltage, V",
            Self::Counts => "encoder, counts",
            Self::Angle => "angle, rad",
            Self::Speed => "speed, rad/s",
            Self::Rpm => "speed, rpm",
            Self::Current => "current, A",
            Self::Supply => "supply, V",
            Self::SpeedReference => "reference of the speed, rad/s",
            Self::AngleReference => "reference of the angle, rad",
            Self::LoadTorque => "load, Nm",
            Self::Torque => "torque, Nm",
            Self::Force => "force, N",
            Self::Position => "position, m",
            Self::Velocity => "speed, m/s",
            Self::LoadForce => "load, N",
        }
    }

    /// Largest plausible magnitude. A larger value is an error or a glitch: it is far beyond the bench of a small
    /// motor.
    fn greatest(self) -> f64 {
        match self {
            // Nanoseconds since 1970 are allowed as time.
            Self::Time => 1e19,
            Self::Duty | Self::Voltage | Self::Current | Self::Supply | Self::LoadTorque | Self::Torque => 1e6,
            Self::Speed | Self::SpeedReference | Self::Force | Self::LoadForce | Self::Position | Self::Velocity => 1e7,
            Self::Rpm => 1e8,
            Self::Angle | Self::AngleReference => 1e9,
            Self::Counts => 1e12,
        }
    }

    /// How an axis moves that has it; nothing for a channel that every axis may have.
    pub fn motion(self) -> Option<Motion> {
        match self {
            Self::Force | Self::Position | Self::Velocity | Self::LoadForce => Some(Motion::Linear),
            Self::Counts | Self::Angle | Self::Speed | Self::Rpm | Self::Torque | Self::LoadTorque => {
                Some(Motion::Rotary)
            }
            Self::Time | Self::Duty | Self::Voltage | Self::Current | Self::Supply => None,
            Self::SpeedReference | Self::AngleReference => None,
        }
    }

    /// The message about a value that cannot be a measurement.
    pub(crate) fn refusal(self, value: f64) -> Option<String> {
        let (column, greatest) = (self.column(), self.greatest());
        (value.abs() > greatest).then(|| {
            format!(
                "column {column}: {value:e} cannot be a measurement (more than {greatest:e}): leave the cell empty if the sample is missing, or correct its unit"
            )
        })
    }

    /// The channel with this column name.
    pub fn of_column(column: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.column() == column)
    }
}

/// Largest share of rows without a time. More are not explained by garbled lines.
const MOST_WITHOUT_TIME: f64 = 0.01;
/// Largest number of rows of a table of steady states. It may have a time of day.
pub(crate) const LONGEST_TABLE: usize = 80;

/// Columns of equal length. See the module.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Where it came from, for messages.
    pub name: String,
    columns: BTreeMap<Channel, Vec<f64>>,
    /// Names of columns without a known meaning.
    pub ignored: Vec<String>,
    /// Columns without any number; they count as not recorded.
    pub empty: Vec<Channel>,
    /// Number of rows that were left out because they have no time.
    pub without_time: usize,
    /// What a person should know of how it was read.
    pub notes: Vec<String>,
    /// Options for a command line that name columns which are likely channels; empty if there are none.
    pub suggestion: String,
}

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("{name}: {source}")]
    Read {
        /// The file.
        name: String,
        /// The message of the operating system.
        source: std::io::Error,
    },
    /// The file is not a table of numbers.
    #[error("{name}, line {line}: {message}")]
    Line {
        /// The file.
        name: String,
        /// Line of the file, from 1.
        line: u64,
        /// The fault.
        message: String,
    },
    /// The table as a whole is of no use.
    #[error("{name}: {message}")]
    Table {
        /// The file.
        name: String,
        /// The fault.
        message: String,
    },
}

impl Recording {
    /// An empty recording.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// Adds or replaces a column.
    ///
    /// # Panics
    /// If its length differs from that of the other columns.
    pub fn set(&mut self, channel: Channel, values: Vec<f64>) {
        if let Some(other) = self.columns.iter().find(|(name, _)| **name != channel) {
            assert_eq!(other.1.len(), values.len(), "columns of one recording are equally long");
        }
        self.columns.insert(channel, values);
    }

    /// The values of a channel, with missing ones as NaN.
    pub fn get(&self, channel: Channel) -> Option<&[f64]> {
        self.columns.get(&channel).map(Vec::as_slice)
    }

    /// Time of each sample; a table of steady states has none.
    pub fn time_s(&self) -> Option<&[f64]> {
        self.get(Channel::Time)
    }

    /// The channels it has.
    pub fn channels(&self) -> impl Iterator<Item = Channel> {
        self.columns.keys().copied()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.columns.values().next().map_or(0, Vec::len)
    }

    /// Whether it has no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether the content is the same; the name of the file does not count.
    pub fn has_the_rows_of(&self, other: &Self) -> bool {
        // Compared by bits, so that missing samples are equal.
        let same = |(channel, own): (&Channel, &Vec<f64>)| {
            let bits = |value: &f64| value.to_bits();
            other.get(*channel).is_some_and(|others| own.iter().map(bits).eq(others.iter().map(bits)))
        };
        self.columns.len() == other.columns.len() && self.columns.iter().all(same)
    }

    /// The rows before a time, counted from the first.
    #[must_use]
    pub fn before(&self, end_s: f64) -> Self {
        let time_s = self.time_s().unwrap_or_default();
        let count = time_s.iter().take_while(|t_s| **t_s - time_s[0] < end_s).count();
        let mut cut = Self { columns: BTreeMap::new(), ..self.clone() };
        self.columns.iter().for_each(|(channel, values)| cut.set(*channel, values[..count].to_vec()));
        cut
    }

    /// Reads a table as text. `name` is for messages. `mappings` maps names of the file to channels.
    ///
    /// # Errors
    /// [`RecordingError`] with the line.
    pub fn parse(name: &str, mut text: impl Read, mappings: &[Mapping]) -> Result<Self, RecordingError> {
        let mut bytes = Vec::new();
        text.read_to_end(&mut bytes).map_err(|source| RecordingError::Read { name: name.into(), source })?;
        Self::of_bytes(name, &bytes, Format::Csv, mappings)
    }

    /// Reads a file of any format.
    ///
    /// # Errors
    /// [`RecordingError`] with the place.
    pub fn of_bytes(name: &str, bytes: &[u8], format: Format, mappings: &[Mapping]) -> Result<Self, RecordingError> {
        let converted = convert::read(name, bytes, format, mappings, Dialect::default());
        let Converted { mut recording, cut } = converted.map_err(|error| match error {
            ConvertError::Recording(error) => error,
            ConvertError::Content { name, fault } => RecordingError::Table { name, message: fault.to_string() },
        })?;
        recording.notes.extend(cut.map(|cut| format!("The file ends early: {cut}.")));
        recording.leave_empty_out();
        Ok(recording)
    }

    /// Mends times that do not increase, where one explanation fits.
    pub(crate) fn mend_times(&mut self, tick_s: f64) {
        let Some(mended) = self.time_s().and_then(|time_s| times::mended(time_s, tick_s)) else { return };
        for values in self.columns.values_mut() {
            let mut kept = mended.kept.iter();
            values.retain(|_| *kept.next().expect("columns are equally long"));
        }
        self.columns.insert(Channel::Time, mended.time_s);
        self.notes.extend(mended.notes);
    }

    /// Removes single rows whose time is no number; garbled lines cause them.
    pub(crate) fn leave_rows_without_time_out(&mut self) {
        let has_time: Vec<bool> = self.time_s().unwrap_or_default().iter().map(|t_s| !t_s.is_nan()).collect();
        let without = has_time.iter().filter(|has_time| !**has_time).count();
        if without as f64 > MOST_WITHOUT_TIME * has_time.len() as f64 || without == 0 {
            return;
        }
        for values in self.columns.values_mut() {
            let mut has_time = has_time.iter();
            values.retain(|_| *has_time.next().expect("columns are equally long"));
        }
        self.without_time = without;
    }

    /// A column without any number counts as not recorded. At least one column is left.
    fn leave_empty_out(&mut self) {
        let is_empty = |values: &Vec<f64>| values.iter().all(|value| value.is_nan());
        if !self.columns.values().all(is_empty) {
            self.empty =
                self.columns.extract_if(.., |_, values| is_empty(values)).map(|(channel, _)| channel).collect();
        }
    }

    /// Advice for a table whose time column may have another name. `None` if there is a time column, if no column
    /// resembles one, or for few rows.
    pub fn advice_on_time(&self) -> Option<String> {
        if self.time_s().is_some() || self.len() < LONGEST_TABLE {
            return None;
        }
        let (name, rows) = (&self.name, self.len());
        let advice = match self.step_by_motion_s() {
            _ if self.suggestion.contains("=t_s") => format!("Likely: {}", self.suggestion),
            Some(step_s) => {
                format!("If rows are evenly spaced, --column row=t_s*{step_s} takes them as {step_s} s apart")
            }
            None => return None,
        };
        Some(format!(
            "{name}: there is no column t_s, and {rows} rows are too many for a table of steady states. {advice}"
        ))
    }

    /// The time between rows that angle and speed agree on.
    fn step_by_motion_s(&self) -> Option<f64> {
        let (angle, speed) = (self.get(Channel::Angle)?, self.get(Channel::Speed)?);
        let least = 0.5 * greatest(speed);
        let steps = angle
            .windows(2)
            .zip(speed.windows(2))
            .filter(|(_, speed)| speed[0].abs() > least && speed[1].abs() > least);
        let step_s = median(steps.map(|(angle, speed)| 2.0 * (angle[1] - angle[0]) / (speed[0] + speed[1])));
        // Whole milliseconds: the tick of a program.
        let step_s = (step_s * 1e3).round() / 1e3;
        (step_s > 0.0).then_some(step_s)
    }

    pub(crate) fn check(&self) -> Result<(), RecordingError> {
        let error = |message: String| RecordingError::Table { name: self.name.clone(), message };
        if self.is_empty() {
            return Err(error("no samples after the header line".into()));
        }
        for (channel, values) in &self.columns {
            if let Some((row, what)) =
                values.iter().enumerate().find_map(|(row, value)| Some((row, channel.refusal(*value)?)))
            {
                return Err(error(format!("sample {}, {what}", row + 1)));
            }
        }
        let Some(time_s) = self.time_s() else { return Ok(()) };
        let without = time_s.iter().filter(|t_s| t_s.is_nan()).count();
        if without > 0 {
            return Err(error(format!(
                "t_s is no number in {without} of {} rows. A few garbled lines are left out, but these are too many: check which column is the time",
                time_s.len()
            )));
        }
        for (row, pair) in time_s.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                return Err(error(format!(
                    "sample {}: t_s goes from {} to {}, but time must increase from sample to sample. If rows are faster than whole milliseconds, record t_s with micros()",
                    row + 2,
                    pair[0],
                    pair[1]
                )));
            }
        }
        Ok(())
    }

    /// The recording as CSV.
    pub fn to_csv(&self) -> String {
        self.csv_header() + &self.csv_rows(0)
    }

    /// The header line of the CSV.
    pub fn csv_header(&self) -> String {
        self.columns.keys().map(|channel| channel.column()).collect::<Vec<_>>().join(",") + "\n"
    }

    /// The CSV's lines from a row on.
    pub fn csv_rows(&self, first: usize) -> String {
        let mut text = String::new();
        for row in first..self.len() {
            for (index, (channel, values)) in self.columns.iter().enumerate() {
                let comma = if index == 0 { "" } else { "," };
                let _ = write!(text, "{comma}{}", cell(*channel, values[row]));
            }
            text.push('\n');
        }
        text
    }
}

/// Below this time, whole nanoseconds have no more digits than a float holds.
const SHORT_TIME_S: f64 = 1e6;

/// A value as text. Nine digits are more than any sensor has. Times keep their nanoseconds, and those since 1970 every
/// digit.
fn cell(channel: Channel, value: f64) -> String {
    if value.is_nan() {
        return String::new();
    }
    let digits = match channel {
        Channel::Time if value.abs() >= SHORT_TIME_S => return value.to_string(),
        Channel::Time => 9,
        _ if value == 0.0 || !value.is_finite() => 0,
        _ => (8 - value.abs().log10().floor() as i32).clamp(0, 12) as usize,
    };
    let rounded = format!("{value:.digits$}");
    if rounded.contains('.') { rounded.trim_end_matches('0').trim_end_matches('.').to_owned() } else { rounded }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Recording, RecordingError> {
        Recording::parse("test.csv", text.as_bytes(), &[])
    }

    #[test]
    fn csv_comes_back_as_it_was() {
        let mut recording = Recording::new("test.csv");
        recording.set(Channel::Time, vec![0.0, 0.001, 0.002]);
        recording.set(Channel::Speed, vec![1.0 / 3.0, -1e-9, f64::NAN]);
        recording.set(Channel::Counts, vec![0.0, 123_456_789.0, -5.0]);
        let read = parse(&recording.to_csv()).unwrap();
        assert_eq!(read.get(Channel::Counts), recording.get(Channel::Counts));
        assert!((read.get(Channel::Speed).unwrap()[0] - 1.0 / 3.0).abs() < 1e-9);
        assert!(read.get(Channel::Speed).unwrap()[2].is_nan());
    }

    #[test]
    fn errors_say_where() {
        let message = |text| parse(text).unwrap_err().to_string();
        assert!(message("t_s,u_V\n0,1\n1,x\n").contains("line 3: column u_V: expected a number, found \"x\""));
        assert!(message("t_s,u_V\r\n0,1\r\n1,x\r\n").contains("line 3: column u_V"));
        assert!(message("t_s,u_V\n0,1\n1\n").contains("line 3: 1 values, but the header line has 2"));
        assert!(message("t_s,u_V\n0,1\n0,1\n").contains("time must increase"));
        assert!(message("a,b\n0,1\n").contains("no known channel"));
        // With tabs as separators a comma may separate thousands.
        assert!(message("t_s\tu_V\n0\t1,500\n").contains("line 2: column u_V"));
        assert!(message("t_s,u_V\n").contains("no samples"));
        for (column, value) in [("omega_rad_per_s", "1e300"), ("omega_rad_per_s", "-1e12"), ("i_A", "1e7")] {
            let found = parse(&format!("t_s,{column}\n0,1\n1,{value}\n")).unwrap_err().to_string();
            assert!(found.contains(&format!("line 3: column {column}: {value} cannot be a measurement")), "{found}");
        }
        let unreadable = Recording::parse("test.npy", &b"\x93NUMPY\x01\0"[..], &[]).unwrap_err().to_string();
        assert!(unreadable.contains("not text, but a table is expected"), "{unreadable}");
        let after_separator = message("sep=;\r\nt_s;u_V\r\n0;1,5\r\n1;x\r\n");
        assert!(after_separator.contains("line 4: column u_V"), "{after_separator}");
        // A 32-bit counter, and a clock since 1970.
        assert!(parse("t_s,counts\n1.7e9,4294967295\n1.8e9,nan\n").is_ok());
    }

    #[test]
    fn semicolons_and_tabs_stand_between_values_as_well() {
        let commas = parse("t_s,u_V,i_A\n0,-1.5,\n0.5,2,3e-3\n").unwrap();
        for other in [
            "t_s;u_V;i_A;\r\n0;-1,5;;\r\n0,5;2;3e-3;\r\n",
            "# 12 V, 2 A\nt_s;u_V;i_A\n0;-1.5;\n0.5;2;0,003\n",
            "t_s|u_V|i_A\n0|-1.5|\n0.5|2|3e-3\n",
            "t_s u_V i_A\n0 -1.5 nan\n0.5  2 0.003\n",
            "t_s\tu_V\ti_A\n0\t-1.5\t\n0.5\t2\t3e-3\n",
            "\u{feff}sep=;\r\nt_s;u_V;i_A\r\n0;-1,5;\r\n0,5;2;0,003\r\n",
        ] {
            let read = parse(other).unwrap();
            assert_eq!((read.to_csv(), &read.ignored), (commas.to_csv(), &commas.ignored), "{other}");
        }
    }

    #[test]
    fn a_column_without_a_number_was_not_recorded() {
        let read = parse("t_s,u_V,i_A\n0,1,nan\n1,2,\n").unwrap();
        assert_eq!((read.get(Channel::Current), &read.empty[..]), (None, &[Channel::Current][..]));
        // It is still a table with two rows.
        assert_eq!(parse("u_V,i_A\nnan,\n,\n").unwrap().len(), 2);
    }

    #[test]
    fn few_rows_without_a_time_are_left_out() {
        let csv = |lost: usize| {
            let time = |row: usize| if row % 100 < lost { "nan".into() } else { row.to_string() };
            (0..1000).fold("t_s,u_V\n".to_string(), |csv, row| csv + &format!("{},{row}\n", time(row)))
        };
        let read = parse(&csv(1)).unwrap();
        assert_eq!((read.len(), read.without_time), (990, 10));
        assert!(read.time_s().unwrap().iter().eq(read.get(Channel::Voltage).unwrap()), "whole rows are");
        let refused = parse(&csv(2)).unwrap_err().to_string();
        assert!(refused.starts_with("test.csv: t_s is no number in 20 of 1000 rows. "), "{refused}");
        assert!(!refused.contains("micros()"), "{refused}");
        assert_eq!(parse(&csv(0)).unwrap().without_time, 0);
    }

    #[test]
    fn a_time_of_another_name_is_recognised() {
        let read = |header: &str, rows: usize| {
            let rows = (0..rows).map(|row| format!("{row},1\n")).collect::<String>();
            parse(&format!("{header}\n{rows}")).unwrap()
        };
        // A unit in the name leaves no doubt.
        let read_ms = read("t_ms,u_V", 100);
        assert_eq!(read_ms.time_s().unwrap()[1], 1e-3);
        assert_eq!(read_ms.notes, ["t_s is the column t_ms, in ms."]);
        let advice = read("time,u_V", 100).advice_on_time().unwrap();
        assert!(advice.ends_with("Likely: --column time=t_s/1000"), "{advice}");
        for (header, rows) in [("time,u_V", 20), ("temperature_C,u_V", 100), ("t_s,u_V", 100), ("time_ms,u_V", 20)] {
            assert_eq!(read(header, rows).advice_on_time(), None, "{header}");
        }
    }

    #[test]
    fn times_since_1970_keep_every_digit() {
        let text = "t_s,u_V\n1709305190.001,1\n1709305190.002,2\n1709305190.00325,3\n";
        assert_eq!(parse(text).unwrap().to_csv(), text);
    }

    #[test]
    fn other_names_are_mapped() {
        let names = ["speed=omega_rad_per_s".parse().unwrap()];
        let read = Recording::parse("x", "t_s,speed,foo\n0,1,2\n".as_bytes(), &names).unwrap();
        assert_eq!(read.get(Channel::Speed), Some(&[1.0][..]));
        assert_eq!(read.ignored, ["foo"]);
        // A table in the format of spreadsheets.
        let read = Recording::parse("x", "\u{feff}speed,t_s\r\n1,0\r\n".as_bytes(), &names).unwrap();
        assert_eq!(read.get(Channel::Speed), Some(&[1.0][..]));
        let wrong = Recording::parse("x", "t_s,foo\n0,1\n".as_bytes(), &names).unwrap_err().to_string();
        assert!(wrong.contains("there are t_s, foo"), "{wrong}");
    }
}

//! Recordings to and from the formats of other tools, one file each.
//!
//! Reading returns columns, or series with their own times, under the names of the file. [`Names`] maps these names to
//! channels. Writing starts from a [`Recording`].

mod csv;
mod mat;
mod numpy;
mod plotjuggler;
mod series;
mod sysid;
mod wpilog;

use crate::recording::{Channel, Recording, RecordingError};
use std::path::Path;

pub use csv::Dialect;

/// A file format. The ending of the file's name gives it, unless the user names another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A table with a header line.
    Csv,
    /// CSV of `PlotJuggler`.
    Plotjuggler,
    /// Legacy JSON of `WPILib` `SysId`.
    Sysid,
    /// `WPILib` data log.
    Wpilog,
    /// MATLAB level 5.
    Mat,
    /// `NumPy`, one array.
    Npy,
    /// `NumPy`, several arrays.
    Npz,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 7] =
        [Self::Csv, Self::Plotjuggler, Self::Sysid, Self::Wpilog, Self::Mat, Self::Npy, Self::Npz];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Plotjuggler => "plotjuggler",
            Self::Sysid => "sysid",
            Self::Wpilog => "wpilog",
            Self::Mat => "mat",
            Self::Npy => "npy",
            Self::Npz => "npz",
        }
    }

    /// What a file of this format holds, for a help text.
    pub const fn description(self) -> &'static str {
        match self {
            Self::Csv => "A table with a header line (.csv, .tsv, .txt)",
            Self::Plotjuggler => "CSV of PlotJuggler: times in `__time`, cells may be empty",
            Self::Sysid => "Legacy JSON of WPILib SysId: four tests, rotations (.json)",
            Self::Wpilog => "WPILib data log 1.0 (.wpilog)",
            Self::Mat => "MATLAB level 5, one vector for each channel (.mat)",
            Self::Npy => "NumPy, one structured array (.npy)",
            Self::Npz => "NumPy, one array for each channel (.npz)",
        }
    }

    /// The format that the ending of a file's name gives.
    ///
    /// # Errors
    /// [`ConvertError`] for an ending that no format has.
    pub fn of_path(path: &Path) -> Result<Self, ConvertError> {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
        match ending.as_str() {
            "csv" | "tsv" | "txt" => Ok(Self::Csv),
            "json" => Ok(Self::Sysid),
            "wpilog" => Ok(Self::Wpilog),
            "mat" => Ok(Self::Mat),
            "npy" => Ok(Self::Npy),
            "npz" => Ok(Self::Npz),
            _ => Err(ConvertError::new(
                path.display(),
                Fault::whole(
                    "no format has this ending: expected .csv, .tsv, .txt, .json (SysId), .wpilog, .mat, .npy or .npz. Or give the format with --from or --to",
                ),
            )),
        }
    }
}

/// A fault in the content of a file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{place}{what}")]
pub struct Fault {
    /// The place, followed by a colon; empty for the whole file.
    place: String,
    /// The fault, and what to do.
    what: String,
}

impl Fault {
    fn whole(what: impl Into<String>) -> Self {
        Self { place: String::new(), what: what.into() }
    }

    fn at(place: impl std::fmt::Display, what: impl Into<String>) -> Self {
        Self { place: format!("{place}: "), what: what.into() }
    }

    fn at_byte(offset: usize, what: impl Into<String>) -> Self {
        Self::at(format_args!("byte {offset}"), what)
    }
}

/// Why a file cannot be converted.
#[derive(Debug, thiserror::Error)]
pub enum ConvertError {
    /// Its content.
    #[error("{name}: {fault}")]
    Content {
        /// Which file.
        name: String,
        /// Where and what.
        fault: Fault,
    },
    /// The content is not a recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

impl ConvertError {
    fn new(name: impl std::fmt::Display, fault: Fault) -> Self {
        Self::Content { name: name.to_string(), fault }
    }
}

/// A name in the file and its channel: `velocity=omega_rad_per_s*6.2832` for revolutions per second.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapping {
    /// Name in the file.
    pub name: String,
    /// The channel.
    pub channel: Channel,
    /// Factor for its values.
    pub factor: f64,
}

impl std::str::FromStr for Mapping {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = "expected NAME=CHANNEL or NAME=CHANNEL*FACTOR, for instance velocity=omega_rad_per_s*6.2832";
        // The names of some formats contain an equals sign; those of channels do not.
        let (name, right) = text.rsplit_once('=').ok_or(expected)?;
        let (column, factor) = right.split_once('*').unwrap_or((right, "1"));
        let channel = Channel::of_column(column.trim())
            .ok_or_else(|| format!("no channel is called \"{column}\"; there are {}", all_columns()))?;
        let is_one = |factor: &f64| factor.is_finite() && *factor != 0.0;
        let factor = factor.trim().parse().ok().filter(is_one);
        let factor = factor.ok_or_else(|| format!("the factor must be a number other than 0; {expected}"))?;
        Ok(Self { name: name.trim().into(), channel, factor })
    }
}

fn all_columns() -> String {
    Channel::ALL.map(Channel::column).join(", ")
}

/// Maps names of a file to channels: by the given mappings, otherwise by the name itself or the last part of its path.
#[derive(Clone, Debug, Default)]
pub struct Names(pub Vec<Mapping>);

impl Names {
    fn channel(&self, name: &str) -> Option<(Channel, f64)> {
        if let Some(mapping) = self.0.iter().find(|mapping| mapping.name == name) {
            return Some((mapping.channel, mapping.factor));
        }
        let last = name.rsplit('/').next().unwrap_or(name);
        Channel::of_column(last).map(|channel| (channel, 1.0))
    }
}

/// Values with their name in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    name: String,
    values: Vec<f64>,
}

/// A recording, and the names of the file that are not used.
#[derive(Debug)]
pub struct Converted {
    /// The recording.
    pub recording: Recording,
    /// Names without a known meaning.
    pub ignored: Vec<String>,
    /// Message about a file that ends too early.
    pub cut: Option<String>,
}

/// Reads a file's bytes. `dialect` is for CSV.
///
/// # Errors
/// [`ConvertError`] with the place.
pub fn read(
    name: &str,
    bytes: &[u8],
    format: Format,
    names: &Names,
    dialect: Dialect,
) -> Result<Converted, ConvertError> {
    let failed = |fault| ConvertError::new(name, fault);
    let whole = |(columns, ignored)| (columns, ignored, None);
    let (columns, ignored, cut) = match format {
        Format::Wpilog => wpilog::read(bytes, names).map(|log| (log.columns, log.ignored, log.cut)),
        Format::Csv if plotjuggler::is_one(bytes) => plotjuggler::read(bytes, names).map(whole),
        Format::Csv => csv::read(bytes, names, dialect).map(whole),
        Format::Plotjuggler => plotjuggler::read(bytes, names).map(whole),
        Format::Sysid => sysid::read(bytes).map(|columns| (columns, Vec::new(), None)),
        Format::Mat => mat::read(bytes, names).map(whole),
        Format::Npy => numpy::read_npy(bytes).map(|columns| (columns, Vec::new(), None)),
        Format::Npz => numpy::read_npz(bytes, names).map(whole),
    }
    .map_err(failed)?;
    Ok(Converted { cut, ..assembled(name, columns, ignored, names)? })
}

fn assembled(
    name: &str,
    columns: Vec<Column>,
    mut ignored: Vec<String>,
    names: &Names,
) -> Result<Converted, ConvertError> {
    let failed = |what: String| ConvertError::new(name, Fault::whole(what));
    let there = || columns.iter().map(|column| &column.name).chain(&ignored).cloned().collect::<Vec<_>>().join(", ");
    if let Some(mapping) = names.0.iter().find(|mapping| columns.iter().all(|column| column.name != mapping.name)) {
        let (missing, there) = (&mapping.name, there());
        return Err(failed(format!("there is no numeric column \"{missing}\"; there are {there}")));
    }
    if columns.iter().all(|column| names.channel(&column.name).is_none()) {
        return Err(failed(format!(
            "no known channel among {}; map one, for instance --map speed=omega_rad_per_s; channels are {}",
            there(),
            all_columns()
        )));
    }
    let mut recording = Recording::new(name);
    let mut first: Option<(String, usize)> = None;
    for column in columns {
        let Some((channel, factor)) = names.channel(&column.name) else {
            ignored.push(column.name);
            continue;
        };
        let (other, length) = first.get_or_insert_with(|| (column.name.clone(), column.values.len()));
        if *length != column.values.len() {
            let (this, own) = (&column.name, column.values.len());
            return Err(failed(format!(
                "{this} has {own} values and {other} has {length}: cut or resample them to the same times"
            )));
        }
        if recording.get(channel).is_some() {
            let column = channel.column();
            return Err(failed(format!("two names map to {column}: map one of them to another channel")));
        }
        recording.set(channel, column.values.into_iter().map(|value| value * factor).collect());
    }
    recording.check()?;
    Ok(Converted { recording, ignored, cut: None })
}

/// The bytes of a file. `dialect` is for CSV; `renamed` maps channels to other names in the file.
///
/// # Errors
/// [`ConvertError`] where the format cannot hold this recording.
pub fn write(
    recording: &Recording,
    format: Format,
    renamed: &[(Channel, String)],
    dialect: Dialect,
) -> Result<Vec<u8>, ConvertError> {
    let columns: Vec<Column> = recording
        .channels()
        .map(|channel| {
            let renamed = renamed.iter().find(|(of, _)| *of == channel).map(|(_, name)| name.clone());
            let values = recording.get(channel).expect("it is one of its channels").to_vec();
            Column { name: renamed.unwrap_or_else(|| channel.column().into()), values }
        })
        .collect();
    let is_another = |(at, column): &(usize, &Column)| columns[..*at].iter().any(|other| other.name == column.name);
    if let Some((_, column)) = columns.iter().enumerate().find(is_another) {
        let what = format!("two columns would be called {}: choose another name with --rename", column.name);
        return Err(ConvertError::new(&recording.name, Fault::whole(what)));
    }
    match format {
        Format::Csv if renamed.is_empty() && dialect == Dialect::default() => Ok(recording.to_csv().into_bytes()),
        Format::Csv => csv::write(&columns, dialect),
        Format::Plotjuggler => plotjuggler::write(recording, &columns),
        Format::Sysid => sysid::write(recording),
        Format::Wpilog => wpilog::write(recording, &columns),
        Format::Mat => mat::write(&columns),
        Format::Npy => Ok(numpy::write_npy(&columns)),
        Format::Npz => numpy::write_npz(&columns),
    }
    .map_err(|fault| ConvertError::new(&recording.name, fault))
}

/// Times of a recording, for formats that need them.
fn times(recording: &Recording) -> Result<&[f64], Fault> {
    recording
        .time_s()
        .ok_or_else(|| Fault::whole("a table without t_s cannot be a time series: use CSV, .mat or NumPy"))
}

#[cfg(test)]
mod tests;

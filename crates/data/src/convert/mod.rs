//! Recordings to and from the formats of other tools, one file each.
//!
//! Reading returns the `Content` of a file under its own names. [`Mapping`] says which names are which channels.
//! Writing starts from a [`Recording`].

mod csv;
mod mat;
mod mat73;
mod mat_objects;
mod numpy;
mod office_open;
mod older_excel;
mod open_document;
mod plotjuggler;
mod spreadsheet;
mod sysid;
mod wpilog;

use crate::assembled;
use crate::content::{Column, Content};
use crate::mapping::Mapping;
use crate::recording::{Channel, Recording, RecordingError};
use crate::{table, text_encoding};
use std::path::Path;

pub use crate::table::Dialect;

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
    /// MATLAB level 5 and 7.3.
    Mat,
    /// Spreadsheets of Office programs.
    Spreadsheet,
    /// `NumPy`, one array.
    Npy,
    /// `NumPy`, several arrays.
    Npz,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 8] =
        [Self::Csv, Self::Plotjuggler, Self::Sysid, Self::Wpilog, Self::Mat, Self::Spreadsheet, Self::Npy, Self::Npz];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Plotjuggler => "plotjuggler",
            Self::Sysid => "sysid",
            Self::Wpilog => "wpilog",
            Self::Mat => "mat",
            Self::Spreadsheet => "spreadsheet",
            Self::Npy => "npy",
            Self::Npz => "npz",
        }
    }

    /// What a file of this format holds, for a help text.
    pub const fn description(self) -> &'static str {
        match self {
            Self::Csv => "A table, also of an instrument or a serial monitor (.csv, .tsv, .txt, .lvm, .log, .dat)",
            Self::Plotjuggler => "CSV of PlotJuggler: times in `__time`, cells may be empty",
            Self::Sysid => "Legacy JSON of WPILib SysId: four tests, rotations (.json)",
            Self::Wpilog => "WPILib data log 1.0 (.wpilog)",
            Self::Mat => "MATLAB: vectors, matrices, structures, Simulink signals (.mat); HDF5 (.h5)",
            Self::Spreadsheet => "Spreadsheet of an Office program, reading only (.xlsx, .xls, .ods)",
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
            "csv" | "tsv" | "txt" | "lvm" | "log" | "dat" => Ok(Self::Csv),
            "json" => Ok(Self::Sysid),
            "wpilog" => Ok(Self::Wpilog),
            "mat" | "h5" | "hdf5" => Ok(Self::Mat),
            "xlsx" | "xlsm" | "xlsb" | "xls" | "ods" => Ok(Self::Spreadsheet),
            "npy" => Ok(Self::Npy),
            "npz" => Ok(Self::Npz),
            _ => Err(ConvertError::new(
                path.display(),
                Fault::whole(
                    "no format has this ending: expected .csv, .tsv, .txt, .lvm, .xlsx, .ods, .json (SysId), .wpilog, .mat, .npy or .npz. Or give the format with --from or --to",
                ),
            )),
        }
    }

    /// The format of a file's content, by its first bytes, or else by the ending of its name.
    pub fn of_content(path: &Path, bytes: &[u8]) -> Self {
        let by_ending = Self::of_path(path).ok();
        if bytes.starts_with(b"WPILOG") {
            return Self::Wpilog;
        }
        if bytes.starts_with(b"MATLAB 5.0") || mat73::is_one(bytes) {
            return Self::Mat;
        }
        if bytes.starts_with(b"\x93NUMPY") {
            return Self::Npy;
        }
        // Archives, and the older files of Office programs.
        if bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"\xd0\xcf\x11\xe0") {
            return if by_ending == Some(Self::Npz) { Self::Npz } else { Self::Spreadsheet };
        }
        // An object on each line is a table; SysId's file is one object.
        let lines = bytes.split(|byte| *byte == b'\n').take(2);
        let objects = lines.filter(|line| line.trim_ascii_start().starts_with(b"{\"")).count();
        if by_ending == Some(Self::Sysid) && objects == 2 {
            return Self::Csv;
        }
        by_ending.unwrap_or(Self::Csv)
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

/// A recording, and the names of the file that are not used.
#[derive(Debug)]
pub struct Converted {
    /// The recording.
    pub recording: Recording,
    /// Message about a file that ends too early.
    pub cut: Option<String>,
}

/// A file whose ending is that of CSV.
const NO_TEXT: &str = "this is not text, but a table is expected. Give its format with --from";

/// Reads a file's bytes. `dialect` is for text.
///
/// # Errors
/// [`ConvertError`] with the place.
pub fn read(
    name: &str,
    bytes: &[u8],
    format: Format,
    mappings: &[Mapping],
    dialect: Dialect,
) -> Result<Converted, ConvertError> {
    let failed = |fault| ConvertError::new(name, fault);
    let content = content(bytes, format, mappings, dialect).map_err(failed)?;
    let cut = content.cut.clone();
    let recording = assembled::recording(name, content, mappings).map_err(|what| failed(Fault::whole(what)))?;
    recording.check()?;
    Ok(Converted { recording, cut })
}

/// All that a file holds, with its own names.
///
/// # Errors
/// [`ConvertError`] with the place.
pub(crate) fn named_content(name: &str, bytes: &[u8], format: Format) -> Result<Content, ConvertError> {
    let failed = |fault| ConvertError::new(name, fault);
    // A log has many series, a file of MATLAB many variables: all are wanted.
    match format {
        Format::Wpilog => wpilog::read(bytes, true),
        Format::Mat if !mat73::is_one(bytes) => mat::read(bytes, &|_| true),
        Format::Npz => numpy::read_npz(bytes, &|_| true),
        _ => content(bytes, format, &[], Dialect::default()),
    }
    .map_err(failed)
}

/// What a file holds.
///
/// # Errors
/// [`Fault`] with the place.
fn content(bytes: &[u8], format: Format, mappings: &[Mapping], dialect: Dialect) -> Result<Content, Fault> {
    let is_wanted = |name: &str| {
        let is_channel = Channel::of_column(crate::mapping::last_part(name)).is_some();
        is_channel || mappings.iter().any(|mapping| mapping.name.contains(name))
    };
    match format {
        Format::Wpilog => wpilog::read(bytes, !mappings.is_empty()),
        Format::Csv => Ok(plotjuggler::series(text(bytes, dialect)?)),
        Format::Plotjuggler => plotjuggler::read(text(bytes, dialect)?),
        Format::Sysid => sysid::read(bytes),
        Format::Mat if mat73::is_one(bytes) => mat73::read(bytes),
        Format::Mat => mat::read(bytes, &is_wanted),
        Format::Spreadsheet => spreadsheet::read(bytes),
        Format::Npy => numpy::read_npy(bytes),
        Format::Npz => numpy::read_npz(bytes, &is_wanted),
    }
}

fn text(bytes: &[u8], dialect: Dialect) -> Result<Content, Fault> {
    let text = text_encoding::decoded(bytes.to_vec()).or_else(|| text_encoding::decoded_with_noise(bytes));
    table::read(&text.ok_or_else(|| Fault::whole(NO_TEXT))?, dialect).map_err(Fault::whole)
}

/// So many letters of a name are kept. A damaged file may have one name of a megabyte for each column of a matrix.
const LONGEST_NAME: usize = 256;

/// So many bytes are unpacked of a file: more than a recording has. A small file may claim to hold more.
const MOST_BYTES: u64 = 1 << 30;
/// What is wrong with a file that holds more.
const TOO_MUCH: &str = "more than 1 GB in it: save the signals of one recording alone";

/// The begin of a name.
fn shortened(name: &str) -> &str {
    name.char_indices().nth(LONGEST_NAME).map_or(name, |(end, _)| &name[..end])
}

/// The columns of a matrix, called `name/1`, `name/2` and so on. Samples stand along its longer side.
fn matrix(name: &str, values: &[f64], rows: usize, columns: usize, by_columns: bool) -> Vec<Column> {
    let at = |row: usize, column: usize| if by_columns { column * rows + row } else { row * columns + column };
    let (samples, signals) = (rows.max(columns), rows.min(columns));
    let of = |signal: usize| {
        let place = |sample: usize| if rows >= columns { at(sample, signal) } else { at(signal, sample) };
        (0..samples).map(|sample| values[place(sample)]).collect()
    };
    let name = shortened(name);
    let path = |signal: usize| if name.is_empty() { signal.to_string() } else { format!("{name}/{signal}") };
    (0..signals).map(|signal| Column::new(path(signal + 1), of(signal))).collect()
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
            Column::new(renamed.unwrap_or_else(|| channel.column().to_owned()), values)
        })
        .collect();
    let is_another = |(at, column): &(usize, &Column)| columns[..*at].iter().any(|other| other.name == column.name);
    if let Some((_, column)) = columns.iter().enumerate().find(is_another) {
        let what = format!("two columns would be called {}: choose another name with --rename", column.name);
        return Err(ConvertError::new(&recording.name, Fault::whole(what)));
    }
    match format {
        Format::Csv => csv::write(&columns, dialect),
        Format::Plotjuggler => plotjuggler::write(recording, &columns),
        Format::Sysid => sysid::write(recording),
        Format::Wpilog => wpilog::write(recording, &columns),
        Format::Mat => mat::write(&columns),
        Format::Spreadsheet => Err(Fault::whole(
            "spreadsheets are read only: write CSV, which every spreadsheet opens, with --to-delimiter and --to-decimal-comma if needed",
        )),
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
mod kinds;
#[cfg(test)]
mod small_files;
#[cfg(test)]
mod tests;

//! Tables with a header line: other delimiters, decimal commas.

use super::{Column, Fault, Names};
use csv::{ReaderBuilder, WriterBuilder};
use std::borrow::Cow;

/// How a table is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dialect {
    /// What stands between values; none: the one of semicolon, tab and comma that the header line has most of.
    pub delimiter: Option<u8>,
    /// Numbers are 1,5 instead of 1.5.
    pub decimal_comma: bool,
}

/// The one of semicolon, tab and comma that the header line has most of.
fn likely_delimiter(table: &[u8]) -> u8 {
    let header = table.split(|byte| *byte == b'\n').find(|line| !line.starts_with(b"#")).unwrap_or_default();
    let count = |delimiter: u8| header.iter().filter(|byte| **byte == delimiter).count();
    (*b",;\t").into_iter().max_by_key(|delimiter| count(*delimiter)).unwrap_or(b',')
}

/// The delimiter that a spreadsheet's first line `sep=;` says, and what comes after that line.
fn after_separator(text: &[u8]) -> (Option<u8>, &[u8]) {
    let said = text.strip_prefix(b"sep=").and_then(|rest| {
        let end = rest.iter().position(|byte| *byte == b'\n')?;
        Some((*rest.first()?, &rest[end + 1..]))
    });
    said.map_or((None, text), |(delimiter, table)| (Some(delimiter), table))
}

/// The text without its byte order mark; of UTF-16, in which spreadsheets export "Unicode text", as well.
fn in_utf_8(bytes: &[u8]) -> Result<Cow<'_, [u8]>, Fault> {
    let from = |pair: fn([u8; 2]) -> u16, rest: &[u8]| {
        let units: Vec<u16> = rest.chunks_exact(2).map(|unit| pair([unit[0], unit[1]])).collect();
        let text = String::from_utf16(&units).map_err(|_| Fault::whole("begins as UTF-16, but is none"));
        text.map(|text| Cow::Owned(text.into_bytes()))
    };
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => Ok(Cow::Borrowed(rest)),
        [0xff, 0xfe, rest @ ..] => from(u16::from_le_bytes, rest),
        [0xfe, 0xff, rest @ ..] => from(u16::from_be_bytes, rest),
        _ => Ok(Cow::Borrowed(bytes)),
    }
}

/// Columns that are channels, and the names of the others.
pub fn read(bytes: &[u8], names: &Names, dialect: Dialect) -> Result<(Vec<Column>, Vec<String>), Fault> {
    let text = in_utf_8(bytes)?;
    let (said, table) = after_separator(&text);
    let delimiter = dialect.delimiter.or(said).unwrap_or_else(|| likely_delimiter(table));
    let mut reader =
        ReaderBuilder::new().delimiter(delimiter).comment(Some(b'#')).trim(csv::Trim::All).from_reader(table);
    let line_fault = |error: csv::Error| {
        let line = error.position().map_or(1, csv::Position::line);
        let delimiter = delimiter as char;
        Fault::at(
            format_args!("line {line}"),
            format!("{error}; values were taken apart at {delimiter:?}, another is said with --delimiter"),
        )
    };
    let header = reader.headers().map_err(line_fault)?.clone();
    let wanted: Vec<bool> = header.iter().map(|name| names.channel(name).is_some()).collect();
    let mut columns: Vec<Column> = header.iter().map(|name| Column { name: name.into(), values: Vec::new() }).collect();
    for row in reader.records() {
        let row = row.map_err(line_fault)?;
        let line = row.position().map_or(0, csv::Position::line);
        for ((column, wanted), text) in columns.iter_mut().zip(&wanted).zip(&row) {
            if *wanted {
                let value = number(text, dialect.decimal_comma);
                column
                    .values
                    .push(value.map_err(|what| Fault::at(format_args!("line {line}, column {}", column.name), what))?);
            }
        }
    }
    let (used, unused): (Vec<_>, Vec<_>) = columns.into_iter().zip(wanted).partition(|(_, wanted)| *wanted);
    // A delimiter at the end of each line makes a column without a name.
    let names = unused.into_iter().map(|(column, _)| column.name).filter(|name| !name.is_empty()).collect();
    Ok((used.into_iter().map(|(column, _)| column).collect(), names))
}

/// A number; empty, `nan` and `NA` stand for a missing sample.
pub fn number(text: &str, decimal_comma: bool) -> Result<f64, String> {
    if text.is_empty() || text.eq_ignore_ascii_case("nan") || text == "NA" {
        return Ok(f64::NAN);
    }
    let parsed = if decimal_comma { text.replace(',', ".").parse() } else { text.parse() };
    let hint = if text.contains(',') && !decimal_comma { "; for decimal commas add --decimal-comma" } else { "" };
    parsed
        .ok()
        .filter(|value: &f64| value.is_finite())
        .ok_or_else(|| format!("expected a number, found \"{text}\"{hint}"))
}

/// A table with every digit that the numbers have.
pub fn write(columns: &[Column], dialect: Dialect) -> Result<Vec<u8>, Fault> {
    let delimiter = dialect.delimiter.unwrap_or(if dialect.decimal_comma { b';' } else { b',' });
    if dialect.decimal_comma && delimiter == b',' {
        return Err(Fault::whole(
            "a comma cannot stand both between numbers and within them: choose another --to-delimiter",
        ));
    }
    let mut writer = WriterBuilder::new().delimiter(delimiter).from_writer(Vec::new());
    let failed = |error: csv::Error| Fault::whole(error.to_string());
    writer.write_record(columns.iter().map(|column| &column.name)).map_err(failed)?;
    for row in 0..columns.first().map_or(0, |column| column.values.len()) {
        let cells = columns.iter().map(|column| match column.values[row] {
            value if value.is_nan() => String::new(),
            value if dialect.decimal_comma => value.to_string().replace('.', ","),
            value => value.to_string(),
        });
        writer.write_record(cells).map_err(failed)?;
    }
    writer.into_inner().map_err(|error| Fault::whole(error.to_string()))
}

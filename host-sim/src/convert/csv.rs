//! Tables with a header line: other delimiters, decimal commas.

use super::{Column, Fault, Names};
use csv::{ReaderBuilder, WriterBuilder};

/// How a table is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dialect {
    /// What stands between values; none: the one of semicolon, tab and comma that the header line has most of.
    pub delimiter: Option<u8>,
    /// Numbers are 1,5 instead of 1.5.
    pub decimal_comma: bool,
}

impl Dialect {
    fn delimiter_of(self, bytes: &[u8]) -> u8 {
        let header = bytes.split(|byte| *byte == b'\n').find(|line| !line.starts_with(b"#")).unwrap_or_default();
        let count = |delimiter: u8| header.iter().filter(|byte| **byte == delimiter).count();
        let likely = (*b",;\t").into_iter().max_by_key(|delimiter| count(*delimiter)).unwrap_or(b',');
        self.delimiter.unwrap_or(likely)
    }
}

/// Columns that are channels, and the names of the others.
pub fn read(bytes: &[u8], names: &Names, dialect: Dialect) -> Result<(Vec<Column>, Vec<String>), Fault> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let delimiter = dialect.delimiter_of(bytes);
    let mut reader =
        ReaderBuilder::new().delimiter(delimiter).comment(Some(b'#')).trim(csv::Trim::All).from_reader(bytes);
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
    let names = unused.into_iter().map(|(column, _)| column.name).collect();
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

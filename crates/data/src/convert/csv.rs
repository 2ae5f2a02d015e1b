//! Tables with a header line: other delimiters, decimal commas.

use super::{Column, Fault, Names};
use crate::delimited::{self, Delimited};
use crate::text_encoding;
use csv::WriterBuilder;

/// Dialect of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dialect {
    /// Separator of values. `None`: of semicolon, tab and comma the one that is most frequent in the header line.
    pub delimiter: Option<u8>,
    /// Numbers use a decimal comma: 1,5 for 1.5.
    pub decimal_comma: bool,
}

/// A file whose ending is that of CSV.
const NO_TEXT: &str =
    "this is not text, but a CSV table is expected. Give its format with --from: mat, npy, npz or wpilog";

/// Columns that are channels, and the names of the others.
pub fn read(bytes: &[u8], names: &Names, dialect: Dialect) -> Result<(Vec<Column>, Vec<String>), Fault> {
    let text = text_encoding::decoded(bytes.to_vec()).ok_or_else(|| Fault::whole(NO_TEXT))?;
    let mut table = Delimited::new(&text);
    table.delimiter = dialect.delimiter.unwrap_or(table.delimiter);
    let decimal_comma = dialect.decimal_comma || table.has_decimal_commas();
    let mut reader = table.reader();
    let line_fault = |error: csv::Error| {
        let (line, delimiter, fault) =
            (table.line(error.position()), table.delimiter as char, delimited::fault(&error));
        Fault::at(
            format_args!("line {line}"),
            format!("{fault}; the separator was taken to be {delimiter:?}, give another one with --delimiter"),
        )
    };
    let header = reader.headers().map_err(line_fault)?.clone();
    let wanted: Vec<bool> = header.iter().map(|name| names.channel(name).is_some()).collect();
    let mut columns: Vec<Column> = header.iter().map(|name| Column { name: name.into(), values: Vec::new() }).collect();
    for row in reader.records() {
        let row = row.map_err(line_fault)?;
        let line = table.line(row.position());
        for ((column, wanted), text) in columns.iter_mut().zip(&wanted).zip(&row) {
            if *wanted {
                let value = number(text, decimal_comma);
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

/// A number, or why it is not one.
pub fn number(text: &str, decimal_comma: bool) -> Result<f64, String> {
    let hint = if text.contains(',') && !decimal_comma { "; for decimal commas add --decimal-comma" } else { "" };
    delimited::number(text, decimal_comma).ok_or_else(|| format!("expected a number, found \"{text}\"{hint}"))
}

/// A table with all digits of its numbers.
pub fn write(columns: &[Column], dialect: Dialect) -> Result<Vec<u8>, Fault> {
    let delimiter = dialect.delimiter.unwrap_or(if dialect.decimal_comma { b';' } else { b',' });
    if dialect.decimal_comma && delimiter == b',' {
        return Err(Fault::whole(
            "the comma cannot be both the separator and the decimal mark: choose another --to-delimiter",
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

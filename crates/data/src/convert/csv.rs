//! Tables with a header line, for other programs: delimiters, decimal commas.

use super::{Column, Fault};
use crate::table::Dialect;
use csv::WriterBuilder;

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

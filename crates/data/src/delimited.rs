//! Text tables of spreadsheets and other programs: separators, decimal commas, a first line `sep=;`.

use csv::{Error, ErrorKind, Reader, ReaderBuilder, Trim};

/// The text of a table, and its dialect.
#[derive(Clone, Copy, Debug)]
pub struct Delimited<'a> {
    /// Separator of values.
    pub delimiter: u8,
    /// The text from the header line on.
    text: &'a str,
    /// Number of lines before it.
    skipped: u64,
}

impl<'a> Delimited<'a> {
    /// Finds the separator. A spreadsheet's first line `sep=;` gives it. Otherwise it is the one of comma, semicolon
    /// and tab that is most frequent in the header line.
    pub fn new(text: &'a str) -> Self {
        let said = text.strip_prefix("sep=").and_then(|rest| rest.split_once('\n'));
        if let Some((sign, text)) = said
            && let Some(&delimiter) = sign.as_bytes().first()
        {
            return Self { delimiter, text, skipped: 1 };
        }
        Self { delimiter: likely_delimiter(text), text, skipped: 0 }
    }

    /// Whether numbers may have a decimal comma. Only semicolons as separators allow it.
    pub fn has_decimal_commas(&self) -> bool {
        self.delimiter == b';'
    }

    /// Splits the table; lines that begin with # are left out.
    pub fn reader(&self) -> Reader<&'a [u8]> {
        let mut reader = ReaderBuilder::new();
        reader.delimiter(self.delimiter).comment(Some(b'#')).trim(Trim::All).from_reader(self.text.as_bytes())
    }

    /// Line number in the file for a line number of the reader.
    pub fn line(&self, of_reader: Option<&csv::Position>) -> u64 {
        of_reader.map_or(1, csv::Position::line) + self.skipped
    }

    /// Names of the columns.
    ///
    /// # Errors
    /// The fault and its place.
    pub fn header(&self) -> Result<Vec<String>, String> {
        let mut reader = self.reader();
        let header = reader.headers().map_err(|error| self.failure(&error))?;
        Ok(header.iter().map(String::from).collect())
    }

    /// The numbers of one column, without missing ones.
    ///
    /// # Errors
    /// The fault and its place.
    pub fn column(&self, name: &str) -> Result<Vec<f64>, String> {
        let mut values: Vec<f64> = self.cells(name)?.into_iter().map(|cell| cell.value).collect();
        values.retain(|value| !value.is_nan());
        Ok(values)
    }

    /// The cells of one column, with missing ones.
    ///
    /// # Errors
    /// The fault and its place.
    pub fn cells(&self, name: &str) -> Result<Vec<Cell>, String> {
        let header = self.header()?;
        let place = header
            .iter()
            .position(|column| column == name)
            .ok_or_else(|| format!("the table needs a column {name}, but has {}", header.join(", ")))?;
        let mut cells = Vec::new();
        for row in self.reader().records() {
            let row = row.map_err(|error| self.failure(&error))?;
            let text = row.get(place).unwrap_or_default();
            let value = number(text, self.has_decimal_commas()).ok_or_else(|| {
                format!("line {}, column {name}: expected a number, found \"{text}\"", self.line(row.position()))
            })?;
            cells.push(Cell { text: text.into(), value });
        }
        Ok(cells)
    }

    fn failure(&self, error: &Error) -> String {
        format!("line {}: {}", self.line(error.position()), fault(error))
    }
}

/// A number as text.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Number of digits that are given.
    pub text: String,
    /// NaN if it is missing.
    pub value: f64,
}

fn likely_delimiter(table: &str) -> u8 {
    let header = table.lines().find(|line| !line.starts_with('#')).unwrap_or_default();
    let count = |delimiter: &u8| header.bytes().filter(|byte| byte == delimiter).count();
    // `max_by_key` returns the last of several equal ones.
    (*b"\t;,").into_iter().max_by_key(count).unwrap_or(b',')
}

/// Fault of a row, without its place.
pub fn fault(error: &Error) -> String {
    match error.kind() {
        ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} values, but the header line has {expected_len}")
        }
        _ => error.to_string(),
    }
}

/// A number; empty, `nan` and `NA` stand for a missing one.
pub fn number(text: &str, decimal_comma: bool) -> Option<f64> {
    if text.is_empty() || text.eq_ignore_ascii_case("nan") || text == "NA" {
        return Some(f64::NAN);
    }
    let parsed = if decimal_comma { text.replacen(',', ".", 1).parse() } else { text.parse() };
    parsed.ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_column_of_any_table() {
        let read = |text: &str| Delimited::new(text).column("resistance_ohm");
        for text in [
            "angle_deg,resistance_ohm\n0,5.8\n20,6.1\n",
            "# a meter\nangle_deg;resistance_ohm;\r\n0;5,8;\r\n10;;\r\n20,5;6,1;\r\n",
            "sep=;\r\nresistance_ohm\r\n5,8\r\n6,1\r\n",
            "angle_deg\tresistance_ohm\n0\t5.8\n20\t6.1\n",
        ] {
            assert_eq!(read(text).unwrap(), [5.8, 6.1], "{text}");
        }
        let message = |text: &str| read(text).unwrap_err();
        assert_eq!(message("ohm,deg\n1,2\n"), "the table needs a column resistance_ohm, but has ohm, deg");
        let third = "line 3, column resistance_ohm: expected a number, found \"x\"";
        assert_eq!(message("sep=;\nresistance_ohm\nx\n"), third);
        assert_eq!(message("a,resistance_ohm\n1,2\n1\n"), "line 3: 1 values, but the header line has 2");
    }
}

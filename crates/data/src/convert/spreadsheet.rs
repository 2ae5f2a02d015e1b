//! Spreadsheets of Office programs (.xlsx, .xlsm, .xlsb, .xls, .ods): the first sheet with a table of numbers.

use super::Fault;
use crate::content::Content;
use crate::table::{self, Dialect};
use calamine::{Data, ExcelDateTime, Range, Reader as _, open_workbook_auto_from_rs};
use std::fmt::Write as _;
use std::io::Cursor;

/// What stands between the cells of a sheet as text.
const BETWEEN: u8 = b'\t';

/// Reads a workbook.
pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    let damaged = |error: &dyn std::fmt::Display| {
        Fault::whole(format!("this spreadsheet cannot be read ({error}): save the sheet as CSV"))
    };
    let mut book = open_workbook_auto_from_rs(Cursor::new(bytes)).map_err(|error| damaged(&error))?;
    let names = book.sheet_names();
    let mut longest: Option<(usize, Content)> = None;
    let mut why = "it has no sheet with a table of numbers".to_owned();
    for (index, name) in names.iter().enumerate() {
        let range = match book.worksheet_range_at(index) {
            Some(Ok(range)) if !range.is_empty() => range,
            _ => continue,
        };
        match table::read(&text(&range), Dialect { delimiter: Some(BETWEEN), decimal_comma: false }) {
            Ok(content) => {
                let rows = content.lines.len();
                if longest.as_ref().is_none_or(|(most, _)| rows > *most) {
                    longest = Some((rows, content.of_sheet(name, names.len())));
                }
            }
            Err(what) => why = format!("sheet {name}: {what}"),
        }
    }
    longest.map(|(_, content)| content).ok_or_else(|| Fault::whole(why))
}

impl Content {
    fn of_sheet(mut self, name: &str, sheets: usize) -> Self {
        if sheets > 1 {
            self.notes.push(format!("Of {sheets} sheets the one with the most rows is read: {name}."));
        }
        self
    }
}

/// A sheet as text, with the rows at their numbers.
fn text(range: &Range<Data>) -> String {
    let mut text = "\n".repeat(range.start().map_or(0, |(row, _)| row as usize));
    for row in range.rows() {
        for (index, cell) in row.iter().enumerate() {
            if index > 0 {
                text.push(char::from(BETWEEN));
            }
            write_cell(&mut text, cell);
        }
        text.push('\n');
    }
    text
}

fn write_cell(text: &mut String, cell: &Data) {
    match cell {
        Data::Int(value) => _ = write!(text, "{value}"),
        Data::Float(value) => _ = write!(text, "{value}"),
        Data::Bool(value) => _ = write!(text, "{value}"),
        Data::DateTime(moment) => *text += &moment_text(moment),
        Data::DateTimeIso(words) | Data::String(words) => *text += &words.replace(['\t', '\n', '\r', '"'], " "),
        _ => {}
    }
}

fn moment_text(moment: &ExcelDateTime) -> String {
    let (year, month, day, hour, minute, second, millisecond) = moment.to_ymd_hms_milli();
    let clock = format!("{hour:02}:{minute:02}:{second:02}.{millisecond:03}");
    // A day before the first one means a time of day.
    if moment.as_f64() < 1.0 { clock } else { format!("{year:04}-{month:02}-{day:02} {clock}") }
}

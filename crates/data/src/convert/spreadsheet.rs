//! Spreadsheets of Office programs (.xlsx, .xlsm, .xlsb, .xls, .ods): the first sheet with a table of numbers.

use super::{Fault, MOST_BYTES, TOO_MUCH, office_open, older_excel, open_document};
use crate::content::Content;
use crate::table::{self, Dialect};
use calamine::{Cell, Data, DataRef, ExcelDateTime, Range, Reader as _, Sheets, open_workbook_auto_from_rs};
use std::fmt::Write as _;
use std::io::{Cursor, Read, copy, sink};
use zip::ZipArchive;

/// What stands between the cells of a sheet as text.
const BETWEEN: u8 = b'\t';

/// Reads a workbook.
pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    read_within(bytes, MOST_BYTES)
}

/// Reads a workbook that is unpacked to less than `most_bytes`.
pub(super) fn read_within(bytes: &[u8], most_bytes: u64) -> Result<Content, Fault> {
    check_archive(bytes, most_bytes)?;
    office_open::check(bytes)?;
    open_document::check(bytes, MOST_CELLS)?;
    older_excel::check(bytes, MOST_CELLS)?;
    let mut book = open_workbook_auto_from_rs(Cursor::new(bytes))
        .map_err(|error| Fault::whole(format!("{}. {AS_CSV}", what_is_wrong(bytes, &error))))?;
    let names = book.sheet_names();
    let mut longest: Option<(usize, Content)> = None;
    let mut why = "it has no sheet with a table of numbers".to_owned();
    for name in &names {
        let range = match sheet(&mut book, name) {
            Ok(range) if !range.is_empty() => range,
            Ok(_) => continue,
            Err(what) => {
                why = format!("sheet {name}: {what}");
                continue;
            }
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

/// Refuses an archive whose parts are unpacked to more than `most_bytes`. What an archive says of its sizes may be wrong.
fn check_archive(bytes: &[u8], most_bytes: u64) -> Result<(), Fault> {
    let Ok(mut archive) = ZipArchive::new(Cursor::new(bytes)) else { return Ok(()) };
    let mut left_bytes = most_bytes;
    for index in 0..archive.len() {
        // Of a damaged part only what comes before the damage can be read, here and later.
        let Ok(part) = archive.by_index(index) else { continue };
        let name = part.name().map_or_else(|_| format!("part {}", index + 1), Into::into);
        let mut part = part.take(left_bytes);
        let _ = copy(&mut part, &mut sink());
        left_bytes = part.limit();
        if left_bytes == 0 {
            return Err(Fault::at(name, format!("the file has {TOO_MUCH}")));
        }
    }
    Ok(())
}

/// So many cells are read: those of a million rows of 32 columns.
const MOST_CELLS: u64 = 1 << 25;

type Book<'a> = Sheets<Cursor<&'a [u8]>>;

/// The cells of a sheet. One far from the table makes a rectangle of 10^10 cells of a small file.
fn sheet(book: &mut Book<'_>, name: &str) -> Result<Range<Data>, String> {
    let cells = match book {
        Sheets::Xlsx(book) => {
            let mut cells = book.worksheet_cells_reader(name).map_err(unreadable)?;
            all_cells(|| cells.next_cell().map_err(unreadable))?
        }
        Sheets::Xlsb(book) => {
            let mut cells = book.worksheet_cells_reader(name).map_err(unreadable)?;
            all_cells(|| cells.next_cell().map_err(unreadable))?
        }
        // The other formats are read when the book is opened.
        Sheets::Xls(_) | Sheets::Ods(_) => return book.worksheet_range(name).map_err(unreadable),
    };
    let is_outside = |at: &(u32, u32)| at.0 >= office_open::MOST_ROWS || at.1 >= office_open::MOST_COLUMNS;
    if let Some((row, column)) = cells.iter().map(Cell::get_position).find(is_outside) {
        return Err(office_open::outside(&format!("row {}, column {}", u64::from(row) + 1, u64::from(column) + 1)));
    }
    let side = |of: fn(&Cell<Data>) -> u32| {
        let (least, most) = cells.iter().map(of).fold((u32::MAX, 0), |(least, most), at| (least.min(at), most.max(at)));
        u64::from(most.saturating_sub(least)) + 1
    };
    let (rows, columns) = (side(|cell| cell.get_position().0), side(|cell| cell.get_position().1));
    if rows * columns > MOST_CELLS {
        let count = cells.len();
        return Err(format!("its {count} cells are {}", open_document::far_apart(rows, columns)));
    }
    Ok(Range::from_sparse(cells))
}

fn unreadable(error: impl std::fmt::Display) -> String {
    format!("it cannot be read ({error})")
}

/// All cells with something in them.
fn all_cells<'a>(
    mut next: impl FnMut() -> Result<Option<Cell<DataRef<'a>>>, String>,
) -> Result<Vec<Cell<Data>>, String> {
    let mut cells = Vec::new();
    while let Some(cell) = next()? {
        if *cell.get_value() != DataRef::Empty {
            cells.push(Cell::new(cell.get_position(), cell.get_value().clone().into()));
        }
        if cells.len() as u64 > MOST_CELLS {
            return Err(format!("more than {MOST_CELLS} cells are in it: save the rows of one recording alone"));
        }
    }
    Ok(cells)
}

/// What a person does with a spreadsheet that cannot be read.
const AS_CSV: &str =
    "Open it in the program that wrote it and save the sheet as CSV, or run `soffice --headless --convert-to csv FILE`";

/// Why a workbook cannot be opened. An archive is named with what it lacks.
fn what_is_wrong(bytes: &[u8], error: &impl std::fmt::Display) -> String {
    let unread = format!("this spreadsheet cannot be read ({error})");
    let Ok(archive) = ZipArchive::new(Cursor::new(bytes)) else { return unread };
    let parts: Vec<String> = archive.file_names().flatten().map(Into::into).collect();
    let has = |name: &str| parts.iter().any(|part| part == name);
    let is_office = parts.iter().any(|part| part.starts_with("xl/"));
    match (is_office, has("xl/workbook.xml"), has("content.xml")) {
        (true, false, _) => {
            let parts = first_of(&parts);
            format!("this .xlsx is not whole: it has no xl/workbook.xml, the list of its sheets; it has {parts}")
        }
        (false, _, false) => format!("this archive is no spreadsheet: it has {}", first_of(&parts)),
        _ => unread,
    }
}

/// The first names of many.
fn first_of(parts: &[String]) -> String {
    const MOST: usize = 5;
    match parts.len() {
        0 => "no file in it".into(),
        count if count > MOST => format!("{} and {} more", parts[..MOST].join(", "), count - MOST),
        _ => parts.join(", "),
    }
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

//! The places of cells that an Office Open XML workbook (.xlsx, .xlsm) names, before it is read. The reader computes with
//! them without a limit: a damaged one would wrap to another row.

use super::Fault;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::io::{BufReader, Cursor, Read, Seek};
use zip::ZipArchive;

/// Rows and columns of the largest sheet (ECMA-376; Excel specifications and limits).
pub const MOST_ROWS: u32 = 1_048_576;
pub const MOST_COLUMNS: u32 = 16_384;

/// The folder of sheets and what belongs to them.
const SHEETS: &str = "xl/";

/// Refuses a workbook in which a row, a cell or the range of a sheet stands outside of any sheet.
pub fn check(bytes: &[u8]) -> Result<(), Fault> {
    let Ok(mut archive) = ZipArchive::new(Cursor::new(bytes)) else { return Ok(()) };
    let parts: Vec<String> = archive.file_names().flatten().map(Into::into).collect();
    let is_of_sheets = |part: &&String| part.starts_with(SHEETS) && part.ends_with(".xml");
    parts.iter().filter(is_of_sheets).try_for_each(|part| check_part(&mut archive, part))
}

/// What is not XML to its end is read, and refused, up to there.
fn check_part(archive: &mut ZipArchive<impl Read + Seek>, name: &str) -> Result<(), Fault> {
    let Ok(part) = archive.by_name(name) else { return Ok(()) };
    let mut reader = Reader::from_reader(BufReader::new(part));
    let config = reader.config_mut();
    (config.check_end_names, config.check_comments, config.allow_unmatched_ends) = (false, false, true);
    let mut buffer = Vec::new();
    loop {
        buffer.clear();
        let place = match reader.read_event_into(&mut buffer) {
            Ok(Event::Start(element) | Event::Empty(element)) => place_outside(&element),
            Ok(Event::Eof) | Err(_) => return Ok(()),
            Ok(_) => None,
        };
        if let Some(place) = place {
            return Err(Fault::at(name, outside(&place)));
        }
    }
}

/// What is wrong with a cell at this place.
pub fn outside(place: &str) -> String {
    let place: String = place.chars().take(40).collect();
    format!(
        "a cell is said to be at {place}, and a sheet ends at XFD{MOST_ROWS}: the file is damaged. Save it again from the \
         program that wrote it, or save the sheet as CSV"
    )
}

/// The place that an element names, if no sheet has it.
fn place_outside(element: &BytesStart<'_>) -> Option<String> {
    let element_name = element.local_name();
    element.attributes().with_checks(false).flatten().find_map(|attribute| {
        let said = &*attribute.value;
        let is_outside = match (element_name.as_ref(), attribute.key.as_ref()) {
            ("row" | "c", "r") => place(said).is_none(),
            ("dimension", "ref") => !is_a_range(said),
            _ => false,
        };
        is_outside.then(|| said.to_owned())
    })
}

/// Whether it ends after its begin.
fn is_a_range(said: &str) -> bool {
    let mut ends = said.split(':').map(place);
    match (ends.next().flatten(), ends.next(), ends.next()) {
        (Some(_), None, None) => true,
        (Some((row, column)), Some(Some((last_row, last_column))), None) => row <= last_row && column <= last_column,
        _ => false,
    }
}

/// Row and column of a place such as `B7`, from 1. A row alone has the column 0.
fn place(said: &str) -> Option<(u32, u32)> {
    let digits = said.trim_start_matches(|letter: char| letter.is_ascii_alphabetic());
    let letters = &said.as_bytes()[..said.len() - digits.len()];
    let column = letters.iter().try_fold(0_u32, |column, letter| {
        let column = 26 * column + u32::from(letter.to_ascii_uppercase() - b'A') + 1;
        (column <= MOST_COLUMNS).then_some(column)
    })?;
    let row = digits.parse().ok().filter(|row| (1..=MOST_ROWS).contains(row))?;
    Some((row, column))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_ends_at_its_last_cell() {
        assert_eq!(
            (place("B7"), place("XFD1048576"), place("12")),
            (Some((7, 2)), Some((1_048_576, 16_384)), Some((12, 0)))
        );
        for outside in ["A0", "A1048577", "XFE1", "A4294967297", "AAAAAAAAAAAAAAAAAAAA1", "", "A", "A-1", "A1B"] {
            assert_eq!(place(outside), None, "{outside}");
        }
        assert!(is_a_range("A1") && is_a_range("A1:B2") && is_a_range("C3:C3"));
        assert!(!is_a_range("B5:A1") && !is_a_range("A1:B2:C3") && !is_a_range("A1:"));
    }
}

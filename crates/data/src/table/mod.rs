//! Tables as people have them: any usual separator, lines before the header, a row of units, prefixes of a serial
//! monitor. Also `name:value` lines, broken lines, and numbers and times in the notations of other programs.
//!
//! What cannot be read is not guessed. It is counted, with the number of its first line.

pub mod cells;
mod header;
mod labels;
mod lines;
mod oscilloscope;
mod rows;

use crate::content::{Broken, Content};
use cells::Notation;
use header::Header;
use lines::{Line, Separator};
pub use rows::PREFIX;

/// Dialect of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dialect {
    /// Separator of values. `None`: the one with which most lines are rows of numbers.
    pub delimiter: Option<u8>,
    /// Numbers use a decimal comma: 1,5 for 1.5.
    pub decimal_comma: bool,
}

/// Rows with the separator that most of them have.
struct Split<'a> {
    separator: Separator,
    /// Cells of a usual row.
    width: usize,
    lines: Vec<Line<'a>>,
}

/// Reads a table.
///
/// # Errors
/// The fault of the table as a whole.
pub fn read(text: &str, dialect: Dialect) -> Result<Content, String> {
    let mut source = lines::of(text);
    if source.lines.is_empty() {
        return Err("the file is empty".into());
    }
    let prefixes = lines::take_prefixes_off(&mut source.lines);
    lines::take_brackets_off(&mut source.lines);
    if let Some(labelled) = labels::read(&source.lines) {
        return Ok(labelled.with_prefixes(prefixes));
    }
    let given = dialect.delimiter.or(source.said).map(Separator::Sign);
    let (separator, width) = lines::separator(&source.lines, given);
    let mut split = Split { separator, width, lines: source.lines };
    if let Some(beside) = oscilloscope::metadata_beside_the_data(&mut split) {
        return rows::read(&split, beside, Vec::new(), prefixes, dialect);
    }
    let header = header::find(&split, &source.comments);
    let before = broken_before(&split, &header);
    rows::read(&split, header, before, prefixes, dialect)
}

/// Lines that hold numbers, but stand before the header: noise of a board that starts.
fn broken_before(split: &Split<'_>, header: &Header) -> Vec<Broken> {
    let before = split.lines[..header.first_row].iter().filter(|line| Some(line.number) < header.line);
    let is_row = |line: &&Line<'_>| lines::is_row_of_numbers(&split.separator.cells(line.text));
    before
        .filter(is_row)
        .map(|line| Broken { line: line.number, what: "it stands before the header line".into() })
        .collect()
}

/// The notation of a file's numbers, from the cells that show it.
fn notation(split: &Split<'_>, first_row: usize, dialect: Dialect) -> Notation {
    if dialect.decimal_comma {
        return Notation::Comma;
    }
    let may_have_commas = |line: &&Line<'_>| {
        line.text.contains(',') && (split.separator != Separator::Sign(b',') || line.text.contains('"'))
    };
    let (mut comma, mut thousands) = (0, 0);
    for line in split.lines[first_row..].iter().filter(may_have_commas) {
        for cell in split.separator.cells(line.text) {
            match cells::evidence(&cell) {
                Some(Notation::Comma) => comma += 1,
                Some(Notation::PointAndThousands) => thousands += 1,
                _ => {}
            }
        }
    }
    match (comma, thousands, split.separator) {
        (0, 0, Separator::Sign(b';')) => Notation::Comma,
        (0, 0, _) => Notation::Point,
        (comma, thousands, _) if comma > thousands => Notation::Comma,
        _ => Notation::PointAndThousands,
    }
}

#[cfg(test)]
mod tests;

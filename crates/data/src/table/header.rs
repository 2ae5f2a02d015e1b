//! The line of names above a table, and a line of units with it.

use super::cells::is_word_for_missing;
use super::lines::{Line, Separator, is_row_of_numbers};
use super::{Split, oscilloscope};
use crate::units;
use std::borrow::Cow;

/// What stands above the rows.
#[derive(Debug, Default)]
pub struct Header {
    /// Line of the names; `None`: there are none.
    pub line: Option<u64>,
    /// Names of the columns.
    pub names: Vec<String>,
    /// Units of the columns, as far as a line states them.
    pub units: Vec<String>,
    /// Index of the first line that may be a row.
    pub first_row: usize,
    /// Columns before the table, for metadata beside it.
    pub skipped: usize,
    /// Time of the first row, and the time between rows, for instruments that write no times.
    pub start_and_step_s: Option<(f64, f64)>,
}

/// So many lines may stand between the names and the first row.
const BETWEEN: usize = 6;

/// Number of cells without empty ones at the end.
pub fn filled(cells: &[Cow<'_, str>]) -> usize {
    cells.iter().rposition(|cell| !cell.is_empty()).map_or(0, |last| last + 1)
}

/// Finds the names of a table: the last line before its rows that has as many cells and few numbers.
pub fn find(split: &Split<'_>, comments: &[Line<'_>]) -> Header {
    let cells = |index: usize| split.separator.cells(split.lines[index].text);
    let is_row = |index: usize| {
        let cells = cells(index);
        cells.len() == split.width && is_row_of_numbers(&cells)
    };
    let count = split.lines.len();
    let first = (0..count).find(|index| is_row(*index)).or_else(|| {
        // With columns of words: the first line whose like most others are.
        let has_width = |index: &usize| cells(*index).len() == split.width;
        (0..count).filter(has_width).find(|index| !looks_like_names(&cells(*index), 1))
    });
    let Some(first) = first else { return of_line(split, 0, None, count.min(1)) };
    let width = (first..count.min(first + 20)).map(|index| filled(&cells(index))).max().unwrap_or(split.width);
    let first = with_missing(split, first);
    if let Some(found) = above(split, first, width) {
        return found;
    }
    // Noise that looks like a row may stand before the names.
    let later = (first + 1..count.min(first + 50)).find(|index| looks_like_names(&cells(*index), width.max(2)));
    if let Some(names) = later.filter(|names| names + 1 < count && is_row(names + 1)) {
        return of_line(split, names, None, names + 1);
    }
    let before = comments.iter().rev().filter(|comment| comment.number < split.lines[first].number);
    for comment in before {
        for separator in [split.separator, Separator::Sign(b','), Separator::Blanks] {
            let names = separator.cells(comment.text);
            if filled(&names) == width && width > 1 && looks_like_names(&names, width) {
                let names = names.iter().map(|name| name.to_string()).collect();
                return Header { line: Some(comment.number), names, first_row: first, ..Header::default() };
            }
        }
    }
    let names = (1..=width.max(1)).map(|number| number.to_string()).collect();
    Header { names, first_row: first, ..Header::default() }
}

/// The first row, with the rows before it that have no value in any cell. Without a column of times, the place of a
/// row is its time.
fn with_missing(split: &Split<'_>, first: usize) -> usize {
    let is_missing = |index: &usize| {
        let cells = split.separator.cells(split.lines[*index].text);
        cells.len() == split.width && cells.iter().all(|cell| is_word_for_missing(cell))
    };
    (0..first).rev().take_while(is_missing).last().unwrap_or(first)
}

/// The names above the first row, and the units between.
fn above(split: &Split<'_>, first: usize, width: usize) -> Option<Header> {
    let cells = |index: usize| split.separator.cells(split.lines[index].text);
    let candidates = (first.saturating_sub(BETWEEN)..first).rev();
    let mut names = candidates.filter(|index| looks_like_names(&cells(*index), width));
    let nearest = names.next()?;
    if is_units(&cells(nearest), width)
        && let Some(above) = names.next().filter(|above| above + 1 == nearest)
    {
        return Some(of_line(split, above, Some(nearest), first));
    }
    Some(of_line(split, nearest, None, first))
}

/// Whether a line of so many cells at least can be names: most of what is in it is no number.
fn looks_like_names(cells: &[Cow<'_, str>], width: usize) -> bool {
    let is_name = |cell: &&Cow<'_, str>| cell.chars().any(char::is_alphabetic) && !super::cells::is_numeric(cell);
    let said = cells.iter().filter(|cell| !cell.is_empty()).count();
    let names = cells.iter().filter(is_name).count();
    // The oscilloscopes of one maker call their channels 1, 2, 3.
    let counted = cells.first().is_some_and(|first| is_name(&first)) && counts_up(&cells[1..]);
    cells.len() >= width && names > 0 && (2 * names > said || counted)
}

fn counts_up(cells: &[Cow<'_, str>]) -> bool {
    let filled = cells.iter().filter(|cell| !cell.is_empty());
    filled.enumerate().all(|(index, cell)| cell.parse() == Ok(index + 1))
}

fn is_units(cells: &[Cow<'_, str>], width: usize) -> bool {
    let known = |cell: &Cow<'_, str>| cell.is_empty() || units::named(cell).is_some();
    cells.iter().take(width).all(known) && cells.iter().any(|cell| !cell.is_empty())
}

fn of_line(split: &Split<'_>, names: usize, units: Option<usize>, first_row: usize) -> Header {
    let cells = |index: usize| -> Vec<String> {
        split.separator.cells(split.lines[index].text).iter().map(|cell| cell.to_string()).collect()
    };
    let (line, names, units) = (split.lines[names].number, cells(names), units.map(cells).unwrap_or_default());
    let start_and_step_s = oscilloscope::start_and_step_s(&split.lines[..first_row], &names, &units);
    Header { line: Some(line), names, units, first_row, skipped: 0, start_and_step_s }
}

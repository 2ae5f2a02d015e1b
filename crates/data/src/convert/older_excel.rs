//! What an older file of Excel (.xls) claims to hold, before it is read. A cell may stand in row 65536 and column 65536,
//! and a stream may go round in a ring.

use super::{Fault, open_document};
use cfb::CompoundFile;
use std::io::{Cursor, Read};
use std::path::PathBuf;

/// First bytes of every compound file.
const MAGIC: &[u8] = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1";
/// Names of the stream with the sheets.
const BOOKS: [&str; 2] = ["Workbook", "Book"];

// Kinds of records ([MS-XLS], 2.3).
const BEGIN: u16 = 0x0809;
const END: u16 = 0x000a;
const SHEET: u16 = 0x0085;
const DIMENSIONS: u16 = 0x0200;
const MANY_NUMBERS: u16 = 0x00bd;
/// Records of one cell: formula, number, label, truth, short number, shared string, formatted label.
const CELLS: [u16; 7] = [0x0006, 0x0203, 0x0204, 0x0205, 0x027e, 0x00fd, 0x00d6];

/// Refuses what is not whole, or has sheets with more than `most_cells` cells together.
pub fn check(bytes: &[u8], most_cells: u64) -> Result<(), Fault> {
    if !bytes.starts_with(MAGIC) {
        return Ok(());
    }
    // Opening it follows each chain of sectors, so that none is endless.
    let mut file = CompoundFile::open(Cursor::new(bytes)).map_err(|error| not_whole(&error))?;
    let is_book = |name: &str| BOOKS.iter().any(|book| book.eq_ignore_ascii_case(name));
    let books = file.walk().filter(|entry| entry.is_stream() && is_book(entry.name()));
    let books: Vec<PathBuf> = books.map(|entry| entry.path().to_path_buf()).collect();
    for path in books {
        let mut book = Vec::new();
        file.open_stream(path)
            .and_then(|mut stream| stream.read_to_end(&mut book))
            .map_err(|error| not_whole(&error))?;
        check_sheets(&book, most_cells)?;
    }
    Ok(())
}

fn not_whole(why: &dyn std::fmt::Display) -> Fault {
    Fault::whole(format!("this .xls is not whole ({why}): save it again, or save the sheet as CSV"))
}

fn check_sheets(book: &[u8], most_cells: u64) -> Result<(), Fault> {
    let mut left_cells = most_cells;
    let sheets = records(book).take_while(|record| record.kind != END).filter(|record| record.kind == SHEET);
    for (record, number) in sheets.zip(1..) {
        let begin = record.number(0).zip(record.number(2)).map(|(low, high)| low | high << 16);
        let sheet = begin.and_then(|begin| book.get(begin as usize..));
        let sheet = sheet.ok_or_else(|| not_whole(&format_args!("sheet {number} begins after its end")))?;
        let (filled, claimed) = sizes(sheet);
        for size in [filled, claimed] {
            if size.cells() > left_cells {
                let what = open_document::far_apart(size.rows, size.columns);
                return Err(Fault::at(format_args!("sheet {number}"), format!("its cells are {what}")));
            }
        }
        left_cells -= filled.cells();
    }
    Ok(())
}

/// A record of a stream.
struct Record<'a> {
    kind: u16,
    data: &'a [u8],
}

impl Record<'_> {
    /// The number of 16 bits at a place.
    fn number(&self, at: usize) -> Option<u32> {
        self.data.get(at..)?.first_chunk().map(|bytes| u32::from(u16::from_le_bytes(*bytes)))
    }
}

/// The records up to the first that is not whole.
fn records(mut rest: &[u8]) -> impl Iterator<Item = Record<'_>> {
    std::iter::from_fn(move || {
        let (head, behind) = rest.split_first_chunk::<4>()?;
        let [kind, length] = [[head[0], head[1]], [head[2], head[3]]].map(u16::from_le_bytes);
        let data = behind.get(..length.into())?;
        rest = &behind[length.into()..];
        Some(Record { kind, data })
    })
}

#[derive(Clone, Copy, Default)]
struct Size {
    rows: u64,
    columns: u64,
}

impl Size {
    fn cells(self) -> u64 {
        self.rows * self.columns
    }
}

/// The rectangle of the cells of a sheet, and the size that the sheet claims.
fn sizes(sheet: &[u8]) -> (Size, Size) {
    let (mut rows, mut columns, mut claimed, mut depth) = (Span::default(), Span::default(), Size::default(), 0_usize);
    for record in records(sheet) {
        match record.kind {
            BEGIN => depth += 1,
            END if depth <= 1 => break,
            END => depth -= 1,
            // Charts within the sheet have records of their own.
            _ if depth > 1 => {}
            DIMENSIONS => claimed = claimed_size(&record).unwrap_or_default(),
            kind if kind == MANY_NUMBERS || CELLS.contains(&kind) => {
                let last = if kind == MANY_NUMBERS { record.data.len().saturating_sub(2) } else { 2 };
                rows.extend(record.number(0));
                columns.extend(record.number(2).into_iter().chain(record.number(last)));
            }
            _ => {}
        }
    }
    (Size { rows: rows.length(), columns: columns.length() }, claimed)
}

/// The end of the rows and of the columns, which are in wider numbers since Excel 97.
fn claimed_size(record: &Record<'_>) -> Option<Size> {
    let wide = |at: usize| Some(u64::from(record.number(at)?) | u64::from(record.number(at + 2)?) << 16);
    let (first, end, columns) = match record.data.len() {
        10 => (record.number(0)?.into(), record.number(2)?.into(), record.number(6)?),
        _ => (wide(0)?, wide(4)?, record.number(10)?),
    };
    let rows = (end as u32).wrapping_sub(first as u32);
    Some(Size { rows: rows.into(), columns: columns.into() })
}

/// From the least to the most of some numbers.
#[derive(Default)]
struct Span(Option<(u32, u32)>);

impl Span {
    fn extend(&mut self, numbers: impl IntoIterator<Item = u32>) {
        for number in numbers {
            let (least, most) = self.0.unwrap_or((number, number));
            self.0 = Some((least.min(number), most.max(number)));
        }
    }

    fn length(&self) -> u64 {
        self.0.map_or(0, |(least, most)| u64::from(most - least) + 1)
    }
}

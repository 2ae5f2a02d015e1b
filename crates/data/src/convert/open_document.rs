//! What an OpenDocument sheet (.ods) claims to hold, before it is read. A cell and a row may say that they are repeated a
//! million times, and a file that ends within a table would be read for ever.

use super::Fault;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::io::{BufReader, Cursor};
use zip::ZipArchive;

/// The part with the sheets.
const CONTENT: &str = "content.xml";

/// Refuses what is not whole, or has more than `most_cells` cells.
pub fn check(bytes: &[u8], most_cells: u64) -> Result<(), Fault> {
    let Ok(mut archive) = ZipArchive::new(Cursor::new(bytes)) else { return Ok(()) };
    let Ok(content) = archive.by_name(CONTENT) else { return Ok(()) };
    let mut reader = Reader::from_reader(BufReader::new(content));
    reader.config_mut().expand_empty_elements = true;
    let (mut depth, mut buffer, mut table) = (0_usize, Vec::new(), Table::default());
    loop {
        buffer.clear();
        match reader.read_event_into(&mut buffer).map_err(|error| not_whole(&error.to_string()))? {
            Event::Start(element) => {
                depth += 1;
                table.begin(&element);
            }
            Event::End(element) => {
                depth = depth.saturating_sub(1);
                if element.name().as_ref() == "table:table-row" {
                    table.end_of_row();
                }
            }
            Event::Eof if depth > 0 => return Err(not_whole("it ends within an element")),
            Event::Eof => return Ok(()),
            _ => {}
        }
        if table.cells() > most_cells {
            return Err(Fault::at(CONTENT, format!("cells are {}", far_apart(table.rows, table.columns))));
        }
    }
}

/// What is wrong with cells that are spread over so many rows and columns.
pub fn far_apart(rows: u64, columns: u64) -> String {
    format!("spread over {rows} rows and {columns} columns: delete what stands far from the table")
}

fn not_whole(why: &str) -> Fault {
    Fault::at(CONTENT, format!("this .ods is not whole ({why}): save it again, or save the sheet as CSV"))
}

/// The rectangle up to the last cell with something in it.
#[derive(Default)]
struct Table {
    /// Cells of the tables before this one.
    before: u64,
    rows: u64,
    columns: u64,
    /// Rows without anything, which count if another follows.
    empty_rows: u64,
    /// How often the row comes, its cells so far, and up to the last with something in it.
    repeated: u64,
    cells_in_row: u64,
    filled_in_row: u64,
}

impl Table {
    fn begin(&mut self, element: &BytesStart<'_>) {
        let times = |name: &str| {
            let said = element.try_get_attribute(name).ok().flatten();
            said.and_then(|said| said.value.parse::<u32>().ok()).map_or(1, u64::from)
        };
        match element.name().as_ref() {
            "table:table" => *self = Self { before: self.cells(), ..Self::default() },
            "table:table-row" => {
                (self.repeated, self.cells_in_row, self.filled_in_row) = (times("table:number-rows-repeated"), 0, 0);
            }
            "table:table-cell" | "table:covered-table-cell" => {
                self.cells_in_row += times("table:number-columns-repeated");
                let is_filled =
                    element.attributes().flatten().any(|attribute| attribute.key.as_ref().contains("value"));
                if is_filled {
                    self.filled_in_row = self.cells_in_row;
                }
            }
            _ => {}
        }
    }

    fn end_of_row(&mut self) {
        if self.filled_in_row == 0 {
            self.empty_rows += self.repeated;
            return;
        }
        self.rows += self.repeated + std::mem::take(&mut self.empty_rows);
        self.columns = self.columns.max(self.filled_in_row);
    }

    fn cells(&self) -> u64 {
        self.before.saturating_add(self.rows.saturating_mul(self.columns))
    }
}

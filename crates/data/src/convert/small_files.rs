//! Small files that promise more than memory and time can hold: damaged ones, and ones with a stray cell.

use super::kinds::{array, book_of, book_with, doubles, element, log, matlab, read_as, words};
use super::*;
use std::io::{Cursor, Write as _};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// A MATLAB file with so many objects. Each has the name in a cell of its own, and shares samples and times with all.
fn objects_that_share(samples: &[u8], names: &[String]) -> Vec<u8> {
    let properties = b"Name\0Data_\0Time\0any\0";
    let mut plain = vec![0, 0];
    for object in 0..names.len() as u32 {
        plain.extend([3, 1, 1, 2 + object, 2, 1, 0, 3, 1, 1]);
    }
    let saved = [0_u32; 2];
    let objects: Vec<u32> =
        [0; 6].into_iter().chain((1..=names.len() as u32).flat_map(|at| [1, 0, 0, 0, at, at])).collect();
    let mut parts = vec![40 + properties.len().next_multiple_of(8)];
    for length in [0, saved.len(), objects.len(), plain.len()] {
        parts.push(parts.last().unwrap() + 4 * length);
    }
    let mut bytes = words(&[4, 4]);
    bytes.extend(words(&parts.iter().map(|part| *part as u32).collect::<Vec<_>>()));
    bytes.resize(40, 0);
    bytes.extend(properties);
    bytes.resize(parts[0], 0);
    bytes.extend([words(&saved), words(&objects), words(&plain)].concat());
    let mut cells = vec![
        array(9, [1, bytes.len() as u32], "", &element(2, &bytes)),
        array(6, [0, 0], "", &[]),
        samples.to_vec(),
        array(6, [300, 1], "", &doubles(&(0..300).map(|row| f64::from(row) * 1e-3).collect::<Vec<_>>())),
    ];
    cells.extend(names.iter().map(|name| array(4, [1, name.len() as u32], "", &element(16, name.as_bytes()))));
    let inside = [vec![0, 1, b'I', b'M', 0, 0, 0, 0], array(1, [cells.len() as u32, 1], "", &cells.concat())].concat();
    matlab(&[array(9, [1, inside.len() as u32], "", &element(2, &inside))])
}

/// A megabyte of objects on one matrix would be six million signals.
#[test]
fn objects_that_share_a_matrix_are_not_multiplied() {
    let matrix = array(9, [300, 300], "", &element(2, &vec![7; 300 * 300]));
    let names: Vec<String> = (0..20_000).map(|number| format!("signal {number}")).collect();
    let shared = objects_that_share(&matrix, &names);
    let content = named_content("objects.mat", &shared, Format::Mat).unwrap();
    assert_eq!((content.series.len(), content.series[0].values.len()), (10_000, 300));
    assert_eq!((&*content.series[0].name, &*content.series[300].name), ("signal 0/1", "signal 1/1"));
}

/// Of thousands of signals of one channel none can be chosen, so they are not all brought to common times.
#[test]
fn objects_of_one_channel_are_not_copied_one_by_one() {
    let samples = array(6, [300, 1], "", &doubles(&[1.0; 300]));
    let names: Vec<String> = (0..5000).map(|number| format!("{number}/u_V")).collect();
    let why = read_as(Format::Mat, &objects_that_share(&samples, &names), &[]).unwrap_err();
    assert!(why.contains("two columns are u_V: 0/u_V, 1/u_V") && !why.contains("200/u_V"), "{}", why.len());
    let chosen = read_as(Format::Mat, &objects_that_share(&samples, &names), &["4000/u_V=u_V"]).unwrap();
    assert_eq!(chosen.len(), 300);
}

#[test]
fn a_long_name_does_not_come_again_for_each_column() {
    let matrix = array(9, [400, 400], &"x".repeat(100_000), &element(2, &vec![1; 160_000]));
    let content = named_content("name.mat", &matlab(&[matrix]), Format::Mat).unwrap();
    assert!(content.columns.len() == 400 && content.columns.iter().all(|column| column.name.len() < 300));
}

#[test]
fn an_array_with_a_series_for_each_byte_is_refused() {
    let pixels = log(&[("camera", "boolean[]"), ("omega", "double")], &[(1, 0, vec![1; 200_000])]);
    let why = read_as(Format::Wpilog, &pixels, &["omega=omega_rad_per_s"]).unwrap_err();
    assert!(why.contains("more than 100000 series: log the motor's alone"), "{why}");
}

fn archive(parts: &[(&str, &str)]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, text) in parts {
        archive.start_file(*name, SimpleFileOptions::default()).unwrap();
        archive.write_all(text.as_bytes()).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn open_document(table: &str) -> Vec<u8> {
    let names = "xmlns:office=\"office\" xmlns:table=\"table\" xmlns:text=\"text\"";
    archive(&[
        ("mimetype", "application/vnd.oasis.opendocument.spreadsheet"),
        ("META-INF/manifest.xml", "<manifest/>"),
        ("content.xml", &format!("<office:document-content {names}>{table}")),
    ])
}

/// A cell in the last corner of a sheet makes a rectangle of 17 thousand million cells.
#[test]
fn a_cell_far_from_the_table_is_named() {
    let row = |number: u32, cells: &str| format!("<row r=\"{number}\">{cells}</row>");
    let near = row(1, "<c r=\"A1\" t=\"str\"><v>t_s</v></c><c r=\"B1\" t=\"str\"><v>u_V</v></c>")
        + &row(2, "<c r=\"A2\"><v>0</v></c><c r=\"B2\"><v>1.5</v></c>");
    let far = row(1_048_576, "<c r=\"XFD1048576\"><v>1</v></c>");
    assert_eq!(read_as(Format::Spreadsheet, &book_of(&near), &[]).unwrap().len(), 1);
    let why = read_as(Format::Spreadsheet, &book_of(&(near + &far)), &[]).unwrap_err();
    let what = "spread over 1048576 rows and 16384 columns: delete what stands far from the table";
    assert!(why.contains(&format!("sheet Log: its 5 cells are {what}")), "{why}");
    // OpenDocument says how often a cell and a row are repeated.
    let cell = |text: &str| {
        format!("<table:table-cell office:value-type=\"string\"><text:p>{text}</text:p></table:table-cell>")
    };
    let number = |value: f64| format!("<table:table-cell office:value-type=\"float\" office:value=\"{value}\"/>");
    let row = |cells: String| {
        format!("<table:table-row>{cells}<table:table-cell table:number-columns-repeated=\"16382\"/></table:table-row>")
    };
    let near = row(cell("t_s") + &cell("u_V")) + &row(number(0.0) + &number(1.5)) + &row(number(0.1) + &number(2.5));
    let rest = "<table:table-row table:number-rows-repeated=\"1048573\"><table:table-cell table:number-columns-repeated=\"16384\"/></table:table-row>";
    let table = |rows: &str| {
        open_document(&format!("<table:table table:name=\"Log\">{rows}</table:table></office:document-content>"))
    };
    let usual = read_as(Format::Spreadsheet, &table(&(near.clone() + rest)), &[]).unwrap();
    assert_eq!(usual.get(Channel::Voltage).unwrap(), [1.5, 2.5]);
    let many = rest.replace("<table:table-cell ", "<table:table-cell office:value-type=\"float\" office:value=\"1\" ");
    let why = read_as(Format::Spreadsheet, &table(&(near + &many)), &[]).unwrap_err();
    assert!(why.contains("delete what stands far from the table"), "{why}");
}

fn npy(version: u8, length: &[u8], text: &str) -> Vec<u8> {
    [&b"\x93NUMPY"[..], &[version, 0], length, text.as_bytes()].concat()
}

/// Each bracket triples the time of the reader: forty of them would be read for ever.
#[test]
fn a_header_with_brackets_in_brackets_is_refused() {
    for inside in ["(".repeat(40), "[".repeat(40), "{".repeat(40), "{'}': ".repeat(40), "''' ' '''".to_owned()] {
        let text = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({inside}");
        let why = read_as(Format::Npy, &npy(1, &(text.len() as u16).to_le_bytes(), &text), &[]).unwrap_err();
        assert!(why.contains("not written by NumPy") && why.contains("numpy.save"), "{inside}: {why}");
    }
    let why = read_as(Format::Npy, &npy(2, &u32::MAX.to_le_bytes(), "{"), &[]).unwrap_err();
    assert!(why.contains("the file ends within its header of 4294967295 bytes"), "{why}");
    // Brackets in a name do not count.
    let name = "speed ((((((((((, rad/s";
    let text = format!("{{'descr': [('{name}', '<f8'), ('t_s', '<f8')], 'fortran_order': False, 'shape': (1,), }}");
    let mut whole = npy(1, &(text.len() as u16).to_le_bytes(), &text);
    whole.extend([0; 16]);
    let content = named_content("log.npy", &whole, Format::Npy).unwrap();
    assert_eq!(content.columns[0].name, name);
}

/// The reader's numbers would wrap: the cell of row 4294967298 would be read as that of row 2.
#[test]
fn a_cell_outside_of_any_sheet_is_named() {
    let head = "<row r=\"1\"><c r=\"A1\" t=\"str\"><v>t_s</v></c><c r=\"B1\" t=\"str\"><v>u_V</v></c></row>";
    for place in ["A4294967298", "AAAAAAAAAA2", "A0", "A1048577"] {
        let why =
            read_as(Format::Spreadsheet, &book_of(&format!("{head}<row><c r=\"{place}\"><v>0</v></c></row>")), &[])
                .unwrap_err();
        let what = format!("a cell is said to be at {place}, and a sheet ends at XFD1048576: the file is damaged");
        assert!(why.contains(&what) && why.contains("save the sheet as CSV"), "{why}");
    }
    let row = format!("{head}<row r=\"99999999999\"/>");
    assert!(read_as(Format::Spreadsheet, &book_of(&row), &[]).unwrap_err().contains("at 99999999999, and a sheet"));
}

/// Such a file would be read for ever.
#[test]
fn a_sheet_that_ends_within_its_table_is_refused() {
    for cut in
        ["<table:table table:name=\"Log\"><table:table-row>", "<table:table table:name=\"Log\"></table:table-row>"]
    {
        let why = read_as(Format::Spreadsheet, &open_document(cut), &[]).unwrap_err();
        assert!(why.contains("content.xml: this .ods is not whole") && why.contains("save the sheet as CSV"), "{why}");
    }
}

/// A record of an older spreadsheet.
fn record(kind: u16, data: &[u8]) -> Vec<u8> {
    [&kind.to_le_bytes()[..], &(data.len() as u16).to_le_bytes(), data].concat()
}

/// A number in a cell of an older spreadsheet.
fn number_at(row: u16, column: u16, value: f64) -> Vec<u8> {
    let place = [row, column, 0].map(u16::to_le_bytes).concat();
    record(0x0203, &[&place[..], &value.to_le_bytes()].concat())
}

/// An older spreadsheet (.xls) whose sheets have these records.
fn older_book(sheets: &[Vec<u8>]) -> Vec<u8> {
    let begin = |what: u16| record(0x0809, &[[0, 6], what.to_le_bytes(), [0; 2], [0; 2]].concat());
    let named = |at: usize, begin: usize| {
        let name = format!("S{at}");
        let head = [&(begin as u32).to_le_bytes()[..], &[0, 0, name.len() as u8, 0]].concat();
        record(0x0085, &[&head[..], name.as_bytes()].concat())
    };
    let listed: usize = (0..sheets.len()).map(|at| named(at, 0).len()).sum();
    let mut book = begin(5);
    let mut place = book.len() + listed + record(0x000a, &[]).len();
    let sheets: Vec<Vec<u8>> =
        sheets.iter().map(|records| [begin(16), records.clone(), record(0x000a, &[])].concat()).collect();
    for (at, sheet) in sheets.iter().enumerate() {
        book.extend(named(at, place));
        place += sheet.len();
    }
    book.extend(record(0x000a, &[]));
    book.extend(sheets.concat());
    let mut file = cfb::CompoundFile::create_with_version(cfb::Version::V3, Cursor::new(Vec::new())).unwrap();
    file.create_stream("Workbook").unwrap().write_all(&book).unwrap();
    file.into_inner().into_inner()
}

/// The header and a row of a table in an older spreadsheet.
fn older_table() -> Vec<u8> {
    let label = |column: u16, text: &str| {
        let head = [0, column, 0, text.len() as u16].map(u16::to_le_bytes).concat();
        record(0x0204, &[&head[..], &[0], text.as_bytes()].concat())
    };
    [label(0, "t_s"), label(1, "u_V"), number_at(1, 0, 0.0), number_at(1, 1, 1.5)].concat()
}

/// Its numbers for rows and columns reach further than those of Excel: a rectangle of 4 thousand million cells.
#[test]
fn a_far_cell_of_an_older_spreadsheet_is_named() {
    let read = |sheets: &[Vec<u8>]| read_as(Format::Spreadsheet, &older_book(sheets), &[]);
    assert_eq!(read(&[older_table()]).unwrap().get(Channel::Voltage).unwrap(), [1.5]);
    // The last cell that Excel has is no fault.
    older_excel::check(&older_book(&[[older_table(), number_at(65_535, 255, 1.0)].concat()]), 65_536 * 256).unwrap();
    let many = record(0x00bd, &[&[0xff, 0xff, 0xfe, 0xff][..], &[0; 12], &[0xff, 0xff]].concat());
    let claimed = record(0x0200, &[0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0xff, 0xff, 0, 0]);
    for far in [number_at(65_535, 65_535, 1.0), many] {
        let why = read(&[older_table(), [older_table(), far].concat()]).unwrap_err();
        let what = "spread over 65536 rows and 65536 columns: delete what stands far from the table";
        assert!(why.contains(&format!("sheet 2: its cells are {what}")), "{why}");
    }
    let why = read(&[[claimed, older_table()].concat()]).unwrap_err();
    assert!(why.contains("sheet 1: its cells are spread over 65536 rows and 65535 columns"), "{why}");
}

/// Each of many sheets may have as many cells as Excel allows.
#[test]
fn the_cells_of_all_sheets_of_an_older_spreadsheet_count() {
    let wide = [number_at(0, 0, 1.0), number_at(65_535, 255, 1.0)].concat();
    let why = read_as(Format::Spreadsheet, &older_book(&vec![wide; 100]), &[]).unwrap_err();
    assert!(why.contains("sheet 3: its cells are spread over 65536 rows and 256 columns"), "{why}");
}

/// Such a file would be read for ever.
#[test]
fn an_older_spreadsheet_whose_sectors_form_a_ring_is_refused() {
    let mut file = older_book(&vec![older_table(); 100]);
    // The header says which sector has the next sector of each; the last of a stream says that it ends.
    let table = 512 * (1 + usize::from(file[76]));
    let next = |sector: usize| table + 4 * sector..table + 4 * sector + 4;
    let end = (1..128).rfind(|sector| file[next(*sector)] == [0xfe, 0xff, 0xff, 0xff]).unwrap();
    let before = file[next(end - 1)].to_vec();
    file[next(end)].copy_from_slice(&before);
    let why = read_as(Format::Spreadsheet, &file, &[]).unwrap_err();
    assert!(why.contains("this .xls is not whole (") && why.contains("save the sheet as CSV"), "{why}");
}

/// A thousandth of its size may be packed, in whichever part, and whatever the archive says of its sizes.
#[test]
fn a_part_that_is_unpacked_without_end_is_named() {
    let texts = format!("<sst>{}</sst>", "<si><t>a</t></si>".repeat(10_000));
    let rows = "<row r=\"1\"><c r=\"A1\" t=\"str\"><v>t_s</v></c></row><row r=\"2\"><c r=\"A2\"><v>0</v></c></row>";
    let strings = ("xl/sharedStrings.xml", &*texts);
    let book = book_with(rows, &[strings]);
    assert!(20 * book.len() < texts.len(), "{}", book.len());
    assert_eq!(spreadsheet::read_within(&book, 2 * texts.len() as u64).unwrap().columns.len(), 1);
    let why = spreadsheet::read_within(&book, texts.len() as u64).unwrap_err().to_string();
    assert!(why.contains("xl/sharedStrings.xml: the file has more than 1 GB in it"), "{why}");
}

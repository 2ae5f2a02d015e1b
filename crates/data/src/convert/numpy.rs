//! `NumPy`: a structured array whose fields are the columns (.npy), or an archive with an array for each column (.npz).

use super::{Fault, MOST_BYTES, TOO_MUCH, matrix};
use crate::content::{Column, Content};
use npyz::{DType, Endianness, NpyHeader, TypeChar, TypeStr};
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Number of header bytes before its text. Both together end on a multiple of [`ALIGNMENT`].
const BEFORE_TEXT: usize = 10;
const ALIGNMENT: usize = 64;

/// A field that is a record with a shape needs seven. A reader tries each bracket in several ways, so its time grows with
/// a power of this.
const MOST_NESTED: usize = 8;

fn header(bytes: &[u8]) -> Result<(NpyHeader, &[u8]), Fault> {
    check_text(bytes)?;
    let mut rest = Cursor::new(bytes);
    let header = NpyHeader::from_reader(&mut rest)
        .map_err(|error| Fault::at_byte(0, format!("no header of a NumPy array: {error}")))?;
    Ok((header, &bytes[rest.position() as usize..]))
}

/// Refuses a header whose text is not in the file, or that would be read for ever.
fn check_text(bytes: &[u8]) -> Result<(), Fault> {
    let (length, start) = match *bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, low, high, ..] => {
            (u32::from(u16::from_le_bytes([low, high])), BEFORE_TEXT)
        }
        [0x93, b'N', b'U', b'M', b'P', b'Y', _, _, a, b, c, d, ..] => {
            (u32::from_le_bytes([a, b, c, d]), BEFORE_TEXT + 2)
        }
        // The reader names it.
        _ => return Ok(()),
    };
    let text = usize::try_from(length).ok().and_then(|length| bytes[start..].get(..length));
    let text =
        text.ok_or_else(|| Fault::at_byte(bytes.len(), format!("the file ends within its header of {length} bytes")))?;
    match nested(text).filter(|nested| *nested <= MOST_NESTED) {
        Some(_) => Ok(()),
        None => {
            Err(Fault::at_byte(start, "this header was not written by NumPy. Save the array again with numpy.save"))
        }
    }
}

/// How deep the brackets of a header stand in each other, outside of names. NumPy never writes three quotes in a row.
fn nested(text: &[u8]) -> Option<usize> {
    if text.windows(3).any(|three| three == b"'''" || three == b"\"\"\"") {
        return None;
    }
    let (mut depth, mut deepest, mut quote) = (0_usize, 0, None);
    let mut bytes = text.iter();
    while let Some(byte) = bytes.next() {
        match (quote, byte) {
            (Some(_), b'\\') => _ = bytes.next(),
            (Some(open), close) if open == close => quote = None,
            (Some(_), _) => {}
            (None, b'\'' | b'"') => quote = Some(byte),
            (None, b'(' | b'[' | b'{') => depth += 1,
            (None, b')' | b']' | b'}') => depth = depth.saturating_sub(1),
            (None, _) => {}
        }
        deepest = deepest.max(depth);
    }
    Some(deepest)
}

/// All fields of a structured array with one dimension, or the columns of a matrix.
pub fn read_npy(bytes: &[u8]) -> Result<Content, Fault> {
    let (header, data) = header(bytes)?;
    let DType::Record(fields) = header.dtype() else { return Ok(Content::of(array(bytes, "")?)) };
    let row_bytes = header.dtype().num_bytes().unwrap_or(0);
    let rows = one_dimension(&header)?;
    let start = bytes.len() - data.len();
    whole(data, rows.saturating_mul(row_bytes), start)?;
    let mut columns = Vec::new();
    let mut offset = 0;
    for field in fields {
        let DType::Plain(kind) = &field.dtype else {
            return Err(Fault::at(
                format_args!("field {}", field.name),
                "a field is itself an array: give each column its own field",
            ));
        };
        let size = field.dtype.num_bytes().unwrap_or(0);
        let cells = (0..rows).map(|row| &data[row * row_bytes + offset..][..size]);
        let values = cells.map(|cell| number(kind, cell)).collect::<Option<_>>();
        columns.push(Column::new(field.name.clone(), values.ok_or_else(|| no_numbers(&field.name, kind))?));
        offset += size;
    }
    Ok(Content::of(columns))
}

/// Every array of an archive. One that cannot be read is an error only if it is wanted.
pub fn read_npz(bytes: &[u8], is_wanted: &dyn Fn(&str) -> bool) -> Result<Content, Fault> {
    let damaged = |error: zip::result::ZipError| Fault::whole(format!("not an archive of NumPy arrays: {error}"));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
    let mut content = Content::default();
    let mut left_bytes = MOST_BYTES;
    for index in 0..archive.len() {
        let file = archive.by_index(index).map_err(damaged)?;
        let name = file.name().map_err(damaged)?.trim_end_matches(".npy").to_string();
        let mut bytes = Vec::new();
        let in_array = |fault: Fault| Fault::at(format_args!("array {name}"), fault.to_string());
        let read =
            file.take(left_bytes).read_to_end(&mut bytes).map_err(|error| in_array(Fault::whole(error.to_string())));
        left_bytes -= bytes.len() as u64;
        if left_bytes == 0 {
            return Err(Fault::at(format_args!("array {name}"), format!("the archive has {TOO_MUCH}")));
        }
        match read.and_then(|_| array(&bytes, &name).map_err(in_array)) {
            Ok(columns) => content.columns.extend(columns),
            Err(fault) if is_wanted(&name) => return Err(fault),
            Err(_) => content.ignored.push(name),
        }
    }
    Ok(content)
}

/// A vector, or the columns of a matrix.
fn array(bytes: &[u8], name: &str) -> Result<Vec<Column>, Fault> {
    let (header, data) = header(bytes)?;
    let DType::Plain(kind) = header.dtype() else { return Err(Fault::whole("a structured array: save it as .npy")) };
    let (shape, size) = (header.shape().to_vec(), kind.num_bytes().unwrap_or(0));
    let count = shape.iter().try_fold(1_u64, |count, side| count.checked_mul(*side));
    let count = count.and_then(|count| usize::try_from(count).ok()).unwrap_or(usize::MAX);
    whole(data, count.saturating_mul(size), bytes.len() - data.len())?;
    if size == 0 {
        return Err(no_numbers(name, &kind));
    }
    let values = data.chunks_exact(size).map(|cell| number(&kind, cell)).collect::<Option<Vec<f64>>>();
    let values = values.ok_or_else(|| no_numbers(name, &kind))?;
    let sides: Vec<usize> = shape.iter().map(|side| *side as usize).filter(|side| *side != 1).collect();
    match sides[..] {
        [] | [_] => Ok(vec![Column::new(name, values)]),
        [rows, columns] => {
            let by_columns = header.order() == npyz::Order::Fortran;
            Ok(matrix(name, &values, rows, columns, by_columns))
        }
        _ => Err(Fault::whole(format!(
            "the array has the shape {shape:?}, but at most two dimensions are expected: give each column its own name"
        ))),
    }
}

fn one_dimension(header: &NpyHeader) -> Result<usize, Fault> {
    match header.shape() {
        shape if shape.iter().filter(|size| **size != 1).count() <= 1 => Ok(shape.iter().product::<u64>() as usize),
        shape => Err(Fault::whole(format!(
            "the array has the shape {shape:?}, but one dimension is expected: give each column its own name"
        ))),
    }
}

fn whole(data: &[u8], expected: usize, start: usize) -> Result<(), Fault> {
    if data.len() == expected {
        return Ok(());
    }
    Err(Fault::at_byte(
        start,
        format!(
            "{expected} bytes of numbers expected, but {} found: the file was cut short; save it again",
            data.len()
        ),
    ))
}

fn no_numbers(name: &str, kind: &TypeStr) -> Fault {
    Fault::at(format_args!("{name}, of type {kind}"), "real numbers are expected: convert them with .astype(float)")
}

fn number(kind: &TypeStr, cell: &[u8]) -> Option<f64> {
    let mut bytes = cell.to_vec();
    if kind.endianness() == Endianness::Big {
        bytes.reverse();
    }
    macro_rules! as_f64 {
        ($type:ty) => {
            Some(<$type>::from_le_bytes(bytes.try_into().ok()?) as f64)
        };
    }
    match (kind.type_char(), cell.len()) {
        (TypeChar::Float, 8) => as_f64!(f64),
        (TypeChar::Float, 4) => as_f64!(f32),
        (TypeChar::Int, 8) => as_f64!(i64),
        (TypeChar::Int, 4) => as_f64!(i32),
        (TypeChar::Int, 2) => as_f64!(i16),
        (TypeChar::Int, 1) => as_f64!(i8),
        (TypeChar::Uint, 8) => as_f64!(u64),
        (TypeChar::Uint, 4) => as_f64!(u32),
        (TypeChar::Uint, 2) => as_f64!(u16),
        (TypeChar::Uint | TypeChar::Bool, 1) => as_f64!(u8),
        _ => None,
    }
}

/// A structured array of doubles.
pub fn write_npy(columns: &[Column]) -> Vec<u8> {
    let quoted = |name: &str| name.replace('\\', "\\\\").replace('\'', "\\'");
    let fields: String = columns.iter().map(|column| format!("('{}', '<f8'), ", quoted(&column.name))).collect();
    let rows = columns.first().map_or(0, |column| column.values.len());
    let mut file = with_header(&format!("[{}]", fields.trim_end()), rows);
    for row in 0..rows {
        file.extend(columns.iter().flat_map(|column| column.values[row].to_le_bytes()));
    }
    file
}

fn with_header(descr: &str, rows: usize) -> Vec<u8> {
    let mut text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': ({rows},), }}");
    let length = (BEFORE_TEXT + text.len() + 1).next_multiple_of(ALIGNMENT) - BEFORE_TEXT;
    text = format!("{text:<width$}\n", width = length - 1);
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((length as u16).to_le_bytes());
    file.extend(text.as_bytes());
    file
}

/// An archive of vectors of doubles, compressed.
pub fn write_npz(columns: &[Column]) -> Result<Vec<u8>, Fault> {
    let failed = |error: zip::result::ZipError| Fault::whole(error.to_string());
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    for column in columns {
        archive.start_file(format!("{}.npy", column.name), options).map_err(failed)?;
        let mut array = with_header("'<f8'", column.values.len());
        array.extend(column.values.iter().flat_map(|value| value.to_le_bytes()));
        archive.write_all(&array).map_err(|error| Fault::whole(error.to_string()))?;
    }
    Ok(archive.finish().map_err(failed)?.into_inner())
}

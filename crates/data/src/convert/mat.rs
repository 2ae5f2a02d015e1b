//! MATLAB files of level 5 (`save -v6` and `-v7`, `scipy.io.savemat`). A header of 128 bytes is followed by elements
//! with a type, a size and data. Variables are elements of type matrix, plain or compressed with zlib.

use super::{Column, Fault, Names};
use flate2::read::ZlibDecoder;
use std::io::Read;

const HEADER: usize = 128;
const HDF5: &[u8] = b"\x89HDF";
// Types of elements.
const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
// Classes of arrays.
const CLASS_DOUBLE: u8 = 6;
const CLASSES_OF_NUMBERS: std::ops::RangeInclusive<u8> = CLASS_DOUBLE..=15;
const COMPLEX: u8 = 0x08;

#[derive(Clone, Copy)]
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
    /// Offset of the compressed bytes in the file.
    origin: Option<usize>,
}

struct Element<'a> {
    kind: u32,
    data: &'a [u8],
    /// Where the data begins.
    at: usize,
}

impl<'a> Reader<'a> {
    fn fault(&self, at: usize, what: impl Into<String>) -> Fault {
        match self.origin {
            Some(origin) => Fault::at(format_args!("byte {at} of the variable compressed at byte {origin}"), what),
            None => Fault::at_byte(at, what),
        }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or_else(|| {
            let left = self.bytes.len() - self.at;
            self.fault(
                self.at,
                format!("{count} bytes expected, but only {left} are left: the file was cut short; save it again"),
            )
        })?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        let big_endian = self.big_endian;
        let bytes: [u8; 4] = self.take(4)?.try_into().expect("four were taken");
        Ok(if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// The next element, padding included. Up to four bytes of data share a word with type and size.
    fn element(&mut self) -> Result<Element<'a>, Fault> {
        let word = self.u32()?;
        if word >> 16 != 0 {
            let at = self.at;
            let (kind, size) = (word & 0xffff, (word >> 16) as usize);
            let data = self.take(4)?;
            let data = data
                .get(..size)
                .ok_or_else(|| self.fault(at, format!("a small element of {size} bytes; it holds 4")))?;
            return Ok(Element { kind, data, at });
        }
        let (size, at) = (self.u32()? as usize, self.at + 4);
        let data = self.take(size)?;
        let padding = if word == COMPRESSED { 0 } else { size.next_multiple_of(8) - size };
        // The last element of a file may lack its padding.
        self.at = (self.at + padding).min(self.bytes.len());
        Ok(Element { kind: word, data, at: at - 4 })
    }

    fn numbers(&self, element: &Element<'_>) -> Result<Vec<f64>, Fault> {
        macro_rules! all {
            ($type:ty) => {
                element
                    .data
                    .chunks_exact(size_of::<$type>())
                    .map(|bytes| {
                        let bytes = bytes.try_into().expect("chunks are exact");
                        (if self.big_endian { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) })
                            as f64
                    })
                    .collect()
            };
        }
        Ok(match element.kind {
            1 => all!(i8),
            2 => all!(u8),
            3 => all!(i16),
            4 => all!(u16),
            INT32 => all!(i32),
            UINT32 => all!(u32),
            7 => all!(f32),
            DOUBLE => all!(f64),
            12 => all!(i64),
            13 => all!(u64),
            kind => return Err(self.fault(element.at, format!("data of type {kind} is not numeric"))),
        })
    }
}

/// Vectors of numbers that are channels, and the names of the other variables.
pub fn read(bytes: &[u8], names: &Names) -> Result<(Vec<Column>, Vec<String>), Fault> {
    let big_endian = match bytes.get(HEADER - 2..HEADER) {
        _ if bytes.starts_with(HDF5) || bytes.starts_with(b"MATLAB 7.3") => {
            return Err(Fault::at_byte(0, "a MATLAB 7.3 file, which is HDF5: save it with save(..., '-v7')"));
        }
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => {
            return Err(Fault::at_byte(
                HEADER - 2,
                "there is no mark IM or MI, so this is not a MATLAB file of level 5: save it with save(..., '-v7')",
            ));
        }
    };
    let mut reader = Reader { bytes, at: HEADER, big_endian, origin: None };
    let (mut columns, mut ignored) = (Vec::new(), Vec::new());
    while reader.at < bytes.len() {
        let element = reader.element()?;
        if element.kind != COMPRESSED {
            let inner = Reader { at: element.at, bytes: &bytes[..element.at + element.data.len()], ..reader };
            variable(&element, inner, names, &mut columns, &mut ignored)?;
            continue;
        }
        let mut plain = Vec::new();
        ZlibDecoder::new(element.data).read_to_end(&mut plain).map_err(|error| {
            Fault::at_byte(element.at, format!("its compressed data is damaged ({error}); save it again"))
        })?;
        let mut inner = Reader { bytes: &plain, at: 0, big_endian, origin: Some(element.at) };
        let element = inner.element()?;
        let content = Reader { at: element.at, ..inner };
        variable(&element, content, names, &mut columns, &mut ignored)?;
    }
    Ok((columns, ignored))
}

/// Reads a variable that is a channel; of another one only the name. `reader` is at the content of its element.
fn variable(
    element: &Element<'_>,
    mut reader: Reader<'_>,
    names: &Names,
    columns: &mut Vec<Column>,
    ignored: &mut Vec<String>,
) -> Result<(), Fault> {
    if element.kind != MATRIX || element.data.is_empty() {
        return Ok(());
    }
    let at = reader.at;
    let flags = reader.element()?;
    let [class, bits] = match (flags.data, reader.big_endian) {
        ([class, bits, ..], false) | ([_, _, bits, class, ..], true) => [*class, *bits],
        _ => return Err(reader.fault(at, "array flags of fewer than 4 bytes")),
    };
    let shape = reader.element()?;
    let shape = reader.numbers(&shape)?;
    let name = reader.element()?;
    let name = String::from_utf8_lossy(name.data).into_owned();
    if names.channel(&name).is_none() {
        let what = if class == 2 { " (a structure: save its fields with save(..., '-struct', ...))" } else { "" };
        ignored.push(name + what);
        return Ok(());
    }
    if !CLASSES_OF_NUMBERS.contains(&class) || bits & COMPLEX != 0 {
        return Err(reader.fault(
            at,
            format!("{name}: expected a vector of real numbers; convert it with double(...) or real(...)"),
        ));
    }
    if shape.iter().filter(|size| **size != 1.0).count() > 1 {
        let shape = shape.iter().map(f64::to_string).collect::<Vec<_>>().join(" x ");
        return Err(
            reader.fault(at, format!("{name} is {shape}: expected a vector; save each column under a name of its own"))
        );
    }
    let data = reader.element()?;
    let values = reader.numbers(&data)?;
    let expected = shape.iter().product::<f64>();
    if values.len() as f64 != expected {
        return Err(reader.fault(data.at, format!("{name}: {expected} numbers expected, but {} found", values.len())));
    }
    columns.push(Column { name, values });
    Ok(())
}

/// A file that MATLAB, Octave and SciPy load: each column a column vector.
pub fn write(columns: &[Column]) -> Result<Vec<u8>, Fault> {
    let mut file = format!("{:<116}", "MATLAB 5.0 MAT-file, written by motorbench").into_bytes();
    file.extend([0; 8]);
    file.extend(0x0100_u16.to_le_bytes());
    file.extend(b"IM");
    for column in columns {
        let letters = column.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if !letters || !column.name.starts_with(|c: char| c.is_ascii_alphabetic()) || column.name.len() > 63 {
            return Err(Fault::at(
                &column.name,
                "this is not a valid name of a MATLAB variable: use letters, digits and _, at most 63",
            ));
        }
        let rows = u32::try_from(column.values.len()).map_err(|_| Fault::whole("too many samples for one variable"))?;
        let mut matrix = Vec::new();
        append(&mut matrix, UINT32, [u32::from(CLASS_DOUBLE), 0].iter().flat_map(|word| word.to_le_bytes()).collect());
        append(&mut matrix, INT32, [rows, 1].iter().flat_map(|size| size.to_le_bytes()).collect());
        append(&mut matrix, INT8, column.name.bytes().collect());
        append(&mut matrix, DOUBLE, column.values.iter().flat_map(|value| value.to_le_bytes()).collect());
        append(&mut file, MATRIX, matrix);
    }
    Ok(file)
}

fn append(file: &mut Vec<u8>, kind: u32, data: Vec<u8>) {
    file.extend(kind.to_le_bytes());
    file.extend((data.len() as u32).to_le_bytes());
    file.extend(data);
    file.resize(file.len().next_multiple_of(8), 0);
}

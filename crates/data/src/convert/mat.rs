//! MATLAB files of level 5 (`save -v6` and `-v7`, `scipy.io.savemat`). A header of 128 bytes is followed by elements
//! with a type, a size and data. Variables are elements of type matrix, plain or compressed with zlib.

use super::mat_objects::{self, Cells, Holds, SHORTEST, Values};
use super::{Fault, LONGEST_NAME, MOST_BYTES, TOO_MUCH, matrix, shortened};
use crate::content::{Column, Content, Series};
use flate2::read::ZlibDecoder;
use std::io::Read;

const HEADER: usize = 128;
// Types of elements.
const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
const UTF8: u32 = 16;
// Classes of arrays.
const CLASS_DOUBLE: u8 = 6;
const CLASSES_OF_NUMBERS: std::ops::RangeInclusive<u8> = CLASS_DOUBLE..=15;
const CLASS_CELL: u8 = 1;
const CLASS_STRUCTURE: u8 = 2;
const CLASS_TEXT: u8 = 4;
const CLASS_UINT8: u8 = 9;
const CLASS_UINT32: u8 = 13;
/// Objects of classes such as timeseries.
const CLASS_OBJECT_OF_CLASSDEF: u8 = 17;
const COMPLEX: u8 = 0x08;

/// Reads elements one after the other.
#[derive(Clone, Copy)]
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
    /// Offset of the compressed bytes in the file.
    origin: Option<usize>,
}

/// Bytes with a type.
#[derive(Clone, Copy)]
struct Element<'a> {
    /// Its type.
    kind: u32,
    /// Its bytes.
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

/// Everything with numbers: vectors, the columns of matrices, the fields of structures, the arrays of objects. A variable
/// that cannot be read is an error only if it is wanted.
pub fn read(bytes: &[u8], is_wanted: &dyn Fn(&str) -> bool) -> Result<Content, Fault> {
    let big_endian = match bytes.get(HEADER - 2..HEADER) {
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
    let mut found = Found {
        content: Content::default(),
        is_wanted,
        left_numbers: MOST_NUMBERS,
        objects: 0,
        variables: Vec::new(),
        workspace: None,
    };
    let mut left_bytes = MOST_BYTES;
    while reader.at < bytes.len() {
        let element = reader.element()?;
        if element.kind != COMPRESSED {
            let inner = Reader { at: element.at, bytes: &bytes[..element.at + element.data.len()], ..reader };
            found.variable(&element, inner)?;
            continue;
        }
        let mut plain = Vec::new();
        ZlibDecoder::new(element.data).take(left_bytes).read_to_end(&mut plain).map_err(|error| {
            Fault::at_byte(element.at, format!("its compressed data is damaged ({error}); save it again"))
        })?;
        left_bytes -= plain.len() as u64;
        if left_bytes == 0 {
            return Err(Fault::at_byte(element.at, format!("the file has {TOO_MUCH}")));
        }
        let mut inner = Reader { bytes: &plain, at: 0, big_endian, origin: Some(element.at) };
        let element = inner.element()?;
        let content = Reader { at: element.at, ..inner };
        found.variable(&element, content)?;
    }
    Ok(found.with_signals())
}

/// So many numbers are read: 1 GB of memory, and more than a recording has.
const MOST_NUMBERS: usize = 1 << 27;
/// Structures in structures are followed so deep.
const DEEPEST: usize = 12;
/// How the names of arrays of objects begin.
const OBJECT: &str = "object/";
/// Note on objects.
const OBJECTS: &str = "The names of these MATLAB objects cannot be read. Their arrays are called object/1, object/2 and so on, in the order of the file.";

/// The begin of an array: what is said before its data.
struct Head {
    /// The class of its values.
    class: u8,
    is_complex: bool,
    /// Its sides.
    shape: Vec<f64>,
    name: String,
    at: usize,
}

impl<'a> Reader<'a> {
    /// A reader of what is in an element.
    fn inside(&self, element: &Element<'_>) -> Self {
        Reader { at: element.at, bytes: &self.bytes[..element.at + element.data.len()], ..*self }
    }

    /// All elements from here to the end, or to the first that is damaged.
    fn elements(&mut self) -> Vec<Element<'a>> {
        std::iter::from_fn(|| self.element().ok()).collect()
    }

    /// The begin of the array in this element.
    fn head(&mut self) -> Result<Head, Fault> {
        let at = self.at;
        let flags = self.element()?;
        let [class, bits] = match (flags.data, self.big_endian) {
            ([class, bits, ..], false) | ([_, _, bits, class, ..], true) => [*class, *bits],
            _ => return Err(self.fault(at, "array flags of fewer than 4 bytes")),
        };
        if class == CLASS_OBJECT_OF_CLASSDEF {
            return Ok(Head { class, is_complex: false, shape: Vec::new(), name: String::new(), at });
        }
        let shape = self.element()?;
        let shape = self.numbers(&shape)?;
        let name = self.element()?;
        let name = name_of(name.data);
        Ok(Head { class, is_complex: bits & COMPLEX != 0, shape, name, at })
    }

    /// The values of an array of numbers.
    fn values(&mut self, head: &Head, name: &str) -> Result<Vec<f64>, Fault> {
        if !CLASSES_OF_NUMBERS.contains(&head.class) || head.is_complex {
            let what = "expected an array of real numbers; convert it with double(...) or real(...)";
            return Err(self.fault(head.at, format!("{name}: {what}")));
        }
        let data = self.element()?;
        let values = self.numbers(&data)?;
        let expected = head.shape.iter().product::<f64>();
        if values.len() as f64 != expected {
            let what = format!("{name}: {expected} numbers expected, but {} found", values.len());
            return Err(self.fault(data.at, what));
        }
        Ok(values)
    }

    /// The name of a variable that is an object, and the numbers of its objects.
    fn object_variable(&mut self) -> Option<(String, Vec<usize>)> {
        let name = self.element().ok()?;
        let name = String::from_utf8_lossy(name.data).into_owned();
        let (_kind, _class) = (self.element().ok()?, self.element().ok()?);
        let references = self.element().ok()?;
        let mut inside = self.inside(&references);
        let head = inside.head().ok()?;
        let numbers = inside.values(&head, &name).ok()?;
        Some((name, mat_objects::references(&numbers)))
    }

    /// The names of a structure's fields, which stand before the fields.
    fn field_names(&mut self) -> Result<Vec<String>, Fault> {
        let length = self.element()?;
        let length = self.numbers(&length)?.first().copied().unwrap_or(0.0) as usize;
        let names = self.element()?;
        let name = |bytes: &[u8]| name_of(bytes.split(|byte| *byte == 0).next().unwrap_or_default());
        Ok(names.data.chunks(length.max(1)).map(name).collect())
    }

    /// A text of one row, or its begin.
    fn text(&mut self) -> Option<String> {
        let whole = self.element().ok()?;
        // A letter has four bytes at most.
        let data = Element { data: &whole.data[..whole.data.len().min(4 * LONGEST_NAME)], ..whole };
        let letters = if data.kind == UTF8 { None } else { self.numbers(&data).ok() };
        let text = letters.map_or_else(
            || String::from_utf8_lossy(data.data).into_owned(),
            |letters| letters.iter().filter_map(|letter| char::from_u32(*letter as u32)).collect(),
        );
        Some(text.trim().to_owned()).filter(|text| !text.is_empty())
    }
}

/// A name from its bytes.
fn name_of(bytes: &[u8]) -> String {
    shortened(&String::from_utf8_lossy(bytes)).to_owned()
}

/// What has been read so far.
struct Found<'a> {
    content: Content,
    is_wanted: &'a dyn Fn(&str) -> bool,
    left_numbers: usize,
    objects: usize,
    /// Variables that are objects, with the numbers of these.
    variables: Vec<(String, Vec<usize>)>,
    /// The bytes that hold the objects.
    workspace: Option<Workspace>,
}

/// The bytes of a variable that holds all objects of a file.
struct Workspace {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Found<'_> {
    /// Reads a variable. `reader` is at the content of its element.
    fn variable(&mut self, element: &Element<'_>, mut reader: Reader<'_>) -> Result<(), Fault> {
        if element.kind != MATRIX || element.data.is_empty() {
            return Ok(());
        }
        let head = reader.head()?;
        let name = head.name.clone();
        if name.is_empty() && matches!(head.class, CLASS_UINT8 | CLASS_OBJECT_OF_CLASSDEF) {
            if head.class == CLASS_UINT8 {
                let data = reader.element()?;
                // Eight bytes of version and byte order.
                let start = data.at + data.data.len().min(8);
                self.objects(Reader { at: start, ..reader.inside(&data) }, 0);
                let bytes = data.data.get(8..).unwrap_or_default().to_vec();
                self.workspace = Some(Workspace { bytes, big_endian: reader.big_endian });
            } else {
                self.variables.extend(reader.object_variable());
            }
            return Ok(());
        }
        match self.array(&head, reader, &name, 0) {
            Err(fault) if (self.is_wanted)(&name) => Err(fault),
            Err(_) => {
                self.content.ignored.push(name);
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    /// The content, with the signals of objects by their names where these can be read.
    fn with_signals(mut self) -> Content {
        let signals = self.workspace.as_ref().map_or_else(Vec::new, |Workspace { bytes, big_endian }| {
            let reader = Reader { bytes, at: 0, big_endian: *big_endian, origin: None };
            objects(reader, &self.variables)
        });
        if !signals.is_empty() {
            self.content.columns.retain(|column| !column.name.starts_with(OBJECT));
            mat_objects::put(signals, &mut self.content);
        } else if self.objects > 0 {
            self.content.notes.push(OBJECTS.into());
        }
        self.content
    }

    /// Reads an array under a path: `log`, `out/signals/speed`.
    fn array(&mut self, head: &Head, mut reader: Reader<'_>, path: &str, depth: usize) -> Result<(), Fault> {
        if depth > DEEPEST {
            return Ok(());
        }
        match head.class {
            CLASS_CELL => self.cells(head, reader, path, depth),
            CLASS_STRUCTURE => self.structure(head, reader, path, depth),
            _ => {
                let values = reader.values(head, path)?;
                let Some(left) = self.left_numbers.checked_sub(values.len()) else {
                    return Err(reader.fault(head.at, format!("{path}: the file has {TOO_MUCH}")));
                };
                self.left_numbers = left;
                let sides: Vec<usize> =
                    head.shape.iter().map(|side| *side as usize).filter(|side| *side != 1).collect();
                match sides[..] {
                    [rows, columns] => self.content.columns.extend(matrix(path, &values, rows, columns, true)),
                    [] | [_] => self.content.columns.push(Column::new(path, values)),
                    // Simulink keeps a signal of one number as 1 x 1 x samples, one of several as n x 1 x samples.
                    _ => {
                        let shape = head.shape.iter().map(f64::to_string).collect::<Vec<_>>().join(" x ");
                        return Err(reader.fault(head.at, format!("{path} is {shape}: expected a vector or a matrix")));
                    }
                }
                Ok(())
            }
        }
    }

    fn cells(&mut self, head: &Head, mut reader: Reader<'_>, path: &str, depth: usize) -> Result<(), Fault> {
        let count = head.shape.iter().product::<f64>() as usize;
        for number in 1..=count {
            let element = reader.element()?;
            self.inner(&element, reader, &format!("{path}/{number}"), depth)?;
        }
        Ok(())
    }

    /// The array in an element of another one.
    fn inner(&mut self, element: &Element<'_>, reader: Reader<'_>, path: &str, depth: usize) -> Result<(), Fault> {
        if element.kind != MATRIX || element.data.is_empty() {
            return Ok(());
        }
        let mut inside = Reader { at: element.at, bytes: &reader.bytes[..element.at + element.data.len()], ..reader };
        let head = inside.head()?;
        match head.class {
            CLASS_CELL | CLASS_STRUCTURE => self.array(&head, inside, path, depth + 1),
            _ if CLASSES_OF_NUMBERS.contains(&head.class) => self.array(&head, inside, path, depth + 1),
            _ => Ok(()),
        }
    }

    fn structure(&mut self, head: &Head, mut reader: Reader<'_>, path: &str, depth: usize) -> Result<(), Fault> {
        let names = reader.field_names()?;
        if names.is_empty() {
            // Without a field it holds nothing, however many of it a damaged file promises.
            return Ok(());
        }
        let count = head.shape.iter().product::<f64>() as usize;
        for number in 1..=count {
            let mut fields = Vec::new();
            for field in &names {
                fields.push((field, reader.element()?));
            }
            let own = if count > 1 { format!("{path}/{number}") } else { path.to_owned() };
            // Simulink calls a signal by its label, or by the block that it comes from.
            let label = ["label", "blockName"].into_iter().find_map(|key| {
                let (_, element) = fields.iter().find(|(name, _)| *name == key)?;
                let mut inside =
                    Reader { at: element.at, bytes: &reader.bytes[..element.at + element.data.len()], ..reader };
                inside.head().ok().filter(|head| head.class == CLASS_TEXT)?;
                inside.text()
            });
            for (name, element) in &fields {
                let path = match &label {
                    Some(label) if *name == "values" => format!("{path}/{label}"),
                    Some(_) => continue,
                    None => format!("{own}/{name}"),
                };
                self.inner(element, reader, &path, depth)?;
            }
        }
        Ok(())
    }

    /// The arrays of objects (timeseries, Dataset), which stand together at the end of the file.
    fn objects(&mut self, mut reader: Reader<'_>, depth: usize) {
        while reader.at < reader.bytes.len() {
            let Ok(element) = reader.element() else { return };
            if element.kind != MATRIX || depth > DEEPEST {
                continue;
            }
            let inside = Reader { at: element.at, bytes: &reader.bytes[..element.at + element.data.len()], ..reader };
            let mut of_array = inside;
            match of_array.head() {
                Ok(head) if CLASSES_OF_NUMBERS.contains(&head.class) && !head.is_complex => {
                    let path = format!("{OBJECT}{}", self.objects + 1);
                    let is_long = head.shape.iter().any(|side| *side >= SHORTEST as f64);
                    // Bytes are the names and the order of the objects.
                    if is_long
                        && !matches!(head.class, CLASS_UINT8 | CLASS_UINT32)
                        && let Ok(values) = of_array.values(&head, &path)
                    {
                        self.objects += 1;
                        self.content.columns.push(Column::new(path, values));
                    }
                }
                _ => self.objects(inside, depth + 1),
            }
        }
    }
}

/// The cells of objects.
struct CellsOfObjects<'a> {
    reader: Reader<'a>,
    cells: Vec<Element<'a>>,
}

/// The signals of the objects in these bytes.
fn objects(reader: Reader<'_>, variables: &[(String, Vec<usize>)]) -> Vec<Series> {
    let found = || {
        let cells = cells_of_objects(reader, 0)?;
        let mut first = reader.inside(cells.first()?);
        first.head().ok()?;
        let bytes = first.element().ok()?.data;
        Some(mat_objects::signals(CellsOfObjects { reader, cells }, bytes, reader.big_endian, variables))
    };
    found().unwrap_or_default()
}

/// The first array of cells.
fn cells_of_objects(mut reader: Reader<'_>, depth: usize) -> Option<Vec<Element<'_>>> {
    if depth > DEEPEST {
        return None;
    }
    let element = reader.elements().into_iter().find(|element| element.kind == MATRIX)?;
    let mut inside = reader.inside(&element);
    let head = inside.head().ok()?;
    if head.class == CLASS_CELL { Some(inside.elements()) } else { cells_of_objects(inside, depth + 1) }
}

impl<'a> Cells for CellsOfObjects<'a> {
    /// Its begin, and where its data stands.
    type Array = (Head, Reader<'a>);

    fn cell(&self, number: usize) -> Option<Self::Array> {
        let mut inside = self.reader.inside(self.cells.get(number)?);
        let head = inside.head().ok()?;
        Some((head, inside))
    }

    fn holds(&self, (head, _): &Self::Array) -> Holds {
        match head.class {
            CLASS_UINT32 => Holds::References,
            CLASS_CELL | CLASS_STRUCTURE => Holds::Arrays,
            _ => Holds::Else,
        }
    }

    fn values(&self, (head, inside): &Self::Array) -> Option<Values> {
        let values = { *inside }.values(head, "").ok()?;
        Some(Values { shape: head.shape.iter().map(|side| *side as usize).collect(), values })
    }

    fn text(&self, (head, inside): &Self::Array) -> Option<String> {
        (head.class == CLASS_TEXT).then(|| { *inside }.text()).flatten()
    }

    fn inner(&self, (head, inside): &Self::Array) -> Vec<(String, Self::Array)> {
        let mut inside = *inside;
        let is_structure = head.class == CLASS_STRUCTURE;
        let mut names = if is_structure { inside.field_names().unwrap_or_default() } else { Vec::new() };
        if names.is_empty() {
            names.push(String::new());
        }
        let elements = inside.elements();
        let named = names.iter().cycle().zip(&elements).filter(|(_, element)| element.kind == MATRIX);
        named
            .filter_map(|(name, element)| {
                let mut inner = inside.inside(element);
                Some((name.clone(), (inner.head().ok()?, inner)))
            })
            .collect()
    }
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

#[cfg(test)]
mod tests {
    use crate::convert::{Dialect, Format, read};

    /// An element of a level 5 file: its kind, its length, its bytes up to a multiple of eight.
    fn element(kind: u32, data: &[u8]) -> Vec<u8> {
        let mut bytes = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        bytes.extend(data);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    #[test]
    fn a_structure_without_fields_ends_however_many_of_it_are_promised() {
        let sides = [i32::MAX, i32::MAX].map(i32::to_le_bytes).concat();
        let structure = [
            element(6, &[2, 0, 0, 0, 0, 0, 0, 0]),
            element(5, &sides),
            element(1, b"data"),
            element(5, &4_i32.to_le_bytes()),
            element(1, &[]),
        ];
        let mut file = vec![b' '; 124];
        file.extend([0x00, 0x01, b'I', b'M']);
        file.extend(element(14, &structure.concat()));
        let refused = read("empty.mat", &file, Format::Mat, &[], Dialect::default());
        assert!(refused.is_err());
    }
}

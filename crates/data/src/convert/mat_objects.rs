//! Objects of MATLAB in files of level 5: the signals of timeseries and of a Simulink Dataset, with their names.
//!
//! A variable without a name holds an array of cells. The first has bytes that say which objects there are, of which
//! class, and in which cell each of their properties stands. The others have the values of the properties.

use super::mat::{CLASS_CELL, CLASS_STRUCTURE, CLASS_TEXT, CLASS_UINT32, Element, Head, MATRIX, Reader};
use super::matrix;
use crate::content::{Column, Series};
use std::collections::BTreeSet;

/// Objects in objects are followed so deep.
const DEEPEST: usize = 24;
/// The cells of properties begin after the one with bytes and an empty one.
const FIRST_VALUE: usize = 2;
/// The first number of a reference to objects.
const REFERENCE: f64 = 3_707_764_736.0;
/// A property has its value in a cell.
const IN_A_CELL: u32 = 1;

/// A property of an object: its name, and the cell of its value.
type Property = (String, usize);

/// The objects of a file.
pub struct Objects<'a> {
    reader: Reader<'a>,
    cells: Vec<Element<'a>>,
    /// Properties of each object by its number, from 1.
    properties: Vec<Vec<Property>>,
    visited: BTreeSet<usize>,
    series: Vec<Series>,
}

/// The signals of the objects, with times of their own. `variables` are the names of variables with the numbers of their
/// objects. Empty if nothing can be read.
pub fn signals(reader: Reader<'_>, variables: &[(String, Vec<usize>)]) -> Vec<Series> {
    let Some(mut objects) = Objects::of(reader) else { return Vec::new() };
    for (name, numbers) in variables {
        for number in numbers {
            objects.object(*number, name, 0);
        }
    }
    for number in 1..objects.properties.len() {
        objects.object(number, "", 0);
    }
    objects.series
}

/// The numbers of the objects that an array refers to: a mark, the dimensions, the objects, and their class.
pub fn references(values: &[f64]) -> Vec<usize> {
    let [REFERENCE, dimensions, rest @ ..] = values else { return Vec::new() };
    let Some((shape, rest)) = rest.split_at_checked(*dimensions as usize) else { return Vec::new() };
    let count = shape.iter().product::<f64>() as usize;
    rest.get(..count).unwrap_or_default().iter().map(|number| *number as usize).collect()
}

impl<'a> Objects<'a> {
    fn of(reader: Reader<'a>) -> Option<Self> {
        let cells = cells(reader, 0)?;
        let mut bytes = reader.inside(cells.first()?);
        bytes.head().ok()?;
        let bytes = bytes.element().ok()?.data;
        let properties = properties(bytes, reader.big_endian())?;
        Some(Self { reader, cells, properties, visited: BTreeSet::new(), series: Vec::new() })
    }

    /// The array in a cell, and where its data begins.
    fn array(&self, cell: usize) -> Option<(Head, Reader<'a>)> {
        let mut inside = self.reader.inside(self.cells.get(cell)?);
        let head = inside.head().ok()?;
        Some((head, inside))
    }

    fn cell_of(&self, object: usize, names: &[&str]) -> Option<usize> {
        let properties = self.properties.get(object)?;
        properties.iter().find(|(name, _)| names.contains(&name.as_str())).map(|(_, cell)| *cell)
    }

    fn text(&self, object: usize, name: &str) -> Option<String> {
        let (head, mut inside) = self.array(self.cell_of(object, &[name])?)?;
        (head.class == CLASS_TEXT).then(|| inside.text()).flatten()
    }

    fn numbers(&self, object: usize, name: &str) -> Option<Vec<f64>> {
        let (head, mut inside) = self.array(self.cell_of(object, &[name])?)?;
        inside.values(&head, name).ok()
    }

    /// Reads an object. `outer` is the name of what refers to it.
    fn object(&mut self, number: usize, outer: &str, depth: usize) {
        if depth > DEEPEST || number == 0 || number >= self.properties.len() || !self.visited.insert(number) {
            return;
        }
        let name = self.text(number, "Name").unwrap_or_else(|| outer.to_owned());
        if self.signal(number, &name).is_some() {
            return;
        }
        for (_, cell) in self.properties[number].clone() {
            if let Some((head, inside)) = self.array(cell) {
                self.follow(&head, inside, &name, depth + 1);
            }
        }
    }

    /// Follows the references in an array, in its cells and in its fields.
    fn follow(&mut self, head: &Head, mut inside: Reader<'a>, outer: &str, depth: usize) {
        if depth > DEEPEST {
            return;
        }
        match head.class {
            CLASS_UINT32 => {
                for number in references(&inside.values(head, "").unwrap_or_default()) {
                    self.object(number, outer, depth);
                }
            }
            CLASS_CELL | CLASS_STRUCTURE => {
                let names =
                    if head.class == CLASS_STRUCTURE { inside.field_names().unwrap_or_default() } else { Vec::new() };
                let elements = inside.elements();
                // A field of that name says how the ones beside it are called.
                let place = names.iter().position(|name| name == "Name");
                let said = place.and_then(|place| {
                    let mut inside = inside.inside(elements.get(place)?);
                    inside.head().ok().filter(|head| head.class == CLASS_TEXT)?;
                    inside.text()
                });
                for element in elements.iter().filter(|element| element.kind == MATRIX) {
                    let mut inner = inside.inside(element);
                    if let Ok(head) = inner.head() {
                        self.follow(&head, inner, said.as_deref().unwrap_or(outer), depth + 1);
                    }
                }
            }
            _ => {}
        }
    }

    /// Reads a timeseries. `None`: the object is none.
    fn signal(&mut self, number: usize, name: &str) -> Option<()> {
        let (head, mut inside) = self.array(self.cell_of(number, &["Data_", "Data"])?)?;
        let values = inside.values(&head, name).ok()?;
        let info = self.cell_of(number, &["TimeInfo"]).and_then(|cell| {
            let (head, mut inside) = self.array(cell)?;
            references(&inside.values(&head, "").ok()?).first().copied()
        });
        let time_s =
            self.numbers(number, "Time").or_else(|| self.times(info?, values.len())).filter(|times| times.len() > 1)?;
        let name = if name.is_empty() { "signal" } else { name };
        let sides: Vec<usize> = head.shape.iter().map(|side| *side as usize).filter(|side| *side != 1).collect();
        let columns = match sides[..] {
            [rows, columns] => matrix(name, &values, rows, columns, true),
            _ => vec![Column::new(name, values)],
        };
        for Column { name, values, .. } in columns.into_iter().filter(|column| column.values.len() == time_s.len()) {
            let equal = self.series.iter().filter(|other| other.name.split('#').next() == Some(&name)).count();
            let name = if equal == 0 { name } else { format!("{name}#{}", equal + 1) };
            self.series.push(Series { name, time_s: time_s.clone(), values });
        }
        Some(())
    }

    /// The times of a timeseries: each of them, or start, step and number. There are at most as many as values.
    fn times(&self, info: usize, most: usize) -> Option<Vec<f64>> {
        if let Some(times) = self.numbers(info, "Time_").filter(|times| !times.is_empty()) {
            return Some(times);
        }
        let one = |name: &str| self.numbers(info, name)?.first().copied();
        let (start_s, step_s, count) = (one("Start_").unwrap_or(0.0), one("Increment_")?, one("Length")?);
        let count = (0.0..=most as f64).contains(&count).then_some(count as usize)?;
        Some((0..count).map(|row| start_s + row as f64 * step_s).collect())
    }
}

/// The cells with the objects: the first array of cells.
fn cells(mut reader: Reader<'_>, depth: usize) -> Option<Vec<Element<'_>>> {
    if depth > DEEPEST {
        return None;
    }
    let is_array = |element: &Element<'_>| element.kind == MATRIX;
    let element = reader.elements().into_iter().find(is_array)?;
    let mut inside = reader.inside(&element);
    let head = inside.head().ok()?;
    if head.class == CLASS_CELL { Some(inside.elements()) } else { cells(inside, depth + 1) }
}

/// Where the parts of the bytes begin: classes, properties of the one kind, objects, properties of the other, the end.
const PARTS: std::ops::Range<usize> = 2..7;
/// The names of classes and properties begin here.
const NAMES: usize = 40;
/// Numbers for each object: its class, two unused ones, and its properties of either kind; then its order.
const OBJECT: usize = 6;

/// The properties of each object.
fn properties(bytes: &[u8], big_endian: bool) -> Option<Vec<Vec<Property>>> {
    let word = |bytes: &[u8]| {
        let bytes = bytes.try_into().expect("four bytes");
        if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    };
    let words =
        |from: usize, to: usize| -> Option<Vec<u32>> { Some(bytes.get(from..to)?.chunks_exact(4).map(word).collect()) };
    let head = words(0, NAMES)?;
    let parts: Vec<usize> = head[PARTS].iter().map(|part| *part as usize).collect();
    let names: Vec<String> = bytes
        .get(NAMES..parts[0])?
        .split(|byte| *byte == 0)
        .map(|name| String::from_utf8_lossy(name).into_owned())
        .collect();
    let of_kind = |words: &[u32]| {
        let mut lists: Vec<Vec<Property>> = Vec::new();
        let mut rest = words;
        while let [count, after @ ..] = rest {
            let Some((list, after)) = after.split_at_checked((*count as usize).saturating_mul(3)) else { break };
            let value = |property: &[u32]| {
                let name = names.get((property[0] as usize).checked_sub(1)?)?;
                (property[1] == IN_A_CELL).then(|| (name.clone(), property[2] as usize + FIRST_VALUE))
            };
            lists.push(list.chunks_exact(3).filter_map(value).collect());
            // Each list fills whole eight bytes.
            let odd = (1 + list.len()) % 2;
            rest = after.get(odd..).unwrap_or_default();
        }
        lists
    };
    let (saved, plain) = (of_kind(&words(parts[1], parts[2])?), of_kind(&words(parts[3], parts[4])?));
    let objects = words(parts[2], parts[3])?;
    let of_object = |object: &[u32]| {
        let list = |lists: &[Vec<Property>], number: u32| lists.get(number as usize).cloned().unwrap_or_default();
        [list(&saved, object[3]), list(&plain, object[4])].concat()
    };
    Some(objects.chunks_exact(OBJECT).map(of_object).collect())
}

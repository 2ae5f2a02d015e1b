//! Objects of MATLAB: the signals of timeseries and of a Simulink Dataset, with their names.
//!
//! A file keeps the parts of all its objects in one list of cells. The first has bytes that say which objects there are,
//! of which class, and in which cell each of their properties stands. The others have the values of the properties.
//! Level 5 and HDF5 keep the cells differently; what they mean is the same.

use super::{matrix, shortened};
use crate::content::{Column, Content, Series};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Objects in objects are followed so deep.
const DEEPEST: usize = 24;
/// So many arrays are followed: more than a recording has, and few enough for a file that refers to itself.
const MOST_FOLLOWED: usize = 1_000_000;
/// So many signals are read: more than a recording has. Objects may share their samples, so a small file may promise many.
const MOST_SIGNALS: usize = 10_000;
/// The cells of properties begin after the one with bytes and an empty one.
const FIRST_VALUE: usize = 2;
/// The first number of a reference to objects.
const REFERENCE: f64 = 3_707_764_736.0;
/// A property has its value in a cell.
const IN_A_CELL: u32 = 1;
/// Shorter arrays are settings.
pub const SHORTEST: usize = 20;

/// Properties that objects may share.
#[derive(Default)]
struct Properties {
    /// The cells of their values, in the order of the file.
    cells: Vec<usize>,
    /// The cell of each name.
    by_name: BTreeMap<Arc<str>, usize>,
}

/// The properties of a file's objects.
struct PropertyLists {
    lists: Vec<Properties>,
    /// The two lists of each object by its number, from 1.
    of_objects: Vec<[usize; 2]>,
}

/// Numbers with their sides.
pub struct Values {
    /// Rows, columns, and more.
    pub shape: Vec<usize>,
    /// The numbers, column by column.
    pub values: Vec<f64>,
}

/// What an array holds.
pub enum Holds {
    /// References to objects, or other whole numbers of 32 bits.
    References,
    /// Other arrays, by their names if they are fields.
    Arrays,
    /// Anything else.
    Else,
}

/// The cells of a file.
pub trait Cells {
    /// An array in a cell or in another array.
    type Array;

    /// The array in a cell.
    fn cell(&self, number: usize) -> Option<Self::Array>;
    /// What it holds.
    fn holds(&self, array: &Self::Array) -> Holds;
    /// Its numbers, if it has these.
    fn values(&self, array: &Self::Array) -> Option<Values>;
    /// Its text, if it is one.
    fn text(&self, array: &Self::Array) -> Option<String>;
    /// The arrays in it, with the names of fields.
    fn inner(&self, array: &Self::Array) -> Vec<(String, Self::Array)>;
}

/// A list that many objects may share.
type Shared = Arc<Vec<f64>>;

/// The signals in a cell: what follows the signal's name, and the samples.
type Signals = Arc<Vec<(String, Shared)>>;

/// The objects of a file.
struct Objects<C: Cells> {
    cells: C,
    properties: PropertyLists,
    visited: BTreeSet<usize>,
    /// Lists of properties whose cells were followed.
    followed: BTreeSet<usize>,
    left_to_follow: usize,
    signals: BTreeMap<usize, Option<Signals>>,
    numbers: BTreeMap<usize, Option<Shared>>,
    /// Times that are told as start, step and number.
    even_times: BTreeMap<(u64, u64, usize), Shared>,
    /// Samples that were read, and times that were made for them.
    samples: usize,
    made_times: usize,
    names: BTreeMap<String, usize>,
    series: Vec<Series>,
}

/// The signals of the objects, with times of their own. `bytes` are those of the first cell. `variables` are the names of
/// variables with the numbers of their objects. Empty if nothing can be read.
pub fn signals<C: Cells>(cells: C, bytes: &[u8], big_endian: bool, variables: &[(String, Vec<usize>)]) -> Vec<Series> {
    let Some(properties) = properties(bytes, big_endian) else { return Vec::new() };
    let mut objects = Objects {
        cells,
        properties,
        visited: BTreeSet::new(),
        followed: BTreeSet::new(),
        left_to_follow: MOST_FOLLOWED,
        signals: BTreeMap::new(),
        numbers: BTreeMap::new(),
        even_times: BTreeMap::new(),
        samples: 0,
        made_times: 0,
        names: BTreeMap::new(),
        series: Vec::new(),
    };
    for (name, numbers) in variables {
        for number in numbers {
            objects.object(*number, name, 0);
        }
    }
    for number in 1..objects.properties.of_objects.len() {
        objects.object(number, "", 0);
    }
    objects.series
}

/// Puts signals into the content of a file. They stay series if there is nothing else of their length.
pub fn put(signals: Vec<Series>, content: &mut Content) {
    if !content.columns.iter().any(|column| column.values.len() >= SHORTEST) {
        content.ignored.extend(content.columns.drain(..).map(|column| column.name));
        content.series = signals;
        return;
    }
    // A list that several signals share becomes one column.
    let mut known = BTreeSet::new();
    for Series { name, time_s, values } in &signals {
        if known.insert(Arc::as_ptr(time_s)) {
            content.columns.push(Column::new(format!("{name}/time"), time_s.to_vec()));
        }
        if known.insert(Arc::as_ptr(values)) {
            content.columns.push(Column::new(name, values.to_vec()));
        }
    }
}

/// The numbers of the objects that an array refers to: a mark, the dimensions, the objects, and their class.
pub fn references(values: &[f64]) -> Vec<usize> {
    let [REFERENCE, dimensions, rest @ ..] = values else { return Vec::new() };
    let Some((shape, rest)) = rest.split_at_checked(*dimensions as usize) else { return Vec::new() };
    let count = shape.iter().product::<f64>() as usize;
    rest.get(..count).unwrap_or_default().iter().map(|number| *number as usize).collect()
}

impl<C: Cells> Objects<C> {
    fn cell_of(&self, object: usize, names: &[&str]) -> Option<usize> {
        let lists = self.properties.of_objects.get(object)?;
        let cell = |name: &&str| lists.iter().find_map(|list| self.properties.lists[*list].by_name.get(*name));
        names.iter().find_map(cell).copied()
    }

    fn text(&self, object: usize, name: &str) -> Option<String> {
        let text = self.cells.text(&self.cells.cell(self.cell_of(object, &[name])?)?)?;
        Some(shortened(&text).to_owned())
    }

    /// A single number.
    fn setting(&mut self, object: usize, name: &str) -> Option<f64> {
        let cell = self.cell_of(object, &[name])?;
        self.numbers(cell)?.first().copied()
    }

    /// Reads an object. `outer` is the name of what refers to it.
    fn object(&mut self, number: usize, outer: &str, depth: usize) {
        if depth > DEEPEST || number == 0 || number >= self.properties.of_objects.len() || !self.visited.insert(number)
        {
            return;
        }
        let name = self.text(number, "Name").unwrap_or_else(|| outer.to_owned());
        if self.signal(number, &name).is_some() {
            return;
        }
        for list in self.properties.of_objects[number] {
            if !self.followed.insert(list) {
                continue;
            }
            for cell in self.properties.lists[list].cells.clone() {
                if let Some(array) = self.cells.cell(cell) {
                    self.follow(&array, &name, depth + 1);
                }
            }
        }
    }

    /// Follows the references in an array, in its cells and in its fields.
    fn follow(&mut self, array: &C::Array, outer: &str, depth: usize) {
        if depth > DEEPEST || self.left_to_follow == 0 {
            return;
        }
        self.left_to_follow -= 1;
        match self.cells.holds(array) {
            Holds::References => {
                let values = self.cells.values(array).map_or_else(Vec::new, |found| found.values);
                for number in references(&values) {
                    self.object(number, outer, depth);
                }
            }
            Holds::Arrays => {
                let inner = self.cells.inner(array);
                // A field of that name says how the ones beside it are called.
                let said = inner.iter().find(|(name, _)| name == "Name").and_then(|(_, array)| self.cells.text(array));
                for (_, array) in &inner {
                    self.follow(array, said.as_deref().unwrap_or(outer), depth + 1);
                }
            }
            Holds::Else => {}
        }
    }

    /// Reads a timeseries. `None`: the object is none.
    fn signal(&mut self, number: usize, name: &str) -> Option<()> {
        let columns = self.samples(self.cell_of(number, &["Data_", "Data"])?)?;
        let count = columns.first()?.1.len();
        let time_s = self.times(number, count).filter(|times| times.len() > 1)?;
        let name = if name.is_empty() { "signal" } else { name };
        let left = MOST_SIGNALS.saturating_sub(self.series.len());
        for (ending, values) in columns.iter().filter(|(_, values)| values.len() == time_s.len()).take(left) {
            let name = format!("{name}{ending}");
            let equal = self.names.entry(name.clone()).or_default();
            *equal += 1;
            let name = if *equal == 1 { name } else { format!("{name}#{equal}") };
            self.series.push(Series { name, time_s: time_s.clone(), values: values.clone() });
        }
        Some(())
    }

    /// The samples in a cell, read once.
    fn samples(&mut self, cell: usize) -> Option<Signals> {
        if let Some(known) = self.signals.get(&cell) {
            return known.clone();
        }
        let found =
            self.cells.cell(cell).and_then(|array| self.cells.values(&array)).map(|Values { shape, values }| {
                self.samples += values.len();
                let sides: Vec<usize> = shape.into_iter().filter(|side| *side != 1).collect();
                Arc::new(match sides[..] {
                    [rows, columns] => matrix("", &values, rows, columns, true)
                        .into_iter()
                        .map(|column| (format!("/{}", column.name), Arc::new(column.values)))
                        .collect(),
                    _ => vec![(String::new(), Arc::new(values))],
                })
            });
        self.signals.insert(cell, found.clone());
        found
    }

    /// The times of a timeseries: each of them, or start, step and number. There are at most as many as samples.
    fn times(&mut self, number: usize, most: usize) -> Option<Shared> {
        if let Some(times) = self.cell_of(number, &["Time"]).and_then(|cell| self.numbers(cell)) {
            return Some(times);
        }
        let cell = self.cell_of(number, &["TimeInfo"])?;
        let info = *references(&self.numbers(cell)?).first()?;
        let listed = self.cell_of(info, &["Time_"]).and_then(|cell| self.numbers(cell));
        if let Some(times) = listed.filter(|times| !times.is_empty()) {
            return Some(times);
        }
        let start_s = self.setting(info, "Start_").unwrap_or(0.0);
        let (step_s, count) = (self.setting(info, "Increment_")?, self.setting(info, "Length")?);
        let count = (0.0..=most as f64).contains(&count).then_some(count as usize)?;
        self.even_times(start_s, step_s, count)
    }

    /// The numbers in a cell, read once.
    fn numbers(&mut self, cell: usize) -> Option<Shared> {
        if let Some(known) = self.numbers.get(&cell) {
            return known.clone();
        }
        let found = self.cells.cell(cell).and_then(|array| self.cells.values(&array));
        let found = found.map(|found| Arc::new(found.values));
        self.numbers.insert(cell, found.clone());
        found
    }

    /// Evenly spaced times. All together they are no more than the samples of the file.
    fn even_times(&mut self, start_s: f64, step_s: f64, count: usize) -> Option<Shared> {
        let key = (start_s.to_bits(), step_s.to_bits(), count);
        if let Some(known) = self.even_times.get(&key) {
            return Some(known.clone());
        }
        self.made_times += count;
        let times = || Arc::new((0..count).map(|row| start_s + row as f64 * step_s).collect::<Vec<f64>>());
        let times = (self.made_times <= self.samples).then(times)?;
        self.even_times.insert(key, times.clone());
        Some(times)
    }
}

/// Where the parts of the bytes begin: classes, properties of the one kind, objects, properties of the other, the end.
const PARTS: std::ops::Range<usize> = 2..7;
/// The names of classes and properties begin here.
const NAMES: usize = 40;
/// Numbers for each object: its class, two unused ones, and its properties of either kind; then its order.
const OBJECT: usize = 6;

/// The properties of each object, from the bytes of the first cell.
fn properties(bytes: &[u8], big_endian: bool) -> Option<PropertyLists> {
    let word = |bytes: &[u8]| {
        let bytes = bytes.try_into().expect("four bytes");
        if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    };
    let words =
        |from: usize, to: usize| -> Option<Vec<u32>> { Some(bytes.get(from..to)?.chunks_exact(4).map(word).collect()) };
    let head = words(0, NAMES)?;
    let parts: Vec<usize> = head[PARTS].iter().map(|part| *part as usize).collect();
    let names: Vec<Arc<str>> = bytes
        .get(NAMES..parts[0])?
        .split(|byte| *byte == 0)
        .map(|name| Arc::from(String::from_utf8_lossy(name)))
        .collect();
    let of_kind = |words: &[u32]| {
        let mut lists: Vec<Properties> = Vec::new();
        let mut rest = words;
        while let [count, after @ ..] = rest {
            let Some((list, after)) = after.split_at_checked((*count as usize).saturating_mul(3)) else { break };
            let mut properties = Properties::default();
            for [name, _, cell] in list.as_chunks().0.iter().filter(|[_, kind, _]| *kind == IN_A_CELL) {
                let Some(name) = (*name as usize).checked_sub(1).and_then(|name| names.get(name)) else { continue };
                let cell = *cell as usize + FIRST_VALUE;
                properties.cells.push(cell);
                properties.by_name.entry(name.clone()).or_insert(cell);
            }
            lists.push(properties);
            // Each list fills whole eight bytes.
            let odd = (1 + list.len()) % 2;
            rest = after.get(odd..).unwrap_or_default();
        }
        lists
    };
    let mut lists = of_kind(&words(parts[1], parts[2])?);
    let saved = lists.len();
    lists.extend(of_kind(&words(parts[3], parts[4])?));
    let none = lists.len();
    lists.push(Properties::default());
    let objects = words(parts[2], parts[3])?;
    let of_object = |object: &[u32; OBJECT]| {
        let [first, second] = [object[3] as usize, object[4] as usize];
        [if first < saved { first } else { none }, if second < none - saved { saved + second } else { none }]
    };
    Some(PropertyLists { lists, of_objects: objects.as_chunks().0.iter().map(of_object).collect() })
}

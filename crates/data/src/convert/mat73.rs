//! MATLAB files of version 7.3, which are HDF5: variables, structures, cells, objects, and the signals of a Simulink
//! Dataset.

use super::mat_objects::{self, Cells, Holds, Values};
use super::{Fault, matrix};
use crate::content::{Column, Content, Series};
use hdf5_pure::{AttrValue, DType, Dataset, File as Hdf5, Group, Object};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// How such a file begins: MATLAB's own text, or HDF5 alone.
pub fn is_one(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x89HDF\r\n\x1a\n") || bytes.starts_with(b"MATLAB 7.3 MAT-file")
}

/// Structures in structures are followed so deep.
const DEEPEST: usize = 12;
/// So many datasets are looked at: more than a recording has, and few enough for a file that refers to itself.
const MOST_DATASETS: usize = 1_000_000;
/// So many numbers are read: 1 GB of memory, and more than a recording has. A small file may claim to hold more.
const MOST_NUMBERS: usize = 1 << 27;
/// Where MATLAB keeps what cells and objects refer to.
const REFERENCES: &str = "#refs#";
/// Where MATLAB keeps the list of what objects refer to.
const OBJECTS: &str = "#subsystem#";
/// Where Simulink keeps the samples of signals that it streams.
const STREAM: &str = "#sigstream#";

/// Reads all numbers.
pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    let damaged = |error: hdf5_pure::Error| {
        Fault::whole(format!("this HDF5 file (MATLAB 7.3) cannot be read ({error}): save it with save(..., '-v7')"))
    };
    let file = Hdf5::from_bytes(bytes.to_vec()).map_err(damaged)?;
    let root = file.root();
    let reader = Reader { left_numbers: Cell::new(MOST_NUMBERS), left_datasets: Cell::new(MOST_DATASETS) };
    let signals = root.group(REFERENCES).map(|references| reader.signals(&file, &references)).unwrap_or_default();
    let mut found = Found { reader: &reader, content: Content::default(), variables: Vec::new() };
    found.walk(&root, "", 0).map_err(damaged)?;
    let Found { mut content, variables, .. } = found;
    if !signals.is_empty() {
        // A Dataset has times of its own; other variables beside it are parameters.
        content.ignored.extend(content.columns.drain(..).map(|column| column.name));
        content.series = signals;
        return Ok(content);
    }
    let signals = root.group(OBJECTS).ok().and_then(|objects| reader.objects(&objects, &variables));
    if let Some(signals) = signals.filter(|signals| !signals.is_empty()) {
        mat_objects::put(signals, &mut content);
    }
    Ok(content)
}

/// Reads datasets, so many as memory and time allow.
struct Reader {
    left_numbers: Cell<usize>,
    left_datasets: Cell<usize>,
}

/// What has been read so far.
struct Found<'a> {
    reader: &'a Reader,
    content: Content,
    /// Variables that are objects, with the numbers of these.
    variables: Vec<(String, Vec<usize>)>,
}

impl Found<'_> {
    /// Reads the datasets of a group and of the groups in it.
    fn walk(&mut self, group: &Group, path: &str, depth: usize) -> Result<(), hdf5_pure::Error> {
        if !self.reader.may_look() {
            return Ok(());
        }
        let own = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}/{name}") };
        for name in group.datasets()? {
            if !name.starts_with('#') {
                self.dataset(&group.dataset(&name)?, &own(&name), depth);
            }
        }
        for name in group.groups()? {
            if !name.starts_with('#') && depth < DEEPEST && self.reader.may_look() {
                self.walk(&group.group(&name)?, &own(&name), depth + 1)?;
            }
        }
        Ok(())
    }

    /// Reads a dataset: numbers, an object, or the cells that it refers to.
    fn dataset(&mut self, dataset: &Dataset, path: &str, depth: usize) {
        if !self.reader.may_look() || is_empty(dataset) || is_text(dataset) {
            return;
        }
        if dataset.attrs().is_ok_and(|attributes| attributes.contains_key("MATLAB_object_decode")) {
            let numbers = self.reader.numbers(dataset).unwrap_or_default();
            self.variables.push((path.to_owned(), mat_objects::references(&numbers)));
            return;
        }
        if !matches!(dataset.dtype(), Ok(DType::ObjectReference)) {
            match self.reader.columns(dataset, path) {
                Some(columns) => self.content.columns.extend(columns),
                None => self.content.ignored.push(path.to_owned()),
            }
            return;
        }
        for (index, target) in dataset.dereference().unwrap_or_default().into_iter().enumerate() {
            let path = format!("{path}/{}", index + 1);
            match target {
                Object::Dataset(inner) if depth < DEEPEST => self.dataset(&inner, &path, depth + 1),
                Object::Group(inner) if depth < DEEPEST => {
                    let _ = self.walk(&inner, &path, depth + 1);
                }
                _ => {}
            }
        }
    }
}

fn is_empty(dataset: &Dataset) -> bool {
    dataset.attrs().is_ok_and(|attributes| attributes.contains_key("MATLAB_empty"))
}

fn is_text(dataset: &Dataset) -> bool {
    let class = dataset.attrs().ok().and_then(|attributes| match attributes.get("MATLAB_class") {
        Some(AttrValue::String(class) | AttrValue::AsciiString(class)) => Some(class.clone()),
        _ => None,
    });
    class.is_some_and(|class| class == "char")
}

/// The sides of a dataset. MATLAB's stand in the reverse order.
fn shape(dataset: &Dataset) -> Option<Vec<usize>> {
    dataset.shape().ok()?.into_iter().map(|side| usize::try_from(side).ok()).collect()
}

impl Reader {
    fn may_look(&self) -> bool {
        self.left_datasets.set(self.left_datasets.get().saturating_sub(1));
        self.left_datasets.get() > 0
    }

    /// Whether so many numbers may still be read.
    fn may_read(&self, count: usize) -> Option<()> {
        self.left_numbers.set(self.left_numbers.get().checked_sub(count)?);
        Some(())
    }

    fn numbers(&self, dataset: &Dataset) -> Option<Vec<f64>> {
        let count = shape(dataset)?.into_iter().try_fold(1_usize, usize::checked_mul)?;
        self.may_read(count)?;
        // A file may promise more than it holds.
        dataset.read_f64().ok().filter(|values| values.len() == count)
    }

    fn bytes(&self, dataset: &Dataset) -> Option<Vec<u8>> {
        let count = shape(dataset)?.into_iter().try_fold(1_usize, usize::checked_mul)?;
        let bytes = count.checked_mul(usize::try_from(dataset.element_size().ok()?).ok()?)?;
        self.may_read(bytes.div_ceil(8))?;
        dataset.read_raw().ok()
    }

    /// The columns of a matrix, or a vector.
    fn columns(&self, dataset: &Dataset, path: &str) -> Option<Vec<Column>> {
        let values = self.numbers(dataset)?;
        let sides: Vec<usize> = shape(dataset)?.into_iter().filter(|side| *side != 1).collect();
        match sides[..] {
            [] | [_] => Some(vec![Column::new(path, values)]),
            [columns, rows] => Some(matrix(path, &values, rows, columns, true)),
            _ => None,
        }
    }

    /// A text that is kept as the numbers of its letters.
    fn text(&self, dataset: &Dataset) -> Option<String> {
        if is_empty(dataset) {
            return None;
        }
        let letters = self.numbers(dataset)?;
        let text: String = letters.iter().filter_map(|letter| char::from_u32(*letter as u32)).collect();
        Some(text.trim().to_owned()).filter(|text| !text.is_empty())
    }

    /// The signals of objects such as timeseries.
    fn objects(&self, objects: &Group, variables: &[(String, Vec<usize>)]) -> Option<Vec<Series>> {
        let cells = objects.dataset("MCOS").ok()?.dereference().ok()?;
        let Object::Dataset(first) = cells.first()? else { return None };
        let bytes = self.bytes(first)?;
        let cells = cells.into_iter().map(Arc::new).collect();
        Some(mat_objects::signals(CellsOfObjects { reader: self, cells }, &bytes, false, variables))
    }

    /// The signals of a Simulink Dataset: groups with `Values`, which have data and times.
    fn signals(&self, file: &Hdf5, references: &Group) -> Vec<Series> {
        let groups = references.groups().unwrap_or_default();
        let mut found: Vec<Series> = Vec::new();
        let mut equal: BTreeMap<String, usize> = BTreeMap::new();
        for group in groups.iter().filter_map(|name| references.group(name).ok()) {
            for mut series in self.signal(file, &group).unwrap_or_default() {
                let number = equal.entry(series.name.clone()).or_default();
                *number += 1;
                if *number > 1 {
                    series.name = format!("{}#{number}", series.name);
                }
                found.push(series);
            }
        }
        found
    }

    /// One signal; several if each sample has several numbers.
    fn signal(&self, file: &Hdf5, group: &Group) -> Option<Vec<Series>> {
        let values = group.group("Values").ok()?;
        let named = |name: &str| self.text(&group.dataset(name).ok()?);
        let block = || {
            let path = group.dataset("BlockPath").ok()?.dereference().ok()?.into_iter().next()?;
            let Object::Dataset(path) = path else { return None };
            self.text(&path).and_then(|path| path.rsplit('/').next().map(str::to_owned))
        };
        let name = named("Name").or_else(block).unwrap_or_else(|| "signal".into());
        let filled = |names: [&str; 2]| {
            names.iter().filter_map(|name| values.dataset(name).ok()).find(|dataset| !is_empty(dataset))
        };
        let times = match filled(["TimeR2", "Time"]).and_then(|times| self.numbers(&times)) {
            Some(times) if times.len() > 1 => Times::Each(times),
            _ => {
                let compressed = self.numbers(&values.dataset("CompressedTime").ok()?)?;
                let [start_s, step_s, count] = compressed[..] else { return None };
                Times::Even { start_s, step_s, count: count as usize }
            }
        };
        let mut columns = self.columns(&filled(["DataR2", "Data"])?, &name)?;
        if columns.len() == 1 && columns[0].values.len() == 1 && times.count() > 1 {
            let stream = self.stream(file, columns[0].values[0] as usize)?;
            columns = vec![Column::new(name, samples(&stream, times.count())?)];
        }
        columns.retain(|column| column.values.len() == times.count());
        let time_s = if columns.is_empty() { Arc::default() } else { Arc::new(times.all()) };
        let series =
            |column: Column| Series { name: column.name, time_s: time_s.clone(), values: Arc::new(column.values) };
        Some(columns.into_iter().map(series).collect())
    }

    /// The bytes of a streamed signal by its number: a dataset, or a group with the bytes and what describes them.
    fn stream(&self, file: &Hdf5, number: usize) -> Option<Vec<u8>> {
        let root = file.root();
        if let Ok(all) = root.group(STREAM) {
            if let Ok(one) = all.group(&number.to_string()) {
                return self.bytes(&one.dataset("#data#").ok()?);
            }
            let by_name = all.dataset(&number.to_string()).ok();
            let in_order = || {
                let names = all.datasets().ok()?;
                all.dataset(names.get(number.checked_sub(1)?)?).ok()
            };
            return self.bytes(&by_name.or_else(in_order)?);
        }
        let all = root.dataset(STREAM).ok()?;
        if !matches!(all.dtype(), Ok(DType::ObjectReference)) {
            return self.bytes(&all);
        }
        match all.dereference().ok()?.into_iter().nth(number.checked_sub(1)?)? {
            Object::Dataset(bytes) => self.bytes(&bytes),
            _ => None,
        }
    }
}

/// The times of a signal.
enum Times {
    Each(Vec<f64>),
    Even { start_s: f64, step_s: f64, count: usize },
}

impl Times {
    fn count(&self) -> usize {
        match self {
            Self::Each(times) => times.len(),
            Self::Even { count, .. } => *count,
        }
    }

    fn all(self) -> Vec<f64> {
        match self {
            Self::Each(times) => times,
            Self::Even { start_s, step_s, count } => (0..count).map(|row| start_s + row as f64 * step_s).collect(),
        }
    }
}

/// Samples of 8 or 4 bytes, by their number.
fn samples(bytes: &[u8], count: usize) -> Option<Vec<f64>> {
    if Some(bytes.len()) == count.checked_mul(8) {
        return Some(bytes.chunks_exact(8).map(|one| f64::from_le_bytes(one.try_into().expect("eight"))).collect());
    }
    let is_single = Some(bytes.len()) == count.checked_mul(4);
    is_single.then(|| {
        bytes.chunks_exact(4).map(|one| f64::from(f32::from_le_bytes(one.try_into().expect("four")))).collect()
    })
}

/// The cells of objects.
struct CellsOfObjects<'a> {
    reader: &'a Reader,
    cells: Vec<Arc<Object>>,
}

impl Cells for CellsOfObjects<'_> {
    type Array = Arc<Object>;

    fn cell(&self, number: usize) -> Option<Self::Array> {
        self.cells.get(number).cloned()
    }

    fn holds(&self, array: &Self::Array) -> Holds {
        match &**array {
            Object::Group(_) => Holds::Arrays,
            Object::Dataset(dataset) if is_empty(dataset) => Holds::Else,
            Object::Dataset(dataset) => match dataset.dtype() {
                Ok(DType::ObjectReference) => Holds::Arrays,
                Ok(DType::U32) => Holds::References,
                _ => Holds::Else,
            },
            _ => Holds::Else,
        }
    }

    fn values(&self, array: &Self::Array) -> Option<Values> {
        let Object::Dataset(dataset) = &**array else { return None };
        if is_empty(dataset) || is_text(dataset) {
            return None;
        }
        let mut shape = shape(dataset)?;
        shape.reverse();
        Some(Values { shape, values: self.reader.numbers(dataset)? })
    }

    fn text(&self, array: &Self::Array) -> Option<String> {
        let Object::Dataset(dataset) = &**array else { return None };
        is_text(dataset).then(|| self.reader.text(dataset)).flatten()
    }

    fn inner(&self, array: &Self::Array) -> Vec<(String, Self::Array)> {
        match &**array {
            Object::Group(group) => {
                let dataset = |name: &String| group.dataset(name).map(|one| Object::Dataset(Box::new(one)));
                let datasets = group.datasets().unwrap_or_default().into_iter();
                let groups = group.groups().unwrap_or_default().into_iter();
                let datasets = datasets.filter_map(|name| Some((name.clone(), Arc::new(dataset(&name).ok()?))));
                let groups =
                    groups.filter_map(|name| Some((name.clone(), Arc::new(Object::Group(group.group(&name).ok()?)))));
                datasets.chain(groups).collect()
            }
            Object::Dataset(dataset) => {
                let inner = dataset.dereference().unwrap_or_default().into_iter();
                inner.map(|object| (String::new(), Arc::new(object))).collect()
            }
            _ => Vec::new(),
        }
    }
}

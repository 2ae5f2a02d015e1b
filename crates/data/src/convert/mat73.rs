//! MATLAB files of version 7.3, which are HDF5: variables, structures, cells, and the signals of a Simulink Dataset.

use super::{Fault, matrix};
use crate::content::{Column, Content, Series};
use hdf5_pure::{AttrValue, DType, Dataset, File as Hdf5, Group, Object};

/// How such a file begins: MATLAB's own text, or HDF5 alone.
pub fn is_one(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x89HDF\r\n\x1a\n") || bytes.starts_with(b"MATLAB 7.3 MAT-file")
}

/// Structures in structures are followed so deep.
const DEEPEST: usize = 12;
/// Where MATLAB keeps what cells and objects refer to.
const REFERENCES: &str = "#refs#";
/// Where Simulink keeps the samples of signals that it streams.
const STREAM: &str = "#sigstream#";

/// Reads all numbers.
pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    let damaged = |error: hdf5_pure::Error| {
        Fault::whole(format!("this HDF5 file (MATLAB 7.3) cannot be read ({error}): save it with save(..., '-v7')"))
    };
    let file = Hdf5::from_bytes(bytes.to_vec()).map_err(damaged)?;
    let mut content = Content::default();
    let root = file.root();
    let signals = root.group(REFERENCES).map(|references| signals(&file, &references)).unwrap_or_default();
    walk(&root, "", 0, &mut content).map_err(damaged)?;
    if !signals.is_empty() {
        // A Dataset has times of its own; other variables beside it are parameters.
        content.ignored.extend(content.columns.drain(..).map(|column| column.name));
        content.series = signals;
    }
    Ok(content)
}

/// Reads the datasets of a group and of the groups in it.
fn walk(group: &Group, path: &str, depth: usize, content: &mut Content) -> Result<(), hdf5_pure::Error> {
    let own = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}/{name}") };
    for name in group.datasets()? {
        if !name.starts_with('#') {
            dataset(&group.dataset(&name)?, &own(&name), depth, content);
        }
    }
    for name in group.groups()? {
        if !name.starts_with('#') && depth < DEEPEST {
            walk(&group.group(&name)?, &own(&name), depth + 1, content)?;
        }
    }
    Ok(())
}

/// Reads a dataset: numbers, or the cells that it refers to.
fn dataset(dataset: &Dataset, path: &str, depth: usize, content: &mut Content) {
    let is_object = dataset.attrs().is_ok_and(|attributes| attributes.contains_key("MATLAB_object_decode"));
    if is_object || is_empty(dataset) || is_text(dataset) {
        return;
    }
    if matches!(dataset.dtype(), Ok(DType::ObjectReference)) {
        let targets = dataset.dereference().unwrap_or_default();
        for (index, target) in targets.into_iter().enumerate() {
            let path = format!("{path}/{}", index + 1);
            match target {
                Object::Dataset(inner) if depth < DEEPEST => self::dataset(&inner, &path, depth + 1, content),
                Object::Group(inner) if depth < DEEPEST => {
                    let _ = walk(&inner, &path, depth + 1, content);
                }
                _ => {}
            }
        }
        return;
    }
    match columns(dataset, path) {
        Some(columns) => content.columns.extend(columns),
        None => content.ignored.push(path.to_owned()),
    }
}

/// The columns of a matrix, or a vector. MATLAB's dimensions stand in the reverse order.
fn columns(dataset: &Dataset, path: &str) -> Option<Vec<Column>> {
    let values = dataset.read_f64().ok()?;
    let sides: Vec<usize> =
        dataset.shape().ok()?.into_iter().map(|side| side as usize).filter(|side| *side != 1).collect();
    match sides[..] {
        [] | [_] => Some(vec![Column::new(path, values)]),
        // A file may promise more than it holds.
        [columns, rows] if columns.checked_mul(rows) == Some(values.len()) => {
            Some(matrix(path, &values, rows, columns, true))
        }
        _ => None,
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

/// A text that is kept as the numbers of its letters.
fn text(dataset: &Dataset) -> Option<String> {
    if is_empty(dataset) {
        return None;
    }
    let letters = dataset.read_f64().ok()?;
    let text: String = letters.iter().filter_map(|letter| char::from_u32(*letter as u32)).collect();
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}

/// The signals of a Simulink Dataset: groups with `Values`, which have data and times.
fn signals(file: &Hdf5, references: &Group) -> Vec<Series> {
    let groups = references.groups().unwrap_or_default();
    let mut found: Vec<Series> = Vec::new();
    for group in groups.iter().filter_map(|name| references.group(name).ok()) {
        for series in signal(file, &group).unwrap_or_default() {
            let number = found.iter().filter(|other| other.name.split('#').next() == Some(&*series.name)).count();
            let name = if number == 0 { series.name } else { format!("{}#{}", series.name, number + 1) };
            found.push(Series { name, ..series });
        }
    }
    found
}

/// One signal; several if each sample has several numbers.
fn signal(file: &Hdf5, group: &Group) -> Option<Vec<Series>> {
    let values = group.group("Values").ok()?;
    let named = |name: &str| text(&group.dataset(name).ok()?);
    let block = || {
        let path = group.dataset("BlockPath").ok()?.dereference().ok()?.into_iter().next()?;
        let Object::Dataset(path) = path else { return None };
        text(&path).and_then(|path| path.rsplit('/').next().map(str::to_owned))
    };
    let name = named("Name").or_else(block).unwrap_or_else(|| "signal".into());
    let filled =
        |names: [&str; 2]| names.iter().filter_map(|name| values.dataset(name).ok()).find(|dataset| !is_empty(dataset));
    let data = filled(["DataR2", "Data"])?;
    let times = || -> Option<Vec<f64>> {
        if let Some(times) =
            filled(["TimeR2", "Time"]).and_then(|dataset| dataset.read_f64().ok()).filter(|times| times.len() > 1)
        {
            return Some(times);
        }
        // Start, step, and number of the samples.
        let [start_s, step_s, count] = values.dataset("CompressedTime").ok()?.read_f64().ok()?[..] else { return None };
        let count = (0.0..1e9).contains(&count).then_some(count as usize)?;
        Some((0..count).map(|row| start_s + row as f64 * step_s).collect())
    };
    let time_s = times()?;
    let mut columns = columns(&data, &name)?;
    if columns.len() == 1 && columns[0].values.len() == 1 && time_s.len() > 1 {
        let stream = stream(file, columns[0].values[0] as usize)?;
        columns = vec![Column::new(name, samples(&stream, time_s.len())?)];
    }
    let is_whole = |column: &Column| column.values.len() == time_s.len();
    let series = |column: Column| Series { name: column.name, time_s: time_s.clone(), values: column.values };
    Some(columns.into_iter().filter(is_whole).map(series).collect())
}

/// The bytes of a streamed signal by its number: a dataset, or a group with the bytes and what describes them.
fn stream(file: &Hdf5, number: usize) -> Option<Vec<u8>> {
    let root = file.root();
    if let Ok(all) = root.group(STREAM) {
        if let Ok(one) = all.group(&number.to_string()) {
            return one.dataset("#data#").ok()?.read_raw().ok();
        }
        let by_name = all.dataset(&number.to_string()).ok();
        let in_order = || {
            let names = all.datasets().ok()?;
            all.dataset(names.get(number.checked_sub(1)?)?).ok()
        };
        return by_name.or_else(in_order)?.read_raw().ok();
    }
    let all = root.dataset(STREAM).ok()?;
    if !matches!(all.dtype(), Ok(DType::ObjectReference)) {
        return all.read_raw().ok();
    }
    match all.dereference().ok()?.into_iter().nth(number.checked_sub(1)?)? {
        Object::Dataset(bytes) => bytes.read_raw().ok(),
        _ => None,
    }
}

/// Samples of 8 or 4 bytes, by their number.
fn samples(bytes: &[u8], count: usize) -> Option<Vec<f64>> {
    if bytes.len() == 8 * count {
        return Some(bytes.chunks_exact(8).map(|one| f64::from_le_bytes(one.try_into().expect("eight"))).collect());
    }
    let is_single = bytes.len() == 4 * count;
    is_single.then(|| {
        bytes.chunks_exact(4).map(|one| f64::from(f32::from_le_bytes(one.try_into().expect("four")))).collect()
    })
}

//! `WPILib` data log, version 1.0. It has records of entries, each with a time in microseconds. A control record gives
//! the name and the type of an entry.

use super::{Column, Fault, shortened, times};
use crate::content::{Content, Series};
use crate::recording::{Channel, Recording};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

const MAGIC: &[u8] = b"WPILOG";
const VERSION: u16 = 0x0100;
const START: u8 = 0;
const FINISH: u8 = 1;
/// Name of the entry of `SysIdRoutineLog` for the running test; the name of the mechanism follows.
const TEST_STATE: &str = "sysid-test-state-";

/// A log has fewer series. An array has one for each of its numbers, and may have a million of these.
const MOST_SERIES: usize = 100_000;

/// Types of entries.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// A number in each record.
    One(Number),
    /// An array in each record.
    Several(Number),
    Other,
}

#[derive(Clone, Copy, Debug)]
enum Number {
    Double,
    Float,
    Int64,
    Boolean,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        match name {
            "double" => Some(Self::Double),
            "float" => Some(Self::Float),
            "int64" => Some(Self::Int64),
            "boolean" => Some(Self::Boolean),
            _ => None,
        }
    }

    fn size(self) -> usize {
        match self {
            Self::Double | Self::Int64 => 8,
            Self::Float => 4,
            Self::Boolean => 1,
        }
    }

    fn value(self, bytes: &[u8]) -> f64 {
        let eight = || bytes.try_into().expect("as many as its size");
        match self {
            Self::Double => f64::from_le_bytes(eight()),
            Self::Int64 => i64::from_le_bytes(eight()) as f64,
            Self::Float => f64::from(f32::from_le_bytes(bytes.try_into().expect("as many as its size"))),
            Self::Boolean => f64::from(bytes[0] != 0),
        }
    }
}

/// A reading position.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

/// A record of the log.
struct Record<'a> {
    entry: u64,
    stamp_us: u64,
    /// Length of its payload.
    size: usize,
    /// Reader at the payload; its fields end with the record.
    record: Cursor<'a>,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or_else(|| {
            Fault::at_byte(
                self.at,
                format!(
                    "{count} bytes expected, but only {} are left: the log was cut short; copy it again",
                    self.bytes.len() - self.at
                ),
            )
        })?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn number(&mut self, count: usize) -> Result<u64, Fault> {
        Ok(self.take(count)?.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte)))
    }

    /// The next record.
    fn record(&mut self) -> Result<Record<'a>, Fault> {
        let lengths = self.number(1)?;
        let entry = self.number((lengths & 3) as usize + 1)?;
        let size = self.number((lengths >> 2 & 3) as usize + 1)? as usize;
        let stamp_us = self.number((lengths >> 4 & 7) as usize + 1)?;
        let at = self.at;
        self.take(size)?;
        Ok(Record { entry, stamp_us, size, record: Cursor { bytes: &self.bytes[..self.at], at } })
    }

    fn text(&mut self) -> Result<String, Fault> {
        let (length, at) = (self.number(4)? as usize, self.at);
        let text = std::str::from_utf8(self.take(length)?);
        Ok(text.map_err(|_| Fault::at_byte(at, "a name that is not UTF-8"))?.to_string())
    }
}

/// Parses a log. `is_mapped` is whether the user names the entries.
pub fn read(bytes: &[u8], is_mapped: bool) -> Result<Content, Fault> {
    let mut cursor = Cursor { bytes, at: 0 };
    if cursor.take(MAGIC.len()).ok() != Some(MAGIC) {
        return Err(Fault::at_byte(0, "the file does not begin with WPILOG, so it is not a WPILib data log"));
    }
    let version = cursor.number(2)?;
    if version >> 8 != u64::from(VERSION >> 8) {
        return Err(Fault::at_byte(6, format!("version {}.{}; only 1.x is known", version >> 8, version & 0xff)));
    }
    let extra = cursor.number(4)? as usize;
    cursor.take(extra)?;
    let mut open: BTreeMap<u64, (String, Kind)> = BTreeMap::new();
    let mut found: BTreeMap<String, Series> = BTreeMap::new();
    let mut units: BTreeMap<String, String> = BTreeMap::new();
    let mut cut = None;
    while cursor.at < bytes.len() {
        let at = cursor.at;
        let Ok(Record { entry, stamp_us, size, mut record }) = cursor.record() else {
            cut =
                Some(format!("the last record, from byte {at} on, is incomplete; the records before it are complete"));
            break;
        };
        if entry == 0 {
            control(&mut record, &mut open, &mut found, &mut units)?;
            continue;
        }
        let (name, kind) =
            open.get(&entry).ok_or_else(|| Fault::at_byte(at, format!("entry {entry} was never started")))?;
        let values = values(*kind, record.take(size)?).map_err(|expected| {
            Fault::at_byte(at, format!("{name}: its type has {expected} bytes, but {size} were found"))
        })?;
        let is_one = matches!(kind, Kind::One(_));
        for (index, value) in values.into_iter().enumerate() {
            let name = if is_one { name.clone() } else { format!("{name}/{}", index + 1) };
            if found.len() > MOST_SERIES && !found.contains_key(&name) {
                return Err(Fault::at_byte(at, format!("more than {MOST_SERIES} series: log the motor's alone")));
            }
            let series = found.entry(name.clone()).or_insert_with(|| empty(name));
            series.push(stamp_us as f64 * 1e-6, value);
        }
    }
    let mut found: Vec<Series> = found.into_values().collect();
    if !is_mapped {
        name_routine(&mut found, &units);
    }
    let (series, words): (Vec<_>, Vec<_>) = found.into_iter().partition(|series| !series.values.is_empty());
    let ignored = words.into_iter().map(|series| series.name).collect();
    Ok(Content { series, ignored, cut, ..Content::default() })
}

fn empty(name: String) -> Series {
    Series::new(name, Vec::new(), Vec::new())
}

/// Maps the entries of a `SysIdRoutineLog` with a single motor to channels. With several motors none can be chosen.
fn name_routine(found: &mut [Series], units: &BTreeMap<String, String>) {
    let Some(mechanism) = found.iter().find_map(|series| series.name.strip_prefix(TEST_STATE)).map(str::to_owned)
    else {
        return;
    };
    let is_of = |name: &str| {
        let (what, whose) = name.split_once('-')?;
        let motor = whose.strip_suffix(&mechanism)?.strip_suffix('-')?;
        let (channel, factor) = routine_channel(what, units.get(name)?)?;
        Some((motor.to_owned(), channel, factor))
    };
    let motors: BTreeSet<String> = found.iter().filter_map(|series| Some(is_of(&series.name)?.0)).collect();
    if motors.len() != 1 {
        return;
    }
    for series in found {
        if let Some((_, channel, factor)) = is_of(&series.name) {
            series.name = channel.column().into();
            Arc::make_mut(&mut series.values).iter_mut().for_each(|value| *value *= factor);
        }
    }
}

/// Channel and factor of an entry by its unit; `None` for a mechanism that moves in metres.
fn routine_channel(what: &str, unit: &str) -> Option<(Channel, f64)> {
    // C++ and Python write `turns_per_second`, Java `Rotation per Second`.
    let unit = unit.to_lowercase();
    let angle = [("turn", TAU), ("rotation", TAU), ("revolution", TAU), ("rad", 1.0), ("deg", PI / 180.0)];
    let factor = angle.into_iter().find(|(name, _)| unit.starts_with(name)).map(|(_, factor)| factor);
    match what {
        "voltage" => Some((Channel::Voltage, 1.0)),
        "current" => Some((Channel::Current, 1.0)),
        "position" => Some((Channel::Angle, factor?)),
        "velocity" => Some((Channel::Speed, factor?)),
        _ => None,
    }
}

fn control(
    record: &mut Cursor<'_>,
    open: &mut BTreeMap<u64, (String, Kind)>,
    found: &mut BTreeMap<String, Series>,
    units: &mut BTreeMap<String, String>,
) -> Result<(), Fault> {
    let what = record.number(1)? as u8;
    let entry = record.number(4)?;
    match what {
        START => {
            let (name, kind, metadata) = (record.text()?, record.text()?, record.text()?);
            let name = shortened(&name).to_owned();
            units.insert(name.clone(), metadata);
            let kind = match (Number::named(&kind), kind.strip_suffix("[]").and_then(Number::named)) {
                (Some(number), _) => Kind::One(number),
                (_, Some(number)) => Kind::Several(number),
                _ => Kind::Other,
            };
            found.entry(name.clone()).or_insert_with(|| empty(name.clone()));
            open.insert(entry, (name, kind));
        }
        FINISH => {
            open.remove(&entry);
        }
        // Metadata, and additions of later versions.
        _ => {}
    }
    Ok(())
}

/// The numbers of a record, or the size that each of them has if that does not fit.
fn values(kind: Kind, payload: &[u8]) -> Result<Vec<f64>, usize> {
    let (number, is_right) = match kind {
        Kind::One(number) => (number, payload.len() == number.size()),
        Kind::Several(number) => (number, payload.len().is_multiple_of(number.size())),
        Kind::Other => return Ok(Vec::new()),
    };
    if !is_right {
        return Err(number.size());
    }
    Ok(payload.chunks_exact(number.size()).map(|bytes| number.value(bytes)).collect())
}

/// A log with an entry of type `double` for each channel. Its times are whole microseconds; a missing sample is NaN.
pub fn write(recording: &Recording, columns: &[Column]) -> Result<Vec<u8>, Fault> {
    let time_s = times(recording)?;
    let mut log = MAGIC.to_vec();
    log.extend(VERSION.to_le_bytes());
    log.extend(0_u32.to_le_bytes());
    let others: Vec<&Column> = recording
        .channels()
        .zip(columns)
        .filter(|(channel, _)| *channel != Channel::Time)
        .map(|(_, column)| column)
        .collect();
    let start_s = time_s[0];
    for (index, column) in others.iter().enumerate() {
        let mut payload = vec![START];
        payload.extend((index as u32 + 1).to_le_bytes());
        for text in [column.name.as_str(), "double", ""] {
            payload.extend((text.len() as u32).to_le_bytes());
            payload.extend(text.as_bytes());
        }
        append(&mut log, 0, 0, &payload);
    }
    for (row, t_s) in time_s.iter().enumerate() {
        let stamp_us = ((t_s - start_s) * 1e6).round() as u64;
        for (index, column) in others.iter().enumerate() {
            append(&mut log, index as u32 + 1, stamp_us, &column.values[row].to_le_bytes());
        }
    }
    Ok(log)
}

/// A record with fields of full length.
fn append(log: &mut Vec<u8>, entry: u32, stamp_us: u64, payload: &[u8]) {
    log.push(0b0111_1111);
    log.extend(entry.to_le_bytes());
    log.extend((payload.len() as u32).to_le_bytes());
    log.extend(stamp_us.to_le_bytes());
    log.extend(payload);
}

//! Lines of names and values, as serial plotters take them: `speed:12.5,current:0.3`, `Speed: 12.5 rad/s`,
//! Teleplot's `>speed:1709305190123:12.5`, and an object of JSON on each line.

use super::cells::{Notation, number};
use super::lines::Line;
use crate::content::{Broken, Column, Content, Series};
use crate::recording::Channel;
use crate::units;
use std::collections::BTreeMap;

/// A name, its value, and the unit behind it; empty without one.
struct Pair<'a> {
    name: &'a str,
    value: f64,
    unit: &'static str,
}

/// Signs between the pairs of a line.
const BETWEEN: [char; 5] = [',', ';', '\t', ' ', '|'];

/// Reads lines of names and values. `None`: most lines are something else.
pub fn read(lines: &[Line<'_>]) -> Option<Content> {
    let is_teleplot = |line: &&Line<'_>| teleplot(line.text).is_some();
    if 2 * lines.iter().filter(is_teleplot).count() > lines.len() {
        return series(lines);
    }
    let labelled = lines.iter().filter(|line| pairs(line.text).is_some()).count();
    if 2 * labelled > lines.len() { rows(lines) } else { None }
}

/// A sketch prints fewer names. With more of them a number is part of the name, as in `step 12: 0.5`.
const MOST_NAMES: usize = 1000;

/// The pairs of a line; `None` if there is something else in it.
fn pairs(line: &str) -> Option<Vec<Pair<'_>>> {
    line.strip_prefix('{').map_or_else(|| pairs_of_words(line), pairs_of_json)
}

/// The pairs of an object in JSON on one line, without its first brace. Objects in it are no pairs.
fn pairs_of_json(line: &str) -> Option<Vec<Pair<'_>>> {
    let inside = line.trim_end_matches(',').trim_end().strip_suffix('}')?;
    fn pair(text: &str) -> Option<Pair<'_>> {
        let (name, value) = text.split_once("\":")?;
        let (value, unit) = self::value(value.trim().trim_matches('"'))?;
        Some(Pair { name: name.trim().strip_prefix('"')?, value, unit })
    }
    // A comma before a name separates; one in a name does not.
    let mut found = Vec::new();
    let mut rest = inside;
    while !rest.trim().is_empty() {
        let value = rest.find("\":")?;
        let end = rest[value..].find(',').map_or(rest.len(), |comma| value + comma);
        found.push(pair(&rest[..end])?);
        rest = rest.get(end + 1..).unwrap_or_default();
    }
    (!found.is_empty()).then_some(found)
}

/// The pairs of a line as serial plotters read it.
fn pairs_of_words(line: &str) -> Option<Vec<Pair<'_>>> {
    let mut rest = line.trim_start_matches('>').trim();
    let mut found = Vec::new();
    while !rest.is_empty() {
        let (name, after) = rest.split_once([':', '='])?;
        let name = name.trim();
        let is_name = name.starts_with(|c: char| c.is_alphabetic() || c == '_')
            && !name.contains(BETWEEN.map(|c| if c == ' ' { ',' } else { c }));
        let after = after.trim_start();
        let end = after.find(BETWEEN).unwrap_or(after.len());
        let (value, unit) = value(&after[..end])?;
        if !is_name {
            return None;
        }
        let (word, after) = unit_behind(&after[end..]);
        found.push(Pair { name, value, unit: if unit.is_empty() { word } else { unit } });
        rest = after.trim_start_matches(BETWEEN);
    }
    (!found.is_empty()).then_some(found)
}

/// The value of a pair, and the unit that may stand right behind it: `12.5`, `0.3A`.
fn value(text: &str) -> Option<(f64, &'static str)> {
    if let Some(value) = number(text, Notation::Point).filter(|_| !text.is_empty()) {
        return Some((value, ""));
    }
    let end = text.rfind(|c: char| c.is_ascii_digit() || c == '.')? + 1;
    let unit = &text[end..];
    let is_unit = unit.chars().all(|c| c.is_alphabetic() || matches!(c, '%' | '\u{b0}' | '/'));
    let value = text[..end].parse().ok().filter(|_| is_unit)?;
    Some((value, units::named(unit).unwrap_or_default()))
}

/// A unit behind a blank, and the text after it: `12.5 rad/s, ...`.
fn unit_behind(text: &str) -> (&'static str, &str) {
    let Some(after) = text.strip_prefix(' ') else { return ("", text) };
    let end = after.find(BETWEEN).unwrap_or(after.len());
    let word = &after[..end];
    // The unit is not the begin of the next name: `Speed: 5 rad/s Motor A: 3`.
    let unit = Some(word).filter(|word| !word.is_empty() && !word.contains([':', '='])).and_then(units::named);
    unit.map_or(("", text), |unit| (unit, &after[end..]))
}

/// A row for each line, or for each group of lines until a name comes again. `None`: too many names.
fn rows(lines: &[Line<'_>]) -> Option<Content> {
    let mut content = Content { header: lines.first().map(|line| line.number), is_text: true, ..Content::default() };
    let mut names: Vec<(&str, &str)> = Vec::new();
    let mut place_of: BTreeMap<&str, usize> = BTreeMap::new();
    let mut rows: Vec<BTreeMap<usize, f64>> = Vec::new();
    for line in lines {
        let Some(pairs) = pairs(line.text) else {
            let what = "it has something besides names and values".to_owned();
            content.broken.push(Broken { line: line.number, what });
            continue;
        };
        let places: Vec<usize> = pairs
            .iter()
            .map(|Pair { name, unit, .. }| {
                *place_of.entry(name).or_insert_with(|| {
                    names.push((name, unit));
                    names.len() - 1
                })
            })
            .collect();
        if names.len() > MOST_NAMES {
            return None;
        }
        let another = places.iter().zip(&pairs).find(|(place, pair)| names[**place].1 != pair.unit);
        if let Some((place, Pair { name, unit, .. })) = another {
            let usual = names[*place].1;
            let what = format!("the unit of {name} is \"{unit}\", but \"{usual}\" in the lines before");
            content.broken.push(Broken { line: line.number, what });
            continue;
        }
        if rows.last().is_none_or(|row| places.iter().any(|place| row.contains_key(place))) {
            rows.push(BTreeMap::new());
            content.lines.push(line.number);
        }
        let row = rows.last_mut().expect("one was just added");
        row.extend(places.into_iter().zip(pairs).map(|(place, pair)| (place, pair.value)));
    }
    // Rows of before the first name came again, or of a line that lost a pair, lack a value.
    let value = |row: &BTreeMap<usize, f64>, place: usize| row.get(&place).copied().unwrap_or(f64::NAN);
    let column = |(place, (name, unit)): (usize, &(&str, &str))| {
        let values = rows.iter().map(|row| value(row, place)).collect();
        Column { unit: (*unit).into(), ..Column::new(*name, values) }
    };
    content.columns = names.iter().enumerate().map(column).collect();
    if OWN.iter().all(|(own, ..)| names.iter().any(|(name, _)| name == own)) {
        for (own, channel, unit) in OWN {
            let column = content.columns.iter_mut().find(|column| column.name == own).expect("it is among the names");
            (column.name, column.unit) = (channel.column().into(), unit.into());
        }
    }
    Some(content)
}

/// What the firmware of this project prints with `stream text`, beside the reference.
const OWN: [(&str, Channel, &str); 4] = [
    ("position", Channel::Angle, "rad"),
    ("speed", Channel::Speed, "rad/s"),
    ("current", Channel::Current, "A"),
    ("duty", Channel::Duty, "%"),
];

/// Name, time in ms, and value of Teleplot's line; text and units follow the value.
fn teleplot(line: &str) -> Option<(&str, f64, f64)> {
    let (name, rest) = line.strip_prefix('>')?.split_once(':')?;
    let mut samples = rest.split(';');
    let (time, value) = samples.next()?.split_once(':')?;
    let value = value.split(['|', '\u{a7}']).next()?;
    Some((name.trim(), time.trim().parse().ok()?, value.trim().parse().ok()?))
}

/// A series for each name. `None`: too many names.
fn series(lines: &[Line<'_>]) -> Option<Content> {
    let mut content = Content { header: lines.first().map(|line| line.number), ..Content::default() };
    let mut place_of: BTreeMap<&str, usize> = BTreeMap::new();
    for line in lines {
        let Some((name, time_ms, value)) = teleplot(line.text) else {
            let what = "it is no line >name:time:value".to_owned();
            content.broken.push(Broken { line: line.number, what });
            continue;
        };
        let place = *place_of.entry(name).or_insert_with(|| {
            content.series.push(Series::new(name, Vec::new(), Vec::new()));
            content.series.len() - 1
        });
        if content.series.len() > MOST_NAMES {
            return None;
        }
        content.series[place].push(time_ms * 1e-3, value);
    }
    Some(content)
}

//! The rows of a table as columns.

use super::cells::{Moment, Notation, direction, moment, number, with_unit};
use super::header::{Header, filled};
use super::{Dialect, Split, notation, oscilloscope};
use crate::content::{Broken, Column, Content};
use crate::units;
use std::borrow::Cow;

/// So many rows show what the cells of a column are.
const SHOWN: usize = 50;

/// Reads the rows.
pub fn read(
    split: &Split<'_>,
    header: Header,
    broken: Vec<Broken>,
    prefixes: Vec<(u64, f64)>,
    dialect: Dialect,
) -> Result<Content, String> {
    let notation = notation(split, header.first_row, dialect);
    let mut content = Content { broken, header: header.line, is_text: true, ..Content::default() };
    let width = if header.line.is_some() { checked_width(split, &header)? } else { header.names.len() };
    let mut rows: Vec<Vec<Cow<'_, str>>> = Vec::new();
    let mut repeated = 0;
    for line in &split.lines[header.first_row..] {
        let mut cells = split.separator.cells(line.text);
        cells.drain(..header.skipped.min(cells.len()));
        if header.skipped == 0 && cells.iter().zip(&header.names).all(|(cell, name)| *cell == **name) && cells.len() > 1
        {
            repeated += 1;
            continue;
        }
        let found = filled(&cells).max(if cells.len() >= width { width } else { 0 });
        if cells.len() < width && !(cells.len() + 1 == width && ends_empty(&header, width)) || found > width {
            let (has, expected) = (cells.len().max(found), header.names.len().min(width.max(1)));
            let what = format!("{has} values, but {} has {expected}", whose(&header, expected));
            content.broken.push(Broken { line: line.number, what });
            continue;
        }
        cells.resize(width, Cow::from(""));
        content.lines.push(line.number);
        rows.push(cells);
    }
    if repeated > 0 {
        content.notes.push(format!("The header line stands {repeated} more times among the rows, as after a restart."));
    }
    let kinds: Vec<Kind> = (0..width).map(|column| kind(&rows, column, notation)).collect();
    let columns = (0..width).map(|column| self::column(&rows, column, kinds[column], notation, &header)).collect();
    content.columns = columns;
    join_date_and_clock(&mut content.columns, &rows, &kinds);
    content.columns.retain(|column| !column.name.is_empty() || column.values.iter().any(|value| value.is_finite()));
    if let Some((start_s, step_s)) = header.start_and_step_s {
        content.add_times_of_instrument(start_s, step_s);
    }
    Ok(content.with_unique_names().with_prefixes(prefixes))
}

fn whose(header: &Header, names: usize) -> &'static str {
    if header.line.is_some() && names == header.names.len() { "the header line" } else { "a usual row" }
}

/// Whether the last column has no name: a separator at the end of each line makes it.
fn ends_empty(header: &Header, width: usize) -> bool {
    header.names.get(width - 1).is_none_or(String::is_empty)
}

/// Number of columns that have cells, if the header line fits the rows.
fn checked_width(split: &Split<'_>, header: &Header) -> Result<usize, String> {
    if header.skipped > 0 {
        return Ok(header.names.len());
    }
    let names = header.names.iter().rposition(|name| !name.is_empty()).map_or(0, |last| last + 1);
    if split.lines.len() <= header.first_row {
        return Ok(names);
    }
    let lacking = header.names.get(split.width..).unwrap_or_default();
    if lacking.iter().all(|name| oscilloscope::may_lack_cells(name)) {
        let needed = header.names[..split.width.min(header.names.len())]
            .iter()
            .rposition(|name| !oscilloscope::may_lack_cells(name));
        return Ok(split.width.min(needed.map_or(names, |last| last + 1)).max(1));
    }
    Ok(names)
}

/// What the cells of a column are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Numbers,
    /// Numbers with a unit in each cell.
    WithUnit(&'static str),
    /// Words for a direction.
    Directions,
    Date,
    Clock,
    DateAndClock,
}

fn kind(rows: &[Vec<Cow<'_, str>>], column: usize, notation: Notation) -> Kind {
    let step = rows.len().div_ceil(SHOWN).max(1);
    let (mut numbers, mut others, mut last) = (0, 0, Kind::Numbers);
    for row in rows.iter().step_by(step).filter(|row| !row[column].is_empty()) {
        if number(&row[column], notation).is_some() {
            numbers += 1;
        } else if let Some((_, unit)) = with_unit(&row[column], notation) {
            (others, last) = (others + 1, Kind::WithUnit(unit));
        } else if direction(&row[column]).is_some() {
            (others, last) = (others + 1, Kind::Directions);
        } else if let Some(found) = moment(&row[column]) {
            others += 1;
            last = match found {
                Moment { date: Some(_), clock: Some(_) } => Kind::DateAndClock,
                Moment { date: Some(_), .. } => Kind::Date,
                _ => Kind::Clock,
            };
        }
    }
    if others > numbers { last } else { Kind::Numbers }
}

fn column(rows: &[Vec<Cow<'_, str>>], place: usize, kind: Kind, notation: Notation, header: &Header) -> Column {
    let name = header.names.get(place).cloned().unwrap_or_default();
    let stated = header.units.get(place).and_then(|unit| units::named(unit)).unwrap_or_default();
    let unit = units::in_name(&name).map_or(stated, |(_, unit)| unit).to_owned();
    let mut column = Column { name, unit, ..Column::default() };
    let is_moment = matches!(kind, Kind::Date | Kind::Clock | Kind::DateAndClock);
    let first = match kind {
        _ if !is_moment => 0,
        _ => rows.iter().find_map(|row| moment(&row[place])).map_or(0, Moment::nanoseconds),
    };
    for (index, row) in rows.iter().enumerate() {
        let cell = &*row[place];
        let value = match kind {
            Kind::Numbers => number(cell, notation),
            // A number in another unit than the others would be wrong by the factor between them.
            Kind::WithUnit(unit) => number(cell, notation)
                .or_else(|| with_unit(cell, notation).filter(|(_, other)| *other == unit).map(|(value, _)| value)),
            Kind::Directions => direction(cell).or_else(|| number(cell, notation)),
            _ => moment(cell).map(|moment| seconds(moment.nanoseconds() - first)),
        };
        column.values.push(value.unwrap_or(f64::NAN));
        if cell.is_empty() {
            column.blank.push(index);
        }
        if value.is_none() {
            column.unreadable.push((index, cell.to_owned()));
        }
    }
    if let Kind::WithUnit(unit) = kind {
        column.unit = unit.into();
    }
    if is_moment {
        column.unit = "s".into();
        column.since =
            rows.iter().map(|row| &row[place]).find(|cell| moment(cell).is_some()).map(|cell| cell.to_string());
    }
    column
}

/// Exact to the last digit of the text, if that is a nanosecond at least.
fn seconds(nanoseconds: i128) -> f64 {
    nanoseconds as f64 / 1e9
}

/// A column of dates and one of times of day are one column of others.
fn join_date_and_clock(columns: &mut [Column], rows: &[Vec<Cow<'_, str>>], kinds: &[Kind]) {
    let place = |kind: Kind| kinds.iter().position(|found| *found == kind);
    let Some(date) = place(Kind::Date) else { return };
    let Some(clock) = place(Kind::Clock) else {
        // A day alone is no time of a sample.
        columns[date].since = None;
        columns[date].unit.clear();
        return;
    };
    let both = |row: &Vec<Cow<'_, str>>| {
        let (date, clock) = (moment(&row[date])?.date, moment(&row[clock])?.clock);
        Some(Moment { date, clock }.nanoseconds())
    };
    let first = rows.iter().find_map(both).unwrap_or(0);
    let values = rows.iter().map(|row| both(row).map_or(f64::NAN, |moment| seconds(moment - first))).collect();
    let since = rows.iter().find(|row| both(row).is_some()).map(|row| format!("{} {}", row[date], row[clock]));
    let name = format!("{} {}", columns[date].name, columns[clock].name);
    let unreadable = columns[clock].unreadable.clone();
    columns[clock] = Column { name, unit: "s".into(), values, unreadable, since, ..Column::default() };
    columns[date].name.clear();
    columns[date].values.fill(f64::NAN);
}

/// Name of the column of times that a serial monitor wrote before each line.
pub const PREFIX: &str = "time stamp";

impl Content {
    /// Adds the times that a serial monitor wrote before the lines.
    #[must_use]
    pub fn with_prefixes(mut self, prefixes: Vec<(u64, f64)>) -> Self {
        if prefixes.is_empty() {
            return self;
        }
        let time = |line: &u64| {
            prefixes.binary_search_by_key(line, |(number, _)| *number).map_or(f64::NAN, |place| prefixes[place].1)
        };
        let values: Vec<f64> = self.lines.iter().map(time).collect();
        let first = values.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
        // Times of day are whole milliseconds or microseconds.
        let values = values.iter().map(|value| ((value - first) * 1e6).round() / 1e6).collect();
        let since = Some(format!("the first row, by the time before line {}", self.lines.first().unwrap_or(&1)));
        self.columns.push(Column { name: PREFIX.into(), unit: "s".into(), values, since, ..Column::default() });
        self
    }

    /// Adds the times of an instrument that states the first one and the step.
    fn add_times_of_instrument(&mut self, start_s: f64, step_s: f64) {
        let rows = self.lines.len();
        // Rigol counts its rows in the first column.
        let is_index = |column: &Column| column.values.iter().enumerate().all(|(row, value)| *value == row as f64);
        self.columns.retain(|column| !is_index(column) || rows < 2);
        let values = (0..rows).map(|row| ((start_s + row as f64 * step_s) * 1e12).round() / 1e12).collect();
        let time = Column { name: "time of the instrument".into(), unit: "s".into(), values, ..Column::default() };
        self.columns.insert(0, time);
    }
}

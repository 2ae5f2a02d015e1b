//! Lines of a text, their prefixes, and the separator of their cells.

use super::cells::{Moment, Notation, is_numeric, moment, number};
use std::borrow::Cow;

/// A line with something in it.
#[derive(Clone, Copy, Debug)]
pub struct Line<'a> {
    /// Its number in the file, from 1.
    pub number: u64,
    /// Its text without blanks around it.
    pub text: &'a str,
}

/// The lines of a file.
pub struct Source<'a> {
    /// All but comments and empty ones.
    pub lines: Vec<Line<'a>>,
    /// Comments, without their sign.
    pub comments: Vec<Line<'a>>,
    /// The separator that a spreadsheet's first line `sep=;` gives.
    pub said: Option<u8>,
}

/// Signs at the begin of a comment.
const COMMENT: [&str; 3] = ["#", "%", "//"];

/// Splits a text into lines.
pub fn of(text: &str) -> Source<'_> {
    let mut source = Source { lines: Vec::new(), comments: Vec::new(), said: None };
    for (index, raw) in text.split('\n').enumerate() {
        // A tab at the begin is an empty first cell.
        let text = raw.trim_matches([' ', '\r', '\0', '\u{feff}']).trim_end_matches('\u{1a}');
        let number = index as u64 + 1;
        if text.trim().is_empty() {
            continue;
        }
        if let (1, Some([sign])) = (number, text.strip_prefix("sep=").map(str::as_bytes)) {
            source.said = Some(*sign);
            continue;
        }
        match COMMENT.iter().find_map(|sign| text.strip_prefix(sign)) {
            Some(comment) => source.comments.push(Line { number, text: comment.trim() }),
            None => source.lines.push(Line { number, text }),
        }
    }
    source
}

/// Signs of a serial monitor between the time of a line and its text.
const ARROWS: [&str; 3] = ["->", " > ", "] "];

/// Splits the time that a serial monitor or a logger writes before a line from its text.
fn prefix(text: &str) -> Option<(f64, &str)> {
    let found = before_an_arrow(text).or_else(|| of_esp_idf(text)).or_else(|| before_a_blank(text));
    found.map(|(time_s, after)| (time_s, without_level(after.trim_start())))
}

/// `14:59:50.001 -> `, `[14:59:50.001] `, `[0.412 0.010] ` with the time since the line before.
fn before_an_arrow(text: &str) -> Option<(f64, &str)> {
    ARROWS.iter().find_map(|arrow| {
        let (before, after) = text.split_once(arrow)?;
        let before = before.trim_start_matches('[').trim();
        let seconds = |text: &str| text.parse::<f64>().ok().filter(|time_s| time_s.is_finite());
        let time_s = moment(before).map(Moment::seconds).or_else(|| seconds(before)).or_else(|| {
            let (total, step) = before.split_once(' ')?;
            seconds(step.trim())?;
            seconds(total)
        })?;
        Some((time_s, after))
    })
}

/// The log of ESP-IDF: `I (412) motor: `, with the milliseconds since the start.
fn of_esp_idf(text: &str) -> Option<(f64, &str)> {
    let (time_ms, after) = text.strip_prefix(['E', 'W', 'I', 'D', 'V'])?.strip_prefix(" (")?.split_once(") ")?;
    let (_, after) = after.split_once(": ")?;
    Some((time_ms.parse::<u64>().ok()? as f64 * 1e-3, after))
}

/// `2024-03-01 14:59:50.001 412,0`: a time of day, and after a blank a text with other separators than blanks.
fn before_a_blank(text: &str) -> Option<(f64, &str)> {
    let blanks = || text.match_indices(' ').map(|(at, _)| at).take(3);
    let (found, after) = blanks().filter_map(|at| Some((moment(&text[..at])?, &text[at..]))).last()?;
    let is_separated = |after: &str| after.contains([';', '\t', '|', '=', ':']) || has_commas_alone(after.trim());
    (found.clock.is_some() && is_separated(after)).then(|| (found.seconds(), after))
}

/// Whether only commas separate: with blanks too, a comma may be that of a decimal number.
fn has_commas_alone(text: &str) -> bool {
    text.contains(',') && text.match_indices(' ').all(|(at, _)| text[..at].ends_with(','))
}

/// Words for how much a line of a log matters.
const LEVELS: [&str; 6] = ["TRACE", "DEBUG", "INFO", "WARNING", "WARN", "ERROR"];

/// The text of a log without such a word: `INFO: `, `[INFO] `, `- INFO - `.
fn without_level(text: &str) -> &str {
    let signs = [' ', '-', ':', '[', ']'];
    let inside = text.trim_start_matches(signs);
    let after = LEVELS.iter().find_map(|level| inside.strip_prefix(level).filter(|after| after.starts_with(signs)));
    after.map_or(text, |after| after.trim_start_matches([' ', ':', ']']).trim_start_matches("- "))
}

/// Takes the brackets off, if most lines are in them: `[0.41, 12.5, 0.3]`, as programs print a list.
pub fn take_brackets_off(lines: &mut [Line<'_>]) {
    fn inside(text: &str) -> Option<&str> {
        let pairs = [('[', ']'), ('(', ')')];
        let found = pairs.into_iter().find_map(|(open, close)| text.strip_prefix(open)?.strip_suffix(close));
        found.filter(|inside| !inside.contains(['[', ']', '(', ')']))
    }
    if 2 * lines.iter().filter(|line| inside(line.text).is_some()).count() > lines.len() {
        for line in lines {
            line.text = inside(line.text).map_or(line.text, str::trim);
        }
    }
}

/// Takes the prefixes off, if most lines have one. Returns the time of each line by its number.
pub fn take_prefixes_off(lines: &mut [Line<'_>]) -> Vec<(u64, f64)> {
    let found: Vec<Option<(f64, &str)>> = lines.iter().map(|line| prefix(line.text)).collect();
    if 2 * found.iter().flatten().count() <= lines.len() {
        return Vec::new();
    }
    let mut times = Vec::new();
    for (line, found) in lines.iter_mut().zip(found) {
        let Some((time_s, text)) = found else { continue };
        line.text = text;
        times.push((line.number, time_s));
    }
    times
}

/// What stands between the cells of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// One sign.
    Sign(u8),
    /// One or more blanks or tabs.
    Blanks,
}

impl Separator {
    /// The cells of a line, without quotes and blanks around them.
    pub fn cells<'a>(self, line: &'a str) -> Vec<Cow<'a, str>> {
        match self {
            Self::Blanks if line.contains('"') => quoted(line, |sign| sign == ' ' || sign == '\t', true),
            Self::Blanks => line.split_whitespace().map(Cow::from).collect(),
            Self::Sign(sign) if line.contains('"') => quoted(line, |other| other == char::from(sign), false),
            Self::Sign(sign) => line.split(char::from(sign)).map(|cell| Cow::from(cell.trim())).collect(),
        }
    }
}

/// Splits a line that has quotes.
fn quoted<'a>(line: &'a str, separates: impl Fn(char) -> bool, join: bool) -> Vec<Cow<'a, str>> {
    let (mut cells, mut cell, mut inside, mut was_quoted) = (Vec::new(), String::new(), false, false);
    let mut signs = line.chars().peekable();
    let mut finish = |cell: &mut String, was_quoted: &mut bool| {
        let text = if *was_quoted { std::mem::take(cell) } else { std::mem::take(cell).trim().to_owned() };
        if !join || !text.is_empty() || *was_quoted {
            cells.push(Cow::from(text));
        }
        *was_quoted = false;
    };
    while let Some(sign) = signs.next() {
        match sign {
            '"' if inside && signs.peek() == Some(&'"') => cell.push(signs.next().unwrap_or('"')),
            '"' if inside => inside = false,
            '"' if cell.trim().is_empty() => {
                (inside, was_quoted) = (true, true);
                cell.clear();
            }
            sign if !inside && separates(sign) => finish(&mut cell, &mut was_quoted),
            // Blanks after a closing quote.
            ' ' if !inside && was_quoted => {}
            sign => cell.push(sign),
        }
    }
    finish(&mut cell, &mut was_quoted);
    cells
}

/// Separators in the order in which equally good ones are taken.
const SEPARATORS: [Separator; 5] =
    [Separator::Sign(b'\t'), Separator::Sign(b';'), Separator::Sign(b','), Separator::Sign(b'|'), Separator::Blanks];

/// So many lines show the separator.
const SAMPLE: usize = 2000;

/// Whether all cells are numbers, missing numbers or times, and at least one is none of the missing.
pub fn is_row_of_numbers(cells: &[Cow<'_, str>]) -> bool {
    let is_said = |cell: &Cow<'_, str>| {
        moment(cell).is_some() || is_numeric(cell) && number(cell, Notation::Point).is_none_or(f64::is_finite)
    };
    cells.iter().all(|cell| is_numeric(cell) || moment(cell).is_some()) && cells.iter().any(is_said)
}

/// Whether half of the cells with something in them are numbers or times.
fn has_numbers(cells: &[Cow<'_, str>]) -> bool {
    let filled = cells.iter().filter(|cell| !cell.is_empty()).count();
    let numbers = cells.iter().filter(|cell| !cell.is_empty() && (is_numeric(cell) || moment(cell).is_some())).count();
    numbers > 0 && 2 * numbers >= filled
}

/// The separator with which most lines are rows of numbers, and the usual number of their cells.
pub fn separator(lines: &[Line<'_>], given: Option<Separator>) -> (Separator, usize) {
    let step = lines.len().div_ceil(SAMPLE).max(1);
    let sample: Vec<&Line<'_>> = lines.iter().step_by(step).collect();
    let candidates: Vec<Separator> = given.map_or_else(|| SEPARATORS.to_vec(), |given| vec![given]);
    let best = |is_row: fn(&[Cow<'_, str>]) -> bool| {
        let mut best = (0, 0, candidates[0]);
        for &separator in &candidates {
            let (count, width) = usual_width(&sample, separator, is_row);
            // A number of its own is also a row of one cell, with any separator.
            let weight = |count: usize, width: usize| if width > 1 { 2 * count } else { count };
            if (weight(count, width), width) > (weight(best.0, best.1), best.1) {
                best = (count, width, separator);
            }
        }
        best
    };
    let strict = best(is_row_of_numbers);
    // Tables with columns of words have no row of numbers only.
    let lenient = if 2 * strict.0 < sample.len() { best(has_numbers) } else { strict };
    let (count, width, separator) = if lenient.0 > strict.0 { lenient } else { strict };
    if count == 0 {
        // No row at all: the header line has the separator.
        let separator = given.unwrap_or_else(|| likely(lines[0].text));
        return (separator, separator.cells(lines[0].text).len());
    }
    (separator, width)
}

fn likely(header: &str) -> Separator {
    let count = |separator: &Separator| separator.cells(header).len();
    // `max_by_key` returns the last of several equal ones.
    SEPARATORS.into_iter().rev().max_by_key(count).unwrap_or(Separator::Sign(b','))
}

/// The most frequent number of cells in rows of numbers, and how many rows have it.
fn usual_width(lines: &[&Line<'_>], separator: Separator, is_row: fn(&[Cow<'_, str>]) -> bool) -> (usize, usize) {
    let mut widths = std::collections::BTreeMap::new();
    for line in lines {
        let cells = separator.cells(line.text);
        if is_row(&cells) {
            *widths.entry(cells.len()).or_insert(0_usize) += 1;
        }
    }
    widths.into_iter().map(|(width, count)| (count, width)).max().unwrap_or((0, 0))
}

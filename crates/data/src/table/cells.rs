//! What a cell of a table says: a number in the notation of its file, a missing one, a date or a time of day.

use crate::units;
use jiff::civil::{Date, DateTime, Time};
use jiff::{SignedDuration, Timestamp};
use std::borrow::Cow;

/// What programs print where there is no number: empty cells, and the words of languages and spreadsheets. Arduino's
/// `print` says `ovf` of a value that is too great for it.
const MISSING: [&str; 22] = [
    "",
    "nan",
    "-nan",
    "+nan",
    "nan(ind)",
    "-nan(ind)",
    "na",
    "n/a",
    "#n/a",
    "#div/0!",
    "#num!",
    "#value!",
    "null",
    "none",
    "ovf",
    "inf",
    "-inf",
    "+inf",
    "\u{221e}",
    "-\u{221e}",
    "+\u{221e}",
    "-",
];

/// Letters that stand between the thousands of a number, and are no separator of cells.
const BETWEEN_THOUSANDS: [char; 5] = ['\'', '\u{2019}', '\u{a0}', '\u{202f}', '\u{2009}'];

/// How the numbers of a file are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Notation {
    /// 1234.5; a comma is no part of a number.
    Point,
    /// 1,234.5
    PointAndThousands,
    /// 1234,5 and 1.234,5
    Comma,
}

/// Evidence in one cell about the notation; `None` for a cell without a comma, or one that both would explain.
pub fn evidence(cell: &str) -> Option<Notation> {
    let cell = cell.trim_start_matches(['-', '+']);
    let (before, after) = cell.split_once(',')?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let whole = |text: &str| digits(text) && text.len() <= 3 && !text.starts_with('0');
    let thousands = |text: &str, sign: char| {
        let mut groups = text.split(sign);
        groups.next().is_some_and(whole) && groups.all(|group| digits(group) && group.len() == 3)
    };
    if before.contains('.') {
        return (thousands(before, '.') && digits(after)).then_some(Notation::Comma);
    }
    let (groups, fraction) = cell.split_once('.').unwrap_or((cell, ""));
    if thousands(groups, ',') {
        let is_certain = cell.contains('.') || groups.matches(',').count() > 1;
        return (is_certain && (fraction.is_empty() || digits(fraction))).then_some(Notation::PointAndThousands);
    }
    let fraction = after.split_once(['e', 'E']).map_or(after, |(fraction, _)| fraction);
    ((before.is_empty() || digits(before)) && (fraction.is_empty() || digits(fraction))).then_some(Notation::Comma)
}

/// Whether a cell says that there is no value. Dashes say so too, but a line of them may be a rule under the names.
pub fn is_word_for_missing(cell: &str) -> bool {
    MISSING.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// The number of a cell, NaN for a missing one. `None`: it is no number.
pub fn number(cell: &str, notation: Notation) -> Option<f64> {
    if let Ok(value) = cell.parse::<f64>() {
        return Some(if value.is_finite() { value } else { f64::NAN });
    }
    if is_word_for_missing(cell) || is_dashes(cell) {
        return Some(f64::NAN);
    }
    match cell {
        "true" | "True" | "TRUE" => return Some(1.0),
        "false" | "False" | "FALSE" => return Some(0.0),
        _ => {}
    }
    let cell: Cow<'_, str> = match cell.contains(BETWEEN_THOUSANDS) {
        true => without_thousands(cell, &BETWEEN_THOUSANDS)?.into(),
        false => cell.into(),
    };
    let plain = match notation {
        Notation::Point => cell.into_owned(),
        Notation::PointAndThousands => without_thousands(&cell, &[','])?,
        Notation::Comma if cell.contains(',') => without_thousands(&cell, &['.'])?.replacen(',', ".", 1),
        Notation::Comma => cell.into_owned(),
    };
    plain.parse().ok().filter(|value: &f64| value.is_finite())
}

/// `--`, `---` and so on.
fn is_dashes(cell: &str) -> bool {
    cell.len() > 1 && cell.bytes().all(|byte| byte == b'-')
}

/// The text without signs between thousands, which stand after one to three digits and then after every three.
fn without_thousands(text: &str, signs: &[char]) -> Option<String> {
    let whole = text.split(['.', ',', 'e', 'E']).next().unwrap_or_default();
    let whole = if signs.contains(&'.') || signs.contains(&',') { text } else { whole };
    let mut groups = whole.split(signs).skip(1);
    let is_group = |group: &str| {
        let digits = group.bytes().take_while(u8::is_ascii_digit).count();
        digits == 3
    };
    groups.all(is_group).then(|| text.replace(signs, ""))
}

/// A cell that looks like a number in any notation, or like nothing.
pub fn is_numeric(cell: &str) -> bool {
    number(cell, Notation::Point).is_some()
        || (cell.contains(',') && number(cell, Notation::Comma).is_some())
        || (cell.contains(',') && number(cell, Notation::PointAndThousands).is_some())
        || with_unit(cell, Notation::Point).is_some()
}

/// A number with its unit in the same cell: `0.412 sec`, `93mA`.
pub fn with_unit(cell: &str, notation: Notation) -> Option<(f64, &'static str)> {
    let end = cell.rfind(|sign: char| sign.is_ascii_digit() || sign == '.')? + 1;
    let unit = units::named(&cell[end..]).filter(|unit| !unit.is_empty())?;
    Some((number(cell[..end].trim_end(), notation)?, unit))
}

/// Words for a direction, 1, -1, or 0 for none.
const DIRECTIONS: [(f64, &[&str]); 3] = [
    (1.0, &["fwd", "forward", "forwards", "f", "cw", "clockwise", "right", "up", "positive", "pos", "vor", "+"]),
    (
        -1.0,
        &[
            "rev",
            "reverse",
            "r",
            "bwd",
            "back",
            "backward",
            "backwards",
            "b",
            "ccw",
            "counterclockwise",
            "anticlockwise",
            "left",
            "down",
            "negative",
            "neg",
            "rueck",
        ],
    ),
    (0.0, &["stop", "stopped", "off", "brake", "coast", "idle", "halt"]),
];

/// The direction that a word names. What is not driven has none.
pub fn direction(cell: &str) -> Option<f64> {
    let lower = cell.to_lowercase();
    DIRECTIONS.into_iter().find(|(_, words)| words.contains(&lower.as_str())).map(|(sign, _)| sign)
}

/// A moment as a cell says it. What it does not say is missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The day.
    pub date: Option<Date>,
    /// Time since the begin of the day.
    pub clock: Option<SignedDuration>,
}

impl Moment {
    /// Nanoseconds since 1970, or since midnight without a date.
    pub fn nanoseconds(self) -> i128 {
        let day = self.date.map_or(0, |date| i128::from(days_since_1970(date)));
        day * 86_400_000_000_000 + self.clock.map_or(0, |clock| clock.as_nanos())
    }

    /// Seconds since 1970, or since midnight without a date.
    pub fn seconds(self) -> f64 {
        self.nanoseconds() as f64 * 1e-9
    }
}

fn days_since_1970(date: Date) -> i64 {
    let [year, month, day] = [i64::from(date.year()), i64::from(date.month()), i64::from(date.day())];
    // Years begin in March, so that the leap day is the last.
    let year = if month <= 2 { year - 1 } else { year };
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// Reads a date, a time of day, or both.
pub fn moment(cell: &str) -> Option<Moment> {
    // A quick look: it begins with a digit and has a sign between numbers.
    if !cell.as_bytes().first()?.is_ascii_digit() || !cell.bytes().any(|byte| matches!(byte, b':' | b'-' | b'/' | b'.'))
    {
        return None;
    }
    if let Some(clock) = clock(cell) {
        return Some(Moment { date: None, clock: Some(clock) });
    }
    if let Some(date) = date(cell) {
        return Some(Moment { date: Some(date), clock: None });
    }
    let (day, time) = cell.split_once(['T', 't', ' '])?;
    let date = date(day)?;
    if let Some(clock) = clock(time.trim()) {
        return Some(Moment { date: Some(date), clock: Some(clock) });
    }
    // An offset from universal time, or the letter Z.
    let stamp: Timestamp = cell.replacen(' ', "T", 1).replace(',', ".").parse().ok()?;
    let since = DateTime::from_parts(Date::constant(1970, 1, 1), Time::midnight());
    let civil = since.checked_add(SignedDuration::from_nanos_i128(stamp.as_nanosecond())).ok()?;
    let clock = civil.time().duration_since(Time::midnight());
    Some(Moment { date: Some(civil.date()), clock: Some(clock) })
}

/// 14:59:50, 14:59:50.001, 14:59:50,001, 2:59:50.1 PM, and 59:50.001 without hours.
fn clock(text: &str) -> Option<SignedDuration> {
    let lower = text.to_ascii_lowercase();
    let (text, half_day) = match lower.strip_suffix("pm").map(|text| (text, true)) {
        Some(found) => (found.0, Some(found.1)),
        None => lower.strip_suffix("am").map_or((&*lower, None), |text| (text, Some(false))),
    };
    let mut parts = text.trim_end().split(':');
    let (first, second, third) = (parts.next()?, parts.next()?, parts.next());
    let (hours, minutes, seconds) = match third {
        Some(seconds) => (first, second, seconds),
        // A fraction shows that seconds stand last: 12:30 may be hours and minutes.
        None if second.contains(['.', ',']) => ("0", first, second),
        None => return None,
    };
    // Some programs write the milliseconds after a third colon.
    let (seconds, fraction) = match parts.next() {
        Some(fraction) => (seconds, fraction),
        None => seconds.split_once(['.', ',']).unwrap_or((seconds, "")),
    };
    if parts.next().is_some() {
        return None;
    }
    let whole = |text: &str, most: i64| {
        let fits = (1..=2).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
        text.parse::<i64>().ok().filter(|value| fits && *value <= most)
    };
    let hours = match (half_day, whole(hours, 24)?) {
        (None, hours) => hours,
        (Some(afternoon), hours) => hours % 12 + if afternoon { 12 } else { 0 },
    };
    let (minutes, seconds) = (whole(minutes, 59)?, whole(seconds, 60)?);
    if fraction.len() > 12 || !fraction.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let nanoseconds: i32 = format!("{fraction:0<9}")[..9].parse().ok()?;
    Some(SignedDuration::new(hours * 3600 + minutes * 60 + seconds, nanoseconds))
}

/// 2024-03-01, 2024/03/01, 01.03.2024, 3/1/2024 (month first, unless only the other order exists).
fn date(text: &str) -> Option<Date> {
    let sign = ['-', '/', '.'].into_iter().find(|sign| text.matches(*sign).count() == 2)?;
    let parts: Vec<&str> = text.split(sign).collect();
    let is_whole = |part: &&str| (1..=4).contains(&part.len()) && part.bytes().all(|byte| byte.is_ascii_digit());
    if !parts.iter().all(is_whole) {
        return None;
    }
    let [a, b, c]: [i16; 3] = [parts[0].parse().ok()?, parts[1].parse().ok()?, parts[2].parse().ok()?];
    let of = |year: i16, month: i16, day: i16| Date::new(year, i8::try_from(month).ok()?, i8::try_from(day).ok()?).ok();
    match (parts[0].len(), parts[2].len(), sign) {
        (4, _, _) => of(a, b, c),
        (_, 4, '.') => of(c, b, a),
        (_, 4, _) => of(c, a, b).or_else(|| of(c, b, a)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_each_notation() {
        for (cell, notation, value) in [
            ("1234.5", Notation::Point, 1234.5),
            ("+3e-3", Notation::Point, 3e-3),
            (".5", Notation::Point, 0.5),
            ("1,234.5", Notation::PointAndThousands, 1234.5),
            ("-12,345,678", Notation::PointAndThousands, -12_345_678.0),
            ("1.234,5", Notation::Comma, 1234.5),
            ("-0,5", Notation::Comma, -0.5),
            ("1.5", Notation::Comma, 1.5),
            ("1'234.5", Notation::Point, 1234.5),
            ("1\u{a0}234,5", Notation::Comma, 1234.5),
            ("true", Notation::Point, 1.0),
        ] {
            assert_eq!(number(cell, notation), Some(value), "{cell}");
        }
        for cell in ["", "NaN", "nan", "N/A", "ovf", "inf", "---", "#DIV/0!", "null"] {
            assert!(number(cell, Notation::Point).is_some_and(f64::is_nan), "{cell}");
        }
        for (cell, notation) in [
            ("x", Notation::Point),
            ("1,5", Notation::Point),
            ("1,5", Notation::PointAndThousands),
            ("1.2.3", Notation::Comma),
        ] {
            assert_eq!(number(cell, notation), None, "{cell}");
        }
    }

    #[test]
    fn cells_with_a_unit_or_a_direction() {
        for (cell, found) in [
            ("0.412 sec", Some((0.412, "s"))),
            ("-93mA", Some((-93.0, "mA"))),
            ("1e-3 V", Some((1e-3, "V"))),
            ("CH1 V", None),
            ("5 apples", None),
            ("V", None),
        ] {
            assert_eq!(with_unit(cell, Notation::Point), found, "{cell}");
        }
        assert_eq!(with_unit("1,5 V", Notation::Comma), Some((1.5, "V")));
        assert_eq!(["FWD", "ccw", "Stop", "x"].map(direction), [Some(1.0), Some(-1.0), Some(0.0), None]);
    }

    #[test]
    fn cells_show_their_notation() {
        for (cell, notation) in [
            ("1,5", Some(Notation::Comma)),
            ("0,001", Some(Notation::Comma)),
            ("1.234,5", Some(Notation::Comma)),
            ("1,234.5", Some(Notation::PointAndThousands)),
            ("1,234,567", Some(Notation::PointAndThousands)),
            ("1,234", None),
            ("12.5", None),
            ("left, right", None),
        ] {
            assert_eq!(evidence(cell), notation, "{cell}");
        }
    }

    #[test]
    fn moments_of_clocks_and_calendars() {
        let second = 1_000_000_000;
        let day = 86_400 * i128::from(second);
        let afternoon = (14 * 3600 + 59 * 60 + 50) * i128::from(second);
        for (cell, nanoseconds) in [
            ("14:59:50.001", afternoon + 1_000_000),
            ("14:59:50,001", afternoon + 1_000_000),
            ("14:59:50:001", afternoon + 1_000_000),
            ("2:59:50 PM", afternoon),
            ("12:00:00 AM", 0),
            ("59:50.001", 3590 * i128::from(second) + 1_000_000),
            ("2024-03-01", 19_783 * day),
            ("01.03.2024", 19_783 * day),
            ("3/1/2024", 19_783 * day),
            ("2024-03-01T14:59:50.000000001Z", 19_783 * day + afternoon + 1),
            ("2024-03-01 14:59:50", 19_783 * day + afternoon),
            ("2024-03-01T16:59:50+02:00", 19_783 * day + afternoon),
        ] {
            assert_eq!(moment(cell).map(Moment::nanoseconds), Some(nanoseconds), "{cell}");
        }
        for cell in ["1.5", "12:30", "-1", "1e-3", "a:b:c", "25:00:00", "2024-13-01", "1.2.3"] {
            assert_eq!(moment(cell), None, "{cell}");
        }
    }
}

//! One mapping of a file's names to channels, for every command that reads a recording.
//!
//! `NAME=CHANNEL`, with a factor and an offset: `adc=i_A*0.0264-13.5`, `pwm=duty/255`. `NAME` is one of
//!
//! - the name in the file, or the last part of its path; `NAME#2` for the second of two equal names;
//! - a number, for the column of that number; `row`, for the number of the row from 0;
//! - `NAME*sign(OTHER)`, for a value whose sign is in another column;
//! - `quadrature(A,B)`, for the count of the edges of an encoder's two channels.

use crate::content::Column;
use crate::recording::Channel;
use crate::{speed_signs, units};
use motorbench_text::keys;

/// A name in the file and its channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapping {
    /// Name in the file. See the module.
    pub name: String,
    /// The channel.
    pub channel: Channel,
    /// Factor for its values; `None`: the unit that the file states.
    pub factor: Option<f64>,
    /// What is added then.
    pub offset: f64,
}

/// What a mapping looks like, for messages.
const EXPECTED: &str = "expected NAME=CHANNEL, with a factor and an offset if needed, for instance speed=omega_rad_per_s*6.2832 or adc=i_A*0.0264-13.5";

impl std::str::FromStr for Mapping {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // The names of some formats contain an equals sign; those of channels do not.
        let (name, right) = text.rsplit_once('=').ok_or(EXPECTED)?;
        let end = right.find(['*', '/', '+', '-', ' ']).unwrap_or(right.len());
        let (column, mut rest) = (right[..end].trim(), right[end..].trim());
        let channel = Channel::of_column(column).ok_or_else(|| no_channel(column))?;
        let (mut factor, mut offset) = (None, 0.0);
        while let Some(sign) = rest.chars().next() {
            let after = rest[sign.len_utf8()..].trim_start();
            let end = end_of_number(after);
            let number = after[..end].trim().parse::<f64>().ok().filter(|number| number.is_finite());
            let number =
                number.ok_or_else(|| format!("\"{rest}\" should begin with *, /, + or - and a number; {EXPECTED}"))?;
            match sign {
                '*' | '/' if number == 0.0 => {
                    return Err(format!("the factor must be a number other than 0; {EXPECTED}"));
                }
                '*' if offset == 0.0 => factor = Some(factor.unwrap_or(1.0) * number),
                '/' if offset == 0.0 => factor = Some(factor.unwrap_or(1.0) / number),
                '+' => offset += number,
                '-' => offset -= number,
                _ => return Err(format!("\"{right}\": the offset stands last; {EXPECTED}")),
            }
            rest = after[end..].trim_start();
        }
        Ok(Self { name: name.trim().into(), channel, factor, offset })
    }
}

/// Where the number at the begin of a text ends; it may have a sign and an exponent.
fn end_of_number(text: &str) -> usize {
    let is_exponent = |at: usize| matches!(text.as_bytes()[at - 1], b'e' | b'E');
    let ends = |(at, sign): &(usize, char)| match sign {
        '*' | '/' | ' ' => true,
        '+' | '-' => *at > 0 && !is_exponent(*at),
        _ => false,
    };
    text.char_indices().find(ends).map_or(text.len(), |(at, _)| at)
}

fn no_channel(column: &str) -> String {
    let meant = keys::suggestion(keys::nearest(column, Channel::ALL.map(Channel::column)));
    format!("no channel is called \"{column}\"{meant}; there are {}", all_columns())
}

/// The names of all channels.
pub fn all_columns() -> String {
    Channel::ALL.map(Channel::column).join(", ")
}

/// What a mapping takes from the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    /// A column.
    Column(usize),
    /// The number of the row, from 0.
    Row,
    /// The magnitude of the first with the sign of the second.
    Signed(usize, usize),
    /// The count of the edges of an encoder's channels.
    Quadrature(usize, usize),
}

impl Term {
    /// The columns in it.
    pub fn columns(self) -> Vec<usize> {
        match self {
            Self::Column(column) => vec![column],
            Self::Row => Vec::new(),
            Self::Signed(a, b) | Self::Quadrature(a, b) => vec![a, b],
        }
    }
}

/// Finds what a name means among the names of a file.
///
/// # Errors
/// What is wrong with the name, and which names there are.
pub fn resolved(name: &str, names: &[&str]) -> Result<Term, String> {
    if let Some(column) = one(name, names)? {
        return Ok(Term::Column(column));
    }
    if name == "row" {
        return Ok(Term::Row);
    }
    let column = |name: &str| one(name.trim(), names)?.ok_or_else(|| unknown(name.trim(), names));
    if let Some((of, by)) = name.strip_suffix(')').and_then(|name| name.split_once("*sign(")) {
        return Ok(Term::Signed(column(of)?, column(by)?));
    }
    if let Some((a, b)) = name
        .strip_prefix("quadrature(")
        .and_then(|name| name.strip_suffix(')'))
        .and_then(|inside| inside.split_once(','))
    {
        return Ok(Term::Quadrature(column(a)?, column(b)?));
    }
    Err(unknown(name, names))
}

fn unknown(name: &str, names: &[&str]) -> String {
    let meant = keys::suggestion(keys::nearest(name, names.iter().copied()));
    format!("there is no numeric column \"{name}\"{meant}; there are {}", listed(names))
}

/// So many names are listed in a message.
const LISTED: usize = 40;

/// Names for a message.
pub fn listed(names: &[&str]) -> String {
    match names.len().checked_sub(LISTED) {
        Some(more @ 1..) => format!("{} and {more} more", names[..LISTED].join(", ")),
        _ => names.join(", "),
    }
}

/// The column of a name: by its whole name, the last parts of its path, without its unit, or by its number.
fn one(name: &str, names: &[&str]) -> Result<Option<usize>, String> {
    let bare = |full: &str| units::in_name(full).map_or(full.to_owned(), |(bare, _)| bare.to_owned());
    let equal = |full: &str| full.rsplit_once('#').map_or(full.to_owned(), |(name, _)| name.to_owned());
    let end = format!("/{name}");
    let ways: [&dyn Fn(&str) -> bool; 6] = [
        &|full| full == name,
        &|full| equal(full) == name,
        &|full| bare(full) == name || full.ends_with(&end) || bare(full).ends_with(&end),
        &|full| equal(last_part(full)) == name,
        &|full| bare(last_part(full)) == name,
        &|full| full.eq_ignore_ascii_case(name),
    ];
    for is_it in ways {
        let found: Vec<usize> = (0..names.len()).filter(|column| is_it(names[*column])).collect();
        match found[..] {
            [] => {}
            [one] => return Ok(Some(one)),
            _ => {
                let which = found.iter().map(|column| names[*column]).collect::<Vec<_>>().join(", ");
                return Err(format!("\"{name}\" may be {which}: give the whole name"));
            }
        }
    }
    let number = name.parse::<usize>().ok().filter(|number| (1..=names.len()).contains(number));
    Ok(number.map(|number| number - 1))
}

/// The part of a path after its last slash, or without one after its last point: `/motor/speed`, `field.speed`.
pub fn last_part(name: &str) -> &str {
    let whole = units::in_name(name).map_or(name, |(bare, _)| bare);
    let begins_a_name = |point: &usize| whole[point + 1..].starts_with(char::is_alphabetic);
    let start = whole.rfind('/').or_else(|| whole.rfind('.').filter(begins_a_name)).map_or(0, |sign| sign + 1);
    &name[start..]
}

/// The values of a term.
pub fn values(term: Term, columns: &[&Column], rows: usize) -> Vec<f64> {
    match term {
        Term::Column(column) => columns[column].values.clone(),
        Term::Row => (0..rows).map(|row| row as f64).collect(),
        Term::Signed(of, by) => {
            columns[of].values.iter().zip(signs(columns[by])).map(|(of, sign)| signed(of.abs(), sign)).collect()
        }
        Term::Quadrature(a, b) => quadrature(&columns[a].values, &columns[b].values),
    }
}

/// The directions in a column, 1 or -1.
fn signs(column: &Column) -> Vec<f64> {
    // The level of a pin has no negative value: its 0 is the other direction.
    let is_level = !column.values.iter().any(|value| *value < 0.0);
    let sign = |by: &f64| match *by {
        by if by.is_nan() => f64::NAN,
        by if by < 0.0 || is_level && by == 0.0 => -1.0,
        _ => 1.0,
    };
    column.values.iter().map(sign).collect()
}

/// The values of a term that is a speed: with a sign by another column it turns back only when it has come to zero.
pub fn speeds(term: Term, columns: &[&Column], rows: usize) -> Vec<f64> {
    match term {
        Term::Signed(of, by) => speed_signs::signed(&columns[of].values, &signs(columns[by])),
        _ => values(term, columns, rows),
    }
}

/// Without a negative zero.
fn signed(magnitude: f64, sign: f64) -> f64 {
    if magnitude == 0.0 && !sign.is_nan() { 0.0 } else { magnitude * sign }
}

/// Counts every edge: up where A leads B. Both edges between two rows have no direction, and count nothing.
fn quadrature(a: &[f64], b: &[f64]) -> Vec<f64> {
    let middle = |values: &[f64]| {
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        (finite().fold(f64::INFINITY, f64::min) + finite().fold(f64::NEG_INFINITY, f64::max)) / 2.0
    };
    let (middle_a, middle_b) = (middle(a), middle(b));
    let (mut count, mut before): (i64, Option<i64>) = (0, None);
    a.iter()
        .zip(b)
        .map(|(a, b)| {
            // The states in the order of a shaft that turns forwards.
            let state = match (*a > middle_a, *b > middle_b) {
                (false, false) => 0,
                (true, false) => 1,
                (true, true) => 2,
                (false, true) => 3,
            };
            match (state - before.unwrap_or(state)).rem_euclid(4) {
                1 => count += 1,
                3 => count -= 1,
                _ => {}
            }
            before = Some(state);
            count as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Mapping {
        text.parse().unwrap()
    }

    #[test]
    fn factors_and_offsets() {
        for (text, name, channel, factor, offset) in [
            ("adc=i_A*0.0264-13.5", "adc", Channel::Current, Some(0.0264), -13.5),
            ("pwm=duty/255", "pwm", Channel::Duty, Some(1.0 / 255.0), 0.0),
            ("v=omega_rad_per_s*9.5/1320", "v", Channel::Speed, Some(9.5 / 1320.0), 0.0),
            ("a=b=u_V * -1e-3 + 2", "a=b", Channel::Voltage, Some(-1e-3), 2.0),
            ("t=t_s", "t", Channel::Time, None, 0.0),
            ("pwm*sign(dir)=duty/255", "pwm*sign(dir)", Channel::Duty, Some(1.0 / 255.0), 0.0),
            ("x=i_A-2.5", "x", Channel::Current, None, -2.5),
        ] {
            let read = parsed(text);
            assert_eq!((&*read.name, read.channel, read.factor), (name, channel, factor), "{text}");
            assert!((read.offset - offset).abs() < 1e-12, "{text}");
        }
        for (text, why) in [
            ("speed", "expected NAME=CHANNEL"),
            ("speed=omega", "no channel is called \"omega\""),
            ("speed=rpm*0", "other than 0"),
            ("speed=rpm*x", "and a number"),
            ("speed=rpm+1*2", "the offset stands last"),
        ] {
            assert!(text.parse::<Mapping>().unwrap_err().contains(why), "{text}");
        }
    }

    #[test]
    fn names_are_found_in_many_ways() {
        let names = ["/motor/speed[rad/s]", "rpm#1", "rpm#2", "left/v", "right/v", "Time (ms)"];
        let found = |name: &str| resolved(name, &names);
        assert_eq!(found("speed"), Ok(Term::Column(0)));
        assert_eq!(found("/motor/speed"), Ok(Term::Column(0)));
        assert_eq!(found("rpm#2"), Ok(Term::Column(2)));
        assert_eq!(found("Time"), Ok(Term::Column(5)));
        assert_eq!(resolved("pwm", &["time", "field.pwm", "field.rpm"]), Ok(Term::Column(1)));
        assert_eq!(found("3"), Ok(Term::Column(2)));
        assert_eq!(found("row"), Ok(Term::Row));
        assert_eq!(found("left/v*sign(speed)"), Ok(Term::Signed(3, 0)));
        assert_eq!(found("rpm"), Err("\"rpm\" may be rpm#1, rpm#2: give the whole name".into()));
        assert_eq!(found("v"), Err("\"v\" may be left/v, right/v: give the whole name".into()));
        assert!(found("sped").is_err_and(|why| why.contains("there are /motor/speed[rad/s], rpm#1")));
        assert!(found("7").is_err());
    }

    #[test]
    fn signs_and_edges() {
        let column = |values: &[f64]| Column::new("x", values.to_vec());
        let (pwm, pin, way) = (column(&[10.0, 20.0, 0.0]), column(&[1.0, 0.0, 0.0]), column(&[1.0, -1.0, 0.0]));
        assert_eq!(values(Term::Signed(0, 1), &[&pwm, &pin], 3), [10.0, -20.0, 0.0]);
        assert_eq!(values(Term::Signed(0, 1), &[&pwm, &way], 3), [10.0, -20.0, 0.0]);
        let a = column(&[0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let b = column(&[0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0]);
        assert_eq!(values(Term::Quadrature(0, 1), &[&a, &b], 7), [0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0]);
    }
}

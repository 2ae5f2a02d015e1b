//! The content of a file as a recording: names become channels, units become SI, times become what they should be.

use crate::content::{Broken, Column, Content};
use crate::mapping::{self, Mapping, Term, all_columns, last_part, resolved};
use crate::recording::{Channel, LONGEST_TABLE, Recording};
use crate::{series, speed_wraps, suggestions, units};

/// Largest share of rows that may be unreadable. More are not explained by noise on a line.
pub const MOST_BROKEN: f64 = 0.01;

/// So many series are looked at for a proposal, and so many values of each.
const MOST_NAMED: usize = 200;
const GLANCE: usize = 1000;

/// A channel, and what in the file it is.
struct Use {
    channel: Channel,
    term: Term,
    factor: f64,
    offset: f64,
}

/// Makes a recording.
///
/// # Errors
/// What is wrong, with the place.
pub fn recording(name: &str, mut content: Content, mappings: &[Mapping]) -> Result<Recording, String> {
    if !content.series.is_empty() {
        let all: Vec<Column> = content.series.iter().take(MOST_NAMED).map(|one| one.glance(GLANCE)).collect();
        content = series::joined(content, mappings)?;
        if content.columns.is_empty() {
            return Err(no_channel(&all, &[Channel::Time]));
        }
    }
    let mut recording = Recording::new(name);
    let columns: Vec<&Column> = content.columns.iter().collect();
    let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    let mut uses = by_mappings(mappings, &names, &columns)?;
    by_names(&mut uses, &names, &columns)?;
    let first = uses.iter().find_map(|found| found.term.columns().first().copied());
    let rows = first.map_or_else(
        || columns.iter().map(|column| column.values.len()).max(),
        |first| Some(columns[first].values.len()),
    );
    let rows = rows.unwrap_or(0);
    recording.notes.extend(time_by_itself(&mut uses, &columns, rows, content.header.is_some()));
    let used: Vec<usize> = uses.iter().flat_map(|found| found.term.columns()).collect();
    let unused = || columns.iter().enumerate().filter(|(index, _)| !used.contains(index)).map(|(_, column)| *column);
    let has: Vec<Channel> = uses.iter().map(|found| found.channel).collect();
    if has.is_empty() || has == [Channel::Time] && unused().next().is_some() && mappings.is_empty() {
        return Err(nothing_known(&content, &has));
    }
    let taken = uses.iter().filter_map(|found| match found.term {
        Term::Column(column) => Some((found.channel, columns[column])),
        _ => None,
    });
    let left: Vec<&Column> = unused().filter(|column| !column.is_text()).collect();
    recording.suggestion = suggestions::options(left.iter().copied(), &has, taken);
    recording.ignored = unused()
        .map(|column| column.name.clone())
        .filter(|name| !name.is_empty() && name != crate::table::PREFIX)
        .collect();
    recording.ignored.extend(content.ignored.iter().cloned());
    let mut broken = content.broken.clone();
    if let Some(other) = used.iter().find(|column| columns[**column].values.len() != rows) {
        return Err(unequal(columns[used[0]], columns[*other]));
    }
    let kept = readable(&content, &columns, &uses, rows, &mut broken);
    check_broken(&broken, rows, content.lines.len() + content.broken.len())?;
    if rows > 0 && !broken.is_empty() {
        recording.notes.push(note_on(&broken));
    }
    let tick_s = uses.iter().find(|found| found.channel == Channel::Time).map_or(1.0, |found| found.factor);
    fill(&mut recording, &uses, &columns, &kept)?;
    recording.notes.extend(content.notes);
    recording.leave_rows_without_time_out();
    recording.mend_times(tick_s);
    Ok(recording)
}

/// Gives the recording its channels, in the rows that are kept.
fn fill(recording: &mut Recording, uses: &[Use], columns: &[&Column], kept: &[bool]) -> Result<(), String> {
    let rows = kept.len();
    let command = command(uses, columns, rows);
    for &Use { channel, term, factor, offset } in uses {
        let is_speed = matches!(channel, Channel::Speed | Channel::Rpm);
        let of_term = if is_speed { mapping::speeds } else { mapping::values };
        let mut values = of_term(term, columns, rows);
        if is_speed && speed_wraps::wrap(&values) {
            values = without_wraps(channel, &values, command.as_deref())?;
            recording.notes.push(format!("{} wraps at 16 bits. It is continued.", channel.column()));
        }
        let keep = values.iter().zip(kept).filter(|(_, kept)| **kept).map(|(value, _)| value * factor + offset);
        recording.set(channel, keep.collect());
    }
    Ok(())
}

/// What the bridge is told, if the file has it.
fn command(uses: &[Use], columns: &[&Column], rows: usize) -> Option<Vec<f64>> {
    let is_command = |found: &&Use| matches!(found.channel, Channel::Voltage | Channel::Duty);
    uses.iter().find(is_command).map(|found| mapping::values(found.term, columns, rows))
}

/// A speed of 16 bits as it was before it wrapped. The command says more than the last row does.
fn without_wraps(channel: Channel, values: &[f64], command: Option<&[f64]>) -> Result<Vec<f64>, String> {
    command
        .and_then(|command| speed_wraps::continued_by(command, values))
        .or_else(|| speed_wraps::continued(values))
        .ok_or_else(|| {
            format!(
                "{} wraps at 16 bits, and changes by more than half of that between rows, so it cannot be continued. Record it in 32 bits, in a larger unit, or more often",
                channel.column()
            )
        })
}

fn unequal(first: &Column, other: &Column) -> String {
    let (count, of_first) = (other.values.len(), first.values.len());
    let (name, first) = (&other.name, &first.name);
    format!("{name} has {count} values and {first} has {of_first}: cut or resample them to the same times")
}

fn by_mappings(mappings: &[Mapping], names: &[&str], columns: &[&Column]) -> Result<Vec<Use>, String> {
    let mut uses: Vec<Use> = Vec::new();
    for Mapping { name, channel, factor, offset } in mappings {
        if uses.iter().any(|other| other.channel == *channel) {
            return Err(format!("two names map to {}: map one of them to another channel", channel.column()));
        }
        let term = resolved(name, names)?;
        let stated = match term {
            Term::Column(column) | Term::Signed(column, _) => {
                units::factor(*channel, &columns[column].unit).unwrap_or(1.0)
            }
            _ => 1.0,
        };
        uses.push(Use { channel: *channel, term, factor: factor.unwrap_or(stated), offset: *offset });
    }
    Ok(uses)
}

/// Names that are those of channels, whole or in the last part of a path.
fn by_names(uses: &mut Vec<Use>, names: &[&str], columns: &[&Column]) -> Result<(), String> {
    let mapped: Vec<usize> = uses.iter().flat_map(|found| found.term.columns()).collect();
    let (mut twice, mut choices) = (None, String::new());
    for channel in Channel::ALL {
        if uses.iter().any(|found| found.channel == channel) {
            continue;
        }
        let column = channel.column();
        let is_it = |name: &str| {
            let equal = name.rsplit_once('#').map_or(name, |(name, _)| name);
            equal == column || last_part(equal) == column
        };
        let free = |at: &usize| !mapped.contains(at);
        let mut found: Vec<usize> = (0..names.len()).filter(free).filter(|at| names[*at] == column).collect();
        if found.is_empty() {
            found = (0..names.len()).filter(free).filter(|at| is_it(names[*at])).collect();
        }
        match found[..] {
            [] => {}
            [one] => {
                let factor = units::factor(channel, &columns[one].unit).unwrap_or(1.0);
                uses.push(Use { channel, term: Term::Column(one), factor, offset: 0.0 });
            }
            [_, _, ..] => {
                let which = || found.iter().map(|at| names[*at]).collect::<Vec<_>>().join(", ");
                twice.get_or_insert_with(|| format!("two columns are {column}: {}", which()));
                // A set value holds for some time, a measured one changes from row to row.
                let measured = found.iter().rev().max_by_key(|at| changes(columns[**at])).expect("there are two");
                choices += &format!(" --column {}={column}", names[*measured]);
            }
        }
    }
    twice.map_or(Ok(()), |twice| Err(format!("{twice}. Choose, for instance{choices}")))
}

/// Rows whose value differs from the one before.
fn changes(column: &Column) -> usize {
    column.values.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

/// Takes a column as the time that can be nothing else: moments, a unit of time, `__time`. A short table may be one of
/// steady states with a time of day.
fn time_by_itself(uses: &mut Vec<Use>, columns: &[&Column], rows: usize, has_names: bool) -> Option<String> {
    if uses.iter().any(|found| found.channel == Channel::Time) || rows < LONGEST_TABLE && has_names {
        return None;
    }
    let used: Vec<usize> = uses.iter().flat_map(|found| found.term.columns()).collect();
    let free = |column: &usize| {
        let values = &columns[*column].values;
        !used.contains(column) && values.len() == rows && values.iter().any(|value| value.is_finite())
    };
    let find = |is_it: &dyn Fn(&Column) -> bool| (0..columns.len()).filter(free).find(|column| is_it(columns[*column]));
    let is_stamp = |column: &Column| column.name == crate::table::PREFIX;
    let column = find(&|column| column.name == "__time")
        .or_else(|| find(&|column| column.since.is_some() && !is_stamp(column)))
        .or_else(|| find(&|column| units::is_of_time(&column.unit) && !is_stamp(column)))
        .or_else(|| find(&|column| units::of_time_in_name(&column.name).is_some()))
        .or_else(|| find(&is_stamp))?;
    let found = columns[column];
    let unit = if found.unit.is_empty() { units::of_time_in_name(&found.name).unwrap_or("s") } else { &found.unit };
    let factor = units::factor(Channel::Time, unit).unwrap_or(1.0);
    uses.push(Use { channel: Channel::Time, term: Term::Column(column), factor, offset: 0.0 });
    let name = &found.name;
    Some(match &found.since {
        Some(since) => format!("t_s is counted from {since} (column {name})."),
        None => format!("t_s is the column {name}, in {unit}."),
    })
}

/// Why a file is of no use without a mapping, with a proposal.
fn nothing_known(content: &Content, has: &[Channel]) -> String {
    if content.is_text && content.header.is_none() {
        let line = content.lines.first().copied().unwrap_or(1);
        return format!(
            "line {line} is numbers: there is no header line. Name the columns by their numbers, for instance {}",
            suggestions::by_number(&content.columns)
        );
    }
    no_channel(&content.columns, has)
}

fn no_channel(columns: &[Column], has: &[Channel]) -> String {
    let numbers = || columns.iter().filter(|column| !column.is_text());
    let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).filter(|name| !name.is_empty()).collect();
    if columns.is_empty() {
        return "no numbers were found in it. Save the signals as plain vectors, or as CSV".into();
    }
    let are_numbered = names.iter().all(|name| last_part(name).parse::<usize>().is_ok());
    let proposal = suggestions::options(numbers(), has, std::iter::empty());
    let is_probe =
        |column: &&Column| column.name.to_lowercase().starts_with("ch") && matches!(&*column.unit, "V" | "mV");
    let advice = match numbers().any(|column| is_probe(&column)) {
        _ if are_numbered => format!("Name them, for instance {}", suggestions::by_number(columns)),
        _ if !proposal.is_empty() => format!("Likely: {proposal}"),
        true => suggestions::of_probes(numbers().filter(is_probe)),
        false => "Name them with --column NAME=CHANNEL".to_owned(),
    };
    format!("no known channel among {}. {advice}. Channels are {}", mapping::listed(&names), all_columns())
}

/// Which rows have a number in every column that is used.
fn readable(content: &Content, columns: &[&Column], uses: &[Use], rows: usize, broken: &mut Vec<Broken>) -> Vec<bool> {
    let mut kept = vec![true; rows];
    for found in uses {
        for column in found.term.columns() {
            for (row, text) in &columns[column].unreadable {
                if std::mem::replace(&mut kept[*row], false) {
                    let what = unreadable(&columns[column].name, found.channel, text);
                    broken.push(Broken { line: content.lines.get(*row).copied().unwrap_or(*row as u64 + 1), what });
                }
            }
        }
        if let Term::Column(column) = found.term {
            for (row, value) in columns[column].values.iter().enumerate() {
                let Some(what) = found.channel.refusal(value * found.factor + found.offset) else { continue };
                if std::mem::replace(&mut kept[row], false) {
                    broken.push(Broken { line: content.lines.get(row).copied().unwrap_or(row as u64 + 1), what });
                }
            }
        }
    }
    broken.sort_by_key(|broken| broken.line);
    kept
}

fn unreadable(name: &str, channel: Channel, text: &str) -> String {
    let of = if name == channel.column() { String::new() } else { format!(" ({})", channel.column()) };
    let hint = if text.contains(',') { "; for decimal commas add --decimal-comma" } else { "" };
    format!("column {name}{of}: expected a number, found \"{text}\"{hint}")
}

fn check_broken(broken: &[Broken], rows: usize, lines: usize) -> Result<(), String> {
    let (count, all) = (broken.len(), lines.max(rows));
    let Some(first) = broken.first().filter(|_| count as f64 > MOST_BROKEN * all as f64) else { return Ok(()) };
    let Broken { line, what } = first;
    let others = if count > 1 {
        format!(" ({count} of {all} lines cannot be read; up to one in a hundred is left out)")
    } else {
        String::new()
    };
    Err(format!("line {line}: {what}{others}"))
}

fn note_on(broken: &[Broken]) -> String {
    let Broken { line, what } = &broken[0];
    match broken.len() {
        1 => format!("Line {line} cannot be read and is left out: {what}."),
        count => format!("{count} lines cannot be read and are left out. The first is line {line}: {what}."),
    }
}

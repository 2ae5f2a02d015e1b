//! Brings series with their own times to common times. Logs that are written on change have such series.

use crate::content::{Column, Content, Series};
use crate::mapping::{Mapping, Term, last_part, resolved};
use crate::recording::Channel;
use crate::statistics::median;

/// Programs log the quantities of one pass one after the other. A value belongs to a sample if it is later by less than
/// this share of the interval.
const SAME_PASS: f64 = 0.25;
/// A measured value belongs to a sample that is nearer than this share of the interval.
const SAME_SAMPLE: f64 = 0.5;

/// So many series are used by their names: more than there are channels. Each becomes a column, while a file may have
/// thousands that share one list of samples.
const MOST_BY_NAME: usize = 100;

/// What a series is to a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Role {
    /// A reading of the shaft.
    Motion,
    /// Another reading.
    Reading,
    /// What holds until it changes: a command, a direction.
    Held,
}

fn role(channel: Option<Channel>) -> Role {
    match channel {
        Some(Channel::Speed | Channel::Rpm | Channel::Counts | Channel::Angle) => Role::Motion,
        Some(Channel::Position | Channel::Velocity) => Role::Motion,
        Some(Channel::Current) => Role::Reading,
        _ => Role::Held,
    }
}

/// Columns at the times of the measured motion with the most samples, counted from the first. A command holds its last
/// value; before its first one it is missing. Other readings are missing where they have no sample. Series that are no
/// channel are listed and not used.
///
/// # Errors
/// For a log with several runs, or a mapping of what is not there.
pub fn joined(mut content: Content, mappings: &[Mapping]) -> Result<Content, String> {
    let series = std::mem::take(&mut content.series);
    let roles = roles(&series, mappings)?;
    let mut used: Vec<(Series, Role)> = Vec::new();
    for (series, role) in series.into_iter().zip(roles) {
        match role {
            Some(role) => used.push((series, role)),
            None => content.ignored.push(series.name),
        }
    }
    let count = |wanted: Role| {
        used.iter()
            .filter(|(_, role)| *role == wanted)
            .map(|(series, _)| series)
            .max_by_key(|series| series.time_s.len())
    };
    let base = count(Role::Motion).or_else(|| count(Role::Reading)).or_else(|| count(Role::Held));
    let Some((base, base_name)) = base.map(|base| (base.time_s.clone(), base.name.clone())) else { return Ok(content) };
    for (series, _) in &used {
        if series.time_s.windows(2).any(|pair| pair[1] < pair[0]) {
            return Err(format!("{}: the times go backwards, so the log has two runs: split it", series.name));
        }
    }
    let start_s = base.first().copied().unwrap_or(0.0);
    let interval_s = median(base.windows(2).map(|pair| pair[1] - pair[0]));
    // Whole nanoseconds: differences of large times have no more digits.
    let times = base.iter().map(|t_s| ((t_s - start_s) * 1e9).round() / 1e9).collect();
    content.columns.push(Column::new(Channel::Time.column(), times));
    for (series, role) in used {
        let (values, left_out) = match role {
            Role::Held => held(&series, &base, SAME_PASS * interval_s),
            _ => nearest(&series, &base, SAME_SAMPLE * interval_s),
        };
        if left_out > 0 {
            content.notes.push(format!(
                "{left_out} of {} values of {} lie between the samples of {base_name} and are left out.",
                series.values.len(),
                series.name
            ));
        }
        content.columns.push(Column::new(series.name, values));
    }
    Ok(content)
}

/// The role of each series; `None`: it is not used.
fn roles(series: &[Series], mappings: &[Mapping]) -> Result<Vec<Option<Role>>, String> {
    let names: Vec<&str> = series.iter().map(|series| series.name.as_str()).collect();
    let by_name = |name: &str| Channel::of_column(name).or_else(|| Channel::of_column(last_part(name)));
    let mut left = MOST_BY_NAME;
    let mut usual = |name: &str| {
        let channel = by_name(name)?;
        left = left.checked_sub(1)?;
        Some(role(Some(channel)))
    };
    let mut roles: Vec<Option<Role>> = names.iter().map(|name| usual(name)).collect();
    for mapping in mappings {
        if mapping.channel == Channel::Time {
            return Err(format!("{}: the log has its own times: leave this one out of --column", mapping.name));
        }
        match resolved(&mapping.name, &names)? {
            Term::Column(column) => roles[column] = Some(role(Some(mapping.channel))),
            Term::Signed(of, by) => {
                roles[of] = Some(role(Some(mapping.channel)));
                roles[by] = Some(Role::Held);
            }
            Term::Quadrature(a, b) => (roles[a], roles[b]) = (Some(Role::Motion), Some(Role::Motion)),
            Term::Row => {}
        }
    }
    if let Some(time) = names.iter().position(|name| by_name(name) == Some(Channel::Time)) {
        roles[time] = None;
    }
    Ok(roles)
}

/// The last value at each time, and how many values no time has seen.
fn held(series: &Series, base: &[f64], tolerance_s: f64) -> (Vec<f64>, usize) {
    let (mut next, mut seen) = (0, 0);
    let values = base
        .iter()
        .map(|t_s| {
            let before = next;
            while next < series.time_s.len() && series.time_s[next] <= t_s + tolerance_s {
                next += 1;
            }
            seen += usize::from(next > before);
            if next == 0 { f64::NAN } else { series.values[next - 1] }
        })
        .collect();
    (values, series.values.len() - seen)
}

/// The nearest value at each time, missing where there is none, and how many values belong to no time.
fn nearest(series: &Series, base: &[f64], tolerance_s: f64) -> (Vec<f64>, usize) {
    let mut values = vec![f64::NAN; base.len()];
    let mut distances = vec![f64::INFINITY; base.len()];
    for (t_s, value) in series.time_s.iter().zip(&*series.values) {
        let after = base.partition_point(|base| base < t_s);
        let candidates = after.saturating_sub(1)..(after + 1).min(base.len());
        let Some(row) = candidates.min_by(|a, b| (base[*a] - t_s).abs().total_cmp(&(base[*b] - t_s).abs())) else {
            continue;
        };
        let distance = (base[row] - t_s).abs();
        if distance <= tolerance_s && distance < distances[row] {
            (values[row], distances[row]) = (*value, distance);
        }
    }
    let placed = distances.iter().filter(|distance| distance.is_finite()).count();
    (values, series.values.len().saturating_sub(placed))
}

//! Brings series with their own times to common times.

use super::{Column, Fault, Names};
use crate::recording::Channel;
use crate::statistics::median;

/// One quantity at the times when it was logged.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    pub name: String,
    pub time_s: Vec<f64>,
    pub values: Vec<f64>,
}

/// Programs log the quantities of one pass one after the other. A value belongs to a sample if it is later by less than
/// this share of the interval.
const SAME_PASS: f64 = 0.25;

/// Columns at the times of the series with the most samples, counted from the first. Each other series holds its last
/// value, since such logs are written on change; before its first value it is missing. Series that are no channel are
/// not used; their names are returned.
pub fn joined(series: Vec<Series>, names: &Names) -> Result<(Vec<Column>, Vec<String>), Fault> {
    let (used, unused): (Vec<_>, Vec<_>) = series.into_iter().partition(|series| names.channel(&series.name).is_some());
    let ignored = unused.into_iter().map(|series| series.name).collect();
    let Some(densest) = used.iter().max_by_key(|series| series.time_s.len()) else { return Ok((Vec::new(), ignored)) };
    let base = densest.time_s.clone();
    let start_s = base.first().copied().unwrap_or(0.0);
    let interval_s = median(base.windows(2).map(|pair| pair[1] - pair[0]));
    let mut columns = vec![Column {
        name: Channel::Time.column().into(),
        // Whole nanoseconds: differences of large times have no more digits.
        values: base.iter().map(|t_s| ((t_s - start_s) * 1e9).round() * 1e-9).collect(),
    }];
    for series in used {
        if names.channel(&series.name).is_some_and(|(channel, _)| channel == Channel::Time) {
            return Err(Fault::at(&series.name, "the log has its own times: leave this one out of --map"));
        }
        columns.push(Column { values: held(&series, &base, SAME_PASS * interval_s), name: series.name });
    }
    Ok((columns, ignored))
}

fn held(series: &Series, base: &[f64], tolerance_s: f64) -> Vec<f64> {
    let mut next = 0;
    base.iter()
        .map(|t_s| {
            while next < series.time_s.len() && series.time_s[next] <= t_s + tolerance_s {
                next += 1;
            }
            if next == 0 { f64::NAN } else { series.values[next - 1] }
        })
        .collect()
}

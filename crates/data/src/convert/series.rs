//! Series with times of their own, brought to common times.

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

/// A value logged later than a sample by less than this share of the interval belongs to the sample: programs log the
/// quantities of one pass one after the other.
const SAME_PASS: f64 = 0.25;

/// Columns at the times of the series that has most samples, counted from the first. Every other series holds its last
/// value, as logs that are written on change mean it; before its first it is missing. Series that are no channel are not
/// looked at; their names come back.
pub fn joined(series: Vec<Series>, names: &Names) -> Result<(Vec<Column>, Vec<String>), Fault> {
    let (used, unused): (Vec<_>, Vec<_>) = series.into_iter().partition(|series| names.channel(&series.name).is_some());
    let ignored = unused.into_iter().map(|series| series.name).collect();
    let Some(densest) = used.iter().max_by_key(|series| series.time_s.len()) else { return Ok((Vec::new(), ignored)) };
    let base = densest.time_s.clone();
    let start_s = base.first().copied().unwrap_or(0.0);
    let interval_s = median(base.windows(2).map(|pair| pair[1] - pair[0]));
    let mut columns = vec![Column {
        name: Channel::Time.column().into(),
        // Whole nanoseconds: the difference of large times has no more digits.
        values: base.iter().map(|t_s| ((t_s - start_s) * 1e9).round() * 1e-9).collect(),
    }];
    for series in used {
        if names.channel(&series.name).is_some_and(|(channel, _)| channel == Channel::Time) {
            return Err(Fault::at(&series.name, "times come with the log itself: leave this one out of --map"));
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

//! What a file holds before any name has a meaning: for a person who says which column is what.

use crate::content::{Column, Series};
use crate::convert::{self, ConvertError, Format};
use crate::suggestions;
use serde::Serialize;

/// Values of each column that are shown.
const SHOWN: usize = 400;

/// A file's columns.
#[derive(Clone, Debug, Serialize)]
pub struct Preview {
    /// The format it was read in.
    pub format: &'static str,
    /// The columns, or the series of a log.
    pub columns: Vec<PreviewColumn>,
    /// What a person should know of how it was read.
    pub notes: Vec<String>,
}

/// One column.
#[derive(Clone, Debug, Serialize)]
pub struct PreviewColumn {
    /// Name in the file.
    pub name: String,
    /// Unit that the file states; empty without one.
    pub unit: String,
    /// Number of values.
    pub count: usize,
    /// Some of the values, evenly over the whole; `None`: missing.
    pub values: Vec<Option<f64>>,
    /// What it likely is: the right side of a mapping, `duty/255`; empty if nothing speaks for any.
    pub likely: String,
}

/// Reads a file without a mapping.
///
/// # Errors
/// [`ConvertError`] with the place.
pub fn preview(name: &str, bytes: &[u8], format: Format) -> Result<Preview, ConvertError> {
    let content = convert::named_content(name, bytes, format)?;
    let of_series = |series: &Series| (series.glance(SHOWN), series.values.len());
    let of_column = |column: &Column| (column.clone(), column.values.len());
    let numbers = content.columns.iter().filter(|column| !column.is_text());
    let all: Vec<(Column, usize)> = content.series.iter().map(of_series).chain(numbers.map(of_column)).collect();
    let likely = suggestions::likely_channels(all.iter().map(|(column, _)| column));
    let columns = all.iter().zip(likely).map(|((column, count), likely)| shown(column, *count, likely)).collect();
    Ok(Preview { format: format.name(), columns, notes: content.notes })
}

/// A column or what is known of a series, which has `count` values.
fn shown(column: &Column, count: usize, likely: String) -> PreviewColumn {
    let step = column.values.len().div_ceil(SHOWN).max(1);
    let value = |value: &f64| value.is_finite().then_some(*value);
    PreviewColumn {
        name: column.name.clone(),
        unit: column.unit.clone(),
        count,
        values: column.values.iter().step_by(step).map(value).collect(),
        likely,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_come_with_what_they_likely_are() {
        let text = "millis,pwm,speed_rpm,mode\n0,0,0,1\n10,128,90,1\n20,255,,1\n";
        let shown = preview("log.csv", text.as_bytes(), Format::Csv).unwrap();
        let named: Vec<_> = shown.columns.iter().map(|column| (&*column.name, &*column.likely)).collect();
        assert_eq!(named, [("millis", "t_s/1000"), ("pwm", "duty/255"), ("speed_rpm", "rpm"), ("mode", "")]);
        assert_eq!(shown.columns[2].values, [Some(0.0), Some(90.0), None]);
        assert_eq!(shown.format, "csv");
    }

    #[test]
    fn names_of_channels_are_what_they_say() {
        let text = "t_s,u_V,omega_rad_per_s,i_A\n0,1,2,3\n1,1,2,3\n";
        let shown = preview("run.csv", text.as_bytes(), Format::Csv).unwrap();
        assert!(shown.columns.iter().all(|column| column.likely == column.name), "{shown:?}");
    }

    #[test]
    fn a_long_file_is_shown_in_part() {
        let rows: String = (0..5000).map(|row| format!("{row},1\n")).collect();
        let shown = preview("run.csv", format!("t_s,u_V\n{rows}").as_bytes(), Format::Csv).unwrap();
        assert_eq!((shown.columns[0].count, shown.columns[0].values.len()), (5000, 385));
    }
}

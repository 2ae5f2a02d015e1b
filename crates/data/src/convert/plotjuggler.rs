//! `PlotJuggler`'s CSV: a time in `__time`, and a column for each curve. A cell is empty if the curve has no point.

use super::{Column, Fault, times};
use crate::content::{Content, Series};
use crate::recording::{Channel, Recording};

const TIME: &str = "__time";

/// Makes series of a table with the time column. An empty cell is no point of its curve.
pub fn series(mut content: Content) -> Content {
    let Some(place) = content.columns.iter().position(|column| column.name == TIME) else { return content };
    let time = content.columns.remove(place);
    for column in content.columns.drain(..) {
        if column.is_text() {
            content.ignored.push(column.name);
            continue;
        }
        let mut blank = column.blank.iter().peekable();
        let is_point = |row: &usize| blank.next_if_eq(&row).is_none();
        let rows: Vec<usize> =
            (0..column.values.len()).filter(is_point).filter(|row| time.values[*row].is_finite()).collect();
        let of = |values: &[f64]| rows.iter().map(|row| values[*row]).collect();
        content.series.push(Series::new(column.name, of(&time.values), of(&column.values)));
    }
    content.lines.clear();
    content
}

/// Makes series of a table that has to have the time column.
pub fn read(content: Content) -> Result<Content, Fault> {
    if content.columns.iter().all(|column| column.name != TIME) {
        return Err(Fault::at(
            "line 1",
            format!("PlotJuggler's CSV needs a column {TIME}; for other tables use --from csv"),
        ));
    }
    Ok(series(content))
}

/// The recording for `PlotJuggler`. A missing sample is `nan`, since an empty cell would be no sample at all.
pub fn write(recording: &Recording, columns: &[Column]) -> Result<Vec<u8>, Fault> {
    let time_s = times(recording)?;
    let time_name = Channel::Time.column();
    let others: Vec<&Column> = recording
        .channels()
        .zip(columns)
        .filter(|(channel, _)| channel.column() != time_name)
        .map(|(_, c)| c)
        .collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let failed = |error: csv::Error| Fault::whole(error.to_string());
    writer
        .write_record(std::iter::once(TIME).chain(others.iter().map(|column| column.name.as_str())))
        .map_err(failed)?;
    for (row, t_s) in time_s.iter().enumerate() {
        let value = |value: f64| if value.is_nan() { "nan".into() } else { value.to_string() };
        let cells = std::iter::once(value(*t_s)).chain(others.iter().map(|column| value(column.values[row])));
        writer.write_record(cells).map_err(failed)?;
    }
    writer.into_inner().map_err(|error| Fault::whole(error.to_string()))
}

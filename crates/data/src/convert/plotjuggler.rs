//! `PlotJuggler`'s CSV: a time in `__time`, and a column for each curve. A cell is empty if the curve has no point.

use super::csv::number;
use super::series::{Series, joined};
use super::{Column, Fault, Names, times};
use crate::recording::{Channel, Recording};

const TIME: &str = "__time";

/// Whether the header has the time column.
pub fn is_one(bytes: &[u8]) -> bool {
    bytes.starts_with(TIME.as_bytes())
}

/// Columns that are channels, and the names of the others.
pub fn read(bytes: &[u8], names: &Names) -> Result<(Vec<Column>, Vec<String>), Fault> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
    let line_fault = |error: csv::Error| {
        Fault::at(format_args!("line {}", error.position().map_or(1, csv::Position::line)), error.to_string())
    };
    let header = reader.headers().map_err(line_fault)?.clone();
    let Some(time_column) = header.iter().position(|name| name == TIME) else {
        return Err(Fault::at(
            "line 1",
            format!("PlotJuggler's CSV needs a column {TIME}; for other tables use --from csv"),
        ));
    };
    let mut series: Vec<Series> =
        header.iter().map(|name| Series { name: name.into(), time_s: Vec::new(), values: Vec::new() }).collect();
    for row in reader.records() {
        let row = row.map_err(line_fault)?;
        let line = row.position().map_or(0, csv::Position::line);
        let cell = |column: usize| {
            let text = row.get(column).unwrap_or_default();
            number(text, false).map_err(|what| Fault::at(format_args!("line {line}, column {}", &header[column]), what))
        };
        let t_s = cell(time_column)?;
        for (column, series) in series.iter_mut().enumerate() {
            let wanted = column != time_column && names.channel(&series.name).is_some();
            if wanted && row.get(column).is_some_and(|text| !text.is_empty()) {
                series.time_s.push(t_s);
                series.values.push(cell(column)?);
            }
        }
    }
    series.remove(time_column);
    joined(series, names)
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

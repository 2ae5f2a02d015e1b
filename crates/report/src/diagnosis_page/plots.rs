//! The plots of a report.

use crate::web_page::{PLOT_LABELS, PLOT_LETTERS, PLOT_SIZE, axis_label, escaped};
use motorbench_diagnosis::dataset::Dataset;
use motorbench_diagnosis::diagnose::Diagnosis;
use motorbench_diagnosis::diagnose::missing::Dependence;
use motorbench_diagnosis::diagnose::outcome::Parameter;
use motorbench_diagnosis::identify::NOMINAL_SPREAD;
use motorbench_model::catalogue::ActsOn;
use motorbench_text::terminal_text::short;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::collections::BTreeMap;
use std::ops::Range;

/// Largest number of samples of a plot over time.
const MOST_POINTS: usize = 1500;
/// Colours for any colour vision (Okabe and Ito 2008): measured, model before, model after.
pub const MEASURED: RGBColor = RGBColor(0, 0, 0);
pub const BEFORE: RGBColor = RGBColor(230, 159, 0);
pub const AFTER: RGBColor = RGBColor(0, 114, 178);
const GREY: RGBColor = RGBColor(150, 150, 150);
/// Height of a line of a row's name, gap between rows, and height of the axis below them.
const LINE_HEIGHT: u32 = 18;
const BETWEEN_ROWS: u32 = 14;
const BELOW_ROWS: u32 = 64;
/// Largest number of labels on a logarithmic axis.
const MOST_TICKS: usize = 5;
/// Room for the names of rows.
const NAME_WIDTH: u32 = 230;

/// Room for the labels of a quantity that may be small.
pub const SMALL_NUMBERS_WIDTH: u32 = 84;

/// A plot of two quantities.
pub type Axes<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Draws into a string. A plot that cannot be drawn is replaced by the reason.
pub fn drawn(
    size: (u32, u32),
    draw: impl FnOnce(&DrawingArea<SVGBackend, Shift>) -> Result<(), Box<dyn std::error::Error>>,
) -> String {
    let mut svg = String::new();
    let result = {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        let result = draw(&area);
        result.and_then(|()| area.present().map_err(Into::into))
    };
    match result {
        // The page scales the picture by its view box.
        Ok(()) => svg,
        Err(error) => format!("<p>This plot could not be drawn: {}</p>", escaped(&error.to_string())),
    }
}

/// The range of the values with a margin.
pub fn range(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return 0.0..1.0;
    }
    let margin = (0.05 * (high - low)).max(1e-9 + 1e-6 * high.abs());
    low - margin..high + margin
}

/// Axes with round numbers; `name_width`: room for the labels of the vertical axis.
pub fn axes<'a, 'b>(
    area: &'a DrawingArea<SVGBackend<'b>, Shift>,
    name_width: u32,
    (horizontal, across): (Range<f64>, &str),
    (vertical, up): (Range<f64>, &str),
) -> Result<Axes<'a, 'b>, Box<dyn std::error::Error>> {
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_right(24)
        .x_label_area_size(44)
        .y_label_area_size(name_width)
        .build_cartesian_2d(horizontal, vertical)?;
    chart
        .configure_mesh()
        .x_desc(across)
        .y_desc(up)
        .x_labels(PLOT_LABELS)
        .x_label_formatter(&axis_label)
        .y_label_formatter(&axis_label)
        .label_style(PLOT_LETTERS)
        .axis_desc_style(PLOT_LETTERS)
        .light_line_style(WHITE)
        .draw()?;
    Ok(chart)
}

/// Time on a plot: several recordings are shown one after the other.
fn time_s(data: &Dataset, index: usize) -> f64 {
    index as f64 * data.interval_s
}

/// Values over time, thinned to the resolution of a plot.
fn thinned(data: &Dataset, values: &[f64]) -> impl Iterator<Item = (f64, f64)> {
    let step = (data.len() / MOST_POINTS).max(1);
    (0..data.len())
        .step_by(step)
        .filter(|index| values[*index].is_finite())
        .map(|index| (time_s(data, index), values[index]))
}

/// Measured and simulated, before and after.
pub fn over_time(diagnosis: &Diagnosis, output: usize) -> String {
    let data = &diagnosis.data;
    let measured = &data.measured[output];
    let series =
        [(&measured.values, MEASURED), (&diagnosis.base[output], BEFORE), (&diagnosis.extended[output], AFTER)];
    let vertical = range(series.iter().flat_map(|(values, _)| values.iter().copied()));
    drawn(PLOT_SIZE, |area| {
        let horizontal = 0.0..time_s(data, data.len());
        let up = (vertical.clone(), measured.output.title());
        let mut chart = axes(area, 72, (horizontal, "time, s"), up)?;
        let mut start = 0;
        while start < data.len() {
            let kept = data.held_out[start];
            let end = (start..data.len()).find(|index| data.held_out[*index] != kept).unwrap_or(data.len());
            if kept {
                let corners = [(time_s(data, start), vertical.start), (time_s(data, end), vertical.end)];
                chart.draw_series([Rectangle::new(corners, BLACK.mix(0.06).filled())])?;
            }
            start = end;
        }
        for (values, colour) in series {
            chart.draw_series(LineSeries::new(thinned(data, values), colour))?;
        }
        Ok(())
    })
}

/// A quantity over one that it may depend on; `what`: its name and unit.
pub fn curve(what: &str, dependence: &Dependence) -> String {
    let points = &dependence.curve;
    let axis = format!("{}, {}", dependence.on, dependence.unit);
    let plot = drawn(PLOT_SIZE, |area| {
        let across = (range(points.iter().map(|point| point.0)), axis.trim_end_matches(", "));
        let mut chart = axes(area, SMALL_NUMBERS_WIDTH, across, (range(points.iter().map(|point| point.1)), what))?;
        chart.draw_series(LineSeries::new(points.iter().copied(), AFTER))?;
        chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, AFTER.filled())))?;
        Ok(())
    });
    let (quantity, on, percent) = (quantity(what), dependence.on, 100.0 * dependence.share);
    format!("<div><p>{quantity} over {on}: explains {percent:.0}&nbsp;% of it</p>{plot}</div>")
}

/// A quantity over all of the data.
pub fn quantity_over_time(data: &Dataset, what: &str, values: &[f64]) -> String {
    let plot = drawn(PLOT_SIZE, |area| {
        let across = (0.0..time_s(data, data.len()), "time, s");
        let mut chart = axes(area, SMALL_NUMBERS_WIDTH, across, (range(values.iter().copied()), what))?;
        chart.draw_series(LineSeries::new(thinned(data, values), AFTER))?;
        Ok(())
    });
    format!("<p>{} over time</p>{plot}", quantity(what))
}

/// The name of an axis without its unit.
fn quantity(axis: &str) -> &str {
    axis.split_once(',').map_or(axis, |(quantity, _)| quantity)
}

/// Name and unit of the quantity that a model lacks.
pub fn missing(acts_on: ActsOn) -> &'static str {
    match acts_on {
        ActsOn::Torque => "missing torque, Nm",
        ActsOn::Voltage => "missing voltage, V",
        ActsOn::CurrentSensor => "missing current, A",
        ActsOn::AngleSensor => "missing speed, rad/s",
    }
}

/// A bar of a waterfall.
pub struct WaterfallBar {
    /// Its name, in lines.
    pub name: String,
    /// Error before; `None` for a whole error.
    pub from: Option<f64>,
    /// Error after.
    pub to: f64,
}

/// How an error falls from step to step.
pub fn waterfall(axis: &str, rungs: &[WaterfallBar]) -> String {
    let values = || rungs.iter().flat_map(|rung| rung.from.into_iter().chain([rung.to])).filter(|value| *value > 0.0);
    let Some((least, most)) = extremes(values()) else { return String::new() };
    let least = 0.7 * least;
    let rows = rungs.iter().map(|WaterfallBar { name, from, to }| {
        let colour = match from {
            None => GREY,
            Some(from) if from >= to => AFTER,
            Some(_) => BEFORE,
        };
        Row { name, shape: Shape::Bar { from: from.unwrap_or(least).max(least), to: to.max(least), colour } }
    });
    row_chart(axis, [least, 1.3 * most], None, &rows.collect::<Vec<_>>())
}

/// The motor's constants that the rig file gives.
pub fn found_over_nominal(parameters: &BTreeMap<&'static str, Parameter>) -> String {
    let rows = parameters.iter().filter_map(|(name, parameter)| {
        let nominal = parameter.nominal.filter(|nominal| *nominal > 0.0)?;
        let [low, high] = parameter.ci95;
        let [low, value, high] = [low, parameter.value, high].map(|value| value / nominal);
        (low > 0.0 && high.is_finite()).then_some(Row { name, shape: Shape::Interval { low, value, high } })
    });
    let rows: Vec<Row> = rows.collect();
    if rows.is_empty() {
        return String::new();
    }
    let worth = [(-NOMINAL_SPREAD).exp(), NOMINAL_SPREAD.exp()];
    let ends = rows.iter().flat_map(|row| row.shape.ends()).chain(worth);
    let Some((least, most)) = extremes(ends) else { return String::new() };
    row_chart("found over nominal", [0.9 * least, 1.1 * most], Some(worth), &rows)
}

fn extremes(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |found, value| {
        let (low, high) = found.unwrap_or((value, value));
        Some((value.min(low), value.max(high)))
    })
}

/// A row of a chart.
struct Row<'a> {
    name: &'a str,
    shape: Shape,
}

/// Content of a row.
enum Shape {
    Bar { from: f64, to: f64, colour: RGBColor },
    Interval { low: f64, value: f64, high: f64 },
}

impl Shape {
    fn ends(&self) -> [f64; 2] {
        match self {
            Self::Bar { from, to, .. } => [*from, *to],
            Self::Interval { low, high, .. } => [*low, *high],
        }
    }
}

/// Round numbers on a logarithmic axis.
fn ticks(least: f64, most: f64) -> Vec<f64> {
    let decades = least.log10().floor() as i32..=most.log10().ceil() as i32;
    let within = |steps: &[f64]| -> Vec<f64> {
        let all = decades.clone().flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        all.filter(|tick| (least..most).contains(tick)).collect()
    };
    let fine = within(&[1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 8.0]);
    if fine.len() <= MOST_TICKS {
        return fine;
    }
    let coarse = within(&[1.0, 3.0]);
    if coarse.len() <= MOST_TICKS { coarse } else { within(&[1.0]) }
}

/// Named rows over a logarithmic axis, with a grey band behind them.
fn row_chart(axis: &str, [least, most]: [f64; 2], band: Option<[f64; 2]>, rows: &[Row]) -> String {
    let count = rows.len() as f64;
    let most_lines = rows.iter().map(|row| row.name.lines().count()).max().unwrap_or(1);
    let row_height = LINE_HEIGHT * most_lines as u32 + BETWEEN_ROWS;
    drawn((PLOT_SIZE.0, row_height * rows.len() as u32 + BELOW_ROWS), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .margin_right(24)
            .x_label_area_size(44)
            .y_label_area_size(NAME_WIDTH)
            .build_cartesian_2d((least..most).log_scale().with_key_points(ticks(least, most)), 0.0..count)?;
        chart
            .configure_mesh()
            .x_desc(axis)
            .x_label_formatter(&|value| short(*value))
            .y_labels(0)
            .disable_y_mesh()
            .label_style(PLOT_LETTERS)
            .axis_desc_style(PLOT_LETTERS)
            .light_line_style(WHITE)
            .draw()?;
        if let Some([from, to]) = band {
            chart.draw_series([Rectangle::new([(from, 0.0), (to, count)], GREY.mix(0.25).filled())])?;
        }
        let letters = PLOT_LETTERS.into_text_style(area).pos(Pos::new(HPos::Right, VPos::Center));
        for (index, Row { name, shape }) in rows.iter().enumerate() {
            let middle = count - index as f64 - 0.5;
            let (edge, height) = chart.backend_coord(&(least, middle));
            let first = height - (LINE_HEIGHT * (name.lines().count() as u32 - 1) / 2) as i32;
            for (line, place) in name.lines().zip((first..).step_by(LINE_HEIGHT as usize)) {
                area.draw(&Text::new(line, (edge - 8, place), letters.clone()))?;
            }
            match shape {
                Shape::Bar { from, to, colour } => {
                    let corners = [(*from, middle - 0.32), (*to, middle + 0.32)];
                    chart.draw_series([Rectangle::new(corners, colour.filled())])?;
                }
                Shape::Interval { low, value, high } => {
                    chart.draw_series([PathElement::new([(*low, middle), (*high, middle)], AFTER.stroke_width(3))])?;
                    chart.draw_series([Circle::new((*value, middle), 5, AFTER.filled())])?;
                }
            }
        }
        Ok(())
    })
}

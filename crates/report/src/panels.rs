//! Plots over time or frequency, one below the other, as SVG.

use crate::plot::{LOW, MEASURED, Mark, OTHERS, Plot, REFERENCE, axis_label, capital, quantity};
use maud::{Markup, html};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use std::error::Error;
use std::ops::Range;

/// Width of a picture, height of a panel, font.
const WIDTH: u32 = 900;
const HEIGHT: u32 = 240;
const LETTERS: (&str, i32) = ("sans-serif", 16);
/// Largest number of labels on an axis.
const LABELS: usize = 8;
/// Position of titles and legends: above the plot, right of its axis.
const LEGEND_LEFT: i32 = 78;
/// Position above them.
const LEGEND_TOP: i32 = 8;
/// Largest number of samples of a line.
const MOST_POINTS: usize = 800;
/// Quantities with the same unit.
pub struct Panel {
    title: String,
    /// Which of several it is about.
    about: Option<String>,
    frequencies_hz: Option<Vec<f64>>,
    /// Below the panel before it, as its difference.
    is_difference: bool,
    /// Of a channel that a page folds away.
    is_aside: bool,
    lines: Vec<(String, Vec<f64>)>,
}

impl Panel {
    /// Over time, without lines so far. The title gives quantity and unit.
    pub fn new(title: &str) -> Self {
        Self {
            title: title.into(),
            about: None,
            frequencies_hz: None,
            is_difference: false,
            is_aside: false,
            lines: Vec::new(),
        }
    }

    /// The same over these frequencies, positive and rising, on a logarithmic axis.
    pub fn over_frequencies(title: &str, frequencies_hz: Vec<f64>) -> Self {
        Self { frequencies_hz: Some(frequencies_hz), ..Self::new(title) }
    }

    /// Of one of several, each with a panel of its own.
    #[must_use]
    pub fn about(self, name: &str) -> Self {
        Self { about: Some(name.into()), ..self }
    }

    /// The difference of what the panel before it shows: on a page it is lower, and has no heading.
    #[must_use]
    pub fn difference(self) -> Self {
        Self { is_difference: true, ..self }
    }

    /// Whether a page folds it away.
    #[must_use]
    pub fn aside(self, is_aside: bool) -> Self {
        Self { is_aside, ..self }
    }

    pub(crate) fn is_aside(&self) -> bool {
        self.is_aside
    }

    /// Adds a line: its name, its values.
    #[must_use]
    pub fn line(mut self, name: &str, values: Vec<f64>) -> Self {
        self.lines.push((name.into(), values));
        self
    }
}

/// The colour of each line by its name: what was measured, or is asked for, has the same one everywhere.
fn colours(lines: &[(String, Vec<f64>)]) -> Vec<RGBColor> {
    let mut others = OTHERS.into_iter().cycle();
    let of_name = |(name, _): &(String, Vec<f64>)| match name.as_str() {
        "reference" => REFERENCE,
        name if is_measured(name) => MEASURED,
        _ => others.next().unwrap_or(MEASURED),
    };
    lines.iter().map(of_name).collect()
}

/// The same for a page. Those over time are zoomed together.
pub fn figures(interval_s: f64, panels: &[&Panel]) -> Markup {
    let caption = |panel: &Panel| {
        // A difference begins with a name, which may be that of a file.
        let title = quantity(&panel.title);
        let title = if panel.is_difference { title.to_owned() } else { capital(title) };
        let title = panel.about.as_ref().map_or_else(|| title.clone(), |name| format!("{title}, {name}"));
        html! { @if panel.is_difference { (title) } @else { b { (title) } } }
    };
    html! { @for panel in panels { (panel.plot(interval_s).figure(&caption(panel))) } }
}

fn is_measured(name: &str) -> bool {
    name == "measured" || name.ends_with(", measured")
}

impl Panel {
    /// Rows of its longest line. Panels of one length show the same time.
    fn rows(&self) -> usize {
        self.lines.iter().map(|(_, values)| values.len()).max().unwrap_or(0)
    }

    fn plot(&self, interval_s: f64) -> Plot {
        // A low plot has no room for more than the unit.
        let unit = || self.title.rsplit_once(", ").map_or("difference", |(_, unit)| unit);
        let axis = if self.is_difference { unit() } else { &self.title };
        let plot = match &self.frequencies_hz {
            None => Plot::new("time, s", axis).in_group(format!("{} rows", self.rows())),
            Some(_) => Plot::new("frequency, Hz", axis).logarithmic(),
        };
        let plot = if self.is_difference { plot.high(LOW) } else { plot };
        let place = |index: usize| match &self.frequencies_hz {
            None => index as f64 * interval_s,
            Some(frequencies_hz) => frequencies_hz[index],
        };
        let mut lines: Vec<_> = self.lines.iter().zip(colours(&self.lines)).collect();
        // What was measured is broad and behind the others, so that it is seen where they agree with it.
        lines.sort_by_key(|((name, _), _)| !is_measured(name));
        lines.iter().fold(plot, |plot, ((name, values), colour)| {
            let points = values.iter().enumerate().map(|(index, value)| [place(index), *value]).collect();
            let mark = if is_measured(name) && lines.len() > 1 { Mark::Broad } else { Mark::Line };
            plot.with(name, *colour, mark, points)
        })
    }
}

/// Draws the panels. Those over time have a sample for each `interval_s`. A picture that cannot be drawn is replaced by
/// the reason.
pub fn panels(interval_s: f64, panels: &[Panel]) -> String {
    let mut svg = String::new();
    match draw(&mut svg, interval_s, panels) {
        Ok(()) => svg,
        Err(error) => format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\"><text y=\"20\">This plot could not be drawn: {error}</text></svg>"
        ),
    }
}

fn draw(svg: &mut String, interval_s: f64, panels: &[Panel]) -> Result<(), Box<dyn Error>> {
    let height = HEIGHT * panels.len() as u32;
    let root = SVGBackend::with_string(svg, (WIDTH, height)).into_drawing_area();
    root.fill(&WHITE)?;
    for (area, panel) in root.split_evenly((panels.len(), 1)).iter().zip(panels) {
        match panel.frequencies_hz.as_deref() {
            None => {
                let axis = 0.0..panel.rows().max(1) as f64 * interval_s;
                draw_panel(area, panel, "time, s", axis, |index| index as f64 * interval_s)?;
            }
            Some(at @ [first, .., last]) => {
                draw_panel(area, panel, "frequency, Hz", (*first..*last).log_scale(), |index| at[index])?;
            }
            Some(_) => return Err("fewer than two frequencies".into()),
        }
    }
    root.present()?;
    Ok(())
}

fn draw_panel<X: AsRangedCoord<Value = f64>>(
    area: &DrawingArea<SVGBackend, Shift>,
    panel: &Panel,
    x_title: &str,
    axis: X,
    x_of: impl Fn(usize) -> f64,
) -> Result<(), Box<dyn Error>>
where
    X::CoordDescType: ValueFormatter<f64>,
{
    let names = panel.lines.iter().map(|(name, _)| name.as_str()).zip(colours(&panel.lines));
    let below_legend = if panel.lines.len() < 2 { LEGEND_TOP } else { legend(area, names)? };
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_top(below_legend)
        .margin_right(24)
        .x_label_area_size(44)
        .y_label_area_size(70)
        .build_cartesian_2d(axis, span(&panel.lines))?;
    chart
        .configure_mesh()
        .x_desc(x_title)
        .y_desc(&panel.title)
        .x_labels(LABELS)
        .x_label_formatter(&axis_label)
        .y_labels(6)
        .y_label_formatter(&axis_label)
        .label_style(LETTERS)
        .axis_desc_style(LETTERS)
        .light_line_style(WHITE)
        .draw()?;
    for ((_, values), colour) in panel.lines.iter().zip(colours(&panel.lines)) {
        let step = values.len().div_ceil(MOST_POINTS).max(1);
        let points = values.iter().enumerate().step_by(step).filter(|(_, value)| value.is_finite());
        chart.draw_series(LineSeries::new(points.map(|(index, value)| (x_of(index), *value)), colour))?;
    }
    Ok(())
}

/// Draws the names of lines in their colours above a plot; returns where they end.
fn legend<'a>(
    area: &DrawingArea<SVGBackend, Shift>,
    names: impl Iterator<Item = (&'a str, RGBColor)>,
) -> Result<i32, Box<dyn Error>> {
    let (right, row_height) = (area.dim_in_pixel().0 as i32, LETTERS.1 + 6);
    let (mut x, mut y) = (LEGEND_LEFT, LEGEND_TOP);
    for (name, colour) in names {
        // Letters are about half as wide as high.
        let width = 42 + name.chars().count() as i32 * LETTERS.1 / 2;
        if x > LEGEND_LEFT && x + width > right {
            (x, y) = (LEGEND_LEFT, y + row_height);
        }
        area.draw(&PathElement::new([(x, y + LETTERS.1 / 3), (x + 18, y + LETTERS.1 / 3)], colour))?;
        area.draw(&Text::new(name.to_owned(), (x + 24, y), LETTERS))?;
        x += width;
    }
    Ok(y + row_height)
}

/// The range of the values with a margin.
fn span(lines: &[(String, Vec<f64>)]) -> Range<f64> {
    let finite = lines.iter().flat_map(|(_, values)| values).copied().filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    let margin = (0.05 * (high - low)).max(1e-6 + 1e-6 * high.abs());
    low - margin..high + margin
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_drawn_and_missing_samples_are_not() {
        let wave = |phase: f64| (0..3000).map(|k| (f64::from(k) * 0.01 + phase).sin()).collect::<Vec<f64>>();
        let mut gap = wave(1.0);
        gap[..1500].fill(f64::NAN);
        let svg = panels(1e-3, &[Panel::new("speed, rad/s").line("a", wave(0.0)).line("b", gap), Panel::new("i, A")]);
        assert!(svg.starts_with("<svg") && svg.contains("speed, rad/s") && svg.contains("i, A"));
        assert_eq!(svg.matches("NaN").count(), 0);
        assert!(svg.contains("#0072B2") && svg.len() < 100_000);
    }

    #[test]
    fn a_frequency_response_stands_over_decades() {
        let at: Vec<f64> = (0..=40).map(|k| 0.05 * 10f64.powf(f64::from(k) / 10.0)).collect();
        let gain = at.iter().map(|f| -10.0 * (1.0 + f * f).log10()).collect();
        let svg = panels(1e-3, &[Panel::over_frequencies("gain, dB", at).line("a", gain)]);
        let places: Vec<f64> = ["0.1", "1", "10", "100"].map(|label| x_of_label(&svg, label)).to_vec();
        let apart: Vec<f64> = places.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(apart.iter().all(|by| *by > 100.0 && (by - apart[0]).abs() < 3.0), "{places:?}");
    }

    /// Position of a label of the axis: the `x` of the text element before it.
    fn x_of_label(svg: &str, label: &str) -> f64 {
        let end = svg.find(&format!(">\n{label}\n<")).unwrap_or_else(|| panic!("no label {label} in {svg}"));
        let start = svg[..end].rfind(" x=\"").expect("a place") + 4;
        svg[start..].split('"').next().and_then(|x| x.parse().ok()).expect("a number")
    }
}

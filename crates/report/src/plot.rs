//! A plot of a page. It is drawn twice, for a screen and for a phone. Its numbers stand beside the drawing, so that a
//! browser can make it live.

use maud::{Markup, PreEscaped, html};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use serde_json::{Value, json};
use std::error::Error;
use std::ops::Range;

/// Colours for any colour vision (Okabe and Ito 2008). What was measured is black in every plot.
pub const MEASURED: RGBColor = RGBColor(0, 0, 0);
/// The model before, the reference of a loop.
pub const BEFORE: RGBColor = RGBColor(230, 159, 0);
/// The model after, the law.
pub const AFTER: RGBColor = RGBColor(0, 114, 178);
/// Others, in their order.
pub const OTHERS: [RGBColor; 5] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];
/// What is asked of a loop.
pub const REFERENCE: RGBColor = RGBColor(125, 130, 138);

/// Sizes of a drawing: width, height for a plot of the usual height, height of the letters, labels on the axis below.
struct Sizes {
    width: u32,
    share_of_height: f64,
    letters: i32,
    labels: usize,
    class: &'static str,
}

/// Free space around a drawing, and on its right, where the last label stands out.
const MARGIN: i32 = 8;
const MARGIN_RIGHT: i32 = 22;

impl Sizes {
    /// Height of the labels below the plot.
    const fn below(&self) -> i32 {
        2 * self.letters + 6
    }

    /// Width of the labels beside it.
    const fn beside(&self) -> i32 {
        11 * self.letters / 2
    }

    /// Pixels of the horizontal axis.
    fn across(&self) -> f64 {
        f64::from(self.width as i32 - self.beside() - MARGIN - MARGIN_RIGHT)
    }

    /// Height of a line of names above the plot.
    const fn row(&self) -> i32 {
        self.letters + 6
    }

    /// Pixels of the vertical axis under names that end there, in a drawing of this height.
    fn up(&self, height: u32, names_end: i32) -> f64 {
        f64::from(height as i32 - self.below() - MARGIN - names_end)
    }
}

const SCREEN: Sizes = Sizes { width: 1120, share_of_height: 1.0, letters: 20, labels: 12, class: "on-screen" };
/// Also one of two plots side by side on paper.
const PHONE: Sizes = Sizes { width: 400, share_of_height: 0.78, letters: 17, labels: 5, class: "on-phone" };
/// A plot with one scale for both axes: as wide as it is high.
const ROUND: Sizes = Sizes { width: 560, share_of_height: 1.4, letters: 20, labels: 6, class: "on-screen" };
/// Usual height of a plot, and of one with residuals.
pub const HEIGHT: u32 = 360;
/// Height of a plot of residuals.
pub const LOW: u32 = 210;
/// Largest number of points of a line in a drawing, and of those that a browser gets to zoom in.
const MOST_DRAWN: usize = 1400;
const MOST_LIVE: usize = 4000;
/// The axes of a plot that is drawn.
type Chart<'a, 'b, X> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, plotters::coord::types::RangedCoordf64>>;
/// Digits of the numbers beside the drawing.
const DIGITS: i32 = 5;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mark {
    /// A line.
    Line,
    /// A broad line that other lines are drawn over.
    Broad,
    /// Dots with their standard deviations, if they have any.
    Dots,
    /// A curve whose points are in any order: it cannot be made live.
    Curve,
    /// An upright line at one place, over the whole height.
    Upright,
}

/// A series of a plot.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Its colour.
    pub colour: RGBColor,
    /// How it is drawn.
    pub mark: Mark,
    /// Its points; a value that is not finite is a gap.
    pub points: Vec<[f64; 2]>,
    /// Standard deviations of the points; empty if there are none.
    pub deviations: Vec<f64>,
}

/// A band behind the lines.
#[derive(Clone, Copy, Debug)]
enum Band {
    Across(f64, f64),
    Up(f64, f64),
}

/// A plot.
#[derive(Clone, Debug)]
pub struct Plot {
    x_title: String,
    y_title: String,
    is_logarithmic: bool,
    height: u32,
    group: Option<String>,
    range: Option<[Range<f64>; 2]>,
    /// Half of the vertical axis, if both axes have one scale and their zero in the middle.
    round: Option<f64>,
    bands: Vec<Band>,
    series: Vec<Series>,
}

impl Plot {
    /// With names and units of its axes.
    pub fn new(x_title: &str, y_title: &str) -> Self {
        Self {
            x_title: x_title.into(),
            y_title: y_title.into(),
            is_logarithmic: false,
            height: HEIGHT,
            group: None,
            range: None,
            round: None,
            bands: Vec::new(),
            series: Vec::new(),
        }
    }

    /// With a logarithmic horizontal axis.
    #[must_use]
    pub fn logarithmic(self) -> Self {
        Self { is_logarithmic: true, ..self }
    }

    /// With another height.
    #[must_use]
    pub fn high(self, height: u32) -> Self {
        Self { height, ..self }
    }

    /// Plots of a group are zoomed together.
    #[must_use]
    pub fn in_group(self, group: impl Into<String>) -> Self {
        Self { group: Some(group.into()), ..self }
    }

    /// With one scale for both axes, so that a circle is round; the vertical one ends at plus and minus `half`.
    #[must_use]
    pub fn round(self, half: f64) -> Self {
        Self { round: Some(half), ..self }
    }

    /// With a grey band over a part of the horizontal axis.
    #[must_use]
    pub fn band(mut self, from: f64, to: f64) -> Self {
        self.bands.push(Band::Across(from, to));
        self
    }

    /// With a grey band over a part of the vertical axis.
    #[must_use]
    pub fn level_band(mut self, from: f64, to: f64) -> Self {
        self.bands.push(Band::Up(from, to));
        self
    }

    /// Adds a line.
    #[must_use]
    pub fn line(self, name: &str, colour: RGBColor, points: Vec<[f64; 2]>) -> Self {
        self.with(name, colour, Mark::Line, points)
    }

    /// Adds a series.
    #[must_use]
    pub fn with(mut self, name: &str, colour: RGBColor, mark: Mark, points: Vec<[f64; 2]>) -> Self {
        self.series.push(Series { name: name.into(), colour, mark, points, deviations: Vec::new() });
        self
    }

    /// Adds dots with standard deviations.
    #[must_use]
    pub fn dots(mut self, name: &str, colour: RGBColor, points: Vec<[f64; 2]>, deviations: Vec<f64>) -> Self {
        self.series.push(Series { name: name.into(), colour, mark: Mark::Dots, points, deviations });
        self
    }

    /// The plot with its caption.
    pub fn figure(&self, caption: &Markup) -> Markup {
        let is_live = self.round.is_none() && self.series.iter().all(|series| series.mark != Mark::Curve);
        html! {
            figure.plot {
                figcaption { (caption) }
                (self.drawn(if self.round.is_some() { &ROUND } else { &SCREEN })) (self.drawn(&PHONE))
                @if is_live {
                    div.live {}
                    script type="application/json" { (PreEscaped(self.numbers().to_string().replace('<', "\\u003c"))) }
                }
            }
        }
    }

    fn drawn(&self, sizes: &Sizes) -> Markup {
        let height = ((f64::from(self.height) * sizes.share_of_height) as u32).max(LOW);
        match self.round {
            Some(half) => {
                let height = if sizes.class == PHONE.class { PHONE.width } else { height };
                let (_, names_end) = self.places_of_names(sizes);
                let wide = half * sizes.across() / sizes.up(height, names_end);
                let range = Some([-wide..wide, -half..half]);
                Self { range, ..self.clone() }.drawn_with(sizes, height)
            }
            None => self.drawn_with(sizes, height),
        }
    }

    fn drawn_with(&self, sizes: &Sizes, height: u32) -> Markup {
        let mut svg = String::new();
        let result = {
            let area = SVGBackend::with_string(&mut svg, (sizes.width, height)).into_drawing_area();
            let drawn = if self.is_logarithmic {
                let x = self.x_range();
                self.draw(&area, sizes, x.log_scale())
            } else {
                self.draw(&area, sizes, self.x_range())
            };
            drawn.and_then(|()| area.present().map_err(Into::into))
        };
        match result {
            Ok(()) => {
                let named = format!("<svg class=\"{}\" role=\"img\" ", sizes.class);
                PreEscaped(svg.replacen("<svg ", &named, 1))
            }
            Err(error) => html! { p { "This plot could not be drawn: " (error) } },
        }
    }

    fn x_range(&self) -> Range<f64> {
        if let Some([x, _]) = &self.range {
            return x.clone();
        }
        let all = self.series.iter().flat_map(|series| series.points.iter().map(|point| point[0]));
        let (low, high) = ends(all).unwrap_or((0.0, 1.0));
        let high = if high > low { high } else { low + 1.0 };
        let has_dots = self.series.iter().any(|series| series.mark == Mark::Dots);
        let margin = if has_dots && !self.is_logarithmic { 0.02 * (high - low) } else { 0.0 };
        low - margin..high + margin
    }

    fn y_range(&self) -> Range<f64> {
        if let Some([_, y]) = &self.range {
            return y.clone();
        }
        let values = self.series.iter().flat_map(|series| series.points.iter().map(|point| point[1]));
        let (low, high) = ends(values).unwrap_or((0.0, 1.0));
        let margin = (0.07 * (high - low)).max(1e-9 + 1e-6 * high.abs());
        low - margin..high + margin
    }

    fn draw<X: AsRangedCoord<Value = f64>>(
        &self,
        area: &DrawingArea<SVGBackend, Shift>,
        sizes: &Sizes,
        x: X,
    ) -> Result<(), Box<dyn Error>>
    where
        X::CoordDescType: ValueFormatter<f64>,
    {
        let letters = ("sans-serif", sizes.letters);
        let top = if self.series.len() < 2 { 8 } else { self.legend(area, sizes)? };
        let (x_ends, y) = (self.x_range(), self.y_range());
        let mut chart = ChartBuilder::on(area)
            .margin(MARGIN)
            .margin_top(top)
            .margin_right(MARGIN_RIGHT)
            .x_label_area_size(sizes.below())
            .y_label_area_size(sizes.beside())
            .build_cartesian_2d(x, y.clone())?;
        chart
            .configure_mesh()
            .x_desc(&self.x_title)
            .y_desc(&self.y_title)
            .x_labels(sizes.labels)
            .y_labels((self.height / 60) as usize)
            .x_label_formatter(&axis_label)
            .y_label_formatter(&axis_label)
            .label_style(letters)
            .axis_desc_style(letters)
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(236, 238, 241))
            .axis_style(RGBColor(150, 155, 162))
            .draw()?;
        for band in &self.bands {
            let corners = match band {
                Band::Across(from, to) => [(*from, y.start), (*to, y.end)],
                Band::Up(from, to) => [(x_ends.start, from.max(y.start)), (x_ends.end, to.min(y.end))],
            };
            chart.draw_series([Rectangle::new(corners, BLACK.mix(0.06).filled())])?;
        }
        self.series.iter().try_for_each(|series| series.draw(&mut chart, &y))
    }

    /// Names in their colours above the plot; returns where they end.
    fn legend(&self, area: &DrawingArea<SVGBackend, Shift>, sizes: &Sizes) -> Result<i32, Box<dyn Error>> {
        let (places, end) = self.places_of_names(sizes);
        for (series, (x, y)) in self.series.iter().zip(places) {
            let middle = y + sizes.letters / 2;
            if series.mark == Mark::Dots {
                area.draw(&Circle::new((x + 11, middle), 4, series.colour.filled()))?;
            } else {
                let width = if series.mark == Mark::Broad { 4 } else { 2 };
                area.draw(&PathElement::new([(x, middle), (x + 22, middle)], series.colour.stroke_width(width)))?;
            }
            area.draw(&Text::new(series.name.clone(), (x + 28, y + 2), ("sans-serif", sizes.letters)))?;
        }
        Ok(end)
    }

    /// Where the names of the lines stand, and where they end.
    fn places_of_names(&self, sizes: &Sizes) -> (Vec<(i32, i32)>, i32) {
        let left = sizes.beside() + MARGIN;
        let (mut x, mut y) = (left, 2);
        let places = self.series.iter().map(|series| {
            // Letters are about half as wide as high.
            let width = 44 + series.name.chars().count() as i32 * sizes.letters / 2;
            if x > left && x + width > sizes.width as i32 {
                (x, y) = (left, y + sizes.row());
            }
            let place = (x, y);
            x += width;
            place
        });
        let places = places.collect();
        (places, y + sizes.row() + 2)
    }

    /// What a browser needs to draw it.
    fn numbers(&self) -> Value {
        let mut before: Option<Vec<f64>> = None;
        let series = self.series.iter().map(|series| {
            let points = series.thinned(MOST_LIVE);
            let [x, y] = [0, 1].map(|axis| points.iter().map(|point| rounded(point[axis])).collect::<Vec<f64>>());
            let is_same = before.as_ref() == Some(&x);
            let mut numbers = json!({
                "name": series.name,
                "colour": format!("rgb({},{},{})", series.colour.0, series.colour.1, series.colour.2),
                "width": if series.mark == Mark::Broad { 3.5 } else { 1.6 },
                "points": series.mark == Mark::Dots,
                "joined": self.series.iter().any(|series| series.mark == Mark::Dots),
                "y": y.iter().map(|value| value.is_finite().then_some(*value)).collect::<Vec<_>>(),
            });
            if !series.deviations.is_empty() {
                numbers["deviations"] = json!(series.deviations.iter().copied().map(rounded).collect::<Vec<_>>());
            }
            if series.mark == Mark::Upright {
                numbers["upright"] = json!(x.first());
            } else if !is_same {
                numbers["x"] = json!(x);
                before = Some(x);
            }
            numbers
        });
        let bands = self.bands.iter().map(|band| match band {
            Band::Across(from, to) => json!({ "from": from, "to": to, "across": true }),
            Band::Up(from, to) => json!({ "from": from, "to": to, "across": false }),
        });
        json!({
            "x_title": self.x_title, "y_title": self.y_title, "log": self.is_logarithmic, "height": self.height,
            "group": self.group, "series": series.collect::<Vec<_>>(), "bands": bands.collect::<Vec<_>>(),
        })
    }
}

impl Series {
    /// Draws it; `y`: the vertical axis, which cuts its deviations.
    fn draw<X: Ranged<ValueType = f64>>(
        &self,
        chart: &mut Chart<'_, '_, X>,
        y: &Range<f64>,
    ) -> Result<(), Box<dyn Error>> {
        let colour = self.colour;
        if self.mark == Mark::Dots {
            for (point, deviation) in self.points.iter().zip(&self.deviations) {
                let [low, high] = [-2.0, 2.0].map(|by| (point[0], (point[1] + by * deviation).clamp(y.start, y.end)));
                chart.draw_series([PathElement::new([low, high], colour.mix(0.35).stroke_width(2))])?;
            }
            let radius = if self.points.len() > 120 { 2 } else { 4 };
            let dots = self.points.iter().filter(|point| point[1].is_finite());
            chart.draw_series(dots.map(|point| Circle::new((point[0], point[1]), radius, colour.filled())))?;
            return Ok(());
        }
        let width = if self.mark == Mark::Broad { 4 } else { 2 };
        for part in self.thinned(MOST_DRAWN).split(|point| !point[1].is_finite()) {
            let points = part.iter().map(|point| (point[0], point[1]));
            chart.draw_series(LineSeries::new(points, colour.stroke_width(width)))?;
        }
        Ok(())
    }

    /// Few enough points for a plot, with the extremes between them. Lines of one length keep the same rows.
    fn thinned(&self, most: usize) -> Vec<[f64; 2]> {
        let step = self.points.len().div_ceil(most).max(1);
        self.points.iter().copied().step_by(step).collect()
    }
}

/// A number with the digits that a plot shows.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let scale = 10f64.powi(DIGITS - 1 - value.abs().log10().floor() as i32);
    if scale.is_finite() { (value * scale).round() / scale } else { value }
}

fn ends(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|value| value.is_finite()).fold(None, |found, value| {
        let (low, high) = found.unwrap_or((value, value));
        Some((value.min(low), value.max(high)))
    })
}

/// The name of an axis without its unit.
pub fn quantity(axis: &str) -> &str {
    axis.split_once(',').map_or(axis, |(quantity, _)| quantity)
}

/// With a capital letter.
pub fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Label of an axis, as short as the number. Its value is a sum of steps, so a value near zero means zero.
pub fn axis_label(value: &f64) -> String {
    const NEARLY_ZERO: f64 = 1e-9;
    if value.abs() < NEARLY_ZERO {
        return "0".into();
    }
    let rounded = format!("{value:.5e}");
    rounded.parse::<f64>().map_or(rounded, |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_is_as_short_as_its_number() {
        let labels = [-1e-17, 0.1 + 0.2, -100.0, 2.5e-5, 3000.0].map(|value| axis_label(&value));
        assert_eq!(labels, ["0", "0.3", "-100", "0.000025", "3000"]);
    }

    #[test]
    fn a_plot_is_drawn_for_two_widths_and_has_its_numbers_beside_it() {
        let wave = |phase: f64| (0..9000).map(|row| [f64::from(row), (f64::from(row) * 1e-3 + phase).sin()]).collect();
        let mut gap: Vec<[f64; 2]> = wave(1.0);
        gap[100][1] = f64::NAN;
        let plot = Plot::new("time, s", "speed, </script>").line("a", MEASURED, wave(0.0)).line("b", AFTER, gap);
        let html = plot.figure(&html! { "a caption" }).into_string();
        assert_eq!(html.matches("<svg ").count(), 2);
        assert_eq!(html.matches("</script>").count(), 1);
        let numbers: Value = plot.numbers();
        assert!(numbers["series"][0]["x"].as_array().is_some_and(|x| x.len() > 2000 && x.len() <= MOST_LIVE));
        assert!(numbers["series"][1]["x"].is_null(), "both lines have the same times");
        assert!(html.len() < 400_000 && !html.contains("NaN"));
    }

    #[test]
    fn a_curve_in_any_order_stays_a_drawing() {
        let circle = (0..50).map(|step| (f64::from(step) / 8.0).sin_cos()).map(|(x, y)| [x, y]).collect();
        let plot = Plot::new("real", "imaginary").with("circle", BLACK, Mark::Curve, circle);
        assert!(!plot.figure(&html! {}).into_string().contains("<script"));
    }
}

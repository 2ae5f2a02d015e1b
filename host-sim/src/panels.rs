//! Plots over time, one under the other, as SVG.

use plotters::prelude::*;
use std::error::Error;
use std::ops::Range;

/// Width of the picture, and height of a panel.
const WIDTH: u32 = 900;
const HEIGHT: u32 = 240;
/// Samples that a line shows at most.
const MOST_POINTS: usize = 800;
/// Colours that people with any colour vision tell apart (Okabe and Ito 2008).
const COLOURS: [RGBColor; 4] = [RGBColor(0, 0, 0), RGBColor(0, 114, 178), RGBColor(230, 159, 0), RGBColor(0, 158, 115)];
const LABELS: (&str, i32) = ("sans-serif", 16);

/// Quantities of one unit.
pub struct Panel {
    title: String,
    lines: Vec<(String, Vec<f64>)>,
}

impl Panel {
    /// Without lines yet; the title says quantity and unit.
    pub fn new(title: &str) -> Self {
        Self { title: title.into(), lines: Vec::new() }
    }

    /// With one line more: its name, its values.
    #[must_use]
    pub fn line(mut self, name: &str, values: Vec<f64>) -> Self {
        self.lines.push((name.into(), values));
        self
    }
}

/// The panels over a common time, with a sample each `interval_s`. A picture that cannot be drawn says why.
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
        let longest = panel.lines.iter().map(|(_, values)| values.len()).max().unwrap_or(0);
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(36)
            .y_label_area_size(70)
            .build_cartesian_2d(0.0..longest.max(1) as f64 * interval_s, span(&panel.lines))?;
        chart
            .configure_mesh()
            .x_desc("time, s")
            .y_desc(&panel.title)
            .y_labels(6)
            .label_style(LABELS)
            .axis_desc_style(LABELS)
            .light_line_style(WHITE)
            .draw()?;
        let step = longest.div_ceil(MOST_POINTS).max(1);
        for ((name, values), colour) in panel.lines.iter().zip(COLOURS) {
            let points = values.iter().enumerate().step_by(step).filter(|(_, value)| value.is_finite());
            chart
                .draw_series(LineSeries::new(points.map(|(index, value)| (index as f64 * interval_s, *value)), colour))?
                .label(name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour));
        }
        if panel.lines.len() > 1 {
            let labels = &mut chart.configure_series_labels();
            labels.border_style(BLACK).background_style(WHITE).label_font(LABELS).draw()?;
        }
    }
    root.present()?;
    Ok(())
}

/// From the smallest to the largest value, and a little more.
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
}

//! The result as one self-contained HTML file: measured and simulated before and after, what is missing, the gains, the
//! intervals. Readable on a phone, printable, no external request.

use super::missing::{Dependence, dependences};
use super::outcome::Outcome;
use super::page::{estimate, how_much_worse, title, verdict};
use super::{Diagnosis, acts_on_words};
use crate::catalogue::{ActsOn, effect};
use crate::terminal_text::short;
use crate::web_page::{PLOT_LETTERS, PLOT_SIZE, document, escaped, list, table};
use plotters::prelude::*;
use std::fmt::Write as _;

/// Samples that a plot over time shows at most.
const MOST_POINTS: usize = 1500;
/// Colours that people with any colour vision tell apart (Okabe and Ito 2008).
const MEASURED: RGBColor = RGBColor(0, 0, 0);
const BEFORE: RGBColor = RGBColor(230, 159, 0);
const AFTER: RGBColor = RGBColor(0, 114, 178);

/// The file's text.
pub fn report(diagnosis: &Diagnosis, names: &[String]) -> String {
    report_with(diagnosis, names, "")
}

/// The same with a section of HTML at its end.
pub fn report_with(diagnosis: &Diagnosis, names: &[String], section: &str) -> String {
    let outcome = &diagnosis.outcome;
    let mut html = format!("<h1>{}</h1>\n<p>{}</p>\n", escaped(&verdict(outcome)), escaped(&names.join(", ")));
    causes(&mut html, outcome);
    html.push_str("<h2>Measured and simulated</h2><p>Black: measured. Orange: the linear motor. Blue: the extended model. Grey bands: data that no fit has seen.</p>");
    for output in 0..diagnosis.data.measured.len() {
        html.push_str(&over_time(diagnosis, output));
    }
    gains(&mut html, diagnosis);
    html.push_str("<h2>What the linear motor lacks</h2><p>With the constants found beside the effects: the torque and the voltage that would make it agree.</p>");
    for lack in &diagnosis.lacks {
        for dependence in
            dependences(&diagnosis.data, &lack.values).iter().filter(|dependence| dependence.on != "direction").take(3)
        {
            html.push_str(&curve(lack.acts_on, dependence));
        }
    }
    intervals(&mut html, outcome);
    html += "<h2>What to do</h2>";
    html += &list(outcome.advice.iter().map(String::as_str));
    html += section;
    document("motorbench diagnosis", &html)
}

fn causes(html: &mut String, outcome: &Outcome) {
    for cause in &outcome.causes {
        let _ =
            write!(html, "<h2>{} <small><code>{}</code></small></h2><p>", escaped(&title(&cause.effect)), cause.effect);
        if let Some(effect) = effect(&cause.effect) {
            let about = effect.about();
            let _ = write!(html, "{}. <em>In data:</em> {}. ", escaped(about.law), escaped(about.looks_like));
        }
        let _ = write!(html, "Confidence {:.0} %.", 100.0 * cause.confidence);
        if let Some(runner_up) = &cause.runner_up {
            let worse = how_much_worse(runner_up);
            let _ = write!(html, " Next best in its place: <code>{}</code>, {worse}.", runner_up.effect);
        }
        if !cause.not_separable_from.is_empty() {
            let _ = write!(
                html,
                " <strong>This data cannot tell it from {}.</strong>",
                cause.not_separable_from.join(", ")
            );
        }
        *html += "</p>";
        *html += &table(&[], cause.parameters.iter().map(|(name, value)| [name.to_string(), estimate(value)]));
    }
    if let Some(unexplained) = &outcome.unexplained {
        let _ = write!(
            html,
            "<h2>Without a name</h2><p>{:.0} % of the error that is left is not the sensors' noise. It acts on {} and depends on {}.</p>",
            100.0 * unexplained.share,
            acts_on_words(unexplained.acts_on),
            unexplained.depends_on
        );
    }
}

/// Draws into a string; a plot that cannot be drawn says why in its place.
fn drawn(
    draw: impl FnOnce(&DrawingArea<SVGBackend, plotters::coord::Shift>) -> Result<(), Box<dyn std::error::Error>>,
) -> String {
    let mut svg = String::new();
    let result = {
        let area = SVGBackend::with_string(&mut svg, PLOT_SIZE).into_drawing_area();
        let result = draw(&area);
        result.and_then(|()| area.present().map_err(Into::into))
    };
    match result {
        // The page scales the picture by its view box.
        Ok(()) => svg,
        Err(error) => format!("<p>This plot could not be drawn: {}</p>", escaped(&error.to_string())),
    }
}

fn range(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return 0.0..1.0;
    }
    let margin = (0.05 * (high - low)).max(1e-9 + 1e-6 * high.abs());
    low - margin..high + margin
}

fn over_time(diagnosis: &Diagnosis, output: usize) -> String {
    let data = &diagnosis.data;
    let measured = &data.measured[output];
    let step = (data.len() / MOST_POINTS).max(1);
    // Several recordings stand one after the other.
    let time = |index: usize| index as f64 * data.interval_s;
    let series =
        [(&measured.values, MEASURED), (&diagnosis.base[output], BEFORE), (&diagnosis.extended[output], AFTER)];
    let vertical = range(series.iter().flat_map(|(values, _)| values.iter().copied()));
    drawn(|area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(72)
            .build_cartesian_2d(0.0..time(data.len()), vertical.clone())?;
        chart
            .configure_mesh()
            .x_desc("time, s")
            .y_desc(measured.output.channel())
            .label_style(PLOT_LETTERS)
            .axis_desc_style(PLOT_LETTERS)
            .light_line_style(WHITE)
            .draw()?;
        let mut start = 0;
        while start < data.len() {
            let kept = data.kept_back[start];
            let end = (start..data.len()).find(|index| data.kept_back[*index] != kept).unwrap_or(data.len());
            if kept {
                let corners = [(time(start), vertical.start), (time(end), vertical.end)];
                chart.draw_series([Rectangle::new(corners, BLACK.mix(0.06).filled())])?;
            }
            start = end;
        }
        for (values, colour) in series {
            let points = (0..data.len()).step_by(step).filter(|index| values[*index].is_finite());
            chart.draw_series(LineSeries::new(points.map(|index| (time(index), values[index])), colour))?;
        }
        Ok(())
    })
}

fn curve(acts_on: ActsOn, dependence: &Dependence) -> String {
    let what = match acts_on {
        ActsOn::Torque => "missing torque, Nm",
        ActsOn::Voltage => "missing voltage, V",
        ActsOn::CurrentSensor => "missing current, A",
        ActsOn::AngleSensor => "missing speed, rad/s",
    };
    let points = &dependence.curve;
    let axis = format!("{}, {}", dependence.on, dependence.unit);
    let plot = drawn(|area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(84)
            .build_cartesian_2d(range(points.iter().map(|point| point.0)), range(points.iter().map(|point| point.1)))?;
        chart
            .configure_mesh()
            .x_desc(axis.trim_end_matches(", "))
            .y_desc(what)
            .label_style(PLOT_LETTERS)
            .axis_desc_style(PLOT_LETTERS)
            .light_line_style(WHITE)
            .draw()?;
        chart.draw_series(LineSeries::new(points.iter().copied(), AFTER))?;
        chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, AFTER.filled())))?;
        Ok(())
    });
    format!("<p>{what} over {}: explains {:.0} % of it</p>{plot}", dependence.on, 100.0 * dependence.share)
}

fn gains(html: &mut String, diagnosis: &Diagnosis) {
    let measured = &diagnosis.data.measured;
    let errors = measured.iter().map(|m| format!("rms error of {}, {}", m.output.channel(), m.output.unit()));
    let header: Vec<String> = ["model".into()].into_iter().chain(errors).collect();
    let row = |name: &str, values: &mut dyn Iterator<Item = f64>| -> Vec<String> {
        [name.into()].into_iter().chain(values.map(short)).collect()
    };
    let of = |name: &str, which: &str| {
        row(name, &mut measured.iter().map(|m| diagnosis.outcome.fit[which][m.output.channel()].rmse))
    };
    let mut rows = vec![of("linear motor", "base")];
    for step in &diagnosis.steps {
        let name = format!("with <code>{}</code>", step.id);
        rows.push(row(&name, &mut step.gain.rmse.iter().map(|(_, after)| *after)));
    }
    rows.extend([of("in the end", "extended"), of("noise of the sensors", "noise_floor")]);
    *html += "<h2>What each step gained</h2>";
    *html += &table(&header.iter().map(String::as_str).collect::<Vec<_>>(), rows);
}

fn intervals(html: &mut String, outcome: &Outcome) {
    let rows = outcome.parameters.iter().map(|(name, parameter)| {
        let [low, high] = parameter.ci95;
        [
            format!("<code>{name}</code>"),
            parameter.nominal.map_or("-".into(), short),
            short(parameter.value),
            format!("{} to {}", short(low), short(high)),
        ]
    });
    *html += "<h2>The motor</h2>";
    *html += &table(&["", "nominal", "found", "95 % interval"], rows);
}

//! The result as one self-contained HTML file: measured and simulated before and after, what is missing, the gains, the
//! intervals. Readable on a phone, printable, no external request.

use super::missing::{Dependence, dependences};
use super::outcome::Outcome;
use super::page::{estimate, short, title, verdict};
use super::{Diagnosis, acts_on_words};
use crate::catalogue::{ActsOn, effect};
use plotters::prelude::*;
use std::fmt::Write as _;

/// Size of a plot in its own units; the page scales it.
const SIZE: (u32, u32) = (760, 320);
/// Letters that a phone still shows.
const LABELS: (&str, i32) = ("sans-serif", 19);
/// Samples that a plot over time shows at most.
const MOST_POINTS: usize = 1500;
/// Colours that people with any colour vision tell apart (Okabe and Ito 2008).
const MEASURED: RGBColor = RGBColor(0, 0, 0);
const BEFORE: RGBColor = RGBColor(230, 159, 0);
const AFTER: RGBColor = RGBColor(0, 114, 178);

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:820px;margin:0 auto;padding:1rem;color:#111}\
h1{font-size:1.4rem}h2{font-size:1.15rem;margin-top:2rem}svg{max-width:100%;height:auto;display:block}\
table{border-collapse:collapse;width:100%;font-size:.9rem}td,th{border-bottom:1px solid #ccc;padding:.25rem .4rem;text-align:left}\
.wide{overflow-x:auto}code{font-size:.9em}@media print{h2{break-after:avoid}svg,table{break-inside:avoid}}";

/// The file's text.
pub fn report(diagnosis: &Diagnosis, names: &[String]) -> String {
    report_with(diagnosis, names, "")
}

/// The same with a section of HTML at its end.
pub fn report_with(diagnosis: &Diagnosis, names: &[String], section: &str) -> String {
    let outcome = &diagnosis.outcome;
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>motorbench diagnosis</title><link rel=\"icon\" href=\"data:,\"><style>{STYLE}</style></head><body>\n<h1>{}</h1>\n<p>{}</p>\n",
        escaped(&verdict(outcome)),
        escaped(&names.join(", "))
    );
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
    html.push_str("<h2>What to do</h2><ul>");
    for advice in &outcome.advice {
        let _ = write!(html, "<li>{}</li>", escaped(advice));
    }
    let _ = writeln!(html, "</ul>{section}</body></html>");
    html
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
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
            let worse = short(runner_up.worse_by_sigmas);
            let _ = write!(
                html,
                " Next best in its place: <code>{}</code>, {worse} standard errors worse.",
                runner_up.effect
            );
        }
        if !cause.not_separable_from.is_empty() {
            let _ = write!(
                html,
                " <strong>This data cannot tell it from {}.</strong>",
                cause.not_separable_from.join(", ")
            );
        }
        html.push_str("</p><table>");
        for (name, value) in &cause.parameters {
            let _ = write!(html, "<tr><td>{name}</td><td>{}</td></tr>", estimate(value));
        }
        html.push_str("</table>");
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
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
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
            .x_label_area_size(50)
            .y_label_area_size(84)
            .build_cartesian_2d(0.0..time(data.len()), vertical.clone())?;
        chart
            .configure_mesh()
            .x_desc("time, s")
            .y_desc(measured.output.channel())
            .label_style(LABELS)
            .axis_desc_style(LABELS)
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
            .x_label_area_size(50)
            .y_label_area_size(96)
            .build_cartesian_2d(range(points.iter().map(|point| point.0)), range(points.iter().map(|point| point.1)))?;
        chart
            .configure_mesh()
            .x_desc(axis.trim_end_matches(", "))
            .y_desc(what)
            .label_style(LABELS)
            .axis_desc_style(LABELS)
            .light_line_style(WHITE)
            .draw()?;
        chart.draw_series(LineSeries::new(points.iter().copied(), AFTER))?;
        chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, AFTER.filled())))?;
        Ok(())
    });
    format!("<p>{what} over {}: explains {:.0} % of it</p>{plot}", dependence.on, 100.0 * dependence.share)
}

fn gains(html: &mut String, diagnosis: &Diagnosis) {
    html.push_str("<h2>What each step gained</h2><div class=\"wide\"><table><tr><th>model</th>");
    for measured in &diagnosis.data.measured {
        let _ = write!(html, "<th>rms error of {}, {}</th>", measured.output.channel(), measured.output.unit());
    }
    html.push_str("</tr>");
    let mut row = |name: &str, values: Vec<f64>| {
        let _ = write!(html, "<tr><td>{name}</td>");
        for value in values {
            let _ = write!(html, "<td>{}</td>", short(value));
        }
        html.push_str("</tr>");
    };
    let of = |which: &str| {
        diagnosis.data.measured.iter().map(|m| diagnosis.outcome.fit[which][m.output.channel()].rmse).collect()
    };
    row("linear motor", of("base"));
    for step in &diagnosis.steps {
        row(&format!("with <code>{}</code>", step.id), step.gain.rmse.iter().map(|(_, after)| *after).collect());
    }
    row("in the end", of("extended"));
    row("noise of the sensors", of("noise_floor"));
    html.push_str("</table></div>");
}

fn intervals(html: &mut String, outcome: &Outcome) {
    html.push_str("<h2>The motor</h2><div class=\"wide\"><table><tr><th></th><th>nominal</th><th>found</th><th>95 % interval</th></tr>");
    for (name, parameter) in &outcome.parameters {
        let nominal = parameter.nominal.map_or("-".into(), short);
        let [low, high] = parameter.ci95;
        let _ = write!(
            html,
            "<tr><td><code>{name}</code></td><td>{nominal}</td><td>{}</td><td>{} to {}</td></tr>",
            short(parameter.value),
            short(low),
            short(high)
        );
    }
    html.push_str("</table></div>");
}

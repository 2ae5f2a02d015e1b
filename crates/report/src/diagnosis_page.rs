//! The result as one self-contained HTML file. It shows measured and simulated quantities before and after, the missing
//! torque or voltage, the improvements, and the intervals. It can be read on a phone and printed, and makes no external
//! request.

use crate::diagnosis_text::{against_nominal, estimate, rival_comparison, scale_words, title, verdict};
use crate::web_page::{code, document, escaped, list, table};
use motorbench_diagnosis::dataset::Dataset;
use motorbench_diagnosis::diagnose::Diagnosis;
use motorbench_diagnosis::diagnose::determined::to_start;
use motorbench_diagnosis::diagnose::missing::dependences;
use motorbench_diagnosis::diagnose::outcome::Outcome;
use motorbench_model::catalogue::effect;
use motorbench_text::terminal_text::short;
use plots::WaterfallBar;
use std::fmt::Write as _;

pub(crate) mod plots;

/// The text of the file.
pub fn report(diagnosis: &Diagnosis, names: &[String]) -> String {
    report_with("motorbench diagnosis", diagnosis, names, "")
}

/// The same with another title, and a section of HTML at its end.
pub fn report_with(page_title: &str, diagnosis: &Diagnosis, names: &[String], section: &str) -> String {
    let outcome = &diagnosis.outcome;
    let mut html = format!("<h1>{}</h1>\n<p>{}</p>\n", escaped(&verdict(outcome)), escaped(&names.join(", ")));
    causes(&mut html, outcome);
    html.push_str("<h2>Measured and simulated</h2><p>Black: measured. Orange: the linear motor. Blue: the extended model. Grey bands: held-out data, used in no fit.</p>");
    for output in 0..diagnosis.data.measured.len() {
        html.push_str(&plots::over_time(diagnosis, output));
    }
    gains(&mut html, diagnosis);
    lacks(&mut html, diagnosis);
    residuals(&mut html, diagnosis);
    determined(&mut html, outcome, &diagnosis.data);
    intervals(&mut html, outcome);
    html += "<h2>What to do</h2>";
    html += &list(outcome.advice.iter().map(String::as_str));
    html += section;
    document(page_title, &html)
}

fn causes(html: &mut String, outcome: &Outcome) {
    for cause in &outcome.causes {
        let _ =
            write!(html, "<h2>{} <small>{}</small></h2><p>", escaped(&title(&cause.effect)), code([&*cause.effect]));
        if let Some(effect) = effect(&cause.effect) {
            let about = effect.about();
            let _ = write!(html, "{}. <em>In data:</em> {}. ", escaped(about.law), escaped(about.looks_like));
        }
        let _ = write!(html, "Confidence {:.0} %.", 100.0 * cause.confidence);
        if let Some(sentence) = against_nominal(cause, outcome) {
            let _ = write!(html, " {}.", escaped(&sentence));
        }
        if let Some(runner_up) = &cause.runner_up {
            let worse = rival_comparison(runner_up);
            let _ = write!(html, " Next best in its place: {}, {worse}.", code([runner_up.effect]));
        }
        if !cause.not_separable_from.is_empty() {
            let _ = write!(
                html,
                " <strong>This data cannot tell it from {}.</strong>",
                code(cause.not_separable_from.iter().map(|id| &**id))
            );
        }
        *html += "</p>";
        *html += &table(&[], cause.parameters.iter().map(|(name, value)| [code([&**name]), estimate(value)]));
    }
    if let Some(unexplained) = &outcome.unexplained {
        let _ = write!(
            html,
            "<h2>Unexplained</h2><p>{:.0} % of the remaining error is not noise of the sensors; {}.</p>",
            100.0 * unexplained.share,
            unexplained.place()
        );
    }
}

/// The missing torque or voltage of the linear motor, over time and over all quantities that it can depend on.
fn lacks(html: &mut String, diagnosis: &Diagnosis) {
    *html += "<h2>What the linear motor lacks</h2><p>With the constants found beside the effects: the torque or the voltage that would make it agree. Either alone would suffice. The cause acts where one plot has a clear shape and the other has none.</p>";
    for lack in &diagnosis.lacks {
        over_all_dependences(html, &diagnosis.data, plots::missing(lack.acts_on), &lack.values);
    }
}

/// The unexplained rest of each sensor. No missing torque or voltage shows a fault of a sensor.
fn residuals(html: &mut String, diagnosis: &Diagnosis) {
    if diagnosis.outcome.unexplained.is_none() {
        return;
    }
    *html += "<h2>What the extended model leaves</h2><p>Measured less simulated, with all named effects. A rest that follows the measured quantity itself, or the angle, but is not in the other sensor, is probably a fault of the sensor.</p>";
    let left = motorbench_diagnosis::diagnose::residuals(&diagnosis.data, &diagnosis.extended);
    for (measured, left) in diagnosis.data.measured.iter().zip(&left) {
        let what = format!("residual of {}", measured.output.title());
        over_all_dependences(html, &diagnosis.data, &what, left);
    }
}

/// A quantity over time, and over all quantities that it can depend on.
fn over_all_dependences(html: &mut String, data: &Dataset, what: &str, values: &[f64]) {
    *html += &plots::quantity_over_time(data, what, values);
    *html += "<div class=\"pairs\">";
    for dependence in dependences(data, values) {
        *html += &plots::curve(what, &dependence);
    }
    *html += "</div>";
}

fn gains(html: &mut String, diagnosis: &Diagnosis) {
    *html += "<h2>What each step gained</h2><p>On held-out data. Each bar goes from the error before a step to the error after it, on a logarithmic scale.</p>";
    let measured = &diagnosis.data.measured;
    for (output, measured) in measured.iter().enumerate() {
        let of = |which: &str| diagnosis.outcome.fit[which][measured.output.channel()].rmse;
        let mut before = of("base");
        let steps = diagnosis.steps.iter().map(|step| {
            let (_, after) = step.gain.rmse[output];
            WaterfallBar {
                name: format!("+ {}", step.added.join("\n+ ")),
                from: Some(std::mem::replace(&mut before, after)),
                to: after,
            }
        });
        let whole = |name: &str, to: f64| WaterfallBar { name: name.into(), from: None, to };
        let rungs: Vec<WaterfallBar> = [whole("linear motor", of("base"))]
            .into_iter()
            .chain(steps)
            .chain([whole("in the end", of("extended")), whole("noise", of("noise_floor"))])
            .collect();
        let axis = format!("rms error of {}", measured.output.title());
        *html += &plots::waterfall(&axis, &rungs);
    }
    *html += &gains_in_figures(diagnosis);
}

fn gains_in_figures(diagnosis: &Diagnosis) -> String {
    let measured = &diagnosis.data.measured;
    let errors = measured.iter().map(|m| format!("rms error of {}", m.output.title()));
    let header: Vec<String> = ["model".into()].into_iter().chain(errors).collect();
    let row = |name: &str, values: &mut dyn Iterator<Item = f64>| -> Vec<String> {
        [name.into()].into_iter().chain(values.map(short)).collect()
    };
    let of = |name: &str, which: &str| {
        row(name, &mut measured.iter().map(|m| diagnosis.outcome.fit[which][m.output.channel()].rmse))
    };
    let mut rows = vec![of("linear motor", "base")];
    for step in &diagnosis.steps {
        let name = format!("with {}", code(step.added.iter().map(|id| &**id)));
        rows.push(row(&name, &mut step.gain.rmse.iter().map(|(_, after)| *after)));
    }
    rows.extend([of("in the end", "extended"), of("noise of the sensors", "noise_floor")]);
    table(&header.iter().map(String::as_str).collect::<Vec<_>>(), rows)
}

/// What the data determine whatever the scale of torque and resistance.
fn determined(html: &mut String, outcome: &Outcome, data: &Dataset) {
    if outcome.determined.is_empty() {
        return;
    }
    *html += "<h2>What the data determine</h2>";
    if let Some(sentence) = to_start(&outcome.determined, data) {
        *html += &format!("<p>{sentence}</p>");
    }
    let rows = outcome.determined.iter().map(|(name, found)| {
        let [low, high] = found.ci95;
        [code([*name]), short(found.value), format!("{} to {}", short(low), short(high)), found.unit.into()]
    });
    *html += &table(&["", "found", "95 % interval", "unit"], rows);
}

fn intervals(html: &mut String, outcome: &Outcome) {
    let rows = outcome.parameters.iter().map(|(name, parameter)| {
        let interval = parameter.interval();
        [
            code([&**name]),
            parameter.nominal.map_or("-".into(), short),
            short(parameter.value),
            interval.map_or("not fitted".into(), |[low, high]| format!("{} to {}", short(low), short(high))),
            scale_words(parameter.scale).unwrap_or("measured").into(),
        ]
    });
    *html += "<h2>The motor</h2>";
    if outcome.parameters.values().any(|parameter| parameter.nominal.is_some()) {
        *html += "<p>Found over nominal, with 95 % intervals; grey: the tolerance of data sheets.</p>";
        *html += &plots::found_over_nominal(&outcome.parameters);
    }
    *html += &table(&["", "nominal", "found", "95 % interval", "scale"], rows);
}

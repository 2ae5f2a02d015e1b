//! The result as one self-contained HTML file. It has the verdict, the gain, and measured and simulated quantities
//! before and after. For each cause it has the plot that proves it. The motor, what to do, and the source of the data
//! follow. The rest is folded away.

use crate::diagnosis_text::{against_nominal, estimate, interval, rival_comparison, scale_words, title, verdict};
use crate::plot::quantity;
use crate::web_page::{Page, Provenance, code, list, number, table, text};
use maud::{Markup, html};
use motorbench_diagnosis::dataset::Dataset;
use motorbench_diagnosis::diagnose::Diagnosis;
use motorbench_diagnosis::diagnose::determined::to_start;
use motorbench_diagnosis::diagnose::missing::dependences;
use motorbench_diagnosis::diagnose::outcome::{Cause, Outcome, RmseGain};
use motorbench_diagnosis::evidence::evidence;
use motorbench_model::catalogue::effect;
use motorbench_text::terminal_text::short;

mod parts;

/// Sections of a page besides those of the diagnosis.
#[derive(Default)]
pub struct Besides {
    /// After the traces.
    pub early: Vec<Markup>,
    /// Folded away, with headings.
    pub folded: Vec<(String, Markup)>,
}

/// The text of the file.
pub fn report(diagnosis: &Diagnosis, provenance: Provenance) -> String {
    report_with("motorbench diagnosis", "Diagnosis", diagnosis, provenance, Besides::default())
}

/// The same with another title, and more sections.
pub fn report_with(
    page_title: &str,
    kind: &'static str,
    diagnosis: &Diagnosis,
    mut provenance: Provenance,
    besides: Besides,
) -> String {
    let outcome = &diagnosis.outcome;
    let mut sections = vec![gain(diagnosis), traces(diagnosis)];
    sections.extend(besides.early);
    sections.extend(outcome.causes.iter().map(|cause| cause_section(diagnosis, cause)));
    sections.extend(unexplained(outcome));
    sections.push(motor(outcome, &diagnosis.data));
    sections.push(html! { section { h2 { "What to do" } (list(outcome.advice.iter().map(String::as_str))) } });
    provenance.left_out.extend(left_out(&diagnosis.data));
    let mut folded = vec![
        ("What each step gained".into(), steps(diagnosis)),
        ("What the linear motor lacks".into(), lacks(diagnosis)),
    ];
    if outcome.unexplained.is_some() {
        folded.insert(0, ("What the extended model leaves".into(), residuals(diagnosis)));
    }
    folded.extend(besides.folded);
    let verdict = verdict(outcome).replace('\n', " ");
    let page = Page { title: page_title.into(), kind, verdict, sections, folded, provenance }.html();
    outcome.axis.motion.words(&page).into_owned()
}

/// Rows that no model was compared with.
fn left_out(data: &Dataset) -> Option<String> {
    let missing = |values: &[f64]| values.iter().filter(|value| !value.is_finite()).count();
    let rows = missing(&data.motion().values);
    (rows > 0).then(|| format!("The motion has no reading in {rows} of {} samples.", data.len()))
}

/// The error before and after, beside the noise.
fn gain(diagnosis: &Diagnosis) -> Markup {
    let fit = &diagnosis.outcome.fit;
    html! {
        section.gains {
            @for measured in &diagnosis.data.measured {
                @let channel = measured.output.channel();
                @let [before, after, noise] = ["base", "extended", "noise_floor"].map(|which| fit[which][channel].rmse);
                @let title = measured.output.title();
                div {
                    h2 { "Error of " (quantity(title)) ", rms on data that no fit has seen" }
                    (bar("before", "before", before, before.max(after), measured.output.unit()))
                    (bar("after", "after", after, before.max(after), measured.output.unit()))
                    (bar("noise", "noise", noise, before.max(after), measured.output.unit()))
                }
            }
        }
    }
}

fn bar(class: &str, name: &str, value: f64, greatest: f64, unit: &str) -> Markup {
    let width = (100.0 * value / greatest.max(f64::MIN_POSITIVE)).clamp(0.0, 100.0);
    html! {
        div class={ "bar " (class) } {
            span { (name) }
            i style={ "width:" (format!("{width:.1}")) "%" } {}
            span { (short(value)) " " (unit) }
        }
    }
}

fn traces(diagnosis: &Diagnosis) -> Markup {
    html! {
        section {
            h2 { "Before and after" }
            p { "The model runs freely over the whole recording. Grey: data that no fit has seen." }
            @for output in 0..diagnosis.data.measured.len() { (parts::traces(diagnosis, output)) }
        }
    }
}

/// One cause: the plot that proves it, its constants, and what it could be confused with.
fn cause_section(diagnosis: &Diagnosis, cause: &Cause) -> Markup {
    let about = effect(&cause.effect).map(|effect| effect.about());
    html! {
        section.cause {
            h2 { (title(&cause.effect)) }
            @if let Some(about) = about { p { (about.law) "." } }
            (proof(diagnosis, cause))
            (table(&["constant", "found [95 % interval]"], cause.parameters.iter().map(|(name, value)| [code([&**name]), text(estimate(value))])))
            p {
                "Confidence " (format!("{:.0}", 100.0 * cause.confidence)) " %."
                @if let Some(sentence) = against_nominal(cause, &diagnosis.outcome) { " It is " (sentence) "." }
                @if let Some(runner_up) = &cause.runner_up {
                    " Next best in its place: " (title(runner_up.effect)) ", " (rival_comparison(runner_up)) "."
                }
            }
            (confused_with(cause))
        }
    }
}

/// The plot of a cause: the lack and the law. A wrong value and a correction of the data have no law over a quantity.
fn proof(diagnosis: &Diagnosis, cause: &Cause) -> Markup {
    if let Some(evidence) = evidence(diagnosis, cause) {
        let percent = format!("{:.1}", 100.0 * evidence.explained());
        return html! {
            div.proof data-effect=(cause.effect) data-explained=(percent) {
                (parts::proof(&evidence))
                p { "The law explains " (percent) " % of what the model lacks without it." }
            }
        };
    }
    let name = cause.parameters.keys().next().map(String::as_str).unwrap_or_default();
    let value = diagnosis.outcome.parameters.get(name).and_then(parts::found_over_nominal);
    html! {
        div.proof data-effect=(cause.effect) {
            @if let Some(picture) = value {
                figure { figcaption { b { "Found over nominal" } ", with its interval; grey: the tolerance of a data sheet" } (picture) }
            } @else {
                @for (channel, RmseGain { rmse_before, rmse_after }) in &cause.gain {
                    figure {
                        figcaption { b { "Error of " (code([*channel])) } " without it and with it" }
                        (bar("before", "without", *rmse_before, rmse_before.max(*rmse_after), ""))
                        (bar("after", "with", *rmse_after, rmse_before.max(*rmse_after), ""))
                    }
                }
            }
        }
    }
}

fn confused_with(cause: &Cause) -> Markup {
    let about = effect(&cause.effect).map(|effect| effect.about());
    let names = |ids: &mut dyn Iterator<Item = &'static str>| ids.map(title).collect::<Vec<_>>().join(", ");
    html! {
        @if !cause.not_separable_from.is_empty() {
            p { strong { "This data cannot tell it from " (names(&mut cause.not_separable_from.iter().copied())) "." } }
        }
        @if let Some(about) = about {
            p.quiet {
                "Could be confused with " (names(&mut about.confused_with.iter().copied())) ". To decide: " (about.experiment) "."
            }
        }
    }
}

fn unexplained(outcome: &Outcome) -> Option<Markup> {
    let unexplained = outcome.unexplained.as_ref()?;
    Some(html! {
        section {
            h2 { "Unexplained" }
            p {
                (format!("{:.0}", 100.0 * unexplained.share)) " % of the remaining error is not noise of the sensors; "
                (unexplained.place()) "."
            }
        }
    })
}

/// Constants of the motor, and what the data determine whatever the scale of torque and resistance.
fn motor(outcome: &Outcome, data: &Dataset) -> Markup {
    let has_nominal = outcome.parameters.values().any(|parameter| parameter.nominal.is_some());
    let rows = outcome.parameters.iter().map(|(name, parameter)| {
        [
            code([&**name]),
            number(parameter.nominal.map_or("-".into(), short)),
            number(short(parameter.value)),
            interval(outcome, name).map_or_else(text, from_to),
            text(scale_words(parameter.scale).unwrap_or("measured")),
        ]
    });
    let header = ["constant", "nominal", "found", "95 % interval", "scale"];
    let pictures = outcome
        .parameters
        .iter()
        .filter_map(|(name, parameter)| parts::found_over_nominal(parameter).map(|picture| [code([&**name]), picture]));
    let determined = outcome
        .determined
        .iter()
        .map(|(name, found)| [code([*name]), number(short(found.value)), from_to(found.ci95), text(found.unit)]);
    html! {
        section {
            h2 { "The motor" }
            (table(&header, rows))
            @if has_nominal {
                (table(&["constant", "found over nominal"], pictures))
                p.quiet { "Grey: the tolerance of data sheets." }
            }
            @if !outcome.determined.is_empty() {
                h3 { "What the data determine by themselves" }
                @if let Some(sentence) = to_start(&outcome.determined, data) { p { (sentence) } }
                (table(&["", "found", "95 % interval", "unit"], determined))
            }
        }
    }
}

/// An interval, which may be broken between its ends.
fn from_to([low, high]: [f64; 2]) -> Markup {
    html! { (number(short(low))) " to " (number(short(high))) }
}

/// The missing torque or voltage of the linear motor, over time and over all quantities that it can depend on.
fn lacks(diagnosis: &Diagnosis) -> Markup {
    html! {
        p {
            "With the constants found beside the effects: the torque or the voltage that would make the linear motor agree. "
            "Either alone would suffice. All causes are in it, and over a short wave its bins are too wide."
        }
        @for lack in &diagnosis.lacks { (over_all_dependences(&diagnosis.data, parts::missing(lack.acts_on), &lack.values)) }
    }
}

/// The unexplained rest of each sensor. No missing torque or voltage shows a fault of a sensor.
fn residuals(diagnosis: &Diagnosis) -> Markup {
    let left = motorbench_diagnosis::diagnose::residuals(&diagnosis.data, &diagnosis.extended);
    html! {
        p {
            "Measured less simulated, with all named effects. A rest that follows the measured quantity itself, or the angle, "
            "but is not in the other sensor, is probably a fault of the sensor."
        }
        @for (measured, left) in diagnosis.data.measured.iter().zip(&left) {
            (over_all_dependences(&diagnosis.data, &format!("residual of {}", measured.output.title()), left))
        }
    }
}

/// A quantity over time, and over all quantities that it can depend on.
fn over_all_dependences(data: &Dataset, what: &str, values: &[f64]) -> Markup {
    html! {
        (parts::quantity_over_time(data, what, values))
        div.pairs { @for dependence in dependences(data, values) { (parts::curve(what, &dependence)) } }
    }
}

/// The errors after each step of the search.
fn steps(diagnosis: &Diagnosis) -> Markup {
    let measured = &diagnosis.data.measured;
    let errors = measured.iter().map(|m| format!("rms error of {}", m.output.title()));
    let header: Vec<String> = ["model".into()].into_iter().chain(errors).collect();
    let row = |name: Markup, values: &mut dyn Iterator<Item = f64>| -> Vec<Markup> {
        [name].into_iter().chain(values.map(|value| text(short(value)))).collect()
    };
    let of = |name: &str, which: &str| {
        row(text(name), &mut measured.iter().map(|m| diagnosis.outcome.fit[which][m.output.channel()].rmse))
    };
    let mut rows = vec![of("linear motor", "base")];
    for step in &diagnosis.steps {
        let name = html! { "with " (code(step.added.iter().map(|id| &**id))) };
        rows.push(row(name, &mut step.gain.rmse.iter().map(|(_, after)| *after)));
    }
    rows.extend([of("in the end", "extended"), of("noise of the sensors", "noise_floor")]);
    html! {
        p { "On held-out data." }
        (table(&header.iter().map(String::as_str).collect::<Vec<_>>(), rows))
    }
}

//! The result of a table, for a terminal and for a browser.

mod plots;

use crate::diagnosis_text::{estimate, verdict, without_a_name};
use crate::web_page::{Page, Provenance, code, list, table, text as cell};
use maud::{Markup, html};
use motorbench_diagnosis::diagnose::DATA_SHEET_TOLERANCE;
use motorbench_diagnosis::diagnose::outcome::{Cause, Estimate, Outcome, Verdict};
use motorbench_diagnosis::steady_state::{Explanation, Level, Study};
use motorbench_text::terminal_text::wrapped;
use std::fmt::Write as _;

const COLUMNS: [&str; 10] =
    ["u_V", "i_A", "rpm", "emf_V", "P_in_W", "P_out_W", "eff", "T_Nm", "R_dyn_ohm", "missing_V"];
/// Width of the columns in letters, and digits after the point.
const WIDTHS: [usize; 10] = [6, 6, 7, 6, 6, 7, 5, 6, 9, 9];
const DIGITS: [usize; 10] = [2, 4, 1, 2, 2, 2, 3, 4, 2, 2];
const EXPLANATIONS: &str = "Explanations of the missing voltage, error at a voltage left out";

fn values(level: &Level) -> [f64; 10] {
    [
        level.u_V,
        level.i_A,
        level.rpm,
        level.emf_V,
        level.p_in_W,
        level.p_out_W,
        level.efficiency,
        level.torque_Nm,
        level.dynamic_resistance_ohm,
        level.missing_V,
    ]
}

fn terms(explanation: &Explanation) -> String {
    if explanation.terms.is_empty() { "nominal values".into() } else { explanation.terms.join(" + ") }
}

fn constants(explanation: &Explanation) -> String {
    let constants = explanation.constants.iter().map(|(name, value)| format!("{name} = {}", estimate(value)));
    constants.collect::<Vec<_>>().join(", ")
}

fn parameters(cause: &Cause) -> String {
    let constants = cause.parameters.iter().map(|(name, value)| format!("{name} = {}", estimate(value)));
    constants.collect::<Vec<_>>().join(", ")
}

/// Constants for a page, one in each line.
fn constants_html<'a>(constants: impl Iterator<Item = (&'a str, &'a Estimate)>) -> Markup {
    html! { @for (name, value) in constants { (code([name])) " = " (estimate(value)) br; } }
}

/// Terms for a page.
fn terms_html(explanation: &Explanation) -> Markup {
    html! {
        @if explanation.terms.is_empty() { "nominal values" }
        @for (index, term) in explanation.terms.iter().enumerate() { @if index > 0 { " + " } (code([&**term])) }
    }
}

/// Measured and simulated.
fn drawings(study: &Study) -> Markup {
    html! {
        section {
            h2 { "Measured and simulated" }
            p { "The speed that voltage and current leave, and the current that friction takes. Named: " (terms_html(study.named())) "." }
            @if let Some(other) = study.as_good() { p { (terms_html(other)) " explains the table as well." } }
            (plots::speed_plot(study)) (plots::current_plot(study))
        }
    }
}

/// The causes, and apart from them the constants that are off by less than the tolerance of a data sheet: those are no
/// causes.
fn by_size(outcome: &Outcome) -> [Vec<&Cause>; 2] {
    let is_small = |cause: &&Cause| {
        let id = cause.effect.trim_start_matches("parameter:");
        let nominal = outcome.parameters.iter().find(|(name, _)| name.starts_with(id)).and_then(|(_, of)| of.nominal);
        let found = cause.parameters.values().next().map(|found| found.value);
        let off = nominal.zip(found).map(|(nominal, found)| (found / nominal).ln().abs());
        cause.is_value() && off.is_some_and(|off| off < DATA_SHEET_TOLERANCE)
    };
    let (small, large): (Vec<&Cause>, Vec<&Cause>) = outcome.causes.iter().partition(is_small);
    [large, small]
}

/// Causes and constants for a terminal. `with_rivals`: with what each cannot be told from.
pub fn cause_lines(outcome: &Outcome, with_rivals: bool) -> String {
    let headings = ["Causes".into(), within_tolerance()];
    let mut text = String::new();
    for (heading, causes) in headings.iter().zip(by_size(outcome)).filter(|(_, causes)| !causes.is_empty()) {
        let _ = writeln!(text, "\n{heading}");
        for cause in causes {
            text += &wrapped(&format!("{}: {}", cause.effect, parameters(cause)), "  ", "    ");
            if with_rivals && !cause.not_separable_from.is_empty() {
                let others = cause.not_separable_from.join(", ");
                text += &wrapped(&format!("cannot be told from: {others}"), "    ", "    ");
            }
        }
    }
    text
}

fn within_tolerance() -> String {
    format!("Constants that differ from the nominal ones by less than {:.0} %", 100.0 * DATA_SHEET_TOLERANCE)
}

/// The verdict without the names of constants that are within the tolerance.
fn sentence(outcome: &Outcome) -> String {
    let mut large = outcome.clone();
    let [causes, _] = by_size(outcome);
    large.causes = causes.into_iter().cloned().collect();
    // What is left are constants alone.
    if large.causes.is_empty() && large.verdict == Verdict::Explained {
        large.verdict = Verdict::Sufficient;
    }
    verdict(&large)
}

/// The page for the terminal, at most 80 columns.
pub fn page(study: &Study) -> String {
    let mut text = format!("{}\n\n ", sentence(&study.outcome));
    for (name, width) in COLUMNS.iter().zip(WIDTHS) {
        let _ = write!(text, " {name:>width$}");
    }
    for level in &study.levels {
        text += "\n ";
        for ((value, width), digits) in values(level).iter().zip(WIDTHS).zip(DIGITS) {
            let _ = write!(text, " {value:width$.digits$}");
        }
    }
    let _ = writeln!(text, "\n\n{EXPLANATIONS}");
    for explanation in &study.explanations {
        let _ = writeln!(text, "  {:.3} V  {}", explanation.left_out_rmse_v, terms(explanation));
        let constants = constants(explanation);
        if !constants.is_empty() {
            text += &wrapped(&constants, "           ", "           ");
        }
    }
    text += &cause_lines(&study.outcome, true);
    if let Some(unexplained) = &study.outcome.unexplained {
        text += "\n";
        text += &wrapped(&without_a_name(unexplained), "  ", "  ");
    }
    text += "\nWhat to do\n";
    for advice in &study.outcome.advice {
        text += &wrapped(advice, "  - ", "    ");
    }
    text
}

/// The page as an HTML file.
pub fn html(study: &Study, provenance: Provenance) -> String {
    page_with("motorbench diagnosis", "Diagnosis of a table", study, Vec::new(), provenance)
}

/// The same with another title, and more sections before what to do.
pub fn page_with(
    page_title: &str,
    kind: &'static str,
    study: &Study,
    besides: Vec<Markup>,
    provenance: Provenance,
) -> String {
    let mut sections = vec![drawings(study), causes(study)];
    sections.extend(besides);
    sections.push(html! { section { h2 { "What to do" } (list(study.outcome.advice.iter().map(String::as_str))) } });
    let levels = study
        .levels
        .iter()
        .map(|level| values(level).into_iter().zip(DIGITS).map(|(value, digits)| cell(format!("{value:.digits$}"))));
    let explanations = study.explanations.iter().map(|explanation| {
        let constants = constants_html(explanation.constants.iter().map(|(name, value)| (*name, value)));
        [cell(format!("{:.3} V", explanation.left_out_rmse_v)), terms_html(explanation), constants]
    });
    let folded = vec![
        ("The table".into(), table(&COLUMNS, levels)),
        (EXPLANATIONS.into(), table(&["error", "explanation", "constants"], explanations)),
    ];
    let verdict = sentence(&study.outcome).replace('\n', " ");
    Page { title: page_title.into(), kind, verdict, sections, folded, provenance }.html()
}

fn causes(study: &Study) -> Markup {
    let row = |cause: &&Cause| {
        let others = code(cause.not_separable_from.iter().map(|id| &**id));
        [code([&*cause.effect]), constants_html(cause.parameters.iter().map(|(name, value)| (&**name, value))), others]
    };
    let headings = ["Causes".into(), within_tolerance()];
    html! {
        @for (heading, causes) in headings.iter().zip(by_size(&study.outcome)).filter(|(_, causes)| !causes.is_empty()) {
            section {
                h2 { (heading) }
                (table(&["name", "constants", "cannot be told from"], causes.iter().map(row)))
            }
        }
        @if let Some(unexplained) = &study.outcome.unexplained { p { (without_a_name(unexplained)) } }
    }
}

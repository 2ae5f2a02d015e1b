//! The page of a comparison: the result in a sentence, what was compared over time or frequency, and the figures.

use crate::panels::{Panel, figures};
use crate::web_page::{Page, Provenance, lines};
use maud::html;

/// What is compared.
pub struct Compared<'a> {
    /// Title of the window.
    pub title: &'a str,
    /// What kind of page it is.
    pub kind: &'static str,
    /// The result in a sentence.
    pub verdict: String,
    /// The plots; those over time have a sample for each interval.
    pub panels: &'a [Panel],
    /// Time between samples.
    pub interval_s: f64,
    /// The figures as a terminal shows them.
    pub figures: &'a str,
}

/// The file.
pub fn html(compared: &Compared, provenance: Provenance) -> String {
    let sections = vec![
        html! { section { (figures(compared.interval_s, compared.panels)) } },
        html! { section { h2 { "In figures" } (lines(compared.figures)) } },
    ];
    Page {
        title: compared.title.into(),
        kind: compared.kind,
        verdict: compared.verdict.clone(),
        sections,
        folded: Vec::new(),
        provenance,
    }
    .html()
}

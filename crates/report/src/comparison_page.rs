//! The page of a comparison: the result in a sentence, what was compared over time or frequency, and the figures.

use crate::panels::{Panel, figures};
use crate::web_page::{Page, Provenance};
use maud::{Markup, html};

/// What is compared.
pub struct Compared<'a> {
    /// Title of the window.
    pub title: &'a str,
    /// What kind of page it is.
    pub kind: &'static str,
    /// The result in a sentence.
    pub verdict: String,
    /// What follows from it, a paragraph each.
    pub conclusions: Vec<String>,
    /// The plots; those over time have a sample for each interval.
    pub panels: &'a [Panel],
    /// Time between samples.
    pub interval_s: f64,
    /// The figures.
    pub figures: Markup,
}

/// The file.
pub fn html(compared: &Compared, provenance: Provenance) -> String {
    let (first, others): (Vec<&Panel>, Vec<&Panel>) = compared.panels.iter().partition(|panel| !panel.is_aside());
    let drawn = |panels: &[&Panel]| figures(compared.interval_s, panels);
    let sections = vec![
        html! { @if !compared.conclusions.is_empty() { section { @for text in &compared.conclusions { p { (text) } } } } },
        html! { section { (drawn(&first)) } },
        html! { section { h2 { "In figures" } (compared.figures) } },
    ];
    let aside = (!others.is_empty()).then(|| ("The other channels".into(), drawn(&others)));
    Page {
        title: compared.title.into(),
        kind: compared.kind,
        verdict: compared.verdict.clone(),
        sections,
        folded: aside.into_iter().collect(),
        provenance,
    }
    .html()
}

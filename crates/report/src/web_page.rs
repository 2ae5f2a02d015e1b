//! The template of all pages for a browser: one self-contained file, readable on a phone, complete in print. Its plots are
//! drawings that need no program; with JavaScript they can be zoomed, moved and asked for values.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use motorbench_text::terminal_text::COLUMNS;

const STYLE: &str = include_str!("../assets/page.css");
const LIVE: &str = include_str!("../assets/page.js");
/// The MIT licensed library that makes plots live.
const PLOT_LIBRARY: &str = include_str!("../assets/uplot/uPlot.iife.min.js");
const PLOT_STYLE: &str = include_str!("../assets/uplot/uPlot.min.css");

/// Where the results of a page come from.
#[derive(Clone, Debug, Default)]
pub struct Provenance {
    /// The recordings or tables.
    pub files: Vec<String>,
    /// The rig file, the model, the scenario, and what else was read; empty lines are left out.
    pub inputs: Vec<(&'static str, String)>,
    /// What was left out of the data.
    pub left_out: Vec<String>,
    /// Day and time, if a clock is at hand.
    pub written: Option<String>,
}

/// A page: a sentence that says the result, and its sections in their order.
pub struct Page {
    /// Title of the window.
    pub title: String,
    /// What kind of page it is, in a few words.
    pub kind: &'static str,
    /// The result in a sentence.
    pub verdict: String,
    /// The sections.
    pub sections: Vec<Markup>,
    /// Folded sections at the end, each with its heading.
    pub folded: Vec<(String, Markup)>,
    /// Where it comes from.
    pub provenance: Provenance,
}

impl Page {
    /// The file.
    pub fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width,initial-scale=1";
                    title { (self.title) }
                    link rel="icon" href="data:,";
                    style { (PreEscaped(PLOT_STYLE)) (PreEscaped(STYLE)) }
                }
                body {
                    p.kind { (self.kind) }
                    h1 { (self.verdict) }
                    p.hint { "In a plot: drag to zoom, shift and drag to move, double-click for the whole, click a name to hide its line." }
                    @for section in &self.sections { (section) }
                    (provenance(&self.provenance))
                    @if !self.folded.is_empty() {
                        div.fold {
                            @for (heading, section) in &self.folded {
                                details { summary { (heading) } (section) }
                            }
                        }
                    }
                    script { (PreEscaped(PLOT_LIBRARY)) }
                    script { (PreEscaped(LIVE)) }
                }
            }
        };
        page.into_string() + "\n"
    }
}

fn provenance(from: &Provenance) -> Markup {
    let version = format!("motorbench {}", env!("CARGO_PKG_VERSION"));
    html! {
        section.provenance {
            h2 { "Where this comes from" }
            ul {
                @if !from.files.is_empty() { li { "Data: " (from.files.join(", ")) } }
                @for (what, file) in from.inputs.iter().filter(|(_, file)| !file.is_empty()) { li { (what) ": " (file) } }
                @for left_out in &from.left_out { li { (left_out) } }
                li { "Written by " (version) @if let Some(written) = &from.written { ", " (written) } "." }
            }
        }
    }
}

/// Names as in files, `friction_asymmetry`. In a narrow place they break after an underscore, not within a word.
pub fn code<'a>(names: impl IntoIterator<Item = &'a str>) -> Markup {
    html! {
        @for (index, name) in names.into_iter().enumerate() {
            @if index > 0 { ", " }
            code { @for (part, text) in name.split_inclusive(['_', ':']).enumerate() { @if part > 0 { wbr; } (text) } }
        }
    }
}

/// A table: its header, if there is one, and rows of cells. On a narrow screen it scrolls in its own frame.
pub fn table<Row: IntoIterator<Item = Markup>>(header: &[&str], rows: impl IntoIterator<Item = Row>) -> Markup {
    html! {
        div.wide {
            table {
                // A screen reader would read a row without a cell as a single one.
                @if !header.is_empty() { tr { @for name in header { th { (name) } } } }
                @for row in rows { tr { @for cell in row { td { (cell) } } } }
            }
        }
    }
}

/// A text as a cell or a paragraph.
pub fn text(text: impl AsRef<str>) -> Markup {
    html! { (text.as_ref()) }
}

/// A number as a cell: its exponent stays with it.
pub fn number(number: impl AsRef<str>) -> Markup {
    html! { span.number { (number.as_ref()) } }
}

/// A list of texts.
pub fn list<'a>(items: impl IntoIterator<Item = &'a str>) -> Markup {
    html! { ul { @for item in items { li { (item) } } } }
}

/// Lines as a terminal shows them.
pub fn lines(lines: &str) -> Markup {
    let columns = lines.lines().map(|line| line.chars().count()).max().unwrap_or(0).clamp(FEWEST, COLUMNS);
    html! { pre style={ "--columns:" (columns) } { (lines) } }
}

/// Lines of fewer letters need no smaller letters on a phone.
const FEWEST: usize = 40;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_one_file_that_asks_for_nothing() {
        let page = Page {
            title: "a <title>".into(),
            kind: "test",
            verdict: "1 < 2".into(),
            sections: vec![code(["friction_asymmetry"])],
            folded: vec![("more".into(), lines("a & b"))],
            provenance: Provenance { files: vec!["run.csv".into()], ..Provenance::default() },
        };
        let html = page.html();
        assert!(html.contains("<title>a &lt;title&gt;</title>") && html.contains("<h1>1 &lt; 2</h1>"));
        assert!(
            html.contains("<code>friction_<wbr>asymmetry</code>")
                && html.contains("<pre style=\"--columns:40\">a &amp; b</pre>")
        );
        assert!(html.contains("Data: run.csv") && html.contains("<details><summary>more</summary>"));
        for outside in ["src=\"", "@import", "url(", "<link rel=\"stylesheet\""] {
            assert!(!html.contains(outside), "{outside}");
        }
    }
}

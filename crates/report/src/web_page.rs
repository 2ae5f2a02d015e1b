//! Pages for a browser: one self-contained file, readable on a phone, complete in print.

/// Size of a plot in its own units. The page scales it to the available width.
pub const PLOT_SIZE: (u32, u32) = (560, 300);
/// Largest number of labels on an axis, for the width of a phone.
pub const PLOT_LABELS: usize = 8;
/// Font size of a plot. The drawing uses 1/1.24 of it. A phone with 390 px still shows letters 9.8 px high.
pub const PLOT_LETTERS: (&str, i32) = ("sans-serif", 19);

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:820px;margin:0 auto;padding:1rem;color:#111}\
h1{font-size:1.4rem}h2{font-size:1.15rem;margin-top:2rem}h2::first-letter{text-transform:uppercase}svg{max-width:100%;height:auto;display:block}\
h1,h2,p,li{overflow-wrap:anywhere}code{overflow-wrap:normal}table{border-collapse:collapse;width:100%;font-size:.9rem}\
td,th{border-bottom:1px solid #ccc;padding:.25rem .4rem;text-align:left}\
.pairs{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(340px,100%),1fr));gap:0 1rem}.wide{overflow-x:auto;margin-bottom:.8rem}\
pre{background:#f4f4f4;padding:.6rem;font-size:.8rem;white-space:pre-wrap;overflow-wrap:anywhere}code{font-size:.9em}\
@media print{@page{size:A4;margin:15mm}body{padding:0;max-width:none}svg,tr,p,li,.pairs>div{break-inside:avoid}\
h2,h2+p,p:has(+svg){break-after:avoid}.pairs{grid-template-columns:1fr 1fr;gap:0 .5rem}\
.wide{overflow:visible}table{font-size:8.5pt}td,th{padding:.15rem .25rem}}";

/// A whole page. `body` is HTML, the title is text.
pub fn document(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{}</title><link rel=\"icon\" href=\"data:,\"><style>{STYLE}</style></head><body>\n{body}</body></html>\n",
        escaped(title)
    )
}

/// Escapes a text for HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Names as in files, `friction_asymmetry`. In a narrow place they break after an underscore, not within a word.
pub fn code<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names = names.into_iter().map(|name| {
        let parts: Vec<String> = name.split_inclusive(['_', ':']).map(escaped).collect();
        format!("<code>{}</code>", parts.join("<wbr>"))
    });
    names.collect::<Vec<_>>().join(", ")
}

/// A table: its header, if there is one, and rows of HTML cells. On a narrow screen it scrolls in its own frame.
pub fn table<Row: IntoIterator<Item = String>>(header: &[&str], rows: impl IntoIterator<Item = Row>) -> String {
    let cells = |tag: &str, cells: &mut dyn Iterator<Item = String>| {
        format!("<tr>{}</tr>", cells.map(|cell| format!("<{tag}>{cell}</{tag}>")).collect::<String>())
    };
    // A screen reader would read a row without a cell as a single one.
    let head =
        if header.is_empty() { String::new() } else { cells("th", &mut header.iter().map(|name| escaped(name))) };
    let body: String = rows.into_iter().map(|row| cells("td", &mut row.into_iter())).collect();
    format!("<div class=\"wide\"><table>{head}{body}</table></div>\n")
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

/// A list of texts.
pub fn list<'a>(items: impl IntoIterator<Item = &'a str>) -> String {
    let items: String = items.into_iter().map(|item| format!("<li>{}</li>", escaped(item))).collect();
    format!("<ul>{items}</ul>\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_is_as_short_as_its_number() {
        let labels = [-1e-17, 0.1 + 0.2, -100.0, 2.5e-5, 3000.0].map(|value| axis_label(&value));
        assert_eq!(labels, ["0", "0.3", "-100", "0.000025", "3000"]);
    }
}

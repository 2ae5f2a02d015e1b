//! The text of a comparison: fits, figures of each loop, and their order.

use super::super::compare::{table, table_html};
use super::{Loop, difference, shared};
use host_sim::figures::{Figures, JUMP};
use maud::{Markup, html};
use motorbench_report::web_page::{self, number};
use motorbench_text::terminal_text::{rounded, short, wrapped};

pub(super) fn page(loops: &[Loop], remaining: &[String]) -> String {
    let mut text = match loops {
        [only] => {
            let (table, figures) = (table(&only.compared), figures_table(&only.figures));
            let between = if figures.is_empty() { "" } else { "\n" };
            format!("Measured (second) against simulated (first)\n{table}{between}{figures}")
        }
        _ => side_by_side(loops),
    };
    for one in loops {
        let name = if loops.len() > 1 { format!("{}: ", one.name) } else { String::new() };
        one.notes.iter().for_each(|note| text += &format!("\n{}", wrapped(&format!("{name}{note}"), "", "  ")));
    }
    text.push('\n');
    for line in remaining {
        line.lines().for_each(|line| text += &wrapped(line, "", "  "));
    }
    text
}

/// The figures for a page.
pub(super) fn figures_html(loops: &[Loop]) -> Markup {
    match loops {
        [only] => html! { (table_html(&only.compared)) (one_html(&only.figures)) },
        _ => side_by_side_html(loops),
    }
}

/// Figures of one loop.
fn one_html(figures: &[Vec<Figures>; 2]) -> Markup {
    let rows = figures_rows(figures);
    let cells = rows.iter().map(|row| row.each_ref().map(number));
    html! { @if !rows.is_empty() { (web_page::table(&["at, s", "figure", "simulated", "measured"], cells)) } }
}

/// The tables of [`side_by_side`].
fn side_by_side_html(loops: &[Loop]) -> Markup {
    let channels = told_channels(loops);
    let fits = loops.iter().map(|one| {
        let cells = channels.iter().map(|channel| number(fit_cell(one, channel)));
        [web_page::text(&one.name)].into_iter().chain(cells).collect::<Vec<_>>()
    });
    html! {
        p { (FITS) }
        (web_page::table(&[&["loop"], &channels[..]].concat(), fits))
        @if same_course(loops) {
            @for (index, first) in loops[0].figures[0].iter().enumerate() {
                h3 { (course_at(first)) }
                (web_page::table(&[&["loop", ""], &COLUMNS[..]].concat(), rows_of_reference(loops, index).map(
                    |(name, source, figures)| [web_page::text(name), web_page::text(source)].into_iter().chain(cells(figures).map(number)).collect::<Vec<_>>()
                )))
            }
            p { (ranking(loops)) }
        } @else {
            p { (DIFFERENT_COURSES) }
            @for one in loops { h3 { (one.name) } (one_html(&one.figures)) }
        }
    }
}

/// Figures of one loop, a line each. An open loop has no reference, and none of them.
fn figures_table(figures: &[Vec<Figures>; 2]) -> String {
    let rows = figures_rows(figures);
    if rows.is_empty() {
        return String::new();
    }
    let head = "  at, s    figure                     simulated     measured\n";
    let line = |[time, name, a, b]: [String; 4]| format!("  {time:<8} {name:<22} {a:>13} {b:>12}\n");
    head.to_owned() + &rows.into_iter().map(line).collect::<String>()
}

/// Time, name, simulated and measured value of each figure.
fn figures_rows(figures: &[Vec<Figures>; 2]) -> Vec<[String; 4]> {
    let mut all = Vec::new();
    for (simulated, measured) in figures[0].iter().zip(&figures[1]) {
        let rows = [
            ("rise, s", simulated.rise_s, measured.rise_s),
            ("settling, s", simulated.settling_s, measured.settling_s),
            ("overshoot, %", simulated.overshoot_percent, measured.overshoot_percent),
            ("steady error", simulated.steady_error, measured.steady_error),
            ("tracking error, rms", Some(simulated.tracking_rms), Some(measured.tracking_rms)),
        ];
        let largest = simulated.largest_error.map(|error| ("largest error", Some(error), measured.largest_error));
        // A continuous reference has no rise time.
        let told = |(_, simulated, measured): &(_, Option<f64>, Option<f64>)| simulated.is_some() || measured.is_some();
        for (name, simulated_value, measured_value) in rows.into_iter().chain(largest).filter(told) {
            all.push([short(simulated.time_s), name.into(), or_dash(simulated_value, 3), or_dash(measured_value, 3)]);
        }
    }
    all
}

fn or_dash(value: Option<f64>, digits: i32) -> String {
    value.filter(|value| value.is_finite()).map_or("-".into(), |value| rounded(value, digits))
}

/// Channels in the table of several loops, as many as fit a line.
const TABLE_CHANNELS: usize = 4;
/// References of two loops are the same if their times differ by less than this.
const SAME_TIME_S: f64 = 0.02;

const FITS: &str = "Measured against simulated: fit in % (rms of the difference)";
const DIFFERENT_COURSES: &str = "The loops follow different courses: each by itself.";

/// The channels of that table.
fn told_channels(loops: &[Loop]) -> Vec<&'static str> {
    let told = |channel: &&str| *channel != "duty" && !channel.starts_with("ref_");
    shared(loops).into_iter().filter(told).take(TABLE_CHANNELS).collect()
}

/// The fit of a channel, and how far measured and simulated are apart.
fn fit_cell(one: &Loop, channel: &str) -> String {
    let found = difference(one, channel);
    let fit = found.fit_percent.map_or("-".into(), |fit| format!("{fit:.1}"));
    format!("{fit} ({})", rounded(found.rms, 2))
}

/// A reference and its time.
fn course_at(figures: &Figures) -> String {
    format!("{} at {} s", figures.course, short(figures.time_s))
}

/// Simulated and measured figures of each loop for a reference.
fn rows_of_reference(loops: &[Loop], index: usize) -> impl Iterator<Item = (&str, &'static str, &Figures)> {
    loops.iter().flat_map(move |one| {
        let sources = ["simulated", "measured"].into_iter().zip(&one.figures);
        sources.filter_map(move |(source, figures)| Some((&*one.name, source, figures.get(index)?)))
    })
}

/// Fit of each loop, and figures of each reference, with the loops in rows.
fn side_by_side(loops: &[Loop]) -> String {
    let channels = told_channels(loops);
    let mut text = format!("{FITS}\n  loop        ");
    channels.iter().for_each(|channel| text += &format!("{channel:>16}"));
    for one in loops {
        text += &format!("\n  {:<12.12}", one.name);
        for channel in &channels {
            text += &format!("{:>16}", fit_cell(one, channel));
        }
    }
    text.push('\n');
    if !same_course(loops) {
        text += &format!("\n{DIFFERENT_COURSES}\n");
        for one in loops {
            text += &format!("\n{}\n{}", one.name, figures_table(&one.figures));
        }
        return text;
    }
    for (index, first) in loops[0].figures[0].iter().enumerate() {
        text += &format!("\n  {:<22}", course_at(first));
        text.extend(COLUMNS.map(|title| format!("{title:>8}")));
        text.push('\n');
        for (name, source, figures) in rows_of_reference(loops, index) {
            let cells = cells(figures).map(|cell| format!("{cell:>8}")).concat();
            text += &format!("  {name:<12.12} {source:<9}{cells}\n");
        }
    }
    text + "\n" + &wrapped(&ranking(loops), "", "  ")
}

/// Titles of [`cells`].
const COLUMNS: [&str; 7] = ["rise, s", "settled", "over, %", "error", "summed", "rms, V", "peak, A"];

fn cells(figures: &Figures) -> [String; 7] {
    [
        (figures.rise_s, 3),
        (figures.settling_s, 3),
        (figures.overshoot_percent, 3),
        (figures.steady_error, 2),
        (Some(figures.iae), 3),
        (Some(figures.effort_v), 3),
        (Some(figures.peak_a), 3),
    ]
    .map(|(value, digits)| or_dash(value, digits))
}

/// Whether all loops had the same references in the same order.
fn same_course(loops: &[Loop]) -> bool {
    let first = &loops[0].figures[0];
    let same = |a: &Figures, b: &Figures| {
        a.course == b.course && (a.time_s - b.time_s).abs() < SAME_TIME_S && (a.to - b.to).abs() <= 1e-3 * b.to.abs()
    };
    !first.is_empty()
        && loops.iter().all(|one| {
            let figures = &one.figures[0];
            figures.len() == first.len() && figures.iter().zip(first).all(|(a, b)| same(a, b))
        })
}

/// The loop with the smallest summed error, and whether the simulation predicted it.
fn ranking(loops: &[Loop]) -> String {
    // A jump belongs to its sequence.
    let references = |figures: &&Figures| figures.course != JUMP;
    let sum = |figures: &[Figures]| figures.iter().filter(references).map(|figures| figures.iae).sum::<f64>();
    let sums: Vec<[f64; 2]> = loops.iter().map(|one| one.figures.each_ref().map(|figures| sum(figures))).collect();
    let least = |source: usize| (0..loops.len()).min_by(|a, b| sums[*a][source].total_cmp(&sums[*b][source]));
    let (Some(simulated), Some(measured)) = (least(0), least(1)) else { return String::new() };
    let each = loops.iter().zip(&sums).map(|(one, [simulated, measured])| {
        format!("{} {} ({})", one.name, rounded(*measured, 4), rounded(*simulated, 4))
    });
    let predicted = match simulated == measured {
        true => "as simulated".to_string(),
        false => format!("in simulation the {}", loops[simulated].name),
    };
    format!(
        "Summed error over all references, measured (simulated): {}. The {} has the smallest, {predicted}.",
        each.collect::<Vec<_>>().join(", "),
        loops[measured].name
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_loop_has_no_table_of_figures() {
        assert_eq!(figures_table(&[Vec::new(), Vec::new()]), "");
    }
}

//! The text of a comparison: fits, figures of each loop, and their order.

use super::super::compare::{table, table_html};
use super::{Loop, difference, shared};
use host_sim::figures::{Figures, JUMP};
use maud::{Markup, html};
use motorbench_report::web_page::{self, lines, number};
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

/// The figures for a page. Several loops have a table that is too wide for one.
pub(super) fn figures_html(loops: &[Loop]) -> Markup {
    let [only] = loops else { return lines(&side_by_side(loops)) };
    let rows = figures_rows(&only.figures);
    html! {
        (table_html(&only.compared))
        @if !rows.is_empty() {
            (web_page::table(&["at, s", "figure", "simulated", "measured"], rows.iter().map(|row| row.each_ref().map(number))))
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

/// Fit of each loop, and figures of each reference, with the loops in rows.
fn side_by_side(loops: &[Loop]) -> String {
    let told = |channel: &&str| *channel != "duty" && !channel.starts_with("ref_");
    let channels: Vec<&str> = shared(loops).into_iter().filter(told).take(TABLE_CHANNELS).collect();
    let mut text = String::from("Measured against simulated: fit in % (rms of the difference)\n  loop        ");
    channels.iter().for_each(|channel| text += &format!("{channel:>16}"));
    for one in loops {
        text += &format!("\n  {:<12.12}", one.name);
        for channel in &channels {
            let found = difference(one, channel);
            let fit = found.fit_percent.map_or("-".into(), |fit| format!("{fit:.1}"));
            text += &format!("{:>16}", format!("{fit} ({})", rounded(found.rms, 2)));
        }
    }
    text.push('\n');
    if !same_course(loops) {
        text += "\nThe loops follow different courses: each by itself.\n";
        for one in loops {
            text += &format!("\n{}\n{}", one.name, figures_table(&one.figures));
        }
        return text;
    }
    for (index, first) in loops[0].figures[0].iter().enumerate() {
        text += &format!("\n  {:<22}", format!("{} at {} s", first.course, short(first.time_s)));
        text.extend(COLUMNS.map(|title| format!("{title:>8}")));
        text.push('\n');
        for one in loops {
            for (source, figures) in ["simulated", "measured"].into_iter().zip(&one.figures) {
                let Some(figures) = figures.get(index) else { continue };
                text += &format!("  {:<12.12} {source:<9}{}\n", one.name, cells(figures));
            }
        }
    }
    text + "\n" + &wrapped(&ranking(loops), "", "  ")
}

/// Titles of [`cells`].
const COLUMNS: [&str; 7] = ["rise, s", "settled", "over, %", "error", "summed", "rms, V", "peak, A"];

fn cells(figures: &Figures) -> String {
    let cells = [
        (figures.rise_s, 3),
        (figures.settling_s, 3),
        (figures.overshoot_percent, 3),
        (figures.steady_error, 2),
        (Some(figures.iae), 3),
        (Some(figures.effort_v), 3),
        (Some(figures.peak_a), 3),
    ];
    cells.into_iter().map(|(value, digits)| format!("{:>8}", or_dash(value, digits))).collect()
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

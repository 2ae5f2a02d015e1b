//! Plots for a terminal. They use no colour, so in a pipe they are plain text. ratatui draws them, which the tuning
//! console needs anyway.

use motorbench_text::terminal_text::COLUMNS;
use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, Widget};

/// Smallest range of an axis.
const LEAST: f64 = 0.1;
/// Columns between two plots side by side.
const BETWEEN: u16 = 2;

/// Times in s, with their values.
pub type Trace = [(f64, f64)];

/// Range of all traces, with zero.
pub fn range<'a>(traces: impl IntoIterator<Item = &'a Trace>) -> [f64; 2] {
    let values = traces.into_iter().flatten().map(|(_, value)| *value);
    values.fold([-LEAST, LEAST], |[low, high], value| [low.min(value), high.max(value)])
}

/// The reference as dots, and the following quantity as a line.
pub fn chart<'a>([dots, line]: [&'a Trace; 2], times_s: [f64; 2], values: [f64; 2]) -> Chart<'a> {
    let dataset = |marker, color, data| {
        Dataset::default().marker(marker).graph_type(GraphType::Line).style(Style::new().fg(color)).data(data)
    };
    Chart::new(vec![dataset(Marker::Dot, Color::Reset, dots), dataset(Marker::Braille, Color::Cyan, line)])
        .x_axis(Axis::default().bounds(times_s))
        .y_axis(Axis::default().bounds(values).labels(values.map(|value| format!("{value:.1}"))))
}

/// Charts side by side, each under its title, as lines of text.
pub fn side_by_side<const COUNT: usize>(charts: [(String, Chart<'_>); COUNT], rows: u16) -> String {
    let mut buffer = Buffer::empty(Rect::new(0, 0, COLUMNS as u16, rows));
    let areas: [Rect; COUNT] = Layout::horizontal([Constraint::Fill(1); COUNT]).spacing(BETWEEN).areas(buffer.area);
    for ((title, chart), area) in charts.into_iter().zip(areas) {
        chart.block(Block::new().title(title)).render(area, &mut buffer);
    }
    let lines =
        buffer.content().chunks(COLUMNS).map(|cells| cells.iter().map(|cell| cell.symbol()).collect::<String>());
    lines.map(|line| line.trim_end().to_owned() + "\n").collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn traces_are_told_apart_in_plain_text() {
        let at = |value: f64| [(0.0, value), (1.0, value)];
        let (reference, below, between) = (at(5.0), at(-4.0), at(0.5));
        let values = range([&reference[..], &below, &between]);
        assert_eq!(values, [-4.0, 5.0]);
        let plot = |line| chart([&reference, line], [0.0, 1.0], values);
        let text = side_by_side([("before".into(), plot(&below)), ("after".into(), plot(&between))], 8);
        let lines: Vec<Vec<char>> = text.lines().map(|line| line.chars().collect()).collect();
        assert!(lines.len() == 8 && lines.iter().all(|line| line.len() <= COLUMNS), "{text}");
        assert!(text.lines().next().is_some_and(|title| title.contains("before") && title.contains("after")), "{text}");
        // Rows with dots, and rows with a line: left half, right half.
        let rows = |columns: std::ops::Range<usize>, is: fn(&char) -> bool| -> Vec<usize> {
            let has = |line: &Vec<char>| line.iter().take(columns.end).skip(columns.start).any(is);
            (1..8).filter(|row| has(&lines[*row])).collect()
        };
        let (dot, braille) = (|c: &char| *c == '•', |c: &char| ('\u{2801}'..='\u{28ff}').contains(c));
        assert_eq!((rows(0..39, dot), rows(41..80, dot)), (vec![1], vec![1]), "{text}");
        assert_eq!((rows(0..39, braille), rows(41..80, braille)), (vec![7], vec![4]), "{text}");
    }
}

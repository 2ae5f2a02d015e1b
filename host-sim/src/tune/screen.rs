//! The tuning console's screen: traces above, gains, figures and keys below. Black and white serve as well as colours.

use super::{Key, LOOPS, SHOWN_S, Session, StepTest, name};
use crate::board::BoardError;
use crate::figures::Figures;
use crate::link::Line;
use motorbench_core::pins::PWM_STEPS;
use ratatui::Frame;
use ratatui::crossterm::event::{Event, KeyCode, KeyEventKind, KeyModifiers, poll, read};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::Line as TextLine;
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, Paragraph};
use std::time::Duration;

/// Points drawn of a trace.
const POINTS: usize = 400;
/// Least range of an axis.
const LEAST: f64 = 0.1;

/// Runs until the person quits, `stop` says so, or the board is gone; the terminal is then as it was.
///
/// # Errors
/// [`BoardError`], when the board or the terminal is gone.
pub fn run<L: Line>(session: &mut Session<L>, stop: &dyn Fn() -> bool) -> Result<(), BoardError> {
    let mut terminal = ratatui::init();
    let ended = until_quit(&mut terminal, session, stop);
    ratatui::restore();
    ended
}

fn until_quit<L: Line>(
    terminal: &mut ratatui::DefaultTerminal,
    session: &mut Session<L>,
    stop: &dyn Fn() -> bool,
) -> Result<(), BoardError> {
    let failed = |error: std::io::Error| BoardError::Failed(format!("the terminal: {error}"));
    while !stop() {
        session.poll()?;
        terminal.draw(|frame| draw(frame, session)).map_err(failed)?;
        while poll(Duration::ZERO).map_err(failed)? {
            let Event::Key(event) = read().map_err(failed)? else { continue };
            let control_c = event.modifiers.contains(KeyModifiers::CONTROL) && event.code == KeyCode::Char('c');
            if event.kind == KeyEventKind::Press && (control_c || event.code == KeyCode::Char('q')) {
                return Ok(());
            }
            if let Some(key) = key(event.code).filter(|_| event.kind == KeyEventKind::Press) {
                session.press(key)?;
            }
        }
    }
    Ok(())
}

/// A key by its name: the character that it writes, or `space`, `tab`, `up`, `down`, `left`, `right`.
pub fn key_named(name: &str) -> Option<Key> {
    let mut characters = name.chars();
    key(match (name, characters.next(), characters.next()) {
        ("space", ..) => KeyCode::Char(' '),
        ("tab", ..) => KeyCode::Tab,
        ("up", ..) => KeyCode::Up,
        ("down", ..) => KeyCode::Down,
        ("left", ..) => KeyCode::Left,
        ("right", ..) => KeyCode::Right,
        (_, Some(character), None) => KeyCode::Char(character),
        _ => return None,
    })
}

fn key(code: KeyCode) -> Option<Key> {
    Some(match code {
        KeyCode::Up => Key::Up,
        KeyCode::Down => Key::Down,
        KeyCode::Left => Key::Less,
        KeyCode::Right => Key::More,
        KeyCode::Char('-') => Key::Lower,
        KeyCode::Char('+' | '=') => Key::Higher,
        KeyCode::Char('a') => Key::Arm,
        KeyCode::Char(' ') => Key::Stop,
        KeyCode::Char('s') => Key::Step,
        KeyCode::Tab => Key::Switch,
        KeyCode::Char('u') => Key::Undo,
        KeyCode::Char('w') => Key::Save,
        KeyCode::Char('r') => Key::Record,
        _ => return None,
    })
}

fn draw<L: Line>(frame: &mut Frame, session: &Session<L>) {
    let [speed, drive, below, message] =
        Layout::vertical([Constraint::Min(8), Constraint::Min(6), Constraint::Length(9), Constraint::Length(3)])
            .areas(frame.area());
    let [gains, figures] = Layout::horizontal([Constraint::Length(30), Constraint::Min(40)]).areas(below);
    draw_traces(frame, session, speed, drive);
    frame.render_widget(gain_list(session), gains);
    frame.render_widget(figure_table(session), figures);
    let keys = [
        "a arm  space stop  s step test  r record  q quit",
        "arrows gain  -/+ reference  tab PID/LQR  u undo  w save on the board",
    ];
    let lines: Vec<TextLine> = [session.message.as_str()].into_iter().chain(keys).map(TextLine::from).collect();
    frame.render_widget(Paragraph::new(lines), message);
}

fn draw_traces<L: Line>(frame: &mut Frame, session: &Session<L>, speed: Rect, drive: Rect) {
    let every = (session.traces.len() / POINTS).max(1);
    let points: Vec<_> = session.traces.iter().step_by(every).map(|sample| session.point(sample)).collect();
    let end_s = points.last().map_or(0.0, |point| point.t_s);
    let trace = |of: &dyn Fn(&crate::design::trial::Point) -> f64| {
        points.iter().map(|point| (point.t_s - end_s, of(point))).collect::<Vec<_>>()
    };
    let (reference, measured) = (trace(&|point| point.reference), trace(&|point| point.measured_rad_per_s));
    let current = trace(&|point| point.i_a);
    let shares = session.traces.iter().step_by(every).map(|sample| f64::from(sample.duty) / f64::from(PWM_STEPS));
    let duty: Vec<_> = points.iter().zip(shares).map(|(point, share)| (point.t_s - end_s, share)).collect();
    let title = |text: &str, last: &[(f64, f64)], unit: &str| {
        format!("{text} {:.2} {unit}", last.last().map_or(0.0, |(_, value)| *value))
    };
    let first =
        [(title("reference", &reference, "rad/s"), &reference), (title("speed", &measured, "rad/s"), &measured)];
    frame.render_widget(chart(&first), speed);
    let second = [(title("duty", &duty, "of 1"), &duty), (title("current", &current, "A"), &current)];
    frame.render_widget(chart(&second), drive);
}

fn chart<'a>(traces: &'a [(String, &'a Vec<(f64, f64)>); 2]) -> Chart<'a> {
    let values = || traces.iter().flat_map(|(_, trace)| trace.iter().map(|(_, value)| *value));
    let low = values().fold(-LEAST, f64::min);
    let high = values().fold(LEAST, f64::max);
    // Told apart without colour as well.
    let looks = [(Marker::Dot, Color::Reset), (Marker::Braille, Color::Cyan)];
    let datasets = traces.iter().zip(looks).map(|((_, trace), (marker, color))| {
        Dataset::default().marker(marker).graph_type(GraphType::Line).style(Style::new().fg(color)).data(trace)
    });
    Chart::new(datasets.collect())
        .block(Block::bordered().title(format!("dots: {} | line: {}", traces[0].0, traces[1].0)))
        .x_axis(Axis::default().bounds([-SHOWN_S, 0.0]))
        .y_axis(Axis::default().bounds([low, high]).labels([format!("{low:.1}"), format!("{high:.1}")]))
}

fn gain_list<L: Line>(session: &Session<L>) -> Paragraph<'_> {
    let lines = session.tuned().gains.iter().enumerate().map(|(index, param)| {
        let chosen = index == session.selected;
        let text =
            format!("{} {:16} {:.5}", if chosen { ">" } else { " " }, name(*param), session.settings.get(*param));
        let style = if chosen { Style::new().add_modifier(Modifier::BOLD) } else { Style::new() };
        TextLine::styled(text, style)
    });
    let title = format!(
        "{} {} to {:.0}{}",
        session.tuned().mode,
        if session.armed { "ARMED" } else { "off" },
        session.reference,
        if session.recording.is_some() { " REC" } else { "" }
    );
    Paragraph::new(lines.collect::<Vec<_>>()).block(Block::bordered().title(title))
}

fn figure_table<L: Line>(session: &Session<L>) -> Paragraph<'_> {
    let lines: Vec<TextLine> = figure_lines(&session.step_tests).into_iter().map(TextLine::from).collect();
    Paragraph::new(lines).block(Block::bordered().title("step tests"))
}

/// A table of the last step test of each loop, and of the one before.
pub fn figure_lines(tests: &[StepTest]) -> Vec<String> {
    let header = ["rise s", "settle s", "over %", "error", "peak A"];
    let mut lines = vec![row("", header.map(String::from))];
    for tuned in LOOPS {
        let own = tests.iter().rev().filter(|test| test.mode == tuned.mode);
        lines.extend([tuned.mode, "  before"].iter().zip(own).map(|(which, test)| figure_line(which, &test.figures)));
    }
    lines
}

fn figure_line(what: &str, figures: &Figures) -> String {
    let number = |value: Option<f64>, digits: usize| value.map_or("-".into(), |value| format!("{value:.digits$}"));
    let peak_a = format!("{:.2}", figures.peak_a);
    row(
        what,
        [
            number(figures.rise_s, 3),
            number(figures.settling_s, 3),
            number(figures.overshoot_percent, 1),
            number(figures.steady_error, 2),
            peak_a,
        ],
    )
}

/// As wide as a terminal of 80 columns leaves.
fn row(what: &str, [rise, settling, overshoot, error, peak]: [String; 5]) -> String {
    format!("{what:10} {rise:>6} {settling:>8} {overshoot:>6} {error:>6} {peak:>6}")
}

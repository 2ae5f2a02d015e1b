//! The tuning console's screen: traces at the top; gains, figures and keys below. It also works without colours.

use super::{Key, LOOPS, SHOWN_S, Session, StepTest};
use crate::terminal_plot;
use host_sim::figures::Figures;
use motorbench_core::HARDWARE;
use motorbench_data::names::setting_name;
use motorbench_link::Line;
use motorbench_link::board::BoardError;
use motorbench_text::terminal_text::fixed;
use ratatui::Frame;
use ratatui::crossterm::event::{Event, KeyCode, KeyEventKind, KeyModifiers, read};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Modifier, Style};
use ratatui::text::Line as TextLine;
use ratatui::widgets::{Block, Chart, Paragraph};
use std::borrow::Cow;
use std::mem::ManuallyDrop;
use std::sync::mpsc::{Receiver, channel};

/// Number of points of a trace.
const POINTS: usize = 400;
/// From this width on gains and figures are side by side; this is their height.
const WIDE: u16 = 70;
const BOXES: u16 = 9;
/// A plot with fewer rows shows nothing.
const PLOT: u16 = 5;

/// Runs until the user quits, `stop` returns true, or the board is gone. The terminal is then restored.
///
/// # Errors
/// [`BoardError`], if the board or the terminal is gone.
pub fn run<L: Line>(session: &mut Session<L>, stop: &dyn Fn() -> bool) -> Result<(), BoardError> {
    // Neither dropped nor restored with messages. On a closed terminal both would fail to print, and end the program
    // before it has switched off the board.
    let mut terminal = ManuallyDrop::new(ratatui::init());
    let ended = until_quit(&mut terminal, session, stop);
    let _ = (terminal.show_cursor(), ratatui::try_restore());
    ended
}

fn until_quit<L: Line>(
    terminal: &mut ratatui::DefaultTerminal,
    session: &mut Session<L>,
    stop: &dyn Fn() -> bool,
) -> Result<(), BoardError> {
    let failed = |error: std::io::Error| BoardError::Failed(format!("the terminal: {error}"));
    let events = events();
    while !stop() {
        session.poll()?;
        terminal.draw(|frame| draw(frame, session)).map_err(failed)?;
        while let Ok(event) = events.try_recv() {
            let Event::Key(event) = event.map_err(failed)? else { continue };
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

/// What happens in the terminal, read in a thread of its own: of a terminal that is closed, the reader may never return.
fn events() -> Receiver<std::io::Result<Event>> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        loop {
            let event = read();
            let is_last = event.is_err();
            if sender.send(event).is_err() || is_last {
                break;
            }
        }
    });
    receiver
}

/// A key by its name: its character, or `space`, `tab`, `up`, `down`, `left`, `right`.
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

/// A non-breaking space.
const NO_BREAK: &str = "\u{a0}";
/// Help for the keys; those that stop and quit come first.
const KEYS: [&str; 2] = [
    "space stop  a arm  q quit  s step test  r record",
    "arrows gain  -/+ reference  tab PID/LQR  u undo  w save on the board",
];

/// Text that matters for a turning motor comes first. The traces get the remaining rows.
fn draw<L: Line>(frame: &mut Frame, session: &Session<L>) {
    let area = frame.area();
    let message = textwrap::wrap(&session.message, usize::from(area.width));
    let words: Vec<TextLine> = message.into_iter().chain(KEYS.map(Cow::from)).map(TextLine::from).collect();
    let rows = u16::try_from(words.len()).unwrap_or(u16::MAX);
    let traces = if area.width >= WIDE && area.height >= rows.saturating_add(BOXES) {
        draw_boxes(frame, session, words, area)
    } else {
        draw_lines(frame, session, area)
    };
    draw_traces(frame, session, traces);
}

/// Gains beside figures, with message and keys below. The traces get the rows above.
fn draw_boxes<L: Line>(frame: &mut Frame, session: &Session<L>, words: Vec<TextLine>, area: Rect) -> Rect {
    let heights = [Constraint::Fill(1), Constraint::Length(BOXES), Constraint::Length(words.len() as u16)];
    let [traces, below, message] = Layout::vertical(heights).areas(area);
    let [gains, figures] = Layout::horizontal([Constraint::Length(30), Constraint::Min(40)]).areas(below);
    let lines: Vec<TextLine> = gain_lines(session).collect();
    frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(state(session))), gains);
    frame.render_widget(figure_table(session), figures);
    frame.render_widget(Paragraph::new(words), message);
    traces
}

/// A terminal too small for boxes: state, keys and message, then gains and figures as far as there is room. The traces
/// get the rows above.
fn draw_lines<L: Line>(frame: &mut Frame, session: &Session<L>, area: Rect) -> Rect {
    let width = usize::from(area.width);
    // The message is between them: a long one must not push away the key that stops the motor.
    let texts = [state(session), together(KEYS[0]), session.message.clone(), together(KEYS[1])];
    let words = texts.iter().flat_map(|text| textwrap::wrap(text, width));
    let figures = figure_lines(&session.step_tests).into_iter().map(TextLine::from);
    let lines: Vec<TextLine> = words
        .map(|line| TextLine::from(line.replace(NO_BREAK, " ")))
        .chain(gain_lines(session))
        .chain(figures)
        .collect();
    let height = u16::try_from(lines.len()).unwrap_or(u16::MAX);
    let [traces, below] = Layout::vertical([Constraint::Fill(1), Constraint::Max(height)]).areas(area);
    frame.render_widget(Paragraph::new(lines), below);
    traces
}

/// Keys as words: a line may end between two keys, but not within one.
fn together(keys: &str) -> String {
    let keys: Vec<String> = keys.split("  ").map(|key| key.replace(' ', NO_BREAK)).collect();
    keys.join("  ")
}

/// The speed, and below it the voltage and current if there is room for both.
fn draw_traces<L: Line>(frame: &mut Frame, session: &Session<L>, area: Rect) {
    let below = if area.height < 2 * PLOT { Constraint::Length(0) } else { Constraint::Fill(3) };
    let [speed, drive] = Layout::vertical([Constraint::Fill(4), below]).areas(area);
    let every = (session.traces.len() / POINTS).max(1);
    let points: Vec<_> = session.traces.iter().step_by(every).map(|sample| session.point(sample)).collect();
    let end_s = points.last().map_or(0.0, |point| point.t_s);
    let trace = |of: &dyn Fn(&host_sim::trial::Point) -> f64| {
        points.iter().map(|point| (point.t_s - end_s, of(point))).collect::<Vec<_>>()
    };
    let (reference, measured) = (trace(&|point| point.reference), trace(&|point| point.measured_rad_per_s));
    let current = trace(&|point| point.i_a);
    let shares =
        session.traces.iter().step_by(every).map(|sample| f64::from(sample.duty) / f64::from(HARDWARE.pwm_steps));
    let duty: Vec<_> = points.iter().zip(shares).map(|(point, share)| (point.t_s - end_s, share)).collect();
    let title = |text: &str, last: &[(f64, f64)], unit: &str| {
        format!("{text} {} {unit}", fixed(last.last().map_or(0.0, |(_, value)| *value), 2))
    };
    let first =
        [(title("reference", &reference, "rad/s"), &reference), (title("speed", &measured, "rad/s"), &measured)];
    if speed.height >= PLOT {
        frame.render_widget(chart(&first), speed);
    }
    let second = [(title("duty", &duty, "of 1"), &duty), (title("current", &current, "A"), &current)];
    if drive.height > 0 {
        frame.render_widget(chart(&second), drive);
    }
}

fn chart<'a>(traces: &'a [(String, &'a Vec<(f64, f64)>); 2]) -> Chart<'a> {
    let courses = [0, 1].map(|index| &traces[index].1[..]);
    terminal_plot::chart(courses, [-SHOWN_S, 0.0], terminal_plot::range(courses))
        .block(Block::bordered().title(format!("dots: {} | line: {}", traces[0].0, traces[1].0)))
}

fn gain_lines<L: Line>(session: &Session<L>) -> impl Iterator<Item = TextLine<'static>> + '_ {
    session.tuned().gains.iter().enumerate().map(|(index, param)| {
        let chosen = index == session.selected;
        let text = format!(
            "{} {:16} {:.5}",
            if chosen { ">" } else { " " },
            setting_name(*param),
            session.settings.get(*param)
        );
        let style = if chosen { Style::new().add_modifier(Modifier::BOLD) } else { Style::new() };
        TextLine::styled(text, style)
    })
}

/// The loop, whether it drives, and its reference.
fn state<L: Line>(session: &Session<L>) -> String {
    format!(
        "{} {} to {:.0}{}",
        session.tuned().mode,
        if session.armed { "ARMED" } else { "off" },
        session.reference,
        if session.recording.is_some() { " REC" } else { "" }
    )
}

fn figure_table<L: Line>(session: &Session<L>) -> Paragraph<'_> {
    let lines: Vec<TextLine> = figure_lines(&session.step_tests).into_iter().map(TextLine::from).collect();
    Paragraph::new(lines).block(Block::bordered().title("step tests"))
}

/// A table with the last step test of each loop, and the one before.
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
    let number = |value: Option<f64>, digits: usize| value.map_or("-".into(), |value| fixed(value, digits));
    let peak_a = fixed(figures.peak_a, 2);
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

/// The width that a terminal of 80 columns leaves.
fn row(what: &str, [rise, settling, overshoot, error, peak]: [String; 5]) -> String {
    format!("{what:10} {rise:>6} {settling:>8} {overshoot:>6} {error:>6} {peak:>6}")
}

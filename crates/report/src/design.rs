//! A design as half a page of text, and as a self-contained page with plots.

use crate::panels::{COLOURS, LEGEND_LEFT, LEGEND_TOP, legend, row_height};
use crate::web_page::{PLOT_LABELS, PLOT_LETTERS, PLOT_SIZE, axis_label, code, document, escaped, list, table};
use host_sim::trial::Point;
use motorbench_core::settings::Param;
use motorbench_design::compensation::Standstill;
use motorbench_design::current_sensor::{Comparison, LoopWith};
use motorbench_design::law::ControlLaw;
use motorbench_design::robustness::corners;
use motorbench_design::sampled_loop::{SampledLoop, SpeedPath};
use motorbench_design::specification::Speed;
use motorbench_design::weights::states;
use motorbench_design::{Design, TrialFigures, TrialWithEffects, current_sensor};
use motorbench_model::linear::eigenvalues;
use motorbench_model::linear::frequency_response::BodePoint;
use motorbench_model::motor::MotorParameters;
use motorbench_text::terminal_text::{short, wrapped};
use nalgebra::Complex;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use std::f64::consts::TAU;
use std::ops::Range;

/// Largest number of points of a line.
const MAX_POINTS: usize = 800;
/// Size of all plots on pages, with room for the title and two rows of names.
const SIZE: (u32, u32) = (PLOT_SIZE.0, PLOT_SIZE.1 + 50);
const LINEAR: RGBColor = COLOURS[1];
const CROSSOVER: RGBColor = COLOURS[2];
const EFFECTS: RGBColor = COLOURS[3];
const CORE: RGBColor = COLOURS[6];

/// A line of a summary: a name, and a text that fits a terminal.
type Entry = (&'static str, String);

/// A few lines about a design.
pub fn summary(design: &Design) -> String {
    let mut text = format!("{}: {}\n", design.law.title(), asked(design));
    for gain in &design.gains {
        text += &format!("  {:16} {:>11} {:11} held as {:.6}\n", gain.name, gain.value, gain.unit, gain.held);
    }
    text.extend(said(design).iter().map(terminal_lines));
    text + &current_sensor::table(design.law, &design.current_sensor)
}

/// The name, with its text to the right.
fn terminal_lines((name, text): &Entry) -> String {
    let other = " ".repeat(19);
    let lines = text.lines().enumerate().map(|(index, line)| {
        let first = if index == 0 { format!("  {name:16} ") } else { other.clone() };
        wrapped(line, &first, &other)
    });
    lines.collect()
}

/// The specification.
fn asked(design: &Design) -> String {
    let speed = match design.specification.speed {
        Speed::BandwidthHz(hz) => format!("bandwidth at least {hz} Hz"),
        Speed::SettlingS(settling_s) => format!("settled in at most {settling_s} s"),
        Speed::Weights(_) => "the weights given".into(),
    };
    format!("{speed}, overshoot at most {} %", design.specification.overshoot_percent)
}

/// Everything except the gains.
fn said(design: &Design) -> Vec<Entry> {
    let refused = design.current_left_out.as_ref();
    let refused = refused.map(|why| ("without current", format!("the loop with a gain on it is refused: {why}")));
    let load = design.load.as_ref().map(|load| {
        let (peak, gone_s) = (short(load.peak_rad_per_nm), short(load.gone_s));
        ("load torque", format!("turns it by at most {peak} rad/Nm, 2 % of it remain after {gone_s} s"))
    });
    let plain = ("without profile", plain_step_text(design));
    let on_core = ("on the core", trial_text(&design.trial, unit(design.law)));
    let tachogenerator = sensor_text(design).map(|text| ("tachogenerator", text));
    let lines = refused.into_iter().chain(linear_lines(design)).chain(load).chain([on_core]);
    lines.chain(tachogenerator).chain([plain]).collect()
}

/// Figures of the linear loop.
fn linear_lines(design: &Design) -> [Entry; 4] {
    let weighed: Vec<&str> = states(design.law.is_position()).iter().map(|(name, _)| *name).collect();
    let (figures, step, robustness) = (&design.figures, &design.figures.step, &design.robustness);
    let margins = &robustness.margins;
    let linear = format!(
        "bandwidth {:.2} Hz, rise {:.1} ms, settling {:.1} ms,\novershoot {:.1} %",
        figures.bandwidth_hz,
        1e3 * step.rise_s,
        1e3 * step.settling_s,
        step.overshoot_percent
    );
    let margins = format!(
        "gain {:.1}, phase {:.0} degrees, modulus {:.2}, delay {:.1} ms",
        margins.gain,
        margins.phase_deg,
        margins.modulus,
        1e3 * margins.delay_s
    );
    let changed = format!(
        "modulus {:.2}, largest eigenvalue {:.4} (unchanged {:.4})",
        robustness.worst_modulus, robustness.worst_spectral_radius, robustness.spectral_radius
    );
    [
        ("weights", format!("{}\n({}; voltage)", design.weights.options(), weighed.join(", "))),
        ("linear loop", linear),
        ("margins", margins),
        ("parameters +-30%", changed),
    ]
}

fn plain_step_text(design: &Design) -> String {
    format!(
        "the same step without profile would need {:.1} V, {:.2} A",
        design.plain_step_peak_v, design.plain_step_peak_a
    )
}

/// Effect of a tachogenerator that replaces the encoder; nothing with an encoder.
fn sensor_text(design: &Design) -> Option<String> {
    let tachogenerator = design.tachogenerator.as_ref()?;
    let SpeedPath::Converted { filter_s, .. } = design.sampling.speed else { return None };
    let aliased_rad_per_s = tachogenerator.aliased_rad_per_s();
    let mut text = format!(
        "{} V at 1000 rpm: steps of {:.3} rad/s, low-pass {:.1} ms;\nits ripple of {:.1} % swings the voltage by {:.2} V at the end",
        tachogenerator.gain_v_per_krpm,
        tachogenerator.resolution_rad_per_s(),
        1e3 * filter_s,
        100.0 * tachogenerator.ripple,
        design.trial.swing_v
    );
    let range_rad_per_s = f64::from(design.settings.all.get(Param::SpeedRange));
    if tachogenerator.ripple > 0.0 && aliased_rad_per_s < range_rad_per_s {
        text += &format!(
            "\nat about {aliased_rad_per_s:.0} rad/s the ripple has the frequency of the conversions\nand reads as an error of the speed of up to {:.1} %",
            100.0 * tachogenerator.ripple
        );
    }
    Some(text)
}

/// Figures of the core, on two lines.
fn trial_text(trial: &TrialFigures, unit: &str) -> String {
    format!(
        "step to {:.2} {unit}: at most {:.2} V, {:.2} A, overshoot {:.1} %;\nat the end off by {:.4} {unit}; at a limit {:.0} %",
        trial.step,
        trial.peak_v,
        trial.peak_a,
        trial.overshoot_percent,
        trial.last_deviation,
        100.0 * trial.limited_part
    )
}

/// Trials with the effects of the model, and the compensation of slow motion; nothing if neither was requested.
pub fn beyond_linear(trials: &[TrialWithEffects], standstill: &[Standstill]) -> String {
    let mut text = String::new();
    if !trials.is_empty() {
        text += "\nthe same steps with the effects of the model, simulated:\n";
    }
    text.extend(trials.iter().map(|trial| terminal_lines(&with_effects(trial))));
    if !standstill.is_empty() {
        text += "\nnear standstill, simulated:\n";
    }
    text.extend(standstill.iter().map(|found| format!("  {}", found.text())));
    text
}

fn with_effects((law, trial, _): &TrialWithEffects) -> Entry {
    (law.title(), trial_text(trial, unit(*law)))
}

fn unit(law: ControlLaw) -> &'static str {
    if law.is_position() { "rad" } else { "rad/s" }
}

/// A page with the plots of all designs.
pub fn html(
    motor: &MotorParameters,
    designs: &[Design],
    trials: &[TrialWithEffects],
    standstill: &[Standstill],
    commands: &[String],
) -> String {
    let constants = motor.named().map(|(name, value)| format!("{name} = {}", short(value)));
    let mut body = format!("<h1>Design</h1>\n<p>For a motor with {}.</p>\n", constants.join(", "));
    for design in designs {
        body += &format!("<h2>{}</h2>\n<p>{}.</p>\n", design.law.title(), escaped(&asked(design)));
        body += &design_tables(design);
        let [gain, phase] = loop_plots(motor, design);
        let course = trials.iter().find(|(law, ..)| *law == design.law).map_or(&[][..], |(.., points)| points);
        let voltage = effort_plot("Voltage on the core", "voltage, V", design, course, |point| point.u_v);
        let current = effort_plot("Current on the core", "current, A", design, course, |point| point.i_a);
        body += "<div class=\"pairs\">";
        for plot in [step_plot(motor, design, course), voltage, current, gain, phase, root_plot(motor, design)] {
            // Plots are drawn into memory, so only the plot itself can fail.
            let plot = plot.unwrap_or_else(|error| format!("<p>{}</p>", escaped(&error.to_string())));
            body += &format!("<div>{plot}</div>");
        }
        body += "</div>\n";
    }
    body += &beyond_linear_html(trials, standstill);
    body += &format!("<h2>For the console</h2>\n<pre>{}</pre>\n", escaped(&commands.join("\n")));
    document("motorbench design", &body)
}

/// The content of [`summary`] as tables that fit a phone.
fn design_tables(design: &Design) -> String {
    let gains = design.gains.iter().map(|gain| {
        let held = format!("{:.6}", gain.held);
        [code([gain.name.as_str()]), format!("{} {}", gain.value, escaped(&gain.unit)), held]
    });
    let gains = table(&["gain", "value", "held as"], gains);
    gains + &entries(&said(design)) + &current_sensor_table(design.law, &design.current_sensor)
}

/// A name and a text in each row.
fn entries(entries: &[Entry]) -> String {
    table(&[], entries.iter().map(|(name, text)| [escaped(name), escaped(text)]))
}

/// The content of [`beyond_linear`].
fn beyond_linear_html(trials: &[TrialWithEffects], standstill: &[Standstill]) -> String {
    let mut html = String::new();
    if !trials.is_empty() {
        let trials: Vec<Entry> = trials.iter().map(with_effects).collect();
        html += "<h2>With what the linear motor lacks</h2>\n<p>The same steps with the effects of the model, simulated.</p>\n";
        html += &entries(&trials);
    }
    if !standstill.is_empty() {
        let found: Vec<String> = standstill.iter().map(Standstill::text).collect();
        html += "<h2>Near standstill</h2>\n<p>Simulated.</p>\n";
        html += &list(found.iter().map(String::as_str));
    }
    html
}

type Plot = Result<String, Box<dyn std::error::Error>>;

/// A line of a plot.
struct Line {
    label: &'static str,
    colour: RGBColor,
    points: Vec<(f64, f64)>,
}

impl Line {
    /// Thinned to few enough points for a page.
    fn new(label: &'static str, colour: RGBColor, points: impl ExactSizeIterator<Item = (f64, f64)>) -> Self {
        let stride = points.len().div_ceil(MAX_POINTS).max(1);
        Self { label, colour, points: points.step_by(stride).collect() }
    }
}

/// A title on white paper; returns where it ends.
fn titled(root: &DrawingArea<SVGBackend, Shift>, title: &str) -> Result<i32, Box<dyn std::error::Error>> {
    root.fill(&WHITE)?;
    root.draw(&Text::new(title, (LEGEND_LEFT, LEGEND_TOP), PLOT_LETTERS))?;
    Ok(LEGEND_TOP + row_height(PLOT_LETTERS))
}

/// Lines over time.
fn over_time(title: &str, y_title: &str, drawn: &[Line]) -> Plot {
    let times = drawn.iter().flat_map(|line| line.points.iter().map(|point| point.0));
    lines(title, "time, s", y_title, span(times, 0.0), drawn)
}

/// Lines over a common axis.
fn lines<X: AsRangedCoord<Value = f64>>(title: &str, x_title: &str, y_title: &str, x: X, lines: &[Line]) -> Plot
where
    X::CoordDescType: ValueFormatter<f64>,
{
    let y = span(lines.iter().flat_map(|line| line.points.iter().map(|point| point.1)), 0.05);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        let below_title = titled(&root, title)?;
        let names = lines.iter().map(|line| (line.label, line.colour));
        let below_legend = if lines.len() < 2 { below_title } else { legend(&root, PLOT_LETTERS, below_title, names)? };
        let mut chart = ChartBuilder::on(&root)
            .margin(8)
            .margin_top(below_legend)
            .margin_right(24)
            .x_label_area_size(44)
            .y_label_area_size(72)
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .x_desc(x_title)
            .y_desc(y_title)
            .x_labels(PLOT_LABELS)
            .x_label_formatter(&axis_label)
            .y_label_formatter(&axis_label)
            .label_style(PLOT_LETTERS)
            .axis_desc_style(PLOT_LETTERS)
            .light_line_style(WHITE)
            .draw()?;
        for line in lines {
            chart.draw_series(LineSeries::new(line.points.iter().copied(), &line.colour))?;
        }
        root.present()?;
    }
    Ok(svg)
}

/// The range of the values, with a margin.
fn span(values: impl Iterator<Item = f64>, more: f64) -> Range<f64> {
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let margin = (more * (high - low)).max(1e-9);
    low - margin..high + margin
}

/// `course`: the same trial with the effects of the model; empty if it has none.
fn step_plot(motor: &MotorParameters, design: &Design, course: &[Point]) -> Plot {
    let output = |point: &Point| if design.law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
    let linear = design.linear_response(motor);
    let points = &design.points;
    let mut drawn = vec![
        Line::new("reference", BLACK, points.iter().map(|point| (point.t_s, point.reference))),
        Line::new("linear", LINEAR, points.iter().zip(linear).map(|(point, value)| (point.t_s, value))),
        Line::new("core", CORE, points.iter().map(|point| (point.t_s, output(point)))),
    ];
    if !course.is_empty() {
        let with_effects = course.iter().map(|point| (point.t_s, output(point)));
        drawn.push(Line::new("with effects", EFFECTS, with_effects));
    }
    let quantity = if design.law.is_position() { "angle, rad" } else { "speed, rad/s" };
    over_time("Step through the profile", quantity, &drawn)
}

/// `course` as for the step.
fn effort_plot(title: &str, y_title: &str, design: &Design, course: &[Point], of: fn(&Point) -> f64) -> Plot {
    let line =
        |label, colour, points: &[Point]| Line::new(label, colour, points.iter().map(|point| (point.t_s, of(point))));
    let mut drawn = vec![line("linear motor", CORE, &design.points)];
    if !course.is_empty() {
        drawn.push(line("with effects", EFFECTS, course));
    }
    over_time(title, y_title, &drawn)
}

/// Gain and phase of the open loop over frequency, one plot each. They cover two decades about the crossover, with the
/// lines for the margins.
fn loop_plots(motor: &MotorParameters, design: &Design) -> [Plot; 2] {
    let points = SampledLoop::new(motor, design.law, &design.sampling).open_loop(&design.held);
    let crossover_hz = design.robustness.margins.crossover_hz;
    let near = |point: &&BodePoint| (0.01..100.0).contains(&(point.omega_rad_per_s / TAU / crossover_hz));
    let near: Vec<&BodePoint> = points.iter().filter(near).collect();
    let hz = |point: &BodePoint| point.omega_rad_per_s / TAU;
    let plot = |title, y_title, label, colour, value: fn(&BodePoint) -> f64, level: (&'static str, f64)| {
        let (Some(first), Some(last)) = (near.first().map(|point| hz(point)), near.last().map(|point| hz(point)))
        else {
            return Err("no frequency about the crossover".into());
        };
        let course = Line::new(label, colour, near.iter().map(|point| (hz(point), value(point))));
        let ends = span(course.points.iter().map(|point| point.1), 0.0);
        let drawn = [
            Line::new(level.0, BLACK, [(first, level.1), (last, level.1)].into_iter()),
            Line::new("crossover", CROSSOVER, [(crossover_hz, ends.start), (crossover_hz, ends.end)].into_iter()),
            course,
        ];
        lines(title, "frequency, Hz", y_title, (first..last).log_scale(), &drawn)
    };
    let decibels = |point: &BodePoint| 20.0 * point.magnitude.log10();
    let degrees = |point: &BodePoint| point.phase_rad.to_degrees();
    [
        plot("Open loop: gain", "gain, dB", "gain", LINEAR, decibels, ("0 dB", 0.0)),
        plot("Open loop: phase", "phase, degrees", "phase", LINEAR, degrees, ("-180 degrees", -180.0)),
    ]
}

/// Eigenvalues of the sampled loop, with the model's parameters and with all of them 30 % off.
fn root_plot(motor: &MotorParameters, design: &Design) -> Plot {
    let roots = |motor: &MotorParameters| {
        eigenvalues(&SampledLoop::new(motor, design.law, &design.sampling).closed(&design.held).a)
    };
    let place = |root: &Complex<f64>| (root.re, root.im);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        let below_title = titled(&root, "Roots of the sampled loop; circles: parameters +-30 %")?;
        let mut chart = ChartBuilder::on(&root)
            .margin(8)
            .margin_top(below_title)
            .margin_right(24)
            .x_label_area_size(44)
            .y_label_area_size(72)
            .build_cartesian_2d(-2.1..2.1, -1.2..1.2)?;
        chart
            .configure_mesh()
            .x_desc("real")
            .y_desc("imaginary")
            .x_label_formatter(&axis_label)
            .y_label_formatter(&axis_label)
            .label_style(PLOT_LETTERS)
            .axis_desc_style(PLOT_LETTERS)
            .light_line_style(WHITE)
            .draw()?;
        let circle = (0..=200).map(|i| (TAU * f64::from(i) / 200.0).sin_cos());
        chart.draw_series(LineSeries::new(circle, &BLACK))?;
        let others = corners(motor).flat_map(|corner| roots(&corner)).collect::<Vec<_>>();
        chart.draw_series(others.iter().map(|root| Circle::new(place(root), 2, CORE)))?;
        chart.draw_series(roots(motor).iter().map(|root| Cross::new(place(root), 4, LINEAR)))?;
        root.present()?;
    }
    Ok(svg)
}

/// A figure of a loop for a page.
type Figure = fn(&LoopWith) -> String;

/// The comparison of current sensors for a page. Each source has a column, since a phone is narrow.
fn current_sensor_table(law: ControlLaw, comparison: &[Comparison]) -> String {
    if comparison.is_empty() {
        return String::new();
    }
    let [peak, load] = current_sensor::units(law);
    let rows: [(&str, Figure); 7] = [
        ("bandwidth, Hz", |found| format!("{:.2}", found.bandwidth_hz)),
        ("settling, ms", |found| format!("{:.1}", 1e3 * found.settling_s)),
        ("modulus", |found| format!("{:.3}", found.modulus)),
        ("modulus, parameters +-30 %", |found| format!("{:.3}", found.worst_modulus)),
        ("delay, ms", |found| format!("{:.1}", 1e3 * found.delay_s)),
        (&format!("peak voltage of a plain step, {peak}"), |found| format!("{:.3}", found.peak_v_per_unit)),
        (&format!("error summed after a load torque, {load}"), |found| format!("{:.3}", found.error_integral_per_nm)),
    ];
    let header: Vec<&str> =
        std::iter::once("current").chain(comparison.iter().map(|with| with.current.name())).collect();
    let rows = rows.into_iter().map(|(title, figure)| {
        let cells = comparison.iter().map(move |with| with.found.as_ref().map_or("-".into(), figure));
        std::iter::once(escaped(title)).chain(cells)
    });
    let said = "What a current sensor would bring: linear loop, exact gains; - where no robust loop is fast enough.";
    format!("<p>{said}</p>\n{}", table(&header, rows))
}

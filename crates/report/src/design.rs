//! A design as half a page of text, and as a self-contained page with plots.

use crate::plot::{AFTER, BEFORE, Mark, OTHERS, Plot, REFERENCE};
use crate::web_page::{Page, Provenance, code, lines, list, table, text as cell};
use host_sim::trial::Point;
use maud::{Markup, html};
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
use plotters::prelude::RGBColor;
use std::f64::consts::TAU;

const LINEAR: RGBColor = AFTER;
const CROSSOVER: RGBColor = BEFORE;
const EFFECTS: RGBColor = OTHERS[2];
const CORE: RGBColor = OTHERS[1];

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
    provenance: Provenance,
) -> String {
    let constants = motor.named().map(|(name, value)| format!("{name} = {}", short(value)));
    let laws: Vec<&str> = designs.iter().map(|design| design.law.title()).collect();
    let asked = designs.first().map_or_else(String::new, asked);
    let verdict = format!("Gains for {}: {asked}.", laws.join(" and "));
    let mut sections = vec![html! { p { "For a motor with " (constants.join(", ")) "." } }];
    sections.extend(designs.iter().map(|design| {
        let course = trials.iter().find(|(law, ..)| *law == design.law).map_or(&[][..], |(.., points)| points);
        design_section(motor, design, course)
    }));
    sections.push(beyond_linear_html(trials, standstill));
    sections.push(html! { section { h2 { "For the console" } (lines(&commands.join("\n"))) } });
    Page { title: "motorbench design".into(), kind: "Design", verdict, sections, folded: Vec::new(), provenance }.html()
}

fn design_section(motor: &MotorParameters, design: &Design, course: &[Point]) -> Markup {
    let [gain, phase] = loop_plots(motor, design);
    let figure = |plot: Plot, caption: &str| plot.figure(&html! { b { (caption) } });
    html! {
        section {
            h2 { (design.law.title()) }
            (figure(step_plot(motor, design, course), "Step through the profile"))
            (design_tables(design))
            div.pairs {
                (figure(effort_plot("voltage, V", design, course, |point| point.u_v), "Voltage on the core"))
                (figure(effort_plot("current, A", design, course, |point| point.i_a), "Current on the core"))
                (figure(gain, "Open loop: gain"))
                (figure(phase, "Open loop: phase"))
            }
            (figure(root_plot(motor, design), "Roots of the sampled loop"))
        }
    }
}

/// The content of [`summary`] as tables that fit a phone.
fn design_tables(design: &Design) -> Markup {
    let gains = design.gains.iter().map(|gain| {
        [code([gain.name.as_str()]), cell(format!("{} {}", gain.value, gain.unit)), cell(format!("{:.6}", gain.held))]
    });
    html! {
        (table(&["gain", "value", "held as"], gains))
        (entries(&said(design)))
        (current_sensor_table(design.law, &design.current_sensor))
    }
}

/// A name and a text in each row.
fn entries(entries: &[Entry]) -> Markup {
    table(&[], entries.iter().map(|(name, text)| [cell(name), cell(text)]))
}

/// The content of [`beyond_linear`].
fn beyond_linear_html(trials: &[TrialWithEffects], standstill: &[Standstill]) -> Markup {
    let trials: Vec<Entry> = trials.iter().map(with_effects).collect();
    let found: Vec<String> = standstill.iter().map(Standstill::text).collect();
    html! {
        @if !trials.is_empty() {
            section {
                h2 { "With what the linear motor lacks" }
                p { "The same steps with the effects of the model, simulated." }
                (entries(&trials))
            }
        }
        @if !found.is_empty() {
            section { h2 { "Near standstill" } p { "Simulated." } (list(found.iter().map(String::as_str))) }
        }
    }
}

/// `course`: the same trial with the effects of the model; empty if it has none.
fn step_plot(motor: &MotorParameters, design: &Design, course: &[Point]) -> Plot {
    let output = |point: &Point| if design.law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
    let linear = design.linear_response(motor);
    let points = &design.points;
    let over_time =
        |points: &[Point], of: &dyn Fn(&Point) -> f64| points.iter().map(|point| [point.t_s, of(point)]).collect();
    let quantity = if design.law.is_position() { "angle, rad" } else { "speed, rad/s" };
    let linear = points.iter().zip(linear).map(|(point, value)| [point.t_s, value]).collect();
    let plot = Plot::new("time, s", quantity)
        .line("reference", REFERENCE, over_time(points, &|point| point.reference))
        .line("linear", LINEAR, linear)
        .line("core", CORE, over_time(points, &output));
    match course.is_empty() {
        true => plot,
        false => plot.line("with effects", EFFECTS, over_time(course, &output)),
    }
}

/// `course` as for the step.
fn effort_plot(y_title: &str, design: &Design, course: &[Point], of: fn(&Point) -> f64) -> Plot {
    let over_time = |points: &[Point]| points.iter().map(|point| [point.t_s, of(point)]).collect();
    let plot = Plot::new("time, s", y_title).line("linear motor", CORE, over_time(&design.points));
    if course.is_empty() { plot } else { plot.line("with effects", EFFECTS, over_time(course)) }
}

/// Gain and phase of the open loop over frequency, one plot each. They cover two decades about the crossover, with the
/// lines for the margins.
fn loop_plots(motor: &MotorParameters, design: &Design) -> [Plot; 2] {
    let points = SampledLoop::new(motor, design.law, &design.sampling).open_loop(&design.held);
    let crossover_hz = design.robustness.margins.crossover_hz;
    let near = |point: &&BodePoint| (0.01..100.0).contains(&(point.omega_rad_per_s / TAU / crossover_hz));
    let near: Vec<&BodePoint> = points.iter().filter(near).collect();
    let hz = |point: &BodePoint| point.omega_rad_per_s / TAU;
    let (low, high) = (0.01 * crossover_hz, 100.0 * crossover_hz);
    let plot = |y_title, label, value: fn(&BodePoint) -> f64, level: (&str, f64)| {
        let course: Vec<[f64; 2]> = near.iter().map(|point| [hz(point), value(point)]).collect();
        let [least, most] = course.iter().fold([level.1; 2], |[least, most], [_, y]| [y.min(least), y.max(most)]);
        let end = near.iter().map(|point| hz(point)).fold(low, f64::max).min(high);
        let begin = near.iter().map(|point| hz(point)).fold(high, f64::min).min(crossover_hz);
        Plot::new("frequency, Hz", y_title)
            .logarithmic()
            .line(level.0, REFERENCE, vec![[begin, level.1], [end, level.1]])
            .with("crossover", CROSSOVER, Mark::Upright, vec![[crossover_hz, least], [crossover_hz, most]])
            .line(label, LINEAR, course)
    };
    let decibels = |point: &BodePoint| 20.0 * point.magnitude.log10();
    let degrees = |point: &BodePoint| point.phase_rad.to_degrees();
    [
        plot("gain, dB", "gain", decibels, ("0 dB", 0.0)),
        plot("phase, degrees", "phase", degrees, ("-180 degrees", -180.0)),
    ]
}

/// Eigenvalues of the sampled loop, with the model's parameters and with all of them 30 % off.
fn root_plot(motor: &MotorParameters, design: &Design) -> Plot {
    let roots = |motor: &MotorParameters| {
        eigenvalues(&SampledLoop::new(motor, design.law, &design.sampling).closed(&design.held).a)
    };
    let place = |root: &Complex<f64>| [root.re, root.im];
    let circle = (0..=200).map(|step| (TAU * f64::from(step) / 200.0).sin_cos()).map(|(x, y)| [x, y]).collect();
    let others = corners(motor).flat_map(|corner| roots(&corner)).map(|root| place(&root)).collect();
    let own = roots(motor).iter().map(place).collect();
    Plot::new("real", "imaginary")
        .round(1.15)
        .with("unit circle", REFERENCE, Mark::Curve, circle)
        .dots("parameters +-30 %", CORE, others, Vec::new())
        .dots("as designed", LINEAR, own, Vec::new())
}

/// A figure of a loop for a page.
type Figure = fn(&LoopWith) -> String;

/// The comparison of current sensors for a page. Each source has a column, since a phone is narrow.
fn current_sensor_table(law: ControlLaw, comparison: &[Comparison]) -> Markup {
    if comparison.is_empty() {
        return Markup::default();
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
        let cells = comparison.iter().map(move |with| with.found.as_ref().map_or("-".into(), figure)).map(cell);
        std::iter::once(cell(title)).chain(cells)
    });
    let said = "What a current sensor would bring: linear loop, exact gains; - where no robust loop is fast enough.";
    html! { p { (said) } (table(&header, rows)) }
}

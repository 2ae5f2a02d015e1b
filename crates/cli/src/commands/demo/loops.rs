//! The speed loop on the simulated motor: designed before the diagnosis, and after it.

use crate::commands::Failure;
use crate::terminal_plot::{chart, range, side_by_side};
use host_sim::figures::{Figures, step_figures};
use host_sim::trial::{Point, Trial};
use maud::{Markup, html};
use motorbench_core::message::Mode;
use motorbench_core::settings::Settings;
use motorbench_design::compensation::compensation;
use motorbench_design::law::ControlLaw;
use motorbench_design::specification::{Specification, Speed};
use motorbench_design::{Bench, Design, design};
use motorbench_diagnosis::diagnose::Diagnosis;
use motorbench_model::Model;
use motorbench_model::motor::MotorParameters;
use motorbench_report::panels::{Panel, figures};
use motorbench_report::web_page::{lines, number, table, text};
use motorbench_text::terminal_text::{fixed, short};
use std::ops::RangeInclusive;

/// Bandwidth of the speed loop, its references, and the time for each.
const BANDWIDTH_HZ: f64 = 5.0;
const REFERENCES_RAD_PER_S: [f64; 6] = [5.0, -5.0, 5.0, 60.0, -60.0, 0.0];
const HOLD_S: f64 = 0.8;
/// Number of slow references, which come first.
const SLOW: usize = 3;
/// Rows of the picture below its title, where a terminal has room for them. A picture with fewer rows shows nothing.
const PICTURE_ROWS: RangeInclusive<u16> = 4..=8;

/// A loop, and how it followed.
struct TriedLoop {
    name: &'static str,
    /// Root mean square errors of the true speed: for the slow references, and for all.
    slow_rms: f64,
    all_rms: f64,
    /// Of each reference.
    figures: Vec<Figures>,
    points: Vec<Point>,
}

impl TriedLoop {
    fn slow_points(&self) -> &[Point] {
        &self.points[..self.points.len() * SLOW / REFERENCES_RAD_PER_S.len()]
    }

    /// Reference and speed of these loops, over time.
    fn slow_courses(&self) -> [Vec<(f64, f64)>; 2] {
        let course =
            |value: fn(&Point) -> f64| self.slow_points().iter().map(|point| (point.t_s, value(point))).collect();
        [course(|point| point.reference), course(|point| point.omega_rad_per_s)]
    }

    fn json(&self) -> serde_json::Value {
        let Self { name, slow_rms, all_rms, figures, .. } = self;
        serde_json::json!({
            "design": name, "standstill_rms_rad_per_s": slow_rms, "all_rms_rad_per_s": all_rms, "figures": figures
        })
    }
}

/// Loops on the motor with its effects, and the console lines of the last one.
pub(super) struct Loops {
    /// The first loop before the diagnosis, the last one after it.
    attempts: [TriedLoop; 3],
    pub(super) commands: Vec<String>,
}

impl Loops {
    /// Three designs: from the data sheet, from the linear motor found, and with friction and drop compensated.
    pub(super) fn compared(truth: &Model, nominal: &MotorParameters, diagnosis: &Diagnosis) -> Result<Self, Failure> {
        let found = &diagnosis.model;
        let before = designed(nominal)?.settings.all;
        let mut list = designed(&found.motor)?.settings;
        let without = list.all;
        let motor = &found.motor;
        let losses = compensation(&found.dry_losses(), motor.resistance_ohm, motor.torque_constant_nm_per_a);
        for setting in losses.map_err(Failure::input)? {
            list.set(setting.param, setting.value).map_err(Failure::input)?;
        }
        let attempts =
            [("designed from the data sheet", before), ("from what was found", without), ("and compensated", list.all)];
        let [before, without, after] = attempts.map(|(name, settings)| tracking(name, truth, settings));
        Ok(Self { attempts: [before?, without?, after?], commands: list.commands() })
    }

    /// Text in so many lines of a terminal, about standstill. The first loop is beside the last.
    pub(super) fn picture(&self, lines: u16) -> String {
        let [before, _, after] = &self.attempts;
        let courses = [before, after].map(TriedLoop::slow_courses);
        let (end_s, speeds) = (SLOW as f64 * HOLD_S, range(courses.iter().flatten().map(Vec::as_slice)));
        let plot = |title: &str, attempt: &TriedLoop, courses| {
            (format!("{title}: {} rad/s", short(attempt.slow_rms)), chart(courses, [0.0, end_s], speeds))
        };
        let [first, last] = courses.each_ref().map(|courses| courses.each_ref().map(Vec::as_slice));
        let plots = [plot("before, by the data sheet", before, first), plot("after, by what was found", after, last)];
        let [before_rms, after_rms] = [before, after].map(|attempt| short(attempt.all_rms));
        format!("Its speed loop of {BANDWIDTH_HZ} Hz, {end_s:.1} s about standstill (dots: reference), rms error:\n")
            + &side_by_side(plots, lines.saturating_sub(2).clamp(*PICTURE_ROWS.start(), *PICTURE_ROWS.end()))
            + &format!("the same with all references, to 60 rad/s: {before_rms} before, {after_rms} after\n")
    }

    /// The figures of each reference before and after, those that became worse too.
    fn figures_table(&self) -> Markup {
        let [before, _, after] = &self.attempts;
        let or_dash = |value: Option<f64>, digits| value.map_or("-".into(), |value| fixed(value, digits));
        let row = |name: &str, figures: &Figures| {
            let rest = [
                or_dash(figures.rise_s, 3),
                or_dash(figures.settling_s, 3),
                or_dash(figures.overshoot_percent, 1),
                or_dash(figures.steady_error, 3),
                fixed(figures.peak_a, 3),
            ];
            [text(short(figures.to)), text(name)].into_iter().chain(rest.map(number)).collect::<Vec<_>>()
        };
        let pairs = before.figures.iter().zip(&after.figures);
        let rows = pairs.flat_map(|(before, after)| [row("before", before), row("after", after)]);
        table(&["to, rad/s", "loop", "rise, s", "settled, s", "over, %", "error, rad/s", "peak, A"], rows)
    }

    /// As JSON.
    pub(super) fn json(&self) -> Vec<serde_json::Value> {
        self.attempts.iter().map(TriedLoop::json).collect()
    }

    /// For the page: all speeds in one plot, the slow part enlarged, the table, and the gains.
    pub(super) fn section(&self) -> Markup {
        let panel = |title: &str, of: fn(&TriedLoop) -> &[Point]| {
            let first = of(&self.attempts[0]).iter();
            let reference = Panel::new(title).line("reference", first.map(|point| point.reference).collect());
            self.attempts.iter().fold(reference, |panel, attempt| {
                let speeds = of(attempt).iter().map(|point| point.omega_rad_per_s);
                panel.line(attempt.name, speeds.collect())
            })
        };
        let interval_s = HOLD_S * REFERENCES_RAD_PER_S.len() as f64 / self.attempts[0].points.len() as f64;
        let plots =
            [panel("speed, rad/s", |of| &of.points), panel("speed about standstill, rad/s", TriedLoop::slow_points)]
                .map(|panel| figures(interval_s, &[&panel]));
        let rows = self.attempts.iter().map(|TriedLoop { name, slow_rms, all_rms, .. }| {
            let [slow_rms, all_rms] = [slow_rms, all_rms].map(|rms| format!("{} rad/s", short(*rms)));
            [text(name), text(slow_rms), text(all_rms)]
        });
        let [all, slow] = plots;
        html! {
            section {
                h2 { "The speed loop before and after" }
                p { (BANDWIDTH_HZ) " Hz, on the motor as it is." }
                (slow) (all)
                (table(&["speed error, rms", "about standstill", "in all"], rows))
                p { "Each reference, before by the data sheet and after by what was found, compensated:" }
                (self.figures_table())
                h3 { "For the board's console" }
                (lines(&self.commands.join("\n")))
            }
        }
    }
}

fn designed(motor: &MotorParameters) -> Result<Design, Failure> {
    let specification =
        Specification { speed: Speed::BandwidthHz(BANDWIDTH_HZ), overshoot_percent: 10.0, current_limit_a: 1.5 };
    design(motor, &Bench::default(), ControlLaw::SpeedPid, &specification).map_err(Failure::input)
}

fn tracking(name: &'static str, truth: &Model, settings: Settings) -> Result<TriedLoop, Failure> {
    let refused = |error| Failure::input(format!("the core refuses the designed settings: {error:?}"));
    let mut trial = Trial::of_model(truth, settings).map_err(refused)?;
    trial.enter(Mode::SpeedPid);
    let points: Vec<Vec<Point>> = REFERENCES_RAD_PER_S.iter().map(|speed| trial.follow(*speed, HOLD_S)).collect();
    let rms = |points: &[Vec<Point>]| {
        let squares = points.iter().flatten().map(|point| (point.omega_rad_per_s - point.reference).powi(2));
        (squares.sum::<f64>() / points.iter().flatten().count() as f64).sqrt()
    };
    let figures = points.iter().zip(REFERENCES_RAD_PER_S);
    let figures = figures.map(|(points, to)| step_figures(points, |point| point.omega_rad_per_s, to)).collect();
    Ok(TriedLoop { name, slow_rms: rms(&points[..SLOW]), all_rms: rms(&points), figures, points: points.concat() })
}

//! Figures of merit: the response of a loop to a step of the reference, or to any other course.

use crate::trial::Point;
use serde::Serialize;

/// Band of the settling time, as a share of the step.
const SETTLED: f64 = 0.02;
/// Part of the largest error after a disturbance within which the loop has recovered.
const RECOVERED: f64 = 0.1;
/// Share of the stretch whose mean error is the steady error.
const LAST_PART: f64 = 0.1;

/// The course of the largest step within a sequence; it has its own figures besides those of the whole sequence.
pub const JUMP: &str = "jump";

/// Response of a loop to one reference. Speeds in rad/s, angles in rad. Values that only a step has are `null` for
/// other courses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Time of the change of the reference, or of the load or fault.
    pub time_s: f64,
    /// Its course: step, ramp, sine, points, sequence; [`JUMP`]; load or fault if that disturbed the loop after a step.
    pub course: &'static str,
    /// Start and end value of the controlled quantity.
    pub from: f64,
    /// See `from`.
    pub to: f64,
    /// Time from 10 to 90 % of the step; `null` if it was not reached.
    pub rise_s: Option<f64>,
    /// Time until it stays within 2 % of the step; `null` if it does not.
    pub settling_s: Option<f64>,
    /// Beyond the end, in percent of the step.
    pub overshoot_percent: Option<f64>,
    /// Mean error over the last tenth.
    pub steady_error: Option<f64>,
    /// Root mean square of the error against the reference after the core's profile.
    pub tracking_rms: f64,
    /// Integral of the error's magnitude: for a step against its end, otherwise against the profile.
    pub iae: f64,
    /// Root mean square of the commanded voltage; with a fault of the supply the actual voltage differs.
    #[serde(rename = "effort_V")]
    pub effort_v: f64,
    /// After a load or a fault: largest magnitude of the error, against the reference where that is a step. `settling_s` is
    /// then the time until the error stays within a tenth of it.
    pub largest_error: Option<f64>,
    /// Largest current.
    #[serde(rename = "peak_A")]
    pub peak_a: f64,
}

/// Figures of the points from a change of the reference to `to` until the next. `of`: the controlled quantity. If it is
/// there already, there is no step, and no figures of a step.
///
/// # Panics
/// If there are fewer than two points.
pub fn step_figures(points: &[Point], of: impl Fn(&Point) -> f64, to: f64) -> Figures {
    let general = tracking_figures(points, &of, "step");
    let (start_s, from, period_s) = (general.time_s, general.from, points[1].t_s - points[0].t_s);
    let size = to - from;
    let part = |point: &Point| (of(point) - from) / size;
    let reached = |share: f64| points.iter().find(|point| part(point) >= share).map(|point| point.t_s - start_s);
    let last_out = points.iter().rposition(|point| (part(point) - 1.0).abs() > SETTLED);
    let last = &points[points.len() - ((points.len() as f64 * LAST_PART) as usize).max(1)..];
    let overshoot_percent = 100.0 * points.iter().map(|point| part(point) - 1.0).fold(0.0, f64::max);
    let is_step = size != 0.0;
    Figures {
        to,
        rise_s: reached(0.1).zip(reached(0.9)).map(|(low, high)| high - low),
        settling_s: match last_out {
            None => is_step.then_some(0.0),
            Some(index) => points.get(index + 1).map(|point| point.t_s - start_s),
        },
        overshoot_percent: is_step.then_some(overshoot_percent),
        steady_error: Some(last.iter().map(|point| to - of(point)).sum::<f64>() / last.len() as f64),
        iae: points.iter().map(|point| (to - of(point)).abs() * period_s).sum(),
        ..general
    }
}

/// Figures of the points from a disturbance on, while the reference stays at `to`.
///
/// # Panics
/// If there are fewer than two points.
pub fn disturbance_figures(points: &[Point], of: impl Fn(&Point) -> f64, to: f64, cause: &'static str) -> Figures {
    let step = step_figures(points, &of, to);
    let error = |point: &Point| (to - of(point)).abs();
    let largest = points.iter().map(error).fold(0.0, f64::max);
    let last_out = points.iter().rposition(|point| error(point) > RECOVERED * largest);
    let settled = points.get(last_out.map_or(0, |index| index + 1));
    Figures {
        course: cause,
        rise_s: None,
        overshoot_percent: None,
        settling_s: settled.map(|point| point.t_s - step.time_s),
        largest_error: Some(largest),
        ..step
    }
}

/// Figures that any course has.
///
/// # Panics
/// If there are fewer than two points.
pub fn tracking_figures(points: &[Point], of: impl Fn(&Point) -> f64, course: &'static str) -> Figures {
    let period_s = points[1].t_s - points[0].t_s;
    let rms = |value: &dyn Fn(&Point) -> f64| {
        (points.iter().map(|point| value(point).powi(2)).sum::<f64>() / points.len() as f64).sqrt()
    };
    let error = |point: &Point| point.reference - of(point);
    Figures {
        time_s: points[0].t_s,
        course,
        from: of(&points[0]),
        to: points[points.len() - 1].reference,
        rise_s: None,
        settling_s: None,
        overshoot_percent: None,
        steady_error: None,
        tracking_rms: rms(&error),
        iae: points.iter().map(|point| error(point).abs() * period_s).sum(),
        effort_v: rms(&|point| point.u_v),
        largest_error: None,
        peak_a: points.iter().map(|point| point.i_a.abs()).fold(0.0, f64::max),
    }
}

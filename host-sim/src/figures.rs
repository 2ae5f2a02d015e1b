//! Figures of merit of a step of the reference.

use crate::design::trial::Point;
use serde::Serialize;

/// Band of the settling time, as a share of the step.
const SETTLED: f64 = 0.02;
/// Share of the stretch whose mean error is the steady error.
const LAST_PART: f64 = 0.1;

/// What a loop made of one step. Speeds in rad/s, angles in rad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// When the reference changed.
    pub time_s: f64,
    /// Where the step began, and where it was to end.
    pub from: f64,
    /// See `from`.
    pub to: f64,
    /// From 10 to 90 % of the step; `null` when it was not reached.
    pub rise_s: Option<f64>,
    /// Until it stays within 2 % of the step; `null` when it does not.
    pub settling_s: Option<f64>,
    /// Beyond the end, in percent of the step.
    pub overshoot_percent: f64,
    /// Mean error over the last tenth.
    pub steady_error: f64,
    /// Integral of the error's magnitude.
    pub iae: f64,
    /// Root mean square of the voltage.
    #[serde(rename = "effort_V")]
    pub effort_v: f64,
    /// Largest current.
    #[serde(rename = "peak_A")]
    pub peak_a: f64,
}

/// Figures of the points from a change of the reference to `to` until the next. `of`: the controlled quantity.
///
/// # Panics
/// If there are fewer than two points.
pub fn step_figures(points: &[Point], of: impl Fn(&Point) -> f64, to: f64) -> Figures {
    let (start_s, period_s) = (points[0].t_s, points[1].t_s - points[0].t_s);
    let from = of(&points[0]);
    let size = to - from;
    let part = |point: &Point| if size == 0.0 { 1.0 } else { (of(point) - from) / size };
    let reached = |share: f64| points.iter().find(|point| part(point) >= share).map(|point| point.t_s - start_s);
    let last_out = points.iter().rposition(|point| (part(point) - 1.0).abs() > SETTLED);
    let last = &points[points.len() - ((points.len() as f64 * LAST_PART) as usize).max(1)..];
    let mean_square = points.iter().map(|point| point.u_v * point.u_v).sum::<f64>() / points.len() as f64;
    Figures {
        time_s: start_s,
        from,
        to,
        rise_s: reached(0.1).zip(reached(0.9)).map(|(low, high)| high - low),
        settling_s: match last_out {
            None => Some(0.0),
            Some(index) => points.get(index + 1).map(|point| point.t_s - start_s),
        },
        overshoot_percent: 100.0 * points.iter().map(|point| part(point) - 1.0).fold(0.0, f64::max),
        steady_error: last.iter().map(|point| to - of(point)).sum::<f64>() / last.len() as f64,
        iae: points.iter().map(|point| (to - of(point)).abs() * period_s).sum(),
        effort_v: mean_square.sqrt(),
        peak_a: points.iter().map(|point| point.i_a.abs()).fold(0.0, f64::max),
    }
}

//! Measures the winding with the rotor held: a line of the voltage over the current, at each position.

use super::window::{Settled, Window};
use super::{Driver, HeldPosition, Operator};
use motorbench_core::settings::Param;
use motorbench_diagnosis::steady_state::{Errors, Line};
use motorbench_link::board::Board;
use motorbench_link::record::Ended;
use motorbench_report::diagnosis_text::estimate;

/// Windows of a held rotor: only the current has to settle.
const HELD_WINDOW_S: f64 = 0.05;
/// Largest current of the winding test as a share of the smallest current limit, and number of its voltage steps.
const HELD_SHARE: f64 = 0.8;
const HELD_STEPS: f64 = 8.0;
/// Smallest current of the line as a share of the largest. Below it friction of the hand and the kink of the drop
/// disturb.
const HELD_LEAST_SHARE: f64 = 0.3;
/// A held rotor may turn by this angle.
const HELD_YIELDS_REV: f64 = 0.01;
/// Smallest error of a mean current. The steps of the converter make means that scatter less than their error.
const LEAST_CURRENT_ERROR_A: f64 = 1e-4;
/// Fewest points of a line with an error.
const FEWEST_POINTS: usize = 4;

/// Result of a voltage staircase with a held rotor.
enum Held {
    /// Points, and the counts of the rotor's position.
    Line(Vec<Window>, i32),
    Turned,
}

impl<B: Board, P: Operator> Driver<'_, B, P> {
    /// Asks until the rotor is held; `None` if the operator refuses.
    pub(super) fn position(&mut self, request: &str) -> Result<Option<HeldPosition>, Ended> {
        let mut request = request.to_owned();
        loop {
            if !self.is_done(&request)? {
                return Ok(None);
            }
            match self.held_points()? {
                Held::Line(points, counts) => match self.fitted(&points, counts) {
                    Some(position) => {
                        self.person.hears(&format!(
                            "{:6.1} deg: {} ohm, {:.2} V at no current; let go",
                            position.angle_deg,
                            estimate(&position.resistance_ohm),
                            position.drop_V
                        ));
                        return Ok(Some(position));
                    }
                    None => request = "too little current flowed for a line: check the leads, then press Enter".into(),
                },
                Held::Turned => request = "the rotor turned: hold it tighter, then press Enter".into(),
            }
        }
    }

    /// Raises the voltage step by step until enough current flows; one point a step.
    fn held_points(&mut self) -> Result<Held, Ended> {
        // A held motor is expected here.
        self.set(Param::TripStall, 0.0)?;
        self.arm()?;
        let most_a = self.held_current_a();
        let resistance = self.motor.resistance_ohm.unwrap_or(f64::from(self.settings.get(Param::Resistance)));
        let step_v = most_a * resistance / HELD_STEPS;
        let limit_v = f64::from(self.settings.get(Param::VoltageLimit));
        let yields = HELD_YIELDS_REV * f64::from(self.settings.get(Param::CountsPerRev));
        let (mut points, mut start, mut turned) = (Vec::new(), None, false);
        let mut voltage_v = step_v;
        while voltage_v <= limit_v && !turned {
            self.board.command(&format!("ref {voltage_v:.3}"))?;
            let (Settled::Steady(window) | Settled::Drifting(_, window)) = self.settle(HELD_WINDOW_S, HELD_WINDOW_S)?;
            let start = *start.get_or_insert(window.counts);
            turned = f64::from(window.counts.wrapping_sub(start).unsigned_abs()) > yields;
            let enough = window.reading.i_A >= most_a;
            points.push(window);
            if enough {
                break;
            }
            voltage_v += step_v;
        }
        self.board.command("disarm")?;
        self.set(Param::TripStall, self.settings.get(Param::TripStall))?;
        let counts = start.unwrap_or(0);
        Ok(if turned { Held::Turned } else { Held::Line(points, counts) })
    }

    /// Limits that neither reduce the voltage nor trip.
    pub(super) fn held_current_a(&self) -> f64 {
        let limits =
            [Param::TripContinuous, Param::TripPeak, Param::CurrentLimit].map(|param| self.settings.get(param));
        HELD_SHARE * f64::from(limits.into_iter().filter(|limit| *limit > 0.0).fold(f32::INFINITY, f32::min))
    }

    /// The line through the points of one position.
    pub(super) fn fitted(&self, points: &[Window], counts: i32) -> Option<HeldPosition> {
        let most_a = points.iter().map(|point| point.reading.i_A).fold(0.0, f64::max);
        let points: Vec<&Window> =
            points.iter().filter(|point| point.reading.i_A > HELD_LEAST_SHARE * most_a).collect();
        if points.len() < FEWEST_POINTS {
            return None;
        }
        let column = |of: &dyn Fn(&Window) -> f64| points.iter().map(|point| of(point)).collect::<Vec<f64>>();
        let resistance = self.motor.resistance_ohm.unwrap_or(f64::from(self.settings.get(Param::Resistance)));
        let errors = column(&|point| resistance * point.current_error_a.max(LEAST_CURRENT_ERROR_A));
        let (constant, current) = (vec![1.0; points.len()], column(&|point| point.reading.i_A));
        let line = Line::new(&[&constant, &current], &column(&|point| point.reading.u_V), &Errors::AtLeast(errors))?;
        let rev = f64::from(self.settings.get(Param::CountsPerRev));
        Some(HeldPosition {
            angle_deg: 360.0 * (f64::from(counts) / rev).rem_euclid(1.0),
            resistance_ohm: line.estimate(1),
            drop_V: line.values[0],
        })
    }
}

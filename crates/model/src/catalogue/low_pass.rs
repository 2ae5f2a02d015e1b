//! A first-order low-pass in front of a reading: the law of [`current_lag`](super::current_lag) and
//! [`speed_lag`](super::speed_lag).
//!
//! A capacitor follows the quantity itself, also between two readings. A program filters its readings: each one
//! (exponential smoothing), or the mean of each two (bilinear transform, as `butter(1, …)` of MATLAB and SciPy).

use super::{Parameter, Scales, Unit};
use crate::between_rows::Bulge;

/// Its constants.
pub(super) static PARAMETERS: [Parameter; 3] = [
    Parameter::within("time_constant_s", Unit::Second, 0.0, 1.0),
    Parameter::choice("in_program"),
    Parameter::choice("bilinear"),
];
/// Its laws in one line.
pub(super) const LAW: &str = "first-order lag with time_constant_s; of the readings alone with in_program = 1, as butter(1) filters with bilinear = 1";

/// The capacitor, the program, and the program by the bilinear transform: in_program and bilinear.
const LAWS: [[f64; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
/// Least time constant, as a share of the time between two readings.
const LEAST_OF_STEP: f64 = 1e-6;
/// Greatest angle of the corner frequency: the bilinear transform needs less than a quarter of a turn.
const WIDEST_CORNER_RAD: f64 = 1.5;
/// The turn of a program: it filters last. A capacitor has a turn among its sensor's effects.
const PROGRAM: i8 = 2;

/// Values to start from.
pub(super) fn starts(scales: &Scales) -> Vec<Vec<f64>> {
    [0.002_f64, 0.008].map(|time_constant_s| vec![time_constant_s.max(0.5 * scales.interval_s), 0.0, 0.0]).to_vec()
}

/// The same time constant by the other laws.
pub(super) fn other_laws(values: &[f64]) -> Vec<Vec<f64>> {
    let laws = LAWS.into_iter().filter(|law| law[..] != values[1..]);
    laws.map(|law| vec![values[0], law[0], law[1]]).collect()
}

/// Its turn: that of a program, or `of_sensor`.
pub(super) fn turn(values: &[f64], of_sensor: i8) -> i8 {
    if values[1] > 0.0 { PROGRAM } else { of_sensor }
}

/// Its memory: output and input at the last reading.
pub(super) const STATES: usize = 2;

/// Filters a reading, `step_s` after the last one. `bulge`: the course of the quantity between the two.
pub(super) fn pass(values: &[f64], step_s: f64, bulge: Bulge, state: &mut [f64], reading: &mut f64) {
    let [time_constant_s, in_program, bilinear] = [values[0], values[1], values[2]];
    let (passed, last, now) = (state[0], state[1], *reading);
    let steps = step_s / time_constant_s.max(LEAST_OF_STEP * step_s);
    let left = (-steps).exp();
    *reading = if step_s == 0.0 {
        now
    } else if in_program > 0.0 && bilinear > 0.0 {
        let mean = 0.5 * (last + now);
        mean + left_by_bilinear(steps) * (passed - mean)
    } else if in_program > 0.0 {
        now + left * (passed - now)
    } else {
        let rise = (now - last) / steps;
        now - rise + left * (passed - last + rise) + bulge.in_a_low_pass(steps)
    };
    state.copy_from_slice(&[*reading, now]);
}

/// Share of the output before that is left, for a step of so many time constants. The corner frequency is kept in place.
fn left_by_bilinear(steps: f64) -> f64 {
    let corner = (0.5 * steps).min(WIDEST_CORNER_RAD).tan();
    (1.0 - corner) / (1.0 + corner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the differential equation in small steps, with a current that settles between two readings and goes on rising.
    #[test]
    fn the_capacitor_follows_what_it_is_given() {
        let (interval_s, time_constant_s, winding_s) = (1e-3, 4e-3, 0.3e-3);
        let current_a = |t_s: f64| 1.0 + 300.0 * t_s - 0.7 * (-t_s / winding_s).exp();
        let parts = 100_000;
        let part_s = interval_s / f64::from(parts);
        let (mut filtered_a, mut sum_a) = (0.2, 0.0);
        for part in 0..parts {
            let now_a = current_a((f64::from(part) + 0.5) * part_s);
            sum_a += now_a;
            filtered_a += part_s / time_constant_s * (now_a - filtered_a);
        }
        let [start_a, end_a] = [0.0, interval_s].map(current_a);
        let bulge = Bulge::new(sum_a / f64::from(parts) - 0.5 * (start_a + end_a), interval_s, winding_s);
        let mut passed_a = end_a;
        pass(&[time_constant_s, 0.0, 0.0], interval_s, bulge, &mut [0.2, start_a], &mut passed_a);
        assert!((passed_a - filtered_a).abs() < 1e-6, "{passed_a} {filtered_a}");
    }

    /// What SciPy 1.17 gives: `butter(1, 1 / (2 * pi * 4e-3), fs=1e3)`, filtering 1, 2, -1, 0.5 from rest at nothing.
    #[test]
    fn bilinear_is_butterworth() {
        let filtered = [0.1116284486183253, 0.421591973391433, 0.43909710613051034, 0.2852514243210577];
        let mut state = [0.0; STATES];
        for (mut passed, filtered) in [1.0, 2.0, -1.0, 0.5].into_iter().zip(filtered) {
            pass(&[4e-3, 1.0, 1.0], 1e-3, Bulge::NONE, &mut state, &mut passed);
            assert!((passed - filtered).abs() < 1e-9, "{passed} {filtered}");
        }
    }
}

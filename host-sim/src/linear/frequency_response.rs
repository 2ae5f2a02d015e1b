//! Bode data, bandwidth and stability margins.

use nalgebra::Complex;
use std::f64::consts::{PI, TAU};

/// One frequency of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodePoint {
    /// Angular frequency.
    pub omega_rad_per_s: f64,
    /// Gain, as a ratio in the units of the response.
    pub magnitude: f64,
    /// Phase, continuous from point to point.
    pub phase_rad: f64,
}

/// `count` (at least two) frequencies from `from` to `to`, evenly spaced in their logarithm.
pub fn log_spaced(from: f64, to: f64, count: usize) -> impl Iterator<Item = f64> {
    let ratio = (to / from).ln() / (count - 1) as f64;
    (0..count).map(move |i| from * (ratio * i as f64).exp())
}

/// Bode data of a response at the given increasing frequencies, dense enough that the phase turns by less than pi from
/// one to the next.
pub fn bode(response: impl Fn(f64) -> Complex<f64>, omegas_rad_per_s: impl IntoIterator<Item = f64>) -> Vec<BodePoint> {
    let mut points: Vec<BodePoint> = Vec::new();
    for omega_rad_per_s in omegas_rad_per_s {
        let (magnitude, mut phase_rad) = response(omega_rad_per_s).to_polar();
        if let Some(last) = points.last() {
            phase_rad += TAU * ((last.phase_rad - phase_rad) / TAU).round();
        }
        points.push(BodePoint { omega_rad_per_s, magnitude, phase_rad });
    }
    points
}

/// Where the gain first falls below `1/sqrt(2)` of that of the first point, in rad/s; `None` if it does not.
pub fn bandwidth_rad_per_s(points: &[BodePoint]) -> Option<f64> {
    let limit = points.first()?.magnitude * 0.5_f64.sqrt();
    let above = points.windows(2).find(|pair| pair[1].magnitude < limit)?;
    Some(crossing(above, |point| point.magnitude.ln(), limit.ln()).omega_rad_per_s)
}

/// How far a loop is from instability. Of several crossings the closest counts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Margins {
    /// Factor by which the loop gain may grow; infinite if the phase never reaches -180 degrees above it.
    pub gain: f64,
    /// Factor below one to which the loop gain may fall; zero if to nothing.
    pub gain_reduction: f64,
    /// Phase lag it may take on at a gain of one, in degrees.
    pub phase_deg: f64,
    /// Smallest distance of the loop's frequency response from -1: the inverse of the peak sensitivity.
    pub modulus: f64,
    /// Further delay it may take on, in seconds.
    pub delay_s: f64,
    /// Highest frequency with a loop gain of one, in hertz.
    #[serde(rename = "crossover_Hz")]
    pub crossover_hz: f64,
}

impl Margins {
    /// Of a stable closed loop, from its open-loop response (negative feedback: `1 + L`).
    pub fn of(open_loop: &[BodePoint]) -> Self {
        let mut margins = Self {
            gain: f64::INFINITY,
            gain_reduction: 0.0,
            phase_deg: f64::INFINITY,
            modulus: f64::INFINITY,
            delay_s: f64::INFINITY,
            crossover_hz: 0.0,
        };
        for point in open_loop {
            let distance = (1.0 + Complex::from_polar(point.magnitude, point.phase_rad)).norm();
            margins.modulus = margins.modulus.min(distance);
        }
        for pair in open_loop.windows(2) {
            margins.gain_crossing(pair);
            margins.phase_crossing(pair);
        }
        margins
    }

    /// A gain of one between two points.
    fn gain_crossing(&mut self, pair: &[BodePoint]) {
        if (pair[0].magnitude > 1.0) == (pair[1].magnitude > 1.0) {
            return;
        }
        let point = crossing(pair, |point| point.magnitude.ln(), 0.0);
        self.crossover_hz = self.crossover_hz.max(point.omega_rad_per_s / TAU);
        let lag_rad = (point.phase_rad + PI).rem_euclid(TAU);
        self.delay_s = self.delay_s.min(lag_rad / point.omega_rad_per_s);
        // A lead of less than the lag is as dangerous.
        self.phase_deg = self.phase_deg.min(lag_rad.min(TAU - lag_rad).to_degrees());
    }

    /// A phase of -180 degrees between two points.
    fn phase_crossing(&mut self, pair: &[BodePoint]) {
        let turns = |point: &BodePoint| (point.phase_rad + PI) / TAU;
        let (from, to) = (turns(&pair[0]), turns(&pair[1]));
        if from.floor() == to.floor() {
            return;
        }
        let point = crossing(pair, turns, from.floor().max(to.floor()));
        if point.magnitude < 1.0 {
            self.gain = self.gain.min(1.0 / point.magnitude);
        } else {
            self.gain_reduction = self.gain_reduction.max(1.0 / point.magnitude);
        }
    }
}

/// The point between two at which `quantity` is `value`, interpolated in the logarithm of the frequency.
fn crossing(pair: &[BodePoint], quantity: impl Fn(&BodePoint) -> f64, value: f64) -> BodePoint {
    let (from, to) = (quantity(&pair[0]), quantity(&pair[1]));
    let part = (value - from) / (to - from);
    let between = |from: f64, to: f64| from + part * (to - from);
    BodePoint {
        omega_rad_per_s: between(pair[0].omega_rad_per_s.ln(), pair[1].omega_rad_per_s.ln()).exp(),
        magnitude: between(pair[0].magnitude.ln(), pair[1].magnitude.ln()).exp(),
        phase_rad: between(pair[0].phase_rad, pair[1].phase_rad),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `L = 2 / (s (s + 1)^2)`: phase -180 degrees at 1 rad/s, where the gain is one: on the verge of instability.
    /// With half the gain the gain margin is 2.
    #[test]
    fn margins_of_a_textbook_loop() {
        let open_loop = |omega: f64| {
            let s = Complex::new(0.0, omega);
            1.0 / (s * (s + 1.0) * (s + 1.0))
        };
        let margins = Margins::of(&bode(open_loop, log_spaced(1e-2, 1e2, 2000)));
        assert!((margins.gain - 2.0).abs() < 1e-3, "{margins:?}");
        assert_eq!(margins.gain_reduction, 0.0);
        // |L| = 1 where w (w^2 + 1) = 1: w = 0.6823; phase -90 - 2 atan w = -158.6 degrees.
        assert!((margins.crossover_hz * TAU - 0.6823).abs() < 1e-3);
        assert!((margins.phase_deg - 21.39).abs() < 0.05, "{margins:?}");
        assert!((margins.delay_s - 21.39_f64.to_radians() / 0.6823).abs() < 1e-3);
        assert!(margins.modulus > 0.2 && margins.modulus < 0.5, "{margins:?}");
    }

    #[test]
    fn bandwidth_of_a_first_order_lag_is_its_corner() {
        let points = bode(|omega| 3.0 / Complex::new(1.0, omega / 20.0), log_spaced(0.1, 1e3, 500));
        assert!((bandwidth_rad_per_s(&points).unwrap() - 20.0).abs() < 0.01);
    }
}

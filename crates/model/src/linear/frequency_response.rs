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

/// A response at one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Value {
    omega_rad_per_s: f64,
    response: Complex<f64>,
}

/// A response that is judged, at frequencies close enough together that nothing happens between two of them unseen.
#[derive(Clone, Debug)]
pub struct Sweep<F> {
    response: F,
    values: Vec<Value>,
}

/// Frequencies of a sweep before it is refined.
const COARSE: usize = 160;
/// Most that the phase, of the response and of its distance from -1, turns from one frequency of a sweep to the next.
const MOST_TURN_RAD: f64 = 0.3;
/// Closest frequencies, relative to each other.
const CLOSEST: f64 = 1e-9;
/// Frequencies about a resonance, in times of its half width.
const ABOUT_A_RESONANCE: [f64; 7] = [-16.0, -4.0, -1.0, 0.0, 1.0, 4.0, 16.0];

impl<F: Fn(f64) -> Complex<f64>> Sweep<F> {
    /// From a frequency to another. `resonances` are poles in the s plane, in rad/s, of the response and of what is
    /// computed from it. A peak that is narrower than the grid stands at one of them.
    pub fn new(response: F, [from, to]: [f64; 2], resonances: &[Complex<f64>]) -> Self {
        let about = |pole: &Complex<f64>| {
            let (at, half_width) = (pole.im, pole.re.abs());
            ABOUT_A_RESONANCE.map(|times| at + times * half_width)
        };
        let mut omegas: Vec<f64> = log_spaced(from, to, COARSE).collect();
        // The exact end: rounding must not step over half the sampling frequency.
        omegas[COARSE - 1] = to;
        omegas.extend(resonances.iter().flat_map(about).filter(|omega| (from..to).contains(omega)));
        omegas.sort_by(f64::total_cmp);
        let mut sweep = Self { response, values: Vec::new() };
        for omega in omegas {
            let value = sweep.at(omega);
            sweep.refine_up_to(value);
        }
        sweep
    }

    fn at(&self, omega_rad_per_s: f64) -> Value {
        Value { omega_rad_per_s, response: (self.response)(omega_rad_per_s) }
    }

    /// Goes on to a frequency, with as many on the way as the turns need.
    fn refine_up_to(&mut self, to: Value) {
        let mut ahead = vec![to];
        while let Some(next) = ahead.pop() {
            let last = self.values.last().copied();
            let middle = last
                .filter(|last| is_far(last, &next))
                .map(|last| self.at((last.omega_rad_per_s * next.omega_rad_per_s).sqrt()));
            // At a pole on the axis itself there is no value.
            match middle {
                Some(middle) if middle.response.is_finite() => ahead.extend([next, middle]),
                _ if next.response.is_finite() => self.values.push(next),
                _ => (),
            }
        }
    }

    /// Where the gain first falls below `1/sqrt(2)` of that at the lowest frequency, in rad/s; `None` if it does not.
    pub fn bandwidth_rad_per_s(&self) -> Option<f64> {
        let limit = self.values.first()?.response.norm() * 0.5_f64.sqrt();
        let pair = self.values.windows(2).find(|pair| pair[1].response.norm() < limit)?;
        Some(self.crossing(pair, |response| (response.norm() / limit).ln()).omega_rad_per_s)
    }

    /// Where `quantity`, of different sign at two neighbours, is zero: by the Illinois variant of false position.
    fn crossing(&self, pair: &[Value], quantity: impl Fn(Complex<f64>) -> f64) -> Value {
        let [mut low, mut high] = [pair[0].omega_rad_per_s, pair[1].omega_rad_per_s];
        let [mut at_low, mut at_high] = [pair[0], pair[1]].map(|value| quantity(value.response));
        let mut found = pair[1];
        for _ in 0..MOST_STEPS {
            let omega = high - at_high * (high - low) / (at_high - at_low);
            if !(omega.is_finite() && (high - low).abs() > f64::EPSILON * high) {
                break;
            }
            let step = (omega - found.omega_rad_per_s).abs();
            found = self.at(omega);
            let here = quantity(found.response);
            if here == 0.0 || step <= 4.0 * f64::EPSILON * omega {
                break;
            }
            if (here > 0.0) == (at_high > 0.0) {
                at_low *= 0.5;
            } else {
                (low, at_low) = (high, at_high);
            }
            (high, at_high) = (omega, here);
        }
        found
    }

    /// The smallest distance from -1 between two frequencies, by golden sections.
    fn closest(&self, mut low: f64, mut high: f64) -> f64 {
        let distance = |omega: f64| (1.0 + (self.response)(omega)).norm();
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let mut inner = [high - golden * (high - low), low + golden * (high - low)];
        let mut at = inner.map(distance);
        while high - low > GOLDEN_WIDTH * high {
            if at[0] < at[1] {
                high = inner[1];
                inner = [high - golden * (high - low), inner[0]];
                at = [distance(inner[0]), at[0]];
            } else {
                low = inner[0];
                inner = [inner[1], low + golden * (high - low)];
                at = [at[1], distance(inner[1])];
            }
        }
        at[0].min(at[1])
    }
}

/// What is smaller is a zero of the response, seen through rounding.
const LEAST_MAGNITUDE: f64 = 1e-9;
/// Steps after which a crossing is as exact as its numbers; usual are 6 to 10.
const MOST_STEPS: usize = 60;
/// Relative width to which an extremum is enclosed: its value is then exact to the square of that.
const GOLDEN_WIDTH: f64 = 1e-7;
/// Distances from -1 up to so many times the smallest of the sweep are looked at between its frequencies.
const NEARLY_CLOSEST: f64 = 1.25;

/// Whether something may happen unseen between two neighbours.
fn is_far(from: &Value, to: &Value) -> bool {
    let turn = |from: Complex<f64>, to: Complex<f64>| (to * from.conj()).arg().abs();
    let turned = turn(from.response, to.response).max(turn(1.0 + from.response, 1.0 + to.response));
    turned > MOST_TURN_RAD && to.omega_rad_per_s - from.omega_rad_per_s > CLOSEST * to.omega_rad_per_s
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
    /// Of a stable closed loop, from its open-loop response (negative feedback: `1 + L`), exact to rounding.
    pub fn of<F: Fn(f64) -> Complex<f64>>(open_loop: &Sweep<F>) -> Self {
        let mut margins = Self {
            gain: f64::INFINITY,
            gain_reduction: 0.0,
            phase_deg: f64::INFINITY,
            modulus: closest_to_instability(open_loop),
            delay_s: f64::INFINITY,
            crossover_hz: 0.0,
        };
        for pair in open_loop.values.windows(2) {
            let [from, to] = [pair[0].response, pair[1].response];
            if (from.norm() > 1.0) != (to.norm() > 1.0) {
                margins.gain_crossing(&open_loop.crossing(pair, |response| response.norm().ln()));
            }
            if (from.im > 0.0) != (to.im > 0.0) {
                margins.phase_crossing(&open_loop.crossing(pair, |response| response.im));
            }
        }
        // A sampled response ends on the real axis.
        if let Some(end) = open_loop.values.last().filter(|end| end.response.im.abs() < 1e-9 * end.response.norm()) {
            margins.phase_crossing(end);
        }
        margins
    }

    /// A gain of one.
    fn gain_crossing(&mut self, at: &Value) {
        self.crossover_hz = self.crossover_hz.max(at.omega_rad_per_s / TAU);
        let lag_rad = (at.response.arg() + PI).rem_euclid(TAU);
        self.delay_s = self.delay_s.min(lag_rad / at.omega_rad_per_s);
        // A lead of less than the lag is as dangerous.
        self.phase_deg = self.phase_deg.min(lag_rad.min(TAU - lag_rad).to_degrees());
    }

    /// A real response; of interest where it is negative.
    fn phase_crossing(&mut self, at: &Value) {
        let magnitude = -at.response.re;
        if magnitude >= 1.0 {
            self.gain_reduction = self.gain_reduction.max(1.0 / magnitude);
        } else if magnitude > LEAST_MAGNITUDE {
            self.gain = self.gain.min(1.0 / magnitude);
        }
    }
}

/// The smallest distance of a response from -1.
fn closest_to_instability<F: Fn(f64) -> Complex<f64>>(sweep: &Sweep<F>) -> f64 {
    let distances: Vec<f64> = sweep.values.iter().map(|value| (1.0 + value.response).norm()).collect();
    let smallest = distances.iter().copied().fold(f64::INFINITY, f64::min);
    let omega = |at: usize| sweep.values[at].omega_rad_per_s;
    (1..distances.len().saturating_sub(1))
        .filter(|&at| distances[at] <= distances[at - 1].min(distances[at + 1]))
        .filter(|&at| distances[at] <= NEARLY_CLOSEST * smallest)
        .map(|at| sweep.closest(omega(at - 1), omega(at + 1)))
        .fold(smallest, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn margins(open_loop: impl Fn(f64) -> Complex<f64>, range: [f64; 2], poles: &[Complex<f64>]) -> Margins {
        Margins::of(&Sweep::new(open_loop, range, poles))
    }

    fn assert_close(found: f64, expected: f64, what: &str) {
        assert!((found - expected).abs() <= 1e-7 * expected.abs(), "{what}: {found}, analytically {expected}");
    }

    /// `L = 1 / (s (s + 1)^2)`: phase -180 degrees at 1 rad/s, where the gain is 1/2.
    #[test]
    fn margins_of_a_textbook_loop() {
        let open_loop = |omega: f64| {
            let s = Complex::new(0.0, omega);
            1.0 / (s * (s + 1.0) * (s + 1.0))
        };
        let margins = margins(open_loop, [1e-2, 1e2], &[]);
        assert_close(margins.gain, 2.0, "gain");
        assert_eq!(margins.gain_reduction, 0.0);
        // |L| = 1 where w (w^2 + 1) = 1, by Cardano; the phase is -90 - 2 atan w degrees.
        let root = (31.0_f64 / 108.0).sqrt();
        let crossover = (0.5 + root).cbrt() + (0.5 - root).cbrt();
        assert_close(margins.crossover_hz * TAU, crossover, "crossover");
        let lag_rad = PI / 2.0 - 2.0 * crossover.atan();
        assert_close(margins.phase_deg, lag_rad.to_degrees(), "phase");
        assert_close(margins.delay_s, lag_rad / crossover, "delay");
        // |1 + L|^2 = (w^2 (w^2 - 1)^2 + (1 - 2 w^2)^2) / (w^2 (w^2 + 1)^2), the smallest of very many.
        let distance = |omega: f64| (1.0 + open_loop(omega)).norm();
        let densely = (1..1_000_000).map(|at| distance(1e-6 * f64::from(at) + 0.3)).fold(f64::INFINITY, f64::min);
        assert_close(margins.modulus, densely, "modulus");
    }

    /// `L = g / s * w0^2 / (s^2 + 2 z w0 s + w0^2)`: at `w0` it is `-g / (2 z w0)`, in a peak a thousandth as wide as the
    /// coarse grid. It is a circle of that diameter from the origin along the negative real axis.
    #[test]
    fn a_resonance_between_the_frequencies_of_the_grid_is_seen() {
        let (resonance, damping) = (37.3, 2e-5);
        let pole = resonance * Complex::new(-damping, f64::sqrt(1.0 - damping * damping));
        for part in [0.3, 0.8, 0.99] {
            let integral = 2.0 * damping * resonance * part;
            let open_loop = move |omega: f64| {
                let s = Complex::new(0.0, omega);
                let second = s * s + 2.0 * damping * resonance * s + resonance * resonance;
                integral / s * resonance * resonance / second
            };
            let margins = margins(open_loop, [1e-5, 1e3], &[pole]);
            assert_close(margins.gain, 1.0 / part, "gain");
            // The circle's nearest point, but for terms of the damping.
            assert!((margins.modulus - (1.0 - part)).abs() < 1e-3 * (1.0 - part), "{part}: {margins:?}");
            assert!(
                (margins.phase_deg - 90.0).abs() < 1e-3 && (margins.crossover_hz * TAU / integral - 1.0).abs() < 1e-6
            );
        }
    }

    /// `L = k w0^2 / (s^2 + 2 z w0 s + w0^2)` with a small k is above one only within its peak.
    #[test]
    fn a_peak_that_alone_is_above_one_has_its_margins() {
        let (resonance, damping, gain) = (12.3_f64, 1e-4_f64, 1e-3_f64);
        let open_loop = |omega: f64| {
            let x = omega / resonance;
            gain / Complex::new(1.0 - x * x, 2.0 * damping * x)
        };
        let pole = resonance * Complex::new(-damping, f64::sqrt(1.0 - damping * damping));
        let margins = margins(open_loop, [1e-3, 1e3], &[pole]);
        // (1 - x^2)^2 + 4 z^2 x^2 = k^2, the upper solution.
        let half = 1.0 - 2.0 * damping * damping;
        let x = (half + (half * half - 1.0 + gain * gain).sqrt()).sqrt();
        assert_close(margins.crossover_hz * TAU, x * resonance, "crossover");
        let lag_rad = (2.0 * damping * x).atan2(x * x - 1.0);
        assert_close(margins.phase_deg, lag_rad.to_degrees(), "phase");
        assert_close(margins.delay_s, lag_rad / (x * resonance), "delay");
    }

    /// `L = k (s^2 + 4) / (s (s + 1)^2)` with `k = 1/2`: a notch without any damping turns the phase by half a turn at once.
    #[test]
    fn a_notch_adds_no_crossing_of_its_own() {
        let open_loop = |omega: f64| {
            let s = Complex::new(0.0, omega);
            0.5 * (s * s + 4.0) / (s * (s + 1.0) * (s + 1.0))
        };
        // s^3 + (2 + k) s^2 + s + 4 k has its roots in the left half plane up to k = 2/3 (Routh).
        let margins = margins(open_loop, [1e-3, 1e3], &[]);
        assert_close(margins.gain, 4.0 / 3.0, "gain");
        assert_eq!(margins.gain_reduction, 0.0);
    }

    /// `L = k / (z - 1)`: the phase is -180 degrees at half the sampling frequency only.
    #[test]
    fn a_sampled_integrator_has_its_margin_at_half_the_sampling_frequency() {
        let margins = margins(|omega| 0.4 / (Complex::from_polar(1.0, omega) - 1.0), [1e-4, PI], &[]);
        assert_close(margins.gain, 5.0, "gain");
        assert_close(margins.modulus, 0.8, "modulus");
        // |e^jw - 1| = 2 sin(w/2) = 0.4; the phase is -90 degrees - w/2.
        let crossover = 2.0 * 0.2_f64.asin();
        assert_close(margins.crossover_hz * TAU, crossover, "crossover");
        assert_close(margins.phase_deg, 90.0 - (0.5 * crossover).to_degrees(), "phase");
    }

    #[test]
    fn bandwidth_of_a_first_order_lag_is_its_corner() {
        let sweep = Sweep::new(|omega| 3.0 / Complex::new(1.0, omega / 20.0), [1e-7, 1e3], &[]);
        assert_close(sweep.bandwidth_rad_per_s().unwrap(), 20.0, "bandwidth");
    }
}

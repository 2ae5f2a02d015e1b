//! Current lag: a filter capacitor at the sensor or averaging in the program.
//!
//! The capacitor follows the current itself, also between two readings. A low-pass in the program follows the readings.

use super::{About, ActsOn, Effect, Parameter, Readings, Sampling, Scales};

/// A shorter time constant, as a share of the time between two readings, is none.
const LEAST_OF_STEP: f64 = 1e-6;

/// See the module.
pub struct CurrentLag;

static ABOUT: About = About {
    id: "current_lag",
    title: "a lag of the current reading",
    acts_on: ActsOn::CurrentSensor,
    parameters: &[Parameter::within("time_constant_s", 0.0, 1.0), Parameter::choice("in_program")],
    linear_in: 0,
    law: "first-order lag with time_constant_s; of the readings alone with in_program = 1",
    looks_like: "The current's peaks after a step are round and late while the speed is right",
    confused_with: &["actuation_delay"],
    experiment: "Hold the rotor and step the voltage, current on an oscilloscope beside the reading",
    remedy: "A smaller capacitor; the filter's state in the observer",
    source: "Allegro ACS712 data sheet (filter pin)",
};

impl Effect for CurrentLag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        [0.002_f64, 0.008].map(|time_constant_s| vec![time_constant_s.max(0.5 * scales.interval_s), 0.0]).to_vec()
    }

    fn other_laws(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        vec![vec![values[0], 1.0 - values[1]]]
    }

    fn current_late_s(&self, values: &[f64]) -> f64 {
        values[0]
    }

    /// What is read, and the current at the last reading.
    fn states(&self) -> usize {
        2
    }

    /// A filter at the sensor comes first, one in the program last.
    fn turn(&self, values: &[f64]) -> i8 {
        if values[1] > 0.0 { 2 } else { -1 }
    }

    fn sense(&self, values: &[f64], at: &Sampling, state: &mut [f64], readings: &mut Readings) {
        let [time_constant_s, in_program] = [values[0], values[1]];
        let (last_read_a, last_a, now_a) = (state[0], state[1], readings.current_a);
        let steps = at.step_s / time_constant_s.max(LEAST_OF_STEP * at.step_s);
        let left = (-steps).exp();
        let read_a = if at.step_s == 0.0 {
            now_a
        } else if in_program > 0.0 {
            now_a + left * (last_read_a - now_a)
        } else {
            let rise_a = (now_a - last_a) / steps;
            now_a - rise_a + left * (last_read_a - last_a + rise_a) + at.bulge.in_a_low_pass(steps)
        };
        state.copy_from_slice(&[read_a, now_a]);
        readings.current_a = read_a;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::effect;
    use crate::free_run::between_rows::Bulge;

    /// Against the differential equations in small steps, for a winding that settles between two readings while its voltage
    /// goes on rising.
    #[test]
    fn the_filter_follows_the_current() {
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
        let bulge_a = sum_a / f64::from(parts) - 0.5 * (start_a + end_a);
        let mut readings = Readings { current_a: end_a, speed_rad_per_s: 0.0, angle_rad: 0.0 };
        let bulge = Bulge::new(bulge_a, interval_s, winding_s);
        let at = Sampling { angle_rad: 0.0, step_s: interval_s, bulge };
        let lag = effect("current_lag").unwrap();
        lag.sense(&[time_constant_s, 0.0], &at, &mut [0.2, start_a], &mut readings);
        assert!((readings.current_a - filtered_a).abs() < 1e-6, "{} {filtered_a}", readings.current_a);
    }
}

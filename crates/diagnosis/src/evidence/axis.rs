//! Bins of a coordinate.

use crate::configuration::evidence::axis::{BINS, EACH_PERIOD, EACH_SIDE, EACH_TURN};
use crate::dataset::Dataset;
use motorbench_model::Term;
use motorbench_model::catalogue::{Coordinate, Instant};
use std::f64::consts::TAU;

/// Edges of bins.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    edges: Vec<f64>,
}

impl Axis {
    /// For an effect, over these values of its coordinate.
    pub(super) fn of(term: &Term, values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low >= high {
            return None;
        }
        let edges = match term.effect.about().shown.over {
            Coordinate::Angle => evenly(0.0, TAU, EACH_TURN.max(EACH_PERIOD * waves(term))),
            Coordinate::Speed
            | Coordinate::Current
            | Coordinate::SupplyCurrent
            | Coordinate::Voltage
            | Coordinate::Duty => {
                let most = high.max(-low);
                let share = |step: f64| step * step.abs();
                let steps = (0..=2 * EACH_SIDE).map(|step| step as f64 / EACH_SIDE as f64 - 1.0);
                steps.map(|step| most * share(step)).collect()
            }
            Coordinate::SpeedSize => evenly(0.0, high, BINS),
            Coordinate::Time | Coordinate::SinceStep => evenly(low, high, BINS),
        };
        Some(Self { edges })
    }

    /// With so many bins in the place of each.
    pub(super) fn finer(&self, parts: usize) -> Self {
        let within = |pair: &[f64]| {
            let (from, width) = (pair[0], pair[1] - pair[0]);
            (0..parts).map(move |part| from + width * part as f64 / parts as f64)
        };
        let mut edges: Vec<f64> = self.edges.windows(2).flat_map(within).collect();
        edges.extend(self.edges.last());
        Self { edges }
    }

    pub(super) fn len(&self) -> usize {
        self.edges.len() - 1
    }

    /// The bin of a value; the greatest value belongs to the last one.
    pub(super) fn bin(&self, value: f64) -> Option<usize> {
        let next = self.edges.partition_point(|edge| *edge <= value);
        let is_last = self.edges.last().is_some_and(|last| *last == value);
        let next = if is_last { self.len() } else { next };
        (1..=self.len()).contains(&next).then(|| next - 1)
    }

    /// Width of the bins of an angle.
    pub(super) fn first_width(&self) -> f64 {
        self.edges[1] - self.edges[0]
    }
}

fn evenly(low: f64, high: f64, bins: usize) -> Vec<f64> {
    (0..=bins).map(|step| low + (high - low) * step as f64 / bins as f64).collect()
}

/// Waves that the effect has in a turn.
fn waves(term: &Term) -> usize {
    term.effect.about().number().map_or(1, |place| term.values[place] as usize)
}

/// The coordinate at an instant. The time since a step is no matter of an instant.
pub(super) fn coordinate(over: Coordinate, at: &Instant) -> f64 {
    match over {
        Coordinate::Speed => at.speed_rad_per_s,
        Coordinate::SpeedSize => at.speed_rad_per_s.abs(),
        Coordinate::Angle => at.angle_rad.rem_euclid(TAU),
        Coordinate::Current => at.current_a,
        Coordinate::SupplyCurrent => at.duty * at.current_a,
        Coordinate::Voltage => at.voltage_v,
        Coordinate::Duty => at.duty,
        Coordinate::Time => at.time_s,
        Coordinate::SinceStep => f64::NAN,
    }
}

/// Rows that have a next one in their stretch.
pub(super) fn rows(data: &Dataset) -> impl Iterator<Item = usize> + '_ {
    data.stretches.iter().flat_map(|stretch| stretch.rows.start..stretch.rows.end - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_model::catalogue::effect;

    fn axis(id: &str, values: Vec<f64>) -> Axis {
        let term = Term { effect: effect(id).unwrap(), values };
        Axis::of(&term, [-3.0, 4.0].into_iter()).unwrap()
    }

    #[test]
    fn each_period_of_a_wave_has_eight_bins() {
        for periods in [2, 7, 24] {
            let axis = axis("cogging", vec![1e-3, 1e-3, f64::from(periods)]);
            assert!(axis.len() >= 8 * periods as usize);
            let bins = [0.0, 1.0, TAU - 1e-9].map(|angle| axis.bin(angle).unwrap());
            assert!(bins[0] == 0 && bins[1] > 0 && bins[2] == axis.len() - 1);
        }
    }

    /// A law that changes its sign at zero would be averaged away in a bin about zero.
    #[test]
    fn no_bin_lies_on_both_sides_of_zero() {
        let axis = axis("coulomb_friction", vec![1e-3]);
        assert_ne!(axis.bin(-1e-6), axis.bin(1e-6));
        assert_eq!((axis.bin(4.0), axis.bin(4.1)), (Some(axis.len() - 1), None));
        assert_eq!(axis.finer(4).len(), 4 * axis.len());
    }
}

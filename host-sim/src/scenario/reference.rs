//! References of a loop: given tick by tick by this computer, or a sequence that the core plays itself.

use super::sequence::SequenceOrder;
use std::f64::consts::TAU;

/// A reference from a time on, until the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Start time.
    pub time_s: f64,
    /// Its course.
    pub course: Course,
}

/// Course of a reference, in the unit of the mode: V, rad/s, rad. It passes the core's profile.
#[derive(Clone, Debug, PartialEq)]
pub enum Course {
    /// One value.
    Step {
        /// The value.
        value: f64,
    },
    /// Straight from the last value to another.
    Ramp {
        /// The end value.
        value: f64,
        /// The duration.
        duration_s: f64,
    },
    /// A sine about an offset.
    Sine {
        /// Its amplitude.
        amplitude: f64,
        /// Its mean.
        offset: f64,
        /// Its frequency.
        frequency_hz: f64,
    },
    /// Straight lines between points: time since the reference began, value.
    Points(Vec<[f64; 2]>),
    /// A sequence that the core plays by itself.
    Sequence(SequenceOrder),
}

impl Course {
    /// For messages and tables.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Step { .. } => "step",
            Self::Ramp { .. } => "ramp",
            Self::Sine { .. } => "sine",
            Self::Points(_) => "points",
            Self::Sequence(_) => "sequence",
        }
    }

    /// Value `t_s` after its start, if the last one ended with `before`; `None` for a sequence of the core.
    pub fn value(&self, t_s: f64, before: f64) -> Option<f64> {
        match self {
            Self::Step { value } => Some(*value),
            Self::Ramp { value, duration_s } => Some(before + (value - before) * (t_s / duration_s).min(1.0)),
            Self::Sine { amplitude, offset, frequency_hz } => {
                Some(offset + amplitude * (TAU * frequency_hz * t_s).sin())
            }
            Self::Points(points) => Some(interpolated(points, t_s)),
            Self::Sequence(_) => None,
        }
    }
}

fn interpolated(points: &[[f64; 2]], t_s: f64) -> f64 {
    let next = points.partition_point(|point| point[0] <= t_s);
    match (next.checked_sub(1).map(|last| points[last]), points.get(next)) {
        (None, Some(first)) => first[1],
        (Some(last), Some(next)) => last[1] + (next[1] - last[1]) * (t_s - last[0]) / (next[0] - last[0]),
        (Some(last), None) => last[1],
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn courses_by_hand() {
        let at = |course: &Course, t_s| course.value(t_s, 2.0).unwrap();
        let ramp = Course::Ramp { value: 6.0, duration_s: 2.0 };
        assert_eq!([at(&ramp, 0.0), at(&ramp, 1.0), at(&ramp, 9.0)], [2.0, 4.0, 6.0]);
        let sine = Course::Sine { amplitude: 3.0, offset: 1.0, frequency_hz: 2.0 };
        assert!((at(&sine, 0.125) - 4.0).abs() < 1e-12);
        let points = Course::Points(vec![[0.5, 1.0], [1.0, 3.0]]);
        assert_eq!([at(&points, 0.0), at(&points, 0.75), at(&points, 2.0)], [1.0, 2.0, 3.0]);
    }
}

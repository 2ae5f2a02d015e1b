//! Missed counts: edges come faster than they are counted, or while the counter is held up.
//!
//! A counter that polls loses what exceeds its rate. A counter that is interrupted now and then loses a share of all edges.
//! A counter that is held up for longer stands still meanwhile. No term says when: the stops are found in the counts
//! (`dataset/counter_stops.rs`) or in the residual (`diagnose/unseen_losses.rs`). Edges that are lost at random add scatter
//! (`diagnose/random_losses.rs`).

use super::{
    About, ActsOn, Coordinate, Law, Parameter, Readings, Sampling, Scales, Search, Sensor, Shown, Strength, Unit,
};

/// Least share of the threshold over which the loss of all counts sets in, so that a fit can move the threshold.
const EDGE: f64 = 0.01;
/// The same where the loss comes up gradually, to start from.
const GRADUAL: f64 = 0.5;

/// A threshold below this share of the greatest speed counts as zero.
const SLOWEST: f64 = 0.02;

/// Share that is lost to start from.
const LOST: f64 = 0.08;

/// Multiples of a threshold that are tried when a share of all counts replaces a share of the excess.
const LATER: [f64; 3] = [1.0, 1.07, 1.15];

/// See the module.
pub struct MissedCounts;

static ABOUT: About = About {
    id: "missed_counts",
    title: "encoder counts lost",
    acts_on: &[ActsOn::AngleSensor],
    parameters: &[
        Parameter::within("lost_share", Unit::One, 0.0, 1.0),
        Parameter::positive("threshold_rad_per_s", Unit::RadianPerSecond),
        Parameter::choice("of_all"),
        Parameter::of_another_law("onset_share", Unit::One, 10.0),
        Parameter { min: -1.0, ..Parameter::choice("one_way") },
    ],
    linear_in: 1,
    law: "of the speed above threshold_rad_per_s the share lost_share is not counted; with of_all = 1 the share of all counts, coming up over onset_share of the threshold above it; with one_way = 1 or -1 only while it turns forward or backward; or none is counted for stop_s, stops_per_s times a second",
    looks_like: "The measured speed bends off above a threshold while the current does not, or drops to zero and is back at once, or is too low in one direction",
    confused_with: &["quadratic_drag", "tacho_ripple", "bridge_asymmetry"],
    experiment: "Mark the shaft and count revolutions by eye or with a second sensor",
    remedy: "Count in hardware or in interrupts; fewer lines; a lower top speed. Where half or three quarters are lost at all speeds, the rig file's counts_per_rev is of more edges than are counted",
    source: "Petrella and others, Speed Measurement Algorithms, IEEE ISIE (2007)",
    falsifies_angle: true,
    sensor: Some(Sensor::Encoder),
    shown: Shown::new(Strength::Reading, Coordinate::Speed),
    ..About::DEFAULT
};

impl Law for MissedCounts {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn states(&self) -> usize {
        1
    }

    fn lost_rad_per_s(&self, values: &[f64], speed_rad_per_s: f64) -> f64 {
        let &[lost_share, threshold_rad_per_s, of_all, onset_share, one_way] = values else { return 0.0 };
        if one_way * speed_rad_per_s < 0.0 {
            return 0.0;
        }
        let speed = speed_rad_per_s.abs();
        let excess_rad_per_s = (speed - threshold_rad_per_s).max(0.0);
        let edge_rad_per_s = (onset_share.max(EDGE) * threshold_rad_per_s).max(f64::MIN_POSITIVE);
        let counted_of = match of_all > 0.0 {
            true => speed * (excess_rad_per_s / edge_rad_per_s).min(1.0),
            false => excess_rad_per_s,
        };
        lost_share * counted_of * speed_rad_per_s.signum()
    }

    /// It acts after an eccentric disc, which moves the edges themselves.
    fn turn(&self, _values: &[f64]) -> i8 {
        1
    }

    fn sense(&self, values: &[f64], at: &Sampling, state: &mut [f64], readings: &mut Readings) {
        let lost_rad_per_s = self.lost_rad_per_s(values, readings.speed_rad_per_s);
        readings.speed_rad_per_s -= lost_rad_per_s;
        state[0] += lost_rad_per_s * at.step_s;
        readings.angle_rad -= state[0];
    }
}

impl Search for MissedCounts {
    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let law = |of_all: f64| move |share: f64| vec![LOST, share * scales.speed_rad_per_s, of_all, 0.0, 0.0];
        let of_excess = [0.0, 0.4, 0.55, 0.7, 0.85].map(law(0.0));
        let of_all = [0.4, 0.55, 0.7, 0.85].map(law(1.0));
        let one_way = [1.0, -1.0].map(|way| vec![LOST, 0.0, 0.0, 0.0, way]);
        of_excess.into_iter().chain(of_all).chain(one_way).collect()
    }

    /// With as many counts lost at full speed. A loss that sets in at once has a higher threshold.
    fn other_laws(&self, values: &[f64], scales: &Scales) -> Vec<Vec<f64>> {
        let &[lost_share, threshold_rad_per_s, of_all, onset_share, one_way] = values else { return Vec::new() };
        let excess_share = (1.0 - threshold_rad_per_s / scales.speed_rad_per_s).max(0.05);
        let at_once = |lost_share: f64, later: f64| vec![lost_share, later * threshold_rad_per_s, 1.0, 0.0, one_way];
        let gradual = |lost_share: f64| vec![lost_share, 0.95 * threshold_rad_per_s, 1.0, GRADUAL, one_way];
        let of_excess = vec![(lost_share / excess_share).min(1.0), 0.95 * threshold_rad_per_s, 0.0, 0.0, one_way];
        // A loss at all speeds has no threshold that another law could use.
        if threshold_rad_per_s < SLOWEST * scales.speed_rad_per_s {
            return Vec::new();
        }
        match (of_all > 0.0, onset_share > 0.0) {
            (true, true) => vec![at_once(lost_share, 1.07), of_excess],
            (true, false) => vec![gradual(lost_share), of_excess],
            (false, _) => {
                let lost_share = lost_share * excess_share;
                LATER.map(|later| at_once(lost_share, later)).into_iter().chain([gradual(lost_share)]).collect()
            }
        }
    }

    fn elsewhere(&self, values: &[f64], _scales: &Scales) -> Vec<Vec<f64>> {
        let moved = |factor: f64| vec![values[0], factor * values[1], values[2], values[3], values[4]];
        if values[2] > 0.0 { [0.93, 1.07].map(moved).to_vec() } else { Vec::new() }
    }

    /// A motor that a bridge drives less one way is slower that way, and so is one whose counts are lost.
    fn instead_of(&self, id: &str, values: &[f64], _scales: &Scales) -> Option<Vec<f64>> {
        let less_backward = *values.first().filter(|_| id == "bridge_asymmetry")?;
        let way = if less_backward < 0.0 { -1.0 } else { 1.0 };
        Some(vec![less_backward.abs() / (1.0 + less_backward.max(0.0)), 0.0, 0.0, 0.0, way])
    }

    /// A share of the counts that is lost at all speeds, both ways, looks like an encoder with fewer lines.
    fn is_a_scale(&self, values: &[f64], scales: &Scales) -> bool {
        values[4] == 0.0 && values[1] < SLOWEST * scales.speed_rad_per_s
    }
}

//! Missed counts: edges come faster than they are counted.

use super::{About, ActsOn, Effect, Parameter, Readings, Sampling, Scales};

/// See the module.
pub struct MissedCounts;

static ABOUT: About = About {
    id: "missed_counts",
    title: "encoder counts lost at high speed",
    acts_on: ActsOn::AngleSensor,
    parameters: &[Parameter::within("lost_share", 0.0, 1.0), Parameter::positive("threshold_rad_per_s")],
    linear_in: 1,
    law: "of the speed above threshold_rad_per_s the share lost_share is not counted",
    looks_like: "The measured speed bends off above a threshold while the current does not",
    confused_with: &["quadratic_drag", "tacho_ripple"],
    experiment: "Mark the shaft and count revolutions by eye or with a second sensor",
    remedy: "Count in hardware or in interrupts; fewer lines; a lower top speed",
    source: "Petrella and others, Speed Measurement Algorithms, IEEE ISIE (2007)",
};

impl Effect for MissedCounts {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn starts(&self, scales: &Scales) -> Vec<Vec<f64>> {
        [0.0, 0.4, 0.55, 0.7, 0.85].map(|share| vec![0.08, share * scales.speed_rad_per_s]).to_vec()
    }

    fn states(&self) -> usize {
        1
    }

    /// What depends on the shaft's angle is not where the counts say.
    fn changes_motion(&self) -> bool {
        true
    }

    fn lost_rad_per_s(&self, values: &[f64], speed_rad_per_s: f64) -> f64 {
        let excess_rad_per_s = (speed_rad_per_s.abs() - values[1]).max(0.0);
        values[0] * excess_rad_per_s * speed_rad_per_s.signum()
    }

    fn sense(&self, values: &[f64], at: &Sampling, state: &mut [f64], readings: &mut Readings) {
        let lost_rad_per_s = self.lost_rad_per_s(values, readings.speed_rad_per_s);
        readings.speed_rad_per_s -= lost_rad_per_s;
        state[0] += lost_rad_per_s * at.step_s;
        readings.angle_rad -= state[0];
    }
}

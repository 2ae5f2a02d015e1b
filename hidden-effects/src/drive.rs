//! What the motor is driven with: a duty for every sample.

use rand::{Rng, RngExt};

/// Kinds of excitation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Excitation {
    /// Ramps through zero, steps both ways, random levels, coast-down with a short-circuited motor, again slow ramps.
    Identify,
    /// Random levels, each held for a random time.
    Levels,
    /// Two levels, switched at random.
    Prbs,
    /// Steps up, down, and the other way round.
    Staircase,
}

/// Duty, -1 to 1, at each of `count` samples.
pub fn duties(kind: Excitation, count: usize, rate_hz: f64, random: &mut impl Rng) -> Vec<f64> {
    match kind {
        Excitation::Identify => identify(count, rate_hz, random),
        Excitation::Levels => levels(count, rate_hz, random, 0.05, 0.4),
        Excitation::Prbs => prbs(count, rate_hz, random),
        Excitation::Staircase => (0..count).map(|k| staircase(k as f64 / count as f64)).collect(),
    }
}

fn identify(count: usize, rate_hz: f64, random: &mut impl Rng) -> Vec<f64> {
    let mut duty = levels(count, rate_hz, random, 0.04, 0.4);
    for (k, value) in duty.iter_mut().enumerate() {
        let part = k as f64 / count as f64;
        *value = match part {
            // Triangle through zero, twice.
            p if p < 0.20 => 0.5 * triangle(p / 0.10),
            p if p < 0.35 => staircase((p - 0.20) / 0.15),
            p if p < 0.75 => *value,
            // Run up and coast, both ways.
            p if p < 0.78 => 0.85,
            p if p < 0.81 => 0.0,
            p if p < 0.84 => -0.85,
            p if p < 0.87 => 0.0,
            p => 0.25 * triangle((p - 0.87) / 0.13),
        };
    }
    duty
}

fn triangle(phase: f64) -> f64 {
    let phase = phase.rem_euclid(1.0);
    if phase < 0.25 {
        4.0 * phase
    } else if phase < 0.75 {
        2.0 - 4.0 * phase
    } else {
        4.0 * phase - 4.0
    }
}

fn staircase(part: f64) -> f64 {
    const LEVELS: [f64; 10] = [0.3, 0.6, 0.9, 0.45, 0.0, -0.3, -0.6, -0.9, -0.45, 0.0];
    LEVELS[((part * LEVELS.len() as f64) as usize).min(LEVELS.len() - 1)]
}

fn levels(count: usize, rate_hz: f64, random: &mut impl Rng, from_s: f64, to_s: f64) -> Vec<f64> {
    let mut duty = Vec::with_capacity(count);
    while duty.len() < count {
        let level = random.random_range(-0.9..0.9);
        let hold = (random.random_range(from_s..to_s) * rate_hz) as usize + 1;
        duty.extend(std::iter::repeat_n(level, hold));
    }
    duty.truncate(count);
    duty
}

fn prbs(count: usize, rate_hz: f64, random: &mut impl Rng) -> Vec<f64> {
    let hold = (0.05 * rate_hz).max(1.0) as usize;
    let mut duty = Vec::with_capacity(count);
    while duty.len() < count {
        let level = if random.random_bool(0.5) { 0.6 } else { -0.6 };
        duty.extend(std::iter::repeat_n(level, hold));
    }
    duty.truncate(count);
    duty
}

//! The excitation of the motor: a duty for every sample.

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
    /// A PI speed loop that follows random steps, some of them slow or to standstill.
    ClosedLoop,
}

/// Duty, -1 to 1, at each of `count` samples; for a closed loop it is not known before, see [`SpeedLoop`].
pub fn duties(kind: Excitation, count: usize, rate_hz: f64, random: &mut impl Rng) -> Vec<f64> {
    match kind {
        Excitation::Identify => identify(count, rate_hz, random),
        Excitation::Levels => levels(count, rate_hz, random, 0.05, 0.4),
        Excitation::Prbs => prbs(count, rate_hz, random),
        Excitation::ClosedLoop => vec![0.0; count],
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

/// PI control of the speed. Speeds are shares of the top speed, so the gains are duty per share.
pub struct SpeedLoop {
    reference: Vec<f64>,
    interval_s: f64,
    integral: f64,
}

impl SpeedLoop {
    const GAIN: f64 = 1.0;
    /// Between the mechanical time constants of the fastest and of the slowest motor.
    const RESET_S: f64 = 0.06;
    /// Headroom as in a firmware that keeps the bootstrap of its bridge alive.
    const MOST_DUTY: f64 = 0.95;

    /// Draws the steps of the reference.
    pub fn new(count: usize, rate_hz: f64, random: &mut impl Rng) -> Self {
        let mut reference = Vec::with_capacity(count);
        while reference.len() < count {
            let level = match random.random_range(0_u8..5) {
                0 => 0.0,
                1 => random.random_range(-0.06..0.06),
                _ => random.random_range(-0.7..0.7),
            };
            let hold = (random.random_range(0.3..1.2) * rate_hz) as usize + 1;
            reference.extend(std::iter::repeat_n(level, hold));
        }
        Self { reference, interval_s: 1.0 / rate_hz, integral: 0.0 }
    }

    /// Duty for the sample at `index`, at which `speed_share` is read.
    pub fn duty(&mut self, index: usize, speed_share: f64) -> f64 {
        let error = self.reference[index] - speed_share;
        let wanted = Self::GAIN * error + self.integral;
        let duty = wanted.clamp(-Self::MOST_DUTY, Self::MOST_DUTY);
        // Anti-windup: no integration while the duty is at its limit.
        if duty == wanted {
            self.integral += Self::GAIN * error * self.interval_s / Self::RESET_S;
        }
        duty
    }
}

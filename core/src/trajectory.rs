//! Reference profiles: ramps and S-curves for speed, trapezoids and S-curves for position.
//!
//! Both are built on one integer recurrence, `Ramp`: a value moves toward its target by a rate that changes by one
//! `step` a tick at most and never exceeds `limit`. The rate is always a whole number of steps. So the way that it needs
//! to come to zero is a sum, which grows and shrinks with the rate. That needs no square root and no division. The value
//! arrives exactly, without overshoot, also when the target changes in the middle of a move.
//!
//! * Speed: the value is the speed, the rate its acceleration, and the step the jerk. That is an S-curve. With
//!   `jerk_time` zero the step is the whole acceleration, which is a ramp. A move is at most `4 + jerk ticks` ticks longer
//!   than in exact arithmetic. Its last tick takes what is left, less than one step.
//! * Position: the value is the position, the rate its speed, and the step the acceleration. That is a trapezoid.
//!   `jerk_time` averages it over that time, rounded up to a power of two of ticks. The average is a sum of the position
//!   minus the same profile so many ticks later. The later copy is computed, not stored.
//!
//! Formats: speed bits with 14 fractional bits; counts with 12. Steps are rounded down: limits are never exceeded.

use crate::arith::{call_mul_i16_u16, call_saturate_i16, whole};
use crate::quantiser::{Format, Quantiser};
use crate::settings::{BuildError, Param, Settings};
use crate::units::{FULL_RANGE, Rule};

/// Fractional bits of the speed profile.
const SPEED_FRACTION: u32 = 14;
/// Fractional bits of the position profile.
const POSITION_FRACTION: u32 = 12;
/// Longest way to stop, and longest way of the ticks that are averaged: leaves room for sums within 32 bits.
const LONGEST_WAY: f32 = 1e9;

/// Places in [`TrajectoryConfig`].
const SPEED: usize = 0;
const POSITION: usize = 1;

/// Steps and limits of both profiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct TrajectoryConfig {
    /// Of the speed profile and of the position profile.
    ramps: [RampConfig; 2],
    /// Power of two of ticks over which positions are averaged: 0..=8.
    average: u8,
    /// Speed bits of 2^-8 counts a tick, times 2^8 or, with `fine`, 2^16.
    speed_scale: u16,
    fine: bool,
}

impl TrajectoryConfig {
    /// From `acceleration`, `jerk_time`, `cruise_speed`, `counts_per_rev`, `speed_range` and `tick_rate`. A change too
    /// slow for the formats is blamed on what makes it slow, a way too long on what makes it long.
    #[inline(always)]
    pub fn quantise(&mut self, q: &mut Quantiser) {
        const SPEED_BITS: f32 = FULL_RANGE * (1u32 << SPEED_FRACTION) as f32;
        const COUNTS: f32 = (1u32 << POSITION_FRACTION) as f32 / core::f32::consts::TAU;
        let jerk_ticks = q.scale(Format::Ticks).times(Param::JerkTime).value();
        let slow = if jerk_ticks > 1.0 { Param::JerkTime } else { Param::Acceleration };
        q.of(SPEED_BITS).times(Param::Acceleration).over(Param::TickRate).over(Param::SpeedRange);
        self.ramps[SPEED].quantise(q, jerk_ticks, Param::JerkTime, slow);
        let cruise_ticks = q.of(1.0).times(Param::CruiseSpeed).over(Param::Acceleration).times(Param::TickRate).value();
        q.of(COUNTS).times(Param::CountsPerRev).times(Param::CruiseSpeed).over(Param::TickRate);
        self.ramps[POSITION].quantise(q, cruise_ticks, Param::CruiseSpeed, Param::Acceleration);
        self.average = power_of_two(jerk_ticks);
        // The way of all ticks that are averaged must fit, too.
        if q.value() * (1u16 << self.average) as f32 >= LONGEST_WAY {
            q.refuse(Param::JerkTime, Rule::TooLarge);
        }
        q.of(core::f32::consts::TAU * FULL_RANGE).times(Param::TickRate).over(Param::CountsPerRev);
        let fine = q.over(Param::SpeedRange).value() < 255.0;
        if fine {
            q.of(q.value() * 256.0);
        }
        self.speed_scale = q.round(Param::SpeedRange, u16::MAX);
        self.fine = fine;
    }

    /// Whether a move that is under way can go on with the other: its rate is a whole number of steps, within the limit.
    #[inline(always)]
    pub fn moves_like(&self, other: &Self) -> bool {
        self.average == other.average && self.ramps == other.ramps
    }

    /// The same, on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn build(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build_in_place(settings, Self::quantise)
    }
}

/// Smallest power of two that is not below `ticks`, at most 256.
fn power_of_two(ticks: f32) -> u8 {
    let ticks = round_up(ticks);
    let mut power = 0;
    while power < 8 && (1 << power) < ticks {
        power += 1;
    }
    power
}

/// The next whole number.
#[inline(never)]
#[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
fn round_up(value: f32) -> i32 {
    let below = whole(value);
    if (below as f32) < value { below + 1 } else { below }
}

/// How fast a rate may change (its step a tick), and how far it may go. One array, which the chip compares in a sixth of
/// the flash that two numbers take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
struct RampConfig([i32; 2]);

impl RampConfig {
    /// The formula's value reached in `steps` steps, rounded up; `far` is to blame for a way too long, `slow` for a step of nothing.
    #[inline(never)]
    #[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
    fn quantise(&mut self, q: &mut Quantiser, steps: f32, far: Param, slow: Param) {
        let limit = q.value();
        // A whole number of steps, so that the limit is reached exactly.
        let steps = round_up(if steps < 1.0 { 1.0 } else { steps });
        if limit * steps as f32 >= LONGEST_WAY {
            q.refuse(far, Rule::TooLarge);
            return;
        }
        let step = whole(limit / steps as f32);
        if step == 0 {
            q.refuse(slow, Rule::RoundsToZero);
        }
        self.0 = [step, step * steps];
    }
}

/// A rate in whole steps, and the way it takes to bring it to zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
struct Ramp {
    /// Magnitude of the rate.
    rate: i32,
    /// What the value still moves if the rate falls by one step a tick from now on.
    stop: i32,
    /// The rate is negative.
    backward: bool,
}

impl Ramp {
    /// The next change of a value that is `distance` away from its target (within +-2^30).
    #[inline(never)]
    fn next(&mut self, config: &RampConfig, distance: i32) -> i32 {
        if self.rate == 0 {
            self.backward = distance < 0;
        }
        let ahead = if self.backward { -distance } else { distance };
        let [step, limit] = config.0;
        let faster = self.rate + step;
        // What is left after a tick at a rate must be enough to stop from it.
        if faster <= limit && ahead - faster >= self.stop + self.rate {
            self.stop += self.rate;
            self.rate = faster;
        } else if ahead - self.rate < self.stop {
            if self.rate == 0 {
                return distance;
            }
            self.rate -= step;
            self.stop -= self.rate;
        } else if self.rate == 0 {
            // Less than one step is left: the last tick takes it.
            return distance;
        }
        if self.backward { -self.rate } else { self.rate }
    }
}

/// A speed on its way to a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct SpeedProfile {
    ramp: Ramp,
    /// Speed bits, with fraction.
    value: i32,
    target: i32,
    /// Speed bits.
    speed: i16,
    /// The target is still ahead: kept, because to compare takes longer than all else of a tick at the target.
    moving: bool,
}

impl SpeedProfile {
    /// At `speed`, in bits, without acceleration.
    #[cfg(test)]
    fn start(speed: i16) -> Self {
        let mut profile = Self::default();
        profile.begin(speed);
        profile
    }

    /// Puts one that is at rest at zero to `speed`, in bits, without acceleration.
    #[inline(always)]
    pub fn begin(&mut self, speed: i16) {
        self.value = (speed as i32) << SPEED_FRACTION;
        self.target = self.value;
        self.speed = speed;
    }

    /// Another target, in bits.
    pub fn retarget(&mut self, speed: i16) {
        self.target = (speed as i32) << SPEED_FRACTION;
        self.moving = true;
    }

    /// Whether the target is still ahead.
    pub fn moving(&self) -> bool {
        self.moving
    }

    /// One tick: the reference, in bits.
    #[inline(always)]
    pub fn step(&mut self, config: &TrajectoryConfig) -> i16 {
        if self.moving {
            self.advance(config);
        }
        self.speed
    }

    #[inline(never)]
    fn advance(&mut self, config: &TrajectoryConfig) {
        // Two speeds are less than 2^30 apart.
        self.value += self.ramp.next(&config.ramps[SPEED], self.target - self.value);
        self.speed = (self.value >> SPEED_FRACTION) as i16;
        self.moving = self.value != self.target || self.ramp.rate != 0;
    }
}

/// A trapezoid: a position on its way to a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
struct Trapezoid {
    ramp: Ramp,
    counts: i32,
    /// 0..2^12 of a count.
    fraction: i16,
    target: i32,
}

impl Trapezoid {
    fn moving(&self) -> bool {
        self.counts != self.target || self.fraction != 0 || self.ramp.rate != 0
    }

    /// One tick: how far it moves, in 2^-12 counts.
    #[inline(never)]
    fn step(&mut self, config: &RampConfig) -> i32 {
        if !self.moving() {
            return 0;
        }
        // Farther than any way to stop is far enough.
        let counts = self.target.wrapping_sub(self.counts).clamp(-0x3_fffe, 0x3_fffe);
        let moved = self.ramp.next(config, (counts << POSITION_FRACTION) - self.fraction as i32);
        let position = moved + self.fraction as i32;
        self.counts = self.counts.wrapping_add(position >> POSITION_FRACTION);
        self.fraction = (position & ((1 << POSITION_FRACTION) - 1)) as i16;
        moved
    }
}

/// A position on its way to a target, by trapezoid or S-curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PositionProfile {
    lead: Trapezoid,
    /// The same profile, as many ticks later as the average is long.
    follow: Trapezoid,
    /// A target waits for the follower; it is due after so many ticks.
    due: u16,
    /// Target asked for.
    target: i32,
    /// Lead minus follower, 2^-12 counts.
    gap: i32,
    counts: i32,
    /// 0..2^12 of a count.
    fraction: i16,
    /// 0..2^average of 2^-12 counts.
    remainder: u8,
    /// The target is still ahead.
    moving: bool,
}

impl PositionProfile {
    /// At rest at `counts`.
    #[cfg(test)]
    fn start(counts: i32) -> Self {
        let mut profile = Self::default();
        profile.begin(counts);
        profile
    }

    /// Puts one that is at rest at zero to `counts`.
    #[inline(never)]
    pub fn begin(&mut self, counts: i32) {
        for place in [&mut self.lead.counts, &mut self.lead.target, &mut self.follow.counts, &mut self.follow.target] {
            *place = counts;
        }
        self.target = counts;
        self.counts = counts;
    }

    /// Another target, in counts. With an S-curve it is taken up when the one before has reached the follower, at most
    /// `jerk_time` later.
    pub fn retarget(&mut self, counts: i32) {
        self.target = counts;
        self.moving = true;
    }

    /// Whether the target is still ahead.
    pub fn moving(&self) -> bool {
        self.moving
    }

    /// One tick: the reference in counts, and its speed in bits.
    #[inline(never)]
    pub fn step(&mut self, config: &TrajectoryConfig) -> (i32, i16) {
        if !self.moving {
            return (self.counts, 0);
        }
        self.moving = self.lead.target != self.target || self.due != 0 || self.lead.moving() || self.follow.moving();
        if !self.moving {
            return (self.counts, 0);
        }
        if self.due == 0 && self.lead.target != self.target {
            self.lead.target = self.target;
            // Without an average the copy that follows is due at once: it is never asked to move.
            self.due = if config.average == 0 { 0 } else { 1 << config.average };
        }
        let moved = self.lead.step(&config.ramps[POSITION]);
        if config.average == 0 {
            return self.advance(config, moved);
        }
        self.gap += moved;
        if self.due != 0 {
            self.due -= 1;
            if self.due == 0 {
                self.follow.target = self.lead.target;
            }
        }
        let gap = self.gap;
        self.gap -= self.follow.step(&config.ramps[POSITION]);
        self.advance(config, gap)
    }

    /// Moves the average on by `gap / 2^average`.
    #[inline(always)]
    fn advance(&mut self, config: &TrajectoryConfig, gap: i32) -> (i32, i16) {
        let gap = gap + self.remainder as i32;
        let mut moved = gap;
        // The chip shifts by one place at a time; the whole gap at once would take 20.
        let mut mask = 0;
        for _ in 0..config.average {
            moved >>= 1;
            mask = mask << 1 | 1;
        }
        self.remainder = gap as u8 & mask;
        let position = moved + self.fraction as i32;
        self.counts = self.counts.wrapping_add((position >> 8) >> 4);
        self.fraction = (position & ((1 << POSITION_FRACTION) - 1)) as i16;
        // Counts a tick with 8 fractional bits.
        let bits = call_mul_i16_u16(call_saturate_i16(moved >> 4), config.speed_scale);
        (self.counts, call_saturate_i16(if config.fine { bits >> 16 } else { bits >> 8 }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn settings(acceleration: f32, jerk_ms: f32, cruise: f32) -> Settings {
        let mut settings = Settings::defaults();
        let values = [(Param::Acceleration, acceleration), (Param::JerkTime, jerk_ms), (Param::CruiseSpeed, cruise)];
        for (param, value) in values {
            settings.set(param, value).unwrap();
        }
        settings
    }

    proptest! {
        /// A speed arrives exactly, in the time of the exact S-curve, and never passes a target that it can still reach.
        /// Acceleration and jerk stay within their limits at every tick, whatever targets come in between.
        #[test]
        fn speed_profile(
            acceleration in 20f32..50_000.0, jerk_ms in prop_oneof![Just(0.0f32), 1f32..255.0],
            start in -30000i16..30000, targets in proptest::collection::vec((-30000i16..30000, 1usize..400), 1..6),
        ) {
            let Ok(config) = TrajectoryConfig::build(&settings(acceleration, jerk_ms, 100.0)) else { return Ok(()) };
            let mut profile = SpeedProfile::start(start);
            let bit = 16384.0;
            let limit = acceleration as f64 * 0.064;
            let jerk = limit / (jerk_ms as f64).max(1.0);
            let (mut before, mut rate_before) = (profile.value as f64 / bit, 0.0);
            let last = targets.len() - 1;
            for (i, (target, ticks)) in targets.into_iter().enumerate() {
                profile.retarget(target);
                let mut left = if i == last { 2_000_000 } else { ticks };
                while profile.moving() && left > 0 {
                    profile.step(&config);
                    let value = profile.value as f64 / bit;
                    let rate = value - before;
                    prop_assert!(rate.abs() <= limit * 1.000_001 + 2e-4, "rate {rate} over {limit}");
                    // The last tick of a move takes what is left, less than one step, and a new move may follow at once.
                    prop_assert!((rate - rate_before).abs() <= 2.0 * jerk + 2e-4, "jerk {} over {jerk}", rate - rate_before);
                    (before, rate_before) = (value, rate);
                    left -= 1;
                }
            }
            prop_assert!(!profile.moving());
            prop_assert_eq!(profile.value, profile.target);
        }

        /// From rest: no overshoot, and as fast as the limits allow.
        #[test]
        fn speed_profile_time(acceleration in 50f32..20_000.0, jerk_ms in 0f32..200.0, target in 500i16..30000) {
            let Ok(config) = TrajectoryConfig::build(&settings(acceleration, jerk_ms, 100.0)) else { return Ok(()) };
            let mut profile = SpeedProfile::start(0);
            profile.retarget(target);
            let mut ticks = 0;
            while profile.moving() {
                let value = profile.step(&config);
                prop_assert!((0..=target).contains(&value));
                ticks += 1;
            }
            // Exact: full acceleration reached or not.
            let (change, limit, ramp) = (target as f64, acceleration as f64 * 0.064, (jerk_ms as f64).max(1.0));
            let exact = if change > limit * ramp { change / limit + ramp } else { 2.0 * (change * ramp / limit).sqrt() };
            // The rounding of the step shows in long moves.
            let tolerance = 4.0 + ramp + exact * (1.0 / config.ramps[SPEED].0[0] as f64);
            prop_assert!((ticks as f64 - exact).abs() <= tolerance, "{ticks} for {exact}");
        }

        /// Position: arrives exactly, stays within a count of the way, with speed and acceleration within their limits.
        #[test]
        fn position_profile(
            acceleration in 100f32..20_000.0, jerk_ms in prop_oneof![Just(0.0f32), 2f32..255.0], cruise in 1f32..300.0,
            start in -1_000_000i32..1_000_000, targets in proptest::collection::vec((-30_000i32..30_000, 1usize..600), 1..5),
        ) {
            let settings = settings(acceleration, jerk_ms, cruise);
            let Ok(config) = TrajectoryConfig::build(&settings) else { return Ok(()) };
            let counts = 2000.0 / std::f64::consts::TAU;
            let fastest = cruise as f64 * counts / 1000.0;
            let mut profile = PositionProfile::start(start);
            let scale = (1i64 << config.average) as f64;
            let position = |profile: &PositionProfile| {
                profile.counts as f64 + (profile.fraction as f64 + profile.remainder as f64 / scale) / 4096.0
            };
            let (mut before, mut rate_before) = (position(&profile), 0.0);
            let last = targets.len() - 1;
            let step = config.ramps[POSITION].0[0] as f64 / 4096.0;
            for (i, (target, ticks)) in targets.into_iter().enumerate() {
                profile.retarget(start + target);
                let mut left = if i == last { 1_000_000 } else { ticks };
                while profile.moving() && left > 0 {
                    let (_, speed) = profile.step(&config);
                    let now = position(&profile);
                    let rate = now - before;
                    prop_assert!(rate.abs() <= fastest + 1e-3, "{rate} over {fastest}");
                    prop_assert!((rate - rate_before).abs() <= 2.0 * step + 1e-3, "{}", rate - rate_before);
                    let bits = rate / counts * 1000.0 * 64.0;
                    prop_assert!((speed as f64 - bits).abs() <= 2.0 + bits.abs() * 0.01 + 64.0 / counts * 4.0, "{speed} for {bits}");
                    (before, rate_before) = (now, rate);
                    left -= 1;
                }
            }
            prop_assert!(!profile.moving());
            prop_assert_eq!((profile.counts, profile.fraction, profile.remainder), (profile.target, 0, 0));
        }
    }

    #[test]
    fn an_s_curve_limits_the_jerk_of_a_position_move() {
        let jerk = |jerk_ms: f32| {
            let config = TrajectoryConfig::build(&settings(2000.0, jerk_ms, 50.0)).unwrap();
            let mut profile = PositionProfile::start(0);
            profile.retarget(20_000);
            let (mut speeds, mut count) = (vec![0i32], 0);
            while profile.moving() {
                speeds.push(profile.step(&config).1 as i32);
                count += 1;
            }
            assert_eq!(profile.counts, 20_000);
            let largest = speeds.windows(3).map(|w| (w[2] - 2 * w[1] + w[0]).abs()).max().unwrap();
            (largest, count)
        };
        let ((trapezoid, short), (s_curve, long)) = (jerk(0.0), jerk(64.0));
        assert!(s_curve * 16 < trapezoid, "{s_curve} {trapezoid}");
        assert_eq!(long, short + 63);
    }

    #[test]
    fn limits_that_do_not_fit_are_named() {
        let build = |a, j, c| TrajectoryConfig::build(&settings(a, j, c)).map(|_| ());
        assert_eq!(build(0.1, 0.0, 0.01), Err(Rule::RoundsToZero.of(Param::Acceleration)));
        assert_eq!(build(900_000.0, 255.0, 10.0), Err(Rule::TooLarge.of(Param::JerkTime)));
        assert_eq!(build(1.0, 0.0, 1000.0), Err(Rule::TooLarge.of(Param::CruiseSpeed)));
    }

    /// The fastest move of all that are accepted does not leave 32 bits, and what would is refused.
    #[test]
    fn the_gap_of_an_s_curve_fits() {
        let mut settings = settings(29_000.0, 255.0, 500.0);
        settings.set(Param::SpeedRange, 4096.0).unwrap();
        settings.set(Param::CountsPerRev, 65_000.0).unwrap();
        assert_eq!(TrajectoryConfig::build(&settings).map(|_| ()), Err(Rule::TooLarge.of(Param::JerkTime)));
        // 953 counts a tick over 256 ticks.
        settings.set(Param::CruiseSpeed, 92.0).unwrap();
        let config = TrajectoryConfig::build(&settings).unwrap();
        let mut profile = PositionProfile::start(0);
        profile.retarget(2_000_000);
        let mut before = 0;
        while profile.moving() {
            let (counts, speed) = profile.step(&config);
            assert!(counts >= before && speed >= 0, "{counts} after {before}, {speed}");
            before = counts;
        }
        assert_eq!(before, 2_000_000);
    }
}

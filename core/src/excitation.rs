//! Excitation signals, played at the control rate with exact timing, repeatable from a seed.
//!
//! Every signal is `offset` plus a deviation within +-`amplitude`, in bits of the reference of the present mode (voltage,
//! speed, or counts). `period` is in ticks. Periods and segments (holds, steps, stairs or bits) are counted in 16 bits. A
//! sequence that needs more is refused, and so is a chirp that is too fast for the ticks: [`Excess`].
//!
//! | kind | signal | length in ticks |
//! |---|---|---|
//! | `steps` | +A, 0, -A, 0, each for one period; `count` times | 4 period count |
//! | `ramp` | 0 to +A to -A to 0, a quarter each period; `count` times | 4 period count |
//! | `stairs` | up to +A, down to -A and back in `count` equal stairs each way, one period each | 4 period count |
//! | `prbs` | +-A, a new bit of x^15 + x^14 + 1 each period, `count` bits; repeats after 32,767 | period count |
//! | `levels` | uniform random levels, one each period, `count` levels | period count |
//! | `chirp` | sine, linear sweep from 0 to `2 count / period` cycles a tick, `count` cycles in all | period |
//! | `coast` | +A, bridge off, +A, braking, then the same with -A, each for one period; `count` times | 8 period count |
//! | `identify` | the ones above that tell the most apart, see `STAGES`; 20 s with 500 ms | 40 period |
//!
//! The divisions are done once, when the [`Sequence`] is made; playing it takes additions only (and for the chirp one
//! product).

use crate::arith::{call_mul_i16, call_mul_i16_u16, call_saturate_i16, saturating_add_i16, whole};
use avr_progmem::progmem;

/// A sequence to play.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(C)]
pub struct Sequence {
    /// Which signal.
    kind: Kind,
    /// Largest deviation from the offset, in bits of the reference.
    amplitude: i16,
    /// Centre of the signal, in bits of the reference.
    offset: i16,
    /// Length of one hold, step or bit, or of the whole sweep, in ticks.
    period: u16,
    /// How many of them.
    count: u16,
    /// Seed of the random signals.
    seed: u16,
    /// What one tick adds: bits times 2^16 (ramp), one stair in bits times 2^16, or turns times 2^32 a tick (chirp).
    slope: i32,
}

impl Sequence {
    /// A sequence; zero `period`, `count` or `seed` are taken as one. `period` is in ticks, see [`Settings::ticks`].
    /// Divides, so not for the tick.
    ///
    /// # Errors
    /// A period or a count that it could not play to the end.
    ///
    /// [`Settings::ticks`]: crate::settings::Settings::ticks
    pub fn new(kind: Kind, amplitude: i16, offset: i16, period: u32, count: u16, seed: u16) -> Result<Self, Excess> {
        // The composite plays a stage at twice the period.
        let longest = if kind == Kind::Identify { u16::MAX >> 1 } else { u16::MAX };
        if period > longest as u32 {
            return Err(Excess::Period(longest));
        }
        let (period, count, seed) = ((period as u16).max(1), count.max(1), seed.max(1));
        // A chirp ends with half a cycle a tick at most: what is faster looks slower.
        let most = if kind == Kind::Chirp { (period >> 2).max(1) } else { u16::MAX >> kind.segments_log2() };
        if count > most {
            return Err(Excess::Count(most));
        }
        let full = (amplitude as i32) << 16;
        let slope = match kind {
            Kind::Ramp | Kind::Identify => full / period as i32,
            Kind::Stairs => full / count as i32,
            // The phase is half the slope times the square of the time: `count` turns of 2^32 at the end.
            Kind::Chirp => whole(count as f32 * 8_589_934_592.0 / (period as f32 * period as f32)),
            _ => 0,
        };
        Ok(Self { kind, amplitude, offset, period, count, seed, slope })
    }

    /// How many segments it plays; the composite's are those of its stages.
    fn segments(&self) -> u16 {
        match self.kind {
            Kind::Identify => 0,
            Kind::Chirp => 1,
            kind => self.count << kind.segments_log2(),
        }
    }

    /// Exactly how many ticks it plays.
    pub fn duration_ticks(&self) -> u32 {
        let period = self.period as u32;
        match self.kind {
            Kind::Identify => 28 * period + 48 * (period >> 2).max(1),
            _ => period * self.segments() as u32,
        }
    }
}

/// What a sequence was asked for that it cannot play, and the most that it can.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Excess {
    /// The period, in ticks: 16 bits hold it, and twice that of the composite.
    Period(u16),
    /// The count: 16 bits hold the segments that the kind makes of it. A chirp has at most a cycle in four ticks.
    Count(u16),
}

/// The signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Kind {
    /// Steps both ways.
    #[default]
    Steps = 0,
    /// Ramp through zero.
    Ramp = 1,
    /// Staircase up and down.
    Stairs = 2,
    /// Pseudo-random binary sequence.
    Prbs = 3,
    /// Random levels.
    Levels = 4,
    /// Linear sine sweep.
    Chirp = 5,
    /// Coast-down with the bridge off and with it braking.
    Coast = 6,
    /// The composite for identification.
    Identify = 7,
}

impl Kind {
    /// How many there are.
    pub const COUNT: u8 = 8;

    /// By number.
    pub const fn from_number(number: u8) -> Option<Self> {
        Some(match number {
            0 => Self::Steps,
            1 => Self::Ramp,
            2 => Self::Stairs,
            3 => Self::Prbs,
            4 => Self::Levels,
            5 => Self::Chirp,
            6 => Self::Coast,
            7 => Self::Identify,
            _ => return None,
        })
    }

    /// Segments for each `count`, as a power of two.
    const fn segments_log2(self) -> u8 {
        // Not as one `match`: of that a table in RAM is made.
        if matches!(self, Self::Coast) {
            3
        } else if self as u8 <= Self::Stairs as u8 {
            2
        } else {
            0
        }
    }
}

/// What the bridge does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Bridge {
    /// Off: the motor runs free.
    #[default]
    Coast = 0,
    /// Both ends of the motor together: it brakes.
    Brake = 1,
    /// Driven.
    Drive = 2,
}

/// One tick of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Play {
    /// The reference, in bits.
    pub value: i16,
    /// What the bridge is to do.
    pub bridge: Bridge,
    /// The sequence is over; the value is its offset.
    pub done: bool,
}

/// A stage of [`Kind::Identify`]: a kind, how often its amplitude and period are halved, and how many segments are played.
/// A negative number doubles the period.
#[derive(Clone, Copy)]
struct Stage {
    kind: Kind,
    halve_amplitude: u8,
    halve_period: i8,
    segments: u8,
}

const fn stage(kind: Kind, halve_amplitude: u8, halve_period: i8, segments: u8) -> Stage {
    Stage { kind, halve_amplitude, halve_period, segments }
}

progmem! {
    /// The stages of [`Kind::Identify`] and how many periods each takes: ramp through zero, slow (8); steps both ways,
    /// full (4) and half (4); random levels (12); coast-down and braking both ways (8); small ramp through zero (4).
    static progmem STAGES: [Stage; 6] = [
        stage(Kind::Ramp, 0, -1, 4),
        stage(Kind::Steps, 0, 0, 4),
        stage(Kind::Steps, 1, 0, 4),
        stage(Kind::Levels, 0, 2, 48),
        stage(Kind::Coast, 0, 0, 8),
        stage(Kind::Ramp, 2, 0, 4),
    ];
    /// A quarter of a sine in 64 steps, times 2^15 - 1.
    static progmem SINE: [i16; 65] = quarter_sine();
}

/// Sine by its recurrence `s(k+1) = 2 cos(d) s(k) - s(k-1)`, which a constant expression can compute.
const fn quarter_sine() -> [i16; 65] {
    // cos and sin of pi / 128.
    let (cos, mut now, mut before) = (0.999_698_818_696_204_2_f64, 0.024_541_228_522_912_288_f64, 0.0_f64);
    let mut table = [0; 65];
    let mut i = 1;
    while i <= 64 {
        table[i] = (now * 32767.0 + 0.5) as i16;
        (now, before) = (2.0 * cos * now - before, now);
        i += 1;
    }
    table
}

/// Plays a [`Sequence`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Player {
    sequence: Sequence,
    /// Kind and amplitude that play now; of the stage, for the composite.
    kind: Kind,
    amplitude: i16,
    period: u16,
    /// Segments left, after this one.
    segments: u16,
    /// Segment number within its kind.
    segment: u16,
    stage: u8,
    bridge: Bridge,
    /// Ticks left of the segment.
    left: u16,
    /// Deviation times 2^16; the chirp's phase, in turns times 2^32.
    value: i32,
    /// What a tick adds to it.
    rate: i32,
    random: u16,
}

impl Player {
    /// Begins a sequence; the first step gives its first value.
    pub fn start(&mut self, sequence: &Sequence) {
        *self = Self { sequence: *sequence, kind: sequence.kind, amplitude: sequence.amplitude, ..Self::default() };
        self.period = sequence.period;
        self.random = sequence.seed;
        self.segments = sequence.segments();
    }

    /// One tick.
    #[inline(never)]
    pub fn step(&mut self) -> Play {
        if self.left == 0 && !self.next_segment() {
            return Play { value: self.sequence.offset, bridge: Bridge::Coast, done: true };
        }
        self.left -= 1;
        let deviation = if self.kind == Kind::Chirp { self.sweep() } else { (self.value >> 16) as i16 };
        self.value = self.value.wrapping_add(self.rate);
        Play { value: saturating_add_i16(self.sequence.offset, deviation), bridge: self.bridge, done: false }
    }

    /// Prepares the next segment; false at the end. Not on the path of an ordinary tick.
    #[inline(never)]
    fn next_segment(&mut self) -> bool {
        if self.segments == 0 && !self.next_stage() {
            return false;
        }
        self.segments -= 1;
        self.left = self.period;
        self.bridge = Bridge::Drive;
        let quarter = self.segment as u8 & 3;
        // Positive, zero, negative, zero; the ramp passes through these one segment later.
        let phase = if self.kind == Kind::Ramp { quarter.wrapping_sub(1) & 3 } else { quarter };
        let mut level = match phase {
            0 => self.amplitude,
            2 => -self.amplitude,
            _ => 0,
        };
        match self.kind {
            Kind::Steps | Kind::Identify => {}
            Kind::Ramp => self.rate = if quarter == 1 || quarter == 2 { -self.ramp_slope() } else { self.ramp_slope() },
            Kind::Prbs => level = if self.random_bit() { self.amplitude } else { -self.amplitude },
            Kind::Levels => level = (call_mul_i16(self.amplitude, self.random_level()) << 1 >> 16) as i16,
            Kind::Coast => level = self.coast(),
            Kind::Stairs | Kind::Chirp => {}
        }
        if self.kind == Kind::Stairs {
            self.climb();
        } else {
            self.value = (level as i32) << 16;
        }
        self.segment = self.segment.wrapping_add(1);
        true
    }

    /// The next stage of the composite; false where there is none.
    fn next_stage(&mut self) -> bool {
        if self.sequence.kind != Kind::Identify || self.stage as usize >= STAGES.len() {
            return false;
        }
        let stage = STAGES.load_at(self.stage as usize);
        self.stage += 1;
        self.kind = stage.kind;
        self.amplitude = self.sequence.amplitude >> stage.halve_amplitude;
        let period = self.sequence.period;
        self.period = if stage.halve_period < 0 { period << 1 } else { (period >> stage.halve_period).max(1) };
        (self.segments, self.segment, self.rate) = (stage.segments as u16, 0, 0);
        true
    }

    /// The slope of a ramp; the composite's ramps are slower or smaller than the sequence's.
    fn ramp_slope(&self) -> i32 {
        match self.stage {
            0 => self.sequence.slope,
            1 => self.sequence.slope >> 1,
            _ => self.sequence.slope >> 2,
        }
    }

    /// One stair up or down: up for a quarter of all, down for two, up for one.
    fn climb(&mut self) {
        let count = self.sequence.count;
        let up = self.segment < count || self.segment >= 3 * count;
        let stair = if up { self.sequence.slope } else { -self.sequence.slope };
        self.value = self.value.wrapping_add(stair);
    }

    /// Drive, off, drive, brake; then the other way. The level to drive at.
    fn coast(&mut self) -> i16 {
        match self.segment as u8 & 3 {
            1 => self.bridge = Bridge::Coast,
            3 => self.bridge = Bridge::Brake,
            _ => return if self.segment & 4 == 0 { self.amplitude } else { -self.amplitude },
        }
        0
    }

    /// Next bit of the maximal-length sequence of x^15 + x^14 + 1.
    fn random_bit(&mut self) -> bool {
        let bit = (self.random ^ (self.random >> 1)) & 1;
        self.random = (self.random & 0x7fff) >> 1 | bit << 14;
        bit != 0
    }

    /// -2^15..2^15, uniform: a 16-bit xorshift with full period (shifts 7, 9, 8).
    fn random_level(&mut self) -> i16 {
        self.random ^= self.random << 7;
        self.random ^= self.random >> 9;
        self.random ^= self.random << 8;
        self.random as i16
    }

    /// The chirp: the phase goes on by its rate, the rate by the slope.
    #[inline(always)]
    fn sweep(&mut self) -> i16 {
        let sine = sine((self.value as u32 >> 16) as u16);
        self.rate = self.rate.wrapping_add(self.sequence.slope);
        call_saturate_i16(call_mul_i16(self.amplitude, sine) >> 15)
    }
}

/// Sine of a phase in turns times 2^16, times 2^15 - 1; linear between 256 points, within 4 bits.
fn sine(phase: u16) -> i16 {
    let quarter = phase & 0x3fff;
    let position = if phase & 0x4000 == 0 { quarter } else { 0x4000 - quarter };
    let index = ((position >> 8) & 63) as usize;
    let magnitude = if position == 0x4000 {
        SINE.load_at(64)
    } else {
        let (left, right) = (SINE.load_at(index), SINE.load_at(index + 1));
        left + (call_mul_i16_u16(right - left, position << 8) >> 16) as i16
    };
    if phase & 0x8000 == 0 { magnitude } else { -magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sequence(kind: Kind, amplitude: i16, offset: i16, period: u32, count: u16, seed: u16) -> Sequence {
        Sequence::new(kind, amplitude, offset, period, count, seed).unwrap()
    }

    fn play(sequence: Sequence) -> Vec<Play> {
        let mut player = Player::default();
        player.start(&sequence);
        std::iter::from_fn(|| Some(player.step()).filter(|play| !play.done)).collect()
    }

    fn values(sequence: Sequence) -> Vec<i16> {
        play(sequence).iter().map(|play| play.value).collect()
    }

    proptest! {
        /// The length is what it says, to the tick, and the signal stays within its amplitude.
        #[test]
        fn length_and_range(
            kind in 0u8..Kind::COUNT, amplitude: i16, offset: i16, period in 0u32..60, count in 0u16..20, seed: u16,
        ) {
            let kind = Kind::from_number(kind).unwrap();
            let Ok(sequence) = Sequence::new(kind, amplitude, offset, period, count, seed) else {
                prop_assert!(kind == Kind::Chirp && count as u32 > period / 4);
                return Ok(());
            };
            let played = play(sequence);
            prop_assert_eq!(played.len() as u32, sequence.duration_ticks());
            for tick in played {
                let deviation = (tick.value as i32 - offset as i32).abs();
                prop_assert!(deviation <= (amplitude as i32).abs() + 1, "{deviation}");
            }
        }

        #[test]
        fn sine_is_a_sine(phase: u16) {
            let exact = (phase as f64 / 65536.0 * std::f64::consts::TAU).sin() * 32767.0;
            prop_assert!((sine(phase) as f64 - exact).abs() <= 4.0, "{} for {exact}", sine(phase));
        }

        #[test]
        fn the_ramp_is_straight_and_goes_through_zero(amplitude in -30000i16..30000, period in 1u32..500) {
            let played = values(sequence(Kind::Ramp, amplitude, 0, period, 1, 1));
            for (tick, value) in played.into_iter().enumerate() {
                let t = tick as f64 / period as f64;
                let shape = if t < 1.0 { t } else if t < 3.0 { 2.0 - t } else { t - 4.0 };
                prop_assert!((value as f64 - amplitude as f64 * shape).abs() <= 2.0, "{tick}: {value}");
            }
        }

        /// The sweep's phase is `count (t / period)^2` turns; the slope's rounding may shift its end by a percent.
        #[test]
        fn chirp_sweeps(period in 1000u32..20_000, count in 5u16..60) {
            let played = values(sequence(Kind::Chirp, 20_000, 0, period, count, 1));
            let crossings = played.windows(2).filter(|w| (w[0] < 0) != (w[1] < 0)).count() as f64;
            prop_assert!((crossings - 2.0 * count as f64).abs() <= 2.0 + 0.03 * count as f64, "{crossings} for {count}");
        }
    }

    #[test]
    fn golden_values() {
        assert_eq!(values(sequence(Kind::Steps, 100, 5, 2, 1, 1)), [105, 105, 5, 5, -95, -95, 5, 5]);
        assert_eq!(values(sequence(Kind::Stairs, 100, 0, 1, 2, 1)), [50, 100, 50, 0, -50, -100, -50, 0]);
        let bits: Vec<bool> = values(sequence(Kind::Prbs, 1, 0, 1, 20, 0x1234)).iter().map(|&v| v > 0).collect();
        let again: Vec<bool> = values(sequence(Kind::Prbs, 1, 0, 1, 20, 0x1234)).iter().map(|&v| v > 0).collect();
        assert_eq!(bits, again);
        assert_eq!(bits.iter().map(|&b| if b { '1' } else { '0' }).collect::<String>(), "01110100110110010011");
        assert_eq!(values(sequence(Kind::Levels, 1000, 0, 1, 5, 7)), [-957, -222, 95, -698, 428]);
    }

    #[test]
    fn the_prbs_has_maximal_length_and_balance() {
        let bits = values(sequence(Kind::Prbs, 1, 0, 1, 65_535, 1));
        assert_eq!(bits[..32_767].iter().filter(|&&v| v > 0).count(), 16_384);
        assert_eq!(bits[..32_768], bits[32_767..65_535]);
        // Autocorrelation of a maximal-length sequence: -1 at every shift.
        for shift in [1, 2, 3, 100, 5000] {
            let sum: i32 = (0..32_767).map(|i| bits[i] as i32 * bits[(i + shift) % 32_767] as i32).sum();
            assert_eq!(sum, -1, "{shift}");
        }
    }

    #[test]
    fn levels_are_uniform() {
        let levels = values(sequence(Kind::Levels, 32_767, 0, 1, 65_535, 1));
        let mean = levels.iter().map(|&v| v as f64).sum::<f64>() / 65_535.0;
        let variance = levels.iter().map(|&v| (v as f64).powi(2)).sum::<f64>() / 65_535.0;
        assert!(mean.abs() < 100.0 && (variance.sqrt() / 18_918.0 - 1.0).abs() < 0.01, "{mean} {variance}");
    }

    /// What is beyond 16 bits is refused; what is just within plays to its end, where a staircase is back at its foot.
    #[test]
    fn what_16_bits_cannot_count_is_refused() {
        for kind in (0..Kind::COUNT).filter_map(Kind::from_number) {
            let made = |period, count| Sequence::new(kind, 1000, 0, period, count, 1);
            let longest = if kind == Kind::Identify { 32_767 } else { 65_535 };
            let most = match kind {
                Kind::Steps | Kind::Ramp | Kind::Stairs => 16_383,
                Kind::Coast => 8191,
                // Within the longest sweep.
                Kind::Chirp => 16_383,
                _ => 65_535,
            };
            for too_long in [longest + 1, 131_070] {
                assert_eq!(made(too_long, 1), Err(Excess::Period(longest as u16)), "{kind:?}");
            }
            for too_many in (most..=65_535).skip(1).step_by(5461) {
                assert_eq!(made(longest, too_many), Err(Excess::Count(most)), "{kind:?}");
            }
            let shortest = if kind == Kind::Chirp { longest } else { 1 };
            for sequence in [made(longest, 1), made(shortest, most)].map(Result::unwrap) {
                let played = play(sequence);
                assert_eq!(played.len() as u32, sequence.duration_ticks(), "{kind:?}");
                assert!(kind != Kind::Stairs || played.last().unwrap().value.abs() <= 1, "{:?}", played.last());
            }
        }
    }

    #[test]
    fn coasting_and_braking() {
        use Bridge::{Brake, Coast, Drive};
        let bridges: Vec<Bridge> = play(sequence(Kind::Coast, 9, 0, 1, 1, 1)).iter().map(|p| p.bridge).collect();
        assert_eq!(bridges, [Drive, Coast, Drive, Brake, Drive, Coast, Drive, Brake]);
        // The composite has both, both ways, and every other ingredient.
        let all = play(sequence(Kind::Identify, 8000, 0, 500, 1, 3));
        assert_eq!(all.len(), 20_000);
        assert_eq!(all.iter().filter(|p| p.bridge == Coast).count(), 1000);
        assert_eq!(all.iter().filter(|p| p.bridge == Brake).count(), 1000);
        assert!(all.iter().any(|p| p.value == 8000) && all.iter().any(|p| p.value == -8000));
    }
}

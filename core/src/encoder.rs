//! Quadrature encoder: x4 decoding, wide count, and speed by count difference and edge timing together (M/T method).
//!
//! ## Decoding
//! The interrupt handler keeps an 8-bit count whose two low bits always equal the state of the lines,
//! `B << 1 | (A ^ B)`. The new state minus the count, modulo 4, is then the step: +1 or -1; 0 is a pulse that was gone
//! before it was read; 2 is an illegal transition (both lines changed): it is counted, and the motion is assumed to
//! have gone on the way it went. A leads B: positive. [`Edges::on_edge`] is that handler in Rust; on the chip it is the
//! same in assembly, and a test on the simulated chip holds the two together.
//!
//! ## Time stamps
//! Each edge is stamped with Timer0 (64 cycles a count) and Timer2 (1 cycle a count), one byte each. The two overlap
//! in two bits. Together they give the time to one cycle (62.5 ns) within 16,384 cycles. The two timers may be misaligned
//! by up to 95 cycles.
//!
//! ## Speed
//! At every tick with edges it is the distance from the last edge known before to the last edge now, divided by the time
//! between the two. An edge up to count n stands at n - 1/2, an edge down to n at n + 1/2. So turning back over one edge is
//! a distance of zero, and reversal needs no special case. At a tick without edges the speed is at most one count over the
//! time since the last edge. The estimate falls with that bound, and after 1.05 s it is zero.
//!
//! | speed | edges a tick | resolution | lag |
//! |---|---|---|---|
//! | above one edge a tick | >= 1 | 1 cycle in a tick (0.006 %) + reciprocal 0.01 % + 1 bit | half a tick + age of the last edge (<= 1 edge) |
//! | below | < 1 | same, per edge | half the time between two edges |
//! | slower than one count in 1.05 s | 0 | zero | 1.05 s |
//!
//! With 2000 counts a turn the slowest speed seen is 0.03 rpm; the largest is 127 counts a tick, 127,000 edges/s.

use crate::arith::{mul_i16_u16, mul_u16, saturate_i16};
use crate::quantiser::Quantiser;
use crate::settings::{BuildError, Param, Settings};
use crate::units::{FULL_RANGE, Rule};
use avr_progmem::progmem;

/// What the interrupt handler keeps, as the tick takes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(C)]
pub struct Edges {
    /// Position modulo 256; the low two bits are the state of the lines.
    pub count: u8,
    /// Bit 1 is the direction of the last step: set, it was -1.
    pub step: u8,
    /// Timer0 at the last step, 64 cycles a count.
    pub coarse: u8,
    /// Timer2 at the last step, 1 cycle a count.
    pub fine: u8,
    /// Illegal transitions, modulo 256.
    pub illegal: u8,
}

/// Bit of [`Edges::step`] that says the last step was backward.
const BACKWARD: u8 = 2;

impl Edges {
    /// The count that fits the lines as they stand, for the start.
    pub fn at_rest(lines: u8) -> Self {
        Self { count: Self::state(lines), ..Self::default() }
    }

    /// Position within the four states: `B << 1 | (A ^ B)`, from the port as read (A in bit 2, B in bit 3).
    #[inline(always)]
    fn state(port: u8) -> u8 {
        let lines = (port >> 2) & 3;
        lines ^ (lines >> 1)
    }

    /// An edge on either line: `port` as read, and the two timers.
    pub fn on_edge(&mut self, port: u8, coarse: u8, fine: u8) {
        let step = Self::state(port).wrapping_sub(self.count);
        match step & 3 {
            0 => return,
            2 => {
                self.illegal = self.illegal.wrapping_add(1);
                self.count = self.count.wrapping_add(if self.step & BACKWARD == 0 { 2 } else { 0xfe });
            }
            odd => {
                self.count = self.count.wrapping_add(if odd & BACKWARD == 0 { 1 } else { 0xff });
                self.step = step;
            }
        }
        self.coarse = coarse;
        self.fine = fine;
    }
}

/// The scale of the speed: speed bits = half counts x `mantissa` x 2^(15 - `shift`) / cycles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct SpeedConfig {
    /// 2^15..2^16.
    mantissa: u16,
    /// Right shift that belongs to it.
    shift: i8,
    /// Cycles between two ticks.
    tick_cycles: u16,
}

/// Cycles of the chip in a second.
const CYCLES_PER_S: f32 = crate::HARDWARE.clock_hz as f32;
// The two bytes of a stamp overlap by this: see the module.
const _: () = assert!(crate::HARDWARE.coarse_timer_shift == 6);

impl SpeedConfig {
    /// From `counts_per_rev`, `speed_range` and `tick_rate` (1000 or 2000 Hz); a scale outside the format is blamed on
    /// `counts_per_rev`.
    #[inline(always)]
    pub fn quantised(q: &mut Quantiser) -> Self {
        q.power_of_two(Param::SpeedRange);
        let tick_cycles = if q.is_fast() { 8_000 } else { 16_000 };
        if q.of(tick_cycles as f32).times(Param::TickRate).value() != CYCLES_PER_S {
            q.refuse(Param::TickRate, Rule::NotAllowed);
        }
        q.of(core::f32::consts::PI * CYCLES_PER_S * FULL_RANGE).over(Param::SpeedRange).over(Param::CountsPerRev);
        // A positive number's own exponent and mantissa, the mantissa rounded to 16 bits; a carry doubles both.
        let bits = q.value().to_bits() + 0x80;
        let mantissa = (bits >> 8) as u16 | 0x8000;
        let shift = 15 + 127 + 15 - (bits >> 23) as u16 as i16;
        if !(-20..=40).contains(&shift) {
            q.refuse(Param::CountsPerRev, Rule::TooLarge);
        }
        Self { mantissa, shift: shift as i8, tick_cycles }
    }

    /// The same, on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn build(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build(settings, Self::quantised)
    }
}

/// What the edges say of the shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Proof {
    /// Edges have come in this tick.
    pub came: bool,
    /// Count, modulo 256, at which the shaft was last seen to move. A motion is more than two counts, because a faulty line
    /// alone goes to and fro by one.
    pub place: u8,
    /// Illegal transitions, modulo 256.
    pub illegal: u8,
}

/// So far may the count go, in either direction, before it is a motion.
const PLACE: i8 = 2;

/// The measured motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct SpeedState {
    /// Position in counts; wraps after 2^31.
    pub counts: i32,
    /// Speed, bits of [`crate::units::Speed`].
    pub speed: i16,
    /// Illegal transitions since reset; stays at the largest.
    pub illegal: u16,
    /// The last edges seen.
    edges: Edges,
    /// Count at which the shaft was last seen to move.
    place: u8,
    /// Cycles from the last edge to the present tick, and [`LATE`] more; saturates at [`LONGEST`].
    elapsed: Cycles,
}

/// A time of up to 24 bits. In two parts, because the usual one, of a tick or two, needs the lower part only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
struct Cycles {
    low: u16,
    high: u8,
}

/// After this long (1.05 s) without an edge the shaft stands still.
const LONGEST: Cycles = Cycles { low: 0, high: 0xff };
/// An edge may come between the tick's instant and its handler. So the handler must take the edges within 256 cycles, less
/// the misalignment of the timers. Times since an edge are kept with this much more, so that none is negative.
const LATE: u16 = 256;

impl Cycles {
    /// A tick later.
    #[inline(always)]
    fn later(self, cycles: u16) -> Self {
        let low = self.low.wrapping_add(cycles);
        let high = if low < cycles { self.high + 1 } else { self.high };
        if high == LONGEST.high { LONGEST } else { Self { low, high } }
    }

    /// Mantissa in 2^15..2^16 and exponent of this time less `cycles`, which is not longer.
    #[inline(always)]
    fn normalised_less(self, cycles: u16) -> (u16, i8) {
        if self.high == 0 { normalise(self.low.saturating_sub(cycles)) } else { self.long_less(cycles) }
    }

    #[inline(never)]
    fn long_less(self, cycles: u16) -> (u16, i8) {
        let high = self.high - (self.low < cycles) as u8;
        let mut low = self.low.wrapping_sub(cycles);
        if high == 0 {
            return normalise(low);
        }
        let (mut mantissa, mut exponent) = ((high as u16) << 8 | low >> 8, 8);
        low <<= 8;
        while mantissa & 0x8000 == 0 {
            mantissa = mantissa << 1 | low >> 15;
            low <<= 1;
            exponent -= 1;
        }
        (mantissa, exponent)
    }
}

impl SpeedState {
    /// Standing still, with the lines as the handler found them.
    #[cfg(test)]
    fn new(edges: Edges) -> Self {
        let mut state = Self::default();
        state.begin(edges);
        state
    }

    /// Stands still, with the lines as the handler found them.
    pub fn begin(&mut self, edges: Edges) {
        self.edges = edges;
        self.place = edges.count;
        self.elapsed = LONGEST;
    }

    /// What the edges so far prove.
    #[inline(always)]
    pub fn proof(&self, came: bool) -> Proof {
        Proof { came, place: self.place, illegal: self.edges.illegal }
    }

    /// One tick: what the handler has kept, and Timer0 at the instant of the tick. At most 127 counts a tick. Returns
    /// whether edges have come.
    #[inline(always)]
    pub fn step(&mut self, config: &SpeedConfig, edges: &Edges, tick_coarse: u8) -> bool {
        let before = self.edges;
        let elapsed = self.elapsed.later(config.tick_cycles);
        self.elapsed = elapsed;
        if edges.illegal != before.illegal {
            self.illegal = self.illegal.saturating_add(edges.illegal.wrapping_sub(before.illegal) as u16);
            self.edges.illegal = edges.illegal;
        }
        let delta = edges.count.wrapping_sub(before.count) as i8;
        let came = delta != 0 || edges.coarse != before.coarse || edges.fine != before.fine;
        let (half_counts, less) = if came {
            self.edges = *edges;
            let away = edges.count.wrapping_sub(self.place) as i8;
            if !(-PLACE..=PLACE).contains(&away) {
                self.place = edges.count;
            }
            self.counts = self.counts.wrapping_add(delta as i32);
            let age = age(tick_coarse, edges);
            self.elapsed = Cycles { low: age, high: 0 };
            // Between the last edges of both ticks: an edge up to a count stands half a count below, one down above it.
            (2 * delta as i16 + (edges.step & BACKWARD) as i16 - (before.step & BACKWARD) as i16, age)
        } else if self.speed == 0 || elapsed == LONGEST {
            self.speed = 0;
            return false;
        } else {
            // The speed can be no more than one count over the time since the last edge.
            (if self.speed > 0 { 2 } else { -2 }, LATE)
        };
        let speed = speed(config, half_counts, elapsed.normalised_less(less));
        let falls = if self.speed > 0 { speed < self.speed } else { speed > self.speed };
        if came || falls {
            self.speed = speed;
        }
        came
    }
}

/// Cycles from the last edge to the tick, and [`LATE`] more: 0..2^14.
#[inline(always)]
fn age(tick_coarse: u8, edges: &Edges) -> u16 {
    let coarse = (tick_coarse.wrapping_sub(edges.coarse) as u16) << 6;
    // Timer2 runs ahead of Timer0's count by 0..=63 ideally; read as -96..=159 it forgives a misalignment of the timers.
    let ahead = edges.fine.wrapping_sub(edges.coarse << 6).wrapping_add(96) as u16;
    coarse.wrapping_add(LATE + 96).wrapping_sub(ahead) & 0x3fff
}

/// Half counts over a time, in bits of speed. Within 2^-13 of the quotient and one bit, saturating.
#[inline(always)]
fn speed(config: &SpeedConfig, half_counts: i16, (mantissa, exponent): (u16, i8)) -> i16 {
    let quotient = (mul_u16(config.mantissa, reciprocal(mantissa)) >> 16) as u16;
    let scaled = mul_i16_u16(half_counts, quotient);
    round_shift(scaled, config.shift + exponent)
}

/// `cycles` = mantissa x 2^exponent with the mantissa in 2^15..2^16. Closer than 64 cycles no two edges are told apart.
#[inline(always)]
fn normalise(cycles: u16) -> (u16, i8) {
    let (mut mantissa, mut exponent) = (cycles.max(64), 0);
    while mantissa & 0x8000 == 0 {
        mantissa <<= 1;
        exponent -= 1;
    }
    (mantissa, exponent)
}

/// Segments of the reciprocal's table.
const SEGMENTS: usize = 64;

progmem! {
    // 2^31 / m at the borders of 64 equal segments of 2^15..=2^16, less half the bow of the chord; low byte first.
    static progmem RECIPROCALS: [u8; 2 * SEGMENTS + 2] = reciprocals();
}

const fn reciprocals() -> [u8; 2 * SEGMENTS + 2] {
    let mut table = [0; 2 * SEGMENTS + 2];
    let mut i = 0;
    while i <= SEGMENTS {
        let m = 32768 + 512 * i as u64;
        let exact = (1u64 << 31) / m;
        // The chord over a segment lies above the curve by at most (512)^2 / 4 / m^2 of the value; half of it.
        let bow = exact * 512 * 512 / (8 * m * m);
        let value = exact - bow;
        let value = if value > 65535 { 65535 } else { value as u16 };
        [table[2 * i], table[2 * i + 1]] = value.to_le_bytes();
        i += 1;
    }
    table
}

/// 2^31 / `m` for `m` in 2^15..2^16, within 6e-5 of the value.
#[inline(always)]
fn reciprocal(m: u16) -> u16 {
    // Bits 9..=14 are the segment, of two bytes.
    let (left, right) = segment((m >> 8) as u8 & 0x7e);
    left - (mul_u16(left - right, m << 7) >> 16) as u16
}

/// Both borders of the segment at `place` in the table; [`progmem!`]'s own reading of more than a byte is a loop.
#[inline(always)]
fn segment(place: u8) -> (u16, u16) {
    debug_assert!(place <= 2 * SEGMENTS as u8 - 2);
    let address = RECIPROCALS.as_ptr().cast::<u8>().wrapping_add(place as usize);
    #[cfg(target_arch = "avr")]
    {
        let (left, right);
        // SAFETY: four bytes from `place` on are within the table, which stands in the flash.
        unsafe {
            core::arch::asm!(
                "lpm {left:l}, Z+",
                "lpm {left:h}, Z+",
                "lpm {right:l}, Z+",
                "lpm {right:h}, Z+",
                left = out(reg_pair) left,
                right = out(reg_pair) right,
                inout("Z") address => _,
                options(pure, readonly, nostack)
            );
        }
        (left, right)
    }
    #[cfg(not(target_arch = "avr"))]
    {
        // SAFETY: four bytes from `place` on are within the table.
        let [a, b, c, d] = unsafe { address.cast::<[u8; 4]>().read() };
        (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]))
    }
}

/// `value / 2^shift`, rounded to the nearest, saturating; `shift` of any sign.
#[inline(always)]
fn round_shift(mut value: i32, mut shift: i8) -> i16 {
    if shift <= 0 {
        // The quotient carries 14 bits and more: without a shift the speed is beyond the range.
        return if value == 0 { 0 } else { saturate_i16(if value < 0 { i32::MIN } else { i32::MAX }) };
    }
    while shift > 8 {
        value >>= 8;
        shift -= 8;
        if shift > 24 {
            return 0;
        }
    }
    while shift > 1 {
        value >>= 1;
        shift -= 1;
    }
    saturate_i16((value + 1) >> 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The lines of a shaft at `position` counts (floor): the inverse of the decoder's state.
    fn port(count: i64) -> u8 {
        let state = count.rem_euclid(4) as u8;
        let b = state >> 1;
        let a = (state & 1) ^ b;
        a << 2 | b << 3
    }

    /// Turns a motion into edges, stamps and ticks, in plain f64 and i64.
    struct Bench {
        state: SpeedState,
        edges: Edges,
        config: SpeedConfig,
        skew: i64,
        now: i64,
        looked: i64,
        last: Option<(f64, i64)>,
        previous: Option<(f64, i64)>,
        count: i64,
    }

    impl Bench {
        fn new(settings: &Settings, skew: i64) -> Self {
            let edges = Edges::at_rest(port(0));
            Self {
                state: SpeedState::new(edges),
                edges,
                config: SpeedConfig::build(settings).unwrap(),
                skew,
                now: 0,
                looked: 0,
                last: None,
                previous: None,
                count: 0,
            }
        }

        /// One tick of 16,000 cycles along `position(cycle)`; the handler takes the edges `latency` cycles late.
        fn tick(&mut self, position: &dyn Fn(f64) -> f64, latency: i64) {
            let end = self.now + 16_000;
            for cycle in self.looked + 1..=end + latency {
                self.look(position, cycle);
            }
            self.state.step(&self.config, &self.edges, (end >> 6) as u8);
            self.looked = end + latency;
            self.now = end;
        }

        fn look(&mut self, position: &dyn Fn(f64) -> f64, cycle: i64) {
            let count = position(cycle as f64).floor() as i64;
            while count != self.count {
                let up = count > self.count;
                // The border crossed, in counts.
                let border = if up { self.count + 1 } else { self.count } as f64;
                self.count += if up { 1 } else { -1 };
                self.edges.on_edge(port(self.count), (cycle >> 6) as u8, (cycle + self.skew) as u8);
                self.last = Some((border, cycle));
            }
        }

        /// Speed in bits between the last edges of this tick and before, as f64 sees it; none without both.
        fn reference(&mut self, settings: &Settings) -> Option<f64> {
            let (last, previous) = (self.last?, self.previous.replace(self.last?));
            let previous = previous?;
            if previous == last {
                return None;
            }
            let rad = (last.0 - previous.0) * 2.0 * std::f64::consts::PI / settings.get(Param::CountsPerRev) as f64;
            let time = (last.1 - previous.1) as f64 / 16e6;
            Some(rad / time / settings.get(Param::SpeedRange) as f64 * 32768.0)
        }
    }

    fn settings(counts: f32, range: f32) -> Settings {
        let mut settings = Settings::defaults();
        settings.set(Param::CountsPerRev, counts).unwrap();
        settings.set(Param::SpeedRange, range).unwrap();
        settings
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// At every tick with edges the speed is within one bit and 1.5e-4 of the quotient of exact distances and times.
        /// That holds through reversal, and for any skew of the timers and latency of the handler.
        #[test]
        fn speed_is_distance_over_time(
            counts in 48f32..8000.0, top in 0.02f64..90.0, period in 0.01f64..0.2, skew in -90i64..90, latency in 0i64..160,
        ) {
            // Top speed in counts a tick; the range that holds it.
            let rad_per_s = top * 1000.0 / counts as f64 * 2.0 * std::f64::consts::PI;
            let range = [8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0, 2048.0, 4096.0]
                .into_iter().find(|&r| r as f64 > rad_per_s * 1.05);
            prop_assume!(range.is_some());
            let settings = settings(counts, range.unwrap());
            let mut bench = Bench::new(&settings, skew);
            let omega = 2.0 * std::f64::consts::PI / (period * 16e6);
            let amplitude = top / 16_000.0 / omega;
            let position = move |cycle: f64| 0.3 + amplitude * (omega * cycle).sin();
            let mut compared = 0;
            for _ in 0..120 {
                bench.tick(&position, latency);
                prop_assert_eq!(bench.state.counts as i64, bench.count);
                if let Some(reference) = bench.reference(&settings) {
                    let error = (bench.state.speed as f64 - reference).abs();
                    prop_assert!(error <= 1.0 + 1.5e-4 * reference.abs(), "{} for {reference}", bench.state.speed);
                    compared += 1;
                } else if bench.last.is_some() {
                    // Without an edge: no more than one count since the last, which the skew of the timers shifts.
                    let (_, cycle) = bench.last.unwrap();
                    let bound = 2.0 * std::f64::consts::PI / counts as f64 / ((bench.now - cycle - skew.abs()).max(64) as f64 / 16e6)
                        / settings.get(Param::SpeedRange) as f64 * 32768.0;
                    prop_assert!((bench.state.speed as f64).abs() <= bound * 1.00015 + 1.0);
                }
            }
            prop_assert!(compared > 0 || amplitude < 1.0);
        }

        /// One jump of both lines is counted once and the position stays on the right state.
        #[test]
        fn illegal_transitions_are_counted(start in -1000i64..1000, steps in proptest::collection::vec(-2i64..=2, 1..200)) {
            let mut edges = Edges::at_rest(port(start));
            let mut expected = 0u8;
            let mut count = start;
            for step in steps {
                count += step;
                edges.on_edge(port(count), 0, 0);
                expected = expected.wrapping_add((step.abs() == 2) as u8);
                prop_assert_eq!(edges.illegal, expected);
                prop_assert_eq!(edges.count & 3, count.rem_euclid(4) as u8);
            }
        }

        /// The reciprocal is within 6e-5 over its whole range.
        #[test]
        fn reciprocal_error(m in 32768u16..=65535) {
            let exact = 2147483648.0 / m as f64;
            prop_assert!((reciprocal(m) as f64 - exact).abs() <= 6e-5 * exact + 1.0, "{m}");
        }
    }

    #[test]
    fn from_under_one_rpm_to_the_encoders_maximum() {
        let settings = settings(2000.0, 512.0);
        // 0.5 rpm is 16.7 counts/s; 3800 rpm is 127 counts a tick.
        for (rpm, tolerance_rpm) in [(0.5, 0.16), (1.0, 0.16), (10.0, 0.16), (300.0, 0.2), (3000.0, 0.6), (3790.0, 0.8)]
        {
            let mut bench = Bench::new(&settings, 0);
            let counts_per_cycle = rpm / 60.0 * 2000.0 / 16e6;
            for _ in 0..200 {
                bench.tick(&|cycle| cycle * counts_per_cycle + 0.5, 40);
            }
            let measured = bench.state.speed as f64 / 64.0 * 60.0 / (2.0 * std::f64::consts::PI);
            assert!((measured - rpm).abs() <= tolerance_rpm, "{measured} for {rpm}");
        }
    }

    #[test]
    fn a_shaft_that_stops_is_at_zero_after_a_second() {
        let settings = settings(2000.0, 512.0);
        let mut bench = Bench::new(&settings, 0);
        let stops = |cycle: f64| cycle.min(800_000.0) * 3e-4;
        for _ in 0..60 {
            bench.tick(&stops, 40);
        }
        assert!(bench.state.speed > 0);
        for _ in 0..1050 {
            bench.tick(&stops, 40);
        }
        assert_eq!(bench.state.speed, 0);
    }

    #[test]
    fn dithering_on_one_edge_is_no_speed() {
        let settings = settings(2000.0, 512.0);
        let mut bench = Bench::new(&settings, 0);
        for _ in 0..100 {
            bench.tick(&|cycle| 0.2 * (cycle / 3000.0).sin(), 40);
            assert_eq!(bench.state.speed, 0);
        }
    }

    #[test]
    fn settings_out_of_format_are_named() {
        let mut bad = settings(2000.0, 500.0);
        assert_eq!(SpeedConfig::build(&bad), Err(Rule::NotPowerOfTwo.of(Param::SpeedRange)));
        bad = settings(2000.0, 512.0);
        bad.set(Param::TickRate, 1500.0).unwrap();
        assert_eq!(SpeedConfig::build(&bad), Err(Rule::NotAllowed.of(Param::TickRate)));
    }
}

//! The quadrature encoder: from an angle to the levels of two lines, with all that can go wrong on the way.
//!
//! Turning forward, A leads B: the lines (A, B) go through 00, 10, 11, 01.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use motorbench_board::pins::{ENCODER_A, ENCODER_B};
use motorbench_core::HARDWARE;

use super::rig::Rig;
use super::sensors::Noise;

/// The lines pass no more edges of the motor than this, as those of an encoder do. The firmware is meant for fewer.
const MOST_EDGES_PER_S: u32 = 125_000;
const EDGE_CYCLES: u64 = (HARDWARE.clock_hz / MOST_EDGES_PER_S) as u64;
/// So many counts the lines may be late, for instance after a blow; what is beyond that is lost, in whole rounds of their levels.
const MOST_LATE: i64 = 64;
const ROUND: i64 = 4;

/// A lasting fault of the encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncoderFault {
    /// Plug pulled: both lines stay where the pull-ups have them, high.
    Unplugged,
    /// Line A stays at this level.
    AStuck(bool),
    /// Line B stays at this level.
    BStuck(bool),
    /// A and B exchanged against what [`Rig`] says: the feedback has the wrong sign.
    Swapped,
    /// A and B touch: open collectors, of which the low one wins.
    Shorted,
    /// Line A changes by chance, `NOISE_PER_S` times a second, whatever the shaft does.
    Noisy,
    /// The coupling slips: the encoder turns by a tenth of what the shaft does.
    Slipping,
}

/// Changes a second of a noisy line, as of a wire that lies beside the motor's 20 kHz.
const NOISE_PER_S: f64 = 20_000.0;
/// What a slipping coupling takes along.
const SLIPPING: f64 = 0.1;

/// Edges at a fixed rate, whatever the motor does.
struct Train {
    forward: bool,
    interval_cycles: f64,
    next_cycle: f64,
}

/// The encoder.
pub(super) struct Encoder {
    counts_per_rad: f64,
    swapped: bool,
    count: i64,
    /// Counts that the lines were too slow for.
    lost: i64,
    /// The lines pass the next edge of the motor from this cycle on.
    passes_from: u64,
    train: Option<Train>,
    fault: Option<EncoderFault>,
    /// Lines inverted by a disturbance right now, and further inversions by their cycle.
    inverted: u8,
    disturbances: BTreeMap<u64, u8>,
    noise: Noise,
    /// When a noisy line changes next, and whether it is inverted now.
    noise_at: Option<u64>,
    noise_inverts: bool,
    /// The encoder turns by so much of the shaft, from this angle on.
    coupling: f64,
    offset_rad: f64,
}

impl Encoder {
    pub fn new(rig: &Rig) -> Self {
        Self {
            counts_per_rad: rig.counts_per_turn * rig.encoder_gear / TAU,
            swapped: rig.encoder_swapped,
            count: 0,
            lost: 0,
            passes_from: 0,
            train: None,
            fault: None,
            inverted: 0,
            disturbances: BTreeMap::new(),
            noise: Noise::new(rig.seed),
            noise_at: None,
            noise_inverts: false,
            coupling: 1.0,
            offset_rad: 0.0,
        }
    }

    /// Position in counts; the start lies in the middle of count 0.
    fn position(&self, angle_rad: f64) -> f64 {
        (angle_rad * self.coupling + self.offset_rad) * self.counts_per_rad + 0.5
    }

    /// The count that a perfect counter of the lines would have, positive when turning forward.
    pub fn count(&self) -> i64 {
        self.count
    }

    /// A fault that begins at this cycle and angle of the shaft.
    pub fn set_fault(&mut self, now: u64, angle_rad: f64, fault: Option<EncoderFault>) {
        let coupling = if fault == Some(EncoderFault::Slipping) { SLIPPING } else { 1.0 };
        self.offset_rad += angle_rad * (self.coupling - coupling);
        self.coupling = coupling;
        self.noise_at = (fault == Some(EncoderFault::Noisy)).then(|| now + self.noise_gap());
        self.noise_inverts = false;
        self.fault = fault;
    }

    /// Cycles until a noisy line changes again: by chance, as raindrops fall.
    fn noise_gap(&mut self) -> u64 {
        (-self.noise.uniform().ln() * f64::from(HARDWARE.clock_hz) / NOISE_PER_S) as u64 + 1
    }

    /// Starts or ends a train of edges. After it the lines go on from where they are.
    pub fn set_train(&mut self, now: u64, edges_per_s: Option<f64>) {
        self.train = edges_per_s.filter(|rate| *rate != 0.0).map(|rate| {
            let interval_cycles = f64::from(HARDWARE.clock_hz) / rate.abs();
            Train { forward: rate > 0.0, interval_cycles, next_cycle: now as f64 + interval_cycles }
        });
    }

    /// Inverts lines from `start` for `width_cycles`; without a width for ever.
    pub fn disturb(&mut self, start: u64, width_cycles: Option<u64>, lines: u8) {
        *self.disturbances.entry(start).or_default() ^= lines;
        if let Some(width) = width_cycles {
            *self.disturbances.entry(start + width).or_default() ^= lines;
        }
    }

    /// Brings the lines to `cycle`, where the shaft stands at `angle_rad`.
    pub fn update(&mut self, cycle: u64, angle_rad: f64) {
        while let Some((&at, &lines)) = self.disturbances.first_key_value()
            && at <= cycle
        {
            self.inverted ^= lines;
            self.disturbances.remove(&at);
        }
        while let Some(at) = self.noise_at.filter(|at| *at <= cycle) {
            self.noise_inverts = !self.noise_inverts;
            self.noise_at = Some(at + self.noise_gap());
        }
        match &mut self.train {
            Some(train) if train.next_cycle <= cycle as f64 => {
                self.count += if train.forward { 1 } else { -1 };
                train.next_cycle += train.interval_cycles;
            }
            Some(_) => {}
            None => self.follow(cycle, angle_rad),
        }
    }

    /// One step at a time, or the lines would skip a state, and none too soon after another.
    fn follow(&mut self, cycle: u64, angle_rad: f64) {
        let late = (self.position(angle_rad).floor() as i64).saturating_sub(self.lost).saturating_sub(self.count);
        if late == 0 || cycle < self.passes_from {
            return;
        }
        self.count += late.signum();
        self.passes_from = cycle + EDGE_CYCLES;
        if late.unsigned_abs() > MOST_LATE as u64 {
            self.lost = self.lost.saturating_add((late - late.signum()) / ROUND * ROUND);
        }
    }

    /// When the lines change next, if the shaft goes on at this speed; not before the next cycle.
    pub fn next_edge(&self, cycle: u64, angle_rad: f64, speed_rad_per_s: f64) -> Option<u64> {
        let own = match &self.train {
            Some(train) => Some(train.next_cycle.ceil() as u64),
            None => {
                let crossing = self.next_crossing(angle_rad, speed_rad_per_s);
                crossing.map(|cycles| (cycle + cycles).max(self.passes_from))
            }
        };
        let disturbance = self.disturbances.keys().next().copied();
        own.into_iter().chain(disturbance).chain(self.noise_at).min().map(|at| at.max(cycle + 1))
    }

    /// Cycles until the position leaves the present count.
    fn next_crossing(&self, angle_rad: f64, speed_rad_per_s: f64) -> Option<u64> {
        let inside = self.position(angle_rad) - self.lost as f64 - self.count as f64;
        let per_cycle = speed_rad_per_s * self.coupling * self.counts_per_rad / f64::from(HARDWARE.clock_hz);
        let distance = if !(0.0..1.0).contains(&inside) {
            return Some(1);
        } else if per_cycle > 0.0 {
            1.0 - inside
        } else {
            inside
        };
        let cycles = (distance / per_cycle.abs()).ceil();
        (cycles < 1e9).then_some(cycles as u64)
    }

    /// Levels of the two lines as a mask in port D.
    pub fn lines(&self) -> u8 {
        let phase = self.count.rem_euclid(4);
        let (mut a, mut b) = (phase == 1 || phase == 2, phase >= 2);
        if self.swapped != (self.fault == Some(EncoderFault::Swapped)) {
            (a, b) = (b, a);
        }
        a ^= (self.inverted & ENCODER_A.mask() != 0) != self.noise_inverts;
        b ^= self.inverted & ENCODER_B.mask() != 0;
        match self.fault {
            Some(EncoderFault::Unplugged) => (a, b) = (true, true),
            Some(EncoderFault::AStuck(level)) => a = level,
            Some(EncoderFault::BStuck(level)) => b = level,
            Some(EncoderFault::Shorted) => (a, b) = (a && b, a && b),
            Some(EncoderFault::Swapped | EncoderFault::Noisy | EncoderFault::Slipping) | None => {}
        }
        (if a { ENCODER_A.mask() } else { 0 }) | (if b { ENCODER_B.mask() } else { 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: u8 = ENCODER_A.mask();
    const B: u8 = ENCODER_B.mask();

    /// Lets the shaft turn by `steps` counts and notes the lines.
    fn turn(encoder: &mut Encoder, steps: i64) -> Vec<u8> {
        let from = encoder.count;
        (1..=steps.abs())
            .map(|step| {
                let count = from + step * steps.signum();
                encoder.update(encoder.passes_from, count as f64 / encoder.counts_per_rad);
                encoder.lines()
            })
            .collect()
    }

    #[test]
    fn a_leads_b_forward() {
        let mut encoder = Encoder::new(&Rig::default());
        assert_eq!(turn(&mut encoder, 5), [A, A | B, B, 0, A]);
        assert_eq!(turn(&mut encoder, -2), [0, B]);
    }

    #[test]
    fn swapped_twice_is_not_swapped() {
        let mut encoder = Encoder::new(&Rig { encoder_swapped: true, ..Rig::default() });
        assert_eq!(turn(&mut encoder, 2), [B, A | B]);
        encoder.set_fault(0, 0.0, Some(EncoderFault::Swapped));
        assert_eq!(turn(&mut encoder, 2), [B, 0]);
        assert_eq!(turn(&mut encoder, 1), [A]);
    }

    #[test]
    fn stuck_line_follows_no_more() {
        let mut encoder = Encoder::new(&Rig::default());
        encoder.set_fault(0, 0.0, Some(EncoderFault::BStuck(false)));
        assert_eq!(turn(&mut encoder, 4), [A, A, 0, 0]);
    }

    #[test]
    fn shorted_lines_are_high_together() {
        let mut encoder = Encoder::new(&Rig::default());
        encoder.set_fault(0, 0.0, Some(EncoderFault::Shorted));
        assert_eq!(turn(&mut encoder, 5), [0, A | B, 0, 0, 0]);
    }

    /// A tenth from where it began to slip, and all again from where it was repaired.
    #[test]
    fn a_slipping_coupling_takes_a_tenth_along() {
        let mut encoder = Encoder::new(&Rig::default());
        let whole = |counts: f64| counts / encoder.counts_per_rad;
        let (begun, further) = (whole(1000.0), whole(1100.0));
        encoder.set_fault(0, begun, Some(EncoderFault::Slipping));
        assert!((encoder.position(begun) - 1000.5).abs() < 1e-6);
        assert!((encoder.position(further) - 1010.5).abs() < 1e-6);
        encoder.set_fault(0, further, None);
        assert!((encoder.position(further) - 1010.5).abs() < 1e-6);
        assert!((encoder.position(begun) - 910.5).abs() < 1e-6);
    }

    /// Whatever the number of changes was.
    #[test]
    fn a_line_that_was_noisy_is_whole_again() {
        let mut encoder = Encoder::new(&Rig::default());
        let sound = encoder.lines();
        encoder.set_fault(0, 0.0, Some(EncoderFault::Noisy));
        let cycle = encoder.next_edge(0, 0.0, 0.0).expect("noise");
        encoder.update(cycle, 0.0);
        assert_ne!(encoder.lines(), sound);
        encoder.set_fault(cycle, 0.0, None);
        assert_eq!(encoder.lines(), sound);
    }

    #[test]
    fn a_noisy_line_changes_as_often_as_it_says() {
        let mut encoder = Encoder::new(&Rig::default());
        encoder.set_fault(0, 0.0, Some(EncoderFault::Noisy));
        let (mut cycle, mut changes) = (0, 0);
        while cycle < u64::from(HARDWARE.clock_hz / 10) {
            cycle = encoder.next_edge(cycle, 0.0, 0.0).expect("noise");
            encoder.update(cycle, 0.0);
            changes += 1;
        }
        assert!((f64::from(changes) - 0.1 * NOISE_PER_S).abs() < 200.0, "{changes}");
    }

    #[test]
    fn a_disturbance_inverts_for_its_width() {
        let mut encoder = Encoder::new(&Rig::default());
        encoder.disturb(100, Some(10), A | B);
        let seen: Vec<u8> = [99, 100, 109, 110].map(|cycle| (encoder.update(cycle, 0.0), encoder.lines()).1).into();
        assert_eq!(seen, [0, A | B, A | B, 0]);
    }

    /// The lines go on at their own rate, at any speed, and are right again when the motor is.
    #[test]
    fn a_motor_too_fast_for_the_lines_loses_whole_rounds() {
        for fast in [1e4, -1e7, 1e300, -1e300, f64::INFINITY, f64::NAN] {
            let mut encoder = Encoder::new(&Rig::default());
            let mut edges = 0;
            for cycle in 0..u64::from(HARDWARE.clock_hz / 1000) {
                let (before, angle_rad) = (encoder.count, fast * cycle as f64 / f64::from(HARDWARE.clock_hz));
                encoder.update(cycle, angle_rad);
                edges += (encoder.count - before).abs();
                assert!(encoder.next_edge(cycle, angle_rad, fast).is_none_or(|at| at > cycle));
            }
            assert!(edges <= i64::from(MOST_EDGES_PER_S / 1000), "{edges} at {fast}");
        }
        let mut encoder = Encoder::new(&Rig::default());
        let angle_rad = |counts: i64| counts as f64 / encoder.counts_per_rad;
        let (far, near) = (angle_rad(1_000_002), angle_rad(1_000_003));
        (0..10).for_each(|edge| encoder.update(edge * EDGE_CYCLES, far));
        assert_eq!((encoder.lines(), encoder.count), (A | B, 2), "as if none had been lost");
        encoder.update(10 * EDGE_CYCLES, near);
        assert_eq!(encoder.lines(), B);
    }

    #[test]
    fn crossing_is_predicted_to_the_cycle() {
        let encoder = Encoder::new(&Rig::default());
        // Half a count at 1000 counts per second lasts 8000 cycles.
        let speed = 1000.0 / encoder.counts_per_rad;
        assert_eq!(encoder.next_edge(50, 0.0, speed), Some(8050));
        assert_eq!(encoder.next_edge(50, 0.0, -speed), Some(8050));
        assert_eq!(encoder.next_edge(50, 0.0, 0.0), None);
    }
}

//! Judges during a recording whether it suffices to identify a motor. It checks which speeds occurred in both
//! directions, whether they changed, and whether limits or the range of the current sensor cut something off.
//!
//! It counts but does not fit. A recording that lacks nothing can still be too short for the wanted intervals, which
//! `motorbench identify` shows.

use motorbench_core::message::{Sample, State};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::AMPERE;
use serde::Serialize;
use std::collections::VecDeque;
use std::fmt::{self, Display, Formatter};

/// Speeds are counted in this many bins of the full range, and judged in this many parts of the greatest speed.
const BINS: usize = 2048;
const BITS_PER_BIN: usize = 32768 / BINS;
const PARTS: usize = 10;
/// A part counts as covered after this long.
const SEEN_S: f64 = 0.01;
/// A speed is changing if it differs by this share of the greatest from the speed this long ago.
const CHANGED_SHARE: f64 = 0.02;
const CHANGED_IN_S: f64 = 0.01;
/// The current is at the end of its range from this share on. The range is half of a 5 V supply from the middle, or
/// that of the telemetry's format.
const AT_RAIL: f64 = 0.97;
const RAIL_MV: f64 = 2500.0;
/// Requirements: covered parts of the speeds in each direction, shares of the time.
const ENOUGH_PARTS: usize = 6;
const ENOUGH_CHANGING: f64 = 0.05;
const MOST_LIMITED: f64 = 0.2;
const MOST_AT_REST: f64 = 0.5;
/// Fewer samples are not judged.
const ENOUGH_S: f64 = 1.0;

/// Counts samples as they come.
#[derive(Clone, Debug)]
pub struct Coverage {
    rate_hz: f64,
    rail_a: f64,
    /// Samples by speed, forwards and backwards.
    bins: [Vec<u32>; 2],
    recent: VecDeque<i16>,
    samples: u32,
    at_rest: u32,
    changing: u32,
    limited: u32,
    at_rail: u32,
}

/// What was covered so far.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Covered {
    /// Tenths of the greatest speed that were seen forwards.
    pub forward_parts: usize,
    /// And backwards.
    pub reverse_parts: usize,
    /// Share of the time in which the speed changed.
    pub changing_share: f64,
    /// Share of the time at rest.
    pub at_rest_share: f64,
    /// Share of the time in which saturation, slew limit or current limit reduced the voltage.
    pub limited_share: f64,
    /// Samples with the current at the end of the sensor's range.
    pub at_rail_samples: u32,
    /// What is missing for an identification, with what to do; empty if it suffices.
    pub lacks: Vec<Lack>,
}

/// A missing property of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Lack {
    /// The property.
    pub what: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

impl Coverage {
    /// Nothing yet, on a board with these settings.
    pub fn new(settings: &Settings) -> Self {
        let gain_mv_per_a = f64::from(settings.get(Param::CurrentGain));
        Self {
            rate_hz: settings.get(Param::TickRate).into(),
            rail_a: (RAIL_MV / gain_mv_per_a).min(f64::from(i16::MAX) / f64::from(AMPERE)),
            bins: [vec![0; BINS], vec![0; BINS]],
            recent: VecDeque::new(),
            samples: 0,
            at_rest: 0,
            changing: 0,
            limited: 0,
            at_rail: 0,
        }
    }

    /// Counts what has come.
    pub fn add(&mut self, samples: &[Sample]) {
        for sample in samples {
            let bin = usize::from(sample.speed.unsigned_abs()) / BITS_PER_BIN;
            self.bins[usize::from(sample.speed < 0)][bin.min(BINS - 1)] += 1;
            self.samples += 1;
            self.at_rest += u32::from(bin == 0);
            self.limited += u32::from(sample.state.has(State::LIMITED));
            let current_a = f64::from(sample.current) / f64::from(AMPERE);
            self.at_rail += u32::from(current_a.abs() >= AT_RAIL * self.rail_a);
            self.recent.push_back(sample.speed);
            if self.recent.len() as f64 > CHANGED_IN_S * self.rate_hz {
                let change = f64::from(sample.speed) - f64::from(self.recent.pop_front().unwrap_or_default());
                let greatest = (self.greatest() * BITS_PER_BIN) as f64;
                self.changing += u32::from(change.abs() > CHANGED_SHARE * greatest.max(1.0));
            }
        }
    }

    /// Bins up to the greatest speed.
    fn greatest(&self) -> usize {
        let seen = |bins: &Vec<u32>| bins.iter().rposition(|count| *count > 0).map_or(0, |last| last + 1);
        seen(&self.bins[0]).max(seen(&self.bins[1]))
    }

    /// Parts of the speeds, up to the greatest, that were covered in a direction. Standstill is none of them.
    fn parts(&self, bins: &[u32]) -> usize {
        let greatest = self.greatest();
        let part = |index: usize| 1 + (greatest - 1) * index / PARTS..1 + (greatest - 1) * (index + 1) / PARTS;
        let seen = |range: std::ops::Range<usize>| {
            f64::from(bins[range].iter().sum::<u32>()) >= (SEEN_S * self.rate_hz).max(1.0)
        };
        if greatest > 1 { (0..PARTS).filter(|index| seen(part(*index))).count() } else { 0 }
    }

    /// What was covered so far.
    pub fn covered(&self) -> Covered {
        let share = |count: u32| f64::from(count) / f64::from(self.samples.max(1));
        let mut covered = Covered {
            forward_parts: self.parts(&self.bins[0]),
            reverse_parts: self.parts(&self.bins[1]),
            changing_share: share(self.changing),
            at_rest_share: share(self.at_rest),
            limited_share: share(self.limited),
            at_rail_samples: self.at_rail,
            lacks: Vec::new(),
        };
        covered.lacks = covered.judged(f64::from(self.samples) / self.rate_hz);
        covered
    }
}

impl Covered {
    fn judged(&self, lasted_s: f64) -> Vec<Lack> {
        let (less, more) = (self.forward_parts.min(self.reverse_parts), self.forward_parts.max(self.reverse_parts));
        let lacks = |lacking: bool, what, remedy| lacking.then_some(Lack { what, remedy });
        [
            lacks(lasted_s < ENOUGH_S, "length", "a longer --period or a greater --count"),
            lacks(self.at_rest_share > MOST_AT_REST, "motion", "it mostly stood: a greater --amplitude"),
            lacks(less == 0, "the other direction", "friction and offsets may differ there: --sequence identify"),
            lacks(
                less > 0 && less < ENOUGH_PARTS || more < ENOUGH_PARTS,
                "speeds between",
                "--sequence identify, stairs or levels",
            ),
            lacks(
                self.changing_share < ENOUGH_CHANGING,
                "changes of speed",
                "they show the inertia: --sequence identify or steps",
            ),
            lacks(
                self.limited_share > MOST_LIMITED,
                "a free voltage",
                "limits reduced the voltage: a smaller --amplitude, or raise them with --set",
            ),
            lacks(
                self.at_rail_samples > 0,
                "the whole current",
                "the sensor was at the end of its range: a smaller --amplitude",
            ),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

impl Display for Covered {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let Self { forward_parts, reverse_parts, changing_share, limited_share, lacks, .. } = self;
        writeln!(
            formatter,
            "speed range covered: forwards {forward_parts} of {PARTS} parts, backwards {reverse_parts} of {PARTS}"
        )?;
        write!(
            formatter,
            "speed changes {:.0} % of the time, voltage limited {:.0} %: ",
            100.0 * changing_share,
            100.0 * limited_share
        )?;
        match &lacks[..] {
            [] => formatter.write_str("enough to identify"),
            [first, ..] => write!(formatter, "lacks {}", first.what),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A speed that alternates between two bounds, in bits, for this many seconds.
    fn swing(low: f64, high: f64, seconds: f64) -> Vec<Sample> {
        let speed = |tick: u32| low + (high - low) * 0.5 * (1.0 - (f64::from(tick) / 100.0).cos());
        (0..(1000.0 * seconds) as u32)
            .map(|tick| Sample { tick, speed: speed(tick) as i16, ..Sample::default() })
            .collect()
    }

    fn covered(samples: &[Sample]) -> Covered {
        let mut coverage = Coverage::new(&Settings::defaults());
        samples.chunks(20).for_each(|some| coverage.add(some));
        coverage.covered()
    }

    #[test]
    fn a_swing_both_ways_suffices_and_half_of_it_does_not() {
        let both = covered(&swing(-6000.0, 6000.0, 5.0));
        assert_eq!((both.forward_parts, both.reverse_parts, &both.lacks[..]), (PARTS, PARTS, &[][..]), "{both}");
        let forward = covered(&swing(100.0, 6000.0, 5.0));
        assert_eq!((forward.reverse_parts, forward.lacks.len()), (0, 1), "{forward:?}");
        assert!(forward.lacks[0].what.contains("other direction"));
        let upper = covered(&[swing(5000.0, 6000.0, 3.0), swing(-6000.0, -5000.0, 3.0)].concat());
        assert!(upper.forward_parts <= 2 && upper.lacks.iter().any(|lack| lack.what == "speeds between"), "{upper:?}");
    }

    #[test]
    fn standing_steady_limited_and_clipped_recordings_are_named() {
        let lacks = |samples: &[Sample], what: &str| covered(samples).lacks.iter().any(|lack| lack.what == what);
        let good = swing(-6000.0, 6000.0, 5.0);
        let with = |change: &dyn Fn(&mut Sample)| {
            let mut samples = good.clone();
            samples.iter_mut().step_by(3).for_each(change);
            samples
        };
        assert!(lacks(&vec![Sample::default(); 3000], "motion"));
        assert!(lacks(&vec![Sample { speed: 5000, ..Sample::default() }; 3000], "changes of speed"));
        assert!(lacks(&with(&|sample| sample.state = State(State::LIMITED)), "a free voltage"));
        assert!(lacks(&with(&|sample| sample.current = i16::MAX), "the whole current"));
        assert!(lacks(&good[..500], "length"));
        assert!(
            ["motion", "changes of speed", "a free voltage", "the whole current", "length"]
                .iter()
                .all(|what| !lacks(&good, what))
        );
    }

    #[test]
    fn the_lines_fit_a_terminal() {
        let widest = covered(&[swing(100.0, 6000.0, 5.0), vec![Sample::default(); 100]].concat()).to_string();
        assert!(widest.contains("forwards 10 of 10 parts, backwards 0 of 10\n"), "{widest}");
        assert!(
            widest.ends_with("lacks the other direction") && widest.lines().all(|line| line.len() < 80),
            "{widest}"
        );
    }
}

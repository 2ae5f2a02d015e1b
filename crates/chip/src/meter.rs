//! Exact times inside the firmware, noted while it runs at full speed.

use super::registers::VECTORS;

/// Smallest, middle and largest of a set of cycle counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spread {
    /// How many there are.
    pub count: usize,
    /// The smallest.
    pub min: u64,
    /// The middle one; of an even number the larger of the two.
    pub median: u64,
    /// The largest.
    pub max: u64,
}

impl Spread {
    /// Sums up `values`; `None` if there are none.
    pub fn of(mut values: Vec<u64>) -> Option<Self> {
        values.sort_unstable();
        let (&min, &max) = (values.first()?, values.last()?);
        Some(Self { count: values.len(), min, median: values[values.len() / 2], max })
    }
}

/// One run of an interrupt handler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HandlerRun {
    /// Cycle at which the processor began to respond.
    pub entry_cycle: u64,
    /// Cycles from there to the end of the RETI: the response, the jump in the vector table and the handler.
    pub cycles: u64,
    /// How many of them other handlers took that interrupted this one.
    pub interrupted_cycles: u64,
}

/// A write to the marker register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Marker {
    /// Cycle at which the writing instruction began.
    pub cycle: u64,
    /// What was written.
    pub value: u8,
}

/// A sample of the converter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Instant of the sample-and-hold.
    pub cycle: u64,
    /// Channel, 0..=15.
    pub channel: u8,
    /// Voltage at the input.
    pub input_v: f64,
}

/// What has been noted since [`super::Chip::measure`] was called.
#[derive(Clone, Debug, Default)]
pub struct Meter {
    pub(super) on: bool,
    pub(super) marker_register: Option<u16>,
    handlers: [Vec<HandlerRun>; VECTORS],
    /// Handlers under way: vector, entry, cycles taken by others meanwhile.
    open: Vec<(u8, u64, u64)>,
    markers: Vec<Marker>,
    samples: Vec<Sample>,
}

/// Cycles of a RETI.
const RETI_CYCLES: u64 = 4;

impl Meter {
    pub(super) fn started(marker_register: Option<u16>) -> Self {
        Self { on: true, marker_register, ..Self::default() }
    }

    pub(super) fn entered(&mut self, vector: u8, cycle: u64) {
        if self.on {
            self.open.push((vector, cycle, 0));
        }
    }

    pub(super) fn returned(&mut self, vector: u8, cycle: u64) {
        if let Some(index) = self.open.iter().rposition(|(v, _, _)| *v == vector) {
            let (_, entry_cycle, interrupted_cycles) = self.open.remove(index);
            let run = HandlerRun { entry_cycle, cycles: cycle + RETI_CYCLES - entry_cycle, interrupted_cycles };
            if let Some((_, _, interrupted)) = self.open.last_mut() {
                *interrupted += run.cycles;
            }
            self.handlers[usize::from(vector)].push(run);
        }
    }

    pub(super) fn marked(&mut self, cycle: u64, value: u8) {
        if self.on {
            self.markers.push(Marker { cycle, value });
        }
    }

    pub(super) fn sampled(&mut self, sample: Sample) {
        if self.on {
            self.samples.push(sample);
        }
    }

    /// Every complete run of the handler of `vector`, in order.
    pub fn handler_runs(&self, vector: u8) -> &[HandlerRun] {
        self.handlers.get(usize::from(vector)).map_or(&[], Vec::as_slice)
    }

    /// Cycles that the handler of `vector` takes, the chip's response included; `None` if it did not run.
    pub fn handler_cycles(&self, vector: u8) -> Option<Spread> {
        Spread::of(self.handler_runs(vector).iter().map(|run| run.cycles).collect())
    }

    /// The same without what other handlers took meanwhile.
    pub fn own_cycles(&self, vector: u8) -> Option<Spread> {
        Spread::of(self.handler_runs(vector).iter().map(|run| run.cycles - run.interrupted_cycles).collect())
    }

    /// By how many cycles the entries of a periodic handler stray from an exact period; `None` if it did not run.
    pub fn entry_jitter_cycles(&self, vector: u8, period_cycles: u64) -> Option<u64> {
        jitter(self.handler_runs(vector).iter().map(|run| run.entry_cycle), period_cycles)
    }

    /// Writes to the marker register.
    pub fn markers(&self) -> &[Marker] {
        &self.markers
    }

    /// Cycles from each marker with the value `from` to the next one with the value `to`. The `out_cycles` of the first
    /// writing instruction are taken off: 1 for OUT, 2 for SBI, CBI and STS.
    pub fn between_markers(&self, from: u8, to: u8, out_cycles: u64) -> Vec<u64> {
        let mut start = None;
        let mut times = Vec::new();
        for marker in &self.markers {
            if marker.value == to
                && let Some(begun) = start.take()
            {
                times.push(marker.cycle - begun - out_cycles);
            }
            if marker.value == from {
                start = Some(marker.cycle);
            }
        }
        times
    }

    /// Samples of the converter.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// By how many cycles the samples of a channel stray from an exact period; `None` if there are none.
    pub fn sample_jitter_cycles(&self, channel: u8, period_cycles: u64) -> Option<u64> {
        jitter(self.samples.iter().filter(|s| s.channel == channel).map(|s| s.cycle), period_cycles)
    }
}

/// Spread of instants around the grid of `period` through the first of them.
fn jitter(instants: impl Iterator<Item = u64>, period: u64) -> Option<u64> {
    let mut instants = instants.peekable();
    let first = *instants.peek()?;
    let half = period as i64 / 2;
    let deviations = instants.map(|at| ((at - first) as i64 + half).rem_euclid(period as i64) - half);
    let (low, high) = deviations.fold((0, 0), |(low, high), d| (d.min(low), d.max(high)));
    Some((high - low) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_is_the_spread_on_both_sides_of_the_grid() {
        assert_eq!(jitter([1000, 1803, 2598, 3400].into_iter(), 800), Some(5));
        assert_eq!(jitter([5].into_iter(), 800), Some(0));
        assert_eq!(jitter([].into_iter(), 800), None);
    }

    #[test]
    fn spread_of_handler_times() {
        let spread = Spread::of(vec![7, 3, 9, 5]);
        assert_eq!(spread, Some(Spread { count: 4, min: 3, median: 7, max: 9 }));
    }

    #[test]
    fn what_interrupts_a_handler_is_not_its_own() {
        let mut meter = Meter { on: true, ..Meter::default() };
        meter.entered(14, 100);
        meter.entered(1, 150);
        meter.returned(1, 196);
        meter.returned(14, 296);
        let spread = |cycles| Some(Spread { count: 1, min: cycles, median: cycles, max: cycles });
        assert_eq!((meter.handler_cycles(14), meter.own_cycles(14)), (spread(200), spread(150)));
        assert_eq!(meter.own_cycles(1), spread(50));
    }

    #[test]
    fn markers_pair_up_in_order() {
        let mut meter = Meter { on: true, ..Meter::default() };
        for (cycle, value) in [(10, 1), (20, 2), (30, 2), (40, 1), (55, 2)] {
            meter.marked(cycle, value);
        }
        assert_eq!(meter.between_markers(1, 2, 1), [9, 14]);
    }
}

//! A sequence that the core plays itself, as requested by a `sequence` line of the console or by a scenario.

use motorbench_core::excitation::{Bridge, Excess, Kind, Player, Sequence};
use motorbench_core::message::Mode;
use motorbench_core::settings::{Param, Settings};
use motorbench_data::telemetry::reference_bit;

/// A jump is a step if it is more than this share of the amplitude...
const LEAST_JUMP: f64 = 0.1;
/// ... and if its end value lasts at least one period in this many, as the levels of `identify` do.
const PARTS_OF_A_PERIOD: u32 = 4;

/// The sequence, with the names of a scenario file.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SequenceOrder {
    /// Its kind.
    #[serde(rename = "sequence", serialize_with = "by_its_name")]
    pub kind: Kind,
    /// Amplitude in the unit of the mode: V, rad/s, rad.
    pub amplitude: f64,
    /// Offset in the same unit.
    pub offset: f64,
    /// Length of one part; see `motorbench_core::excitation`.
    pub period_ms: u16,
    /// Number of repetitions.
    pub count: u16,
    /// Seed of random sequences.
    pub seed: u16,
}

/// The name of a kind, on the console and in files.
pub fn name(kind: Kind) -> String {
    format!("{kind:?}").to_lowercase()
}

fn by_its_name<S: serde::Serializer>(kind: &Kind, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&name(*kind))
}

/// A step of the reference, and its duration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Start, from the beginning of the sequence.
    pub from_s: f64,
    /// End, from the beginning of the sequence.
    pub until_s: f64,
    /// Value in the unit of the mode; positions from the start of the sequence.
    pub value: f64,
}

impl SequenceOrder {
    /// For the console.
    pub fn line(&self) -> String {
        let Self { kind, amplitude, offset, period_ms, count, seed } = *self;
        format!("sequence {} {amplitude} {offset} {period_ms} {count} {seed}", name(kind))
    }

    /// As the board plays it in a mode.
    ///
    /// # Errors
    /// The core refuses a number that is too large for it.
    pub fn of_core(&self, mode: Mode, settings: &Settings) -> Result<Sequence, String> {
        let bit = reference_bit(mode, settings);
        let largest = f64::from(i16::MAX);
        let bits = |name: &str, value: f64| {
            let bits = (value / bit).round();
            let fits = bits.abs() <= largest;
            fits.then_some(bits as i16).ok_or_else(|| format!("{name} {value}: expected at most {}", largest * bit))
        };
        let Self { kind, amplitude, offset, period_ms, count, seed } = *self;
        let levels = (bits("an amplitude of", amplitude)?, bits("an offset of", offset)?);
        let made = Sequence::new(kind, levels.0, levels.1, settings.ticks(period_ms), count, seed);
        made.map_err(|excess| match excess {
            Excess::Period(ticks) => {
                format!("a period of {period_ms} ms: expected at most {}", settings.whole_ms(ticks))
            }
            Excess::Count(most) => format!("a count of {count}: expected at most {most}"),
        })
    }

    /// Its duration in ticks, in any mode.
    ///
    /// # Errors
    /// As [`SequenceOrder::of_core`], of period and count.
    pub fn duration_ticks(&self, settings: &Settings) -> Result<u32, String> {
        // The levels, whose bits are the mode's, do not make it longer.
        let level = Self { amplitude: 0.0, offset: 0.0, ..*self };
        level.of_core(Mode::OpenLoop, settings).map(|sequence| sequence.duration_ticks())
    }

    /// The largest of its steps in a closed loop that was at zero, the longest of equal ones. Ramps and sweeps have
    /// none, nor has a refused sequence.
    pub fn largest_jump(&self, mode: Mode, settings: &Settings) -> Option<Jump> {
        let rate_hz = f64::from(settings.get(Param::TickRate));
        let least_ticks = (settings.ticks(self.period_ms) / PARTS_OF_A_PERIOD).max(1) as usize;
        let mut player = Player::default();
        player.start(&self.of_core(mode, settings).ok()?);
        let plays: Vec<_> = std::iter::from_fn(|| Some(player.step()).filter(|play| !play.done)).collect();
        let (mut before, mut start, mut largest) = (0, 0, None);
        for stands in plays.chunk_by(|a, b| a == b) {
            let (play, ticks) = (stands[0], stands.len());
            let rank = (i32::from(play.value).abs_diff(before), ticks);
            let is_greater = largest.is_none_or(|(greatest, _)| rank > greatest);
            if play.bridge == Bridge::Drive && ticks >= least_ticks && is_greater {
                largest = Some((rank, (start, start + ticks, play.value)));
            }
            (before, start) = (play.value.into(), start + ticks);
        }
        let unit = reference_bit(mode, settings);
        let ((bits, _), (from, until, value)) = largest?;
        (f64::from(bits) * unit > LEAST_JUMP * self.amplitude.abs()).then_some(Jump {
            from_s: from as f64 / rate_hz,
            until_s: until as f64 / rate_hz,
            value: f64::from(value) * unit,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn largest_jump(kind: Kind, count: u16) -> Option<Jump> {
        let order = SequenceOrder { kind, amplitude: 50.0, offset: 0.0, period_ms: 200, count, seed: 7 };
        order.largest_jump(Mode::SpeedPid, &Settings::defaults())
    }

    #[test]
    fn the_largest_jump_by_hand() {
        let near = |value: f64, expected: f64| (value - expected).abs() < 0.05;
        let first = largest_jump(Kind::Steps, 1).unwrap();
        assert!(near(first.value, 50.0) && near(first.from_s, 0.0) && near(first.until_s, 0.2), "{first:?}");
        // From one end to the other, and of these the one that stands for most bits.
        let bits = largest_jump(Kind::Prbs, 60).unwrap();
        assert!(near(bits.value.abs(), 50.0) && bits.from_s > 0.0 && bits.until_s - bits.from_s > 0.5, "{bits:?}");
        assert!(largest_jump(Kind::Levels, 20).unwrap().until_s > 0.2);
        assert!(near(largest_jump(Kind::Stairs, 5).unwrap().value.abs() % 10.0, 0.0));
        assert_eq!([largest_jump(Kind::Ramp, 1), largest_jump(Kind::Chirp, 1)], [None, None]);
    }

    /// At 2 kHz half the milliseconds; `identify` doubles its period; a count makes four or eight segments.
    #[test]
    fn what_the_board_cannot_count_is_refused_with_what_it_can() {
        let mut fast = Settings::defaults();
        fast.set(Param::TickRate, 2000.0).unwrap();
        let made = |kind, period_ms, count, settings: &Settings| {
            // More than a voltage may be, as a loop's speeds are.
            let order = SequenceOrder { kind, amplitude: 60.0, offset: 0.0, period_ms, count, seed: 7 };
            order.duration_ticks(settings)
        };
        let refused = |what: &str| Err(what.to_owned());
        let slow = Settings::defaults();
        assert_eq!(made(Kind::Steps, 65_535, 1, &slow), Ok(4 * 65_535));
        assert_eq!(made(Kind::Steps, 32_767, 1, &fast), Ok(4 * 65_534));
        assert_eq!(made(Kind::Steps, 32_768, 1, &fast), refused("a period of 32768 ms: expected at most 32767"));
        assert_eq!(made(Kind::Identify, 32_768, 1, &slow), refused("a period of 32768 ms: expected at most 32767"));
        assert_eq!(made(Kind::Identify, 16_384, 1, &fast), refused("a period of 16384 ms: expected at most 16383"));
        assert_eq!(made(Kind::Stairs, 1, 16_384, &slow), refused("a count of 16384: expected at most 16383"));
        assert_eq!(made(Kind::Coast, 1, 8192, &slow), refused("a count of 8192: expected at most 8191"));
        assert_eq!(made(Kind::Prbs, 1, 65_535, &slow), Ok(65_535));
        let far = SequenceOrder { kind: Kind::Steps, amplitude: 0.0, offset: -200.0, period_ms: 1, count: 1, seed: 1 };
        let refused = far.of_core(Mode::PositionPid, &slow).unwrap_err();
        assert!(refused.starts_with("an offset of -200: expected at most 102.9"), "{refused}");
    }
}

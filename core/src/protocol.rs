//! THE frames of the telemetry, and the one text line, used by the firmware and the host alike.
//!
//! While the binary stream is on, everything the board says is frames: COBS-encoded, ended by a zero byte. A frame's
//! content, little-endian:
//!
//! | bytes | content |
//! |---|---|
//! | 1 | kind: [`SAMPLE`] or [`TEXT`] |
//! | 1 | sequence number, one more with every frame: a loss is seen |
//! | n | payload |
//! | 2 | CRC-16/XMODEM of all before |
//!
//! A sample's payload is [`SAMPLE_COLUMNS`]. A text's payload is up to 32 characters of what the console says.
//! [`StreamDecoder`] reads the stream, and resynchronises at the next zero byte after any damage.

use crate::crc16::Crc16;
use crate::message::{Sample, State, Trip};

/// Kind of a frame that carries a [`Sample`].
pub const SAMPLE: u8 = b's';
/// Kind of a frame that carries text.
pub const TEXT: u8 = b't';
/// Longest text in one frame.
pub const TEXT_CHUNK: usize = 32;
/// Bytes of a sample.
pub const SAMPLE_BYTES: usize = 22;
/// Longest content: kind, sequence number, payload, CRC.
const CONTENT: usize = 2 + TEXT_CHUNK + 2;
/// Longest frame on the line: content, one byte of COBS, the zero.
pub const FRAME: usize = CONTENT + 2;

/// The columns of a sample in the order they are sent: name, bytes, meaning.
pub const SAMPLE_COLUMNS: [(&str, u8, &str); 9] = [
    ("tick", 4, "ticks since reset"),
    ("reference", 4, "bits of voltage or speed, or counts, by mode"),
    ("counts", 4, "encoder counts"),
    ("speed", 2, "2^-15 of speed_range"),
    ("current", 2, "2^-12 A"),
    ("duty", 2, "PWM steps, -800..=800"),
    ("supply", 2, "2^-10 V"),
    ("state", 1, "mode in bits 0-2, armed 3, enabled 4, playing 5, limited 6, moving 7"),
    ("trip", 1, "trip code, 0 none"),
];

/// The bytes of a sample: those it has in memory.
pub fn pack(sample: &Sample) -> &[u8; SAMPLE_BYTES] {
    const { assert!(cfg!(target_endian = "little") && size_of::<Sample>() >= SAMPLE_BYTES) };
    // SAFETY: `repr(C)` with the fields in the order of their sizes: no gaps before the last field's end.
    unsafe { &*(&raw const *sample).cast() }
}

/// The sample of such bytes; none if the trip is one this version does not know.
pub fn unpack(bytes: &[u8; SAMPLE_BYTES]) -> Option<Sample> {
    let word = |at: usize| i16::from_le_bytes([bytes[at], bytes[at + 1]]);
    let long = |at: usize| i32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    Some(Sample {
        tick: long(0) as u32,
        reference: long(4),
        counts: long(8),
        speed: word(12),
        current: word(14),
        duty: word(16),
        supply: word(18),
        state: State(bytes[20]),
        trip: Trip::from_number(bytes[21])?,
    })
}

/// Makes frames and numbers them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Framer {
    sequence: u8,
}

impl Framer {
    /// A frame with `payload` (at most [`TEXT_CHUNK`] bytes; more is cut off) into `frame`; returns its length.
    #[inline(never)]
    pub fn frame(&mut self, kind: u8, payload: &[u8], frame: &mut [u8; FRAME]) -> usize {
        let mut encoder = Encoder { frame, crc: Crc16::default(), code: 0, end: 1 };
        encoder.push(kind);
        encoder.push(self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
        payload.iter().take(TEXT_CHUNK).for_each(|&byte| encoder.push(byte));
        let [low, high] = encoder.crc.value().to_le_bytes();
        encoder.push(low);
        encoder.push(high);
        // The end of the last group is the end of the frame.
        encoder.put(0);
        encoder.end as usize
    }
}

/// COBS and CRC in one pass: each group of bytes other than zero is preceded by its length and one. A frame is shorter
/// than the longest group.
struct Encoder<'a> {
    frame: &'a mut [u8; FRAME],
    crc: Crc16,
    /// Where the length of the present group will stand.
    code: u8,
    end: u8,
}

impl Encoder<'_> {
    #[inline(never)]
    fn push(&mut self, byte: u8) {
        self.crc.push(byte);
        self.put(byte);
    }

    #[inline(never)]
    fn put(&mut self, byte: u8) {
        if let Some(place) = self.frame.get_mut(self.end as usize) {
            *place = byte;
        }
        if byte == 0 {
            if let Some(place) = self.frame.get_mut(self.code as usize) {
                *place = self.end - self.code;
            }
            self.code = self.end;
        }
        self.end += 1;
    }
}

/// What a [`StreamDecoder`] finds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// A sample.
    Sample(Sample),
    /// Text, and how many of its bytes count.
    Text([u8; TEXT_CHUNK], usize),
}

/// Reads a binary stream byte by byte.
#[derive(Clone, Debug)]
pub struct StreamDecoder {
    buffer: [u8; FRAME],
    length: usize,
    expected: Option<u8>,
    gap: Gap,
    /// Frames that never came, by their sequence numbers. Where so many are missing in a row that these begin anew, the
    /// ticks of the samples around them count.
    pub lost: u32,
    /// Of them those that came damaged. Pieces of one frame count once when the next sample is there.
    pub damaged: u32,
}

/// What came since the last sample.
#[derive(Clone, Copy, Debug, Default)]
struct Gap {
    /// When that was, if the sample is one of a sequence that plays. At other times a listing of the settings holds samples
    /// up for 390 ticks, and these have no sequence numbers.
    tick: Option<u32>,
    lost: u32,
    damaged: u32,
}

/// Sequence numbers until they begin anew.
const NUMBERS: u32 = 256;

impl Gap {
    /// Frames that the sequence numbers do not show, when a sample of this tick ends the gap. They are whole rounds of
    /// numbers, as near to the ticks as can be. Without another sign of a loss the ticks between are those of a divider.
    fn hidden(&self, tick: u32) -> u32 {
        let missing = self.tick.and_then(|last| tick.checked_sub(last)).map_or(0, |ticks| ticks.saturating_sub(1));
        match (self.lost, self.damaged) {
            (0, 0) => 0,
            (lost, _) => (missing.saturating_sub(lost) + NUMBERS / 2) / NUMBERS * NUMBERS,
        }
    }
}

impl Default for StreamDecoder {
    fn default() -> Self {
        Self { buffer: [0; FRAME], length: 0, expected: None, gap: Gap::default(), lost: 0, damaged: 0 }
    }
}

impl StreamDecoder {
    /// Takes the next byte; a frame when one is complete and undamaged.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        if byte != 0 {
            if let Some(place) = self.buffer.get_mut(self.length) {
                *place = byte;
            }
            self.length = (self.length + 1).min(FRAME + 1);
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if length == 0 {
            return None;
        }
        let frame = self.decode(length);
        match frame {
            None => self.piece(),
            Some(Frame::Text(..)) => {}
            Some(Frame::Sample(sample)) => self.close(&sample),
        }
        frame
    }

    fn piece(&mut self) {
        self.damaged += 1;
        self.gap.damaged += 1;
    }

    fn lose(&mut self, frames: u32) {
        self.lost += frames;
        self.gap.lost += frames;
    }

    /// A sample ends a gap: what was lost in it is known.
    fn close(&mut self, sample: &Sample) {
        let tick = sample.state.has(State::PLAYING).then_some(sample.tick);
        self.lose(tick.map_or(0, |tick| self.gap.hidden(tick)));
        self.damaged = self.damaged.saturating_sub(self.gap.damaged.saturating_sub(self.gap.lost));
        self.gap = Gap { tick, ..Gap::default() };
    }

    fn decode(&mut self, length: usize) -> Option<Frame> {
        let mut content = [0; FRAME];
        let end = cobs::decode(self.buffer.get(..length)?, &mut content).ok()?.frame_size();
        let (body, crc) = content.get(..end)?.split_last_chunk::<2>()?;
        let (&[kind, sequence], payload) = body.split_first_chunk::<2>()?;
        if Crc16::of(body) != u16::from_le_bytes(*crc) {
            return None;
        }
        if let Some(expected) = self.expected.replace(sequence.wrapping_add(1)) {
            self.lose(sequence.wrapping_sub(expected).into());
        }
        match kind {
            SAMPLE => unpack(payload.try_into().ok()?).map(Frame::Sample),
            TEXT => {
                let mut text = [0; TEXT_CHUNK];
                text.get_mut(..payload.len())?.copy_from_slice(payload);
                Some(Frame::Text(text, payload.len()))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample() -> impl Strategy<Value = Sample> {
        (any::<(u32, i32, i32, i16, i16, i16, i16, u8)>(), 0u8..=10).prop_map(
            |((tick, reference, counts, speed, current, duty, supply, state), trip)| Sample {
                tick,
                reference,
                counts,
                speed,
                current,
                duty,
                supply,
                state: State(state),
                trip: Trip::from_number(trip).unwrap(),
            },
        )
    }

    fn encode(framer: &mut Framer, kind: u8, payload: &[u8]) -> Vec<u8> {
        let mut frame = [0; FRAME];
        let length = framer.frame(kind, payload, &mut frame);
        frame[..length].to_vec()
    }

    fn hear(decoder: &mut StreamDecoder, stream: &[u8]) {
        for &byte in stream {
            decoder.push(byte);
        }
    }

    #[test]
    fn the_columns_are_the_sample() {
        let bytes: usize = SAMPLE_COLUMNS.iter().map(|&(_, bytes, _)| bytes as usize).sum();
        assert_eq!(bytes, SAMPLE_BYTES);
    }

    /// While the board lists its settings it sends no samples, and loses none but those that are damaged.
    #[test]
    fn what_was_not_sent_is_not_lost() {
        let (mut framer, mut decoder) = (Framer::default(), StreamDecoder::default());
        let sample = |tick| Sample { tick, ..Sample::default() };
        let mut stream = encode(&mut framer, SAMPLE, pack(&sample(1)));
        encode(&mut framer, SAMPLE, pack(&sample(2)));
        stream.extend([7, 0]);
        stream.extend(encode(&mut framer, SAMPLE, pack(&sample(391))));
        hear(&mut decoder, &stream);
        assert_eq!((decoder.lost, decoder.damaged), (1, 1));
    }

    proptest! {
        #[test]
        fn samples_come_back(samples in proptest::collection::vec(sample(), 1..20)) {
            let (mut framer, mut decoder) = (Framer::default(), StreamDecoder::default());
            for sample in samples {
                let frame = encode(&mut framer, SAMPLE, pack(&sample));
                prop_assert!(frame.len() <= 28 && frame.iter().rposition(|&b| b == 0) == Some(frame.len() - 1));
                let found: Vec<Frame> = frame.iter().filter_map(|&byte| decoder.push(byte)).collect();
                prop_assert_eq!(found, vec![Frame::Sample(sample)]);
            }
            prop_assert_eq!((decoder.lost, decoder.damaged), (0, 0));
        }

        #[test]
        fn text_comes_back(text in proptest::collection::vec(any::<u8>(), 0..=TEXT_CHUNK)) {
            let (mut framer, mut decoder) = (Framer::default(), StreamDecoder::default());
            let frame = encode(&mut framer, TEXT, &text);
            let Some(Frame::Text(bytes, length)) = frame.iter().find_map(|&byte| decoder.push(byte)) else {
                panic!("no text")
            };
            prop_assert_eq!(&bytes[..length], &text[..]);
        }

        /// Any damage: nothing panics, no frame is invented, and whole frames after it are read again; every frame
        /// that is missing is counted as lost. (A damaged end of frame takes the next frame with it.)
        #[test]
        fn damage_is_seen(damage in proptest::collection::vec((0usize..2800, any::<u8>()), 0..20)) {
            let mut framer = Framer::default();
            let samples: Vec<Sample> = (0..100).map(|tick| Sample { tick, ..Sample::default() }).collect();
            let mut stream: Vec<u8> =
                samples.iter().flat_map(|sample| encode(&mut framer, SAMPLE, pack(sample))).collect();
            let length = stream.len();
            for (at, byte) in damage {
                stream[at % (length - 56)] = byte;
            }
            let mut decoder = StreamDecoder::default();
            let found: Vec<Frame> = stream.iter().filter_map(|&byte| decoder.push(byte)).collect();
            for frame in &found {
                let Frame::Sample(sample) = frame else { panic!("invented") };
                prop_assert_eq!(*sample, samples[sample.tick as usize]);
            }
            prop_assert_eq!(found.last(), Some(&Frame::Sample(samples[99])));
            let first = samples.iter().position(|sample| found[0] == Frame::Sample(*sample)).unwrap();
            prop_assert_eq!(found.len() + decoder.lost as usize + first, 100);
        }

        /// However many are missing in a row, of the answers that come between as well; and a frame in pieces is one frame.
        #[test]
        fn all_that_is_lost_is_counted(gaps in proptest::collection::vec((0u32..3000, 0usize..10, 0u32..4), 1..10)) {
            let (mut framer, mut decoder) = (Framer::default(), StreamDecoder::default());
            let mut tick = 0;
            let mut sample = |framer: &mut Framer| {
                tick += 1;
                encode(framer, SAMPLE, pack(&Sample { tick, state: State(State::PLAYING), ..Sample::default() }))
            };
            let mut lost = 0;
            for (samples, texts, pieces) in gaps {
                hear(&mut decoder, &sample(&mut framer));
                for _ in 0..samples {
                    sample(&mut framer);
                }
                for _ in 0..texts {
                    encode(&mut framer, TEXT, b"ok");
                }
                let missing = samples + texts as u32;
                prop_assume!(pieces > 0 || missing == 0 || !missing.is_multiple_of(NUMBERS));
                lost += missing;
                (0..pieces).for_each(|_| hear(&mut decoder, &[7, 1, 2, 0]));
            }
            hear(&mut decoder, &sample(&mut framer));
            prop_assert_eq!(decoder.lost, lost);
            prop_assert!(decoder.damaged <= lost);
        }

        #[test]
        fn garbage_is_no_frame(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let mut decoder = StreamDecoder::default();
            for byte in bytes {
                // One in 65,536 by chance: the CRC is what stands between.
                decoder.push(byte);
            }
        }
    }
}

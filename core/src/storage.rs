//! Settings in EEPROM: versioned, checksummed, two slots.
//!
//! A save writes the slot that does not hold the newest set. First it makes the slot's mark invalid, then it writes the
//! values, and last mark, number and CRC. Whenever the power goes, one slot is whole. Bytes that already stand there are not written
//! again. A slot, little-endian:
//!
//! | bytes | content |
//! |---|---|
//! | 1 | low byte of [`VERSION`]; anything else is no slot |
//! | 1 | number of the save, modulo 256; the newer of two is the one that is one more |
//! | 4 n | the values, f32, in the order of the list |
//! | 2 | CRC-16 of all before, as XMODEM's, but begun with [`VERSION`] |

use crate::crc16::Crc16;
use crate::settings::{self, Param, Settings};

/// A checksum of every name, unit and format in the list of settings. Settings that were saved under another list are not
/// loaded. Another text of help, range or default leaves it as it is.
pub const VERSION: u16 = Crc16::of(settings::MEANING.as_bytes());
/// The first byte of a slot.
const MARK: u8 = VERSION as u8;
/// A byte that was never written.
const ERASED: u8 = 0xff;
/// Bytes of a slot.
const SLOT: u16 = 2 + VALUES + 2;
const VALUES: u16 = 4 * Param::COUNT as u16;
/// Where the second slot begins; the first does at zero.
const SECOND: u16 = 512;
const _: () = assert!(SLOT <= SECOND);

/// A memory of bytes that keeps without power. 1024 bytes; a write takes milliseconds.
pub trait Eeprom {
    /// The byte at `address`.
    fn read(&mut self, address: u16) -> u8;
    /// Whether the last write is done.
    fn ready(&mut self) -> bool;
    /// Begins to write a byte; only when [`Eeprom::ready`].
    fn write(&mut self, address: u16, byte: u8);
}

/// The newest whole slot: where it begins, and its number.
fn newest(eeprom: &mut impl Eeprom) -> Option<(u16, u8)> {
    match (number(eeprom, 0), number(eeprom, SECOND)) {
        (Some(first), Some(second)) if second == first.wrapping_add(1) => Some((SECOND, second)),
        (Some(first), _) => Some((0, first)),
        (None, Some(second)) => Some((SECOND, second)),
        (None, None) => None,
    }
}

/// The number of the slot at `start`, if it is whole.
fn number(eeprom: &mut impl Eeprom, start: u16) -> Option<u8> {
    if eeprom.read(start) != MARK {
        return None;
    }
    let mut crc = Crc16::begun_with(VERSION);
    for offset in 0..SLOT - 2 {
        crc.push(eeprom.read(start + offset));
    }
    let stored = [eeprom.read(start + SLOT - 2), eeprom.read(start + SLOT - 1)];
    (crc.value() == u16::from_le_bytes(stored)).then(|| eeprom.read(start + 1))
}

/// Whether something stands where settings are saved, of this version or another.
pub fn holds_something(eeprom: &mut impl Eeprom) -> bool {
    eeprom.read(0) & eeprom.read(SECOND) != ERASED
}

/// Loads the saved settings, if there are any whole ones within their ranges; the content is of no use otherwise.
#[inline(never)]
pub fn load(eeprom: &mut impl Eeprom, settings: &mut Settings) -> bool {
    let Some((slot, _)) = newest(eeprom) else { return false };
    let mut address = slot + 2;
    for index in 0..Param::COUNT {
        let mut bytes = [0; 4];
        for byte in &mut bytes {
            *byte = eeprom.read(address);
            address += 1;
        }
        let Some(param) = Param::from_index(index) else { return false };
        if settings.set(param, f32::from_le_bytes(bytes)).is_err() {
            return false;
        }
    }
    true
}

/// A save under way, or none. Polled, because each byte takes milliseconds and the main loop must go on talking.
#[derive(Default)]
pub struct Saver {
    busy: bool,
    start: u16,
    number: u8,
    /// Next offset to write; the mark is written first (invalid) and last.
    offset: u16,
    crc: Crc16,
}

impl Saver {
    /// Begins a save. The settings must not change until it is done.
    pub fn start(&mut self, eeprom: &mut impl Eeprom) {
        let (start, number) = match newest(eeprom) {
            Some((newest, number)) => (SECOND - newest, number.wrapping_add(1)),
            None => (0, 0),
        };
        let mut crc = Crc16::begun_with(VERSION);
        crc.push(MARK);
        crc.push(number);
        *self = Self { busy: true, start, number, offset: 0, crc };
    }

    /// Whether a save is under way.
    pub fn is_busy(&self) -> bool {
        self.busy
    }

    /// Writes the next byte when the memory is ready; true when with this all is written.
    #[inline(never)]
    pub fn poll(&mut self, eeprom: &mut impl Eeprom, settings: &Settings) -> bool {
        if !self.busy || !eeprom.ready() {
            return false;
        }
        let (offset, byte) = match self.offset {
            // Invalid until everything else stands.
            0 => (0, !MARK),
            1 => (1, self.number),
            offset if offset < 2 + VALUES => {
                let index = offset - 2;
                let value = settings.values.get(index as usize / 4).copied().unwrap_or(0.0);
                let byte = value.to_le_bytes()[index as usize % 4];
                self.crc.push(byte);
                (offset, byte)
            }
            offset if offset < SLOT => {
                let crc = self.crc.value().to_le_bytes();
                (offset, crc[(offset - (SLOT - 2)) as usize & 1])
            }
            SLOT => (0, MARK),
            _ => {
                self.busy = false;
                return true;
            }
        };
        self.offset += 1;
        let address = self.start + offset;
        if eeprom.read(address) != byte {
            eeprom.write(address, byte);
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A memory that loses power after so many writes.
    struct Memory {
        bytes: [u8; 1024],
        writes: usize,
        power: usize,
    }

    impl Memory {
        fn blank() -> Self {
            Self { bytes: [0xff; 1024], writes: 0, power: usize::MAX }
        }

        fn save(&mut self, settings: &Settings) {
            let mut saver = Saver::default();
            saver.start(self);
            while !saver.poll(self, settings) {}
        }
    }

    impl Eeprom for Memory {
        fn read(&mut self, address: u16) -> u8 {
            self.bytes[address as usize]
        }

        fn ready(&mut self) -> bool {
            true
        }

        fn write(&mut self, address: u16, byte: u8) {
            if self.writes < self.power {
                self.bytes[address as usize] = byte;
            }
            self.writes += 1;
        }
    }

    fn loaded(memory: &mut Memory) -> Option<Settings> {
        let mut settings = Settings::defaults();
        load(memory, &mut settings).then_some(settings)
    }

    fn numbered(number: usize) -> Settings {
        let mut settings = Settings::defaults();
        settings.set(Param::SpeedKi, number as f32 + 0.5).unwrap();
        settings.set(Param::CruiseSpeed, number as f32 + 1.25).unwrap();
        settings
    }

    #[test]
    fn blank_memory_holds_nothing_and_a_save_comes_back() {
        let mut memory = Memory::blank();
        assert_eq!(loaded(&mut memory), None);
        // Past the wrap of the number.
        for number in 0..600 {
            memory.save(&numbered(number));
            assert_eq!(loaded(&mut memory), Some(numbered(number)), "{number}");
        }
    }

    #[test]
    fn a_power_cut_at_any_byte_leaves_the_old_or_the_new() {
        for before in 0..4 {
            let mut memory = Memory::blank();
            (0..=before).for_each(|number| memory.save(&numbered(number)));
            let (old, new) = (numbered(before), numbered(before + 1));
            let start = memory.bytes;
            memory.writes = 0;
            memory.save(&new);
            let all = memory.writes;
            for power in 0..=all {
                let mut memory = Memory { bytes: start, writes: 0, power };
                memory.save(&new);
                let found = loaded(&mut memory);
                assert!(found == Some(old) || found == Some(new), "after {power} writes");
                assert_eq!(found == Some(new), power == all);
                // And the next save works.
                memory.power = usize::MAX;
                memory.save(&numbered(9));
                assert_eq!(loaded(&mut memory), Some(numbered(9)));
            }
        }
    }

    #[test]
    fn unchanged_bytes_are_not_rewritten() {
        let mut memory = Memory::blank();
        (0..4).for_each(|_| memory.save(&numbered(1)));
        memory.writes = 0;
        memory.save(&numbered(1));
        // The mark twice, the number, the CRC.
        assert!(memory.writes <= 5, "{}", memory.writes);
    }

    /// The same bytes under a list of the same length are whole for that list only, whatever their mark.
    #[test]
    fn what_another_list_has_saved_is_not_loaded() {
        let list = settings::MEANING;
        for (of_this, of_other) in [("speed_kp", "speed_kq"), ("rad/s2", "rad/s"), ("Volt", "Own")] {
            assert_ne!(Crc16::of(list.replacen(of_this, of_other, 1).as_bytes()), VERSION, "{of_other}");
        }
        let mut memory = Memory::blank();
        memory.save(&numbered(1));
        let whole = Crc16::of(&memory.bytes[..SLOT as usize - 2]);
        memory.bytes[SLOT as usize - 2..SLOT as usize].copy_from_slice(&whole.to_le_bytes());
        assert_eq!(loaded(&mut memory), None);
    }

    proptest! {
        /// A flipped bit in either slot: the other set or none, never a wrong one.
        #[test]
        fn flipped_bits(address in 0usize..1024, bit in 0u8..8) {
            let mut memory = Memory::blank();
            memory.save(&numbered(1));
            memory.save(&numbered(2));
            memory.bytes[address] ^= 1 << bit;
            let found = loaded(&mut memory);
            prop_assert!(found == Some(numbered(1)) || found == Some(numbered(2)), "{found:?}");
        }
    }
}

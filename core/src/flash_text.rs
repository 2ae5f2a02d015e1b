//! Texts that stay in flash: the Uno would copy every string literal into its RAM, and they would fill it.
//!
//! All texts of the program are one array of bytes, each ended by a zero. They are packed when the program is compiled
//! (byte pair encoding). The printable characters move down to 1..=95. Then the most frequent pair of bytes becomes one
//! byte from 96 up, again and again, as long as that saves something. A text is found by counting zeros, which takes up to
//! a millisecond and no RAM.

use crate::{console, settings};
use avr_progmem::progmem;

/// The tables of texts, each by where it begins.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub(crate) enum Table {
    /// Name and unit of each setting.
    Settings = STARTS[0],
    /// Name and arguments of each command.
    Commands = STARTS[1],
    /// What the console says.
    Sayings = STARTS[2],
    /// Words within it.
    Words = STARTS[3],
}

const TABLES: [&str; 4] = [settings::TEXT, console::COMMAND_TEXT, console::SAYINGS, console::WORDS];
const UNPACKED: usize = TABLES[0].len() + TABLES[1].len() + TABLES[2].len() + TABLES[3].len();
/// How far the characters move down: the space, the first that is printable, becomes 1.
const DOWN: u8 = b' ' - 1;
/// The first byte that stands for a pair: the one after the last printable character.
const FIRST_PAIR: u8 = b'~' - DOWN + 1;
/// How many there can be; 255 stands for none, so that [`most_frequent`] has as many bytes in either half.
const MOST_PAIRS: usize = 255 - FIRST_PAIR as usize;
/// Least number of times a pair must occur to be worth its two bytes in the list of pairs.
const LEAST: u8 = 4;
/// How deep a byte may stand for pairs of pairs.
const DEEPEST: usize = 8;

struct Packed {
    bytes: [u8; UNPACKED],
    length: usize,
    pairs: [[u8; 2]; MOST_PAIRS],
    count: usize,
    /// What has to be put aside while a byte is unpacked.
    depth: [u8; 256],
}

#[allow(long_running_const_eval, reason = "some seconds in which the text loses two fifths")]
const PACKED: Packed = pack();
const LENGTH: usize = PACKED.length;
const PAIR_COUNT: usize = PACKED.count;

progmem! {
    static progmem BYTES: [u8; LENGTH] = first_bytes();
    static progmem PAIRS: [[u8; 2]; PAIR_COUNT] = first_pairs();
}

const fn first_bytes() -> [u8; LENGTH] {
    let mut bytes = [0; LENGTH];
    bytes.copy_from_slice(PACKED.bytes.split_at(LENGTH).0);
    bytes
}

const fn first_pairs() -> [[u8; 2]; PAIR_COUNT] {
    let mut pairs = [[0; 2]; PAIR_COUNT];
    pairs.copy_from_slice(PACKED.pairs.split_at(PAIR_COUNT).0);
    pairs
}

/// All texts one after the other.
const fn joined() -> [u8; UNPACKED] {
    let (mut bytes, mut table, mut end) = ([0; UNPACKED], 0, 0);
    while table < TABLES.len() {
        let text = TABLES[table].as_bytes();
        let mut i = 0;
        while i < text.len() {
            assert!(text[i] == 0 || text[i] >= b' ' && text[i] <= b'~', "a text is printable ASCII");
            bytes[end] = text[i].saturating_sub(DOWN);
            (i, end) = (i + 1, end + 1);
        }
        table += 1;
    }
    bytes
}

const fn pack() -> Packed {
    let mut packed =
        Packed { bytes: joined(), length: UNPACKED, pairs: [[0; 2]; MOST_PAIRS], count: 0, depth: [0; 256] };
    while packed.count < MOST_PAIRS {
        let (pair, occurrences) = most_frequent(&packed);
        if occurrences < LEAST {
            break;
        }
        replace(&mut packed, pair);
    }
    packed
}

/// The pair that occurs most often, and how often, those that would go too deep left out. Two arrays, because none may
/// be larger than 32 KiB on the chip, and that holds while compiling as well.
const fn most_frequent(packed: &Packed) -> ([u8; 2], u8) {
    const HALF: usize = 127;
    let mut low = [[0u8; 256]; HALF];
    let mut high = [[0u8; 256]; HALF];
    let (mut best, mut most, mut i) = ([0; 2], 0, 1);
    while i < packed.length {
        let (left, right) = (packed.bytes[i - 1], packed.bytes[i]);
        let shallow = packed.depth[left as usize] as usize + 1 < DEEPEST;
        if left != 0 && right != 0 && shallow {
            let row = left as usize - 1;
            let count = if row < HALF { &mut low[row] } else { &mut high[row - HALF] };
            let count = &mut count[right as usize];
            *count = count.saturating_add(1);
            if *count > most {
                (best, most) = ([left, right], *count);
            }
        }
        i += 1;
    }
    (best, most)
}

/// Gives the pair the next byte.
const fn replace(packed: &mut Packed, pair: [u8; 2]) {
    let code = FIRST_PAIR + packed.count as u8;
    packed.pairs[packed.count] = pair;
    packed.count += 1;
    let (left, right) = (packed.depth[pair[0] as usize] + 1, packed.depth[pair[1] as usize]);
    packed.depth[code as usize] = if left > right { left } else { right };
    let (mut from, mut to) = (0, 0);
    while from < packed.length {
        let here = packed.bytes[from] == pair[0] && from + 1 < packed.length && packed.bytes[from + 1] == pair[1];
        packed.bytes[to] = if here { code } else { packed.bytes[from] };
        from += if here { 2 } else { 1 };
        to += 1;
    }
    packed.length = to;
}

/// Where each table begins.
const STARTS: [u16; 4] = starts();

const fn starts() -> [u16; 4] {
    let (mut starts, mut table, mut at) = ([0; 4], 1, 0);
    while table < TABLES.len() {
        let text = TABLES[table - 1].as_bytes();
        let (mut i, mut texts) = (0, 0);
        while i < text.len() {
            texts += (text[i] == 0) as usize;
            i += 1;
        }
        while texts > 0 {
            texts -= (PACKED.bytes[at] == 0) as usize;
            at += 1;
        }
        starts[table] = at as u16;
        table += 1;
    }
    starts
}

/// The rest of a text in flash.
#[derive(Clone, Copy)]
pub struct FlashText {
    at: u16,
    /// Bytes still to be unpacked before the one at `at`.
    aside: [u8; DEEPEST],
    depth: u8,
}

impl FlashText {
    /// Text `index` of a table.
    #[inline(never)]
    pub(crate) fn of(table: Table, index: u8) -> Self {
        let mut text = Self { at: table as u16, aside: [0; DEEPEST], depth: 0 };
        text.skip_texts(index);
        text
    }

    /// Goes on to the text `count` texts later.
    #[inline(never)]
    pub(crate) fn skip_texts(&mut self, mut count: u8) {
        self.depth = 0;
        let mut at = self.at;
        while count > 0 && (at as usize) < LENGTH {
            if byte(at) == 0 {
                count -= 1;
            }
            at += 1;
        }
        self.at = at;
    }

    /// Which of the alternatives of this text, `one|other|third` up to its first space, is `word`; goes on behind it.
    #[inline(never)]
    pub(crate) fn choice(&mut self, word: &[u8]) -> Option<u8> {
        let (mut index, mut same) = (0, 0u8);
        loop {
            let next = self.next().unwrap_or(0);
            if !matches!(next, 0 | b'|' | b' ') {
                let expected = word.get(same as usize) == Some(&next);
                // A length no word has: the rest of this alternative cannot be it any more.
                same = if expected { same + 1 } else { 0xfe };
                continue;
            }
            if same as usize == word.len() {
                return Some(index);
            }
            if next != b'|' {
                return None;
            }
            (index, same) = (index + 1, 0);
        }
    }
}

/// Which of the first `count` entries of a table, of two texts each, has `word` as its first text.
#[inline(never)]
pub(crate) fn find(table: Table, count: u8, word: &[u8]) -> Option<u8> {
    let mut text = FlashText::of(table, 0);
    for index in 0..count {
        if text.choice(word).is_some() {
            return Some(index);
        }
        text.skip_texts(2);
    }
    None
}

#[inline(always)]
fn byte(at: u16) -> u8 {
    debug_assert!((at as usize) < LENGTH);
    // SAFETY: every text of a table ends with a zero, past which only `skip_texts` goes, and no further than the end.
    unsafe { avr_progmem::raw::read_byte(BYTES.as_ptr().cast::<u8>().wrapping_add(at as usize)) }
}

impl Iterator for FlashText {
    type Item = u8;

    #[inline(never)]
    fn next(&mut self) -> Option<u8> {
        let mut byte = match self.depth.checked_sub(1) {
            Some(top) => {
                self.depth = top;
                self.aside.get(top as usize).copied()?
            }
            None => {
                let byte = byte(self.at);
                if byte == 0 {
                    return None;
                }
                self.at += 1;
                byte
            }
        };
        while byte >= FIRST_PAIR {
            let [left, right] = PAIRS.load_at((byte - FIRST_PAIR) as usize);
            if let Some(place) = self.aside.get_mut(self.depth as usize) {
                *place = right;
            }
            self.depth += 1;
            byte = left;
        }
        Some(byte + DOWN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_text_comes_back() {
        let tables = [Table::Settings, Table::Commands, Table::Sayings, Table::Words];
        for (table, texts) in tables.into_iter().zip(TABLES) {
            for (index, text) in texts.split_terminator('\0').enumerate() {
                let unpacked: String = FlashText::of(table, index as u8).map(char::from).collect();
                assert_eq!(unpacked, text);
            }
        }
        println!("{UNPACKED} bytes of text packed into {}", LENGTH + 2 * PAIR_COUNT);
    }

    #[test]
    fn choices() {
        let modes = || FlashText::of(Table::Commands, 3);
        assert_eq!(modes().choice(b"off"), Some(0));
        assert_eq!(modes().choice(b"lqr_position"), Some(5));
        for wrong in [&b""[..], b"lqr", b"lqr_positions", b"of", b"offf", b"ooff", b"off|open"] {
            assert_eq!(modes().choice(wrong), None);
        }
    }
}

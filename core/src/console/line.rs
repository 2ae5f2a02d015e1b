//! The line editor: what comes in becomes lines, or is refused whole.

/// Longest line.
const LONGEST: usize = 96;

/// A line under way.
#[derive(Clone, Debug)]
pub struct LineEditor {
    bytes: [u8; LONGEST],
    length: u8,
    /// Words of the line that were read end here.
    read: u8,
    /// The line holds something that is not printable ASCII, or is too long: it is refused at its end.
    bad: bool,
    /// The last byte was a carriage return, so a line feed belongs to it.
    after_return: bool,
}

/// What a byte has done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edit {
    /// Nothing to show.
    Nothing,
    /// The character is part of the line.
    Added(u8),
    /// The last character is gone.
    Erased,
    /// So many characters are gone.
    Cleared(u8),
    /// The line is complete.
    Complete,
    /// The line is complete and not acceptable.
    Refused,
}

impl Default for LineEditor {
    fn default() -> Self {
        Self { bytes: [0; LONGEST], length: 0, read: 0, bad: false, after_return: false }
    }
}

impl LineEditor {
    /// Takes a byte. Carriage return, line feed or both end a line; backspace, delete and Ctrl-U edit it.
    pub fn push(&mut self, byte: u8) -> Edit {
        let after_return = core::mem::replace(&mut self.after_return, byte == b'\r');
        match byte {
            b'\n' if after_return => Edit::Nothing,
            b'\r' | b'\n' if self.bad => Edit::Refused,
            b'\r' | b'\n' => Edit::Complete,
            0x08 | 0x7f if self.length > 0 => {
                self.length -= 1;
                Edit::Erased
            }
            0x08 | 0x7f => Edit::Nothing,
            0x15 => {
                let cleared = self.length;
                self.clear();
                Edit::Cleared(cleared)
            }
            0x20..=0x7e => match self.bytes.get_mut(self.length as usize) {
                Some(place) => {
                    *place = byte;
                    self.length += 1;
                    Edit::Added(byte)
                }
                None => {
                    self.bad = true;
                    Edit::Nothing
                }
            },
            _ => {
                self.bad = true;
                Edit::Nothing
            }
        }
    }

    /// The line so far.
    #[cfg(test)]
    fn line(&self) -> &[u8] {
        self.bytes.get(..self.length as usize).unwrap_or(&[])
    }

    /// The next word of the line; empty at its end.
    #[inline(never)]
    pub fn next_word(&mut self) -> &[u8] {
        let line = self.bytes.get(..self.length as usize).unwrap_or(&[]);
        let (word, rest) = word(line.get(self.read as usize..).unwrap_or(&[]));
        self.read = self.length - rest.len() as u8;
        word
    }

    /// Whether all words were read.
    pub fn at_end(&self) -> bool {
        self.bytes.get(self.read as usize..self.length as usize).is_none_or(|rest| rest.trim_ascii_start().is_empty())
    }

    /// Goes back to the first word of the line.
    pub fn rewind(&mut self) {
        self.read = 0;
    }

    /// Begins a new line.
    pub fn clear(&mut self) {
        self.length = 0;
        self.read = 0;
        self.bad = false;
    }
}

/// The first word of `line`, and what follows it; empty at the end.
pub fn word(line: &[u8]) -> (&[u8], &[u8]) {
    let line = line.trim_ascii_start();
    let end = line.iter().position(|&byte| byte == b' ').unwrap_or(line.len());
    line.split_at_checked(end).unwrap_or((line, &[]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(input: &[u8]) -> Vec<Result<String, ()>> {
        let mut editor = LineEditor::default();
        let mut lines = Vec::new();
        for &byte in input {
            match editor.push(byte) {
                Edit::Complete => lines.push(Ok(String::from_utf8(editor.line().to_vec()).unwrap())),
                Edit::Refused => lines.push(Err(())),
                _ => continue,
            }
            editor.clear();
        }
        lines
    }

    #[test]
    fn line_ends_and_editing() {
        let ok = |text: &str| Ok(text.to_string());
        assert_eq!(lines(b"a\rb\nc\r\nd\r\r"), [ok("a"), ok("b"), ok("c"), ok("d"), ok("")]);
        assert_eq!(lines(b"arx\x08m\n\x08\x7fok\n"), [ok("arm"), ok("ok")]);
        assert_eq!(lines(b"bad\x15good\n"), [ok("good")]);
    }

    #[test]
    fn what_is_not_text_or_too_long_is_refused_whole() {
        assert_eq!(lines(b"ar\x00m\narm\n"), [Err(()), Ok("arm".to_string())]);
        assert_eq!(lines("\u{e4}rm\n".as_bytes()), [Err(())]);
        let long = [b'x'; 97];
        assert_eq!(lines(&[&long[..], b"\narm\n"].concat()), [Err(()), Ok("arm".to_string())]);
        assert_eq!(lines(&[&long[..96], b"\n"].concat()).len(), 1);
    }

    #[test]
    fn words() {
        let (first, rest) = word(b"  set  a 1 ");
        assert_eq!((first, rest), (&b"set"[..], &b"  a 1 "[..]));
        assert_eq!(word(b"   "), (&b""[..], &b""[..]));
    }
}

//! Converts the bytes of a file to text.

/// Reads the encodings of editors, spreadsheets and shells: UTF-8 with or without a byte order mark, UTF-16 with one,
/// otherwise Latin-1. Line ends become one character. `None`: it is not text.
pub fn decoded(bytes: Vec<u8>) -> Option<String> {
    let text = match &bytes[..] {
        [0xef, 0xbb, 0xbf, rest @ ..] => String::from_utf8(rest.to_vec()).ok(),
        [0xff, 0xfe, rest @ ..] => utf_16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf_16(rest, u16::from_be_bytes),
        _ => String::from_utf8(bytes).or_else(|error| latin_1(error.as_bytes()).ok_or(error)).ok(),
    };
    // Table readers miscount lines that end with two characters.
    text.map(|text| if text.contains('\r') { text.replace("\r\n", "\n") } else { text })
}

fn utf_16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Option<String> {
    let units: Vec<u16> = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
    String::from_utf16(&units).ok()
}

/// One byte for each letter. Text has no control characters.
fn latin_1(bytes: &[u8]) -> Option<String> {
    let is_text = |byte: &u8| matches!(byte, b'\t' | b'\r' | b'\n' | 0x20..=0x7e | 0x80..);
    bytes.iter().all(is_text).then(|| bytes.iter().copied().map(char::from).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_other_programs_are_read() {
        let text = "u_V at 20 \u{b0}C\r\n";
        let utf_16 =
            |unit: fn(u16) -> [u8; 2]| "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(unit).collect();
        let latin_1 = text.chars().map(|letter| letter as u8).collect();
        let with_mark = format!("\u{feff}{text}").into_bytes();
        for bytes in [text.into(), with_mark, utf_16(u16::to_le_bytes), utf_16(u16::to_be_bytes), latin_1] {
            assert_eq!(decoded(bytes).as_deref(), Some("u_V at 20 \u{b0}C\n"));
        }
        for bytes in [&[0x93, b'N', b'U', 0, 1][..], &[0xff, 0xfe, 0, 0xd8]] {
            assert_eq!(decoded(bytes.to_vec()), None);
        }
    }
}

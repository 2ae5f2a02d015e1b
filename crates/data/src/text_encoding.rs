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
    text.map(with_one_line_end)
}

/// Lines that end with several characters would be miscounted.
fn with_one_line_end(text: String) -> String {
    match (text.contains('\r'), text.contains('\n')) {
        (false, _) => text,
        (true, true) => text.replace("\r\n", "\n"),
        (true, false) => text.replace('\r', "\n"),
    }
}

/// Reads a text in which a serial line has left noise: characters that no text has, in a few places.
pub fn decoded_with_noise(bytes: &[u8]) -> Option<String> {
    let is_noise = |byte: &u8| matches!(byte, 0..=8 | 0x0b | 0x0c | 0x0e..=0x1f | 0x7f);
    let noise = bytes.iter().filter(|byte| is_noise(byte)).count();
    if noise as f64 > MOST_NOISE * bytes.len() as f64 {
        return None;
    }
    let text = bytes.iter().map(|byte| if is_noise(byte) { char::REPLACEMENT_CHARACTER } else { char::from(*byte) });
    Some(with_one_line_end(text.collect()))
}

/// Largest share of characters that a board's start or a loose wire leaves in a text.
const MOST_NOISE: f64 = 0.01;

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
        let with_noise =
            b"\x00\x7fReady\rt_s,u_V\r0,1\r".repeat(20).into_iter().chain(vec![b'1'; 4000]).collect::<Vec<_>>();
        assert!(decoded(with_noise.clone()).is_none_or(|text| text.contains('\0')));
        assert!(decoded_with_noise(&with_noise).is_some_and(|text| text.contains("Ready\nt_s,u_V\n0,1\n")));
        assert_eq!(decoded_with_noise(&[0; 20]), None);
        for bytes in [&[0x93, b'N', b'U', 0, 1][..], &[0xff, 0xfe, 0, 0xd8]] {
            assert_eq!(decoded(bytes.to_vec()), None);
        }
    }
}

//! Decimal numbers, without the formatting machinery of the standard library, which alone would fill the flash.
//!
//! Reading is within 1e-6 of the number; what is printed with six digits reads back within 1e-5.

use ufmt::{uWrite, uwrite};

/// Reads `-12.5`, `+3`, `.5`, `1e-3`: sign, digits, point, digits, exponent. Nothing else.
pub fn parse(text: &[u8]) -> Option<f32> {
    let (negative, text) = sign(text);
    let (mut mantissa, mut exponent, mut digits, mut point) = (0u32, 0i16, false, false);
    let mut rest = text;
    while let Some((&byte, after)) = rest.split_first() {
        match byte {
            b'0'..=b'9' => {
                digits = true;
                // Eight digits are more than the format holds; further ones only count.
                if mantissa < 10_000_000 {
                    mantissa = mantissa * 10 + (byte - b'0') as u32;
                    exponent -= point as i16;
                } else {
                    exponent += !point as i16;
                }
            }
            b'.' if !point => point = true,
            b'e' | b'E' if digits => {
                exponent += exponent_of(after)?;
                rest = &[];
                break;
            }
            _ => return None,
        }
        rest = after;
    }
    if !digits || !rest.is_empty() {
        return None;
    }
    let mut value = mantissa as f32;
    for _ in 0..exponent.unsigned_abs().min(60) {
        value = if exponent < 0 { value / 10.0 } else { value * 10.0 };
    }
    Some(if negative { -value } else { value })
}

fn sign(text: &[u8]) -> (bool, &[u8]) {
    match text.split_first() {
        Some((b'-', rest)) => (true, rest),
        Some((b'+', rest)) => (false, rest),
        _ => (false, text),
    }
}

/// A whole exponent of at most two digits.
fn exponent_of(text: &[u8]) -> Option<i16> {
    let (negative, digits) = sign(text);
    if digits.is_empty() || digits.len() > 2 {
        return None;
    }
    let mut value = 0;
    for &digit in digits {
        if !digit.is_ascii_digit() {
            return None;
        }
        value = value * 10 + (digit - b'0') as i16;
    }
    Some(if negative { -value } else { value })
}

/// Reads a whole number of 0..=65535.
pub fn parse_u16(text: &[u8]) -> Option<u16> {
    if text.is_empty() {
        return None;
    }
    let mut value = 0u32;
    for &digit in text {
        if !digit.is_ascii_digit() || value > 65535 {
            return None;
        }
        value = value * 10 + (digit - b'0') as u32;
    }
    u16::try_from(value).ok()
}

/// Prints six significant digits without trailing zeros; beyond 1e-4..1e7 with an exponent.
pub fn write<W: uWrite>(out: &mut W, value: f32) -> Result<(), W::Error> {
    if value.is_nan() || value.is_infinite() {
        return out.write_char('?');
    }
    if value < 0.0 {
        out.write_char('-')?;
    }
    let (mut digits, mut exponent) = scale(if value < 0.0 { -value } else { value });
    // Trailing zeros say nothing.
    let mut count = 6i8;
    while count > 1 && digits % 10 == 0 {
        digits /= 10;
        count -= 1;
    }
    let scientific = !(-4..7).contains(&exponent);
    let shown = exponent;
    if scientific {
        exponent = 0;
    }
    write_fixed(out, digits, count, exponent)?;
    if scientific {
        out.write_char('e')?;
        uwrite!(out, "{}", shown)?;
    }
    Ok(())
}

/// Six digits and the power of ten of the first.
fn scale(mut value: f32) -> (u32, i8) {
    if value == 0.0 {
        return (0, 0);
    }
    let mut exponent = 0;
    while value >= 10.0 {
        value /= 10.0;
        exponent += 1;
    }
    while value < 1.0 {
        value *= 10.0;
        exponent -= 1;
    }
    let digits = (value * 100_000.0 + 0.5) as i32 as u32;
    if digits >= 1_000_000 { (100_000, exponent + 1) } else { (digits, exponent) }
}

/// `count` digits, the first worth 10^`exponent`.
fn write_fixed<W: uWrite>(out: &mut W, mut digits: u32, count: i8, exponent: i8) -> Result<(), W::Error> {
    let mut text = [b'0'; 6];
    for place in text.iter_mut().take(count as usize).rev() {
        *place = b'0' + (digits % 10) as u8;
        digits /= 10;
    }
    let mut place = exponent;
    if place < 0 {
        out.write_str("0.")?;
        for _ in 0..-1 - place {
            out.write_char('0')?;
        }
        place = -1;
    }
    let mut shown = text.iter().take(count as usize);
    let mut left = count;
    while left > 0 || place >= 0 {
        out.write_char(shown.next().copied().unwrap_or(b'0') as char)?;
        left -= 1;
        if place == 0 && left > 0 {
            out.write_char('.')?;
        }
        place -= 1;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Printed(String);

    impl uWrite for Printed {
        type Error = core::convert::Infallible;

        fn write_str(&mut self, text: &str) -> Result<(), Self::Error> {
            self.0 += text;
            Ok(())
        }
    }

    fn printed(value: f32) -> String {
        let mut text = Printed(String::new());
        write(&mut text, value).unwrap();
        text.0
    }

    #[test]
    fn examples() {
        let cases = [
            (0.0, "0"),
            (1.0, "1"),
            (-12.5, "-12.5"),
            (0.05, "0.05"),
            (0.000_1, "0.0001"),
            (0.000_01, "1e-5"),
            (2000.0, "2000"),
            (123_456.0, "123456"),
            (1_234_560.0, "1234560"),
            (12_345_600.0, "1.23456e7"),
            (999_999.6, "1000000"),
            (100.0, "100"),
        ];
        for (value, text) in cases {
            assert_eq!(printed(value), text);
        }
        for text in ["", "-", ".", "1.2.3", "e5", "1e", "1e+", "1e123", "0x1", "1 ", "nan", "inf", "--1", "1e1.5"] {
            assert_eq!(parse(text.as_bytes()), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn reads_what_the_standard_library_reads(value in -1e30f64..1e30, digits in 0usize..9, small: bool) {
            let value = if small { value / 1e33 } else { value };
            for text in [format!("{value:.digits$e}"), format!("{:.digits$}", value % 1e9)] {
                let exact: f64 = text.parse().unwrap();
                let read = parse(text.as_bytes()).unwrap() as f64;
                prop_assert!((read - exact).abs() <= exact.abs() * 3e-6 + 1e-36, "{text}: {read}");
            }
        }

        #[test]
        fn reads_what_it_prints(bits: u32) {
            let value = f32::from_bits(bits);
            prop_assume!(value.is_finite() && (value == 0.0 || (1e-30..1e30).contains(&value.abs())));
            let back = parse(printed(value).as_bytes()).unwrap();
            prop_assert!((back - value).abs() <= value.abs() * 1.2e-5, "{value} {} {back}", printed(value));
        }

        #[test]
        fn any_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..30)) {
            if let Some(value) = parse(&bytes) {
                prop_assert!(bytes.iter().all(|b| b"+-.eE0123456789".contains(b)), "{value}");
            }
            if parse_u16(&bytes).is_some() {
                prop_assert!(bytes.iter().all(u8::is_ascii_digit));
            }
        }
    }
}

//! Decimal numbers, without the formatting machinery of the standard library, which alone would fill the flash.
//!
//! Reading is within 1e-6 of the number; what is printed with six digits reads back within 1e-5.

use crate::arith::whole;

/// Reads `-12.5`, `+3`, `.5`, `1e-3`: sign, digits, point, digits, exponent. Nothing else.
#[inline(never)]
pub fn parse(text: &[u8]) -> Option<f32> {
    let (negative, text) = sign(text);
    let (mut value, mut exponent, mut digits, mut point) = (0.0, 0i8, false, false);
    let mut rest = text.iter();
    while let Some(&byte) = rest.next() {
        match byte {
            b'0'..=b'9' => {
                digits = true;
                value = value * 10.0 + (byte - b'0') as f32;
                // No line is so long that this could overflow.
                exponent -= point as i8;
            }
            b'.' if !point => point = true,
            b'e' | b'E' if digits => {
                exponent = exponent.saturating_add(exponent_of(rest.as_slice())?);
                break;
            }
            _ => return None,
        }
    }
    if !digits {
        return None;
    }
    while exponent != 0 {
        if exponent < 0 {
            value /= 10.0;
            exponent += 1;
        } else {
            value *= 10.0;
            exponent -= 1;
        }
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
fn exponent_of(text: &[u8]) -> Option<i8> {
    let (negative, digits) = sign(text);
    let value = if digits.len() > 2 { None } else { parse_u16(digits) }? as i8;
    Some(if negative { -value } else { value })
}

/// Reads a whole number of 0..=65535.
#[inline(never)]
pub fn parse_u16(text: &[u8]) -> Option<u16> {
    let mut value = 0u16;
    for &digit in text {
        let digit = digit.wrapping_sub(b'0');
        if digit > 9 || value > 6553 {
            return None;
        }
        value = (10 * value).checked_add(digit as u16)?;
    }
    (!text.is_empty()).then_some(value)
}

/// A number in print.
#[derive(Clone, Copy, Debug, Default)]
pub struct Decimal {
    bytes: [u8; 16],
    length: u8,
}

impl Decimal {
    /// A number as [`Decimal::write`] writes it.
    pub fn of(value: f32) -> Self {
        let mut text = Self::default();
        text.write(value);
        text
    }

    /// Six significant digits without trailing zeros; beyond 1e-4..1e7 with an exponent.
    #[inline(never)]
    pub fn write(&mut self, value: f32) {
        let negative = value < 0.0;
        if negative {
            self.push(b'-');
        }
        let (number, exponent) = scale(value.abs());
        let plain = (-4..7).contains(&exponent);
        self.place(number, Some(if plain { exponent } else { 0 }));
        if plain {
            return;
        }
        self.push(b'e');
        if exponent < 0 {
            self.push(b'-');
        }
        let (tens, ones) = (exponent.unsigned_abs() / 10, exponent.unsigned_abs() % 10);
        if tens > 0 {
            self.push(b'0' + tens);
        }
        self.push(b'0' + ones);
    }

    /// A whole number, to the last digit.
    pub fn write_whole(&mut self, number: u32) {
        self.place(number, None);
    }

    /// The characters.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length as usize).unwrap_or(&[])
    }

    #[inline(never)]
    fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.length as usize) {
            *place = byte;
            self.length += 1;
        }
    }

    /// The digits of a number, of which the first is worth 10^`exponent`, or the last one if there is none; without
    /// trailing zeros behind a point, which say nothing.
    #[inline(never)]
    fn place(&mut self, mut number: u32, exponent: Option<i8>) {
        let (mut digits, mut count, mut zeros) = ([0; 10], 0, 0);
        // The last digit first.
        for place in &mut digits {
            if number == 0 {
                break;
            }
            *place = (number % 10) as u8;
            number /= 10;
            zeros += (zeros == count && *place == 0) as i8;
            count += 1;
        }
        let mut worth = exponent.unwrap_or(if count == 0 { 0 } else { count - 1 });
        let mut above = if worth < 0 { worth } else { 0 };
        while above < 0 {
            self.push(b'0');
            if above == worth {
                self.push(b'.');
            }
            above += 1;
        }
        while count > zeros || worth >= 0 {
            count -= 1;
            self.push(b'0' + digits.get(count as usize).copied().unwrap_or(0));
            if worth == 0 && count > zeros {
                self.push(b'.');
            }
            worth -= 1;
        }
    }
}

/// Six digits and the power of ten of the first.
fn scale(mut value: f32) -> (u32, i8) {
    if value == 0.0 {
        return (0, 0);
    }
    let mut exponent = 0;
    // No further than numbers go.
    while value >= 10.0 && exponent < 39 {
        value /= 10.0;
        exponent += 1;
    }
    while value < 1.0 {
        value *= 10.0;
        exponent -= 1;
    }
    let digits = whole(value * 100_000.0 + 0.5) as u32;
    if digits >= 1_000_000 { (100_000, exponent + 1) } else { (digits, exponent) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn printed(value: f32) -> String {
        String::from_utf8(Decimal::of(value).as_bytes().to_vec()).unwrap()
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
        for whole in [0, 7, 10, 65_535, 999_999] {
            assert_eq!(printed(whole as f32), whole.to_string());
        }
        for whole in [0, 9, 10, 65_536, 999_999, 1_234_567, 4_000_000_000, u32::MAX] {
            let mut decimal = Decimal::default();
            decimal.write_whole(whole);
            assert_eq!(decimal.as_bytes(), whole.to_string().as_bytes());
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

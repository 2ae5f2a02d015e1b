//! Texts that stay in flash: the Uno would copy every string literal into its RAM, and the help alone would fill it.
//!
//! A table of texts is one array of bytes, each text ended by a zero; a text is found by counting zeros, which takes up
//! to a millisecond and no RAM.

/// Declares a table in flash from literals.
macro_rules! flash_texts {
    ($name:ident, $length:ident, $($text:expr),* $(,)?) => {
        const $length: usize = concat!($($text, "\0"),*).len();
        avr_progmem::progmem! {
            static progmem $name: [u8; $length] = $crate::flash_text::bytes(concat!($($text, "\0"),*));
        }
    };
}
pub(crate) use flash_texts;

/// The bytes of a text whose length is known.
pub(crate) const fn bytes<const N: usize>(text: &str) -> [u8; N] {
    let text = text.as_bytes();
    let mut bytes = [0; N];
    let mut i = 0;
    while i < N {
        bytes[i] = text[i];
        i += 1;
    }
    bytes
}

/// The characters of text `index` of a table of `N` bytes, read by `byte`.
pub(crate) fn text<const N: usize>(byte: impl Fn(usize) -> u8 + Copy, index: usize) -> impl Iterator<Item = u8> {
    let mut skip = index;
    let mut at = 0;
    while skip > 0 && at < N {
        if byte(at) == 0 {
            skip -= 1;
        }
        at += 1;
    }
    (at..N).map(byte).take_while(|&byte| byte != 0)
}

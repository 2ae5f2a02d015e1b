//! Commands and settings in words, for the host: the chip has no room for them.

use super::{COMMAND_COUNT, COMMAND_HELP, COMMAND_TEXTS};
use crate::flash_text::{self, FlashText, Table};
use crate::settings::{self, Param, Settings};

/// What a line of `help` or `show` is about, in one line, by the word it begins with: the chip has no room for it.
pub fn explanation(word: &str) -> Option<&'static str> {
    let command = flash_text::find(Table::Commands, COMMAND_COUNT, word.as_bytes());
    command.map(|index| COMMAND_HELP[index as usize]).or_else(|| settings::find(word.as_bytes()).map(settings::help))
}

/// Commands and settings as one text, for the host.
pub fn reference() -> impl core::fmt::Display {
    Reference
}

struct Reference;

/// The bar would end a cell of the table.
fn within_a_cell(byte: u8) -> u8 {
    if byte == b'|' { b'/' } else { byte }
}

impl core::fmt::Display for Reference {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        use core::fmt::Write;
        fn put(f: &mut core::fmt::Formatter<'_>, text: impl Iterator<Item = u8>) -> core::fmt::Result {
            text.map(char::from).try_for_each(|character| f.write_char(character))
        }
        writeln!(f, "| command | arguments | what it does |\n|---|---|---|")?;
        for index in 0..COMMAND_COUNT {
            for part in 0..COMMAND_TEXTS {
                write!(f, "| ")?;
                put(f, FlashText::of(Table::Commands, index * COMMAND_TEXTS + part).map(within_a_cell))?;
                write!(f, " ")?;
            }
            write!(f, "| {} ", COMMAND_HELP[index as usize])?;
            writeln!(f, "|")?;
        }
        writeln!(f, "\n| setting | unit | default | range | what it is |\n|---|---|---|---|---|")?;
        let defaults = Settings::defaults();
        for &param in Param::ALL {
            let (min, max) = param.range();
            write!(f, "| ")?;
            put(f, settings::text(param, settings::Text::Name))?;
            write!(f, " | ")?;
            put(f, settings::text(param, settings::Text::Unit).map(within_a_cell))?;
            writeln!(f, " | {} | {min}..{max} | {} |", defaults.get(param), settings::help(param))?;
        }
        Ok(())
    }
}

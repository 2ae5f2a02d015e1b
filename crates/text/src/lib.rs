//! Texts for a person: mistyped keys of files, names as a shell takes them, numbers with the digits that count.

pub mod keys;
pub mod terminal_text;

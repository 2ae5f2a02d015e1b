//! What the tests of the chip share.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

use host_sim::chip::{Chip, Program, Unconnected, assemble};

/// Assembles a program of `chip-programs`.
pub fn elf(name: &str) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("chip-programs").join(name).with_extension("S");
    assemble(source).unwrap_or_else(|error| panic!("{error}"))
}

/// A chip with this program and nothing around it.
pub fn chip(name: &str) -> Chip<Unconnected> {
    Chip::new(&Program::load(elf(name)).unwrap_or_else(|error| panic!("{error}")), Unconnected)
}

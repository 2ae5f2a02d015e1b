//! Texts for a person: hints for mistyped keys, names quoted for a shell, numbers with their significant digits.
//!
//! ```
//! use motorbench_text::{keys, terminal_text};
//!
//! assert_eq!(keys::nearest("inertia_kgm2", ["inertia_kg_m2", "inductance_H"]), Some("inertia_kg_m2"));
//! assert_eq!(terminal_text::short(0.0681234), "0.0681");
//! assert_eq!(terminal_text::quoted("my run.csv"), "'my run.csv'");
//! ```
//!
//! The functions that everything else uses: [`terminal_text::short`] for a number, [`terminal_text::wrapped`] for a
//! sentence, [`keys::explained`] for an error in a TOML file.

pub mod keys;
pub mod terminal_text;

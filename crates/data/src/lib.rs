//! Recordings, rig files, formats of other tools and a board's telemetry: text and bytes in, tables out. Opens no file.

pub mod convert;
pub mod delimited;
pub mod names;
pub mod recording;
pub mod rig;
pub mod statistics;
pub mod telemetry;
pub mod text_encoding;

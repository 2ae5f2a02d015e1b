//! Recordings, rig files, formats of other tools and a board's telemetry. Text and bytes go in, tables come out. It
//! opens no file.
//!
//! ```
//! use motorbench_data::recording::{Channel, Recording};
//! use motorbench_data::rig::Rig;
//!
//! let text = "t_s,u_V,omega_rad_per_s\n0.000,0,0\n0.001,12,0.4\n0.002,12,1.1\n";
//! let recording = Recording::parse("run.csv", text.as_bytes(), &[])?;
//! assert_eq!(recording.get(Channel::Voltage), Some(&[0.0, 12.0, 12.0][..]));
//!
//! let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n[motor]\nresistance_ohm = 5.84\n")?;
//! assert_eq!(rig.motor.resistance_ohm, Some(5.84));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The three types to know: [`recording::Recording`] (columns with units), [`rig::Rig`] (the rig of a recording),
//! [`convert::Format`] (formats of other tools).

mod assembled;
mod content;
pub mod convert;
pub mod coverage;
pub mod delimited;
pub mod mapping;
pub mod names;
pub mod preview;
pub mod recording;
pub mod rig;
pub mod sensor_scales;
mod series;
mod speed_signs;
mod speed_wraps;
pub mod statistics;
mod suggestions;
mod table;
pub mod telemetry;
pub mod text_encoding;
mod times;
mod units;

//! Pages for a browser, plots and texts about a diagnosis, a design and a test stand. It returns text and writes no
//! file.
//!
//! ```
//! use motorbench_report::panels::{Panel, panels};
//!
//! let speed = (0..100).map(|row| 60.0 * (1.0 - (-f64::from(row) / 20.0).exp())).collect();
//! let svg = panels(1e-3, &[Panel::new("speed, rad/s").line("measured", speed)]);
//! assert!(svg.starts_with("<svg"));
//! ```
//!
//! The modules to know: [`diagnosis_page`] is the report of a diagnosis, [`diagnosis_text`] the same for a terminal.
//! [`web_page`] is the template of all pages, [`plot`] a plot of a page, [`panels`] has plots over time as a file.

pub mod comparison_page;
pub mod design;
pub mod diagnosis_page;
pub mod diagnosis_text;
pub mod panels;
#[cfg(feature = "png")]
pub mod picture;
pub mod plot;
pub mod steady_state;
pub mod web_page;

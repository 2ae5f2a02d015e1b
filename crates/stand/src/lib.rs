//! The test stand and the experiments on a board: losses, condition, tuning, identification with both loops.
//!
//! ```
//! use motorbench_data::recording::Recording;
//! use motorbench_data::rig::Rig;
//! use motorbench_stand::evaluate;
//!
//! # let mut csv = String::from("u_V,i_A,omega_rad_per_s\n");
//! # for volts in [6.0_f64, 9.0, 12.0, 15.0, 18.0] {
//! #     for sign in [1.0, -1.0] {
//! #         let current = 0.1 + 0.002 * volts;
//! #         csv += &format!("{},{:.4},{:.3}\n", sign * volts, sign * current, sign * (volts - 5.84 * current) / 0.072);
//! #     }
//! # }
//! // `csv`: voltage, current and speed in steady states.
//! let table = Recording::parse("table.csv", csv.as_bytes(), &[])?;
//! let rig = "[supply]\nvoltage_V = 24\n[motor]\nresistance_ohm = 5.84\ntorque_constant_Nm_per_A = 0.072\n";
//! let stand = evaluate(&table, None, None, &Rig::parse("rig.toml", rig)?)?;
//! assert_eq!(stand.study.levels.len(), 5, "both directions of a voltage are one level");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The three types to know: [`Stand`] (the results of a table of steady states), [`drive::Plan`] (how a board drives
//! it), [`thesis::Thesis`] (identification, PID and LQR as one experiment).

mod condition;
pub mod derived;
pub mod drive;
mod losses;
pub mod on_board;
pub mod thesis;

pub use condition::Condition;
pub use losses::{Constants, Directions, EfficiencyMap, LoadedPoint, Losses, OperatingPoint, Stand, evaluate};

//! What a simulation of the motor gets wrong, by what physical cause, and what naming it gains on data that no fit has
//! seen.
//!
//! ```
//! use motorbench_data::recording::Recording;
//! use motorbench_data::rig::Rig;
//! use motorbench_diagnosis::diagnose::diagnose;
//!
//! # let mut csv = String::from("t_s,u_V,omega_rad_per_s,i_A\n");
//! # let (mut speed, mut current) = (0.0_f64, 0.0_f64);
//! # for row in 0..4000 {
//! #     let volts = [8.0, -8.0, 4.0, -4.0, 10.0, 0.0, -10.0, 2.0][row / 250 % 8];
//! #     let noise = |prime: usize| (row * prime % 101) as f64 / 101.0 - 0.5;
//! #     csv += &format!("{:.3},{volts},{:.4},{:.5}\n", row as f64 * 1e-3, speed + 0.02 * noise(37), current + 0.002 * noise(59));
//! #     for _ in 0..20 {
//! #         current += 5e-5 * (volts - 5.8 * current - 0.07 * speed) / 3e-3;
//! #         let driven = 0.07 * current - 6e-6 * speed;
//! #         let before = speed + 5e-5 * driven / 4e-5;
//! #         let friction = 5e-5 * 0.006 / 4e-5;
//! #         speed = if before.abs() <= friction { 0.0 } else { before - friction * before.signum() };
//! #     }
//! # }
//! // `csv`: steps of the voltage, with speed and current. The motor that made it has Coulomb friction of 6 mNm.
//! let recording = Recording::parse("run.csv", csv.as_bytes(), &[])?;
//! let rig = Rig::parse("rig.toml", "[supply]\nvoltage_V = 12\n")?;
//! let found = diagnose(&[recording], &rig, &|progress| println!("{progress:?}"))?;
//! let cause = &found.outcome.causes[0];
//! assert_eq!(cause.effect, "coulomb_friction");
//! assert!((cause.parameters["torque_Nm"].value - 0.006).abs() < 3e-4, "{cause:?}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The three types to know: [`dataset::Dataset`] (recordings made ready for a fit), [`identify::Fit`] (a model fitted to
//! them), [`diagnose::outcome::Outcome`] (what is told).

pub mod compare;
mod configuration;
pub mod dataset;
pub mod diagnose;
pub mod evidence;
pub mod free_run;
pub mod identify;
mod parallel;
pub mod steady_state;

//! The control core in closed loop with a motor, on this computer: bit for bit what the Uno does.
//!
//! ```
//! use host_sim::trial::Trial;
//! use motorbench_core::message::Mode;
//! use motorbench_core::settings::Settings;
//! use motorbench_model::Model;
//! use motorbench_model::motor::MotorParameters;
//!
//! let mut trial = Trial::of_model(&Model::linear(MotorParameters::PIVT6), Settings::defaults()).unwrap();
//! trial.enter(Mode::SpeedPid);
//! // Half a second towards 60 rad/s; the true speed of the motor, not the measured one.
//! let points = trial.follow(60.0, 0.5);
//! assert!((points.last().unwrap().omega_rad_per_s - 60.0).abs() < 3.0);
//! ```
//!
//! The three types to know: [`plant::Plant`] (a motor with its load and its supply), [`trial::Trial`] (the core on such a
//! plant), [`scenario::Scenario`] (a whole experiment from a file).

pub mod figures;
pub mod hidden_bench;
pub mod plant;
pub mod scenario;
pub mod sensor_effects;
pub mod trial;
pub mod virtual_board;

//! The DC motor: its constants, and the linear systems that they make. The laws of the effects that a linear motor
//! lacks, and the extended model with its one step.
//!
//! ```
//! use motorbench_model::catalogue::effect;
//! use motorbench_model::linear::motor_model::{TimeConstants, speed};
//! use motorbench_model::motor::MotorParameters;
//! use motorbench_model::Model;
//!
//! let motor = MotorParameters::PIVT6;
//! // Steady speed per volt, in rad/s/V, and the two time constants.
//! assert!((speed(&motor).dc_gain() - 13.8).abs() < 0.1);
//! assert!(TimeConstants::of(&motor).electromagnetic_s < TimeConstants::of(&motor).electromechanical_s);
//!
//! // The same motor with Coulomb friction of 4 mNm, as a model file and back.
//! let model = Model::linear(motor).with(effect("coulomb_friction").unwrap(), vec![0.004]);
//! assert!(Model::parse(&model.to_toml()).unwrap().has("coulomb_friction"));
//! ```
//!
//! The three types to know: [`motor::MotorParameters`] (the linear motor), [`catalogue::Effect`] (the law of one effect),
//! [`Model`] (both together).

mod axis;
pub mod between_rows;
pub mod catalogue;
pub mod closed_form;
mod extended;
pub mod linear;
mod linear_step;
pub mod motor;
pub mod pwm_period;
mod steady_voltage;
mod switched_step;
pub mod unit;

pub use axis::{Axis, Drive, Input, Motion};
pub use extended::{Model, ModelError, Term};
pub use linear_step::{Late, LinearStep, LinearSteps, Reached, SAME_LENGTH_S, oppose_motion, volts};
pub use steady_voltage::Direction;
pub use switched_step::SwitchedStep;

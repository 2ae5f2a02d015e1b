//! The control core in closed loop with a motor, on this computer.

pub mod figures;
pub mod plant;
pub mod scenario;
pub mod sensor_effects;
pub mod trial;

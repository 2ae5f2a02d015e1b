//! The test stand and the experiments on a board: losses, condition, tuning, identification with both loops.

mod condition;
pub mod derived;
pub mod drive;
mod losses;
pub mod on_board;
pub mod thesis;

pub use condition::Condition;
pub use losses::{Constants, Directions, EfficiencyMap, LoadedPoint, Losses, OperatingPoint, Stand, evaluate};

//! What a trial recorded, and what the linear motor does not account for in it.

use hidden_effects::{Effect, Excitation, Recipe, Trial, draw};

/// Stairs of the staircase, and the two of them at which the duty is zero.
pub const STAIRS: usize = 10;
pub const STANDSTILL: [usize; 2] = [4, 9];

/// Columns of a full recording.
pub struct Columns {
    pub time_s: Vec<f64>,
    pub duty: Vec<f64>,
    pub voltage_v: Vec<f64>,
    pub counts: Vec<f64>,
    pub speed_rad_per_s: Vec<f64>,
    pub current_a: Vec<f64>,
}

pub fn staircase(effects: &[Effect]) -> Recipe {
    Recipe { excitation: Excitation::Staircase, ..Recipe::of(effects) }
}

pub fn rows(csv: &str) -> Vec<Vec<f64>> {
    csv.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
}

pub fn columns(trial: &Trial) -> Columns {
    let rows = rows(&trial.csv);
    let column = |index: usize| rows.iter().map(|row| row[index]).collect();
    Columns {
        time_s: column(0),
        duty: column(1),
        voltage_v: column(2),
        counts: column(3),
        speed_rad_per_s: column(4),
        current_a: column(5),
    }
}

pub fn recorded(seed: u64, effects: &[Effect]) -> (Trial, Columns) {
    let trial = draw(seed, &staircase(effects));
    let columns = columns(&trial);
    (trial, columns)
}

pub fn constant(trial: &Trial, effect: Effect, name: &str) -> f64 {
    let (_, constants) = trial.truth.effects.iter().find(|(present, _)| *present == effect).unwrap();
    constants.iter().find(|(other, _)| *other == name).unwrap().1
}

pub fn rig_value(trial: &Trial, key: &str) -> f64 {
    let line = trial.rig_toml.lines().find(|line| line.starts_with(&format!("{key} ="))).unwrap();
    line.split('=').nth(1).unwrap().trim().parse().unwrap()
}

pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|value| value * value).collect();
    mean(&squares).sqrt()
}

/// Means over the last quarter of a stair.
#[derive(Clone, Copy, Debug)]
pub struct Steady {
    pub time_s: f64,
    pub duty: f64,
    pub voltage_v: f64,
    pub speed_rad_per_s: f64,
    pub current_a: f64,
}

pub fn steady(columns: &Columns, stair: usize) -> Steady {
    let length = columns.time_s.len() / STAIRS;
    let range = stair * length + 3 * length / 4..(stair + 1) * length;
    Steady {
        time_s: mean(&columns.time_s[range.clone()]),
        duty: mean(&columns.duty[range.clone()]),
        voltage_v: mean(&columns.voltage_v[range.clone()]),
        speed_rad_per_s: mean(&columns.speed_rad_per_s[range.clone()]),
        current_a: mean(&columns.current_a[range]),
    }
}

pub fn moving_stairs(columns: &Columns) -> Vec<Steady> {
    (0..STAIRS).filter(|stair| !STANDSTILL.contains(stair)).map(|stair| steady(columns, stair)).collect()
}

pub fn stall_nm(trial: &Trial) -> f64 {
    trial.truth.motor.torque_constant_nm_per_a * rig_value(trial, "voltage_V") / trial.truth.motor.resistance_ohm
}

/// Torque that the linear motor does not account for.
pub fn lost_nm(trial: &Trial, at: Steady) -> f64 {
    let motor = trial.truth.motor;
    motor.torque_constant_nm_per_a * at.current_a - motor.viscous_friction_nm_s * at.speed_rad_per_s
}

/// Voltage that the linear motor does not account for.
pub fn lost_v(trial: &Trial, at: Steady) -> f64 {
    let motor = trial.truth.motor;
    at.voltage_v - motor.resistance_ohm * at.current_a - motor.torque_constant_nm_per_a * at.speed_rad_per_s
}

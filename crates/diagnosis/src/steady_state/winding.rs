//! Resistance of a winding, measured at rest.

use serde::Serialize;

/// Resistance of the winding over rotor positions.
#[derive(Clone, Debug, Serialize)]
pub struct Winding {
    /// One a position or row.
    #[serde(rename = "resistances_ohm")]
    pub resistances_ohm: Vec<f64>,
    /// Their mean.
    pub mean_ohm: f64,
    /// Their standard deviation.
    pub spread_ohm: f64,
}

impl Winding {
    /// Nothing of no readings.
    pub fn of(resistances_ohm: Vec<f64>) -> Option<Self> {
        let count = resistances_ohm.len() as f64;
        let mean_ohm = resistances_ohm.iter().sum::<f64>() / count;
        let squares = resistances_ohm.iter().map(|value| (value - mean_ohm).powi(2)).sum::<f64>();
        let spread_ohm = (squares / (count - 1.0).max(1.0)).sqrt();
        (!resistances_ohm.is_empty()).then_some(Self { resistances_ohm, mean_ohm, spread_ohm })
    }
}

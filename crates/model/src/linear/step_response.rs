//! What a step response is judged by.

/// Figures of a step response.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct StepFigures {
    /// From 10 % to 90 % of the final value, in seconds.
    pub rise_s: f64,
    /// After this time it stays within 2 % of the final value, in seconds.
    pub settling_s: f64,
    /// Largest excess over the final value, in percent of it.
    pub overshoot_percent: f64,
}

/// Band around the final value that counts as settled.
const SETTLED: f64 = 0.02;

impl StepFigures {
    /// From samples `period_s` apart, and the value they tend to (not zero). `None` if the last sample has not settled.
    pub fn of(response: &[f64], period_s: f64, final_value: f64) -> Option<Self> {
        let relative: Vec<f64> = response.iter().map(|value| value / final_value).collect();
        let crosses = |level: f64| {
            let after = relative.iter().position(|&value| value >= level)?;
            let before = after.saturating_sub(1);
            let rise = relative[after] - relative[before];
            let part = if rise > 0.0 { (level - relative[before]) / rise } else { 0.0 };
            Some((before as f64 + part) * period_s)
        };
        let outside = relative.iter().rposition(|value| (value - 1.0).abs() > SETTLED);
        let settled = outside.map_or(0, |last| last + 1);
        if settled >= relative.len() {
            return None;
        }
        let peak = relative.iter().copied().fold(0.0, f64::max);
        Some(Self {
            rise_s: crosses(0.9)? - crosses(0.1)?,
            settling_s: settled as f64 * period_s,
            overshoot_percent: 100.0 * (peak - 1.0).max(0.0),
        })
    }
}

//! A voltage drop behind a command of one magnitude, such as random levels of plus and minus the same voltage. The drop
//! then takes the same share of every pulse. A motor with resistance, torque constant, inertia and all torques smaller
//! by that share turns exactly as one without a drop. So the drop is estimated from nominal values and usual bridges,
//! not from the readings.

use super::data_sheet::off_data_sheet;
use crate::configuration::diagnose::hidden_drop::{LEAST_LEFT, USUAL_V};
use crate::dataset::{Dataset, greatest};
use crate::identify::{Fit, GIVEN_DROP_SPREAD_V, NOMINAL_SPREAD, Prior, Z95};
use motorbench_data::rig::Bridge;
use motorbench_model::Model;
use motorbench_model::catalogue::{VOLTAGE_DROP, effect};
use motorbench_model::unit::{Quantity, Unit};
use motorbench_text::terminal_text::short;

/// The assumed drop.
#[derive(Clone, Copy, Debug)]
pub struct HiddenDrop {
    drop_v: f64,
    /// Standard deviation of the logarithm of the voltage that the bridge leaves.
    spread: f64,
    /// Greatest plausible drop.
    most_v: f64,
}

impl HiddenDrop {
    /// The drop for data that do not show it, from the constants found without one.
    pub fn of(data: &Dataset, prior: &Prior, bridge: &Bridge, found: &Fit) -> Option<Self> {
        if !data.has_one_magnitude() {
            return None;
        }
        let asked_v = greatest(&data.command);
        let (drop_v, spread_v) = bridge.drop_v.map_or(USUAL_V, |drop_v| (drop_v, GIVEN_DROP_SPREAD_V));
        let left = (1.0 - drop_v / asked_v).max(LEAST_LEFT);
        let known = (-left.ln(), spread_v / (left * asked_v));
        let (mean, spread) = with_nominal_values(known, off_data_sheet(prior, found).map(|(_, off)| off));
        let asked_over_left = mean.clamp(0.0, -LEAST_LEFT.ln());
        let drop_v = |asked_over_left: f64| asked_v * (1.0 - (-asked_over_left).exp());
        Some(Self { drop_v: drop_v(asked_over_left), spread, most_v: drop_v(asked_over_left + Z95 * spread) })
    }

    /// The data with this drop in front of the motor.
    pub fn before(&self, data: &Dataset) -> Dataset {
        data.behind_a_drop(self.drop_v)
    }

    /// The model that turns behind this drop as `found` does without one.
    pub fn behind(&self, found: &Model, data: &Dataset) -> Model {
        found.scaled(Quantity::Voltage, 1.0 - self.drop_v / greatest(&data.command))
    }

    /// Uncertainty of a constant of a unit from the drop, as from a supply voltage: standard deviations of the logarithm.
    pub fn uncertainty(&self, unit: Unit) -> f64 {
        Quantity::Voltage.power(unit).abs() * self.spread
    }

    /// The note on it.
    pub fn note(&self) -> String {
        format!(
            "The command has only one magnitude, so the voltage drop of the bridge ({VOLTAGE_DROP}) cannot be measured. {} V are assumed, from the nominal values and from usual bridges. It may be up to {} V; the intervals contain that. Record with two magnitudes, or with pauses at zero.",
            short(self.drop_v),
            short(self.most_v)
        )
    }
}

/// The model with the assumed drop, for use with other data.
pub fn also_in(model: Model, data: &Dataset) -> Model {
    match data.origin.hidden_drop_v {
        0.0 => model,
        drop_v => model.with(effect(VOLTAGE_DROP).expect("an effect of the catalogue"), vec![drop_v]),
    }
}

/// Combines a prior (mean and standard deviation of a logarithm) with the logarithms of found over nominal, which
/// contain it too.
fn with_nominal_values((mean, spread): (f64, f64), off: impl Iterator<Item = f64>) -> (f64, f64) {
    let weight = |spread: f64| spread.powi(-2);
    let known = (weight(spread) * mean, weight(spread));
    let add = |(sum, weights), off| (sum + weight(NOMINAL_SPREAD) * off, weights + weight(NOMINAL_SPREAD));
    let (sum, weights): (f64, f64) = off.fold(known, add);
    (sum / weights, weights.sqrt().recip())
}

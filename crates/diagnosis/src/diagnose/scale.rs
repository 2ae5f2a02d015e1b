//! Recognises a recording in another scale than its rig file says: a current in milliamperes, counts with another
//! decoding, another supply voltage. A motor in another scale moves the same. But all its constants differ from their
//! nominal values by powers of one factor, which no real motor does.

use super::advice::OTHER_UNIT;
use super::causes::value_cause;
use super::data_sheet::{OF_SIZE, off_data_sheet};
use super::outcome::{Cause, Estimate};
use super::{DATA_SHEET_TOLERANCE, counter_stops};
use crate::configuration::diagnose::scale::{
    DECODINGS, EVEN, FROM_STANDSTILL, KNOWN, MILLIAMPERES, NEARLY, ROUGHLY, SAME_FACTOR, SPEED_UNITS, STUDENT,
};
use crate::dataset::{Dataset, Output, greatest};
use crate::identify::{Fit, NOMINAL_SPREAD, Prior, Z95};
use motorbench_model::Model;
use motorbench_model::catalogue::VOLTAGE_DROP;
use motorbench_model::unit::{Quantity, Unit};
use motorbench_text::terminal_text::short;
use std::f64::consts::TAU;

/// Names of the constants that show a scale, where one is wrong by itself, in the order of [`OF_SIZE`].
const VALUES: [&str; 3] = ["parameter:resistance", "parameter:torque_constant", "parameter:inertia"];

/// A quantity and its wrong factor.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    quantity: Quantity,
    /// Logarithm of recorded over true.
    recorded_over_true: f64,
    /// Half the width of its 95 % interval.
    half: f64,
    /// Whether several wrong nominal values are excluded as an explanation.
    is_beyond_doubt: bool,
}

impl Scale {
    /// The scale that the constants have in common against their nominal values, if there is one. Without a current
    /// only the nominal values themselves show a scale, so there is none.
    pub fn of(data: &Dataset, prior: &Prior, fit: &Fit) -> Option<Self> {
        data.current()?;
        let off = off(data, prior, fit);
        let scales =
            [Quantity::Voltage, Quantity::Current, Quantity::Motion].map(|quantity| Self::common(&off, quantity));
        let best = scales.into_iter().flatten().min_by(|a, b| a.half.total_cmp(&b.half))?;
        Some(best.of_a_known_factor(data))
    }

    /// The same from logarithms of found over nominal.
    fn common(off: &[(Unit, f64)], quantity: Quantity) -> Option<Self> {
        let of_scale: Vec<(f64, f64)> = off.iter().map(|(unit, off)| (quantity.power(*unit), *off)).collect();
        let degrees = off.len().checked_sub(1)?;
        let concerned = || of_scale.iter().filter(|(power, _)| *power != 0.0);
        // A load on the shaft, or a bridge in series, also raises two of them.
        if concerned().count() < OF_SIZE.iter().filter(|unit| quantity.power(**unit) != 0.0).count() {
            return None;
        }
        let squares: f64 = concerned().map(|(power, _)| power * power).sum();
        let x = concerned().map(|(power, off)| power * off).sum::<f64>() / squares;
        let rests: Vec<f64> = of_scale.iter().map(|(power, off)| off - power * x).collect();
        let worst = greatest(&rests);
        let is_the_same = off.len() == OF_SIZE.len() && worst < 0.5 * SAME_FACTOR && x.abs() > DATA_SHEET_TOLERANCE;
        let is_beyond_doubt = is_the_same || x.abs() > OTHER_UNIT.ln();
        // A single value that is off is no scale; nor is one that is off but does not depend on the quantity.
        let are_all_off = of_scale.iter().all(|(power, off)| (off.abs() > DATA_SHEET_TOLERANCE) == (*power != 0.0));
        let is_one = is_the_same || worst < NEARLY.max(ROUGHLY * x.abs()) && (is_beyond_doubt || are_all_off);
        let spread = (rests.iter().map(|rest| rest * rest).sum::<f64>() / degrees as f64).sqrt();
        // Estimated from their agreement, but no worse than data sheets are.
        let half = (STUDENT[degrees - 1] * spread).clamp(SAME_FACTOR, Z95 * NOMINAL_SPREAD) / squares.sqrt();
        is_one.then_some(Self { quantity, recorded_over_true: x, half, is_beyond_doubt })
    }

    /// Whether the factor exceeds any error of a data sheet.
    pub fn is_another_unit(&self) -> bool {
        self.recorded_over_true.abs() > OTHER_UNIT.ln()
    }

    /// With the usual wrong factor, where the factor is close to one.
    fn of_a_known_factor(mut self, data: &Dataset) -> Self {
        let known: &[f64] = match self.quantity {
            Quantity::Motion if self.is_of_counts(data) => &DECODINGS,
            Quantity::Motion => &SPEED_UNITS,
            Quantity::Current => &MILLIAMPERES,
            Quantity::Voltage => &[],
        };
        let logarithms = known.iter().flat_map(|factor| [factor.ln(), -factor.ln()]);
        let known = logarithms.into_iter().find(|known| (self.recorded_over_true - known).abs() < KNOWN);
        self.recorded_over_true = known.unwrap_or(self.recorded_over_true);
        self
    }

    /// The data in the scale that the nominal values give.
    pub fn corrected(&self, data: &Dataset) -> Dataset {
        let factor = (-self.recorded_over_true).exp();
        match self.quantity {
            Quantity::Voltage => data.with_voltage_times(factor),
            Quantity::Current => data.with_current_times(factor),
            Quantity::Motion => data.with_motion_times(factor),
        }
    }

    /// Uncertainty of a constant of a unit from it: standard deviations of the logarithm.
    pub fn uncertainty(&self, unit: Unit) -> f64 {
        self.quantity.power(unit).abs() * self.half / Z95
    }

    /// The cause that it is reported as. Supply and counts per revolution are values of the rig file; for a recorded
    /// column it is the correction factor. `data`: as corrected; `hides_a_drop`: whether a drop would act as another
    /// supply in them.
    pub fn cause(&self, data: &Dataset, hides_a_drop: bool) -> Cause {
        let estimate =
            |value: f64| Estimate { value, ci95: Some([-self.half, self.half].map(|off| value * off.exp())) };
        let true_over_recorded = (-self.recorded_over_true).exp();
        let sigmas = Z95 * self.recorded_over_true.abs() / self.half;
        let (id, constant, value) = match self.quantity {
            Quantity::Motion if self.is_of_counts(data) => ("counts_per_rev", "counts_per_rev", TAU / data.count_rad),
            Quantity::Voltage => ("supply_voltage", "found_over_nominal", true_over_recorded),
            Quantity::Current => ("current_scale", "true_over_recorded", true_over_recorded),
            Quantity::Motion => ("speed_scale", "true_over_recorded", true_over_recorded),
        };
        let cause = value_cause(id, constant, estimate(value), sigmas);
        // Fewer counts than the rig file says may also be lost counts, the same share at all speeds.
        let may_be_lost = self.is_of_counts(data) && self.recorded_over_true < 0.0;
        let mut not_separable_from: Vec<&'static str> = may_be_lost.then_some(counter_stops::ID).into_iter().collect();
        if hides_a_drop && self.quantity == Quantity::Voltage {
            not_separable_from.push(VOLTAGE_DROP);
        }
        if !self.is_beyond_doubt {
            let concerned = OF_SIZE.iter().zip(VALUES).filter(|(unit, _)| self.quantity.power(**unit) != 0.0);
            not_separable_from.extend(concerned.map(|(_, value)| value));
        }
        Cause { not_separable_from, ..cause }
    }

    /// The advice on it.
    pub fn advice(&self, data: &Dataset) -> String {
        let great_or_small = if self.recorded_over_true > 0.0 { "great" } else { "small" };
        let size = format!("{} times too {great_or_small}", short(self.recorded_over_true.abs().exp()));
        let question = match self.quantity {
            Quantity::Motion if self.is_of_counts(data) => format!(
                "All constants of the motor say that the counts are {size} for [encoder] counts_per_rev. Check x4 decoding (2 or 4 times too small: fewer edges are counted), and that the encoder is on the motor's shaft, not behind a gear."
            ),
            Quantity::Motion => format!(
                "All constants of the motor say that the speed is {size}. Check the unit (9.55 times too great: rpm; 57.3: degrees; 6.28 times too small: revolutions), and that it is measured on the motor's shaft, not behind a gear."
            ),
            Quantity::Current => format!(
                "All constants of the motor say that the current is {size}. Check the unit (1000 times too great: mA), and the sensitivity of the sensor (an ACS712 has 185, 100 or 66 mV/A)."
            ),
            Quantity::Voltage => format!(
                "All constants of the motor say that the voltage is {size}. Measure the supply at the bridge under load and write it into [supply] voltage_V. Convert a column u_V with --map u_V=u_V*FACTOR."
            ),
        };
        format!("{question} This result and the model use the corrected scale.")
    }

    fn is_of_counts(&self, data: &Dataset) -> bool {
        self.quantity == Quantity::Motion && data.count_rad > 0.0 && data.motion().output != Output::Speed
    }
}

/// Logarithms of found over nominal. Counts lost at all speeds are equivalent to another scale.
fn off(data: &Dataset, prior: &Prior, fit: &Fit) -> Vec<(Unit, f64)> {
    let counted = (1.0 - lost_at_all_speeds(&fit.model, data)).ln();
    let with_lost = |(unit, off)| (unit, off + Quantity::Motion.power(unit) * counted);
    off_data_sheet(prior, fit).map(with_lost).collect()
}

/// Share of the counts that a model loses at all speeds.
fn lost_at_all_speeds(model: &Model, data: &Dataset) -> f64 {
    let speed_rad_per_s = greatest(&data.motion().values);
    let lost = |speed: f64| {
        let terms = model.terms.iter();
        terms.map(|term| term.effect.lost_rad_per_s(&term.values, speed)).sum::<f64>() / speed
    };
    let [slow, fast] = [FROM_STANDSTILL * speed_rad_per_s, speed_rad_per_s].map(lost);
    if slow > EVEN * fast { fast } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The scales that constants of these multiples of the nominal ones have in common: resistance, torque constant,
    /// inertia. NaN: no nominal value.
    fn scales_of(found_over_nominal: [f64; 3]) -> Vec<(Quantity, f64)> {
        let off = OF_SIZE.into_iter().zip(found_over_nominal).map(|(constant, off)| (constant, off.ln()));
        let off: Vec<_> = off.filter(|(_, off)| off.is_finite()).collect();
        let quantities = [Quantity::Voltage, Quantity::Current, Quantity::Motion];
        let scales = quantities.into_iter().filter_map(|quantity| Scale::common(&off, quantity));
        scales.map(|scale| (scale.quantity, scale.recorded_over_true.exp())).collect()
    }

    #[test]
    fn a_scale_is_what_all_constants_have_in_common() {
        let [(Quantity::Voltage, third)] = scales_of([1.33; 3])[..] else { panic!("another supply") };
        assert!((third - 1.33).abs() < 1e-9, "{third}");
        // With a data sheet that is wrong by up to a fifth.
        let [(Quantity::Motion, quarter)] = scales_of([0.9, 4.4, 14.0])[..] else { panic!("counts after x4 decoding") };
        assert!((quarter - 0.25).abs() < 0.03, "{quarter}");
        let [(Quantity::Current, milli)] = scales_of([1.1e-3, 1.0, 850.0])[..] else { panic!("milliamperes") };
        assert!((milli - 1000.0).abs() < 150.0, "{milli}");
    }

    /// A load on the shaft, and a bridge whose resistance is in series.
    #[test]
    fn two_raised_values_are_no_scale() {
        for values in [[2.0, f64::NAN, 2.0], [4.0, f64::NAN, 4.0], [2.0, 1.0, 2.0]] {
            assert_eq!(scales_of(values), [], "{values:?}");
        }
    }

    #[test]
    fn one_wrong_value_is_no_scale_nor_are_two_that_differ() {
        for values in
            [[1.0, 1.0, 1.0], [1.6, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 9.0], [1.5, 1.0, 2.6], [1.0, 1.6, 0.6]]
        {
            assert_eq!(scales_of(values), [], "{values:?}");
        }
    }
}

//! The drawings of a table's report: what was measured, and what the nominal constants and those found make of it.

use super::{Explanation, Level, Study};
use crate::diagnose::report::plots::{AFTER, BEFORE, MEASURED, SMALL_NUMBERS_WIDTH, axes, drawn, range};
use crate::web_page::PLOT_SIZE;
use plotters::prelude::*;

/// Of what explains the table as well.
const AS_WELL: RGBColor = RGBColor(0, 158, 115);
/// Widths of a line, and of one that another lies on.
const LINE: u32 = 2;
const BEHIND: u32 = 8;

/// A line through the levels.
struct Series {
    style: ShapeStyle,
    /// One a level.
    values: Vec<f64>,
}

impl Study {
    /// Speed over voltage: nominal, named, and what cannot be told from that.
    pub(super) fn speed_plot(&self) -> String {
        let simulated = |style, explanation: &Explanation| Series {
            style,
            values: self.levels.iter().map(|level| self.speed_rad_per_s(explanation, level)).collect(),
        };
        let nominal = self.explanations.iter().find(|explanation| explanation.terms.is_empty());
        let lines = nominal.map(|nominal| simulated(BEFORE.stroke_width(LINE), nominal)).into_iter();
        // Behind the named one, which it mostly follows.
        let lines = lines.chain(self.as_good().map(|other| simulated(AS_WELL.mix(0.5).stroke_width(BEHIND), other)));
        let lines = lines.chain([simulated(AFTER.stroke_width(LINE), self.named())]);
        self.over_voltage("speed, rad/s", |level| level.omega_rad_per_s, &lines.collect::<Vec<_>>())
    }

    /// Current over voltage: of viscous friction alone, and with dry friction.
    pub(super) fn current_plot(&self) -> String {
        let lines = self.friction_a.iter().flatten().zip([BEFORE, AFTER]);
        let lines = lines
            .map(|(values, colour)| Series { style: colour.stroke_width(LINE), values: values.clone() })
            .collect::<Vec<_>>();
        self.over_voltage("current, A", |level| level.i_A, &lines)
    }

    /// What the causes are taken from.
    pub(super) fn named(&self) -> &Explanation {
        &self.explanations[self.named]
    }

    /// What else holds with as many terms.
    pub(super) fn as_good(&self) -> Option<&Explanation> {
        let named = self.named();
        let is_as_good = |other: &&Explanation| other.holds() && other.terms.len() == named.terms.len();
        self.explanations.iter().filter(|other| other.terms != named.terms).find(is_as_good)
    }

    /// By the voltage and the current of a level.
    fn speed_rad_per_s(&self, explanation: &Explanation, level: &Level) -> f64 {
        let constant =
            |name: &str, otherwise: f64| explanation.constants.get(name).map_or(otherwise, |found| found.value);
        let growth_ohm_s = constant("growth_ohm_s", 0.0);
        let voltage_v = level.u_V - constant("resistance_ohm", self.nominal.0) * level.i_A - constant("drop_V", 0.0);
        voltage_v / (constant("back_emf_constant_V_s", self.nominal.1) + growth_ohm_s * level.i_A)
    }

    fn over_voltage(&self, what: &str, measured: fn(&Level) -> f64, lines: &[Series]) -> String {
        let volts = || self.levels.iter().map(|level| level.u_V);
        let values = self.levels.iter().map(measured).chain(lines.iter().flat_map(|line| line.values.iter().copied()));
        drawn(PLOT_SIZE, |area| {
            let mut chart = axes(area, SMALL_NUMBERS_WIDTH, (range(volts()), "voltage, V"), (range(values), what))?;
            for Series { style, values } in lines {
                for load_nm in self.loads_nm() {
                    let of_load = self.levels.iter().zip(values).filter(|(level, _)| level.load_Nm == load_nm);
                    let points = of_load.map(|(level, value)| (level.u_V, *value));
                    chart.draw_series(LineSeries::new(points, *style))?;
                }
            }
            let points =
                self.levels.iter().map(|level| Circle::new((level.u_V, measured(level)), 4, MEASURED.filled()));
            chart.draw_series(points)?;
            Ok(())
        })
    }

    /// Each once: a line is drawn through the levels under one load.
    fn loads_nm(&self) -> Vec<f64> {
        let mut loads_nm: Vec<f64> = self.levels.iter().map(|level| level.load_Nm).collect();
        loads_nm.sort_unstable_by(f64::total_cmp);
        loads_nm.dedup();
        loads_nm
    }
}

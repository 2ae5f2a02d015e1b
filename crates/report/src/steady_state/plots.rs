//! The plots of a table's report: measured values, nominal constants, and found constants.

use crate::diagnosis_page::plots::{AFTER, BEFORE, MEASURED, SMALL_NUMBERS_WIDTH, axes, drawn, range};
use crate::web_page::PLOT_SIZE;
use motorbench_diagnosis::steady_state::{Explanation, Level, Study};
use plotters::prelude::*;

/// Colour of another explanation of the table.
const ALTERNATIVE: RGBColor = RGBColor(0, 158, 115);
/// Width of a line, and of one that another line covers.
const LINE: u32 = 2;
const BEHIND: u32 = 8;

/// A line through the levels.
struct Series {
    style: ShapeStyle,
    /// One value for each level.
    values: Vec<f64>,
}

/// Speed over voltage: nominal, named, and another explanation that fits as well.
pub(super) fn speed_plot(study: &Study) -> String {
    let simulated = |style, explanation: &Explanation| Series {
        style,
        values: study.levels.iter().map(|level| speed_rad_per_s(study, explanation, level)).collect(),
    };
    let nominal = study.explanations.iter().find(|explanation| explanation.terms.is_empty());
    let lines = nominal.map(|nominal| simulated(BEFORE.stroke_width(LINE), nominal)).into_iter();
    // Drawn behind the named one, since both nearly coincide.
    let lines = lines.chain(study.as_good().map(|other| simulated(ALTERNATIVE.mix(0.5).stroke_width(BEHIND), other)));
    let lines = lines.chain([simulated(AFTER.stroke_width(LINE), study.named())]);
    over_voltage(study, "speed, rad/s", |level| level.omega_rad_per_s, &lines.collect::<Vec<_>>())
}

/// Current over voltage: viscous friction alone, and with dry friction.
pub(super) fn current_plot(study: &Study) -> String {
    let lines = study.friction_a.iter().flatten().zip([BEFORE, AFTER]);
    let lines = lines
        .map(|(values, colour)| Series { style: colour.stroke_width(LINE), values: values.clone() })
        .collect::<Vec<_>>();
    over_voltage(study, "current, A", |level| level.i_A, &lines)
}

/// By voltage and current of a level.
fn speed_rad_per_s(study: &Study, explanation: &Explanation, level: &Level) -> f64 {
    let constant = |name: &str, otherwise: f64| explanation.constants.get(name).map_or(otherwise, |found| found.value);
    let growth_ohm_s = constant("growth_ohm_s", 0.0);
    let voltage_v = level.u_V - constant("resistance_ohm", study.nominal.0) * level.i_A - constant("drop_V", 0.0);
    voltage_v / (constant("back_emf_constant_V_s", study.nominal.1) + growth_ohm_s * level.i_A)
}

fn over_voltage(study: &Study, what: &str, measured: fn(&Level) -> f64, lines: &[Series]) -> String {
    let volts = || study.levels.iter().map(|level| level.u_V);
    let values = study.levels.iter().map(measured).chain(lines.iter().flat_map(|line| line.values.iter().copied()));
    drawn(PLOT_SIZE, |area| {
        let mut chart = axes(area, SMALL_NUMBERS_WIDTH, (range(volts()), "voltage, V"), (range(values), what))?;
        for Series { style, values } in lines {
            for load_nm in loads_nm(study) {
                let of_load = study.levels.iter().zip(values).filter(|(level, _)| level.load_Nm == load_nm);
                let points = of_load.map(|(level, value)| (level.u_V, *value));
                chart.draw_series(LineSeries::new(points, *style))?;
            }
        }
        let points = study.levels.iter().map(|level| Circle::new((level.u_V, measured(level)), 4, MEASURED.filled()));
        chart.draw_series(points)?;
        Ok(())
    })
}

/// Each level once: a line goes through the levels under one load.
fn loads_nm(study: &Study) -> Vec<f64> {
    let mut loads_nm: Vec<f64> = study.levels.iter().map(|level| level.load_Nm).collect();
    loads_nm.sort_unstable_by(f64::total_cmp);
    loads_nm.dedup();
    loads_nm
}

//! The plots of a table's report: measured values, nominal constants, and found constants.

use crate::plot::{AFTER, BEFORE, MEASURED, Mark, OTHERS, Plot};
use maud::{Markup, html};
use motorbench_diagnosis::steady_state::{Explanation, Level, Study};
use plotters::prelude::RGBColor;

/// A line through the levels.
struct Series {
    name: &'static str,
    colour: RGBColor,
    mark: Mark,
    /// One value for each level.
    values: Vec<f64>,
}

/// Speed over voltage: nominal, named, and another explanation that fits as well.
pub(super) fn speed_plot(study: &Study) -> Markup {
    let simulated = |name, colour, mark, explanation: &Explanation| Series {
        name,
        colour,
        mark,
        values: study.levels.iter().map(|level| speed_rad_per_s(study, explanation, level)).collect(),
    };
    let nominal = study.explanations.iter().find(|explanation| explanation.terms.is_empty());
    let lines = nominal.map(|nominal| simulated("nominal values", BEFORE, Mark::Line, nominal)).into_iter();
    // Drawn behind the named one, since both nearly coincide.
    let as_good = study.as_good().map(|other| simulated("explains the table as well", OTHERS[2], Mark::Broad, other));
    let lines = lines.chain(as_good).chain([simulated("named causes", AFTER, Mark::Line, study.named())]);
    over_voltage(
        study,
        ["speed, rad/s", "Speed over voltage"],
        |level| level.omega_rad_per_s,
        &lines.collect::<Vec<_>>(),
    )
}

/// Current over voltage: viscous friction alone, and with dry friction.
pub(super) fn current_plot(study: &Study) -> Markup {
    let lines =
        study.friction_a.iter().flatten().zip([("viscous friction alone", BEFORE), ("with dry friction", AFTER)]);
    let lines = lines.map(|(values, (name, colour))| Series { name, colour, mark: Mark::Line, values: values.clone() });
    over_voltage(study, ["current, A", "Current over voltage"], |level| level.i_A, &lines.collect::<Vec<_>>())
}

/// By voltage and current of a level.
fn speed_rad_per_s(study: &Study, explanation: &Explanation, level: &Level) -> f64 {
    let constant = |name: &str, otherwise: f64| explanation.constants.get(name).map_or(otherwise, |found| found.value);
    let growth_ohm_s = constant("growth_ohm_s", 0.0);
    let voltage_v = level.u_V - constant("resistance_ohm", study.nominal.0) * level.i_A - constant("drop_V", 0.0);
    voltage_v / (constant("back_emf_constant_V_s", study.nominal.1) + growth_ohm_s * level.i_A)
}

fn over_voltage(study: &Study, [what, caption]: [&str; 2], measured: fn(&Level) -> f64, lines: &[Series]) -> Markup {
    let mut plot = Plot::new("voltage, V", what);
    let loads_nm = loads_nm(study);
    for Series { name, colour, mark, values } in lines {
        for load_nm in &loads_nm {
            let of_load = study.levels.iter().zip(values).filter(|(level, _)| level.load_Nm == *load_nm);
            let points = of_load.map(|(level, value)| [level.u_V, *value]).collect();
            let name = if loads_nm.len() == 1 { (*name).into() } else { format!("{name}, {load_nm} Nm") };
            plot = plot.with(&name, *colour, *mark, points);
        }
    }
    let points = study.levels.iter().map(|level| [level.u_V, measured(level)]).collect();
    plot.dots("measured", MEASURED, points, Vec::new()).figure(&html! { b { (caption) } })
}

/// Each level once: a line goes through the levels under one load.
fn loads_nm(study: &Study) -> Vec<f64> {
    // A brake that is off has no direction: there is no load of -0.
    let mut loads_nm: Vec<f64> = study.levels.iter().map(|level| level.load_Nm + 0.0).collect();
    loads_nm.sort_unstable_by(f64::total_cmp);
    loads_nm.dedup();
    loads_nm
}

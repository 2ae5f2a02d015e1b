//! `motorbench stand`: evaluates a table of steady states, or measures one on a board.

mod figures;
mod measure;

use super::{
    Failure, JSON_TO, Outputs, TERMINAL, open_next, plot_file, provenance, read_recording, read_rig, write, write_json,
    write_plot,
};
use clap::Args;
use motorbench_data::delimited::Delimited;
use motorbench_data::mapping::Mapping;
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_files::text_file;
use motorbench_report::plot::axis_label;
use motorbench_report::steady_state;
use motorbench_stand::{EfficiencyMap, OperatingPoint, Stand, evaluate};
use motorbench_text::terminal_text::short;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::error::Error;
use std::path::{Path, PathBuf};

/// Test stand: drives a board through voltages and loads, or reads a table. Gives powers, efficiency, losses, condition and best
/// operating points.
#[derive(Args)]
#[command(after_help = "Examples:
  motorbench stand --rig rig.toml --both-directions --positions 6
  motorbench stand --port /tmp/motorbench --rig rig.toml --voltages 6,8,10,12
  motorbench stand --rig rig.toml --voltages 8,10,12 --load-Nm 0,0.01,0.02
  motorbench stand no_load.csv --rig rig.toml --resistance positions.csv
  motorbench stand no_load.csv --rig rig.toml --derived printed.csv
  motorbench stand now.csv --earlier last_year.csv --rig rig.toml \\
    --map efficiency.svg

Without a table it drives the motor on the board. For each load it asks you to
set the brake; the brake of motorbench virtual sets itself. Ctrl-C stops the
motor and keeps the rows that are done.")]
pub struct Arguments {
    /// Table with u_V, i_A and omega_rad_per_s or rpm; load_Nm if there is a brake. Rows with the rotor held give the winding's
    /// resistance.
    table: Option<PathBuf>,
    #[command(flatten)]
    board: measure::BoardArguments,
    /// Nominal resistance_ohm and torque_constant_Nm_per_A under [motor] (TOML).
    #[arg(long)]
    rig: PathBuf,
    /// A column of the table that has another name or unit: speed=omega_rad_per_s*6.2832, pwm=duty/255.
    #[arg(long = "column", value_name = "NAME=CHANNEL")]
    columns: Vec<Mapping>,
    /// Resistances by a meter at several rotor positions: a table with a column resistance_ohm.
    #[arg(long, value_name = "POSITIONS.csv")]
    resistance: Option<PathBuf>,
    /// A table of the same motor from an earlier test.
    #[arg(long, value_name = "TABLE.csv")]
    earlier: Option<PathBuf>,
    /// Quantities that a study derived from the table. Cells that contradict their formula or the readings are listed.
    #[arg(long, value_name = "TABLE.csv", requires = "table")]
    derived: Option<PathBuf>,
    /// Draws the efficiency over voltage and torque, computed with the constants found.
    #[arg(long, value_name = "FILE.svg|png", value_parser = plot_file)]
    map: Option<PathBuf>,
    /// Writes a page with plots and figures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Prints the result as JSON instead of text, or writes it into a file.
    #[arg(long, value_name = JSON_TO, num_args = 0..=1, require_equals = true, default_missing_value = TERMINAL)]
    json: Option<PathBuf>,
}

/// Runs it.
///
/// # Errors
/// [`Failure`] with file and what to do.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let outputs = arguments.outputs()?;
    let rig = read_rig(&arguments.rig)?;
    let read = |path: &Path| table(path, &arguments.columns);
    let earlier = arguments.earlier.as_deref().map(read).transpose()?;
    let winding = arguments.resistance.as_deref().map(resistances).transpose()?;
    match &arguments.table {
        Some(path) => report(arguments, &outputs, &read(path)?, (earlier.as_ref(), winding), &rig),
        None => {
            let measured = arguments.board.run((&arguments.rig, &rig), |table, held| {
                let winding = Some(held).filter(|held| !held.is_empty()).or(winding);
                report(arguments, &outputs, table, (earlier.as_ref(), winding), &rig)
            });
            measured.map_err(|failure| arguments.board.port.failure(failure))
        }
    }
}

/// A table of steady states.
fn table(path: &Path, columns: &[Mapping]) -> Result<Recording, Failure> {
    let table = read_recording(path, columns)?;
    if table.time_s().is_some() {
        return Err(Failure::input(format!(
            "{} is a recording over time (t_s). Give a table of steady states, one reading a row; for a recording use `motorbench diagnose`",
            path.display()
        )));
    }
    Ok(table)
}

/// Evaluates a table and prints or writes the requested results. `resistances_ohm`: of the winding, if measured
/// separately.
fn report(
    arguments: &Arguments,
    outputs: &Outputs,
    table: &Recording,
    (earlier, resistances_ohm): (Option<&Recording>, Option<Vec<f64>>),
    rig: &Rig,
) -> Result<(), Failure> {
    let mut stand = evaluate(table, earlier, resistances_ohm, rig).map_err(Failure::input)?;
    if let Some(path) = &arguments.derived {
        let failed = |what: &dyn std::fmt::Display| Failure::input(format!("{}: {what}", path.display()));
        let derived = text_file::read(path, "a table (CSV) of derived figures").map_err(|error| failed(&error))?;
        stand.check(&derived, rig).map_err(|what| failed(&what))?;
    }
    if let Some(path) = &arguments.json {
        write_json(path, &stand)?;
    }
    if let Some(path) = &arguments.report {
        let figures = figures::section(&stand, rig.motor.resistance_ohm);
        let (title, kind) = ("motorbench stand", "Test stand");
        let from = provenance::of_files(arguments.table.iter().map(PathBuf::as_path));
        let from = provenance::with(from, "Rig file", Some(&arguments.rig));
        write(path, &steady_state::page_with(title, kind, &stand.study, vec![figures], from))?;
    }
    outputs.say(&figures::page(&stand, rig.motor.resistance_ohm));
    // The map comes last, so that a table without a map still has its evaluation.
    arguments.map.as_deref().map_or(Ok(()), |path| write_map(path, &stand))?;
    outputs.wrote(&open_next(arguments.report.as_deref()));
    Ok(())
}

fn write_map(path: &Path, stand: &Stand) -> Result<(), Failure> {
    let greatest_v = stand.study.levels.iter().map(|level| level.u_V).fold(0.0, f64::max);
    let cells = stand.constants.map(greatest_v);
    let best = cells.points.iter().max_by(|a, b| a.efficiency.total_cmp(&b.efficiency)).ok_or_else(|| {
        let path = path.display();
        Failure::input(format!(
            "{path}: no map: with the constants found the motor does not turn at any voltage up to {greatest_v} V. Check the units of the table"
        ))
    })?;
    write_plot(path, &map(&cells, best).map_err(Failure::machine)?)
}

impl Arguments {
    fn outputs(&self) -> Result<Outputs, Failure> {
        let measured = if self.table.is_none() { self.board.files() } else { Vec::new() };
        let others = [&self.table, &self.resistance, &self.earlier, &self.derived].into_iter().flatten();
        let written = self.map.iter().chain(&self.report).chain(&self.json).chain(&measured);
        Outputs::new([&self.rig].into_iter().chain(others), written)
    }
}

fn resistances(path: &Path) -> Result<Vec<f64>, Failure> {
    let failed = |what: &dyn std::fmt::Display| Failure::input(format!("{}: {what}", path.display()));
    let text = text_file::read(path, "a table (CSV) with a column resistance_ohm").map_err(|error| failed(&error))?;
    match Delimited::new(&text).column("resistance_ohm").map_err(|what| failed(&what))? {
        none if none.is_empty() => Err(failed(&"it holds no resistance")),
        resistances => Ok(resistances),
    }
}

/// Blue; stronger for a larger share of the best efficiency.
fn shade(share: f64) -> ShapeStyle {
    RGBColor(0, 114, 178).mix(share.clamp(0.0, 1.0)).filled()
}

/// Shades of the map, from a quarter of the best efficiency on.
const SHADES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Position, distance and size of their legend.
const SHADES_AT: (i32, i32) = (96, 36);
const SHADES_APART: i32 = 100;
const SHADE_SIZE: (i32, i32) = (24, 16);
const MAP_LETTERS: (&str, i32) = ("sans-serif", 16);

/// Legend of the map's shades, above it.
fn shades(area: &DrawingArea<SVGBackend, Shift>, best: f64) -> Result<(), Box<dyn Error>> {
    for (share, index) in SHADES.into_iter().zip(0..) {
        let (left, top) = (SHADES_AT.0 + index * SHADES_APART, SHADES_AT.1);
        let corners = [(left, top), (left + SHADE_SIZE.0, top + SHADE_SIZE.1)];
        area.draw(&Rectangle::new(corners, shade(share)))?;
        let percent = format!("{:.0} %", 100.0 * share * best);
        area.draw(&Text::new(percent, (left + SHADE_SIZE.0 + 8, top), MAP_LETTERS))?;
    }
    Ok(())
}

/// Efficiency over voltage and torque: darker is better, the point is the best.
fn map(map: &EfficiencyMap, best: &OperatingPoint) -> Result<String, Box<dyn Error>> {
    let EfficiencyMap { step_v, step_nm, points } = map;
    let greatest_v = points.iter().map(|point| point.u_V).fold(0.0, f64::max) + 0.5 * step_v;
    let greatest_nm = points.iter().map(|point| point.torque_Nm).fold(0.0, f64::max) + 0.5 * step_nm;
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (760, 480)).into_drawing_area();
        root.fill(&WHITE)?;
        let caption = format!(
            "efficiency at the shaft; best (point) {:.0} % at {} V and {} Nm",
            100.0 * best.efficiency,
            short(best.u_V),
            short(best.torque_Nm)
        );
        root.draw(&Text::new(caption, (SHADES_AT.0, 8), ("sans-serif", 20)))?;
        shades(&root, best.efficiency)?;
        let mut chart = ChartBuilder::on(&root)
            .margin(8)
            .margin_top(SHADES_AT.1 + 2 * SHADE_SIZE.1)
            .margin_right(24)
            .x_label_area_size(48)
            .y_label_area_size(84)
            .build_cartesian_2d(0.0..greatest_v, 0.0..greatest_nm)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc("voltage, V")
            .y_desc("torque at the shaft, Nm")
            .x_label_formatter(&axis_label)
            .y_label_formatter(&axis_label)
            .label_style(MAP_LETTERS)
            .axis_desc_style(MAP_LETTERS)
            .draw()?;
        chart.draw_series(points.iter().map(|point| {
            let (u, torque) = (point.u_V, point.torque_Nm);
            let corners = [(u - 0.5 * step_v, torque - 0.5 * step_nm), (u + 0.5 * step_v, torque + 0.5 * step_nm)];
            Rectangle::new(corners, shade(point.efficiency / best.efficiency))
        }))?;
        chart.draw_series([Circle::new((best.u_V, best.torque_Nm), 5, BLACK.filled())])?;
        root.present()?;
    }
    Ok(svg)
}

//! The figures of a test stand: tables and sentences, for a terminal and for a page.

use maud::{Markup, html};
use motorbench_diagnosis::steady_state::Winding;
use motorbench_report::diagnosis_text::estimate;
use motorbench_report::steady_state::cause_lines;
use motorbench_report::web_page::{self, number};
use motorbench_stand::derived::WrongCell;
use motorbench_stand::{Directions, LoadedPoint, OperatingPoint, Stand};
use motorbench_text::terminal_text::{fixed, rounded, short, wrapped};
use std::fmt::Write as _;

/// A table under its heading.
struct Table {
    heading: String,
    /// Names of the columns, and their widths in letters.
    columns: Vec<(&'static str, usize)>,
    rows: Vec<Vec<String>>,
    /// Sentences below it.
    below: Vec<String>,
}

impl Table {
    fn new(heading: impl Into<String>, columns: Vec<(&'static str, usize)>, rows: Vec<Vec<String>>) -> Self {
        Self { heading: heading.into(), columns, rows, below: Vec::new() }
    }

    fn text(&self) -> String {
        let line = |cells: &mut dyn Iterator<Item = &str>| {
            let cells = cells.zip(&self.columns).map(|(cell, (_, width))| format!(" {cell:>width$}"));
            format!(" {}\n", cells.collect::<String>())
        };
        let head = line(&mut self.columns.iter().map(|(name, _)| *name));
        let rows = self.rows.iter().map(|row| line(&mut row.iter().map(String::as_str)));
        let below = self.below.iter().map(|sentence| format!("{sentence}\n"));
        wrapped(&self.heading, "", "") + &head + &rows.chain(below).collect::<String>()
    }

    fn html(&self) -> Markup {
        let names: Vec<&str> = self.columns.iter().map(|(name, _)| *name).collect();
        html! {
            h3 { (self.heading) }
            (web_page::table(&names, self.rows.iter().map(|row| row.iter().map(number))))
            @for sentence in &self.below { p { (sentence) } }
        }
    }
}

/// The text for a terminal. `nominal_ohm`: resistance of the rig file.
pub(super) fn page(stand: &Stand, nominal_ohm: Option<f64>) -> String {
    let mut parts = vec![nominal_levels(stand).text(), losses(stand).text()];
    // It begins with an empty line, as it may itself be empty.
    parts.push(cause_lines(&stand.study.outcome, false).trim_start_matches('\n').into());
    parts.extend(winding(stand, nominal_ohm).map(|line| wrapped(&line, "", "  ")));
    parts.extend(wrong_cells(&stand.slips).map(|table| table.text()));
    parts.extend(directions(stand).map(|table| table.text()));
    parts.push(condition(stand));
    parts.extend(loads(stand).map(|table| table.text()));
    parts.push(most_efficient(stand).text());
    parts.retain(|part| !part.is_empty());
    parts.join("\n")
}

/// The same for a page, which has the causes elsewhere.
pub(super) fn section(stand: &Stand, nominal_ohm: Option<f64>) -> Markup {
    html! {
        section {
            h2 { "The test stand in figures" }
            (nominal_levels(stand).html())
            (losses(stand).html())
            @if let Some(line) = winding(stand, nominal_ohm) { p { (line) } }
            @for table in [wrong_cells(&stand.slips), directions(stand)].into_iter().flatten() { (table.html()) }
            (condition_html(stand))
            @if let Some(table) = loads(stand) { (table.html()) }
            (most_efficient(stand).html())
        }
    }
}

/// The columns of a table by level: the voltage, and the load if a row has one.
fn by_level(stand: &Stand, others: &[(&'static str, usize)]) -> Vec<(&'static str, usize)> {
    let load = (!stand.loaded.is_empty()).then_some(("load_Nm", 8));
    [("u_V", 6)].into_iter().chain(load).chain(others.iter().copied()).collect()
}

/// A row of such a table.
fn row<const COUNT: usize>(stand: &Stand, u_v: f64, load_nm: f64, others: [String; COUNT]) -> Vec<String> {
    let load = (!stand.loaded.is_empty()).then(|| fixed(load_nm, 4));
    [format!("{u_v:.2}")].into_iter().chain(load).chain(others).collect()
}

/// The levels with the formulas of a test stand.
fn nominal_levels(stand: &Stand) -> Table {
    let columns = [
        ("emf_V", 6),
        ("rpm", 7),
        ("P_in_W", 6),
        ("P_out_W", 7),
        ("eff", 5),
        ("torque_Nm", 9),
        ("k_mot", 6),
        ("R_dyn_ohm", 9),
    ];
    let rows = stand.study.levels.iter().map(|level| {
        let cells = [
            (level.emf_V, 2),
            (level.rpm, 1),
            (level.p_in_W, 2),
            (level.p_out_W, 2),
            (level.efficiency, 2),
            (level.torque_Nm, 4),
            (level.k_mot_rad_per_s_per_V, 2),
            (level.dynamic_resistance_ohm, 2),
        ];
        row(stand, level.u_V, level.load_Nm, cells.map(|(value, digits)| format!("{value:.digits$}")))
    });
    let heading = "Derived with the nominal constants, as usual at test stands";
    Table::new(heading, by_level(stand, &columns), rows.collect())
}

fn losses(stand: &Stand) -> Table {
    let shaft = (!stand.loaded.is_empty()).then_some(("shaft", 8));
    let others = [("winding", 8), ("drop", 8), ("dry fr.", 8), ("viscous", 8), ("rest", 8)];
    let columns = by_level(stand, &shaft.into_iter().chain(others).collect::<Vec<_>>());
    let rows = stand.losses.iter().map(|losses| {
        let [winding, drop, dry, viscous] =
            [losses.winding_W, losses.drop_W, losses.coulomb_W, losses.viscous_W].map(|power| format!("{power:.3}"));
        let mut cells = row(stand, losses.u_V, losses.load_Nm, [winding, drop, dry, viscous, fixed(losses.rest_W, 3)]);
        if shaft.is_some() {
            cells.insert(2, fixed(losses.shaft_W, 3));
        }
        cells
    });
    Table::new("Where the power goes by the constants found, W", columns, rows.collect())
}

fn winding(stand: &Stand, nominal_ohm: Option<f64>) -> Option<String> {
    let winding = stand.winding.as_ref()?;
    let least = winding.resistances_ohm.iter().copied().fold(f64::INFINITY, f64::min);
    let most = winding.resistances_ohm.iter().copied().fold(0.0, f64::max);
    Some(format!(
        "Winding at {} positions: mean {} ohm, spread {}, {} to {}; nominal {}",
        winding.resistances_ohm.len(),
        short(winding.mean_ohm),
        short(winding.spread_ohm),
        short(least),
        short(most),
        nominal_ohm.map_or("unknown".into(), |nominal| against_mean(nominal, winding))
    ))
}

/// Nominal resistance with its given digits, and whether it is the mean of the positions.
fn against_mean(nominal_ohm: f64, winding: &Winding) -> String {
    let digits = nominal_ohm.to_string().split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let is_mean = format!("{:.digits$}", winding.mean_ohm) == format!("{nominal_ohm:.digits$}");
    if is_mean { short(nominal_ohm) } else { format!("{}, not that mean", short(nominal_ohm)) }
}

fn most_efficient(stand: &Stand) -> Table {
    let heading = match stand.loaded.is_empty() {
        false => "Most efficient load at each voltage, by the constants found",
        true => "Most efficient load at each voltage, predicted: no row of the table had a load",
    };
    let rows = stand.most_efficient.iter().map(|point| {
        let OperatingPoint { u_V, torque_Nm, omega_rad_per_s, i_A, efficiency } = point;
        let cells = [(*u_V, 2), (*torque_Nm, 4), (rpm(*omega_rad_per_s), 0), (*i_A, 2), (*efficiency, 2)];
        cells.map(|(value, digits)| format!("{value:.digits$}")).to_vec()
    });
    Table::new(heading, vec![("u_V", 6), ("torque_Nm", 10), ("rpm", 7), ("i_A", 6), ("eff", 6)], rows.collect())
}

/// Efficiency over load at each voltage.
fn loads(stand: &Stand) -> Option<Table> {
    let best = stand.loaded.iter().max_by(|a, b| a.shaft_efficiency.total_cmp(&b.shaft_efficiency))?;
    let columns = vec![("u_V", 6), ("load_Nm", 8), ("rpm", 7), ("i_A", 6), ("formulas", 9), ("brake", 6), ("found", 6)];
    let rows = stand.loaded.iter().map(|point| {
        let LoadedPoint { u_V, load_Nm, i_A, formula_efficiency, shaft_efficiency, .. } = point;
        let found = point.model_efficiency.map_or("-".into(), |efficiency| format!("{efficiency:.3}"));
        vec![
            format!("{u_V:.2}"),
            fixed(*load_Nm, 4),
            format!("{:.0}", rpm(point.omega_rad_per_s)),
            format!("{i_A:.3}"),
            format!("{formula_efficiency:.3}"),
            fixed(*shaft_efficiency, 3),
            found,
        ]
    });
    let mut table =
        Table::new("Efficiency over load: by formulas, at the brake, by the constants found", columns, rows.collect());
    table.below.push(format!(
        "Best measured: {:.3} at {:.2} V and {} Nm, {:.0} rpm",
        best.shaft_efficiency,
        best.u_V,
        short(best.load_Nm),
        rpm(best.omega_rad_per_s)
    ));
    let scale = stand.load_scale.as_ref();
    table
        .below
        .extend(scale.map(|scale| format!("The currents correspond to {} times the stated loads", estimate(scale))));
    Some(table)
}

/// Wrong cells of a derived table.
fn wrong_cells(slips: &[WrongCell]) -> Option<Table> {
    let cell = |value: Option<f64>| value.map_or("-".into(), |value| rounded(value, 5));
    let rows = slips.iter().map(|WrongCell { u_V, column, printed, by_row, by_readings }| {
        vec![format!("{u_V:.2}"), column.to_string(), rounded(*printed, 5), cell(*by_row), cell(*by_readings)]
    });
    let heading = "Errors in the derived table: printed cell, formula with its own row, formula with the readings";
    let columns = vec![("u_V", 6), ("column", 22), ("printed", 8), ("own row", 8), ("readings", 9)];
    (!slips.is_empty()).then(|| Table::new(heading, columns, rows.collect()))
}

fn rpm(omega_rad_per_s: f64) -> f64 {
    omega_rad_per_s * 60.0 / std::f64::consts::TAU
}

fn directions(stand: &Stand) -> Option<Table> {
    let columns = by_level(stand, &[("i_A fwd", 8), ("i_A rev", 8), ("rpm fwd", 8), ("rpm rev", 8)]);
    let rows = stand.directions.iter().map(
        |Directions { u_V, load_Nm, forward_A, reverse_A, forward_rad_per_s, reverse_rad_per_s }| {
            let [forward, reverse] = [forward_A, reverse_A].map(|current| format!("{current:.4}"));
            let [forward_rpm, reverse_rpm] =
                [forward_rad_per_s, reverse_rad_per_s].map(|speed| format!("{:.1}", rpm(*speed)));
            row(stand, *u_V, *load_Nm, [forward, reverse, forward_rpm, reverse_rpm])
        },
    );
    (!stand.directions.is_empty()).then(|| Table::new("Forwards and backwards", columns, rows.collect()))
}

const AGAINST: &str = "Against the earlier test";

fn condition(stand: &Stand) -> String {
    if stand.condition.is_empty() {
        return String::new();
    }
    let mut text = format!("{AGAINST}\n");
    for condition in &stand.condition {
        let (before, now) = (estimate(&condition.before), estimate(&condition.now));
        text.push_str(&wrapped(&format!("{}: {}", condition.part, condition.verdict), "  ", "    "));
        let _ = writeln!(text, "    {}, {:+.1} sigmas:\n    {before} -> {now}", condition.quantity, condition.sigmas);
    }
    text
}

fn condition_html(stand: &Stand) -> Markup {
    let rows = stand.condition.iter().map(|condition| {
        let sigmas = format!("{:+.1}", condition.sigmas);
        let (before, now) = (estimate(&condition.before), estimate(&condition.now));
        let cells = [condition.part.to_string(), condition.verdict.to_string(), condition.quantity.to_string()];
        cells.into_iter().chain([sigmas, before, now]).map(web_page::text)
    });
    html! {
        @if !stand.condition.is_empty() {
            h3 { (AGAINST) }
            (web_page::table(&["part", "verdict", "quantity", "sigmas", "before", "now"], rows))
        }
    }
}

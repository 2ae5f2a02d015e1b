//! Checks a printed table of derived quantities against its own formulas, and against the readings it came from.

use motorbench_data::delimited::{Cell, Delimited};
use motorbench_diagnosis::steady_state::{Level, same_level};
use serde::Serialize;
use std::f64::consts::TAU;

/// Means are rounded before they are used: a deviation by this share is no error.
const ROUNDED_ON_THE_WAY: f64 = 5e-4;

/// A cell that its own row or the readings contradict.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(non_snake_case, reason = "names of the contract, with their units")]
pub struct WrongCell {
    /// Voltage of the row.
    pub u_V: f64,
    /// Name of the column, with its unit.
    pub column: &'static str,
    /// The cell.
    pub printed: f64,
    /// The column's formula with the other cells of the row; `None` if one of them is missing.
    pub by_row: Option<f64>,
    /// The formula with the readings; `None` if there are none at this voltage.
    pub by_readings: Option<f64>,
}

/// Columns that are known.
const COLUMNS: usize = 8;
/// A row of them, NaN where one is missing.
type Figures = [f64; COLUMNS];

/// A column, its formula from the others of its row, and from the readings.
struct Formula {
    column: &'static str,
    of_row: fn(&Figures, u_v: f64, k: f64) -> f64,
    of_readings: fn(&Level) -> f64,
}

/// Indices of the columns in a row.
const RPM: usize = 0;
const OMEGA: usize = 1;
const EMF: usize = 2;
const P_IN: usize = 3;
const P_OUT: usize = 4;

/// The current, which such tables leave out, is `P_in / U`: nothing else in the row gives P_in.
const FORMULAS: [Formula; COLUMNS] = [
    Formula { column: "rpm", of_row: |row, _, _| row[OMEGA] * 60.0 / TAU, of_readings: |level| level.rpm },
    Formula {
        column: "omega_rad_per_s",
        of_row: |row, _, _| row[RPM] * TAU / 60.0,
        of_readings: |level| level.omega_rad_per_s,
    },
    Formula { column: "emf_V", of_row: |row, _, k| k * row[OMEGA], of_readings: |level| level.emf_V },
    Formula { column: "p_in_W", of_row: |_, _, _| f64::NAN, of_readings: |level| level.p_in_W },
    Formula { column: "p_out_W", of_row: |row, u_v, _| row[EMF] * row[P_IN] / u_v, of_readings: |level| level.p_out_W },
    Formula { column: "torque_Nm", of_row: |row, u_v, k| k * row[P_IN] / u_v, of_readings: |level| level.torque_Nm },
    Formula { column: "efficiency", of_row: |row, _, _| row[P_OUT] / row[P_IN], of_readings: |level| level.efficiency },
    Formula {
        column: "k_mot_rad_per_s_per_V",
        of_row: |row, u_v, _| row[OMEGA] / u_v,
        of_readings: |level| level.k_mot_rad_per_s_per_V,
    },
];

/// Wrong cells of a table with a column `u_V` and any of those above. `k`: the nominal constant it was derived with.
///
/// # Errors
/// What is wrong with the table, and where.
pub fn slips(table: &str, levels: &[Level], k: f64) -> Result<Vec<WrongCell>, String> {
    let table = Delimited::new(table);
    let (voltages, header) = (table.cells("u_V")?, table.header()?);
    let known = |formula: &Formula| header.iter().any(|column| column == formula.column);
    if !FORMULAS.iter().any(known) {
        let columns: Vec<&str> = FORMULAS.iter().map(|formula| formula.column).collect();
        return Err(format!("the table has none of the columns {}; it has {}", columns.join(", "), header.join(", ")));
    }
    let mut columns = Vec::new();
    for formula in &FORMULAS {
        columns.push(if known(formula) { Some(table.cells(formula.column)?) } else { None });
    }
    let greatest_v = levels.iter().map(|level| level.u_V).fold(0.0, f64::max);
    let mut slips = Vec::new();
    for (row, voltage) in voltages.iter().enumerate() {
        let cells: Vec<Option<&Cell>> = columns.iter().map(|column| column.as_ref().map(|cells| &cells[row])).collect();
        let row = Row { u_v: voltage.value, cells: &cells, k };
        let level = levels.iter().find(|level| level.load_Nm == 0.0 && same_level(level.u_V, row.u_v, greatest_v));
        slips.extend((0..COLUMNS).filter_map(|column| row.slip(column, level)));
    }
    Ok(slips)
}

/// A row of the table.
struct Row<'a> {
    u_v: f64,
    cells: &'a [Option<&'a Cell>],
    k: f64,
}

impl Row<'_> {
    fn values(&self) -> Figures {
        std::array::from_fn(|column| self.cells[column].map_or(f64::NAN, |cell| cell.value))
    }

    /// The value of a formula for the row, and its change with the last digits of the cells.
    fn derived(&self, column: usize) -> Option<(f64, f64)> {
        let of = |row: &Figures| (FORMULAS[column].of_row)(row, self.u_v, self.k);
        let values = self.values();
        let derived = of(&values);
        let changed_by = |other: usize| {
            let mut moved = values;
            moved[other] += 0.5 * self.cells[other].map_or(0.0, last_digit);
            (of(&moved) - derived).abs()
        };
        derived.is_finite().then(|| (derived, (0..COLUMNS).map(changed_by).sum()))
    }

    fn slip(&self, column: usize, level: Option<&Level>) -> Option<WrongCell> {
        let cell = self.cells[column].filter(|cell| cell.value.is_finite())?;
        // A digit is rounded or cut off.
        let differs =
            |value: f64, by: f64| (cell.value - value).abs() > last_digit(cell) + by + ROUNDED_ON_THE_WAY * value.abs();
        let (row, readings) = (self.derived(column), level.map(FORMULAS[column].of_readings));
        let is_slip =
            row.is_some_and(|(value, by)| differs(value, by)) || readings.is_some_and(|value| differs(value, 0.0));
        is_slip.then(|| WrongCell {
            u_V: self.u_v,
            column: FORMULAS[column].column,
            printed: cell.value,
            by_row: row.map(|(value, _)| value),
            by_readings: readings,
        })
    }
}

/// The weight of a number's last digit.
fn last_digit(cell: &Cell) -> f64 {
    let decimals = cell.text.split(['.', ',']).nth(1).map_or(0, |decimals| decimals.len());
    0.1_f64.powi(i32::try_from(decimals).unwrap_or(i32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0.072 V s of 100 rad/s, 0.5 A.
    const RIGHT: &str = "u_V,rpm,omega_rad_per_s,emf_V,p_in_W,p_out_W,torque_Nm,efficiency,k_mot_rad_per_s_per_V\n\
                         10,954.9,100.00,7.20,5.00,3.60,0.036,0.72,10.00\n";

    fn columns(table: &str) -> Vec<&'static str> {
        slips(table, &[], 0.072).unwrap().iter().map(|slip| slip.column).collect()
    }

    #[test]
    fn each_column_is_held_against_its_formula() {
        assert_eq!(columns(RIGHT), [""; 0]);
        // Digits that are cut off instead of rounded, or another last digit of the constant, are no error.
        assert_eq!(columns(&RIGHT.replace("7.20", "7.21").replace("954.9", "954.8")), [""; 0]);
        for (right, wrong, found) in [
            (",954.9,", ",945.9,", &["rpm", "omega_rad_per_s"][..]),
            (",0.036,", ",0.063,", &["torque_Nm"]),
            (",0.72,", ",0.62,", &["efficiency"]),
            (",10.00\n", ",11.00\n", &["k_mot_rad_per_s_per_V"]),
            (",7.20,", ",7.02,", &["emf_V", "p_out_W"]),
        ] {
            assert_eq!(columns(&RIGHT.replace(right, wrong)), found, "{wrong}");
        }
    }

    #[test]
    fn fewer_columns_are_enough_and_none_is_an_error() {
        assert_eq!(columns("u_V;omega_rad_per_s;k_mot_rad_per_s_per_V\n10;100,0;9,00\n"), ["k_mot_rad_per_s_per_V"]);
        assert_eq!(columns("u_V,emf_V\n10,7.2\n"), [""; 0]);
        let error = |table: &str| slips(table, &[], 0.072).unwrap_err();
        assert!(
            error("u_V,eta\n10,0.5\n").starts_with("the table has none of the columns rpm, omega_rad_per_s, emf_V")
        );
        assert_eq!(error("rpm\n1\n"), "the table needs a column u_V, but has rpm");
    }
}

//! What oscilloscopes and LabVIEW write beside or above their rows: metadata, and the times that the rows lack.

use super::Split;
use super::header::Header;
use super::lines::{Line, Separator};
use crate::units;

/// Names after the columns of a header line that are no columns.
const NO_COLUMNS: [&str; 4] = ["", "start", "increment", "comment"];

/// Whether a name without cells in the rows may stand in the header line.
pub fn may_lack_cells(name: &str) -> bool {
    NO_COLUMNS.contains(&name.to_lowercase().as_str()) || name.contains('=')
}

/// The first time and the time between rows, in s.
pub fn start_and_step_s(above: &[Line<'_>], names: &[String], values: &[String]) -> Option<(f64, f64)> {
    let beside = |name: &str| {
        let place = names.iter().position(|other| other.eq_ignore_ascii_case(name))?;
        values.get(place)?.parse::<f64>().ok()
    };
    let within = |key: &str| {
        let (_, value) = names.iter().find_map(|name| name.split_once('=').filter(|(name, _)| name.trim() == key))?;
        value.trim().trim_end_matches('s').parse::<f64>().ok()
    };
    let said = |key: &str| {
        let separators = [Separator::Sign(b'\t'), Separator::Sign(b','), Separator::Sign(b';')];
        let of_line = |line: &Line<'_>| {
            separators.iter().find_map(|separator| {
                let cells = separator.cells(line.text);
                (cells.len() > 1 && cells[0].eq_ignore_ascii_case(key))
                    .then(|| cells[1].replace(',', ".").parse().ok())?
            })
        };
        above.iter().find_map(of_line)
    };
    let increment = beside("Increment").or_else(|| within("tInc"));
    if let Some(increment) = increment {
        return Some((beside("Start").or_else(|| within("t0")).unwrap_or(0.0), increment));
    }
    // LabVIEW without a column of times.
    let has_no_times = above.iter().any(|line| line.text.split_whitespace().eq(["X_Columns", "No"]));
    let step = has_no_times.then(|| said("Delta_X")).flatten()?;
    Some((said("X0").unwrap_or(0.0), step))
}

/// Tektronix: the first two columns have the settings, the last ones the samples.
pub fn metadata_beside_the_data(split: &mut Split<'_>) -> Option<Header> {
    let first = split.lines.first().filter(|line| line.text.starts_with("Record Length"))?;
    let cells = split.separator.cells(first.text);
    let number = |cell: usize| cells.get(cell).is_some_and(|cell| cell.parse::<f64>().is_ok());
    if split.separator != Separator::Sign(b',') || !number(3) || !number(4) {
        return None;
    }
    let said = |key: &str| {
        let line = split.lines.iter().take(30).find(|line| line.text.starts_with(key))?;
        split.separator.cells(line.text).get(1).map(|cell| cell.trim().to_owned())
    };
    let unit = |key: &str| said(key).as_deref().and_then(units::named).unwrap_or_default().to_owned();
    let names = vec!["Time".to_owned(), said("Source").unwrap_or_else(|| "CH1".into())];
    let units = vec![unit("Horizontal Units"), unit("Vertical Units")];
    split.width = cells.len();
    Some(Header { line: Some(first.number), names, units, first_row: 0, skipped: 3, start_and_step_s: None })
}

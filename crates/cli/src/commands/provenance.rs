//! Where a page comes from: its files and the day.

use motorbench_report::web_page::Provenance;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// Seconds of a day.
const DAY_S: u64 = 86_400;

/// For a page of these data.
pub(super) fn of_files<'a>(files: impl IntoIterator<Item = &'a Path>) -> Provenance {
    let files = files.into_iter().map(|file| file.display().to_string()).collect();
    Provenance { files, written: Some(now()), ..Provenance::default() }
}

/// The same with another input, if there is one.
pub(super) fn with(mut from: Provenance, what: &'static str, file: Option<&Path>) -> Provenance {
    from.inputs.extend(file.map(|file| (what, file.display().to_string())));
    from
}

/// Day and time in UTC.
fn now() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let ([year, month, day], minutes) = (date(since / DAY_S), since % DAY_S / 60);
    format!("{year}-{month:02}-{day:02} {:02}:{:02} UTC", minutes / 60, minutes % 60)
}

/// Year, month and day so many days after 1 January 1970 (Hinnant, chrono-compatible date algorithms). Years that begin
/// in March have their leap day at the end.
fn date(days: u64) -> [u64; 3] {
    let days = days + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = 400 * era + year_of_era + u64::from(month <= 2);
    [year, month, of_year - (153 * from_march + 2) / 5 + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_counted_with_their_leap_days() {
        let known = [(0, [1970, 1, 1]), (11_016, [2000, 2, 29]), (19_782, [2024, 2, 29]), (20_783, [2026, 11, 26])];
        known.iter().for_each(|(days, day)| assert_eq!(date(*days), *day));
    }
}

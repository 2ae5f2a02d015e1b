//! Readings that no shaft can produce: one direction whatever the voltage, or three times the speed for a single row.

use super::columns::{correlation, greatest, mean};
use crate::configuration::dataset::mistakes::{ALL_BUT, FOLLOWS, IMPOSSIBLE, OFTEN, SUBSTANTIAL};

/// Whether a motion never reverses though its drive does.
pub(super) fn has_no_sign(drive: &[f64], motion: &[f64]) -> bool {
    let magnitude: Vec<f64> = drive.iter().map(|volts| volts.abs()).collect();
    let follows = || correlation(&about_mean(&magnitude), &about_mean(motion)) > FOLLOWS;
    let least = -SUBSTANTIAL * greatest(motion);
    let goes_back = motion.iter().any(|speed| *speed < least);
    goes(drive, 1.0) && goes(drive, -1.0) && goes(motion, 1.0) && !goes_back && follows()
}

/// Whether a current never reverses though its drive does, and follows the magnitude of it: the sensor has no sign. A sensor
/// of one direction, and one that reads something at no current, follow the drive itself.
pub(super) fn is_a_magnitude(drive: &[f64], current: &[f64]) -> bool {
    let magnitude: Vec<f64> = drive.iter().map(|volts| volts.abs()).collect();
    let follows = |drive: &[f64]| correlation(&about_mean(drive), &about_mean(current));
    let least = -SUBSTANTIAL * greatest(current);
    let goes_back = current.iter().any(|current| *current < least);
    goes(drive, 1.0) && goes(drive, -1.0) && !goes_back && follows(&magnitude) > follows(drive).abs()
}

/// Whether many rows have substantial values of this sign.
fn goes(values: &[f64], sense: f64) -> bool {
    let least = SUBSTANTIAL * greatest(values);
    values.iter().filter(|value| sense * **value > least).count() as f64 > OFTEN * values.len() as f64
}

pub(super) fn about_mean(values: &[f64]) -> Vec<f64> {
    let mean = mean(values);
    values.iter().map(|value| value - mean).collect()
}

/// Removes single rows with a speed that no shaft can have, as from garbled lines. Returns their number.
pub(super) fn take_out_impossible(speed: &mut [f64]) -> usize {
    let mut moving: Vec<f64> = speed.iter().map(|value| value.abs()).filter(|value| *value > 0.0).collect();
    moving.sort_unstable_by(f64::total_cmp);
    let Some(usual) = moving.get(((1.0 - ALL_BUT) * moving.len() as f64) as usize) else { return 0 };
    let is_beyond = |value: f64| value.abs() > IMPOSSIBLE * usual;
    let is_alone = |row: &usize| is_beyond(speed[*row]) && !is_beyond(speed[row - 1]) && !is_beyond(speed[row + 1]);
    let rows: Vec<usize> = (1..speed.len().saturating_sub(1)).filter(is_alone).collect();
    for row in &rows {
        speed[*row] = f64::NAN;
    }
    rows.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volts() -> Vec<f64> {
        (0..2000).map(|row| 12.0 * (f64::from(row) / 100.0).sin()).collect()
    }

    #[test]
    fn a_motion_without_a_sign_is_seen() {
        let (drive, speed): (Vec<f64>, Vec<f64>) = volts().iter().map(|volts| (*volts, 8.0 * volts)).unzip();
        let magnitude: Vec<f64> = speed.iter().map(|speed| speed.abs()).collect();
        assert!(has_no_sign(&drive, &magnitude));
        assert!(!has_no_sign(&drive, &speed));
        // A speed without any relation to the voltage is another mistake.
        let apart: Vec<f64> = (0..drive.len()).map(|row| (row % 7) as f64).collect();
        assert!(!has_no_sign(&drive, &apart));
        // Driven in one direction alone it needs no sign.
        let forwards: Vec<f64> = drive.iter().map(|volts| volts.abs()).collect();
        assert!(!has_no_sign(&forwards, &magnitude));
    }

    #[test]
    fn a_current_without_a_sign_is_seen() {
        let drive = volts();
        let of = |read: fn(f64) -> f64| drive.iter().map(|volts| read(0.1 * volts)).collect::<Vec<f64>>();
        assert!(is_a_magnitude(&drive, &of(f64::abs)));
        assert!(!is_a_magnitude(&drive, &of(|current| current)));
        assert!(!is_a_magnitude(&drive, &of(|current| current.max(0.0))), "one direction alone");
        assert!(!is_a_magnitude(&drive, &of(|current| current + 2.5)), "the reading at no current is not taken off");
        assert!(!is_a_magnitude(&of(f64::abs), &of(f64::abs)), "driven in one direction it needs no sign");
    }

    #[test]
    fn garbled_speeds_are_taken_out_and_no_others() {
        let speed: Vec<f64> = volts().iter().map(|volts| 8.0 * volts).collect();
        let mut garbled = speed.clone();
        let rows = [3, 500, 777, 1998];
        for row in rows {
            garbled[row] = 9999.0;
        }
        assert_eq!(take_out_impossible(&mut garbled), rows.len());
        assert!(
            garbled
                .iter()
                .zip(&speed)
                .enumerate()
                .all(|(row, (left, whole))| { if rows.contains(&row) { left.is_nan() } else { left == whole } })
        );
        // A short motion after a long standstill is not garbled.
        let mut started = [vec![0.0; 1000], vec![50.0; 5]].concat();
        assert_eq!(take_out_impossible(&mut started), 0);
    }
}

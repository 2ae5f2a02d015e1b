//! A current sensor that is dead: its reading stands still while the motor is driven and turns.

use super::columns::{correlation, greatest, mean, width};
use super::mistakes::about_mean;
use super::noise::noise;
use super::{Dataset, Measured, Output};
use crate::configuration::dataset::dead_current::{FOLLOWS, MOST_STEPS, MOVES};
use motorbench_text::terminal_text::short;

/// Takes the current of recordings in which its sensor is dead for not recorded: of all, where no other shows a current, or of
/// those alone.
pub(super) fn leave_out(recordings: &mut [Dataset], resolution_a: Option<f64>) {
    let stands: Vec<bool> = recordings.iter().map(|data| stands(data, resolution_a.unwrap_or(0.0))).collect();
    let of_all = stands.iter().all(|stands| *stands);
    let is_dead: Vec<bool> = recordings.iter().zip(&stands).map(|(data, stands)| *stands && turns(data)).collect();
    if !is_dead.contains(&true) {
        return;
    }
    for (data, is_dead) in recordings.iter_mut().zip(is_dead) {
        if is_dead {
            let current = data.current_mut().expect("it stands");
            let stands_at_a = mean(&current.values);
            current.values.fill(f64::NAN);
            data.origin.dead_current_a = Some(stands_at_a);
        }
        if of_all {
            data.measured.retain(|measured| measured.output != Output::Current);
        }
    }
}

/// What is said of it.
pub(super) fn note(stands_at_a: f64) -> String {
    format!(
        "i_A stays at {} A though the motor is driven and turns. The sensor seems dead, so i_A is not used. Check its supply, that the motor's wire goes through it, the pin, and the column.",
        short(stands_at_a)
    )
}

fn stands(data: &Dataset, resolution_a: f64) -> bool {
    let Some(Measured { values, .. }) = data.current() else { return false };
    width(values) <= MOST_STEPS * resolution_a
        && correlation(&about_mean(&data.command), &about_mean(values)).abs() < FOLLOWS
}

/// Whether the motor is driven and moves: then a current flows.
fn turns(data: &Dataset) -> bool {
    let is_driven = data.command.iter().zip(&data.open).any(|(volts, open)| *volts != 0.0 && !open);
    let motion = &data.motion().values;
    is_driven && greatest(motion) > MOVES * noise(motion)
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_data::recording::{Channel, Recording};
    use motorbench_data::rig::Rig;

    const RESOLUTION_A: f64 = 0.005;

    /// A motor on its way to and fro, with what its current sensor makes of the current, or of time alone.
    fn recording(reading: impl Fn(f64, f64) -> f64) -> Recording {
        let time_s: Vec<f64> = (0..4000).map(|row| f64::from(row) * 1e-3).collect();
        let (mut speed, mut rows) = (0.0, Vec::new());
        for time_s in &time_s {
            let volts = if time_s % 1.0 < 0.5 { 6.0 } else { -6.0 };
            let current_a = (volts - 0.04 * speed) / 2.0;
            rows.push([*time_s, volts, speed, reading(current_a, *time_s)]);
            speed += 1e-3 * 0.04 * current_a / 1e-4;
        }
        let mut recording = Recording::new("run.csv");
        let channels = [Channel::Time, Channel::Voltage, Channel::Speed, Channel::Current];
        for (index, channel) in channels.into_iter().enumerate() {
            recording.set(channel, rows.iter().map(|row| row[index]).collect());
        }
        recording
    }

    fn dataset(recordings: &[Recording]) -> Dataset {
        let rig = format!("[supply]\nvoltage_V = 12\n[current_sensor]\nresolution_A = {RESOLUTION_A}\n");
        Dataset::new(recordings, &Rig::parse("rig.toml", &rig).unwrap()).unwrap()
    }

    /// Toggles by a step of the converter, with no regard to the motor.
    fn unrest(time_s: f64) -> f64 {
        RESOLUTION_A * (time_s * 12_345.0).sin().round()
    }

    #[test]
    fn a_dead_sensor_is_told_and_its_current_not_recorded() {
        for stands_at_a in [0.0, 2.5, -0.3] {
            for toggles in [0.0, 1.0] {
                let data = dataset(&[recording(|_, time_s| stands_at_a + toggles * unrest(time_s))]);
                assert!(data.current().is_none(), "{stands_at_a}");
                let said = format!("i_A stays at {} A", short(data.origin.dead_current_a.unwrap()));
                assert!(data.notes().iter().any(|note| note.starts_with(&said)), "{:?}", data.notes());
            }
        }
    }

    /// However coarse, and with an offset.
    #[test]
    fn a_sensor_that_answers_is_not_dead() {
        for step_a in [0.005, 0.5, 2.9] {
            let data =
                dataset(&[recording(|current_a, time_s| 2.5 + (current_a / step_a).round() * step_a + unrest(time_s))]);
            assert!(data.current().is_some() && data.origin.dead_current_a.is_none(), "{step_a}");
        }
    }

    /// The current of another recording of the same rig is compared on.
    #[test]
    fn of_several_recordings_the_dead_one_has_no_current() {
        let data = dataset(&[recording(|_, _| 0.0), recording(|current_a, _| current_a)]);
        let current = &data.current().expect("the second has one").values;
        assert!(current[..4000].iter().all(|value| value.is_nan()) && current[4000..].iter().all(|a| a.is_finite()));
        assert_eq!(data.origin.dead_current_a, Some(0.0));
    }
}

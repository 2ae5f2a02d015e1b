//! Signs that a motor without an external drive never has: a motion or a current against its voltage.

use super::NEARLY_AT_REST;
use crate::dataset::{DatasetError, greatest};
use motorbench_data::recording::{Channel, Recording};

/// What drives the motor of a table.
const VOLTAGE: &str = "voltage";

/// Refuses such a table with the same messages as recordings.
pub(super) fn check(table: &Recording, voltage: &[f64], current: &[f64], speed: &[f64]) -> Result<(), DatasetError> {
    // A weight may turn a motor against its voltage.
    if table.get(Channel::LoadTorque).is_some_and(|load| load.iter().any(|load| *load != 0.0)) {
        return Ok(());
    }
    let column = [Channel::Speed, Channel::Rpm].into_iter().find(|channel| table.get(*channel).is_some());
    let (name, motion) = (table.name.clone(), column.unwrap_or(Channel::Speed).column());
    if goes_both_ways(voltage) && !goes_both_ways(speed) {
        return Err(DatasetError::NoSign { name, column: motion, drive: VOLTAGE });
    }
    if opposes(voltage, speed) {
        return Err(DatasetError::Backward { name, column: motion, drive: VOLTAGE });
    }
    // The offset of the sensor may exceed the no-load current: single rows prove nothing, all together do.
    let power_w: f64 =
        voltage.iter().zip(current).map(|(u_v, i_a)| u_v * i_a).filter(|power_w| !power_w.is_nan()).sum();
    if power_w < 0.0 {
        return Err(DatasetError::Backward { name, column: Channel::Current.column(), drive: VOLTAGE });
    }
    Ok(())
}

fn goes_both_ways(values: &[f64]) -> bool {
    let least = NEARLY_AT_REST * greatest(values);
    values.iter().any(|value| *value > least) && values.iter().any(|value| *value < -least)
}

/// Whether a speed opposes its voltage in any row in which the motor turns.
fn opposes(voltage: &[f64], speed: &[f64]) -> bool {
    let least = NEARLY_AT_REST * greatest(speed);
    voltage.iter().zip(speed).any(|(u_v, omega)| u_v * omega < 0.0 && omega.abs() > least)
}

#[cfg(test)]
mod tests {
    use crate::steady_state::study;
    use motorbench_data::recording::Recording;
    use motorbench_data::rig::Rig;

    /// Rows of u_V, i_A, rpm: what the study says.
    fn said(rows: &str) -> String {
        let table = Recording::parse("t.csv", format!("u_V,i_A,rpm\n{rows}").as_bytes(), &[]).unwrap();
        let rig = "[motor]\nresistance_ohm = 2\ntorque_constant_Nm_per_A = 0.15\n";
        study(&table, &Rig::parse("rig.toml", rig).unwrap(), None)
            .map_or_else(|error| error.to_string(), |_| "well".into())
    }

    #[test]
    fn a_motion_or_a_current_against_its_voltage_is_refused() {
        assert_eq!(said("3,0.13,180\n6,0.16,360\n9,0.19,540\n-9,-0.19,-540\n12,0.22,720\n"), "well");
        let backward = said("3,0.13,-180\n6,0.16,-360\n9,0.19,-540\n12,0.22,-720\n");
        assert!(backward.starts_with("t.csv: rpm has the opposite sign of the voltage that drives it"));
        assert!(backward.contains("--column rpm=rpm*-1"), "{backward}");
        // A single row, as from a slip of the pen.
        assert!(said("3,0.13,180\n6,0.16,-360\n9,0.19,540\n12,0.22,720\n").contains("rpm has the opposite sign"));
        let current = said("3,-0.13,180\n6,-0.16,360\n9,-0.19,540\n12,-0.22,720\n");
        assert!(current.contains("i_A has the opposite sign of the voltage"), "{current}");
        let no_sign = said("-12,-0.22,720\n-6,-0.16,360\n6,0.16,360\n12,0.22,720\n");
        assert!(no_sign.contains("the voltage reverses but rpm never becomes negative"), "{no_sign}");
    }

    /// Whatever the rig file has: none of its keys would help.
    #[test]
    fn voltage_and_speed_alone_are_told_what_is_missing() {
        for head in ["u_V,rpm", "duty,omega_rad_per_s"] {
            let table = Recording::parse("t.csv", format!("{head}\n0.2,100\n0.4,200\n").as_bytes(), &[]).unwrap();
            let error = study(&table, &Rig::default(), None).unwrap_err().to_string();
            assert!(
                error.starts_with("t.csv: the table has no i_A") && error.contains("Measure the current"),
                "{error}"
            );
        }
    }

    #[test]
    fn an_offset_of_the_current_is_no_wrong_sign() {
        assert_eq!(said("-6,0.02,-360\n-3,0.05,-180\n3,0.20,180\n6,0.23,360\n9,0.3,540\n"), "well");
    }
}

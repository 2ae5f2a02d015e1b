//! Published recordings of other motors, if they are beside this project: `../shared/recordings/`. The results are in
//! docs/explanation/how-it-was-tried.md.

use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::dataset::DatasetError;
use motorbench_diagnosis::diagnose::{Diagnosis, diagnose};
use motorbench_diagnosis::steady_state::{StudyError, study};
use motorbench_model::catalogue::ActsOn;
use std::path::PathBuf;

/// The folder of a rig; without it a line that says so, and `None`.
fn folder(rig: &str) -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings").join(rig);
    if !folder.is_dir() {
        println!("skipped: no recordings of {rig} at {}", folder.display());
        return None;
    }
    Some(folder)
}

fn diagnosed(files: &[PathBuf], supply_v: f64) -> Result<Diagnosis, DatasetError> {
    let recordings: Vec<Recording> = files.iter().map(|file| motorbench_files::recording(file, &[]).unwrap()).collect();
    let rig = Rig::parse("rig.toml", &format!("[supply]\nvoltage_V = {supply_v}\n")).unwrap();
    diagnose(&recordings, &rig, &|_| ())
}

/// Identifiers that count as a name of an effect: itself, or one that the report says it cannot be told from.
fn names(diagnosis: &Diagnosis, id: &str) -> bool {
    diagnosis.outcome.causes.iter().any(|cause| cause.effect == id || cause.not_separable_from.contains(&id))
}

/// Fit of the linear motor and of the extended model, to the tenth of a percent that the document gives.
fn fit_percent(diagnosis: &Diagnosis) -> [String; 2] {
    let percent = |fit: &str| diagnosis.outcome.fit[fit]["omega_rad_per_s"].fit_percent;
    ["base", "extended"].map(|fit| format!("{:.1}", percent(fit)))
}

fn gain(diagnosis: &Diagnosis) -> f64 {
    let rmse = |fit: &str| diagnosis.outcome.fit[fit]["omega_rad_per_s"].rmse;
    rmse("base") / rmse("extended")
}

/// A gearmotor behind a bridge, six steps, no current: the author found it neither linear nor symmetric.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn gearmotor_with_a_dead_zone() {
    let Some(folder) = folder("jga25-370") else { return };
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.file_name().unwrap().to_str().unwrap().starts_with("step_"));
    files.sort();
    assert_eq!(files.len(), 6);
    let diagnosis = diagnosed(&files, 12.0).unwrap();
    assert!(names(&diagnosis, "voltage_drop") && names(&diagnosis, "coulomb_friction"), "{:?}", diagnosis.outcome);
    assert!(
        diagnosis.outcome.causes.iter().all(|cause| cause.confidence < 0.6),
        "without a current nobody can be sure"
    );
    assert!(gain(&diagnosis) > 3.0, "{}", gain(&diagnosis));
    assert_eq!(fit_percent(&diagnosis), ["91.9", "97.7"]);
    let rest = diagnosis.outcome.unexplained.expect("the author found it neither linear nor symmetric");
    assert_eq!((rest.acts_on, &*rest.depends_on), (ActsOn::Torque, "speed"));
}

/// A teaching motor around one speed at 50 Hz: friction or load cannot be told apart, the delay can.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn teaching_motor_around_one_speed() {
    let Some(folder) = folder("undcmotor") else { return };
    let diagnosis = diagnosed(&[folder.join("prbs_open_loop.csv")], 5.0).unwrap();
    assert!(names(&diagnosis, "actuation_delay"), "{:?}", diagnosis.outcome);
    assert!(names(&diagnosis, "load_torque") && names(&diagnosis, "coulomb_friction"), "{:?}", diagnosis.outcome);
    assert_eq!(fit_percent(&diagnosis), ["89.7", "96.1"]);
    let delay_s = diagnosis.outcome.causes.iter().find_map(|cause| cause.parameters.get("delay_s")).unwrap().value;
    assert!((delay_s - 0.012).abs() < 0.0005, "{delay_s}");
    let fit = &diagnosis.outcome.fit;
    let excess = fit["extended"]["omega_rad_per_s"].rmse / fit["noise_floor"]["omega_rad_per_s"].rmse;
    assert!(excess < 1.1 && gain(&diagnosis) > 2.0, "{excess} {}", gain(&diagnosis));
    assert!(diagnosis.outcome.advice.iter().any(|advice| advice.contains("never reverses")));
}

/// Differences of its angle at 50 Hz are little more than noise: refused, with what to record instead.
#[test]
fn staircase_of_angles_is_refused() {
    let Some(folder) = folder("undcmotor") else { return };
    let error = diagnosed(&[folder.join("stairs_closed_loop.csv")], 5.0).err().expect("it drowns in noise");
    assert!(matches!(error, DatasetError::Drowned(..)), "{error}");
}

/// Steady speeds over voltage or duty: without a current none of the causes can be told from the others, and that is said.
#[test]
fn static_curves_without_a_current_are_refused() {
    for rig in ["jga25-370", "undcmotor"] {
        let Some(folder) = folder(rig) else { return };
        let table = motorbench_files::recording(&folder.join("static.csv"), &[]).unwrap();
        let error = study(&table, &Rig::default(), None).unwrap_err();
        assert!(matches!(error, StudyError::NoCurrent(_)), "{error}");
    }
}

/// A slide behind a current-controlled drive, in a closed position loop (EMPS). The published constants are those of an
/// inverse identification with Coulomb friction and an offset.
#[test]
#[ignore = "takes long: `scripts/trials committed`"]
fn emps_has_friction_and_an_offset() {
    let Some(folder) = folder("emps") else { return };
    let columns = ["drive_V=force_N*35.150652", "position_m=x_m"].map(|column| column.parse().unwrap());
    let recording = motorbench_files::recording(&folder.join("identification.csv"), &columns).unwrap();
    let diagnosis = diagnose(&[recording], &Rig::default(), &|_| ()).unwrap();
    let constant = |id: &str, name: &str| {
        let cause = diagnosis.outcome.causes.iter().find(|cause| cause.effect == id);
        cause.unwrap_or_else(|| panic!("{id}: {:?}", diagnosis.outcome.causes)).parameters[name].value
    };
    assert!(names(&diagnosis, "load_torque"), "the published offset: {:?}", diagnosis.outcome.causes);
    let parameter = |name: &str| diagnosis.outcome.parameters[name].value;
    for (found, published, share) in [
        (parameter("inertia_kg_m2"), 95.1, 0.03),
        (parameter("viscous_friction_Nm_s"), 203.5, 0.1),
        (constant("coulomb_friction", "torque_Nm"), 20.4, 0.1),
        // Half the difference between both directions acts as the offset does.
        (0.5 * constant("friction_asymmetry", "difference_Nm"), -3.2, 0.15),
    ] {
        assert!((found / published - 1.0).abs() < share, "{found} for {published}");
    }
}

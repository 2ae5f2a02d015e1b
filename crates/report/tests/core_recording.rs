//! Given a recording by the core of a motor with an effect, the diagnosis names the effect. The recording has passed
//! excitation, sensors and fixed point, and no property of the core's sampling is taken for a cause.

use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters};
use host_sim::trial::Trial;
use motorbench_core::excitation::{Kind, Sequence};
use motorbench_core::message::{Mode, Request, Sample};
use motorbench_core::settings::Settings;
use motorbench_core::units::VOLT;
use motorbench_data::recording::Recording;
use motorbench_data::rig::NominalMotor;
use motorbench_data::telemetry;
use motorbench_diagnosis::diagnose::{Diagnosis, diagnose};
use motorbench_diagnosis::evidence::evidence;
use motorbench_model::motor::MotorParameters;
use motorbench_report::web_page::Provenance;
use serde_json::Value;

fn settings() -> Settings {
    let mut settings = Settings::defaults();
    for (param, value) in telemetry::IDENTIFICATION_SETTINGS {
        settings.set(param, value).unwrap();
    }
    settings
}

fn record(motor: DcMotorParameters) -> (Vec<Sample>, Settings) {
    let settings = settings();
    let mut trial = Trial::new(DcMotor::new(motor), settings).unwrap();
    trial.enter(Mode::OpenLoop);
    let sequence = Sequence::new(Kind::Identify, (10.0 * VOLT) as i16, 0, 500, 1, 7).unwrap();
    trial.tick(Some(Request::Play(sequence)));
    let samples = (0..sequence.duration_ticks()).map(|_| {
        trial.tick(None);
        *trial.sample()
    });
    (samples.collect(), settings)
}

/// On the page each cause has one plot, with the measured bins and the law, and the text says what that law explains.
fn each_cause_has_the_plot_that_proves_it(diagnosis: &Diagnosis) {
    let html = motorbench_report::diagnosis_page::report(diagnosis, Provenance::default());
    for cause in &diagnosis.outcome.causes {
        let found = evidence(diagnosis, cause).unwrap_or_else(|| panic!("{}: no evidence", cause.effect));
        assert!(found.explained() > 0.95, "{}: {}", cause.effect, found.explained());
        let parts: Vec<&str> = html.split(&format!("data-effect=\"{}\"", cause.effect)).collect();
        assert_eq!(parts.len(), 2, "{}: one plot", cause.effect);
        let section = parts[1].split("</section>").next().unwrap();
        let (plot, text) = section.split_once("</figure>").unwrap();
        let (_, numbers) = plot.split_once("<script type=\"application/json\">").unwrap();
        let numbers: Value = serde_json::from_str(numbers.split("</script>").next().unwrap()).unwrap();
        let dots = numbers["series"][1]["y"].as_array().unwrap();
        assert_eq!(
            (dots.len(), numbers["series"][1]["name"].as_str().unwrap().contains("measured")),
            (found.bins.len(), true)
        );
        for (dot, bin) in dots.iter().zip(&found.bins) {
            assert!((dot.as_f64().unwrap() - bin.lack).abs() <= 1e-4 * bin.lack.abs(), "{dot} {bin:?}");
        }
        let said = format!("The law explains {:.1} % of what the model lacks without it.", 100.0 * found.explained());
        assert!(text.contains(&said), "{said} not in {text}");
    }
    let places =
        ["Before and after", "class=\"cause\"", "The motor", "What to do", "Where this comes from", "<details"];
    let places: Vec<usize> = places.iter().map(|part| html.find(part).expect(part)).collect();
    assert!(places.is_sorted(), "{places:?}");
}

#[test]
fn friction_and_bridge_are_found_in_what_the_core_records() {
    let linear = MotorParameters::PIVT6;
    let motor =
        DcMotorParameters { coulomb_friction_nm: 0.012, bridge: BridgeLosses::L293D, ..DcMotorParameters::PIVT6 };
    let (samples, settings) = record(motor);
    let csv = telemetry::recording("core", &samples, &settings).to_csv();
    let recording = Recording::parse("core.csv", csv.as_bytes(), &[]).unwrap();
    let nominal = MotorParameters { resistance_ohm: 1.1 * linear.resistance_ohm, ..linear };
    let rig = telemetry::rig_of_core(&settings, NominalMotor::from(nominal));
    let diagnosis = diagnose(&[recording], &rig, &|_| ()).unwrap();
    println!("{}", motorbench_report::diagnosis_text::page(&diagnosis));
    let mut named: Vec<_> = diagnosis.outcome.causes.iter().map(|cause| cause.effect.as_str()).collect();
    named.sort_unstable();
    assert_eq!(named, ["coulomb_friction", "voltage_drop"]);
    let friction = diagnosis.outcome.causes.iter().find(|cause| cause.effect == "coulomb_friction").unwrap();
    assert!((friction.parameters["torque_Nm"].value / 0.012 - 1.0).abs() < 0.05, "{friction:?}");
    each_cause_has_the_plot_that_proves_it(&diagnosis);
}

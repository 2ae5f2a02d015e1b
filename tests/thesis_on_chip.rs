//! The thesis experiment end to end: given an Uno with the real firmware and a motor with friction behind an L293D, the
//! motor is identified over the serial line, PID and LQR are designed from what was found, run in the firmware, and the
//! simulation says beforehand what they do.

use host_sim::chip::{Bench, ChipBoard, Rig, firmware_elf};
use host_sim::design::specification::{Specification, Speed};
use host_sim::motor::MotorParameters;
use host_sim::plant::{BridgeLosses, DcMotor, DcMotorParameters};
use host_sim::rig::NominalMotor;
use host_sim::thesis::{Loop, Thesis, thesis};

fn experiment() -> Thesis {
    let motor =
        DcMotorParameters { coulomb_friction_nm: 0.012, bridge: BridgeLosses::L293D, ..DcMotorParameters::PIVT6 };
    let bench = Bench::new(firmware_elf().expect("firmware"), Rig::default(), DcMotor::new(motor)).expect("bench");
    let mut board = ChipBoard::start(bench).expect("the firmware starts");
    // The data sheet, a tenth off.
    let sheet = MotorParameters::PIVT6;
    let nominal = MotorParameters {
        resistance_ohm: 1.1 * sheet.resistance_ohm,
        inertia_kg_m2: 0.9 * sheet.inertia_kg_m2,
        ..sheet
    };
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    thesis(&mut board, NominalMotor::from(nominal), &specification, &|_| ()).unwrap_or_else(|error| panic!("{error}"))
}

/// What the simulation said and what the firmware did.
fn agrees(done: &Loop) {
    let law = done.design.law.title();
    assert!(done.speed.fit_percent > 99.5 && done.speed.rms < 0.2, "{law}: {:?}", done.speed);
    assert!(done.current.fit_percent > 94.0, "{law}: {:?}", done.current);
    for [measured, simulated] in &done.figures {
        let close = |of: fn(&host_sim::figures::Figures) -> Option<f64>, by: f64| {
            (of(measured).expect("a step that is followed") - of(simulated).expect("the same")).abs() < by
        };
        assert!(close(|figures| figures.rise_s, 3e-3), "{law}: {measured:?} {simulated:?}");
        assert!(close(|figures| figures.overshoot_percent, 1.0), "{law}: {measured:?} {simulated:?}");
        assert!(measured.steady_error.is_some_and(|error| error.abs() < 0.1), "{law}: {measured:?}");
        assert!((measured.peak_a / simulated.peak_a - 1.0).abs() < 0.1, "{law}: {measured:?} {simulated:?}");
    }
}

#[test]
fn identified_designed_run_and_foretold() {
    let found = experiment();
    println!("{}", found.tables());
    let mut causes: Vec<_> = found.diagnosis.outcome.causes.iter().map(|cause| cause.effect.as_str()).collect();
    causes.sort_unstable();
    assert_eq!(causes, ["coulomb_friction", "voltage_drop"]);
    // Resistance, torque constant and inertia, whose nominal values were wrong.
    let (motor, truth) = (found.diagnosis.model.motor, DcMotorParameters::PIVT6);
    for (found, truth) in [
        (motor.resistance_ohm, truth.resistance_ohm),
        (motor.torque_constant_nm_per_a, truth.torque_constant_nm_per_a),
        (motor.inertia_kg_m2, truth.inertia_kg_m2),
    ] {
        assert!((found / truth - 1.0).abs() < 0.03, "{motor:?}");
    }
    found.loops.iter().for_each(agrees);
}

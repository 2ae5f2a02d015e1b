//! The thesis experiment end to end, on an Uno with the real firmware and a motor with friction behind an L293D. The
//! motor is identified over the serial line. PID and LQR are designed from the result and run in the firmware. The
//! simulation says beforehand what they do.

#[path = "../thesis/mod.rs"]
mod set_up;

use host_sim::plant::DcMotorParameters;
use motorbench_stand::thesis::Loop;

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
    let found = set_up::experiment(&|_| ()).unwrap_or_else(|error| panic!("{error}"));
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

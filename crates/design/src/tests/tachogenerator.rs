//! Loops that take their speed from a tachogenerator.

use super::*;

/// The studies' stand: the speed from a tachogenerator of 3 V at 1000 rpm with 5 % ripple, and no encoder.
fn stand() -> Bench {
    Bench { counts_per_rev: None, tachogenerator: Some(Tachogenerator::new(3.0)), ..Bench::default() }
}

#[test]
fn with_a_tachogenerator_the_loop_has_its_delay_its_steps_and_its_ripple() {
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    let motor = MotorParameters::PIVT6;
    for law in [ControlLaw::SpeedPid, ControlLaw::SpeedLqr] {
        let with_encoder = pivt6(law, 10.0, 10.0).unwrap();
        let with_tacho = design(&motor, &stand(), law, &specification).unwrap();
        assert!((0.99 * 10.0..1.05 * 10.0).contains(&with_tacho.figures.bandwidth_hz));
        // With the same gains, low-pass and conversion reduce the margin by their delay: half a tick more than the
        // mean, plus 3.2 ms. It is less if the current is fed back as well, which they do not delay.
        let margin_s =
            |sampling: &Sampling| robustness::check(&motor, law, sampling, &with_tacho.held).unwrap().margins.delay_s;
        let lost_s = margin_s(&with_encoder.sampling) - margin_s(&with_tacho.sampling);
        println!("{law:?}: conversion and low-pass take {:.2} ms of the delay margin", 1e3 * lost_s);
        let least_s = if law == ControlLaw::SpeedPid { 3.2e-3 } else { 2.9e-3 };
        assert!((least_s..3.9e-3).contains(&lost_s), "{lost_s}");
        assert!(with_tacho.robustness.margins.modulus > 0.6, "{:?}", with_tacho.robustness.margins);
        // The ripple appears in the voltage of the report; an encoder has none.
        assert!(with_tacho.trial.swing_v > 2.0 * with_encoder.trial.swing_v, "{:?}", with_tacho.trial);
        let said = with_tacho.commands.join(" ");
        for expected in ["speed_sensor 1", "tacho_gain 3 ", "speed_filter 3.1831"] {
            assert!(said.contains(expected), "{expected}: {said}");
        }
        assert!(!said.contains("counts_per_rev") && with_encoder.commands.join(" ").contains("speed_sensor 0"));
    }
    // Both laws on one board share the low-pass.
    let [pid, lqr] = [ControlLaw::SpeedPid, ControlLaw::SpeedLqr]
        .map(|law| design(&motor, &stand(), law, &specification).unwrap().settings.all.get(Param::SpeedFilter));
    assert_eq!(pid, lqr);
}

/// The model of the conversion agrees with the core up to the ripple and the age of the conversion. The trial has half
/// a tick, the model the worst case of a whole tick.
#[test]
fn with_a_tachogenerator_the_core_follows_the_linear_loop() {
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    let motor = MotorParameters::PIVT6;
    for law in [ControlLaw::SpeedPid, ControlLaw::SpeedLqr] {
        let design = design(&motor, &stand(), law, &specification).unwrap();
        let linear = design.linear_response(&motor);
        let differences =
            linear.iter().zip(&design.points).map(|(linear, point)| (linear - point.omega_rad_per_s).abs());
        let worst = differences.fold(0.0, f64::max) / design.trial.step;
        println!(
            "{law:?} by the tachogenerator: core and linear loop differ by {:.2} % of the step at most",
            100.0 * worst
        );
        assert!(worst < 0.02, "{law:?}: {worst}");
    }
}

#[test]
fn what_the_firmware_cannot_do_with_a_tachogenerator_is_refused() {
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    let refused =
        |bench: &Bench, law| design(&MotorParameters::PIVT6, bench, law, &specification).unwrap_err().to_string();
    let none = Bench { tachogenerator: None, ..stand() };
    for (message, expected) in [
        (refused(&stand(), ControlLaw::PositionPid), "the position PID needs an encoder, and the rig file has none"),
        (refused(&none, ControlLaw::SpeedPid), "the speed PID needs an encoder, and the rig file has none"),
        (refused(&Bench { supply_v: 30.0, ..stand() }, ControlLaw::SpeedLqr), "the converter ends at 332 rad/s"),
        (refused(&Bench { tick_rate_hz: 2000.0, ..stand() }, ControlLaw::SpeedPid), "set 1000 Hz"),
    ] {
        println!("{message}");
        assert!(message.contains(expected), "{message}");
    }
    // With an encoder for the position and a tachogenerator for the speed the design succeeds.
    let both = Bench { counts_per_rev: Some(2000.0), ..stand() };
    let slow = Specification { speed: Speed::BandwidthHz(5.0), ..specification };
    for law in [ControlLaw::PositionPid, ControlLaw::PositionLqr] {
        let offered = design(&MotorParameters::PIVT6, &both, law, &slow).unwrap();
        assert!(offered.commands.join(" ").contains("speed_sensor 1"));
    }
}

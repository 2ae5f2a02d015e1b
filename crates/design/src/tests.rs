mod random_motors;
mod tachogenerator;

use super::*;
use host_sim::plant::DcMotor;
use host_sim::trial::Trial;
use motorbench_model::Model;
use motorbench_model::linear::motor_model;

/// Bandwidth of each law for the paper's motor.
const BANDWIDTHS_HZ: [(ControlLaw, f64); 4] = [
    (ControlLaw::SpeedPid, 10.0),
    (ControlLaw::SpeedLqr, 10.0),
    (ControlLaw::PositionPid, 5.0),
    (ControlLaw::PositionLqr, 5.0),
];

fn pivt6(law: ControlLaw, hz: f64, overshoot_percent: f64) -> Result<Design, DesignError> {
    let specification = Specification { speed: Speed::BandwidthHz(hz), overshoot_percent, current_limit_a: 1.0 };
    design(&MotorParameters::PIVT6, &Bench::default(), law, &specification)
}

/// Figures of each law on the paper's motor. They are fixed here so that a change of the method shows.
#[test]
fn every_law_for_the_papers_motor() {
    for (law, hz) in BANDWIDTHS_HZ {
        let design = pivt6(law, hz, 10.0).unwrap();
        println!("{law:?}: {:?} {:?} {:?}", design.figures, design.robustness, design.trial);
        assert!((0.99 * hz..1.05 * hz).contains(&design.figures.bandwidth_hz));
        assert!(design.figures.step.overshoot_percent <= 10.0);
        let margins = design.robustness.margins;
        assert!(margins.modulus > 0.8 && margins.delay_s > 20e-3, "{margins:?}");
        // The set value and the held value differ only by the rounding of the format.
        for gain in &design.gains {
            assert!((gain.value - gain.held).abs() <= 0.01 * gain.value.abs(), "{gain:?}");
        }
        assert!(design.trial.peak_a < 1.0 && design.trial.limited_part == 0.0);
    }
}

/// The core in fixed point follows the linear loop with the gains that it holds. The page shows both curves.
#[test]
fn the_core_follows_the_linear_loop() {
    for (law, hz) in BANDWIDTHS_HZ {
        let design = pivt6(law, hz, 10.0).unwrap();
        let worst = farthest_from_linear(&design, &MotorParameters::PIVT6);
        println!("{law:?}: core and linear loop differ by {:.2} % of the step at most", 100.0 * worst);
        assert!(worst < 0.02, "{law:?}: {worst}");
    }
}

#[test]
fn settling_is_a_specification_too() {
    let specification = Specification { speed: Speed::SettlingS(0.1), overshoot_percent: 5.0, current_limit_a: 1.0 };
    for law in ControlLaw::ALL {
        let design = design(&MotorParameters::PIVT6, &Bench::default(), law, &specification).unwrap();
        assert!(design.figures.step.settling_s <= 0.102, "{law:?} {:?}", design.figures);
        assert!(design.figures.step.overshoot_percent <= 5.1, "{law:?} {:?}", design.figures);
        assert!(design.trial.overshoot_percent <= 5.0, "{law:?} {:?}", design.trial);
    }
}

#[test]
fn without_a_current_sensor_the_core_observes_the_current() {
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    let bench = Bench { current_measured: false, ..Bench::default() };
    let slow_winding = MotorParameters { inductance_h: 29.2e-3, ..MotorParameters::PIVT6 };
    for (motor, law) in [
        (MotorParameters::PIVT6, ControlLaw::SpeedLqr),
        (slow_winding, ControlLaw::SpeedLqr),
        (slow_winding, ControlLaw::PositionLqr),
    ] {
        let design = design(&motor, &bench, law, &specification).unwrap();
        let on_current = law.feedback().iter().position(|(_, signal)| *signal == Signal::Current).unwrap();
        assert!(design.held.feedback[on_current] != 0.0, "{:?}", design.held);
        assert_eq!(f64::from(design.settings.all.get(Param::TorqueConstant)), f64::from(0.072_f32));
        assert!(design.settings.all.get(Param::WindingTime) > 1.0);
        // The checked loop contains the observer, like the comparison's loop with the exact gains.
        let observer = design.current_sensor[1].found.unwrap();
        let Robustness { margins, worst_modulus, .. } = design.robustness;
        assert!((margins.modulus - observer.modulus).abs() < 0.01, "{law:?}: {margins:?} {observer:?}");
        assert!((worst_modulus - observer.worst_modulus).abs() < 0.01, "{law:?}: {worst_modulus} {observer:?}");
        let worst = farthest_from_linear(&design, &motor);
        println!("{law:?} with an observed current: core and linear loop differ by {:.2} % at most", 100.0 * worst);
        assert!(worst < 0.02, "{law:?}: {worst}");
    }
    let tachogenerator = Tachogenerator { gain_v_per_krpm: 3.0, ripple: 0.02, ripples_per_rev: 24.0 };
    let bench = Bench { tachogenerator: Some(tachogenerator), ..bench };
    let design = design(&MotorParameters::PIVT6, &bench, ControlLaw::SpeedLqr, &specification).unwrap();
    assert_eq!((design.gains[1].name.as_str(), design.gains[1].value), ("lqr_speed_kc", 0.0));
}

/// The delay of a model is in the linear loop and on the core. Gains designed without the delay are refused with it.
#[test]
fn a_delay_of_the_voltage_is_in_the_loop() {
    let (motor, delay_s) = (MotorParameters::PIVT6, 6.3e-3);
    let specification = |hz| Specification { speed: Speed::BandwidthHz(hz), ..pivt6_at_4_hz() };
    let bench = Bench { delay_s, ..Bench::default() };
    for (law, hz) in [(ControlLaw::SpeedPid, 4.0), (ControlLaw::SpeedLqr, 4.0), (ControlLaw::PositionPid, 2.0)] {
        let late = design(&motor, &bench, law, &specification(hz)).unwrap();
        let prompt = design(&motor, &Bench::default(), law, &specification(hz)).unwrap();
        assert!(late.robustness.margins.gain < 0.6 * prompt.robustness.margins.gain, "{:?}", late.robustness);
        let worst = farthest_from_linear(&late, &motor);
        println!("{law:?}, {delay_s} s late: core and linear loop differ by {:.2} % of the step", 100.0 * worst);
        assert!(worst < 0.02, "{law:?}: {worst}");
    }
    let fast = pivt6(ControlLaw::SpeedPid, 30.0, 10.0).unwrap();
    let delayed = motorbench_model::catalogue::effect("actuation_delay").unwrap();
    let model = Model::linear(motor).with(delayed, vec![2.0 * fast.robustness.margins.delay_s]);
    let error = trial_with_effects(&model, &fast, &fast.settings.all).unwrap_err();
    assert!(matches!(error, DesignError::WithEffects { .. }), "{error}");
    let bench = Bench { delay_s: 0.03, ..Bench::default() };
    let error = design(&motor, &bench, ControlLaw::SpeedPid, &pivt6_at_4_hz()).unwrap_err().to_string();
    assert!(error.contains("actuation_delay.delay_s = 0.03 s exceeds the 0.02 s"), "{error}");
}

fn pivt6_at_4_hz() -> Specification {
    Specification { speed: Speed::BandwidthHz(4.0), overshoot_percent: 10.0, current_limit_a: 1.0 }
}

/// Largest difference of the core's trial and the linear loop, relative to the step.
fn farthest_from_linear(design: &Design, motor: &MotorParameters) -> f64 {
    let linear = design.linear_response(motor);
    let output = |point: &Point| if design.law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
    let differences = linear.iter().zip(&design.points).map(|(linear, point)| (linear - output(point)).abs());
    differences.fold(0.0, f64::max) / design.trial.step
}

/// The console accepts every line, and both laws of a kind can be pasted in sequence.
#[test]
fn commands_are_the_consoles() {
    let mut together = SettingList::default();
    for law in [ControlLaw::PositionPid, ControlLaw::PositionLqr] {
        together.merge(&pivt6(law, 5.0, 10.0).unwrap().settings);
    }
    assert!(together.all.get(Param::PositionKp) > 1.0 && together.all.get(Param::LqrPositionKp) > 1.0);
    assert!(motorbench_core::control_loop::LoopConfig::build(&together.all).is_ok());
    let mut pasted = motorbench_core::settings::Settings::defaults();
    for line in together.commands() {
        paste(&mut pasted, &line);
    }
    for &param in Param::ALL {
        let (pasted, designed) = (pasted.get(param), together.all.get(param));
        assert!((pasted - designed).abs() <= 1e-5 * designed.abs(), "{param:?}: {pasted} {designed}");
    }
}

/// Acts as the console: it takes a line as a whole if the core can hold the result.
fn paste(settings: &mut Settings, line: &str) {
    assert!(line.len() <= 96, "{line}");
    let words: Vec<&str> = line.split(' ').collect();
    assert_eq!(words[0], "set");
    for pair in words[1..].chunks(2) {
        let param = Param::ALL.iter().find(|param| setting_name(**param) == pair[0]).unwrap();
        let value = motorbench_core::console::number::parse(pair[1].as_bytes()).unwrap();
        settings.set(*param, value).unwrap();
    }
    let built = motorbench_core::control_loop::LoopConfig::build(settings);
    assert!(built.is_ok(), "the console refuses {line}: {:?}", built.err());
}

/// A slow motor: its speed range fits neither the default tachogenerator gain nor the default gains. The board still
/// accepts each line in order.
#[test]
fn a_board_with_its_defaults_takes_every_line() {
    let slow = MotorParameters {
        torque_constant_nm_per_a: 0.8,
        inertia_kg_m2: 2e-3,
        viscous_friction_nm_s: 5e-4,
        ..MotorParameters::PIVT6
    };
    for (law, hz) in [(ControlLaw::SpeedPid, 5.0), (ControlLaw::SpeedLqr, 5.0), (ControlLaw::PositionLqr, 3.0)] {
        let specification =
            Specification { speed: Speed::BandwidthHz(hz), overshoot_percent: 10.0, current_limit_a: 1.0 };
        let design = design(&slow, &Bench::default(), law, &specification).unwrap();
        assert!(design.settings.all.get(Param::SpeedRange) < 43.0, "the tachogenerator's default would fit");
        let mut board = Settings::defaults();
        design.commands.iter().for_each(|line| paste(&mut board, line));
    }
}

#[test]
fn bad_input_is_refused_each_with_its_own_message() {
    let good = Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    let refused = |motor: MotorParameters, bench: Bench, specification: Specification| {
        design(&motor, &bench, ControlLaw::SpeedPid, &specification).unwrap_err().to_string()
    };
    let motor = MotorParameters::PIVT6;
    let of = |specification| refused(motor, Bench::default(), specification);
    for (message, expected) in [
        (of(Specification { speed: Speed::BandwidthHz(-1.0), ..good }), "bandwidth-Hz = -1: it must be a positive"),
        (of(Specification { speed: Speed::BandwidthHz(400.0), ..good }), "at most a tenth of the tick rate"),
        (of(Specification { speed: Speed::BandwidthHz(0.001), ..good }), "at least 1/20000 of the tick rate"),
        (of(Specification { speed: Speed::SettlingS(0.001), ..good }), "at least five ticks"),
        (of(Specification { speed: Speed::SettlingS(100.0), ..good }), "at most 20000 ticks"),
        (of(Specification { current_limit_a: 1e-3, ..good }), "trip_peak = 0.0012 A is below its range: raise current"),
        (
            refused(MotorParameters { inertia_kg_m2: 1e-12, ..motor }, Bench::default(), good),
            "is larger than its format holds: check inertia and torque constant of the model, or lower current-limit-A",
        ),
        (
            refused(
                MotorParameters { torque_constant_nm_per_a: 2.5, inertia_kg_m2: 2.0, ..motor },
                Bench::default(),
                Specification { current_limit_a: 0.1, ..good },
            ),
            "acceleration = 0.04 rad/s2 is below its range: raise --current-limit-A (the profile uses a third of it)",
        ),
        (
            refused(motor, Bench { supply_v: 1e-3, ..Bench::default() }, good),
            "is below its range: check supply and encoder of the rig",
        ),
        (of(Specification { overshoot_percent: 150.0, ..good }), "overshoot-percent = 150"),
        (of(Specification { current_limit_a: 0.0, ..good }), "current-limit-A = 0"),
        (of(Specification { speed: Speed::SettlingS(0.006), ..good }), "cannot be that fast: it settles in 0.0"),
        (
            refused(MotorParameters { inertia_kg_m2: -1.0, ..motor }, Bench::default(), good),
            "inertia_kg_m2 = -1: it must be a positive number",
        ),
        (
            refused(motor, Bench { counts_per_rev: Some(20_000.0), ..Bench::default() }, good),
            "the chip can count 100000: lower the supply or use a coarser encoder",
        ),
        (
            refused(motor, Bench { tick_rate_hz: 1500.0, ..Bench::default() }, good),
            "tick_rate = 1500 Hz is not allowed",
        ),
    ] {
        println!("{message}");
        assert!(message.contains(expected), "{message}");
    }
}

/// A flywheel: the gain that would make it fast exceeds the core's format.
#[test]
fn a_gain_that_the_core_cannot_hold_is_refused_by_name() {
    let flywheel =
        MotorParameters { inertia_kg_m2: 100.0 * MotorParameters::PIVT6.inertia_kg_m2, ..MotorParameters::PIVT6 };
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    for (law, name) in [(ControlLaw::SpeedPid, "speed_kp"), (ControlLaw::SpeedLqr, "lqr_speed_k")] {
        let error = design(&flywheel, &Bench::default(), law, &specification).unwrap_err().to_string();
        println!("{error}");
        assert!(
            error.starts_with(name) && error.contains("larger than its format holds: ask for a slower loop"),
            "{error}"
        );
    }
}

/// A slow winding with much resistance needs more volts for each ampere than the format holds. The law omits the gain
/// and says so.
#[test]
fn an_lqr_whose_gain_on_the_current_cannot_be_held_does_without_it() {
    let motor = MotorParameters {
        resistance_ohm: 200.0,
        inductance_h: 2.0,
        torque_constant_nm_per_a: 1.0,
        inertia_kg_m2: 4e-4,
        viscous_friction_nm_s: 5e-5,
    };
    let bench = Bench { supply_v: 24.0, ..Bench::default() };
    let lqr = |hz| {
        let specification =
            Specification { speed: Speed::BandwidthHz(hz), overshoot_percent: 10.0, current_limit_a: 0.2 };
        design(&motor, &bench, ControlLaw::SpeedLqr, &specification)
    };
    let without = lqr(8.0).unwrap();
    assert_eq!((without.gains[1].name.as_str(), without.gains[1].value), ("lqr_speed_kc", 0.0));
    let refused = without.current_left_out.as_ref().expect("the gain on the current was left out").to_string();
    assert!(refused.starts_with("lqr_speed_kc = "), "{refused}");
    let with = lqr(5.0).unwrap();
    assert!(with.gains[1].value > 1.0 && with.current_left_out.is_none());
    // If both loops fail, the reason of the better one is reported.
    let refused = lqr(20.0).unwrap_err().to_string();
    assert!(refused.starts_with("lqr_speed_kc = ") && refused.contains("larger than its format holds"), "{refused}");
}

/// The effect of a load in the summary is the one on the core's own loop, also for a very slow integral.
#[test]
fn a_load_turns_the_motor_as_far_and_as_long_as_is_said() {
    const LOAD_NM: f64 = 0.02;
    for law in [ControlLaw::PositionPid, ControlLaw::PositionLqr] {
        let design = pivt6(law, 5.0, 10.0).unwrap();
        let load = design.load.unwrap();
        let plant = DcMotor::new(ideal(&MotorParameters::PIVT6));
        let mut trial = Trial::new(plant, design.settings.all).unwrap();
        trial.enter(law.mode());
        trial.surroundings.load_torque_nm = LOAD_NM;
        let points = trial.follow(0.0, 2.0 * load.gone_s);
        let peak_rad = points.iter().map(|point| point.theta_rad.abs()).fold(0.0, f64::max);
        println!("{law:?}: {load:?}, on the core {peak_rad:.4} rad by {LOAD_NM} Nm");
        assert!((peak_rad / (LOAD_NM * load.peak_rad_per_nm) - 1.0).abs() < 0.05, "{law:?}: {peak_rad} {load:?}");
        let count_rad = std::f64::consts::TAU / 2000.0;
        let left = |part: f64| points[(part * points.len() as f64) as usize].theta_rad.abs();
        assert!(left(0.25) > 0.04 * peak_rad && left(0.5) < 0.02 * peak_rad + 2.0 * count_rad, "{law:?}: {load:?}");
        let slow = Specification { speed: Speed::SettlingS(0.3), overshoot_percent: 10.0, current_limit_a: 1.0 };
        let slow = super::design(&MotorParameters::PIVT6, &Bench::default(), law, &slow).unwrap();
        let slowest_s = -1e-3 / slow.robustness.spectral_radius.ln();
        let gone_s = slow.load.unwrap().gone_s;
        println!("{law:?}, settled in 0.3 s: gone after {gone_s:.1} s");
        assert!((gone_s / (slowest_s * 50_f64.ln()) - 1.0).abs() < 0.1, "{law:?}: {gone_s} {slowest_s}");
    }
    assert!(pivt6(ControlLaw::SpeedPid, 10.0, 10.0).unwrap().load.is_none());
}

/// Gains that only stabilise the model are refused: each weakness is found.
#[test]
fn a_loop_that_is_not_robust_is_refused() {
    let judge = |kp: f64, ki: f64| {
        let gains = Gains { feedback: vec![kp, 0.0, ki], reference: kp };
        robustness::check(&MotorParameters::PIVT6, ControlLaw::SpeedPid, &Sampling::new(1e-3, 2e-3), &gains)
    };
    assert!(judge(0.1, 3.0).is_ok());
    assert!(matches!(judge(5.0, 3.0), Err(Weakness::Unstable { .. })), "{:?}", judge(5.0, 3.0));
    assert!(matches!(judge(1.0, 3.0), Err(Weakness::Modulus { .. })), "{:?}", judge(1.0, 3.0));
    let message = judge(1.0, 3.0).unwrap_err().to_string();
    assert!(message.contains("at least 0.5 is needed"), "{message}");
}

/// The core's other tick rate.
#[test]
fn at_two_kilohertz_the_core_follows_as_well() {
    let bench = Bench { tick_rate_hz: 2000.0, ..Bench::default() };
    for law in ControlLaw::ALL {
        let speed = Speed::BandwidthHz(if law.is_position() { 10.0 } else { 20.0 });
        let specification = Specification { speed, overshoot_percent: 10.0, current_limit_a: 1.0 };
        let design = design(&MotorParameters::PIVT6, &bench, law, &specification).unwrap();
        let worst = farthest_from_linear(&design, &MotorParameters::PIVT6);
        println!("{law:?} at 2 kHz: core and linear loop differ by {:.2} % of the step at most", 100.0 * worst);
        assert!(worst < 0.02, "{law:?}: {worst}");
    }
}

/// An encoder with few counts is scaled more coarsely and not refused, also with a slow motor.
#[test]
fn a_coarse_encoder_is_no_reason_to_refuse() {
    let geared = MotorParameters {
        resistance_ohm: 6.57,
        inductance_h: 7e-3,
        torque_constant_nm_per_a: 0.129,
        inertia_kg_m2: 9.5e-5,
        viscous_friction_nm_s: 4.6e-4,
    };
    let specification = Specification { speed: Speed::BandwidthHz(3.0), overshoot_percent: 10.0, current_limit_a: 0.8 };
    for (motor, supply_v) in [(MotorParameters::PIVT6, 12.0), (geared, 6.0)] {
        for counts_per_rev in [28.0, 48.0, 64.0, 100.0] {
            let bench = Bench { supply_v, counts_per_rev: Some(counts_per_rev), ..Bench::default() };
            for law in [ControlLaw::SpeedPid, ControlLaw::SpeedLqr] {
                if let Err(error) = design(&motor, &bench, law, &specification) {
                    panic!("{law:?} with {counts_per_rev} counts at {supply_v} V: {error}");
                }
            }
        }
    }
}

/// Weights from a search give the same gains to the last bit if they are given by hand. This holds for every law, and
/// for motors unlike the paper's.
#[test]
fn weights_found_are_the_same_gains_when_given() {
    let slow = MotorParameters { inertia_kg_m2: 20.0 * MotorParameters::PIVT6.inertia_kg_m2, ..MotorParameters::PIVT6 };
    let inductive =
        MotorParameters { inductance_h: 10.0 * MotorParameters::PIVT6.inductance_h, ..MotorParameters::PIVT6 };
    let bench = Bench::default();
    for (motor, hz) in [(MotorParameters::PIVT6, 10.0), (slow, 2.0), (inductive, 4.0)] {
        for law in ControlLaw::ALL {
            let speed = Speed::BandwidthHz(if law.is_position() { 0.5 * hz } else { hz });
            let specification = Specification { speed, overshoot_percent: 10.0, current_limit_a: 1.0 };
            let searched = design(&motor, &bench, law, &specification).unwrap();
            let json = serde_json::to_value(searched.weights).unwrap();
            let q: Vec<f64> = serde_json::from_value(json["q"].clone()).unwrap();
            let written = Weights::new(law.is_position(), &q, json["r"].as_f64().unwrap()).unwrap();
            let specification = Specification { speed: Speed::Weights(written), ..specification };
            let given = design(&motor, &bench, law, &specification).unwrap();
            let values = |design: &Design| design.gains.iter().map(|gain| gain.value).collect::<Vec<_>>();
            assert_eq!(values(&given), values(&searched), "{law:?} {}", written.options());
            let set = |design: &Design, param| design.settings.all.get(param);
            for &param in searched.settings.changed.iter().filter(|param| **param != Param::PositionRange) {
                let (given, searched) = (set(&given, param), set(&searched, param));
                // The profile is slowed down in its own steps.
                let near = if param == Param::Acceleration { 0.5 } else { 1e-6 };
                assert!((given / searched - 1.0).abs() <= near || given == searched, "{law:?} {param:?}");
            }
            // Two times all weights is the same cost.
            let twice: Vec<f64> = q.iter().map(|weight| 2.0 * weight).collect();
            let twice = Weights::new(law.is_position(), &twice, 2.0 * written.r()).unwrap();
            let specification = Specification { speed: Speed::Weights(twice), ..specification };
            assert_eq!(values(&design(&motor, &bench, law, &specification).unwrap()), values(&searched), "{law:?}");
        }
    }
}

/// Given weights pass the same checks as searched ones.
#[test]
fn given_weights_are_checked() {
    let motor = MotorParameters::PIVT6;
    let refused = |law: ControlLaw, q: &[f64], r: f64, overshoot_percent: f64| {
        let speed = Speed::Weights(Weights::new(q.len() == 4, q, r).unwrap());
        let specification = Specification { speed, overshoot_percent, current_limit_a: 1.0 };
        design(&motor, &Bench::default(), law, &specification).unwrap_err().to_string()
    };
    for (message, expected) in [
        (refused(ControlLaw::SpeedLqr, &[0.0, 0.0, 1.0], 1e-6, 20.0), "is larger than its format holds"),
        (refused(ControlLaw::SpeedPid, &[0.0, 0.0, 1.0], 1e-3, 10.0), "is not robust"),
        (refused(ControlLaw::SpeedLqr, &[0.0, 0.0, 1e-9], 1.0, 10.0), "no gains with which a step settles within 20 s"),
        (
            refused(ControlLaw::SpeedLqr, &[1e30, 0.0, 1.0], 1.0, 10.0),
            "--q 1e30,0,1 --r 1 has no solution: the largest weight is",
        ),
        (
            refused(ControlLaw::SpeedLqr, &[1e-30, 0.0, 1e-30], 1.0, 10.0),
            "the largest weight is 1e30 times the smallest",
        ),
        (refused(ControlLaw::PositionPid, &[0.0, 0.0, 0.0, 3000.0], 1.0, 2.0), "overshoots by at least 36.7 %"),
        (refused(ControlLaw::PositionLqr, &[1.0, 0.0, 1.0], 1.0, 10.0), "the weights are those of a speed loop"),
    ] {
        println!("{message}");
        assert!(message.contains(expected), "{message}");
    }
}

/// A specification that cannot be met comes with one that can, and that one is met.
#[test]
fn what_can_be_met_is_met() {
    let bench = Bench::default();
    let asked = Specification { speed: Speed::BandwidthHz(80.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    let law = ControlLaw::SpeedPid;
    assert!(design(&MotorParameters::PIVT6, &bench, law, &asked).is_err());
    let met = fastest_possible(&MotorParameters::PIVT6, &bench, law, &asked).unwrap();
    assert!(matches!(met.speed, Speed::BandwidthHz(hz) if hz > 5.0 && hz < 80.0), "{:?}", met.speed);
    assert!(design(&MotorParameters::PIVT6, &bench, law, &met).is_ok());
}

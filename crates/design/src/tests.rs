use super::*;
use rayon::prelude::*;

fn pivt6(law: ControlLaw, hz: f64, overshoot_percent: f64) -> Result<Design, DesignError> {
    let specification = Specification { speed: Speed::BandwidthHz(hz), overshoot_percent, current_limit_a: 1.0 };
    design(&MotorParameters::PIVT6, &Bench::default(), law, &specification)
}

/// What each law reaches on the paper's motor. The figures are held so that a change of the method shows.
#[test]
fn every_law_for_the_papers_motor() {
    for (law, hz) in [
        (ControlLaw::SpeedPid, 10.0),
        (ControlLaw::SpeedLqr, 10.0),
        (ControlLaw::PositionPid, 5.0),
        (ControlLaw::PositionLqr, 5.0),
    ] {
        let design = pivt6(law, hz, 10.0).unwrap();
        println!("{law:?}: {:?} {:?} {:?}", design.figures, design.robustness, design.trial);
        assert!((0.99 * hz..1.05 * hz).contains(&design.figures.bandwidth_hz));
        assert!(design.figures.step.overshoot_percent <= 10.0);
        let margins = design.robustness.margins;
        assert!(margins.modulus > 0.8 && margins.delay_s > 20e-3, "{margins:?}");
        // What it is set to and what the core holds differ by the format's rounding alone.
        for gain in &design.gains {
            assert!((gain.value - gain.held).abs() <= 0.01 * gain.value.abs(), "{gain:?}");
        }
        assert!(design.trial.peak_a < 1.0 && design.trial.limited_part == 0.0);
    }
}

/// What the page overlays: the core in fixed point does what the linear loop does with the gains it holds.
#[test]
fn the_core_follows_the_linear_loop() {
    for (law, hz) in [
        (ControlLaw::SpeedPid, 10.0),
        (ControlLaw::SpeedLqr, 10.0),
        (ControlLaw::PositionPid, 5.0),
        (ControlLaw::PositionLqr, 5.0),
    ] {
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
        // What was checked has the observer in it, as the comparison's loop with the exact gains.
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

/// A model's delay is in the linear loop and on the core; gains that know nothing of it are not offered with it.
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

/// Between the core's trial and the linear loop, of the step.
fn farthest_from_linear(design: &Design, motor: &MotorParameters) -> f64 {
    let linear = design.linear_response(motor);
    let output = |point: &Point| if design.law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
    let differences = linear.iter().zip(&design.points).map(|(linear, point)| (linear - output(point)).abs());
    differences.fold(0.0, f64::max) / design.trial.step
}

/// Every line is one that the console reads, and both laws of a kind can be pasted one after the other.
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

/// What the console does with a line: all of it, if the core can hold what comes of it.
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

/// A slow motor: the range of speed that suits it fits neither the tachogenerator nor the gains that a new board has. Each
/// line is taken all the same, one after the other.
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
            "is larger than its format holds: check the model's inertia and torque constant, or lower current-limit-A",
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
            "the chip counts 100000: lower the supply or use a coarser encoder",
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

/// A flywheel: the gain that would make it fast is beyond the core's format.
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

/// A slow winding of much resistance asks for more volts an ampere than the format holds: the law goes without, and says so.
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
    // Where neither loop can be, it is the better one's reason.
    let refused = lqr(20.0).unwrap_err().to_string();
    assert!(refused.starts_with("lqr_speed_kc = ") && refused.contains("larger than its format holds"), "{refused}");
}

/// What the summary says of a load is what it does to the core's own loop; one with hardly any integral is found out.
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

/// Gains that stabilise the model alone are refused: each weakness is found.
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

/// The core's other rate.
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

/// An encoder of few counts is scaled more coarsely and not refused, however slow the motor.
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

/// Where motors are drawn from, two decades each, evenly in the logarithm: resistance in ohm, L/R in s, torque constant in
/// Nm/A, electromechanical time constant in s, viscous friction relative to what the back-EMF brakes.
const DECADES: [[f64; 2]; 5] = [[0.2, 20.0], [0.1e-3, 10e-3], [0.005, 0.5], [5e-3, 0.5], [1e-3, 1e-1]];

/// A motor somewhere in [`DECADES`], with an encoder that the chip can count and a specification that
/// suits its own time constant.
struct Draw {
    motor: MotorParameters,
    bench: Bench,
    current_limit_a: f64,
    /// Bandwidth over the motor's own.
    faster: f64,
    /// The five in [`DECADES`].
    drawn: [f64; 5],
}

impl Draw {
    fn new(seed: u64) -> Self {
        use rand::{RngExt, SeedableRng};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut decades = |[from, to]: [f64; 2]| from * (to / from).powf(random.random::<f64>());
        let drawn = DECADES.map(&mut decades);
        let [resistance_ohm, electromagnetic_s, torque_constant_nm_per_a, electromechanical_s, friction] = drawn;
        let stiffness = torque_constant_nm_per_a.powi(2) / resistance_ohm;
        let motor = MotorParameters {
            resistance_ohm,
            inductance_h: resistance_ohm * electromagnetic_s,
            torque_constant_nm_per_a,
            inertia_kg_m2: stiffness * electromechanical_s,
            viscous_friction_nm_s: stiffness * friction,
        };
        let supply_v = 12.0;
        let no_load_rad_per_s = supply_v / torque_constant_nm_per_a;
        let counts_per_rev = (80_000.0 * std::f64::consts::TAU / no_load_rad_per_s).min(2000.0).floor();
        let bench = Bench { supply_v, counts_per_rev: Some(counts_per_rev), ..Bench::default() };
        let current_limit_a = (0.7 * supply_v / resistance_ohm).min(specification::LARGEST_CURRENT_A);
        Self { motor, bench, current_limit_a, faster: decades([0.5, 5.0]), drawn }
    }

    /// The same motor, its speed by a tachogenerator that has between a fifth and nine tenths of the converter's range at no
    /// load, up to a tenth of ripple, and a commutator of 4 to 60 segments.
    fn with_tachogenerator(mut self, seed: u64) -> Self {
        use rand::{RngExt, SeedableRng};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(!seed);
        let mut between = |[from, to]: [f64; 2]| from + (to - from) * random.random::<f64>();
        let no_load_krpm =
            self.bench.supply_v / self.motor.torque_constant_nm_per_a * 60.0 / std::f64::consts::TAU / 1e3;
        let tachogenerator = Tachogenerator {
            gain_v_per_krpm: (10.0 * between([0.2, 0.9]) / no_load_krpm).min(100.0),
            ripple: between([0.0, 0.1]),
            ripples_per_rev: between([4.0, 60.0]).round(),
        };
        self.bench = Bench { counts_per_rev: None, tachogenerator: Some(tachogenerator), ..self.bench };
        self
    }

    fn design(&self, law: ControlLaw) -> Result<Design, DesignError> {
        design(&self.motor, &self.bench, law, &self.specification(law))
    }

    /// What [`Draw::design`] asks for.
    fn specification(&self, law: ControlLaw) -> Specification {
        let own_hz = 1.0
            / (std::f64::consts::TAU
                * motorbench_model::linear::motor_model::TimeConstants::of(&self.motor).electromechanical_s);
        let part = if law.is_position() { 0.5 } else { 1.0 };
        let hz = (part * self.faster * own_hz).min(40.0);
        Specification { speed: Speed::BandwidthHz(hz), overshoot_percent: 10.0, current_limit_a: self.current_limit_a }
    }

    /// The design that is refused for its reversal alone: gains and profile that have passed all else.
    fn design_that_may_lose_its_direction(&self, law: ControlLaw) -> Design {
        let specification = self.specification(law);
        let settings = fixed_point::rig_settings(&self.motor, &self.bench, &specification).unwrap();
        let speed = fixed_point::speed_path(&settings).unwrap();
        let seen = Seen { speed, ..Seen::by_encoder(1.0 / self.bench.tick_rate_hz) };
        let used = vec![true; law.feedback().len()];
        let search = Search { motor: &self.motor, law, seen, used: &used, observer: None };
        let rig = Rig { settings, tachogenerator: self.bench.tachogenerator };
        let tried = |shape| {
            let candidate = search.gentlest(shape, &specification).ok()?;
            tried(&self.motor, &rig, law, &specification, candidate).ok()
        };
        search.shapes().into_iter().find_map(tried).expect("one that the reversal was asked of")
    }

    /// Whether the firmware takes the wrong direction for the speed of this motor, from one of some speeds to their
    /// opposite.
    fn loses_its_direction(&self, design: &Design, motor: &MotorParameters) -> bool {
        let turns = |part: f64| {
            let plant = DcMotor::new(ideal(motor));
            let mut trial = Trial::new(plant, design.settings.all).unwrap();
            start(&mut trial, design.law, design.tachogenerator.as_ref());
            let duration_s = 1.0 + 2.0 * design.points.last().unwrap().t_s;
            for reference in [part * design.trial.step, -part * design.trial.step] {
                trial.follow(reference, duration_s);
            }
            trial.sample().trip == Trip::Runaway
        };
        [0.3, 0.4, 0.5, 0.6, 0.7].into_iter().any(turns)
    }

    /// Turns about (forward, reverse), and judges the last fifth of each.
    fn hold(&self, seed: u64, design: &Design, motor: &MotorParameters) {
        let motor = DcMotor::new(ideal(motor));
        let mut trial = Trial::new(motor, design.settings.all).unwrap();
        start(&mut trial, design.law, design.tachogenerator.as_ref());
        let duration_s = 1.0 + 2.0 * design.points.last().unwrap().t_s;
        for reference in [0.5 * design.trial.step, -0.5 * design.trial.step] {
            let points = trial.follow(reference, duration_s);
            assert_eq!(trial.sample().trip, Trip::None, "seed {seed}: {:?}", design.law);
            let tail = &points[points.len() * 4 / 5..];
            let output = |point: &Point| if design.law.is_position() { point.theta_rad } else { point.omega_rad_per_s };
            let worst = tail.iter().map(|point| (output(point) - reference).abs()).fold(0.0, f64::max);
            let allowed = self.allowed(design) + self.followed_ripple(design, reference);
            assert!(worst <= allowed, "seed {seed}: {:?} off by {worst}, allowed {allowed}", design.law);
        }
    }

    /// What of a tachogenerator's ripple, beaten down by the conversions, is slow enough for the loop to follow.
    fn followed_ripple(&self, design: &Design, speed_rad_per_s: f64) -> f64 {
        let Some(tachogenerator) = self.bench.tachogenerator else { return 0.0 };
        let converted_hz = tachogenerator::CONVERSIONS_HZ;
        let ripple_hz = tachogenerator.ripples_per_rev * speed_rad_per_s.abs() / std::f64::consts::TAU;
        let beat_hz = (ripple_hz - converted_hz * (ripple_hz / converted_hz).round()).abs();
        tachogenerator.ripple * speed_rad_per_s.abs() / (beat_hz / design.figures.bandwidth_hz).hypot(1.0)
    }

    /// Two bits of duty and a few of the measurement: nothing finer can be held.
    fn allowed(&self, design: &Design) -> f64 {
        let get = |param| f64::from(design.settings.all.get(param));
        let duty_v = self.bench.supply_v / f64::from(motorbench_core::HARDWARE.pwm_steps);
        if design.law.is_position() {
            return 3.0 * std::f64::consts::TAU / get(Param::CountsPerRev) + 2.0 * duty_v / design.held.reference;
        }
        let steps = self.bench.tachogenerator.map_or(0.0, |tacho| SETTLED_TACHO_STEPS * tacho.resolution_rad_per_s());
        2.0 * duty_v * motor_model::speed(&self.motor).dc_gain() + 8.0 * get(Param::SpeedRange) / 32768.0 + steps
    }
}

/// What the firmware would not see by a tachogenerator.
const REVERSAL: &str = "the reversal";

/// Why a design was refused, in a word.
fn reason(error: &DesignError) -> &'static str {
    match error {
        DesignError::Setting { .. } => "a setting the core cannot hold",
        DesignError::TooSlow { .. } => "not fast enough",
        DesignError::Overshoot { .. } => "overshoot",
        DesignError::Quantised { .. } => "gains rounded too much",
        DesignError::NotRobust { .. } => "not robust",
        DesignError::Trial { .. } => "fails on the core",
        DesignError::Tachogenerator { what } if what.starts_with("a reversal") => REVERSAL,
        other => panic!("no motor is drawn for this: {other}"),
    }
}

/// What a law was offered for, of how many motors.
#[derive(Default)]
struct Tally {
    offered: usize,
    refused: std::collections::BTreeMap<&'static str, usize>,
}

/// Random motors, both laws of both kinds, the LQRs with the current measured and observed: what is offered holds on the
/// core in closed loop, with the motor of the model and with one 30 % off in every parameter; and what is refused stays the
/// exception, for every law by itself.
#[test]
fn what_is_offered_is_stable_on_the_core() {
    const MOTORS: u64 = 40;
    let draws = || (0..MOTORS).map(Draw::new);
    for (at, [from, to]) in DECADES.into_iter().enumerate() {
        let decades = draws().map(|draw| (draw.drawn[at] / from).log10() / (to / from).log10());
        let [least, most] = decades.fold([1.0_f64, 0.0_f64], |[low, high], part| [low.min(part), high.max(part)]);
        assert!(least < 0.1 && most > 0.9, "parameter {at} is drawn from {least:.2} to {most:.2} of its decades alone");
    }
    let observed = [ControlLaw::SpeedLqr, ControlLaw::PositionLqr].map(|law| (law, false));
    let cases = [&ControlLaw::ALL.map(|law| (law, true))[..], &observed].concat();
    let cases = &cases;
    let results: Vec<(usize, Option<DesignError>)> = (0..MOTORS)
        .into_par_iter()
        .flat_map_iter(|seed| (0..cases.len()).map(move |case| (seed, case)))
        // An observer makes the loop larger and the search slower: every other motor.
        .filter(|(seed, case)| cases[*case].1 || seed % 2 == 0)
        .map(|(seed, case)| {
            let mut draw = Draw::new(seed);
            let (law, current_measured) = cases[case];
            draw.bench.current_measured = current_measured;
            // The design alone, without what other sensors would bring.
            let design = match best_shape(&draw.motor, &draw.bench, law, &draw.specification(law)) {
                Ok(design) => design,
                Err(error) => return (case, Some(error)),
            };
            let mut board = Settings::defaults();
            design.commands.iter().for_each(|line| paste(&mut board, line));
            draw.hold(seed, &design, &draw.motor);
            let corners: Vec<_> = robustness::corners(&draw.motor).collect();
            draw.hold(seed, &design, &corners[seed as usize % corners.len()]);
            (case, None)
        })
        .collect();
    let mut tallies: Vec<Tally> = cases.iter().map(|_| Tally::default()).collect();
    for (case, error) in &results {
        match error {
            None => tallies[*case].offered += 1,
            Some(error) => {
                println!("{error}");
                *tallies[*case].refused.entry(reason(error)).or_default() += 1;
            }
        }
    }
    for ((law, current_measured), Tally { offered, refused }) in cases.iter().zip(&tallies) {
        let current = if *current_measured { "" } else { ", the current observed" };
        let motors = offered + refused.values().sum::<usize>();
        println!("{}{current}: {offered} of {motors} offered; refused: {refused:?}", law.title());
        assert!(10 * offered >= 9 * motors && motors >= MOTORS as usize / 2, "{law:?}: {refused:?}");
    }
    let refused = results.iter().filter(|(_, error)| error.is_some()).count();
    assert!(refused * 20 <= results.len(), "{refused} of {} are refused", results.len());
}

/// What came of motors with a tachogenerator.
#[derive(Default)]
struct ByTachogenerator {
    /// By law.
    tallies: [Tally; 2],
    /// Of those refused for the reversal: how many lose their direction with a motor that is 30 % off.
    lost: usize,
}

/// Motors from seeds, each with a tachogenerator: what is offered turns about with the model's motor and two that are 30 %
/// off, and of what is refused for the reversal it is seen whether that would not.
fn by_tachogenerator(seeds: impl IntoParallelIterator<Item = u64>) -> ByTachogenerator {
    const LAWS: [ControlLaw; 2] = [ControlLaw::SpeedPid, ControlLaw::SpeedLqr];
    let draws = seeds.into_par_iter().flat_map_iter(|seed| LAWS.iter().enumerate().map(move |case| (seed, case)));
    let judged = draws.map(|(seed, (case, &law))| {
        let draw = Draw::new(seed).with_tachogenerator(seed);
        let corners: Vec<_> = robustness::corners(&draw.motor).collect();
        match draw.design(law) {
            Ok(design) => {
                let mut board = Settings::defaults();
                design.commands.iter().for_each(|line| paste(&mut board, line));
                for motor in [draw.motor, corners[seed as usize % 32], corners[31 - seed as usize % 32]] {
                    draw.hold(seed, &design, &motor);
                }
                (case, None, false)
            }
            Err(error) => {
                println!("seed {seed}: {error}");
                let reason = reason(&error);
                let loses = |design: &Design| corners.iter().any(|motor| draw.loses_its_direction(design, motor));
                let lost = reason == REVERSAL && loses(&draw.design_that_may_lose_its_direction(law));
                (case, Some(reason), lost)
            }
        }
    });
    let mut found = ByTachogenerator::default();
    for (case, reason, lost) in judged.collect::<Vec<_>>() {
        match reason {
            None => found.tallies[case].offered += 1,
            Some(reason) => *found.tallies[case].refused.entry(reason).or_default() += 1,
        }
        found.lost += usize::from(lost);
    }
    for (law, Tally { offered, refused }) in LAWS.iter().zip(&found.tallies) {
        println!("{} by a tachogenerator: {offered} offered; refused: {refused:?}", law.title());
    }
    let refused: usize = found.tallies.iter().filter_map(|tally| tally.refused.get(REVERSAL)).sum();
    println!("{} of {refused} refused for the reversal lose their direction with a motor 30 % off", found.lost);
    found
}

/// The sign turns only where a conversion sees the motor near standstill, with a voltage. What is offered turns about; what
/// is refused for the reversal would not.
#[test]
fn what_is_offered_by_a_tachogenerator_turns_about() {
    const MOTORS: u64 = 20;
    let found = by_tachogenerator(0..MOTORS);
    let offered: usize = found.tallies.iter().map(|tally| tally.offered).sum();
    assert!(offered >= MOTORS as usize && found.lost > 0, "{offered} {}", found.lost);
}

/// The same with freshly drawn motors.
#[test]
fn designs_for_freshly_drawn_tachogenerators_reverse() {
    const MOTORS: u64 = 6;
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let first = now.as_secs();
    println!("seeds from {first}");
    by_tachogenerator(first..first + MOTORS);
}

/// Weights that a search reports, written down and given by hand, are the same gains to the last bit: for every law, and
/// for motors far from the paper's.
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
                // The profile is as gentle as it must be, by steps of its own.
                let near = if param == Param::Acceleration { 0.5 } else { 1e-6 };
                assert!((given / searched - 1.0).abs() <= near || given == searched, "{law:?} {param:?}");
            }
            // Twice all weights are the same cost.
            let twice: Vec<f64> = q.iter().map(|weight| 2.0 * weight).collect();
            let twice = Weights::new(law.is_position(), &twice, 2.0 * written.r()).unwrap();
            let specification = Specification { speed: Speed::Weights(twice), ..specification };
            assert_eq!(values(&design(&motor, &bench, law, &specification).unwrap()), values(&searched), "{law:?}");
        }
    }
}

/// Weights that were given pass the same checks as those that were found.
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
        (refused(ControlLaw::SpeedPid, &[0.0, 0.0, 1.0], 1e-3, 10.0), "would not be robust"),
        (refused(ControlLaw::SpeedLqr, &[0.0, 0.0, 1e-9], 1.0, 10.0), "no gains with which a step settles within 20 s"),
        (
            refused(ControlLaw::SpeedLqr, &[1e30, 0.0, 1.0], 1.0, 10.0),
            "--q 1e30,0,1 --r 1 has no solution: the largest weight is",
        ),
        (
            refused(ControlLaw::SpeedLqr, &[1e-30, 0.0, 1e-30], 1.0, 10.0),
            "the largest weight is 1e30 times the smallest",
        ),
        (refused(ControlLaw::PositionPid, &[0.0, 0.0, 0.0, 3000.0], 1.0, 2.0), "overshoots by 36.7 %"),
        (refused(ControlLaw::PositionLqr, &[1.0, 0.0, 1.0], 1.0, 10.0), "the weights are those of a speed loop"),
    ] {
        println!("{message}");
        assert!(message.contains(expected), "{message}");
    }
}

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
        // With the same gains low-pass and conversion take what they delay from the margin: half a tick more than the mean
        // over a tick has, and 3.2 ms; less where the current, which they do not delay, is fed back as well.
        let margin_s =
            |sampling: &Sampling| robustness::check(&motor, law, sampling, &with_tacho.held).unwrap().margins.delay_s;
        let lost_s = margin_s(&with_encoder.sampling) - margin_s(&with_tacho.sampling);
        println!("{law:?}: conversion and low-pass take {:.2} ms of the delay margin", 1e3 * lost_s);
        let least_s = if law == ControlLaw::SpeedPid { 3.2e-3 } else { 2.9e-3 };
        assert!((least_s..3.9e-3).contains(&lost_s), "{lost_s}");
        assert!(with_tacho.robustness.margins.modulus > 0.6, "{:?}", with_tacho.robustness.margins);
        // What the ripple makes of the voltage is told, and the encoder has none.
        assert!(with_tacho.trial.swing_v > 2.0 * with_encoder.trial.swing_v, "{:?}", with_tacho.trial);
        let said = with_tacho.commands.join(" ");
        for expected in ["speed_sensor 1", "tacho_gain 3 ", "speed_filter 3.1831"] {
            assert!(said.contains(expected), "{expected}: {said}");
        }
        assert!(!said.contains("counts_per_rev") && with_encoder.commands.join(" ").contains("speed_sensor 0"));
    }
    // Both laws on one board have one low-pass.
    let [pid, lqr] = [ControlLaw::SpeedPid, ControlLaw::SpeedLqr]
        .map(|law| design(&motor, &stand(), law, &specification).unwrap().settings.all.get(Param::SpeedFilter));
    assert_eq!(pid, lqr);
}

/// What the loop's model says of the conversion is what the core does: to the ripple, and the conversion's age of half a tick
/// in the trial where the model has the worst of a whole.
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
        (refused(&stand(), ControlLaw::PositionPid), "the position PID needs an encoder, and the rig has none"),
        (refused(&none, ControlLaw::SpeedPid), "the speed PID needs an encoder, and the rig has none"),
        (refused(&Bench { supply_v: 30.0, ..stand() }, ControlLaw::SpeedLqr), "the converter ends at 332 rad/s"),
        (refused(&Bench { tick_rate_hz: 2000.0, ..stand() }, ControlLaw::SpeedPid), "use 1000 Hz"),
    ] {
        println!("{message}");
        assert!(message.contains(expected), "{message}");
    }
    // With an encoder for the position and the tachogenerator for the speed the firmware can.
    let both = Bench { counts_per_rev: Some(2000.0), ..stand() };
    let slow = Specification { speed: Speed::BandwidthHz(5.0), ..specification };
    for law in [ControlLaw::PositionPid, ControlLaw::PositionLqr] {
        let offered = design(&MotorParameters::PIVT6, &both, law, &slow).unwrap();
        assert!(offered.commands.join(" ").contains("speed_sensor 1"));
    }
}

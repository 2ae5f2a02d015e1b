//! Designs for motors drawn at random.

use super::*;
use crate::core_trial::{SETTLED_TACHO_STEPS, arm_in_mode};
use crate::tachogenerator::CONVERSIONS_HZ;
use host_sim::plant::DcMotor;
use host_sim::trial::Trial;
use motorbench_core::message::Trip;
use rayon::prelude::*;

/// Ranges of random motors, two decades each, uniform in the logarithm. They are resistance in ohm, L/R in s, torque
/// constant in Nm/A, electromechanical time constant in s. The last is viscous friction relative to the braking by the
/// back-EMF.
const DECADES: [[f64; 2]; 5] = [[0.2, 20.0], [0.1e-3, 10e-3], [0.005, 0.5], [5e-3, 0.5], [1e-3, 1e-1]];

/// A random motor in [`DECADES`]. Its encoder can be counted by the chip, and its specification suits its own time
/// constant.
struct Draw {
    motor: MotorParameters,
    bench: Bench,
    current_limit_a: f64,
    /// Requested bandwidth relative to the motor's own.
    faster: f64,
    /// The five random numbers in [`DECADES`].
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

    /// The same motor with a tachogenerator. At no load it uses a fifth to nine tenths of the converter's range. Its
    /// ripple is at most a tenth, with a commutator of 4 to 60 segments.
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

    /// The specification of [`Draw::design`].
    fn specification(&self, law: ControlLaw) -> Specification {
        let own_hz = 1.0
            / (std::f64::consts::TAU
                * motorbench_model::linear::motor_model::TimeConstants::of(&self.motor).electromechanical_s);
        let part = if law.is_position() { 0.5 } else { 1.0 };
        let hz = (part * self.faster * own_hz).min(40.0);
        Specification { speed: Speed::BandwidthHz(hz), overshoot_percent: 10.0, current_limit_a: self.current_limit_a }
    }

    /// The design that is refused only because of its reversal: its gains and profile have passed all other checks.
    fn design_that_may_lose_its_direction(&self, law: ControlLaw) -> Design {
        let specification = self.specification(law);
        let settings = fixed_point::rig_settings(&self.motor, &self.bench, &specification).unwrap();
        let speed = fixed_point::speed_path(&settings).unwrap();
        let timing = MotorTiming { speed, ..MotorTiming::by_encoder(1.0 / self.bench.tick_rate_hz) };
        let used = vec![true; law.feedback().len()];
        let search = Search { motor: &self.motor, law, timing, used: &used, observer: None };
        let rig = Rig { settings, tachogenerator: self.bench.tachogenerator };
        let tried = |shape| {
            let candidate = search.gentlest(shape, &specification).ok()?;
            quantised(&self.motor, &rig, law, &specification, candidate).ok()
        };
        search.shapes().into_iter().find_map(tried).expect("one that the reversal was asked of")
    }

    /// Whether the firmware takes the wrong sign for the speed of this motor during a reversal between some speeds.
    fn loses_its_direction(&self, design: &Design, motor: &MotorParameters) -> bool {
        let turns = |part: f64| {
            let plant = DcMotor::new(ideal(motor));
            let mut trial = Trial::new(plant, design.settings.all).unwrap();
            arm_in_mode(&mut trial, design.law, design.tachogenerator.as_ref());
            let duration_s = 1.0 + 2.0 * design.points.last().unwrap().t_s;
            for reference in [part * design.trial.step, -part * design.trial.step] {
                trial.follow(reference, duration_s);
            }
            trial.sample().trip == Trip::Runaway
        };
        [0.3, 0.4, 0.5, 0.6, 0.7].into_iter().any(turns)
    }

    /// Turns forward and in reverse, and checks the last fifth of each.
    fn hold(&self, seed: u64, design: &Design, motor: &MotorParameters) {
        let motor = DcMotor::new(ideal(motor));
        let mut trial = Trial::new(motor, design.settings.all).unwrap();
        arm_in_mode(&mut trial, design.law, design.tachogenerator.as_ref());
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

    /// The slow part of a tachogenerator's sampled ripple, which the loop can follow.
    fn followed_ripple(&self, design: &Design, speed_rad_per_s: f64) -> f64 {
        let Some(tachogenerator) = self.bench.tachogenerator else { return 0.0 };
        let converted_hz = CONVERSIONS_HZ;
        let ripple_hz = tachogenerator.ripples_per_rev * speed_rad_per_s.abs() / std::f64::consts::TAU;
        let beat_hz = (ripple_hz - converted_hz * (ripple_hz / converted_hz).round()).abs();
        tachogenerator.ripple * speed_rad_per_s.abs() / (beat_hz / design.figures.bandwidth_hz).hypot(1.0)
    }

    /// Two bits of duty and a few of the measurement limit what can be held.
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

/// A refusal because the firmware would miss the reversal with a tachogenerator.
const REVERSAL: &str = "the reversal";

/// Short name of the reason of a refusal.
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

/// Number of motors for which a law was offered.
#[derive(Default)]
struct Tally {
    offered: usize,
    refused: std::collections::BTreeMap<&'static str, usize>,
}

/// Motors of the long trial. The suite takes some of them.
const MOTORS: u64 = 40;

/// The motors are drawn from nearly all of their ranges.
#[test]
fn random_motors_fill_their_decades() {
    for (at, [from, to]) in DECADES.into_iter().enumerate() {
        let decades = (0..MOTORS).map(|seed| (Draw::new(seed).drawn[at] / from).log10() / (to / from).log10());
        let [least, most] = decades.fold([1.0_f64, 0.0_f64], |[low, high], part| [low.min(part), high.max(part)]);
        assert!(least < 0.1 && most > 0.9, "parameter {at} is drawn from {least:.2} to {most:.2} of its decades alone");
    }
}

/// Every fifth motor of the trial.
#[test]
fn what_is_offered_is_stable_on_the_core() {
    offered_designs_are_stable(&(0..MOTORS).step_by(5).collect::<Vec<_>>());
}

#[test]
#[ignore = "takes minutes: `scripts/trials motors`"]
fn what_is_offered_for_every_motor_is_stable_on_the_core() {
    offered_designs_are_stable(&(0..MOTORS).collect::<Vec<_>>());
}

/// Random motors with all four laws; the LQRs with the current measured and observed. An offered design works on the
/// core with the motor of the model, and with one that is 30 % off in every parameter. Refusals stay the exception for
/// every law.
fn offered_designs_are_stable(motors: &[u64]) {
    let observed = [ControlLaw::SpeedLqr, ControlLaw::PositionLqr].map(|law| (law, false));
    let cases = [&ControlLaw::ALL.map(|law| (law, true))[..], &observed].concat();
    let cases = &cases;
    let results: Vec<(usize, Option<DesignError>)> = motors
        .par_iter()
        .enumerate()
        .flat_map_iter(|(index, seed)| (0..cases.len()).map(move |case| (index, *seed, case)))
        // An observer makes the loop larger and the search slower, so only every other motor is tried.
        .filter(|(index, _, case)| cases[*case].1 || index % 2 == 0)
        .map(|(_, seed, case)| {
            let mut draw = Draw::new(seed);
            let (law, current_measured) = cases[case];
            draw.bench.current_measured = current_measured;
            // The design alone, without the comparison of sensors.
            let design = match best_design(&draw.motor, &draw.bench, law, &draw.specification(law)) {
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
        let tried = offered + refused.values().sum::<usize>();
        println!("{}{current}: {offered} of {tried} offered; refused: {refused:?}", law.title());
        assert!(10 * offered >= 9 * tried && tried >= motors.len() / 2, "{law:?}: {refused:?}");
    }
    let refused = results.iter().filter(|(_, error)| error.is_some()).count();
    assert!(refused * 20 <= results.len(), "{refused} of {} are refused", results.len());
}

/// Results for motors with a tachogenerator.
#[derive(Default)]
struct ByTachogenerator {
    /// Results by law.
    tallies: [Tally; 2],
    /// Among motors refused for the reversal: how many lose the sign with a motor that is 30 % off.
    lost: usize,
}

/// Motors from seeds, each with a tachogenerator. An offered design reverses with the model's motor and with two that
/// are 30 % off. For designs refused for the reversal it counts how many would fail.
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

/// The sign changes only if a conversion sees the motor near standstill, with a voltage. Offered designs reverse;
/// designs refused for the reversal would not.
fn offered_designs_reverse(seeds: Vec<u64>) {
    let motors = seeds.len();
    let found = by_tachogenerator(seeds);
    let offered: usize = found.tallies.iter().map(|tally| tally.offered).sum();
    assert!(offered >= motors && found.lost > 0, "{offered} {}", found.lost);
}

/// Some of the motors of the trial, with some that are refused for the reversal.
#[test]
fn what_is_offered_by_a_tachogenerator_turns_about() {
    offered_designs_reverse((0..6).collect());
}

#[test]
#[ignore = "takes minutes: `scripts/trials motors`"]
fn what_is_offered_by_every_tachogenerator_turns_about() {
    offered_designs_reverse((0..20).collect());
}

/// The same with freshly drawn motors.
#[test]
fn designs_for_freshly_drawn_tachogenerators_reverse() {
    const MOTORS: u64 = 4;
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let first = now.as_secs();
    println!("seeds from {first}");
    by_tachogenerator(first..first + MOTORS);
}

//! The stock PWM of an Uno, 490 Hz: the current goes up and down within each period, and a sketch reads it at any moment.
//! The bridge brakes or coasts between the pulses. And a fast PWM that is in step with the rows. The simulation shares nothing
//! with the models.

use crate::benches::in_turn;
use crate::{fresh_seed, less};
use motorbench_data::recording::Recording;
use motorbench_data::rig::Rig;
use motorbench_diagnosis::diagnose::diagnose;
use motorbench_diagnosis::diagnose::outcome::{Cause, Outcome, Verdict};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::fmt::Write as _;

const SUPPLY_V: f64 = 12.0;
const RESISTANCE_OHM: f64 = 5.0;
const INDUCTANCE_H: f64 = 2.5e-3;
const TORQUE_CONSTANT: f64 = 0.06;
const INERTIA_KG_M2: f64 = 3.5e-5;
const VISCOUS_NM_S: f64 = 5e-6;
const FRICTION_NM: f64 = 0.005;
const DROP_V: f64 = 1.4;
const DIODE_V: f64 = 0.8;
const COUNTS_PER_REV: f64 = 1200.0;
const STEP_S: f64 = 1e-5;
/// One step of a converter of 10 bits behind a sensor of 185 mV/A.
const STEP_A: f64 = 0.0264;

/// A whole number of periods in a row of one millisecond.
const FAST_HZ: f64 = 20_000.0;
const FAST_STEP_S: f64 = 1e-6;

/// What a rig file says of a bridge whose off phase coasts.
const COASTS: &str = "[bridge]\npwm_Hz = 490\ndecay = \"coast\"\n";

/// What the bridge does between the pulses.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Between {
    Brakes,
    Coasts,
}

/// How a timer makes a duty.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Timer {
    /// In software: a period begins with its pulse, and a command acts at once.
    Software,
    /// The pulse is in the middle of a period, and a command waits for the next one, as on the pins 9 and 10 of an Uno.
    PhaseCorrect,
}

struct Bench {
    timer: Timer,
    drop_v: f64,
    step_s: f64,
    /// Of the period that runs.
    duty: f64,
    pwm_hz: f64,
    /// Share of a period that has passed at time 0.
    phase: f64,
    /// Over which a program averages its readings.
    window_s: f64,
    lately_a: VecDeque<f64>,
    time_s: f64,
    current_a: f64,
    speed_rad_per_s: f64,
    angle_rad: f64,
}

impl Bench {
    /// At rest.
    fn new(timer: Timer, pwm_hz: f64, phase: f64) -> Self {
        Self {
            timer,
            drop_v: DROP_V,
            step_s: STEP_S,
            duty: 0.0,
            pwm_hz,
            phase,
            window_s: 0.0,
            lately_a: VecDeque::new(),
            time_s: 0.0,
            current_a: 0.0,
            speed_rad_per_s: 0.0,
            angle_rad: 0.0,
        }
    }

    /// Runs at a duty for some time.
    fn run(&mut self, between: Between, duty: f64, length_s: f64) {
        let step_s = self.step_s;
        for _ in 0..(length_s / step_s).round() as usize {
            let passed = (self.phase + self.time_s * self.pwm_hz).fract();
            if self.timer == Timer::Software || passed < step_s * self.pwm_hz {
                self.duty = duty;
            }
            let is_on = match self.timer {
                Timer::Software => passed < self.duty.abs(),
                Timer::PhaseCorrect => (passed - 0.5).abs() < 0.5 * self.duty.abs(),
            };
            self.current_a = self.current_after(between, is_on, self.duty);
            let torque_nm = TORQUE_CONSTANT * self.current_a - VISCOUS_NM_S * self.speed_rad_per_s;
            let free = self.speed_rad_per_s + step_s * torque_nm / INERTIA_KG_M2;
            self.speed_rad_per_s = less(free, step_s * FRICTION_NM / INERTIA_KG_M2);
            self.angle_rad += step_s * self.speed_rad_per_s;
            self.time_s += step_s;
            self.lately_a.push_back(self.current_a);
            self.lately_a.drain(..self.lately_a.len().saturating_sub((self.window_s / step_s) as usize));
        }
    }

    fn reading_a(&self) -> f64 {
        match self.lately_a.len() {
            0 => self.current_a,
            count => self.lately_a.iter().sum::<f64>() / count as f64,
        }
    }

    fn current_after(&self, between: Between, is_on: bool, duty: f64) -> f64 {
        let per_volt = self.step_s / INDUCTANCE_H;
        let own_v = -RESISTANCE_OHM * self.current_a - TORQUE_CONSTANT * self.speed_rad_per_s;
        let free = |source_v: f64| self.current_a + per_volt * (source_v + own_v);
        match (between, is_on) {
            (Between::Coasts, false) if self.current_a == 0.0 => 0.0,
            // Through the diodes against the supply until it is zero.
            (Between::Coasts, false) => {
                let way = self.current_a.signum();
                let next = free(-way * (SUPPLY_V + 2.0 * DIODE_V));
                if next * way > 0.0 { next } else { 0.0 }
            }
            _ => less(free(if is_on { SUPPLY_V.copysign(duty) } else { 0.0 }), per_volt * self.drop_v),
        }
    }
}

/// Duties of both signs for some time each, and a slow way through zero.
fn command(time_s: f64) -> f64 {
    const DUTIES: [i32; 16] = [0, 129, 60, 210, -139, 162, -128, 208, -26, -110, 120, -32, 103, 24, -223, 193];
    let duty = match time_s {
        ..8.0 => f64::from(DUTIES[(time_s / 0.5) as usize]),
        _ => 235.0 * (0.9 * time_s).sin(),
    };
    (duty.round() / 255.0 * 1e5).round() / 1e5
}

/// The same in whole steps of a fast PWM.
fn fast_command(time_s: f64) -> f64 {
    let steps = 1.0 / (FAST_HZ * FAST_STEP_S);
    (command(time_s) * steps).round() / steps
}

impl Bench {
    /// 12 s.
    fn table(
        self,
        between: Between,
        command: impl Fn(f64) -> f64,
        interval_s: f64,
        mut noise_a: impl FnMut() -> f64,
    ) -> String {
        let mut bench = self;
        let mut text = String::from("t_s,duty,counts,i_A\n");
        for row in 0..(12.0 / interval_s) as u32 {
            let time_s = f64::from(row) * interval_s;
            let counts = (bench.angle_rad / TAU * COUNTS_PER_REV).floor();
            let current = ((bench.reading_a() + noise_a()) / STEP_A).round() * STEP_A;
            let _ = writeln!(text, "{time_s:.5},{},{counts},{current:.4}", command(time_s));
            bench.run(between, command(time_s), interval_s);
        }
        text
    }
}

fn diagnosed(text: &str, bridge: &str) -> Outcome {
    let rig = format!(
        "[supply]\nvoltage_V = {SUPPLY_V}\n[encoder]\ncounts_per_rev = {COUNTS_PER_REV}\n[motor]\nresistance_ohm = 5.4\ninductance_H = 0.0025\ntorque_constant_Nm_per_A = 0.062\ninertia_kg_m2 = 3.3e-5\n{bridge}"
    );
    let recording = Recording::parse("run.csv", text.as_bytes(), &[]).unwrap();
    diagnose(&[recording], &Rig::parse("rig.toml", &rig).unwrap(), &|_| ()).unwrap().outcome
}

fn named<'a>(found: &'a Outcome, effect: &str) -> &'a Cause {
    let cause = found.causes.iter().find(|cause| cause.effect == effect);
    cause.unwrap_or_else(|| panic!("no {effect}: {found:?}"))
}

fn assert_near(what: &str, found: f64, expected: f64, share: f64) {
    assert!((found / expected - 1.0).abs() < share, "{what}: {found}, expected {expected}");
}

/// Some draws look like a bridge that drops less in the off phase. Behind such a bridge no recording shows the scale of the
/// voltages: then the interval has to know it.
fn assert_drop_told(case: &str, found: &Outcome) {
    let drop = named(found, "voltage_drop");
    if drop.parameters.contains_key("off_phase_V") {
        let [low, high] = drop.parameters["drop_V"].ci95.expect("it was fitted");
        assert!(low <= DROP_V && DROP_V <= high && high - low < DROP_V, "{case}: drop in {low} to {high}");
    } else {
        assert_near(&format!("{case}: drop"), drop.parameters["drop_V"].value, DROP_V, 0.15);
    }
}

/// The clock of the board is off by up to half a percent, and the recording begins anywhere in a period. Each current is a
/// mean over some conversions. They take between a third of `longest_s` and all of it.
fn assert_told(seed: u64, timer: Timer, between: Between, bridge: &str, longest_s: f64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let pwm_hz = 490.196 * random.random_range(0.995..1.005);
    let mut bench = Bench::new(timer, pwm_hz, random.random());
    bench.window_s = longest_s * random.random_range(0.33..1.0);
    let (hz, window_s) = (bench.pwm_hz, bench.window_s);
    let case = format!("seed {seed}, {timer:?}, {between:?}, {hz:.3} Hz, mean over {window_s:.5} s");
    let found = diagnosed(&bench.table(between, command, 0.0101, || 0.0), bridge);
    assert_near(
        &format!("{case}: friction"),
        named(&found, "coulomb_friction").parameters["torque_Nm"].value,
        FRICTION_NM,
        0.15,
    );
    if between == Between::Brakes {
        assert_drop_told(&case, &found);
    }
    let inductance_h = found.parameters["inductance_H"].value;
    assert_near(&format!("{case}: inductance"), inductance_h, INDUCTANCE_H, 0.15);
    assert_eq!(found.verdict, Verdict::Explained, "{case}: {found:?}");
    let advice = found.advice.join("\n");
    let told = advice.split("a PWM of ").nth(1).and_then(|rest| rest.split(" Hz").next()?.parse::<f64>().ok());
    // Half of the last digit, and what the estimate may be off by where that is rounded the other way.
    assert!(told.is_some_and(|told| (told - hz).abs() < 0.006), "{case}: {advice}");
    assert!(advice.contains("Average the current over a PWM period"), "{case}: {advice}");
}

/// The current of a moment is not the mean of a period. All is told all the same, and what to do.
#[test]
fn a_current_of_any_moment_at_490_hz() {
    let ways = [
        (Timer::Software, Between::Brakes, ""),
        (Timer::Software, Between::Coasts, COASTS),
        (Timer::PhaseCorrect, Between::Coasts, COASTS),
        (Timer::PhaseCorrect, Between::Brakes, ""),
    ];
    let seed = fresh_seed();
    for (timer, between, bridge) in in_turn(seed, 2, ways.into_iter()) {
        assert_told(seed, timer, between, bridge, 0.0);
    }
}

/// Several conversions of 112 us each, over a part of a period.
#[test]
fn a_current_that_is_a_mean_over_a_part_of_a_period() {
    assert_told(fresh_seed(), Timer::PhaseCorrect, Between::Brakes, "", 1.2e-3);
}

/// One clock makes the rows and a fast PWM: each reading is at the same place in a period. Whichever place, and wherever the
/// pulse is in its period, that is told from the current. Transistors without a drop, and diodes that coast.
#[test]
fn rows_in_step_with_a_fast_pwm() {
    let seed = fresh_seed();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let timer = if random.random() { Timer::Software } else { Timer::PhaseCorrect };
    let phase = random.random();
    let bench = Bench { drop_v: 0.0, step_s: FAST_STEP_S, ..Bench::new(timer, FAST_HZ, phase) };
    let case = format!("seed {seed}, {timer:?}, phase {phase:.3}");
    let table = bench.table(Between::Coasts, fast_command, 1e-3, || random.random_range(-0.02..0.02));
    let found = diagnosed(&table, &format!("[bridge]\npwm_Hz = {FAST_HZ}\n"));
    let torque_nm = named(&found, "coulomb_friction").parameters["torque_Nm"].value;
    assert_near(&format!("{case}: friction"), torque_nm, FRICTION_NM, 0.03);
    named(&found, "coast_decay");
    for (name, truth) in [("resistance_ohm", RESISTANCE_OHM), ("inertia_kg_m2", INERTIA_KG_M2)] {
        assert_near(&format!("{case}: {name}"), found.parameters[name].value, truth, 0.03);
    }
    assert_eq!(found.verdict, Verdict::Explained, "{case}: {found:?}");
}

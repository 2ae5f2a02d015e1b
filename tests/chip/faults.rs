//! Every half-broken encoder in every closed loop on the simulated chip. The drive is off before it can run away;
//! without a fault it stays on. `--ignored --nocapture every_fault` runs all combinations and writes
//! `docs/reference/safety.md`; what the suite runs is every ninth of them.

use crate::common::Uno;
use host_sim::plant::Bridge;
use motorbench_chip::EncoderFault;
use motorbench_core::message::Trip;
use motorbench_model::motor::MotorParameters;
use std::fmt::Write as _;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

const FAULTS: [(&str, EncoderFault); 8] = [
    ("A stuck high (open)", EncoderFault::AStuck(true)),
    ("A stuck low", EncoderFault::AStuck(false)),
    ("B stuck high (open)", EncoderFault::BStuck(true)),
    ("B stuck low", EncoderFault::BStuck(false)),
    ("A shorted to B", EncoderFault::Shorted),
    ("A noisy", EncoderFault::Noisy),
    ("A and B swapped", EncoderFault::Swapped),
    ("coupling slips", EncoderFault::Slipping),
];
const MODES: [&str; 4] = ["speed", "lqr_speed", "position", "lqr_position"];
/// Nominal load: with the friction it takes the continuous current of the bridge.
const LOAD_NM: f64 = 0.018;
/// The drive must be off within this time, or before the motor has turned so far at full duty, whichever is later.
const LATEST_S: f64 = 0.1;
const FARTHEST_AT_FULL_DUTY_RAD: f64 = std::f64::consts::PI;
/// Of the PWM's range, from which the duty counts as full.
const FULL_DUTY: f64 = 0.98;
/// How long is waited for a trip.
const WATCHED_S: f64 = 0.6;
/// The fault comes into a motion that lasts so long, or with the order to move.
const RUNNING_S: f64 = 0.4;
/// Truth every 100 us.
const ROW_CYCLES: u64 = 1_600;

#[derive(Clone, Copy)]
struct Case {
    fault: Option<usize>,
    mode: usize,
    forward: bool,
    loaded: bool,
    at_speed: bool,
    /// The board knows the motor's back-EMF constant.
    known: bool,
}

/// What came of it, from the fault on.
struct Outcome {
    trip: Trip,
    /// When the bridge was off.
    off_s: Option<f64>,
    /// By when it had to be.
    due_s: f64,
    speed_rad_per_s: f64,
    angle_rad: f64,
    full_duty_rad: f64,
}

fn cases(faults: impl Iterator<Item = Option<usize>>, known: bool) -> Vec<Case> {
    let both = [false, true];
    let mut cases = Vec::new();
    for fault in faults {
        for mode in 0..MODES.len() {
            for at_speed in both {
                for forward in both {
                    cases.extend(both.map(|loaded| Case { fault, mode, forward, loaded, at_speed, known }));
                }
            }
        }
    }
    cases
}

fn run(case: &Case) -> Outcome {
    let mut uno = Uno::start();
    let sign = if case.forward { 1.0 } else { -1.0 };
    let target = if MODES[case.mode].ends_with("speed") { 60.0 } else { 400.0 };
    uno.order("set cruise_speed 60");
    if case.known {
        uno.order(&format!("set torque_constant {}", MotorParameters::PIVT6.torque_constant_nm_per_a));
    }
    uno.order("arm");
    uno.order(&format!("mode {}", MODES[case.mode]));
    if case.loaded {
        uno.bench.set_load_torque_nm(sign * LOAD_NM);
    }
    let fault = case.fault.map(|fault| FAULTS[fault].1);
    if case.at_speed {
        uno.order(&format!("ref {}", sign * target));
        uno.run_s(RUNNING_S);
        assert_eq!(uno.last().trip, Trip::None, "before the fault");
    } else {
        uno.bench.set_encoder_fault(fault);
        uno.bench.serial().write(format!("ref {}\n", sign * target));
    }
    uno.bench.record(ROW_CYCLES);
    let begun = uno.bench.now();
    uno.bench.set_encoder_fault(fault);
    let tick = uno.last().tick;
    uno.run_s(WATCHED_S);
    let trip = uno.samples.iter().find(|sample| sample.tick >= tick && sample.trip != Trip::None);
    let mut outcome = Outcome {
        trip: trip.map_or(Trip::None, |sample| sample.trip),
        off_s: None,
        due_s: f64::INFINITY,
        speed_rad_per_s: 0.0,
        angle_rad: 0.0,
        full_duty_rad: 0.0,
    };
    let mut before_rad = begun.angle_rad;
    for row in uno.bench.take_recording() {
        let since_s = row.t_s - begun.t_s;
        if row.bridge == Bridge::Coast && since_s > 0.0 {
            outcome.off_s = Some(since_s);
            break;
        }
        outcome.speed_rad_per_s = outcome.speed_rad_per_s.max(row.speed_rad_per_s.abs());
        outcome.angle_rad = outcome.angle_rad.max((row.angle_rad - begun.angle_rad).abs());
        if row.duty.abs() >= FULL_DUTY {
            outcome.full_duty_rad += (row.angle_rad - before_rad).abs();
        }
        before_rad = row.angle_rad;
        if outcome.full_duty_rad >= FARTHEST_AT_FULL_DUTY_RAD && outcome.due_s.is_infinite() {
            outcome.due_s = since_s.max(LATEST_S);
        }
    }
    outcome
}

/// Runs them side by side.
fn run_all(cases: &[Case]) -> Vec<Outcome> {
    let next = AtomicUsize::new(0);
    let outcomes = Mutex::new(cases.iter().map(|_| None).collect::<Vec<_>>());
    let workers = std::thread::available_parallelism().map_or(2, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some((index, case)) = Some(next.fetch_add(1, Ordering::Relaxed))
                    .and_then(|index| cases.get(index).map(|case| (index, case)))
                {
                    let outcome = run(case);
                    outcomes.lock().expect("no panic")[index] = Some(outcome);
                }
            });
        }
    });
    outcomes.into_inner().expect("no panic").into_iter().map(|outcome| outcome.expect("an outcome")).collect()
}

fn name(case: &Case) -> String {
    format!(
        "{}, {}, {}, {}, {}, {}",
        case.fault.map_or("no fault", |fault| FAULTS[fault].0),
        MODES[case.mode],
        if case.at_speed { "at speed" } else { "from rest" },
        if case.forward { "forward" } else { "reverse" },
        if case.loaded { "loaded" } else { "unloaded" },
        if case.known { "back-EMF known" } else { "back-EMF not known" }
    )
}

/// What is wrong with an outcome.
fn complaint(case: &Case, outcome: &Outcome) -> Option<String> {
    let Outcome { trip, off_s, due_s, .. } = outcome;
    let wrong = match case.fault {
        None => *trip != Trip::None || off_s.is_some(),
        // Only the back-EMF shows that an encoder counts too few.
        Some(fault) if !case.known && FAULTS[fault].1 == EncoderFault::Slipping => false,
        Some(_) => *trip == Trip::None || off_s.is_none_or(|off_s| off_s > *due_s && off_s > LATEST_S),
    };
    wrong.then(|| {
        format!(
            "{}: {trip:?} off after {off_s:?} s, due {due_s} s; {:.0} rad/s, {:.1} rad, {:.1} rad at full duty",
            name(case),
            outcome.speed_rad_per_s,
            outcome.angle_rad,
            outcome.full_duty_rad
        )
    })
}

fn check(cases: &[Case], outcomes: &[Outcome]) {
    let complaints: Vec<String> =
        cases.iter().zip(outcomes).filter_map(|(case, outcome)| complaint(case, outcome)).collect();
    assert!(complaints.is_empty(), "{} of {}:\n{}", complaints.len(), cases.len(), complaints.join("\n"));
}

#[test]
fn a_draw_of_all_faults_switches_the_drive_off_in_time() {
    let cases: Vec<Case> = [true, false]
        .into_iter()
        .flat_map(|known| {
            let faults = cases((0..FAULTS.len()).map(Some), known);
            let controls = cases([None].into_iter(), known);
            faults.into_iter().skip(usize::from(known)).step_by(9).chain(controls.into_iter().step_by(9))
        })
        .collect();
    let outcomes = run_all(&cases);
    check(&cases, &outcomes);
}

/// What a sound motor may do near standstill. It creeps at 1 rpm in its friction, or holds a position against a load
/// that changes its sign. A load may turn it back for a moment.
#[test]
fn motion_near_standstill_is_no_fault() {
    let runs_on = |what: &str, orders: &[&str], loads: &dyn Fn(usize) -> f64| {
        let mut uno = Uno::start();
        uno.order(&format!("set torque_constant {}", MotorParameters::PIVT6.torque_constant_nm_per_a));
        for order in orders {
            uno.order(order);
        }
        for part in 0..40 {
            uno.bench.set_load_torque_nm(loads(part));
            uno.run_s(0.05);
            assert_eq!(uno.last().trip, Trip::None, "{what}, {part}");
        }
    };
    runs_on("creeping", &["arm", "mode speed", "ref 0.105"], &|_| 0.0);
    let to_and_fro = |part: usize| if part.is_multiple_of(2) { 0.003 } else { -0.003 };
    runs_on("holding", &["arm", "mode position", "ref 0.003"], &to_and_fro);
    let now_and_then = |part: usize| if part % 10 == 5 { 0.06 } else { 0.0 };
    runs_on("turned back", &["set trip_continuous 1", "arm", "mode speed", "ref 10"], &now_and_then);
}

/// The table of the docs.
#[test]
#[ignore = "takes minutes, and writes docs/reference/safety.md: `scripts/trials faults`"]
fn every_fault_switches_the_drive_off_in_time() {
    let [known, unknown] = [true, false].map(|known| cases((0..FAULTS.len()).map(Some), known));
    let controls: Vec<Case> = [true, false].into_iter().flat_map(|known| cases([None].into_iter(), known)).collect();
    let [with, without, undisturbed] = [&known, &unknown, &controls].map(|cases| run_all(cases));
    let table = table(&known, &with, &without, controls.len());
    println!("{table}");
    check(&controls, &undisturbed);
    check(&known, &with);
    check(&unknown, &without);
    std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reference/safety.md"), table)
        .expect("docs/reference/safety.md");
}

/// The worst of both directions and both loads in one row.
fn table(cases: &[Case], known: &[Outcome], unknown: &[Outcome], controls: usize) -> String {
    let mut text = format!(
        "# What the trips do about a half-broken encoder\n\n\
         Measured on the simulated chip with the motor of the test stand: {} combinations of fault, mode, direction, load,\n\
         start and back-EMF known or not. In {controls} runs without a fault nothing trips. Each row is the worst of both\n\
         directions, with and without a load that takes the continuous current. The fault comes with the order to move (from\n\
         rest), or at 60 rad/s. `scripts/trials faults` writes this page.\n\n\
         The drive must be off within 100 ms, or before the motor has turned half a revolution at full duty, whichever is\n\
         later. Time, speed and angle are those until the bridge is off. In the last two columns `torque_constant` is 0: the\n\
         board does not know the back-EMF. Then nothing shows that a coupling slips. Set `resistance` and `torque_constant`;\n\
         `motorbench design` does it.\n\n\
         | fault | mode | start | trip | off after, ms | largest speed, rad/s | turned, rad | of it at full duty, rad \
         | trip, back-EMF not known | off after, ms |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
        2 * cases.len()
    );
    for ((group, known), unknown) in cases.chunks(4).zip(known.chunks(4)).zip(unknown.chunks(4)) {
        let first = &group[0];
        let worst = |value: fn(&Outcome) -> f64| known.iter().map(value).fold(0.0, f64::max);
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {:.0} | {:.1} | {:.1} | {} | {} |",
            FAULTS[first.fault.expect("a fault")].0,
            MODES[first.mode],
            if first.at_speed { "60 rad/s" } else { "rest" },
            trips(known),
            off_ms(known),
            worst(|outcome| outcome.speed_rad_per_s),
            worst(|outcome| outcome.angle_rad),
            worst(|outcome| outcome.full_duty_rad),
            trips(unknown),
            off_ms(unknown)
        );
    }
    text
}

/// The trips of a row.
fn trips(outcomes: &[Outcome]) -> String {
    let mut trips: Vec<String> = outcomes.iter().map(|outcome| format!("{:?}", outcome.trip)).collect();
    trips.sort();
    trips.dedup();
    trips.join(", ")
}

/// When the last of a row was off.
fn off_ms(outcomes: &[Outcome]) -> String {
    let times: Option<Vec<f64>> = outcomes.iter().map(|outcome| outcome.off_s).collect();
    times.map_or_else(|| "not".into(), |times| format!("{:.0}", 1e3 * times.into_iter().fold(0.0, f64::max)))
}

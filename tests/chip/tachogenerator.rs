//! The studies' stand on the real firmware. The Uno's encoder is unplugged, and the motor has friction behind an L293D.
//! A tachogenerator with ripple measures its speed. PID and LQR designed for it do what the simulated loop does.

use crate::common::Uno;
use host_sim::figures::{Figures, step_figures};
use host_sim::plant::ModelPlant;
use host_sim::scenario::reference::{Course, Reference};
use host_sim::scenario::{Load, Noise, Scenario};
use host_sim::trial::Point;
use motorbench_chip::{EncoderFault, Rig, Row, Tachogenerator as Sensor};
use motorbench_core::HARDWARE;
use motorbench_core::message::{Sample, Trip};
use motorbench_core::settings::{Param, Settings};
use motorbench_core::units::{AMPERE, FULL_RANGE};
use motorbench_design::law::ControlLaw;
use motorbench_design::specification::{Specification, Speed};
use motorbench_design::tachogenerator::Tachogenerator;
use motorbench_design::{Bench, Design, design};
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_model::motor::MotorParameters;

const TACHO: Tachogenerator = Tachogenerator { gain_v_per_krpm: 3.0, ripple: 0.05, ripples_per_rev: 22.0 };
const STRETCH_S: f64 = 0.8;
/// Time at rest before the first.
const BEFORE_S: f64 = 0.05;

/// What happens at the beginning of a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
    ReferenceRadPerS(f64),
    LoadNm(f64),
}

/// Up, down, a load and its end, and a reversal.
const COURSE: [Event; 5] = [
    Event::ReferenceRadPerS(60.0),
    Event::ReferenceRadPerS(30.0),
    Event::LoadNm(0.02),
    Event::LoadNm(0.0),
    Event::ReferenceRadPerS(-60.0),
];

/// Reference that holds in each stretch.
fn references() -> [f64; 5] {
    let mut last = 0.0;
    COURSE.map(|event| {
        if let Event::ReferenceRadPerS(value) = event {
            last = value;
        }
        last
    })
}

/// Friction and the bridge's drop are in the motor and not in the design.
fn motor() -> Model {
    let with = |model: Model, id, values| model.with(effect(id).expect("an effect of the catalogue"), values);
    let motor = with(Model::linear(MotorParameters::PIVT6), "coulomb_friction", vec![0.012]);
    with(motor, "voltage_drop", vec![1.6])
}

fn designed(law: ControlLaw) -> Design {
    let bench = Bench { counts_per_rev: None, tachogenerator: Some(TACHO), ..Bench::default() };
    let specification =
        Specification { speed: Speed::BandwidthHz(10.0), overshoot_percent: 10.0, current_limit_a: 1.0 };
    design(&MotorParameters::PIVT6, &bench, law, &specification).unwrap_or_else(|error| panic!("{error}"))
}

/// A board with no edges from its encoder: what it knows of the speed is the tachogenerator's.
fn stand() -> Uno<ModelPlant> {
    let sensor = Sensor {
        v_per_1000_rpm: TACHO.gain_v_per_krpm,
        ripple: TACHO.ripple,
        ripples_per_turn: TACHO.ripples_per_rev,
        ..Sensor::default()
    };
    let mut uno = Uno::with(Rig { tachogenerator: sensor, ..Rig::default() }, ModelPlant::new(motor()));
    uno.bench.set_encoder_fault(Some(EncoderFault::Unplugged));
    uno.listen();
    uno
}

/// The true speed at a tick, the rest as the firmware reports it.
fn point(truth: &Row, sample: &Sample, settings: &Settings) -> Point {
    let speed = f64::from(settings.get(Param::SpeedRange)) / f64::from(FULL_RANGE);
    Point {
        t_s: f64::from(sample.tick) * 1e-3,
        reference: f64::from(sample.reference) * speed,
        u_v: f64::from(sample.duty) / f64::from(HARDWARE.pwm_steps) * f64::from(settings.get(Param::SupplyVoltage)),
        measured_rad_per_s: f64::from(sample.speed) * speed,
        omega_rad_per_s: truth.speed_rad_per_s,
        theta_rad: truth.angle_rad,
        i_a: f64::from(sample.current) / f64::from(AMPERE),
        limited: false,
    }
}

/// The course on the chip: the design's lines over the serial port, then event after event; points tick by tick.
fn on_chip(design: &Design) -> Vec<Vec<Point>> {
    let mut uno = stand();
    design.commands.iter().for_each(|line| uno.order(line));
    uno.order("arm");
    uno.order(if design.law == ControlLaw::SpeedPid { "mode speed" } else { "mode lqr_speed" });
    let stretches = COURSE.map(|event| {
        match event {
            // Without waiting for the answer: what the motor does meanwhile belongs to the stretch.
            Event::ReferenceRadPerS(value) => uno.bench.serial().write(format!("ref {value}\n")),
            Event::LoadNm(torque_nm) => uno.bench.set_load_torque_nm(torque_nm),
        }
        let mut points = stretch(&mut uno, &design.settings.all);
        if matches!(event, Event::ReferenceRadPerS(_)) {
            // The console takes some ticks; the telemetry shows which was the first.
            let moved = points.iter().position(|point| point.reference != points[0].reference).expect("a reference");
            points.drain(..moved);
        }
        points
    });
    assert_eq!((uno.decoder.lost, uno.decoder.damaged, uno.last().counts), (0, 0, 0), "no frame lost, no edge counted");
    stretches.into()
}

fn stretch(uno: &mut Uno<ModelPlant>, settings: &Settings) -> Vec<Point> {
    let mut points = Vec::new();
    while points.len() < (STRETCH_S * 1e3) as usize {
        // A sample comes within a millisecond of its tick.
        let (truth, known) = (uno.bench.now(), uno.samples.len());
        uno.run_s(1e-3);
        for sample in &uno.samples[known..] {
            assert_eq!(sample.trip, Trip::None, "after {} ticks", points.len());
            points.push(point(&truth, sample, settings));
        }
    }
    points
}

/// The same course with the core on this computer, stretches as long as those on the chip.
fn in_simulation(design: &Design, lengths: &[usize]) -> Vec<Vec<Point>> {
    let starts: Vec<f64> = lengths
        .iter()
        .scan(BEFORE_S, |at, length| {
            let start = *at;
            *at += *length as f64 * 1e-3;
            Some(start)
        })
        .collect();
    let (mut references, mut loads) = (Vec::new(), Vec::new());
    for (&time_s, event) in starts.iter().zip(COURSE) {
        match event {
            Event::ReferenceRadPerS(value) => references.push(Reference { time_s, course: Course::Step { value } }),
            Event::LoadNm(torque_nm) => loads.push(Load { time_s, torque_nm }),
        }
    }
    let scenario = Scenario {
        duration_s: BEFORE_S + lengths.iter().sum::<usize>() as f64 * 1e-3,
        mode: design.law.mode(),
        model: motor(),
        model_file: None,
        settings: design.settings.all,
        references,
        loads,
        faults: Vec::new(),
        noise: Noise { tacho_ripple: TACHO.ripple, ..Noise::default() },
        expected_trip: Trip::None,
    };
    let outcome = scenario.run().unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(outcome.trip, Trip::None);
    let mut rest = &outcome.points[(BEFORE_S * 1e3).round() as usize..];
    lengths
        .iter()
        .map(|length| {
            let (stretch, later) = rest.split_at(*length);
            rest = later;
            stretch.to_vec()
        })
        .collect()
}

fn rms(of: impl ExactSizeIterator<Item = f64>) -> f64 {
    let number = of.len() as f64;
    (of.map(|value| value * value).sum::<f64>() / number).sqrt()
}

/// Largest error of a stretch.
fn worst(points: &[Point], reference: f64) -> f64 {
    points.iter().map(|point| (point.omega_rad_per_s - reference).abs()).fold(0.0, f64::max)
}

/// What the chip did, beside what the simulation says.
fn agrees(law: ControlLaw, event: Event, reference: f64, [measured, simulated]: [&[Point]; 2]) {
    let figures = |points: &[Point]| step_figures(points, |point| point.omega_rad_per_s, reference);
    let [chip, host] = [figures(measured), figures(simulated)];
    let [farthest, foretold] = [measured, simulated].map(|points| worst(points, reference));
    let apart = measured.iter().zip(simulated).map(|(chip, host)| chip.omega_rad_per_s - host.omega_rad_per_s);
    let misread = measured.iter().map(|chip| chip.measured_rad_per_s - chip.omega_rad_per_s);
    let [apart, misread] = [rms(apart), rms(misread)];
    let is_step = matches!(event, Event::ReferenceRadPerS(_));
    for (source, figures, farthest) in [("chip", &chip, farthest), ("simulated", &host, foretold)] {
        let Figures { rise_s, overshoot_percent, steady_error, iae, peak_a, .. } = *figures;
        let of_step = |value: Option<f64>, digits| match value {
            Some(value) if is_step => format!("{value:.digits$}"),
            _ => "-".into(),
        };
        println!(
            "| {} | {event:?} | {source} | {} | {} | {farthest:.1} | {:.2} | {iae:.2} | {peak_a:.2} |",
            law.title(),
            of_step(rise_s.map(|rise_s| 1e3 * rise_s), 0),
            of_step(overshoot_percent, 1),
            steady_error.unwrap_or(f64::NAN),
        );
    }
    println!("apart by {apart:.2} rad/s rms; the firmware reads the speed to {misread:.2} rad/s rms");
    let close = |[chip, host]: [Option<f64>; 2], by: f64| (chip.expect("reached") - host.expect("reached")).abs() <= by;
    let of = |figure: fn(&Figures) -> Option<f64>| [figure(&chip), figure(&host)];
    assert!(!is_step || close(of(|figures| figures.rise_s), 3e-3), "{chip:?} {host:?}");
    assert!(!is_step || close(of(|figures| figures.overshoot_percent), 0.5), "{chip:?} {host:?}");
    assert!(close(of(|figures| figures.steady_error), 0.05), "{chip:?} {host:?}");
    // The converter cuts off: a step of it at most is what the loop holds beside the reference.
    assert!(chip.steady_error.is_some_and(|error| error.abs() < TACHO.resolution_rad_per_s()), "{chip:?}");
    assert!((chip.iae / host.iae - 1.0).abs() < 0.05 && (farthest - foretold).abs() < 0.5, "{chip:?} {host:?}");
    assert!(apart < 0.3 && misread < 2.0, "{law:?}, {event:?}: {apart} {misread} rad/s");
}

#[test]
fn the_firmware_holds_and_turns_by_the_tachogenerator_as_simulated() {
    for law in [ControlLaw::SpeedPid, ControlLaw::SpeedLqr] {
        let design = designed(law);
        let measured = on_chip(&design);
        let simulated = in_simulation(&design, &measured.iter().map(Vec::len).collect::<Vec<_>>());
        for (at, reference) in references().into_iter().enumerate() {
            agrees(law, COURSE[at], reference, [&measured[at], &simulated[at]]);
        }
    }
}

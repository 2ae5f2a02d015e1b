//! Linear models and the Riccati solver, compared with SciPy, python-control, and the printed figures of the University
//! of Michigan's control tutorials. `tests/data/linear_reference.py` made the results.

use motorbench_design::law::ControlLaw;
use motorbench_design::observer::kalman_gain;
use motorbench_design::sampled_loop::{MotorTiming, SampledLoop, Sampling};
use motorbench_design::search::Search;
use motorbench_design::weights::Weights;
use motorbench_model::linear::frequency_response::bode;
use motorbench_model::linear::step_response::StepFigures;
use motorbench_model::linear::transfer_function::TransferFunction;
use motorbench_model::linear::{Matrix, eigenvalues, motor_model, riccati, spectral_radius};
use motorbench_model::motor::MotorParameters;
use nalgebra::Complex;
use serde::Deserialize;
use std::collections::BTreeMap;

#[derive(Deserialize)]
struct Reference {
    motors: BTreeMap<String, Motor>,
    michigan_speed_pid: Pid,
    michigan_position_pid: Pid,
    dare: Vec<Dare>,
    kalman: Kalman,
    weighted: Vec<Weighted>,
}

#[derive(Deserialize)]
struct Motor {
    parameters: BTreeMap<String, f64>,
    speed_poles: Vec<[f64; 2]>,
    current_zeros: Vec<[f64; 2]>,
    angle_poles: Vec<[f64; 2]>,
    speed_dc_gain: f64,
    current_dc_gain: f64,
    speed_step: Figures,
    bode: Vec<[f64; 3]>,
    #[serde(rename = "zoh_1ms_delay_0.2ms")]
    zoh: Zoh,
}

#[derive(Deserialize)]
struct Figures {
    rise_s: f64,
    settling_s: f64,
    overshoot_percent: f64,
}

#[derive(Deserialize)]
struct Zoh {
    a: Vec<Vec<f64>>,
    input_before: Vec<f64>,
    input_now: Vec<f64>,
}

#[derive(Deserialize)]
struct Pid {
    gains: [f64; 3],
    step: Figures,
    poles: Vec<[f64; 2]>,
}

#[derive(Deserialize)]
struct Dare {
    a: Vec<Vec<f64>>,
    b: Vec<Vec<f64>>,
    q: Vec<Vec<f64>>,
    r: Vec<Vec<f64>>,
    x: Vec<Vec<f64>>,
    k: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Kalman {
    process_noise: [f64; 2],
    measurement_noise: f64,
    gain: [f64; 2],
    poles: Vec<[f64; 2]>,
}

#[derive(Deserialize)]
struct Weighted {
    position: bool,
    q: Vec<f64>,
    r: f64,
    crossover_rad_per_s: f64,
    all_states: Vec<f64>,
    measured: Vec<f64>,
}

fn reference() -> Reference {
    serde_json::from_str(include_str!("data/linear_reference.json")).unwrap()
}

impl Motor {
    fn parameters(&self) -> MotorParameters {
        MotorParameters {
            resistance_ohm: self.parameters["R"],
            inductance_h: self.parameters["L"],
            torque_constant_nm_per_a: self.parameters["k"],
            inertia_kg_m2: self.parameters["J"],
            viscous_friction_nm_s: self.parameters["b"],
        }
    }
}

fn matrix(rows: &[Vec<f64>]) -> Matrix {
    Matrix::from_fn(rows.len(), rows[0].len(), |row, column| rows[row][column])
}

fn assert_close(what: &str, value: f64, expected: f64, relative: f64) {
    let scale = expected.abs().max(1e-12);
    assert!((value - expected).abs() <= relative * scale, "{what}: {value}, expected {expected}");
}

fn assert_roots(what: &str, roots: &[Complex<f64>], expected: &[[f64; 2]]) {
    assert_eq!(roots.len(), expected.len(), "{what}");
    for (root, [re, im]) in roots.iter().zip(expected) {
        let distance = (root - Complex::new(*re, *im)).norm();
        assert!(distance <= 1e-8 * root.norm().max(1.0), "{what}: {root}, expected {re} {im}");
    }
}

/// Step response by exact sampling, fine enough for times to four digits.
fn figures(system: &TransferFunction, end_s: f64) -> StepFigures {
    let period_s = end_s / 20_000.0;
    let response = system.state_space().discretise(period_s, 0.0).step_response(20_001);
    StepFigures::of(response.as_slice(), period_s, system.dc_gain()).unwrap()
}

fn assert_figures(what: &str, figures: &StepFigures, expected: &Figures) {
    assert_close(&format!("{what}: rise"), figures.rise_s, expected.rise_s, 2e-3);
    assert_close(&format!("{what}: settling"), figures.settling_s, expected.settling_s, 2e-3);
    assert!((figures.overshoot_percent - expected.overshoot_percent).abs() < 0.01, "{what}: {figures:?}");
}

#[test]
fn poles_zeros_gains_and_steps() {
    for (name, motor) in reference().motors {
        let parameters = motor.parameters();
        let speed = motor_model::speed(&parameters);
        assert_roots(&name, &speed.poles(), &motor.speed_poles);
        assert_roots(&name, &motor_model::armature(&parameters).poles(), &motor.speed_poles);
        assert_roots(&name, &motor_model::current(&parameters).zeros(), &motor.current_zeros);
        assert_roots(&name, &motor_model::angle(&parameters).poles(), &motor.angle_poles);
        assert_close(&name, speed.dc_gain(), motor.speed_dc_gain, 1e-12);
        assert_close(&name, motor_model::current(&parameters).dc_gain(), motor.current_dc_gain, 1e-12);
        let end_s = 3.0 * motor.speed_step.settling_s;
        assert_figures(&name, &figures(&speed, end_s), &motor.speed_step);
    }
}

#[test]
fn bode_data() {
    for (name, motor) in reference().motors {
        let speed = motor_model::speed(&motor.parameters());
        let points = bode(|omega| speed.at(Complex::new(0.0, omega)), motor.bode.iter().map(|[omega, ..]| *omega));
        for (point, [_, magnitude, phase_rad]) in points.iter().zip(&motor.bode) {
            assert_close(&name, point.magnitude, *magnitude, 1e-9);
            assert!((point.phase_rad - phase_rad).abs() < 1e-9, "{name}: {point:?}");
        }
    }
}

#[test]
fn zero_order_hold_with_a_delay() {
    for (name, motor) in reference().motors {
        let discrete = motor_model::armature(&motor.parameters()).discretise(1e-3, 0.2e-3);
        for row in 0..2 {
            for column in 0..2 {
                assert_close(&name, discrete.a[(row, column)], motor.zoh.a[row][column], 1e-8);
            }
            assert_close(&name, discrete.a[(row, 2)], motor.zoh.input_before[row], 1e-8);
            assert_close(&name, discrete.b[(row, 0)], motor.zoh.input_now[row], 1e-8);
        }
    }
}

/// Printed results of the tutorials: poles, settling, damping, state feedback, and PID designs that meet their
/// requirements.
#[test]
fn michigan_tutorials() {
    let reference = reference();
    let speed_motor = reference.motors["michigan_speed"].parameters();
    let speed = motor_model::speed(&speed_motor);
    for (pole, printed) in speed.poles().iter().zip([-2.0025, -9.9975]) {
        assert!((pole - printed).norm() < 5e-5, "{pole}");
    }
    let open = figures(&speed, 5.0);
    assert!((open.settling_s - 2.07).abs() < 0.005, "{open:?}");
    assert!((speed.dc_gain() - 0.0999).abs() < 5e-5);

    // State feedback for poles at -5 +- i, in their order of states (speed, current).
    let armature = motor_model::armature(&speed_motor);
    let gain = Matrix::from_row_slice(1, 2, &[12.99, -1.0]);
    assert_roots("feedback", &eigenvalues(&(&armature.a - &armature.b * gain)), &[[-5.0, -1.0], [-5.0, 1.0]]);

    let position = motor_model::angle(&reference.motors["michigan_position"].parameters());
    // Position with unity feedback: natural frequency and damping of the slow pair.
    let mut closed = position.clone();
    closed.denominator[3] += closed.numerator[0];
    let pair = closed.poles()[0];
    assert!((pair.norm() - 46.1).abs() < 0.05 && (-pair.re / pair.norm() - 0.643).abs() < 5e-4, "{pair}");

    // Their requirements: speed, 2 s and 5 %; position, 40 ms and 16 %.
    for (name, plant, design, end_s, settling_s, overshoot_percent) in [
        ("speed PID", &speed, &reference.michigan_speed_pid, 10.0, 2.0, 5.0),
        ("position PID", &position, &reference.michigan_position_pid, 0.2, 0.040, 16.0),
    ] {
        let [kp, ki, kd] = design.gains;
        let numerator: Vec<f64> = [kd, kp, ki].iter().map(|gain| gain * plant.numerator[0]).collect();
        let mut denominator = [plant.denominator.clone(), vec![0.0]].concat();
        let offset = denominator.len() - numerator.len();
        for (at, value) in numerator.iter().enumerate() {
            denominator[offset + at] += value;
        }
        let closed = TransferFunction { numerator, denominator };
        assert_roots(name, &closed.poles(), &design.poles);
        let figures = figures(&closed, end_s);
        assert_figures(name, &figures, &design.step);
        assert!(figures.settling_s < settling_s && figures.overshoot_percent < overshoot_percent, "{figures:?}");
    }
}

#[test]
fn riccati_equations() {
    for (index, case) in reference().dare.iter().enumerate() {
        let (a, b, q, r) = (matrix(&case.a), matrix(&case.b), matrix(&case.q), matrix(&case.r));
        let x = riccati::solve(&a, &b, &q, &r).unwrap();
        let expected = matrix(&case.x);
        assert!((&x - &expected).norm() < 1e-9 * expected.norm(), "case {index}: {x} {expected}");
        let k = riccati::feedback(&a, &b, &q, &r).unwrap();
        assert!((&k - matrix(&case.k)).norm() < 1e-8 * k.norm(), "case {index}");
        assert!(spectral_radius(&(&a - &b * k)) < 1.0, "case {index}");
    }
}

/// The current of the PIVT-6 estimated from its speed, sampled at 1 kHz.
#[test]
fn kalman_filter() {
    let expected = reference().kalman;
    let mut motor = motor_model::armature(&MotorParameters::PIVT6);
    motor.c = Matrix::from_row_slice(1, 2, &[1.0, 0.0]);
    let process = Matrix::from_diagonal(&nalgebra::DVector::from_row_slice(&expected.process_noise));
    let noise = Matrix::from_element(1, 1, expected.measurement_noise);
    let system = motor.discretise(1e-3, 0.0);
    let found = kalman_gain(&system, &process, &noise).unwrap();
    for (gain, expected) in found.iter().zip(expected.gain) {
        assert_close("gain", *gain, expected, 1e-8);
    }
    let poles = eigenvalues(&(&system.a - &system.a * found * &system.c));
    assert_roots("poles", &poles, &expected.poles);
}

/// Q and R given for the PIVT-6's sampled loop. The Riccati equation gives the feedback of all states. SciPy finds the
/// cheapest gains on the measured signals as a minimum of the cost.
#[test]
fn given_weights() {
    for case in reference().weighted {
        let law = if case.position { ControlLaw::PositionLqr } else { ControlLaw::SpeedLqr };
        let what = format!("{law:?} {:?} {}", case.q, case.r);
        let weights = Weights::new(case.position, &case.q, case.r).unwrap();
        let sampled = SampledLoop::new(&MotorParameters::PIVT6, law, &Sampling::new(1e-3, 0.0));
        let (a, b) = sampled.system();
        let full = riccati::feedback(a, b, &sampled.weights(&weights), &Matrix::identity(1, 1)).unwrap();
        let scale = full.amax();
        for (gain, expected) in full.iter().zip(&case.all_states) {
            assert!((gain - expected).abs() < 1e-8 * scale, "{what}: {full} {:?}", case.all_states);
        }
        let used = vec![true; law.feedback().len()];
        let motor = &MotorParameters::PIVT6;
        let search = Search { motor, law, timing: MotorTiming::by_encoder(1e-3), used: &used, observer: None };
        let candidate = search.candidate(&weights, 100.0).unwrap();
        assert_close(&what, candidate.crossover_rad_per_s, case.crossover_rad_per_s, 1e-6);
        for (gain, expected) in candidate.gains.feedback.iter().zip(&case.measured) {
            assert_close(&what, *gain, *expected, 1e-4);
        }
    }
}

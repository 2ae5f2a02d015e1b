//! The plant against reference solutions where it is stiff or discontinuous: error against step, order, bound.
//!
//! The reference is a classical Runge-Kutta method of steps far below every time constant. It looks by bisection for
//! the instant at which a sign term lets go or takes hold. It shares nothing with the plant. Run with `--nocapture` for
//! the tables.

use host_sim::plant::{Bridge, Inputs, ModelPlant, PeriodEnd, Plant, Pwm};
use motorbench_model::Model;
use motorbench_model::catalogue::effect;
use motorbench_model::motor::MotorParameters;

const MOTOR: MotorParameters = MotorParameters::PIVT6;
const PERIOD_S: f64 = 50e-6;
/// Free-wheeling diodes of the plant's bridge, both.
const DIODES_V: f64 = 2.6;

/// Bridge and how long.
type Phase = (Bridge, f64);

/// Speed and current at the end of each phase.
type Course = Vec<[f64; 2]>;

/// Sign-magnitude PWM with slow decay, a new duty each millisecond.
fn pwm(duties: impl Iterator<Item = f64>) -> Vec<Phase> {
    let period = |duty: f64| {
        let on = if duty < 0.0 { Bridge::Reverse } else { Bridge::Forward };
        [(on, PERIOD_S * duty.abs()), (Bridge::Brake, PERIOD_S * (1.0 - duty.abs()))]
    };
    duties.flat_map(|duty| (0..20).flat_map(move |_| period(duty))).collect()
}

/// The plant, each phase cut into `parts` steps.
fn plant(model: &Model, phases: &[Phase], parts: u32) -> Course {
    let mut plant = ModelPlant::new(model.clone());
    let course = phases.iter().map(|&(bridge, dt_s)| {
        for _ in 0..parts {
            plant.advance(dt_s / f64::from(parts), &Inputs { bridge, ..Inputs::default() });
        }
        [plant.speed_rad_per_s(), plant.current_a()]
    });
    course.collect()
}

/// Largest difference of speed and of current.
fn distance(a: &Course, b: &Course) -> [f64; 2] {
    let largest = |of: usize| a.iter().zip(b).map(|(a, b)| (a[of] - b[of]).abs()).fold(0.0, f64::max);
    [largest(0), largest(1)]
}

/// Coulomb friction, a drop and cogging, by Runge and Kutta with bisection.
struct Reference {
    motor: MotorParameters,
    friction_nm: f64,
    drop_v: f64,
    cogging_nm: f64,
    /// Speed, current, angle.
    x: [f64; 3],
}

const COGGING_PERIODS: f64 = 14.0;

/// Sign in which a quantity moves; 0: held at zero.
fn sign(value: f64, drive: f64, hold: f64) -> f64 {
    match (value != 0.0, drive.abs() > hold) {
        (true, _) => value.signum(),
        (false, true) => drive.signum(),
        (false, false) => 0.0,
    }
}

fn runge_kutta<const N: usize>(x: [f64; N], h: f64, rates: impl Fn(&[f64; N]) -> [f64; N]) -> [f64; N] {
    let plus = |k: &[f64; N], h: f64| std::array::from_fn(|index| x[index] + h * k[index]);
    let k1 = rates(&x);
    let k2 = rates(&plus(&k1, 0.5 * h));
    let k3 = rates(&plus(&k2, 0.5 * h));
    let k4 = rates(&plus(&k3, h));
    std::array::from_fn(|index| x[index] + h / 6.0 * (k1[index] + 2.0 * (k2[index] + k3[index]) + k4[index]))
}

impl Reference {
    fn at_rest(friction_nm: f64, drop_v: f64, cogging_nm: f64) -> Self {
        Self { motor: MOTOR, friction_nm, drop_v, cogging_nm, x: [0.0; 3] }
    }

    /// Torque of current and cogging.
    fn free_nm(&self, x: &[f64; 3]) -> f64 {
        self.motor.torque_constant_nm_per_a * x[1] - self.cogging_nm * (COGGING_PERIODS * x[2]).sin()
    }

    fn signs(&self, x: &[f64; 3], source_v: f64, drop_v: f64) -> [f64; 2] {
        let k = self.motor.torque_constant_nm_per_a;
        [sign(x[0], self.free_nm(x), self.friction_nm), sign(x[1], source_v - k * x[0], drop_v)]
    }

    fn after(&self, h: f64, signs: [f64; 2], source_v: f64, drop_v: f64) -> [f64; 3] {
        let m = &self.motor;
        runge_kutta(self.x, h, |x| {
            let torque_nm = self.free_nm(x) - m.viscous_friction_nm_s * x[0] - signs[0] * self.friction_nm;
            let voltage_v = source_v - m.resistance_ohm * x[1] - m.torque_constant_nm_per_a * x[0] - signs[1] * drop_v;
            [signs[0].abs() * torque_nm / m.inertia_kg_m2, signs[1].abs() * voltage_v / m.inductance_h, x[0]]
        })
    }

    /// Whether the state still belongs to the signs.
    fn holds(&self, x: &[f64; 3], signs: [f64; 2], source_v: f64, drop_v: f64) -> bool {
        let k = self.motor.torque_constant_nm_per_a;
        let stays = |sign: f64, value: f64, drive: f64, hold: f64| {
            if sign == 0.0 { drive.abs() <= hold } else { hold == 0.0 || sign * value >= 0.0 }
        };
        stays(signs[0], x[0], self.free_nm(x), self.friction_nm) && stays(signs[1], x[1], source_v - k * x[0], drop_v)
    }

    fn phase(&mut self, (bridge, dt_s): Phase, step_s: f64) -> [f64; 2] {
        let supply_v = Inputs::default().supply_v;
        let (source_v, drop_v) = match bridge {
            Bridge::Forward => (supply_v, self.drop_v),
            Bridge::Reverse => (-supply_v, self.drop_v),
            Bridge::Brake => (0.0, self.drop_v),
            Bridge::Coast => (0.0, supply_v + DIODES_V + self.drop_v),
        };
        let mut left_s = dt_s;
        while left_s > 1e-15 {
            let signs = self.signs(&self.x, source_v, drop_v);
            let mut h = step_s.min(left_s);
            let mut next = self.after(h, signs, source_v, drop_v);
            if !self.holds(&next, signs, source_v, drop_v) {
                let (mut inside, mut beyond) = (0.0, h);
                while beyond - inside > 1e-14 {
                    let middle = 0.5 * (inside + beyond);
                    let holds = self.holds(&self.after(middle, signs, source_v, drop_v), signs, source_v, drop_v);
                    *(if holds { &mut inside } else { &mut beyond }) = middle;
                }
                h = beyond;
                next = self.after(h, signs, source_v, drop_v);
                // What has just crossed zero is put there, for the next signs to hold it.
                for (x, sign) in next.iter_mut().zip(signs) {
                    *x = if sign * *x < 0.0 { 0.0 } else { *x };
                }
            }
            self.x = next;
            left_s -= h;
        }
        [self.x[0], self.x[1]]
    }

    fn course(mut self, phases: &[Phase], step_s: f64) -> Course {
        phases.iter().map(|&phase| self.phase(phase, step_s)).collect()
    }
}

fn with(model: &Model, id: &str, values: Vec<f64>) -> Model {
    model.with(effect(id).expect("an effect of the catalogue"), values)
}

/// The same model, but stepped by terms: what acts on the voltage is not solved event by event. The supply does not sag.
fn stepwise(model: &Model) -> Model {
    with(model, "supply_sag", vec![0.0])
}

/// Errors with phases in 1, 2, 4, 8, 16 steps, each within `bound` over the number of steps: of the first order at least.
///
/// Where the instant of an event falls within a step is chance, so that single orders scatter about one.
fn converges(name: &str, model: &Model, phases: &[Phase], reference: &Course, bound: [f64; 2]) {
    let errors = [1, 2, 4, 8, 16].map(|parts| (parts, distance(&plant(model, phases, parts), reference)));
    println!("{name}\n   steps a phase   rad/s        A            order (speed, current)");
    for (index, (parts, error)) in errors.iter().enumerate() {
        let order = |of: usize| index.checked_sub(1).map_or(f64::NAN, |last| (errors[last].1[of] / error[of]).log2());
        println!("   {parts:>13}   {:<10.3e}   {:<10.3e}   {:.2} {:.2}", error[0], error[1], order(0), order(1));
    }
    for (parts, error) in errors {
        let most = bound.map(|bound| bound / f64::from(parts));
        assert!(error[0] <= most[0] && error[1] <= most[1], "{name}, {parts} steps a phase: {error:?} of {most:?}");
    }
}

/// Voltage to and fro about standstill: breaks away, moves, stops and sticks.
fn to_and_fro() -> Vec<Phase> {
    pwm((0..200).map(|ms| 0.45 * (f64::from(ms) * 0.08).sin()))
}

#[test]
fn an_armature_far_faster_than_the_step() {
    let stiff = MotorParameters { inductance_h: 5.84e-6, ..MOTOR };
    let phases = pwm((0..20).map(|ms| if ms < 10 { 0.7 } else { -0.3 }));
    let reference = Reference { motor: stiff, ..Reference::at_rest(0.0, 0.0, 0.0) }.course(&phases, 0.1e-6);
    // A microsecond against steps of up to 35: linear, so exact at any step.
    for (name, model) in [("events", Model::linear(stiff)), ("terms", stepwise(&Model::linear(stiff)))] {
        for parts in [1, 4] {
            let error = distance(&plant(&model, &phases, parts), &reference);
            println!("stiff armature, by {name}, {parts} steps a phase: {:.1e} rad/s, {:.1e} A", error[0], error[1]);
            assert!(error[0] < 1e-9 && error[1] < 1e-9, "{error:?}");
        }
    }
}

#[test]
fn sticking_and_breaking_away() {
    let (friction_nm, drop_v) = (0.012, 1.8);
    let model = with(&with(&Model::linear(MOTOR), "coulomb_friction", vec![friction_nm]), "voltage_drop", vec![drop_v]);
    let phases = to_and_fro();
    let reference = Reference::at_rest(friction_nm, drop_v, 0.0).course(&phases, 2e-6);
    let moved = reference.iter().filter(|x| x[0] != 0.0).count();
    let stuck = reference.iter().filter(|x| x[0] == 0.0 && x[1] != 0.0).count();
    assert!(moved > 1000 && stuck > 100, "{moved} {stuck}");
    for parts in [1, 16] {
        let error = distance(&plant(&model, &phases, parts), &reference);
        println!("sticking, by events, {parts} steps a phase: {:.1e} rad/s, {:.1e} A", error[0], error[1]);
        assert!(error[0] < 1e-5 && error[1] < 1e-7, "{error:?}");
    }
    converges("sticking, by terms", &stepwise(&model), &phases, &reference, [0.02, 2e-4]);
}

#[test]
fn coasting_until_the_diodes_block() {
    let phases: Vec<Phase> = (0..40)
        .flat_map(|round| {
            let drive = if round % 3 == 0 { Bridge::Reverse } else { Bridge::Forward };
            let phase = |bridge, periods| std::iter::repeat_n((bridge, 0.93 * PERIOD_S), periods);
            phase(drive, 18).chain(phase(Bridge::Coast, 23))
        })
        .collect();
    let model = with(&with(&Model::linear(MOTOR), "voltage_drop", vec![1.8]), "coulomb_friction", vec![0.004]);
    let reference = Reference::at_rest(0.004, 1.8, 0.0).course(&phases, 2e-6);
    assert!(reference.iter().filter(|x| x[1] == 0.0).count() >= 40);
    let error = distance(&plant(&model, &phases, 1), &reference);
    println!("coasting, by events: {:.1e} rad/s, {:.1e} A", error[0], error[1]);
    assert!(error[0] < 1e-5 && error[1] < 1e-7, "{error:?}");
    converges("coasting, by terms", &stepwise(&model), &phases, &reference, [0.007, 4e-5]);
}

/// Two masses with a gap; the contact pushes and does not pull.
fn backlash_course(gap_rad: f64, share: f64, phases: &[Phase], step_s: f64) -> Course {
    let rate = std::f64::consts::TAU * 300.0;
    let j = MOTOR.inertia_kg_m2;
    let mut x = [0.0; 4];
    let supply_v = Inputs::default().supply_v;
    let rates = |[w, i, load, twist]: &[f64; 4], source_v: f64| {
        let depth = twist - twist.clamp(-0.5 * gap_rad, 0.5 * gap_rad);
        let push = share * (1.0 - share) * j * rate * (rate * depth + 0.8 * (w - load));
        let push = if depth > 0.0 {
            push.max(0.0)
        } else if depth < 0.0 {
            push.min(0.0)
        } else {
            0.0
        };
        let torque_nm = MOTOR.torque_constant_nm_per_a * i - MOTOR.viscous_friction_nm_s * w - push;
        let voltage_v = source_v - MOTOR.resistance_ohm * i - MOTOR.torque_constant_nm_per_a * w;
        [torque_nm / ((1.0 - share) * j), voltage_v / MOTOR.inductance_h, push / (share * j), w - load]
    };
    let mut course = Vec::new();
    for &(bridge, dt_s) in phases {
        let source_v = match bridge {
            Bridge::Forward => supply_v,
            Bridge::Reverse => -supply_v,
            Bridge::Brake | Bridge::Coast => 0.0,
        };
        let steps = (dt_s / step_s).ceil();
        for _ in 0..steps as usize {
            x = runge_kutta(x, dt_s / steps, |x| rates(x, source_v));
        }
        course.push([x[0], x[1]]);
    }
    course
}

#[test]
fn contact_through_backlash() {
    let model = with(&Model::linear(MOTOR), "backlash", vec![0.05, 0.4, 300.0, 0.4]);
    let phases = to_and_fro();
    let reference = backlash_course(0.05, 0.4, &phases, 0.2e-6);
    let finer = backlash_course(0.05, 0.4, &phases, 0.1e-6);
    println!("contact, reference against half its step: {:?}", distance(&reference, &finer));
    converges("contact, by terms", &model, &phases, &finer, [0.12, 3e-4]);
}

/// Held torques: of second order where the shaft turns, of first where it sticks and breaks away.
#[test]
fn cogging_beside_friction_and_drop() {
    let (friction_nm, drop_v, cogging_nm) = (0.006, 1.8, 0.004);
    let model = with(&with(&Model::linear(MOTOR), "coulomb_friction", vec![friction_nm]), "voltage_drop", vec![drop_v]);
    let model = with(&model, "cogging", vec![0.0, cogging_nm, COGGING_PERIODS]);
    let turning = pwm((0..200).map(|ms| 0.6 * (f64::from(ms) / 20.0).min(1.0)));
    for (name, phases, bound) in
        [("cogging, turning", turning, [1e-5, 1e-7]), ("cogging, to and fro", to_and_fro(), [1e-5, 1e-7])]
    {
        let reference = Reference::at_rest(friction_nm, drop_v, cogging_nm).course(&phases, 2e-6);
        converges(name, &model, &phases, &reference, bound);
    }
}

/// PWM periods taken at once as maps, and the same switched by hand. Tried are braking and coasting, both directions,
/// standstill, and the sample within the rest and within the pulse.
#[test]
fn whole_periods_are_their_parts() {
    let friction = with(&with(&Model::linear(MOTOR), "coulomb_friction", vec![0.006]), "voltage_drop", vec![1.8]);
    let cogging = with(&friction, "cogging", vec![0.0, 0.004, COGGING_PERIODS]);
    let linear = Model::linear(MOTOR);
    // Cogging is held for a period in the one, for a part of it in the other.
    for (name, model, bound) in
        [("linear", &linear, 1e-9), ("friction and drop", &friction, 1e-6), ("cogging", &cogging, 1e-4)]
    {
        let (mut at_once, mut by_hand) = (ModelPlant::new(model.clone()), ModelPlant::new(model.clone()));
        let mut largest = [0.0_f64; 3];
        for tick in 0..400 {
            let duty = 0.98 * (f64::from(tick) * 0.03).sin();
            let pwm = Pwm {
                pulse: if duty < 0.0 { Bridge::Reverse } else { Bridge::Forward },
                rest: if tick % 100 < 70 { Bridge::Brake } else { Bridge::Coast },
                pulse_s: PERIOD_S * duty.abs(),
                period_s: PERIOD_S,
                sampled_s: 0.965 * PERIOD_S,
            };
            let mut ends = [PeriodEnd::default(); 20];
            at_once.advance_pwm(&pwm, &Inputs::default(), &mut ends);
            for end in ends {
                let expected = by_hand.advance_period(&pwm, &Inputs::default());
                largest[0] = largest[0].max((end.angle_rad - expected.angle_rad).abs());
                largest[1] = largest[1].max((end.sampled_a - expected.sampled_a).abs());
            }
            largest[2] = largest[2].max((at_once.speed_rad_per_s() - by_hand.speed_rad_per_s()).abs());
        }
        println!(
            "{name}: angle {:.1e} rad, sampled current {:.1e} A, speed {:.1e} rad/s",
            largest[0], largest[1], largest[2]
        );
        assert!(largest.iter().all(|error| *error < bound), "{name}: {largest:?}");
        assert!(by_hand.angle_rad().abs() > 1.0, "{name} did not turn");
    }
}

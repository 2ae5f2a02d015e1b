//! The extended model as a plant: what a diagnosis has found, to run a loop against.

use super::dc_motor::Torques;
use super::{Bridge, BridgeLosses, DcMotor, DcMotorParameters, Inputs, Motion, PeriodEnd, Plant, Pwm};
use crate::catalogue::{ActsOn, Balance, Effect, Instant};
use crate::free_run::LinearStep;
use crate::model::{Model, Term};

/// Longest step; shorter ones are taken as they come.
const LONGEST_STEP_S: f64 = 50e-6;
/// Effects that a switched bridge brings about by itself, or that are not the motor's.
const NOT_THE_MOTORS: [&str; 2] = ["coast_decay", "actuation_delay"];

/// Effects that the event-exact motor has as well.
const EXACT: [&str; 2] = ["coulomb_friction", "voltage_drop"];

/// A motor with the effects of a model, at rest at first. Coulomb friction and the bridge's drop are solved event by event
/// ([`DcMotor`]), also under other torques that need no memory of their own (`Held`); everything else step by step. What
/// the model says of sensors and of timing is not part of it.
#[derive(Clone, Debug)]
pub struct ModelPlant(Solver);

#[derive(Clone, Debug)]
enum Solver {
    Exact(DcMotor),
    Held(Held),
    Stepwise(Stepwise),
}

#[derive(Clone, Debug)]
struct Stepwise {
    model: Model,
    bridge: BridgeLosses,
    inertia_kg_m2: f64,
    /// The lengths of the parts of PWM periods with and without a sample in them, used in turn.
    steps: [LinearStep; 4],
    states: Vec<Vec<f64>>,
    time_s: f64,
    angle_rad: f64,
    speed_rad_per_s: f64,
    current_a: f64,
    supply_v: f64,
}

impl ModelPlant {
    /// At rest, behind a bridge that loses what the model says.
    pub fn new(model: Model) -> Self {
        Self::behind(BridgeLosses::DIODES, model)
    }

    /// At rest, behind a bridge with losses of its own.
    pub fn behind(bridge: BridgeLosses, mut model: Model) -> Self {
        model.terms.retain(|term| Self::simulates(term.effect));
        let exact = |term: &Term| EXACT.contains(&term.id());
        let held = |term: &Term| term.effect.about().acts_on == ActsOn::Torque && term.effect.states() == 0;
        Self(if model.terms.iter().all(exact) {
            Solver::Exact(event_exact(bridge, &model))
        } else if model.terms.iter().all(|term| exact(term) || held(term)) {
            Solver::Held(Held::new(bridge, model))
        } else {
            Solver::Stepwise(Stepwise::new(bridge, model))
        })
    }

    /// Whether an effect is part of it.
    pub fn simulates(effect: &dyn Effect) -> bool {
        effect.acts_on_motor() && !NOT_THE_MOTORS.contains(&effect.about().id)
    }

    /// Becomes another motor while it turns: angle, speed and current stay, what effects remember is forgotten.
    pub fn replace(&mut self, bridge: BridgeLosses, model: Model) {
        let motion = Motion {
            angle_rad: self.angle_rad(),
            speed_rad_per_s: self.speed_rad_per_s(),
            current_a: self.current_a(),
        };
        *self = Self::behind(bridge, model);
        match &mut self.0 {
            Solver::Exact(motor) => motor.set_motion(motion),
            Solver::Held(held) => held.motor.set_motion(motion),
            Solver::Stepwise(motor) => {
                motor.angle_rad = motion.angle_rad;
                motor.speed_rad_per_s = motion.speed_rad_per_s;
                motor.current_a = motion.current_a;
            }
        }
    }
}

/// The event-exact motor under further torques, which are held for a PWM period, at most for [`LONGEST_STEP_S`].
#[derive(Clone, Debug)]
struct Held {
    motor: DcMotor,
    torques: FurtherTorques,
    time_s: f64,
}

impl Held {
    fn new(bridge: BridgeLosses, model: Model) -> Self {
        Self { motor: event_exact(bridge, &model), torques: FurtherTorques::of(model), time_s: 0.0 }
    }
}

/// Torques of effects that need no memory of their own.
#[derive(Clone, Debug)]
struct FurtherTorques {
    model: Model,
    /// Coulomb friction, to which they add.
    friction_nm: f64,
}

impl FurtherTorques {
    fn of(mut model: Model) -> Self {
        let friction_nm = sum(&model, "coulomb_friction");
        model.terms.retain(|term| !EXACT.contains(&term.id()));
        Self { model, friction_nm }
    }

    /// Of a step from this state and time on, with the angle in its middle.
    #[inline(always)]
    fn over(&self, step_s: f64, time_s: f64, state: &Motion, inputs: &Inputs) -> Torques {
        let at = Instant {
            time_s,
            // No torque knows of the bridge.
            voltage_v: 0.0,
            duty: 0.0,
            supply_v: inputs.supply_v,
            current_a: state.current_a,
            speed_rad_per_s: state.speed_rad_per_s,
            angle_rad: state.angle_rad + 0.5 * step_s * state.speed_rad_per_s,
            step_s,
        };
        let mut terms = Balance {
            torque_nm: -inputs.load_torque_nm,
            dry_forward_nm: self.friction_nm,
            dry_backward_nm: self.friction_nm,
            ..Balance::default()
        };
        for term in &self.model.terms {
            term.effect.contribute(&term.values, &self.model.motor, &at, &[], &mut terms);
        }
        // Friction that differs by direction is the same in both, and a load.
        let asymmetry_nm = 0.5 * (terms.dry_forward_nm - terms.dry_backward_nm);
        Torques {
            load_nm: asymmetry_nm + terms.viscous_nm_s * state.speed_rad_per_s - terms.torque_nm,
            friction_nm: (0.5 * (terms.dry_forward_nm + terms.dry_backward_nm)).max(0.0),
        }
    }
}

impl Plant for Held {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        let steps = (dt_s / LONGEST_STEP_S - 1e-9).ceil().max(1.0);
        let step_s = dt_s / steps;
        for _ in 0..steps as usize {
            let torques = self.torques.over(step_s, self.time_s, self.motor.motion(), inputs);
            self.motor.advance_under(step_s, inputs, torques);
            self.time_s += step_s;
        }
    }

    fn advance_pwm(&mut self, pwm: &Pwm, inputs: &Inputs, ends: &mut [PeriodEnd]) {
        let (torques, from_s) = (&self.torques, self.time_s);
        let at_s = |period: usize| from_s + period as f64 * pwm.period_s;
        self.motor.advance_pwm_under(pwm, inputs, ends, |period, state| {
            torques.over(pwm.period_s, at_s(period), state, inputs)
        });
        self.time_s = at_s(ends.len());
    }

    fn angle_rad(&self) -> f64 {
        self.motor.angle_rad()
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.motor.speed_rad_per_s()
    }

    fn current_a(&self) -> f64 {
        self.motor.current_a()
    }

    fn supply_v(&self) -> f64 {
        self.motor.supply_v()
    }
}

/// The first constants of all terms of an effect.
fn sum(model: &Model, id: &str) -> f64 {
    model.terms.iter().filter(|term| term.id() == id).map(|term| term.values[0]).sum()
}

/// The motor of a model, without other effects than [`EXACT`].
fn event_exact(bridge: BridgeLosses, model: &Model) -> DcMotor {
    let drop_v = sum(model, "voltage_drop");
    DcMotor::new(DcMotorParameters {
        resistance_ohm: model.motor.resistance_ohm,
        inductance_h: model.motor.inductance_h,
        torque_constant_nm_per_a: model.motor.torque_constant_nm_per_a,
        inertia_kg_m2: model.motor.inertia_kg_m2,
        viscous_friction_nms_per_rad: model.motor.viscous_friction_nm_s,
        coulomb_friction_nm: sum(model, "coulomb_friction"),
        // The drop is there whatever the bridge does; a coasting current flows through two diodes besides.
        bridge: BridgeLosses {
            drive_v: bridge.drive_v + drop_v,
            brake_v: bridge.brake_v + drop_v,
            diode_v: bridge.diode_v + 0.5 * drop_v,
        },
    })
}

impl Stepwise {
    fn new(bridge: BridgeLosses, model: Model) -> Self {
        let share: f64 = model.terms.iter().map(|term| term.effect.motor_share(&term.values)).product();
        Self {
            inertia_kg_m2: model.motor.inertia_kg_m2 * share,
            steps: [LinearStep::default(); 4],
            states: model.terms.iter().map(|term| vec![0.0; term.effect.states()]).collect(),
            model,
            bridge,
            time_s: 0.0,
            angle_rad: 0.0,
            speed_rad_per_s: 0.0,
            current_a: 0.0,
            supply_v: 0.0,
        }
    }

    /// The step of this length, computed if it is none of the last.
    fn linear_step(&mut self, step_s: f64) -> LinearStep {
        match self.steps.iter().find(|kept| (kept.step_s() - step_s).abs() <= 1e-12) {
            Some(kept) => *kept,
            None => {
                self.steps.rotate_right(1);
                self.steps[0] = LinearStep::new(&self.model.motor, self.inertia_kg_m2, step_s);
                self.steps[0]
            }
        }
    }

    fn step(&mut self, step_s: f64, inputs: &Inputs) {
        let linear = self.linear_step(step_s);
        let mut terms = Balance { torque_nm: -inputs.load_torque_nm, ..Balance::default() };
        let (duty, drop_v) = match inputs.bridge {
            Bridge::Forward => (1.0, self.bridge.drive_v),
            Bridge::Reverse => (-1.0, self.bridge.drive_v),
            Bridge::Brake => (0.0, self.bridge.brake_v),
            // The current flows on against the supply, through two diodes, until it is nothing.
            Bridge::Coast => (0.0, inputs.supply_v + 2.0 * self.bridge.diode_v),
        };
        terms.dry_drop_v = drop_v;
        let mut at = Instant {
            time_s: self.time_s,
            voltage_v: duty * inputs.supply_v,
            duty,
            supply_v: inputs.supply_v,
            current_a: self.current_a,
            speed_rad_per_s: self.speed_rad_per_s,
            angle_rad: self.angle_rad,
            step_s,
        };
        for (term, state) in self.model.terms.iter().zip(&self.states) {
            term.effect.contribute(&term.values, &self.model.motor, &at, state, &mut terms);
        }
        let before = self.speed_rad_per_s;
        (self.current_a, self.speed_rad_per_s) = linear.take(self.current_a, before, at.voltage_v, false, &terms);
        if inputs.blocked {
            self.speed_rad_per_s = 0.0;
        }
        self.angle_rad += 0.5 * (before + self.speed_rad_per_s) * step_s;
        self.time_s += step_s;
        at.current_a = self.current_a;
        at.speed_rad_per_s = self.speed_rad_per_s;
        for (term, state) in self.model.terms.iter().zip(&mut self.states) {
            term.effect.advance(&term.values, &self.model.motor, &at, state);
        }
    }
}

impl Plant for Stepwise {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        self.supply_v = inputs.supply_v;
        if dt_s <= 0.0 {
            return;
        }
        let steps = (dt_s / LONGEST_STEP_S - 1e-9).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(dt_s / steps, inputs);
        }
    }

    fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.speed_rad_per_s
    }

    fn current_a(&self) -> f64 {
        self.current_a
    }

    fn supply_v(&self) -> f64 {
        self.supply_v
    }
}

impl ModelPlant {
    fn plant(&self) -> &dyn Plant {
        match &self.0 {
            Solver::Exact(motor) => motor,
            Solver::Held(motor) => motor,
            Solver::Stepwise(motor) => motor,
        }
    }

    fn plant_mut(&mut self) -> &mut dyn Plant {
        match &mut self.0 {
            Solver::Exact(motor) => motor,
            Solver::Held(motor) => motor,
            Solver::Stepwise(motor) => motor,
        }
    }
}

impl Plant for ModelPlant {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        self.plant_mut().advance(dt_s, inputs);
    }

    fn advance_pwm(&mut self, pwm: &Pwm, inputs: &Inputs, ends: &mut [PeriodEnd]) {
        self.plant_mut().advance_pwm(pwm, inputs, ends);
    }

    fn angle_rad(&self) -> f64 {
        self.plant().angle_rad()
    }

    fn speed_rad_per_s(&self) -> f64 {
        self.plant().speed_rad_per_s()
    }

    fn current_a(&self) -> f64 {
        self.plant().current_a()
    }

    fn supply_v(&self) -> f64 {
        self.plant().supply_v()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::effect;
    use crate::motor::MotorParameters;

    /// Friction and bridge drop of the catalogue against the plant that finds every event exactly.
    #[test]
    fn agrees_with_the_event_exact_motor() {
        let model = Model::linear(MotorParameters::PIVT6)
            .with(effect("coulomb_friction").unwrap(), vec![0.01])
            .with(effect("voltage_drop").unwrap(), vec![2.0]);
        let bridge = BridgeLosses { drive_v: 0.3, brake_v: 0.2, ..BridgeLosses::DIODES };
        let (mut exact, mut plant) = (event_exact(bridge, &model), Stepwise::new(bridge, model));
        for period in 0..20_000 {
            let duty = [0.6, -0.4, 0.25, 0.0][period / 5_000];
            let on_s = 50e-6 * f64::abs(duty);
            let on = if duty < 0.0 { Bridge::Reverse } else { Bridge::Forward };
            for (bridge, dt_s) in [(on, on_s), (Bridge::Brake, 50e-6 - on_s)] {
                let inputs = Inputs { bridge, ..Inputs::default() };
                exact.advance(dt_s, &inputs);
                plant.advance(dt_s, &inputs);
            }
            assert!((exact.speed_rad_per_s() - plant.speed_rad_per_s).abs() < 0.05, "period {period}");
            assert!((exact.current_a() - plant.current_a).abs() < 0.01, "period {period}");
        }
    }

    /// From one solver to the other and back: nothing jumps, and the new constants act.
    #[test]
    fn becomes_another_motor_while_it_turns() {
        let free = Model::linear(MotorParameters::PIVT6);
        let cogging = free.with(effect("cogging").unwrap(), vec![1e-4, 0.0, 7.0]);
        let heavy = free.with(effect("coulomb_friction").unwrap(), vec![0.02]);
        let mut plant = ModelPlant::new(free);
        let inputs = Inputs { bridge: Bridge::Forward, ..Inputs::default() };
        let run = |plant: &mut ModelPlant| (0..20_000).for_each(|_| plant.advance(50e-6, &inputs));
        run(&mut plant);
        let free_rad_per_s = plant.speed_rad_per_s();
        for model in [cogging, heavy] {
            let before = (plant.angle_rad(), plant.speed_rad_per_s(), plant.current_a());
            plant.replace(BridgeLosses::DIODES, model);
            assert_eq!(before, (plant.angle_rad(), plant.speed_rad_per_s(), plant.current_a()));
            run(&mut plant);
        }
        // Friction takes R c / k^2 of the speed.
        let expected = free_rad_per_s - 5.84 * 0.02 / (0.072 * 0.072 + 5.84 * 5e-6);
        assert!((plant.speed_rad_per_s() - expected).abs() < 0.01, "{} {expected}", plant.speed_rad_per_s());
    }
}

//! The extended model as a plant: runs a loop with the model of a diagnosis.

use super::dc_motor::Torques;
use super::{Bridge, BridgeLosses, DcMotor, DcMotorParameters, Inputs, Motion, PeriodEnd, Plant, Pwm};
use motorbench_model::catalogue::{ActsOn, Balance, DryLosses, Effect, Instant, Wave};
use motorbench_model::motor::MotorParameters;
use motorbench_model::{Input, LinearStep};
use motorbench_model::{Model, Term};

/// Longest step; shorter ones are taken as they come.
const LONGEST_STEP_S: f64 = 50e-6;
/// Time constant of the capacitor at the bridge: some tenths of an ohm and some millifarads.
const CAPACITOR_S: f64 = 1e-3;
/// A motor with the effects of a model, at rest at first. Coulomb friction and the bridge's drop are solved event by
/// event ([`DcMotor`]), also under other torques and in a winding that warms up (`Held`). All other effects are solved
/// step by step. Effects of sensors and of timing are not part of it.
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
    mean_duty: f64,
}

impl ModelPlant {
    /// At rest, behind a bridge with the losses of the model.
    pub fn new(model: Model) -> Self {
        Self::behind(BridgeLosses::DIODES, model)
    }

    /// At rest, behind a bridge with losses of its own.
    pub fn behind(bridge: BridgeLosses, mut model: Model) -> Self {
        model.terms.retain(|term| Self::simulates(term.effect));
        model.terms.sort_by_key(Term::turn);
        let held = |term: &Term| {
            let about = term.effect.about();
            about.acts_on == [ActsOn::Torque] || about.is_slow_resistance
        };
        Self(if model.terms.iter().all(is_exact) {
            Solver::Exact(event_exact(bridge, &model))
        } else if model.terms.iter().all(|term| is_exact(term) || held(term)) {
            Solver::Held(Held::new(bridge, model))
        } else {
            Solver::Stepwise(Stepwise::new(bridge, model))
        })
    }

    /// Whether an effect is part of it.
    pub fn simulates(effect: &dyn Effect) -> bool {
        effect.acts_on_motor() && !effect.is_of_switching()
    }

    /// Changes the motor while it turns: angle, speed and current stay, the memory of the effects is cleared.
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
}

impl Held {
    fn new(bridge: BridgeLosses, model: Model) -> Self {
        Self { motor: event_exact(bridge, &model), torques: FurtherTorques::of(model) }
    }

    /// Sets the resistance of the warm winding.
    #[inline(always)]
    fn warm_up(&mut self) {
        if !self.torques.warms_up {
            return;
        }
        let (now_ohm, was_ohm) = (self.torques.resistance_ohm(), self.motor.parameters().resistance_ohm);
        if (now_ohm / was_ohm - 1.0).abs() > RESISTANCE_STEP {
            self.motor.set_resistance_ohm(now_ohm);
        }
    }
}

/// Relative change of the resistance below which it is taken as constant: a few ticks of a winding that warms up.
const RESISTANCE_STEP: f64 = 1e-5;

/// Torques of effects, and their memory.
#[derive(Clone, Debug)]
struct FurtherTorques {
    motor: MotorParameters,
    /// Coulomb friction, to which they add.
    friction_nm: f64,
    waves: Vec<FollowedWave>,
    /// All other effects, and their states.
    terms: Vec<(Term, Vec<f64>)>,
    /// Whether any of them has a state, and whether any acts on the resistance.
    remembers: bool,
    warms_up: bool,
    inertia_kg_m2: f64,
    time_s: f64,
    step: Step,
}

/// Inputs of the effects' memory for the current step.
#[derive(Clone, Copy, Debug, Default)]
struct Step {
    length_s: f64,
    /// The pulse's part of it.
    pulse_part: f64,
    /// Current at its start.
    start_a: f64,
}

impl FurtherTorques {
    fn of(model: Model) -> Self {
        let others = model.terms.iter().filter(|term| !is_exact(term));
        let (waves, terms): (Vec<_>, Vec<_>) = others.partition(|term| term.effect.wave(&term.values).is_some());
        let with_state = |term: &Term| (term.clone(), vec![0.0; term.effect.states()]);
        Self {
            friction_nm: exact_losses(&model).friction_forward_nm,
            waves: waves.iter().filter_map(|term| term.effect.wave(&term.values)).map(FollowedWave::new).collect(),
            remembers: terms.iter().any(|term| term.effect.states() > 0),
            warms_up: terms.iter().any(|term| term.effect.about().is_slow_resistance),
            terms: terms.into_iter().map(with_state).collect(),
            inertia_kg_m2: motor_inertia_kg_m2(&model),
            motor: model.motor,
            time_s: 0.0,
            step: Step::default(),
        }
    }

    /// Of a step from this state on, with the angle in its middle. `pulse_a`: the current at the end of the last pulse.
    #[inline(always)]
    fn over(&mut self, step_s: f64, pulse_part: f64, (start, pulse_a): (&Motion, f64), inputs: &Inputs) -> Torques {
        if self.remembers {
            self.remember(start, pulse_a);
            self.step = Step { length_s: step_s, pulse_part, start_a: start.current_a };
        }
        let step_rad = step_s * start.speed_rad_per_s;
        let angle_rad = start.angle_rad + 0.5 * step_rad;
        let waves_nm: f64 = self.waves.iter_mut().map(|wave| wave.torque_nm(angle_rad, step_rad)).sum();
        let torque_nm = waves_nm - inputs.load_torque_nm;
        if self.terms.is_empty() {
            return Torques { load_nm: -torque_nm, friction_nm: self.friction_nm };
        }
        let at = self.instant(step_s, &Motion { angle_rad, ..*start }, inputs.supply_v);
        self.of_terms(&at, torque_nm)
    }

    fn instant(&self, step_s: f64, state: &Motion, supply_v: f64) -> Instant {
        Instant {
            time_s: self.time_s,
            // No torque depends on the bridge.
            voltage_v: 0.0,
            duty: 0.0,
            mean_duty: 0.0,
            supply_v,
            // So the current is taken as it is.
            open: true,
            current_a: state.current_a,
            speed_rad_per_s: state.speed_rad_per_s,
            angle_rad: state.angle_rad,
            turned_rad: 0.0,
            step_s,
        }
    }

    /// Beside a torque.
    fn of_terms(&mut self, at: &Instant, torque_nm: f64) -> Torques {
        let mut terms = Balance {
            torque_nm,
            dry_forward_nm: self.friction_nm,
            dry_backward_nm: self.friction_nm,
            ..Balance::default()
        };
        for (term, state) in &mut self.terms {
            term.effect.contribute(&term.values, &self.motor, at, state, &mut terms);
        }
        // Friction that differs by direction is the same in both, and a load.
        let asymmetry_nm = 0.5 * (terms.dry_forward_nm - terms.dry_backward_nm);
        // Damping in the middle of the step, of the speed that it leaves there: stable however strong it is.
        let damping_nm_s = terms.viscous_nm_s / (1.0 + 0.5 * at.step_s * terms.viscous_nm_s / self.inertia_kg_m2);
        Torques {
            load_nm: asymmetry_nm + damping_nm_s * at.speed_rad_per_s - terms.torque_nm,
            friction_nm: (0.5 * (terms.dry_forward_nm + terms.dry_backward_nm)).max(0.0),
        }
    }

    /// Ends the last step, if there is one: updates the effects' memory over it.
    fn remember(&mut self, end: &Motion, pulse_a: f64) {
        if self.step.length_s <= 0.0 {
            return;
        }
        let Step { length_s, pulse_part, start_a } = std::mem::take(&mut self.step);
        let mut at = self.instant(length_s, end, 0.0);
        // Linear from the start to the end of the pulse and on to the end of the period; the square of the current
        // heats.
        let line = |from: f64, to: f64| (from * from + from * to + to * to) * (1.0 / 3.0);
        let square = pulse_part * line(start_a, pulse_a) + (1.0 - pulse_part) * line(pulse_a, end.current_a);
        at.current_a = square.sqrt().copysign(end.current_a);
        for (term, state) in &mut self.terms {
            term.effect.advance(&term.values, &self.motor, &at, state);
        }
    }

    /// Of the winding.
    fn resistance_ohm(&mut self) -> f64 {
        let mut terms = Balance::default();
        let at = self.instant(LONGEST_STEP_S, &Motion::default(), 0.0);
        for (term, state) in self.terms.iter_mut().filter(|(term, _)| term.effect.about().is_slow_resistance) {
            term.effect.contribute(&term.values, &self.motor, &at, state, &mut terms);
        }
        self.motor.resistance_ohm + terms.resistance_ohm
    }
}

/// A wave along the angle. The angle a step later is nearly known now: its sine and cosine are computed ahead, in
/// parallel with the step, and the remaining way is a small correction.
#[derive(Clone, Copy, Debug)]
struct FollowedWave {
    wave: Wave,
    /// An angle at which the wave was evaluated by sine and cosine: there, and a quarter of a period on.
    anchor_rad: f64,
    at_anchor_nm: [f64; 2],
    /// The same, where the shaft was expected to be.
    expected_rad: f64,
    at_expected_nm: [f64; 2],
}

impl FollowedWave {
    /// Largest phase from the anchor: what follows the series' last terms is below 2e-12 of the amplitude.
    const REACH: f64 = 0.3;
    /// Largest phase from where the shaft was expected: what follows the square is below 2e-11 of the amplitude.
    const NEAR: f64 = 5e-4;

    fn new(wave: Wave) -> Self {
        let at_zero_nm = Self::by_sine_and_cosine(&wave, 0.0);
        Self { wave, anchor_rad: 0.0, at_anchor_nm: at_zero_nm, expected_rad: 0.0, at_expected_nm: at_zero_nm }
    }

    fn by_sine_and_cosine(wave: &Wave, angle_rad: f64) -> [f64; 2] {
        let [cosine_nm, sine_nm] = wave.against_nm;
        let (sine, cosine) = (wave.periods_per_rev * angle_rad).sin_cos();
        [-(cosine_nm * cosine + sine_nm * sine), cosine_nm * sine - sine_nm * cosine]
    }

    /// At an angle; `step_rad` later it will be asked for again.
    #[inline(always)]
    fn torque_nm(&mut self, angle_rad: f64, step_rad: f64) -> f64 {
        let mut phase = self.wave.periods_per_rev * (angle_rad - self.expected_rad);
        if phase.abs() > Self::NEAR {
            self.at_expected_nm = self.by_series(angle_rad);
            phase = 0.0;
        }
        let [here_nm, on_nm] = self.at_expected_nm;
        self.expected_rad = angle_rad + step_rad;
        self.at_expected_nm = self.by_series(self.expected_rad);
        here_nm + phase * (on_nm - phase * (0.5 * here_nm))
    }

    /// At an angle, and a quarter of a period on; by Taylor's series from the anchor.
    #[inline(always)]
    fn by_series(&mut self, angle_rad: f64) -> [f64; 2] {
        let since = |wave: &Self| wave.wave.periods_per_rev * (angle_rad - wave.anchor_rad);
        let mut x = since(self);
        if x.abs() > Self::REACH {
            // Ahead of the shaft, so that it stays near for longer.
            self.anchor(angle_rad + 0.9 * Self::REACH.copysign(x) / self.wave.periods_per_rev);
            x = since(self);
        }
        let x2 = x * x;
        let x4 = x2 * x2;
        // Products with constants: a quotient would take as long as the rest together.
        let cosine = (1.0 - x2 * 0.5) + x4 * ((1.0 / 24.0 - x2 * (1.0 / 720.0)) + x4 * (1.0 / 40_320.0));
        let sine = (1.0 - x2 * (1.0 / 6.0)) + x4 * ((1.0 / 120.0 - x2 * (1.0 / 5_040.0)) + x4 * (1.0 / 362_880.0));
        let [here_nm, on_nm] = self.at_anchor_nm;
        let sine = x * sine;
        [here_nm * cosine + on_nm * sine, on_nm * cosine - here_nm * sine]
    }

    #[inline(never)]
    fn anchor(&mut self, angle_rad: f64) {
        self.anchor_rad = angle_rad;
        self.at_anchor_nm = Self::by_sine_and_cosine(&self.wave, angle_rad);
    }
}

impl Plant for Held {
    fn advance(&mut self, dt_s: f64, inputs: &Inputs) {
        if dt_s <= 0.0 {
            return;
        }
        let steps = (dt_s / LONGEST_STEP_S - 1e-9).ceil().max(1.0);
        let step_s = dt_s / steps;
        for _ in 0..steps as usize {
            self.warm_up();
            let start_a = self.motor.current_a();
            let torques = self.torques.over(step_s, 0.0, (self.motor.motion(), start_a), inputs);
            self.motor.advance_under(step_s, inputs, torques);
            self.torques.remember(self.motor.motion(), start_a);
            self.torques.time_s += step_s;
        }
    }

    fn advance_pwm(&mut self, pwm: &Pwm, inputs: &Inputs, ends: &mut [PeriodEnd]) {
        self.warm_up();
        let from_s = self.torques.time_s;
        let torques = &mut self.torques;
        let pulse_part = pwm.pulse_s / pwm.period_s;
        let mut period = 0.0;
        let pulse_a = self.motor.advance_pwm_under(pwm, inputs, ends, |state, pulse_a| {
            torques.time_s = from_s + period * pwm.period_s;
            period += 1.0;
            torques.over(pwm.period_s, pulse_part, (state, pulse_a), inputs)
        });
        self.torques.remember(self.motor.motion(), pulse_a);
        self.torques.time_s = from_s + ends.len() as f64 * pwm.period_s;
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

/// Of the motor's own shaft.
fn motor_inertia_kg_m2(model: &Model) -> f64 {
    model.motor.inertia_kg_m2 * model.motor_share()
}

/// Whether the event-exact motor contains an effect.
fn is_exact(term: &Term) -> bool {
    term.effect.is_dry_losses_alone(&term.values)
}

/// The parameters of those.
fn exact_losses(model: &Model) -> DryLosses {
    model.terms.iter().filter(|term| is_exact(term)).map(Term::dry_losses).sum()
}

/// The motor of a model, without effects that it does not contain.
fn event_exact(bridge: BridgeLosses, model: &Model) -> DcMotor {
    let losses = exact_losses(model);
    let drop_v = losses.bridge_drop_v;
    DcMotor::new(DcMotorParameters {
        resistance_ohm: model.motor.resistance_ohm,
        inductance_h: model.motor.inductance_h,
        torque_constant_nm_per_a: model.motor.torque_constant_nm_per_a,
        inertia_kg_m2: motor_inertia_kg_m2(model),
        viscous_friction_nms_per_rad: model.motor.viscous_friction_nm_s,
        coulomb_friction_nm: losses.friction_forward_nm,
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
        Self {
            inertia_kg_m2: motor_inertia_kg_m2(&model),
            steps: [LinearStep::default(); 4],
            states: model.terms.iter().map(|term| vec![0.0; term.effect.states()]).collect(),
            model,
            bridge,
            time_s: 0.0,
            angle_rad: 0.0,
            speed_rad_per_s: 0.0,
            current_a: 0.0,
            supply_v: 0.0,
            mean_duty: 0.0,
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
        self.mean_duty += (duty - self.mean_duty) * step_s / (CAPACITOR_S + step_s);
        let mut at = Instant {
            time_s: self.time_s,
            voltage_v: duty * inputs.supply_v,
            duty,
            mean_duty: self.mean_duty,
            supply_v: inputs.supply_v,
            open: false,
            current_a: self.current_a,
            speed_rad_per_s: self.speed_rad_per_s,
            angle_rad: self.angle_rad,
            turned_rad: 0.0,
            step_s,
        };
        for (term, state) in self.model.terms.iter().zip(&mut self.states) {
            term.effect.contribute(&term.values, &self.model.motor, &at, state, &mut terms);
        }
        let before = self.speed_rad_per_s;
        let reached = linear.take(self.current_a, before, Input::Voltage(at.voltage_v), &terms);
        (self.current_a, self.speed_rad_per_s) = (reached.current_a, reached.speed_rad_per_s);
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
    use motorbench_model::catalogue::effect;

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

    /// A supply behind a capacitor gives the mean of what pulses draw, and at half duty loses half as much in each of them.
    #[test]
    fn a_capacitor_halves_the_sag_at_half_duty() {
        let (source_ohm, duty) = (2.0, 0.5);
        for within_pulses in [0.0, 1.0] {
            let values = vec![source_ohm, within_pulses];
            let model = Model::linear(MotorParameters::PIVT6).with(effect("supply_sag").unwrap(), values);
            let mut plant = ModelPlant::new(model);
            let pulse = Inputs { bridge: Bridge::Forward, blocked: true, ..Inputs::default() };
            let rest = Inputs { bridge: Bridge::Brake, ..pulse };
            let mut mean_a = 0.0;
            for period in 0..2000 {
                plant.advance(duty * 50e-6, &pulse);
                plant.advance((1.0 - duty) * 50e-6, &rest);
                mean_a += if period >= 1000 { plant.current_a() / 1000.0 } else { 0.0 };
            }
            let in_series_ohm = source_ohm * duty * if within_pulses > 0.0 { 1.0 } else { duty };
            let expected_a = duty * pulse.supply_v / (MotorParameters::PIVT6.resistance_ohm + in_series_ohm);
            // At the end of a period the current is below its mean by half its swing.
            assert!((mean_a / expected_a - 1.0).abs() < 0.02, "{within_pulses}: {mean_a} {expected_a}");
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

    /// A wave that is followed against sine and cosine: slow and fast, both directions, as expected and not, many turns.
    #[test]
    fn a_wave_that_is_followed_is_the_wave() {
        let wave = Wave { against_nm: [2e-3, -1e-3], periods_per_rev: 14.0 };
        for (step_rad, unexpected_rad) in [(1e-5, 0.0), (0.004, 1e-5), (-0.009, -3e-5), (0.002, 1e-3), (0.3, 0.0)] {
            let mut followed = FollowedWave::new(wave);
            for step in 0..20_000 {
                let angle_rad = f64::from(step) * step_rad;
                let (found, expected) =
                    (followed.torque_nm(angle_rad, step_rad + unexpected_rad), wave.torque_nm(angle_rad));
                assert!((found - expected).abs() < 1e-13, "{angle_rad}: {found} {expected}");
            }
        }
    }

    /// Effects with a memory beside the exact solution against the same stepped by terms, a hundred times as finely.
    #[test]
    fn memory_beside_events_agrees_with_fine_steps() {
        let friction = Model::linear(MotorParameters::PIVT6).with(effect("coulomb_friction").unwrap(), vec![0.006]);
        let friction = friction.with(effect("voltage_drop").unwrap(), vec![1.8]);
        for (id, values, bound_rad_per_s, bound_a) in [
            ("winding_heating", vec![0.2, 0.3], 0.03, 3e-4),
            ("shaft_compliance", vec![40.0, 0.4, 0.05], 0.03, 3e-4),
            ("backlash", vec![0.02, 0.4, 300.0, 0.4], 0.12, 3e-4),
        ] {
            let model = friction.with(effect(id).unwrap(), values);
            let mut plant = ModelPlant::new(model.clone());
            assert!(matches!(plant.0, Solver::Held(_)), "{id}");
            let mut fine = Stepwise::new(BridgeLosses::DIODES, model);
            let mut largest = [0.0_f64; 2];
            for tick in 0..400 {
                let duty = 0.7 * (f64::from(tick) * 0.02).sin();
                let pwm = Pwm {
                    pulse: if duty < 0.0 { Bridge::Reverse } else { Bridge::Forward },
                    rest: Bridge::Brake,
                    pulse_s: 50e-6 * duty.abs(),
                    period_s: 50e-6,
                    sampled_s: 48e-6,
                };
                plant.advance_pwm(&pwm, &Inputs::default(), &mut [PeriodEnd::default(); 20]);
                for _ in 0..20 {
                    for (bridge, dt_s) in pwm.parts(0.0, pwm.period_s) {
                        let inputs = Inputs { bridge, ..Inputs::default() };
                        (0..50).for_each(|_| fine.advance(dt_s / 50.0, &inputs));
                    }
                }
                largest[0] = largest[0].max((plant.speed_rad_per_s() - fine.speed_rad_per_s).abs());
                largest[1] = largest[1].max((plant.current_a() - fine.current_a).abs());
            }
            println!("{id}: {:.1e} rad/s, {:.1e} A from steps of 0.5 us", largest[0], largest[1]);
            assert!(largest[0] < bound_rad_per_s && largest[1] < bound_a, "{id}: {largest:?}");
        }
    }
}
